"""Pictures show guaranteed bounds as bars."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scenes import cyclic, paper_scene

import vemcvx as vx
from vemcvx.plots import energy_ledger, hysteresis_loop

pytest.importorskip("matplotlib")
TIMES = np.linspace(0.0, 1.0, 5)
STEEL = vx.Elasticity(200.0, 0.3)


@pytest.fixture(scope="module")
def bounded():
    return vx.simulate(paper_scene(cyclic), vx.meshes.squares(4), TIMES, bound=True)


def find_bars(ax):
    """Return ends (k, 2) and places (k,) of error bars."""
    (drawn,) = ax.containers
    ends = np.array(drawn.lines[2][0].get_segments())
    return ends[:, :, 1], ends[:, 0, 0]


@pytest.mark.long
def test_bounds_of_the_energy_are_bars_in_the_ledger_and_in_files(bounded, tmp_path):
    ends, times = find_bars(energy_ledger(bounded).axes[0])
    assert np.array_equal(times, bounded.times)
    assert np.allclose(ends[1:], [vx.error_bound(bounded, step=n).energy for n in range(1, 5)])
    read = vx.read_history(bounded.write(tmp_path / "run"))
    assert np.array_equal(read.energy_bounds, bounded.energy_bounds)
    assert np.array_equal(read.cell_bounds, bounded.cell_bounds)


def test_histories_without_bounds_have_no_bars():
    free = vx.simulate(paper_scene(cyclic), vx.meshes.squares(4), [0.0, 1.0])
    assert not energy_ledger(free).axes[0].containers


def pull(*effects):
    """Return a scene in which the right side moves to and fro."""
    moved = vx.PrescribedDisplacement(
        lambda x, t: 0.01 * np.sin(2.0 * np.pi * t) + 0.0 * x[:, 0], on="right", direction=(1.0, 0.0)
    )
    return vx.Scene(STEEL, vx.Symmetry(on="left"), moved, *effects)


@pytest.mark.long
def test_bounds_of_the_driving_force_are_bars_and_in_files(tmp_path):
    """The force on a fine mesh is within the bounds of a coarse mesh."""
    scene = pull(vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.2, on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(4), TIMES, bound=True)
    assert history.bounded_force == {"right": 0}
    force = vx.PrescribedDisplacement((1.0, 0.0), on="right")
    bounds = [vx.error_bound(history, n, force) for n in range(1, 5)]
    certain = np.array([(bound.low, bound.high) for bound in bounds])
    assert np.allclose(history.force_bounds[1:], certain, rtol=1e-9)
    assert np.isnan(history.force_bounds[0]).all()
    ends, _ = find_bars(hysteresis_loop(history).axes[0])
    assert np.allclose(ends, certain)
    assert not hysteresis_loop(history, on="top").axes[0].containers
    fine = vx.simulate(scene, vx.meshes.squares(24), TIMES).reaction("right")[1:, 0]
    assert ((certain[:, 0] < fine) & (fine < certain[:, 1])).all()
    read = vx.read_history(history.write(tmp_path / "run"))
    assert read.bounded_force == history.bounded_force
    assert np.array_equal(read.force_bounds, history.force_bounds, equal_nan=True)
    told = json.loads((tmp_path / "run" / "summary.json").read_text())["bound_force"]
    assert (told["on"], told["axis"]) == ("right", 0)
    assert told["low"] == history.force_bounds[-1, 0] < told["value"] < told["high"]
    words = f"{told['low']:.6g} ... {told['high']:.6g} for the reaction of right along x in the last step"
    assert words in " ".join(history.summary().split())


def test_the_force_of_a_support_at_an_edge_of_an_obstacle_has_no_bounds():
    """The forces of support and obstacle cannot be separated at their common corner."""
    lifted = vx.PrescribedDisplacement(lambda x, t: 0.01 * t + 0.0 * x[:, 0], on="right", direction=(0.0, 1.0))
    scene = vx.Scene(STEEL, vx.Clamp(on="left"), lifted, vx.UnilateralContact(on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 0.25], bound=True)
    assert history.bound is not None
    assert history.force_bounds is None
    assert not hysteresis_loop(history).axes[0].containers
