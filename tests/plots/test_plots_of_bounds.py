"""Pictures of guaranteed bounds show what the bounds are, and only where there are some."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scenes import cyclic, paper_scene

import vemcvx as vx
from vemcvx.plots import energy_ledger, error_map, hysteresis_loop
from vemcvx.plots.pictures import draw_pictures

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def bounded():
    return vx.simulate(paper_scene(cyclic), vx.meshes.squares(4), np.linspace(0.0, 1.0, 5), bound=True)


def bars(ax):
    """The lower and upper ends of the error bars of axes (k, 2), and where they stand (k,)."""
    (drawn,) = ax.containers
    ends = np.array(drawn.lines[2][0].get_segments())
    return ends[:, :, 1], ends[:, 0, 0]


@pytest.mark.long
def test_energies_have_bars_where_the_exact_ones_are(bounded):
    ends, times = bars(energy_ledger(bounded).axes[0])
    assert np.array_equal(times, bounded.times)
    bounds = [vx.error_bound(bounded, step=n).energy for n in range(1, 5)]
    assert np.allclose(ends[1:], bounds)
    assert (bounded.energy_bounds[:, 0] <= bounded.energy_bounds[:, 1]).all()


@pytest.mark.long
def test_the_map_shows_the_parts_of_cells(bounded):
    figure = error_map(bounded)
    shown = 10.0 ** figure.axes[0].collections[0].get_array()
    worst = vx.error_bound(bounded, step=int(bounded.bound["step"]))
    density = np.sqrt(worst.cells / bounded.mesh.areas)
    assert np.allclose(shown, np.maximum(density / density.max(), 1e-3))
    assert f"{bounded.bound['relative']:.2%}" in figure.axes[0].get_title()


@pytest.mark.long
def test_they_are_drawn_where_there_are_bounds(bounded, tmp_path):
    assert "error_map" in draw_pictures(bounded, None)
    read = vx.read_history(bounded.write(tmp_path / "run"))
    assert np.array_equal(read.energy_bounds, bounded.energy_bounds)
    assert np.array_equal(read.cell_bounds, bounded.cell_bounds)
    assert "error_map" in draw_pictures(read, None)
    free = vx.simulate(bounded.scene, bounded.mesh, [0.0, 1.0])
    assert "error_map" not in draw_pictures(free, None)
    with pytest.raises(vx.HistoryError, match="bound=True"):
        error_map(free)
    assert not energy_ledger(free).axes[0].containers


def way(x, t):
    return 0.01 * np.sin(2.0 * np.pi * t) + 0.0 * x[:, 0]


PULLED = vx.PrescribedDisplacement(way, on="right", direction=(1.0, 0.0))
RUBBED = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.2, on="bottom")


@pytest.mark.long
def test_the_loop_has_bars_of_its_force():
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Symmetry(on="left"), PULLED, vx.Symmetry(on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(2), np.linspace(0.0, 1.0, 5))
    force = vx.PrescribedDisplacement(1.0, on="right", direction=(1.0, 0.0))
    found = [vx.error_bound(history, n, force) for n in range(1, 5)]
    between = np.array([[np.nan, np.nan], *((one.low, one.high) for one in found)])
    ends, _ = bars(hysteresis_loop(history, between=between).axes[0])
    assert np.allclose(ends, between[1:])
    # Uniaxial stress, which all meshes have exactly.
    assert np.allclose(between[1:].mean(axis=1), history.reaction("right")[1:, 0], atol=1e-9)
    with pytest.raises(vx.SceneError, match="between"):
        hysteresis_loop(history, between=[1.0, 2.0])


@pytest.mark.long
def test_runs_with_a_bound_have_bars_of_the_force_that_moves_them(tmp_path):
    """By a theorem in every step, whatever sticks and slips; kept in files, and said in the summary and the report."""
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Symmetry(on="left"), PULLED, *RUBBED)
    history = vx.simulate(scene, vx.meshes.squares(4), np.linspace(0.0, 1.0, 5), bound=True)
    assert history.bounded_force == {"right": 0}
    force = vx.PrescribedDisplacement((1.0, 0.0), on="right")
    bounds = [vx.error_bound(history, n, force) for n in range(1, 5)]
    certain = np.array([(bound.low, bound.high) for bound in bounds])
    assert np.allclose(history.force_bounds[1:], certain, rtol=1e-9)
    assert np.isnan(history.force_bounds[0]).all()
    ends, _ = bars(hysteresis_loop(history).axes[0])
    assert np.allclose(ends, certain)
    assert not hysteresis_loop(history, on="top").axes[0].containers
    fine = vx.simulate(scene, vx.meshes.squares(24), np.linspace(0.0, 1.0, 5)).reaction("right")[1:, 0]
    assert ((certain[:, 0] < fine) & (fine < certain[:, 1])).all()
    read = vx.read_history(history.write(tmp_path / "run"))
    assert read.bounded_force == history.bounded_force
    assert np.array_equal(read.force_bounds, history.force_bounds, equal_nan=True)
    told = json.loads((tmp_path / "run" / "summary.json").read_text())["bound_force"]
    assert (told["on"], told["axis"]) == ("right", 0)
    assert told["low"] == history.force_bounds[-1, 0] < told["value"] < told["high"]


def test_a_force_without_a_theorem_has_no_bars():
    """What a support does that presses the edge of an obstacle cannot be told apart from what the obstacle does."""
    lifted = vx.PrescribedDisplacement(way, on="right", direction=(0.0, 1.0))
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), lifted, vx.UnilateralContact(on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 0.25], bound=True)
    assert history.bound is not None
    assert history.force_bounds is None
    assert not hysteresis_loop(history).axes[0].containers
