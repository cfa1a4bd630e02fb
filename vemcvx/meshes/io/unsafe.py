"""Files that would hang a reader or mislead it: what is checked before, and after, meshio has a file in its hands.

meshio looks for a well-known text (WKT) by an expression whose numbers match in several ways: a triangle
with one coordinate too few costs it 2^digits steps. The expression `TIN` says the same with groups that are never
entered again (atomic), so that it takes linear time, and what it accepts meshio finds at its first attempt.
The reader of Gmsh's files believes the counts of nodes, cells and tags; and compressed files are read whole, whatever
they unpack to. Some readers look for a closing line in a loop that the end of the file does not leave: they get an open
file, which objects to being read on and on at its end.
"""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from vemcvx.errors import MeshError
from vemcvx.meshes.io.blocks import CELL, MARK, PHYSICAL, Blocks
from vemcvx.meshes.io.polyhedra import has_polyhedra
from vemcvx.meshes.io.vtk_files import rewritten

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

NUMBER = r"(?>[+-]?(?:\d++\.?+\d*+|\.\d++))"
POINT = rf"(?>{NUMBER}(?:\s++{NUMBER}){{2,3}}+)"
RING = rf"\(\s*+\(\s*+{POINT}(?:\s*+,\s*+{POINT}){{3}}+\s*+\)\s*+\)"
TIN = re.compile(rf"\s*+TIN\s*+\((?>\s*+{RING}\s*+,?+)*+\s*+\)")
SECTION = re.compile(rb"^\$(Nodes|Elements|NodeData|ElementData|ElementNodeData)[ \t\r]*\n", re.MULTILINE)
# Meshes as text compress 3 to 15 times, gzip at best 1030 times; beyond a megabyte that is no mesh.
UNPACKED, SMALL = 200, 2**20
# Formats whose readers may wait for ever; at the end of a sound file they ask once or twice.
WAITING_FOR_TEXT, WAITING_FOR_BYTES, PATIENCE = ("nastran", "off", "tecplot"), ("ply", "mdpa", "ansys"), 100


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
        PolyData are not polygons alone; a compressed file unpacks to more than 200 times its size; a section of a
        Gmsh file claims more than the file has room for; a well-known text is not of the form TIN (((x y z, x y z,
        x y z, x y z)), ...).
    """
    _check_file(path, file_format)
    if path.suffix.lower() in (".vtk", ".vtp") or (file_format == "vtu" and has_polyhedra(path.read_bytes())):
        with rewritten(path) as grid:
            yield grid
    elif file_format in WAITING_FOR_TEXT:
        with io.TextIOWrapper(io.BufferedReader(_Impatient(path)), encoding="utf-8") as text:
            yield text
    elif file_format in WAITING_FOR_BYTES:
        with io.BufferedReader(_Impatient(path)) as data:
            yield data
    else:
        yield path


def _check_file(path: Path, file_format: str) -> None:
    if path.suffix.lower() == ".gz":
        _check_size(path)
    if file_format == "gmsh":
        _check_counts(path.read_bytes())
    if file_format == "wkt" and not TIN.match(path.read_text(encoding="utf-8")):
        raise MeshError(
            "it is no well-known text of the form TIN (((x y z, x y z, x y z, x y z)), ...) with numbers in plain "
            "decimals."
        )


def _check_size(path: Path) -> None:
    most = max(SMALL, UNPACKED * path.stat().st_size)
    try:
        with gzip.open(path) as file:
            while file.tell() <= most:
                if not file.read(SMALL):
                    return
    except (OSError, EOFError, zlib.error):
        return  # the reader says what is wrong
    raise MeshError(f"it unpacks to more than {UNPACKED} times its size; unpack it first if that is right.")


def _check_counts(data: bytes) -> None:
    """MeshError if a section of a Gmsh file claims more entries than the file has bytes, or more tags than lines."""
    for head in SECTION.finditer(data):
        name, lines = head.group(1).decode(), data[head.end() :].splitlines()
        if not name.endswith("Data"):
            _check_count(name, lines[:1], len(data), "entries")
            continue
        place = 0
        for kind in ("strings", "reals", "integers"):
            count = _check_count(name, lines[place : place + 1], len(lines), kind)
            if kind == "integers":
                _check_count(name, lines[place + 3 : place + 4], len(data), "entries")
            place += count + 1


def _check_count(name: str, line: list[bytes], most: int, what: str) -> int:
    """The number on a line, 0 if there is none: the reader then says what is wrong."""
    word = line[0].strip() if line else b""
    if not word.isdigit():
        return 0
    if len(word) > 18 or int(word) > most:
        raise MeshError(f"its section ${name} claims {word.decode()[:30]} {what}; there is room for {most}.")
    return int(word)


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
