"""From points and cells in space to the arrays of a valid mesh, or to a MeshError that names the fault.

Mended, with a note for a warning: faces that do not run outwards (turned) and nodes that no cell uses (dropped). The
order of the checks is that in which faults can be told: numbers, places of nodes, single faces, single cells, how cells
fit together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.cells import brief_row
from vemcvx.meshes.checks.closed_cells import faces_to_turn
from vemcvx.meshes.checks.face_lists import check_face_lists
from vemcvx.meshes.checks.mesh import check_points, dropped
from vemcvx.meshes.checks.plane_faces import check_faces
from vemcvx.meshes.checks.shared_faces import SharedFaces, shared_faces
from vemcvx.meshes.checks.space_tiling import check_space_tiling
from vemcvx.meshes.checks.tiling import check_coincident
from vemcvx.meshes.polygons.segments import TOLERANCE
from vemcvx.meshes.polygons.shapes import diameters
from vemcvx.meshes.polygons.topology import cell_of_corner, rows_in_order, turned
from vemcvx.meshes.polyhedra.shapes import volumes_and_centroids
from vemcvx.meshes.polyhedra.topology import Faces, nodes_of_cells


@dataclass(frozen=True, eq=False)
class CheckedInSpace:
    """Arrays of a valid mesh (see `PolyhedralMesh`), and what was mended on the way."""

    points: Floats
    faces: Faces
    node_map: Ints | None
    notes: tuple[str, ...]


def checked_in_space(points: ArrayLike, cells: Any) -> CheckedInSpace:
    """Return valid arrays made of a user's points and cells, or raise MeshError."""
    points = check_points(points, 3)
    offsets, vertices, cell_offsets = check_face_lists(cells, len(points))
    used = np.flatnonzero(np.bincount(vertices, minlength=len(points)))
    check_coincident(points, used)
    owner = cell_of_corner(cell_offsets)
    shared = shared_faces(offsets, vertices, owner, len(points))
    outlines = rows_in_order(offsets, vertices, shared.first)
    shapes = check_faces(points, *outlines, owner[shared.first])
    turn = faces_to_turn(offsets, vertices, cell_offsets, len(points))
    volumes = volumes_and_centroids(shapes, cell_offsets, shared.number, np.where(shared.along ^ turn, 1.0, -1.0))[0]
    turn ^= (volumes < 0.0)[owner]
    faces = _joined(*outlines, cell_offsets, shared=shared, turn=turn)
    _check_volumes(points, faces, volumes)
    turned_faces = turn[shared.first]
    shapes = shapes._replace(normals=np.where(turned_faces[:, None], -shapes.normals, shapes.normals))
    check_space_tiling(points, faces, shapes)
    notes = []
    if turn.any():
        mended = np.unique(owner[turn])
        notes.append(
            f"{len(mended)} of {len(volumes)} cells had faces that did not run outwards, counter-clockwise seen from "
            f"outside (the first is cell {mended[0]}); they have been turned."
        )
    node_map = None
    if len(used) < len(points):
        node_map, note = dropped(used, len(points))
        notes.append(note)
        points, faces = points[used], faces._replace(face_vertices=node_map[faces.face_vertices])
    return CheckedInSpace(points, faces, node_map, tuple(notes))


def _joined(face_offsets: Ints, face_vertices: Ints, cell_offsets: Ints, *, shared: SharedFaces, turn: Bools) -> Faces:
    """Faces with their cells, outwards of the first; MeshError if both cells of one lie on the same side of it."""
    owner = cell_of_corner(cell_offsets)
    later = np.flatnonzero(shared.first[shared.number] != np.arange(len(owner)))
    face = shared.number[later]
    outwards = shared.along ^ turn
    bad = np.flatnonzero(outwards[later] == outwards[shared.first[face]])
    if len(bad):
        k = face[bad[0]]
        row = brief_row(face_vertices[face_offsets[k] : face_offsets[k + 1]])
        raise MeshError(
            f"cells {owner[shared.first[k]]} and {owner[later[bad[0]]]} overlap: both lie on the same side of their "
            f"face {row}. Remove or correct one of them."
        )
    face_cells = np.column_stack([owner[shared.first], np.full(len(shared.first), -1)])
    face_cells[face, 1] = owner[later]
    vertices = turned(face_offsets, face_vertices, turn[shared.first])
    return Faces(face_offsets, vertices, cell_offsets, shared.number, face_cells)


def _check_volumes(points: Floats, faces: Faces, volumes: Floats) -> None:
    offsets, nodes = nodes_of_cells(faces, len(points))
    sizes = diameters(points, offsets, nodes)
    largest = np.maximum.reduceat(np.abs(points[nodes]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(np.abs(volumes) <= TOLERANCE * largest * sizes**2)
    if len(flat):
        raise MeshError(
            f"cell {flat[0]} has no volume (volume {volumes[flat[0]]:.3g}, diameter {sizes[flat[0]]:.3g}). Remove it "
            "or correct its faces."
        )
