"""Do faces of a surface meet in whole edges and common nodes only? Surfaces are cells, and the boundary of the mesh.

Let all cells be closed surfaces with an inside, and every face that of one cell, or of two on its two sides. How often
a place is covered is then the winding number about it of the boundary; so cells tile a domain if and only if no two
faces of the boundary meet but in common nodes and edges, and the boundary winds once about the inside of each of its
pieces. Convex cells cannot meet themselves; of others, faces are compared as those of the boundary.

Two faces that meet elsewhere have a vertex of the one on the other, or an edge of the one that pierces the other, runs
across it between two of its vertices, or crosses one of its edges: these four are looked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.checks.fitting import NARROW
from vemcvx.meshes.polygons.segments import TOLERANCE, overlapping_boxes
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, edge_keys, spans
from vemcvx.meshes.polyhedra.shapes import FaceShapes
from vemcvx.meshes.polyhedra.touching import PAIRS_AT_ONCE, beside_faces, crossing_distance, piercing


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
        """How many ends of edges (m, 2) are vertices of faces (m,)."""
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
