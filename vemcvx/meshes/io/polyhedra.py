"""Cells of VTK's XML files: the arrays that say what their nodes are, and of polyhedra (type 42) their faces.

meshio reads no polyhedra beside other cells, permutes them, keeps one piece of several, and believes offsets (one that
is too large took gigabytes). So a file is handed to it with one point a cell, and the arrays that describe cells as
data of the whole file, in names that begin with `PREFIX`. Up to VTK 9.3 the faces of a cell are a stream (number of
faces; number of nodes and nodes of each), since then rows of faces.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.io.blocks import VTK_TYPES, Blocks, grouped
from vemcvx.meshes.polygons.topology import offsets_of, rows_in_order, spans
from vemcvx.meshes.polyhedra.topology import Listed

PREFIX = "vemcvx:cells:"
TYPES = f"{PREFIX}types"
POLYHEDRON = 42
NODES = {3: 2, 5: 3, 9: 4}
"""Of lines, triangles and quadrilaterals; those of solids are counted where their faces are made."""
CELLS = re.compile(rb"<Cells>(.*?)</Cells>", re.DOTALL)
VERSION = re.compile(rb'(<VTKFile[^>]*\bversion=")[0-9.]+"')


def without_cells(data: bytes) -> bytes:
    """A VTU file with points for cells, and the arrays of its cells as data of the whole file."""
    head, appended, arrays = data.partition(b"<AppendedData")
    found, counts = CELLS.findall(head), re.findall(rb'NumberOfCells="\s*(\d{1,18})\s*"', head)
    if b"<UnstructuredGrid" not in head:
        raise MeshError("it holds no UnstructuredGrid.")
    if len(found) != 1 or len(counts) != 1:
        raise MeshError(f"it holds {len(found)} pieces; wanted is one: merge them before writing.")
    count = int(counts[0])
    if count > len(data):
        raise MeshError(f"it claims {count} cells; there is room for {len(data)}.")
    one = b'<DataArray type="Int64" Name="%s" format="ascii">%s</DataArray>'
    numbers = b" ".join(b"%d" % number for number in range(1, count + 1))
    points = one % (b"connectivity", b"0 " * count) + one % (b"offsets", numbers) + one % (b"types", b"1 " * count)
    fields = re.sub(rb'Name="', b'Name="' + PREFIX.encode(), found[0])
    head = CELLS.sub(lambda _: b"<Cells>" + points + b"</Cells>", head)
    # PyVista keeps words with the file, which meshio does not read; as numbers, it passes them over.
    head = VERSION.sub(rb'\g<1>1.0"', head).replace(b'type="String"', b'type="UInt8"')
    return head.replace(b"<Piece", b"<FieldData>" + fields + b"</FieldData><Piece", 1) + appended + arrays


def blocks_of_vtk(fields: Mapping[str, Any], data: Mapping[str, NDArray[Any]]) -> Blocks:
    """Cells and their data, from the arrays of a grid (`PREFIX` before their names)."""
    arrays = {
        name.removeprefix(PREFIX): np.asarray(values) for name, values in fields.items() if name.startswith(PREFIX)
    }
    whole = all(values.dtype.kind in "iu" for values in arrays.values())
    if not whole or {"types", "offsets", "connectivity"} - set(arrays):
        raise MeshError("its cells are no whole numbers.")
    arrays = {name: values.astype(np.int64).ravel() for name, values in arrays.items()}
    types, ends, nodes = arrays["types"], arrays["offsets"], arrays["connectivity"]
    offsets = np.concatenate([[0], ends])
    if len(ends) != len(types) or (np.diff(offsets) < 0).any() or offsets[-1] > len(nodes):
        raise MeshError("its lists of cells are damaged: offsets do not increase, or lead beyond the end.")
    for kind, count in NODES.items():
        if (np.diff(offsets)[types == kind] != count).any():
            raise MeshError(f"its cells of the kind {VTK_TYPES[kind]!r} do not all have {count} nodes.")
    solid = types == POLYHEDRON
    polyhedra = _faces(arrays, solid) if solid.any() else None
    # A polyhedron stands in its block by its number.
    counts = np.where(solid, 1, np.diff(offsets))
    rows = offsets_of(counts)
    vertices = np.empty(rows[-1], dtype=np.int64)
    corners = np.repeat(~solid, counts)
    vertices[corners] = rows_in_order(offsets, nodes, np.flatnonzero(~solid))[1]
    vertices[~corners] = np.arange(np.count_nonzero(solid))
    blocks = grouped(types, rows, vertices, data=data)
    blocks.polyhedra = polyhedra
    return blocks


def _faces(arrays: Mapping[str, Ints], solid: Any) -> Listed:
    if "polyhedron_to_faces" in arrays:
        return _faces_by_rows(arrays, solid)
    if {"faces", "faceoffsets"} - set(arrays):
        raise MeshError("it has no lists of faces for its polyhedra.")
    return _faces_by_stream(arrays, solid)


def _faces_by_rows(arrays: Mapping[str, Ints], solid: Any) -> Listed:
    names = ("face_offsets", "face_connectivity", "polyhedron_offsets", "polyhedron_to_faces")
    if set(names) - set(arrays):
        raise MeshError("its faces are incomplete.")
    ends, nodes, cell_ends, numbers = (arrays[name] for name in names)
    offsets, cell_offsets = np.concatenate([[0], ends]), np.concatenate([[0], cell_ends])
    sound = len(cell_ends) == len(solid) and (np.diff(offsets) >= 0).all() and (np.diff(cell_offsets) >= 0).all()
    sound = sound and offsets[-1] <= len(nodes) and cell_offsets[-1] <= len(numbers)
    if not sound or not ((numbers >= 0) & (numbers < len(ends))).all():
        raise MeshError("its lists of faces are damaged: offsets do not increase, or lead beyond the end.")
    rows, faces = rows_in_order(cell_offsets, numbers, np.flatnonzero(solid))
    return Listed(*rows_in_order(offsets, nodes, faces), rows)


def _faces_by_stream(arrays: Mapping[str, Ints], solid: Any) -> Listed:
    stream, ends = arrays["faces"], arrays["faceoffsets"]
    damaged = MeshError("its lists of faces are damaged: they lead beyond the end, or do not fill their room.")
    if len(ends) != len(solid) or (ends[solid] > len(stream)).any() or (np.diff(ends[solid]) < 2).any():
        raise damaged
    ends = ends[solid]
    at = np.concatenate([[0], ends[:-1]])
    if (ends < 1).any() or (at >= len(stream)).any():
        raise damaged
    left = stream[at]
    if (left < 1).any() or (left > len(stream)).any():
        raise damaged
    cell_offsets, at = offsets_of(left), at + 1
    starts, counts = np.empty(cell_offsets[-1], dtype=np.int64), np.empty(cell_offsets[-1], dtype=np.int64)
    going = np.arange(len(left))
    for face in range(int(left.max(initial=0))):  # the next face of every cell that has one
        going = going[left[going] > face]
        if (at[going] >= ends[going]).any():
            raise damaged
        count = stream[at[going]]
        starts[cell_offsets[going] + face], counts[cell_offsets[going] + face] = at[going] + 1, count
        if (count < 0).any() or (at[going] + 1 + count > ends[going]).any():
            raise damaged
        at[going] += 1 + count
    if (at != ends).any():
        raise damaged
    return Listed(offsets_of(counts), stream[spans(starts, counts)], cell_offsets)
