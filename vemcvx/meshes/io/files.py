"""Mesh files, through meshio: a closed list of formats, each tried with files that went wrong.

VTU and legacy VTK hold every polygonal mesh, VTU every polyhedral one. Gmsh's MSH holds triangles and quadrilaterals,
tetrahedra, hexahedra, wedges and pyramids with their physical groups; Abaqus' and Nastran's files hold such cells
alone. What another program has, meshio converts.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vemcvx.errors import MeshError, MeshWarning
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.io.blocks import PHYSICAL, Blocks, add_boundaries, cell_blocks
from vemcvx.meshes.io.meshio_mesh import blocks_of, finished, mesh_of, meshio_mesh, named, translated
from vemcvx.meshes.io.readers import opened
from vemcvx.meshes.io.solids import solid_blocks
from vemcvx.meshes.io.vtu import write_polyhedra
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

ANY_POLYGON = (".vtu", ".vtk")
NASTRAN = (".bdf", ".nas", ".fem")
FORMATS = {".vtu": "vtu", ".vtk": "vtk", ".vtp": "vtu", ".msh": "gmsh", ".inp": "abaqus"}
FORMATS |= dict.fromkeys(NASTRAN, "nastran")
READ_ONLY = (".vtp",)
WORDS = "Gmsh (.msh), VTK (.vtu, .vtk, .vtp), Abaqus (.inp) and Nastran (.bdf, .nas, .fem)"
UNSPEAKABLE = '"\\\r\n'
"""Characters that Gmsh's names cannot have."""


def load(path: str | Path) -> Tessellation | SpaceTessellation:
    """The mesh in a file: see :func:`vemcvx.meshes.read`."""
    path = _path(path)
    return finished(str(path), lambda: _read(path))


def write(path: str | Path, mesh: Tessellation | SpaceTessellation) -> None:
    """Write a mesh with its named boundaries and cell data (see `write` of meshes)."""
    path = _path(path)
    suffix = _check_target(path)
    with named(str(path)):
        if isinstance(mesh, SpaceTessellation) and suffix == ".vtu":
            _save(path, lambda draft: write_polyhedra(draft, mesh, {}, mesh.cell_data, sides=True))
            return
        if suffix == ".msh":
            _check_names(mesh)
        if isinstance(mesh, Tessellation):
            blocks = _plane_blocks(suffix, mesh)
        else:
            blocks = solid_blocks(mesh, in_order=suffix not in ANY_POLYGON, sides=suffix in (*ANY_POLYGON, ".msh"))
    # Version 4 wants a geometry.
    file_format = "gmsh22" if suffix == ".msh" else FORMATS[suffix]
    _save(path, lambda draft: meshio_mesh(mesh.points, blocks, suffix).write(draft, file_format=file_format))
    lost = _lost(mesh, suffix)
    if lost:
        all_of_it = ".vtu" if isinstance(mesh, SpaceTessellation) else " and ".join(ANY_POLYGON)
        warnings.warn(f"{path}: {suffix} files do not keep {lost}; {all_of_it} files do.", MeshWarning, stacklevel=3)


def _plane_blocks(suffix: str, mesh: Tessellation) -> Blocks:
    if suffix not in ANY_POLYGON and np.diff(mesh.offsets).max() > 4:
        raise MeshError(
            f"{suffix} files do not keep polygons of more than four vertices, and this mesh has "
            f"some. Write {' or '.join(ANY_POLYGON)}."
        )
    if suffix not in ANY_POLYGON and mesh.interfaces:
        raise MeshError(f"{suffix} files do not keep interfaces of bodies. Write {' or '.join(ANY_POLYGON)}.")
    blocks = cell_blocks(mesh, mesh.cell_data, in_order=suffix not in ANY_POLYGON)
    if suffix in (*ANY_POLYGON, ".msh"):
        add_boundaries(blocks, mesh)
    return blocks


def _path(path: str | Path) -> Path:
    try:
        return Path(path)
    except TypeError:
        raise MeshError(f"the path of a mesh file must be a string or Path; got {path!r}.") from None


def _suffix(path: Path) -> str:
    """The suffix, one of those known, or MeshError."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise MeshError(
            f"{path}: the suffix {path.suffix!r} is none of the mesh formats here: {WORDS}. Convert the file: "
            f"meshio convert {path.name} {path.stem}.vtu"
        )
    return suffix


def _check_target(path: Path) -> str:
    suffix = _suffix(path)
    if suffix in READ_ONLY:
        raise MeshError(f"{path}: {suffix} files are read, not written; {' and '.join(ANY_POLYGON)} hold every mesh.")
    if not os.path.isdir(path.parent):
        raise MeshError(f"{path}: there is no folder {path.parent}; create it first.")
    if os.path.isdir(path):
        raise MeshError(f"{path} is a folder; name a file.")
    return suffix


def _check_names(mesh: Tessellation | SpaceTessellation) -> None:
    wrong = [name for name in mesh.boundaries if any(character in UNSPEAKABLE for character in name)]
    if wrong:
        raise MeshError(f".msh files have no names with quotes, backslashes or ends of lines, as {wrong[0]!r} has.")


def _save(path: Path, put: Callable[[Path], None]) -> None:
    """Write a file in one go."""
    known = path.suffix.lower() in ANY_POLYGON
    failure = "cannot be written" if known else "cannot be written; .vtu and .vtk hold every mesh"
    with translated(str(path), failure), tempfile.TemporaryDirectory(dir=path.parent) as folder:
        draft = Path(folder) / path.name
        put(draft)
        os.replace(draft, path)


def _lost(mesh: Tessellation | SpaceTessellation, suffix: str) -> str:
    """The parts of a mesh that a format cannot hold."""
    if suffix in ANY_POLYGON:
        return ""
    names = set(mesh.cell_data) - {PHYSICAL} if suffix == ".msh" else set(mesh.cell_data) | set(mesh.boundaries)
    rounded = ["all digits of the points"] if suffix in NASTRAN else []
    return ", ".join([*rounded, *map(repr, sorted(names - {WHOLE}))])


def _read(path: Path) -> tuple[Tessellation | SpaceTessellation, list[str]]:
    import meshio

    # Unlike pathlib's, these know no names that are too long.
    if not os.path.isfile(path):
        folder = os.path.isdir(path)
        raise MeshError(f"{path} is a folder; name a file." if folder else f"{path}: there is no such file.")
    suffix = _suffix(path)
    with translated(str(path), "cannot be read as a mesh"):
        with opened(path, FORMATS[suffix]) as source:
            file = meshio.read(source, file_format=FORMATS[suffix])
        blocks = blocks_of(file, suffix)
    with named(str(path)):
        mesh, notes = mesh_of(file.points, blocks)
    if suffix == ".vtk" and not blocks.data and b"\nCELL_DATA " in path.read_bytes():
        notes.append("cell data are left out; of polygons they are read from .vtk files of version 5.1 only.")
    return mesh, notes
