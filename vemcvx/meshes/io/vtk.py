"""VTK's files: grids and polygons (PolyData) in XML and in legacy files of versions 2 to 5.1, read and written.

They are read here and not by meshio, whose readers permute polygons, know no polyhedra beside other cells, keep one
piece of several, and make arrays as long as a damaged file claims. Here no array is longer than what the file holds;
compressed ones unpack to a bounded multiple of its size.

Polyhedra are written with their faces outwards, in their order, so that they come back to the bit.
"""

from __future__ import annotations

import base64
import lzma
import re
import sys
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple
from urllib.parse import quote, unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.grid import AnyTessellation, Grid, grid_of, polygon_kinds, take_parts, translated
from vemcvx.meshes.polygons import offsets_of, rows_in_order
from vemcvx.meshes.polyhedra import Listed

Arrays = Mapping[str, NDArray[Any]]
EMPTY: Arrays = MappingProxyType({})

KINDS = {0: "empty", 1: "vertex", 3: "line", 4: "poly_line", 5: "triangle", 6: "triangle_strip", 7: "polygon"}
KINDS |= {8: "pixel", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 42: "polyhedron"}
KINDS |= {21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 26: "wedge15", 28: "quad9"}
KINDS |= {27: "pyramid13", 29: "hexahedron27", 32: "wedge18", 34: "triangle7"}
"""VTK's numbers of types -> kinds of cells."""
TYPES = {kind: number for number, kind in KINDS.items()}
UNPACKED = 200  # Times its own size to which a compressed file may unpack, or 1 MiB.
DAMAGED = "its lists of {} are damaged: offsets do not increase, or lead beyond the end."


def vtk_grid(points: Floats, cells: Arrays, data: Arrays, fields: Arrays) -> Grid:
    """Return the grid of arrays that describe cells, by the names that XML files give them; or MeshError.

    `fields` are data of the whole file. Without types, cells are polygons.
    """
    if {"offsets", "connectivity"} - set(cells) or any(values.dtype.kind not in "iu" for values in cells.values()):
        raise MeshError("its cells are no whole numbers.")
    arrays = {name: values.astype(np.int64).ravel() for name, values in cells.items()}
    offsets = _offsets(arrays["offsets"], len(arrays["connectivity"]), "cells")
    kinds = polygon_kinds(offsets)
    if "types" in arrays:
        if len(arrays["types"]) != len(offsets) - 1:
            raise MeshError(DAMAGED.format("cells"))
        numbers, place = np.unique(arrays["types"], return_inverse=True)
        kinds = np.array([KINDS.get(number, f"number {number} of VTK") for number in numbers.tolist()], dtype=str)[
            place
        ]
    solid = kinds == "polyhedron"
    faces = _faces(arrays, solid) if solid.any() else None
    return take_parts(Grid(points, kinds, offsets, arrays["connectivity"], data=dict(data), faces=faces), fields)


def _offsets(ends: Ints, room: int, what: str) -> Ints:
    offsets = np.concatenate([[0], ends])
    # Compared, not subtracted: differences may overflow.
    if (offsets[1:] < offsets[:-1]).any() or offsets[-1] > room:
        raise MeshError(DAMAGED.format(what))
    return offsets


def _faces(arrays: Mapping[str, Ints], solid: Bools) -> Listed:
    """Faces of polyhedra: by rows since VTK 9.4, before as a stream."""
    newest = {"face_offsets", "face_connectivity", "polyhedron_offsets", "polyhedron_to_faces"}
    if newest <= set(arrays):
        nodes, numbers = arrays["face_connectivity"], arrays["polyhedron_to_faces"]
        offsets = _offsets(arrays["face_offsets"], len(nodes), "faces")
        cell_offsets = _offsets(arrays["polyhedron_offsets"], len(numbers), "faces")
        if len(cell_offsets) != len(solid) + 1 or not ((numbers >= 0) & (numbers < len(offsets) - 1)).all():
            raise MeshError(DAMAGED.format("faces"))
        rows, faces = rows_in_order(cell_offsets, numbers, np.flatnonzero(solid))
        return Listed(*rows_in_order(offsets, nodes, faces), rows)
    if {"faces", "faceoffsets"} - set(arrays) or len(arrays["faceoffsets"]) != len(solid):
        raise MeshError("its lists of faces are damaged: some are missing.")
    return _faces_in_stream(arrays["faces"].tolist(), arrays["faceoffsets"][solid].tolist())


def _faces_in_stream(stream: list[int], ends: list[int]) -> Listed:
    """The faces in a stream: of each cell their number, then of each face its nodes; `ends` are those of cells."""
    at, counts, faces = 0, list[int](), list[list[int]]()
    for end in ends:
        left, at, first = stream[at] if at < end <= len(stream) else 0, at + 1, len(faces)
        while len(faces) - first < left and at < end and 0 <= stream[at] < end - at:
            faces.append(stream[at + 1 : at + 1 + stream[at]])
            at += 1 + stream[at]
        counts.append(len(faces) - first)
        if at != end or counts[-1] != left:
            raise MeshError("its lists of faces are damaged: they lead beyond the end, or do not fill their room.")
    vertices = np.array([node for face in faces for node in face], dtype=np.int64)
    return Listed(offsets_of(np.array([len(face) for face in faces])), vertices, offsets_of(np.array(counts)))


def face_stream(listed: Listed) -> tuple[Ints, Ints]:
    """The stream of faces as VTK has it, and where it ends for each cell."""
    sizes = np.diff(listed.offsets)
    stream = np.insert(listed.vertices, listed.offsets[:-1], sizes)
    starts = (listed.offsets + np.arange(len(listed.offsets)))[listed.cell_offsets]
    stream = np.insert(stream, starts[:-1], np.diff(listed.cell_offsets))
    return stream, starts[1:] + np.arange(1, len(starts))


class _Xml:
    """The arrays of an XML file, decoded where they are asked for."""

    def __init__(self, data: bytes):
        head, _, appended = data.partition(b"<AppendedData")
        self.root = ElementTree.fromstring(head + b"</VTKFile>" if appended else head)
        words, _, body = appended.rpartition(b"</AppendedData")[0].partition(b"_")
        self.appended, self.raw = body, b"raw" in words
        self.order: Literal["<", ">"] = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self.head = np.dtype(f"{self.order}u{8 if self.root.get('header_type') == 'UInt64' else 4}")
        self.compressor, self.left = self.root.get("compressor", ""), max(2**20, UNPACKED * len(data))
        places = [int(array.get("offset", 0)) for array in self.root.iter("DataArray")]
        self.places = [*sorted({place for place in places if place >= 0}), len(self.appended)]

    def arrays(self, section: ElementTree.Element | None) -> dict[str, NDArray[Any]]:
        """All arrays of numbers of a section, by name."""
        found = () if section is None else section.findall("DataArray")
        return {a.get("Name", ""): self._values(a) for a in found if re.match("Float|U?Int", a.get("type", ""))}

    def _values(self, array: ElementTree.Element) -> NDArray[Any]:
        dtype = np.dtype(array.get("type", "").lower())
        if array.get("format") == "ascii":
            values = np.array((array.text or "").split(), dtype=dtype)
        else:
            if array.get("format") == "appended":
                start = int(array.get("offset", 0))
                data = self.appended[start : next(place for place in self.places if place > start)]
            else:
                data = (array.text or "").encode()
            if not (self.raw and array.get("format") == "appended"):
                # Texts one after the other, each filled up with = where it ends early.
                texts = re.findall(rb"[A-Za-z0-9+/]+={0,2}", b"".join(data.split()))
                data = b"".join(map(base64.b64decode, texts))
            values = np.frombuffer(self._unpacked(data), dtype.newbyteorder(self.order)).astype(dtype)
        components = int(array.get("NumberOfComponents", 1))
        return values.reshape(-1, components) if components > 1 else values

    def _unpacked(self, data: bytes) -> bytes:
        """The array after its size; or, compressed, its blocks after their number and sizes."""
        if not data:
            return b""
        count, width = int(np.frombuffer(data, self.head, 1)[0]), self.head.itemsize
        if not self.compressor:
            return data[width : width + count]
        if count == 0:
            return b""
        sizes, at, parts = np.frombuffer(data, self.head, 3 + count)[3:].tolist(), (3 + count) * width, []
        for size in sizes:
            unpacker: Any = zlib.decompressobj() if "ZLib" in self.compressor else lzma.LZMADecompressor()
            parts.append(unpacker.decompress(data[at : at + size], self.left + 1))
            at, self.left = at + size, self.left - len(parts[-1])
            if self.left < 0:
                raise MeshError(f"it unpacks to more than {UNPACKED} times its size; write it without compression.")
        return b"".join(parts)


def read_xml(data: bytes, kind: str) -> Grid:
    """Return the grid of a VTU file, or the polygons of a VTP file (`kind` "PolyData")."""
    file = _Xml(data)
    grids, pieces = kind == "UnstructuredGrid", file.root.findall(f"{kind}/Piece")
    if len(pieces) > 1:
        raise MeshError(f"it holds {len(pieces)} pieces; wanted is one: merge them before writing.")
    if not pieces:
        raise MeshError("it holds no UnstructuredGrid." if grids else "it holds no polygons.")
    (piece,) = pieces
    if not grids:
        counts = {name: int(piece.get(f"NumberOf{name}", 0)) for name in ("Polys", "Verts", "Lines", "Strips")}
        _check_polygons(counts.pop("Polys"), [name for name, count in counts.items() if count])
    points = file.arrays(piece.find("Points"))
    if not points:
        raise MeshError("it holds no points.")
    name = "Cells" if grids else "Polys"
    cells = file.arrays(piece.find(name))
    claimed, there = int(piece.get(f"NumberOf{name}", 0)), len(cells.get("offsets", ()))
    if claimed != there:
        raise MeshError(f"it claims {claimed} cells; there are {there}.")
    fields = file.arrays(file.root.find(f"{kind}/FieldData"))
    return vtk_grid(next(iter(points.values())), cells, file.arrays(piece.find("CellData")), fields)


def _check_polygons(polygons: int, others: list[str]) -> None:
    """MeshError unless there are polygons, and nothing else."""
    if not polygons:
        raise MeshError("it holds no polygons.")
    if others:
        raise MeshError(f"it holds {others[0].lower().replace('_', ' ')} beside polygons; keep the polygons alone.")


class Block(NamedTuple):
    """An array as XML files have it: the attributes of its element, and its bytes, compressed, after their sizes."""

    words: dict[str, str]
    data: bytes


class Packed(NamedTuple):
    """Points and cells of a mesh, packed once for all files that have fields on it."""

    nodes: int
    cells: int
    sections: dict[str, list[Block]]


def packed_cells(mesh: AnyTessellation) -> Packed:
    """Return the points and cells of a mesh, packed; its boundaries and cell data are left out."""
    return _packed_grid(grid_of(mesh, {}, polyhedra=True, sides=False))


def write_cells(path: Path, packed: Packed, point_data: Arrays, cell_data: Arrays) -> None:
    """Write fields on a mesh, one row a node or cell, as a .vtu file that ParaView opens; or MeshError.

    Vectors of two components get a third, zero.
    """
    if path.suffix != ".vtu":
        raise MeshError(f"{path}: fields are written as .vtu files; got the suffix {path.suffix!r}.")
    for kind, data, rows in (("point", point_data, packed.nodes), ("cell", cell_data, packed.cells)):
        for name, values in data.items():
            if np.ndim(values) not in (1, 2) or len(values) != rows:
                raise MeshError(f"{path}: {kind} field {name!r} needs {rows} rows; got shape {np.shape(values)}.")
    nodes, cells = (_blocks({name: _three(values) for name, values in d.items()}) for d in (point_data, cell_data))
    with translated(str(path), "cannot be written"):
        _write(path, packed, {"PointData": nodes, "CellData": cells})


def _three(values: ArrayLike) -> NDArray[Any]:
    values = np.asarray(values)
    return np.pad(values, ((0, 0), (0, 1))) if values.ndim == 2 and values.shape[1] == 2 else values


def write_xml(path: Path, grid: Grid, fields: Arrays = EMPTY) -> None:
    """Write a grid, its named sets of cells as data, and data of the whole file as a VTU file."""
    data = {"PointData": [], "CellData": _blocks(grid.marked)}
    whole = [Block({**words, "NumberOfTuples": str(len(fields[words["Name"]]))}, of) for words, of in _blocks(fields)]
    _write(path, _packed_grid(grid), data, whole)


def _packed_grid(grid: Grid) -> Packed:
    points = _blocks({"Points": _three(grid.points)})
    return Packed(len(grid.points), len(grid.kinds), {"Points": points, "Cells": _blocks(_cells(grid))})


def _write(path: Path, packed: Packed, data: Mapping[str, list[Block]], fields: Iterable[Block] = ()) -> None:
    """Write a VTU file: what there is as XML, then the bytes of all arrays behind each other as they are.

    In base64 they would be a third longer. They follow in the reverse of the order in which the XML names them: meshio
    5.3 replaces offsets one by one, beginning with the least, and each time takes the first array of that offset. In
    ascending order that may be one whose new offset is another's old one, and the two arrays are interchanged.
    """
    root = ElementTree.Element("VTKFile", type="UnstructuredGrid", version="1.0", header_type="UInt64")
    root.set("byte_order", "LittleEndian" if sys.byteorder == "little" else "BigEndian")
    root.set("compressor", "vtkZLibDataCompressor")
    whole, arrays = ElementTree.SubElement(root, "UnstructuredGrid"), list[tuple[ElementTree.Element, bytes]]()
    sizes, at = {"NumberOfPoints": str(packed.nodes), "NumberOfCells": str(packed.cells)}, 0
    piece = ElementTree.Element("Piece", sizes)
    for tag, blocks in {"FieldData": fields, **packed.sections, **data}.items():
        section = ElementTree.SubElement(whole if tag == "FieldData" else piece, tag)
        arrays += [(ElementTree.SubElement(section, "DataArray", words, format="appended"), of) for words, of in blocks]
    arrays.reverse()
    for array, block in arrays:
        array.set("offset", str(at))
        at += len(block)
    whole.append(piece)
    head = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True).removesuffix(b"</VTKFile>")
    appended = [block for _, block in arrays]
    with path.open("wb") as file:
        file.writelines([head, b'<AppendedData encoding="raw">\n_', *appended, b"\n</AppendedData></VTKFile>\n"])


def _blocks(arrays: Arrays) -> list[Block]:
    blocks = []
    for name, values in arrays.items():
        kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
        words = {"type": kind, "Name": name}
        if values.ndim > 1:
            words["NumberOfComponents"] = str(values[0].size if len(values) else values.shape[1])
        native = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
        blocks.append(Block(words, _packed(native.tobytes())))
    return blocks


def _cells(grid: Grid) -> Arrays:
    arrays: Arrays = {"connectivity": grid.vertices, "offsets": grid.offsets[1:], "types": _types(grid)}
    if grid.faces is None:
        return arrays
    stream, ends = face_stream(grid.faces)
    places = np.full(len(grid.kinds), -1)
    places[grid.kinds == "polyhedron"] = ends
    return {**arrays, "faces": stream, "faceoffsets": places}


def _types(grid: Grid) -> NDArray[np.uint8]:
    kinds, place = np.unique(grid.kinds, return_inverse=True)
    return np.array([TYPES[kind] for kind in kinds.tolist()], dtype=np.uint8)[place]


def _packed(data: bytes) -> bytes:
    """One zlib block after the sizes that VTK expects.

    Numbers of cells and nodes, and fields that are zero away from contact, shrink 5 to 90 times, at 650 MB/s.
    Displacements and stresses shrink by a fifth, at 30 MB/s, and are only wrapped.
    """
    sample = data[len(data) // 2 :][:4096]  # Bytes from the middle tell if compressing pays.
    packed = zlib.compress(data, int(2 * len(zlib.compress(sample, 1)) < len(sample)))
    header = np.array([1, len(data), len(data), len(packed)] if data else [0, 0, 0], dtype=np.uint64)
    return header.tobytes() + (packed if data else b"")


NUMBERS = {"double": "f8", "float": "f4", "vtkidtype": "i4", "signed_char": "i1"}
NUMBERS |= {"char": "i1", "short": "i2", "int": "i4", "long": "i8"}
NUMBERS |= {f"unsigned_{name}": f"u{NUMBERS[name][1:]}" for name in ("char", "short", "int", "long")}
NUMBERS |= {f"vtktype{sign}int{8 * n}": f"{sign or 'i'}{n}" for sign in ("", "u") for n in (1, 2, 4, 8)}
"""Names of types in legacy files, and what numpy calls them; they are stored with the last byte first."""
WIDTHS = {"SCALARS": 1, "VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


class _Legacy:
    """The lines and arrays of a legacy file, one after the other."""

    def __init__(self, data: bytes):
        lines = data.split(b"\n", 3)
        if not lines[0].startswith(b"# vtk DataFile Version") or len(lines) < 4:
            raise MeshError("it does not begin as VTK's files do.")
        self.newest = lines[0].split()[-1].startswith(b"5.1")
        self.text, self.data, self.at = lines[2].strip().upper() == b"ASCII", data, len(data) - len(lines[3])

    def line(self) -> list[str]:
        """The words of the next line; none at the end."""
        while self.at < len(self.data):
            end = self.data.find(b"\n", self.at) + 1 or len(self.data)
            words, self.at = self.data[self.at : end].decode(errors="replace").split(), end
            if words and words[0].upper() == "METADATA":
                self.at = self.data.find(b"\n\n", self.at) + 1 or len(self.data)
            elif words:
                return words
        return []

    def array(self, rows: int, kind: str, width: int = 1) -> NDArray[Any]:
        """The next numbers, of a type that is called so."""
        dtype, count = np.dtype(NUMBERS.get(kind.lower(), "V")), rows * width
        if dtype.kind == "V":
            raise MeshError(f"it holds an array of the type {kind[:40]!r}; save it as .vtu.")
        if not 0 <= count <= len(self.data) or width < 1:
            raise MeshError(f"it claims {count} numbers; there is room for {len(self.data)}.")
        if self.text:
            words = self.data[self.at :].split(None, count) if count else []
            self.at = len(self.data) - len(words.pop()) if len(words) > count else len(self.data) if count else self.at
            values = np.array(words, dtype=dtype)
        else:
            values = np.frombuffer(self.data[self.at : self.at + count * dtype.itemsize], dtype.newbyteorder(">"))
            self.at += count * dtype.itemsize
        if len(values) != count:
            raise MeshError(f"it ends after {len(values)} of {count} numbers.")
        return values.astype(dtype) if width == 1 else values.astype(dtype).reshape(rows, width)

    def rows(self, count: int, entries: int) -> dict[str, NDArray[Any]]:
        """Rows of nodes: offsets and nodes, or in older versions the length of each before its nodes."""
        if self.newest:
            ends = self.array(count, self.line()[1])[1:]
            return {"offsets": ends, "connectivity": self.array(entries, self.line()[1])}
        stream, at, starts = self.array(entries, "int"), 0, []
        for _ in range(count):
            starts.append(at)
            at += 1 + int(stream[at]) if at < len(stream) and stream[at] >= 0 else len(stream) + 1
            if at > len(stream):
                raise MeshError(DAMAGED.format("cells"))
        return {"offsets": np.cumsum(stream[starts]), "connectivity": np.delete(stream[:at], starts)}

    def field(self, words: list[str]) -> dict[str, NDArray[Any]]:
        """The arrays of a section FIELD."""
        found = {}
        for _ in range(int(words[2])):
            name, width, count, kind = self.line()
            found[unquote(name)] = self.array(int(count), kind, int(width))
        return found


def read_legacy(data: bytes) -> Grid:
    """Return the grid or the polygons of a legacy file, with their cell data."""
    file, points, cells = _Legacy(data), np.zeros((0, 3)), {"types": np.zeros(0, dtype=np.int64)}
    where, size, others = "", 0, []
    found: dict[str, dict[str, NDArray[Any]]] = {"": {}, "CELL_DATA": {}, "POINT_DATA": {}}
    while words := file.line():
        head = words[0].upper()
        if head == "DATASET" and words[1].upper() in ("UNSTRUCTURED_GRID", "POLYDATA"):
            cells = {} if words[1].upper() == "POLYDATA" else cells
        elif head == "DATASET":
            raise MeshError(
                f"it is a {words[1][:40]}; wanted are UNSTRUCTURED_GRID, POLYDATA: meshio convert a.vtk a.vtu."
            )
        elif head in ("CELLS", "POLYGONS", "VERTICES", "LINES", "TRIANGLE_STRIPS"):
            rows = file.rows(int(words[1]), int(words[2]))
            if head in ("CELLS", "POLYGONS"):
                cells |= rows
            elif len(rows["offsets"]):
                others.append(head)
        elif head == "POINTS":
            points = file.array(int(words[1]), words[2], 3)
        elif head == "CELL_TYPES":
            cells["types"] = file.array(int(words[1]), "int")
        elif head in found:
            where, size = head, int(words[1])
        elif head == "FIELD":
            found[where] |= file.field(words)
        elif head in WIDTHS:
            width = int(words[3]) if len(words) > 3 else WIDTHS[head]
            if head == "SCALARS":
                file.line()  # the name of a table of colours
            found[where][unquote(words[1])] = file.array(size, words[2], width)
        else:
            raise MeshError(f"it has a section {words[0][:40]!r}; save it as .vtu.")
    if "types" not in cells:
        _check_polygons(len(cells.get("offsets", ())), others)
    return vtk_grid(points, cells, found["CELL_DATA"], found[""])


def write_legacy(path: Path, grid: Grid) -> None:
    """Write a grid without polyhedra, and its named sets of cells as data, as a binary file of version 5.1."""
    # The normal of VTK's bottom of a wedge points outwards.
    wedges = grid.offsets[:-1][grid.kinds == "wedge", None]
    nodes = grid.vertices.copy()
    nodes[wedges + np.arange(6)] = grid.vertices[wedges + np.array([0, 2, 1, 3, 5, 4])]
    text = "# vtk DataFile Version 5.1\nvemcvx\nBINARY\nDATASET UNSTRUCTURED_GRID\n"
    sections: list[tuple[str, NDArray[Any], str]] = [
        (f"POINTS {len(grid.points)} double", _three(grid.points), "f8"),
        (f"CELLS {len(grid.offsets)} {len(nodes)}\nOFFSETS vtktypeint64", grid.offsets, "i8"),
        ("CONNECTIVITY vtktypeint64", nodes, "i8"),
        (f"CELL_TYPES {len(grid.kinds)}", _types(grid), "i4"),
    ]
    head = f"CELL_DATA {len(grid.kinds)}\nFIELD FieldData {len(grid.marked)}\n"
    for name, values in grid.marked.items():
        # Names of other widths of whole numbers than this are not all known to VTK.
        kind, called = {4: ("f4", "float"), 8: ("f8", "double")}.get(
            values.dtype.itemsize * (values.dtype.kind == "f"), ("i8", "vtktypeint64")
        )
        sections.append((f"{head}{quote(name)} {values[:1].size} {len(values)} {called}", values, kind))
        head = ""
    with path.open("wb") as file:
        file.write(text.encode())
        for words, values, kind in sections:
            file.write(words.encode() + b"\n" + values.astype(f">{kind}").tobytes() + b"\n")
