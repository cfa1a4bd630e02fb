"""Readers that trust no file: sizes and counts of Gmsh, VTK and other files are checked before memory is asked for."""

from __future__ import annotations

import base64
import io
import lzma
import math
import re
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from vemcvx.archives import SMALL, UNPACKED, most_unpacked
from vemcvx.errors import MeshError
from vemcvx.meshes.io.blocks import CELL, MARK, PHYSICAL, Blocks
from vemcvx.meshes.io.solids import without_cells

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer


# Gmsh's files: what is checked before meshio reads one, because it believes all counts and numbers of nodes.
#
# It makes arrays of as many entries as the file claims, and one of as many as the largest number of a node: nine
# digits are gigabytes. Kept is what a section has room for.


FORMAT = re.compile(rb"\$MeshFormat\s+(\S+)\s+1\s")  # of binary files, and their version
SECTION = re.compile(rb"^\$(Nodes|Elements|NodeData|ElementData|ElementNodeData)[ \t\r]*\n", re.MULTILINE)
LONG = re.compile(rb"(?<![\d.eE+-])\d{9,}(?![\d.eE])")
LARGEST = 10**8
NODES = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 15: 1}
"""Of Gmsh's types of elements, those of first order."""


def check_gmsh(data: bytes) -> None:
    """MeshError if a section claims more than the file has room for, or numbers nodes by more than eight digits."""
    if not data[:100].lstrip().startswith(b"$"):
        raise MeshError("it does not begin as Gmsh's files do, with $MeshFormat.")
    binary = FORMAT.search(data[:10_000])
    for head in SECTION.finditer(data):
        name, at = head.group(1).decode(), head.end()
        if name.endswith("Data"):
            _check_tags(name, data[at:].splitlines(), len(data))
        elif binary and binary[1].startswith(b"4"):
            _check_blocks(name, data, at, newest=binary[1] != b"4.0")
        else:
            end = data.find(b"$End", at)
            _check_count(name, data[at:].split(b"\n", 1)[:1], len(data), "entries")
            long = None if binary else LONG.search(data, at, end if end >= 0 else len(data))
            if long:
                raise _too_large(name, int(long[0][:30]))


def _check_blocks(name: str, data: bytes, at: int, *, newest: bool) -> None:
    """Check the counts of entity blocks in a binary file of version 4."""
    blocks, count = np.frombuffer(data, "<u8", 2, at).tolist()
    _check_room(name, max(blocks, count), len(data), "entries")
    at += 32 if newest else 16
    for _ in range(blocks):
        kind, count = (int.from_bytes(data[at + i : at + j], "little") for i, j in ((8, 12), (12, 20)))
        _check_room(name, count, len(data), "entries")
        at += 20
        if name == "Nodes":
            numbers = (
                np.frombuffer(data, "<u8", count, at) if newest else np.frombuffer(data, "<i4", 7 * count, at)[::7]
            )
            if numbers.max(initial=0) >= LARGEST:
                raise _too_large(name, int(numbers.max()))
            at += count * (32 if newest else 28)
        elif kind in NODES:
            at += count * (1 + NODES[kind]) * (8 if newest else 4)
        else:
            raise MeshError(f"it holds elements of Gmsh's type {kind}; export elements of first order.")


def _check_tags(name: str, lines: list[bytes], most: int) -> None:
    """The counts of words and numbers before data, and that of the data."""
    place = 0
    for kind in ("strings", "reals", "integers"):
        count = _check_count(name, lines[place : place + 1], len(lines), kind)
        if kind == "integers":
            _check_count(name, lines[place + 3 : place + 4], most, "entries")
        place += count + 1


def _check_count(name: str, line: list[bytes], most: int, what: str) -> int:
    """The number on a line, 0 if there is none: the reader then says what is wrong."""
    word = line[0].strip() if line else b""
    count = int(word[:30]) if word.isdigit() else 0
    _check_room(name, count, most, what)
    return count


def _check_room(name: str, count: int, most: int, what: str) -> None:
    if count > most:
        raise MeshError(f"its section ${name} claims {count} {what}; there is room for {most}.")


def _too_large(name: str, number: int) -> MeshError:
    return MeshError(
        f"its section ${name} has the number {number}; nodes and elements have less than {LARGEST:,}: renumber them."
    )


# VTK's own files, rewritten as what meshio reads of them.
#
# Files of polygons alone (PolyData, .vtp and .vtk) differ from unstructured grids in the names of a few sections;
# grids also say the type of every cell. In legacy files of version 5.1, meshio knows whole numbers by the names of
# few types; and it believes what legacy files say of the nodes of a cell and of the points of a grid.


POLYGON = 7  # VTK's number of the type
POLYDATA = re.compile(rb"^DATASET\s+POLYDATA", re.MULTILINE | re.IGNORECASE)
SIZES = {b"char": 8, b"short": 16, b"int": 32, b"long": 64}
NUMBERS = re.compile(
    rb"^((?:(?:SCALARS|VECTORS|TENSORS)\s\S+|\S+\s\d+\s\d+)\s)(?:(un)?signed_)?(char|short|int|long)\b", re.MULTILINE
)


CELLS = re.compile(
    rb"^CELLS[ \t]+(\d{1,18})[ \t]+(\d{1,18})[ \t\r]*\n(?:\S+[ \t]+(?:vtktype)?(u?int\d+)[ \t\r]*\n)?",
    re.MULTILINE | re.IGNORECASE,
)
DIMENSIONS = re.compile(rb"^DIMENSIONS[ \t]+(\d{1,18})[ \t]+(\d{1,18})[ \t]+(\d{1,18})", re.MULTILINE | re.IGNORECASE)


@contextmanager
def rewritten(path: Path, data: bytes) -> Iterator[Path]:
    """A passing file that holds the grid of a .vtk, the polygons of PolyData as one, or cells of a .vtu as points.

    Raises
    ------
    MeshError
        There are no polygons in PolyData, or other cells beside them.
    """
    ways = {".vtp": lambda data: without_cells(_xml(data)), ".vtk": _legacy, ".vtu": without_cells}
    data = ways[path.suffix.lower()](data)
    with tempfile.TemporaryDirectory() as folder:
        grid = Path(folder) / path.name
        grid.write_bytes(data)
        yield grid


def _legacy(data: bytes) -> bytes:
    newest = data.partition(b"\n")[0].rstrip().endswith(b"5.1")
    if newest:
        data = NUMBERS.sub(lambda m: b"%svtktype%sint%d" % (m[1], b"u" * bool(m[2]), SIZES[m[3]]), data)
    data = _legacy_polydata(data, newest) if POLYDATA.search(data[:1024]) else data
    _check_legacy(data, newest)
    return data


def _check_legacy(data: bytes, newest: bool) -> None:
    """MeshError where a cell has more nodes than the file has bytes, or a grid more points; such arrays are made."""
    for found in DIMENSIONS.finditer(data):
        points = math.prod(map(int, found.groups()))
        if points > max(SMALL, len(data)):
            raise MeshError(f"it is a grid of {points} points; there is room for {len(data)}.")
    text = b"".join(data.split(b"\n", 3)[2:3]).strip().upper() == b"ASCII"
    for found in CELLS.finditer(data):
        count = int(found[1 if newest else 2])
        kind = np.dtype((found[3] or b"int32").decode().lower() if newest else "int32").newbyteorder(">")
        if count > len(data):
            raise MeshError(f"its cells claim {count} numbers; there is room for {len(data)}.")
        if text:
            numbers = np.array(data[found.end() :].split(None, count)[:count]).astype(float)
        else:
            numbers = np.frombuffer(data, kind, count, found.end())
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() <= len(data):
            raise MeshError(f"its cells run from {numbers.min()} to {numbers.max()}; there is room for {len(data)}.")


def _legacy_polydata(data: bytes, newest: bool) -> bytes:
    lines = data.split(b"\n", 3)
    found = re.search(rb"^POLYGONS[ \t]+(\d{1,18})[ \t]+\d+[ \t\r]*$", data, re.MULTILINE)
    others = re.search(rb"^(VERTICES|LINES|TRIANGLE_STRIPS)[ \t]+\d+[ \t]+\d+[ \t\r]*$", data, re.MULTILINE)
    # The newest version counts the offsets, one more than there are polygons.
    count = max(_count(found and found[1], others and others[1], data) - newest, 0)
    ascii_numbers = lines[2].strip().upper() == b"ASCII"
    types = b"%d " % POLYGON * count if ascii_numbers else np.full(count, POLYGON, ">i4").tobytes()
    head, _, tail = data.partition(b"POLYGONS")
    head = POLYDATA.sub(b"DATASET UNSTRUCTURED_GRID", head, count=1)
    return b"%sCELL_TYPES %d\n%s\nCELLS%s" % (head, count, types, tail)


def _xml(data: bytes) -> bytes:
    head, appended, arrays = data.partition(b"<AppendedData")
    counts = dict(re.findall(rb'NumberOf(Verts|Lines|Strips|Polys)="\s*(\d{1,18})\s*"', head))
    if head.count(b"<Piece") > 1:
        raise MeshError(f"it holds {head.count(b'<Piece')} pieces; wanted is one: merge them before writing.")
    others = [kind for kind in (b"Verts", b"Lines", b"Strips") if counts.get(kind, b"0").strip(b"0")]
    count = _count(counts.get(b"Polys"), others[0] if others else None, data)
    empty = b""
    for kind in (b"Verts", b"Lines", b"Strips"):
        before, opening, rest = head.partition(b"<%s>" % kind)
        inside, _, after = rest.partition(b"</%s>" % kind)
        head, empty = (before + after, empty + inside) if opening else (head, empty)
    # meshio finds appended arrays by their places one after the other: empty ones stay, where nobody looks at them.
    types = b'<DataArray type="UInt8" Name="types" format="ascii">%s%s</DataArray>' % (b"7 " * count, empty)
    for old, new in (
        (b'type="PolyData"', b'type="UnstructuredGrid"'),
        (b"PolyData>", b"UnstructuredGrid>"),
        (b"NumberOfPolys=", b"NumberOfCells="),
        (b"<Polys>", b"<Cells>" + types),
        (b"</Polys>", b"</Cells>"),
    ):
        head = head.replace(old, new)
    return head + appended + arrays


def _count(polygons: bytes | None, other: bytes | None, data: bytes) -> int:
    """The number of polygons, which are all that there may be."""
    if polygons is None:
        raise MeshError("it holds no polygons.")
    if other is not None:
        kind = other.decode().lower().replace("_", " ")
        raise MeshError(f"it holds {kind} beside polygons; keep the polygons alone.")
    if int(polygons) > len(data):
        raise MeshError(f"it claims {polygons.decode()} polygons; there is room for {len(data)}.")
    return int(polygons)


# Files that would hang a reader or take all memory: what is checked before, and after, meshio has a file in its
# hands.
#
# Compressed arrays are unpacked whole; sets of Abaqus that are generated, and points of VTK that lie on a grid, are
# as many as they say. The reader of Nastran's files looks for a closing line in a loop that the end of the file does
# not leave: it gets an open file, which objects to being read on and on at its end.


COMPRESSOR = re.compile(rb"""compressor\s*=\s*["']vtk(ZLib|LZMA)DataCompressor""")
INLINE = re.compile(rb"""format\s*=\s*["']binary["'][^>]*>([^<]*)<""")
OFFSET = re.compile(rb"""offset\s*=\s*["']\s*(\d{1,18})""")
GENERATED = re.compile(
    rb"^\*[NE]L?SET[^\n]*GENERATE[^\n]*\n\s*([+-]?\d{1,18})\s*,\s*([+-]?\d{1,18})\s*,\s*([+-]?\d{1,18})",
    re.MULTILINE | re.IGNORECASE,
)


class _Impatient(io.FileIO):
    misses = 0

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        count = super().readinto(buffer)
        self.misses = 0 if count else self.misses + 1
        # At the end of a sound file readers ask once or twice.
        if self.misses > 100:
            raise EOFError("the file ends too early")
        return count


@contextmanager
def opened(path: Path, file_format: str) -> Iterator[Path | io.IOBase]:
    """Open a file for meshio, after refusing those it would read for ever or out of memory.

    Files of VTK's are rewritten as what it reads.

    Raises
    ------
    MeshError
        PolyData are not polygons alone; arrays unpack to more than 200 times the file's size; a section, a set or a
        grid claims more than the file has room for.
    """
    if file_format == "nastran":
        with io.TextIOWrapper(io.BufferedReader(_Impatient(path)), encoding="utf-8") as text:
            yield text
        return
    data = path.read_bytes()
    if file_format == "gmsh":
        check_gmsh(data)
    if file_format == "abaqus":
        _check_sets(data)
    if file_format == "vtu":
        _check_unpacked(data)
    if file_format in ("vtk", "vtu"):
        with rewritten(path, data) as grid:
            yield grid
    else:
        yield path


def _check_sets(data: bytes) -> None:
    for found in GENERATED.finditer(data):
        first, last, step = map(int, found.groups())
        count = (last - first) // step if step else 0
        if count > len(data):
            raise MeshError(f"a set of it has {count} members; there is room for {len(data)}.")


class _Unpacker(Protocol):
    def decompress(self, data: bytes, max_length: int = ..., /) -> bytes: ...


def _check_unpacked(data: bytes) -> None:
    """MeshError if the compressed arrays of a VTU or VTP file hold more than 200 times its size."""
    kind = COMPRESSOR.search(data)
    if kind is None:
        return
    left = most_unpacked(len(data))
    with suppress(ValueError, IndexError, zlib.error, lzma.LZMAError, EOFError):  # the reader says what is wrong
        for block in _compressed(data):
            unpacker: _Unpacker = zlib.decompressobj() if kind[1] == b"ZLib" else lzma.LZMADecompressor()
            left -= len(unpacker.decompress(block, left + 1))
            if left < 0:
                raise MeshError(f"it unpacks to more than {UNPACKED} times its size; write it without compression.")


def _compressed(data: bytes) -> Iterator[bytes]:
    """Compressed blocks, those in place and those at the end: numbers of bytes in front, and then the bytes."""
    head, _, appended = data.partition(b"<AppendedData")
    dtype = np.dtype(np.uint64 if b"UInt64" in head.partition(b"<Piece")[0] else np.uint32)
    dtype = dtype.newbyteorder(">" if b"BigEndian" in head else "<")
    start = appended.partition(b"_")[2].partition(b"</AppendedData")[0] if b"base64" in appended[:100] else b""
    texts = [text.strip() for text in INLINE.findall(head)]
    texts += [start[int(offset) :] for offset in OFFSET.findall(head) if start]
    for text in texts:
        width = -(-dtype.itemsize // 3) * 4
        count = 3 + int(np.frombuffer(base64.b64decode(text[:width])[: dtype.itemsize], dtype)[0])
        width = -(-count * dtype.itemsize // 3) * 4
        sizes = np.frombuffer(base64.b64decode(text[:width]), dtype, count)[3:].tolist()
        yield from _parts(base64.b64decode(text[width : width + -(-sum(sizes) // 3) * 4]), sizes)
    raw = appended.partition(b"_")[2] if b"raw" in appended[:100] else b""
    for offset in OFFSET.findall(head) if raw else ():
        at = int(offset)
        count = 3 + int(np.frombuffer(raw, dtype, 1, at)[0])
        sizes = np.frombuffer(raw, dtype, count, at)[3:].tolist()
        yield from _parts(raw[at + count * dtype.itemsize :], sizes)


def _parts(data: bytes, sizes: list[int]) -> Iterator[bytes]:
    at = 0
    for size in sizes:
        yield data[at : at + size]
        at += size


def check_data(blocks: Blocks) -> None:
    """MeshError unless every datum has one row a cell, of one shape in all blocks, and names and numbers one value."""
    for name, parts in blocks.data.items():
        for (kind, cells), values in zip(blocks.cells, parts, strict=True):
            if values.shape[:1] != (len(cells),):
                raise MeshError(f"its cell datum {name!r} has the shape {values.shape} on {len(cells)} cells ({kind}).")
        single = name in (CELL, PHYSICAL) or name.startswith(MARK)
        shapes = {values.shape[1:] for values in parts} | ({()} if single else set())
        if len(shapes) > 1:
            found = ", ".join(map(str, sorted(shapes)))
            raise MeshError(f"its cell datum {name!r} has values of different shapes: {found}.")
