"""Parts of the boundary: normals, nodal lengths, corners, curves, names."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scenes import small
from scipy.spatial import ConvexHull

import vemcvx as vx
from vemcvx.base.errors import MeshWarning
from vemcvx.vem import Space
from vemcvx.vem.boundary import edge_part


def make_space(family="squares", n=4):
    return Space(small(family, n))


def make_polygon(*points):
    return Space(vx.PolygonMesh(np.array(points, dtype=float), [range(len(points))]))


def test_the_whole_boundary_satisfies_the_theorem_of_gauss(family):
    """int n ds = 0 and int x . n ds = 2 |Omega|. The sum of nodal lengths is the perimeter."""
    space = make_space(family)
    part = space.part("boundary", "test")
    midpoints = space.mesh.points[part.sides].mean(axis=1)
    assert np.abs(part.measures @ part.normals).max() < 1e-14
    assert part.measures @ np.einsum("ea,ea->e", midpoints, part.normals) == pytest.approx(2.0, rel=1e-14)
    assert part.node_lengths.sum() == pytest.approx(4.0, rel=1e-14)
    assert np.array_equal(part.nodes, np.unique(part.sides))


@pytest.mark.parametrize(("make", "names"), [("squares", "left bottom"), ("cubes", "left front bottom")])
def test_nodes_at_edges_and_corners_have_a_row_for_every_normal(make, names):
    space = Space(getattr(vx.meshes, make)(2))
    dim, rows = space.dim, space.part(names.split(), "test").node_normals
    _, count = np.unique(rows.nodes, return_counts=True)
    assert np.bincount(count).tolist() == ([0, 4, 1] if dim == 2 else [0, 12, 6, 1])
    corner = rows.nodes == np.argmin(np.abs(space.mesh.points).sum(axis=1))
    assert sorted(map(tuple, rows.normals[corner])) == sorted(map(tuple, -np.eye(dim)))
    assert rows.lengths[corner] == pytest.approx(0.25 ** (dim - 1), rel=1e-15)
    assert rows.lengths.sum() == pytest.approx(dim, rel=1e-14)
    assert rows.matrix @ np.ones(len(rows.points)) == pytest.approx(rows.lengths, rel=1e-13)
    assert np.all(np.diff(rows.nodes) >= 0)
    if dim == 2:  # the body lies to the left of the tangents
        assert np.array_equal(rows.tangents, rows.normals @ [[0.0, 1.0], [-1.0, 0.0]])


def test_overlapping_names_count_edges_once_in_any_order():
    mesh = vx.meshes.FAMILIES["squares"](4).with_boundary("low", lambda x: x[:, 1] < 0.5)
    space = Space(mesh)
    part = space.part(["bottom", "low", "bottom"], "test")
    assert part.measures.sum() == pytest.approx(2.0, rel=1e-15)
    assert np.array_equal(part.sides, space.part("low", "test").sides)
    assert np.array_equal(space.part(("left", "top"), "test").sides, space.part(["top", "left"], "test").sides)


def test_short_edges_on_an_inclined_side_make_no_corners():
    """Rounding rotates an edge of length 1e-12 by up to 1e-4."""
    direction = np.array([np.cos(0.3), np.sin(0.3)])
    on_side = [s * direction for s in (0.0, 0.5, 0.5 + 1e-12, 1.0)]
    space = make_polygon(*on_side, (0.0, 1.0))
    mesh = space.mesh.with_boundary("slope", lambda x: x[:, 1] < x[:, 0] * np.tan(0.3) + 1e-6)
    part = Space(mesh).part("slope", "test")
    assert part.measures.min() < 1.1e-12
    rows = part.node_normals
    assert len(rows.nodes) == 4
    assert np.abs(rows.normals - [direction[1], -direction[0]]).max() < 1e-12


@pytest.mark.parametrize("degrees", [40.0, 42.4, 42.6, 45.0])
def test_sides_at_angles_below_42_and_a_half_degrees_are_a_curve(degrees):
    end = 1 + np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    mesh = make_polygon((0, 0), (1, 0), end, (0, 3)).mesh
    part = Space(mesh.with_boundary("base", lambda x: (x[:, 0] > 0.1) & (x[:, 1] < 0.5))).part("base", "test")
    assert list(part.node_normals.nodes) == ([0, 1, 2] if degrees < 42.5 else [0, 1, 1, 2])


def test_normals_of_a_regular_polygon_are_radial():
    """`cosines` are cosines of half the angle between the normals of neighbouring sides."""
    corners = [(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 13)[:-1]]
    rows = Space(make_polygon(*corners).mesh).part("boundary", "test").node_normals
    assert len(rows.nodes) == 12
    assert np.allclose(rows.normals, corners, rtol=0, atol=1e-15)
    assert np.allclose(rows.cosines, np.cos(np.pi / 12), rtol=1e-15)


@pytest.mark.parametrize("turns", [(0.1, 0.1), (0.1, 0.3), (0.02, 0.5)])
def test_normals_between_unequal_sides_are_normals_of_the_circle_through_their_nodes(turns):
    """The error is O(angle^3)."""
    angles = np.array([-0.5 * np.pi - turns[0], -0.5 * np.pi, -0.5 * np.pi + turns[1]])
    mesh = make_polygon(*np.column_stack([np.cos(angles), np.sin(angles)]), (0, 3)).mesh
    rows = Space(mesh.with_boundary("base", lambda x: x[:, 1] < -0.5)).part("base", "test").node_normals
    assert list(rows.nodes) == [0, 1, 2]
    assert abs(rows.normals[1, 0]) <= sum(turns) ** 3 / 24 + (1e-4 if min(turns) > 0.05 else 0.02) * sum(turns)
    assert rows.normals[1, 1] < -0.99


def test_normals_of_a_sphere_are_radial():
    """Normals of random triangles are averaged with the weights of Max (1999)."""
    points = np.random.default_rng(3).normal(size=(150, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    cells = [[*triangle, len(points)] for triangle in ConvexHull(points).simplices]
    tetrahedra = [[[c[a], c[b], c[d]] for a, b, d in ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))] for c in cells]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)  # faces are reversed with a warning
        mesh = vx.PolyhedralMesh(np.vstack([points, np.zeros(3)]), tetrahedra)
    rows = Space(mesh).part("boundary", "test").node_normals
    smooth = np.bincount(rows.nodes, minlength=len(points))[rows.nodes] == 1
    assert smooth.mean() > 0.9
    # Area weights would give an error of .12.
    assert np.median(np.linalg.norm(rows.normals - mesh.points[rows.nodes], axis=1)[smooth]) <= 1e-3


def test_integral_weights_are_exact_for_degree_six(family):
    """Compute int x^6 phi_i over the bottom from the antiderivatives of x^6 and x^7."""
    space = make_space(family)
    rows = space.part("bottom", "test").node_normals
    order = np.argsort(space.mesh.points[rows.nodes, 0])
    x, expected = space.mesh.points[rows.nodes[order], 0], np.zeros(len(order))
    mass, moment = np.diff(x**7) / 7, np.diff(x**8) / 8
    expected[:-1] += (x[1:] * mass - moment) / np.diff(x)
    expected[1:] += (moment - x[:-1] * mass) / np.diff(x)
    found = rows.matrix @ rows.points[:, 0] ** 6
    assert np.abs(found[order] - expected).max() < 1e-14
    assert rows.matrix @ np.ones(len(rows.points)) == pytest.approx(rows.lengths, rel=1e-14)


def test_nodes_where_two_cells_touch_have_four_normals():
    points = np.array([[0, 0], [0, -1], [-1, 0], [0, 1], [1, 0]], dtype=float)
    rows = edge_part(np.array([[1, 0], [0, 2], [3, 0], [0, 4]]), points).node_normals
    assert list(rows.nodes) == [0, 0, 0, 0, 1, 2, 3, 4]
    assert sorted(map(tuple, rows.normals[:4])) == [(-1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, 0.0)]
    assert np.array_equal(rows.lengths, np.full(8, 0.5))
