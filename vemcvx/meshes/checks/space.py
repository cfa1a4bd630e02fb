"""A mesh of space checked: from points and cells to polyhedra that tile a domain, or to a MeshError."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.faces import PLANE, SharedFaces, check_face_lists, check_faces, faces_to_turn, shared_faces
from vemcvx.meshes.checks.plane import NARROW, brief_row, check_coincident, check_points, dropped
from vemcvx.meshes.polygons.geometry import TOLERANCE, diameters, overlapping_boxes
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    rows_in_order,
    smallest_linked,
    spans,
    turned,
)
from vemcvx.meshes.polyhedra import (
    PAIRS_AT_ONCE,
    Faces,
    FaceShapes,
    beside_faces,
    crossing_distance,
    nodes_of_cells,
    piercing,
    signs_of,
    solid_angles,
    volumes_and_centroids,
)

# Do faces of a surface meet in whole edges and common nodes only? Surfaces are cells, and the boundary of the mesh.
#
# Let all cells be closed surfaces with an inside, and every face that of one cell, or of two on its two sides. How
# often a place is covered is then the winding number about it of the boundary; so cells tile a domain if and only if
# no two faces of the boundary meet but in common nodes and edges, and the boundary winds once about the inside of
# each of its pieces. Convex cells cannot meet themselves; of others, faces are compared as those of the boundary.
#
# Two faces that meet elsewhere have a vertex of the one on the other, or an edge of the one that pierces the other,
# runs across it between two of its vertices, or crosses one of its edges: these four are looked for.


@dataclass(frozen=True)
class Intersection:
    """A place where faces meet as they must not.

    Attributes
    ----------
    kind : {"piercing", "touching", "across", "crossing"}
        An edge pierces a face; a node lies on it; an edge runs across it from vertex to vertex; two edges cross.
    part, other : int
        Numbers of the faces.
    nodes : sequence of int
        The node, or the edge, of the first.
    crossed : sequence of int
        The edge of the other that it crosses.
    distance : float
        Of a node from the face.
    """

    kind: str
    part: int
    other: int
    nodes: tuple[int, ...]
    crossed: tuple[int, ...] = ()
    distance: float = 0.0


class Boxes(NamedTuple):
    """Lowest and highest corners (m, 3) of boxes, and the surface that each belongs to."""

    low: Floats
    high: Floats
    surface: Ints


def meeting_boxes(ones: Boxes, others: Boxes) -> tuple[Ints, Ints]:
    """Pairs of boxes of one surface that meet.

    Surface 0, the boundary, is large: a tree of boxes finds the pairs. In all others every pair is looked at.
    """
    outer, tree = (np.flatnonzero(boxes.surface == 0) for boxes in (ones, others))
    i, j = overlapping_boxes(ones.low[outer], ones.high[outer], others.low[tree], others.high[tree])
    found = [(outer[i], tree[j])]
    order = np.argsort(others.surface, kind="stable")
    first = np.searchsorted(others.surface[order], ones.surface)
    counts = np.searchsorted(others.surface[order], ones.surface, side="right") - first
    inner = np.flatnonzero(ones.surface > 0)
    for part in np.array_split(inner, 1 + counts[inner].sum() // PAIRS_AT_ONCE):
        i, j = np.repeat(part, counts[part]), order[spans(first[part], counts[part])]
        meet = ((ones.low[i] <= others.high[j]) & (ones.high[i] >= others.low[j])).all(axis=1)
        found.append((i[meet], j[meet]))
    one, other = (np.concatenate(pairs) for pairs in zip(*found, strict=True))
    return one, other


@dataclass(frozen=True, kw_only=True, eq=False)
class Surfaces:
    """Faces, each of one surface of many; a face may be given for several.

    Attributes
    ----------
    points : (n_nodes, 3) float
    offsets, vertices : int arrays
        Vertices of the faces.
    shapes : FaceShapes
    surface : (n_faces,) int
        The surface of each face.
    shortest : (n_nodes,) float
        The shortest edge at each node.
    """

    points: Floats
    offsets: Ints
    vertices: Ints
    shapes: FaceShapes
    surface: Ints
    shortest: Floats

    @cached_property
    def _face_of_corner(self) -> Ints:
        return cell_of_corner(self.offsets)

    @cached_property
    def _corner_nodes(self) -> Ints:
        """Corners (n,), one a node of each surface."""
        keys = self.surface[self._face_of_corner] * len(self.points) + self.vertices
        corners: Ints = np.unique(keys, return_index=True)[1]
        return corners

    @cached_property
    def _ends(self) -> Ints:
        return directed_edges(self.offsets, self.vertices)

    @cached_property
    def _edge_numbers(self) -> tuple[Ints, Ints]:
        """Corners (n,), one an edge of each surface; and of all corners the number of their edge."""
        edges, number = np.unique(edge_keys(self._ends, len(self.points)), return_inverse=True)
        keys = self.surface[self._face_of_corner] * len(edges) + number
        return np.unique(keys, return_index=True)[1], number

    def _on_edges(self) -> tuple[Boxes, Ints]:
        """Boxes of the edges, and their corners."""
        corners = self._edge_numbers[0]
        places = self.points[self._ends[corners]]
        return Boxes(places.min(axis=1), places.max(axis=1), self.surface[self._face_of_corner[corners]]), corners

    @cached_property
    def _on_faces(self) -> Boxes:
        corners = self.points[self.vertices]
        low, high = (f.reduceat(corners, self.offsets[:-1], axis=0) for f in (np.minimum, np.maximum))
        margin = NARROW * (high - low).max(axis=1) + TOLERANCE * np.maximum(np.abs(low), np.abs(high)).max(axis=1)
        return Boxes(low - margin[:, None], high + margin[:, None], self.surface)

    @cached_property
    def _vertices_of_faces(self) -> Ints:
        return np.sort(self._face_of_corner * len(self.points) + self.vertices)

    def _is_vertex(self, nodes: Ints, faces: Ints) -> Bools:
        wanted, keys = faces * len(self.points) + nodes, self._vertices_of_faces
        found: Bools = keys[np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)] == wanted
        return found

    def _heights(self, nodes: Ints, faces: Ints) -> Floats:
        arm = self.points[nodes] - self.shapes.centroids[faces]
        height: Floats = np.einsum("ij,ij->i", arm, self.shapes.normals[faces])
        return height

    def _beside(self, places: Floats, faces: Ints) -> tuple[Floats, Bools]:
        return beside_faces(
            places, faces, self.points, self.offsets, vertices=self.vertices, normals=self.shapes.normals
        )

    def intersection(self) -> Intersection | None:
        """Find a place where faces of one surface meet as they must not."""
        searches = (self._nodes_on_faces, self._across, self._crossing, self._piercing)
        return next((found for search in searches if (found := search())), None)

    def _nodes_on_faces(self) -> Intersection | None:
        corners = self._corner_nodes
        nodes, owner = self.vertices[corners], self._face_of_corner[corners]
        places = self.points[nodes]
        number, face = meeting_boxes(Boxes(places, places, self.surface[owner]), self._on_faces)
        free = ~self._is_vertex(nodes[number], face)
        number, face = number[free], face[free]
        node = nodes[number]
        edge, inside = self._beside(self.points[node], face)
        distance = np.where(inside, np.abs(self._heights(node, face)), edge)
        wide = np.sqrt(self.shapes.areas[face])
        slack = TOLERANCE * np.abs(self.points[node]).max(axis=1)
        bad = np.flatnonzero(distance <= slack + NARROW * np.minimum(self.shortest[node], wide))
        if not len(bad):
            return None
        k = bad[0]
        gap = float(distance[k]) if distance[k] > slack[k] else 0.0
        return Intersection("touching", int(owner[number[k]]), int(face[k]), (int(node[k]),), distance=gap)

    @cached_property
    def _edges_and_faces(self) -> tuple[Ints, Ints]:
        boxes, corners = self._on_edges()
        number, face = meeting_boxes(boxes, self._on_faces)
        return corners[number], face

    def _common_nodes(self, ends: Ints, faces: Ints) -> Ints:
        """The number of ends of edges (m, 2) that are vertices of faces (m,)."""
        return self._is_vertex(ends[:, 0], faces).astype(np.int64) + self._is_vertex(ends[:, 1], faces)

    def _piercing(self) -> Intersection | None:
        corner, face = self._edges_and_faces
        apart = self._common_nodes(self._ends[corner], face) == 0
        corner, face = corner[apart], face[apart]
        a, b = self._ends[corner].T
        heights = self._heights(a, face), self._heights(b, face)
        through, places = piercing(self.points[a], self.points[b], *heights)
        return self._inside("piercing", corner[through], face[through], places[through])

    def _across(self) -> Intersection | None:
        corner, face = self._edges_and_faces
        number = self._edge_numbers[1]
        edges = number.max() + 1
        own = np.isin(face * edges + number[corner], self._face_of_corner * edges + number)
        both = (self._common_nodes(self._ends[corner], face) == 2) & ~own
        middles = self.points[self._ends[corner[both]]].mean(axis=1)
        return self._inside("across", corner[both], face[both], middles)

    def _inside(self, kind: str, corner: Ints, face: Ints, places: Floats) -> Intersection | None:
        """The first edge whose place is inside its face."""
        bad = np.flatnonzero(self._beside(places, face)[1])
        if not len(bad):
            return None
        k = bad[0]
        edge = tuple(self._ends[corner[k]].tolist())
        return Intersection(kind, int(self._face_of_corner[corner[k]]), int(face[k]), edge)

    def _crossing(self) -> Intersection | None:
        (low, high, surface), corners = self._on_edges()
        ends = self._ends[corners]
        slack = TOLERANCE * np.maximum(np.abs(low), np.abs(high)).max(axis=1)
        slack += NARROW * self.shortest[ends].min(axis=1)
        boxes = Boxes(low - slack[:, None], high + slack[:, None], surface)
        one, other = meeting_boxes(boxes, boxes)
        free = (one < other) & (ends[one][:, :, None] != ends[other][:, None]).all(axis=(1, 2))
        one, other = one[free], other[free]
        distance = crossing_distance(self.points, ends[one], ends[other])
        bad = np.flatnonzero(distance <= np.minimum(slack[one], slack[other]))
        if not len(bad):
            return None
        i, j = one[bad[0]], other[bad[0]]
        part, other = self._face_of_corner[corners[[i, j]]].tolist()
        return Intersection("crossing", part, other, tuple(ends[i].tolist()), tuple(ends[j].tolist()))


# Do cells in space fit together, and none meet itself? Checks of a user's mesh as a whole (see `surfaces`).


HEIGHTS_AT_ONCE = 1_000_000


def check_space_tiling(points: Floats, faces: Faces, shapes: FaceShapes) -> None:
    """MeshError if cells, whose faces are plane and fit by pairs, meet themselves or each other elsewhere."""
    boundary = np.flatnonzero(faces.face_cells[:, 1] < 0)
    if not len(boundary):
        raise MeshError("the cells have no boundary: they overlap.")
    dented = _dented(points, faces, shapes)
    counts = np.diff(faces.cell_offsets)[dented]
    number = np.concatenate([boundary, faces.cell_faces[spans(faces.cell_offsets[dented], counts)]])
    surface = np.concatenate([np.zeros(len(boundary), dtype=np.int64), np.repeat(dented + 1, counts)])
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, number)
    surfaces = Surfaces(
        points=points,
        offsets=offsets,
        vertices=vertices,
        shapes=FaceShapes(*(values[number] for values in shapes)),
        surface=surface,
        shortest=_shortest_edges(points, faces),
    )
    intersection = surfaces.intersection()
    if intersection:
        cells = np.where(surface > 0, surface - 1, faces.face_cells[number, 0])
        rows = [vertices[offsets[face] : offsets[face + 1]] for face in (intersection.part, intersection.other)]
        raise MeshError(_sentence(intersection, int(cells[intersection.part]), int(cells[intersection.other]), rows[1]))
    _check_winding(points, faces, shapes, boundary)


def _shortest_edges(points: Floats, faces: Faces) -> Floats:
    """The shortest edge at each node, (n_nodes,)."""
    ends = directed_edges(faces.face_offsets, faces.face_vertices)
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    shortest = np.full(len(points), np.inf)
    for nodes in ends.T:
        np.minimum.at(shortest, nodes, length)
    return shortest


def _dented(points: Floats, faces: Faces, shapes: FaceShapes) -> Ints:
    """Cells of which some node lies above the plane of one of their faces: all others are convex.

    A node counts as above where no vertex of the face might be.
    """
    offsets, nodes = nodes_of_cells(faces, len(points))
    sign = signs_of(faces)
    owner = cell_of_corner(faces.cell_offsets)
    counts = np.diff(offsets)[owner]
    slack = PLANE * np.sqrt(shapes.areas) + TOLERANCE * np.abs(points).max()
    found = []
    for part in np.array_split(np.arange(len(owner)), 1 + counts.sum() // HEIGHTS_AT_ONCE):
        face = np.repeat(faces.cell_faces[part], counts[part])
        node = nodes[spans(offsets[owner[part]], counts[part])]
        height = np.einsum("ij,ij->i", points[node] - shapes.centroids[face], shapes.normals[face])
        above = np.repeat(sign[part], counts[part]) * height > slack[face]
        found.append(np.repeat(owner[part], counts[part])[above])
    return np.unique(np.concatenate(found))


def _sentence(intersection: Intersection, cell: int, other: int, row: Ints) -> str:
    face, edge = brief_row(row), brief_row(intersection.nodes)
    both = f"cell {cell} crosses itself" if cell == other else f"cells {cell} and {other} overlap"
    if intersection.kind == "piercing":
        return f"{both}: the edge {edge} of cell {cell} pierces the face {face} of cell {other}. Correct the vertices."
    if intersection.kind == "crossing":
        edges = f"edges {edge} and {brief_row(intersection.crossed)} cross"
        if cell == other:
            return f"{both}: its {edges}. Correct the vertices."
        return (
            f"{both}, or meet in part of a face: their {edges}. Two cells must meet in whole faces of both: cut the "
            "faces where those of the neighbours end, with a node at the crossing."
        )
    if intersection.kind == "across":
        return (
            f"the edge {edge} of cell {cell} runs across the face {face} of cell {other}. Two cells must meet in whole "
            f"faces of both: cut that face along the edge in cell {other}."
        )
    place = f"{intersection.distance:.3g} beside" if intersection.distance else "on"
    node = intersection.nodes[0]
    if cell == other:
        return f"cell {cell} touches itself: its node {node} lies {place} its face {face}. Split the cell there."
    return (
        f"node {node} lies {place} the face {face} of cell {other} without being one of its vertices. Two cells must "
        f"meet in whole faces of both: cut that face of cell {other} into the faces of its neighbours, and make a node "
        "on an edge a vertex of every face that has the edge."
    )


def _check_winding(points: Floats, faces: Faces, shapes: FaceShapes, boundary: Ints) -> None:
    """MeshError unless the boundary winds once about the inside of each of its pieces."""
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, boundary)
    piece = _pieces(offsets, vertices, len(points))
    if not piece.any():
        return  # one piece, with the volume of the cells inside
    own = FaceShapes(*(values[boundary] for values in shapes))
    inside = beside_faces(
        own.centroids, np.arange(len(boundary)), points, offsets, vertices=vertices, normals=own.normals
    )[1]
    chosen = np.flatnonzero(inside)
    probes = chosen[np.unique(piece[chosen], return_index=True)[1]]
    corner = np.arange(len(vertices))
    first = np.repeat(offsets[:-1], np.diff(offsets))
    last = np.repeat(offsets[1:] - 1, np.diff(offsets))
    corner, first = corner[(corner > first) & (corner < last)], first[(corner > first) & (corner < last)]
    triangles = points[vertices[np.stack([first, corner, corner + 1], axis=1)]]
    owner = cell_of_corner(offsets)[corner]
    for probe in probes:
        others = owner != probe
        angle = solid_angles(own.centroids[probe][None], triangles[others]).sum() + 2.0 * np.pi
        if abs(angle - 4.0 * np.pi) > 1.0:
            cell = faces.face_cells[boundary[probe], 0]
            row = vertices[offsets[probe] : offsets[probe + 1]]
            raise MeshError(
                f"cell {cell} overlaps another cell: behind its face {brief_row(row)} space is covered more than once. "
                "Remove or correct one of the cells."
            )


def _pieces(offsets: Ints, vertices: Ints, n_nodes: int) -> Ints:
    """The smallest number of a face linked to each one over edges that two faces share."""
    keys = edge_keys(directed_edges(offsets, vertices), n_nodes)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0]))
    pairs = starts[np.diff(np.append(starts, len(keys))) == 2]
    face = cell_of_corner(offsets)
    return smallest_linked(np.column_stack([face[order[pairs]], face[order[pairs + 1]]]), len(offsets) - 1)


# From points and cells in space to the arrays of a valid mesh, or to a MeshError that names the fault.
#
# Mended, with a note for a warning: faces that do not run outwards (turned) and nodes that no cell uses (dropped).
# The order of the checks is that in which faults can be told: numbers, places of nodes, single faces, single cells,
# how cells fit together.


@dataclass(frozen=True, eq=False)
class CheckedInSpace:
    """Arrays of a valid mesh (see `PolyhedralMesh`), and what was mended on the way."""

    points: Floats
    faces: Faces
    node_map: Ints | None
    notes: tuple[str, ...]


def checked_in_space(points: ArrayLike, cells: Any) -> CheckedInSpace:
    """Return valid arrays made of a user's points and cells, or raise MeshError."""
    points = check_points(points, 3)
    offsets, vertices, cell_offsets = check_face_lists(cells, len(points))
    used = np.flatnonzero(np.bincount(vertices, minlength=len(points)))
    check_coincident(points, used)
    owner = cell_of_corner(cell_offsets)
    shared = shared_faces(offsets, vertices, owner, len(points))
    outlines = rows_in_order(offsets, vertices, shared.first)
    shapes = check_faces(points, *outlines, owner[shared.first])
    turn = faces_to_turn(offsets, vertices, cell_offsets, len(points))
    volumes = volumes_and_centroids(shapes, cell_offsets, shared.number, np.where(shared.along ^ turn, 1.0, -1.0))[0]
    turn ^= (volumes < 0.0)[owner]
    faces = _joined(*outlines, cell_offsets, shared=shared, turn=turn)
    _check_volumes(points, faces, volumes)
    turned_faces = turn[shared.first]
    shapes = shapes._replace(normals=np.where(turned_faces[:, None], -shapes.normals, shapes.normals))
    check_space_tiling(points, faces, shapes)
    notes = []
    if turn.any():
        mended = np.unique(owner[turn])
        notes.append(
            f"{len(mended)} of {len(volumes)} cells had faces that did not run outwards, counter-clockwise seen from "
            f"outside (the first is cell {mended[0]}); they have been turned."
        )
    node_map = None
    if len(used) < len(points):
        node_map, note = dropped(used, len(points))
        notes.append(note)
        points, faces = points[used], faces._replace(face_vertices=node_map[faces.face_vertices])
    return CheckedInSpace(points, faces, node_map, tuple(notes))


def _joined(face_offsets: Ints, face_vertices: Ints, cell_offsets: Ints, *, shared: SharedFaces, turn: Bools) -> Faces:
    """Faces with their cells, outwards of the first; MeshError if both cells of one lie on the same side of it."""
    owner = cell_of_corner(cell_offsets)
    later = np.flatnonzero(shared.first[shared.number] != np.arange(len(owner)))
    face = shared.number[later]
    outwards = shared.along ^ turn
    bad = np.flatnonzero(outwards[later] == outwards[shared.first[face]])
    if len(bad):
        k = face[bad[0]]
        row = brief_row(face_vertices[face_offsets[k] : face_offsets[k + 1]])
        raise MeshError(
            f"cells {owner[shared.first[k]]} and {owner[later[bad[0]]]} overlap: both lie on the same side of their "
            f"face {row}. Remove or correct one of them."
        )
    face_cells = np.column_stack([owner[shared.first], np.full(len(shared.first), -1)])
    face_cells[face, 1] = owner[later]
    vertices = turned(face_offsets, face_vertices, turn[shared.first])
    return Faces(face_offsets, vertices, cell_offsets, shared.number, face_cells)


def _check_volumes(points: Floats, faces: Faces, volumes: Floats) -> None:
    offsets, nodes = nodes_of_cells(faces, len(points))
    sizes = diameters(points, offsets, nodes)
    largest = np.maximum.reduceat(np.abs(points[nodes]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(np.abs(volumes) <= TOLERANCE * largest * sizes**2)
    if len(flat):
        raise MeshError(
            f"cell {flat[0]} has no volume (volume {volumes[flat[0]]:.3g}, diameter {sizes[flat[0]]:.3g}). Remove it "
            "or correct its faces."
        )
