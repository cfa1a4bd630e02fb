"""Is every cell by itself a simple polygon with an area? Checks of a user's mesh, one cell at a time.

A convex cell is told by its turns: none to the right, and once around in all. Only the others have their edges
compared pair by pair.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.polygons.segments import TOLERANCE, beside, cross, crossing, rounding
from vemcvx.meshes.polygons.shapes import areas_and_centroids, diameters
from vemcvx.meshes.polygons.topology import directed_edges, next_vertex, previous_corner

PAIRS_AT_ONCE = 500_000  # about 100 MB of temporaries


@dataclass(frozen=True)
class Fault:
    """Why a polygon is none.

    Attributes
    ----------
    kind : {"crossing", "flat", "spike", "touching"}
        Two edges cross; there is no area; the outline turns back on itself; a vertex lies on an edge.
    cell : int
        Number of the polygon.
    edge, other : sequence of int
        Nodes of the edge, and of the one that crosses it.
    node : int
        The node at the tip of the spike, or on the edge.
    beside : int
        Of a spike: the node on the edge.
    """

    kind: str
    cell: int
    edge: Sequence[int] = ()
    other: Sequence[int] = ()
    node: int = -1
    beside: int = -1


def check_cells(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Signed areas (n_cells,), or MeshError at the first cell that is not a simple polygon with an area."""
    areas, fault = fault_of(points, offsets, vertices)
    if fault is None:
        return areas
    cell = fault.cell
    if fault.kind == "flat":
        size = diameters(points, offsets[cell : cell + 2] - offsets[cell], vertices[offsets[cell] :])[0]
        raise MeshError(
            f"cell {cell} has no area: its vertices {brief_row(vertices[offsets[cell] : offsets[cell + 1]])} lie on "
            f"one line (area {areas[cell]:.3g}, diameter {size:.3g}). Remove it or correct its vertices."
        )
    edge, other = brief_row(fault.edge), brief_row(fault.other)
    if fault.kind == "crossing":
        raise MeshError(
            f"cell {cell} crosses itself: its edges {edge} and {other} intersect. List its vertices in order around it."
        )
    if fault.kind == "spike":
        raise MeshError(
            f"cell {cell} has a spike: at node {fault.node} its outline turns back on itself (node {fault.beside} lies "
            f"on the edge {edge}). Remove the node at the tip from the cell."
        )
    raise MeshError(
        f"cell {cell} touches itself: its node {fault.node} lies on its edge {edge}. Split the cell there, or move the "
        "node."
    )


def fault_of(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Fault | None]:
    """Signed areas (n_cells,), and what is wrong with the first cell that is not a simple polygon with an area."""
    areas = areas_and_centroids(points, offsets, vertices)[0]
    sizes = diameters(points, offsets, vertices)
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    thin = np.abs(areas) <= TOLERANCE * largest * sizes
    suspects = np.flatnonzero(thin | ~_convex(points, offsets, vertices, areas))
    ends = directed_edges(offsets, vertices)
    cells, first, second = _near_pairs(points, ends, offsets, suspects)
    fault = _crossing(points, cells, first, second)
    if fault is None and thin.any():
        fault = Fault("flat", int(np.flatnonzero(thin)[0]))
    return areas, fault or _touching(points, cells, first, second)


def _convex(points: Floats, offsets: Ints, vertices: Ints, areas: Floats) -> Bools:
    """Cells that turn one way only and once around, with no turn back by (nearly) half a circle."""
    edge = points[next_vertex(offsets, vertices)] - points[vertices]
    before = edge[previous_corner(offsets)]
    turn = np.arctan2(cross(before, edge), np.einsum("ij,ij->i", before, edge))
    turn *= np.repeat(np.sign(areas), np.diff(offsets))
    # A straight angle may turn back by rounding; 1e-9 keeps such cells here, and cannot hide a crossing: the turns
    # of a cell that winds twice add up to two full circles.
    one_way = np.minimum.reduceat(turn, offsets[:-1]) > -1e-9
    no_spike = np.maximum.reduceat(turn, offsets[:-1]) < np.pi - 1e-6
    once = np.abs(np.add.reduceat(turn, offsets[:-1]) - 2.0 * np.pi) < 1e-3
    return one_way & no_spike & once


def _pairs_of_edges(offsets: Ints, cells: Ints) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Cell and two corners (edges start there) for every pair of edges of the given cells, in portions."""
    counts = np.diff(offsets)[cells]
    for count in np.unique(counts):
        here = cells[counts == count]
        for start in range(0, count * (count - 1) // 2, PAIRS_AT_ONCE):
            one, other = _pairs_of(count, start, min(start + PAIRS_AT_ONCE, count * (count - 1) // 2))
            portion = max(1, PAIRS_AT_ONCE // len(one))
            for begin in range(0, len(here), portion):
                some = here[begin : begin + portion]
                corner = offsets[some][:, None]
                yield np.repeat(some, len(one)), (corner + one).ravel(), (corner + other).ravel()


def _pairs_of(count: int, start: int, stop: int) -> tuple[Ints, Ints]:
    """Pairs (i, j), i < j < count, number start to stop, ordered by j and then i."""
    number = np.arange(start, stop)
    j = np.floor(0.5 + np.sqrt(2.0 * number + 0.25)).astype(np.int64)
    j += (j + 1) * j // 2 <= number
    j -= j * (j - 1) // 2 > number
    return number - j * (j - 1) // 2, j


def _near_pairs(points: Floats, ends: Ints, offsets: Ints, cells: Ints) -> tuple[Ints, Ints, Ints]:
    """Cell and two edges (m, 2), as node numbers, for the pairs of edges of a cell whose boxes meet up to rounding."""
    start, end = points[ends[:, 0]], points[ends[:, 1]]
    slack = rounding(start, end)[:, None]
    left, bottom = (np.minimum(start, end) - slack).T.copy()
    right, top = (np.maximum(start, end) + slack).T.copy()
    found = [(np.empty(0, dtype=np.int64),) * 3]
    for cell, i, j in _pairs_of_edges(offsets, cells):
        beside_x = (left[i] <= right[j]) & (left[j] <= right[i])
        near = np.flatnonzero(beside_x & (bottom[i] <= top[j]) & (bottom[j] <= top[i]))
        found.append((cell[near], i[near], j[near]))
    cell, i, j = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return cell, ends[i], ends[j]


def _crossing(points: Floats, cells: Ints, first: Ints, second: Ints) -> Fault | None:
    bad = np.flatnonzero(crossing(points, first, second))
    return Fault("crossing", int(cells[bad[0]]), first[bad[0]], second[bad[0]]) if len(bad) else None


def _touching(points: Floats, cells: Ints, first: Ints, second: Ints) -> Fault | None:
    edge = np.concatenate([first, first, second, second])
    other = np.concatenate([second, second, first, first])
    node = np.concatenate([second[:, 0], second[:, 1], first[:, 0], first[:, 1]])
    apart = np.flatnonzero((edge[:, 0] != node) & (edge[:, 1] != node))
    edge, other, node, cells = edge[apart], other[apart], node[apart], np.tile(cells, 4)[apart]
    at, start, end = points[node], points[edge[:, 0]], points[edge[:, 1]]
    bad = np.flatnonzero(beside(at, start, end)[0] <= rounding(at, start, end))
    if not len(bad):
        return None
    tips = (edge[bad, :, None] == other[bad, None]).any(axis=2)  # which end of the edge the other edge starts from
    k = bad[np.argmax(tips.any(axis=1))]  # a spike also makes edges farther on touch: name the spike
    if tips.any():
        tip = edge[k][np.isin(edge[k], other[k])][0]
        return Fault("spike", int(cells[k]), edge[k], node=int(tip), beside=int(node[k]))
    return Fault("touching", int(cells[k]), edge[k], node=int(node[k]))


def brief_row(nodes: Sequence[int] | Ints) -> str:
    """Node numbers in brackets, long lists cut."""
    shown = ", ".join(map(str, nodes[:6]))
    return f"({shown}{', ...' if len(nodes) > 6 else ''})"
