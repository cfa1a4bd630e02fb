"""Points of polyhedra as averages over nodes and cells: where they lie, and what functions of the space are there.

A point lies in a closed cell if the triangles of its faces, seen from there, fill the sphere (4 pi), or if it is on one
of them but for rounding. On faces functions are known, piecewise linear (:mod:`.faces`), and take their own values at
nodes; inside cells Pi u stands for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import ROUNDING, SOME, Bools, Floats, Ints
from vemcvx.meshes.interfaces import faces_of
from vemcvx.meshes.mesh import PolyhedralMesh
from vemcvx.meshes.polygons import TOLERANCE, offsets_of, overlapping_boxes, spans
from vemcvx.meshes.polyhedra import angles_seen
from vemcvx.vem.projection import face_groups
from vemcvx.vem.space import Space


def solid_places(space: Space, mesh: PolyhedralMesh, x: Floats) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Matrices (p, n_nodes) and (p, n_cells) that take values at nodes and on cells to points x (p, 3).

    Where several cells meet, their values are averaged; points outside of the mesh have empty rows.
    """
    # Points in one go: each meets some hundred triangles.
    parts = [_places(space, mesh, x[k : k + SOME]) for k in range(0, len(x), SOME)]
    nodes, cells = ([part[k] for part in parts] for k in range(2))
    return sp.vstack(nodes, format="csr"), sp.vstack(cells, format="csr")


def _places(space: Space, mesh: PolyhedralMesh, x: Floats) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    offsets, vertices = mesh.cell_nodes
    low, high = (f.reduceat(mesh.points[vertices], offsets[:-1]) for f in (np.minimum, np.maximum))
    # Points computed as 0.1 + 0.2 are 5e-17 off.
    reach = ROUNDING * mesh.h + TOLERANCE * float(np.abs(mesh.points).max())
    point, cell = overlapping_boxes(x - reach, x + reach, low, high)
    if len(point) == 0:
        return sp.csr_matrix((len(x), mesh.n_nodes)), sp.csr_matrix((len(x), mesh.n_cells))
    order = np.lexsort([cell, point])
    near = _Near(mesh, x, point[order], cell[order], reach)
    point, cell = near.held
    share = 1.0 / np.bincount(point, minlength=len(x))[point]
    cells = sp.csr_matrix((share, (point, cell)), shape=(len(x), mesh.n_cells))
    on, values = near.traces()
    first = np.unique(point, return_index=True)[1]
    first = first[~np.isin(point[first], on)]
    inside = solid_values(space, x, point[first], cell[first])
    return sp.csr_matrix(values + inside), cells


@dataclass(frozen=True, eq=False)
class _Triangles:
    """The triangles (t, 3, 3) of some faces, those of one face together, and the nodal values at their corners."""

    faces: Ints
    offsets: Ints
    corners: Floats
    values: sp.csr_matrix  # (3 t, n_nodes)

    @classmethod
    def of(cls, mesh: PolyhedralMesh, faces: Ints) -> _Triangles:
        face, corners, values = [], [], []
        for group in face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, faces):
            f, n = group.nodes.shape
            count = group.triangles.shape[1]
            at = group.corners + group.origin[:, None]
            at[:, :n] = mesh.points[group.nodes]
            row = np.arange(f)[:, None, None]
            face.append(np.repeat(group.faces, count))
            corners.append(at[row, group.triangles].reshape(-1, 3, 3))
            # Of every face its vertices, then c.
            entries = np.concatenate([np.broadcast_to(np.eye(n), (f, n, n)), group.weights[:, None]], axis=1)
            columns = np.repeat(group.nodes[:, None], n + 1, axis=1)
            starts = np.arange(0, f * (n + 1) * n + 1, n)
            at_points = sp.csr_matrix((entries.ravel(), columns.ravel(), starts), shape=(f * (n + 1), mesh.n_nodes))
            values.append(at_points[(row * (n + 1) + group.triangles).ravel()])
        number, where = np.concatenate(face), np.concatenate(corners)
        order = np.argsort(number, kind="stable")
        rows = (order[:, None] * 3 + np.arange(3)).ravel()
        found, counts = np.unique(number, return_counts=True)
        return cls(found, offsets_of(counts), where[order], sp.csr_matrix(sp.vstack(values, format="csr")[rows]))


class _Near:
    """Candidates: pairs of a point and a cell that may hold it, within `reach` of its faces."""

    def __init__(self, mesh: PolyhedralMesh, x: Floats, point: Ints, cell: Ints, reach: float):
        counts = np.diff(mesh.cell_offsets)[cell]
        at = spans(mesh.cell_offsets[cell], counts)
        self._point, self._cell, self._size = point, cell, len(x)
        self._triangles = _Triangles.of(mesh, np.unique(mesh.cell_faces[at]))
        place = np.searchsorted(self._triangles.faces, mesh.cell_faces[at])
        several = np.diff(self._triangles.offsets)[place]
        self._each = spans(self._triangles.offsets[place], several)
        self._owner = np.repeat(np.repeat(np.arange(len(point)), counts), several)
        arms = self._triangles.corners[self._each] - x[point[self._owner], None]
        angles = angles_seen(arms) * np.repeat(mesh.face_signs[at], several)
        self._around = np.bincount(self._owner, angles, len(point)) > 2.0 * np.pi
        self._weights, self._distance = _nearest(arms)
        self._on = self._distance <= reach
        holds = self._around | (np.bincount(self._owner, self._on, len(self._point)) > 0)
        if mesh.interfaces:
            # A point on an interface counts with the first body, unless only cells of second ones hold it.
            seconds = np.zeros(mesh.n_faces, dtype=bool)
            for joint in mesh.interfaces.values():
                seconds[mesh.boundaries["boundary"][faces_of(joint.partners, mesh._outlines)]] = True
            there = self._on & np.repeat(seconds[mesh.cell_faces[at]], several)
            second = holds & (np.bincount(self._owner, there, len(self._point)) > 0)
            holds &= ~(second & np.isin(self._point, self._point[holds & ~second]))
        self._holds: Bools = holds
        self._on &= holds[self._owner]

    @property
    def held(self) -> tuple[Ints, Ints]:
        """Points and closed cells that hold them, by point, then by cell."""
        return self._point[self._holds], self._cell[self._holds]

    def traces(self) -> tuple[Ints, sp.csr_matrix]:
        """The points on faces, and the values there (p, n_nodes), from the nearest triangle."""
        on = np.flatnonzero(self._on)
        on = on[np.lexsort([self._distance[on], self._point[self._owner[on]]])]
        points, first = np.unique(self._point[self._owner[on]], return_index=True)
        best = on[first]
        columns = self._each[best][:, None] * 3 + np.arange(3)
        entries = self._weights[best].ravel(), (np.repeat(points, 3), columns.ravel())
        corner = sp.csr_matrix(entries, shape=(self._size, self._triangles.values.shape[0]))
        return points, sp.csr_matrix(corner @ self._triangles.values)


def _nearest(arms: Floats) -> tuple[Floats, Floats]:
    """Barycentric coordinates (k, 3) of the points of triangles (k, 3, 3) nearest to the origin if that is close."""
    a, b, c = (arms[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    part = np.stack([np.einsum("ki,ki->k", normal, np.cross(p, q)) for p, q in ((b, c), (c, a), (a, b))], axis=1)
    part = np.maximum(part, 0.0)
    here = np.all(arms == 0.0, axis=2)  # At a corner that corner alone counts.
    corner = np.any(here, axis=1)
    part[corner] = here[corner]
    weights = part / np.maximum(part.sum(axis=1), np.finfo(float).tiny)[:, None]
    return weights, np.linalg.norm(np.einsum("kc,kci->ki", weights, arms), axis=1)


def solid_values(space: Space, x: Floats, point: Ints, cell: Ints) -> sp.csr_matrix:
    """Values (p, n_nodes) of Pi at points in cells, each in its own."""
    total = sp.csr_matrix((len(x), space.mesh.n_nodes))
    for group in space.groups:
        place = np.minimum(np.searchsorted(group.cells, cell), len(group.cells) - 1)
        mine = group.cells[place] == cell
        if not mine.any():
            continue
        some = group.part(place[mine])
        measures, g = some.gradients()
        means = some.boundary_means()
        to = space.mesh.points[some.nodes] - x[point[mine], None]
        centre = np.einsum("ci,cia->ca", means, to)
        values = means - np.einsum("cia,ca->ci", g / measures[:, None, None], centre)
        rows = np.repeat(point[mine], values.shape[1])
        total = total + sp.csr_matrix((values.ravel(), (rows, some.nodes.ravel())), shape=total.shape)
    return total
