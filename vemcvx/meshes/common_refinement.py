"""The coarsest mesh that refines two refinements of one mesh: everywhere the finer of their cells.

Of two such meshes each cell of the one lies in a cell of the other or is filled by some. That is told from the cells
themselves, without a tree: by the areas of those around one inner point of each. Nodes of both are matched by
place, then nodes that lie on an edge become vertices of the cell beside it.
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from vemcvx.errors import MeshError
from vemcvx.meshes.geometry import Floats
from vemcvx.meshes.location import cells_around, inner_points
from vemcvx.meshes.named import check_cell_data
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.ragged import offsets_of, spans
from vemcvx.meshes.search import search_tree
from vemcvx.meshes.segments import Bools, beside, overlapping_boxes, rounding
from vemcvx.meshes.topology import Ints, edge_keys, next_vertex
from vemcvx.real import brief

# Relative: areas of cells and places of nodes that count as the same. Both agree to some 1e-13; refinement makes
# parts of at most 0.7 of a cell, and nodes at least 0.01 of an edge apart.
SAME = 1e-6


def common_refinement(a: PolygonMesh, b: PolygonMesh) -> PolygonMesh:
    """Return the mesh that has, everywhere, the finer of the cells of two refinements of the same mesh.

    Parameters
    ----------
    a, b : PolygonMesh
        Made of one mesh by `refine`, any number of times.

    Returns
    -------
    PolygonMesh
        Cells in the order of the cells of ``a`` that they are or lie in; nodes of ``a`` first. Names of boundaries and
        cell data are those of ``a``. Several nodes may hang on a side, however the two are graded.

    Raises
    ------
    MeshError
        A cell of ``a`` and one of ``b`` overlap in part, or the meshes do not cover the same domain.
    """
    for name, mesh in (("a", a), ("b", b)):
        if not isinstance(mesh, PolygonMesh):
            raise MeshError(f"common_refinement: found {name} = {brief(mesh)}; wanted a PolygonMesh.")
    around_a, around_b = cells_around(b, inner_points(a)), cells_around(a, inner_points(b))
    for name, around in (("a", around_a), ("b", around_b)):
        if (around < 0).any():
            raise MeshError(
                f"cell {np.flatnonzero(around < 0)[0]} of mesh {name} lies outside the other mesh; a common refinement "
                "needs two meshes made of the same one by refine()."
            )
    kept_a = a.areas <= (1.0 + SAME) * b.areas[around_a]
    kept_b = b.areas < (1.0 - SAME) * a.areas[around_b]
    _check_filled(a, b, kept_a, around_b[kept_b], b.areas[kept_b], "a")
    _check_filled(b, a, kept_b, around_a[kept_a], a.areas[kept_a], "b")
    points = np.concatenate([a.points, b.points])
    number = _numbers_in(a, b)
    cells = [np.flatnonzero(kept_a), np.flatnonzero(kept_b)]
    parents = np.concatenate([cells[0], around_b[cells[1]]])
    offsets, vertices = _listed((a.offsets, a.vertices, cells[0]), (b.offsets, number[b.vertices], cells[1]))
    order = np.argsort(parents, kind="stable")
    offsets, vertices = _listed((offsets, vertices, order))
    offsets, vertices = _with_hanging(points, offsets, vertices)
    used, vertices = np.unique(vertices, return_inverse=True)
    mesh = PolygonMesh.unchecked(points[used], offsets, vertices, a._box)
    data = check_cell_data({name: values[parents[order]] for name, values in a.cell_data.items()}, mesh.n_cells)
    return mesh._replace(_named=_names(a, mesh), cell_data=MappingProxyType(data))


def _check_filled(mesh: PolygonMesh, other: PolygonMesh, kept: Bools, around: Ints, areas: Floats, name: str) -> None:
    """MeshError unless the cells that are not kept are filled by those of the other mesh, and the kept by none."""
    filled = np.bincount(around, weights=areas, minlength=mesh.n_cells)
    bad = np.flatnonzero(np.abs(filled - np.where(kept, 0.0, mesh.areas)) > SAME * mesh.areas)
    if len(bad):
        raise MeshError(
            f"cell {bad[0]} of mesh {name} overlaps cells of the other mesh in part ({len(bad)} of {mesh.n_cells} do; "
            f"the other has {other.n_cells} cells); a common refinement needs two meshes made of the same one by "
            "refine()."
        )


def _numbers_in(a: PolygonMesh, b: PolygonMesh) -> Ints:
    """Numbers of the nodes of b among those of a, followed by those of b that a does not have."""
    apart, nearest = search_tree(a.points).query(b.points)
    reach = SAME * np.minimum(_shortest_edges(a)[nearest], _shortest_edges(b)) + rounding(b.points)
    return np.where(apart <= reach, nearest, a.n_nodes + np.arange(b.n_nodes))


def _shortest_edges(mesh: PolygonMesh) -> Floats:
    """Length of the shortest edge at each node, (n_nodes,)."""
    ends = next_vertex(mesh.offsets, mesh.vertices)
    length = np.hypot(*(mesh.points[ends] - mesh.points[mesh.vertices]).T)
    shortest = np.full(mesh.n_nodes, np.inf)
    np.minimum.at(shortest, mesh.vertices, length)
    np.minimum.at(shortest, ends, length)
    return shortest


def _listed(*parts: tuple[Ints, Ints, Ints]) -> tuple[Ints, Ints]:
    """Offsets and vertices of chosen cells, given as (offsets, vertices, cells)."""
    counts = [np.diff(offsets)[cells] for offsets, _, cells in parts]
    lists = [vertices[spans(part[cells], n)] for (part, vertices, cells), n in zip(parts, counts, strict=True)]
    return offsets_of(np.concatenate(counts)), np.concatenate(lists)


def _with_hanging(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Ints, Ints]:
    """The cells with every node that lies on one of their edges as a vertex."""
    ends = next_vertex(offsets, vertices)
    _, inverse, counts = np.unique(edge_keys(vertices, ends, len(points)), return_inverse=True, return_counts=True)
    single = np.flatnonzero(counts[inverse] == 1)
    nodes = np.unique(np.concatenate([vertices[single], ends[single]]))
    node, edge = _on_edges(points[nodes], points[vertices[single]], points[ends[single]])
    node, corner = nodes[node], single[edge]
    inner = (node != vertices[corner]) & (node != ends[corner])
    node, corner = node[inner], corner[inner]
    along = np.hypot(*(points[node] - points[vertices[corner]]).T)
    order = np.lexsort((along, corner))
    sizes = 1 + np.bincount(corner, minlength=len(vertices))
    place = offsets_of(sizes)
    outlines = np.empty(place[-1], dtype=np.int64)
    old = np.zeros(len(outlines), dtype=bool)
    old[place[:-1]] = True
    outlines[old], outlines[~old] = vertices, node[order]
    return place[offsets], outlines


def _on_edges(at: Floats, start: Floats, end: Floats) -> tuple[Ints, Ints]:
    """Pairs (i, j) where the point i lies on the edge j, ends included."""
    margin = SAME * np.hypot(*(end - start).T)[:, None] + rounding(start, end)[:, None]
    point, edge = overlapping_boxes(at, at, np.minimum(start, end) - margin, np.maximum(start, end) + margin)
    near = beside(at[point], start[edge], end[edge])[0] <= margin[edge, 0]
    return point[near], edge[near]


def _names(a: PolygonMesh, mesh: PolygonMesh) -> dict[str, Ints]:
    """The boundary edges of the mesh on those of a that have a name."""
    if not a._named:
        return {}
    boundary = mesh._boundary
    middles = mesh.points[boundary].mean(axis=1)
    named = {}
    for name, part in a._named.items():
        some, _ = _on_edges(middles, a.points[part[:, 0]], a.points[part[:, 1]])
        named[name] = boundary[np.unique(some)]
        named[name].flags.writeable = False
    return named
