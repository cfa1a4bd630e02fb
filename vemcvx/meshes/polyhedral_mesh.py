"""What a polyhedral mesh is: points, faces, cells, named parts of the boundary, data on cells; immutable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Bools, Floats, Ints, read_only
from vemcvx.meshes.box import SpaceBox
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.polyhedra import shapes, topology


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolyhedralMesh:
    """A polyhedral mesh of a domain in space.

    Cells are polyhedra with plane faces; two cells meet in whole faces of both, so that where a large cell meets four
    small ones it has four coplanar faces. Neither cells nor faces need be convex.

    Attributes
    ----------
    points : (n_nodes, 3) float
        Node coordinates.
    face_offsets, face_vertices : (n_faces + 1,) int, (n_corners,) int
        Face f has the vertices ``face_vertices[face_offsets[f]:face_offsets[f + 1]]``; by the right-hand rule their
        order gives the normal out of its first cell.
    face_cells : (n_faces, 2) int
        First and second cell of each face; the second is -1 on the boundary.
    cell_offsets, cell_faces : (n_cells + 1,) int, (m,) int
        Cell c has the faces ``cell_faces[cell_offsets[c]:cell_offsets[c + 1]]``.
    cell_data : mapping of str to (n_cells, ...) array
        Data on cells.
    interfaces : mapping
        Empty: bodies are put together in the plane only.
    node_map : (n,) int or None
        If nodes that no cell uses were dropped: new number of each given node, -1 if dropped. Else None.

    Notes
    -----
    All arrays are read-only. Node and cell order are those given.
    """

    points: Floats
    face_offsets: Ints
    face_vertices: Ints
    cell_offsets: Ints
    cell_faces: Ints
    face_cells: Ints
    cell_data: Mapping[str, NDArray[Any]]
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    _named: Mapping[str, Ints]
    _box: SpaceBox | None

    @classmethod
    def unchecked(
        cls,
        points: Floats,
        face_offsets: Ints,
        face_vertices: Ints,
        cell_offsets: Ints,
        cell_faces: Ints,
        face_cells: Ints,
        box: SpaceBox | None = None,
    ) -> Self:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        fields = {
            "points": points,
            "face_offsets": face_offsets,
            "face_vertices": face_vertices,
            "cell_offsets": cell_offsets,
            "cell_faces": cell_faces,
            "face_cells": face_cells,
        }
        mesh.__dict__.update({name: read_only(values) for name, values in fields.items()})
        mesh.__dict__.update(cell_data=MappingProxyType({}), interfaces=MappingProxyType({}), node_map=None)
        mesh.__dict__.update(_named={}, _box=box)
        return mesh

    def __repr__(self) -> str:
        names = ", ".join(self.boundaries)
        return (
            f"{type(self).__name__}({self.n_cells} cells, {self.n_nodes} nodes, h = {self.h:.4g}, boundaries: {names})"
        )

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cell_offsets) - 1

    @property
    def n_faces(self) -> int:
        """Number of faces, inner ones counted once."""
        return len(self.face_offsets) - 1

    @cached_property
    def _faces(self) -> shapes.FaceShapes:
        found = shapes.face_shapes(self.points, self.face_offsets, self.face_vertices)
        return shapes.FaceShapes(*map(read_only, found))

    @property
    def face_areas(self) -> Floats:
        """Area of each face, (n_faces,)."""
        return self._faces.areas

    @property
    def face_normals(self) -> Floats:
        """Unit normal of each face, out of its first cell, (n_faces, 3)."""
        return self._faces.normals

    @property
    def face_centroids(self) -> Floats:
        """Centroid of each face, (n_faces, 3)."""
        return self._faces.centroids

    @cached_property
    def face_signs(self) -> Floats:
        """1 where the normal of a cell's face points out of the cell, -1 where into it; as ``cell_faces``."""
        return read_only(topology.signs_of(self.cell_offsets, self.cell_faces, self.face_cells))

    @cached_property
    def _volumes_and_centroids(self) -> tuple[Floats, Floats]:
        volumes, centroids = shapes.volumes_and_centroids(
            self._faces, self.cell_offsets, self.cell_faces, self.face_signs
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
        offsets, nodes = shapes.nodes_of_cells(
            self.n_nodes,
            self.face_offsets,
            self.face_vertices,
            cell_offsets=self.cell_offsets,
            cell_faces=self.cell_faces,
        )
        return read_only(offsets), read_only(nodes)

    @cached_property
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""
        return read_only(shapes.diameters(self.points, *self.cell_nodes))

    @cached_property
    def h(self) -> float:
        """Mesh size: the largest cell diameter."""
        return float(self.diameters.max())

    @cached_property
    def _boundary(self) -> Ints:
        return read_only(np.flatnonzero(self.face_cells[:, 1] < 0))

    @cached_property
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary: name -> face numbers (m,), ascending; "boundary" is all of it."""
        sides = {} if self._box is None else self._sides(self._box)
        return MappingProxyType({**sides, **self._named, "boundary": self._boundary})

    def _sides(self, box: SpaceBox) -> dict[str, Ints]:
        """Boundary faces on each side of the box; the families put points on its sides to the bit."""
        place = self.points[self.face_vertices]
        names = (("left", "right"), ("front", "back"), ("bottom", "top"))
        named = {}
        for axis, pair in enumerate(names):
            for name, at in zip(pair, (box.low[axis], box.high[axis]), strict=True):
                on = np.logical_and.reduceat(place[:, axis] == at, self.face_offsets[:-1])
                named[name] = read_only(np.flatnonzero(on & (self.face_cells[:, 1] < 0)))
        return named

    def with_boundary(self, name: str, predicate: Callable[[Floats], Bools]) -> Self:
        """Return this mesh with one more named part of its boundary.

        Parameters
        ----------
        name : str
            Its name; a part of that name is replaced, and parts may overlap.
        predicate : callable
            Takes the centroids (m, 3) of all boundary faces, returns which belong: bool (m,).
        """
        chosen = read_only(self._boundary[predicate(self.face_centroids[self._boundary])])
        mesh = object.__new__(type(self))
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key != "boundaries"})
        mesh.__dict__["_named"] = {**self._named, name: chosen}
        return mesh
