"""Do cells in space fit together, and none meet itself? Checks of a user's mesh as a whole (see `surfaces`)."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.cells import brief_row
from vemcvx.meshes.checks.plane_faces import PLANE
from vemcvx.meshes.checks.surfaces import Intersection, Surfaces
from vemcvx.meshes.polygons.segments import TOLERANCE
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    rows_in_order,
    smallest_linked,
    spans,
)
from vemcvx.meshes.polyhedra.shapes import FaceShapes
from vemcvx.meshes.polyhedra.topology import Faces, nodes_of_cells, signs_of
from vemcvx.meshes.polyhedra.touching import beside_faces, solid_angles

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
    """Of each face the smallest number of a face that it is linked to over edges that two faces have."""
    keys = edge_keys(directed_edges(offsets, vertices), n_nodes)
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0]))
    pairs = starts[np.diff(np.append(starts, len(keys))) == 2]
    face = cell_of_corner(offsets)
    return smallest_linked(np.column_stack([face[order[pairs]], face[order[pairs + 1]]]), len(offsets) - 1)
