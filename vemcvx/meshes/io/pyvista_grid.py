"""Meshes of PyVista: unstructured grids, cells in their order; named boundaries are field data, rows of nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.names import WHOLE
from vemcvx.meshes.io.blocks import MARK, SOLIDS, Blocks, grouped, marked_edges, named_edges, vtk_types
from vemcvx.meshes.io.polyhedra import POLYHEDRON, PREFIX, blocks_of_vtk
from vemcvx.meshes.io.solids import padded
from vemcvx.meshes.io.unsafe import check_data
from vemcvx.meshes.io.vtu import face_stream
from vemcvx.meshes.polygons.topology import rows_in_order
from vemcvx.meshes.polyhedra.topology import listed_faces
from vemcvx.meshes.space_tessellation import SpaceTessellation
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
    if (types == POLYHEDRON).any():
        arrays = {"types": types, "offsets": offsets[1:], "connectivity": vertices, **_face_arrays(grid)}
        blocks = blocks_of_vtk({PREFIX + name: values for name, values in arrays.items()}, on_cells)
    else:
        blocks = grouped(types, offsets, vertices, data=on_cells)
    check_data(blocks)
    blocks.edges.update(marked_edges(data.field_data, solid=any(kind in SOLIDS for kind, _ in blocks.cells)))
    return np.array(grid.points), blocks


def _face_arrays(grid: Any) -> dict[str, Ints]:
    """The faces of polyhedra, in the names that files give them."""
    import pyvista

    if not hasattr(grid, "GetPolyhedronFaces"):
        raise MeshError("polyhedra are taken from PyVista with VTK 9.4 or newer; write a .vtu file and read that.")
    arrays = {}
    for cells, ends, entries in (
        (grid.GetPolyhedronFaces(), "face_offsets", "face_connectivity"),
        (grid.GetPolyhedronFaceLocations(), "polyhedron_offsets", "polyhedron_to_faces"),
    ):
        arrays[ends] = np.asarray(pyvista.convert_array(cells.GetOffsetsArray()), dtype=np.int64)[1:]
        arrays[entries] = np.asarray(pyvista.convert_array(cells.GetConnectivityArray()), dtype=np.int64)
    return arrays


def to_pyvista(mesh: Tessellation | SpaceTessellation) -> Any:
    """UnstructuredGrid with the cells in their order."""
    import pyvista

    if isinstance(mesh, SpaceTessellation):
        stream, ends = face_stream(listed_faces(mesh.faces))
        cells = np.insert(stream, ends - np.diff(ends, prepend=0), np.diff(ends, prepend=0))
        types = np.full(mesh.n_cells, POLYHEDRON)
        named = {
            name: padded(*rows_in_order(mesh.face_offsets, mesh.face_vertices, faces))
            for name, faces in mesh.boundaries.items()
            if name != WHOLE
        }
    else:
        counts = np.diff(mesh.offsets)
        cells, types, named = np.insert(mesh.vertices, mesh.offsets[:-1], counts), vtk_types(counts), named_edges(mesh)
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
    grid = pyvista.UnstructuredGrid(cells, types.astype(np.uint8), points)
    for name, values in mesh.cell_data.items():
        grid.cell_data[name] = np.array(values)
    for name, rows in named.items():
        grid.field_data[MARK + name] = np.array(rows)
    return grid
