"""Cells in space as files hold them, by their vertices or as polyhedra, and their faces; and back.

Named boundaries are blocks of polygons, marked as lines are in the plane (see `blocks`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.face_names import matching_faces
from vemcvx.meshes.checks.names import WHOLE
from vemcvx.meshes.io.blocks import (
    PASSED_OVER,
    POLYGONS,
    SOLIDS,
    Blocks,
    data_on,
    marked_sides,
    order_of,
)
from vemcvx.meshes.polygons.topology import offsets_of, turned
from vemcvx.meshes.polyhedra.shapes import face_shapes, volumes_and_centroids
from vemcvx.meshes.polyhedra.standard import FACES
from vemcvx.meshes.polyhedra.topology import Listed
from vemcvx.meshes.space_tessellation import SpaceTessellation


def space_mesh_of(points: Floats, blocks: Blocks) -> tuple[SpaceTessellation, list[str]]:
    """Return the mesh of the solids of a file, its polygons as boundaries; and notes on polygons inside, left out."""
    solids = [number for number, (kind, _) in enumerate(blocks.cells) if kind in SOLIDS]
    strange = [kind for kind, _ in blocks.cells if kind not in (*SOLIDS, *POLYGONS, *PASSED_OVER, "line")]
    if strange:
        raise MeshError(
            f"it holds cells of the kind {strange[0]!r}; wanted are {', '.join(SOLIDS)} with straight edges and plane "
            "faces. Export elements of first order."
        )
    listed = _joined([_listed(blocks, number, np.asarray(points, dtype=float)) for number in solids])
    order = order_of(blocks, solids)
    mesh = SpaceTessellation(points, listed.in_order(order), cell_data=data_on(blocks, solids, order))
    named = {name: _marked_faces(blocks, parts) for name, parts in marked_sides(blocks).items()}
    for name, rows in blocks.edges.items():
        named[name] = _rows(rows)
    return _with_faces(mesh, named)


def _listed(blocks: Blocks, number: int, points: Floats) -> Listed:
    kind, corners = blocks.cells[number]
    if kind == "polyhedron" and blocks.polyhedra is not None:
        return blocks.polyhedra.in_order(corners.ravel())
    faces = FACES[kind]
    if corners.ndim != 2 or corners.shape[1] != max(map(max, faces)) + 1:
        raise MeshError(f"its cells of the kind {kind!r} do not all have as many nodes as that takes.")
    sizes = np.tile([len(face) for face in faces], len(corners))
    vertices = corners[:, np.concatenate(faces)]
    listed = Listed(offsets_of(sizes), vertices.ravel(), np.arange(len(corners) + 1) * len(faces))
    return _outwards(listed, points)


def _outwards(listed: Listed, points: Floats) -> Listed:
    """The same with all faces of a cell turned where it is inside out: programs number both ways around."""
    inside = (listed.vertices >= 0) & (listed.vertices < len(points))
    if not inside.all() or points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        return listed  # the checks of the mesh say what is wrong
    shapes = face_shapes(points, listed.offsets, listed.vertices)
    faces = np.arange(len(listed.offsets) - 1)
    volumes = volumes_and_centroids(shapes, listed.cell_offsets, faces, np.ones(len(faces)))[0]
    return listed._replace(
        vertices=turned(listed.offsets, listed.vertices, np.repeat(volumes < 0.0, np.diff(listed.cell_offsets)))
    )


def _joined(parts: Sequence[Listed]) -> Listed:
    """Cells of several lists, one after the other."""
    return Listed(
        offsets_of(np.concatenate([np.diff(part.offsets) for part in parts])),
        np.concatenate([part.vertices for part in parts]),
        offsets_of(np.concatenate([np.diff(part.cell_offsets) for part in parts])),
    )


def _marked_faces(blocks: Blocks, parts: list[NDArray[Any]]) -> tuple[Ints, Ints]:
    """Offsets and vertices of the polygons that are marked."""
    chosen = [cells[part != 0] for (kind, cells), part in zip(blocks.cells, parts, strict=True) if kind in POLYGONS]
    sizes = [np.full(len(cells), cells.shape[1]) for cells in chosen]
    none = np.empty(0, dtype=np.int64)
    return offsets_of(np.concatenate([none, *sizes])), np.concatenate([none, *(cells.ravel() for cells in chosen)])


def _rows(padded: Ints) -> tuple[Ints, Ints]:
    """Offsets and entries of rows (m, k) without the -1 that fill them up; less than three are no face."""
    filled = padded[(padded >= 0).sum(axis=1) > 2]
    return offsets_of((filled >= 0).sum(axis=1)), filled[filled >= 0]


def padded(offsets: Ints, vertices: Ints) -> Ints:
    """Rows of different lengths as one array (m, k), filled up with -1."""
    counts = np.diff(offsets)
    rows = np.full((len(counts), counts.max(initial=0)), -1)
    rows[np.arange(rows.shape[1]) < counts[:, None]] = vertices
    return rows


def _with_faces(mesh: SpaceTessellation, named: Mapping[str, tuple[Ints, Ints]]) -> tuple[SpaceTessellation, list[str]]:
    """Name boundaries by polygons; those inside the mesh are left out, with a note."""
    notes, boundaries = [], {}
    number = np.arange(mesh.n_nodes) if mesh.node_map is None else mesh.node_map
    for name, (offsets, vertices) in named.items():
        known = (vertices >= 0) & (vertices < len(number))
        own = np.where(known, number[np.where(known, vertices, 0)], -1)
        faces = matching_faces(mesh.faces, offsets, own)
        found = np.unique(faces[faces >= 0])
        if (faces < 0).any():
            count = np.count_nonzero(faces < 0)
            notes.append(f"{count} of {len(faces)} polygons named {name!r} are not on the boundary and are left out.")
        if len(found) and not (name == WHOLE and len(found) == len(mesh.boundaries[WHOLE])):
            boundaries[name] = found
    return mesh.with_boundaries(boundaries), notes
