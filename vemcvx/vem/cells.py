"""Cells with equally many vertices, so that one array operation serves them all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Self

import numpy as np

from vemcvx.arrays import Floats, Ints, read_only
from vemcvx.vem.projection import area_gradients, boundary_weights, values_at_vertices


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Polygons with equally many vertices; what differs for polyhedra is said in :mod:`vemcvx.vem.polyhedra`."""

    cells: Ints
    """(c,) cell numbers"""
    nodes: Ints
    """(c, n) their vertices, of polygons counter-clockwise"""
    points: Floats
    """(n_nodes, dim) the points of the whole mesh"""

    @cached_property
    def corners(self) -> Floats:
        """Vertex coordinates (c, n, dim) relative to the first vertex of each cell.

        Differences of neighbouring coordinates are exact, products of coordinates near 1e6 are not: with
        this origin a body far away from the origin loses nothing more than its points were rounded by.
        """
        corners = self.points[self.nodes]
        return read_only(corners - corners[:, :1])

    @property
    def simplices(self) -> bool:
        """Whether the cells are triangles, or tetrahedra, on which Pi v = v."""
        return bool(self.nodes.shape[1] == self.points.shape[1] + 1)

    @property
    def shapes(self) -> tuple[Floats, ...]:
        """Arrays (c, ...) that local matrices depend on, beside moduli: equal to the bit for translates."""
        return (self.corners,)

    @property
    def stabilised_size(self) -> Floats:
        """h_K^(dim - 2), by which the stabilisation is scaled, (c,)."""
        return np.ones(len(self.cells))

    def gradients(self) -> tuple[Floats, Floats]:
        """|K| (c,), and |K| G_i (c, n, dim): grad Pi v = sum_i v_i (x) G_i."""
        return area_gradients(self.corners)

    def boundary_means(self) -> Floats:
        """(c, n) weights of the mean over the boundary of a cell."""
        return boundary_weights(self.corners)

    def vertex_values(self) -> Floats:
        """Pi at the vertices, (c, n, n): entry (i, j) is Pi of the basis function of x_j at x_i."""
        return values_at_vertices(self.corners, *self.gradients(), self.boundary_means())

    def chunks(self, entries: int) -> Iterator[CellGroup]:
        """The group in pieces whose local n x n matrices hold about `entries` numbers together."""
        size = max(1, entries // self.nodes.shape[1] ** 2)
        for start in range(0, len(self.cells), size):
            yield self.part(slice(start, start + size))

    def part(self, places: Ints | slice) -> Self:
        """Some of its cells, by their places in the group."""
        own = [field.name for field in fields(self) if field.name != "points"]
        return replace(self, **{name: getattr(self, name)[places] for name in own})
