"""Areas, normals and centroids of plane polygons in space; volumes and centroids of polyhedra.

A face is summed over the fan of triangles from its first vertex o (d_i = x_i - o), with signed areas along its normal:

    area vector = 1/2 sum_i d_i x d_{i+1},      centroid = o + sum_i s_i (d_i + d_{i+1}) / 3 / sum_i s_i,

exact for plane faces, convex or not. A cell is summed over the pyramids from the mean p of the centroids of its faces,
with a the area vectors outwards and c the centroids of faces:

    volume = 1/3 sum_f a_f . (c_f - p),         centroid = p + 3/4 sum_f V_f (c_f - p) / sum_f V_f.

Coordinates are taken relative to a vertex or a mean nearby, so a mesh far from the origin loses nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.topology import next_corner


class FaceShapes(NamedTuple):
    """Areas (n_faces,), unit normals and centroids (n_faces, 3); zero, zero and the first vertex of a flat face."""

    areas: Floats
    normals: Floats
    centroids: Floats


def face_shapes(points: Floats, offsets: Ints, vertices: Ints) -> FaceShapes:
    """Shapes of faces; normals by the right-hand rule."""
    counts = np.diff(offsets)
    origin = points[vertices[offsets[:-1]]]
    here = points[vertices] - np.repeat(origin, counts, axis=0)
    after = here[next_corner(offsets)]
    part = 0.5 * np.cross(here, after)
    vectors = np.add.reduceat(part, offsets[:-1], axis=0)
    areas = np.linalg.norm(vectors, axis=1)
    normals = _divided(vectors, areas)
    signed = np.einsum("ij,ij->i", part, np.repeat(normals, counts, axis=0))
    moments = np.add.reduceat((here + after) * signed[:, None], offsets[:-1], axis=0)
    return FaceShapes(areas, normals, origin + _divided(moments, 3.0 * areas))


def volumes_and_centroids(faces: FaceShapes, offsets: Ints, cell_faces: Ints, signs: Floats) -> tuple[Floats, Floats]:
    """Signed volumes (n_cells,) and centroids (n_cells, 3) of cells.

    Cell c has the faces ``cell_faces[offsets[c]:offsets[c + 1]]``; `signs` (1 outwards, -1 inwards) goes with them.
    """
    counts = np.diff(offsets)
    place = faces.centroids[cell_faces]
    apex = np.add.reduceat(place - np.repeat(place[offsets[:-1]], counts, axis=0), offsets[:-1], axis=0)
    apex = place[offsets[:-1]] + apex / counts[:, None]
    arm = place - np.repeat(apex, counts, axis=0)
    part = np.einsum("ij,ij->i", faces.normals[cell_faces], arm) * (signs * faces.areas[cell_faces])
    volumes = np.add.reduceat(part, offsets[:-1])
    moments = np.add.reduceat(arm * part[:, None], offsets[:-1], axis=0)
    return volumes / 3.0, apex + 0.75 * _divided(moments, volumes)


def _divided(rows: Floats, by: Floats) -> Floats:
    """Rows divided by a number each; zero where that is zero."""
    return np.divide(rows, by[:, None], out=np.zeros_like(rows), where=by[:, None] != 0.0)
