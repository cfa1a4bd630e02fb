"""Discs of friction that a support, a symmetry plane or contact on the other side of an edge cuts to a segment."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.vem import Space, stiffness

FEW = 60
"""Linear systems of a step; 38 at most were seen, on five kernels. Where rows that follow from others' spoil the
systems of sets, it takes more than the 200 that Newton may."""


def down(size):
    return vx.Traction(lambda x, t: np.tile([0.0, 0.0, -size * t], (len(x), 1)), on="top")


def pressed_into_corner(on, friction, n=2):
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3), vx.Clamp(on="right"), down(0.02), vx.UnilateralContact(on=on), friction(on)
    )
    return scene, vx.meshes.cubes(n)


@pytest.mark.parametrize("on", [["bottom", "front"], ["bottom", "front", "left"]], ids=len)
@pytest.mark.parametrize("coefficient", [0.1, 0.3])
def test_coulombs_law_at_edges_and_corners_of_contact(on, coefficient):
    """Newton finds it on its sets, with forces within their bounds."""
    scene, mesh = pressed_into_corner(on, lambda on: vx.CoulombFriction(coefficient, on=on))
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert history.certificate.max() < 1e-8
    assert history.iterations[-1] <= FEW
    # What rubs on several faces has a bound for each.
    alone = history.contact.closed[-1] & (np.abs(history.contact.normals).max(axis=1) > 0.999)
    size = np.linalg.norm(history.contact.traction[-1][alone], axis=1)
    bound = coefficient * history.contact.pressure[-1][alone]
    assert alone.any()
    assert (size <= bound + 1e-10 * bound.max()).all()


@pytest.mark.long
@pytest.mark.parametrize("bound", [0.003, 0.01])
def test_given_bounds_on_three_faces(bound):
    on = ["bottom", "front", "left"]
    scene, mesh = pressed_into_corner(on, lambda on: vx.TrescaFriction(bound, on=on), n=3)
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert history.certificate.max() < 1e-8
    other = vx.simulate(scene, mesh, [0.0, 1.0], solver=vx.Clarabel())
    assert apart(history, other) <= (history.certificate + other.certificate)[-1]


def apart(one, other):
    """The energy norm of the difference of last states, in that of the first."""
    lam, mu = (np.full(one.mesh.n_cells, modulus) for modulus in (0.3 / 0.52, 1 / 2.6))
    K = stiffness(Space(one.mesh), lam, mu)
    u, v = one.displacement[-1].ravel(), other.displacement[-1].ravel()
    return np.sqrt((u - v) @ K @ (u - v) / (u @ K @ u))


def pushed(x, t):
    return t * np.column_stack([0.02 * x[:, 0], 0.03 * x[:, 1], -0.05 * (1 - 0.3 * x[:, 0] ** 2)])


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction:vemcvx.SceneWarning")
@pytest.mark.parametrize(
    ("planes", "counts"), [(["left"], (2, 4, 2)), (["front"], (4, 2, 2)), (["left", "front"], (2, 2, 2))]
)
def test_parts_of_symmetric_bodies_answer_as_the_whole(planes, counts):
    """Symmetry planes hold one direction of the nodes of friction at their foot; so do answers of the whole body."""
    effects = (
        vx.Elasticity(1.0, 0.3),
        vx.Traction(pushed, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    )
    whole = vx.simulate(vx.Scene(*effects), vx.meshes.cubes((4, 4, 2), box=((-1, 1), (-1, 1), (0, 1))), [0.0, 1.0])
    box = tuple((0 if name in planes else -1, 1) for name in ("left", "front"))
    part = vx.simulate(
        vx.Scene(*effects, vx.Symmetry(on=planes)), vx.meshes.cubes(counts, box=(*box, (0, 1))), [0.0, 1.0]
    )
    assert part.certificate.max() < 1e-8
    assert part.iterations[-1] <= FEW
    same = [int(np.argmin(np.linalg.norm(whole.mesh.points - x, axis=1))) for x in part.mesh.points]
    scale = np.abs(whole.displacement[-1]).max()
    np.testing.assert_allclose(part.displacement[-1], whole.displacement[-1][same], rtol=0, atol=1e-8 * scale)
