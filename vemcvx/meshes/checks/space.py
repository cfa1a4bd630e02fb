"""Checks of the points and cells of meshes in space.

Every edge of a cell must belong to exactly two faces of the cell, and must have opposite directions in both faces. If
directions are wrong, faces with normals towards the middle of the cell are reversed. Neighbouring cells must share
whole faces, so boundary faces must not overlap. Cells overlap if the total volume of cells exceeds the volume of the
convex hull.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SINGLE_EPS, Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes import polygons, polyhedra
from vemcvx.meshes.checks import plane
from vemcvx.meshes.checks.plane import brief_row
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons import TOLERANCE, cell_of_corner, corner_edges, offsets_of, reverse_rows, rows_in_order
from vemcvx.meshes.polyhedra import FaceLists, Faces, FaceShapes


def check_polyhedral_mesh(
    points: ArrayLike, cells: Any, interfaces: Mapping[str, Interface] | None
) -> plane.CheckedMesh:
    """Return the checked points and faces of a `PolyhedralMesh`."""
    points = plane.check_points(points, 3)
    listed = cells if isinstance(cells, FaceLists) else _list_faces(cells)
    _check_lists(listed, len(points))
    interfaces = check_interfaces(interfaces, len(points), 3)
    place = places_of(pairs_of(interfaces), points)
    joined = listed._replace(vertices=place[listed.vertices])
    plane.check_coincident(points, joined.vertices)
    turn = _check_cells(points, joined)
    notes = []
    if turn.any():
        mended = np.unique(cell_of_corner(listed.cell_offsets)[turn])
        notes.append(
            f"{len(mended)} of {len(listed.cell_offsets) - 1} cells had faces with clockwise vertices, "
            f"seen from outside (the first is cell {mended[0]}); these faces have been reversed."
        )
    outwards = reverse_rows(listed.offsets, listed.vertices, turn)
    faces = polyhedra.join_faces(listed.offsets, outwards, listed.cell_offsets)
    points, vertices, node_map, more = plane.drop_unused(points, faces.face_vertices)
    return plane.CheckedMesh((points, *faces._replace(face_vertices=vertices)), interfaces, node_map, notes + more)


def _list_faces(cells: Any) -> FaceLists:
    wanted = "cells must be a sequence of cells, each a sequence of faces, each a sequence of node numbers"
    rows = [plane.list_of(cell, wanted) for cell in plane.list_of(cells, wanted)]
    cell_offsets = offsets_of(np.array(list(map(len, rows)), dtype=np.int64))
    faces = list(chain.from_iterable(rows))
    return FaceLists(*plane.lay_flat(faces, lambda face: _face(face, cell_offsets)), cell_offsets)


def _check_lists(listed: FaceLists, n_nodes: int) -> None:
    counts = np.diff(listed.cell_offsets)
    if not len(counts):
        raise MeshError("a mesh needs at least one cell; got none.")
    if counts.min() < 4:
        raise MeshError(f"cell {np.argmax(counts < 4)} has {counts[counts < 4][0]} faces; a polyhedron has at least 4.")
    plane.check_polygons(listed.offsets, listed.vertices, n_nodes, lambda face: _face(face, listed.cell_offsets))


def _face(number: int, cell_offsets: Ints) -> str:
    cell = int(np.searchsorted(cell_offsets, number, side="right")) - 1
    return f"cell {cell}: its face {number - cell_offsets[cell]}"


def _check_cells(points: Floats, listed: FaceLists) -> Bools:
    """Return a mask of listed faces with inward normals."""
    owner = cell_of_corner(listed.cell_offsets)
    first, number = polygons.same_rows(listed.offsets, listed.vertices)
    shapes = polyhedra.face_shapes(points, listed.offsets, listed.vertices)
    _check_faces(points, listed, first, shapes)
    turn = _faces_to_turn(listed, shapes, len(points))
    signs = np.where(turn, -1.0, 1.0)
    volumes = polyhedra.volumes_and_centroids(shapes, listed.cell_offsets, np.arange(len(owner)), signs)[0]
    turn ^= (volumes < 0.0)[owner]
    normals = np.where(turn[:, None], -shapes.normals, shapes.normals)
    again = first[number] != np.arange(len(owner))
    same_side = np.einsum("ij,ij->i", normals, normals[first[number]]) > 0.0
    bad = np.flatnonzero(again & (same_side | (np.bincount(number)[number] > 2)))
    if len(bad):
        cells = ", ".join(map(str, owner[number == number[bad[0]]]))
        row = brief_row(listed.offsets, listed.vertices, bad[0])
        raise MeshError(
            f"cells {cells} overlap at their face {row}: a face belongs to at most two cells, one on each side. "
            "Correct or remove other cells."
        )
    outer = FaceShapes(shapes.areas[first], normals[first], shapes.centroids[first])
    _check_volumes(points, polyhedra.join_faces(*listed), np.abs(volumes), outer)
    return turn


def _faces_to_turn(listed: FaceLists, shapes: FaceShapes, n_nodes: int) -> Bools:
    offsets, vertices, cell_offsets = listed
    owner, face = cell_of_corner(cell_offsets), cell_of_corner(offsets)
    ends = corner_edges(offsets, vertices)
    edges, number = np.unique(polygons.edge_keys(ends, n_nodes), return_inverse=True)
    keys = owner[face] * len(edges) + number
    order = np.argsort(keys, kind="stable")
    edge, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
    if (counts != 2).any():
        k = np.argmax(counts != 2)
        corner = order[starts[k]]
        pair = tuple(np.sort(ends[corner]).tolist())
        raise MeshError(
            f"cell {owner[face[corner]]} is not closed, or touches itself: its edge {pair} belongs to {counts[k]} of "
            "its faces instead of two. List each face once; insert hanging nodes of neighbours into edges; split a "
            "cell that touches itself."
        )
    nodes = np.bincount(np.unique(owner[face] * n_nodes + vertices) // n_nodes)
    euler = nodes - np.bincount(edge // len(edges)) + np.diff(cell_offsets)
    one, other = order.reshape(-1, 2).T
    alike = ends[one, 0] == ends[other, 0]
    mixed = np.zeros(len(cell_offsets) - 1, dtype=bool)
    mixed[owner[face[one[alike]]]] = True
    middles = np.add.reduceat(shapes.centroids, cell_offsets[:-1]) / np.diff(cell_offsets)[:, None]
    turn = mixed[owner] & (np.einsum("ij,ij->i", shapes.normals, shapes.centroids - middles[owner]) < 0.0)
    wrong = euler != 2
    wrong[owner[face[one[alike ^ turn[face[one]] ^ turn[face[other]]]]]] = True
    if wrong.any():
        raise MeshError(
            f"the faces of cell {np.argmax(wrong)} do not form one closed surface without holes, with all faces "
            "counter-clockwise seen from outside. Correct its faces, or split the cell."
        )
    return turn


def _check_faces(points: Floats, listed: FaceLists, some: Ints, shapes: FaceShapes) -> None:
    """Raise MeshError if a face is not a plane simple polygon."""
    offsets, vertices = rows_in_order(listed.offsets, listed.vertices, some)
    shapes, face = FaceShapes(*(values[some] for values in shapes)), cell_of_corner(offsets)
    sizes, rounding = polygons.diameters(points, offsets, vertices), plane.roundings(points[vertices], offsets)

    def name(number: int) -> str:
        return f"{_face(some[number], listed.cell_offsets)} {brief_row(listed.offsets, listed.vertices, some[number])}"

    plane.check_areas(shapes.areas, sizes, rounding, name)
    places = polyhedra.in_planes(points[vertices], face, shapes)
    height = np.abs(places[:, 2])
    bent = np.flatnonzero(height > (SINGLE_EPS * sizes + rounding)[face])
    if len(bent):
        worst = bent[np.argmax(height[bent] / sizes[face[bent]])]
        raise MeshError(
            f"{name(face[worst])} is not plane: node {vertices[worst]} lies {height[worst]:.3g} off its plane. At "
            f"most {SINGLE_EPS:g} times its diameter {sizes[face[worst]]:.3g} is allowed. Split the face into "
            "triangles, the same in both cells, or move the node."
        )
    plane.check_simple(places[:, :2], offsets, rounding, name)


def _check_volumes(points: Floats, faces: Faces, volumes: Floats, shapes: FaceShapes) -> None:
    """Raise MeshError for flat or overlapping cells, and for partly shared faces."""
    from scipy.spatial import ConvexHull, QhullError

    offsets, nodes = polyhedra.nodes_of_cells(faces, len(points))
    sizes = polygons.diameters(points, offsets, nodes)
    flat = np.flatnonzero(volumes <= plane.roundings(points[nodes], offsets) * sizes**2)
    if len(flat):
        raise MeshError(
            f"cell {flat[0]} has no volume (volume {volumes[flat[0]]:.3g}, diameter {sizes[flat[0]]:.3g}). Remove it "
            "or correct its faces."
        )
    outer = np.flatnonzero(faces.face_cells[:, 1] < 0)
    rows = rows_in_order(faces.face_offsets, faces.face_vertices, outer)
    width = SINGLE_EPS * float((volumes / sizes**2).min())
    upon = find_touching_faces(points, *rows, FaceShapes(*(values[outer] for values in shapes)), width)
    if upon.size:
        first, second = (
            f"the face {brief_row(faces.face_offsets, faces.face_vertices, face)} of cell {faces.face_cells[face, 0]}"
            for face in outer[upon[:, 0]]
        )
        raise MeshError(
            f"{first} and {second} lie on one another. Two cells must meet in whole "
            "faces of both: split the larger face into the faces of its neighbours. A node on an edge belongs to "
            "every face with this edge. If the cells overlap, correct the vertices."
        )
    try:
        hull = float(ConvexHull(points[np.unique(nodes)]).volume)
    except QhullError:  # the points lie in a plane up to rounding
        hull = np.inf
    if volumes.sum() > (1.0 + SINGLE_EPS) * hull:
        raise MeshError(
            f"cells overlap: their volumes add up to {volumes.sum():.6g}, but the convex hull of all cells has only "
            f"{hull:.6g}. Remove or correct some of them."
        )


def find_touching_faces(
    points: Floats,
    offsets: Ints,
    vertices: Ints,
    shapes: FaceShapes,
    width: float,
    *,
    body: Ints | None = None,  # body of each face; only pairs from different bodies are returned
    part: float = SINGLE_EPS,  # smallest common area, relative to the smaller face
) -> Ints:
    """Return pairs (2, k) of faces that overlap within the distance `width`."""
    import shapely

    corners = points[vertices]
    low, high = (f.reduceat(corners, offsets[:-1], axis=0) for f in (np.minimum, np.maximum))
    slack = width + TOLERANCE * np.abs(corners).max(initial=0.0)
    one, other = polygons.overlapping_boxes(low - slack, high + slack, low, high)
    pairs = one < other if body is None else (one < other) & (body[one] != body[other])
    one, other = one[pairs], other[pairs]
    tilt = np.linalg.norm(np.cross(shapes.normals[one], shapes.normals[other]), axis=1)
    apart = np.abs(np.einsum("ij,ij->i", shapes.normals[one], shapes.centroids[other] - shapes.centroids[one]))
    near = apart + tilt * np.sqrt(shapes.areas[other]) <= slack
    one, other = one[near], other[near]

    def in_plane(listed: Ints) -> NDArray[Any]:
        rows, nodes = rows_in_order(offsets, vertices, listed)
        places = polyhedra.in_planes(points[nodes], one[cell_of_corner(rows)], shapes)
        return polygons.outlines(places[:, :2], rows, np.arange(len(nodes)))

    common = shapely.area(shapely.intersection(in_plane(one), in_plane(other)))
    over = common > part * np.minimum(shapes.areas[one], shapes.areas[other])
    return np.stack([one[over], other[over]])


RAY_FRAME = np.linalg.qr(np.array([[0.61, -0.32, 0.71], [0.23, 0.94, 0.11], [-0.77, 0.05, 0.58]]))[0]
"""Orthonormal axes, not aligned with usual meshes."""


def is_enclosed(places: Floats, points: Floats, offsets: Ints, vertices: Ints) -> Bools:
    """Return a mask of the places (m, 3) inside a closed surface."""
    places, points = places @ RAY_FRAME, points @ RAY_FRAME
    first, after = np.repeat(vertices[offsets[:-1]], np.diff(offsets)), polygons.next_corner(offsets)
    corners = points[np.stack([first, vertices, vertices[after]], axis=1)]
    corners = corners[(first != vertices) & (first != vertices[after])]
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    i, k = polygons.overlapping_boxes(places[:, :2], places[:, :2], low, high)
    arms = corners[k] - places[i, None]
    turns = np.stack([polygons.cross(arms[:, a, :2], arms[:, b, :2]) for a, b in ((1, 2), (2, 0), (0, 1))], axis=1)
    sign = (turns > 0.0).all(axis=1).astype(float) - (turns < 0.0).all(axis=1)
    above = np.einsum("ka,ka->k", turns, arms[:, :, 2]) * sign > 0.0
    return np.bincount(i[above], sign[above], len(places)) > 0.5
