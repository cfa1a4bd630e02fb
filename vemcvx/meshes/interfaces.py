"""Interfaces: where the boundaries of two bodies coincide, edge by edge, each body with nodes of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints, brief, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes.box import check_edges, check_mapping, check_name
from vemcvx.meshes.polygons.geometry import rounding
from vemcvx.meshes.polygons.topology import edge_keys, smallest_linked


@dataclass(frozen=True, eq=False)
class Interface:
    """Edges of one body that are also edges of another, each with nodes of its own in the same places.

    Attributes
    ----------
    bodies : (str, str)
        Names of the two bodies, the first and the second.
    edges : (k, 2) int
        Edges of the first body, as they run in its counter-clockwise cells: the body on the left.
    partners : (k, 2) int
        The nodes of the second body in the same places, so that it has the edges ``partners[:, ::-1]``.
    """

    bodies: tuple[str, str]
    edges: Ints
    partners: Ints

    @property
    def pairs(self) -> Ints:
        """Nodes of the first body and of the second in the same places, (m, 2), each pair once, in order."""
        return np.unique(np.column_stack([self.edges.ravel(), self.partners.ravel()]), axis=0)


def check_interfaces(interfaces: Mapping[str, Interface] | None, n_nodes: int) -> dict[str, Interface]:
    """Interfaces whose edges and partners are pairs of node numbers, or MeshError."""
    found = {}
    for name, given in check_mapping(interfaces, "interfaces", "Interface").items():
        check_name(name)
        if not isinstance(given, Interface):
            raise MeshError(f"interface {name!r}: found {brief(given)} where an Interface is wanted.")
        bodies = tuple(given.bodies) if isinstance(given.bodies, (tuple, list)) else ()
        if len(bodies) != 2 or not all(isinstance(body, str) for body in bodies):
            raise MeshError(f"interface {name!r}: bodies must be the names of two; got {brief(given.bodies)}.")
        edges, partners = (check_edges(name, ends, n_nodes) for ends in (given.edges, given.partners))
        if edges.shape != partners.shape:
            raise MeshError(f"interface {name!r}: it has {len(edges)} edges and partners of {len(partners)}.")
        found[name] = Interface(bodies, edges, partners)
    return found


def pairs_of(interfaces: Mapping[str, Interface]) -> Ints:
    """All pairs (m, 2) of nodes in the same place."""
    return np.concatenate([np.empty((0, 2), dtype=np.int64), *(found.pairs for found in interfaces.values())])


def places_of(pairs: Ints, points: Floats) -> Ints:
    """The place of each node, (n_nodes,): the smallest of the numbers of the nodes that are there, or MeshError."""
    if not len(pairs):
        return np.arange(len(points))
    one, other = points[pairs[:, 0]], points[pairs[:, 1]]
    apart = np.flatnonzero(~(np.abs(one - other).max(axis=1) <= rounding(one, other)))
    if len(apart):
        a, b = pairs[apart[0]]
        raise MeshError(f"nodes {a} and {b} are partners at an interface, but at {points[a]} and {points[b]}.")
    return smallest_linked(pairs, len(points))


def outside(interfaces: Mapping[str, Interface], boundary: Ints, n_nodes: int) -> Bools:
    """A mask of the edges of the boundary (m, 2) that no interface has on either side."""
    keys = edge_keys(boundary, n_nodes)
    sides = [edge_keys(side, n_nodes) for found in interfaces.values() for side in (found.edges, found.partners)]
    return ~np.isin(keys, np.concatenate([keys[:0], *sides]))


def on_boundary(
    interfaces: Mapping[str, Interface], boundary: Ints, n_nodes: int, node_map: Ints | None = None
) -> dict[str, Interface]:
    """Interfaces with their edges in the order of the boundary; MeshError if one side is not on it."""
    keys = boundary[:, 0] * n_nodes + boundary[:, 1]
    order = np.argsort(keys)
    found = {}
    for name, interface in interfaces.items():
        new = [interface.edges, interface.partners]
        edges, partners = new if node_map is None else [node_map[ends] for ends in new]
        for side in (partners[:, ::-1], edges):
            wanted = side[:, 0] * n_nodes + side[:, 1]
            place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
            wrong = np.flatnonzero(keys[place] != wanted)
            if len(wrong):
                raise MeshError(
                    f"interface {name!r}: {tuple(side[wrong[0]].tolist())} is not an edge of the boundary. The edges "
                    "of the first body run counter-clockwise about it; partners are the nodes of the second one there."
                )
        along = np.argsort(place)
        found[name] = replace(interface, edges=read_only(edges[along]), partners=read_only(partners[along]))
    return found
