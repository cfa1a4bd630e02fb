r"""The shapes of cells: two ratios that determine the constants of Assumption 3.3 of the paper named in :mod:`vemcvx`.

By Assumption 3.3 every cell K of diameter h_K can be split into shape-regular triangles of comparable size, and each
edge of K is a side of a triangle. The constants depend on two ratios only (L. Chen and J. Huang, Some error analysis
on virtual element methods, Calcolo 55, 2018; S. Brenner and L.-Y. Sung, Virtual element methods on meshes with small
edges or faces, 2018):

- star: rho_K / h_K, with the radius rho_K of the largest ball such that K is star-shaped about every point of the ball;
- edge: the length of the shortest edge / h_K.

K is star-shaped about x if x is on the inner side of all edges (faces). Hence

$$ \rho_K = \max_x \min_e \, n_e \cdot (a_e - x), \qquad n_e \text{ the outward normal, } a_e \text{ a point on } e. $$

If K is convex, rho_K is the radius of the largest inscribed circle (sphere). If K is not star-shaped, rho_K is
negative, and star is set to 0. HiGHS solves this linear program for thousands of cells at once.

For the stability (2.9), the stabilisation term S should be comparable to the shear energy a_mu on fields without a
linear part. On a cell of aspect ratio r, S / a_mu lies between about 1 / r and r. A short edge lowers the least ratio
S / a_mu like 1 / |log edge| (problems/stabilisation_spectrum.py).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from vemcvx.base.arrays import CHUNK_SIZE, Bools, Floats, Ints
from vemcvx.base.errors import MeshWarning
from vemcvx.base.outline import ArrayRecord
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import cell_of_corner, next_corner, right_of
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

LEAST_STAR, LEAST_EDGE = 0.05, 1e-4
"""Ratios below which a warning is issued. A rectangle with the side ratio 10 has `star` = .05."""


@dataclass(frozen=True, eq=False, repr=False)
class Quality(ArrayRecord):
    """The shapes of the cells of a mesh: the two ratios on which the constants of Assumption 3.3 depend.

    Attributes
    ----------
    star : (n_cells,)
        Radius of the largest ball such that the cell is star-shaped about every point of the ball, divided by the cell
        diameter; 0 if there is no ball. At most 1/2: a square has .35, a regular hexagon .43, a cube .29.
    edge : (n_cells,)
        Length of the shortest edge divided by the cell diameter.
    poor : (n_cells,) bool
        Cells on which the constants grow: `star` is below .05 or, in the plane, `edge` is below 1e-4.
    """

    star: Floats
    edge: Floats
    poor: Bools


def measure_quality(mesh: Mesh) -> Quality:
    """Measure the shapes of all cells; issue a MeshWarning if some are poor."""
    offsets, normals, away, lengths = walls_of(mesh)
    star = np.maximum(largest_balls(offsets, normals, away)[1], 0.0)
    edge = np.minimum.reduceat(lengths, offsets[:-1]) / mesh.diameters
    poor = (star < LEAST_STAR) | ((edge < LEAST_EDGE) & isinstance(mesh, PolygonMesh))
    if poor.any():
        words = (
            f"quality: the constants of the method grow in {poor.sum()} of {len(poor)} cells, which are stretched, "
            f"dented or not star-shaped (star below {LEAST_STAR:g}; least {star.min():.2g}, cell {np.argmin(star)}), "
            f"or have edges below {LEAST_EDGE:g} of their diameter (least {edge.min():.2g}, cell {np.argmin(edge)}). "
            "Cut stretched cells across, collapse short edges, or remesh."
        )
        warnings.warn(words, MeshWarning, stacklevel=3)
    return Quality(star, edge, poor)


class Walls(NamedTuple):
    """The lines (in space: planes) of the sides of all cells, cell by cell."""

    offsets: Ints
    normals: Floats  # (k, dim) outward unit normals
    away: Floats  # (k,) distance from the centroid of the cell, divided by the cell diameter
    lengths: Floats  # (k,) length of the edge (in space: of the shortest edge of the face)


def walls_of(mesh: Mesh) -> Walls:
    """Return the walls of all cells of a mesh."""
    if isinstance(mesh, PolygonMesh):
        along = _along(mesh.points, mesh.offsets, mesh.vertices)
        lengths = np.linalg.norm(along, axis=1)
        offsets, normals, places = mesh.offsets, right_of(along) / lengths[:, None], mesh.points[mesh.vertices]
    elif isinstance(mesh, PolyhedralMesh):
        faces, along = mesh.cell_faces, _along(mesh.points, mesh.face_offsets, mesh.face_vertices)
        lengths = np.minimum.reduceat(np.linalg.norm(along, axis=1), mesh.face_offsets[:-1])[faces]
        offsets, normals = mesh.cell_offsets, mesh.face_signs[:, None] * mesh.face_normals[faces]
        places = mesh.face_centroids[faces]
    owner = cell_of_corner(offsets)
    away = np.einsum("ki,ki->k", normals, places - mesh.centroids[owner]) / mesh.diameters[owner]
    return Walls(offsets, normals, away, lengths)


def _along(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Return, for each corner, the vector of the edge that starts there."""
    return points[vertices[next_corner(offsets)]] - points[vertices]


def largest_balls(offsets: Ints, normals: Floats, away: Floats) -> tuple[Floats, Floats]:
    """Return, from `Walls`, centres minus centroids (c, dim), and the radii rho_K (c,), both divided by h_K."""
    from scipy.optimize import linprog

    size, cells = normals.shape[1] + 1, len(offsets) - 1
    found = np.empty((cells, size))
    for first in range(0, cells, CHUNK_SIZE):
        last = min(first + CHUNK_SIZE, cells)
        sides = slice(offsets[first], offsets[last])
        rows = np.column_stack([normals[sides], np.ones(len(normals[sides]))])
        columns = (cell_of_corner(offsets[first : last + 1])[:, None]) * size + np.arange(size)
        starts = size * np.arange(len(rows) + 1)
        matrix: Any = csr_array((rows.ravel(), columns.ravel(), starts), shape=(len(rows), size * (last - first)))
        cost = np.tile(np.append(np.zeros(size - 1), -1.0), last - first)
        solved: Any = linprog(cost, A_ub=matrix, b_ub=away[sides], bounds=(None, None))
        found[first:last] = solved.x.reshape(-1, size)
    return found[:, :-1], found[:, -1]
