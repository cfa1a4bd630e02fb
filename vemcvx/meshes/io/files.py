"""Mesh files: a closed list of formats.

VTU files can hold any mesh. Gmsh's MSH files can hold triangles, quadrilaterals, tetrahedra, hexahedra, wedges and
pyramids, with physical groups. Nastran files hold the same kinds of cells, Abaqus files all but pyramids; we write both
without names.
"""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.io.abaqus import read_abaqus, write_abaqus
from vemcvx.meshes.io.blocks import to_meshio
from vemcvx.meshes.io.gmsh import read_gmsh, write_gmsh
from vemcvx.meshes.io.grid import AnyTessellation, Grid, bodies_of, finish_mesh, grid_of, translate_errors
from vemcvx.meshes.io.nastran import read_nastran
from vemcvx.meshes.io.vtu import read_vtu, write_vtu
from vemcvx.meshes.polygon_mesh import PolygonMesh

NASTRAN = (".bdf", ".nas", ".fem")
READERS: dict[str, Callable[[Path], Grid]] = {".vtu": lambda path: read_vtu(path.read_bytes()), ".msh": read_gmsh}
READERS |= {".inp": read_abaqus, **dict.fromkeys(NASTRAN, read_nastran)}
FORMATS = "VTK (.vtu), Gmsh (.msh), Abaqus (.inp) and Nastran (.bdf, .nas, .fem)"


def load(path: str | Path) -> AnyTessellation:
    """Return the mesh in a file: see :func:`vemcvx.meshes.read`."""
    grid = _read(_path(path))
    try:
        return finish_mesh(str(path), grid)
    except MeshError as error:
        words, hint = ", ".join(map(repr, grid.bodies[:8])), ""
        if len(grid.bodies) > 1:
            hint = (
                f" If {words} are bodies, read the file with bodies='physical'; vemcvx run --mesh does so if the scene "
                f"names parts of bodies, such as on='{grid.bodies[0]}.NAME'."
            )
        raise MeshError(f"{_with_file_numbers(str(error), grid)}{hint}") from None


def _with_file_numbers(message: str, grid: Grid) -> str:
    """Replace the numbers of two nodes in a message by their numbers in the file, if the file numbers its nodes."""
    names = {str(node): f"{key}.{n}".lstrip(".") for key, own in grid.numbers.items() for n, node in own.items()}
    return re.sub(
        r"\bnodes (\d+) and (\d+)", lambda two: f"nodes {' and '.join(names.get(k, k) for k in two.groups())}", message
    )


def load_bodies(path: str | Path) -> tuple[dict[str, AnyTessellation], set[str]]:
    """Return the mesh of each body in a file, by name, and the names of all sides."""
    grid = _read(_path(path))
    with translate_errors(str(path), "holds no valid mesh"):
        grids = bodies_of(grid)
    for note in grid.notes:
        warnings.warn(f"{path}: {note}", MeshWarning, stacklevel=3)
    sides = {side for part in grids.values() for side in (*part.parts, *part.nodes)}
    sides |= {side for part in grids.values() for side, x in part.sets.items() if (x & part.bounding[1]).any()}
    return {name: finish_mesh(f"{path}: {name}", part, by_place=not sides) for name, part in grids.items()}, sides


def _read(path: Path) -> Grid:
    # unlike pathlib, os.path does not raise for names that are too long
    if not os.path.isfile(path):
        folder = os.path.isdir(path)
        raise MeshError(f"{path} is a folder; name a file." if folder else f"{path}: there is no such file.")
    suffix = _suffix(path)
    with translate_errors(str(path), "cannot be read as a mesh"):
        return READERS[suffix](path)


def write(path: str | Path, mesh: AnyTessellation) -> None:
    """Write a mesh with its named boundaries and cell data: see :meth:`vemcvx.PolygonMesh.write`."""
    path = _path(path)
    suffix = _suffix(path)
    if os.path.isdir(path) or not os.path.isdir(path.parent):
        there = "is a folder; name a file." if os.path.isdir(path) else f"has no folder {path.parent}; create it first."
        raise MeshError(f"{path} {there}")
    lost: list[str] = []
    with translate_errors(str(path), "cannot be written; .vtu holds every mesh"):
        _check_holds(suffix, mesh)
        grid = grid_of(mesh, polyhedra=suffix == ".vtu", sides=suffix in (".vtu", ".msh"))
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            draft = Path(folder) / path.name
            if suffix == ".vtu":
                write_vtu(draft, grid)
            elif suffix == ".msh":
                lost = write_gmsh(draft, grid)
            else:
                lost = [*mesh.cell_data, *(name for name in mesh.boundaries if name != WHOLE)]
                (write_abaqus if suffix == ".inp" else _write_nastran)(draft, grid)
            os.replace(draft, path)
    if lost or suffix in NASTRAN:
        words = ", ".join([*["all digits of the points"] * (suffix in NASTRAN), *map(repr, sorted(lost))])
        warnings.warn(f"{path}: {suffix} files do not keep {words}; .vtu files do.", MeshWarning, stacklevel=3)


def _write_nastran(path: Path, grid: Grid) -> None:
    made = to_meshio(grid, in_order=True)
    made.points, made.cell_data = np.vectorize(_in_a_field)(made.points), {}
    made.write(path, file_format="nastran")


def _in_a_field(x: float) -> float:
    """Round a number to the digits that fit in a Nastran field of 16 characters; with more digits meshio fails."""
    digits = 12
    while len(text := np.format_float_scientific(x, precision=digits, exp_digits=1)) > 16:
        digits -= 1
    return float(text)


def _check_holds(suffix: str, mesh: AnyTessellation) -> None:
    """Raise MeshError if files of a format would lose cells, interfaces or names."""
    wrong = [name for name in (*mesh.boundaries, *mesh.cell_data) if suffix == ".msh" and set(name) & set('"\\\r\n')]
    if wrong:
        raise MeshError(f".msh files cannot have quotes, backslashes or line breaks in names such as {wrong[0]!r}.")
    if suffix != ".vtu" and isinstance(mesh, PolygonMesh) and np.diff(mesh.offsets).max() > 4:
        raise MeshError(f"{suffix} files do not keep polygons of more than four vertices. Write .vtu.")
    if suffix != ".vtu" and mesh.interfaces:
        raise MeshError(f"{suffix} files do not keep interfaces of bodies. Write .vtu.")


def _path(path: str | Path) -> Path:
    try:
        return Path(path)
    except TypeError:
        raise MeshError(f"the path of a mesh file must be a string or Path; got {path!r}.") from None


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise MeshError(
            f"{path}: the suffix {path.suffix!r} is not one of the mesh formats: {FORMATS}. Convert the file: "
            f"meshio convert {path.name} {path.stem}.vtu"
        )
    return suffix
