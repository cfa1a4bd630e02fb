"""VTK files of unstructured grids, .vtu.

The reader of meshio permutes polygons, cannot read polyhedra together with other cells, and rejects files of current
versions of ParaView and PyVista.
"""

from __future__ import annotations

import base64
import lzma
import math
import re
import sys
import zlib
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Bools, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.grid import MARK, Grid, grid_of, translate_errors
from vemcvx.meshes.polygons import offsets_of, rows_in_order
from vemcvx.meshes.polyhedra import FaceLists

Arrays = Mapping[str, NDArray[Any]]

KINDS = {0: "empty", 1: "vertex", 3: "line", 4: "poly_line", 5: "triangle", 6: "triangle_strip", 7: "polygon"}
KINDS |= {8: "pixel", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 42: "polyhedron"}
KINDS |= {21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 26: "wedge15", 28: "quad9"}
KINDS |= {27: "pyramid13", 29: "hexahedron27", 32: "wedge18", 34: "triangle7"}
"""VTK's number of a cell type -> kind of cells."""
TYPES = {kind: number for number, kind in KINDS.items()}
DAMAGED = "its lists of {} are damaged: offsets do not increase, or exceed the length of the list."


def read_vtu(data: bytes) -> Grid:
    """Read the grid of a VTU file. Damaged files also raise errors of XML and NumPy."""
    head, _, appended = data.partition(b"<AppendedData")
    root = ElementTree.fromstring(head + b"</VTKFile>" if appended else head)
    pieces = root.findall("UnstructuredGrid/Piece")
    if len(pieces) != 1:
        raise MeshError(f"it has {len(pieces)} pieces of an UnstructuredGrid instead of one; merge them in ParaView.")

    def arrays(section: ElementTree.Element | None) -> dict[str, NDArray[Any]]:
        found = () if section is None else section.findall("DataArray")
        numbers = [array for array in found if re.match("Float|U?Int", array.get("type", ""))]
        return {array.get("Name", ""): _values(array, root, appended) for array in numbers}

    (piece,) = pieces
    points = list(arrays(piece.find("Points")).values())
    cells = {name: values.astype(np.int64).ravel() for name, values in arrays(piece.find("Cells")).items()}
    if not points or {"offsets", "connectivity", "types"} - set(cells):
        raise MeshError("it has no points and cells.")
    offsets = _offsets(cells["offsets"], len(cells["connectivity"]), "cells")
    kinds = np.array([KINDS.get(n, f"number {n} of VTK") for n in cells["types"].tolist()], dtype=str)
    if not len(kinds) == len(offsets) - 1 == int(piece.get("NumberOfCells", -1)):
        raise MeshError(f"its header has {piece.get('NumberOfCells')} cells; there are {len(offsets) - 1}.")
    solid = kinds == "polyhedron"
    faces = _faces(cells, solid) if solid.any() else None
    grid = Grid(points[0], kinds, offsets, cells["connectivity"], data=arrays(piece.find("CellData")), faces=faces)
    return with_parts(grid, arrays(root.find("UnstructuredGrid/FieldData")))


def with_parts(grid: Grid, fields: Mapping[str, Any]) -> Grid:
    """Add boundary parts from fields "boundary:<name>" to a grid."""
    for name, values in ((name, np.asarray(x)) for name, x in fields.items() if name.startswith(MARK)):
        rows = values if values.ndim == 2 else values.reshape(-1, 2)
        if rows.dtype.kind not in "iu":
            raise MeshError(f"its field {name!r} is not an array of node numbers.")
        grid.parts[name.removeprefix(MARK)] = offsets_of((rows >= 0).sum(axis=1)), rows[rows >= 0].astype(np.int64)
    return grid


def _values(array: ElementTree.Element, root: ElementTree.Element, appended: bytes) -> NDArray[Any]:
    dtype = np.dtype(array.get("type", "").lower())
    if array.get("format") == "ascii":
        values = np.array((array.text or "").split(), dtype=dtype)
    else:
        order: Literal["<", ">"] = ">" if root.get("byte_order") == "BigEndian" else "<"
        raw, data = False, (array.text or "").encode()
        if array.get("format") == "appended":
            words, _, body = appended.rpartition(b"</AppendedData")[0].partition(b"_")
            places = [int(other.get("offset", 0)) for other in root.iter("DataArray")]
            start = int(array.get("offset", 0))
            raw, data = b"raw" in words, body[start : min((p for p in places if p > start), default=len(body))]
        if not raw:
            # The data may consist of several base64 texts.
            data = b"".join(map(base64.b64decode, re.findall(rb"[A-Za-z0-9+/]+={0,2}", b"".join(data.split()))))
        head = np.dtype(f"{order}u{8 if root.get('header_type') == 'UInt64' else 4}")
        values = np.frombuffer(_unpack(data, head, root.get("compressor", "")), dtype.newbyteorder(order))
    components = int(array.get("NumberOfComponents") or 1)
    values = values.astype(dtype)
    return values.reshape(-1, components) if components > 1 else values


def _unpack(data: bytes, head: np.dtype[Any], compressor: str) -> bytes:
    """Return the decompressed bytes of an array."""
    if not data:
        return b""
    count = int(np.frombuffer(data, head, 1)[0])
    if not compressor:
        return data[head.itemsize :][:count]
    unpack = zlib.decompress if "ZLib" in compressor else lzma.decompress
    ends = offsets_of(np.frombuffer(data, head, 3 + count)[3:].astype(np.int64)) + (3 + count) * head.itemsize
    return b"".join(unpack(data[start:end]) for start, end in pairwise(ends))


def _offsets(ends: Ints, room: int, what: str) -> Ints:
    offsets = np.concatenate([[0], ends])
    # differences of offsets may overflow
    if (offsets[1:] < offsets[:-1]).any() or offsets[-1] > room:
        raise MeshError(DAMAGED.format(what))
    return offsets


def _faces(arrays: Mapping[str, Ints], solid: Bools) -> FaceLists:
    """Return the faces of polyhedra, in the old or new layout of VTK."""
    if "face_connectivity" in arrays:
        nodes, numbers = arrays["face_connectivity"], arrays["polyhedron_to_faces"]
        offsets = _offsets(arrays["face_offsets"], len(nodes), "faces")
        cell_offsets = _offsets(arrays["polyhedron_offsets"], len(numbers), "faces")
        rows, faces = rows_in_order(cell_offsets, numbers, np.flatnonzero(solid))
        return FaceLists(*rows_in_order(offsets, nodes, faces), rows)
    stream, at, counts, faces_found = arrays["faces"].tolist(), 0, list[int](), list[list[int]]()
    for end in arrays["faceoffsets"][solid].tolist():
        at, left = at + 1, stream[at]
        counts.append(left)
        while left > 0 and 0 < stream[at] < end - at <= len(stream) - at:
            faces_found.append(stream[at + 1 : at + 1 + stream[at]])
            at, left = at + 1 + stream[at], left - 1
        if left or at != end:
            raise MeshError(DAMAGED.format("faces"))
    sizes = np.array([len(face) for face in faces_found], dtype=np.int64)
    return FaceLists(offsets_of(sizes), np.concatenate(faces_found), offsets_of(np.array(counts)))


def pack_cells(mesh: Any) -> ElementTree.Element:
    """Return the points and cells of a mesh as XML."""
    return _pack_grid(grid_of(mesh, polyhedra=True, sides=False, data=False))


def write_cells(path: Path, packed: ElementTree.Element, point_data: Arrays, cell_data: Arrays) -> None:
    """Write packed cells and data as a VTU file."""
    with translate_errors(str(path), "cannot be written"):
        _write(path, packed, point_data, cell_data)


def write_vtu(path: Path, grid: Grid) -> None:
    """Write a grid as a VTU file, with named sets as data."""
    marks = {MARK + name: chosen.astype(np.uint8) for name, chosen in grid.sets.items()}
    _write(path, _pack_grid(grid), {}, grid.data | marks)


def _pack_grid(grid: Grid) -> ElementTree.Element:
    types = np.array([TYPES[kind] for kind in grid.kinds.tolist()], dtype=np.uint8)
    cells: dict[str, NDArray[Any]] = {"connectivity": grid.vertices, "offsets": grid.offsets[1:], "types": types}
    if grid.faces is not None:
        # A cell begins with the number of faces, and a face with the number of nodes.
        faces = grid.faces
        stream = np.insert(faces.vertices, faces.offsets[:-1], np.diff(faces.offsets))
        starts = (faces.offsets + np.arange(len(faces.offsets)))[faces.cell_offsets]
        cells["faces"] = np.insert(stream, starts[:-1], np.diff(faces.cell_offsets))
        cells["faceoffsets"] = np.full(len(grid.kinds), -1)
        cells["faceoffsets"][grid.kinds == "polyhedron"] = starts[1:] + np.arange(1, len(starts))
    sizes = {"NumberOfPoints": str(len(grid.points)), "NumberOfCells": str(len(grid.kinds))}
    piece = ElementTree.Element("Piece", sizes)
    piece.extend([_section("Points", {"Points": grid.points}), _section("Cells", cells)])
    return piece


def _write(path: Path, packed: ElementTree.Element, point_data: Arrays, cell_data: Arrays) -> None:
    root = ElementTree.Element("VTKFile", type="UnstructuredGrid", version="1.0", header_type="UInt64")
    root.set("byte_order", "LittleEndian" if sys.byteorder == "little" else "BigEndian")
    root.set("compressor", "vtkZLibDataCompressor")
    piece = ElementTree.SubElement(ElementTree.SubElement(root, "UnstructuredGrid"), "Piece", packed.attrib)
    piece.extend([*packed, _section("PointData", point_data), _section("CellData", cell_data)])
    path.write_bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _section(tag: str, arrays: Arrays) -> ElementTree.Element:
    section = ElementTree.Element(tag)
    for name, values in arrays.items():
        if values.ndim == 2 and values.shape[1] == 2:
            values = np.pad(values, ((0, 0), (0, 1)))
        kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
        array = ElementTree.SubElement(section, "DataArray", type=kind, Name=name, format="binary")
        if values.ndim > 1:
            array.set("NumberOfComponents", str(math.prod(values.shape[1:])))
        data = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("=")).tobytes()
        packed = zlib.compress(data, 1) if data else b""
        # number of blocks, size of a block, size of the last block, compressed size
        header = np.array([1, len(data), len(data), len(packed)] if data else [0, 0, 0], dtype=np.uint64)
        array.text = (base64.b64encode(header.tobytes()) + base64.b64encode(packed)).decode()
    return section
