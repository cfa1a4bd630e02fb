"""A mesh with boundary edges cut into pieces. Data at the new nodes are compared with linear interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from vemcvx.base.arrays import ROUNDING, Floats, Ints
from vemcvx.bound.skeleton import Skeleton
from vemcvx.effects import Friction, Obstacle
from vemcvx.meshes import Interface, PolygonMesh
from vemcvx.meshes.polygons import positions

PIECES = 32
"""Number of pieces of each boundary edge."""


@dataclass(frozen=True)
class FineBoundary:
    """A mesh with boundary edges cut into pieces."""

    mesh: PolygonMesh
    old: int  # number of the first new node
    pieces: Ints  # (b PIECES, 2) end nodes of pieces
    owner: Ints  # (q,) the boundary edge of each new node
    along: Floats  # (q,) position on the edge, in (0, 1)

    def between(self, values: Floats, at: Ints | slice = slice(None)) -> Floats:
        """Interpolate linearly from the ends of boundary edges to new nodes."""
        start, stop = values[self.owner[at], 0], values[self.owner[at], 1]
        s = self.along[at].reshape(-1, *[1] * (start.ndim - 1))
        return np.asarray((1.0 - s) * start + s * stop)

    def tips(self, rows: Friction | Obstacle, values: Floats) -> Floats:
        """Return values (b, 2, d) at ends of boundary edges; missing values are NaN."""
        found = np.full((int(self.owner.max()) + 1, 2, values.shape[1]), np.nan)
        if rows.ends is not None:
            tips = np.flatnonzero((rows.nodes[rows.ends.row] < self.old) & (rows.ends.beyond >= self.old))
            next_door = rows.ends.beyond[tips] - self.old
            found[self.owner[next_door], (self.along[next_door] > 0.5).astype(int)] = values[rows.ends.row[tips]]
        return found

    def read(self, rows: Friction | Obstacle, values: Floats) -> tuple[Ints, Floats, Floats]:
        """Return the new nodes of an effect, the values there, and interpolated values."""
        new = np.flatnonzero(rows.nodes >= self.old) if rows.ends is not None else np.zeros(0, dtype=np.int64)
        at = rows.nodes[new] - self.old
        return at, *without_rounding(values[new], np.nan_to_num(self.between(self.tips(rows, values), at)))


def without_rounding(values: Floats, line: Floats) -> tuple[Floats, Floats]:
    """Return `values` and `line`, made equal where they differ only by rounding."""
    size = max(np.abs(values).max(initial=0.0), np.abs(line).max(initial=0.0))
    return np.where(np.abs(values - line) <= ROUNDING * size, line, values), line


def fine_boundary(mesh: PolygonMesh, edges: Skeleton) -> FineBoundary:
    """Return the mesh with boundary edges cut into pieces."""
    joints, ends, count = edges.joints, edges.outer_edges, len(edges.outer)
    new = mesh.n_nodes + np.arange(count * (PIECES - 1)).reshape(count, -1)
    across = np.full(new.shape, -1)
    across[joints.first] = new[joints.second, ::-1]
    owner, along = np.repeat(np.arange(count), PIECES - 1), np.tile(np.arange(1, PIECES) / PIECES, count)
    first, last = mesh.points[ends[owner]].swapaxes(0, 1)

    def chain(between: Ints, tips: Ints) -> Ints:
        nodes = np.column_stack([tips[:, 0], between, tips[:, 1]])
        return np.stack([nodes[:, :-1], nodes[:, 1:]], axis=2)

    def select(pieces: Ints, whole: Ints) -> Ints:
        return pieces[np.unique(positions(whole, ends, mesh.n_nodes))].reshape(-1, 2)

    pieces, partners = chain(new, ends), chain(across, joints.across)
    added = (PIECES - 1) * np.bincount(edges.outer, minlength=mesh.n_cells)
    fine = PolygonMesh.unchecked(
        np.concatenate([mesh.points, first + along[:, None] * (last - first)]),
        mesh.offsets + np.append(0, np.cumsum(added)),
        np.insert(mesh.vertices, edges.outer_corners[owner] + 1, new.ravel()),
    )
    sides = {name: of for name, of in mesh.boundaries.items() if name not in (*mesh.interfaces, "boundary")}
    joined = {
        name: Interface(joint.bodies, select(pieces, joint.edges), select(partners, joint.edges))
        for name, joint in mesh.interfaces.items()
    }
    named = {name: select(pieces, of) for name, of in sides.items()}
    fine = fine._replace(_named=named, interfaces=MappingProxyType(joined), cell_data=mesh.cell_data)
    return FineBoundary(mesh=fine, old=mesh.n_nodes, pieces=pieces.reshape(-1, 2), owner=owner, along=along)
