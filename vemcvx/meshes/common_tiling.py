"""One tiling for bodies in space where their boundaries coincide: the intersection of the tilings that they bring.

A place on an edge becomes a vertex of all faces of the body that have the edge, as in the plane. A place inside a face
cuts it together with the lines of other bodies that run over it (:mod:`.meeting`). So a face becomes the polygons
between its outline and these lines, and where two bodies touch, both have the same: these are found by their places,
and no areas are compared. Polyhedra take the pieces as coplanar faces.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.base.arrays import SAME, SINGLE, SOME, Bools, Floats, Ints
from vemcvx.meshes.interfaces import padded
from vemcvx.meshes.meeting import Meeting, Surface, lines_between, meeting_of, unmatched
from vemcvx.meshes.polygons import (
    all_found_in,
    among,
    areas_and_centroids,
    cell_of_corner,
    cross,
    distinct,
    found_in,
    next_corner,
    numbered_outlines,
    offsets_of,
    rows_in_order,
    same_rows,
    smallest_linked,
    spans,
    triangles_of,
    turned,
    with_hanging,
)
from vemcvx.meshes.polyhedra import Faces, FaceShapes, face_shapes, heights, in_planes


class Tiled(NamedTuple):
    """Bodies whose faces have been cut."""

    points: Floats
    faces: Faces
    body: Ints
    """(n_nodes,) the body of each node"""
    place: Ints
    """(n_nodes,) the place of each node: the first of those there"""
    origin: Ints
    """(n_faces,) the face of before that each is a part of"""
    touching: Ints
    """(k, 2) nodes and bodies that touch there without a node"""


def common_tiling(points: Floats, faces: Faces, body: Ints, place: Ints, tolerance: float) -> Tiled:
    """Cut the faces of bodies that lie side by side in one list, where boundaries coincide.

    Parameters
    ----------
    points : (n_nodes, 3) array
    faces : Faces
        The faces of all bodies, which share no node.
    body, place : (n_nodes,) arrays
        The body of each node, and the first of the nodes in its place.
    tolerance : float
        Boundaries coincide where they are no farther apart.

    Raises
    ------
    MeshError
        The edges of two tilings do not make polygons that cover a face; it says where.
    """
    meeting = meeting_of(points, Surface.of(points, faces, body, place, tolerance))
    outline = _with_hanging(faces, meeting)
    return _assembled(faces, meeting, outline, _pieces(meeting, outline))


# Faces with new vertices, and cut.


class _Outlines(NamedTuple):
    """All faces of all bodies with the places on their edges as vertices."""

    offsets: Ints
    vertices: Ints
    place: Ints
    """(n_nodes + h,) the place of each node, new ones last"""
    body: Ints


def _with_hanging(faces: Faces, meeting: Meeting) -> _Outlines:
    """Faces with a new node in every place on an edge."""
    surface, on_edges = meeting.surface, meeting.on_edges
    order = np.lexsort((on_edges.along, on_edges.edge))
    edge, many = np.unique(on_edges.edge[order], return_counts=True)
    old, new = (faces.face_offsets, faces.face_vertices), len(surface.place) + np.arange(len(order))
    return _Outlines(
        *with_hanging(old, surface.ends[edge], offsets_of(many), new),
        np.concatenate([surface.place, on_edges.place[order]]),
        np.concatenate([surface.body, surface.body_of_edge[on_edges.edge[order]]]),
    )


class _Pieces(NamedTuple):
    """The polygons that faces are cut into, outwards."""

    face: Ints
    """(k,) the faces, of those of the surface, ascending"""
    offsets: Ints
    places: Ints
    """places of the vertices"""
    flat: Bools
    """(k,) whether they are in the planes of the faces for certain"""


def _pieces(meeting: Meeting, outline: _Outlines) -> _Pieces:
    """Cut the faces of the surface over which lines of other bodies run."""
    surface = meeting.surface
    offsets, vertices = rows_in_order(outline.offsets, outline.vertices, surface.faces)
    places = outline.place[vertices]
    over, lines = _lines_over_faces(meeting, offsets, places)
    cut = distinct(over)
    rows, around = rows_in_order(offsets, places, cut)
    face, sizes, place, flat = [cut[:0]], [cut[:0]], [cut[:0]], [cut[:0] > 0]
    for first in range(0, len(cut), SOME):
        some = cut[first : first + SOME]
        begin, end = np.searchsorted(over, [some[0], some[-1] + 1])
        row = rows[first : first + SOME + 1]
        crossed = np.searchsorted(some, over[begin:end]), lines[begin:end]
        of, ring, places, plane = _cut(surface, some, (row - row[0], around[row[0] : row[-1]]), crossed)
        face.append(some[of])
        sizes.append(np.diff(ring))
        place.append(places)
        flat.append(plane)
    return _Pieces(np.concatenate(face), offsets_of(np.concatenate(sizes)), np.concatenate(place), np.concatenate(flat))


def _cut(
    surface: Surface, faces: Ints, outline: tuple[Ints, Ints], lines: tuple[Ints, Ints]
) -> tuple[Ints, Ints, Ints, Bools]:
    """The polygons between the outlines of faces, rows of places, and lines, each over one of these faces."""
    rows, around = outline
    owner, follow = cell_of_corner(rows), next_corner(rows)
    sides = surface.seen(surface.points[around], faces[owner])
    over = surface.seen(surface.points[lines[1].ravel()], np.repeat(faces[lines[0]], 2))
    segments = np.concatenate([np.column_stack([around, around[follow]]), lines[1]])
    at = np.concatenate([np.stack([sides, sides[follow]], axis=1), over.reshape(-1, 2, 3)])
    found, ring, corner = polygons_between(np.concatenate([owner, lines[0]]), segments, at[:, :, :2])
    corners, place = at.reshape(-1, 3)[corner], segments.ravel()[corner]
    areas = areas_and_centroids(corners[:, :2], ring, np.arange(len(corners)))[0]
    whole = areas_and_centroids(sides[:, :2], rows, np.arange(len(sides)))[0]
    # Pieces cover a face up to a thousandth: the tolerance is far below the edges, or bodies are not matched.
    missing = np.abs(np.bincount(found, np.abs(areas), len(faces)) - whole) > 1e-3 * whole
    if missing.any():
        raise unmatched(surface.shapes.centroids[faces[missing][0]])
    # A piece is no farther off its own plane than a few times as far as off that of the face.
    flat = np.maximum.reduceat(np.abs(corners[:, 2]), ring[:-1]) < 0.1 * SINGLE * np.sqrt(np.abs(areas))
    return found, ring, turned(ring, place, areas < 0.0), flat


def _lines_over_faces(meeting: Meeting, offsets: Ints, places: Ints) -> tuple[Ints, Ints]:
    """Faces of the surface, and the line (k, 2) of another body that runs over each."""
    surface = meeting.surface
    count, faces = len(surface.points), len(surface.faces)
    lines, owner = lines_between(surface, meeting.on_edges)
    in_face = np.concatenate([cell_of_corner(offsets), meeting.in_faces.face])
    incident = distinct(np.concatenate([places, meeting.in_faces.place]) * faces + in_face)
    place, in_face = np.divmod(incident, faces)
    number, at = all_found_in(place, lines[:, 0])
    face = in_face[at]
    other = surface.body_of_face[face] != surface.body_of_edge[owner[number]]
    number, face = number[other], face[other]
    runs = among(lines[number, 1] * faces + face, incident)
    face, ends = face[runs], lines[number[runs]]

    def key(face: Ints, ends: Ints) -> Ints:
        number: Ints = (face * count + ends[:, 0]) * count + ends[:, 1]
        return number

    sides = np.sort(np.column_stack([places, places[next_corner(offsets)]]), axis=1)
    keys, first = np.unique(key(face, ends), return_index=True)
    first = first[~among(keys, key(cell_of_corner(offsets), sides))]
    first = first[_inside(surface, face[first], ends[first])]
    return face[first], ends[first]


def _inside(surface: Surface, face: Ints, lines: Ints) -> Bools:
    """True for lines (k, 2) between places of a face that run inside: all, unless the face has a corner inwards."""
    import shapely

    every = cell_of_corner(surface.offsets)
    corners = surface.seen(surface.points[surface.place[surface.vertices]], every)[:, :2]
    arm = corners[next_corner(surface.offsets)] - corners
    # What rounding turns a corner inwards spans less than 1e-9 of the face's area.
    inwards = cross(arm, arm[next_corner(surface.offsets)]) < -SAME * surface.shapes.areas[every]
    hollow = np.logical_or.reduceat(inwards, surface.offsets[:-1])
    inside = np.ones(len(face), dtype=bool)
    asked = np.flatnonzero(hollow[face])
    middle = surface.seen(surface.points[lines[asked]].mean(axis=1), face[asked])
    inside[asked] = shapely.contains_xy(surface.charts[face[asked]], middle[:, 0], middle[:, 1])
    return inside


# All bodies again.


def _assembled(faces: Faces, meeting: Meeting, outline: _Outlines, cut: _Pieces) -> Tiled:
    """The faces of all bodies with those that were cut replaced by their pieces, which get nodes of their own."""
    surface, in_faces = meeting.surface, meeting.in_faces
    known = surface.key(outline.place, outline.body)
    wanted = surface.key(cut.places, surface.body_of_face[cut.face][cell_of_corner(cut.offsets)])
    fresh = distinct(wanted)
    known = np.concatenate([known, fresh[~among(fresh, known)]])
    nodes = found_in(known, wanted)
    place, body = np.divmod(known, len(surface.boxes[0]))
    hanging = faces._replace(face_offsets=outline.offsets, face_vertices=outline.vertices)
    cut_faces = surface.faces[cut.face]
    tiled, origin = _replaced(hanging, cut_faces, cut.offsets, nodes)
    points, leader = surface.points[place], np.unique(place, return_index=True)[1]
    number = np.full(len(surface.points), -1)
    number[place[leader]] = leader
    touched = np.ones(len(points), dtype=bool)
    touched[: len(meeting.before)] = (points[: len(meeting.before)] != meeting.before).any(axis=1)
    doubtful = np.logical_or.reduceat(touched[tiled.face_vertices], tiled.face_offsets[:-1])
    doubtful[among(origin, cut_faces)] = ~cut.flat
    tiled, part = _flattened(points, tiled, number[place], np.flatnonzero(doubtful))
    host = surface.body_of_face[in_faces.face]
    bare = ~among(surface.key(in_faces.place, host), known)
    touching = np.column_stack([number[in_faces.place], host])[bare]
    return Tiled(points, tiled, body=body, place=number[place], origin=origin[part], touching=touching)


def _replaced(faces: Faces, some: Ints, offsets: Ints, nodes: Ints) -> tuple[Faces, Ints]:
    """The faces with some replaced by rows of nodes, their pieces; and the face that each was or is a piece of.

    `some` (k,) are the faces, ascending, of which the rows are pieces.
    """
    many, (face, count) = np.ones(len(faces.face_offsets) - 1, dtype=np.int64), np.unique(some, return_counts=True)
    many[face] = count
    origin = np.repeat(np.arange(len(many)), many)
    row = origin.copy()
    row[among(origin, face)] = len(many) + np.arange(len(some))
    face_offsets, face_vertices = rows_in_order(
        np.concatenate([faces.face_offsets, faces.face_offsets[-1] + offsets[1:]]),
        np.concatenate([faces.face_vertices, nodes]),
        row,
    )
    each = many[faces.cell_faces]
    cell_offsets = offsets_of(np.add.reduceat(each, faces.cell_offsets[:-1]))
    cell_faces = spans(offsets_of(many)[faces.cell_faces], each)
    return Faces(face_offsets, face_vertices, cell_offsets, cell_faces, faces.face_cells[origin]), origin


def _flattened(points: Floats, faces: Faces, place: Ints, some: Ints) -> tuple[Faces, Ints]:
    """The faces with those of some cut into triangles that are not plane any more; and which face each was.

    Faces of two bodies in the same places get the same triangles.
    """
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, some)
    shapes, corner = face_shapes(points, offsets, vertices), cell_of_corner(offsets)
    height = np.abs(heights(points[vertices], corner, shapes))
    warped = np.flatnonzero(np.maximum.reduceat(height, offsets[:-1]) > SINGLE * np.sqrt(shapes.areas))
    if not len(warped):
        return faces, np.arange(len(faces.face_offsets) - 1)
    offsets, vertices = rows_in_order(offsets, vertices, warped)
    some, shapes = some[warped], FaceShapes(*(values[warped] for values in shapes))
    first, number = same_rows(offsets, place[vertices])
    corners = in_planes(points[vertices], cell_of_corner(offsets), shapes)[:, :2]
    owner, rows = triangles_of(numbered_outlines(corners, offsets)[first])
    # Each face has the triangles of the first in its places, the other way round if it is another one.
    order, begin = np.argsort(owner, kind="stable"), np.searchsorted(np.sort(owner), np.arange(len(first) + 1))
    counts = np.diff(begin)[number]
    triangles = vertices[rows[order[spans(begin[number], counts)]]]
    face = np.repeat(np.arange(len(number)), counts)
    triangles = np.where((face != first[number[face]])[:, None], triangles[:, ::-1], triangles)
    key = place[vertices] * len(offsets) + cell_of_corner(offsets)
    own = vertices[found_in(key, (place[triangles] * len(offsets) + face[:, None]).ravel())]
    return _replaced(faces, some[face], 3 * np.arange(len(face) + 1), own)


def coinciding_faces(outlines: tuple[Ints, Ints], body: Ints, place: Ints) -> tuple[Ints, Ints, Ints]:
    """Outer faces of two bodies in the same places.

    Numbers (k, 2) of these faces, that of the earlier body first; rows (k, n) of their nodes, in the order of the face
    of the earlier one: its own, and those of the later one there. `outlines` are the offsets and vertices of outer
    faces; rows are filled up with -1.
    """
    offsets, vertices = outlines
    shared = np.bincount(place)[place] > 1
    faces = np.flatnonzero(np.logical_and.reduceat(shared[vertices], offsets[:-1]))
    rows, nodes = rows_in_order(offsets, vertices, faces)
    first, number = same_rows(rows, place[nodes])
    order = np.argsort(number, kind="stable")
    begin = np.searchsorted(number[order], np.arange(len(first)))
    double = np.flatnonzero(np.bincount(number, minlength=len(first)) > 1)
    one, other = order[begin[double]], order[begin[double] + 1]
    mine = rows_in_order(rows, nodes, one)
    count = int(body.max()) + 1
    of_other = np.repeat(body[nodes[rows[:-1]]][other], np.diff(mine[0]))
    across = found_in(place * count + body, place[mine[1]] * count + of_other)
    return faces[np.column_stack([one, other])], padded(*mine), padded(mine[0], across)


# Polygons between segments that meet at their ends: the faces of plane graphs, many graphs at once.
#
# Every segment is walked in both directions, a polygon on the left of each. At its end the walk turns as far to the
# left as it can: the segments of a node are sorted by their angles, and what follows a walk a -> b is the one before
# b -> a, counter-clockwise. So walks close to rings (as in a doubly connected edge list; de Berg et al., *Computational
# Geometry*, 2.2): counter-clockwise those of the polygons, clockwise the one around each connected graph.
#
# Graphs in several pieces have polygons with holes, segments with the same polygon on both sides end nowhere or bridge,
# and rings may touch themselves. Shapely is asked for these.


def polygons_between(owner: Ints, ends: Ints, at: Floats) -> tuple[Ints, Ints, Ints]:
    """The polygons between segments of one owner, in order of these, in either direction.

    Parameters
    ----------
    owner : (s,) array
        The graph that each segment is of, all below some number.
    ends : (s, 2) array
        The nodes at its ends, called by any numbers.
    at : (s, 2, 2) array
        Where these are in the plane of the owner.

    Returns
    -------
    found, offsets, corners
        The owner (p,) of each polygon, and where in `ends`, row by row, its nodes stand. Polygons with holes are cut in
        triangles.
    """
    rings = _rings(owner, ends, at)
    awkward = _awkward(owner, ends, rings)
    kept = (rings.area > 0.0) & ~awkward[rings.of]
    offsets, corners = rows_in_order(rings.offsets, rings.walks, np.flatnonzero(kept))
    found = rings.of[kept]
    if not awkward.any():
        return found, offsets, corners
    some, graphs = np.flatnonzero(awkward[owner]), np.flatnonzero(awkward)
    segments = np.dstack([at[some], 2 * some[:, None] + [0, 1]])
    others, rows, more = _by_shapely(np.searchsorted(graphs, owner[some]), segments)
    found, sizes = np.concatenate([found, graphs[others]]), np.concatenate([np.diff(offsets), np.diff(rows)])
    order = np.argsort(found, kind="stable")
    return found[order], *rows_in_order(offsets_of(sizes), np.concatenate([corners, more]), order)


class _Rings(NamedTuple):
    """Walks that close: walk 2 k begins at the first end of segment k and goes along it, walk 2 k + 1 comes back."""

    offsets: Ints
    walks: Ints
    of: Ints
    """the owner of each ring"""
    area: Floats
    """twice the area, negative where it runs clockwise"""


def _rings(owner: Ints, ends: Ints, at: Floats) -> _Rings:
    """The rings of all walks, in order of their owners."""
    walks, of = np.arange(2 * len(owner)), np.repeat(owner, 2)
    here, there = at.reshape(-1, 2), at[:, ::-1].reshape(-1, 2)
    arm = there - here
    node = of * (int(ends.max(initial=0)) + 1) + ends.ravel()
    order = np.lexsort((np.arctan2(arm[:, 1], arm[:, 0]), node))
    first = np.flatnonzero(np.diff(node[order], prepend=-1))
    before = walks - 1
    before[first] = np.append(first[1:], len(order)) - 1
    rank = np.empty_like(order)
    rank[order] = walks
    follow = order[before[rank[walks ^ 1]]]
    # The smallest walk of each ring leads; all rings go on at once, and leave when they are back at it.
    head = distinct(smallest_linked(np.column_stack([walks, follow]), len(walks)))
    head = head[np.argsort(of[head], kind="stable")]
    ring, walk, found = np.arange(len(head)), head, list[tuple[Ints, Ints]]()
    while len(walk):
        found.append((ring, walk))
        walk = follow[walk]
        on = walk != head[ring]
        ring, walk = ring[on], walk[on]
    ring, walk = (np.concatenate(parts) for parts in zip(*found, strict=True))
    offsets, walk = offsets_of(np.bincount(ring)), walk[np.argsort(ring, kind="stable")]
    origin = np.repeat(here[walk[offsets[:-1]]], np.diff(offsets), axis=0)
    area = np.add.reduceat(cross(here[walk] - origin, there[walk] - origin), offsets[:-1])
    return _Rings(offsets, walk, of[head], area)


def _awkward(owner: Ints, ends: Ints, rings: _Rings) -> Bools:
    """Return True for each owner whose rings are not all outlines of polygons, or the one around them."""
    (offsets, walk, of, area), graphs = rings, int(owner.max(initial=-1)) + 1
    awkward: Bools = np.bincount(of, area <= 0.0, graphs) != np.bincount(owner, minlength=graphs).astype(bool)
    ring_of = np.empty_like(walk)
    ring_of[walk] = np.repeat(np.arange(len(of)), np.diff(offsets))
    awkward[owner[ring_of[::2] == ring_of[1::2]]] = True
    again = np.sort(ring_of * (int(ends.max(initial=0)) + 1) + ends.ravel())
    twice = again[1:][again[1:] == again[:-1]]
    awkward[of[twice // (int(ends.max(initial=0)) + 1)]] = True
    return awkward


def _by_shapely(owner: Ints, segments: Floats) -> tuple[Ints, Ints, Ints]:
    """The same polygons; segments (s, 2, 3) have as third coordinates where their ends stand."""
    import shapely

    order = np.argsort(owner, kind="stable")
    graphs = np.split(shapely.linestrings(segments[order]), np.cumsum(np.bincount(owner))[:-1])
    parts = [shapely.get_parts(shapely.polygonize(lines)) for lines in graphs]
    every, found = np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(some) for some in parts])
    holed = shapely.get_num_interior_rings(every) > 0
    corners, ring = shapely.get_coordinates(every[~holed], include_z=True, return_index=True)
    first = np.diff(ring, append=-1) == 0  # without the last corner, which is the first again
    names, sizes = corners[first, 2], np.bincount(ring[first])
    owner, triangles = triangles_of(every[holed])
    names, sizes = np.append(names, triangles), np.append(sizes, np.full(len(triangles), 3))
    within = np.append(found[~holed], found[holed][owner])
    ranked = np.argsort(within, kind="stable")
    return within[ranked], *rows_in_order(offsets_of(sizes), names.astype(np.int64), ranked)
