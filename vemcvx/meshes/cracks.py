"""Cracks: meshes cut along the sides between two sets of their cells, edges in the plane and faces in space.

A corner is a cell with one of its nodes. The corners at a node are joined across the sides that are not cut. Where that
leaves them in several groups, each group gets a node of its own; where it leaves one, as at a tip inside the body, or
along the front of a crack in space, nothing is double.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints, brief, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes.box import check_name
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary, on_faces, padded
from vemcvx.meshes.local_refinement import check_marks
from vemcvx.meshes.polygons import (
    among,
    cell_of_corner,
    directed_edges,
    distinct,
    next_corner,
    rows_in_order,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import joined_faces, listed_faces
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

Mesh = TypeVar("Mesh", bound=Tessellation)
Solid = TypeVar("Solid", bound=SpaceTessellation)
TIPS = {"edges": ("edge", "both ends", "two edges long"), "faces": ("face", "all its nodes", "two faces wide")}
"""Words for sides that cannot open"""


def cut(mesh: Mesh, name: str, sides: Mapping[str, ArrayLike]) -> Mesh:
    """Cut a mesh along the edges between two sets of its cells: see :meth:`vemcvx.PolygonMesh.cut`."""
    one, other = _check_sides(mesh, name, sides)
    cell, (left, right) = cell_of_corner(mesh.offsets), mesh.shared_edges.twice
    backwards = other[cell[left]]
    left, right = np.where(backwards, right, left), np.where(backwards, left, right)
    opened = _opened(one[cell[left]] & other[cell[right]], mesh, sides)
    follow = next_corner(mesh.offsets)
    pairs = np.concatenate([np.column_stack([left, follow[right]]), np.column_stack([follow[left], right])])
    vertices, origin = _numbered_anew(mesh.vertices, pairs, np.tile(opened, 2), mesh.n_nodes)
    before, after = directed_edges(mesh.offsets, mesh.vertices), directed_edges(mesh.offsets, vertices)
    edges, partners = after[left[opened]], after[right[opened]][:, ::-1]
    _check_opening(mesh, origin, edges, partners)
    order = np.argsort(before @ [mesh.n_nodes, 1])

    def renumbered(side: Ints) -> Ints:
        place = np.searchsorted(before @ [mesh.n_nodes, 1], side @ [mesh.n_nodes, 1], sorter=order)
        return read_only(after[order[place]])

    joints = {name: Interface(_names(sides), edges, partners)}
    for key, found in mesh.interfaces.items():
        joints[key] = Interface(found.bodies, renumbered(found.edges), renumbered(found.partners[:, ::-1])[:, ::-1])
    made = type(mesh).unchecked(mesh.points[origin], mesh.offsets, vertices, box=mesh._box)
    return made._replace(
        _named={key: renumbered(side) for key, side in mesh._named.items()},
        interfaces=MappingProxyType(on_boundary(joints, made._boundary, made.n_nodes)),
        cell_data=mesh.cell_data,
    )


def cut_in_space(mesh: Solid, name: str, sides: Mapping[str, ArrayLike]) -> Solid:
    """Cut a mesh along the faces between two sets of its cells: see :meth:`vemcvx.PolyhedralMesh.cut`."""
    one, other = _check_sides(mesh, name, sides)
    inner = np.flatnonzero(mesh.face_cells[:, 1] >= 0)
    cells = mesh.face_cells[inner]
    cells = np.where(other[cells[:, :1]], cells[:, ::-1], cells)
    opened = _opened(one[cells[:, 0]] & other[cells[:, 1]], mesh, sides)
    rows, nodes = mesh.cell_nodes
    keys = cell_of_corner(rows) * mesh.n_nodes + nodes

    def corners(cell: Ints, node: Ints) -> Ints:
        place: Ints = np.searchsorted(keys, cell * mesh.n_nodes + node)
        return place

    offsets, vertices = rows_in_order(mesh.face_offsets, mesh.face_vertices, inner)
    beside = cells[cell_of_corner(offsets)]
    pairs = np.column_stack([corners(cell, vertices) for cell in beside.T])
    number, origin = _numbered_anew(nodes, pairs, opened[cell_of_corner(offsets)], mesh.n_nodes)
    which = np.flatnonzero(opened)
    lips = [padded(*rows_in_order(offsets, number[side], which)) for side in pairs.T]
    _check_opening(mesh, origin, *lips)
    joints = {name: Interface(_names(sides), *lips)}
    for key, found in mesh.interfaces.items():
        moved = []
        for side in (found.edges, found.partners):
            there = side >= 0
            cell = mesh.face_cells[mesh._boundary[faces_of(side, mesh._outlines)], 0]
            moved.append(side.copy())
            moved[-1][there] = number[corners(np.repeat(cell, there.sum(axis=1)), side[there])]
        joints[key] = Interface(found.bodies, *moved)
    listed = listed_faces(mesh.faces)
    owner = np.repeat(cell_of_corner(listed.cell_offsets), np.diff(listed.offsets))
    faces = joined_faces(listed.offsets, number[corners(owner, listed.vertices)], listed.cell_offsets)
    made = type(mesh).unchecked(mesh.points[origin], *faces, box=mesh._box)
    anew = np.empty(mesh.n_faces, dtype=np.int64)
    anew[mesh.cell_faces] = faces.cell_faces
    return made._replace(
        _named={key: read_only(anew[side]) for key, side in mesh._named.items()},
        interfaces=MappingProxyType(on_faces(joints, made._outlines)),
        cell_data=mesh.cell_data,
    )


def _numbered_anew(nodes: Ints, pairs: Ints, opened: Bools, count: int) -> tuple[Ints, Ints]:
    """New nodes of all corners, those that were not there last; and which of `count` nodes each of them was.

    `nodes` has that of each corner, `pairs` (k, 2) those corners at a node that a side joins, unless it is opened.
    """
    whole, parted = (smallest_linked(pairs[kept], len(nodes)) for kept in (np.ones_like(opened), ~opened))
    first = distinct(parted)  # each group is called by its first corner
    fresh = ~among(first, distinct(whole))
    number = np.where(fresh, count + np.cumsum(fresh) - 1, nodes[first])
    return number[np.searchsorted(first, parted)], np.concatenate([np.arange(count), nodes[first[fresh]]])


def _check_sides(
    mesh: Tessellation | SpaceTessellation, name: str, sides: Mapping[str, ArrayLike]
) -> tuple[Bools, Bools]:
    if check_name(name) in mesh.boundaries:
        raise MeshError(f"cut: there is a boundary {name!r} already; give the crack another name.")
    if not isinstance(sides, Mapping) or len(sides) != 2 or not all(isinstance(side, str) for side in sides):
        raise MeshError(f"cut: wanted are two sides of the crack, name -> cells; got {brief(sides)}.")
    one, other = (check_marks(cells, mesh.n_cells, f"cells of {side!r}") for side, cells in sides.items())
    if (one & other).any():
        raise MeshError(f"cut: cell {np.flatnonzero(one & other)[0]} is on both sides of the crack.")
    return one, other


def _names(sides: Mapping[str, ArrayLike]) -> tuple[str, str]:
    first, second = sides
    return first, second


def _opened(opened: Bools, mesh: Tessellation | SpaceTessellation, sides: Mapping[str, ArrayLike]) -> Bools:
    if not opened.any():
        between, side = " and ".join(map(repr, sides)), TIPS[mesh.PARTS][0]
        raise MeshError(f"cut: no {side} is between the cells of {between}; they must be neighbours.")
    return opened


def _check_opening(mesh: Tessellation | SpaceTessellation, origin: Ints, lip: Ints, other: Ints) -> None:
    """MeshError where both lips, rows of nodes that were `origin`, are one side of all that is there."""
    closed = np.flatnonzero((lip == other).all(axis=1))
    if len(closed):
        row = lip[closed[0]]
        at: Floats = mesh.points[origin[row[row >= 0]]].mean(axis=0)
        side, where, size = TIPS[mesh.PARTS]
        raise MeshError(
            f"cut: the {side} at ({', '.join(f'{x:.6g}' for x in at)}) has a tip at {where} and cannot open. A crack "
            f"inside a body is at least {size}: refine the mesh, or take more cells."
        )
