"""Results at any points of the body.

The computed displacement u_h is linear on edges, and piecewise linear on faces of polyhedra. Inside a cell, the linear
projection Pi u_h, (3.11) of the paper named in :mod:`vemcvx`, replaces u_h. Fields that are constant on cells are
averaged over all cells that contain the point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import ROUNDING, Floats, Ints, as_real_array, choice, finite, shape_in_words
from vemcvx.base.errors import SceneError
from vemcvx.meshes import Mesh, PolygonMesh, PolyhedralMesh, plane_mesh
from vemcvx.meshes.polygons import TOLERANCE, cell_of_corner, find_containing, next_vertex, outlines, overlapping_boxes
from vemcvx.results.results import Results
from vemcvx.vem import Space
from vemcvx.vem.points_in_solids import solid_places


@dataclass(frozen=True, eq=False)
class Location:
    """Cells and edges that contain p points of the plane, with k pairs (point, cell)."""

    points: Ints  # (k,) the point of each pair, ascending
    cells: Ints  # (k,) the cell of each pair, ascending for each point
    starts: Ints  # (p,) first node of the edge that contains the point, or -1
    ends: Ints  # (p,) second node of the edge, or -1
    along: Floats  # (p,) position of the point on the edge, 0 ... 1


def locate(mesh: PolygonMesh, points: Floats) -> Location:
    """Find the cells and edges that contain points (p, 2)."""
    owner, a, b = cell_of_corner(mesh.offsets), mesh.vertices, next_vertex(mesh.offsets, mesh.vertices)
    reach = ROUNDING * mesh.diameters[owner] + TOLERANCE * np.abs(mesh.points).max()
    low, high = (f(mesh.points[a], mesh.points[b]) for f in (np.minimum, np.maximum))
    i, s = overlapping_boxes(points, points, low - reach[:, None], high + reach[:, None])
    arm, side = points[i] - mesh.points[a[s]], mesh.points[b[s]] - mesh.points[a[s]]
    along = np.clip(np.einsum("sd,sd->s", arm, side) / np.einsum("sd,sd->s", side, side), 0.0, 1.0)
    distance = np.linalg.norm(arm - along[:, None] * side, axis=1)
    order = np.lexsort([distance, i])
    order = order[distance[order] <= reach[s[order]]]
    i, s, along = i[order], s[order], along[order]
    inside = find_containing(outlines(mesh.points, mesh.offsets, mesh.vertices), points)
    on = i * mesh.n_cells + owner[s]
    pairs = np.union1d(inside[0] * mesh.n_cells + inside[1], on)
    if mesh.interfaces:
        # On interfaces, cells of the first body take precedence.
        seconds = np.concatenate([joint.partners[:, ::-1] for joint in mesh.interfaces.values()]) @ [mesh.n_nodes, 1]
        second = np.isin(pairs, on[np.isin(a[s] * mesh.n_nodes + b[s], seconds)])
        kept = ~(second & np.isin(pairs // mesh.n_cells, pairs[~second] // mesh.n_cells))
        pairs, known = pairs[kept], np.isin(on, pairs[kept])
        i, s, along = i[known], s[known], along[known]
    nearest = np.unique(i, return_index=True)[1]
    starts, ends, shares = np.full(len(points), -1), np.full(len(points), -1), np.zeros(len(points))
    for values, found in ((starts, a[s]), (ends, b[s]), (shares, along)):
        values[i[nearest]] = found[nearest]
    return Location(*np.divmod(pairs, mesh.n_cells), starts, ends, shares)


@dataclass(frozen=True, eq=False)
class Places:
    """Matrices (p, n_nodes) and (p, n_cells) that interpolate nodal and cell values at p points."""

    nodes: sp.csr_matrix
    cells: sp.csr_matrix

    def at_nodes(self, values: Floats) -> Floats:
        """Return values (S, p, ...) at the points from nodal values (S, n_nodes, ...)."""
        return np.stack([self.nodes @ row for row in values])


def places(mesh: Mesh, points: ArrayLike, subject: str) -> Places:
    """Return the interpolation at points (p, dim), or raise SceneError."""
    dim = mesh.points.shape[1]
    wanted = f"points (p, {dim}), one per row, such as {[[0.5] * dim]}"
    x = finite(as_real_array(points, subject, wanted), subject)
    if x.ndim != 2 or x.shape[1] != dim:
        raise SceneError(f"{subject}: found {shape_in_words(x)}; wanted {wanted}.")
    if isinstance(mesh, PolyhedralMesh):
        nodes, cells = solid_places(Space(mesh), mesh, x)
    else:
        nodes, cells = _in_plane(plane_mesh(mesh, subject), x)
    out = np.flatnonzero(np.diff(cells.indptr) == 0)
    if len(out):
        first, kind = int(out[0]), "polyhedra" if isinstance(mesh, PolyhedralMesh) else "polygons"
        node = int(np.argmin(np.linalg.norm(mesh.points - x[first], axis=1)))
        more = f" (and so do {len(out) - 1} others)" if len(out) > 1 else ""
        raise SceneError(
            f"{subject}: point {first} at {x[first]} lies outside the body{more}; the nearest node of the mesh is "
            f"{node} at {mesh.points[node]}. Give points inside the {kind} of the mesh."
        )
    return Places(nodes, cells)


def _in_plane(mesh: PolygonMesh, x: Floats) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    found = locate(mesh, x)
    shares = 1.0 / np.bincount(found.points, minlength=len(x))[found.points]
    cells = sp.csr_matrix((shares, (found.points, found.cells)), shape=(len(x), mesh.n_cells))
    on = np.flatnonzero(found.starts >= 0)
    row, part = np.tile(on, 2), np.concatenate([1.0 - found.along[on], found.along[on]])
    ends = np.concatenate([found.starts[on], found.ends[on]])
    edges = sp.csr_matrix((part, (row, ends)), shape=(len(x), mesh.n_nodes))
    inner, first = np.unique(found.points, return_index=True)  # A point inside a cell is in no other cell.
    inside = found.starts[inner] < 0
    inner, cell = inner[inside], found.cells[first[inside]]
    return sp.csr_matrix(edges + Space(mesh).project_values(x, inner, cell)), cells


FIELDS = "displacement", "stress", "out_of_plane_stress", "von_mises", "principal_stresses"


def probe(history: Results, points: ArrayLike, field: str) -> Floats:
    """Return a field of a history at points: see :meth:`vemcvx.History.probe`."""
    choice(field, "probe", "field", FIELDS)
    at = places(history.mesh, points, "probe")
    if field == "displacement":
        return at.at_nodes(history.displacement)
    return np.stack([at.cells @ getattr(history, field)(int(step)) for step in history.stored])
