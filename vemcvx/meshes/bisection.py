"""Refinement in space: bisection of some tetrahedra, or splitting of all cells.

*Tetrahedra.* A cell is bisected through the midpoint of the longest edge. Every cell with a new node on an edge is then
bisected in the same way, until no edge has a hanging node (M.-C. Rivara, Int. J. Numer. Meth. Eng. 20 (1984), 745-756).
If edges are equally long, node numbers decide. Coinciding nodes at an interface count as one node.

*Other cells* are split into one part per vertex. New nodes are the midpoints of edges, and the centroids of faces and
cells. The new faces must be plane.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes.carrying import check_lengths, check_marks, inherit_parts, middle_places
from vemcvx.meshes.checks.space import check_polyhedral_mesh
from vemcvx.meshes.interfaces import pairs_of, places_of
from vemcvx.meshes.local_refinement import refine_polygons
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import (
    cell_of_corner,
    edge_keys,
    find_in,
    offsets_of,
    previous_corner,
    rows_in_order,
    same_rows,
    sort_edges,
)
from vemcvx.meshes.polyhedra import FACES, join_faces, list_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

EDGES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
OPPOSITE = [3, 2, 0, 1]  # corner opposite to each face in `FACES`
ALL_DIRECTIONS = 3  # number of bisections that divide the volume by 8


def refine_mesh(mesh: Any, cells: ArrayLike | None) -> Any:
    """Return the refined mesh: see :meth:`vemcvx.PolygonMesh.refine`."""
    marked = check_marks(cells, mesh.n_cells)
    if not marked.any():
        return mesh
    if isinstance(mesh, PolygonMesh):
        return refine_polygons(mesh, marked)
    if marked.all() and len(other_cells(mesh)):
        return split_about_vertices(mesh)
    check_tetrahedra(mesh, "refine")
    return bisect_cells(mesh, marked, ALL_DIRECTIONS if cells is None else 1)


def other_cells(mesh: PolyhedralMesh) -> Ints:
    """Return the numbers of the cells that are not tetrahedra."""
    most = np.maximum.reduceat(np.diff(mesh.face_offsets)[mesh.cell_faces], mesh.cell_offsets[:-1])
    return np.flatnonzero((np.diff(mesh.cell_offsets) != 4) | (most != 3))


def check_tetrahedra(mesh: PolyhedralMesh, subject: str) -> None:
    """Raise MeshError if a cell is not a tetrahedron."""
    others = other_cells(mesh)
    if len(others):
        cell = int(others[0])
        faces = mesh.cell_offsets[cell + 1] - mesh.cell_offsets[cell]
        raise MeshError(
            f"{subject}: local refinement in space needs tetrahedra without hanging nodes; cell {cell}, with {faces} "
            f"faces, is not one. Start with vx.meshes.tetrahedra(n) (--mesh tetrahedra), or split all cells "
            "by mesh.refine()."
        )


class Tetrahedra(NamedTuple):
    """Tetrahedra during bisection."""

    corners: Ints  # (n, 4) nodes, with the orientation of `FACES`
    parts: Ints  # (n, 4) old boundary face opposite to the corner, or -1
    parents: Ints  # (n,) original cell
    cuts: Ints  # (n,) number of bisections since the original cell

    @classmethod
    def from_mesh(cls, mesh: PolyhedralMesh) -> Tetrahedra:
        """Return the cells of a mesh."""
        corners = mesh.cell_nodes[1].reshape(-1, 4).copy()
        x = mesh.points[corners]
        mirrored = np.linalg.det(x[:, 1:] - x[:, :1]) < 0.0
        corners[mirrored, 2:] = corners[mirrored, :1:-1]
        owners, faces = mesh._owners, mesh._outlines[1].reshape(-1, 3)
        opposite = corners[owners].sum(axis=1) - faces.sum(axis=1)
        parts = np.full(corners.shape, -1)
        parts[owners, np.argmax(corners[owners] == opposite[:, None], axis=1)] = np.arange(len(faces))
        return cls(corners, parts, np.arange(len(corners)), np.zeros(len(corners), dtype=np.int64))

    def longest_edges(self, points: Floats, places: Ints) -> Ints:
        """Return two column numbers (n, 2) of `corners` per cell: the ends of its longest edge."""
        ends = places[self.corners[:, EDGES]]
        x, keys = points[ends], edge_keys(ends.reshape(-1, 2), len(points)).reshape(-1, 6)
        squared = np.sum((x[:, :, 0] - x[:, :, 1]) ** 2, axis=2)
        return EDGES[np.lexsort((keys, squared))[:, -1]]

    def cut(self, chosen: Bools, at: Ints, middle: Ints) -> Tetrahedra:
        """Return the cells after a bisection of the chosen cells."""
        some, row = Tetrahedra(*(values[chosen] for values in self)), np.arange(len(at))
        halves = []
        for kept, left in (at.T, at.T[::-1]):
            corners, parts = some.corners.copy(), some.parts.copy()
            corners[row, left] = middle
            parts[row, kept] = -1  # no boundary face between the halves
            halves.append(Tetrahedra(corners, parts, some.parents, some.cuts + 1))
        rest = Tetrahedra(*(values[~chosen] for values in self))
        return Tetrahedra(*map(np.concatenate, zip(rest, *halves, strict=True)))


def bisect_cells(mesh: PolyhedralMesh, marked: Bools, cuts: int) -> PolyhedralMesh:
    """Bisect marked cells, then further cells until no edge has a hanging node."""
    n, points, places = mesh.n_nodes, mesh.points, places_of(pairs_of(mesh.interfaces), mesh.points)
    cells, todo, ends = Tetrahedra.from_mesh(mesh), marked, np.empty((0, 2), dtype=np.int64)
    while todo.any():
        some = Tetrahedra(*(array[todo] for array in cells))
        at = some.longest_edges(points, places)
        pairs = np.take_along_axis(some.corners, at, axis=1)
        keys = np.unique(edge_keys(pairs, len(points)))
        fresh = np.column_stack(np.divmod(keys[~np.isin(keys, edge_keys(ends, len(points)))], len(points)))
        check_lengths(points, fresh)
        ends, points = np.concatenate([ends, fresh]), np.concatenate([points, points[fresh].mean(axis=1)])
        split = edge_keys(places[ends], len(points))
        places = np.concatenate([places[:n], n + find_in(split, split)])
        cells = cells.cut(todo, at, n + find_in(edge_keys(ends, len(points)), edge_keys(pairs, len(points))))
        edges = edge_keys(places[cells.corners[:, EDGES]].reshape(-1, 2), len(points))
        hanging = np.isin(edges, split).reshape(-1, 6).any(axis=1)
        todo = hanging | (marked[cells.parents] & (cells.cuts < cuts))
    cells = Tetrahedra(*(array[np.argsort(cells.parents, kind="stable")] for array in cells))
    count, listed = len(cells.corners), cells.corners[:, np.array(FACES["tetra"])].ravel()
    faces = join_faces(np.arange(4 * count + 1) * 3, listed, np.arange(count + 1) * 4)
    made = PolyhedralMesh.unchecked(points, *faces)
    return inherit_parts(mesh, made, cells.parents, _parts(made, cells.parts[:, OPPOSITE]), places)


def _parts(made: PolyhedralMesh, listed: Ints) -> Ints:
    of_face = np.empty(made.n_faces, dtype=np.int64)
    of_face[made.cell_faces] = listed.ravel()
    return of_face[made._boundary]


def split_about_vertices(mesh: PolyhedralMesh) -> PolyhedralMesh:
    """Split each cell into one part per vertex."""
    places = places_of(pairs_of(mesh.interfaces), mesh.points)
    shared = sort_edges(mesh.face_offsets, mesh.face_vertices, mesh.n_nodes)
    n, ends = mesh.n_nodes, shared.ends
    check_lengths(mesh.points, ends)
    in_face, in_cell = n + len(ends), n + len(ends) + mesh.n_faces
    rows, corner = rows_in_order(mesh.face_offsets, np.arange(len(mesh.face_vertices)), mesh.cell_faces)
    listed, back = cell_of_corner(rows), corner[previous_corner(rows)]
    cell, face = cell_of_corner(mesh.cell_offsets)[listed], mesh.cell_faces[listed]
    outwards = mesh.face_signs[listed] > 0.0
    after, before = n + shared.number[np.where(outwards, (corner, back), (back, corner))]
    node = mesh.face_vertices[corner]
    # The part at a vertex has two quadrilaterals per adjacent face, one in the face and one inside the cell.
    order = np.lexsort((after, cell)).reshape(-1, 2)
    beyond = np.empty_like(face)
    beyond[order] = face[order[:, ::-1]]
    on_face = np.column_stack([node, after, in_face + face, before])
    across = np.column_stack([after, in_face + beyond, in_cell + cell, in_face + face])
    keys, part = np.unique(cell * n + node, return_inverse=True)
    order = np.argsort(np.tile(part, 2), kind="stable")
    quads = np.concatenate([on_face, across])[order]
    faces = join_faces(np.arange(len(quads) + 1) * 4, quads.ravel(), offsets_of(2 * np.bincount(part)))
    first, number = same_rows(mesh.face_offsets, places[mesh.face_vertices])
    of_cells = in_cell + np.arange(mesh.n_cells)
    places = np.concatenate([places, middle_places(places, ends), in_face + first[number], of_cells])
    points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1), mesh.face_centroids, mesh.centroids])
    points[n:] = points[places[n:]]
    made, parents = PolyhedralMesh.unchecked(points, *faces), keys // n
    old = np.full(mesh.n_faces, -1)
    old[mesh._boundary] = np.arange(len(mesh._boundary))
    parts = _parts(made, np.append(old[face], np.full(len(face), -1))[order])
    found = inherit_parts(mesh, made, parents, parts, places)
    try:
        check_polyhedral_mesh(points, list_faces(faces), found.interfaces)
    except MeshError as error:
        raise MeshError(
            f"refine: parts of cells after the split would not have plane faces ({str(error).partition('. ')[0]}). "
            "Make a new mesh with more cells, or a mesh of tetrahedra."
        ) from None
    return found
