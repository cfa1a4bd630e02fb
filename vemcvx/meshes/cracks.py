"""Cracks between two sets of cells, and cuts of a mesh into two parts.

A crack divides the cells at a node into groups. Neighbouring cells are in one group if the crack does not separate
them. Every group gets a copy of the node. At a crack tip, all cells form one group, and the node stays single.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Bools, Ints, brief, one_point, read_only
from vemcvx.base.errors import MeshError, quietly
from vemcvx.base.outline import coordinates
from vemcvx.meshes.box import check_name
from vemcvx.meshes.carrying import check_marks
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary, pad_rows
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygons import (
    backwards,
    cell_of_corner,
    find_in,
    matching_rows,
    offsets_of,
    rows_in_order,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import join_faces, list_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

AnyMesh = TypeVar("AnyMesh", bound=Mesh)


def open_crack(mesh: AnyMesh, name: str, sides: Mapping[str, ArrayLike]) -> AnyMesh:
    """Return the mesh of :meth:`vemcvx.PolygonMesh.cut`."""
    one, other = _check_sides(mesh, name, sides)
    cells, (offsets, vertices) = mesh.neighbours, mesh._inner_outlines
    swapped = other[cells[:, 0]]
    cells = np.where(swapped[:, None], cells[:, ::-1], cells)
    vertices = np.where(np.repeat(swapped, np.diff(offsets)), vertices[backwards(offsets)], vertices)
    opened, (first, second) = one[cells[:, 0]] & other[cells[:, 1]], sides
    if not opened.any():
        raise MeshError(f"cut: the cells of {first!r} and {second!r} have no {mesh.PARTS} in common; give neighbours.")
    rows, nodes = mesh.cell_nodes
    keys = cell_of_corner(rows) * mesh.n_nodes + nodes

    def corners(cell: Ints, node: Ints) -> Ints:
        return find_in(keys, cell * mesh.n_nodes + node)

    side = cell_of_corner(offsets)
    pairs = np.column_stack([corners(cell, vertices) for cell in cells[side].T])
    number, origin = _split_nodes(nodes, pairs, opened[side], mesh.n_nodes)
    lips = [pad_rows(*rows_in_order(offsets, number[lip], np.flatnonzero(opened))) for lip in pairs.T]
    _check_opening(mesh, origin, *lips)

    def renumber(cell: Ints, rows: Ints, nodes: Ints) -> Ints:
        return number[corners(np.repeat(cell, np.diff(rows)), nodes)]

    arrays: tuple[Ints, ...] = (rows, number)
    if isinstance(mesh, PolyhedralMesh):
        listed = list_faces(mesh.faces)
        new = renumber(np.arange(mesh.n_cells), listed.offsets[listed.cell_offsets], listed.vertices)
        arrays = join_faces(listed.offsets, new, listed.cell_offsets)
    made = type(mesh).unchecked(mesh.points[origin], *arrays)
    joints, named = {name: Interface((first, second), *lips)}, {}
    for key, found in mesh.interfaces.items():
        moved = [found.edges.copy(), found.partners.copy()]
        for lip in moved:
            there, cell = lip >= 0, mesh._owners[faces_of(lip, mesh._outlines)]
            lip[there] = renumber(cell, offsets_of(there.sum(axis=1)), lip[there])
        joints[key] = Interface(found.bodies, *moved)
    for key, parts in mesh._named.items():
        place = mesh._places(parts)
        rows, nodes = rows_in_order(*mesh._outlines, place)
        new = matching_rows(*made._outlines, rows, renumber(mesh._owners[place], rows, nodes))
        named[key] = read_only(made._boundary[new])
    interfaces = MappingProxyType(on_boundary(joints, made._outlines))
    return made._replace(_named=named, interfaces=interfaces, cell_data=mesh.cell_data)


def _split_nodes(nodes: Ints, pairs: Ints, opened: Bools, count: int) -> tuple[Ints, Ints]:
    """Return the new node of each corner, and the old number of each new node."""
    whole, parted = (smallest_linked(pairs[kept], len(nodes)) for kept in (np.ones_like(opened), ~opened))
    first = np.unique(parted)  # the first corner identifies a group
    fresh = ~np.isin(first, np.unique(whole))
    number = np.where(fresh, count + np.cumsum(fresh) - 1, nodes[first])
    return number[np.searchsorted(first, parted)], np.concatenate([np.arange(count), nodes[first[fresh]]])


def _check_sides(mesh: Mesh, name: str, sides: Mapping[str, ArrayLike]) -> tuple[Bools, Bools]:
    if check_name(name) in mesh.boundaries:
        raise MeshError(f"cut: there already is a boundary {name!r}; give the crack another name.")
    if not isinstance(sides, Mapping) or len(sides) != 2 or not all(isinstance(side, str) for side in sides):
        raise MeshError(f"cut: sides must map the names of two sides of the crack to cells; got {brief(sides)}.")
    one, other = (check_marks(cells, mesh.n_cells, f"cells of {side!r}") for side, cells in sides.items())
    if (one & other).any():
        raise MeshError(f"cut: cell {np.flatnonzero(one & other)[0]} is on both sides of the crack.")
    return one, other


def _check_opening(mesh: Mesh, origin: Ints, lip: Ints, other: Ints) -> None:
    closed = np.flatnonzero((lip == other).all(axis=1))
    if len(closed):
        row = lip[closed[0]]
        at = coordinates(mesh.points[origin[row[row >= 0]]].mean(axis=0), 6)
        raise MeshError(
            f"cut: {mesh.A_PART} at {at} has crack tips at all its nodes and cannot open. A crack inside a body must "
            f"be at least two {mesh.PARTS} wide: refine the mesh, or take more cells."
        )


def cut(mesh: AnyMesh, point: ArrayLike, normal: ArrayLike) -> tuple[AnyMesh, AnyMesh]:
    """Cut the mesh of a body in two along a straight line of edges, or in space along a plane of faces.

    :func:`vemcvx.meshes.bodies` joins both parts again. The cut becomes an interface, for example for `Pretension`.
    Both parts keep cell data and names of boundaries.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        The mesh of one body, without interfaces.
    point, normal : (dim,) array_like
        A point on the line or plane, and a normal vector of any length, which points to the part `ahead`.

    Returns
    -------
    behind, ahead : PolygonMesh or PolyhedralMesh
        The two parts. Nodes and cells keep their order.

    Raises
    ------
    MeshError
        The line or plane crosses cells, the whole mesh is on one side, or the mesh has interfaces.

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
        raise MeshError("cut: the normal has length 0; give a nonzero vector, such as (0, 1).")
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
    named = {}
    for name, parts in mesh._named.items():
        places = mesh._places(parts)
        outlines: tuple[Ints, Ints] = mesh._outlines
        offsets, nodes = rows_in_order(*outlines, places[chosen[mesh._owners[places]]])
        if len(nodes):
            named[name] = np.split(nodes, offsets[1:-1])
    cells = [mesh.cells[k] for k in np.flatnonzero(chosen)]
    data = {name: values[chosen] for name, values in mesh.cell_data.items()}
    with quietly():  # suppresses the warning about dropped nodes
        return type(mesh)(mesh.points, cells, boundaries=named, cell_data=data)
