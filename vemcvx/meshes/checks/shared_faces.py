"""Listed faces joined: which of them are one face, that of two cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Bools, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.cells import brief_row
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, edge_keys, rows_in_order
from vemcvx.meshes.polyhedra.topology import same_faces


class SharedFaces(NamedTuple):
    """Faces that cells list, joined."""

    first: Ints
    """(n_faces,) the listing that names each face first"""
    number: Ints
    """(n_listed,) the face that each listing is"""
    along: Bools
    """(n_listed,) whether it runs as the first listing of its face"""


def shared_faces(offsets: Ints, vertices: Ints, owner: Ints, n_nodes: int) -> SharedFaces:
    """Join the faces that cells list (see `SharedFaces`); MeshError if one has three cells, or two outlines."""
    first, number = same_faces(offsets, vertices)
    counts = np.bincount(number)
    crowded = np.flatnonzero(counts > 2)
    order = np.argsort(number, kind="stable")
    starts = np.cumsum(counts) - counts
    if len(crowded):
        face = crowded[0]
        cells = owner[order[starts[face] : starts[face] + counts[face]]]
        raise MeshError(
            f"the face {_row(offsets, vertices, first[face])} belongs to {counts[face]} cells: "
            f"{', '.join(map(str, cells[:6]))}. At most two cells can share a face; remove or correct the others."
        )
    one, other = order[starts[counts == 2]], order[starts[counts == 2] + 1]
    twice = np.flatnonzero(owner[one] == owner[other])
    if len(twice):
        k = one[twice[0]]
        raise MeshError(
            f"cell {owner[k]} lists its face {_row(offsets, vertices, k)} twice; every face must appear once."
        )
    along = np.ones(len(owner), dtype=bool)
    along[other] = _run_along(offsets, vertices, one, other, n_nodes=n_nodes, owner=owner)
    return SharedFaces(first, number, along)


def _run_along(offsets: Ints, vertices: Ints, one: Ints, other: Ints, *, n_nodes: int, owner: Ints) -> Bools:
    """Whether two listings of the same vertices run the same way around; MeshError if they make other outlines."""
    rows, keys, way = [], [], []
    for listed in (one, other):
        at, nodes = rows_in_order(offsets, vertices, listed)
        ends = directed_edges(at, nodes)
        key = edge_keys(ends, n_nodes)
        order = np.lexsort((key, cell_of_corner(at)))
        rows.append(at)
        keys.append(key[order])
        way.append(ends[order, 0] < ends[order, 1])
    differs = np.flatnonzero(keys[0] != keys[1])
    if len(differs):
        k = int(np.searchsorted(rows[0], differs[0], side="right")) - 1
        raise MeshError(
            f"cells {owner[one[k]]} and {owner[other[k]]} list the vertices of a face in different orders, "
            f"{_row(offsets, vertices, one[k])} and {_row(offsets, vertices, other[k])}. Run around it both times, in "
            "either direction."
        )
    begin = rows[0][:-1]
    same: Bools = way[0][begin] == way[1][begin]
    return same


def _row(offsets: Ints, vertices: Ints, listing: int) -> str:
    return brief_row(vertices[offsets[listing] : offsets[listing + 1]])
