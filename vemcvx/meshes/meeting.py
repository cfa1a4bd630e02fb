"""The places where bodies in space meet: nodes, on edges and in faces of other bodies, and lines that cross.

Nodes of several bodies within the tolerance of each other are in one *place*. A place near an edge of another body is
on it; one near two edges of a corner joins the corner. So edges are chains of *lines* between places, each
of one body or of several; two lines that cross make one more place. A place inside a face is near no edge of it.

Of bodies that do not coincide to rounding, the earlier one keeps its shape: nodes of the later one move to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import ROUNDING, Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes.polygons import (
    all_found_in,
    among,
    cell_of_corner,
    directed_edges,
    distinct,
    least_of_each,
    outlines,
    overlapping_boxes,
    rounding,
    rows_in_order,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import Faces, FaceShapes, along_axes, axes_in_planes, face_shapes, heights

# Cosine of the outward normals of faces that face each other. Bodies that are flush have edges near to each other
# on faces that do not.
FACING = -0.5
# Nodes that move to an earlier body may come near to further edges, so they are matched again; after as many rounds as
# this the tilings are refused.
ROUNDS = 8


# The outer faces and edges that are near another body.


@dataclass(frozen=True, eq=False)
class Surface:
    """Outer faces of bodies near other bodies, and the edges of these faces."""

    points: Floats
    """(n_nodes, 3) of the places of nodes, each called by its first node"""
    body: Ints
    place: Ints
    """(n_nodes,)"""
    boxes: tuple[Floats, Floats]
    """(bodies, 3) lowest and highest coordinates of each body"""
    faces: Ints
    """(f,) numbers"""
    offsets: Ints
    vertices: Ints
    ends: Ints
    """(e, 2) nodes of the edges, the smaller first"""
    tolerance: float
    reach: float
    """how far from each other along their normals surfaces may be: the tolerance, and by how much nodes have moved"""

    @classmethod
    def of(cls, points: Floats, faces: Faces, body: Ints, place: Ints, tolerance: float) -> Surface:
        """The outer faces of bodies that lie side by side, as far as they are near another."""
        outer = np.flatnonzero(faces.face_cells[:, 1] < 0)
        offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, outer)
        boxes, near = near_others(points, (offsets, vertices), body, ROUNDS * tolerance)
        offsets, vertices = rows_in_order(offsets, vertices, np.flatnonzero(near))
        ends = np.sort(directed_edges(offsets, vertices), axis=1)
        ends = ends[np.unique(ends @ [len(points), 1], return_index=True)[1]]
        return cls(
            points=points,
            body=body,
            place=place,
            boxes=boxes,
            faces=outer[near],
            offsets=offsets,
            vertices=vertices,
            ends=ends,
            tolerance=tolerance,
            reach=tolerance,
        )

    def extended(self, points: Floats) -> Surface:
        """The surface with more points after its own, which changes nothing that is known of its faces."""
        grown = replace(self, points=np.concatenate([self.points, points]))
        known = {name: value for name, value in vars(self).items() if name not in vars(grown)}
        vars(grown).update(known)
        return grown

    @cached_property
    def shapes(self) -> FaceShapes:
        """Shapes of the faces."""
        return face_shapes(self.points, self.offsets, self.place[self.vertices])

    @cached_property
    def body_of_face(self) -> Ints:
        """The body (f,) of each face."""
        return self.body[self.vertices[self.offsets[:-1]]]

    @cached_property
    def body_of_edge(self) -> Ints:
        """The body (e,) of each edge."""
        return self.body[self.ends[:, 0]]

    @cached_property
    def normals_at_edges(self) -> Floats:
        """The normals (e, 2, 3) of the two faces at each edge; zero for one that is far from other bodies."""
        size = len(self.body)
        ends = np.sort(directed_edges(self.offsets, self.vertices), axis=1)
        edge = np.searchsorted(self.ends @ [size, 1], ends @ [size, 1])
        order = np.argsort(edge, kind="stable")
        normals = self.shapes.normals[cell_of_corner(self.offsets)[order]]
        first = np.flatnonzero(np.diff(edge[order], prepend=-1))
        second = first + (np.diff(edge[order], append=-1)[first] == 0)
        return np.stack([normals[first], np.where((second > first)[:, None], normals[second], 0.0)], axis=1)

    @cached_property
    def places(self) -> Ints:
        """The places of its nodes."""
        return distinct(self.place[self.vertices])

    def key(self, place: Ints, body: Ints) -> Ints:
        """One number for a place and a body."""
        number: Ints = place * len(self.boxes[0]) + body
        return number

    @cached_property
    def taken(self) -> Ints:
        """The keys of places and of the bodies that have a node there."""
        nodes = distinct(self.vertices)
        return distinct(self.key(self.place[nodes], self.body[nodes]))

    def seen(self, places: Floats, faces: Ints) -> Floats:
        """Coordinates of places in the plane of a face each, and above it."""
        return along_axes(places, faces, self._axes, self.shapes)

    @cached_property
    def _axes(self) -> Floats:
        return axes_in_planes(self.shapes)

    @cached_property
    def charts(self) -> NDArray[Any]:
        """The faces, each in its plane."""
        corners = self.seen(self.points[self.place[self.vertices]], cell_of_corner(self.offsets))
        return outlines(corners[:, :2], self.offsets, np.arange(len(corners)))


Boxes = tuple[Floats, Floats]


def near_others(points: Floats, outlines: tuple[Ints, Ints], body: Ints, width: float) -> tuple[Boxes, Bools]:
    """The boxes of all bodies, wider by a width on all sides, and a mask of the outer faces that meet another's.

    `outlines` are the offsets and vertices of all outer faces, body by body.
    """
    offsets, vertices = outlines
    low, high = (f.reduceat(points[vertices], offsets[:-1]) for f in (np.minimum, np.maximum))
    of_face = body[vertices[offsets[:-1]]]
    first = np.searchsorted(of_face, np.arange(of_face[-1] + 1))
    boxes = np.minimum.reduceat(low, first) - width, np.maximum.reduceat(high, first) + width
    near = [(of_face != own) & _meets((low, high), box) for own, box in enumerate(zip(*boxes, strict=True))]
    return boxes, np.any(near, axis=0)


def _meets(boxes: Boxes, other: Boxes) -> Bools:
    meets: Bools = np.all((boxes[0] <= other[1]) & (boxes[1] >= other[0]), axis=-1)
    return meets


# Where places lie on other bodies.


class OnEdges(NamedTuple):
    """Places (h,) on edges of bodies that have no node there."""

    place: Ints
    edge: Ints
    along: Floats
    """how far along the edge, from 0 to 1"""
    at: Floats
    """(h, 3) the nearest points of the edges"""


class InFaces(NamedTuple):
    """Places (i,) in faces of bodies that have them neither at a node nor on an edge."""

    place: Ints
    face: Ints
    at: Floats
    """(i, 3) the nearest points of the faces"""

    def normals(self, surface: Surface) -> Floats:
        """The normals (i, 2, 3) of the faces, twice, as there are two at an edge."""
        return np.repeat(surface.shapes.normals[self.face][:, None], 2, axis=1)


def settled(surface: Surface) -> tuple[Surface, OnEdges, InFaces]:
    """The surface with places that were joined, and nodes that were moved to the bodies before theirs.

    And where its places are on edges and in faces of other bodies.
    """
    for _ in range(ROUNDS):
        near = _near_edges(surface, surface.places)
        if len(links := _corners(surface, near)):
            surface = _linked(surface, links)
            continue
        # Of each body, the edge that is nearest to a place.
        distance = np.linalg.norm(surface.points[near.place] - near.at, axis=1)
        nearest = least_of_each(surface.key(near.place, surface.body_of_edge[near.edge]), distance)
        on_edges = OnEdges(near.place[nearest], near.edge[nearest], near.along[nearest], near.at[nearest])
        known = surface.key(on_edges.place, surface.body_of_edge[on_edges.edge])
        in_faces = _in_faces(surface, surface.places, known)
        spot, at = np.concatenate([on_edges.place, in_faces.place]), np.concatenate([on_edges.at, in_faces.at])
        host = np.concatenate([surface.body_of_edge[on_edges.edge], surface.body_of_face[in_faces.face]])
        here = surface.points[spot]
        off = np.flatnonzero(
            (host < surface.body[spot]) & (np.linalg.norm(at - here, axis=1) > 4.0 * rounding(here, at))
        )
        if not len(off):
            return surface, on_edges, in_faces
        off = off[least_of_each(spot[off], host[off])]  # of several earlier bodies, the first
        points = surface.points.copy()
        points[spot[off]] = at[off]
        # Faces between nodes that have moved across may be so much farther from what was within the tolerance.
        normals = np.concatenate([surface.normals_at_edges[on_edges.edge], in_faces.normals(surface)])[off]
        across = np.abs(np.einsum("kai,ki->ka", normals, at[off] - here[off])).max()
        surface = replace(surface, points=points, reach=surface.reach + float(across))
    raise unmatched(surface.points[spot[off[0]]])


def _linked(surface: Surface, links: Ints) -> Surface:
    """The surface with more places (l, 2) that are one; MeshError if two nodes of a body come together."""
    place = smallest_linked(links, len(surface.place))[surface.place]
    nodes = distinct(surface.vertices)
    _, first, counts = np.unique(surface.key(place[nodes], surface.body[nodes]), return_index=True, return_counts=True)
    if (counts > 1).any():
        raise unmatched(surface.points[nodes[first[counts > 1][0]]])
    return replace(surface, place=place)


def _near_edges(surface: Surface, spots: Ints) -> OnEdges:
    """All pairs of a place, one of the spots, and an edge of another body that is no farther from it.

    Across a face beside the edge, that is within `reach`; along this face, within the tolerance.
    """
    ends = surface.place[surface.ends]
    x = surface.points[ends]
    boxes = x.min(axis=1) - surface.reach, x.max(axis=1) + surface.reach
    place, edge = _in_boxes(surface, spots, surface.body_of_edge, boxes, surface.taken)
    start, arm = _arms(x[edge])
    along = np.einsum("ki,ki->k", surface.points[place] - start, arm) / np.einsum("ki,ki->k", arm, arm)
    along = np.clip(along, 0.0, 1.0)
    at = start + along[:, None] * arm
    apart = surface.points[place] - at
    height = np.abs(np.einsum("kai,ki->ka", surface.normals_at_edges[edge], apart))
    along_face = np.sqrt(np.maximum((apart**2).sum(axis=1)[:, None] - height**2, 0.0))
    near = ((height <= surface.reach) & (along_face <= surface.tolerance)).any(axis=1)
    return OnEdges(place[near], edge[near], along[near], at[near])


def _corners(surface: Surface, near: OnEdges) -> Ints:
    """Pairs (l, 2) of a place and the corner of two edges of one body that are both near it."""
    ends = surface.place[surface.ends[near.edge]].ravel()
    rows = np.column_stack([np.repeat(near.place, 2), ends])
    body = np.repeat(surface.body_of_edge[near.edge], 2)
    found, counts = np.unique(np.column_stack([rows, body]), axis=0, return_counts=True)
    links: Ints = found[counts > 1][:, :2]
    return links[np.unique(links[:, 0], return_index=True)[1]]


def _in_boxes(surface: Surface, spots: Ints, body: Ints, boxes: Boxes, known: Ints) -> tuple[Ints, Ints]:
    """Pairs of a place, one of the spots, and one of the boxes, each of a part of a body, that it is in.

    `known` are keys of places and bodies that are not asked for.
    """
    found, points = [np.empty((2, 0), dtype=np.int64)], surface.points
    for number, box in enumerate(zip(*surface.boxes, strict=True)):
        own = np.flatnonzero(body == number)
        asked = ~among(surface.key(spots, np.full_like(spots, number)), known)
        there = spots[_meets((points[spots], points[spots]), box) & asked]
        at = points[there]
        i, j = overlapping_boxes(at, at, boxes[0][own], boxes[1][own])
        found.append(np.stack([there[i], own[j]]))
    place, part = np.concatenate(found, axis=1)
    return place, part


def _in_faces(surface: Surface, spots: Ints, known: Ints) -> InFaces:
    """Places inside faces of other bodies, each in the nearest; `known` are keys of what bodies have else."""
    import shapely

    corners = surface.points[surface.place[surface.vertices]]
    low, high = (f.reduceat(corners, surface.offsets[:-1]) for f in (np.minimum, np.maximum))
    boxes = low - surface.reach, high + surface.reach
    known = np.concatenate([surface.taken, known])
    place, face = _in_boxes(surface, spots, surface.body_of_face, boxes, known)
    near = np.abs(heights(surface.points[place], face, surface.shapes)) <= surface.reach
    place, face = place[near], face[near]
    seen = surface.seen(surface.points[place], face)
    inside = shapely.contains_xy(surface.charts[face], seen[:, 0], seen[:, 1])
    place, face, height = place[inside], face[inside], seen[inside, 2]
    nearest = least_of_each(surface.key(place, surface.body_of_face[face]), np.abs(height))
    place, face, height = place[nearest], face[nearest], height[nearest]
    return InFaces(place, face, surface.points[place] - height[:, None] * surface.shapes.normals[face])


class Meeting(NamedTuple):
    """All places, those of nodes and then crossings of lines, and where they lie on other bodies."""

    before: Floats
    """(n_nodes, 3) where nodes have been"""
    surface: Surface
    """with more points: those of all places"""
    on_edges: OnEdges
    in_faces: InFaces


def meeting_of(before: Floats, surface: Surface) -> Meeting:
    """All places of a surface; `before` (n_nodes, 3) is where nodes have been."""
    surface, on_edges, in_faces = settled(surface)
    lines, owner = lines_between(surface, on_edges)
    # Bodies share lines; each is crossed once, and so is every edge that it is a part of.
    number = np.unique(lines @ [len(surface.points), 1], return_inverse=True)[1]
    one, other, at = _crossings(surface, lines, owner)
    pair = np.sort(number[np.column_stack([one, other])], axis=1)
    first = np.unique(pair @ [len(lines), 1], return_index=True)[1]
    pair, fresh = pair[first], len(surface.points) + np.arange(len(first))
    crossed, line = all_found_in(number, pair.T.ravel())
    edge, place = owner[line], np.tile(fresh, 2)[crossed]
    start, arm = _arms(surface.points[surface.place[surface.ends[edge]]])
    surface = surface.extended(at[first])
    along = np.einsum("ki,ki->k", surface.points[place] - start, arm) / np.einsum("ki,ki->k", arm, arm)
    on_edges = OnEdges(
        np.concatenate([on_edges.place, place]),
        np.concatenate([on_edges.edge, edge]),
        np.concatenate([on_edges.along, along]),
        np.concatenate([on_edges.at, surface.points[place]]),
    )
    known = surface.key(on_edges.place, surface.body_of_edge[on_edges.edge])
    more = _in_faces(surface, fresh, known)
    in_faces = InFaces(*(np.concatenate(both) for both in zip(in_faces, more, strict=True)))
    return Meeting(before, surface, on_edges, in_faces)


def lines_between(surface: Surface, on_edges: OnEdges) -> tuple[Ints, Ints]:
    """Lines (l, 2) between places that follow each other on an edge, the smaller first, and their edges (l,)."""
    every, ends = np.arange(len(surface.ends)), surface.place[surface.ends]
    edge = np.concatenate([every, on_edges.edge, every])
    place = np.concatenate([ends[:, 0], on_edges.place, ends[:, 1]])
    along = np.concatenate([np.full(len(every), -1.0), on_edges.along, np.full(len(every), 2.0)])
    order = np.lexsort((along, edge))
    edge, place = edge[order], place[order]
    begin = np.flatnonzero(edge[1:] == edge[:-1])
    return np.sort(np.column_stack([place[begin], place[begin + 1]]), axis=1), edge[begin]


def _crossings(surface: Surface, lines: Ints, owner: Ints) -> tuple[Ints, Ints, Floats]:
    """Pairs of lines (l, 2) of two bodies that cross, where these face each other; and where: on the earlier body."""
    ends, body = surface.points[lines], surface.body_of_edge[owner]
    low, high = ends.min(axis=1), ends.max(axis=1)
    found = [np.empty((2, 0), dtype=np.int64)]
    for (a, own), (b, its) in combinations(enumerate(zip(*surface.boxes, strict=True)), 2):
        if not _meets(own, its):
            continue
        one = np.flatnonzero((body == a) & _meets((low, high), its))
        other = np.flatnonzero((body == b) & _meets((low, high), own))
        i, j = overlapping_boxes(low[one] - surface.reach, high[one] + surface.reach, low[other], high[other])
        found.append(np.stack([one[i], other[j]]))
    one, other = np.concatenate(found, axis=1)
    apart = (lines[one][:, :, None] != lines[other][:, None, :]).all(axis=(1, 2))
    one, other = one[apart], other[apart]
    (p, u), (q, v) = (_arms(ends[which]) for which in (one, other))
    mine, its = (surface.normals_at_edges[owner[which]] for which in (one, other))
    cosine = np.einsum("kai,kbi->kba", mine, its).min(axis=2, initial=0.0)
    # The line of the later body is seen along the normal of its faces; at a rim, where they turn by 45 degrees, of that
    # which faces the other body.
    smooth = np.einsum("ki,ki->k", its[:, 0], its[:, 1]) > 0.7
    upright = np.where(smooth[:, None], its.sum(axis=1), its[np.arange(len(its)), np.argmin(cosine, axis=1)])
    across = np.cross(v, upright)
    start, fall = np.einsum("ki,ki->k", p - q, across), np.einsum("ki,ki->k", u, across)
    # Where edges that are parallel meet, their ends do.
    turns = np.abs(fall) > ROUNDING * np.linalg.norm(u, axis=1) * np.linalg.norm(across, axis=1)
    s = -start / np.where(turns, fall, 1.0)
    at = p + s[:, None] * u
    t = np.einsum("ki,ki->k", at - q, v) / np.einsum("ki,ki->k", v, v)
    crosses = turns & (np.abs(s - 0.5) < 0.5) & (np.abs(t - 0.5) < 0.5) & (cosine.min(axis=1, initial=0.0) < FACING)
    crosses &= np.linalg.norm(at - q - t[:, None] * v, axis=1) <= surface.reach
    return one[crosses], other[crosses], at[crosses]


def _arms(ends: Floats) -> tuple[Floats, Floats]:
    return ends[:, 0], ends[:, 1] - ends[:, 0]


def unmatched(at: Floats) -> MeshError:
    """The error that refuses tilings which do not match near a point (3,)."""
    where = ", ".join(f"{x:.6g}" for x in at)
    return MeshError(
        f"bodies: the tilings of two bodies do not match near ({where}), where edges and nodes are hardly farther "
        "apart than the tolerance. Give a smaller or larger tolerance=, or mesh the bodies more alike there."
    )
