"""In random scenes, certificates bound true errors up to rounding, and all exceptions are VemcvxErrors.

A failure names the seed. ``any_scene.draw(seed)`` builds the scene, and ``judged.run_and_judge`` judges a run.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from any_scene import draw, draw_two_bodies
from exact_steps import Steps, floats
from judged import judge, run, run_and_judge

import vemcvx as vx

CHUNK = 25
DEFAULT, ALL = (29, 33, 37, 72, 268, 275, 414, 469, 526, 531, 609, 733, 793, *range(10_000, 10_028)), range(1000)


def judge_all(seeds, most_refused, draw=draw):
    """Judge the scenes of all seeds, and report their faults together.

    Exact steps may fail under tiny loads, for example 1e-29 in scene 251. Failures in the scene
    with the most failures are not counted. All other failures are at most 5 % of all steps.
    """
    faults, refused, steps, unknown = [], Counter(), 0, []
    scenes = [drawn for drawn in map(draw, seeds) if drawn is not None]
    for drawn in scenes:
        try:
            verdict = run_and_judge(drawn)
        except Exception as error:
            faults.append(f"{type(error).__name__}: {error}\n  {drawn.words}")
            continue
        refused[verdict.refused.split(":")[0]] += bool(verdict.refused)
        steps += verdict.steps
        unknown.append(verdict.unknown)
        faults += [f"{fault}\n  {drawn.words}" for fault in verdict.faults]
    assert not faults, "\n".join([f"{len(faults)} faults:", *faults])
    assert refused.total() <= most_refused * len(scenes)
    assert steps >= len(scenes)
    assert sum(unknown) - max(unknown, default=0) <= 0.05 * steps


@cache
def run_known_scene():
    """Return a scene and its history: the body slips on two sides, and obstacles press on it."""
    drawn = draw(83)
    return drawn, run(drawn)


FALSE = {
    "certificate": lambda t: {"state": t.state * (1 + 1e-5 * np.sin(np.arange(t.state.shape[1])))},
    "ledger": lambda t: {"work": t.work * (1 + 1e-6)},
    "number": lambda t: {"gap": np.where(np.arange(len(t.gap)) == 1, np.nan, t.gap)},
}


@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_the_judge_finds_no_fault_in_a_right_answer():
    assert judge(*run_known_scene()).faults == []


@pytest.mark.parametrize("complaint", FALSE)
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_the_judge_finds_a_false_state_false_work_and_a_gap_that_is_no_number(complaint):
    drawn, history = run_known_scene()
    trajectory = history.trajectory
    false = replace(history, trajectory=replace(trajectory, **FALSE[complaint](trajectory)))
    assert any(fault.startswith(complaint) for fault in judge(drawn, false).faults)


@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_the_judge_finds_forces_that_do_not_balance():
    drawn, history = run_known_scene()
    forces = np.array(history.forces)
    forces[-1, 0] *= 1 + 1e-9
    assert any(fault.startswith("balance") for fault in judge(drawn, replace(history, forces=forces)).faults)


def test_exact_steps_are_exact():
    """A wall stops the unknown x, and friction acts on the unknown y."""
    system = vx.System(
        np.array([[3.0, -1.0], [-1.0, 2.0]]),
        lambda t: np.array([5.0, 1.0]) * t,
        vx.Norms(np.array([[0.0, 1.0]]), [0.25]),
        limits=vx.Limits(np.array([[1.0, 0.0]]), [1.0]),
    )
    step = Steps(system).step(np.zeros(2), 0.0, 1.0, (np.zeros(2), np.zeros(1), np.zeros(1)))
    # With the unknowns x and y, the wall holds x = 1, and y slips: 2 y = 1 + 1 - 1/4.
    d = Steps(system).unscaled(step.d, step.unit)
    assert d.tolist() == [1.0, 0.875]
    assert floats(step.p)[0] > 0
    assert step.slip_sets.tolist() == [1]
    assert step.acts.tolist() == [True]
    # The distance of the answer from zero is |(1, 7/8)|_K, with |(1, 7/8)|_K^2 = 3 - 2 * 7/8 + 2 * 49/64.
    assert step.distance(0 * step.d) == pytest.approx(np.sqrt(3 - 1.75 + 2 * 49 / 64), rel=1e-15)


@pytest.mark.long
def test_certificates_hold_in_any_scene():
    judge_all(DEFAULT, most_refused=0.4)


@pytest.mark.slow
@pytest.mark.parametrize("first", ALL[::CHUNK])
def test_certificates_hold_in_a_thousand_scenes(first):
    judge_all(range(first, first + CHUNK), most_refused=0.5)


@pytest.mark.parametrize(
    "seeds", [range(20_000, 20_020), pytest.param(range(20_000, 20_300), marks=pytest.mark.slow)], ids=["few", "many"]
)
@pytest.mark.long
def test_certificates_hold_for_two_bodies(seeds):
    judge_all(seeds, most_refused=0.4, draw=draw_two_bodies)
