"""Mesh files: a closed list of formats, each tried with files that went wrong.

VTU and legacy VTK hold every polygonal mesh, VTU every polyhedral one. Gmsh's MSH holds triangles and quadrilaterals,
tetrahedra, hexahedra, wedges and pyramids with their physical groups; Abaqus' and Nastran's files hold such cells
alone. These are read and written by meshio, which believes what a file claims: counts and numbers that would hang it,
or fill the memory, are refused before.
"""

from __future__ import annotations

import io
import os
import re
import tempfile
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.meshes.box import MOST_CELLS, WHOLE
from vemcvx.meshes.io.grid import PHYSICAL, AnyTessellation, Grid, finished, grid_of, mesh_of, named, translated
from vemcvx.meshes.io.objects import from_meshio, groups_of, to_meshio
from vemcvx.meshes.io.vtk import read_legacy, read_xml, write_legacy, write_xml
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

ANY_POLYGON = (".vtu", ".vtk")
NASTRAN = (".bdf", ".nas", ".fem")
# Version 4 of Gmsh's format wants a geometry.
THROUGH_MESHIO = {
    ".msh": ("gmsh", "gmsh22"),
    ".inp": ("abaqus", "abaqus"),
    **dict.fromkeys(NASTRAN, ("nastran", "nastran")),
}
"""Suffix -> the names under which meshio reads a format, and under which it writes it."""
WORDS = "Gmsh (.msh), VTK (.vtu, .vtk, .vtp), Abaqus (.inp) and Nastran (.bdf, .nas, .fem)"
UNSPEAKABLE = '"\\\r\n'  # Characters that Gmsh's names cannot have.


def load(path: str | Path) -> AnyTessellation:
    """The mesh in a file: see :func:`vemcvx.meshes.read`."""
    path = _path(path)

    def made() -> tuple[AnyTessellation, list[str]]:
        grid = _read(path)
        with named(str(path)):
            return mesh_of(grid)

    return finished(str(path), made)


def load_bodies(path: str | Path) -> tuple[dict[str, AnyTessellation], set[str]]:
    """The mesh of every physical group of cells in a file, by name; and the names that the file has for sides."""
    path = _path(path)
    grid = _read(path)
    with named(str(path)):
        grids = groups_of(grid)
    meshes = {name: finished(f"{path}: {name}", partial(mesh_of, part)) for name, part in grids.items()}
    return meshes, {side for grid in grids.values() for side in grid.sides}


def _read(path: Path) -> Grid:
    # Unlike pathlib's, these know no names that are too long.
    if not os.path.isfile(path):
        folder = os.path.isdir(path)
        raise MeshError(f"{path} is a folder; name a file." if folder else f"{path}: there is no such file.")
    suffix = _suffix(path)
    with translated(str(path), "cannot be read as a mesh"):
        if suffix in (".vtu", ".vtp"):
            grid = read_xml(path.read_bytes(), "UnstructuredGrid" if suffix == ".vtu" else "PolyData")
        else:
            grid = read_legacy(path.read_bytes()) if suffix == ".vtk" else _read_by_meshio(path, suffix)
    return grid


def write(path: str | Path, mesh: AnyTessellation) -> None:
    """Write a mesh with its named boundaries and cell data (see `write` of meshes)."""
    path = _path(path)
    suffix = _check_target(path)
    with named(str(path)):
        _check_holds(suffix, mesh)
        sides = suffix in (*ANY_POLYGON, ".msh")
        grid = grid_of(mesh, mesh.cell_data, polyhedra=suffix == ".vtu", sides=sides)
    failure = "cannot be written" if suffix in ANY_POLYGON else "cannot be written; .vtu and .vtk hold every mesh"
    with translated(str(path), failure), tempfile.TemporaryDirectory(dir=path.parent) as folder:
        draft = Path(folder) / path.name
        if suffix == ".vtu":
            write_xml(draft, grid)
        elif suffix == ".vtk":
            write_legacy(draft, grid)
        else:
            made = to_meshio(grid, in_order=True, groups=suffix == ".msh")
            made.cell_data = made.cell_data if suffix == ".msh" else {}
            made.points = np.vectorize(_in_a_field)(made.points) if suffix in NASTRAN else made.points
            made.write(draft, file_format=THROUGH_MESHIO[suffix][1])
        os.replace(draft, path)
    if suffix not in ANY_POLYGON:
        names = set(mesh.cell_data) - {PHYSICAL} if suffix == ".msh" else {*mesh.cell_data, *mesh.boundaries}
        rounded = ["all digits of the points"] if suffix in NASTRAN else []
        if lost := ", ".join([*rounded, *map(repr, sorted(names - {WHOLE}))]):
            others = ".vtu" if isinstance(mesh, SpaceTessellation) else " and ".join(ANY_POLYGON)
            warnings.warn(f"{path}: {suffix} files do not keep {lost}; {others} files do.", MeshWarning, stacklevel=3)


def _in_a_field(x: float) -> float:
    """A number with as many digits as Nastran's fields of 16 characters hold, where meshio gives up on more."""
    digits = 12
    while len(text := np.format_float_scientific(x, precision=digits, exp_digits=1)) > 16:
        digits -= 1
    return float(text)


def _check_holds(suffix: str, mesh: AnyTessellation) -> None:
    """MeshError where files of a format would lose cells, interfaces or names."""
    wrong = [name for name in mesh.boundaries if suffix == ".msh" and set(name) & set(UNSPEAKABLE)]
    if wrong:
        raise MeshError(f".msh files have no names with quotes, backslashes or ends of lines, as {wrong[0]!r} has.")
    if suffix in ANY_POLYGON:
        return
    instead = f"Write {' or '.join(ANY_POLYGON)}."
    if isinstance(mesh, Tessellation) and np.diff(mesh.offsets).max() > 4:
        raise MeshError(
            f"{suffix} files do not keep polygons of more than four vertices, and this mesh has some. {instead}"
        )
    if mesh.interfaces:
        raise MeshError(f"{suffix} files do not keep interfaces of bodies. {instead}")


def _path(path: str | Path) -> Path:
    try:
        return Path(path)
    except TypeError:
        raise MeshError(f"the path of a mesh file must be a string or Path; got {path!r}.") from None


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (*ANY_POLYGON, ".vtp", *THROUGH_MESHIO):
        raise MeshError(
            f"{path}: the suffix {path.suffix!r} is none of the mesh formats here: {WORDS}. Convert the file: "
            f"meshio convert {path.name} {path.stem}.vtu"
        )
    return suffix


def _check_target(path: Path) -> str:
    suffix = _suffix(path)
    if suffix == ".vtp":
        raise MeshError(f"{path}: {suffix} files are read, not written; {' and '.join(ANY_POLYGON)} hold every mesh.")
    if not os.path.isdir(path.parent):
        raise MeshError(f"{path}: there is no folder {path.parent}; create it first.")
    if os.path.isdir(path):
        raise MeshError(f"{path} is a folder; name a file.")
    return suffix


FORMAT = re.compile(rb"\$MeshFormat\s+(\S+)\s+1\s")  # of binary files of Gmsh, and their version
SECTION = re.compile(rb"^\$(Nodes|Elements|NodeData|ElementData|ElementNodeData)[ \t\r]*\n", re.MULTILINE)
LONG = re.compile(rb"(?<![\d.eE+-])\d{9,}(?![\d.eE])")
NODES_OF_TYPE = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 15: 1}
NODES_OF_TYPE |= {8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 16: 8, 17: 20, 18: 15, 19: 13}
"""Of Gmsh's types of elements, those of first and of second order."""
GENERATED = re.compile(
    rb"^\*[NE]L?SET[^\n]*GENERATE[^\n]*\n\s*([+-]?\d{1,18})\s*,\s*([+-]?\d{1,18})\s*,\s*([+-]?\d{1,18})",
    re.MULTILINE | re.IGNORECASE,
)


class _Impatient(io.FileIO):
    """A file that objects to being read on and on at its end, as meshio's reader of Nastran's files does."""

    misses = 0

    def readinto(self, buffer: WriteableBuffer, /) -> int:
        count = super().readinto(buffer)
        self.misses = 0 if count else self.misses + 1
        # At the end of a sound file readers ask once or twice.
        if self.misses > 100:
            raise EOFError("the file ends too early")
        return count


def _read_by_meshio(path: Path, suffix: str) -> Grid:
    import meshio

    name = THROUGH_MESHIO[suffix][0]
    if suffix in NASTRAN:
        with io.TextIOWrapper(io.BufferedReader(_Impatient(path)), encoding="utf-8") as text:
            return from_meshio(meshio.read(text, file_format=name))
    data = path.read_bytes()
    if suffix == ".msh":
        _check_gmsh(data)
    for found in GENERATED.finditer(data) if suffix == ".inp" else ():
        first, last, step = map(int, found.groups())
        _check_room("a set of it has", (last - first) // step if step else 0, "members", len(data))
    return from_meshio(meshio.read(path, file_format=name))


def _check_room(claim: str, count: int, what: str, most: int) -> None:
    if count > most:
        raise MeshError(f"{claim} {count} {what}; there is room for {most}.")


def _check_gmsh(data: bytes) -> None:
    """MeshError if a section claims more than the file has room for, or numbers nodes by more than eight digits."""
    if not data[:100].lstrip().startswith(b"$"):
        raise MeshError("it does not begin as Gmsh's files do, with $MeshFormat.")
    binary = FORMAT.search(data[:10_000])
    for head in SECTION.finditer(data):
        name, at = head.group(1).decode(), head.end()
        claim = f"its section ${name} claims"
        if name.endswith("Data"):
            # The counts of words and numbers before data, and that of the data.
            lines, place = data[at:].splitlines(), 0
            for kind in ("strings", "reals", "integers"):
                count = _whole(lines[place : place + 1])
                _check_room(claim, count, kind, len(lines))
                if kind == "integers":
                    _check_room(claim, _whole(lines[place + 3 : place + 4]), "entries", len(data))
                place += count + 1
        elif binary and binary[1].startswith(b"4"):
            _check_blocks(name, data, at, newest=binary[1] != b"4.0")
        else:
            end = data.find(b"$End", at)
            _check_room(claim, _whole(data[at:].split(b"\n", 1)[:1]), "entries", len(data))
            long = None if binary else LONG.search(data, at, end if end >= 0 else len(data))
            _check_number(name, int(long[0][:30]) if long else 0)


def _check_blocks(name: str, data: bytes, at: int, *, newest: bool) -> None:
    """Check the counts of entity blocks in a binary file of version 4."""
    claim = f"its section ${name} claims"
    blocks, count = np.frombuffer(data, "<u8", 2, at).tolist()
    _check_room(claim, max(blocks, count), "entries", len(data))
    at += 32 if newest else 16
    for _ in range(blocks):
        kind, count = (int.from_bytes(data[at + i : at + j], "little") for i, j in ((8, 12), (12, 20)))
        _check_room(claim, count, "entries", len(data))
        at += 20
        if name == "Nodes":
            step = 1 if newest else 7  # before 4.1 each number stands with its point
            numbers = np.frombuffer(data, "<u8" if newest else "<i4", step * count, at)[::step]
            _check_number(name, int(numbers.max(initial=0)))
            at += count * (32 if newest else 28)
        elif kind in NODES_OF_TYPE:
            at += count * (1 + NODES_OF_TYPE[kind]) * (8 if newest else 4)
        else:
            raise MeshError(f"it holds elements of Gmsh's type {kind}; export elements of first or second order.")


def _check_number(name: str, number: int) -> None:
    # meshio makes an array of as many entries as the largest number of a node: a gigabyte.
    if number >= MOST_CELLS:
        raise MeshError(
            f"its section ${name} has the number {number}; nodes and elements have less than {MOST_CELLS:,}: renumber "
            "them."
        )


def _whole(line: list[bytes]) -> int:
    """The number on a line, 0 if there is none: the reader then says what is wrong."""
    word = line[0].strip() if line else b""
    return int(word[:30]) if word.isdigit() else 0
