"""What a polygonal mesh is: points, cells, named parts of the boundary, data on cells; immutable.

Cells are simple polygons listed counter-clockwise; two cells meet in whole edges and vertices of both. A vertex may
lie on a straight line between its neighbours (a hanging node of the cell next door) and cells need not be convex.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, Ints, read_only
from vemcvx.errors import MeshWarning
from vemcvx.meshes.box import Box
from vemcvx.meshes.checks.names import check_boundaries, check_cell_data, side_edges
from vemcvx.meshes.checks.plane import checked
from vemcvx.meshes.interfaces import Interface, on_boundary
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygons import geometry, topology


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Tessellation(Mesh):
    """Points and polygonal cells, checked: the data of a :class:`vemcvx.PolygonMesh`, whose docstring says the rest."""

    offsets: Ints
    vertices: Ints
    _box: Box | None

    ARRAYS = ("points", "offsets", "vertices")
    PARTS = "edges"

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[ArrayLike] | NDArray[np.integer],
        *,
        boundaries: Mapping[str, ArrayLike] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
        interfaces: Mapping[str, Interface] | None = None,
    ):
        mesh = checked(points, cells, interfaces)
        for note in mesh.notes:
            warnings.warn(note, MeshWarning, stacklevel=2)
        self._fill(mesh.points, mesh.offsets, mesh.vertices, node_map=mesh.node_map)
        object.__setattr__(self, "_named", self._checked_parts(boundaries, mesh.node_map))
        matched = on_boundary(mesh.interfaces, self._boundary, self.n_nodes, mesh.node_map)
        object.__setattr__(self, "interfaces", MappingProxyType(matched))
        object.__setattr__(self, "cell_data", MappingProxyType(check_cell_data(cell_data, self.n_cells)))

    @classmethod
    def unchecked(cls, points: Floats, offsets: Ints, vertices: Ints, box: Box | None = None) -> Self:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        mesh._fill(points, offsets, vertices, _box=box)
        return mesh

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.offsets) - 1

    @cached_property
    def cells(self) -> tuple[Ints, ...]:
        """Vertex numbers of each cell, counter-clockwise: one view an array of ``vertices`` a cell."""
        return tuple(self.vertices[start:end] for start, end in pairwise(self.offsets.tolist()))

    @cached_property
    def _areas_and_centroids(self) -> tuple[Floats, Floats]:
        areas, centroids = geometry.areas_and_centroids(self.points, self.offsets, self.vertices)
        return read_only(areas), read_only(centroids)

    @property
    def areas(self) -> Floats:
        """Area of each cell, (n_cells,)."""
        return self._areas_and_centroids[0]

    @property
    def centroids(self) -> Floats:
        """Centroid of each cell, (n_cells, 2)."""
        return self._areas_and_centroids[1]

    @cached_property
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""
        return read_only(geometry.diameters(self.points, self.offsets, self.vertices))

    @cached_property
    def shared_edges(self) -> topology.SharedEdges:
        """Corners by the edge that they start."""
        return topology.shared_edges(self.offsets, self.vertices, self.n_nodes)

    @cached_property
    def _boundary(self) -> Ints:
        edges = topology.directed_edges(self.offsets, self.vertices)
        return read_only(edges[self.shared_edges.alone])

    @cached_property
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary: name -> edges (m, 2); "boundary" is all of it.

        An edge (a, b) runs as in its counter-clockwise cell: the outward normal is (y_b - y_a, x_a - x_b) / length.
        The name of an interface means its edges of the first body; "boundary" has those of both.
        """
        sides = {} if self._box is None else side_edges(self.points, self._boundary, self._box)
        joints = {name: interface.edges for name, interface in self.interfaces.items()}
        return MappingProxyType({**sides, **self._named, **joints, "boundary": self._boundary})

    @cached_property
    def neighbours(self) -> Ints:
        """Pairs of cells that share an edge, (m, 2)."""
        return read_only(topology.neighbours(self.offsets, self.shared_edges))

    @property
    def _choice(self) -> tuple[Ints, Floats]:
        inner = [side for found in self.interfaces.values() for side in (found.edges, found.partners)]
        free = np.ones(len(self._boundary), dtype=bool)
        if inner:
            free[topology.positions(np.concatenate(inner), self._boundary, self.n_nodes)] = False
        edges = self._boundary[free]
        return edges, 0.5 * (self.points[edges[:, 0]] + self.points[edges[:, 1]])

    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        return check_boundaries(boundaries, self._boundary, self.n_nodes, node_map)
