"""Meshes of PyVista: unstructured grids, cells in their order; named boundaries are field data, their edges (m, 2)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.errors import MeshError
from vemcvx.meshes.io.blocks import MARK, Blocks, grouped, marked_edges, named_edges, vtk_types
from vemcvx.meshes.io.unsafe import check_data
from vemcvx.meshes.tessellation import Tessellation


def from_pyvista(data: Any) -> tuple[Floats, Blocks]:
    """Points and cells of UnstructuredGrid, PolyData or whatever else casts to a grid."""
    import pyvista

    if not data.n_cells:
        raise MeshError("it holds no cells.")
    grid = data if isinstance(data, pyvista.UnstructuredGrid) else data.cast_to_unstructured_grid()
    offsets = np.asarray(pyvista.convert_array(grid.GetCells().GetOffsetsArray()), dtype=np.int64)
    vertices = np.asarray(grid.cell_connectivity, dtype=np.int64)
    types = np.asarray(grid.celltypes, dtype=np.int64)
    on_cells = {name: np.array(values) for name, values in grid.cell_data.items()}
    blocks = grouped(types, offsets, vertices, data=on_cells)
    check_data(blocks)
    blocks.edges.update(marked_edges(data.field_data))
    return np.array(grid.points), blocks


def to_pyvista(mesh: Tessellation) -> Any:
    """UnstructuredGrid with the cells in their order."""
    import pyvista

    counts = np.diff(mesh.offsets)
    cells = np.insert(mesh.vertices, mesh.offsets[:-1], counts)
    grid = pyvista.UnstructuredGrid(cells, vtk_types(counts).astype(np.uint8), np.pad(mesh.points, ((0, 0), (0, 1))))
    for name, values in mesh.cell_data.items():
        grid.cell_data[name] = np.array(values)
    for name, edges in named_edges(mesh).items():
        grid.field_data[MARK + name] = np.array(edges)
    return grid
