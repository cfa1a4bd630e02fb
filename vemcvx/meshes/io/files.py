"""Reading of VTU, Gmsh, Abaqus and Nastran files, and writing of VTU files."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.meshes.io.abaqus import read_abaqus
from vemcvx.meshes.io.gmsh import read_gmsh
from vemcvx.meshes.io.grid import AnyTessellation, Grid, bodies_of, finish_mesh, grid_of, translate_errors
from vemcvx.meshes.io.nastran import read_nastran
from vemcvx.meshes.io.vtu import read_vtu, write_vtu

READERS: dict[str, Callable[[Path], Grid]] = {".vtu": lambda path: read_vtu(path.read_bytes()), ".msh": read_gmsh}
READERS |= {".inp": read_abaqus, **dict.fromkeys((".bdf", ".nas", ".fem"), read_nastran)}
BODIES = {".msh": "physical group of cells", ".inp": "instance or part, or else of every element set"}
BODIES |= dict.fromkeys((".bdf", ".nas", ".fem"), "property")
"""Suffix -> source of bodies, for messages."""
FORMATS = "VTK (.vtu), Gmsh (.msh), Abaqus (.inp) and Nastran (.bdf, .nas, .fem)"


def load(path: str | Path) -> AnyTessellation:
    """Return the mesh in a file: see :func:`vemcvx.meshes.read`."""
    grid = _read(path)
    try:
        return finish_mesh(str(path), grid)
    except MeshError as error:
        words, hint = ", ".join(map(repr, grid.bodies[:8])), ""
        if len(grid.bodies) > 1:
            hint = (
                f" If {words} are bodies, read the file with bodies='physical'; vemcvx run --mesh does so if the scene "
                f"names parts of bodies, such as on='{grid.bodies[0]}.NAME'."
            )
        raise MeshError(f"{error}{hint}") from None


def load_bodies(path: str | Path) -> tuple[dict[str, AnyTessellation], set[str]]:
    """Return name -> mesh of the body, and the names of sides."""
    grid = _read(path)
    with translate_errors(str(path), "holds no valid mesh"):
        if (source := BODIES.get(Path(path).suffix.lower())) is None:
            raise MeshError("bodies='physical' is for files of Gmsh, Abaqus and Nastran; omit bodies= for a VTU file.")
        grids = bodies_of(grid, source)
    for note in grid.notes:
        warnings.warn(f"{path}: {note}", MeshWarning, stacklevel=3)
    sides = {side for part in grids.values() for side in (*part.parts, *part.nodes)}
    sides |= {side for part in grids.values() for side, x in part.sets.items() if (x & part.bounding[1]).any()}
    return {name: finish_mesh(f"{path}: {name}", part, by_place=not sides) for name, part in grids.items()}, sides


def _read(path: str | Path) -> Grid:
    with translate_errors(str(path), "cannot be read as a mesh"):
        path = Path(path)
        if path.suffix.lower() not in READERS:
            raise MeshError(
                f"the suffix {path.suffix!r} is not one of the mesh formats: {FORMATS}. Convert the file: meshio "
                f"convert {path.name} {path.stem}.vtu"
            )
        if not path.is_file():
            raise MeshError("there is no such file.")
        return READERS[path.suffix.lower()](path)


def write(path: str | Path, mesh: AnyTessellation) -> None:
    """Write a mesh with its named boundaries and cell data: see :meth:`vemcvx.PolygonMesh.write`."""
    with translate_errors(str(path), "cannot be written"):
        path = Path(path)
        if path.suffix.lower() != ".vtu":
            raise MeshError(
                "meshes are written as .vtu files; mesh.to('meshio').write(path) writes other formats, some of them "
                "without names and data."
            )
        write_vtu(path, grid_of(mesh, polyhedra=True))
