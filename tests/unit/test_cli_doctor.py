"""`vemcvx doctor` says what is there, and notices what is not well."""

from __future__ import annotations

import numpy as np
import pytest
from called import call

import vemcvx as vx
from vemcvx.cli import doctor


@pytest.mark.long
def test_all_is_well_here():
    code, said = call("doctor")
    assert code == 0, said
    assert said.rstrip().endswith("All is well.")
    for word in ("vemcvx", f"numpy           {np.__version__}", "newton", "clarabel", "osqp", "superlu"):
        assert f"\n{word}" in f"\n{said}"


@pytest.mark.long
def test_a_missing_package_is_named(monkeypatch):
    known = doctor.version_of
    monkeypatch.setattr(doctor, "version_of", lambda name: None if name in ("osqp", "pyamg") else known(name))
    code, said = call("doctor")
    assert code == 1
    assert "missing: install vemcvx again" in said
    assert "optional: pip install 'vemcvx[multigrid]'" in said
    assert "Failed: osqp." in said


@pytest.mark.long
def test_a_solver_that_does_not_converge_is_named(monkeypatch):
    monkeypatch.setitem(doctor.NAMES, "newton", lambda: vx.Newton(accuracy=1e-30))
    code, said = call("doctor")
    assert code == 1
    assert "does not work: step 1" in said
    assert "Failed: newton." in said


@pytest.mark.long
def test_an_answer_beyond_its_certificate_is_named(monkeypatch):
    """Forces that are a millionth too large certify well and are wrong."""
    march = doctor.march

    def wrong(system, *given, **named):
        return march(vx.System(system.K, lambda t: 1.000001 * system.force(t), system.norms), *given, **named)

    monkeypatch.setattr(doctor, "march", wrong)
    code, said = call("doctor")
    assert code == 1
    assert ": above its certificate" in said
