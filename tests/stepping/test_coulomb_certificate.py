"""Coulomb's certificate: a bound on the distance to a solution where sets settle, an estimate elsewhere, true in both.

Every step of a run is repeated from the state before it by convex programs until nothing moves any more, and what the
run answered is held against that: the theorem of :mod:`vemcvx.solvers.coulomb` is not used by the reference.
"""

from __future__ import annotations

import importlib
import json
import logging
from dataclasses import replace

import numpy as np
import pytest
from any_scene import draw
from coulomb_scenes import converged, coulomb_scene, energy_norm

import vemcvx as vx
from vemcvx.scene import pose_scene
from vemcvx.solvers.newton import independent
from vemcvx.stepping.backward_euler import QuasistaticSteps
from vemcvx.stepping.ledger import step_data

ROUNDING = 3e-11
"""Relative energy error of the reference: its programs are certified to 1e-11."""
pytestmark = pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")


def judged(monkeypatch, system, times, solver):
    """[(true error, certified error + floor, estimate?)] of all steps that have a reference, relative to the scale."""
    found, step = [], QuasistaticSteps.step

    def watched(steps, before, n, t):
        run, state = steps.run, step(steps, before, n, t)
        reference = converged(run, before, step_data(run.system, run.condensation, t))
        if reference is not None:
            scale = max(state.scale, np.finfo(float).tiny)
            own = state.certificate
            away = energy_norm(run, state.y - reference.y) / scale
            found.append((away, (own.error + own.error_floor) / scale, own.estimate))
        return state

    monkeypatch.setattr(QuasistaticSteps, "step", watched)
    run = vx.march(system, times, solver=solver)
    monkeypatch.undo()
    return run, found


REPORTED = vx.meshes.triangles(12)


def dragged(mu=1.8, poisson=0.2, mesh=REPORTED):
    """The scene of an early report: certified 9.1e-7 by the last ratio of increments, where 6.8e-6 was true."""

    def pull(x, t):
        return np.tile([3.0 * t, 0.0], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(2600.0, poisson),
        vx.Pressure(lambda x, t: np.full(len(x), t), on="top"),
        vx.Traction(pull, on="left"),
        vx.PrescribedDisplacement(0.0, on="right", direction=(1.0, 0.0)),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(mu, on="bottom"),
    )
    return pose_scene(scene, mesh).system


def without_slope(system):
    """The same law, not known to be piecewise affine."""
    return replace(system, norms=replace(system.norms, law=replace(system.norms.law, slope=None)))


@pytest.mark.long
@pytest.mark.parametrize("proof", [True, False])
def test_a_lucky_ratio_of_increments_certifies_nothing(monkeypatch, proof):
    system = dragged() if proof else without_slope(dragged())
    run, steps = judged(monkeypatch, system, [0.0, 0.5, 1.0], vx.Newton(accuracy=1e-6))
    assert len(steps) == 2
    for away, certified, estimate in steps:
        assert estimate is not proof
        assert away <= certified + ROUNDING
        assert away <= 1e-6
    assert run.certificate_kind == ("bound" if proof else "estimate")
    if proof:
        assert run.iterations.max() <= 50


def check_scene(monkeypatch, seed, solver, proof=True):
    """Every step of a random scene: how many had a reference, and how many were estimates."""
    scene, mesh = coulomb_scene(seed)
    system = pose_scene(scene, mesh).system
    try:
        _, steps = judged(monkeypatch, system if proof else without_slope(system), np.linspace(0, 1, 5), solver)
    except vx.SceneError as error:
        if "there is no equilibrium" not in str(error):
            raise
        return 0, 0
    for away, certified, _ in steps:
        assert away <= certified + ROUNDING
        assert away <= solver.accuracy + ROUNDING
    return len(steps), sum(estimate for *_, estimate in steps)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 3, 4])
def test_certificates_are_true_in_random_scenes(monkeypatch, seed):
    assert check_scene(monkeypatch, seed, vx.Newton(accuracy=1e-4)) == (4, 0)


@pytest.mark.long
def test_answers_of_a_conic_solver_stay_its_own_and_are_judged(monkeypatch):
    scene, mesh = coulomb_scene(4)
    system = pose_scene(scene, mesh).system
    run, steps = judged(monkeypatch, system, [0.0, 0.5, 1.0], vx.Clarabel(accuracy=1e-3))
    for away, certified, estimate in steps:
        assert not estimate
        assert 1e-9 < away <= certified <= 1e-3 + 1e-9
    sharper, _ = judged(monkeypatch, system, [0.0, 0.5, 1.0], vx.Clarabel(accuracy=1e-3, polish=True))
    assert sharper.certificate.max() < 1e-9 < run.certificate.max()


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("part", range(8))
def test_200_scenes(monkeypatch, accuracy, part):
    checked = [check_scene(monkeypatch, seed, vx.Newton(accuracy=accuracy)) for seed in range(part, 200, 8)]
    assert sum(steps for steps, _ in checked) > 80


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("part", range(4))
def test_100_scenes_by_estimates(monkeypatch, accuracy, part):
    def check(seed):
        try:
            return check_scene(monkeypatch, seed, vx.Newton(accuracy=accuracy, max_iterations=2000), proof=False)
        except vx.NotContracting:
            return 0, 0

    assert sum(steps for steps, _ in map(check, range(part, 100, 4))) > 60


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6])
def test_25_scenes_by_a_conic_solver(monkeypatch, accuracy):
    assert sum(check_scene(monkeypatch, seed, vx.Clarabel(accuracy=accuracy))[0] for seed in range(25)) > 80


def wedge(coefficient, power=None):
    """One slider whose slip by u raises its pressure: p = 1 + .9 u, u = 3.5 - w(p) while it slips."""

    def weights(t, p, past, slip):
        return coefficient * (p if power is None else p**power)

    slope = None if power is not None else lambda t, p, past: np.full((1, 1), coefficient)
    norms = vx.Norms([[1.0, 0.0]], 0.0, law=vx.Law(weights, slope=slope, slips=False))
    stiffness = [[1.0, -0.9], [-0.9, 1.0]]
    return vx.System(stiffness, lambda t: [3.5 * t, t], norms, limits=vx.Limits([[0.0, 1.0]], 0.0))


def test_a_solution_is_found_where_the_fixed_point_cycles():
    """With the coefficient 3 programs alone jump between stick and slip; the sets have a solution, and it is proven."""
    run = vx.march(wedge(3.0), [0.0, 1.0])
    u = (3.5 - 3.0) / (1 + 0.9 * 3.0)
    assert run.state[-1] == pytest.approx([u, 0.0], rel=1e-12)
    assert run.pressures[-1, 0] == pytest.approx(1 + 0.9 * u, rel=1e-12)
    assert run.certificate_kind == "bound"
    assert run.certificate[-1] < 1e-12


def test_a_law_of_ones_own_has_estimates_that_hold():
    """w = sqrt(p): u = 3.5 - sqrt(1 + .9 u), a quadratic equation."""
    u = 3.5 + 0.45 - np.sqrt((3.5 + 0.45) ** 2 - (3.5**2 - 1))
    for accuracy in (1e-2, 1e-4, 1e-6, 1e-8):
        run = vx.march(wedge(1.0, 0.5), [0.0, 1.0], solver=vx.Newton(accuracy=accuracy))
        assert run.certificate_kind == "estimate"
        assert abs(run.state[-1, 0] - u) <= run.certificate[-1] * run.norm[-1]
        assert run.certificate[-1] <= accuracy


@pytest.mark.long
def test_the_derivative_of_a_law_has_a_row_a_term_and_a_column_a_limit():
    norms = vx.Norms([[1.0]], 0.0, law=vx.Law(lambda t, p, past, slip: p, slope=lambda t, p, past: np.ones((2, 1))))
    system = vx.System([[1.0]], lambda t: [t], norms, limits=vx.Limits([[1.0]], 0.0))
    with pytest.raises(vx.SceneError, match=r"^Norms: slope: found a matrix of shape \(2, 1\); wanted \(1, 1\)"):
        vx.march(system, [0.0, 1.0])


def resting(push=0.29, mu=0.3, young=200.0, press=1.0):
    """A block on a floor, pressed and pushed, and nothing else."""

    def pushed(x, t):
        return np.tile([push * press * t, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young, 0.3),
        vx.Pressure(press, on="top"),
        vx.Traction(pushed, on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(mu, on="bottom"),
    )


def test_a_body_that_only_friction_and_contact_hold_costs_what_others_do():
    """607 iterations a step at 6 x 6 cells, once; and the floor's reaction is the load."""
    history = vx.simulate(resting(), vx.meshes.squares(6), np.linspace(0, 1, 5), initial="settled")
    assert history.iterations.max() <= 50
    assert not history.contact.sticking[-1].all()
    assert history.certificate.max() <= 1e-8
    assert history.certificate_kind == "bound"
    assert history.reaction("bottom") == pytest.approx(np.column_stack([-0.29 * history.times, np.ones(5)]), abs=1e-9)


@pytest.mark.long
def test_conic_solvers_take_such_a_body_as_it_is(caplog):
    """One program for each weights, not one a proximal point: 350 to 830 iterations a step, once."""
    with caplog.at_level(logging.DEBUG, logger="vemcvx"):
        history = vx.simulate(resting(), vx.meshes.squares(6), [0.0, 1.0], initial="settled", solver=vx.Clarabel())
    programs = sum(record.message.startswith("step 1, program") for record in caplog.records)
    assert 1 < programs <= 10
    # Interior points are asked once more, with care, where they miss.
    assert history.iterations[-1] <= 50 * programs
    assert history.certificate.max() <= 1e-6
    polished = vx.simulate(resting(), vx.meshes.squares(6), [0.0, 1.0], initial="settled", solver=vx.OSQP(polish=True))
    assert polished.certificate.max() <= 1e-9


def test_a_pressed_joint_in_si_units():
    """Steel, millimetres in metres: a plate under 60 MPa, pulled; 38,917 iterations in the first step, once."""
    mesh = vx.meshes.squares((4, 1), box=((0, 0.08), (0, 0.02)))
    history = vx.simulate(resting(0.5, 0.2, 210e9, 60e6), mesh, [0.0, 0.5, 1.0], initial="settled")
    assert history.iterations.max() <= 50
    assert history.certificate.max() <= 1e-8


def cornered(mu):
    """A block pressed into the corner of a floor and a wall, both rough, and nothing else."""

    def pressed(x, t):
        return np.full(len(x), t)

    def pushed(x, t):
        return np.tile([0.7 * t, 0.0], (len(x), 1))

    rough = [e for on in ("bottom", "right") for e in (vx.UnilateralContact(on=on), vx.CoulombFriction(mu, on=on))]
    return vx.Scene(vx.Elasticity(200.0, 0.3), vx.Pressure(pressed, on="top"), vx.Traction(pushed, on="left"), *rough)


@pytest.mark.parametrize("mu", [0.1, 0.4, 0.9])
def test_what_sticks_where_two_obstacles_meet_is_held_twice(mu):
    """One row follows from another there: 86 iterations and an estimate, once, as no set seemed to be regular."""
    history = vx.simulate(cornered(mu), vx.meshes.squares(3), np.linspace(0, 1, 4))
    assert history.iterations.max() <= 15
    assert history.certificate_kind == "bound"
    assert history.certificate.max() <= 1e-12


def test_rows_that_follow_from_others_are_found():
    rows = np.array([[1.0, 0, 0], [0, 1, 0], [-2, 1, 0], [0, 0, 3], [0, 0, 0], [0, 1, 1 / 3]])
    assert independent(rows).tolist() == [True, True, False, True, False, False]


@pytest.mark.long
def test_more_push_than_friction_holds_is_refused():
    with pytest.raises(
        vx.SceneError, match=r"The load pushes it there with a force of 0\.\d+ and friction holds 0\.3 "
    ):
        vx.simulate(resting(0.5), vx.meshes.squares(3), np.linspace(0, 1, 5), initial="settled")


def test_iterations_are_limited_over_the_whole_step():
    """A fixed point of many programs counts as one step."""
    system = without_slope(dragged())
    with pytest.raises(vx.NotCertified, match=r"The solver said: iteration limit\..* raise max_iterations"):
        vx.march(system, [0.0, 1.0], solver=vx.Newton(max_iterations=12))
    run = vx.march(system, [0.0, 1.0], solver=vx.Newton(max_iterations=12), check=False)
    assert run.iterations[-1] <= 12
    assert run.certificate_kind == "estimate"


@pytest.mark.long
@pytest.mark.arithmetic
@pytest.mark.parametrize("most", [5, 50, 200])
def test_sets_count_among_the_iterations_of_a_step(most):
    """A body on a soft floor beside a wall took 201 of 200 iterations, all but one of them for convex programs.

    At least 8 are needed, or 12, as the kernels of BLAS round.
    """
    drawn = draw(778)
    solver = vx.Newton(accuracy=1e-9, max_iterations=most)
    history = vx.simulate(drawn.scene, drawn.mesh, drawn.times, solver=solver, initial="settled", check=False)
    assert history.iterations.max() <= most
    assert (history.certificate.max() <= 1e-9) == (most > 5)


def test_slow_steps_report_to_the_log(caplog):
    with caplog.at_level(logging.INFO, logger="vemcvx"):
        vx.march(without_slope(dragged()), [0.0, 1.0], solver=vx.Newton(1e-4))
    lines = [record.message for record in caplog.records if record.message.startswith("step 1, program")]
    assert lines
    assert lines[0].startswith("step 1, program 4: ")


@pytest.mark.long
def test_kinds_are_said_everywhere(tmp_path):
    """In the history, its words, and summary.json; where nothing follows the pressure, a certificate is a bound."""
    proven = vx.simulate(resting(), vx.meshes.squares(2), [0.0, 1.0], initial="settled")
    assert proven.certificate_kind == "bound"
    assert "estimate" not in proven.summary()
    doubtful = replace(proven, trajectory=replace(proven.trajectory, estimated=np.array([False, True])))
    assert doubtful.certificate_kind == "estimate"
    assert "an estimate at 1 of 2 instants" in doubtful.summary()
    for name, history in (("bound", proven), ("estimate", doubtful)):
        history.write(tmp_path / name)
        assert json.loads((tmp_path / name / "summary.json").read_text())["certificate_kind"] == name
        assert vx.read_history(tmp_path / name).certificate_kind == name


@pytest.mark.long
def test_refined_states_keep_the_kind_of_their_certificate():
    """Near incompressibility every step is refined against the original stiffness; an estimate stays one."""
    system = dragged(0.5, 0.49999999, vx.meshes.squares(3))
    assert vx.march(system, [0.0, 1.0]).certificate_kind == "bound"
    run = vx.march(without_slope(system), [0.0, 1.0], solver=vx.Newton(1e-4))
    assert run.certificate_kind == "estimate"
    assert 0 < run.certificate[-1] <= 1e-4


@pytest.mark.long
def test_open_places_keep_their_slips_where_states_are_refined(monkeypatch):
    """A multiplier of 1e-18 points anywhere; to turn a slip of 3e-5 after it left the step out of balance by 4e-3."""
    monkeypatch.setattr("vemcvx.stepping.state.needs_refinement", lambda *_: True)

    def pull(x, t):
        return np.column_stack([min(3 * t, 1) * np.sin(7 * t) * (0.75 + 0.5 * x[:, 1]), np.zeros(len(x))])

    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Traction(pull, on="left"),
        vx.Pressure(lambda x, t: 2 * min(3 * t, 1) * (1 + 0.3 * x[:, 0]), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.5, on="bottom"),
    )
    run = vx.simulate(scene, vx.meshes.triangles(9), np.linspace(0, 0.4, 5), solver=vx.Newton(accuracy=1e-10))
    assert (run.contact.open_count[1:] > 0).any()
    assert run.certificate.max() < 1e-10


@pytest.mark.long
def test_blocks_that_slide_as_a_whole_may_be_refined(monkeypatch):
    """Friction 7e-13 below its bound does work on the slip: that was 3e-7 of the energy norm, and refused the step."""
    monkeypatch.setattr("vemcvx.stepping.state.needs_refinement", lambda *_: True)
    monkeypatch.syspath_prepend("problems")
    problem = importlib.import_module("skew_joint")
    for n in (2, 3):
        run = vx.simulate(problem.scene(), problem.mesh(n), problem.times(18)[:4], solver=vx.Newton(accuracy=1e-8))
        assert run.contact.slip_count[-1] == len(run.contact.nodes)
        assert run.certificate.max() <= 1e-8
