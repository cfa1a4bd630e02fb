"""`vemcvx doctor` lists packages and solvers, and marks packages and solvers that do not work."""

from __future__ import annotations

import numpy as np
import pytest
from called import call

import vemcvx as vx
from vemcvx.cli import doctor


@pytest.mark.long
def test_this_installation_works():
    code, output = call("doctor")
    assert code == 0, output
    assert output.rstrip().endswith("All is well.")
    for word in ("vemcvx", f"numpy           {np.__version__}", "newton", "clarabel", "osqp", "superlu"):
        assert f"\n{word}" in f"\n{output}"


@pytest.mark.long
def test_a_missing_package_is_named(monkeypatch):
    known = doctor.version_of
    monkeypatch.setattr(doctor, "version_of", lambda name: None if name in ("osqp", "pyamg") else known(name))
    code, output = call("doctor")
    assert code == 1
    assert "missing: install vemcvx again" in output
    assert "optional: pip install 'vemcvx[multigrid]'" in output
    assert "Failed: osqp." in output


@pytest.mark.long
def test_an_answer_with_a_false_certificate_is_named(monkeypatch):
    """The steps are solved and certified with forces that are too large by a millionth."""
    march = doctor.march

    def wrong(system, *given, **named):
        return march(vx.System(system.K, lambda t: 1.000001 * system.force(t), system.norms), *given, **named)

    monkeypatch.setattr(doctor, "march", wrong)
    code, output = call("doctor")
    assert code == 1
    assert ": above its certificate" in output
