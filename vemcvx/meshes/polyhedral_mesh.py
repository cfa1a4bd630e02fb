"""Meshes of polyhedra in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import Floats, Ints, plain, read_only
from vemcvx.meshes import polyhedra
from vemcvx.meshes.checks.space import check_polyhedral_mesh
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.mesh import Mesh, Sides


@dataclass(frozen=True, eq=False, repr=False, init=False)
class PolyhedralMesh(Mesh):
    """A polyhedral mesh of a domain in space.

    Neighbouring cells share whole faces. Nodes and cells keep the given order. Faces are numbered as they first appear.

    Parameters
    ----------
    points : (n_nodes, 3) array_like of float
        Node coordinates, in consistent units.
    cells : nested sequences of int, or (n_cells, faces, vertices) array of int
        Faces of each cell. A face lists its vertices counter-clockwise as seen from outside the cell.
    boundaries : mapping of str to array_like, optional
        Name -> numbers of boundary faces, or lists of vertices. The name "boundary" is reserved for the whole
        boundary. By default, the faces where x, y or z is least or greatest are "left", "right", "front", "back",
        "bottom" and "top". An empty mapping names nothing.
    cell_data, interfaces : as in `PolygonMesh`

    Attributes
    ----------
    points, cell_data, interfaces : as the parameters
    face_offsets, face_vertices : (n_faces + 1,) int, (n_corners,) int
        Face f has the vertices ``face_vertices[face_offsets[f]:face_offsets[f + 1]]``, counter-clockwise as seen from
        outside its first cell.
    face_cells : (n_faces, 2) int
        Adjacent cells of each face; the second is -1 on the boundary.
    cell_offsets, cell_faces : (n_cells + 1,) int, (m,) int
        Cell c has the faces ``cell_faces[cell_offsets[c]:cell_offsets[c + 1]]``.
    node_map : as in `PolygonMesh`

    Raises
    ------
    MeshError
        The points and cells do not form a valid mesh. Vertices within 1e-6 face diameters of the face plane are valid.

    Examples
    --------
    >>> corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    >>> vx.PolyhedralMesh(corners, [[(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]]).volumes
    array([0.16666667])
    """

    face_offsets: Ints
    face_vertices: Ints
    cell_offsets: Ints
    cell_faces: Ints
    face_cells: Ints

    ARRAYS = ("points", "face_offsets", "face_vertices", "cell_offsets", "cell_faces", "face_cells")
    NUMBERED = MappingProxyType({"face_vertices": "n_nodes", "cell_faces": "n_faces", "face_cells": "n_cells"})
    PARTS, A_PART = "faces", "a face"

    def __init__(
        self,
        points: ArrayLike,
        cells: Sequence[Sequence[ArrayLike]] | NDArray[np.integer] | polyhedra.FaceLists,
        *,
        boundaries: Mapping[str, ArrayLike | Sequence[ArrayLike]] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
        interfaces: Mapping[str, Interface] | None = None,
    ):
        self._take(check_polyhedral_mesh(points, cells, interfaces), boundaries, cell_data)

    @cached_property
    def cells(self) -> tuple[tuple[Ints, ...], ...]:
        """Faces of each cell, with vertices counter-clockwise as seen from outside."""
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
        """Number of faces. A face between two cells counts once."""
        return len(self.face_offsets) - 1

    @property
    def faces(self) -> polyhedra.Faces:
        """All arrays of faces in a named tuple."""
        return polyhedra.Faces(
            self.face_offsets, self.face_vertices, self.cell_offsets, self.cell_faces, self.face_cells
        )

    @cached_property
    def _face_shapes(self) -> polyhedra.FaceShapes:
        found = polyhedra.face_shapes(self.points, self.face_offsets, self.face_vertices)
        return polyhedra.FaceShapes(*map(read_only, found))

    @property
    def face_areas(self) -> Floats:
        """Areas (n_faces,) of the faces."""
        return self._face_shapes.areas

    @property
    def face_normals(self) -> Floats:
        """Unit normals (n_faces, 3) that point out of the first cell of each face."""
        return self._face_shapes.normals

    @property
    def face_centroids(self) -> Floats:
        """Centroids (n_faces, 3) of the faces."""
        return self._face_shapes.centroids

    @cached_property
    def face_signs(self) -> Floats:
        """Signs (m,) of entries in ``cell_faces``: 1 if the normal points out of the cell, else -1."""
        return read_only(polyhedra.signs_of(self.faces))

    def _measure_cells(self) -> tuple[Floats, Floats]:
        return polyhedra.volumes_and_centroids(self._face_shapes, self.cell_offsets, self.cell_faces, self.face_signs)

    @property
    def volumes(self) -> Floats:
        """Volumes (n_cells,) of the cells."""
        return self.measures

    @cached_property
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """Offsets (n_cells + 1,), and the ascending nodes of each cell."""
        offsets, nodes = polyhedra.nodes_of_cells(self.faces, self.n_nodes)
        return read_only(offsets), read_only(nodes)

    @property
    def _sides(self) -> Sides:
        return Sides(self.face_offsets, self.face_vertices, self.face_cells)

    @property
    def _boundary(self) -> Ints:
        return read_only(self._outer_sides)

    @property
    def _middles(self) -> Floats:
        return self.face_centroids[self._boundary]

    def _places(self, parts: Ints) -> Ints:
        return np.searchsorted(self._boundary, parts)

    def _parts(self, name: str, given: Any, number: Ints) -> tuple[Ints, list[str]]:
        faces = plain(given)
        if faces is None or faces.ndim != 1 or faces.dtype.kind not in "iu" or not len(faces):
            return super()._parts(name, given, number)
        place = np.minimum(np.searchsorted(self._boundary, faces), len(self._boundary) - 1)
        return np.where(self._boundary[place] == faces, place, -1), [f"face {face}" for face in faces.tolist()]
