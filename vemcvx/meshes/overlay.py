"""Splitting of boundary faces in space, so that faces of touching bodies coincide.

Nearby nodes of several bodies get one position, a *place*. Overlapping boundary faces in one plane form a *patch*. The
outlines of the faces divide the patch into polygons, which replace the faces. Finally, every place on an edge becomes a
vertex of all faces with this edge.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.checks.space import find_touching_faces
from vemcvx.meshes.polygons import (
    cell_of_corner,
    close_pairs,
    corner_edges,
    diameters,
    edge_keys,
    find_in,
    insert_hanging,
    next_corner,
    offsets_of,
    outlines,
    overlapping_boxes,
    reverse_rows,
    rows_in_order,
    same_rows,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import FaceShapes, axes_in_planes, face_shapes, join_faces, list_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

CORNER_FACTOR = 4.0  # ratio of tolerances at corners and at edges, about 1 / sin(15 degrees)
COVERAGE_TOLERANCE = 1e-3  # largest relative change of the area of a split face
Rows = tuple[Ints, Ints]  # offsets and entries of rows


def overlay_tilings(
    apart: PolyhedralMesh, body: Ints, place: Ints, tolerance: float
) -> tuple[PolyhedralMesh, Ints, Ints, Ints]:
    """Split the boundary faces of touching bodies."""
    faces, points = apart.faces, apart.points[place]
    offsets, nodes, cell_offsets = list_faces(faces)
    of_face, rows = body[nodes[offsets[:-1]]], (offsets, place[nodes])
    outer = np.flatnonzero(faces.face_cells[faces.cell_faces, 1] < 0)
    outline = rows_in_order(*rows, outer)
    shapes = face_shapes(points, *outline)
    upon = find_touching_faces(points, *outline, shapes, tolerance, body=of_face[outer], part=0.0)
    number = same_rows(*outline)[1]
    points, face, pieces = _split_faces(points, outline, shapes, upon.T[number[upon[0]] != number[upon[1]]], tolerance)
    # Pieces replace split faces.
    kept = np.setdiff1d(np.arange(len(of_face)), outer[face])
    listed = np.append(kept, outer[face])
    order = np.argsort(listed, kind="stable")
    listed = listed[order]
    rows = rows_in_order(*_join(rows_in_order(*rows, kept), pieces), order)
    offsets, vertices = _hang(rows, _join(outline, pieces), points, tolerance)
    # Bodies get nodes at new places. New nodes come last.
    face, count = cell_of_corner(offsets), int(body[-1]) + 1
    keys = np.sort(face * len(points) + vertices)
    twice = keys[1:][np.diff(keys) == 0]
    if len(twice):
        raise mismatch_error(points[twice[0] % len(points)])
    known, wanted = place * count + body, vertices * count + of_face[listed[face]]
    known = np.append(known, np.setdiff1d(wanted, known))
    place, body = np.divmod(known, count)
    _, leader, number = np.unique(place, return_index=True, return_inverse=True)
    cells = offsets_of(np.bincount(cell_of_corner(cell_offsets)[listed]))
    faces, old = join_faces(offsets, find_in(known, wanted), cells), faces.cell_faces[listed]
    origin = np.empty(len(faces.face_cells), dtype=np.int64)
    origin[faces.cell_faces] = old
    mesh = PolyhedralMesh.unchecked(points[place], *faces)
    return mesh, body, leader[number], apart._places(origin[mesh._boundary])


def _join(one: Rows, other: Rows) -> Rows:
    return np.append(one[0], one[0][-1] + other[0][1:]), np.append(one[1], other[1])


def _hang(rows: Rows, sides: Rows, points: Floats, tolerance: float) -> Rows:
    """Insert hanging vertices into edges."""
    edges = corner_edges(*sides)
    ends = edges[np.unique(edge_keys(edges, len(points)), return_index=True)[1]]
    known = np.unique(sides[1])
    at, (start, end) = points[known], points[ends].swapaxes(0, 1)
    i, k = overlapping_boxes(at, at, np.minimum(start, end) - tolerance, np.maximum(start, end) + tolerance)
    arm, apart = (end - start)[k], at[i] - start[k]
    along = np.einsum("ki,ki->k", apart, arm) / np.einsum("ki,ki->k", arm, arm)
    near = np.linalg.norm(apart - along[:, None] * arm, axis=1) <= tolerance
    near &= (known[i, None] != ends[k]).all(axis=1) & (np.abs(along - 0.5) < 0.5)
    i, k, along = i[near], k[near], along[near]
    order = np.lexsort((along, k))
    return insert_hanging(rows, ends, offsets_of(np.bincount(k, minlength=len(ends))), known[i[order]])


def _split_faces(
    points: Floats, outline: Rows, shapes: FaceShapes, links: Ints, tolerance: float
) -> tuple[Floats, Ints, Rows]:
    """Return points, the face of each piece, and the pieces, ordered by face."""
    linked = np.unique(links.ravel())
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
        face, ring, corners = _split_in_plane(own, (points[nodes] - centre) @ axes.T)
        found.append((linked[first + face], np.diff(ring), centre + corners @ axes))
    face, counts, corners = (np.concatenate(parts) for parts in zip(*found, strict=True))
    points, places = _places(points, np.unique(rows[1]), corners, tolerance)
    kept, pieces = _without_slivers(points, (offsets_of(counts), places), tolerance)
    face, piece = face[kept], face_shapes(points, *pieces)
    covered = np.bincount(face, piece.areas, len(shapes.areas))[linked] / shapes.areas[linked]
    if np.abs(covered - 1.0).max() > COVERAGE_TOLERANCE:
        raise mismatch_error(shapes.centroids[linked[np.argmax(np.abs(covered - 1.0))]])
    inwards = np.einsum("ki,ki->k", piece.normals, shapes.normals[face]) < 0.0
    order = np.argsort(face, kind="stable")
    return points, face[order], rows_in_order(pieces[0], reverse_rows(*pieces, inwards), order)


def _split_in_plane(rows: Ints, places: Floats) -> tuple[Ints, Ints, Floats]:
    """Return face numbers, offsets and corners of pieces."""
    import shapely

    faces = outlines(places, rows, np.arange(len(places)))
    lines = shapely.union_all(shapely.boundary(faces))
    parts = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    holed = shapely.get_num_interior_rings(parts) > 0
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(parts[holed]))
    parts = np.append(parts[~holed], triangles)
    part, face = shapely.STRtree(faces).query(shapely.point_on_surface(parts), predicate="within")
    corners, ring = shapely.get_coordinates(parts[part], return_index=True)
    kept = np.diff(ring, append=-1) == 0  # the last corner repeats the first
    return face, offsets_of(np.bincount(ring[kept], minlength=len(part))), corners[kept]


def _places(points: Floats, known: Ints, corners: Floats, distance: float) -> tuple[Floats, Ints]:
    """Return all points, and the place of each corner."""
    leader = smallest_linked(close_pairs(np.concatenate([points[known], corners]), distance), len(known) + len(corners))
    fresh = np.unique(leader[leader >= len(known)])
    place = np.concatenate([known, np.full(len(corners), -1)])
    place[fresh] = len(points) + np.arange(len(fresh))
    return np.concatenate([points, corners[fresh - len(known)]]), place[leader[len(known) :]]


def _without_slivers(points: Floats, rows: Rows, tolerance: float) -> tuple[Ints, Rows]:
    """Return the numbers and the rows of pieces wider than the tolerance."""
    areas = face_shapes(points, *rows).areas
    kept = np.flatnonzero(2.0 * areas > tolerance * diameters(points, *rows))
    offsets, places = rows_in_order(*rows, kept)
    single = places != places[next_corner(offsets)]
    return kept, (offsets_of(np.add.reduceat(single, offsets[:-1], dtype=np.int64)), places[single])


def mismatch_error(at: Floats) -> MeshError:
    """Return the error for surfaces that do not match near a point."""
    return MeshError(
        f"bodies: the surfaces of two bodies do not match near {coordinates(at, 6)}: they do not lie in the same "
        "planes, or some edges and nodes are only slightly farther apart than the tolerance. Give both bodies the "
        "same nodes there, or another tolerance=."
    )
