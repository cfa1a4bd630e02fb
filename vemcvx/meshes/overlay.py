"""One tiling for bodies in space where their boundaries coincide: the overlay of their tilings in each common plane.

Nodes of several bodies near each other are in one *place*, and rows of nodes become rows of places. Outer faces of two
bodies that lie on one another link to *patches*, each in one plane. There GEOS unites the outlines of all faces and
finds the polygons between them; a face is replaced by those inside. Polyhedra take the pieces as coplanar faces.
Finally every place on an edge becomes a vertex of all faces that have the edge. So two bodies have the same pieces
where they touch, which are found by their places; no areas are compared.

Places within the tolerance of an edge are on it, and nodes of two bodies within `CORNER` times the tolerance are in one
place: so a node near two edges of a corner of 30 degrees or more is at the corner.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.checks.space import find_upon
from vemcvx.meshes.polygons import (
    cell_of_corner,
    close_pairs,
    diameters,
    directed_edges,
    distinct,
    edge_keys,
    found_in,
    next_corner,
    offsets_of,
    outlines,
    overlapping_boxes,
    rows_in_order,
    same_rows,
    smallest_linked,
    spans,
    turned,
    with_hanging,
)
from vemcvx.meshes.polyhedra import Faces, FaceShapes, axes_in_planes, face_shapes

CORNER = 4.0
"""1 / sin(15 degrees), rounded up"""
COVERED = 1e-3
"""Part of a face that its pieces may miss: slivers along edges as wide as the tolerance, or bodies are not matched"""
Rows = tuple[Ints, Ints]
"""Offsets and entries of rows"""


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


def overlay_tilings(points: Floats, faces: Faces, body: Ints, place: Ints, tolerance: float) -> Tiled:
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
    of_face, points = body[faces.face_vertices[faces.face_offsets[:-1]]], points[place]
    faces = faces._replace(face_vertices=place[faces.face_vertices])
    outer = np.flatnonzero(faces.face_cells[:, 1] < 0)
    outline = rows_in_order(faces.face_offsets, faces.face_vertices, outer)
    shapes = face_shapes(points, *outline)
    upon = find_upon(points, *outline, shapes, tolerance, body=of_face[outer], part=0.0)
    number = same_rows(*outline)[1]
    links = np.column_stack([upon.one, upon.other])[number[upon.one] != number[upon.other]]
    points, face, pieces = _cut(points, outline, shapes, links, tolerance)
    faces, origin = _replace_faces(faces, outer[face], pieces)
    sides = np.append(outline[0], outline[0][-1] + pieces[0][1:]), np.append(outline[1], pieces[1])
    offsets, vertices = _hang((faces.face_offsets, faces.face_vertices), sides, points, tolerance)
    faces = faces._replace(face_offsets=offsets, face_vertices=vertices)
    return Tiled(*_number(faces, of_face[origin], points, body, place), origin)


def _hang(rows: Rows, sides: Rows, points: Floats, tolerance: float) -> Rows:
    """Return rows of places with the vertices of `sides` that lie on edges of `sides` as vertices there."""
    edges = directed_edges(*sides)
    ends = edges[np.unique(edge_keys(edges, len(points)), return_index=True)[1]]
    known = distinct(sides[1])
    at, (start, end) = points[known], points[ends].swapaxes(0, 1)
    i, k = overlapping_boxes(at, at, np.minimum(start, end) - tolerance, np.maximum(start, end) + tolerance)
    arm, apart = (end - start)[k], at[i] - start[k]
    along = np.einsum("ki,ki->k", apart, arm) / np.einsum("ki,ki->k", arm, arm)
    near = np.linalg.norm(apart - along[:, None] * arm, axis=1) <= tolerance
    near &= (known[i, None] != ends[k]).all(axis=1) & (np.abs(along - 0.5) < 0.5)
    i, k, along = i[near], k[near], along[near]
    order = np.lexsort((along, k))
    return with_hanging(rows, ends, offsets_of(np.bincount(k, minlength=len(ends))), known[i[order]])


def _cut(points: Floats, outline: Rows, shapes: FaceShapes, links: Ints, tolerance: float) -> tuple[Floats, Ints, Rows]:
    """Return points with those of new places, outer faces (k,) that are cut, ascending, and their pieces (k rows)."""
    linked = distinct(links.ravel())
    if not len(linked):
        return points, linked, (np.zeros(1, dtype=np.int64), linked)
    patch = smallest_linked(links, len(shapes.areas))[linked]
    linked = linked[np.argsort(patch, kind="stable")]
    rows = _hang(rows_in_order(*outline, linked), rows_in_order(*outline, linked), points, tolerance)
    all_axes = axes_in_planes(shapes)
    begin = np.append(np.flatnonzero(np.diff(np.sort(patch), prepend=-1)), len(linked))
    found = []
    for first, last in pairwise(begin):
        own, nodes = rows_in_order(*rows, np.arange(first, last))
        centre, axes = shapes.centroids[linked[first]], all_axes[linked[first], :2]
        face, ring, corners = _cut_in_plane(own, (points[nodes] - centre) @ axes.T)
        found.append((linked[first + face], np.diff(ring), centre + corners @ axes))
    face, counts, corners = (np.concatenate(parts) for parts in zip(*found, strict=True))
    points, places = _places(points, distinct(rows[1]), corners, tolerance)
    kept, pieces = _without_slivers(points, (offsets_of(counts), places), tolerance)
    face, piece = face[kept], face_shapes(points, *pieces)
    covered = np.bincount(face, piece.areas, len(shapes.areas))[linked] / shapes.areas[linked]
    if np.abs(covered - 1.0).max() > COVERED:
        raise unmatched(shapes.centroids[linked[np.argmax(np.abs(covered - 1.0))]])
    inwards = np.einsum("ki,ki->k", piece.normals, shapes.normals[face]) < 0.0
    order = np.argsort(face, kind="stable")
    return points, face[order], rows_in_order(pieces[0], turned(*pieces, inwards), order)


def _cut_in_plane(rows: Ints, places: Floats) -> tuple[Ints, Ints, Floats]:
    """Return pieces of faces (rows of places): the face of each, offsets, corners; with holes they are triangles."""
    import shapely

    faces = outlines(places, rows, np.arange(len(places)))
    lines = shapely.union_all(shapely.boundary(faces))
    parts = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    holed = shapely.get_num_interior_rings(parts) > 0
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(parts[holed]))
    parts = np.append(parts[~holed], triangles)
    part, face = shapely.STRtree(faces).query(shapely.point_on_surface(parts), predicate="within")
    corners, ring = shapely.get_coordinates(parts[part], return_index=True)
    kept = np.diff(ring, append=-1) == 0  # without the last corner, which is the first again
    return face, offsets_of(np.bincount(ring[kept], minlength=len(part))), corners[kept]


def _places(points: Floats, known: Ints, corners: Floats, distance: float) -> tuple[Floats, Ints]:
    """Return points with those of new places, and the place of each corner (m, 3): a known one nearby, or a new one."""
    leader = smallest_linked(close_pairs(np.concatenate([points[known], corners]), distance), len(known) + len(corners))
    fresh = distinct(leader[leader >= len(known)])
    place = np.concatenate([known, np.full(len(corners), -1)])
    place[fresh] = len(points) + np.arange(len(fresh))
    return np.concatenate([points, corners[fresh - len(known)]]), place[leader[len(known) :]]


def _without_slivers(points: Floats, rows: Rows, tolerance: float) -> tuple[Ints, Rows]:
    """Return numbers of the pieces that are wider than the tolerance, and their rows without repeated places.

    A triangle is left out if its apex is on its longest side.
    """
    areas = face_shapes(points, *rows).areas
    kept = np.flatnonzero(2.0 * areas > tolerance * diameters(points, *rows))
    offsets, places = rows_in_order(*rows, kept)
    single = places != places[next_corner(offsets)]
    return kept, (offsets_of(np.add.reduceat(single, offsets[:-1], dtype=np.int64)), places[single])


def _replace_faces(faces: Faces, some: Ints, pieces: Rows) -> tuple[Faces, Ints]:
    """Return the faces with `some` (k,), ascending, replaced by their pieces, and the face that each was or is of."""
    many, (face, count) = np.ones(len(faces.face_offsets) - 1, dtype=np.int64), np.unique(some, return_counts=True)
    many[face] = count
    origin = np.repeat(np.arange(len(many)), many)
    row = origin.copy()
    row[np.isin(origin, face)] = len(many) + np.arange(len(some))
    every = np.concatenate([faces.face_offsets, faces.face_offsets[-1] + pieces[0][1:]])
    rows = rows_in_order(every, np.concatenate([faces.face_vertices, pieces[1]]), row)
    each = many[faces.cell_faces]
    cell_offsets = offsets_of(np.add.reduceat(each, faces.cell_offsets[:-1]))
    cell_faces = spans(offsets_of(many)[faces.cell_faces], each)
    return Faces(*rows, cell_offsets, cell_faces, faces.face_cells[origin]), origin


def _number(faces: Faces, of_face: Ints, points: Floats, body: Ints, place: Ints) -> tuple[Floats, Faces, Ints, Ints]:
    """Give each body a node of its own in every place of its faces, rows of places; new nodes come last."""
    corner = cell_of_corner(faces.face_offsets)
    keys = np.sort(corner * len(points) + faces.face_vertices)
    twice = keys[1:][np.diff(keys) == 0]
    if len(twice):
        raise unmatched(points[twice[0] % len(points)])
    count = int(body[-1]) + 1
    known, wanted = place * count + body, faces.face_vertices * count + of_face[corner]
    known = np.concatenate([known, np.setdiff1d(wanted, known)])
    place, body = np.divmod(known, count)
    _, leader, number = np.unique(place, return_index=True, return_inverse=True)
    return points[place], faces._replace(face_vertices=found_in(known, wanted)), body, leader[number]


def unmatched(at: Floats) -> MeshError:
    """Return the error that refuses tilings which do not match near a point (3,)."""
    return MeshError(
        f"bodies: the surfaces of two bodies do not match near {coordinates(at, 6)}: they are no pieces of the "
        "same planes, or have edges and nodes hardly farther apart than the tolerance. Mesh both bodies alike "
        "there, or give another tolerance=."
    )
