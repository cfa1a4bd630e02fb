"""A mesh as files hold it: cells in blocks of one kind, data and named groups a block, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.polygons.topology import cell_of_corner, edge_keys, positions
from vemcvx.meshes.polyhedra import Listed
from vemcvx.meshes.tessellation import Tessellation

# Named groups of cells in files: physical groups of Gmsh, cell sets of other programs.
#
# Groups of what bounds cells (lines; surfaces, where there are solids) name parts of the boundary, groups of cells
# become cell data: 1 in the group, 0 outside.


def _kinds(blocks: Blocks) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """Dimension of the cells, their kinds, and the kinds of what bounds them."""
    if any(kind in SOLIDS for kind, _ in blocks.cells):
        return 3, SOLIDS, POLYGONS
    return 2, POLYGONS, ("line",)


def physical_groups(blocks: Blocks) -> tuple[Data, dict[str, Ints]]:
    """Data that put every named block into a physical group, and the numbers (tag, dimension) of their names.

    Other data stay behind: meshio writes them into a Gmsh file in a way that it cannot read.
    """
    dimension, inner, _ = _kinds(blocks)
    tags = [np.zeros(len(cells), dtype=np.int64) for _, cells in blocks.cells]
    for number, parts in enumerate(blocks.sides.values(), start=1):
        for tag, part in zip(tags, parts, strict=True):
            tag[part] = number
    for tag, (kind, _), given in zip(tags, blocks.cells, blocks.data.get(PHYSICAL, ()), strict=False):
        if kind in inner and not tag.any():
            tag[:] = given
    names = {name: np.array([number, dimension - 1]) for number, name in enumerate(blocks.sides, start=1)}
    return {PHYSICAL: tags, "gmsh:geometrical": tags}, names


def take_physical_groups(blocks: Blocks, names: Mapping[str, NDArray[Any]]) -> None:
    """Physical groups of a Gmsh file: those of sides by name or number, those of cells by name."""
    tags = blocks.data.get(PHYSICAL)
    blocks.data.pop("gmsh:geometrical", None)
    if tags is None:
        return
    dimension, inner, outer = _kinds(blocks)
    called = {(int(value[1]), int(value[0])): name for name, value in names.items() if np.shape(value) == (2,)}
    kinds = [kind for kind, _ in blocks.cells]
    on_sides = [part for part, kind in zip(tags, kinds, strict=True) if kind in outer]
    for tag in np.unique(np.concatenate(on_sides)).tolist() if on_sides else ():
        if tag:  # 0 is no group
            blocks.sides[called.get((dimension - 1, tag), str(tag))] = [part == tag for part in tags]
    for (rank, tag), name in called.items():
        if rank == dimension:
            blocks.sets[name] = [part == tag for part in tags]
    if not any(part.any() for part, kind in zip(tags, kinds, strict=True) if kind in inner):
        del blocks.data[PHYSICAL]


def take_sets(blocks: Blocks, sets: Mapping[str, list[Any]]) -> None:
    """Named sets of cells: those of sides are boundaries, those of cells cell data; a cell may be in several."""
    _, inner, outer = _kinds(blocks)
    for name, members in sets.items():
        if name.startswith("gmsh:"):
            continue
        parts = [np.zeros(len(cells), dtype=bool) for _, cells in blocks.cells]
        for part, chosen in zip(parts, members, strict=True):
            if chosen is not None:
                part[np.asarray(chosen, dtype=np.int64)] = True
        chosen_kinds = {kind for (kind, _), part in zip(blocks.cells, parts, strict=True) if part.any()}
        if chosen_kinds & set(outer):
            blocks.sides[name] = parts
        elif chosen_kinds & set(inner):
            blocks.sets[name] = parts


# A mesh as files hold it: cells in blocks of one kind, data in one array a block, and back.
#
# A block holds cells of one vertex count. In files that keep data, one block a count permutes the cells, the datum
# `CELL` carries the number of each, and reading restores the order; in others a block is a run of equal counts. Every
# named boundary goes along as a block of lines, marked by a datum
# "boundary:<name>" (1 on its lines, 0 elsewhere); otherwise lines have the data of the cells they bound, so that
# colouring by a datum looks the same with and without them. Where cells stand beside data that belong to no cell
# (field data), a boundary may instead be the datum "boundary:<name>" there: its edges (m, 2).
#
# An interface goes along as two boundaries: its own, edges of the first body, and "partners:<first>:<second>:<name>",
# edge by edge the nodes of the second body in the same places.


CELL, MARK, PARTNERS, PHYSICAL = "vemcvx:cell", "boundary:", "partners:", "gmsh:physical"
VTK_TYPES = {0: "empty", 1: "vertex", 3: "line", 4: "poly_line", 5: "triangle", 6: "triangle_strip", 7: "polygon"}
VTK_TYPES |= {21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 26: "wedge15", 28: "quad9"}
VTK_TYPES |= {8: "pixel", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 42: "polyhedron"}
POLYGONS = ("triangle", "quad", "polygon")
SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron")
PASSED_OVER = ("vertex", "empty")

Data = dict[str, list[NDArray[Any]]]


@dataclass
class Blocks:
    """Cells and their data, block by block.

    Attributes
    ----------
    cells : list of (kind, (m, k) int)
        Kinds are meshio's: "triangle", "quad", "polygon", "line" ...
    data : dict of str to list of (m, ...) arrays
        One array a block.
    sides, sets : dict of str to list of (m,) bool
        Named sets, one array a block: of what bounds cells (lines; in space, polygons), and of cells.
    edges : dict of str to (m, 2) int
        Named edges that are no cells; in space, named faces, (m, k) padded by -1.
    polyhedra : Listed, optional
        The faces of polyhedra, which blocks of the kind "polyhedron" name by numbers, (m, 1).
    """

    cells: list[tuple[str, Ints]]
    data: Data = field(default_factory=dict)
    sides: Data = field(default_factory=dict)
    sets: Data = field(default_factory=dict)
    edges: dict[str, Ints] = field(default_factory=dict)
    polyhedra: Listed | None = None


def vtk_types(counts: Ints) -> Ints:
    """VTK's types of polygons of so many vertices."""
    return np.select([counts == 3, counts == 4], [5, 9], 7)


def cell_blocks(mesh: Tessellation, cell_data: Mapping[str, NDArray[Any]], *, in_order: bool = False) -> Blocks:
    """Return the polygons of a mesh with the given data; see :func:`grouped`."""
    types = vtk_types(np.diff(mesh.offsets))
    return grouped(types, mesh.offsets, mesh.vertices, data=cell_data, in_order=in_order)


def grouped(
    types: Ints, offsets: Ints, vertices: Ints, *, data: Mapping[str, NDArray[Any]], in_order: bool = False
) -> Blocks:
    """Return cells of VTK's types block by block, and where that permutes them also their numbers.

    There is one block a type and vertex count, or, ``in_order``, a new one whenever these change.
    """
    counts = np.diff(offsets)
    kinds = counts * 256 + types
    blocks = Blocks([])
    if in_order:
        members = np.split(np.arange(len(kinds)), np.flatnonzero(np.diff(kinds)) + 1)
    else:
        members = [np.flatnonzero(kinds == kind) for kind in np.unique(kinds)]
    for cells in members:
        corners = vertices[offsets[cells, None] + np.arange(counts[cells[0]])]
        number = int(types[cells[0]])
        blocks.cells.append((VTK_TYPES.get(number, f"number {number} of VTK"), corners))
    if CELL not in data and np.any(np.diff(np.concatenate([[-1], *members])) != 1):
        data = {**data, CELL: np.arange(len(kinds))}
    for name, values in data.items():
        blocks.data[name] = [_storable(values)[cells] for cells in members]
    return blocks


def marked_edges(data: Mapping[str, Any], *, solid: bool = False) -> dict[str, Ints]:
    """Named boundaries among data that belong to no cell; MeshError where they are no pairs (no rows) of nodes."""
    named = {name.removeprefix(MARK): np.asarray(values) for name, values in data.items() if name.startswith(MARK)}
    for name, values in named.items():
        if values.dtype.kind not in "iu" or (values.ndim != 2 if solid else values.size % 2):
            wanted = "faces, rows of node numbers" if solid else "edges, pairs of node numbers"
            raise MeshError(f"its datum {MARK + name!r} is no list of {wanted}.")
    rows = {name: values if solid else values.reshape(-1, 2) for name, values in named.items()}
    return {name: values.astype(np.int64) for name, values in rows.items()}


def named_edges(mesh: Tessellation) -> dict[str, Ints]:
    """The names that a file has: boundaries but the whole, and partners at interfaces."""
    named = {name: edges for name, edges in mesh.boundaries.items() if name != WHOLE}
    for name, found in mesh.interfaces.items():
        first, second = (quote(body, safe="") for body in found.bodies)
        named[f"{PARTNERS}{first}:{second}:{name}"] = found.partners
    return named


def _take_interfaces(named: dict[str, Ints]) -> dict[str, Interface]:
    """Interfaces among the named edges of a file, which then are no boundaries any more."""
    found = {}
    for key in [name for name in named if name.startswith(PARTNERS) and name.count(":") > 2]:
        first, second, name = key.removeprefix(PARTNERS).split(":", 2)
        if name not in named:
            raise MeshError(f"it holds partners of an interface {name!r}, but no such boundary.")
        found[name] = Interface((unquote(first), unquote(second)), named.pop(name), named.pop(key))
    return found


def add_boundaries(blocks: Blocks, mesh: Tessellation) -> None:
    """Add a block of lines a named boundary, with the data of their cells, to ``blocks`` of all cells of the mesh."""
    owner = cell_of_corner(mesh.offsets)[mesh.shared_edges.alone]
    # of each cell in the data of all blocks
    place = np.argsort(np.concatenate(blocks.data[CELL])) if CELL in blocks.data else np.arange(mesh.n_cells)
    on_cells = {name: np.concatenate(parts) for name, parts in blocks.data.items()}
    named = named_edges(mesh)
    for edges in named.values():
        blocks.cells.append(("line", edges))
        cells = place[owner[positions(edges, mesh.boundaries[WHOLE], mesh.n_nodes)]]
        for name, parts in blocks.data.items():
            parts.append(on_cells[name][cells])
    first = len(blocks.cells) - len(named)
    for number, name in enumerate(named):
        blocks.sides[name] = [np.full(len(c), k == first + number) for k, (_, c) in enumerate(blocks.cells)]


def plane_mesh_of(points: Floats, blocks: Blocks) -> tuple[Tessellation, list[str]]:
    """Return the mesh of the polygons of a file, its lines as boundaries; and notes on lines inside it, left out."""
    polygons = [number for number, (kind, _) in enumerate(blocks.cells) if kind in POLYGONS]
    strange = [kind for kind, _ in blocks.cells if kind not in (*POLYGONS, *PASSED_OVER, "line")]
    if strange:
        raise MeshError(
            f"it holds cells of the kind {strange[0]!r}; wanted are plane polygons with straight edges (triangles, "
            "quads, polygons) and lines. Export the plane surface alone, with elements of first order."
        )
    if not polygons:
        raise MeshError(f"it holds no polygons, only {', '.join(kind for kind, _ in blocks.cells) or 'nothing'}.")
    ragged = [kind for kind, corners in blocks.cells if np.ndim(corners) != 2 and kind in POLYGONS]
    if ragged:
        raise MeshError(f"its cells of the kind {ragged[0]!r} do not all have as many nodes as that takes.")
    cells, order = _cells_in_order(blocks, polygons)
    named = {name: _marked_lines(blocks, parts) for name, parts in marked_sides(blocks).items()} | blocks.edges
    data = data_on(blocks, polygons, order)
    mesh = Tessellation(_plane(points), cells, cell_data=data, interfaces=_take_interfaces(named))
    return _with_lines(mesh, named)


def data_on(blocks: Blocks, chosen: Sequence[int], order: Ints) -> dict[str, NDArray[Any]]:
    """Data on the cells of the chosen blocks, one after the other and then in the given order; sets as 0 and 1."""
    data = {name: parts for name, parts in blocks.data.items() if name != CELL and not name.startswith(MARK)}
    data |= {name: [part.astype(np.uint8) for part in parts] for name, parts in blocks.sets.items()}
    whole = {name: np.concatenate([parts[k] for k in chosen])[order] for name, parts in data.items()}
    return {name: _native(values) for name, values in whole.items() if values.dtype.kind in "biuf"}


def marked_sides(blocks: Blocks) -> Data:
    """Named sets of what bounds cells: those marked by data, and those of the file's own."""
    return {name.removeprefix(MARK): p for name, p in blocks.data.items() if name.startswith(MARK)} | blocks.sides


def order_of(blocks: Blocks, chosen: Sequence[int]) -> Ints:
    """In which order to take the cells of the chosen blocks, laid one after the other."""
    if CELL in blocks.data:
        return np.argsort(np.concatenate([blocks.data[CELL][number] for number in chosen]), kind="stable")
    return np.arange(sum(len(blocks.cells[number][1]) for number in chosen))


def _cells_in_order(blocks: Blocks, polygons: Sequence[int]) -> tuple[list[Ints] | Ints, Ints]:
    rows = [blocks.cells[number][1] for number in polygons]
    order = order_of(blocks, polygons)
    if len({row.shape[1] for row in rows}) == 1:
        return np.concatenate(rows)[order], order
    flat = [cell for row in rows for cell in row]
    return [flat[number] for number in order], order


def _plane(points: Floats) -> Floats:
    """The points without a third coordinate that is the same everywhere."""
    points = np.asarray(points, dtype=float)
    if points.ndim == 2 and points.shape[1] == 3 and len(points):
        # A plane that was turned into place by the program that wrote the file is plane to its digits. Points that
        # are no numbers are left to the checks of the mesh, which name them.
        if np.ptp(points[:, 2]) > 1e-9 * np.nanmax(np.abs(points - points[0]), initial=0.0):
            raise MeshError(
                f"its points do not lie in a plane z = constant: z runs from {points[:, 2].min():.6g} to "
                f"{points[:, 2].max():.6g}. Turn the mesh into the x-y plane first."
            )
        return points[:, :2]
    return points


def _with_lines(mesh: Tessellation, named: Mapping[str, Ints]) -> tuple[Tessellation, list[str]]:
    """Name boundaries by lines; lines inside the mesh are left out, with a note."""
    notes, boundaries = [], {}
    boundary = mesh.boundaries[WHOLE]
    keys = edge_keys(boundary, mesh.n_nodes)
    for name, edges in named.items():
        number = np.arange(mesh.n_nodes) if mesh.node_map is None else mesh.node_map
        edges = np.where((edges >= 0) & (edges < len(number)), number[np.clip(edges, 0, len(number) - 1)], -1)
        wanted = np.isin(keys, edge_keys(edges, mesh.n_nodes)[(edges >= 0).all(axis=1)])
        inner = len(np.unique(np.sort(edges, axis=1), axis=0)) - np.count_nonzero(wanted)
        if inner:
            notes.append(f"{inner} of {len(edges)} lines named {name!r} are not on the boundary and are left out.")
        if wanted.any() and not (name == WHOLE and wanted.all()):
            boundaries[name] = boundary[wanted]
    return mesh.with_boundaries(boundaries), notes


def _marked_lines(blocks: Blocks, parts: list[NDArray[Any]]) -> Ints:
    lines = [c[part != 0] for (kind, c), part in zip(blocks.cells, parts, strict=True) if kind == "line"]
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *lines])


def _native(values: NDArray[Any]) -> NDArray[Any]:
    """Values in the byte order of this machine; legacy VTK files are big-endian."""
    return values.astype(values.dtype.newbyteorder("="))


def _storable(values: NDArray[Any]) -> NDArray[Any]:
    """Values in a type that files know: truth values as 0 and 1."""
    values = np.asarray(values)
    return values.astype(np.uint8) if values.dtype == bool else values
