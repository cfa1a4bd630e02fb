"""Loads: closed forms on edges, forces of affine fields on cells of every shape, points inside."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import small

import vemcvx as vx
from vemcvx.vem import Space, cell_load, cell_quadrature, edge_load

# Nodal loads are sums of at most a few hundred products of numbers near one.
TOLERANCE = 1e-13


def affine(x):
    return np.column_stack([1.0 + 2.0 * x[:, 0] - x[:, 1], 0.5 - 0.3 * x[:, 0] + 4.0 * x[:, 1]])


def total(load):
    return load.reshape(-1, 2).sum(axis=0)


def box_moments(boxes):
    """Integrals of 1, x, y, x^2, xy, y^2 over disjoint boxes (x0, x1, y0, y1)."""
    result = np.zeros(6)
    for x0, x1, y0, y1 in boxes:
        px, py = ([(b ** (k + 1) - a ** (k + 1)) / (k + 1) for k in range(3)] for a, b in ((x0, x1), (y0, y1)))
        result += [px[0] * py[0], px[1] * py[0], px[0] * py[1], px[2] * py[0], px[1] * py[1], px[0] * py[2]]
    return result


def monomials(x):
    return np.column_stack([np.ones(len(x)), x[:, 0], x[:, 1], x[:, 0] ** 2, x[:, 0] * x[:, 1], x[:, 1] ** 2])


def inside(polygon, points):
    """Whether points are inside: the angles under which they see the edges add up to one turn."""
    to = polygon[None] - points[:, None]
    after = np.roll(to, -1, axis=1)
    cross = to[..., 0] * after[..., 1] - to[..., 1] * after[..., 0]
    turns = np.arctan2(cross, np.einsum("pia,pia->pi", to, after)).sum(axis=1) / (2 * np.pi)
    return np.abs(turns - 1.0) < 1e-6


SHAPES = {
    "L": ([(0, 0), (4, 0), (4, 1), (1, 1), (1, 5), (0, 5)], [(0, 4, 0, 1), (0, 1, 1, 5)]),
    "U": (
        [(0, 0), (4, 0), (4, 5), (3, 5), (3, 1), (1, 1), (1, 5), (0, 5)],
        [(0, 4, 0, 1), (0, 1, 1, 5), (3, 4, 1, 5)],
    ),
    "comb": (
        [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)],
        [(0, 5, 0, 1), (0, 1, 1, 3), (2, 3, 1, 3), (4, 5, 1, 3)],
    ),
    "spiral": (
        [
            *[(0, 0), (6, 0), (6, 6), (1, 6), (1, 2), (4, 2), (4, 4)],
            *[(3, 4), (3, 3), (2, 3), (2, 5), (5, 5), (5, 1), (0, 1)],
        ],
        [(0, 6, 0, 1), (5, 6, 1, 6), (1, 5, 5, 6), (1, 2, 2, 5), (2, 4, 2, 3), (3, 4, 3, 4)],
    ),
    "rectangle with straight vertices": (
        [(0, 0), (1, 0), (2, 0), (5, 0), (5, 1), (5, 2), (2.5, 2), (0, 2), (0, 1.5)],
        [(0, 5, 0, 2)],
    ),
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 0, 1)]),
}


def one_cell(name):
    points, boxes = SHAPES[name]
    return Space(vx.PolygonMesh(np.array(points, dtype=float), [range(len(points))])), box_moments(boxes)


@pytest.mark.parametrize("name", SHAPES)
def test_quadrature_on_a_cell_of_any_shape(name):
    """Degree 2 is exact and no point leaves the cell, also after a turn of the list of vertices."""
    space, moments = one_cell(name)
    (group,) = space.groups
    n = len(group.nodes[0])
    for shift in range(0, n, 3):
        turned = type(group)(group.cells, np.roll(group.nodes, shift, axis=1), group.points)
        x, weights, owner = cell_quadrature(turned)
        assert weights @ monomials(x) == pytest.approx(moments, rel=1e-13)
        assert inside(space.mesh.points, x).all()
        assert weights.min() >= 0.0
        assert not owner.any()


@pytest.mark.long
def test_convex_cells_need_four_points():
    """The ellipse of inertia, scaled to degree 2, is inside every convex cell; thin ones too."""
    rng = np.random.default_rng(3)
    for n in (4, 5, 6, 9):
        for _ in range(50):
            angle = np.sort(rng.uniform(0, 2 * np.pi, n))
            if np.diff(angle, append=angle[0] + 2 * np.pi).max() > 3.0:
                continue  # nearly flat: its centre may not even be inside
            corners = np.column_stack([np.cos(angle), 10.0 ** rng.uniform(-4, 0) * np.sin(angle)])
            (group,) = Space(vx.PolygonMesh(corners, [range(n)])).groups
            x, weights, _ = cell_quadrature(group)
            assert len(x) == 4
            assert inside(corners, x).all()
            assert weights @ x[:, 0] ** 2 == pytest.approx(second_moment(corners), rel=1e-11)


def second_moment(x):
    """int x^2 by Green's theorem: 1/12 sum (x_i^2 + x_i x_j + x_j^2)(x_i y_j - x_j y_i)."""
    a, b = x, np.roll(x, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    return cross @ (a[:, 0] ** 2 + a[:, 0] * b[:, 0] + b[:, 0] ** 2) / 12


def test_isosceles_triangle_with_a_hanging_node():
    """Here the four-point rule would touch the base; the points must be clearly inside."""
    points = np.array([[-1.0, 0], [0, 0], [1, 0], [0, 1.5]])
    (group,) = Space(vx.PolygonMesh(points, [[0, 1, 2, 3]])).groups
    x, weights, _ = cell_quadrature(group)
    assert x[:, 1].min() > 1e-3
    # Height H = 3/2, base 2: int y = base H^2 / 6, int y^2 = base H^3 / 12, int x^2 = H base^3 / 48.
    assert weights @ monomials(x) == pytest.approx([1.5, 0, 0.75, 0.25, 0, 0.5625], rel=1e-14, abs=1e-15)


def test_points_are_inside_their_cells(family):
    mesh = small(family, 4)
    for group in Space(mesh).groups:
        x, weights, owner = cell_quadrature(group)
        area = np.bincount(owner, weights=weights)
        assert area == pytest.approx(mesh.areas[group.cells], rel=1e-12)
        for k, cell in enumerate(group.nodes):
            assert inside(mesh.points[cell], x[owner == k]).all()


def test_body_force_is_shared_equally_by_the_vertices(family):
    """Affine f: each vertex of K gets |K| f(centroid) / n."""
    mesh = small(family, 4)
    expected = np.zeros((mesh.n_nodes, 2))
    for cell, area, centroid in zip(mesh.cells, mesh.areas, mesh.centroids, strict=True):
        expected[cell] += area * affine(centroid[None])[0] / len(cell)
    x, matrix, _ = cell_load(Space(mesh))
    assert matrix.shape == (2 * mesh.n_nodes, 2 * len(x))
    assert np.abs((matrix @ affine(x).ravel()).reshape(-1, 2) - expected).max() < TOLERANCE


def test_total_body_force_of_a_quadratic_field_and_far_away(family):
    """int over the unit square of (x^2, x y) = (1/3, 1/4)."""
    mesh = small(family, 4)
    x, matrix, _ = cell_load(Space(mesh))
    f = np.column_stack([x[:, 0] ** 2, x[:, 0] * x[:, 1]])
    assert total(matrix @ f.ravel()) == pytest.approx([1 / 3, 1 / 4], rel=1e-13)
    x, matrix, _ = cell_load(Space(vx.PolygonMesh(mesh.points + 2.0**10, list(mesh.cells))))
    assert total(matrix @ np.ones(x.size)) == pytest.approx([1.0, 1.0], rel=1e-12)


def test_traction_is_exact_for_affine_data(family):
    """int f phi_a = |e| (2 f_a + f_b) / 6 on the edge e = [a, b]."""
    space = Space(small(family, 4))
    part = space.part("boundary", "test")
    values = affine(space.mesh.points)
    expected = np.zeros_like(values)
    for (a, b), length in zip(part.sides, part.measures, strict=True):
        expected[a] += length * (2 * values[a] + values[b]) / 6
        expected[b] += length * (2 * values[b] + values[a]) / 6
    x, matrix, _ = edge_load(space, part)
    assert np.abs((matrix @ affine(x).ravel()).reshape(-1, 2) - expected).max() < TOLERANCE


def test_traction_has_the_force_and_moment_of_its_data():
    """8 (5/4 - y) pulls on x = 0: force 6 and moment int y 8 (5/4 - y) dy = 5 - 8/3, whatever the mesh."""
    space = Space(vx.meshes.FAMILIES["voronoi"](5))
    x, matrix, _ = edge_load(space, space.part("left", "test"))
    load = (matrix @ np.column_stack([8 * (1.25 - x[:, 1]), 0 * x[:, 1]]).ravel()).reshape(-1, 2)
    assert load.sum(axis=0) == pytest.approx([6.0, 0.0], abs=1e-14)
    assert space.mesh.points[:, 1] @ load[:, 0] == pytest.approx(5 - 8 / 3, rel=1e-14)
