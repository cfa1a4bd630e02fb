"""Meshes of scikit-fem, PyVista and meshio, taken and given."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from vemcvx.arrays import Floats, Ints, brief
from vemcvx.errors import MeshError, MeshWarning, VemcvxError
from vemcvx.meshes.box import WHOLE, matching_faces
from vemcvx.meshes.io.blocks import (
    MARK,
    SOLIDS,
    Blocks,
    add_boundaries,
    cell_blocks,
    grouped,
    marked_edges,
    named_edges,
    vtk_types,
)
from vemcvx.meshes.io.meshio_mesh import blocks_of, finished, mesh_of, meshio_mesh, named, translated
from vemcvx.meshes.io.readers import check_data
from vemcvx.meshes.io.solids import POLYHEDRON, PREFIX, blocks_of_vtk, by_vertices, padded, solid_blocks
from vemcvx.meshes.io.vtu import face_stream
from vemcvx.meshes.polygons.geometry import polygon_centroids
from vemcvx.meshes.polygons.topology import positions, rows_in_order
from vemcvx.meshes.polyhedra import listed_faces
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

# Meshes of scikit-fem: cells of one kind, named facets, named sets of cells.


PLANE = {"ElementTriP1": "triangle", "ElementQuad1": "quad"}
KINDS = {**PLANE, "ElementTetP1": "tetra", "ElementHex1": "hexahedron"}
# Where scikit-fem has the vertices of a hexahedron that runs around its bottom, then around its top.
HEXAHEDRON = np.array([0, 3, 6, 2, 1, 5, 7, 4])


def from_skfem(mesh: Any) -> tuple[Floats, Blocks]:
    """Points and cells; named facets are boundaries, subdomains cell data."""
    element = mesh.elem.__name__
    points, cells = np.asarray(mesh.doflocs).T, np.array(mesh.t, dtype=np.int64).T
    if element == "ElementHex1":
        cells = cells[:, HEXAHEDRON]
    if element in PLANE:  # either way around is usual: triangles, say, are sorted by the numbers of their vertices
        clockwise = polygon_centroids(points[cells])[0] < 0.0
        cells[clockwise, 1:] = cells[clockwise, :0:-1]
    blocks = Blocks([(KINDS.get(element, element), cells)])
    for name, facets in (mesh.boundaries or {}).items():
        blocks.edges[name] = np.asarray(mesh.facets, dtype=np.int64)[:, np.asarray(facets)].T
    for name, members in (mesh.subdomains or {}).items():
        blocks.sets[name] = [np.isin(np.arange(len(cells)), members)]
    return points, blocks


def to_skfem(mesh: Tessellation | SpaceTessellation) -> tuple[Any, list[str]]:
    """MeshTri, MeshQuad, MeshTet or MeshHex, and the names of cell data that it does not keep."""
    made = _solid(mesh) if isinstance(mesh, SpaceTessellation) else _plane(mesh)
    facets: Ints = made.facets.T.astype(np.int64)
    named = {name: parts for name, parts in mesh.boundaries.items() if name != WHOLE}
    if isinstance(mesh, SpaceTessellation):
        # The number of the boundary face that each facet is, -1 inside.
        faces = matching_faces(mesh.faces, np.arange(len(facets) + 1) * facets.shape[1], facets.ravel())
        sides = {name: np.flatnonzero(np.isin(faces, chosen)) for name, chosen in named.items()}
    else:
        sides = {name: positions(edges, facets, mesh.n_nodes) for name, edges in named.items()}
    sets = {name: np.flatnonzero(v) for name, v in mesh.cell_data.items() if v.ndim == 1 and np.isin(v, (0, 1)).all()}
    return made.with_boundaries(sides).with_subdomains(sets), sorted(set(mesh.cell_data) - set(sets))


def _plane(mesh: Tessellation) -> Any:
    import skfem

    counts = np.unique(np.diff(mesh.offsets)).tolist()
    if counts not in ([3], [4]):
        found = " or ".join(map(str, counts))
        raise MeshError(f"scikit-fem has meshes of triangles or of quadrilaterals; here, cells have {found} vertices.")
    kind = skfem.MeshTri if counts == [3] else skfem.MeshQuad
    return kind(mesh.points.T.copy(), mesh.vertices.reshape(-1, *counts).T.copy())


def _solid(mesh: SpaceTessellation) -> Any:
    import skfem

    types, offsets, vertices = by_vertices(mesh)
    if len(np.unique(types)) > 1 or types[0] not in (10, 12):
        raise MeshError("scikit-fem has meshes of tetrahedra or of hexahedra; here, there are other cells.")
    cells = vertices.reshape(-1, offsets[1])
    if types[0] == 10:
        return skfem.MeshTet(mesh.points.T.copy(), cells.T.copy())
    return skfem.MeshHex(mesh.points.T.copy(), cells[:, np.argsort(HEXAHEDRON)].T.copy())


# Meshes of PyVista: unstructured grids, cells in their order; named boundaries are field data, rows of nodes.


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


# Meshes of other libraries in memory: which library an object is of, and the way there and back.


CALLED = {"meshio": "meshio", "skfem": "scikit-fem", "pyvista": "PyVista"}
MESHES = {("meshio", "Mesh"), ("skfem", "Mesh"), ("pyvista", "DataSet")}


def from_object(other: Any) -> Tessellation | SpaceTessellation:
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
    ways: dict[str, Callable[[Any], tuple[Floats, Blocks]]] = {"skfem": from_skfem, "pyvista": from_pyvista}

    def made() -> tuple[Tessellation | SpaceTessellation, list[str]]:
        with translated(subject, "cannot be converted"):
            points, blocks = ways.get(library, _from_meshio)(other)
        with named(subject):
            return mesh_of(points, blocks)

    return finished(subject, made)


def to_object(mesh: Tessellation | SpaceTessellation, library: str) -> Any:
    """A mesh as an object of a library: see `PolygonMesh.to`."""
    if not isinstance(library, str) or library not in CALLED:
        raise MeshError(f"a mesh goes to {', '.join(map(repr, CALLED))}; got {brief(library)}. To a file: write(path).")
    try:
        if library == "meshio":
            return _to_meshio(mesh)
        if library == "pyvista":
            return to_pyvista(mesh)
        made, lost = to_skfem(mesh)
    except ImportError:
        package = {"skfem": "scikit-fem", "pyvista": "'vemcvx[view]'"}[library]
        raise VemcvxError(f"this needs {CALLED[library]}, which is not installed: pip install {package}") from None
    if lost:
        names = ", ".join(map(repr, lost))
        warnings.warn(f"meshes of scikit-fem keep only sets of cells (0 or 1), not {names}.", MeshWarning, stacklevel=3)
    if mesh.interfaces:
        names = ", ".join(map(repr, mesh.interfaces))
        warnings.warn(
            f"meshes of scikit-fem keep no interfaces: of {names} the edges of the first body stay, as boundaries.",
            MeshWarning,
            stacklevel=3,
        )
    return made


def _from_meshio(mesh: Any) -> tuple[Floats, Blocks]:
    return mesh.points, blocks_of(mesh)


def _to_meshio(mesh: Tessellation | SpaceTessellation) -> Any:
    if isinstance(mesh, SpaceTessellation):
        return meshio_mesh(mesh.points, solid_blocks(mesh))
    blocks = cell_blocks(mesh, mesh.cell_data)
    add_boundaries(blocks, mesh)
    return meshio_mesh(mesh.points, blocks)
