"""Meshes read from files, and taken from objects of other libraries."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from vemcvx.base.arrays import brief
from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.io.files import load, load_bodies
from vemcvx.meshes.io.objects import from_object
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.several_bodies import bodies as joined


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
        its sides or on one.
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
        inside the mesh or on interfaces left out, sides named; or what is in the file was not read.
    """
    if bodies is None and tolerance is None:
        return load(path)
    if not isinstance(bodies, str) or bodies != "physical":
        raise MeshError(
            f"read: found bodies = {brief(bodies)}; there is 'physical', with which tolerance= goes, or None for one "
            "mesh."
        )
    meshes, sides = load_bodies(path)
    mesh = joined(meshes, tolerance=tolerance)
    called = {name: _names_of(interface, meshes, sides) for name, interface in mesh.interfaces.items()}
    times = Counter(side for names in called.values() for side in names)
    kept = {}
    for name, interface in mesh.interfaces.items():
        kept[called[name][0] if [times[side] for side in called[name]] == [1] else name] = interface
    named = {(body, side) for body, own in meshes.items() for side in own.boundaries}
    hidden = {side for body, side in named if f"{body}.{side}" not in mesh.boundaries}
    if left := ", ".join(map(repr, sorted((hidden & sides) - set(kept)))):
        warnings.warn(
            f"{path}: the sides named {left} are on interfaces, which are called {', '.join(map(repr, kept))}: a name "
            "is kept if it is the only one that is of all of one interface, and of no other.",
            MeshWarning,
            stacklevel=2,
        )
    return mesh._replace(interfaces=MappingProxyType(kept))


def _names_of(interface: Interface, meshes: Mapping[str, Any], sides: set[str]) -> list[str]:
    """Return the names of sides that are all of an interface, on each of its bodies that has them there."""
    start, covers = 0, dict[str, list[bool]]()
    for body, own in meshes.items():
        if body in interface.bodies:
            # Nodes of bodies stand one after the other, and behind them those that interfaces have added.
            nodes = (interface.edges, interface.partners)[interface.bodies.index(body)] - start
            offsets, vertices = own._outlines
            there = set(np.flatnonzero(np.logical_and.reduceat(np.isin(vertices, nodes), offsets[:-1])).tolist())
            for side in sorted(sides.intersection(own.boundaries)):
                places = set(own._places(own.boundaries[side]).tolist())
                if places & there:
                    covers.setdefault(side, []).append(places == there)
        start += own.n_nodes
    return [side for side, each in covers.items() if all(each)]


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
