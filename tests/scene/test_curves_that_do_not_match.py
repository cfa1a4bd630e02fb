"""Contact along a curve between meshes that do not match."""

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx
from vemcvx.vem import Space

INNER, JOINT, OUTER = 1.0, 1.6, 2.4


def ring(inside, outside, cells, turn):
    """Return the sector of a ring between the angles 0 and `turn`."""
    radii = np.geomspace(inside, outside, max(1, round(cells / turn * np.log(outside / inside))) + 1)
    return vx.meshes.ring(radii, cells, angles=(0.0, turn))


def rings(cells, others, turn=2 * np.pi, order=("inner", "outer"), interfaces=None):
    parts = {"inner": ring(INNER, JOINT, cells, turn), "outer": ring(JOINT, OUTER, others, turn)}
    apart = JOINT * (turn / min(cells, others)) ** 2 / 7
    mesh = vx.meshes.bodies({name: parts[name] for name in order}, interfaces, tolerance=apart)
    mesh = mesh.with_boundary("bore", lambda x: np.hypot(*x.T) < INNER + 0.1)
    mesh = mesh.with_boundary("rim", lambda x: np.hypot(*x.T) > OUTER - 0.1)
    return mesh if turn > 6 else mesh.with_boundary("cut", lambda x: np.abs(x).min(axis=1) < 1e-9)


@pytest.mark.long
@pytest.mark.parametrize("digits", [16, 5])
@pytest.mark.parametrize("named", [("inner", "outer"), ("outer", "inner")], ids="|".join)
@pytest.mark.parametrize("order", [("inner", "outer"), ("outer", "inner")], ids=" before ".join)
@pytest.mark.parametrize("cells", [(16, 20), (20, 16), (16, 21), (12, 48), (360, 450)])
def test_normals_of_a_circle_are_radial(cells, order, named, digits):
    mesh = rings(*cells, order=order, interfaces={"joint": named})
    joint = mesh.interfaces["joint"]
    if digits < 16:
        sides = {name: edges for name, edges in mesh.boundaries.items() if name not in ("boundary", "joint")}
        points = np.round(mesh.points, digits)
        mesh = vx.PolygonMesh(points, mesh.cells, boundaries=sides, interfaces={"joint": joint})
    rows = Space(mesh).part("joint", "test", contact=True).node_normals
    x = mesh.points[rows.nodes]
    sign = 1 if named[0] == "inner" else -1
    assert len(rows.nodes) > min(cells)
    # Rounding to five digits rotates sides by 1e-5 / length, with the length 2 pi JOINT / cells.
    loose = 1e-12 if digits == 16 else 1e-5 * max(cells)
    assert np.abs(rows.normals - sign * x / np.hypot(*x.T)[:, None]).max() < loose


@mostly_long("contact", [vx.BilateralContact, vx.UnilateralContact], 1)
def test_a_ring_turns_freely_in_another_ring(contact):
    """With the normals of the chords, the rings would jam."""
    spin = vx.PrescribedDisplacement(lambda x, t: 0.01 * t * x @ np.array([[0.0, 1.0], [-1.0, 0.0]]), on="bore")
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), spin, contact(on="inner|outer"), vx.Clamp(on="rim"))
    history = vx.simulate(scene, rings(16, 20), [0.0, 1.0])
    assert np.abs(history.stress(-1)).max() < 1e-10
    assert np.abs(history.displacement[-1]).max() == pytest.approx(0.01 * JOINT, rel=1e-9)


@pytest.mark.parametrize("lean", [0.0, 0.3, 2.0])
def test_straight_sides_with_hanging_nodes_keep_their_normals(lean):
    c, s = np.cos(lean), np.sin(lean)
    lower, upper = (vx.meshes.squares(n, box=((0, 2), side)) for n, side in ((4, (0, 1)), (5, (1, 2))))
    turned = {}
    for name, mesh in (("lower", lower), ("upper", upper)):
        turned[name] = vx.PolygonMesh(mesh.points @ np.array([[c, s], [-s, c]]), mesh.cells)
    rows = Space(vx.meshes.bodies(turned)).part("lower|upper", "test", contact=True).node_normals
    assert np.abs(rows.normals - [-s, c]).max() < (1e-15 if lean else 1e-300)
    assert (rows.cosines == 1.0).all()


def test_the_boundary_of_a_round_cell_is_not_straight():
    """The edges of one cell form an arc. Small angles between edges add up to a right angle."""
    angle = np.linspace(0, np.pi / 2, 201)
    points = np.vstack([np.column_stack([np.cos(angle), np.sin(angle)]), [[0.0, 0.0]]])
    mesh = vx.PolygonMesh(points, [list(range(202))]).with_boundary("arc", lambda x: np.hypot(*x.T) > 0.9)
    rows = Space(mesh).part("arc", "test").node_normals
    inner = slice(1, -1)
    assert np.abs(rows.normals - points[rows.nodes])[inner].max() < 1e-12
