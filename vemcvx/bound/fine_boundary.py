"""Points between nodes at which data are evaluated: boundary edges cut into pieces, and points in cells.

The effects of a scene are evaluated again, on the same mesh with boundary edges cut into pieces. An error of assembly
is the value of a datum at a new node, minus its linear interpolation between the old nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from vemcvx.base.arrays import ROUNDING, Bools, Floats, Ints
from vemcvx.bound.skeleton import Skeleton
from vemcvx.effects import Friction, Obstacle
from vemcvx.meshes import Interface, PolygonMesh
from vemcvx.meshes.polygons import outlines, places, positions, triangulate

PIECES, SPACING = 512, 128
"""About PIECES pieces of edges, or SPACING small triangles of cells, fit along the longer side of the body's box."""


@dataclass(frozen=True)
class FineBoundary:
    """A mesh with its boundary edges cut into pieces; the cells and their data do not change."""

    mesh: PolygonMesh
    old: int
    """number of the first new node"""
    pieces: Ints
    """(k, 2) the pieces, edge by edge"""
    piece_owner: Ints
    """(k,) the boundary edge of each piece"""
    owner: Ints
    """(q,) the boundary edge of each new node"""
    along: Floats
    """(q,) position in (0, 1) from the first end of the edge to the second"""
    lengths: Floats
    """(q,) length of the pieces at each new node: weights of the trapezoidal rule, if functions vanish at the ends"""

    def between(self, values: Floats, at: Ints | slice = slice(None)) -> Floats:
        """Return the values at new nodes of linear functions with the values (b, 2, ...) at the ends of edges."""
        start, stop = values[self.owner[at], 0], values[self.owner[at], 1]
        s = self.along[at].reshape(-1, *[1] * (start.ndim - 1))
        return np.asarray((1.0 - s) * start + s * stop)

    def tips(self, rows: Friction | Obstacle, values: Floats) -> Floats:
        """Convert values (m, j) of rows to values (b, 2, j) at ends of boundary edges; nan on edges without rows."""
        found = np.full((int(self.owner.max()) + 1, 2, values.shape[1]), np.nan)
        if rows.ends is not None:
            tips = np.flatnonzero((rows.nodes[rows.ends.row] < self.old) & (rows.ends.beyond >= self.old))
            next_door = rows.ends.beyond[tips] - self.old
            found[self.owner[next_door], (self.along[next_door] > 0.5).astype(int)] = values[rows.ends.row[tips]]
        return found

    def read(self, rows: Friction | Obstacle, values: Floats) -> tuple[Ints, Floats, Floats]:
        """Return new nodes (k,), the values (k, j) of rows there, and values interpolated between the ends of edges."""
        new = np.flatnonzero(rows.nodes >= self.old) if rows.ends is not None else np.zeros(0, dtype=np.int64)
        at = rows.nodes[new] - self.old
        return at, *without_rounding(values[new], np.nan_to_num(self.between(self.tips(rows, values), at)))


def without_rounding(values: Floats, line: Floats) -> tuple[Floats, Floats]:
    """Replace values by `line` where they differ from it by rounding errors only; return the values and `line`."""
    size = max(np.abs(values).max(initial=0.0), np.abs(line).max(initial=0.0))
    return np.where(np.abs(values - line) <= ROUNDING * size, line, values), line


def fine_boundary(mesh: PolygonMesh, edges: Skeleton) -> FineBoundary:
    """Return the mesh with its boundary edges cut into pieces, equally on both sides of an interface."""
    joints, ends = edges.joints, edges.outer_edges
    counts = np.maximum(np.ceil(edges.lengths * PIECES / np.ptp(mesh.points, axis=0).max()).astype(np.int64), 4)
    counts[joints.second] = counts[joints.first]
    inner, piece_owner = counts - 1, np.repeat(np.arange(len(counts)), counts)
    start, owner = np.cumsum(inner) - inner, np.repeat(np.arange(len(counts)), inner)
    place = np.arange(len(owner)) - start[owner]
    along, new = (place + 1) / counts[owner], mesh.n_nodes + np.arange(len(owner))
    first, last = mesh.points[ends[owner]].swapaxes(0, 1)
    offsets = mesh.offsets + np.append(0, np.cumsum(np.bincount(edges.outer, inner, mesh.n_cells))).astype(np.int64)
    opposite = np.full(len(counts), -1)
    opposite[joints.first] = joints.second
    across = np.where(opposite[owner] < 0, -1, mesh.n_nodes + start[opposite[owner]] + inner[owner] - 1 - place)

    def chain(between: Ints, tips: Ints) -> Ints:
        """Return the ends (k, 2) of the pieces of all edges, one after the other."""
        rows = (np.insert(between, at, tips[:, side]) for side, at in enumerate((start, start + inner)))
        return np.column_stack(list(rows))

    def find_pieces(whole: Ints) -> Bools:
        return np.isin(piece_owner, positions(whole, ends, mesh.n_nodes))

    pieces, partners = chain(new, ends), chain(across, joints.across)
    fine = PolygonMesh.unchecked(
        np.concatenate([mesh.points, first + along[:, None] * (last - first)]),
        offsets,
        np.insert(mesh.vertices, edges.outer_corners[owner] + 1, new),
    )
    sides = {name: of for name, of in mesh.boundaries.items() if name not in (*mesh.interfaces, "boundary")}
    named = {name: pieces[find_pieces(of)] for name, of in sides.items()}
    joined = {
        name: Interface(joint.bodies, pieces[find_pieces(joint.edges)], partners[find_pieces(joint.edges)])
        for name, joint in mesh.interfaces.items()
    }
    fine = fine._replace(_named=named, interfaces=MappingProxyType(joined), cell_data=mesh.cell_data)
    return FineBoundary(
        mesh=fine,
        old=mesh.n_nodes,
        pieces=pieces,
        piece_owner=piece_owner,
        owner=owner,
        along=along,
        lengths=(edges.lengths / counts)[owner],
    )


@dataclass(frozen=True)
class SamplePoints:
    """A midpoint rule in cells: points (q, 2), weights (q,), and the cell of each point (q,)."""

    x: Floats
    weights: Floats
    owner: Ints


def in_cells(mesh: PolygonMesh, spacing: float = SPACING) -> SamplePoints:
    """Return the centroids of small triangles: cells are cut into triangles, and triangles into equal small ones."""
    corners, areas, owner = triangulate(outlines(mesh.points, mesh.offsets, mesh.vertices))
    size = np.ptp(mesh.points, axis=0).max()
    cuts = np.maximum(np.ceil(np.sqrt(2.0 * areas) * spacing / size).astype(np.int64), 2)
    parts = []
    for m in np.unique(cuts):
        these, (i, j) = np.flatnonzero(cuts == m), np.indices((m, m))
        up, down = i + j < m, i + j < m - 1
        a, b = (np.append(k[up] + 1.0 / 3.0, k[down] + 2.0 / 3.0) / m for k in (i, j))
        x, count = places(corners[these], np.column_stack([a, b, 1.0 - a - b])), m * m
        parts.append((x.reshape(-1, 2), np.repeat(areas[these] / count, count), np.repeat(owner[these], count)))
    return SamplePoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))
