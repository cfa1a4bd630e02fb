"""Conversion from and to meshes of meshio, with Gmsh's physical groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Ints
from vemcvx.meshes.io.grid import CELL, DIGITS, MARK, NODES, PHYSICAL, POLYGONS, SOLIDS, Grid, keep_corners
from vemcvx.meshes.io.vtu import with_parts
from vemcvx.meshes.polygons import offsets_of

if TYPE_CHECKING:
    import meshio

Group = tuple[int, int]  # dimension and number of a physical group or geometrical entity
GEOMETRICAL = "gmsh:geometrical"


def from_meshio(mesh: Any) -> Grid:
    """Convert a mesh of meshio, with data, named sets and physical groups."""
    grid = cells_of(mesh)
    names = {(int(x[1]), int(x[0])): name for name, x in mesh.field_data.items() if np.shape(x) == (2,)}
    if PHYSICAL in grid.data:
        take_groups(grid, grid.data.pop(PHYSICAL), names)
    return with_parts(grid, mesh.field_data)


def cells_of(mesh: Any) -> Grid:
    """Convert a mesh of meshio, without physical groups."""
    rows: list[Ints] = []
    for block in mesh.cells:  # blocks of unknown kinds may have no array
        known = block.type.rstrip(DIGITS) in {*NODES, "polygon"}
        rows.append(np.asarray(block.data if known else np.zeros((len(block.data), 1))).astype(np.int64))
    sizes, none = [len(row) for row in rows], np.zeros(0, dtype=np.int64)
    grid = Grid(
        mesh.points,
        np.repeat(np.array([block.type for block in mesh.cells], dtype=str), sizes),
        offsets_of(np.concatenate([none, *(np.full(len(row), row.shape[1]) for row in rows)])),
        np.concatenate([none, *(row.ravel() for row in rows)]),
        {name: np.concatenate(parts) if parts else none for name, parts in mesh.cell_data.items()},
    )
    for name, members in mesh.cell_sets.items():
        if not name.startswith("gmsh:"):
            some = [(start, m) for start, m in zip(offsets_of(np.array(sizes)), members, strict=False) if m is not None]
            chosen = np.concatenate([none, *(start + np.asarray(m, dtype=np.int64) for start, m in some)])
            grid.sets[name] = np.isin(np.arange(len(grid.kinds)), chosen)
    for name, nodes in mesh.point_sets.items():
        grid.nodes[name] = np.isin(np.arange(len(mesh.points)), np.asarray(nodes, dtype=np.int64))
    return keep_corners(grid)


def take_groups(
    grid: Grid, numbers: Ints, names: Mapping[Group, str], groups: Mapping[Group, Sequence[int]] | None = None
) -> None:
    """Add a set of cells for each physical group."""
    dimension = np.select([np.isin(grid.kinds, SOLIDS), np.isin(grid.kinds, POLYGONS), grid.kinds == "line"], [3, 2, 1])
    first = np.zeros(len(numbers), dtype=np.int64)
    for dim, number in np.unique(np.column_stack([dimension, numbers]), axis=0).tolist():
        members = (dimension == dim) & (numbers == number)
        here = [number] if groups is None else groups.get((dim, number), ())
        for group in (one for one in here if one):
            name = names.get((dim, group), str(group))
            grid.sets[name] = grid.sets.get(name, False) | members
            first[members & (first == 0)] = group
    grid.data.pop(GEOMETRICAL, None)
    if first[grid.bounding[0]].any():
        grid.data[PHYSICAL] = first
    grid.bodies = tuple(name for name, chosen in grid.sets.items() if (chosen & grid.bounding[0]).any())


def to_meshio(grid: Grid) -> meshio.Mesh:
    """Return a mesh of meshio. The cell datum `CELL` holds the old positions of cells."""
    import meshio

    counts = np.diff(grid.offsets)
    _, first, kind = np.unique(np.char.add(grid.kinds, counts.astype(str)), return_index=True, return_inverse=True)
    kind = np.argsort(np.argsort(first))[kind]
    order = np.argsort(kind, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)
    data: dict[str, NDArray[Any]] = grid.data | {MARK + name: x.astype(np.uint8) for name, x in grid.sets.items()}
    if (order != np.arange(len(order))).any():
        data = {**data, CELL: np.arange(len(order))}
    return meshio.Mesh(
        np.pad(grid.points, ((0, 0), (0, 3 - grid.points.shape[1]))),
        [(str(grid.kinds[m[0]]), grid.vertices[grid.offsets[m, None] + np.arange(counts[m[0]])]) for m in members],
        cell_data={name: [values[m] for m in members] for name, values in data.items()},
    )
