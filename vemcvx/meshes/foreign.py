"""Meshes from elsewhere: files and objects of other libraries."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from vemcvx.arrays import brief
from vemcvx.errors import MeshError, MeshWarning, SceneError
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.io.files import load, load_bodies
from vemcvx.meshes.io.objects import from_object
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.meshes.several_bodies import bodies as joined
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

# Meshes of the plane or of space, and the sentence that refuses the latter where only the former will do.


AnyMesh = PolygonMesh | PolyhedralMesh


def plane_mesh(mesh: AnyMesh, subject: str, instead: str = "") -> PolygonMesh:
    """The mesh, if it is of polygons.

    Raises
    ------
    SceneError
        It is of polyhedra; `subject` exists in the plane only, and `instead` says what to do.
    """
    if isinstance(mesh, PolyhedralMesh):
        raise SceneError(
            f"{subject}: exists in the plane only, and this mesh is of polyhedra{instead and f'; {instead}'}."
        )
    return mesh


# Meshes out of files and of the objects of other libraries.


# To checkers of types, what is read may be anything beside a PolygonMesh: scripts that know their files need no cast.
def read(path: str | Path, bodies: str | None = None) -> PolygonMesh | Any:
    """Read a mesh from a file of Gmsh (.msh), VTK (.vtu, .vtk, .vtp), Abaqus (.inp) or Nastran (.bdf, .nas, .fem).

    Where there are tetrahedra, hexahedra, wedges, pyramids or polyhedra, it is a mesh in space of these. Hexahedra,
    wedges and pyramids must have plane faces: mesh bodies where they would be warped with tetrahedra, or hand in cells
    of your own whose warped faces are two triangles each, the same in both cells. Cells of second order (triangle6,
    quad8, quad9, tetra10, hexahedron20, hexahedron27 ...) are read by their corners, with straight edges.

    Named boundaries are those that `write` of a mesh wrote, or the physical groups of lines (in space, of surfaces) of
    a Gmsh file, their number if they have no name. Cell data come along; a physical group of cells is a cell datum of
    its name, 1 in the group and 0 outside. Node and cell order are the file's; of plane meshes, a constant third
    coordinate is dropped.

    If the file names no part of the boundary, what lies where x, y or z is least or greatest is called as families of
    meshes call it ("left", "right", "bottom" and "top" in the plane): a `MeshWarning` says which there are.

    Parameters
    ----------
    path : str or Path
        The file; its suffix tells the format. `meshio convert a.xyz a.vtu` converts files of other formats.
    bodies : "physical", optional
        Make a body of every physical group of cells, as :func:`vemcvx.meshes.bodies` joins them: where groups meet, in
        nodes that they share or that are double, there is an interface. Boundaries are called "plate.rim", and an
        interface "plate|pin", or as the physical group of lines (in space, of surfaces) that is all of it.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The mesh, checked.

    Raises
    ------
    MeshError
        There is no such file, it is damaged or foreign, or what it holds is no valid mesh.

    Warns
    -----
    MeshWarning
        Cells were turned, unused nodes or those between the corners of cells of second order dropped, named lines or
        faces inside the mesh or on interfaces left out, or sides named.
    """
    if bodies is None:
        return _with_methods(load(path))
    if not isinstance(bodies, str) or bodies != "physical":
        raise MeshError(f"read: found bodies = {brief(bodies)}; there is 'physical', or None for one mesh.")
    found, sides = load_bodies(path)
    meshes: dict[str, Any] = {name: _with_methods(mesh) for name, mesh in found.items()}
    mesh = joined(meshes)
    lost = {
        (body, side): len(own.boundaries[side])
        for body, own in meshes.items()
        for side in sides.intersection(own.boundaries)
        if f"{body}.{side}" not in mesh.boundaries
    }
    return mesh._replace(interfaces=MappingProxyType(_named_by_groups(str(path), mesh.interfaces, lost)))


def _named_by_groups(
    path: str, interfaces: Mapping[str, Interface], lost: Mapping[tuple[str, str], int]
) -> dict[str, Interface]:
    """The interfaces, under the names of groups that are all of one; a warning names the other groups on interfaces.

    `lost` are bodies and groups of which nothing is outside of interfaces, and how many sides of cells each has.
    """
    groups = sorted({side for _, side in lost})
    named: dict[str, list[str]] = {side: [] for side in groups}
    for name, found in interfaces.items():
        for side in groups:
            if all(lost.get((body, side)) == len(found.edges) for body in found.bodies):
                named[side].append(name)
    called = {names[0]: side for side, names in named.items() if len(names) == 1}
    kept = {called.get(name, name): found for name, found in interfaces.items()}
    left = ", ".join(repr(side) for side in groups if side not in kept)
    if left:
        warnings.warn(
            f"{path}: the sides named {left} are on interfaces, which are called {', '.join(map(repr, kept))}: a name "
            "is kept if it is of all of one interface.",
            MeshWarning,
            stacklevel=3,
        )
    return kept


def convert(other: Any) -> PolygonMesh | Any:
    """Return the mesh that an object of another library holds; `to` of a mesh is the way back.

    Order, names and data are kept, sides without names are named, and the mesh is checked, all as in :func:`read`.

    Parameters
    ----------
    other : meshio.Mesh, skfem.MeshTri, MeshQuad, MeshTet or MeshHex, pyvista.UnstructuredGrid or PolyData
        Boundaries are named by cell sets of lines (in space, of polygons) or physical groups (meshio), named boundaries
        (scikit-fem), and by what `to` of a mesh makes of them. Subdomains and cell sets are cell data, 1 inside and 0
        outside.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The mesh, checked; what is raised and warned of is as of :func:`read`.
    """
    return _with_methods(from_object(other))


def _with_methods(found: Tessellation | SpaceTessellation) -> PolygonMesh | PolyhedralMesh:
    kind: type[PolygonMesh | PolyhedralMesh] = PolygonMesh if isinstance(found, Tessellation) else PolyhedralMesh
    mesh = object.__new__(kind)
    mesh.__dict__.update(found.__dict__)
    return mesh
