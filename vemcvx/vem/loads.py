"""Quadrature in cells, nodal loads of forces and stresses, and mean strains."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats, Ints, totals
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons import (
    DEGREE_2_POINTS,
    cross,
    places,
    polygon_centroids,
    split_at_vertices,
    triangle_areas,
)
from vemcvx.vem.boundary import Part, edge_part, face_part
from vemcvx.vem.projection import CellGroup, PolyhedronGroup, second_moments
from vemcvx.vem.space import Space
from vemcvx.vem.tensors import COMPONENTS

# Let c be the centroid of a polygon K, and M = 1/|K| int_K (x - c)(x - c)' dx the second moments. The four points
#
#     c +- sqrt(2) M^(1/2) e_x,   c +- sqrt(2) M^(1/2) e_y,   of weight |K|/4 each,
#
# form a rule of degree 2. Every convex cell contains all four points (Kannan, Lovasz, Simonovits, Discrete Comput.
# Geom. 13 (1995)). If a point is not clearly inside, the cell is cut into triangles with three points each. Polyhedra
# have one point, the centroid.
Rule = tuple[Floats, Floats, Ints]


def cell_quadrature(group: CellGroup) -> Rule:
    """Return points inside cells, weights, and positions of cells in the group."""
    if isinstance(group, PolyhedronGroup):
        return group.quadrature()
    points, weights, owner = _plane_quadrature(group)
    return points, weights * group.depth(points), owner


def _plane_quadrature(group: CellGroup) -> Rule:
    corners = group.corners
    origin = group.points[group.nodes[:, 0]]
    if corners.shape[1] == 3:
        points, weights, owner = _on_triangles(corners, np.arange(len(corners)))
        return points + origin[owner], weights, owner
    areas, centres = polygon_centroids(corners)
    about = corners - centres[:, None]
    ring = _ring(about, areas)
    inside = _all_inside(ring, about, areas)
    whole, cut = np.flatnonzero(inside), np.flatnonzero(~inside)
    four = (ring + centres[:, None])[whole].reshape(-1, 2), np.repeat(0.25 * areas[whole], 4), np.repeat(whole, 4)
    triangles = corners[cut[:, None, None], split_at_vertices(corners[cut])]
    pieces = four, _on_triangles(triangles, np.repeat(cut, triangles.shape[1]))
    points, weights, owner = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return points + origin[owner], weights, owner


def _ring(about: Floats, areas: Floats) -> Floats:
    """Return the four points relative to the centroid."""
    M = second_moments(about) / areas[:, None, None]
    trace = M[:, 0, 0] + M[:, 1, 1]
    # On very thin cells, rounding may make the determinant negative.
    root = np.sqrt(np.maximum(M[:, 0, 0] * M[:, 1, 1] - M[:, 0, 1] ** 2, 0.0))
    half = (M + root[:, None, None] * np.eye(2)) * np.sqrt(2.0 / (trace + 2.0 * root))[:, None, None]
    return np.concatenate([half, -half], axis=1)


def _all_inside(points: Floats, corners: Floats, areas: Floats) -> Bools:
    """Return a mask of cells with all points clearly left of all edges."""
    edge = np.roll(corners, -1, axis=1) - corners
    # The distance from an edge must exceed 1e-6 sqrt(|K|).
    reach = 1e-6 * np.sqrt(np.einsum("cia,cia->ci", edge, edge) * areas[:, None])
    left = cross(edge[:, :, None], points[:, None] - corners[:, :, None])
    return np.all(left > reach[:, :, None], axis=(1, 2))


def _on_triangles(triangles: Floats, owner: Ints) -> Rule:
    triangles = triangles.reshape(-1, 3, 2)
    weights = np.repeat(triangle_areas(triangles) / 3.0, 3)
    return places(triangles, DEGREE_2_POINTS).reshape(-1, 2), weights, np.repeat(owner, 3)


def edge_load(space: Space, part: Part) -> tuple[Floats, sp.csr_matrix, Ints]:
    """Return the load of a traction on a part of the boundary.

    Parameters
    ----------
    space : Space
    part : Part

    Returns
    -------
    points : (q, dim) array
        Two Gauss points per edge; seven points per triangle of a face.
    matrix : (dim n_nodes, dim q) csr_matrix
        ``matrix @ f(points).ravel()`` is the nodal load of f. It is exact for f of degree 2 in the plane, 4 in space,
        and 1 in bodies of revolution.
    sides : (q,) array of int
        The side of each point, as a position in the part.

    Examples
    --------
    >>> space = vx.vem.Space(vx.meshes.squares(1))
    >>> points, matrix, sides = vx.vem.edge_load(space, space.part("left", "example"))
    >>> print((matrix @ np.tile([1.0, 0.0], len(points))).round(9))
    [0.5 0.  0.  0.  0.5 0.  0.  0. ]
    """
    rules = part.rules(2)  # two Gauss points per edge
    points = np.concatenate([rule.points.reshape(-1, space.dim) for rule in rules])
    sides = np.concatenate([np.repeat(rule.sides, rule.points.shape[1]) for rule in rules])
    matrices = []
    for rule in rules:
        m, n, q = rule.shares.shape
        nodes = np.repeat(rule.nodes, q, axis=0)
        matrices.append(_load_matrix(nodes, rule.shares.transpose(0, 2, 1).reshape(m * q, n), space))
    return points, sp.hstack(matrices, format="csc").tocsr(), sides


def cell_load(space: Space) -> tuple[Floats, sp.csr_matrix, Ints]:
    """Return points inside cells, a matrix, and the cell of each point.

    ``matrix @ f(points).ravel()`` is the nodal load of a body force f.
    """
    points, matrices, cells = [], [], []
    for group in space.groups:
        for chunk in group.chunks():
            x, weights, owner = cell_quadrature(chunk)
            points.append(x)
            cells.append(chunk.cells[owner])
            shares = weights[:, None] * chunk.load_shares()[owner]
            matrices.append(_load_matrix(chunk.nodes[owner], shares, space))
    return np.concatenate(points), sp.hstack(matrices, format="csc").tocsr(), np.concatenate(cells)


def mean_weights(space: Space, some: Bools) -> tuple[Floats, Floats]:
    """Return w and g with int Pi u = w'u and int grad Pi u = g'u over some cells, with the projection Pi."""
    mesh = space.mesh
    cells, gradient = np.flatnonzero(some), np.zeros(mesh.points.shape)
    for group in space.groups:
        kept = group.part(np.flatnonzero(some[group.cells]))
        np.add.at(gradient, kept.nodes, kept.gradients()[1])
    return mesh.measures[cells] @ space.project_values(mesh.centroids[cells], np.arange(len(cells)), cells), gradient


def stress_load(space: Space) -> sp.csr_matrix:
    """Return the load of stresses that are constant on cells, sum_K |K| sigma : eps(Pi v), with the projection Pi.

    Parameters
    ----------
    space : Space

    Returns
    -------
    (dim n_nodes, components n_cells) csr_matrix
        ``matrix @ sigma.ravel()`` is the nodal load of sigma (n_cells, components).

    Examples
    --------
    >>> vx.vem.stress_load(vx.vem.Space(vx.meshes.squares(1))).shape
    (8, 3)
    """
    rows, columns, values = list[Ints](), list[Ints](), list[Floats]()
    for group in space.groups:
        B = group.strain_rows()[1]
        components = B.shape[1]
        unknowns = space.dim * group.nodes[:, :, None] + np.arange(space.dim)
        rows.append(np.broadcast_to(unknowns[:, None], B.shape).ravel())
        cell = components * group.cells[:, None] + np.arange(components)
        columns.append(np.broadcast_to(cell[:, :, None, None], B.shape).ravel())
        values.append(B.ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = sp.coo_matrix(entries, shape=(space.n_unknowns, space.components * space.mesh.n_cells)).tocsr()
    matrix.eliminate_zeros()
    return matrix


def _load_matrix(nodes: Ints, shares: Floats, space: Space) -> sp.csc_matrix:
    """Return the matrix from forces at points to nodal forces."""
    (q, n), dim = nodes.shape, space.dim
    rows = dim * nodes[:, None, :] + np.arange(dim)[:, None]
    values = np.repeat(shares[:, None, :], dim, axis=1)
    indptr = np.arange(0, dim * q * n + 1, n)
    return sp.csc_matrix((values.ravel(), rows.ravel(), indptr), shape=(space.n_unknowns, dim * q))


def mean_strains(space: Space, displacement: Callable[[Floats], Floats]) -> Floats:
    """Return the mean strain of a displacement in each cell."""
    mesh, sides = space.mesh, space.mesh._sides
    if isinstance(mesh, PolyhedralMesh):
        part = face_part(np.arange(mesh.n_faces), mesh)
    else:
        part = edge_part(sides.vertices.reshape(-1, 2), mesh.points)
    total = np.zeros((len(sides.cells), space.dim))
    for rule in part.rules(4):  # exact for degree 7 on edges and 5 on faces
        values = displacement(rule.points.reshape(-1, space.dim)).reshape(rule.points.shape)
        total[rule.sides] = np.einsum("fq,fqa->fa", rule.shares.sum(axis=1), values)
    flux = total[:, :, None] * part.normals[:, None, :]  # int u n' ds, with the outward normal n of the first cell
    columns = [flux[:, a, a] if a == b else flux[:, a, b] + flux[:, b, a] for a, b in COMPONENTS[space.dim]]
    (first, second), inner = sides.cells.T, sides.cells[:, 1] >= 0
    sums = [totals(first, x, mesh.n_cells) - totals(second[inner], x[inner], mesh.n_cells) for x in columns]
    return np.column_stack(sums) / mesh.measures[:, None]
