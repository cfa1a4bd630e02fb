"""The problems in space, compared with closed forms, force balances and bounds."""

from __future__ import annotations

import numpy as np
import pytest

import ball_in_socket as ball
import block_dragged_along_a_curve as curve
import bolted_flange as flange
import bolted_lap_joint as lap_joint
import bracket_in_space as bracket
import circular_hysteresis as circles
import cone_clutch as clutch
import dovetail
import hertz_two_balls as balls
import lug_and_pin as lug
import skew_joint as skew
import spherical_indenter as sphere
import tubes_shrunk_on as tubes
import twisted_pad as pad
import vemcvx as vx
from vemcvx.vem import Space

SOME = ("cubes", "prisms")
SPACE = [name if name in SOME else pytest.param(name, marks=pytest.mark.slow) for name in vx.meshes.SPACE_FAMILIES]
LOOSE = pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")
FLOOR = 1e-9
"""Relative tolerance for results, if the energy is certified to 1e-11."""


def simulate(problem, n, steps=None, family=None, mesh=None, **parameters):
    """Simulate a problem. `problem.SMALL` has the accuracy and the default number of steps."""
    mesh = mesh or (problem.mesh(n) if family is None else problem.mesh(n, family=family))
    small, initial = getattr(problem, "SMALL", {}), getattr(problem, "initial", None)
    times, solver = problem.times(steps or small["steps"]), vx.Newton(small.get("accuracy", 1e-8))
    return vx.simulate(problem.scene(**parameters), mesh, times, initial=initial, solver=solver)


@pytest.mark.long
@pytest.mark.parametrize("family", SPACE)
def test_circular_hysteresis_is_exact_step_by_step(family):
    mesh, times = circles.mesh(2, family=family), circles.times(30)
    history = vx.simulate(circles.scene(steps=30), mesh, times, solver=vx.Newton(1e-11))
    exact = circles.exact(history.mesh.points, history.times)
    assert np.abs(history.displacement - exact).max() < FLOOR * np.abs(exact).max()
    gamma, a = circles.exact_solution(history.times)
    area = history.contact.friction_lengths[:, None]
    force = history.contact.traction[..., :2] * area
    assert np.abs(force + circles.MU * gamma[:, None] * area).max() < FLOOR * circles.BOUND * area.max()
    path = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(a, axis=0), axis=1)))
    assert history.dissipated == pytest.approx(circles.BOUND * 2.0 * path, rel=FLOOR)


def test_a_turn_of_the_play_operator_dissipates_the_closed_form():
    a = circles.exact_solution(np.linspace(0.0, 9.0, 181))[1][-21:]
    path = np.linalg.norm(np.diff(a, axis=0), axis=1).sum()
    assert 2.0 * circles.BOUND * path == pytest.approx(circles.turn_dissipation(20), rel=1e-9)


@pytest.mark.long
def test_friction_opposes_the_motion_along_a_curve():
    history = simulate(curve, 1, 32)
    contact, force = history.contact, curve.sole_friction(history)[1:]
    assert (contact.slip_count[1:] == len(contact.nodes)).all()
    moved = np.diff(curve.top(history.times), axis=0)
    lag = curve.top(history.times)[:, None] - contact.slip[..., :2]
    change = np.linalg.norm(np.diff(lag, axis=0), axis=2).max(axis=1) / np.linalg.norm(moved, axis=1)
    off = np.linalg.norm(force - curve.friction(history.times), axis=1)
    assert np.linalg.norm(force, axis=1).max() < curve.FRICTION * (1 + FLOOR)
    assert (off <= 2 * change * curve.FRICTION)[1:].all()


@pytest.mark.long
@LOOSE
def test_a_twisted_pad_bears_two_thirds_of_mu_p_r():
    mesh = pad.mesh(5)
    history = vx.simulate(pad.scene(), mesh, [0.0, 1.0], initial="settled")
    assert pad.torque(history)[1:] == pytest.approx(pad.FULL, rel=0.01)
    assert history.contact.pressure == pytest.approx(pad.PRESSURE, rel=1e-7)
    assert mesh.volumes.sum() == pytest.approx(np.pi * pad.RADIUS**2 * pad.HEIGHT, rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("n", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_flange_unscrews_when_its_base_shakes(n):
    """The torques of load, friction and springs balance at each instant."""
    history = simulate(flange, n, 2 * flange.STEPS)
    held, friction = (history.moment(kind)[:, 2] for kind in (vx.ElasticFoundation, vx.CoulombFriction))
    applied = -held - friction
    assert np.ptp(applied) < 1e-7 * np.abs(applied).max()
    # The load acts on a polygon with 16n corners in place of a circle.
    assert applied[0] == pytest.approx(0.75 * flange.FRICTION_TORQUE, rel=(np.pi / (16 * n)) ** 2)
    assert np.all(np.abs(friction) <= flange.FRICTION_TORQUE * 1.05)
    turned = flange.angle(history)[:: flange.STEPS]
    final = 0.75 * flange.FRICTION_TORQUE / (flange.SPRINGS * flange.SECOND_MOMENT)
    assert np.all(np.diff(turned) > 0)
    assert 0.85 < turned[-1] / final < 1


@pytest.mark.slow
def test_a_sphere_is_dragged_as_cattaneo_and_mindlin_say():
    n = 6
    history = simulate(sphere, n, 4)
    P, Q = np.transpose(sphere.forces(history))[-1]
    a, mu = sphere.hertz(P)[0], sphere.FRICTION
    exact = a * np.cbrt(1 - Q / (mu * P))
    assert 0.4 < Q / (mu * P) < 0.8
    # The tolerance is one cell, a / n.
    assert sphere.stick_radius(history) == pytest.approx(exact, abs=a / n)


@pytest.mark.long
@LOOSE
@pytest.mark.parametrize("family", SPACE)
def test_a_skew_joint_is_a_friction_spring(family):
    """While the whole joint slides, the springs have the force of the closed form."""
    history = simulate(skew, skew.SMALL["n"] if family == "cubes" else 2, skew.SMALL["steps"], family)
    contact, known, found = history.contact, skew.exact_solution(history.times), skew.springs(history)
    assert (contact.partners >= 0).all()
    assert np.abs(skew.forces(history)[:, 2] + skew.load(history.times)).max() < 1e-12
    # Leave out steps in which rigid blocks would stick.
    slides = (contact.slip_count == len(contact.nodes)) & (np.abs(np.diff(known, prepend=0.0)) > 1e-9)
    assert slides.sum() >= 9
    assert found[slides] == pytest.approx(known[slides], rel=1e-4)
    # The tolerance is 3 %, because the springs at the sides have a hundredth of the stiffness of the blocks.
    assert found == pytest.approx(known, abs=0.03 * known.max())


@pytest.mark.long
def test_a_ball_lifts_off_the_back_of_its_socket():
    """Normals of faces deviate from the mean normal of a node by at most pi / 8."""
    history = simulate(ball, 2)
    contact = history.contact
    assert np.abs(history.stress(1) + ball.PRESSURE * np.array([1, 1, 1, 0, 0, 0])).max() < 1e-9 * ball.PRESSURE
    assert contact.pressure[1].max() < (1 + 1e-9) * ball.PRESSURE
    assert contact.pressure[1].min() > np.cos(np.pi / 8) * ball.PRESSURE
    assert contact.sticking[1].all()
    weight = ball.PRESSURE * history.mesh.face_areas[history.mesh.boundaries["ball.top"]].sum()
    force = ball.joint_force(history)
    balance = force + history.reaction("ball.grip")
    balance[1:, 2] -= weight
    assert np.abs(balance).max() < 1e-9 * np.abs(force).max()


@pytest.mark.long
@pytest.mark.parametrize("slant", [0.0, 0.5])
def test_the_normal_force_of_a_dovetail_is_between_its_values_at_full_slip(slant):
    mesh, solver = dovetail.mesh(2), vx.Newton(1e-7)
    history = vx.simulate(dovetail.scene(slant=slant), mesh, dovetail.times(12), solver=solver)
    pull, normal, force = dovetail.load(history.times), dovetail.normal_force(history), dovetail.nodal_forces(history)
    _, y, z = history.contact.points.T
    moment = (force[:, :, 2] @ y) - (force[:, :, 1] @ z)
    scale = dovetail.PULL
    assert np.abs(force[:, :, 1].sum(axis=1) + pull / 2).max() < 1e-9 * scale
    assert np.abs(force[:, :, 2].sum(axis=1)).max() < 1e-9 * scale
    assert np.abs(moment - slant * dovetail.HALF * pull / 6).max() < 1e-9 * scale
    assert (normal > dovetail.OUT * pull - 1e-6 * scale).all()
    assert (normal < dovetail.IN * pull + 1e-6 * scale).all()
    assert normal[1:5] == pytest.approx(dovetail.OUT * pull[1:5], rel=3e-3)
    assert normal[7:9] == pytest.approx(dovetail.IN * pull[7:9], rel=3e-3)
    assert normal[5] > 1.15 * dovetail.OUT * pull[5]


@pytest.mark.long
@pytest.mark.parametrize("friction", [0.2, 0.1])
def test_a_bolted_lap_joint_slips_at_mu_times_its_normal_force(friction):
    """While nodes slip, their friction forces turn towards the pull, until the resultant is mu N along the pull."""
    history = vx.simulate(lap_joint.scene(friction), lap_joint.mesh(2), lap_joint.times(20), solver=vx.Newton(1e-7))
    lap, heads, walls = lap_joint.forces_on_upper_plate(history)
    contact, pull, t = history.contact, history.reaction("upper.right"), history.times
    nuts = contact.points[:, 2] < -0.9 * lap_joint.THICK
    tension = contact.pressure[:, nuts] @ contact.lengths[nuts]
    scale = tension.max()
    assert (contact.pressure[1:, nuts] > 0).all()
    assert np.abs((lap + heads + walls + pull)[:, [0, 2]]).max() < FLOOR * scale
    assert np.abs(heads[:, 2] + tension).max() < FLOOR * scale
    assert np.abs(heads[:, :2]).max() < FLOOR * scale
    bound, bears = friction * lap[:, 2], walls[:, 0] < 0
    assert (np.hypot(lap[:, 0], lap[:, 1]) <= bound * (1 + 1e-6)).all()
    full, way = -lap[:, 0] > 0.99 * bound, lap_joint.PULL * (t - 1.0)
    slides = np.flatnonzero(full & ~bears & (t > 1.0))
    assert np.abs(-lap[slides[-1], 0] / bound[slides[-1]] - 1) < 1e-8
    assert pull[slides[2:-1], 0] == pytest.approx(pull[slides[-1], 0], rel=1e-4)
    # Between first slip and first contact with a wall, the end moves by the clearance, to within one step.
    assert way[bears][0] == pytest.approx(lap_joint.CLEARANCE + way[slides[0]], abs=way[-1] - way[-2])
    assert (np.diff(walls[bears, 0]) < 0).all()


@pytest.mark.long
@pytest.mark.parametrize(("n", "target"), [(16, 0.2), pytest.param(24, 0.17, marks=pytest.mark.slow)])
def test_an_adaptive_bracket_has_less_than_a_third_of_the_nodes(n, target):
    found = bracket.adapt(target)
    equal = vx.simulate(bracket.scene(), bracket.mesh(n), bracket.times(1))
    assert bracket.relative_error(found) < min(target, bracket.relative_error(equal))
    assert found.mesh.n_nodes < 0.33 * equal.mesh.n_nodes


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports")
@pytest.mark.parametrize(("n", "upper", "highest"), [(8, None, 0.03), (12, 9, 0.07)])
def test_two_balls_press_as_hertz_says(n, upper, highest):
    """Contact radius and peak pressure agree with Hertz within 3 %."""
    history = simulate(balls, n, mesh=balls.mesh(n, upper=upper))
    radius, peak = balls.hertz(balls.force(history)[-1])
    found = balls.measure(history)
    assert found[0] == pytest.approx(radius, rel=0.03)
    assert found[1] == pytest.approx(peak, rel=0.03)
    assert history.contact.pressure[-1].max() == pytest.approx(peak, rel=highest)


@pytest.mark.long
def test_tubes_that_are_shrunk_on_press_as_lame_says():
    """Mean pressures and changes of length agree with Lame within 1 %."""
    history = simulate(tubes, 8)
    assert tubes.mean_pressure(history) == pytest.approx(tubes.pressure() * history.times, rel=0.01, abs=1e-12)
    assert history.contact.pressure[-1] == pytest.approx(tubes.pressure(), rel=0.04)
    assert history.contact.pressure_recovered[-1] == pytest.approx(tubes.pressure(), rel=0.01)
    for tube, strain in zip(("inner", "outer"), tubes.axial_strains(), strict=True):
        nodes = Space(history.mesh).part(f"{tube}.top", "top").nodes
        assert history.displacement[-1, nodes, 2].mean() == pytest.approx(strain * tubes.LENGTH, rel=0.01)


@pytest.mark.long
def test_a_cone_clutch_slips_at_its_torque():
    """The error of the torque is O(1 / sectors^2), and below 1 % for n = 8. Pressures are uniform."""
    off = []
    for n in (6, 8):
        history = simulate(clutch, n)
        torque, pressure = clutch.torque(history), history.contact.pressure
        assert not history.contact.sticking[-1].any()
        assert pressure[-1] == pytest.approx(pressure[-1].mean(), rel=1e-4)
        assert pressure[1] == pytest.approx(pressure[1].mean(), rel=1e-9)
        assert pressure[[1, -1]] == pytest.approx(clutch.PRESSURE, rel=(np.pi / (4 * n)) ** 2)
        off.append(1 - torque[-1] / clutch.TORQUE)
    assert 0 < off[1] < 0.01
    assert off[0] / off[1] == pytest.approx((8 / 6) ** 2, rel=0.05)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports")
def test_a_lug_bears_its_pin_as_the_load_turns():
    history = simulate(lug, 4)
    area = history.mesh.face_areas[history.mesh.boundaries["pin.top"]].sum()
    force = lug.joint_force(history)[:, :2] / (area * lug.SHEAR)
    assert np.abs(force + lug.load(history.times)[:, :2] / lug.SHEAR).max() < 1e-9
    assert (np.diff(history.dissipated)[1:] > 0).all()
    contact = history.contact
    risen = history.times >= 1.0
    assert (contact.open_count[risen] > 50).all()
    # The centre of pressure follows the direction of the load.
    weights = contact.pressure * contact.lengths
    middle = np.arctan2(weights @ contact.points[:, 1], weights @ contact.points[:, 0])
    behind = (middle - lug.direction(history.times) + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(behind[risen]).max() < 0.3
