"""A mesh of space checked: from points and cells to polyhedra that tile a domain, or to a MeshError.

Faults are told in the order in which they can be: numbers, places of nodes, single faces, single cells, how cells fit
together. Mended, with a note for a warning, are faces that do not run outwards (turned) and nodes that no cell uses
(dropped).

Let all cells be closed surfaces with an inside, and every face that of one cell, or of two on its two sides. How often
a place is covered is then the winding number about it of the boundary; so the cells tile a domain if no two faces of
the boundary meet but in common nodes and edges, and the boundary winds once about the inside of each of its pieces. Two
faces that meet elsewhere have a vertex of the one on the other, or an edge of the one that runs across the other in its
plane or pierces it: these three are looked for. Cells that meet themselves inside the body are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.faces import Flat, SharedFaces, check_face_lists, check_faces, faces_to_turn, shared_faces
from vemcvx.meshes.checks.plane import NARROW, brief_row, check_coincident, check_points, dropped, shortest_edges
from vemcvx.meshes.polygons.geometry import (
    TOLERANCE,
    diameters,
    distances,
    inner_points,
    overlapping_boxes,
    run_through,
)
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    neighbours,
    rows_in_order,
    shared_edges,
    smallest_linked,
    spans,
    turned,
)
from vemcvx.meshes.polyhedra import Faces, FaceShapes, angles_seen, joined_faces, nodes_of_cells, volumes_and_centroids


def checked_in_space(points: ArrayLike, cells: Any) -> tuple[Floats, Faces, Ints | None, list[str]]:
    """Points and faces made of a user's points and cells, or MeshError; the map of nodes, notes on what was mended."""
    points = check_points(points, 3)
    offsets, vertices, cell_offsets = check_face_lists(cells, len(points))
    used = np.flatnonzero(np.bincount(vertices, minlength=len(points)))
    check_coincident(points, used)
    owner = cell_of_corner(cell_offsets)
    shared = shared_faces(offsets, vertices, owner)
    outlines = rows_in_order(offsets, vertices, shared.first)
    shapes = check_faces(points, *outlines, owner[shared.first])
    turn = faces_to_turn(offsets, vertices, cell_offsets, len(points))
    volumes = volumes_and_centroids(shapes, cell_offsets, shared.number, np.where(shared.along ^ turn, 1.0, -1.0))[0]
    turn ^= (volumes < 0.0)[owner]
    faces = _joined(offsets, vertices, cell_offsets, shared=shared, turn=turn)
    _check_volumes(points, faces, volumes)
    turned_faces = turn[shared.first]
    shapes = shapes._replace(normals=np.where(turned_faces[:, None], -shapes.normals, shapes.normals))
    _check_tiling(points, faces, shapes)
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
    return points, faces, node_map, notes


def _joined(offsets: Ints, vertices: Ints, cell_offsets: Ints, *, shared: SharedFaces, turn: Bools) -> Faces:
    """Listed faces, turned and joined; MeshError if both cells of one lie on the same side of it."""
    owner = cell_of_corner(cell_offsets)
    first = shared.first[shared.number]
    outwards = shared.along ^ turn
    bad = np.flatnonzero((first != np.arange(len(owner))) & (outwards == outwards[first]))
    if len(bad):
        k = bad[0]
        row = brief_row(vertices[offsets[k] : offsets[k + 1]])
        raise MeshError(
            f"cells {owner[first[k]]} and {owner[k]} overlap: both lie on the same side of their face {row}. Remove or "
            "correct one of them."
        )
    return joined_faces(offsets, turned(offsets, vertices, turn), cell_offsets)


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


def _check_tiling(points: Floats, faces: Faces, shapes: FaceShapes) -> None:
    """MeshError if cells, whose faces are plane and fit by pairs, meet each other elsewhere."""
    boundary = np.flatnonzero(faces.face_cells[:, 1] < 0)
    if not len(boundary):
        raise MeshError("the cells have no boundary: they overlap.")
    offsets, vertices = rows_in_order(faces.face_offsets, faces.face_vertices, boundary)
    own = FaceShapes(*(values[boundary] for values in shapes))
    shell = _Shell(
        points=points,
        offsets=offsets,
        vertices=vertices,
        cells=faces.face_cells[boundary, 0],
        flat=Flat.of(points, offsets, vertices, own),
        widths=np.sqrt(own.areas),
        shortest=shortest_edges(points, directed_edges(faces.face_offsets, faces.face_vertices)),
    )
    shell.check_nodes()
    shell.check_edges()
    shell.check_winding()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shell:
    """The faces of the boundary, with their cells, their widths, and the shortest edge at each node."""

    points: Floats
    offsets: Ints
    vertices: Ints
    cells: Ints
    flat: Flat
    widths: Floats
    shortest: Floats

    def _near(self, places: Floats) -> tuple[Ints, Ints]:
        """Pairs of boxes about places (m, k, 3) and faces that meet."""
        corners = self.points[self.vertices]
        low, high = (f.reduceat(corners, self.offsets[:-1], axis=0) for f in (np.minimum, np.maximum))
        margin = (NARROW * self.widths + TOLERANCE * np.abs(corners).max())[:, None]
        return overlapping_boxes(places.min(axis=1), places.max(axis=1), low - margin, high + margin)

    def _are_vertices(self, nodes: Ints, faces: Ints) -> Bools:
        keys = cell_of_corner(self.offsets) * len(self.points) + self.vertices
        return np.isin(faces * len(self.points) + nodes, keys)

    def _named(self, face: int) -> str:
        row = self.vertices[self.offsets[face] : self.offsets[face + 1]]
        return f"the face {brief_row(row)} of cell {self.cells[face]}"

    def check_nodes(self) -> None:
        """MeshError where a node lies on a face, or hardly beside it."""
        nodes = np.unique(self.vertices)
        number, face = self._near(self.points[nodes][:, None])
        node = nodes[number]
        free = ~self._are_vertices(node, face)
        node, face = node[free], face[free]
        seen = self.flat.seen(self.points[node], face)
        distance = np.hypot(distances(self.flat.polygons[face], seen[:, :2]), seen[:, 2])
        slack = TOLERANCE * np.abs(self.points[node]).max(axis=1)
        bad = np.flatnonzero(distance <= slack + NARROW * np.minimum(self.shortest[node], self.widths[face]))
        if len(bad):
            k = bad[0]
            where = f"{distance[k]:.3g} beside" if distance[k] > slack[k] else "on"
            raise MeshError(
                f"node {node[k]} lies {where} {self._named(face[k])} without being one of its vertices. Two cells must "
                f"meet in whole faces of both: cut that face of cell {self.cells[face[k]]} into the faces of its "
                "neighbours, and make a node on an edge a vertex of every face that has the edge."
            )

    def check_edges(self) -> None:
        """MeshError where an edge runs across a face in its plane, or pierces it."""
        ends, owner = directed_edges(self.offsets, self.vertices), cell_of_corner(self.offsets)
        _, first, edge = np.unique(edge_keys(ends, len(self.points)), return_index=True, return_inverse=True)
        number, face = self._near(self.points[ends[first]])
        corner = first[number]
        own = np.isin(face * len(first) + number, owner * len(first) + edge)
        common = self._are_vertices(ends[corner, 0], face).astype(np.int64) + self._are_vertices(ends[corner, 1], face)
        # An edge with one end in common that runs across meets another edge of the face, which runs across its own.
        apart = (common == 0) | ((common == 2) & ~own)
        corner, face = corner[apart], face[apart]
        a, b = (self.flat.seen(self.points[ends[corner, k]], face) for k in (0, 1))
        size = TOLERANCE * np.abs(self.points[ends[corner]]).max(axis=(1, 2))
        slack = size + NARROW * np.minimum(self.shortest[ends[corner]].min(axis=1), self.widths[face])
        along = np.flatnonzero((np.abs(a[:, 2]) <= slack) & (np.abs(b[:, 2]) <= slack))
        along = along[run_through(self.flat.polygons[face[along]], np.stack([a, b], axis=1)[along, :, :2])]
        if len(along):
            k = along[0]
            raise MeshError(
                f"the edge {brief_row(ends[corner[k]])} of cell {self.cells[owner[corner[k]]]} runs across "
                f"{self._named(face[k])}. Two cells must meet in whole faces of both: cut that face along the edge in "
                f"cell {self.cells[face[k]]}; if the cells overlap, correct the vertices."
            )
        through = np.flatnonzero((np.minimum(a[:, 2], b[:, 2]) < -size) & (np.maximum(a[:, 2], b[:, 2]) > size))
        a, b, corner, face = a[through], b[through], corner[through], face[through]
        part = (a[:, 2] / (a[:, 2] - b[:, 2]))[:, None]
        inside = np.flatnonzero(distances(self.flat.polygons[face], (a + part * (b - a))[:, :2]) == 0.0)
        if len(inside):
            cell, other = self.cells[owner[corner[inside[0]]]], self.cells[face[inside[0]]]
            both = f"cells {cell} and {other} overlap" if cell != other else f"cell {cell} crosses itself"
            raise MeshError(
                f"{both}: the edge {brief_row(ends[corner[inside[0]]])} of cell {cell} pierces "
                f"{self._named(face[inside[0]])}. Correct the vertices."
            )

    def check_winding(self) -> None:
        """MeshError unless the boundary winds once about the inside of each of its pieces."""
        probes = np.unique(self._pieces())
        if len(probes) == 1:
            return  # one piece, with the volume of the cells inside
        inner = inner_points(self.flat.polygons[probes])
        places = self.flat.origins[probes] + np.einsum("pa,pai->pi", inner, self.flat.axes[probes, :2])
        # The fan of triangles of each face.
        counts = np.diff(self.offsets)
        corner = spans(self.offsets[:-1] + 1, counts - 2)
        owner = np.repeat(np.arange(len(counts)), counts - 2)
        triangles = self.points[self.vertices[np.stack([self.offsets[owner], corner, corner + 1], axis=1)]]
        for probe, place in zip(probes, places, strict=True):
            # Just behind a face the sphere is half full of it; all others fill the other half, or the body is double.
            angle = angles_seen(triangles[owner != probe] - place).sum()
            if abs(angle - 2.0 * np.pi) > 1.0:
                row = self.vertices[self.offsets[probe] : self.offsets[probe + 1]]
                raise MeshError(
                    f"cell {self.cells[probe]} overlaps another cell: behind its face {brief_row(row)} space is "
                    "covered more than once. Remove or correct one of the cells."
                )

    def _pieces(self) -> Ints:
        """Of each face the smallest number of a face that it is linked to over edges that two faces have."""
        shared = shared_edges(self.offsets, self.vertices, len(self.points))
        return smallest_linked(neighbours(self.offsets, shared), len(self.cells))
