"""Meshes of meshio, scikit-fem and PyVista, taken and given."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Ints, brief
from vemcvx.base.errors import MeshError, MeshWarning, VemcvxError
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import padded
from vemcvx.meshes.io import grid as grids
from vemcvx.meshes.io.grid import (
    CELL,
    MARK,
    PHYSICAL,
    AnyTessellation,
    Grid,
    by_corners,
    grid_of,
    take_parts,
    translated,
)
from vemcvx.meshes.io.vtk import read_xml, write_xml
from vemcvx.meshes.polygons import matching_rows, offsets_of, polygon_centroids, rows_in_order
from vemcvx.meshes.tessellation import SpaceTessellation

if TYPE_CHECKING:
    import meshio


def from_meshio(mesh: meshio.Mesh) -> Grid:
    """Cells block by block, their data, and named groups; MeshError where data do not go with the cells.

    Groups of what bounds cells (lines; surfaces, where there are solids) name parts of the boundary; groups of cells
    become cell data, 1 in the group and 0 outside.
    """
    known = [block.type in (*grids.NODES, "polygon", *chain(*grids.CORNERS.values())) for block in mesh.cells]
    rows = [
        np.asarray(block.data if fits else np.zeros((len(block.data), 1))).astype(np.int64)
        for block, fits in zip(mesh.cells, known, strict=True)
    ]
    ragged = [block.type for block, row in zip(mesh.cells, rows, strict=True) if row.ndim != 2]
    if ragged:
        raise MeshError(f"its cells of the kind {ragged[0]!r} do not all have as many nodes as that takes.")
    none = np.zeros(0, dtype=np.int64)
    sizes = [len(row) for row in rows]
    grid = Grid(
        mesh.points,
        np.repeat(np.array([block.type for block in mesh.cells], dtype=str), sizes),
        offsets_of(np.concatenate([none, *(np.full(len(row), row.shape[1]) for row in rows)])),
        np.concatenate([none, *(row.ravel() for row in rows)]),
        {name: _joined(name, list(map(np.asarray, parts)), sizes) for name, parts in mesh.cell_data.items()},
    )
    grid = by_corners(take_parts(grid, mesh.field_data))
    _take_physical_groups(grid, mesh.field_data)
    starts = offsets_of(np.array(sizes, dtype=np.int64))
    for name, members in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            some = [(start, m) for start, m in zip(starts, members, strict=False) if m is not None]
            chosen = np.concatenate([none, *(start + np.asarray(m, dtype=np.int64) for start, m in some)])
            inside, (inner, outer) = np.isin(np.arange(len(grid.kinds)), chosen), grid.bounding
            if (inside & outer).any():
                grid.sides[name] = inside
            elif (inside & inner).any():
                grid.data[name] = inside.astype(np.uint8)
    return grid


def _joined(name: str, parts: list[NDArray[Any]], sizes: list[int]) -> NDArray[Any]:
    """The datum of all blocks; MeshError where one is not of one row a cell, or of another shape."""
    for values, size in zip(parts, sizes, strict=True):
        if values.shape[:1] != (size,):
            raise MeshError(f"its cell datum {name!r} has the shape {values.shape} on {size} cells.")
    shapes = sorted({values.shape[1:] for values in parts})
    if len(shapes) > 1:
        raise MeshError(f"its cell datum {name!r} has values of different shapes: {', '.join(map(str, shapes))}.")
    return np.concatenate(parts) if parts else np.zeros(0)


def _take_physical_groups(grid: Grid, names: Mapping[str, Any]) -> None:
    """Physical groups of a Gmsh file: those of sides by name or number, those of cells by name."""
    tags = grid.data.get(PHYSICAL)
    grid.data.pop("gmsh:geometrical", None)
    if tags is None:
        return
    inner, outer = grid.bounding
    dimension = 3 if grid.solid else 2
    called = {(int(value[1]), int(value[0])): name for name, value in names.items() if np.shape(value) == (2,)}
    for tag in np.unique(tags[outer]).tolist():
        if tag:  # 0 is no group
            grid.sides[called.get((dimension - 1, tag), str(tag))] = outer & (tags == tag)
    for (rank, tag), name in called.items():
        if rank == dimension:
            grid.data[name] = (tags == tag).astype(np.uint8)
    if not tags[inner].any():
        del grid.data[PHYSICAL]


def groups_of(grid: Grid) -> dict[str, Grid]:
    """The cells of each physical group alone, with the lines or faces that its nodes have, by the name of the group.

    Nodes are numbered anew in their order; data that say which cells are in a group are left out. MeshError where
    there are no groups, or cells in none.
    """
    grid = by_corners(grid)
    tags, (inner, outer) = grid.data.get(PHYSICAL), grid.bounding
    if tags is None or grid.faces is not None or not tags[inner].all():
        lacking = "" if tags is None else f"{np.count_nonzero(tags[inner] == 0)} of its cells are in none; "
        raise MeshError(
            f"bodies='physical' makes a body of every physical group of cells, and {lacking}wanted is a Gmsh file in "
            "which each cell is in one."
        )
    members = {int(tag): inner & (tags == tag) for tag in np.unique(tags[inner])}
    said = {
        tag: [name for name, x in grid.data.items() if name != PHYSICAL and np.array_equal(x != 0, tags == tag)]
        for tag in members
    }
    data = {name: x for name, x in grid.data.items() if name != PHYSICAL and not any(name in n for n in said.values())}
    cell = np.repeat(np.arange(len(grid.kinds)), np.diff(grid.offsets))
    found: dict[str, Grid] = {}
    for tag, mine in members.items():
        own = np.zeros(len(grid.points), dtype=bool)
        own[grid.vertices[mine[cell]]] = True
        kept = mine | (outer & (np.bincount(cell, ~own[grid.vertices], len(mine)) == 0))
        rows = np.flatnonzero(kept)
        offsets, vertices = rows_in_order(grid.offsets, grid.vertices, rows)
        found[said[tag][0] if said[tag] else str(tag)] = Grid(
            grid.points[own],
            grid.kinds[rows],
            offsets,
            (np.cumsum(own) - 1)[vertices],
            data={name: x[rows] for name, x in data.items()},
            sides={name: chosen[rows] for name, chosen in grid.sides.items() if chosen[rows].any()},
            # What is said of the whole file is said once.
            notes=() if found else grid.notes,
        )
    return found


def to_meshio(grid: Grid, *, in_order: bool, groups: bool = False) -> meshio.Mesh:
    """The meshio mesh of a grid, one block a kind and number of nodes, or ``in_order`` a new one whenever these change.

    Where blocks permute cells, the datum `CELL` has the number of each. With `groups`, named sets of cells are Gmsh's
    physical groups, and other data stay behind: meshio writes them into a Gmsh file in a way that it cannot read.
    """
    import meshio

    counts = np.diff(grid.offsets)
    _, first, kind = np.unique(np.char.add(grid.kinds, counts.astype(str)), return_index=True, return_inverse=True)
    kind = np.argsort(np.argsort(first))[kind]  # in order of appearance
    order = np.arange(len(kind)) if in_order else np.argsort(kind, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)
    data, names = grid.marked, {}
    if groups:
        names = {name: np.array([k, grid.points.shape[1] - 1]) for k, name in enumerate(grid.sides, start=1)}
        tags = np.where(grid.bounding[0], grid.data.get(PHYSICAL, 0), 0)
        for k, chosen in enumerate(grid.sides.values(), start=1):
            tags = np.where(chosen, k, tags)
        data = {PHYSICAL: tags, "gmsh:geometrical": tags}
    elif (order != np.arange(len(order))).any():
        data = {**data, CELL: np.arange(len(order))}
    return meshio.Mesh(
        np.pad(grid.points, ((0, 0), (0, 3 - grid.points.shape[1]))),
        [(str(grid.kinds[m[0]]), grid.vertices[grid.offsets[m, None] + np.arange(counts[m[0]])]) for m in members],
        cell_data={name: [values[m] for m in members] for name, values in data.items()},
        field_data=names,
    )


PLANE = {"ElementTriP1": "triangle", "ElementQuad1": "quad"}
KINDS = {**PLANE, "ElementTetP1": "tetra", "ElementHex1": "hexahedron"}
# Where scikit-fem has the vertices of a hexahedron that runs around its bottom, then around its top.
HEXAHEDRON = np.array([0, 3, 6, 2, 1, 5, 7, 4])


def from_skfem(mesh: Any) -> Grid:
    """Points and cells; named facets are boundaries, subdomains cell data."""
    element = mesh.elem.__name__
    points, cells = np.asarray(mesh.doflocs).T, np.array(mesh.t, dtype=np.int64).T
    if element == "ElementHex1":
        cells = cells[:, HEXAHEDRON]
    if element in PLANE:  # either way around is usual: triangles, say, are sorted by the numbers of their vertices
        clockwise = polygon_centroids(points[cells])[0] < 0.0
        cells[clockwise, 1:] = cells[clockwise, :0:-1]
    offsets = np.arange(len(cells) + 1) * cells.shape[1]
    grid = Grid(points, np.full(len(cells), KINDS.get(element, element)), offsets, cells.ravel())
    for name, facets in (mesh.boundaries or {}).items():
        rows = np.asarray(mesh.facets, dtype=np.int64)[:, np.asarray(facets)].T
        grid.parts[name] = np.arange(len(rows) + 1) * rows.shape[1], rows.ravel()
    for name, members in (mesh.subdomains or {}).items():
        grid.data[name] = np.isin(np.arange(len(cells)), members).astype(np.uint8)
    return grid


def to_skfem(mesh: AnyTessellation) -> tuple[Any, list[str]]:
    """MeshTri, MeshQuad, MeshTet or MeshHex, and the names of cell data that it does not keep."""
    import skfem

    if isinstance(mesh, SpaceTessellation):
        kinds, offsets, vertices = grids.by_vertices(mesh)
        made = {"tetra": skfem.MeshTet, "hexahedron": skfem.MeshHex}.get(kinds[0])
        if len(np.unique(kinds)) > 1 or made is None:
            raise MeshError("scikit-fem has meshes of tetrahedra or of hexahedra; here, there are other cells.")
    else:
        counts, offsets, vertices = np.unique(np.diff(mesh.offsets)).tolist(), mesh.offsets, mesh.vertices
        made = {(3,): skfem.MeshTri, (4,): skfem.MeshQuad}.get(tuple(counts))
        if made is None:
            found = " or ".join(map(str, counts))
            raise MeshError(
                f"scikit-fem has meshes of triangles or of quadrilaterals; here, cells have {found} vertices."
            )
    cells = vertices.reshape(-1, offsets[1])
    cells = cells[:, np.argsort(HEXAHEDRON)] if offsets[1] == 8 else cells
    made = made(mesh.points.T.copy(), cells.T.copy())
    facets: Ints = made.facets.T.astype(np.int64)
    parts = {name: part for name, part in mesh.boundaries.items() if name != WHOLE}
    # Where in the boundary each facet is, -1 inside.
    place = matching_rows(*mesh._outlines, np.arange(len(facets) + 1) * facets.shape[1], facets.ravel())
    sides = {name: np.flatnonzero(np.isin(place, mesh._places(part))) for name, part in parts.items()}
    sets = {name: np.flatnonzero(v) for name, v in mesh.cell_data.items() if v.ndim == 1 and np.isin(v, (0, 1)).all()}
    return made.with_boundaries(sides).with_subdomains(sets), sorted(set(mesh.cell_data) - set(sets))


def from_pyvista(data: Any) -> Grid:
    """Points and cells of UnstructuredGrid, PolyData or whatever else casts to a grid, through a file of VTK's."""
    import pyvista

    if not data.n_cells:
        raise MeshError("it holds no cells.")
    grid = data.copy() if isinstance(data, pyvista.UnstructuredGrid) else data.cast_to_unstructured_grid()
    values, fields = ({name: np.array(x) for name, x in of.items()} for of in (grid.cell_data, data.field_data))
    grid.clear_data()  # not all names of data survive a file of VTK's
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.vtu"
        grid.save(file)
        made = read_xml(file.read_bytes(), "UnstructuredGrid")
    return take_parts(replace(made, data=values), fields)


def to_pyvista(mesh: AnyTessellation) -> Any:
    """UnstructuredGrid with the cells in their order."""
    import pyvista

    fields = {MARK + name: padded(*grids.rows_of(mesh, part)) for name, part in grids.named_parts(mesh).items()}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.vtu"
        write_xml(file, grid_of(mesh, mesh.cell_data, polyhedra=True, sides=False), fields=fields)
        return pyvista.read(file)


CALLED = {"meshio": "meshio", "skfem": "scikit-fem", "pyvista": "PyVista"}
MESHES = {("meshio", "Mesh"), ("skfem", "Mesh"), ("pyvista", "DataSet")}


def from_object(other: Any) -> AnyTessellation:
    """The mesh in an object: see :func:`vemcvx.meshes.convert`."""
    kinds = {(kind.__module__.partition(".")[0], kind.__name__) for kind in type(other).__mro__}
    if not kinds & MESHES:
        raise MeshError(
            f"convert takes meshio.Mesh, MeshTri, MeshQuad, MeshTet and MeshHex of scikit-fem, UnstructuredGrid and "
            f"PolyData of PyVista; got {brief(other)}. For a file there is read, for points and cells "
            "PolygonMesh(points, cells) and PolyhedralMesh(points, cells)."
        )
    library = (kinds & MESHES).pop()[0]
    subject = f"the mesh of {CALLED[library]}"

    def made() -> tuple[AnyTessellation, list[str]]:
        with translated(subject, "cannot be converted"):
            grid = {"meshio": from_meshio, "skfem": from_skfem, "pyvista": from_pyvista}[library](other)
        with grids.named(subject):
            return grids.mesh_of(grid)

    return grids.finished(subject, made)


def to_object(mesh: AnyTessellation, library: str) -> Any:
    """A mesh as an object of a library: see `PolygonMesh.to`."""
    if not isinstance(library, str) or library not in CALLED:
        raise MeshError(f"a mesh goes to {', '.join(map(repr, CALLED))}; got {brief(library)}. To a file: write(path).")
    try:
        if library == "meshio":
            return to_meshio(grid_of(mesh, mesh.cell_data), in_order=False)
        if library == "pyvista":
            return to_pyvista(mesh)
        made, lost = to_skfem(mesh)
    except ImportError:
        package = {"skfem": "scikit-fem", "pyvista": "'vemcvx[view]'"}[library]
        raise VemcvxError(f"this needs {CALLED[library]}, which is not installed: pip install {package}") from None
    notes = []
    if lost:
        notes.append(f"keep only sets of cells (0 or 1), not {', '.join(map(repr, lost))}.")
    if mesh.interfaces:
        names = ", ".join(map(repr, mesh.interfaces))
        notes.append(f"keep no interfaces: of {names} the {mesh.PARTS} of the first body stay, as boundaries.")
    for note in notes:
        warnings.warn(f"meshes of scikit-fem {note}", MeshWarning, stacklevel=3)
    return made
