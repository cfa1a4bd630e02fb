"""Do the faces of every cell close, and which way do they run? Each edge of a cell is in exactly two of its faces.

Both run the edge in opposite directions if their normals point to the same side of the cell. Where they do not, which
faces must be turned is read off the components of a graph of twice as many nodes, one a face as it is and one a face
turned: links join what runs along together. A cell whose face is linked to itself turned has no inside.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, edge_keys, smallest_linked


def faces_to_turn(offsets: Ints, vertices: Ints, cell_offsets: Ints, n_nodes: int) -> Bools:
    """Which listed faces (m,) must be turned for those of a cell to run along together, or MeshError.

    The first face of each cell stays as it is; whether all then point outwards or inwards, volumes tell.
    """
    owner = cell_of_corner(cell_offsets)
    listing = cell_of_corner(offsets)
    ends = directed_edges(offsets, vertices)
    corners = _pairs(ends, owner[listing], n_nodes)
    pairs = listing[corners]
    connected = smallest_linked(pairs, len(owner))
    first = np.repeat(cell_offsets[:-1], np.diff(cell_offsets))
    apart = np.flatnonzero(connected != first)
    if len(apart):
        raise MeshError(
            f"cell {owner[apart[0]]} falls into several closed surfaces; a cell has one. Make each a cell of its own, "
            "or split a cell with a cavity in two."
        )
    along = ends[corners[:, 0], 0] == ends[corners[:, 1], 0]
    if not along.any():
        return np.zeros(len(owner), dtype=bool)
    count = len(owner)
    one, other = pairs.T
    turned = other + count * along
    links = np.concatenate(
        [np.column_stack([one, turned]), np.column_stack([one + count, (turned + count) % (2 * count)])]
    )
    label = smallest_linked(links, 2 * count)
    endless = np.flatnonzero(label[:count] == label[count:])
    if len(endless):
        raise MeshError(
            f"cell {owner[endless[0]]} has no inside: its faces close like those of a Klein bottle. Correct its faces."
        )
    flips: Bools = label[:count] != label[first]
    return flips


def _pairs(ends: Ints, cells: Ints, n_nodes: int) -> Ints:
    """The two corners (m, 2) of each cell that start an edge of it; MeshError if there are more or fewer."""
    edges, number = np.unique(edge_keys(ends, n_nodes), return_inverse=True)
    keys = cells * len(edges) + number
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0]))
    counts = np.diff(np.append(starts, len(keys)))
    wrong = np.flatnonzero(counts != 2)
    if len(wrong):
        k = wrong[np.argmin(cells[order[starts[wrong]]])]
        corner = order[starts[k]]
        a, b = sorted(ends[corner].tolist())
        if counts[k] == 1:
            raise MeshError(
                f"cell {cells[corner]} is not closed: its edge ({a}, {b}) belongs to one of its faces only. List all "
                "its faces; where a neighbour's edge is cut in two by a node, so must be this one."
            )
        raise MeshError(
            f"cell {cells[corner]} touches itself: its edge ({a}, {b}) belongs to {counts[k]} of its faces, wanted are "
            "two. Split the cell there, or remove the face that is listed twice."
        )
    return order.reshape(-1, 2)
