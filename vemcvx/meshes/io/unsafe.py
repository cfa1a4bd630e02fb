"""Files that would hang a reader or take all memory: what is checked before, and after, meshio has a file in its hands.

Compressed arrays are unpacked whole; sets of Abaqus that are generated, and points of VTK that lie on a grid, are as
many as they say. The reader of Nastran's files looks for a closing line in a loop that the end of the file does not
leave: it gets an open file, which objects to being read on and on at its end.
"""

from __future__ import annotations

import base64
import io
import lzma
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from vemcvx.archives import UNPACKED, most_unpacked
from vemcvx.errors import MeshError
from vemcvx.meshes.io.blocks import CELL, MARK, PHYSICAL, Blocks
from vemcvx.meshes.io.gmsh_files import check_gmsh
from vemcvx.meshes.io.vtk_files import rewritten

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

COMPRESSOR = re.compile(rb"""compressor\s*=\s*["']vtk(ZLib|LZMA)DataCompressor""")
INLINE = re.compile(rb"""format\s*=\s*["']binary["'][^>]*>([^<]*)<""")
OFFSET = re.compile(rb"""offset\s*=\s*["']\s*(\d{1,18})""")
GENERATED = re.compile(
    rb"^\*[NE]L?SET[^\n]*GENERATE[^\n]*\n\s*([+-]?\d{1,18})\s*,\s*([+-]?\d{1,18})\s*,\s*([+-]?\d{1,18})",
    re.MULTILINE | re.IGNORECASE,
)
PATIENCE = 100
"""Reads at the end of a file: at that of a sound one readers ask once or twice."""


class _Impatient(io.FileIO):
    misses = 0

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        count = super().readinto(buffer)
        self.misses = 0 if count else self.misses + 1
        if self.misses > PATIENCE:
            raise EOFError("the file ends too early")
        return count


@contextmanager
def opened(path: Path, file_format: str) -> Iterator[Path | io.IOBase]:
    """What to hand to meshio: the path, or an open file; what it would read for ever, or out of memory, is refused.

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
