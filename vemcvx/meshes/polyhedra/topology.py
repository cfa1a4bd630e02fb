"""Faces that cells list one by one, joined: every face once, with the cells on its two sides.

Two listed faces are the same if they have the same vertices. Faces are numbered as they first appear, so the first
cell of a face is the one of lower number, whose listing the face keeps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.topology import cell_of_corner, offsets_of, rows_in_order, turned


class Listed(NamedTuple):
    """Faces of cells that list all of theirs, one cell after the other."""

    offsets: Ints
    """(n_listed + 1,) where in `vertices` each face begins"""
    vertices: Ints
    cell_offsets: Ints
    """(n_cells + 1,) which faces are each cell's"""

    def in_order(self, cells: Ints) -> Listed:
        """Those of the cells with the given numbers, in this order."""
        cell_offsets, faces = rows_in_order(self.cell_offsets, np.arange(len(self.offsets) - 1), cells)
        return Listed(*rows_in_order(self.offsets, self.vertices, faces), cell_offsets)


class Faces(NamedTuple):
    """Faces of a mesh (see :class:`vemcvx.PolyhedralMesh`)."""

    face_offsets: Ints
    face_vertices: Ints
    cell_offsets: Ints
    cell_faces: Ints
    face_cells: Ints


def joined_faces(offsets: Ints, vertices: Ints, cell_offsets: Ints) -> Faces:
    """Faces of cells that list all of theirs, outwards: listed face k is ``vertices[offsets[k]:offsets[k + 1]]``."""
    first, number = same_faces(offsets, vertices)
    face_offsets, face_vertices = rows_in_order(offsets, vertices, first)
    owner = cell_of_corner(cell_offsets)
    second = np.full(len(first), -1)
    later = np.flatnonzero(first[number] != np.arange(len(number)))
    second[number[later]] = owner[later]
    return Faces(
        face_offsets,
        face_vertices,
        cell_offsets,
        number,
        np.column_stack([owner[first], second]),
    )


def same_faces(offsets: Ints, vertices: Ints) -> tuple[Ints, Ints]:
    """Of each face the listing that names its vertices first, in order; and of each listing the face that it is."""
    counts = np.diff(offsets)
    leader = np.arange(len(counts))
    for count in np.unique(counts):
        listed = np.flatnonzero(counts == count)
        rows = np.sort(vertices[offsets[listed, None] + np.arange(count)], axis=1)
        order = np.lexsort(rows.T[::-1])
        rows = rows[order]
        starts = np.concatenate([[True], (rows[1:] != rows[:-1]).any(axis=1)])
        leader[listed[order]] = listed[order[np.flatnonzero(starts)]][np.cumsum(starts) - 1]
    first = np.unique(leader)
    return first, np.searchsorted(first, leader)


def listed_faces(faces: Faces) -> Listed:
    """The faces of each cell, outwards: what `joined_faces` makes them of."""
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, faces.cell_faces)
    return Listed(offsets, turned(offsets, vertices, signs_of(faces) < 0.0), faces.cell_offsets)


def signs_of(faces: Faces) -> Floats:
    """1 where the stored normal of a cell's face points out of it, -1 where into it; in the order of `cell_faces`."""
    return np.where(faces.face_cells[faces.cell_faces, 0] == cell_of_corner(faces.cell_offsets), 1.0, -1.0)


def nodes_of_cells(faces: Faces, n_nodes: int) -> tuple[Ints, Ints]:
    """Offsets (n_cells + 1,) and the nodes of each cell, once each and ascending."""
    rows, nodes = rows_in_order(faces.face_offsets, faces.face_vertices, faces.cell_faces)
    cells = np.repeat(cell_of_corner(faces.cell_offsets), np.diff(rows))
    keys = np.sort(cells * n_nodes + nodes)
    keys = keys[np.concatenate([[True], keys[1:] != keys[:-1]])]
    return offsets_of(np.bincount(keys // n_nodes)), keys % n_nodes
