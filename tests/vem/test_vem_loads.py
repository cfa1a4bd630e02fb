"""Quadrature inside cells of every shape, affine body forces, polynomial tractions, mean strains."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scenes import FAMILIES, small
from solids import SOLIDS, solid

import vemcvx as vx
from vemcvx.vem import Space, edge_load
from vemcvx.vem.loads import cell_load, cell_quadrature, mean_strains

TOLERANCE = 1e-13
BOX = ((0.0, 1.0), (0.0, 1.2), (-0.3, 0.6))
OFFSET, SLOPE = np.array([1.0, 0.5, -0.2]), np.array([[2.0, -0.3, 0.7], [-1.0, 4.0, 0.1], [0.6, 0.2, 1.5]])


def evaluate_affine(x):
    """Return an affine vector field (n, dim)."""
    dim = x.shape[1]
    return OFFSET[:dim] + x @ SLOPE[:dim, :dim]


def evaluate_monomials(x):
    return np.column_stack([np.ones(len(x)), x[:, 0], x[:, 1], x[:, 0] ** 2, x[:, 0] * x[:, 1], x[:, 1] ** 2])


def integrate(corners):
    """Integrate the monomials over triangles between the origin and the sides."""
    a, b = corners, np.roll(corners, -1, axis=0)
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return area @ (evaluate_monomials(0.5 * a) + evaluate_monomials(0.5 * b) + evaluate_monomials(0.5 * (a + b))) / 3


SHAPES = {
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "comb": [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)],
    "spiral": [
        *[(0, 0), (6, 0), (6, 6), (1, 6), (1, 2), (4, 2), (4, 4)],
        *[(3, 4), (3, 3), (2, 3), (2, 5), (5, 5), (5, 1), (0, 1)],
    ],
    "straight vertices": [(0, 0), (1, 0), (2, 0), (5, 0), (5, 1), (5, 2), (2.5, 2), (0, 2), (0, 1.5)],
    "thin": [(1, 1e-5), (0.3, 7e-5), (-0.8, 6e-5), (-0.9, -4e-5), (0.2, -1e-4)],
    # A quadrature rule of four points would have points on the base.
    "hanging node": [(-1, 0), (0, 0), (1, 0), (0, 1.5)],
}


@pytest.mark.parametrize("name", SHAPES)
def test_quadrature_is_exact_for_degree_two_with_points_inside_cells_of_any_shape(name):
    corners = np.array(SHAPES[name], dtype=float)
    for shift in range(0, len(corners), 3):
        (group,) = Space(vx.PolygonMesh(corners, [np.roll(range(len(corners)), shift)])).groups
        x, weights, owner = cell_quadrature(group)
        assert weights @ evaluate_monomials(x) == pytest.approx(integrate(corners), rel=1e-13, abs=1e-14)
        assert shapely.contains_xy(shapely.Polygon(corners), x).all()
        assert len(x) == 4 or name not in ("square", "thin")
        assert x[:, 1].min() > 1e-3 or name != "hanging node"
        assert weights.min() >= 0.0
        assert not owner.any()


@pytest.mark.parametrize("name", [*FAMILIES, *SOLIDS])
def test_vertices_share_the_force_on_a_cell_equally(name):
    """A vertex of a cell K with n vertices gets |K| f(centroid) / n of an affine force f."""
    mesh = small(name, 4) if name in FAMILIES else solid(name, 2, BOX)
    (offsets, nodes), expected = mesh.cell_nodes, np.zeros(mesh.points.shape)
    count = np.diff(offsets)
    forces = mesh.measures[:, None] * evaluate_affine(mesh.centroids) / count[:, None]
    np.add.at(expected, nodes, np.repeat(forces, count, axis=0))
    x, matrix, cells = cell_load(Space(mesh))
    assert np.abs((matrix @ evaluate_affine(x).ravel()).reshape(expected.shape) - expected).max() < TOLERANCE
    if name in FAMILIES:
        for cell, corners in enumerate(mesh.cells):
            assert shapely.contains_xy(shapely.Polygon(mesh.points[corners]), x[cells == cell]).all()


def test_tractions_on_edges_are_exact_for_affine_data(family):
    """int f phi_a = |e| (2 f_a + f_b) / 6 on the edge e = [a, b]."""
    space = Space(small(family, 4))
    part = space.part("boundary", "test")
    values = evaluate_affine(space.mesh.points)
    expected = np.zeros_like(values)
    for (a, b), length in zip(part.sides, part.measures, strict=True):
        expected[a] += length * (2 * values[a] + values[b]) / 6
        expected[b] += length * (2 * values[b] + values[a]) / 6
    x, matrix, _ = edge_load(space, part)
    assert np.abs((matrix @ evaluate_affine(x).ravel()).reshape(-1, 2) - expected).max() < TOLERANCE


@pytest.mark.parametrize("name", SOLIDS)
def test_forces_of_tractions_on_faces_are_exact_for_degree_four(name):
    space = Space(solid(name, 2, BOX))
    x, matrix, _ = edge_load(space, space.part("left", "test"))
    (_, y, z), (_, (a, b), (c, d)) = x.T, BOX
    total = (matrix @ np.column_stack([y**4, y**2 * z**2, z**4]).ravel()).reshape(-1, 3).sum(axis=0)
    exact = [(b**5 - a**5) / 5 * (d - c), (b**3 - a**3) / 3 * (d**3 - c**3) / 3, (b - a) * (d**5 - c**5) / 5]
    assert total == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("name", [*FAMILIES, *SOLIDS])
def test_mean_strains_of_quadratic_displacements_are_their_strains_at_centroids(name):
    """The strains of u = (x^2 + x y, y^2 - x y), in space (x y, y z, z x), are linear."""
    mesh = small(name, 2) if name in FAMILIES else solid(name, 2, BOX)
    if name in FAMILIES:
        (x, y), quadratic = mesh.centroids.T, lambda p: p * np.column_stack([p.sum(axis=1), p[:, 1] - p[:, 0]])
        exact = [2 * x + y, 2 * y - x, x - y]
    else:
        (x, y, z), quadratic = mesh.centroids.T, lambda p: p * p[:, [1, 2, 0]]
        exact = [y, z, x, x, y, z]
    np.testing.assert_allclose(mean_strains(Space(mesh), quadratic), np.column_stack(exact), atol=1e-13)
