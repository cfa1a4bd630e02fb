"""The problem files of heated bodies against their closed forms, in a small setting and by the command line."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.fixture(autouse=True)
def problems(monkeypatch):
    monkeypatch.syspath_prepend(PROBLEMS)


@pytest.mark.long
def test_a_heated_bar_expands_from_its_ends_and_comes_half_way_back():
    """The rod's error is of the order of H / l = 1 / 20, measured 0.3 % in the end and 0.5 % in the loss."""
    bar = importlib.import_module("thermal_expansion_blocked_by_friction")
    history = vx.simulate(bar.scene(), bar.mesh(4), bar.times(24))
    mesh = history.mesh
    end = history.displacement[:, mesh.points[:, 0] == bar.LENGTH, 0].mean(axis=1)
    assert end[[8, 16, 24]] == pytest.approx(bar.end_displacement(), rel=0.005)
    # The second heating ends where the first did: nothing remembers the cycle between.
    assert end[24] == pytest.approx(end[8], rel=1e-9)
    assert history.dissipated[8] == pytest.approx(bar.first_dissipation(), rel=0.01)
    locked = mesh.centroids[:, 0] < bar.LENGTH - bar.slip_length() - 2 * bar.HEIGHT
    blocked = bar.YOUNG * bar.EXPANSION * bar.RISE
    assert np.abs(history.stress(8)[locked] - [-blocked, 0.0, 0.0]).max() < 0.005 * blocked
    # The middle holds back the whole blocked force, and everything beyond the slip length sticks.
    sticks = history.contact.sticking[8] & (history.contact.points[:, 0] > 0)
    reach = bar.LENGTH - history.contact.points[sticks, 0].max()
    assert reach == pytest.approx(bar.slip_length(), rel=0.05)
    assert history.reaction("left")[8, 0] == pytest.approx(blocked * bar.HEIGHT, rel=0.005)
    assert history.certificate.max() < 1e-8
    assert history.dissipated[8] == pytest.approx(0.066342783247750265, rel=1e-6)


@pytest.mark.long
def test_a_bimetallic_strip_bends_as_timoshenko_says():
    """Squares of h = H / 8 bend 2 % too little, those of H / 16 0.6 %, of H / 32 0.2 %: order h^2."""
    strip = importlib.import_module("bimetallic_strip")
    errors = []
    for n in (8, 16):
        history = vx.simulate(strip.scene(), strip.mesh(n), strip.times(4))
        x, u = history.mesh.points[:, 0], history.displacement[-1, :, 1]
        found = u[x == strip.LENGTH].mean() - u[x == 0].mean()
        errors.append(1 - found / strip.deflection())
        # In equilibrium with itself: neither rollers nor springs bear a force.
        assert np.abs(history.reaction("left")[-1]).max() < 1e-9 * strip.YOUNG[0]
    assert 0 < errors[1] < 0.007
    assert 3 < errors[0] / errors[1] < 4.5
    assert found == pytest.approx(0.01156439371211594, rel=1e-6)


@pytest.mark.long
def test_wood_bends_it_by_its_modulus_along_the_strip():
    """Along and nearly across the strip 0.04 % and 1 % (order h^2); aslant the rollers at x = 0 hold shear, 3 %."""
    strip = importlib.import_module("bimetallic_strip")
    for grain, tolerance in {0.0: 0.001, 0.5: 0.04, 1.5: 0.02}.items():
        history = vx.simulate(strip.scene(grain), strip.mesh(16), strip.times(1))
        x, u = history.mesh.points[:, 0], history.displacement[-1, :, 1]
        assert u[x == strip.LENGTH].mean() - u[x == 0].mean() == pytest.approx(strip.deflection(grain), rel=tolerance)
    assert strip.deflection(1.5) < 0.9 * strip.deflection(0.5)


@pytest.mark.long
@pytest.mark.parametrize("name", ["thermal_expansion_blocked_by_friction", "bimetallic_strip"])
def test_by_the_command_line(name, tmp_path):
    run = CliRunner().invoke(
        app, ["run", str(PROBLEMS / f"{name}.py"), "--n", "4", "--steps", "3", "--out", str(tmp_path)]
    )
    assert run.exit_code == 0, run.output
    history = vx.read_history(tmp_path)
    assert history.prestress.shape == (4, history.mesh.n_cells, 3)
    assert CliRunner().invoke(app, ["show", str(PROBLEMS / f"{name}.py"), "--n", "4"]).exit_code == 0
