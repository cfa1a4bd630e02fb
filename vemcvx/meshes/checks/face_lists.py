"""Cells as lists of faces, faces as lists of nodes: laid flat, or refused with the number of the cell."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Ints, plain
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.mesh import check_polygons
from vemcvx.meshes.polygons.topology import offsets_of
from vemcvx.meshes.polyhedra.topology import Listed

WANTED = "cells must be a sequence of cells, each a sequence of faces, each a sequence of node numbers"
BY_VERTICES = (
    "Tetrahedra, hexahedra, wedges and pyramids given by their vertices come in by "
    'vx.meshes.convert(meshio.Mesh(points, {"tetra": cells})).'
)


def check_face_lists(cells: Any, n_nodes: int) -> Listed:
    """The faces that cells list, or MeshError.

    Every cell has at least four faces, every face at least three different nodes that exist.
    """
    offsets, vertices, cell_offsets = _flattened(cells)
    if len(cell_offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    few = np.flatnonzero(np.diff(cell_offsets) < 4)
    if len(few):
        count = cell_offsets[few[0] + 1] - cell_offsets[few[0]]
        raise MeshError(f"cell {few[0]} has {count} faces; a polyhedron has at least 4.")
    check_polygons(offsets, vertices, n_nodes, lambda face: _face(face, cell_offsets))
    return Listed(offsets, vertices, cell_offsets)


def _face(number: int, cell_offsets: Ints) -> str:
    cell = int(np.searchsorted(cell_offsets, number, side="right")) - 1
    return f"cell {cell}: its face {number - cell_offsets[cell]}"


def _flattened(cells: Any) -> Listed:
    if isinstance(cells, Listed):
        return cells
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "iu" and not isinstance(cells, np.ma.MaskedArray):
        if cells.ndim != 3:
            raise MeshError(
                f"cells as one array must have the shape (n_cells, faces, vertices); got {cells.shape}. {BY_VERTICES}"
            )
        count, each, sides = cells.shape
        flat = cells.astype(np.int64).ravel()
        return Listed(np.arange(count * each + 1) * sides, flat, np.arange(count + 1) * each)
    try:
        listed = [list(cell) for cell in cells]
    except Exception:  # of whatever a user hands in
        raise MeshError(f"{WANTED}; got {type(cells).__name__}. {BY_VERTICES}") from None
    cell_offsets = offsets_of(np.array([len(cell) for cell in listed], dtype=np.int64))
    faces = list(chain.from_iterable(listed))
    found = _numbers(faces)
    if found is None:
        found = _one_by_one(faces, cell_offsets)
    return Listed(*found, cell_offsets)


def _numbers(faces: Sequence[Any]) -> tuple[Ints, Ints] | None:
    """Offsets and numbers of plain lists of integers, all at once; None if something else is among them."""
    if not all(type(face) in (list, tuple, np.ndarray) for face in faces):
        return None
    try:
        sizes = np.array([len(face) for face in faces], dtype=np.int64)
        listed = list(chain.from_iterable(faces))
        flat: NDArray[Any] = np.array(listed)
    except Exception:  # ragged, or no numbers: told face by face
        return None
    whole = flat.ndim == 1 and flat.dtype.kind in "iu" and not {bool, np.bool_} & set(map(type, listed))
    return (offsets_of(sizes), flat.astype(np.int64)) if whole else None


def _one_by_one(faces: Sequence[Any], cell_offsets: Ints) -> tuple[Ints, Ints]:
    rows = []
    for number, face in enumerate(faces):
        row = plain(face)
        if row is None or row.ndim != 1 or (row.dtype.kind not in "iu" and row.size):
            found = type(face).__name__ if row is None else f"{row.dtype} of shape {row.shape}"
            raise MeshError(f"{_face(number, cell_offsets)} must be a list of node numbers; got {found}. {BY_VERTICES}")
        rows.append(row)
    sizes = np.array([len(row) for row in rows], dtype=np.int64)
    whole = np.concatenate([np.empty(0, dtype=np.int64), *rows], dtype=np.int64, casting="unsafe")
    return offsets_of(sizes), whole
