"""Conversion from and to meshes of meshio, scikit-fem and PyVista."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.base.arrays import brief
from vemcvx.base.errors import MeshError, VemcvxError
from vemcvx.meshes.interfaces import pad_rows
from vemcvx.meshes.io.blocks import from_meshio, to_meshio
from vemcvx.meshes.io.grid import (
    MARK,
    PARTNERS,
    AnyTessellation,
    Grid,
    finish_mesh,
    grid_of,
    list_named_parts,
    translate_errors,
)
from vemcvx.meshes.io.vtu import read_vtu, with_parts, write_vtu
from vemcvx.meshes.polygons import polygon_centroids

PLANE = {"ElementTriP1": "triangle", "ElementQuad1": "quad"}
KINDS = {**PLANE, "ElementTetP1": "tetra", "ElementHex1": "hexahedron"}
HEXAHEDRON = np.array([0, 3, 6, 2, 1, 5, 7, 4])  # Vertices of scikit-fem around the bottom, then around the top.


def from_skfem(mesh: Any) -> Grid:
    """Return the grid of a mesh of scikit-fem."""
    element = mesh.elem.__name__
    points, cells = np.asarray(mesh.doflocs).T, np.array(mesh.t, dtype=np.int64).T
    if element == "ElementHex1":
        cells = cells[:, HEXAHEDRON]
    if element in PLANE:  # scikit-fem may sort vertices by number, so some cells are clockwise
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


def to_skfem(mesh: AnyTessellation) -> Any:
    """Return a mesh of scikit-fem, without interfaces."""
    import skfem.io.meshio

    grid, n = grid_of(mesh, data=False), mesh.n_cells
    kinds = sorted(set(grid.kinds[:n].tolist()))
    if kinds[1:] or kinds[0] not in KINDS.values():
        wanted = "tetrahedra or of hexahedra" if grid.solid else "triangles or of quadrilaterals"
        raise MeshError(f"scikit-fem needs meshes of {wanted}; this mesh has cells of the kind {' and '.join(kinds)}.")
    sides, grid.sets = grid.sets, {}
    theirs = to_meshio(grid)
    theirs.cell_sets = {
        name: [np.flatnonzero(side[:n]), np.flatnonzero(side[n:])]
        for name, side in sides.items()
        if not name.startswith(PARTNERS)
    }
    sets = {name: np.flatnonzero(x) for name, x in mesh.cell_data.items() if x.ndim == 1 and np.isin(x, (0, 1)).all()}
    return skfem.io.meshio.from_meshio(theirs).with_subdomains(sets)


def from_pyvista(data: Any) -> Grid:
    """Return the grid of a data set of PyVista."""
    import pyvista

    if not data.n_cells:
        raise MeshError("it has no cells.")
    grid = data.copy() if isinstance(data, pyvista.UnstructuredGrid) else data.cast_to_unstructured_grid()
    values, fields = ({name: np.array(x) for name, x in of.items()} for of in (grid.cell_data, data.field_data))
    grid.clear_data()  # a VTK file does not keep all names
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.vtu"
        grid.save(file)
        return with_parts(replace(read_vtu(file.read_bytes()), data=values), fields)


def to_pyvista(mesh: AnyTessellation) -> Any:
    """Return a mesh as an UnstructuredGrid of PyVista."""
    import pyvista

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.vtu"
        write_vtu(file, grid_of(mesh, polyhedra=True, sides=False))
        grid = pyvista.read(file)
    for name, rows in list_named_parts(mesh).items():
        grid.field_data[MARK + name] = pad_rows(*rows)
    return grid


LIBRARIES = {"meshio": "meshio", "skfem": "scikit-fem", "pyvista": "PyVista"}
MESHES = {("meshio", "Mesh"), ("skfem", "Mesh"), ("pyvista", "DataSet")}


def convert(other: Any) -> AnyTessellation | Any:
    """Convert an object of another library to a mesh; ``mesh.to(library)`` is the inverse.

    Parameters
    ----------
    other : meshio.Mesh, skfem.MeshTri, MeshQuad, MeshTet or MeshHex, pyvista.UnstructuredGrid or PolyData
        Named boundaries become boundaries, and so do sets and groups of edges or faces. Subdomains, sets and groups of
        cells become cell data of 0 and 1.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The checked mesh.

    Raises
    ------
    MeshError
        ``other`` is an object of another type, or not a valid mesh.

    Examples
    --------
    >>> vx.meshes.convert(vx.meshes.squares(4).to("meshio")).n_cells
    16
    """
    kinds = {(kind.__module__.partition(".")[0], kind.__name__) for kind in type(other).__mro__}
    if not kinds & MESHES:
        raise MeshError(
            f"convert takes meshio.Mesh, MeshTri, MeshQuad, MeshTet and MeshHex of scikit-fem, UnstructuredGrid and "
            f"PolyData of PyVista; got {brief(other)}. For a file, use read(path); for points and cells, "
            "PolygonMesh(points, cells) or PolyhedralMesh(points, cells)."
        )
    library = (kinds & MESHES).pop()[0]
    subject = f"the mesh of {LIBRARIES[library]}"
    with translate_errors(subject, "cannot be converted"):
        grid = {"meshio": from_meshio, "skfem": from_skfem, "pyvista": from_pyvista}[library](other)
    return finish_mesh(subject, grid)


def to_object(mesh: AnyTessellation, library: str) -> Any:
    """Return a mesh as an object of a library: see `PolygonMesh.to`."""
    if not isinstance(library, str) or library not in LIBRARIES:
        known = ", ".join(map(repr, LIBRARIES))
        raise MeshError(f"to: library must be one of {known}; got {brief(library)}. For a file, use write(path).")
    try:
        if library == "meshio":
            return to_meshio(grid_of(mesh))
        return to_pyvista(mesh) if library == "pyvista" else to_skfem(mesh)
    except ImportError:
        package = {"skfem": "scikit-fem", "pyvista": "'vemcvx[view]'"}[library]
        raise VemcvxError(f"this needs {LIBRARIES[library]}, which is not installed: pip install {package}") from None
