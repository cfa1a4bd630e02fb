"""A crack in a mesh: the edges between two sets of cells become an interface, the nodes along it double.

The corners of cells at a node are joined across the edges that are not cut. Where that leaves them in several groups,
each group gets a node of its own; where it leaves one, as at a tip of the crack inside the body, nothing is double.
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
from vemcvx.meshes.interfaces import Interface, on_boundary
from vemcvx.meshes.local_refinement import check_marks
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, next_corner, smallest_linked
from vemcvx.meshes.tessellation import Tessellation

Mesh = TypeVar("Mesh", bound=Tessellation)


def cut(mesh: Mesh, name: str, sides: Mapping[str, ArrayLike]) -> Mesh:
    """Cut a mesh along the edges between two sets of its cells: see :meth:`vemcvx.PolygonMesh.cut`."""
    one, other = _check_sides(mesh, name, sides)
    cell, (left, right) = cell_of_corner(mesh.offsets), _inner_edges(mesh)
    backwards = other[cell[left]]
    left, right = np.where(backwards, right, left), np.where(backwards, left, right)
    opened = one[cell[left]] & other[cell[right]]
    if not opened.any():
        raise MeshError(
            f"cut: no edge is between the cells of {' and '.join(map(repr, sides))}; they must be neighbours."
        )
    vertices, origin = _numbered_anew(mesh, left, right, opened)
    before, after = directed_edges(mesh.offsets, mesh.vertices), directed_edges(mesh.offsets, vertices)
    edges, partners = after[left[opened]], after[right[opened]][:, ::-1]
    _check_opening(mesh.points[origin], edges, partners)
    order = np.argsort(before @ [mesh.n_nodes, 1])

    def renumbered(side: Ints) -> Ints:
        place = np.searchsorted(before @ [mesh.n_nodes, 1], side @ [mesh.n_nodes, 1], sorter=order)
        return read_only(after[order[place]])

    first, second = sides
    joints = {name: Interface((first, second), edges, partners)}
    for key, found in mesh.interfaces.items():
        joints[key] = Interface(found.bodies, renumbered(found.edges), renumbered(found.partners[:, ::-1])[:, ::-1])
    made = type(mesh).unchecked(mesh.points[origin], mesh.offsets, vertices, mesh._box)
    return made._replace(
        _named={key: renumbered(side) for key, side in mesh._named.items()},
        interfaces=MappingProxyType(on_boundary(joints, made._boundary, made.n_nodes)),
        cell_data=mesh.cell_data,
    )


def _inner_edges(mesh: Tessellation) -> tuple[Ints, Ints]:
    """The two corners at which each edge inside the mesh starts, in the one cell and in the other."""
    shared = mesh.shared_edges
    first = shared.first[shared.counts == 2]
    return shared.corners[first], shared.corners[first + 1]


def _numbered_anew(mesh: Tessellation, left: Ints, right: Ints, opened: Bools) -> tuple[Ints, Ints]:
    """Nodes of all corners with some inner edges opened, the new ones last; and which node each of them was."""
    follow = next_corner(mesh.offsets)
    whole, parted = (_groups(follow, left[kept], right[kept]) for kept in (np.ones_like(opened), ~opened))
    first = np.unique(parted)  # each group is called by its first corner
    fresh = ~np.isin(first, whole)
    number = np.where(fresh, mesh.n_nodes + np.cumsum(fresh) - 1, mesh.vertices[first])
    return number[np.searchsorted(first, parted)], np.concatenate(
        [np.arange(mesh.n_nodes), mesh.vertices[first[fresh]]]
    )


def _groups(follow: Ints, left: Ints, right: Ints) -> Ints:
    """The first corner (n_corners,) of each one's group: those at one node are joined across the given edges."""
    pairs = np.concatenate([np.column_stack([left, follow[right]]), np.column_stack([follow[left], right])])
    return smallest_linked(pairs, len(follow))


def _check_sides(mesh: Tessellation, name: str, sides: Mapping[str, ArrayLike]) -> tuple[Bools, Bools]:
    if check_name(name) in mesh.boundaries:
        raise MeshError(f"cut: there is a boundary {name!r} already; give the crack another name.")
    if not isinstance(sides, Mapping) or len(sides) != 2 or not all(isinstance(side, str) for side in sides):
        raise MeshError(f"cut: wanted are two sides of the crack, name -> cells; got {brief(sides)}.")
    one, other = (check_marks(cells, mesh.n_cells, f"cells of {side!r}") for side, cells in sides.items())
    if (one & other).any():
        raise MeshError(f"cut: cell {np.flatnonzero(one & other)[0]} is on both sides of the crack.")
    return one, other


def _check_opening(points: Floats, edges: Ints, partners: Ints) -> None:
    closed = np.flatnonzero((edges == partners).all(axis=1))
    if len(closed):
        x, y = points[edges[closed[0]]].mean(axis=0)
        raise MeshError(
            f"cut: the edge at ({x:.6g}, {y:.6g}) has a tip at both ends and cannot open. A crack inside a body is at "
            "least two edges long: refine the mesh, or take more cells."
        )
