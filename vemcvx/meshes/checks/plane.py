"""Checks of the points and cells of plane meshes.

Clockwise cells are reversed, and unused nodes are dropped. A note describes each correction. Shapely decides whether a
polygon is simple, and whether polygons form a coverage. In a coverage, polygons share whole edges and do not overlap.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SINGLE_EPS, Floats, Ints, brief, plain
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.box import LARGEST
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons import (
    TOLERANCE,
    areas_and_centroids,
    cell_of_corner,
    close_pairs,
    diameters,
    offsets_of,
    outlines,
    reverse_rows,
)

CELL = "cell {}".format
Name = Callable[[int], str]  # number of a row -> name in messages


class CheckedMesh(NamedTuple):
    """Arrays of a valid mesh."""

    arrays: tuple[NDArray[Any], ...]  # in the order of `ARRAYS` of the mesh class
    interfaces: dict[str, Interface]
    node_map: Ints | None  # new numbers of given nodes, -1 for dropped nodes
    notes: list[str]  # sentences about corrections


def check_polygon_mesh(points: ArrayLike, cells: Any, interfaces: Mapping[str, Interface] | None) -> CheckedMesh:
    """Return the checked arrays of a `PolygonMesh`, or raise MeshError."""
    points = check_points(points)
    offsets, own = lay_flat(list_of(cells, "cells must be a sequence of sequences of node numbers"), CELL)
    if len(offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    check_polygons(offsets, own, len(points), CELL)
    interfaces = check_interfaces(interfaces, len(points))
    place = places_of(pairs_of(interfaces), points)
    vertices = place[own]
    check_coincident(points, vertices)
    areas = check_cells(points, offsets, vertices)
    _check_coverage(points, offsets, vertices)
    notes, backwards = [], areas < 0.0
    if backwards.any():
        notes.append(
            f"{backwards.sum()} of {len(backwards)} cells were listed clockwise (the first is cell "
            f"{np.argmax(backwards)}) and have been reversed."
        )
    points, vertices, node_map, more = drop_unused(points, reverse_rows(offsets, own, backwards))
    return CheckedMesh((points, offsets, vertices), interfaces, node_map, notes + more)


def drop_unused(points: Floats, vertices: Ints) -> tuple[Floats, Ints, Ints | None, list[str]]:
    """Return points and vertices without unused nodes, `node_map`, and notes."""
    used = np.unique(vertices)
    if len(used) == len(points):
        return points, vertices, None, []
    node_map = np.full(len(points), -1)
    node_map[used] = np.arange(len(used))
    note = (
        f"{len(points) - len(used)} of {len(points)} nodes belong to no cell (the first is node "
        f"{np.argmin(node_map)}) and have been dropped; mesh.node_map gives the new numbers."
    )
    return points[used], node_map[vertices], node_map, [note]


def check_points(points: ArrayLike, dimension: int = 2) -> Floats:
    """Return a copy of the points as finite floats, or raise MeshError."""
    given = plain(points)
    if given is None or given.dtype.kind not in "biuf" or given.ndim != 2 or given.shape[1] != dimension:
        found = brief(points) if given is None or given.dtype.kind not in "biuf" else f"the shape {given.shape}"
        raise MeshError(f"points must be real numbers of shape (n_nodes, {dimension}); got {found}.")
    array = np.array(given, dtype=float)
    bad = np.flatnonzero(~(np.abs(array) <= LARGEST).all(axis=1))
    if len(bad):
        raise MeshError(
            f"node {bad[0]} is at {tuple(array[bad[0]].tolist())}: coordinates must be finite, and at most {LARGEST:g} "
            "in size. Choose other units."
        )
    return array


def list_of(given: Any, wanted: str) -> list[Any]:
    """Return the given object as a list, or raise MeshError."""
    try:
        return list(given)
    except Exception:  # users may pass any object
        raise MeshError(f"{wanted}; got {type(given).__name__}.") from None


def lay_flat(rows: list[Any], name: Name) -> tuple[Ints, Ints]:
    """Return rows of whole numbers as offsets and entries, or raise MeshError."""
    flat, counts = None, np.zeros(len(rows), dtype=np.int64)
    with contextlib.suppress(Exception):  # rows may be of any type
        counts[:] = list(map(len, rows))
        flat = np.concatenate([np.empty(0, dtype=np.int64), *rows])
    if flat is None or flat.ndim != 1 or flat.dtype != np.int64:
        for number, made in enumerate(map(plain, rows)):
            if made is None or made.ndim != 1 or (made.dtype.kind not in "iu" and made.size):
                found = type(rows[number]).__name__ if made is None else f"{made.dtype} of shape {made.shape}"
                raise MeshError(f"{name(number)} must be a list of node numbers; got {found}.")
        flat = np.concatenate(list(map(np.ravel, rows)), dtype=np.int64, casting="unsafe")
    return offsets_of(counts), flat


def check_polygons(offsets: Ints, vertices: Ints, n_nodes: int, name: Name) -> None:
    """Raise MeshError if a polygon has too few, repeated or invalid nodes."""
    few = np.flatnonzero(np.diff(offsets) < 3)
    if len(few):
        raise MeshError(f"{name(few[0])} has {np.diff(offsets)[few[0]]} vertices; a polygon has at least 3.")
    owner = cell_of_corner(offsets)
    bad = np.flatnonzero((vertices < 0) | (vertices >= n_nodes))
    if len(bad):
        raise MeshError(
            f"{name(owner[bad[0]])} names node {vertices[bad[0]]}; the {n_nodes} nodes are numbered 0 to {n_nodes - 1}."
        )
    keys = np.sort(owner * n_nodes + vertices)
    twice = keys[1:][np.diff(keys) == 0]
    if len(twice):
        polygon, node = divmod(int(twice[0]), n_nodes)
        raise MeshError(f"{name(polygon)} names node {node} twice; every vertex must appear once.")


def brief_row(offsets: Ints, vertices: Ints, row: int) -> str:
    """Return the first six node numbers of a row, in brackets."""
    shown = list(map(str, vertices[offsets[row] : offsets[row + 1]]))
    return f"({', '.join(shown[:6])}{', ...' if len(shown) > 6 else ''})"


def check_coincident(points: Floats, vertices: Ints) -> None:
    """Raise MeshError if two vertices coincide up to rounding."""
    used = np.unique(vertices)
    pairs = used[close_pairs(points[used], TOLERANCE * np.abs(points).max())]
    if len(pairs):
        a, b = sorted(pairs[0])
        raise MeshError(
            f"nodes {a} and {b} are in the same place, {coordinates(points[a], 9)}. Replace them by one node, to "
            "join the cells around them. Or, if two bodies meet there, make a mesh (a file) of each body and join "
            "them with vx.meshes.bodies, which keeps both nodes and names the interface."
        )


def check_cells(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Return the signed areas of valid cells, or raise MeshError."""
    places, sizes = points[vertices], diameters(points, offsets, vertices)
    areas = areas_and_centroids(points, offsets, vertices)[0]
    rounding = roundings(places, offsets)
    check_areas(areas, sizes, rounding, CELL)
    check_simple(places, offsets, rounding, lambda k: f"cell {k} {brief_row(offsets, vertices, k)}")
    return areas


def roundings(places: Floats, offsets: Ints) -> Floats:
    """Return the rounding error of distances for each row of points."""
    return TOLERANCE * np.maximum.reduceat(np.abs(places).max(axis=1), offsets[:-1])


def check_areas(areas: Floats, sizes: Floats, rounding: Floats, name: Name) -> None:
    """Raise MeshError if a polygon has no area."""
    flat = np.flatnonzero(np.abs(areas) <= rounding * sizes)
    if len(flat):
        k = flat[0]
        raise MeshError(
            f"{name(k)} has no area (area {areas[k]:.3g}, diameter {sizes[k]:.3g}): its vertices lie on one line, or "
            "its outline crosses itself. Remove it or correct its vertices."
        )


def check_simple(places: Floats, offsets: Ints, rounding: Floats, name: Name) -> None:
    """Raise MeshError if an outline crosses or touches itself."""
    import shapely

    polygons = outlines(places, offsets, np.arange(len(places)))
    bad = ~shapely.is_valid(polygons)
    several = np.diff(offsets) > 3  # triangles are simple
    bad[several] |= shapely.minimum_clearance(polygons[several]) <= rounding[several]
    if bad.any():
        raise MeshError(
            f"{name(int(np.argmax(bad)))} crosses or touches itself. List its vertices in order around it; where its "
            "outline comes back to a vertex or an edge, move the vertex or split the polygon."
        )


def _check_coverage(points: Floats, offsets: Ints, vertices: Ints) -> None:
    """Raise MeshError unless the cells form a coverage without narrow gaps."""
    width = SINGLE_EPS * lowest(points, offsets, vertices)
    misfit = find_misfit(outlines(points, offsets, vertices), width)
    if misfit:
        (one, other), at = misfit
        raise MeshError(
            f"cells {one} and {other} overlap near {coordinates(at, 6)}, or do not fit together there. A vertex of one "
            "cell lies on an edge of the other without being its vertex, or there is a gap narrower than "
            f"{width:.3g} ({SINGLE_EPS:g} of the smallest cell height). Give both cells the same vertices, "
            "hanging nodes included, or widen the gap."
        )


def lowest(points: Floats, offsets: Ints, vertices: Ints) -> float:
    """Return the smallest cell height, which is area / diameter."""
    areas = areas_and_centroids(points, offsets, vertices)[0]
    return float((np.abs(areas) / diameters(points, offsets, vertices)).min())


def find_misfit(polygons: NDArray[Any], width: float, body: Ints | None = None) -> tuple[list[int], Floats] | None:
    """Return two cells that do not fit, and a nearby point, or None."""
    import shapely

    edges = shapely.coverage_invalid_edges(polygons, gap_width=width)
    bad = np.flatnonzero(~shapely.is_empty(edges))
    one, other = shapely.STRtree(polygons).query(edges[bad], predicate="dwithin", distance=width)
    one = bad[one]
    pairs = one != other if body is None else body[one] != body[other]
    one, other = one[pairs], other[pairs]
    overlap = shapely.area(shapely.intersection(polygons[one], polygons[other]))
    along = shapely.length(shapely.intersection(edges[one], edges[other]))
    near = np.flatnonzero((overlap > 0.0) | (shapely.distance(edges[one], edges[other]) <= width))
    if not len(near):
        return None
    k = near[np.lexsort((along[near], overlap[near]))[-1]]
    at = shapely.get_coordinates(shapely.shortest_line(edges[one[k]], polygons[other[k]]))[0]
    return sorted((int(one[k]), int(other[k]))), at
