"""Every effect that exists in space against a closed form, on every family; every other is refused in a sentence."""

from __future__ import annotations

import numpy as np
import pytest
from solids import SOLIDS, solid

import vemcvx as vx

E, NU = 200.0, 0.3
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
BOX = ((0.0, 1.0), (0.0, 1.2), (0.0, 0.8))
VOLUME, HEIGHT, FOOT = 0.96, 0.8, 1.2
STEPS = [0.0, 0.5, 1.0]
BODY = vx.Elasticity(E, NU)
ROLLERS = vx.Symmetry(on=["left", "front"])
EXACT = 1e-11


@pytest.fixture(params=SOLIDS)
def mesh(request):
    return solid(request.param, 2, BOX)


def run(mesh, *effects, times=STEPS, **options):
    return vx.simulate(vx.Scene(*effects), mesh, times, **options)


def same(found, exact):
    """To rounding that grows in a solve."""
    assert np.abs(found - exact).max() < EXACT * np.abs(exact).max()


def squeezed(mesh, pressure, floor=0.0):
    """Under pressure from above, free to bulge; the floor gives way by so much."""
    u = mesh.points * [NU, NU, -1.0] * pressure / E
    u[:, 2] -= floor
    return u


def test_patch_with_mixed_conditions(mesh):
    """A linear field: prescribed whole, along a normal and along a vector, tractions elsewhere."""
    slope = np.array([[0.3, -1.2, 0.4], [0.7, 0.4, 0.1], [-0.2, 0.5, 0.6]]) * 1e-2
    strain = 0.5 * (slope + slope.T)
    sigma = 2 * MU * strain + LAM * np.trace(strain) * np.eye(3)
    along = np.array([2.0, -1.0, 2.0]) / 3

    def u(x, t):
        return t * (x @ slope.T + [0.2, -0.1, 0.3])

    def pull(normal, free):
        return lambda x, t: np.tile(t * (free @ sigma @ normal), (len(x), 1))

    x, y, z = np.eye(3)
    history = run(
        mesh,
        BODY,
        vx.PrescribedDisplacement(u, on="bottom"),
        vx.PrescribedDisplacement(lambda p, t: u(p, t) @ x, on="right", direction="normal"),
        vx.Traction(pull(x, np.eye(3) - np.outer(x, x)), on="right"),
        vx.PrescribedDisplacement(lambda p, t: u(p, t) @ along, on="back", direction=along),
        vx.Traction(pull(y, np.eye(3) - np.outer(along, along)), on="back"),
        *(vx.Traction(pull(n, np.eye(3)), on=name) for n, name in ((-x, "left"), (-y, "front"), (z, "top"))),
    )
    same(history.displacement[-1], u(mesh.points, 1.0))
    same(history.stress(-1), np.tile(sigma[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]], (mesh.n_cells, 1)))
    principal = np.linalg.eigvalsh(sigma)[::-1]
    same(history.principal_stresses(-1), np.tile(principal, (mesh.n_cells, 1)))
    deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
    same(history.von_mises(-1), np.full(mesh.n_cells, np.sqrt(1.5) * np.linalg.norm(deviator)))
    assert history.energy[-1] == pytest.approx(0.5 * VOLUME * np.sum(sigma * strain), rel=EXACT)


def test_pressure_and_symmetry(mesh):
    history = run(mesh, BODY, ROLLERS, vx.Symmetry(on="bottom"), vx.Pressure(lambda x, t: 3 * t, on="top"))
    same(history.displacement[-1], squeezed(mesh, 3.0))
    assert history.reaction("bottom")[-1, 2] == pytest.approx(3 * FOOT, rel=EXACT)


def test_clamp_bears_the_weight(mesh):
    history = run(mesh, BODY, vx.Clamp(on="bottom"), vx.BodyForce(lambda x, t: t * np.array([2.0, -1.0, -5.0])))
    assert np.abs(history.displacement[:, mesh.points[:, 2] == 0]).max() == 0.0
    assert history.reaction("bottom")[-1] == pytest.approx(VOLUME * np.array([-2.0, 1.0, 5.0]), rel=EXACT)


@pytest.mark.long
def test_elastic_foundation(mesh):
    """Under pressure it gives way by p/k; pushed along the floor, it moves by q/k besides its own shear."""
    springs = vx.ElasticFoundation(normal=50.0, tangential=20.0, on="bottom")
    history = run(mesh, BODY, ROLLERS, vx.Pressure(lambda x, t: 3 * t, on="top"), springs)
    # Springs along the floor would hold the bulge back.
    frictionless = vx.ElasticFoundation(normal=50.0, on="bottom")
    free = run(mesh, BODY, ROLLERS, vx.Pressure(lambda x, t: 3 * t, on="top"), frictionless)
    same(free.displacement[-1], squeezed(mesh, 3.0, floor=3.0 / 50.0))
    assert history.energy[-1] < free.energy[-1]
    assert free.energy[-1] == pytest.approx(0.5 * 9 / E * VOLUME + 0.5 * 9 / 50 * FOOT, rel=EXACT)
    slid = run(
        mesh,
        BODY,
        vx.PrescribedDisplacement(0.0, on=["bottom", "top"], direction="normal"),
        vx.Symmetry(on=["front", "back"]),
        springs,
        *(vx.Traction(lambda x, t, s=s: [0.0, 0.0, s * t], on=on) for on, s in (("left", -1.0), ("right", 1.0))),
        vx.Traction(lambda x, t: [t, 0.0, 0.0], on="top"),
    )
    exact = np.zeros_like(mesh.points)
    exact[:, 0] = 1 / 20 + mesh.points[:, 2] / MU
    same(slid.displacement[-1], exact)


def test_thermal_strain(mesh):
    """Free to expand, it has no stress; blocked, a pressure of 3 K alpha theta on all planes."""
    swell = vx.ThermalStrain(1e-3, lambda x, t: 20 * t)
    free = run(mesh, BODY, ROLLERS, vx.Symmetry(on="bottom"), swell)
    same(free.displacement[-1], 0.02 * mesh.points)
    assert np.abs(free.stress(-1)).max() < EXACT * E
    blocked = run(mesh, BODY, vx.Clamp(on="boundary"), swell).stress(-1)
    same(blocked, np.tile(np.repeat([-0.02 * (3 * LAM + 2 * MU), 0.0], 3), (mesh.n_cells, 1)))


def test_prestress(mesh):
    """Kept where the body is held; a free body relaxes by C^-1 of it."""
    stress = np.array([3.0, -1.0, 2.0, 0.5, -0.7, 0.3])
    held = run(mesh, BODY, vx.Clamp(on="boundary"), vx.Prestress(lambda x, t: t * stress))
    same(held.stress(-1), np.tile(stress, (mesh.n_cells, 1)))
    walls = vx.Symmetry(on=["left", "front", "bottom"])
    free = run(mesh, BODY, walls, vx.Prestress(lambda x, t: t * np.array([3.0, -1.0, 2.0, 0.0, 0.0, 0.0])))
    same(free.displacement[-1], mesh.points * -((1 + NU) * stress[:3] - NU * 4.0) / E)
    assert np.abs(free.stress(-1)).max() < EXACT * 10


@pytest.mark.long
def test_viscosity_creeps_as_backward_euler_says(mesh):
    """Without cross contraction: sigma = 2 (mu e + eta e')."""
    shear, eta = 80.0, 30.0
    times = np.array([0.0, 0.2, 0.5, 1.0])
    load = vx.Pressure(lambda x, t: -4.0, on="top")
    walls = vx.Symmetry(on=["left", "front", "bottom"])
    history = run(mesh, vx.Elasticity(2 * shear, 0.0), vx.Viscosity(eta), walls, load, times=times)
    e = 0.0
    for step, k in enumerate(np.diff(times), start=1):
        e = (2.0 + eta * e / k) / (shear + eta / k)
        same(history.displacement[step], mesh.points * [0.0, 0.0, e])


def test_normal_compliance_and_a_gap(mesh):
    """Pushed down by w = gap + p / k + p H / E."""
    w, k, gap = 0.05, 50.0, 0.01
    lid = vx.PrescribedDisplacement(lambda x, t: -w * t, on="top", direction="normal")
    history = run(mesh, BODY, ROLLERS, lid, vx.NormalCompliance(k, on="bottom", gap=gap))
    pressure = (w - gap) / (1 / k + HEIGHT / E)
    same(history.displacement[-1], squeezed(mesh, pressure, floor=gap + pressure / k))
    assert history.contact.pressure[-1] == pytest.approx(pressure, rel=1e-9)


def test_one_sided_contact_closes_a_gap(mesh):
    """Pressed down through the gap, squeezed, and lifted off again."""

    def top(x, t):
        return {0.0: 0.0, 1.0: -0.01, 2.0: -0.05, 3.0: 0.02}[t]

    lid = vx.PrescribedDisplacement(top, on="top", direction="normal")
    history = run(mesh, BODY, ROLLERS, lid, vx.UnilateralContact(on="bottom", gap=0.03), times=[0.0, 1.0, 2.0, 3.0])
    pressure = E * 0.02 / HEIGHT
    assert history.contact.pressure[:2] == pytest.approx(0.0, abs=1e-12)
    assert history.contact.pressure[2] == pytest.approx(pressure, rel=1e-9)
    same(history.displacement[2], squeezed(mesh, pressure, floor=0.03))
    assert history.contact.closed.all(axis=1).tolist() == [False, False, True, False]
    assert not history.contact.closed[[0, 1, 3]].any()


@pytest.mark.long
def test_coulomb_friction_under_uniform_pressure(mesh):
    """Without cross contraction pressure is uniform, and friction is Tresca's with the bound f p."""
    shear, press, f = 80.0, 0.02, 0.4
    bound = f * 2 * shear * press / HEIGHT
    reach = bound * HEIGHT / shear
    path = reach * np.array([(0, 0), (0.6, 0.4), (2.0, 0.5), (2.5, 2.0), (2.1, 1.7), (-1.0, 2.0)])
    foot = [np.zeros(2)]
    for place in path[1:]:
        apart = place - foot[-1]
        foot.append(place - apart * min(1.0, reach / np.linalg.norm(apart)))
    lean = (path - foot) / HEIGHT

    def side(axis, sign):
        return lambda x, t: [0.0, 0.0, sign * shear * lean[round(t), axis]]

    sides = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)
    history = run(
        mesh,
        vx.Elasticity(2 * shear, 0.0),
        vx.PrescribedDisplacement(lambda x, t: [*path[round(t)], -press], on="top"),
        *(vx.Traction(side(axis, sign), on=name) for name, axis, sign in sides),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(f, on="bottom"),
        times=np.arange(6.0),
        initial="settled",
    )
    exact = np.zeros_like(history.displacement)
    exact[:, :, :2] = np.array(foot)[:, None] + mesh.points[:, 2, None] * lean[:, None]
    exact[:, :, 2] = -press * mesh.points[:, 2] / HEIGHT
    assert np.abs(history.displacement - exact).max() < 1e-8 * np.abs(exact).max()
    assert history.contact.bound[1:] == pytest.approx(bound, rel=1e-7)


CUBES = vx.meshes.cubes(2)


def test_a_block_that_friction_alone_holds_is_said_to_drift_and_turn():
    motions = (
        r"translation \(1, 0, 0\) .* translation \(0, 1, 0\) .* a rotation about \(0, 0, 1\) of the body\. Stresses"
    )
    with pytest.warns(vx.SceneWarning, match=motions):
        run(CUBES, BODY, vx.BilateralContact(on="bottom"), vx.TrescaFriction(1.0, on="bottom"))


def test_friction_that_supports_drag_all_over():
    """No unknown moves what rubs: friction is g against the motion, and the supports bear it."""
    moved = vx.PrescribedDisplacement(lambda x, t: [0.1 * t, 0.2 * t, 0.0], on="bottom")
    scene = (BODY, vx.Clamp(on="top"), moved, vx.BilateralContact(on="bottom"), vx.TrescaFriction(3.0, on="bottom"))
    history = run(CUBES, *scene)
    assert history.dissipated == pytest.approx(3.0 * np.hypot(0.1, 0.2) * np.array(STEPS), rel=1e-12)
    along = np.array([0.1, 0.2, 0.0]) / np.hypot(0.1, 0.2)
    assert history.contact.traction[1:] == pytest.approx(np.tile(-3.0 * along, (2, 9, 1)), rel=1e-12)


def test_several_materials_meet_in_a_body():
    """Two layers in series under pressure."""
    mesh = vx.meshes.cubes(2, BOX)
    upper = mesh.centroids[:, 2] > HEIGHT / 2
    mesh = mesh.with_cell_data("upper", upper).with_cell_data("lower", ~upper)
    walls = vx.Symmetry(on=["left", "right", "front", "back", "bottom"])
    soft, stiff = vx.Elasticity(E, 0.0, on="upper"), vx.Elasticity(4 * E, 0.0, on="lower")
    history = run(mesh, soft, stiff, walls, vx.Pressure(lambda x, t: t, on="top"))
    top = mesh.points[:, 2] == HEIGHT
    assert history.displacement[-1, top, 2] == pytest.approx(-HEIGHT / 2 * (1 / E + 1 / (4 * E)), rel=EXACT)
