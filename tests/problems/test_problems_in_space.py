"""The problems in space against their closed forms, and what each must keep whatever the mesh."""

from __future__ import annotations

import numpy as np
import pytest

import ball_in_socket as ball
import block_dragged_along_a_curve as curve
import block_in_space as block
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
"""Relative; what is compared so is certified to 1e-11 or better in energy."""


def simulated(problem, n, steps, family=None, parameters=None, accuracy=None):
    mesh = problem.mesh(n) if family is None else problem.mesh(n, family=family)
    solver = vx.Newton(accuracy or problem.SMALL.get("accuracy", 1e-8))
    initial = getattr(problem, "initial", None)
    return vx.simulate(problem.scene(**(parameters or {})), mesh, problem.times(steps), initial=initial, solver=solver)


@pytest.mark.long
@pytest.mark.parametrize("family", SPACE)
def test_circular_hysteresis_is_exact_step_by_step(family):
    history = simulated(circles, 2, 30, family, {"steps": 30}, accuracy=1e-11)
    exact = circles.exact(history.mesh.points, history.times)
    assert np.abs(history.displacement - exact).max() < FLOOR * np.abs(exact).max()
    gamma, a = circles.exact_solution(history.times)
    area = history.contact.friction_lengths[:, None]
    force = history.contact.traction[..., :2] * area
    assert np.abs(force + circles.MU * gamma[:, None] * area).max() < FLOOR * circles.BOUND * area.max()
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(a, axis=0), axis=1)))
    assert history.dissipated == pytest.approx(circles.BOUND * 2.0 * way, rel=FLOOR)


def test_a_turn_dissipates_what_the_closed_form_says():
    """Of the play operator itself, once it goes in circles; in many steps as in steps without end, to first order."""
    for steps in (20, 80):
        instants = np.linspace(0.0, 9.0, 9 * steps + 1)
        a = circles.exact_solution(instants)[1][-steps - 1 :]
        way = np.linalg.norm(np.diff(a, axis=0), axis=1).sum()
        assert 2.0 * circles.BOUND * way == pytest.approx(circles.turn_dissipation(steps), rel=1e-9)
    off = [1 - circles.turn_dissipation(steps) / circles.turn_dissipation() for steps in (80, 160)]
    assert 1.9 < off[0] / off[1] < 2.1


@pytest.mark.long
def test_two_absolute_values_would_bear_more():
    """At 45 degrees the disc bears g; the square of one bound for each axis would bear sqrt(2) g."""
    history = simulated(circles, 1, 30, parameters={"steps": 30})
    sizes = np.linalg.norm(history.contact.traction, axis=2)
    assert sizes.max() < circles.BOUND * (1 + FLOOR)
    assert np.abs(history.contact.traction[..., :2]).sum(axis=2).max() > 1.3 * circles.BOUND


@pytest.mark.long
def test_a_push_to_the_other_side_mirrors_the_block():
    one, other = (simulated(block, 3, 4, parameters={"aside": aside}) for aside in (2.0, -2.0))
    x = one.mesh.points
    mirrored = np.lexsort((x * [1, -1, 1] + [0, 1, 0]).T.round(9))[np.argsort(np.lexsort(x.T.round(9)))]
    assert np.allclose(x[mirrored], x * [1, -1, 1] + [0, 1, 0], atol=1e-12)
    difference = one.displacement - other.displacement[:, mirrored] * [1, -1, 1]
    assert np.abs(difference).max() < FLOOR * np.abs(one.displacement).max()
    assert one.contact.slip_count[-1] > 0 < one.contact.stick_count[-1]


@pytest.mark.long
def test_the_friction_of_the_block_turns():
    """It opposes the slip of its step where a node slips, at its bound, and its direction varies over the face."""
    contact = simulated(block, 4, 8).contact
    moved, slips = np.diff(contact.slip, axis=0), ~contact.sticking[1:]
    against = contact.traction[1:][slips] / np.linalg.norm(moved[slips], axis=1, keepdims=True)
    work = np.einsum("ka,ka->k", against, moved[slips])
    assert work == pytest.approx(-contact.bound[1:][slips], rel=1e-9)
    angles = np.arctan2(contact.traction[-1, :, 1], contact.traction[-1, :, 0])[~contact.sticking[-1]]
    assert np.ptp(angles % (2 * np.pi)) > 0.3


@pytest.mark.long
def test_friction_opposes_the_motion_along_a_curve():
    """Of each node it opposes U_n - U_{n-1} less the change of its lag behind the plate."""
    history = simulated(curve, 1, 32)
    contact, force = history.contact, curve.sole_friction(history)[1:]
    assert (contact.slip_count[1:] == len(contact.nodes)).all()
    moved = np.diff(curve.top(history.times), axis=0)
    lag = curve.top(history.times)[:, None] - contact.slip[..., :2]
    share = np.linalg.norm(np.diff(lag, axis=0), axis=2).max(axis=1) / np.linalg.norm(moved, axis=1)
    off = np.linalg.norm(force - curve.friction(history.times), axis=1)
    assert np.linalg.norm(force, axis=1).max() < curve.FRICTION * (1 + FLOOR)
    assert (off <= 2 * share * curve.FRICTION)[1:].all()
    # In the first step the lag comes to be; then it turns.
    assert share[1:].max() < 0.1
    turned = np.unwrap(np.arctan2(force[:, 1], force[:, 0]))
    assert np.abs(np.diff(turned)).sum() > 1.5 * np.pi


@pytest.mark.long
@LOOSE
def test_a_twisted_pad_bears_two_thirds_of_mu_p_r():
    mesh = pad.mesh(5)
    history = vx.simulate(pad.scene(), mesh, [0.0, 1.0], initial="settled")
    torque = pad.torque(history)
    assert torque[1:] == pytest.approx(pad.FULL, rel=0.01)
    assert history.contact.pressure == pytest.approx(pad.PRESSURE, rel=1e-7)
    assert mesh.volumes.sum() == pytest.approx(np.pi * pad.RADIUS**2 * pad.HEIGHT, rel=1e-12)
    centre = np.linalg.norm(history.contact.points[:, :2], axis=1)
    slip = np.linalg.norm(history.contact.slip[-1], axis=1)
    # The sole follows the top but for the shear of the pad, which friction bounds.
    assert np.abs(slip - pad.ANGLE * centre).max() < 1.5 * pad.FIRST * pad.RADIUS


@LOOSE
@pytest.mark.slow
def test_the_torque_of_the_pad_is_of_second_order():
    off = []
    for n in (4, 8):
        history = vx.simulate(pad.scene(), pad.mesh(n), [0.0, 1.0], initial="settled")
        off.append(pad.torque(history)[-1] / pad.FULL - 1)
    assert 3.0 < off[0] / off[1] < 6.0


def torques(history):
    """Of springs and of friction about the axis, (N + 1,): what they do to a rotation without strain."""
    mesh, contact, x = history.mesh, history.contact, history.contact.points
    springs = next(effect for effect in flange.scene() if isinstance(effect, vx.ElasticFoundation))
    turn = np.column_stack([-mesh.points[:, 1], mesh.points[:, 0], np.zeros(mesh.n_nodes)]).ravel()
    held = -history.displacement.reshape(len(history.times), -1) @ (springs.contribute(Space(mesh)).stiffness @ turn)
    rubs = contact.traction * contact.friction_lengths[:, None]
    return held, (rubs[..., 1] * x[:, 0] - rubs[..., 0] * x[:, 1]).sum(axis=1)


@pytest.mark.long
@pytest.mark.parametrize("n", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_flange_unscrews_when_its_base_shakes(n):
    """Its torques balance at each instant, and what friction leaves of the load the springs bear."""
    history = simulated(flange, n, 2 * flange.STEPS)
    held, friction = torques(history)
    applied = -held - friction
    assert np.ptp(applied) < 1e-7 * np.abs(applied).max()
    # The torque of the load on the polygons in place of the circles.
    assert applied[0] == pytest.approx(0.75 * flange.FRICTION_TORQUE, rel=(np.pi / (16 * n)) ** 2)
    assert np.all(np.abs(friction) <= flange.FRICTION_TORQUE * 1.05)
    turned = flange.angle(history)[:: flange.STEPS]
    final = 0.75 * flange.FRICTION_TORQUE / (flange.SPRINGS * flange.SECOND_MOMENT)
    assert np.all(np.diff(turned) > 0)
    assert 0.85 < turned[-1] / final < 1


@pytest.mark.long
def test_a_flange_at_rest_holds_its_torque():
    history = simulated(flange, 1, 4, parameters={"shaking": 0.0})
    final = 0.75 * flange.FRICTION_TORQUE / (flange.SPRINGS * flange.SECOND_MOMENT)
    assert flange.angle(history)[-1] < 0.1 * final
    assert np.ptp(flange.angle(history)) < 1e-6 * final


@pytest.mark.slow
def test_a_sphere_is_pressed_in_as_hertz_says():
    scene = sphere.scene().without(vx.CoulombFriction).with_(vx.Symmetry(on="left"))
    mesh = sphere.quarter(8)
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    contact = history.contact
    force = 4 * contact.pressure[-1] @ contact.lengths
    assert force == pytest.approx(4 * history.reaction("sole")[-1, 2], rel=1e-9)
    a, peak = sphere.hertz(force)
    share = contact.pressure[-1] * contact.lengths / (0.25 * force)
    radius = np.sqrt(2.5 * share @ (contact.points[:, :2] ** 2).sum(axis=1))
    assert radius == pytest.approx(a, rel=0.03)
    assert contact.pressure[-1].max() == pytest.approx(peak, rel=0.03)


@pytest.mark.slow
def test_a_sphere_is_dragged_as_cattaneo_and_mindlin_say():
    n = 6
    history = simulated(sphere, n, 4)
    P, Q = np.transpose(sphere.forces(history))[-1]
    a, mu = sphere.hertz(P)[0], sphere.FRICTION
    exact = a * np.cbrt(1 - Q / (mu * P))
    assert 0.4 < Q / (mu * P) < 0.8
    # To a cell: its sets are those of nodes a/n apart.
    assert sphere.stick_radius(history) == pytest.approx(exact, abs=a / n)
    contact = history.contact
    r = np.linalg.norm(contact.points[:, :2], axis=1)
    sticks = contact.sticking[-1] & contact.closed[-1]
    assert r[sticks].max() < exact + a / n
    assert r[~sticks & contact.closed[-1]].min() > exact - 2 * a / n


@pytest.mark.slow
def test_the_picture_of_the_sphere_shows_the_friction_of_cattaneo_and_mindlin():
    """Within half the radius that sticks, where cells were too coarse once: 4 to 7 % below the closed form."""
    history = simulated(sphere, sphere.SMALL["n"], sphere.SMALL["steps"])
    P, Q = np.transpose(sphere.forces(history))[-1]
    (a, peak), mu = sphere.hertz(P), sphere.FRICTION
    c = a * np.cbrt(1 - Q / (mu * P))
    r = np.linalg.norm(history.contact.points[:, :2], axis=1)
    inside = r < 0.5 * c
    exact = mu * peak * (np.sqrt(1 - (r[inside] / a) ** 2) - c / a * np.sqrt(1 - (r[inside] / c) ** 2))
    off = np.linalg.norm(history.contact.traction[-1, inside], axis=1) / exact - 1
    assert inside.sum() >= 5
    assert np.abs(off).max() < 0.08


@pytest.mark.long
@LOOSE
@pytest.mark.parametrize("family", SPACE)
def test_a_skew_joint_is_a_friction_spring(family):
    """Forces balance to rounding; where all of the joint slides, springs bear what the closed form says."""
    history = simulated(skew, skew.SMALL["n"] if family == "cubes" else 2, skew.SMALL["steps"], family)
    contact, known, found = history.contact, skew.exact_solution(history.times), skew.springs(history)
    assert (contact.partners >= 0).all()
    assert np.abs(skew.forces(history)[:, 2] + skew.load(history.times)).max() < 1e-12
    # Where stiff blocks just stick, elastic ones may slip at all nodes, by little and in directions of their own.
    slides = (contact.slip_count == len(contact.nodes)) & (np.abs(np.diff(known, prepend=0.0)) > 1e-9)
    assert slides.sum() >= 9
    assert found[slides] == pytest.approx(known[slides], rel=1e-4)
    # Blocks are as stiff as the springs at their sides a hundred times over.
    assert found == pytest.approx(known, abs=0.03 * known.max())
    turn, back = int(history.steps / 3), int(2 * history.steps / 3)
    assert found[turn] / found[back] == pytest.approx(skew.DOWN / (0.2 * skew.UP), rel=1e-4)


@pytest.mark.long
@LOOSE
def test_what_the_skew_joint_loses():
    """The small setting, in numbers; a full cycle of stiff blocks would lose two thirds of what goes in."""
    history = simulated(skew, **skew.SMALL)
    assert history.dissipated_second_order[-1] == pytest.approx(0.0011581957100063552, rel=1e-6)


def small_run(problem, mesh):
    """In the problem's small setting, on another mesh."""
    initial, small = getattr(problem, "initial", None), problem.SMALL
    times, solver = problem.times(small["steps"]), vx.Newton(small["accuracy"])
    return vx.simulate(problem.scene(), mesh, times, solver=solver, initial=initial)


@pytest.mark.long
def test_a_ball_lifts_off_its_socket_behind():
    """Faces at a node turn from their mean by less than a cell is seen under, 90 degrees over 2n."""
    history = small_run(ball, ball.mesh(2))
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
    x = contact.points[:, 0]
    opened = contact.pressure[-1] == 0
    assert x[opened].max() < 0 < opened.sum()
    assert (np.diff(contact.open_count[1:]) > 0).all()


@pytest.mark.long
@pytest.mark.parametrize("slant", [0.0, 0.5])
def test_a_dovetail_is_held_between_the_lines_of_full_slip(slant):
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
def test_a_bolted_lap_joint_slips_at_mu_times_what_presses_it(friction):
    """Friction turns into the pull as places slip: by a factor of seven a step, as they do here."""
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
    assert tension[:5] == pytest.approx(t[:5] * tension[4], rel=1e-2)
    bound, bears = friction * lap[:, 2], walls[:, 0] < 0
    assert (np.hypot(lap[:, 0], lap[:, 1]) <= bound * (1 + 1e-6)).all()
    full, way = -lap[:, 0] > 0.99 * bound, lap_joint.PULL * (t - 1.0)
    slides = np.flatnonzero(full & ~bears & (t > 1.0))
    assert np.abs(-lap[slides[-1], 0] / bound[slides[-1]] - 1) < 1e-8
    assert pull[slides[2:-1], 0] == pytest.approx(pull[slides[-1], 0], rel=1e-4)
    # The end goes by the clearance on top of what it takes to slip, to a step.
    assert way[bears][0] == pytest.approx(lap_joint.CLEARANCE + way[slides[0]], abs=way[-1] - way[-2])
    assert (np.diff(walls[bears, 0]) < 0).all()


def test_the_field_at_the_edge_leaves_the_inner_sides_free():
    """Tractions there are errors of central differences: their step squared, and rounding over it."""
    lame = bracket.SHEAR * 2 * bracket.POISSON / (1 - 2 * bracket.POISSON)
    upwards = np.array([[0.5, 0.5 + y, 0.1] for y in (0.01, 0.1, 0.4)])
    for x, across in ((upwards, 0), (upwards[:, [1, 0, 2]], 1)):
        e = bracket.strain(x, 1.0)
        stress = lame * (e[:, :1] + e[:, 1:2]) + 2 * bracket.SHEAR * e[:, :2]
        shear = bracket.SHEAR * e[:, 3]
        assert np.abs(np.column_stack([stress[:, across], shear])).max() < 1e-8 * np.abs(stress).max()


@pytest.mark.long
@pytest.mark.parametrize(("n", "target"), [(16, 0.2), pytest.param(24, 0.17, marks=pytest.mark.slow)])
def test_an_adaptive_bracket_has_less_than_a_third_of_the_nodes(n, target):
    """Of equal cubes whose true error is the same or larger."""
    found = bracket.adapt(target)
    equal = vx.simulate(bracket.scene(), bracket.mesh(n), bracket.times(1))
    assert bracket.relative_error(found) < min(target, bracket.relative_error(equal))
    assert found.mesh.n_nodes < 0.33 * equal.mesh.n_nodes


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports")
@pytest.mark.parametrize(("n", "upper", "highest"), [(8, None, 0.03), (12, 9, 0.07)])
def test_two_balls_press_as_hertz_says(n, upper, highest):
    """Radius and peak of the half-ellipsoid within three per cent; nodal pressures alternate where meshes differ."""
    history = small_run(balls, balls.mesh(n, upper=upper))
    radius, peak = balls.hertz(balls.force(history)[-1])
    found = balls.measure(history)
    assert found[0] == pytest.approx(radius, rel=0.03)
    assert found[1] == pytest.approx(peak, rel=0.03)
    assert history.contact.pressure[-1].max() == pytest.approx(peak, rel=highest)


@pytest.mark.long
def test_tubes_that_are_shrunk_on_press_as_lame_says():
    """The mean pressure within one per cent; and the tubes change their lengths."""
    history = small_run(tubes, tubes.mesh(8))
    assert tubes.mean_pressure(history) == pytest.approx(tubes.pressure() * history.times, rel=0.01, abs=1e-12)
    assert history.contact.pressure[-1] == pytest.approx(tubes.pressure(), rel=0.04)
    assert history.contact.pressure_recovered[-1] == pytest.approx(tubes.pressure(), rel=0.01)
    mesh = history.mesh
    for tube, strain in zip(("inner", "outer"), tubes.axial_strains(), strict=True):
        nodes = Space(mesh).part(f"{tube}.top", "top").nodes
        grown = history.displacement[-1, nodes, 2]
        assert (mesh.points[nodes, 2] == tubes.LENGTH).all()
        assert grown == pytest.approx(strain * tubes.LENGTH, rel=0.05)
        assert grown.mean() == pytest.approx(strain * tubes.LENGTH, rel=0.01)


@pytest.mark.long
def test_a_cone_clutch_slips_at_its_torque():
    """Within one per cent, of second order in the sectors; pressed uniformly before and then."""
    off = []
    for n in (6, 8):
        history = small_run(clutch, clutch.mesh(n))
        torque, pressure = clutch.torque(history), history.contact.pressure
        assert (np.diff(torque) > -1e-6 * clutch.TORQUE).all()
        assert np.abs(torque[:2]).max() < 1e-9 * clutch.TORQUE
        assert torque[2] < 0.6 * clutch.TORQUE
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
    history = small_run(lug, lug.mesh(4))
    area = history.mesh.face_areas[history.mesh.boundaries["pin.top"]].sum()
    force = lug.joint_force(history)[:, :2] / (area * lug.SHEAR)
    assert np.abs(force + lug.load(history.times)[:, :2] / lug.SHEAR).max() < 1e-9
    assert (np.diff(history.dissipated)[1:] > 0).all()
    contact = history.contact
    risen = history.times >= 1.0
    assert (contact.open_count[risen] > 50).all()
    # The pressure follows the load.
    weights = contact.pressure * contact.lengths
    middle = np.arctan2(weights @ contact.points[:, 1], weights @ contact.points[:, 0])
    behind = (middle - lug.direction(history.times) + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(behind[risen]).max() < 0.3


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports")
def test_the_pressure_of_lug_and_pin_has_no_ripple():
    """Beside a smooth field of angle and height, where it is a third of the peak at least: below 2 % of the median."""
    contact = vx.simulate(lug.scene(), lug.mesh(8), [0.0, 1.0], solver=vx.Newton(1e-6)).contact
    angle, z = np.arctan2(contact.points[:, 1], contact.points[:, 0]), contact.points[:, 2] / lug.THICK
    ripples = []
    for p in (contact.pressure[-1], contact.pressure_recovered[-1]):
        on, median = p > p.max() / 3, np.median(p[p > 0])
        waves = [np.cos(k * angle) for k in range(8)] + [np.sin(k * angle) for k in range(1, 8)]
        basis = np.column_stack([wave * z ** (2 * q) for wave in waves for q in range(3)])[on]
        weight = np.sqrt(contact.lengths[on])
        fit = basis @ np.linalg.lstsq(basis * weight[:, None], p[on] * weight, rcond=1e-10)[0]
        assert on.sum() > 4 * basis.shape[1]
        ripples.append(np.abs(p[on] - fit).max() / median)
    assert ripples[0] > 0.06
    assert ripples[1] < 0.02


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports")
def test_a_load_that_is_turned_has_the_turned_answer():
    mesh, turn = lug.mesh(3, layers=1), 2 * np.pi * 5 / 24
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    times, solver = lug.times(8), vx.Newton(1e-7)
    plain, other = (vx.simulate(lug.scene(turn=angle), mesh, times, solver=solver) for angle in (0.0, turn))
    x = plain.contact.points
    there = np.linalg.norm((x @ R.T)[:, None] - x, axis=2).argmin(axis=1)
    size = plain.contact.pressure.max()
    assert other.contact.pressure[:, there] == pytest.approx(plain.contact.pressure, abs=1e-3 * size)
    assert other.contact.traction[:, there] == pytest.approx(plain.contact.traction @ R.T, abs=1e-3 * size)
