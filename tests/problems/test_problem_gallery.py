"""Displacements and forces of problems are compared with closed forms."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scenes import any_family, few_families, mostly_long

import beam_on_a_stop as beam
import block_between_dies as dies
import block_with_grain as grain
import bonded_pad as pad
import circular_inclusion as inclusion
import fault_slip as fault
import gallery
import janssen_silo as silo
import joint_diagram as diagram
import liner_in_housing as liner
import plate_with_hole as hole
import pressurised_crack as crack
import pretensioned_tendon as tendon
import rigid_punch as punch
import rough_layer as layer
import strip_on_a_belt as belt
import vemcvx as vx

FLOOR = 1e-7
"""Relative error of displacements and forces for the certified energy error 1e-8."""


@cache
def run_small(problem):
    return gallery.small_run(problem)


def simulate(problem, n, steps=None, family=None, **parameters):
    mesh = problem.mesh(n) if family is None else problem.mesh(n, family=family)
    times = problem.times(problem.SMALL["steps"] if steps is None else steps)
    solver = vx.Newton(accuracy=problem.SMALL.get("accuracy", 1e-8))
    return vx.simulate(problem.scene(**parameters), mesh, times, solver=solver)


@pytest.mark.long
def test_a_plate_with_a_hole_has_the_field_of_kirsch():
    """Displacements, and stresses at centroids, have errors O(h^2)."""
    off, rim = [], []
    for n in (8, 16):
        history = simulate(hole, n)
        mesh = history.mesh
        exact, weights = hole.kirsch(mesh.centroids)[1], mesh.areas[:, None]
        error = history.stress(-1) - exact
        off.append(np.sqrt((weights * error**2).sum() / (weights * exact**2).sum()))
        u = hole.kirsch(mesh.points)[0]
        rim.append(np.abs(history.displacement[-1] - u).max() / np.abs(u).max())
        # The relative error of this force is at most the relative error of stresses.
        assert -history.reaction("last")[-1, 0] == pytest.approx(hole.roller_force(), rel=off[-1])
    assert 3.5 < off[0] / off[1] < 4.5
    assert 3.5 < rim[0] / rim[1] < 4.5
    assert rim[1] < (np.pi / 64) ** 2
    highest = hole.kirsch(mesh.centroids[mesh.centroids[:, 0].argmin()][None])[1][0, 0]
    assert history.stress(-1)[:, 0].max() == pytest.approx(highest, rel=0.05)


@pytest.mark.long
def test_the_stress_in_a_fibre_is_uniform():
    """Displacements and the mean stress have errors O(h^2). Stresses of single cells have errors O(h)."""
    mean, around = [], []
    for n in (8, 16):
        history = simulate(inclusion, n)
        fibre, exact = history.mesh.cell_data["fibre"] != 0, inclusion.constants()[3]
        areas, stress = history.mesh.areas[fibre], history.stress(-1)[fibre]
        mean.append(np.abs(areas @ stress / areas.sum() - exact).max() / exact[0])
        outside = np.linalg.norm(history.mesh.points, axis=1) >= 1 - 1e-9
        u = inclusion.outside(history.mesh.points[outside])[0]
        around.append(np.abs(history.displacement[-1][outside] - u).max() / np.abs(u).max())
        assert np.abs(stress - exact).max() < np.pi / (2 * n) * exact[0] / 2
    assert 3.5 < mean[0] / mean[1] < 4.5
    assert 3.5 < around[0] / around[1] < 4.5
    assert mean[1] < (np.pi / 32) ** 2


@pytest.mark.long
@few_families
def test_a_block_with_grain_is_exact_on_every_mesh(family):
    history = simulate(grain, 5, family=family)
    contact, (gamma, a, stress) = history.contact, grain.exact_solution(history.times)
    lifted = -(grain.top(history.times)[1] / grain.HEIGHT)[:, None] * history.mesh.points[:, 1]
    exact = np.stack([a[:, None] + gamma[:, None] * history.mesh.points[:, 1], lifted], axis=2)
    size = np.abs(stress).max()
    assert np.abs(history.displacement - exact).max() < FLOOR * np.abs(exact).max()
    # The condition number of the contact problem multiplies the errors of forces.
    assert np.abs(contact.pressure + stress[:, 1:2]).max() < 10 * FLOOR * size
    assert np.abs(contact.traction[:, :, 0] + stress[:, 2:]).max() < 10 * FLOOR * size


def test_a_crack_opens_where_the_fluid_bears_more_than_the_rock():
    """Closed contact bears the rock's stress minus the fluid pressure."""
    history = run_small(crack)
    p, x = crack.fluid(history.times), crack.measure_opening(history)[0]
    bears = np.broadcast_to(np.maximum(crack.ACROSS - p, 0.0)[:, None], history.contact.pressure.shape)
    assert history.contact.pressure == pytest.approx(bears, abs=1e-9 * crack.ACROSS)
    exact = np.array([crack.opening(x, one) for one in p])
    away = np.abs(x) < 0.3
    assert crack.measure_opening(history)[1][:, away] == pytest.approx(exact[:, away], rel=0.03, abs=1e-9 * exact.max())
    assert np.abs(history.displacement[p <= crack.ACROSS]).max() < 1e-9 * exact.max()


def test_the_slip_of_a_fault_causes_the_given_stress_drop():
    """On the middle six tenths of the fault, the error of the stress drop is below 2 %."""
    x, lost = fault.stress_drop(run_small(fault))
    assert lost[-1, np.abs(x) < 0.6] == pytest.approx(fault.DROP, rel=0.02)


@pytest.mark.long
def test_a_tendon_keeps_its_stress_beyond_the_transfer_length():
    """The computed draw-in is within .13 % of rod theory."""
    history, H = run_small(tendon), tendon.HEIGHT
    third, mesh = history.steps // 3, history.mesh
    end = mesh.points[:, 0] == tendon.LENGTH
    found = -history.displacement[[third, 2 * third, 3 * third]][:, end, 0].mean(axis=1)
    assert found == pytest.approx(tendon.draw_in(), rel=H / tendon.transfer_length() / 8)
    assert found[2] == pytest.approx(found[0], rel=1e-6)
    s, sigma = tendon.LENGTH - mesh.centroids[:, 0], history.stress(third)[:, 0]
    for place in (2.125, 10.125, 30.125):
        section = np.abs(s - place) < 1e-9
        # The tolerance is the friction of half a cell.
        assert sigma[section].mean() == pytest.approx(tendon.stress(place), abs=tendon.BOUND * 0.25 / H)


@pytest.mark.long
def test_a_liner_leans_on_its_housing_from_the_closing_pressure_on():
    """Radial displacements and pressures have errors O(h^2). The pressure is zero until the gap closes."""
    errors = []
    for n in (5, 10):
        history = simulate(liner, n)
        p, points = liner.PRESSURE * history.times, history.mesh.points
        q, r = liner.contact_pressure(p), np.linalg.norm(history.mesh.points, axis=1)
        exact = np.array([liner.radial_displacement(r, *pair) for pair in zip(p, q, strict=True)])
        radial = np.einsum("snd,nd->sn", history.displacement, points) / r
        # Contact forces of nodes on the lines of symmetry include reactions of the rollers.
        free = (history.contact.points > 1e-9).all(axis=1)
        found = history.contact.pressure[:, free]
        errors.append([np.abs(radial - exact).max() / exact.max(), np.abs(found - q[:, None]).max() / q.max()])
    assert (np.array(errors[1]) < (np.pi / 40) ** 2).all()
    assert (np.divide(*errors) > 3.0).all()
    assert (np.divide(*errors) < 5.0).all()


@pytest.mark.long
def test_a_belt_pulls_a_strip_by_the_force_of_a_rod():
    """Rod theory has an error O(height / slip length), and is exact if all nodes slip."""
    history, contact = run_small(belt), run_small(belt).contact
    most, fifth = belt.BOUND * belt.LENGTH, history.steps // 5
    found, exact = -history.reaction("left")[:, 0], belt.hold(history.times)
    assert np.abs(found - exact).max() < most / belt.LENGTH * belt.HEIGHT / 4
    slides = ~contact.sticking.any(axis=1)
    assert slides[[fifth, 3 * fifth, 5 * fifth]].all()
    assert np.abs(found - exact)[slides].max() < FLOOR * most
    # A closed loop of the belt ends in the state in which it began.
    assert np.abs(history.displacement[5 * fifth] - history.displacement[fifth]).max() < FLOOR * belt.AMPLITUDE


@pytest.mark.long
def test_a_silo_hangs_on_its_walls():
    """The theory of slices has an error O((width / decay length)^2), .9 % for mu = .4 and .3 % for mu = .2."""
    errors = []
    for friction in (0.2, 0.4):
        history = simulate(silo, 4, steps=2, friction=friction)
        depth, sigma = silo.HEIGHT - history.mesh.centroids[:, 1], -history.stress(-1)[:, 1]
        levels = np.unique(depth.round(9))[: -2 * 4]  # without the lowest part, two widths high
        mean = np.array([sigma[np.abs(depth - level) < 1e-6].mean() for level in levels])
        exact = silo.vertical_stress(levels, friction)
        errors.append(np.abs(mean - exact).max() / exact.max())
        small_number = (silo.WIDTH / silo.decay_length(friction)) ** 2
        assert errors[-1] < 0.5 * small_number
    assert errors[1] / errors[0] > 2.5
    weight = silo.WEIGHT * silo.WIDTH * silo.HEIGHT
    floor, wall = (history.reaction(name)[-1, 1] + history.force(name)[-1, 1] for name in ("bottom", "right"))
    assert floor + wall == pytest.approx(weight, rel=1e-9)
    assert floor < 0.4 * weight


@pytest.mark.long
def test_a_beam_meets_its_stop():
    """The deflection has an error O(h^2). The force of the stop is within one per cent of Timoshenko's theory."""
    history = run_small(beam)
    force = beam.FORCE * history.times
    end = (history.mesh.points == [beam.LENGTH, 0.0]).all(axis=1)
    found, R = -history.displacement[:, end, 1].mean(axis=1), history.force("stop")[:, 1]
    # With 16 squares across the height, the beam bends .8 % too little.
    near = {"rel": 0.01, "abs": 1e-6}
    assert found == pytest.approx(beam.end_deflection(force), **near)
    free = force * beam.deflection_by_force() < beam.GAP
    assert 3 <= free.sum() <= len(force) - 3
    assert np.abs(R[free]).max() < 1e-6
    leaning = force * beam.deflection_by_force() > 1.2 * beam.GAP
    assert R[leaning] == pytest.approx(beam.stop_force(force[leaning]), abs=0.01 * beam.stop_force(beam.FORCE))
    assert history.reaction("left")[-1, 1] + R[-1] == pytest.approx(beam.FORCE, rel=1e-9)


@mostly_long("poisson", [0.49, 0.4999], 1)
def test_a_bonded_pad_has_the_pressure_of_a_thin_layer(poisson):
    """Pressures exceed thin-layer theory by at most 4.5 mu d / h: shear modulus mu, compression d, thickness h."""
    history = simulate(pad, 8, poisson=poisson)
    x, sigma = history.mesh.centroids, history.stress(-1)
    under = (x[:, 1] > x[:, 1].max() - 1e-9) & (x[:, 0] < pad.HALF_WIDTH - pad.HEIGHT)
    extra = -sigma[under, 1] - pad.pressure(x[under, 0], poisson)
    unit = pad.MU * pad.SQUEEZE / pad.HEIGHT
    assert (extra > 0).all()
    assert extra.max() < 4.5 * unit < 0.2 * pad.pressure(0.0, poisson)
    force = -history.reaction("top")[-1, 1]
    assert 0 < force - pad.force(poisson) < 4.5 * unit * pad.HALF_WIDTH
    # Without the clamp, the pressure would be 4 mu d / h for nu = 1/2, less than a fifth of the mean pressure here.
    assert force > 5 * 4 * unit * pad.HALF_WIDTH


@any_family
def test_dies_press_alike_whatever_their_angle(family):
    """Displacements, stresses and pressures are exact on every mesh."""
    history = simulate(dies, 5, steps=2, family=family)
    mesh, p = history.mesh, dies.pressure(1.0)
    exact = -dies.CLOSING * (mesh.points - dies.FOOT)
    assert np.abs(history.displacement[-1] - exact).max() < FLOOR * np.abs(exact).max()
    assert np.abs(history.stress(-1) + p * np.array([1.0, 1.0, 0.0])).max() < FLOOR * p
    inner = (history.contact.points[:, 0] > 0) & (history.contact.points[:, 0] < dies.CORNERS[1, 0])
    assert history.contact.pressure[-1][inner] == pytest.approx(p, rel=10 * FLOOR)


@pytest.mark.long
@few_families
def test_a_column_and_its_layer_are_compressed_in_series(family):
    """The pressure is exact on every mesh, before and after the gap closes."""
    history = simulate(layer, 4, family=family)
    p = layer.pressure(layer.DEPTH * history.times)
    assert np.abs(history.contact.pressure - p[:, None]).max() < FLOOR * p.max()
    under = history.displacement[:, history.contact.nodes, 1]
    closed = p > 0
    assert np.abs(-under[closed] - layer.GAP - p[closed, None] / layer.LAYER).max() < FLOOR * layer.DEPTH
    assert (~closed).sum() >= 2
    assert -history.stress(-1)[:, 1] == pytest.approx(p[-1], rel=FLOOR)


@pytest.mark.long
def test_a_rigid_punch_tilts():
    history = run_small(punch)
    tilts, exact = punch.tilt(history), punch.turn(history.times)
    assert tilts[:3] == pytest.approx(np.zeros(3), abs=1e-9 * np.abs(tilts).max())
    assert tilts[-1] == pytest.approx(exact[-1], rel=0.11)
    x, p = history.contact.points[:, 0], history.contact.pressure
    inside = np.abs(x) < 0.6
    for step in (0, -1):
        wanted = punch.pressure(x[inside], history.times[step])
        assert p[step, inside] == pytest.approx(wanted, abs=0.1 * punch.FORCE)
    assert history.force(vx.Rigid) == pytest.approx(np.tile([0.0, -punch.FORCE], (len(p), 1)), abs=1e-9)


def test_the_joint_diagram_of_a_bolt():
    history = run_small(diagram)
    bolt, sleeve = history.force("shank|head")[:, 1], history.force("left|cap")[:, 1] + history.force("right|cap")[:, 1]
    assert bolt == pytest.approx(diagram.bolt_force(history.times), abs=FLOOR * diagram.OPENS)
    assert sleeve == pytest.approx(diagram.pull(history.times) - bolt, abs=FLOOR * diagram.OPENS)
