"""Mesh files, through meshio.

VTU and legacy VTK hold every polygonal mesh. Gmsh's MSH holds triangles and quadrilaterals with their physical
groups. Of meshio's other formats some lose cells without a word (OFF and STL keep triangles only, Medit and SU2
triangles and quadrilaterals), so polygons go into the first two alone, and what any other format holds is read back
and compared before the file is left behind.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vemcvx.arrays import Ints
from vemcvx.errors import MeshError, MeshWarning
from vemcvx.meshes.io.blocks import Blocks, add_boundaries, cell_blocks
from vemcvx.meshes.io.by_vertices import solid_blocks
from vemcvx.meshes.io.meshio_mesh import blocks_of, meshio_mesh
from vemcvx.meshes.io.messages import finished, named, translated
from vemcvx.meshes.io.reading import mesh_of
from vemcvx.meshes.io.unsafe import opened
from vemcvx.meshes.io.vtu import write_polyhedra
from vemcvx.meshes.space_tessellation import SpaceTessellation
from vemcvx.meshes.tessellation import Tessellation

ANY_POLYGON = (".vtu", ".vtk")
SOLID_ONLY = (".ele", ".node")  # TetGen's
READ_ONLY = {".vtp": ["vtu"]}


def load(path: str | Path) -> Tessellation | SpaceTessellation:
    """The mesh in a file: see :func:`vemcvx.meshes.read`."""
    path = _path(path)
    return finished(str(path), lambda: _read(path))


def write(path: str | Path, mesh: Tessellation | SpaceTessellation) -> None:
    """Write a mesh with its named boundaries and cell data (see `write` of meshes)."""
    path = _path(path)
    suffix = _check_target(path)
    own = mesh if suffix not in ANY_POLYGON else None
    if isinstance(mesh, Tessellation):
        lost = _save(path, suffix, meshio_mesh(mesh.points, _plane_blocks(path, suffix, mesh), suffix).write, own)
    elif suffix == ".vtu":
        lost = _save(path, suffix, lambda draft, **_: write_polyhedra(draft, mesh, {}, mesh.cell_data, sides=True))
    else:
        with named(str(path)):
            blocks = solid_blocks(mesh, in_order=suffix not in ANY_POLYGON, sides=suffix in (*ANY_POLYGON, ".msh"))
        lost = _save(path, suffix, meshio_mesh(mesh.points, blocks, suffix).write, mesh)
    if lost:
        all_of_it = ".vtu" if isinstance(mesh, SpaceTessellation) else " and ".join(ANY_POLYGON)
        warnings.warn(f"{path}: {suffix} files do not keep {lost}; {all_of_it} files do.", MeshWarning, stacklevel=3)


def _plane_blocks(path: Path, suffix: str, mesh: Tessellation) -> Blocks:
    if suffix not in ANY_POLYGON and np.diff(mesh.offsets).max() > 4:
        raise MeshError(
            f"{path}: {suffix} files do not keep polygons of more than four vertices, and this mesh has "
            f"some. Write {' or '.join(ANY_POLYGON)}."
        )
    if suffix not in ANY_POLYGON and mesh.interfaces:
        raise MeshError(f"{path}: {suffix} files do not keep interfaces of bodies. Write {' or '.join(ANY_POLYGON)}.")
    blocks = cell_blocks(mesh, mesh.cell_data, in_order=suffix not in ANY_POLYGON)
    if suffix in (*ANY_POLYGON, ".msh"):
        add_boundaries(blocks, mesh)
    return blocks


def _path(path: str | Path) -> Path:
    try:
        return Path(path)
    except TypeError:
        raise MeshError(f"the path of a mesh file must be a string or Path; got {path!r}.") from None


def _formats() -> tuple[str, ...]:
    import meshio

    return tuple(sorted(set(meshio.extension_to_filetypes) - set(SOLID_ONLY)))


def _suffix(path: Path, known: tuple[str, ...]) -> str:
    """The suffix among those known ("vol.gz" counts as one), or MeshError."""
    endings = ["".join(path.suffixes[k:]).lower() for k in range(len(path.suffixes))]
    for ending in endings:
        if ending in known:
            return ending
    raise MeshError(
        f"{path}: the suffix {path.suffix!r} is no mesh format; {' and '.join(ANY_POLYGON)} hold every "
        f"mesh, others are {', '.join(known)}."
    )


def _check_target(path: Path) -> str:
    suffix = _suffix(path, _formats())
    if not os.path.isdir(path.parent):
        raise MeshError(f"{path}: there is no folder {path.parent}; create it first.")
    if os.path.isdir(path):
        raise MeshError(f"{path} is a folder; name a file.")
    return suffix


def _save(
    path: Path, suffix: str, put: Callable[..., None], mesh: Tessellation | SpaceTessellation | None = None
) -> str:
    """Write a file in one go; if a mesh is given, first compare what it reads as, and return what is lost."""
    lost = ""
    failure = "cannot be written" if suffix in ANY_POLYGON else "cannot be written; .vtu and .vtk hold every mesh"
    with translated(str(path), failure), tempfile.TemporaryDirectory(dir=path.parent) as folder:
        draft = Path(folder) / path.name  # some formats are more than one file
        put(draft, file_format="gmsh22" if suffix == ".msh" else None)  # version 4 wants a geometry
        if mesh is not None:
            lost = _lost(mesh, draft, suffix)
        for made in Path(folder).iterdir():
            shutil.move(made, path.parent / made.name)
    return lost


def _lost(mesh: Tessellation | SpaceTessellation, draft: Path, suffix: str) -> str:
    """Names that a file does not give back; MeshError if it does not give back the mesh."""
    try:
        back = _read(draft)[0]
        same = all(map(np.array_equal, _cells_of(back), _cells_of(mesh)))
        # Some formats write six digits; a mesh that six digits damage has been refused on reading.
        same = same and np.allclose(back.points, mesh.points, rtol=0.0, atol=1e-5 * np.ptp(mesh.points))
    except MeshError:
        same = False
    if not same:
        raise MeshError(f"what a {suffix} file gives back is another mesh.")
    names = [*(set(mesh.boundaries) - set(back.boundaries)), *(set(mesh.cell_data) - set(back.cell_data))]
    rounded = [] if np.array_equal(back.points, mesh.points) else ["all digits of the points"]
    return ", ".join([*rounded, *map(repr, sorted(names))])


def _cells_of(mesh: Tessellation | SpaceTessellation) -> tuple[Ints, Ints]:
    """Offsets and nodes of the cells; in space, in no order within a cell."""
    return (mesh.offsets, mesh.vertices) if isinstance(mesh, Tessellation) else mesh.cell_nodes


def _read(path: Path) -> tuple[Tessellation | SpaceTessellation, list[str]]:
    import meshio

    # Unlike pathlib's, these know no names that are too long.
    if not os.path.isfile(path):
        folder = os.path.isdir(path)
        raise MeshError(f"{path} is a folder; name a file." if folder else f"{path}: there is no such file.")
    suffix = _suffix(path, (*_formats(), *READ_ONLY))
    with translated(str(path), "cannot be read as a mesh"):
        formats = (meshio.extension_to_filetypes | READ_ONLY)[suffix]
        # .msh is Ansys' as well as Gmsh's; only the latter begins with a dollar.
        gmsh = suffix == ".msh" and path.read_bytes()[:100].lstrip().startswith(b"$")
        file_format = "gmsh" if gmsh else formats[0]
        with opened(path, file_format) as source:
            file = meshio.read(source, file_format=file_format)
        blocks = blocks_of(file, suffix)
    with named(str(path)):
        mesh, notes = mesh_of(file.points, blocks)
    if suffix == ".vtk" and not blocks.data and b"\nCELL_DATA " in path.read_bytes():
        notes.append("cell data are left out; of polygons they are read from .vtk files of version 5.1 only.")
    return mesh, notes
