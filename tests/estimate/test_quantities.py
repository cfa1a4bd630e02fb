"""Friction work, work and wear with estimated errors: against runs of many steps, and on finer meshes."""

import logging

import numpy as np
import pytest

import block_in_space
import feng_han_huang
import missed_reversal
import two_blocks_in_series
import vemcvx as vx

NAMES = ["dissipated", "work", "wear"]


def pad(steps, n=5):
    """Pressed on a rough floor while it is rubbed to and fro, with Coulomb's law."""

    def plate(x, t):
        return np.tile([0.06 * np.sin(np.pi * t), -0.02 * min(t, 1.0)], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(plate, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    )
    return vx.simulate(scene, vx.meshes.squares(n, box=((0.0, 2.0), (0.0, 1.0))), np.linspace(0.0, 2.0, steps + 1))


def approaching(steps, n=4):
    """A block that closes a gap while it is dragged."""

    def plate(x, t):
        return np.tile([0.05 * t, -0.03 * t], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(plate, on="top"),
        vx.UnilateralContact(on="bottom", gap=0.01),
        vx.CoulombFriction(0.2, on="bottom"),
    )
    return vx.simulate(scene, vx.meshes.squares(n), np.linspace(0.0, 1.0, steps + 1))


def problem(module, n):
    return lambda steps: vx.simulate(module.scene(), module.mesh(n), module.times(steps))


RUNS = {
    "Coulomb": (pad, 24),
    "Coulomb, approached": (approaching, 15),
    "Tresca": (problem(feng_han_huang, 6), 8),
    "Tresca, reversal missed": (problem(missed_reversal, 6), 9),
    "two bodies": (problem(two_blocks_in_series, 3), 16),
    "space": (problem(block_in_space, 3), 12),
}


def at_the_end(history):
    run = history.trajectory
    worn = history.contact.wear_second_order[-1].max()
    return [run.dissipated_second_order[-1], run.work_second_order[-1], worn]


@pytest.mark.parametrize("name", RUNS)
def test_errors_of_steps_are_one_to_five_times_the_truth(name):
    run, steps = RUNS[name]
    history = run(steps)
    found, truth = vx.quantities(history), at_the_end(run(32 * steps))
    assert list(found) == NAMES
    assert [one.value for one in found.values()] == at_the_end(history)
    for one, true in zip(found.values(), truth, strict=True):
        off = abs(one.value - true)
        # Rounding and the solver's accuracy, which is that of states, 1e-8 of their energy norm at most.
        assert off <= one.steps + 1e-8 * abs(true)
        assert one.steps <= 5.0 * off + 1e-8 * abs(true)
        assert one.error == (one.steps if np.isnan(one.mesh) else one.steps + one.mesh)
        assert np.isnan(one.mesh) == (name == "space")


def test_errors_of_the_mesh_cover_what_finer_meshes_find():
    """On squares of the widths 1/5 and 1/10 against 1/40, whose own error is a small part of theirs.

    The largest wear is at a corner, where it grows without limit: it is no quantity of the continuum.
    """
    steps = 8
    truth = at_the_end(pad(steps, 40))
    for n in (5, 10):
        found = vx.quantities(pad(steps, n))
        for name, true in zip(NAMES[:2], truth, strict=False):
            off = abs(found[name].value - true)
            assert off <= found[name].mesh <= 5.0 * off


def test_the_budget_has_them():
    history = pad(6, 3)
    budget = vx.error_budget(history)
    assert budget.quantities == vx.quantities(history)
    assert budget.quantities["dissipated"].error > 0


def test_runs_that_were_read_are_refused(tmp_path):
    history = pad(2, 2)
    history.write(tmp_path)
    with pytest.raises(vx.HistoryError, match=r"quantities: this history was read from files"):
        vx.quantities(vx.read_history(tmp_path))


def test_lost_work_is_warned_of_once_and_only_where_it_counts(caplog):
    """5.8 % with 16 steps, 1.5 % with 64: by the balance the work is the same."""
    run = problem(feng_han_huang, 6)
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        run(64)
        assert not caplog.records
        run(8)
    assert len(caplog.records) == 1
    said = caplog.records[0].getMessage()
    assert "Quote history.work_second_order and dissipated_second_order" in said
    assert "% off that of second order" in said
