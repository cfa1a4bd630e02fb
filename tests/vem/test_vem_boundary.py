"""Parts of the boundary: normals, shares of nodes, corners, names."""

from __future__ import annotations

import itertools
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import small
from scipy.spatial import ConvexHull

import vemcvx as vx
from vemcvx.base.errors import MeshWarning
from vemcvx.vem import Space, edge_part


def space_of(family="squares", n=4):
    return Space(small(family, n))


def polygon(*points):
    return Space(vx.PolygonMesh(np.array(points, dtype=float), [range(len(points))]))


def test_whole_boundary_obeys_gauss(family):
    """int n ds = 0 and int x . n ds = 2 |Omega|; every node gets its share of the length."""
    space = space_of(family)
    part = space.part("boundary", "test")
    midpoints = space.mesh.points[part.sides].mean(axis=1)
    assert np.abs(part.measures @ part.normals).max() < 1e-14
    assert part.measures @ np.einsum("ea,ea->e", midpoints, part.normals) == pytest.approx(2.0, rel=1e-14)
    assert part.node_lengths.sum() == pytest.approx(4.0, rel=1e-14)
    assert np.array_equal(part.nodes, np.unique(part.sides))


def test_sides_have_the_axes_as_normals(family):
    space = space_of(family)
    for name, normal in {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1)}.items():
        part = space.part(name, "test")
        assert np.array_equal(part.normals, np.tile(normal, (len(part.sides), 1)))
        rows = part.node_normals
        assert np.array_equal(rows.nodes, part.nodes)  # a straight side: one row a node
        assert np.array_equal(rows.normals, np.tile(normal, (len(part.nodes), 1)))
        assert rows.lengths == pytest.approx(part.node_lengths, rel=1e-14)


def test_corner_has_a_row_for_each_side():
    space = space_of()
    rows = space.part(["left", "bottom"], "test").node_normals
    corner = np.flatnonzero(np.abs(space.mesh.points).max(axis=1) == 0.0)
    at = np.flatnonzero(rows.nodes == corner)
    assert sorted(map(tuple, rows.normals[at])) == [(-1.0, 0.0), (0.0, -1.0)]
    assert rows.lengths[at] == pytest.approx([0.125, 0.125], rel=1e-15)
    assert len(rows.nodes) == 10
    assert np.all(np.diff(rows.nodes) >= 0)
    for normal, tangent in zip(rows.normals, rows.tangents, strict=True):
        assert tuple(tangent) == ((0.0, -1.0) if normal[0] == -1 else (1.0, 0.0))  # the body on the left


def test_overlapping_names_count_edges_once_in_any_order():
    mesh = vx.meshes.FAMILIES["squares"](4).with_boundary("low", lambda x: x[:, 1] < 0.5)
    space = Space(mesh)
    part = space.part(["bottom", "low", "bottom"], "test")
    assert part.measures.sum() == pytest.approx(2.0, rel=1e-15)
    assert np.array_equal(part.sides, space.part("low", "test").sides)
    assert np.array_equal(space.part(("left", "top"), "test").sides, space.part(["top", "left"], "test").sides)


def test_tiny_edge_on_an_inclined_side_is_no_corner():
    """Rounding turns an edge of 1e-12 by about 1e-4; the node still has one normal, that of its long edge."""
    direction = np.array([np.cos(0.3), np.sin(0.3)])
    on_side = [s * direction for s in (0.0, 0.5, 0.5 + 1e-12, 1.0)]
    space = polygon(*on_side, (0.0, 1.0))
    mesh = space.mesh.with_boundary("slope", lambda x: x[:, 1] < x[:, 0] * np.tan(0.3) + 1e-6)
    part = Space(mesh).part("slope", "test")
    assert part.measures.min() < 1.1e-12
    rows = part.node_normals
    assert len(rows.nodes) == 4
    assert np.abs(rows.normals - [direction[1], -direction[0]]).max() < 1e-12


@pytest.mark.parametrize("degrees", [40.0, 42.4, 42.6, 45.0])
def test_sides_that_turn_little_are_a_curve(degrees):
    end = 1 + np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    mesh = polygon((0, 0), (1, 0), end, (0, 3)).mesh
    part = Space(mesh.with_boundary("base", lambda x: (x[:, 0] > 0.1) & (x[:, 1] < 0.5))).part("base", "test")
    assert list(part.node_normals.nodes) == ([0, 1, 2] if degrees < 42.5 else [0, 1, 1, 2])


def test_sides_of_a_curve_go_out_together():
    """A regular polygon's corners go out by more than its sides, by one over the cosine of half its turns."""
    corners = [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 13)[:-1]]
    rows = Space(polygon(*corners).mesh).part("boundary", "test").node_normals
    assert len(rows.nodes) == 12
    assert np.allclose(rows.normals, corners, rtol=0, atol=1e-15)
    assert np.allclose(rows.cosines, np.cos(np.pi / 12), rtol=1e-15)


@pytest.mark.parametrize("turns", [(0.1, 0.1), (0.1, 0.3), (0.02, 0.5)])
def test_the_normal_of_unequal_sides_is_that_of_the_circle_through_them(turns):
    """But for third powers of what they turn by, and 1e-4 of it, since very short sides have no say."""
    angles = np.array([-0.5 * np.pi - turns[0], -0.5 * np.pi, -0.5 * np.pi + turns[1]])
    mesh = polygon(*np.column_stack([np.cos(angles), np.sin(angles)]), (0, 3)).mesh
    rows = Space(mesh.with_boundary("base", lambda x: x[:, 1] < -0.5)).part("base", "test").node_normals
    assert list(rows.nodes) == [0, 1, 2]
    assert abs(rows.normals[1, 0]) <= sum(turns) ** 3 / 24 + (1e-4 if min(turns) > 0.05 else 0.02) * sum(turns)
    assert rows.normals[1, 1] < -0.99


def test_normals_of_a_sphere_are_radial():
    """Of points on it at whatever distances, in triangles (Max 1999)."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(150, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = ConvexHull(points)
    cells = [[*triangle, len(points)] for triangle in hull.simplices]
    tetrahedra = [[[c[a], c[b], c[d]] for a, b, d in ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))] for c in cells]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)  # faces are turned outwards
        mesh = vx.PolyhedralMesh(np.vstack([points, np.zeros(3)]), tetrahedra)
    rows = Space(mesh).part("boundary", "test").node_normals
    smooth = np.bincount(rows.nodes, minlength=len(points))[rows.nodes] == 1
    turned = np.linalg.norm(rows.normals - mesh.points[rows.nodes], axis=1)[smooth]
    by_area = np.zeros_like(points)
    for simplex in hull.simplices:
        a, b, c = points[simplex]
        area = np.cross(b - a, c - a)
        by_area[simplex] += area * np.sign(area @ a)
    by_area /= np.linalg.norm(by_area, axis=1)[:, None]
    assert smooth.mean() > 0.9
    assert np.median(turned) <= 1e-3 < 0.01 < np.median(np.linalg.norm(by_area - points, axis=1))


def test_integral_weights_are_exact_for_degree_six(family):
    """int g phi_i over the bottom with g = x^6, against the antiderivatives of x^6 and x^7."""
    space = space_of(family)
    rows = space.part("bottom", "test").node_normals
    x = space.mesh.points[rows.nodes, 0]
    order = np.argsort(x)
    expected = np.zeros(len(x))
    for i, j in itertools.pairwise(order):
        a, b = x[i], x[j]
        mass, moment = (b**7 - a**7) / 7, (b**8 - a**8) / 8
        expected[i] += (b * mass - moment) / (b - a)
        expected[j] += (moment - a * mass) / (b - a)
    found = rows.matrix @ rows.points[:, 0] ** 6
    assert np.abs(found - expected).max() < 1e-14
    assert rows.matrix @ np.ones(len(rows.points)) == pytest.approx(rows.lengths, rel=1e-14)


def test_node_where_two_cells_touch_by_a_corner():
    """Four edges and four normals meet at the middle."""
    points = np.array([[0, 0], [0, -1], [-1, 0], [0, 1], [1, 0]], dtype=float)
    rows = edge_part(np.array([[1, 0], [0, 2], [3, 0], [0, 4]]), points).node_normals
    assert list(rows.nodes) == [0, 0, 0, 0, 1, 2, 3, 4]
    assert sorted(map(tuple, rows.normals[:4])) == [(-1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, 0.0)]
    assert np.array_equal(rows.lengths, np.full(8, 0.5))


def test_names_that_are_none_are_refused():
    empty = SimpleNamespace(boundaries={"gap": np.zeros((0, 2), dtype=np.int64)}, PARTS="edges")
    for space, on, subject in (
        (space_of(), ["left", "lft"], "Clamp: there is no boundary named 'lft'; this mesh has 'left', "),
        *((space_of(), on, "Clamp: there is no boundary named") for on in (3, None, [7], [["left"]])),
        (space_of(), [], "Clamp: on= names no boundary; this mesh has 'left'"),
        (Space(empty), "gap", "Clamp: the boundary 'gap' has no edges"),
    ):
        with pytest.raises(vx.SceneError, match=subject):
            space.part(on, "Clamp")


def test_arrays_are_read_only():
    space = space_of()
    part = space.part("left", "test")
    rows = part.node_normals
    arrays = [part.sides, part.measures, part.normals, part.nodes, rows.nodes, rows.normals, rows.lengths]
    assert not any(array.flags.writeable for array in (*arrays, space.groups[0].nodes, space.groups[0].cells))
