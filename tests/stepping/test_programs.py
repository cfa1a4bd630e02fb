"""`History.program` and `vx.programs` return the programs that the steps solved, for every kind of scene."""

from dataclasses import replace

import numpy as np
import pytest

import vemcvx as vx
from slip_weakening import SlipWeakening

EPS = float(np.finfo(float).eps)
TIMES = np.linspace(0.0, 1.0, 5)


def push(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


def press(x, t):
    return np.column_stack([np.full(len(x), 3 * t * (1.4 - t)), np.full(len(x), -6.0 * t)])


def carried(x, t):
    return np.column_stack([np.full(len(x), 0.05 * t), np.full(len(x), -0.01 * t)])


BODY = vx.Elasticity(young=200.0, poisson=0.3)
HELD = BODY, vx.Clamp(on="right"), vx.Traction(push, on="left")
TOUCHES = BODY, vx.Clamp(on="left"), vx.Traction(press, on="top")
SCENES = {
    "Tresca": (*HELD, vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=4.0, on="bottom")),
    "no contact": HELD,
    "moving supports": (
        BODY,
        vx.PrescribedDisplacement(carried, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(bound=2.0, on="bottom", while_closed=False),
    ),
    "while closed": (
        *TOUCHES,
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(bound=0.5, on="bottom", while_closed=True),
    ),
    "Coulomb": (*TOUCHES, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")),
    "moving obstacle": (*TOUCHES, vx.UnilateralContact(gap=lambda x, t: 0.01 * t, on="bottom")),
    "soft": (*TOUCHES, vx.NormalCompliance(500.0, on="bottom"), vx.TrescaFriction(bound=1.0, on="bottom")),
    "slip weakening": (*HELD, vx.BilateralContact(on="bottom"), SlipWeakening(4.0, 1.0, 0.1, on="bottom")),
    "free": (
        BODY,
        vx.Traction(lambda x, t: np.column_stack([t + 0 * x[:, 0], 0 * x[:, 0]]), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    ),
    "viscous": (
        *HELD,
        vx.Viscosity(20.0, 10.0),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    ),
}


def check_answer(program, history, n):
    """Check the run's answer to a program, and return the certificate."""
    trajectory, (lam, p) = history.trajectory, (program.answer.lam, program.answer.p)
    stored = np.abs(trajectory.state[-1]).max() + np.abs(program.answer.d).max(initial=0.0)
    B, D = (abs(rows).sum(axis=1) for rows in (program.operators.B, program.operators.D))
    rough = 2 * EPS * stored * (np.repeat(program.w, program.operators.block) @ B + p @ D)
    assert (np.linalg.norm(lam, axis=1) <= program.w * (1 + 4 * EPS)).all()
    assert (p >= 0).all()
    found = program.certificate
    floors = found.floor + trajectory.floor[n] + rough
    assert found.error <= np.sqrt(2 * trajectory.gap[n]) + np.sqrt(2 * floors)
    low, high = program.bounds
    assert low <= program.objective(program.answer.d) <= high
    assert high - low >= found.gap
    return found


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction")
@pytest.mark.parametrize("condense", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_the_answer_of_a_run_solves_its_programs(name, condense):
    scene, mesh = vx.Scene(*SCENES[name]), vx.meshes.squares(4)
    history = vx.simulate(scene, mesh, TIMES)
    scale = history.trajectory.norm.max()
    marched = vx.programs(scene, mesh, TIMES, condense=condense)
    for n, other in enumerate(marched, start=1):
        program = history.program(n, condense)
        assert (program.step, program.t) == (other.step, other.t) == (n, TIMES[n])
        assert check_answer(program, history, n).error < 1e-7 * scale
        assert check_answer(other, history, n).error < 1e-7 * scale
        if not condense:
            assert len(program.g) == history.trajectory.state.shape[1]
        for one, two in ((program.g, other.g), (program.w, other.w), (program.b, other.b), (program.e, other.e)):
            size = max(np.abs(program.g).max(initial=0.0), np.abs(one).max(initial=0.0))
            assert np.abs(one - two).max(initial=0.0) <= 1e-10 * size
    assert n == len(TIMES) - 1


@pytest.mark.long
def test_a_program_needs_the_stored_state_before_its_step():
    scene, mesh = vx.Scene(*SCENES["Tresca"]), vx.meshes.squares(2)
    history = vx.simulate(scene, mesh, TIMES, store=[2, 3])
    assert history.program(3).step == 3
    for n, words in {2: "the state after step 1 is not stored", 0: "there is no such", 5: "there is no such"}.items():
        with pytest.raises(vx.HistoryError, match=rf"^program\({n}\): .*{words}"):
            history.program(n)
    assert vx.simulate(scene, mesh, TIMES, store=[1]).program(1).step == 1
    with pytest.raises(vx.SceneError, match="condense"):
        history.program(3, condense="no")
    with pytest.raises(vx.HistoryError, match="was read from files"):
        replace(history, scene=None).program(3)
    with pytest.raises(vx.SceneError, match="wanted a Scene, then a mesh"):
        next(vx.programs(scene, scene, TIMES))
