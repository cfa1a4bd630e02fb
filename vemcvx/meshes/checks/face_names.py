"""Named parts of the boundary of a mesh in space: faces, by number or by their vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints, brief, plain, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes.box import SpaceBox
from vemcvx.meshes.checks.names import WHOLE, check_mapping, check_name, check_whole
from vemcvx.meshes.polygons.topology import offsets_of, spans
from vemcvx.meshes.polyhedra.topology import Faces, same_faces

SIDES = (("left", "right"), ("front", "back"), ("bottom", "top"))
"""Names of the two sides across each axis."""


def box_sides(corners: Floats, offsets: Ints, box: SpaceBox, tolerance: float = 0.0) -> dict[str, Bools]:
    """Which faces lie on each side of the box; families put points on its sides to the bit."""
    on = {}
    for axis, names in enumerate(SIDES):
        for name, place in zip(names, (box.low[axis], box.high[axis]), strict=True):
            on[name] = np.logical_and.reduceat(np.abs(corners[:, axis] - place) <= tolerance, offsets[:-1])
    return on


def extreme_faces(points: Floats, faces: Faces) -> dict[str, Ints]:
    """Boundary faces that lie where x, y or z is extreme, by the names that families give them; those there are."""
    low, high = points.min(axis=0), points.max(axis=0)
    # A mesh that was moved or scaled into place has plane sides to its digits.
    rounding = 1e-9 * float((high - low).max())
    box = SpaceBox(tuple(low.tolist()), tuple(high.tolist()))
    on = box_sides(points[faces.face_vertices], faces.face_offsets, box, rounding)
    sides = {name: np.flatnonzero(flags & (faces.face_cells[:, 1] < 0)) for name, flags in on.items()}
    return {name: numbers for name, numbers in sides.items() if len(numbers)}


def check_face_boundaries(
    boundaries: Mapping[str, ArrayLike | Sequence[ArrayLike]] | None, mesh: Faces, node_map: Ints | None
) -> dict[str, Ints]:
    """Named faces by their numbers, ascending; MeshError if one is not on the boundary."""
    boundaries = check_mapping(boundaries, "boundaries", "faces")
    if WHOLE in boundaries:
        whole = _faces(WHOLE, boundaries[WHOLE], mesh, node_map)
        check_whole(whole, np.flatnonzero(mesh.face_cells[:, 1] < 0))
    rest = [name for name in boundaries if name != WHOLE]
    return {check_name(name): _faces(name, boundaries[name], mesh, node_map) for name in rest}


def _faces(name: str, given: Any, mesh: Faces, node_map: Ints | None) -> Ints:
    numbers = plain(given)
    if numbers is not None and numbers.ndim == 1 and numbers.dtype.kind in "iu" and len(numbers):
        faces, called = numbers.astype(np.int64), [f"face {number}" for number in numbers.tolist()]
        faces = np.where((faces >= 0) & (faces < len(mesh.face_cells)), faces, -1)
    else:
        rows = _rows(name, given)
        faces, called = faces_of(rows, mesh, node_map), [f"({', '.join(map(str, row.tolist()))})" for row in rows]
    strange = np.flatnonzero((faces < 0) | (mesh.face_cells[faces, 1] >= 0))
    if len(strange):
        raise MeshError(
            f"boundary {name!r}: {called[strange[0]]} is not a face of the boundary ({len(strange)} of {len(faces)} "
            "are not). Name only faces that belong to exactly one cell."
        )
    return read_only(np.unique(faces))


def _rows(name: str, given: Any) -> list[Ints]:
    wanted = f"boundary {name!r}: faces must be numbers (m,) or rows of the numbers of their vertices, at least one"
    try:
        rows = [plain(row) for row in given]
    except Exception:  # of whatever a user hands in
        raise MeshError(f"{wanted}; got {brief(given)}.") from None
    if not rows or any(row is None or row.ndim != 1 or row.dtype.kind not in "iu" or not len(row) for row in rows):
        raise MeshError(f"{wanted}; got {brief(given)}.")
    return [row.astype(np.int64) for row in rows if row is not None]


def faces_of(rows: Sequence[Ints], mesh: Faces, node_map: Ints | None) -> Ints:
    """Number of the face with the given vertices (numbers before unused nodes were dropped), -1 where there is none."""
    number = np.arange(mesh.face_vertices.max() + 1) if node_map is None else node_map
    flat = np.concatenate(rows)
    known = (flat >= 0) & (flat < len(number))
    flat = np.where(known, number[np.where(known, flat, 0)], -1)
    return matching_faces(mesh, offsets_of(np.array([len(row) for row in rows])), flat)


def matching_faces(mesh: Faces, offsets: Ints, vertices: Ints) -> Ints:
    """Number of the face that has the same vertices as each row, -1 where there is none."""
    counts = np.diff(mesh.face_offsets)
    # Only faces with as many vertices, on the boundary: sorting all faces of a mesh takes longer than reading it.
    outer = np.flatnonzero((mesh.face_cells[:, 1] < 0) & np.isin(counts, np.diff(offsets)))
    own = mesh.face_vertices[spans(mesh.face_offsets[outer], counts[outer])]
    whole = offsets_of(np.concatenate([counts[outer], np.diff(offsets)]))
    first, number = same_faces(whole, np.concatenate([own, vertices]))
    found = first[number[len(outer) :]]
    return np.append(outer, -1)[np.minimum(found, len(outer))]
