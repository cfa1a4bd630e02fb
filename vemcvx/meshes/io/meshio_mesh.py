"""Meshes of meshio, and what is said of meshes that cannot be taken."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats
from vemcvx.errors import MeshError, MeshWarning
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.io.blocks import (
    MARK,
    POLYGONS,
    SOLIDS,
    Blocks,
    Data,
    marked_edges,
    physical_groups,
    plane_mesh_of,
    take_physical_groups,
    take_sets,
)
from vemcvx.meshes.io.readers import check_data
from vemcvx.meshes.io.solids import TYPES, blocks_of_vtk, space_mesh_of
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation, straight_sides

if TYPE_CHECKING:
    import meshio


# What reading, converting and writing meshes say: errors that begin with their subject, and notes as warnings.


Found = Tessellation | SpaceTessellation


def finished(subject: str, made: Callable[[], tuple[Found, list[str]]]) -> Found:
    """The mesh of a file or an object, its sides named if nothing is; what is to be said of it as warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh, notes = made()
    sides = straight_sides(mesh)
    if sides and set(mesh.boundaries) == {WHOLE}:
        mesh = mesh.with_boundaries(sides)
        notes = [*notes, f"no part of the boundary has a name; by their place, sides are called {', '.join(sides)}."]
    for note in [*(str(warning.message) for warning in caught if warning.category is MeshWarning), *notes]:
        warnings.warn(f"{subject}: {note}", MeshWarning, stacklevel=4)
    return mesh


@contextlib.contextmanager
def translated(subject: str, failure: str) -> Iterator[None]:
    """Turn whatever other libraries do on failure, sys.exit included, into a MeshError, and keep the terminal clean."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MeshError as error:
        raise MeshError(f"{subject} {failure}: {error}") from None
    except (SystemExit, Exception) as error:
        cause = said.getvalue() if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
        raise MeshError(f"{subject} {failure} ({' '.join(cause.split())[:200]}).") from error


@contextlib.contextmanager
def named(subject: str) -> Iterator[None]:
    """Put the subject before the message of a MeshError."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{subject}: {error}") from None


# What files and objects hold, made a mesh of the plane or of space.


def mesh_of(points: Floats, blocks: Blocks) -> tuple[Tessellation | SpaceTessellation, list[str]]:
    """Return the mesh of the solids that there are, or else of the polygons, and notes on what was left out."""
    if any(kind in SOLIDS for kind, _ in blocks.cells):
        return space_mesh_of(points, blocks)
    return plane_mesh_of(points, blocks)


# Meshes as meshio has them, in memory and as it is to write them: files of each kind spell names in their own way.


Arrays = Mapping[str, NDArray[Any]]
IN_MEMORY = ""


def meshio_mesh(points: Floats, blocks: Blocks, suffix: str = IN_MEMORY) -> meshio.Mesh:
    """The meshio mesh to be written into a file with that suffix, or to be handed out."""
    import meshio

    spellings: dict[str, Callable[[str], str]] = {".vtu": xml_name, ".vtk": quote}
    spelled = spellings.get(suffix, str)
    data: Data = {}
    names: Arrays = {}
    if suffix in (".vtu", ".vtk", IN_MEMORY):
        marks = {MARK + name: [part.astype(np.uint8) for part in parts] for name, parts in blocks.sides.items()}
        data = blocks.data | marks
        if suffix == ".vtk":
            data = {name: [_wide(part) for part in parts] for name, parts in data.items()}
    elif suffix == ".msh":
        data, names = physical_groups(blocks)
    return meshio.Mesh(
        np.pad(points, ((0, 0), (0, 3 - points.shape[1]))),
        blocks.cells,
        cell_data={spelled(name): parts for name, parts in data.items()},
        field_data=names,
    )


def blocks_of(mesh: meshio.Mesh, suffix: str = IN_MEMORY) -> Blocks:
    """Cells, data and names of a mesh, from a file with that suffix or from memory."""
    spelled = unquote if suffix == ".vtk" else str
    data = {spelled(name): [_flat(np.asarray(p), suffix) for p in parts] for name, parts in mesh.cell_data.items()}
    if TYPES in mesh.field_data:
        blocks = blocks_of_vtk(mesh.field_data, {name: parts[0] for name, parts in data.items()})
    else:
        known = [block.type in (*SOLIDS[:-1], *POLYGONS, "line") for block in mesh.cells]
        cells = [
            np.asarray(block.data if flat else np.zeros((len(block.data), 1))).astype(np.int64)
            for block, flat in zip(mesh.cells, known, strict=True)
        ]
        blocks = Blocks([(block.type, part) for block, part in zip(mesh.cells, cells, strict=True)], data)
    check_data(blocks)
    solid = any(kind in SOLIDS for kind, _ in blocks.cells)
    fields = {spelled(name): values for name, values in mesh.field_data.items()}
    blocks.edges.update(marked_edges(fields, solid=solid))
    take_physical_groups(blocks, {n: value for n, value in mesh.field_data.items() if not n.startswith(MARK)})
    take_sets(blocks, mesh.cell_sets)
    return blocks


def _flat(values: NDArray[Any], suffix: str) -> NDArray[Any]:
    """Numbers of a legacy file are columns where VTK calls them scalars."""
    return values.ravel() if suffix == ".vtk" and values.shape[1:] == (1,) else values


def _wide(values: NDArray[Any]) -> NDArray[Any]:
    """Whole numbers in 64 bits: the names that meshio gives the other widths in legacy files are unknown to VTK."""
    return values.astype(np.int64) if values.dtype.kind in "iu" else values


def xml_name(name: str) -> str:
    """A name as an XML attribute in ASCII: meshio writes it as it comes, in the encoding of the system."""
    return escape(name, {'"': "&quot;"}).encode("ascii", "xmlcharrefreplace").decode()
