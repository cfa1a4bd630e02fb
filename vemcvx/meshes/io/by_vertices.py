"""Tetrahedra, hexahedra, wedges and pyramids told by their faces, and given by their vertices as other programs do."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.names import WHOLE
from vemcvx.meshes.io.blocks import CELL, Blocks, grouped, vtk_types
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, offsets_of, rows_in_order
from vemcvx.meshes.polyhedra.topology import Listed, listed_faces
from vemcvx.meshes.space_tessellation import SpaceTessellation

# Numbers of nodes, faces and triangles -> VTK's type.
SHAPES = {(4, 4, 4): 10, (8, 6, 0): 12, (6, 5, 2): 13, (5, 5, 4): 14}


def solid_blocks(mesh: SpaceTessellation, *, in_order: bool = False, sides: bool = True) -> Blocks:
    """The cells of a mesh, in blocks (see :func:`vemcvx.meshes.io.blocks.grouped`), and its named boundaries as more.

    Raises
    ------
    MeshError
        Some cell is none of the four shapes.
    """
    types, offsets, vertices = by_vertices(mesh)
    blocks = grouped(types, offsets, vertices, data=mesh.cell_data, in_order=in_order)
    return _with_sides(blocks, mesh) if sides else blocks


def by_vertices(mesh: SpaceTessellation) -> tuple[Ints, Ints, Ints]:
    """VTK's type of each cell, and offsets and vertices in VTK's order; MeshError if a cell is none of the shapes."""
    listed = listed_faces(mesh.faces)
    nodes = np.diff(mesh.cell_nodes[0])
    triangles = np.add.reduceat(np.diff(listed.offsets) == 3, listed.cell_offsets[:-1], dtype=np.int64)
    types = np.zeros(mesh.n_cells, dtype=np.int64)
    for shape, number in SHAPES.items():
        types[(np.column_stack([nodes, np.diff(mesh.cell_offsets), triangles]) == shape).all(axis=1)] = number
    # The bottom is the first face; of wedges the first triangle, of pyramids the quadrilateral.
    wanted = np.where(types == 13, 3, np.where(types == 14, 4, np.diff(listed.offsets)[listed.cell_offsets[:-1]]))
    cell = cell_of_corner(listed.cell_offsets)
    fitting = np.flatnonzero(np.diff(listed.offsets) == wanted[cell])
    bottom = fitting[np.unique(cell[fitting], return_index=True)[1]]
    rows, around = rows_in_order(listed.offsets, listed.vertices, bottom[types[cell[bottom]] > 0])
    counts = np.diff(rows)
    mirrored = np.repeat(rows[:-1] + rows[1:] - 1, counts) - np.arange(len(around))
    around = around[mirrored]
    above = _above(mesh, listed, around, np.repeat(np.flatnonzero(types > 0), counts))
    own = np.repeat(types[types > 0], counts)
    first = np.zeros(len(around), dtype=bool)
    first[rows[:-1]] = True
    kept = np.isin(own, (12, 13)) | first  # over a bottom there is one apex, or a node a corner
    if (types == 0).any() or (above[kept] < 0).any():
        strange = int(np.flatnonzero(types == 0)[0]) if (types == 0).any() else int(np.argmin(above))
        raise MeshError(
            f"tetrahedra, hexahedra, wedges and pyramids alone are given by their vertices, and cell {strange} is none "
            f"of them. Polyhedra go into .vtu files and to PyVista."
        )
    owner = np.repeat(np.arange(mesh.n_cells), counts)
    whole = np.concatenate([around, above[kept]])
    cells = np.concatenate([owner, owner[kept]])
    return types, offsets_of(np.bincount(cells)), whole[np.argsort(cells, kind="stable")]


def _above(mesh: SpaceTessellation, listed: Listed, around: Ints, cells: Ints) -> Ints:
    """The node that an edge leads to from each node of a bottom, away from it; -1 where that is not one."""
    n = mesh.n_nodes
    ends = directed_edges(listed.offsets, listed.vertices)
    cell = cell_of_corner(listed.cell_offsets)[cell_of_corner(listed.offsets)]
    on = np.sort(cells * n + around)
    up = np.isin(cell * n + ends[:, 0], on) & ~np.isin(cell * n + ends[:, 1], on)
    keys = (cell * n + ends[:, 0])[up]
    order = np.argsort(keys, kind="stable")
    first, last = (np.searchsorted(keys[order], cells * n + around, side=side) for side in ("left", "right"))
    return np.where(last - first == 1, np.append(ends[up, 1][order], -1)[first], -1)


def _with_sides(blocks: Blocks, mesh: SpaceTessellation) -> Blocks:
    """Add blocks of triangles and quadrilaterals for every named boundary, with the data of their cells."""
    place = np.argsort(np.concatenate(blocks.data[CELL])) if CELL in blocks.data else np.arange(mesh.n_cells)
    on_cells = {name: np.concatenate(parts) for name, parts in blocks.data.items()}
    marks: list[str | None] = [None] * len(blocks.cells)
    named = {name: faces for name, faces in mesh.boundaries.items() if name != WHOLE}
    for name, faces in named.items():
        counts = np.diff(mesh.face_offsets)[faces]
        for count in np.unique(counts):
            chosen = faces[counts == count]
            kind = {5: "triangle", 9: "quad"}[int(vtk_types(count))]
            blocks.cells.append((kind, mesh.face_vertices[mesh.face_offsets[chosen, None] + np.arange(count)]))
            marks.append(name)
            for datum, parts in blocks.data.items():
                parts.append(on_cells[datum][place[mesh.face_cells[chosen, 0]]])
    for name in named:
        blocks.sides[name] = [
            np.full(len(cells), mark == name) for mark, (_, cells) in zip(marks, blocks.cells, strict=True)
        ]
    return blocks
