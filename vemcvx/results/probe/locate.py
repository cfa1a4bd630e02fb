"""Which cells of a polygonal mesh hold which points, for all points at once, whatever the shape of the cells.

A point lies inside a simple polygon if a ray from it crosses the sides an odd number of times (Shimrat, Algorithm 112,
Comm. ACM 5 (1962)). It lies on a side, where parity is a matter of rounding, if it is as close as rounding brings it:
then all cells there hold it, and the side is kept, because functions of the space are known on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons.segments import cross, overlapping_boxes
from vemcvx.meshes.polygons.topology import next_vertex, spans
from vemcvx.vem.points_in_solids import CLOSE, POINT_ROUNDING

# Points in one go: temporaries of some ten megabytes.
CHUNK = 2**14


@dataclass(frozen=True, eq=False)
class Location:
    """Where p points lie.

    Attributes
    ----------
    points, cells : (k,) and (k,) arrays of int
        Point points[i] lies in the closed cell cells[i]; by point, then by cell.
    starts, ends : (p,) and (p,) arrays of int
        The nodes of the side that a point lies on; -1 inside of cells and outside of the mesh.
    along : (p,) array
        How much of that side lies before the point, 0 ... 1.
    """

    points: Ints
    cells: Ints
    starts: Ints
    ends: Ints
    along: Floats


def locate(mesh: PolygonMesh, points: Floats) -> Location:
    """Where the finite points (p, 2) lie; those outside the mesh are in no cell."""
    low, high = (f.reduceat(mesh.points[mesh.vertices], mesh.offsets[:-1]) for f in (np.minimum, np.maximum))
    rounding = POINT_ROUNDING * np.abs(mesh.points).max()
    reach = CLOSE * mesh.h + rounding
    near = np.flatnonzero(((points >= low.min(axis=0) - reach) & (points <= high.max(axis=0) + reach)).all(axis=1))
    starts, ends, along = np.full(len(points), -1), np.full(len(points), -1), np.zeros(len(points))
    found = [np.zeros((2, 0), dtype=np.int64)]
    for chunk in np.split(near, range(CHUNK, len(near), CHUNK)) if len(near) else []:
        i, cells = overlapping_boxes(points[chunk] - reach, points[chunk] + reach, low, high)
        order = np.lexsort([cells, i])
        i, cells = chunk[i[order]], cells[order]
        if len(i):
            sides = _Sides(mesh, points, i, cells, CLOSE * mesh.diameters[cells] + rounding)
            on, a, b, t = sides.nearest()
            starts[on], ends[on], along[on] = a, b, t
            found.append(np.stack([i, cells])[:, sides.holds])
    held, holding = np.concatenate(found, axis=1)
    return Location(held, holding, starts, ends, along)


class _Sides:
    """The sides of candidates: pairs of a point i and a cell that may hold it, within `reach` of its sides."""

    def __init__(self, mesh: PolygonMesh, points: Floats, i: Ints, cells: Ints, reach: Floats):
        counts = np.diff(mesh.offsets)[cells]
        corner = spans(mesh.offsets[cells], counts)
        self._begin = np.cumsum(counts) - counts
        self._point = np.repeat(i, counts)
        self._a, self._b = mesh.vertices[corner], next_vertex(mesh.offsets, mesh.vertices)[corner]
        a, b = (mesh.points[ends] - points[self._point] for ends in (self._a, self._b))
        side = b - a
        self._along = np.clip(-np.einsum("sd,sd->s", a, side) / np.einsum("sd,sd->s", side, side), 0.0, 1.0)
        self._distance = np.linalg.norm(a + self._along[:, None] * side, axis=1)
        self._on = self._distance <= np.repeat(reach, counts)
        # The ray to the right meets a side from below to above if the point lies left of it, and so on.
        left = cross(a, b) > 0
        self._crossed = ((a[:, 1] > 0) != (b[:, 1] > 0)) & (left == (b[:, 1] > a[:, 1]))
        if mesh.interfaces:
            first = np.repeat(~self._of_second_bodies(mesh, i), counts)
            self._on, self._crossed = self._on & first, self._crossed & first

    @property
    def holds(self) -> Bools:
        """Whether each candidate's closed cell holds its point."""
        odd: Bools = np.add.reduceat(self._crossed.astype(np.int64), self._begin) % 2 == 1
        return odd | np.logical_or.reduceat(self._on, self._begin)

    def _of_second_bodies(self, mesh: PolygonMesh, i: Ints) -> Bools:
        """Whether a candidate's point lies on a side of its cell that is the second body's of an interface.

        Not where that is so of all candidates of a point.
        """
        n = mesh.n_nodes
        second = np.concatenate([joint.partners[:, 1] * n + joint.partners[:, 0] for joint in mesh.interfaces.values()])
        there = self._on & np.isin(self._a * n + self._b, second)
        found: Bools = np.logical_or.reduceat(there, self._begin)
        others = np.bincount(i[~found], minlength=i.max() + 1)[i] > 0
        return found & others

    def nearest(self) -> tuple[Ints, Ints, Ints, Floats]:
        """Points on sides, without repetition; the ends of the nearest side of each, and the place on it."""
        on = np.flatnonzero(self._on)
        on = on[np.lexsort([self._distance[on], self._point[on]])]
        points, first = np.unique(self._point[on], return_index=True)
        side = on[first]
        return points, self._a[side], self._b[side], self._along[side]
