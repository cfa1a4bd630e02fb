"""A mesh of space checked: from points and cells to polyhedra that fit together, or to a MeshError.

Faults are told in the order in which they can be: numbers, places of nodes, single faces, single cells, how cells fit
together. Faces that do not run outwards are turned and nodes that no cell uses dropped, each with a note for a warning.

Each edge of a cell is in exactly two of its faces, which run it in opposite directions if their normals point to the
same side of the cell. Where they do not, the faces to be turned are read off the components of a graph of twice as many
nodes, one a face as it is and one a face turned: links join what runs along together. A cell whose face is linked to
itself turned has no inside.

Two cells meet in whole faces of both: no two faces of the boundary may lie on one another. Cells that pierce each other
are not looked for; they are found if their volumes add up to more than that of the convex hull of all.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SINGLE, Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes import polygons, polyhedra
from vemcvx.meshes.checks import plane
from vemcvx.meshes.checks.plane import brief_row, check_polygons, laid_flat
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons import TOLERANCE, cell_of_corner, directed_edges, offsets_of, rows_in_order, turned
from vemcvx.meshes.polyhedra import Faces, FaceShapes, Listed


def checked_in_space(points: ArrayLike, cells: Any, interfaces: Mapping[str, Interface] | None) -> plane.Checked:
    """Points and `Faces` of a `PolyhedralMesh`, or MeshError.

    Only at interfaces may two nodes be in one place; how cells fit together is checked as if nodes there were one.
    """
    points = plane.check_points(points, 3)
    offsets, own, cell_offsets = check_face_lists(cells, len(points))
    interfaces = check_interfaces(interfaces, len(points), 3)
    place = places_of(pairs_of(interfaces), points)
    vertices = place[own]
    plane.check_coincident(points, np.unique(vertices))
    owner = cell_of_corner(cell_offsets)
    shared = shared_faces(offsets, vertices, owner, len(points))
    shapes = check_faces(points, *rows_in_order(offsets, vertices, shared.first), owner[shared.first])
    turn = faces_to_turn(offsets, vertices, cell_offsets, len(points))
    volumes = polyhedra.volumes_and_centroids(
        shapes, cell_offsets, shared.number, np.where(shared.along ^ turn, 1.0, -1.0)
    )[0]
    turn ^= (volumes < 0.0)[owner]
    first, outwards = shared.first[shared.number], shared.along ^ turn
    bad = np.flatnonzero((first != np.arange(len(owner))) & (outwards == outwards[first]))
    if len(bad):
        k = bad[0]
        raise MeshError(
            f"cells {owner[first[k]]} and {owner[k]} overlap: both lie on the same side of their face "
            f"{_row(offsets, vertices, k)}. Remove or correct one of them."
        )
    faces = polyhedra.joined_faces(offsets, turned(offsets, vertices, turn), cell_offsets)
    shapes = shapes._replace(normals=np.where(turn[shared.first, None], -shapes.normals, shapes.normals))
    check_volumes(points, faces, np.abs(volumes), shapes)
    notes = []
    if turn.any():
        mended = np.unique(owner[turn])
        notes.append(
            f"{len(mended)} of {len(volumes)} cells had faces that did not run outwards, counter-clockwise seen from "
            f"outside (the first is cell {mended[0]}); they have been turned."
        )
    if interfaces:
        faces = polyhedra.joined_faces(offsets, turned(offsets, own, turn), cell_offsets)
    points, vertices, node_map, more = plane.dropped(points, faces.face_vertices)
    return plane.Checked((points, *faces._replace(face_vertices=vertices)), interfaces, node_map, notes + more)


# Lists of faces.


BY_VERTICES = (
    "Tetrahedra, hexahedra, wedges and pyramids given by their vertices come in by "
    'vx.meshes.convert(meshio.Mesh(points, {"tetra": cells})).'
)


def check_face_lists(cells: Any, n_nodes: int) -> Listed:
    """The faces that cells list, or MeshError.

    Every cell has at least four faces, every face at least three different nodes that exist.
    """
    listed = cells if isinstance(cells, Listed) else _flattened(cells)
    if len(listed.cell_offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    few = np.flatnonzero(np.diff(listed.cell_offsets) < 4)
    if len(few):
        count = np.diff(listed.cell_offsets)[few[0]]
        raise MeshError(f"cell {few[0]} has {count} faces; a polyhedron has at least 4.")
    check_polygons(listed.offsets, listed.vertices, n_nodes, lambda face: _face(face, listed.cell_offsets))
    return listed


def _face(number: int, cell_offsets: Ints) -> str:
    cell = int(np.searchsorted(cell_offsets, number, side="right")) - 1
    return f"cell {cell}: its face {number - cell_offsets[cell]}"


def _flattened(cells: Any) -> Listed:
    try:
        listed = [list(cell) for cell in cells]
    except Exception:  # of whatever a user hands in
        raise MeshError(
            "cells must be a sequence of cells, each a sequence of faces, each a sequence of node numbers; got "
            f"{type(cells).__name__}. {BY_VERTICES}"
        ) from None
    cell_offsets = offsets_of(np.array([len(cell) for cell in listed], dtype=np.int64))

    def fault(number: int, row: NDArray[Any] | None) -> str:
        found = type(faces[number]).__name__ if row is None else f"{row.dtype} of shape {row.shape}"
        return f"{_face(number, cell_offsets)} must be a list of node numbers; got {found}. {BY_VERTICES}"

    faces = list(chain.from_iterable(listed))
    return Listed(*laid_flat(faces, fault), cell_offsets)


def faces_to_turn(offsets: Ints, vertices: Ints, cell_offsets: Ints, n_nodes: int) -> Bools:
    """A mask (m,) of listed faces to turn so that those of a cell are oriented alike, or MeshError.

    The first face of each cell stays as it is; whether all then point outwards or inwards, volumes tell.
    """
    owner = cell_of_corner(cell_offsets)
    listing = cell_of_corner(offsets)
    ends = directed_edges(offsets, vertices)
    corners = _pairs(ends, owner[listing], n_nodes)
    pairs = listing[corners]
    connected = polygons.smallest_linked(pairs, len(owner))
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
    backwards = other + count * along
    links = np.concatenate(
        [np.column_stack([one, backwards]), np.column_stack([one + count, (backwards + count) % (2 * count)])]
    )
    label = polygons.smallest_linked(links, 2 * count)
    endless = np.flatnonzero(label[:count] == label[count:])
    if len(endless):
        raise MeshError(
            f"cell {owner[endless[0]]} has no inside: its faces close like those of a Klein bottle. Correct its faces."
        )
    return label[:count] != label[first]


def _pairs(ends: Ints, cells: Ints, n_nodes: int) -> Ints:
    """The two corners (m, 2) of each cell that start an edge of it; MeshError if there are more or fewer."""
    edges, number = np.unique(polygons.edge_keys(ends, n_nodes), return_inverse=True)
    keys = cells * len(edges) + number
    order = np.argsort(keys, kind="stable")
    _, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
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
    first, number = polygons.same_rows(offsets, vertices)
    counts = np.bincount(number)
    order = np.argsort(number, kind="stable")
    starts = np.cumsum(counts) - counts
    crowded = np.flatnonzero(counts > 2)
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
    if not len(one):
        return SharedFaces(first, number, along)

    def edges(listed: Ints, backwards: bool = False) -> tuple[Ints, Ints]:
        """The offsets of faces, and their directed edges as numbers, ascending in each face."""
        rows, nodes = rows_in_order(offsets, vertices, listed)
        keys = directed_edges(rows, nodes) @ np.array([1, n_nodes] if backwards else [n_nodes, 1])
        return rows[:-1], keys[np.lexsort((keys, cell_of_corner(rows)))]

    begin, mine = edges(one)
    same = np.logical_and.reduceat(mine == edges(other)[1], begin)
    mirrored = np.logical_and.reduceat(mine == edges(other, backwards=True)[1], begin)
    differs = np.flatnonzero(~same & ~mirrored)
    if len(differs):
        k = differs[0]
        raise MeshError(
            f"cells {owner[one[k]]} and {owner[other[k]]} list the vertices of a face in different orders, "
            f"{_row(offsets, vertices, one[k])} and {_row(offsets, vertices, other[k])}. Run around it both times, in "
            "either direction."
        )
    along[other] = same
    return SharedFaces(first, number, along)


def _row(offsets: Ints, vertices: Ints, listing: int) -> str:
    return brief_row(vertices[offsets[listing] : offsets[listing + 1]])


# Shapes of faces, volumes of cells, and how these fit together.


def check_faces(points: Floats, offsets: Ints, vertices: Ints, cells: Ints) -> FaceShapes:
    """Shapes of faces of the cells (n_faces,), or MeshError at the first that is no plane simple polygon."""
    shapes = polyhedra.face_shapes(points, offsets, vertices)
    sizes = polygons.diameters(points, offsets, vertices)
    face = cell_of_corner(offsets)
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])

    def named(number: int) -> str:
        return f"cell {cells[number]}: its face {_row(offsets, vertices, number)}"

    flat = np.flatnonzero(shapes.areas <= TOLERANCE * largest * sizes)
    if len(flat):
        raise MeshError(
            f"{named(flat[0])} has no area (area {shapes.areas[flat[0]]:.3g}, diameter {sizes[flat[0]]:.3g}): its "
            "vertices lie on one line, or its outline crosses itself. Remove it or correct its vertices."
        )
    places = polyhedra.in_planes(points[vertices], face, shapes)
    height = np.abs(places[:, 2])
    bent = np.flatnonzero(height > (SINGLE * sizes + TOLERANCE * largest)[face])
    if len(bent):
        worst = bent[np.argmax(height[bent] / sizes[face[bent]])]
        raise MeshError(
            f"{named(face[worst])} is not plane: node {vertices[worst]} lies {height[worst]:.3g} off its plane, "
            f"and {SINGLE:g} of its diameter {sizes[face[worst]]:.3g} is allowed. Split the face into triangles, "
            "the same ones in both cells that have it, or move the node."
        )
    several = np.flatnonzero(np.diff(offsets) > 3)
    if len(several):
        rows, corners = rows_in_order(offsets, np.arange(len(vertices)), several)
        flat = polygons.outlines(places[:, :2], rows, corners)
        plane.check_simple(places[:, :2], rows, corners, flat, named=lambda k: named(several[k]), nodes=vertices)
    return shapes


def check_volumes(points: Floats, faces: Faces, volumes: Floats, shapes: FaceShapes) -> None:
    """MeshError if a cell has no volume, or cells overlap or meet in parts of faces."""
    from scipy.spatial import ConvexHull, QhullError

    offsets, nodes = polyhedra.nodes_of_cells(faces, len(points))
    sizes = polygons.diameters(points, offsets, nodes)
    largest = np.maximum.reduceat(np.abs(points[nodes]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(volumes <= TOLERANCE * largest * sizes**2)
    if len(flat):
        raise MeshError(
            f"cell {flat[0]} has no volume (volume {volumes[flat[0]]:.3g}, diameter {sizes[flat[0]]:.3g}). Remove it "
            "or correct its faces."
        )
    _check_outer_faces(points, faces, shapes, SINGLE * float((volumes / sizes**2).min()))
    try:
        hull = float(ConvexHull(points[np.unique(nodes)]).volume)
    except QhullError:  # as flat as rounding
        hull = np.inf
    if volumes.sum() > (1.0 + SINGLE) * hull:
        raise MeshError(
            f"cells overlap: their volumes add up to {volumes.sum():.6g}, and the convex hull of all has {hull:.6g}. "
            "Remove or correct some of them."
        )


class Upon(NamedTuple):
    """Two outer faces that lie on one another, or hardly apart."""

    faces: tuple[int, int]
    """where they stand among the outer faces"""
    distance: float
    slack: float
    """the least distance that is none"""


def faces_upon(
    points: Floats, offsets: Ints, vertices: Ints, shapes: FaceShapes, width: float, body: Ints | None = None
) -> Upon | None:
    """The first two outer faces, of different bodies if these (f,) are given, that lie within a width of each other."""
    import shapely

    corners = points[vertices]
    low, high = (f.reduceat(corners, offsets[:-1], axis=0) for f in (np.minimum, np.maximum))
    slack = width + TOLERANCE * np.abs(corners).max()
    one, other = polygons.overlapping_boxes(low - slack, high + slack, low, high)
    tilt = np.linalg.norm(np.cross(shapes.normals[one], shapes.normals[other]), axis=1)
    apart = np.abs(np.einsum("ij,ij->i", shapes.normals[one], shapes.centroids[other] - shapes.centroids[one]))
    near = (one < other) & (apart + tilt * np.sqrt(shapes.areas[other]) <= slack)
    if body is not None:
        near &= body[one] != body[other]
    one, other, apart = one[near], other[near], apart[near]
    if not len(one):
        return None

    def in_plane(listed: Ints) -> NDArray[Any]:
        rows, nodes = rows_in_order(offsets, vertices, listed)
        return polygons.outlines(
            polyhedra.in_planes(points[nodes], one[cell_of_corner(rows)], shapes)[:, :2], rows, np.arange(len(nodes))
        )

    common = shapely.area(shapely.intersection(in_plane(one), in_plane(other)))
    over = np.flatnonzero(common > SINGLE * np.minimum(shapes.areas[one], shapes.areas[other]))
    return Upon((int(one[over[0]]), int(other[over[0]])), float(apart[over[0]]), slack) if len(over) else None


def _check_outer_faces(points: Floats, faces: Faces, shapes: FaceShapes, width: float) -> None:
    """MeshError where two faces of the boundary lie on one another, or hardly apart."""
    outer = np.flatnonzero(faces.face_cells[:, 1] < 0)
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, outer)
    upon = faces_upon(points, offsets, vertices, FaceShapes(*(values[outer] for values in shapes)), width)
    if upon:
        first, second = (
            f"the face {_row(offsets, vertices, face)} of cell {faces.face_cells[outer[face], 0]}"
            for face in upon.faces
        )
        how = f"{upon.distance:.3g} beside" if upon.distance > 1e-3 * upon.slack else "on"
        raise MeshError(
            f"{first} and {second} lie {how} one another. Two cells must meet in whole faces of both: cut the "
            "larger face into the faces of its neighbours, and make a node on an edge a vertex of every face that has "
            "the edge; if the cells overlap, correct the vertices."
        )


# Rays go along the third axis of a frame that is turned against whatever a mesh is aligned with.
RAYS = np.linalg.qr(np.array([[0.61, -0.32, 0.71], [0.23, 0.94, 0.11], [-0.77, 0.05, 0.58]]))[0]


def enclosed(places: Floats, points: Floats, offsets: Ints, vertices: Ints) -> Bools:
    """A mask of the places (m, 3) inside a closed surface of faces that run outwards: rays from there leave it."""
    if not len(places):
        return np.zeros(0, dtype=bool)
    places, points = places @ RAYS, points @ RAYS
    first, after = np.repeat(vertices[offsets[:-1]], np.diff(offsets)), polygons.next_corner(offsets)
    corners = points[np.stack([first, vertices, vertices[after]], axis=1)]
    corners = corners[(first != vertices) & (first != vertices[after])]
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    i, k = polygons.overlapping_boxes(places[:, :2], places[:, :2], low, high)
    arms = corners[k] - places[i, None]
    turns = np.stack([polygons.cross(arms[:, a, :2], arms[:, b, :2]) for a, b in ((1, 2), (2, 0), (0, 1))], axis=1)
    sign = np.where((turns > 0.0).all(axis=1), 1.0, np.where((turns < 0.0).all(axis=1), -1.0, 0.0))
    above = np.einsum("ka,ka->k", turns, arms[:, :, 2]) * sign > 0.0
    return np.bincount(i[above], sign[above], len(places)) > 0.5
