"""Points of the body as averages over nodes and cells.

On an edge u_h is known: linear between its nodes, whose own values it takes at the ends; on faces of polyhedra it is
piecewise linear. Inside a cell it is not known, and its projection Pi u_h, (3.11), stands for it. What is constant on
cells is averaged over all cells that hold the point, so that a mirror image gives the mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, Ints, as_real_array, shape_in_words
from vemcvx.errors import SceneError
from vemcvx.meshes import AnyMesh, PolygonMesh, PolyhedralMesh
from vemcvx.meshes.interpolation import projected_values
from vemcvx.results.probe.locate import Location, locate
from vemcvx.vem import Space, solid_places


@dataclass(frozen=True, eq=False)
class Places:
    """p points of a body.

    Attributes
    ----------
    nodes : (p, n_nodes) sparse matrix
        Values at the points from values at nodes.
    cells : (p, n_cells) sparse matrix
        Values at the points from values on cells.
    """

    nodes: sp.csr_matrix
    cells: sp.csr_matrix

    def at_nodes(self, values: Floats) -> Floats:
        """(S, p, ...) of values (S, n_nodes, ...)."""
        return np.stack([self.nodes @ row for row in values])

    def at_cells(self, values: Floats) -> Floats:
        """(p, ...) of values (n_cells, ...)."""
        return self.cells @ values


def places(mesh: AnyMesh, points: ArrayLike, subject: str) -> Places:
    """The places of points (p, dim) in the body.

    Raises
    ------
    SceneError
        They are not points, or one lies outside the body; `subject` asked.
    """
    x = _points(points, mesh.points.shape[1], subject)
    nodes, cells = solid_places(Space(mesh), mesh, x) if isinstance(mesh, PolyhedralMesh) else _in_plane(mesh, x)
    out = np.flatnonzero(np.diff(cells.indptr) == 0)
    if len(out):
        raise SceneError(_outside(mesh, x, out, subject))
    return Places(nodes, cells)


def _in_plane(mesh: PolygonMesh, x: Floats) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    found = locate(mesh, x)
    shares = 1.0 / np.bincount(found.points, minlength=len(x))[found.points]
    cells = sp.csr_matrix((shares, (found.points, found.cells)), shape=(len(x), mesh.n_cells))
    return _nodes(mesh, x, found), cells


def _nodes(mesh: PolygonMesh, x: Floats, found: Location) -> sp.csr_matrix:
    """Values at the points from values at nodes."""
    on = np.flatnonzero(found.starts >= 0)
    row, part = np.tile(on, 2), np.concatenate([1.0 - found.along[on], found.along[on]])
    ends = np.concatenate([found.starts[on], found.ends[on]])
    edges = sp.csr_matrix((part, (row, ends)), shape=(len(x), mesh.n_nodes))
    # Inside, one cell holds the point.
    inner, first = np.unique(found.points, return_index=True)
    inside = found.starts[inner] < 0
    inner, cell = inner[inside], found.cells[first[inside]]
    spread = sp.csr_matrix((np.ones(len(inner)), (inner, np.arange(len(inner)))), shape=(len(x), len(inner)))
    return sp.csr_matrix(edges + spread @ projected_values(mesh, cell, x[inner]))


def _points(points: ArrayLike, dim: int, subject: str) -> Floats:
    wanted = f"points (p, {dim}), one a row, such as {[[0.5] * dim]}"
    x = as_real_array(points, subject, wanted)
    if x.ndim != 2 or x.shape[1] != dim:
        raise SceneError(f"{subject}: found {shape_in_words(x)}; wanted {wanted}.")
    bad = ~np.isfinite(x).all(axis=1)
    if bad.any():
        raise SceneError(f"{subject}: found NaN or infinity in point {int(np.argmax(bad))}; wanted finite {wanted}.")
    return x


def _outside(mesh: AnyMesh, x: Floats, out: Ints, subject: str) -> str:
    first, cells = int(out[0]), "polyhedra" if isinstance(mesh, PolyhedralMesh) else "polygons"
    node = int(np.argmin(np.linalg.norm(mesh.points - x[first], axis=1)))
    more = f" (and so do {len(out) - 1} others)" if len(out) > 1 else ""
    return (
        f"{subject}: point {first} at {x[first]} lies outside the body{more}; the nearest node of the mesh is {node} "
        f"at {mesh.points[node]}. Give points of the {cells} that the mesh is made of."
    )
