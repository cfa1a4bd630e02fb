"""Cutting a mesh in two along a line, in space along a plane."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats, Ints, one_point, read_only
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import corner_edges, insert_hanging, positions, rows_in_order
from vemcvx.meshes.polyhedra import list_faces

AnyMesh = TypeVar("AnyMesh", bound=Mesh)
NEAR_FRACTION = 0.1  # inner nodes move onto the line up to this distance, divided by their shortest edge


def cut(mesh: AnyMesh, point: ArrayLike, normal: ArrayLike) -> tuple[AnyMesh, AnyMesh]:
    """Return two meshes: the parts of a mesh behind and ahead of a line (in space: of a plane).

    :func:`vemcvx.meshes.bodies` joins both parts again; the cut becomes an interface, for example for `Pretension`.
    Both parts keep cell data and names of boundaries. In the plane, cells that the line crosses are split. Inner nodes
    nearer to the line than a tenth of their shortest edge move onto it.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        The mesh of one body, without interfaces.
    point, normal : (dim,) array_like
        A point on the line or plane, and a normal vector of any length. The part ahead is on the side of the normal.

    Returns
    -------
    behind, ahead : PolygonMesh or PolyhedralMesh
        The two parts; nodes and cells keep their order, new nodes come last.

    Raises
    ------
    MeshError
        The whole mesh is on one side; the mesh has interfaces; the line meets a nonconvex cell more than twice; in
        space the plane crosses cells.

    Examples
    --------
    >>> import vemcvx as vx
    >>> shank, head = vx.meshes.cut(vx.meshes.squares(4), point=(0.0, 0.4), normal=(0.0, 1.0))
    >>> list(vx.meshes.bodies({"shank": shank, "head": head}).interfaces)
    ['shank|head']
    """
    points, side = _sides(mesh, point, normal)
    rows = mesh.cell_nodes
    low, high = (f.reduceat(side[rows[1]], rows[0][:-1]) for f in (np.minimum, np.maximum))
    crossed = np.flatnonzero((low < 0) & (high > 0))
    ends = np.empty((0, 2), dtype=np.int64)
    if isinstance(mesh, PolygonMesh):
        ends = mesh.shared_edges.ends
        ends = ends[side[ends[:, 0]] * side[ends[:, 1]] < 0]
        rows = insert_hanging(rows, ends, np.arange(len(ends) + 1), mesh.n_nodes + np.arange(len(ends)))
    elif len(crossed):
        at = coordinates(mesh.centroids[crossed[0]], 6)
        raise MeshError(
            f"cut: the plane crosses {len(crossed)} cells, the first at {at}; in space it must run along faces. Move "
            "the plane to nodes of the mesh, or mesh the body with nodes in the plane."
        )
    fraction = np.abs(side[ends]) / np.abs(side[ends]).sum(axis=1, keepdims=True)
    points = np.concatenate([points, fraction[:, 1:] * points[ends[:, 0]] + fraction[:, :1] * points[ends[:, 1]]])
    side = np.append(side, np.zeros(len(ends)))
    several = crossed[np.add.reduceat(side[rows[1]] == 0.0, rows[0][:-1], dtype=np.int64)[crossed] != 2]
    if len(several):
        at = coordinates(mesh.centroids[several[0]], 6)
        raise MeshError(f"cut: the line meets cell {several[0]} at {at} more than twice; refine it, or move the line.")
    for whole, where in (((high <= 0).all(), "behind"), ((low >= 0).all(), "ahead of")):
        if whole:
            raise MeshError(f"cut: the whole mesh is {where} the cut; move the cut.")
    return _part(mesh, points, side, rows, ends), _part(mesh, points, -side, rows, ends)


def _sides(mesh: Mesh, point: ArrayLike, normal: ArrayLike) -> tuple[Floats, Floats]:
    """Move points near the line onto it; return all points and their signed distances (n_nodes,), positive ahead."""
    if not isinstance(mesh, Mesh) or mesh.interfaces:
        raise MeshError("cut: give the mesh of one body, without interfaces; cut the body before joining it to others.")
    p, n = (one_point(x, mesh.points.shape[1], f"cut: {name}") for name, x in (("point", point), ("normal", normal)))
    if not n.any():
        raise MeshError("cut: the normal has length 0; give one that points ahead, such as (0, 1).")
    n = n / np.linalg.norm(n)
    depth, near = (mesh.points - p) @ n, SAME * float(np.ptp(mesh.points, axis=0).max())
    if not isinstance(mesh, PolygonMesh):
        return mesh.points, np.where(np.abs(depth) <= near, 0.0, depth)
    ends, shortest = corner_edges(mesh.offsets, mesh.vertices), np.full(mesh.n_nodes, np.inf)
    length = np.linalg.norm(mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]], axis=1)
    np.minimum.at(shortest, ends, length[:, None])
    shortest[mesh._boundary] = 0.0
    moving = np.abs(depth) <= np.maximum(near, NEAR_FRACTION * shortest)
    return mesh.points - (depth * moving)[:, None] * n, np.where(moving, 0.0, depth)


def _part(mesh: Any, points: Floats, side: Floats, rows: tuple[Ints, Ints], ends: Ints) -> Any:
    """Return the part where `side` < 0; `rows` are the nodes of cells, and node n_nodes + k is on edge ends[k]."""
    parents = np.flatnonzero(np.minimum.reduceat(side[rows[1]], rows[0][:-1]) < 0)
    offsets, nodes = rows_in_order(*rows, parents)
    kept = side[nodes] <= 0
    used = np.unique(nodes[kept])
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    if isinstance(mesh, PolygonMesh):
        counts = np.add.reduceat(kept, offsets[:-1], dtype=np.int64)
        cells: Any = np.split(number[nodes[kept]], np.cumsum(counts)[:-1])
    else:
        listed = list_faces(mesh.faces).in_order(parents)
        cells = listed._replace(vertices=number[listed.vertices])
    data = {name: values[parents] for name, values in mesh.cell_data.items()}
    made, named = type(mesh)(points[used], cells, boundaries={}, cell_data=data), {}
    outlines: tuple[Ints, Ints] = mesh._outlines
    for name, parts in mesh._named.items():
        starts, corners = rows_in_order(*outlines, mesh._places(parts))
        if len(ends):  # a crossed edge ends at its new node
            edge = np.repeat(positions(corners.reshape(-1, 2), ends, len(points)), 2)
            corners = np.where((edge >= 0) & (side[corners] > 0), mesh.n_nodes + edge, corners)
        found = made._find_parts(starts, corners, number)
        if (found >= 0).any():
            named[name] = read_only(made._boundary[np.unique(found[found >= 0])])
    return made._with_named(named)
