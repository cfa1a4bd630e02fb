"""Meshes of other libraries in memory: which library an object is of, and the way there and back."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

from vemcvx.arrays import Floats, brief
from vemcvx.errors import MeshError, MeshWarning, VemcvxError
from vemcvx.meshes.io.blocks import Blocks, add_boundaries, cell_blocks
from vemcvx.meshes.io.by_vertices import solid_blocks
from vemcvx.meshes.io.meshio_mesh import blocks_of, meshio_mesh
from vemcvx.meshes.io.messages import finished, named, translated
from vemcvx.meshes.io.pyvista_grid import from_pyvista, to_pyvista
from vemcvx.meshes.io.reading import mesh_of
from vemcvx.meshes.io.skfem_mesh import from_skfem, to_skfem
from vemcvx.meshes.space_tessellation import SpaceTessellation
from vemcvx.meshes.tessellation import Tessellation

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
