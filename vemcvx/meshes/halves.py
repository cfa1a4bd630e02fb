"""Cutting a mesh in two along a line, in space along a plane."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Bools, Ints, one_point
from vemcvx.base.errors import MeshError, quietly
from vemcvx.base.outline import coordinates
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygons import rows_in_order

AnyMesh = TypeVar("AnyMesh", bound=Mesh)


def cut(mesh: AnyMesh, point: ArrayLike, normal: ArrayLike) -> tuple[AnyMesh, AnyMesh]:
    """Return two meshes: the parts of a mesh behind and ahead of a line (in space: of a plane) along its edges (faces).

    :func:`vemcvx.meshes.bodies` joins both parts again; the cut becomes an interface, for example for `Pretension`.
    Both parts keep cell data and names of boundaries.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        The mesh of one body, without interfaces.
    point, normal : (dim,) array_like
        A point on the line or plane, and a normal vector of any length. The part ahead is on the side of the normal.

    Returns
    -------
    behind, ahead : PolygonMesh or PolyhedralMesh
        The two parts; nodes and cells keep their order.

    Raises
    ------
    MeshError
        The line or plane crosses cells; the whole mesh is on one side; or the mesh has interfaces.

    Examples
    --------
    >>> import vemcvx as vx
    >>> shank, head = vx.meshes.cut(vx.meshes.squares(4), point=(0.0, 0.5), normal=(0.0, 1.0))
    >>> list(vx.meshes.bodies({"shank": shank, "head": head}).interfaces)
    ['shank|head']
    """
    if not isinstance(mesh, Mesh) or mesh.interfaces:
        raise MeshError("cut: give the mesh of one body, without interfaces; cut the body before joining it to others.")
    p, n = (one_point(x, mesh.points.shape[1], f"cut: {name}") for name, x in (("point", point), ("normal", normal)))
    if not n.any():
        raise MeshError("cut: the normal has length 0; give one that points ahead, such as (0, 1).")
    offsets, nodes = mesh.cell_nodes
    depth, near = (mesh.points - p) @ (n / np.linalg.norm(n)), SAME * float(np.ptp(mesh.points, axis=0).max())
    low, high = (f.reduceat(depth[nodes], offsets[:-1]) for f in (np.minimum, np.maximum))
    crossed = np.flatnonzero((low < -near) & (high > near))
    if len(crossed):
        raise MeshError(
            f"cut: the cut crosses {len(crossed)} cells, the first at {coordinates(mesh.centroids[crossed[0]], 6)}; it "
            f"must run along {mesh.PARTS}. Move the cut to nodes of the mesh, or mesh the body with nodes in the cut."
        )
    ahead = high > near
    if ahead.all() or not ahead.any():
        raise MeshError(f"cut: the whole mesh is {'ahead of' if ahead.all() else 'behind'} the cut; move the cut.")
    return _select(mesh, ~ahead), _select(mesh, ahead)


def _select(mesh: Any, chosen: Bools) -> Any:
    """Return the mesh of the chosen cells."""
    named = {}
    for name, parts in mesh._named.items():
        places = mesh._places(parts)
        outlines: tuple[Ints, Ints] = mesh._outlines
        offsets, nodes = rows_in_order(*outlines, places[chosen[mesh._owners[places]]])
        if len(nodes):
            named[name] = np.split(nodes, offsets[1:-1])
    cells = [mesh.cells[k] for k in np.flatnonzero(chosen)]
    data = {name: values[chosen] for name, values in mesh.cell_data.items()}
    with quietly():  # the nodes of other cells are dropped
        return type(mesh)(mesh.points, cells, boundaries=named, cell_data=data)
