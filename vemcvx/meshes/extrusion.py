"""Polygons carried along z: a layer of prisms between any two heights."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, Ints, plain
from vemcvx.errors import MeshError
from vemcvx.meshes.box import LARGEST, SHORTEST, WHOLE
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    next_vertex,
    offsets_of,
    positions,
    rows_in_order,
)
from vemcvx.meshes.polyhedra import joined_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.meshes.tessellation import Tessellation

# Sides of the plane below and above are those in front and at the back of a box in space.
RENAMED = {"bottom": "front", "top": "back"}


def extruded(mesh: Tessellation, heights: ArrayLike) -> PolyhedralMesh:
    """The prisms over the cells of a plane mesh: see :meth:`vemcvx.meshes.polygon_mesh.PolygonMesh.extruded`."""
    levels = check_heights(heights)
    named = _names(mesh)
    layers, nodes, cells = len(levels) - 1, mesh.n_nodes, mesh.n_cells
    offsets, vertices, owner = _layer(mesh)
    sizes = np.diff(offsets)
    shift = np.repeat(np.arange(layers), len(vertices)) * nodes
    joined = joined_faces(
        offsets_of(np.tile(sizes, layers)),
        np.tile(vertices, layers) + shift,
        offsets_of(np.tile(np.bincount(owner), layers)),
    )
    points = np.column_stack([np.tile(mesh.points, (layers + 1, 1)), np.repeat(levels, nodes)])
    solid = PolyhedralMesh.unchecked(points, *joined)
    # In every layer, the faces of a cell are its bottom, its top and its sides in the order of its corners.
    first = joined.cell_offsets[:-1].reshape(layers, cells)
    corner_face = cell_of_corner(mesh.offsets) * 2 + 2 + np.arange(len(mesh.vertices))
    sides = joined.cell_faces[corner_face + (np.arange(layers) * len(owner))[:, None]]
    boundary = mesh.shared_edges.alone
    parts = {}
    for name, edges in named.items():
        corners = boundary[positions(edges, mesh.boundaries[WHOLE], nodes)]
        parts[RENAMED.get(name, name)] = sides[:, corners].ravel()
    parts |= {"bottom": joined.cell_faces[first[0]], "top": joined.cell_faces[first[-1] + 1]}
    solid = solid.with_boundaries(parts)
    for name, values in mesh.cell_data.items():
        solid = solid.with_cell_data(name, np.concatenate([values] * layers))
    return solid


def check_heights(heights: ArrayLike) -> Floats:
    """At least two increasing, finite numbers, or MeshError."""
    wanted = "heights must be at least two increasing numbers, the z of the layers' faces"
    given = plain(heights)
    if given is None or given.ndim != 1 or given.dtype.kind not in "iuf" or len(given) < 2:
        raise MeshError(f"{wanted}; got {heights!r}.")
    levels = given.astype(float)
    if not np.isfinite(levels).all() or np.abs(levels).max() > LARGEST or np.diff(levels).min() < SHORTEST:
        raise MeshError(f"{wanted}, at most {LARGEST:g} and {SHORTEST:g} apart; got {levels}.")
    return levels


def _names(mesh: Tessellation) -> dict[str, Ints]:
    if mesh.interfaces:
        raise MeshError(
            f"this mesh has interfaces ({', '.join(mesh.interfaces)}), which meshes in space do not have yet. Extrude "
            "a mesh of one body."
        )
    named = {name: edges for name, edges in mesh.boundaries.items() if name != WHOLE}
    for old, new in RENAMED.items():
        if old in named and new in named:
            raise MeshError(
                f'the part {old!r} of the boundary is called {new!r} in space, where "bottom" and "top" are those in '
                f"z, but this mesh has a part {new!r} as well. Give one of them another name."
            )
    return named


def _layer(mesh: Tessellation) -> tuple[Ints, Ints, Ints]:
    """Faces of one layer, cell by cell and outwards: offsets, vertices (of the level above from n_nodes on), owners."""
    below = mesh.vertices
    corner = np.arange(len(below))
    # Backwards: corner k of a row becomes the last but k.
    mirrored = np.repeat(mesh.offsets[:-1] + mesh.offsets[1:] - 1, np.diff(mesh.offsets)) - corner
    after = next_vertex(mesh.offsets, below)
    sides = np.column_stack([below, after, after + mesh.n_nodes, below + mesh.n_nodes])
    counts = np.diff(mesh.offsets)
    vertices = np.concatenate([below[mirrored], below + mesh.n_nodes, sides.ravel()])
    sizes = np.concatenate([counts, counts, np.full(len(below), 4)])
    cells = np.arange(mesh.n_cells)
    owner = np.concatenate([cells, cells, cell_of_corner(mesh.offsets)])
    order = np.argsort(owner, kind="stable")
    return *rows_in_order(offsets_of(sizes), vertices, order), owner[order]
