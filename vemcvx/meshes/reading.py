"""Meshes read from files, and taken from objects of other libraries."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from vemcvx.base.arrays import Ints, brief
from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import faces_of
from vemcvx.meshes.io.files import load, load_bodies
from vemcvx.meshes.io.objects import from_object
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.several_bodies import describe_gaps, join


# To checkers of types, what is read may be anything beside a PolygonMesh: scripts that know their files need no cast.
def read(path: str | Path, bodies: str | None = None, *, tolerance: float | None = None) -> PolygonMesh | Any:
    """Read a mesh from a file of VTK (.vtu), Gmsh (.msh), Abaqus (.inp) or Nastran (.bdf, .nas, .fem).

    Where there are tetrahedra, hexahedra, wedges, pyramids or polyhedra, it is a mesh in space of these. Hexahedra,
    wedges and pyramids must have plane faces: mesh bodies where they would be warped with tetrahedra, or hand in cells
    of your own whose warped faces are two triangles each, the same in both cells. Cells of higher order (triangle6,
    quad8, quad9, tetra10, hexahedron20, hexahedron27 ...) are read by their corners, with straight edges.

    Named boundaries are those that `write` of a mesh wrote, the physical groups of lines (in space, of surfaces) of a
    Gmsh file, the node sets and surfaces of an Abaqus file, or what has a property of a Nastran file. Cell data come
    along; a physical group or element set is a cell datum of its name, 1 in the group and 0 outside. A group without a
    name is called by its number. Node and cell order are the file's; of plane meshes, a constant third coordinate is
    dropped.

    If the file names no part of the boundary, what lies where x, y or z is least or greatest is called as families of
    meshes call it ("left", "right", "bottom" and "top" in the plane): a `MeshWarning` says which there are.

    Parameters
    ----------
    path : str or Path
        The file; its suffix tells the format. `meshio convert a.xyz a.vtu` converts files of other formats.
    bodies : "physical", optional
        Make a body of every physical group of cells of a Gmsh file, of every instance or part of an Abaqus file (if it
        has none, of every element set), of every property of a Nastran file, as :func:`vemcvx.meshes.bodies` joins
        them: where bodies meet, in nodes that they share or that are double, there is an interface. Boundaries are
        called "plate.rim", and an interface "plate|pin", or by the one name that all of it has in the file, on both of
        its sides or on one. Other names that are on interfaces alone are parts of these, under their name.
    tolerance : float, optional
        With `bodies`: how far apart boundaries may be that coincide, as of :func:`vemcvx.meshes.bodies`.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The mesh, checked.

    Raises
    ------
    MeshError
        There is no such file, it is damaged or foreign, it has what would be read wrongly, or it holds no valid mesh.

    Warns
    -----
    MeshWarning
        Cells were turned, unused nodes dropped, cells of higher order read by their corners, named lines or faces
        inside the mesh left out, sides named; what is in the file was not read; or a body touches no other.
    """
    if bodies is None and tolerance is None:
        return load(path)
    if not isinstance(bodies, str) or bodies != "physical":
        raise MeshError(
            f"read: found bodies = {brief(bodies)}; there is 'physical', with which tolerance= goes, or None for one "
            "mesh."
        )
    meshes, sides = load_bodies(path)
    mesh, origin = join(meshes, None, tolerance)
    for gap in describe_gaps(meshes, mesh):
        warnings.warn(f"{path}: {gap}", MeshWarning, stacklevel=2)
    parts, kept = _on_interfaces(mesh, meshes, origin, sides), {}
    for name, interface in mesh.interfaces.items():
        whole = set(faces_of(interface.edges, mesh._outlines).tolist())
        called = [side for side, places in parts.items() if places == whole]
        kept[called[0] if len(called) == 1 else name] = interface
    named = {side: mesh._boundary[sorted(places)] for side, places in parts.items() if side not in kept}
    return mesh._replace(interfaces=MappingProxyType(kept))._with_named(named)


def _on_interfaces(mesh: Any, meshes: Mapping[str, Any], origin: Ints, sides: set[str]) -> dict[str, set[int]]:
    """Return sides of bodies that are on interfaces alone: name -> numbers of their pieces, those of first bodies.

    `origin` says of each part of the boundary of what it is a piece, `sides` are the names that a file has.
    """
    first, start, found = np.arange(len(origin)), 0, dict[str, set[int]]()
    for interface in mesh.interfaces.values():
        first[faces_of(interface.partners, mesh._outlines)] = faces_of(interface.edges, mesh._outlines)
    for body, own in meshes.items():
        for side in sorted(sides.intersection(own.boundaries) - {WHOLE}):
            if f"{body}.{side}" not in mesh.boundaries:
                pieces = np.isin(origin, start + own._places(own.boundaries[side]))
                found.setdefault(side, set()).update(first[pieces].tolist())
        start += len(own._boundary)
    return found


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
    return from_object(other)
