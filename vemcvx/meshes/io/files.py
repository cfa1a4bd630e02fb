"""Mesh files, through meshio (the one file that knows it).

VTU and legacy VTK hold every polygonal mesh. Gmsh's MSH holds triangles and quadrilaterals with their physical
groups. Of meshio's other formats some lose cells without a word (OFF and STL keep triangles only, Medit and SU2
triangles and quadrilaterals), so polygons go into the first two alone, and what any other format holds is read back
and compared before the file is left behind.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats
from vemcvx.errors import MeshError, MeshWarning
from vemcvx.meshes.io.blocks import MARK, POLYGONS, Blocks, Data, add_boundaries, cell_blocks, mesh_of
from vemcvx.meshes.io.groups import physical_groups, take_physical_groups, take_sets
from vemcvx.meshes.io.unsafe import check_data, opened
from vemcvx.meshes.tessellation import Tessellation

if TYPE_CHECKING:
    import meshio

ANY_POLYGON = (".vtu", ".vtk")
SOLID_ONLY = (".ele", ".node")  # TetGen's
Arrays = Mapping[str, NDArray[Any]]


def load(path: str | Path) -> Tessellation:
    """The mesh in a file: see :func:`vemcvx.meshes.read`."""
    path = _path(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh, notes = _read(path)
    for note in [*(str(warning.message) for warning in caught if warning.category is MeshWarning), *notes]:
        warnings.warn(f"{path}: {note}", MeshWarning, stacklevel=3)
    return mesh


def write(path: str | Path, mesh: Tessellation) -> None:
    """Write a mesh with its named boundaries and cell data (see `PolygonMesh.write`)."""
    path = _path(path)
    suffix = _check_target(path)
    if suffix not in ANY_POLYGON and np.diff(mesh.offsets).max() > 4:
        raise MeshError(
            f"{path}: {suffix} files do not keep polygons of more than four vertices, and this mesh has "
            f"some. Write {' or '.join(ANY_POLYGON)}."
        )
    blocks = cell_blocks(mesh, mesh.cell_data, in_order=suffix not in ANY_POLYGON)
    if suffix in (*ANY_POLYGON, ".msh"):
        add_boundaries(blocks, mesh)
    lost = _save(path, suffix, _file_of(suffix, mesh.points, blocks, {}), mesh if suffix not in ANY_POLYGON else None)
    if lost:
        warnings.warn(
            f"{path}: {suffix} files do not keep {lost}; {' and '.join(ANY_POLYGON)} files do.",
            MeshWarning,
            stacklevel=3,
        )


def write_cells(path: str | Path, mesh: Tessellation, point_data: Arrays, cell_data: Arrays) -> None:
    """Write fields on a mesh as a VTU file that ParaView opens.

    Parameters
    ----------
    path : str or Path
        Must end in .vtu.
    mesh : PolygonMesh
        The cells; boundaries and cell data of the mesh are not written.
    point_data, cell_data : mapping of str to array
        One row a node, one row a cell; vectors of two components get a third, zero.

    Raises
    ------
    MeshError
        The suffix is another, a field has the wrong number of rows, or the file cannot be written.
    """
    path = _path(path)
    if _check_target(path) != ".vtu":
        raise MeshError(f"{path}: fields are written as .vtu files; got the suffix {path.suffix!r}.")
    for kind, data, rows in (("point", point_data, mesh.n_nodes), ("cell", cell_data, mesh.n_cells)):
        for name, values in data.items():
            if np.ndim(values) not in (1, 2) or len(values) != rows:
                raise MeshError(f"{path}: {kind} field {name!r} needs {rows} rows; got shape {np.shape(values)}.")
    blocks = cell_blocks(mesh, {name: _three(values) for name, values in cell_data.items()})
    fields = {name: _three(values) for name, values in point_data.items()}
    _save(path, ".vtu", _file_of(".vtu", mesh.points, blocks, fields))


def _path(path: str | Path) -> Path:
    try:
        return Path(path)
    except TypeError:
        raise MeshError(f"the path of a mesh file must be a string or Path; got {path!r}.") from None


def _three(values: ArrayLike) -> NDArray[Any]:
    values = np.asarray(values)
    return np.pad(values, ((0, 0), (0, 1))) if values.ndim == 2 and values.shape[1] == 2 else values


def _formats() -> tuple[str, ...]:
    import meshio

    return tuple(sorted(set(meshio.extension_to_filetypes) - set(SOLID_ONLY)))


def _suffix(path: Path) -> str:
    """The suffix that meshio knows ("vol.gz" counts as one), or MeshError."""
    known = _formats()
    endings = ["".join(path.suffixes[k:]).lower() for k in range(len(path.suffixes))]
    for ending in endings:
        if ending in known:
            return ending
    raise MeshError(
        f"{path}: the suffix {path.suffix!r} is no mesh format; {' and '.join(ANY_POLYGON)} hold every "
        f"mesh, others are {', '.join(known)}."
    )


def _check_target(path: Path) -> str:
    suffix = _suffix(path)
    if not os.path.isdir(path.parent):
        raise MeshError(f"{path}: there is no folder {path.parent}; create it first.")
    if os.path.isdir(path):
        raise MeshError(f"{path} is a folder; name a file.")
    return suffix


def _file_of(suffix: str, points: Floats, blocks: Blocks, point_data: Arrays) -> meshio.Mesh:
    import meshio

    spellings: dict[str, Callable[[str], str]] = {".vtu": _xml_name, ".vtk": quote}
    spelled = spellings.get(suffix, str)
    data: Data = {}
    names: Arrays = {}
    if suffix in ANY_POLYGON:
        marks = {MARK + name: [part.astype(np.uint8) for part in parts] for name, parts in blocks.lines.items()}
        data = blocks.data | marks
        if suffix == ".vtk":
            data = {name: [_wide(part) for part in parts] for name, parts in data.items()}
    elif suffix == ".msh":
        data, names = physical_groups(blocks)
    return meshio.Mesh(
        np.pad(points, ((0, 0), (0, 1))),
        blocks.cells,
        point_data={spelled(name): values for name, values in point_data.items()},
        cell_data={spelled(name): parts for name, parts in data.items()},
        field_data=names,
    )


def _wide(values: NDArray[Any]) -> NDArray[Any]:
    """Whole numbers in 64 bits: the names that meshio gives the other widths in legacy files are unknown to VTK."""
    return values.astype(np.int64) if values.dtype.kind in "iu" else values


def _xml_name(name: str) -> str:
    """A name as an XML attribute in ASCII: meshio writes it as it comes, in the encoding of the system."""
    return escape(name, {'"': "&quot;"}).encode("ascii", "xmlcharrefreplace").decode()


def _save(path: Path, suffix: str, file: meshio.Mesh, mesh: Tessellation | None = None) -> str:
    """Write a file in one go; if a mesh is given, first compare what it reads as, and return what is lost."""
    lost = ""
    failure = "cannot be written" if suffix in ANY_POLYGON else "cannot be written; .vtu and .vtk hold every mesh"
    with _translated(path, failure), tempfile.TemporaryDirectory(dir=path.parent) as folder:
        draft = Path(folder) / path.name  # some formats are more than one file
        file.write(draft, file_format="gmsh22" if suffix == ".msh" else None)  # version 4 wants a geometry
        if mesh is not None:
            lost = _lost(mesh, draft, suffix)
        for made in Path(folder).iterdir():
            shutil.move(made, path.parent / made.name)
    return lost


def _lost(mesh: Tessellation, draft: Path, suffix: str) -> str:
    """Names that a file does not give back; MeshError if it does not give back the mesh."""
    try:
        back = _read(draft)[0]
        same = np.array_equal(back.offsets, mesh.offsets) and np.array_equal(back.vertices, mesh.vertices)
        # Some formats write six digits; a mesh that six digits damage has been refused on reading.
        same = same and np.allclose(back.points, mesh.points, rtol=0.0, atol=1e-5 * np.ptp(mesh.points))
    except MeshError:
        same = False
    if not same:
        raise MeshError(f"what a {suffix} file gives back is another mesh.")
    names = [*(set(mesh.boundaries) - set(back.boundaries)), *(set(mesh.cell_data) - set(back.cell_data))]
    rounded = [] if np.array_equal(back.points, mesh.points) else ["all digits of the points"]
    return ", ".join([*rounded, *map(repr, sorted(names))])


def _read(path: Path) -> tuple[Tessellation, list[str]]:
    import meshio

    # Unlike pathlib's, these know no names that are too long.
    if not os.path.isfile(path):
        folder = os.path.isdir(path)
        raise MeshError(f"{path} is a folder; name a file." if folder else f"{path}: there is no such file.")
    suffix = _suffix(path)
    with _translated(path, "cannot be read as a mesh"):
        formats = meshio.extension_to_filetypes[suffix]
        # .msh is Ansys' as well as Gmsh's; only the latter begins with a dollar.
        gmsh = suffix == ".msh" and path.read_bytes()[:100].lstrip().startswith(b"$")
        file_format = "gmsh" if gmsh else formats[0]
        with opened(path, file_format) as source:
            file = meshio.read(source, file_format=file_format)
        blocks = _blocks_of(file, suffix)
    with _named(path):
        return mesh_of(file.points, blocks)


def _blocks_of(file: meshio.Mesh, suffix: str) -> Blocks:
    spelled = unquote if suffix == ".vtk" else str
    kinds = [block.type for block in file.cells]
    known = [block.type in (*POLYGONS, "line") for block in file.cells]
    cells = [
        np.asarray(block.data if flat else np.zeros((len(block.data), 1))).astype(np.int64)
        for block, flat in zip(file.cells, known, strict=True)
    ]
    data = {spelled(name): list(map(np.asarray, parts)) for name, parts in file.cell_data.items()}
    blocks = Blocks(list(zip(kinds, cells, strict=True)), data)
    check_data(blocks)
    for name, parts in data.items():
        if name.startswith(MARK):
            blocks.lines[name.removeprefix(MARK)] = [part != 0 for part in parts]
    take_physical_groups(blocks, file.field_data)
    take_sets(blocks, file.cell_sets)
    return blocks


@contextlib.contextmanager
def _translated(path: Path, failure: str) -> Iterator[None]:
    """Turn whatever meshio does on failure, sys.exit included, into a MeshError, and keep it off the terminal."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MeshError as error:
        raise MeshError(f"{path} {failure}: {error}") from None
    except (SystemExit, Exception) as error:
        cause = said.getvalue() if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
        raise MeshError(f"{path} {failure} ({' '.join(cause.split())[:200]}).") from error


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Put the path before the message of a MeshError."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
