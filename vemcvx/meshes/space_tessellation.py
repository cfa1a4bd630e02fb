"""A polyhedral mesh: points, faces, cells, named parts of the boundary, data on cells; immutable.

Cells are polyhedra with plane faces; two cells meet in whole faces of both, so that where a large cell meets four small
ones it has four coplanar faces. Neither cells nor faces need be convex.
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
from vemcvx.meshes import polyhedra
from vemcvx.meshes.box import Box, check_cell_data, check_face_boundaries
from vemcvx.meshes.checks.space import checked_in_space
from vemcvx.meshes.polygons.geometry import diameters
from vemcvx.meshes.polygons.topology import rows_in_order
from vemcvx.meshes.tessellation import Mesh


@dataclass(frozen=True, eq=False, repr=False, init=False)
class SpaceTessellation(Mesh):
    """Points, faces and polyhedral cells, checked: the data of a :class:`vemcvx.PolyhedralMesh`."""

    face_offsets: Ints
    face_vertices: Ints
    cell_offsets: Ints
    cell_faces: Ints
    face_cells: Ints
    _box: Box | None

    ARRAYS = ("points", "face_offsets", "face_vertices", "cell_offsets", "cell_faces", "face_cells")
    PARTS = "faces"

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[Sequence[ArrayLike]] | NDArray[np.integer] | polyhedra.Listed,
        *,
        boundaries: Mapping[str, ArrayLike | Sequence[ArrayLike]] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
    ):
        points, faces, node_map, notes = checked_in_space(points, cells)
        for note in notes:
            warnings.warn(note, MeshWarning, stacklevel=2)
        self._fill(points, *faces, node_map=node_map)
        object.__setattr__(self, "_named", self._checked_parts(boundaries, node_map))
        object.__setattr__(self, "cell_data", MappingProxyType(check_cell_data(cell_data, self.n_cells)))

    @classmethod
    def unchecked(
        cls,
        points: Floats,
        face_offsets: Ints,
        face_vertices: Ints,
        cell_offsets: Ints,
        cell_faces: Ints,
        face_cells: Ints,
        box: Box | None = None,
    ) -> Self:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        faces = polyhedra.Faces(face_offsets, face_vertices, cell_offsets, cell_faces, face_cells)
        mesh._fill(points, *faces, _box=box)
        return mesh

    @cached_property
    def cells(self) -> tuple[tuple[Ints, ...], ...]:
        """Faces of each cell, outwards: the vertex numbers of each, as `PolyhedralMesh` takes them."""
        forwards = [self.face_vertices[start:end] for start, end in pairwise(self.face_offsets.tolist())]
        listed = [
            forwards[face] if sign > 0.0 else read_only(forwards[face][::-1])
            for face, sign in zip(self.cell_faces.tolist(), self.face_signs.tolist(), strict=True)
        ]
        return tuple(tuple(listed[start:end]) for start, end in pairwise(self.cell_offsets.tolist()))

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cell_offsets) - 1

    @property
    def n_faces(self) -> int:
        """Number of faces, inner ones counted once."""
        return len(self.face_offsets) - 1

    @property
    def faces(self) -> polyhedra.Faces:
        """The topology: the faces of cells, and the vertices of faces."""
        return polyhedra.Faces(
            self.face_offsets, self.face_vertices, self.cell_offsets, self.cell_faces, self.face_cells
        )

    @cached_property
    def _face_shapes(self) -> polyhedra.FaceShapes:
        found = polyhedra.face_shapes(self.points, self.face_offsets, self.face_vertices)
        return polyhedra.FaceShapes(*map(read_only, found))

    @property
    def face_areas(self) -> Floats:
        """Area of each face, (n_faces,)."""
        return self._face_shapes.areas

    @property
    def face_normals(self) -> Floats:
        """Unit normal of each face, out of its first cell, (n_faces, 3)."""
        return self._face_shapes.normals

    @property
    def face_centroids(self) -> Floats:
        """Centroid of each face, (n_faces, 3)."""
        return self._face_shapes.centroids

    @cached_property
    def face_signs(self) -> Floats:
        """1 where the normal of a cell's face points out of the cell, -1 where into it; as ``cell_faces``."""
        return read_only(polyhedra.signs_of(self.faces))

    @cached_property
    def _volumes_and_centroids(self) -> tuple[Floats, Floats]:
        volumes, centroids = polyhedra.volumes_and_centroids(
            self._face_shapes, self.cell_offsets, self.cell_faces, self.face_signs
        )
        return read_only(volumes), read_only(centroids)

    @property
    def volumes(self) -> Floats:
        """Volume of each cell, (n_cells,)."""
        return self._volumes_and_centroids[0]

    @property
    def centroids(self) -> Floats:
        """Centroid of each cell, (n_cells, 3)."""
        return self._volumes_and_centroids[1]

    @cached_property
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """Offsets (n_cells + 1,), and the nodes of each cell between them, once each and ascending."""
        offsets, nodes = polyhedra.nodes_of_cells(self.faces, self.n_nodes)
        return read_only(offsets), read_only(nodes)

    @cached_property
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""
        return read_only(diameters(self.points, *self.cell_nodes))

    @cached_property
    def _boundary(self) -> Ints:
        return read_only(np.flatnonzero(self.face_cells[:, 1] < 0))

    @property
    def _outlines(self) -> tuple[Ints, Ints]:
        return rows_in_order(self.face_offsets, self.face_vertices, self._boundary)

    @property
    def _choice(self) -> tuple[Ints, Floats]:
        return self._boundary, self.face_centroids[self._boundary]

    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        return check_face_boundaries(boundaries, self.faces, node_map)
