"""Estimated errors of steps are one to five times the true errors."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from random_scenes import KINDS, coarse_mesh, feature_scene
from scenes import mostly_long, paper_scene

import vemcvx as vx
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.finer_steps import compare_finer_steps
from vemcvx.scene import pose_scene
from vemcvx.stepping import certify_in_full, initial_state, prepare
from vemcvx.stepping.course import sample_course

MOST = 5.0
NOISE = 1e-6
"""Relative errors below this number are errors of the solver."""


def compare_steps(scene, mesh, times, initial=None, parts=24):
    """Return (estimated error) / (true error) of the steps, and the relative true error.

    The reference run splits each step into `parts` steps, and has instants at all kinks and jumps of data.
    """
    posed = pose_scene(scene, mesh)
    run = prepare(posed.system, None, False, True)
    start = certify_in_full(run, initial_state(run, times, initial)).full
    found = compare_finer_steps(run, times, start)
    equal = [np.linspace(a, b, parts + 1) for a, b in pairwise(times)]
    fine = np.union1d(np.concatenate(equal), sample_course(posed.system, times).bends)
    states = [vx.march(posed.system, t, initial=initial, check=False).state for t in (times, fine)]
    apart = states[0] - states[1][np.searchsorted(fine, times)]
    true = np.sqrt(np.maximum(np.einsum("ni,ni->n", apart, (posed.system.K @ apart.T).T), 0.0)).max()
    if found.norm == 0.0:
        assert true <= 1e-12, "without friction, states do not depend on the path"
        return 1.0, 0.0
    return found.errors.max() / max(true, NOISE * found.norm), true / found.norm


def dips(x, t):
    """Return a friction bound that nearly vanishes for a twentieth of the run."""
    return np.full(len(x), 0.02 if 0.43 < t < 0.48 else 4.0)


def held(bound):
    return paper_scene(lambda t: 1.0, bound=bound)


COURSES = {
    "half a wave": lambda t: np.sin(np.pi * t),
    "turn": lambda t: np.interp(t, [0.0, 0.37, 1.0], [0.0, 2.0, -1.2]),
    "pulse": lambda t: 2 * max(0.0, 1.0 - abs(t - 0.43) / 0.05),
    "jump": lambda t: 0.5 * t + (t > 0.3) - 0.8 * (t > 0.7),
}


@pytest.mark.parametrize("steps", [1, pytest.param(4, marks=pytest.mark.long), pytest.param(9, marks=pytest.mark.slow)])
@mostly_long("name", COURSES, "jump")
def test_estimated_errors_of_steps_are_one_to_five_times_the_true_errors(name, steps):
    found, true = compare_steps(paper_scene(COURSES[name]), vx.meshes.squares(4), np.linspace(0, 1, steps + 1))
    if true > NOISE:
        assert 1.0 <= found <= MOST
    assert found <= MOST


@pytest.mark.long
def test_adapted_steps_meet_a_dip_of_the_bound_and_jumps_are_named():
    """A single step misses the dip completely."""
    before = compare_steps(held(dips), vx.meshes.squares(4), np.array([0.0, 1.0]), "settled")
    assert 1.0 <= before[0] <= MOST
    assert before[1] > 0.3
    found = vx.adapt(held(dips), vx.meshes.squares(4), [0.0, 1.0], 0.2, initial="settled")
    times = found.history.trajectory.times
    assert found.met
    assert np.abs(times[:, None] - [0.43, 0.48]).min(axis=0).max() <= 1e-9
    assert len(times) <= 8
    jumps = [f"the bound of friction jumps at t = {t}; no step size resolves the jump" for t in (0.43, 0.48)]
    assert list(found.budget.jumps) == jumps
    assert jumps[0] in found.summary()
    truth = vx.simulate(held(dips), found.history.mesh.refine(), np.linspace(0, 1, 41), store="last", initial="settled")
    assert vx.measures.energy_distance(found.history, truth).relative <= 0.2
    slope = paper_scene(lambda t: np.clip((t - 0.3) * 50, 0.0, 1.0))
    assert error_budget(vx.simulate(slope, vx.meshes.squares(3), [0.0, 1.0])).jumps == ()


def find_course(scene, times=(0.0, 1.0)):
    return sample_course(pose_scene(scene, vx.meshes.squares(3)).system, np.array(times))


@pytest.mark.long
def test_tops_of_smooth_data_are_found():
    """The load is largest at .401, near the instant .4."""
    scene, top = paper_scene(lambda t: 1.0 - (t - 0.401) ** 2 * 3, bound=1.0), 0.401
    times = np.array([0.0, 0.2, 0.4, 0.6, 1.0])
    assert np.abs(find_course(scene, times).bends - top).min() <= 1e-9
    found, lost = compare_steps(scene, vx.meshes.squares(4), times, "settled", 40)
    assert 1e-8 < lost < 1e-4
    assert found >= 1.0


@pytest.mark.long
def test_bends_of_obstacles_and_supports_are_found():
    steel = vx.Elasticity(200.0, 0.3)
    rubbed = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=2.0, on="bottom")

    def carried(x, t):
        return np.column_stack([np.full(len(x), 0.1 * min(t, 1.2 - t)), np.zeros(len(x))])

    scene = vx.Scene(steel, vx.PrescribedDisplacement(carried, on="top"), *rubbed)
    assert np.abs(find_course(scene).bends - 0.6).min() <= 1e-12
    assert 1.0 <= compare_steps(scene, vx.meshes.squares(4), np.array([0.0, 1.0]))[0] <= MOST
    rises = vx.UnilateralContact(on="bottom", gap=lambda x, t: np.full(len(x), 0.02 + 0.01 * abs(t - 0.3)))
    assert np.abs(find_course(vx.Scene(steel, vx.Clamp(on="top"), rises)).bends - 0.3).min() <= 1e-12


@pytest.mark.long
@pytest.mark.parametrize(("lifted", "initial"), [(0.0, None), (1.0, "settled")])
def test_the_estimate_does_not_depend_on_the_stored_steps(lifted, initial):
    scene, times = paper_scene(lambda t: np.sin(np.pi * t) + lifted), np.linspace(0, 1, 4)
    kept = [vx.simulate(scene, vx.meshes.squares(3), times, store=store, initial=initial) for store in ("all", "last")]
    assert np.array_equal(*(history.trajectory.initial for history in kept))
    whole, last = (error_budget(history, -1).time[-1] for history in kept)
    assert whole == pytest.approx(last)


def measure_effectivity(seed):
    """Return effectivities of the whole budget and of the time part, and the relative time error."""
    scene, initial = feature_scene(seed)
    mesh, times = coarse_mesh(seed, 5), np.linspace(0, 1, 3 + seed % 4)
    history = vx.simulate(scene, mesh, times, initial=initial)
    system = pose_scene(scene, mesh).system
    fine = np.union1d(np.linspace(0, 1, 60 * (len(times) - 1) + 1), sample_course(system, times).bends)
    fine = fine[np.append(True, np.diff(fine) > 1e-13)]
    at = [int(np.abs(fine - t).argmin()) for t in times]
    truth = vx.simulate(scene, mesh.refine().refine().refine(), fine, store=at, initial=initial)
    true = max(
        vx.measures.energy_distance(truth, history, step=at[n], reference_step=n).absolute for n in range(1, len(times))
    )
    budget = error_budget(history)
    in_steps, lost = compare_steps(scene, mesh, times, initial, 100)
    return budget.largest["total"] * (budget.scale or 1.0) / true, in_steps, lost


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports. nothing but friction")
@pytest.mark.parametrize("seed", range(40), ids=lambda seed: f"{seed}-{KINDS[seed % len(KINDS)]}")
def test_estimates_of_scenes_with_features_are_one_to_five_times_the_true_errors(seed):
    whole, in_steps, lost = measure_effectivity(seed)
    assert 1.0 <= whole <= MOST
    if lost > NOISE:
        assert 1.0 <= in_steps <= MOST
