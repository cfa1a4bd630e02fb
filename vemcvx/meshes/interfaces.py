"""Interfaces: where the boundaries of two bodies coincide, edge by edge, each body with nodes of its own.

In space face by face: a face is a row of its vertices, and rows are filled up with -1 to the length of the longest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import Floats, Ints, brief, plain, read_only
from vemcvx.base.errors import MeshError
from vemcvx.meshes.box import check_mapping, check_name
from vemcvx.meshes.polygons import (
    cell_of_corner,
    distinct,
    found_in,
    matching_rows,
    offsets_of,
    rounding,
    rows_in_order,
    same_rows,
    smallest_linked,
)


@dataclass(frozen=True, eq=False)
class Interface:
    """Edges of one body that are also edges of another, in space faces, each with nodes of its own in the same places.

    Attributes
    ----------
    bodies : (str, str)
        Names of the two bodies, the first and the second.
    edges : (k, 2) int
        Edges of the first body, as they run in its counter-clockwise cells: the body on the left. In space its faces,
        (k, n) rows of their vertices, counter-clockwise seen from outside, filled up with -1.
    partners : (k, 2) int
        The nodes of the second body in the same places, so that it has the edges ``partners[:, ::-1]``. In space
        likewise, as `edges`.
    """

    bodies: tuple[str, str]
    edges: Ints
    partners: Ints

    @property
    def pairs(self) -> Ints:
        """Nodes of the first body and of the second in the same places, (m, 2), each pair once, in order."""
        known = self.edges.ravel() >= 0
        own, other = self.edges.ravel()[known], self.partners.ravel()[known]
        count = int(other.max(initial=0)) + 1
        return np.column_stack(np.divmod(distinct(own * count + other), count))


def check_interfaces(
    interfaces: Mapping[str, Interface] | None, n_nodes: int, dimension: int = 2
) -> dict[str, Interface]:
    """Return interfaces whose sides are pairs of node numbers, in space rows of these, or raise MeshError."""
    found = {}
    for name, given in check_mapping(interfaces, "interfaces", "Interface").items():
        check_name(name)
        if not isinstance(given, Interface):
            raise MeshError(f"interface {name!r}: found {brief(given)} where an Interface is wanted.")
        bodies = tuple(given.bodies) if isinstance(given.bodies, (tuple, list)) else ()
        if len(bodies) != 2 or not all(isinstance(body, str) for body in bodies):
            raise MeshError(f"interface {name!r}: bodies must be the names of two; got {brief(given.bodies)}.")
        edges, partners = (_check_sides(name, side, n_nodes, dimension) for side in (given.edges, given.partners))
        if edges.shape != partners.shape or not np.array_equal(edges < 0, partners < 0):
            raise MeshError(f"interface {name!r}: it has {len(edges)} sides, and partners of {len(partners)}.")
        found[name] = Interface(bodies, edges, partners)
    return found


def _check_sides(name: str, given: object, n_nodes: int, dimension: int) -> Ints:
    """Return rows (k, n) of the vertices of edges or faces, filled up with -1, or raise MeshError."""
    rows, good = plain(given), False
    if rows is not None and rows.ndim == 2 and rows.dtype.kind in "iu" and len(rows) and rows.shape[1] >= dimension:
        rows = rows.astype(np.int64)
        filled = rows >= 0
        last = filled[:, :dimension].all() and (filled[:, 1:] <= filled[:, :-1]).all() and (rows >= -1).all()
        good = bool(last and (rows < n_nodes).all()) and (dimension == 3 or rows.shape[1] == 2)
    if rows is None or not good:
        wanted = "edges must be pairs (k, 2) of nodes"
        if dimension == 3:
            wanted = "faces must be rows (k, n) of three nodes or more, filled up with -1"
        raise MeshError(f"interface {name!r}: {wanted}, numbered 0 to {n_nodes - 1}; got {brief(given)}.")
    return rows


def padded(offsets: Ints, flat: Ints) -> Ints:
    """Return rows of different lengths as an array (k, n), filled up with -1."""
    counts = np.diff(offsets)
    rows = np.full((len(counts), counts.max(initial=0)), -1)
    rows[np.arange(rows.shape[1]) < counts[:, None]] = flat
    return rows


def coinciding_sides(outlines: tuple[Ints, Ints], body: Ints, place: Ints) -> tuple[Ints, Ints]:
    """Return nodes of sides of two bodies in the same places: of the earlier body, and of the later one.

    `outlines` are the offsets and vertices of the sides of the boundary. Rows (k, n) of nodes are in the order of the
    side of the earlier body, filled up with -1.
    """
    offsets, vertices = outlines
    shared = np.bincount(place)[place] > 1
    sides = np.flatnonzero(np.logical_and.reduceat(shared[vertices], offsets[:-1]))
    rows, nodes = rows_in_order(offsets, vertices, sides)
    number = same_rows(rows, place[nodes])[1]
    order = np.argsort(number, kind="stable")
    again = np.flatnonzero(np.diff(number[order]) == 0)
    one, other = order[again], order[again + 1]
    mine = rows_in_order(rows, nodes, one)
    count = int(body.max()) + 1
    wanted = place[mine[1]] * count + np.repeat(body[nodes[rows[:-1]]][other], np.diff(mine[0]))
    across = found_in(place * count + body, wanted)
    return padded(*mine), padded(mine[0], across)


def pairs_of(interfaces: Mapping[str, Interface]) -> Ints:
    """Return all pairs (m, 2) of nodes in the same place."""
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *(found.pairs for found in interfaces.values())])


def places_of(pairs: Ints, points: Floats) -> Ints:
    """Return the place of each node, (n_nodes,): the smallest number of a node that is there; or raise MeshError."""
    if not len(pairs):
        return np.arange(len(points))
    one, other = points[pairs[:, 0]], points[pairs[:, 1]]
    apart = np.flatnonzero(~(np.abs(one - other).max(axis=1) <= rounding(one, other)))
    if len(apart):
        a, b = pairs[apart[0]]
        raise MeshError(f"nodes {a} and {b} are partners at an interface, but at {points[a]} and {points[b]}.")
    return smallest_linked(pairs, len(points))


def on_boundary(
    interfaces: Mapping[str, Interface], outlines: tuple[Ints, Ints], node_map: Ints | None = None
) -> dict[str, Interface]:
    """Return interfaces with sides in the order of the boundary, each as it runs there; or raise MeshError.

    `outlines` are the offsets and vertices of the edges or faces of the boundary.
    """
    offsets, vertices = outlines
    found = {}
    for name, interface in interfaces.items():
        there = interface.edges >= 0
        rows = offsets_of(there.sum(axis=1))
        new = [interface.edges[there], interface.partners[there]]
        nodes, partners = new if node_map is None else [node_map[side] for side in new]
        both = np.concatenate([rows, rows[-1] + rows[1:]]), np.concatenate([nodes, partners])
        number, beside = np.split(matching_rows(offsets, vertices, *both), 2)
        side, how = "a face", "Name faces of the first body by their vertices"
        if there.shape[1] == 2:
            side, how = "an edge", "The edges of the first body run counter-clockwise about it"
            first = vertices[::2]
            number[first[number] != nodes[::2]] = -1
            beside[first[beside] != partners[1::2]] = -1
        for given, at in ((partners, beside), (nodes, number)):
            if (at < 0).any():
                k = int(np.argmax(at < 0))
                row = tuple(given[rows[k] : rows[k + 1]].tolist())
                raise MeshError(
                    f"interface {name!r}: {row} is not {side} of the boundary. {how}; partners are the nodes of the "
                    "second one there."
                )
        order = np.argsort(number)
        count = int(max(vertices.max(), partners.max())) + 1
        own_rows, own = rows_in_order(offsets, vertices, number[order])
        wanted = np.repeat(order, np.diff(own_rows)) * count + own
        mine = partners[found_in(cell_of_corner(rows) * count + nodes, wanted)]
        edges, across = (read_only(padded(own_rows, side)) for side in (own, mine))
        found[name] = replace(interface, edges=edges, partners=across)
    return found


def faces_of(side: Ints, outlines: tuple[Ints, Ints]) -> Ints:
    """Return the numbers in the boundary of the faces of one side of an interface, rows (k, n) of nodes."""
    there = side >= 0
    return matching_rows(*outlines, offsets_of(there.sum(axis=1)), side[there])
