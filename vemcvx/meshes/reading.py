"""Meshes from files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from vemcvx.base.arrays import Ints, brief
from vemcvx.base.errors import MeshError
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import faces_of
from vemcvx.meshes.io.files import load, load_bodies
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.several_bodies import join


# The file determines the type of the mesh. With `| Any`, scripts need no cast.
def read(path: str | Path, bodies: str | None = None, *, tolerance: float | None = None) -> PolygonMesh | Any:
    """Read a mesh from a file of VTK (.vtu), Gmsh (.msh), Abaqus (.inp) or Nastran (.bdf, .nas, .fem).

    A group or set of boundary edges or faces becomes a named boundary. A group or set of cells becomes a cell datum,
    which is 1 in the group and 0 outside. If the file names no part of the boundary, straight sides are named "left",
    "right" and so on, with a `MeshWarning`. The page "Meshes" describes all formats.

    Parameters
    ----------
    path : str or Path
        The file; its suffix determines the format. `meshio convert a.xyz a.vtu` converts files of other formats.
    bodies : "physical", optional
        Read several bodies, and join them by :func:`vemcvx.meshes.bodies`. A body is a physical group of cells in Gmsh,
        a property in Nastran, and an instance or part in Abaqus. Without parts, an element set of Abaqus is a body.
    tolerance : float, optional
        With `bodies`: the largest distance between coinciding boundaries, see :func:`vemcvx.meshes.bodies`.

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        The checked mesh.

    Raises
    ------
    MeshError
        The file is missing, damaged, ambiguous or of an unknown format, or its mesh is not valid.

    Examples
    --------
    >>> vx.meshes.squares(4).write("plate.vtu")
    >>> vx.meshes.read("plate.vtu")
    PolygonMesh(16 cells, 25 nodes, h = 0.3536, boundaries: left, right, bottom, top, boundary)
    """
    if bodies is None and tolerance is None:
        return load(path)
    if not isinstance(bodies, str) or bodies != "physical":
        raise MeshError(
            f"read: found bodies = {brief(bodies)}; give bodies='physical' (tolerance= needs it), or None for a single "
            "mesh."
        )
    meshes, sides = load_bodies(path)
    mesh, origin = join(meshes, None, tolerance)
    parts, kept = _on_interfaces(mesh, meshes, origin, sides), {}
    for name, interface in mesh.interfaces.items():
        whole = set(faces_of(interface.edges, mesh._outlines).tolist())
        called = [side for side, places in parts.items() if places == whole]
        kept[called[0] if len(called) == 1 else name] = interface
    named = {side: mesh._boundary[sorted(places)] for side, places in parts.items() if side not in kept}
    return mesh._replace(interfaces=MappingProxyType(kept))._with_named(named)


def _on_interfaces(mesh: Any, meshes: Mapping[str, Any], origin: Ints, sides: set[str]) -> dict[str, set[int]]:
    """Return side name -> positions on the boundary, for sides on interfaces."""
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
