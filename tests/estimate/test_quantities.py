"""Estimated errors of friction work, work and wear, compared with runs in more steps and on finer meshes."""

import numpy as np
import pytest
from scenes import mostly_slow

import block_in_space
import missed_reversal
import two_blocks_in_series
import vemcvx as vx

NAMES = ["dissipated", "work", "wear"]
SECOND_ORDER = "dissipated_second_order", "work_second_order"


def rubbed(plate, mesh, end=1.0, coefficient=0.3):
    """Return a function that runs the scene in a given number of steps. The top of the body moves by plate(t)."""
    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.tile(plate(t), (len(x), 1)), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom"),
    )
    return lambda steps: vx.simulate(scene, mesh, np.linspace(0.0, end, steps + 1))


def pad(steps, n=5):
    """Return the run of a pad that is pressed and rubbed to and fro."""
    mesh = vx.meshes.squares(n, box=((0.0, 2.0), (0.0, 1.0)))
    return rubbed(lambda t: [0.06 * np.sin(np.pi * t), -0.02 * min(t, 1.0)], mesh, end=2.0)(steps)


def problem(module, n):
    return lambda steps: vx.simulate(module.scene(), module.mesh(n), module.times(steps))


RUNS = {
    "Coulomb": (pad, 24),
    "Tresca, reversal missed": (problem(missed_reversal, 6), 9),
    "two bodies": (problem(two_blocks_in_series, 3), 16),
    "space": (problem(block_in_space, 3), 12),
    "Coulomb, round a corner in space": (
        rubbed(
            lambda t: [0.03 * min(t, 1.0), 0.02 * max(t - 1.0, 0.0), -0.03 * min(2.0 * t, 1.0)],
            vx.meshes.cubes(2),
            end=2.0,
            coefficient=0.2,
        ),
        8,
    ),
}


def final_values(history):
    """Return friction work, work and the largest wear at the end of a run."""
    run = history.trajectory
    wear = history.contact.wear_second_order[-1].max()
    return [run.dissipated_second_order[-1], run.work_second_order[-1], wear]


def measure_errors(history, truth):
    """Return the errors of friction work and of work, and the largest error of wear at a node."""
    one, other = history.trajectory, truth.trajectory
    wear = [run.contact.wear_second_order[-1] for run in (history, truth)]
    energies = [abs(getattr(one, name)[-1] - getattr(other, name)[-1]) for name in SECOND_ORDER]
    return [*energies, np.abs(wear[0] - wear[1]).max()]


@pytest.mark.long
@mostly_slow("name", RUNS, *(name for name in RUNS if not name.startswith("Coulomb")))
def test_estimated_errors_of_steps_are_one_to_five_times_the_true_errors(name):
    run, steps = RUNS[name]
    history = run(steps)
    found, exact = vx.quantities(history), run(32 * steps)
    truth = final_values(exact)
    assert list(found) == NAMES
    assert [one.value for one in found.values()] == final_values(history)
    for one, true, off in zip(found.values(), truth, measure_errors(history, exact), strict=True):
        # The solver has errors of at most 1e-8 in the energy norm.
        assert abs(one.value - true) <= off <= one.steps + 1e-8 * abs(true)
        assert one.steps <= 5.0 * off + 1e-8 * abs(true)
        assert one.error == (one.steps if np.isnan(one.mesh) else one.steps + one.mesh)
        assert not np.isnan(one.mesh)


@pytest.mark.long
def test_estimated_errors_of_the_mesh_are_one_to_five_times_the_true_errors():
    """The reference has squares of side 1/40. Wear is left out, because wear is unbounded at a corner."""
    steps = 8
    truth = final_values(pad(steps, 40))
    for n in (5, 10):
        found = vx.quantities(pad(steps, n))
        for name, true in zip(NAMES[:2], truth, strict=False):
            off = abs(found[name].value - true)
            assert off <= found[name].mesh <= 5.0 * off


@pytest.mark.slow
def test_wear_on_a_compliant_floor_has_an_error_and_wear_on_a_rigid_floor_is_unbounded():

    def top(x, t):
        return np.tile([0.02 * np.sin(5 * t), -0.01 * (1 - np.cos(7 * t))], (len(x), 1))

    def rubbed_on(floor):
        steel = vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement(top, on="top")
        return vx.Scene(*steel, floor, vx.CoulombFriction(0.3, on="bottom"))

    times = np.linspace(0.0, 1.0, 7)
    soft, rigid = rubbed_on(vx.NormalCompliance(500.0, on="bottom")), rubbed_on(vx.UnilateralContact(on="bottom"))
    truth = vx.simulate(soft, vx.meshes.squares(96), times, store="last").contact.wear_second_order[-1].max()
    for n in (4, 8, 16):
        found = vx.quantities(vx.simulate(soft, vx.meshes.squares(n), times))["wear"]
        assert 1.0 <= found.mesh / abs(found.value - truth) <= 6.0
        assert found.unbounded == ""
    found = vx.quantities(vx.simulate(rigid, vx.meshes.squares(4), times))
    assert found["wear"].unbounded.startswith("at a corner of contact with friction and ")
    assert found["wear"].words.endswith(found["wear"].unbounded)
    assert found["dissipated"].unbounded == ""


@pytest.mark.long
def test_histories_from_files_have_no_quantities(tmp_path):
    pad(6, 3).write(tmp_path)
    with pytest.raises(vx.HistoryError, match=r"quantities: this history was read from files"):
        vx.quantities(vx.read_history(tmp_path))
