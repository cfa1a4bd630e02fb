"""Solvers of different kinds, cross-validated on a table of scenes: each within what its certificates claim."""

from functools import cache

import numpy as np
import pytest
from scenes import cyclic, few_families, monotone, mostly_long, paper_scene, small
from solids import solid

import vemcvx as vx
from slip_weakening import SlipWeakening
from vemcvx.scene import pose_scene

pytestmark = [pytest.mark.arithmetic, pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")]
SOLVERS = {"newton": vx.Newton(), "clarabel": vx.Clarabel(), "osqp": vx.OSQP()}
TIMES = np.linspace(0.0, 1.0, 13)
FEW = TIMES[::3]
STEEL, JOINT = vx.Elasticity(200.0, 0.3), "lower|upper"


def rigid(way, on):
    """A side that moves as way(t)."""
    return vx.PrescribedDisplacement(lambda x, t: np.tile(way(t), (len(x), 1)), on=on)


def along(force, on):
    return vx.Traction(lambda x, t: np.tile(force(t), (len(x), 1)), on=on)


def growing(size):
    return lambda x, t: np.full(len(x), size * t)


def blocks():
    upper = vx.meshes.hexagons(4, box=((0, 1), (1, 2)))
    return vx.meshes.bodies({"lower": small("voronoi", 3), "upper": upper})


def cracked(n=8):
    mesh = vx.meshes.squares(n, box=((-4, 4), (-4, 4))).with_boundary("outside", lambda x: np.full(len(x), True))
    x, y = mesh.centroids.T
    return mesh.cut("crack", {"below": (np.abs(x) < 1) & (y < 0), "above": (np.abs(x) < 1) & (y > 0)})


def twisted(x, t):
    turned = 0.03 * t * np.column_stack([0.6 - x[:, 1], x[:, 0] - 0.5, np.zeros(len(x))])
    return turned + np.array([0.05 * np.sin(3 * t), 0.02 * np.sin(3 * t), -0.01 * t])


BLOCK = vx.Elasticity(10.0, 0.3), vx.Clamp(on="lower.bottom")
HELD = STEEL, vx.Clamp(on="right")
ON_FLOOR = vx.BilateralContact(on="bottom")
ASIDE = vx.PrescribedDisplacement(lambda x, t: x[:, 1:] * [0.02 * t, -0.01 * np.sin(5 * t)], on="outside")
CLOSING = vx.UnilateralContact(on=JOINT, gap=lambda x, t: 0.02 + 0.05 * (x[:, 0] - 0.5) ** 2)
DISHED = vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.004 * x[:, 0] ** 2)
SCENES = {
    "held by friction alone": (
        lambda: small("voronoi", 6),
        *(STEEL, along(lambda t: [3.6 * cyclic(t), 0.0], "left"), ON_FLOOR, vx.TrescaFriction(4.0, on="bottom")),
    ),
    "a block that lies on another": (
        blocks,
        *(*BLOCK, vx.UnilateralContact(on=JOINT), vx.CoulombFriction(0.5, on=JOINT)),
        *(vx.Pressure(growing(1.0), on="upper.top"), along(lambda t: [0.25 * t, 0.0], "upper.left")),
    ),
    "gaps that close with friction": (
        blocks,
        *(*BLOCK, CLOSING, vx.CoulombFriction(0.3, on=JOINT), rigid(lambda t: [0.1 * t, -0.1 * t], "upper.top")),
    ),
    "a crack": (cracked, STEEL, ASIDE, vx.UnilateralContact(on="crack"), vx.CoulombFriction(0.3, on="crack")),
    "friction that wears off": (
        lambda: small("voronoi", 4),
        *(*HELD, along(lambda t: [8 * np.sin(5 * t), -2 * t], "left"), ON_FLOOR),
        SlipWeakening(4.0, 1.0, 0.1, on="bottom"),
    ),
    "a twisted block in space": (
        lambda: solid("tetrahedra", 2, ((0, 1), (0, 1.2), (0, 0.9))),
        *(STEEL, vx.PrescribedDisplacement(twisted, on="top"), DISHED),
        vx.TrescaFriction(lambda x, t: 2.0 + x[:, 1], on="bottom", while_closed=False),
    ),
    "friction by direction": (
        lambda: vx.meshes.voronoi3(2),
        *(STEEL, rigid(lambda t: [0.02 * cyclic(t), 0.01 * t, 0.0], "top"), ON_FLOOR),
        vx.TrescaFriction(1.0, on="bottom", direction=(3.0, 2.0, 5.0), across=0.4),
    ),
}
"""What makes the mesh, and effects."""


def energy_norms(history, difference):
    """|u|_a of rows of nodal differences, with the matrix of the scene itself."""
    A = pose_scene(history.scene, history.mesh).A
    flat = difference.reshape(len(difference), -1)
    return np.sqrt(np.maximum(np.einsum("ni,ni->n", flat, (A @ flat.T).T), 0.0))


def assert_within_certificates(one, two, worth=1e-5):
    """Of the accumulated certificates, which are worth something beside the answer."""
    distance = energy_norms(one, one.displacement - two.displacement)
    scale = np.maximum.accumulate(np.sqrt(2 * one.energy))
    claimed = one.certificate_total + two.certificate_total + one.certificate_floor + two.certificate_floor
    assert (distance <= claimed * scale * (1 + 1e-6)).all()
    assert claimed[-1] < worth


@pytest.mark.long
@pytest.mark.parametrize("solver", ["clarabel", "osqp"])
@pytest.mark.parametrize("name", SCENES)
def test_scenes_are_answered_alike_within_certificates(name, solver):
    made, *effects = SCENES[name]
    mesh = made()
    if solver == "osqp" and mesh.points.shape[1] == 3:
        pytest.skip("discs are none of its terms")
    asked = {"clarabel": vx.Clarabel(), "osqp": vx.OSQP(1e-5)}[solver]
    one, two = (vx.simulate(vx.Scene(*effects), mesh, FEW, solver=s) for s in (vx.Newton(1e-9), asked))
    assert_within_certificates(one, two)
    assert one.dissipated[-1] > 0


@cache
def run(family, course, solver):
    load = {"monotone": monotone, "cyclic": cyclic}[course]
    return vx.simulate(paper_scene(load), small(family), TIMES, solver=SOLVERS[solver])


@few_families
@mostly_long("course", ["monotone", "cyclic"], "cyclic")
@mostly_long("pair", [("newton", "clarabel"), ("newton", "osqp"), ("clarabel", "osqp")])
def test_histories_agree_within_their_accumulated_certificates(family, course, pair):
    one, other = (run(family, course, solver) for solver in pair)
    assert_within_certificates(one, other)
    if course == "monotone":
        assert 0 < one.contact.sticking[-1].sum() < len(one.contact.nodes)
