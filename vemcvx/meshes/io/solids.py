"""Cells in space as files hold them: by their vertices or as polyhedra, and back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.box import WHOLE, matching_faces
from vemcvx.meshes.io.blocks import (
    CELL,
    PASSED_OVER,
    POLYGONS,
    SOLIDS,
    VTK_TYPES,
    Blocks,
    data_on,
    grouped,
    marked_sides,
    order_of,
    vtk_types,
)
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, offsets_of, rows_in_order, spans, turned
from vemcvx.meshes.polyhedra import FACES, Listed, face_shapes, listed_faces, volumes_and_centroids
from vemcvx.meshes.tessellation import SpaceTessellation

# Tetrahedra, hexahedra, wedges and pyramids told by their faces, and given by their vertices as other programs do.


# Numbers of nodes, faces and triangles -> VTK's type.
SHAPES = {(4, 4, 4): 10, (8, 6, 0): 12, (6, 5, 2): 13, (5, 5, 4): 14}


def solid_blocks(mesh: SpaceTessellation, *, in_order: bool = False, sides: bool = True) -> Blocks:
    """The cells of a mesh, in blocks (see :func:`vemcvx.meshes.io.blocks.grouped`), and its named boundaries as more.

    Raises
    ------
    MeshError
        Some cell is none of the four shapes.
    """
    types, offsets, vertices = by_vertices(mesh)
    blocks = grouped(types, offsets, vertices, data=mesh.cell_data, in_order=in_order)
    return _with_sides(blocks, mesh) if sides else blocks


def by_vertices(mesh: SpaceTessellation) -> tuple[Ints, Ints, Ints]:
    """VTK's type of each cell, and offsets and vertices in VTK's order; MeshError if a cell is none of the shapes."""
    listed = listed_faces(mesh.faces)
    nodes = np.diff(mesh.cell_nodes[0])
    triangles = np.add.reduceat(np.diff(listed.offsets) == 3, listed.cell_offsets[:-1], dtype=np.int64)
    types = np.zeros(mesh.n_cells, dtype=np.int64)
    for shape, number in SHAPES.items():
        types[(np.column_stack([nodes, np.diff(mesh.cell_offsets), triangles]) == shape).all(axis=1)] = number
    # The bottom is the first face; of wedges the first triangle, of pyramids the quadrilateral.
    wanted = np.where(types == 13, 3, np.where(types == 14, 4, np.diff(listed.offsets)[listed.cell_offsets[:-1]]))
    cell = cell_of_corner(listed.cell_offsets)
    fitting = np.flatnonzero(np.diff(listed.offsets) == wanted[cell])
    bottom = fitting[np.unique(cell[fitting], return_index=True)[1]]
    rows, around = rows_in_order(listed.offsets, listed.vertices, bottom[types[cell[bottom]] > 0])
    counts = np.diff(rows)
    mirrored = np.repeat(rows[:-1] + rows[1:] - 1, counts) - np.arange(len(around))
    around = around[mirrored]
    above = _above(mesh, listed, around, np.repeat(np.flatnonzero(types > 0), counts))
    own = np.repeat(types[types > 0], counts)
    first = np.zeros(len(around), dtype=bool)
    first[rows[:-1]] = True
    kept = np.isin(own, (12, 13)) | first  # over a bottom there is one apex, or a node a corner
    if (types == 0).any() or (above[kept] < 0).any():
        strange = int(np.flatnonzero(types == 0)[0]) if (types == 0).any() else int(np.argmin(above))
        raise MeshError(
            f"tetrahedra, hexahedra, wedges and pyramids alone are given by their vertices, and cell {strange} is none "
            f"of them. Polyhedra go into .vtu files and to PyVista."
        )
    owner = np.repeat(np.arange(mesh.n_cells), counts)
    whole = np.concatenate([around, above[kept]])
    cells = np.concatenate([owner, owner[kept]])
    return types, offsets_of(np.bincount(cells)), whole[np.argsort(cells, kind="stable")]


def _above(mesh: SpaceTessellation, listed: Listed, around: Ints, cells: Ints) -> Ints:
    """The node that an edge leads to from each node of a bottom, away from it; -1 where that is not one."""
    n = mesh.n_nodes
    ends = directed_edges(listed.offsets, listed.vertices)
    cell = cell_of_corner(listed.cell_offsets)[cell_of_corner(listed.offsets)]
    on = np.sort(cells * n + around)
    up = np.isin(cell * n + ends[:, 0], on) & ~np.isin(cell * n + ends[:, 1], on)
    keys = (cell * n + ends[:, 0])[up]
    order = np.argsort(keys, kind="stable")
    first, last = (np.searchsorted(keys[order], cells * n + around, side=side) for side in ("left", "right"))
    return np.where(last - first == 1, np.append(ends[up, 1][order], -1)[first], -1)


def _with_sides(blocks: Blocks, mesh: SpaceTessellation) -> Blocks:
    """Add blocks of triangles and quadrilaterals for every named boundary, with the data of their cells."""
    place = np.argsort(np.concatenate(blocks.data[CELL])) if CELL in blocks.data else np.arange(mesh.n_cells)
    on_cells = {name: np.concatenate(parts) for name, parts in blocks.data.items()}
    marks: list[str | None] = [None] * len(blocks.cells)
    named = {name: faces for name, faces in mesh.boundaries.items() if name != WHOLE}
    for name, faces in named.items():
        counts = np.diff(mesh.face_offsets)[faces]
        for count in np.unique(counts):
            chosen = faces[counts == count]
            kind = {5: "triangle", 9: "quad"}[int(vtk_types(count))]
            blocks.cells.append((kind, mesh.face_vertices[mesh.face_offsets[chosen, None] + np.arange(count)]))
            marks.append(name)
            for datum, parts in blocks.data.items():
                parts.append(on_cells[datum][place[mesh.face_cells[chosen, 0]]])
    for name in named:
        blocks.sides[name] = [
            np.full(len(cells), mark == name) for mark, (_, cells) in zip(marks, blocks.cells, strict=True)
        ]
    return blocks


# Cells of VTK's XML files: the arrays that say what their nodes are, and of polyhedra (type 42) their faces.
#
# meshio reads no polyhedra beside other cells, permutes them, keeps one piece of several, and believes offsets (one
# that is too large took gigabytes). So a file is handed to it with one point a cell, and the arrays that describe
# cells as data of the whole file, in names that begin with `PREFIX`. Up to VTK 9.3 the faces of a cell are a stream
# (number of faces; number of nodes and nodes of each), since then rows of faces.


PREFIX = "vemcvx:cells:"
TYPES = f"{PREFIX}types"
POLYHEDRON = 42
NODES = {3: 2, 5: 3, 9: 4}
"""Of lines, triangles and quadrilaterals; those of solids are counted where their faces are made."""
CELLS = re.compile(rb"<Cells>(.*?)</Cells>", re.DOTALL)
VERSION = re.compile(rb'(<VTKFile[^>]*\bversion=")[0-9.]+"')


def without_cells(data: bytes) -> bytes:
    """A VTU file with points for cells, and the arrays of its cells as data of the whole file."""
    head, appended, arrays = data.partition(b"<AppendedData")
    found, counts = CELLS.findall(head), re.findall(rb'NumberOfCells="\s*(\d{1,18})\s*"', head)
    if b"<UnstructuredGrid" not in head:
        raise MeshError("it holds no UnstructuredGrid.")
    if len(found) != 1 or len(counts) != 1:
        raise MeshError(f"it holds {len(found)} pieces; wanted is one: merge them before writing.")
    count = int(counts[0])
    if count > len(data):
        raise MeshError(f"it claims {count} cells; there is room for {len(data)}.")
    one = b'<DataArray type="Int64" Name="%s" format="ascii">%s</DataArray>'
    numbers = b" ".join(b"%d" % number for number in range(1, count + 1))
    points = one % (b"connectivity", b"0 " * count) + one % (b"offsets", numbers) + one % (b"types", b"1 " * count)
    fields = re.sub(rb'Name="', b'Name="' + PREFIX.encode(), found[0])
    head = CELLS.sub(lambda _: b"<Cells>" + points + b"</Cells>", head)
    # PyVista keeps words with the file, which meshio does not read; as numbers, it passes them over.
    head = VERSION.sub(rb'\g<1>1.0"', head).replace(b'type="String"', b'type="UInt8"')
    return head.replace(b"<Piece", b"<FieldData>" + fields + b"</FieldData><Piece", 1) + appended + arrays


def blocks_of_vtk(fields: Mapping[str, Any], data: Mapping[str, NDArray[Any]]) -> Blocks:
    """Cells and their data, from the arrays of a grid (`PREFIX` before their names)."""
    arrays = {
        name.removeprefix(PREFIX): np.asarray(values) for name, values in fields.items() if name.startswith(PREFIX)
    }
    whole = all(values.dtype.kind in "iu" for values in arrays.values())
    if not whole or {"types", "offsets", "connectivity"} - set(arrays):
        raise MeshError("its cells are no whole numbers.")
    arrays = {name: values.astype(np.int64).ravel() for name, values in arrays.items()}
    types, ends, nodes = arrays["types"], arrays["offsets"], arrays["connectivity"]
    offsets = np.concatenate([[0], ends])
    # Compared, not subtracted: differences may overflow.
    if len(ends) != len(types) or (offsets[1:] < offsets[:-1]).any() or offsets[-1] > len(nodes):
        raise MeshError("its lists of cells are damaged: offsets do not increase, or lead beyond the end.")
    for kind, count in NODES.items():
        if (np.diff(offsets)[types == kind] != count).any():
            raise MeshError(f"its cells of the kind {VTK_TYPES[kind]!r} do not all have {count} nodes.")
    solid = types == POLYHEDRON
    polyhedra = _faces(arrays, solid) if solid.any() else None
    # A polyhedron stands in its block by its number.
    counts = np.where(solid, 1, np.diff(offsets))
    rows = offsets_of(counts)
    vertices = np.empty(rows[-1], dtype=np.int64)
    corners = np.repeat(~solid, counts)
    vertices[corners] = rows_in_order(offsets, nodes, np.flatnonzero(~solid))[1]
    vertices[~corners] = np.arange(np.count_nonzero(solid))
    blocks = grouped(types, rows, vertices, data=data)
    blocks.polyhedra = polyhedra
    return blocks


def _faces(arrays: Mapping[str, Ints], solid: Any) -> Listed:
    if "polyhedron_to_faces" in arrays:
        return _faces_by_rows(arrays, solid)
    if {"faces", "faceoffsets"} - set(arrays):
        raise MeshError("it has no lists of faces for its polyhedra.")
    return _faces_by_stream(arrays, solid)


def _faces_by_rows(arrays: Mapping[str, Ints], solid: Any) -> Listed:
    names = ("face_offsets", "face_connectivity", "polyhedron_offsets", "polyhedron_to_faces")
    if set(names) - set(arrays):
        raise MeshError("its faces are incomplete.")
    ends, nodes, cell_ends, numbers = (arrays[name] for name in names)
    offsets, cell_offsets = np.concatenate([[0], ends]), np.concatenate([[0], cell_ends])
    sound = len(cell_ends) == len(solid) and all((x[1:] >= x[:-1]).all() for x in (offsets, cell_offsets))
    sound = sound and offsets[-1] <= len(nodes) and cell_offsets[-1] <= len(numbers)
    if not sound or not ((numbers >= 0) & (numbers < len(ends))).all():
        raise MeshError("its lists of faces are damaged: offsets do not increase, or lead beyond the end.")
    rows, faces = rows_in_order(cell_offsets, numbers, np.flatnonzero(solid))
    return Listed(*rows_in_order(offsets, nodes, faces), rows)


def _faces_by_stream(arrays: Mapping[str, Ints], solid: Any) -> Listed:
    stream, ends = arrays["faces"], arrays["faceoffsets"]
    damaged = MeshError("its lists of faces are damaged: they lead beyond the end, or do not fill their room.")
    if len(ends) != len(solid):
        raise damaged
    ends = ends[solid]
    if not ((ends >= 0) & (ends <= len(stream))).all() or (np.diff(ends) < 2).any():
        raise damaged
    at = np.concatenate([[0], ends[:-1]])
    if (ends < 1).any() or (at >= len(stream)).any():
        raise damaged
    left = stream[at]
    if (left < 1).any() or (left > len(stream)).any():
        raise damaged
    cell_offsets, at = offsets_of(left), at + 1
    starts, counts = np.empty(cell_offsets[-1], dtype=np.int64), np.empty(cell_offsets[-1], dtype=np.int64)
    going = np.arange(len(left))
    for face in range(int(left.max(initial=0))):  # the next face of every cell that has one
        going = going[left[going] > face]
        if (at[going] >= ends[going]).any():
            raise damaged
        count = stream[at[going]]
        starts[cell_offsets[going] + face], counts[cell_offsets[going] + face] = at[going] + 1, count
        if (count < 0).any() or (at[going] + 1 + count > ends[going]).any():
            raise damaged
        at[going] += 1 + count
    if (at != ends).any():
        raise damaged
    return Listed(offsets_of(counts), stream[spans(starts, counts)], cell_offsets)


# Cells in space as files hold them, by their vertices or as polyhedra, and their faces; and back.
#
# Named boundaries are blocks of polygons, marked as lines are in the plane (see `blocks`).


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
