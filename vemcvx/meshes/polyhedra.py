"""Polyhedra: shared faces, areas, normals, volumes, and the solid angles of triangles.

A face with the vertices o, x_1, x_2 ... consists of the triangles (o, x_i, x_{i+1}). Let s_i be the signed areas of
these triangles, and d_i = x_i - o. Then

    area vector = 1/2 sum_i d_i x d_{i+1},      centroid = o + sum_i s_i (d_i + d_{i+1}) / 3 / sum_i s_i.

A face f of a cell has the outward area vector a_f and the centroid c_f. Let p be the mean of all c_f. The cell consists
of pyramids with the base f, the apex p and the volume V_f = a_f . (c_f - p) / 3. So

    volume = sum_f V_f,                         centroid = p + 3/4 sum_f V_f (c_f - p) / sum_f V_f.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.meshes.polygons import cell_of_corner, next_corner, offsets_of, reverse_rows, rows_in_order, same_rows


class FaceLists(NamedTuple):
    """The faces of all cells, cell by cell."""

    offsets: Ints  # (n_faces + 1,) positions in `vertices`
    vertices: Ints
    cell_offsets: Ints  # (n_cells + 1,) positions in the list of faces

    def in_order(self, cells: Ints) -> FaceLists:
        """Return the faces of the given cells."""
        cell_offsets, faces = rows_in_order(self.cell_offsets, np.arange(len(self.offsets) - 1), cells)
        return FaceLists(*rows_in_order(self.offsets, self.vertices, faces), cell_offsets)


class Faces(NamedTuple):
    """Faces of a mesh (see :class:`vemcvx.PolyhedralMesh`)."""

    face_offsets: Ints
    face_vertices: Ints
    cell_offsets: Ints
    cell_faces: Ints
    face_cells: Ints


def join_faces(offsets: Ints, vertices: Ints, cell_offsets: Ints) -> Faces:
    """Return the faces of a mesh, from lists of faces with outward normals."""
    first, number = same_rows(offsets, vertices)
    owner, second = cell_of_corner(cell_offsets), np.full(len(first), -1)
    later = np.flatnonzero(first[number] != np.arange(len(number)))
    second[number[later]] = owner[later]
    cells = np.column_stack([owner[first], second])
    return Faces(*rows_in_order(offsets, vertices, first), cell_offsets, number, cells)


def list_faces(faces: Faces) -> FaceLists:
    """List the faces of each cell, with outward normals."""
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, faces.cell_faces)
    return FaceLists(offsets, reverse_rows(offsets, vertices, signs_of(faces) < 0.0), faces.cell_offsets)


def signs_of(faces: Faces) -> Floats:
    """Return 1 for outward and -1 for inward normals in `cell_faces`."""
    return np.where(faces.face_cells[faces.cell_faces, 0] == cell_of_corner(faces.cell_offsets), 1.0, -1.0)


def nodes_of_cells(faces: Faces, n_nodes: int) -> tuple[Ints, Ints]:
    """Return the offsets and the sorted nodes of cells."""
    rows, nodes = rows_in_order(faces.face_offsets, faces.face_vertices, faces.cell_faces)
    cells = np.repeat(cell_of_corner(faces.cell_offsets), np.diff(rows))
    keys = np.unique(cells * n_nodes + nodes)
    return offsets_of(np.bincount(keys // n_nodes)), keys % n_nodes


class FaceShapes(NamedTuple):
    """The shapes of faces."""

    areas: Floats  # (n_faces,)
    normals: Floats  # (n_faces, 3) unit normals
    centroids: Floats  # (n_faces, 3)


def face_shapes(points: Floats, offsets: Ints, vertices: Ints) -> FaceShapes:
    """Compute the shapes of faces, with normals by the right-hand rule."""
    places = points[vertices]
    counts, begin = np.diff(offsets), offsets[:-1]
    origin = places[begin]
    here = places - np.repeat(origin, counts, axis=0)
    after = here[next_corner(offsets)]
    part = 0.5 * np.cross(here, after)
    vectors = np.add.reduceat(part, begin, axis=0)
    areas = np.linalg.norm(vectors, axis=1)
    normals = _divide_rows(vectors, areas)
    signed = np.einsum("ij,ij->i", part, np.repeat(normals, counts, axis=0))
    moments = np.add.reduceat((here + after) * signed[:, None], begin, axis=0)
    return FaceShapes(areas, normals, origin + _divide_rows(moments, 3.0 * areas))


def in_planes(places: Floats, faces: Ints, shapes: FaceShapes) -> Floats:
    """Return coordinates (m, 3) of points relative to centroids, along `axes_in_planes`."""
    arms, axes = places - shapes.centroids[faces], axes_in_planes(shapes)
    return np.asarray(np.einsum("mai,mi->ma", axes[faces], arms))


def axes_in_planes(shapes: FaceShapes) -> Floats:
    """Return axes (n_faces, 3, 3): two in the plane of a face, and the normal."""
    across = np.eye(3)[np.argmin(np.abs(shapes.normals), axis=1)]
    first = np.cross(shapes.normals, across)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(shapes.normals, first), shapes.normals], axis=1)


def volumes_and_centroids(faces: FaceShapes, offsets: Ints, cell_faces: Ints, signs: Floats) -> tuple[Floats, Floats]:
    """Return the signed volumes and the centroids of cells."""
    counts = np.diff(offsets)
    place = faces.centroids[cell_faces]
    apex = np.add.reduceat(place - np.repeat(place[offsets[:-1]], counts, axis=0), offsets[:-1], axis=0)
    apex = place[offsets[:-1]] + apex / counts[:, None]
    arm = place - np.repeat(apex, counts, axis=0)
    part = np.einsum("ij,ij->i", faces.normals[cell_faces], arm) * (signs * faces.areas[cell_faces])
    volumes = np.add.reduceat(part, offsets[:-1])
    moments = np.add.reduceat(arm * part[:, None], offsets[:-1], axis=0)
    return volumes / 3.0, apex + 0.75 * _divide_rows(moments, volumes)


def _divide_rows(rows: Floats, by: Floats) -> Floats:
    return np.divide(rows, by[:, None], out=np.zeros_like(rows), where=by[:, None] != 0.0)


# Faces with outward normals. Vertices are numbered around the bottom, then around the top.
FACES = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}


def angles_seen(arms: Floats) -> Floats:
    """Return the solid angles of triangles, seen from the origin.

    tan(angle / 2) = a . (b x c) / (|a| |b| |c| + (a . b) |c| + (a . c) |b| + (b . c) |a|)
    for the corners a, b, c (A. van Oosterom and J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983), 125-126).
    """
    a, b, c = (arms[..., k, :] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    ab, ac, bc = (np.einsum("...i,...i->...", x, y) for x, y in ((a, b), (a, c), (b, c)))
    volume = np.einsum("...i,...i->...", a, np.cross(b, c))
    return np.asarray(2.0 * np.arctan2(volume, la * lb * lc + ab * lc + ac * lb + bc * la))
