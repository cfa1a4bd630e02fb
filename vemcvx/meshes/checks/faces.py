"""Faces of polyhedra as a user lists them, checked: laid flat, plane and simple, closed about every cell, joined.

Each edge of a cell is in exactly two of its faces, which run it in opposite directions if their normals point to the
same side of the cell. Where they do not, the faces to be turned are read off the components of a graph of twice as many
nodes, one a face as it is and one a face turned: links join what runs along together. A cell whose face is linked to
itself turned has no inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.plane import brief_row, check_polygons, fault_in_words, fault_of, laid_flat
from vemcvx.meshes.polygons.geometry import TOLERANCE, diameters, outlines
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    first_in_row,
    offsets_of,
    rotation,
    rows_in_order,
    smallest_linked,
    turned,
)
from vemcvx.meshes.polyhedra import FaceShapes, Listed, face_shapes, same_faces

WANTED = "cells must be a sequence of cells, each a sequence of faces, each a sequence of node numbers"
BY_VERTICES = (
    "Tetrahedra, hexahedra, wedges and pyramids given by their vertices come in by "
    'vx.meshes.convert(meshio.Mesh(points, {"tetra": cells})).'
)


def check_face_lists(cells: Any, n_nodes: int) -> Listed:
    """The faces that cells list, or MeshError.

    Every cell has at least four faces, every face at least three different nodes that exist.
    """
    offsets, vertices, cell_offsets = _flattened(cells)
    if len(cell_offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    few = np.flatnonzero(np.diff(cell_offsets) < 4)
    if len(few):
        count = cell_offsets[few[0] + 1] - cell_offsets[few[0]]
        raise MeshError(f"cell {few[0]} has {count} faces; a polyhedron has at least 4.")
    check_polygons(offsets, vertices, n_nodes, lambda face: _face(face, cell_offsets))
    return Listed(offsets, vertices, cell_offsets)


def _face(number: int, cell_offsets: Ints) -> str:
    cell = int(np.searchsorted(cell_offsets, number, side="right")) - 1
    return f"cell {cell}: its face {number - cell_offsets[cell]}"


def _flattened(cells: Any) -> Listed:
    if isinstance(cells, Listed):
        return cells
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "iu" and not isinstance(cells, np.ma.MaskedArray):
        if cells.ndim != 3:
            raise MeshError(
                f"cells as one array must have the shape (n_cells, faces, vertices); got {cells.shape}. {BY_VERTICES}"
            )
        count, each, sides = cells.shape
        flat = cells.astype(np.int64).ravel()
        return Listed(np.arange(count * each + 1) * sides, flat, np.arange(count + 1) * each)
    try:
        listed = [list(cell) for cell in cells]
    except Exception:  # of whatever a user hands in
        raise MeshError(f"{WANTED}; got {type(cells).__name__}. {BY_VERTICES}") from None
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
    connected = smallest_linked(pairs, len(owner))
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
    label = smallest_linked(links, 2 * count)
    endless = np.flatnonzero(label[:count] == label[count:])
    if len(endless):
        raise MeshError(
            f"cell {owner[endless[0]]} has no inside: its faces close like those of a Klein bottle. Correct its faces."
        )
    flips: Bools = label[:count] != label[first]
    return flips


def _pairs(ends: Ints, cells: Ints, n_nodes: int) -> Ints:
    """The two corners (m, 2) of each cell that start an edge of it; MeshError if there are more or fewer."""
    edges, number = np.unique(edge_keys(ends, n_nodes), return_inverse=True)
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


# Of the diameter of a face: coordinates in single precision, or printed with seven digits, are nearer to its plane.
PLANE = 1e-6


def check_faces(points: Floats, offsets: Ints, vertices: Ints, cells: Ints) -> FaceShapes:
    """Shapes of faces of the cells (n_faces,), or MeshError at the first that is no plane simple polygon."""
    shapes = face_shapes(points, offsets, vertices)
    sizes = diameters(points, offsets, vertices)
    face = np.repeat(np.arange(len(cells)), np.diff(offsets))
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(shapes.areas <= TOLERANCE * largest * sizes)
    if len(flat):
        raise MeshError(
            f"{_named(flat[0], offsets, vertices, cells)} has no area (area {shapes.areas[flat[0]]:.3g}, diameter "
            f"{sizes[flat[0]]:.3g}): its vertices lie on one line, or its outline crosses itself. Remove it or correct "
            "its vertices."
        )
    height = np.einsum("ij,ij->i", points[vertices] - shapes.centroids[face], shapes.normals[face])
    bent = np.flatnonzero(np.abs(height) > (PLANE * sizes + TOLERANCE * largest)[face])
    if len(bent):
        worst = bent[np.argmax(np.abs(height[bent]) / sizes[face[bent]])]
        raise MeshError(
            f"{_named(face[worst], offsets, vertices, cells)} is not plane: node {vertices[worst]} lies "
            f"{abs(height[worst]):.3g} off its plane, and {PLANE:g} of the face's diameter {sizes[face[worst]]:.3g} is "
            "allowed. Split the face into triangles, the same ones in both cells that have it, or move the node."
        )
    _check_outlines(points, offsets, vertices, cells, shapes)
    return shapes


@dataclass(frozen=True, eq=False)
class Flat:
    """Plane faces as polygons, each in a frame of its own.

    Attributes
    ----------
    origins : (n_faces, 3) float
        The centroids.
    axes : (n_faces, 3, 3) float
        Two axes in the plane, and the normal: right-handed unit vectors, a row each.
    polygons : (n_faces,) objects of Shapely
        The faces in the coordinates along the first two axes.
    """

    origins: Floats
    axes: Floats
    polygons: NDArray[Any]

    @classmethod
    def of(cls, points: Floats, offsets: Ints, vertices: Ints, shapes: FaceShapes) -> Flat:
        """Lay faces of the given shapes flat."""
        across = np.eye(3)[np.argmin(np.abs(shapes.normals), axis=1)]
        first = np.cross(shapes.normals, across)
        first /= np.linalg.norm(first, axis=1)[:, None]
        axes = np.stack([first, np.cross(shapes.normals, first), shapes.normals], axis=1)
        bare = cls(shapes.centroids, axes, np.empty(0))
        plane = bare.seen(points[vertices], cell_of_corner(offsets))[:, :2]
        return replace(bare, polygons=outlines(plane, offsets, np.arange(len(vertices))))

    def seen(self, places: Floats, faces: Ints) -> Floats:
        """Coordinates (m, 3) of places (m, 3), each in the frame of its face."""
        coordinates: Floats = np.einsum("mai,mi->ma", self.axes[faces], places - self.origins[faces])
        return coordinates


def _check_outlines(points: Floats, offsets: Ints, vertices: Ints, cells: Ints, shapes: FaceShapes) -> None:
    """MeshError at a face whose outline meets itself; looked at in its own plane."""
    several = np.flatnonzero(np.diff(offsets) > 3)
    if not len(several):
        return
    rows, corners = rows_in_order(offsets, vertices, several)
    flat = Flat.of(points, rows, corners, FaceShapes(*(values[several] for values in shapes)))
    plane = flat.seen(points[corners], cell_of_corner(rows))[:, :2]
    found = fault_of(plane, rows, np.arange(len(corners)), flat.polygons)
    if found is None:
        return
    misfit, number, edge, other = found
    said = _named(several[number], offsets, vertices, cells)
    if misfit.kind == "crossing":
        raise MeshError(said + fault_in_words(misfit, corners[edge], corners[other]))
    raise MeshError(
        f"{said} touches itself: its node {corners[misfit.node]} lies on its edge {brief_row(corners[edge])}. Split "
        "the face, or move the node."
    )


def _named(face: int, offsets: Ints, vertices: Ints, cells: Ints) -> str:
    return f"cell {cells[face]}: its face {brief_row(vertices[offsets[face] : offsets[face + 1]])}"


class SharedFaces(NamedTuple):
    """Faces that cells list, joined."""

    first: Ints
    """(n_faces,) the listing that names each face first"""
    number: Ints
    """(n_listed,) the face that each listing is"""
    along: Bools
    """(n_listed,) whether it runs as the first listing of its face"""


def shared_faces(offsets: Ints, vertices: Ints, owner: Ints) -> SharedFaces:
    """Join the faces that cells list (see `SharedFaces`); MeshError if one has three cells, or two outlines."""
    first, number = same_faces(offsets, vertices)
    counts = np.bincount(number)
    crowded = np.flatnonzero(counts > 2)
    order = np.argsort(number, kind="stable")
    starts = np.cumsum(counts) - counts
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
    # Both listings from their smallest vertex on: the same, or the same backwards, or another outline.
    if not len(one):
        return SharedFaces(first, number, np.ones(len(owner), dtype=bool))
    (rows, mine), (_, theirs) = (_from_smallest(offsets, vertices, listed) for listed in (one, other))
    begin = rows[:-1]
    same = np.logical_and.reduceat(mine == theirs, begin)
    mirrored = np.logical_and.reduceat(mine == turned(rows, theirs, np.ones(len(one), dtype=bool)), begin)
    differs = np.flatnonzero(~same & ~mirrored)
    if len(differs):
        k = differs[0]
        raise MeshError(
            f"cells {owner[one[k]]} and {owner[other[k]]} list the vertices of a face in different orders, "
            f"{_row(offsets, vertices, one[k])} and {_row(offsets, vertices, other[k])}. Run around it both times, in "
            "either direction."
        )
    along = np.ones(len(owner), dtype=bool)
    along[other] = same
    return SharedFaces(first, number, along)


def _from_smallest(offsets: Ints, vertices: Ints, listed: Ints) -> tuple[Ints, Ints]:
    """Offsets and vertices of listed faces, each from its smallest vertex on."""
    rows, nodes = rows_in_order(offsets, vertices, listed)
    smallest = np.repeat(np.minimum.reduceat(nodes, rows[:-1]), np.diff(rows))
    return rows, nodes[rotation(rows, first_in_row(nodes == smallest, rows))]


def _row(offsets: Ints, vertices: Ints, listing: int) -> str:
    return brief_row(vertices[offsets[listing] : offsets[listing + 1]])
