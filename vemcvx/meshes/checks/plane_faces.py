"""Is every face a simple polygon in a plane? Checks of a user's mesh in space, one face at a time."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.cells import brief_row, fault_of
from vemcvx.meshes.polygons.segments import TOLERANCE
from vemcvx.meshes.polygons.shapes import diameters
from vemcvx.meshes.polygons.topology import rows_in_order
from vemcvx.meshes.polyhedra.shapes import FaceShapes, face_shapes

# Of the diameter of a face: coordinates in single precision, or printed with seven digits, are nearer to its plane.
PLANE = 1e-6


def check_faces(points: Floats, offsets: Ints, vertices: Ints, cells: Ints) -> FaceShapes:
    """Shapes of faces of the cells (n_faces,), or MeshError at the first that is no plane simple polygon."""
    shapes = face_shapes(points, offsets, vertices)
    sizes = diameters(points, offsets, vertices)
    face = np.repeat(np.arange(len(cells)), np.diff(offsets))
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(shapes.areas <= TOLERANCE * largest * sizes)
    if len(flat):
        raise MeshError(
            f"{_named(flat[0], offsets, vertices, cells)} has no area (area {shapes.areas[flat[0]]:.3g}, diameter "
            f"{sizes[flat[0]]:.3g}): its vertices lie on one line, or its outline crosses itself. Remove it or correct "
            "its vertices."
        )
    height = np.einsum("ij,ij->i", points[vertices] - shapes.centroids[face], shapes.normals[face])
    bent = np.flatnonzero(np.abs(height) > (PLANE * sizes + TOLERANCE * largest)[face])
    if len(bent):
        worst = bent[np.argmax(np.abs(height[bent]) / sizes[face[bent]])]
        raise MeshError(
            f"{_named(face[worst], offsets, vertices, cells)} is not plane: node {vertices[worst]} lies "
            f"{abs(height[worst]):.3g} off its plane, and {PLANE:g} of the face's diameter {sizes[face[worst]]:.3g} is "
            "allowed. Split the face into triangles, the same ones in both cells that have it, or move the node."
        )
    _check_outlines(points, offsets, vertices, cells, shapes)
    return shapes


def _check_outlines(points: Floats, offsets: Ints, vertices: Ints, cells: Ints, shapes: FaceShapes) -> None:
    """MeshError at a face whose outline meets itself; looked at in its own plane."""
    several = np.flatnonzero(np.diff(offsets) > 3)
    if not len(several):
        return
    rows, corners = rows_in_order(offsets, vertices, several)
    face = np.repeat(several, np.diff(rows))
    arm = points[corners] - shapes.centroids[face]
    first, second = frames(shapes.normals[several])
    row = np.repeat(np.arange(len(several)), np.diff(rows))
    plane = np.column_stack([np.einsum("ij,ij->i", arm, axis[row]) for axis in (first, second)])
    fault = fault_of(plane, rows, np.arange(len(corners)))[1]
    if fault is None:
        return
    said = _named(several[fault.cell], offsets, vertices, cells)
    edge, other = (brief_row(corners[list(pair)]) for pair in (fault.edge, fault.other))
    if fault.kind == "crossing":
        raise MeshError(
            f"{said} crosses itself: its edges {edge} and {other} intersect. List its vertices in order around it."
        )
    node = corners[fault.beside if fault.kind == "spike" else fault.node]
    raise MeshError(
        f"{said} touches itself: its node {node} lies on its edge {edge}. Split the face, or move the node."
    )


def frames(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (m, 3) each that make a right-handed frame with a unit normal."""
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normals, first)


def _named(face: int, offsets: Ints, vertices: Ints, cells: Ints) -> str:
    return f"cell {cells[face]}: its face {brief_row(vertices[offsets[face] : offsets[face + 1]])}"
