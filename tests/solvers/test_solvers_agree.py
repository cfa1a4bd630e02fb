"""Solvers of different kinds agree within their certificates on a table of scenes."""

from functools import cache

import numpy as np
import pytest
from scenes import cyclic, monotone, mostly_long, paper_scene, small
from solids import solid

import vemcvx as vx
from slip_weakening import SlipWeakening
from vemcvx.scene import pose_scene

pytestmark = [pytest.mark.arithmetic, pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")]
SOLVERS = {"newton": vx.Newton(), "clarabel": vx.Clarabel(), "osqp": vx.OSQP()}
TIMES = np.linspace(0.0, 1.0, 13)
FEW = TIMES[::3]
STEEL, JOINT = vx.Elasticity(200.0, 0.3), "lower|upper"


def move_side(way, on):
    """Return a support that moves a side rigidly by way(t)."""
    return vx.PrescribedDisplacement(lambda x, t: np.tile(way(t), (len(x), 1)), on=on)


def pull_side(force, on):
    return vx.Traction(lambda x, t: np.tile(force(t), (len(x), 1)), on=on)


def make_blocks():
    upper = vx.meshes.hexagons(4, box=((0, 1), (1, 2)))
    return vx.meshes.bodies({"lower": small("voronoi", 3), "upper": upper})


def make_cracked_plate(n=8):
    mesh = vx.meshes.squares(n, box=((-4, 4), (-4, 4))).with_boundary("outside", lambda x: np.full(len(x), True))
    x, y = mesh.centroids.T
    return mesh.cut("crack", {"below": (np.abs(x) < 1) & (y < 0), "above": (np.abs(x) < 1) & (y > 0)})


def twist(x, t):
    turned = 0.03 * t * np.column_stack([0.6 - x[:, 1], x[:, 0] - 0.5, np.zeros(len(x))])
    return turned + np.array([0.05 * np.sin(3 * t), 0.02 * np.sin(3 * t), -0.01 * t])


ON_FLOOR = vx.BilateralContact(on="bottom")
SHEAR = vx.PrescribedDisplacement(lambda x, t: x[:, 1:] * [0.02 * t, -0.01 * np.sin(5 * t)], on="outside")
CLOSING = vx.UnilateralContact(on=JOINT, gap=lambda x, t: 0.02 + 0.05 * (x[:, 0] - 0.5) ** 2)
CURVED = vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.004 * x[:, 0] ** 2)
SCENES = {
    "held by friction alone": (
        lambda: small("voronoi", 6),
        *(STEEL, pull_side(lambda t: [3.6 * cyclic(t), 0.0], "left"), ON_FLOOR, vx.TrescaFriction(4.0, on="bottom")),
    ),
    "gaps that close with friction": (
        make_blocks,
        *(vx.Elasticity(10.0, 0.3), vx.Clamp(on="lower.bottom"), CLOSING, vx.CoulombFriction(0.3, on=JOINT)),
        move_side(lambda t: [0.1 * t, -0.1 * t], "upper.top"),
    ),
    "a crack": (
        make_cracked_plate,
        *(STEEL, SHEAR, vx.UnilateralContact(on="crack"), vx.CoulombFriction(0.3, on="crack")),
    ),
    "slip weakening": (
        lambda: small("voronoi", 4),
        *(STEEL, vx.Clamp(on="right"), pull_side(lambda t: [8 * np.sin(5 * t), -2 * t], "left"), ON_FLOOR),
        SlipWeakening(4.0, 1.0, 0.1, on="bottom"),
    ),
    "a twisted block in space": (
        lambda: solid("tetrahedra", 2, ((0, 1), (0, 1.2), (0, 0.9))),
        *(STEEL, vx.PrescribedDisplacement(twist, on="top"), CURVED),
        vx.TrescaFriction(lambda x, t: 2.0 + x[:, 1], on="bottom", while_closed=False),
    ),
    "friction by direction": (
        lambda: vx.meshes.voronoi3(2),
        *(STEEL, move_side(lambda t: [0.02 * cyclic(t), 0.01 * t, 0.0], "top"), ON_FLOOR),
        vx.TrescaFriction(1.0, on="bottom", direction=(3.0, 2.0, 5.0), across=0.4),
    ),
}
"""Name -> a function that makes the mesh, followed by the effects."""


def energy_norms(history, difference):
    """Return |u|_a for each row of nodal differences."""
    A = pose_scene(history.scene, history.mesh).A
    flat = difference.reshape(len(difference), -1)
    return np.sqrt(np.maximum(np.einsum("ni,ni->n", flat, (A @ flat.T).T), 0.0))


def assert_within_certificates(one, two, worth=1e-5):
    """Check that two histories differ by at most their total certificates, which are at most `worth`."""
    distance = energy_norms(one, one.displacement - two.displacement)
    scale = np.maximum.accumulate(np.sqrt(2 * one.energy))
    claimed = one.certificate_total + two.certificate_total + one.certificate_floor + two.certificate_floor
    assert (distance <= claimed * scale * (1 + 1e-6)).all()
    assert claimed[-1] < worth


@pytest.mark.long
@pytest.mark.parametrize("solver", ["clarabel", "osqp"])
@pytest.mark.parametrize("name", SCENES)
def test_conic_solvers_agree_with_newton_within_certificates(name, solver):
    make_mesh, *effects = SCENES[name]
    mesh = make_mesh()
    if solver == "osqp" and mesh.points.shape[1] == 3:
        pytest.skip("OSQP accepts no discs")
    conic = {"clarabel": vx.Clarabel(), "osqp": vx.OSQP(1e-5)}[solver]
    one, two = (vx.simulate(vx.Scene(*effects), mesh, FEW, solver=s) for s in (vx.Newton(1e-9), conic))
    assert_within_certificates(one, two)
    assert one.dissipated[-1] > 0


@cache
def run(course, solver):
    load = {"monotone": monotone, "cyclic": cyclic}[course]
    return vx.simulate(paper_scene(load), small("voronoi"), TIMES, solver=SOLVERS[solver])


@mostly_long("course", ["monotone", "cyclic"], "cyclic")
@pytest.mark.parametrize("pair", [("newton", "clarabel"), ("newton", "osqp"), ("clarabel", "osqp")])
def test_histories_of_three_solvers_agree_within_total_certificates(course, pair):
    one, other = (run(course, solver) for solver in pair)
    assert_within_certificates(one, other)
    if course == "monotone":
        assert 0 < one.contact.sticking[-1].sum() < len(one.contact.nodes)
