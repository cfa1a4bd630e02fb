"""VTK's own files, rewritten as what meshio reads of them.

Files of polygons alone (PolyData, .vtp and .vtk) differ from unstructured grids in the names of a few sections; grids
also say the type of every cell. In legacy files of version 5.1, meshio knows whole numbers by the names of few types;
and it believes what legacy files say of the nodes of a cell and of the points of a grid.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from vemcvx.archives import SMALL
from vemcvx.errors import MeshError
from vemcvx.meshes.io.polyhedra import without_cells

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
