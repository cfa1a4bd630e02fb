"""Interfaces, at which the boundaries of two bodies coincide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Floats, Ints, brief, plain, read_only
from vemcvx.base.errors import MeshError
from vemcvx.meshes.box import check_mapping, check_name
from vemcvx.meshes.polygons import (
    cell_of_corner,
    find_in,
    matching_rows,
    offsets_of,
    rounding,
    rows_in_order,
    same_rows,
    smallest_linked,
)


@dataclass(frozen=True, eq=False)
class Interface:
    """Coinciding edges of two bodies, or in space coinciding faces.

    Coinciding nodes have different numbers.

    Attributes
    ----------
    bodies : (str, str)
        Names of the two bodies, the first and the second.
    edges : (k, 2) int
        Nodes of edges, with the first body on the left. In space: nodes (k, n) of faces, counter-clockwise seen from
        outside the first body. Short rows are padded with -1.
    partners : (k, 2) int
        The nodes of the second body that coincide with the nodes in `edges`, entry by entry.

    Examples
    --------
    >>> two = {"lower": vx.meshes.squares(1), "upper": vx.meshes.squares(1, box=((0, 1), (1, 2)))}
    >>> vx.meshes.bodies(two).interfaces["lower|upper"].pairs
    array([[2, 4],
           [3, 5]])
    """

    bodies: tuple[str, str]
    edges: Ints
    partners: Ints

    @property
    def pairs(self) -> Ints:
        """Sorted pairs (m, 2): a node of the first body, and the coinciding node of the second body."""
        known = self.edges >= 0
        return np.unique(np.column_stack([self.edges[known], self.partners[known]]), axis=0)


def check_interfaces(
    interfaces: Mapping[str, Interface] | None, n_nodes: int, dimension: int = 2
) -> dict[str, Interface]:
    """Return the interfaces if they are valid, or raise MeshError."""
    found = {}
    wanted = "(k, 2)" if dimension == 2 else "(k, n), n > 2, each row padded with -1"
    for name, given in check_mapping(interfaces, "interfaces", "Interface").items():
        check_name(name)
        bodies: Any = getattr(given, "bodies", None)
        sides = (getattr(given, field, None) for field in ("edges", "partners"))
        edges, partners = map(plain, sides)
        two = isinstance(bodies, (tuple, list)) and [isinstance(body, str) for body in bodies] == [True, True]
        if not two or edges is None or partners is None or not _are_rows(edges, partners, n_nodes, dimension):
            raise MeshError(
                f"interface {name!r} must be an Interface with the names of two bodies; edges and partners must be "
                f"nodes 0 to {n_nodes - 1} in arrays of one shape {wanted}; got {brief(given)}."
            )
        found[name] = Interface(tuple(bodies), edges.astype(np.int64), partners.astype(np.int64))
    return found


def _are_rows(edges: NDArray[Any], partners: NDArray[Any], n_nodes: int, dimension: int) -> bool:
    if {edges.dtype.kind, partners.dtype.kind} - {"i", "u"} or edges.shape != partners.shape or edges.ndim != 2:
        return False
    if not len(edges) or edges.shape[1] < dimension or (dimension == 2 and edges.shape[1] > 2):
        return False
    rows = np.stack([edges, partners])
    are_known = (rows >= -1) & (rows < n_nodes) & ((rows < 0) == (edges < 0))
    return bool(are_known.all() and (edges[:, :dimension] >= 0).all())


def pad_rows(offsets: Ints, flat: Ints) -> Ints:
    """Return the rows as an array (k, n), padded with -1."""
    counts = np.diff(offsets)
    rows = np.full((len(counts), counts.max(initial=0)), -1)
    rows[np.arange(rows.shape[1]) < counts[:, None]] = flat
    return rows


def coinciding_sides(outlines: tuple[Ints, Ints], place: Ints) -> tuple[Ints, Ints]:
    """Return the nodes of coinciding edges or faces, for both bodies."""
    offsets, vertices = outlines
    shared = np.bincount(place)[place] > 1
    sides = np.flatnonzero(np.logical_and.reduceat(shared[vertices], offsets[:-1]))
    rows, nodes = rows_in_order(offsets, vertices, sides)
    first, number = same_rows(rows, place[nodes])
    again = np.flatnonzero(first[number] != np.arange(len(number)))
    one, other = (rows_in_order(rows, nodes, sides) for sides in (first[number[again]], again))
    return pad_rows(*one), pad_rows(one[0], partners_of(one, other, place))


def partners_of(one: tuple[Ints, Ints], other: tuple[Ints, Ints], places: Ints) -> Ints:
    """Return the nodes of the other body that coincide with the given nodes."""
    (rows, mine), (more, theirs), count = one, other, len(places)
    row = matching_rows(more, places[theirs], rows, places[mine])
    wanted = row[cell_of_corner(rows)] * count + places[mine]
    return theirs[find_in(cell_of_corner(more) * count + places[theirs], wanted)]


def pairs_of(interfaces: Mapping[str, Interface]) -> Ints:
    """Return all pairs (m, 2) of coinciding nodes."""
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *(found.pairs for found in interfaces.values())])


def places_of(pairs: Ints, points: Floats) -> Ints:
    """Return, for each node, the first node at the same place."""
    if not len(pairs):
        return np.arange(len(points))
    one, other = points[pairs[:, 0]], points[pairs[:, 1]]
    apart = np.flatnonzero(~(np.abs(one - other).max(axis=1) <= rounding(one, other)))
    if len(apart):
        a, b = pairs[apart[0]]
        raise MeshError(f"nodes {a} and {b} are partners at an interface, but lie at {points[a]} and {points[b]}.")
    return smallest_linked(pairs, len(points))


def on_boundary(
    interfaces: Mapping[str, Interface], outlines: tuple[Ints, Ints], node_map: Ints | None = None
) -> dict[str, Interface]:
    """Return interfaces with edges or faces in the order of the boundary."""
    offsets, vertices = outlines
    found = {}
    for name, interface in interfaces.items():
        there = interface.edges >= 0
        rows = offsets_of(there.sum(axis=1))
        new = [interface.edges[there], interface.partners[there]]
        nodes, partners = new if node_map is None else [node_map[side] for side in new]
        number, beside = (matching_rows(offsets, vertices, rows, side) for side in (nodes, partners))
        if there.shape[1] == 2:
            first = vertices[::2]
            number[first[number] != nodes[::2]] = -1
            beside[first[beside] != partners[1::2]] = -1
        for given, at in ((partners, beside), (nodes, number)):
            if (at < 0).any():
                k = int(np.argmax(at < 0))
                row = tuple(given[rows[k] : rows[k + 1]].tolist())
                raise MeshError(
                    f"interface {name!r}: {row} is not on the boundary. Edges of the first body run counter-clockwise "
                    "about it; partners are the nodes of the second body in the same places."
                )
        order, count = np.argsort(number), int(vertices.max()) + 1
        own_rows, own = rows_in_order(offsets, vertices, number[order])
        wanted = np.repeat(order, np.diff(own_rows)) * count + own
        mine = partners[find_in(cell_of_corner(rows) * count + nodes, wanted)]
        edges, across = (read_only(pad_rows(own_rows, side)) for side in (own, mine))
        found[name] = replace(interface, edges=edges, partners=across)
    return found


def faces_of(side: Ints, outlines: tuple[Ints, Ints]) -> Ints:
    """Return the positions of edges or faces in `outlines`."""
    there = side >= 0
    return matching_rows(*outlines, offsets_of(there.sum(axis=1)), side[there])
