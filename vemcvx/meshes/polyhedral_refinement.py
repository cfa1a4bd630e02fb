"""Local refinement of polyhedral meshes: chosen cells are split, neighbours take new coplanar faces and stay.

HEAD
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, eye_array, vstack

from vemcvx.arrays import Bools, Floats, Ints, brief, flag, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes import local_refinement as plane
from vemcvx.meshes.box import check_cell_data
from vemcvx.meshes.interfaces import Interface, faces_of, on_faces, padded, pairs_of, places_of
from vemcvx.meshes.local_refinement import Kinds, Outlines, Refinement, Splitting, check_marks
from vemcvx.meshes.polygons import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    first_in_row,
    next_corner,
    offsets_of,
    previous_corner,
    rotation,
    rounding,
    rows_in_order,
    same_rows,
    shared_edges,
    smallest_linked,
    spans,
    turned,
)
from vemcvx.meshes.polyhedra import (
    Faces,
    FaceShapes,
    Listed,
    axes_in_planes,
    face_shapes,
    joined_faces,
    listed_faces,
    numbered_faces,
    signs_of,
    volumes_and_centroids,
)
from vemcvx.meshes.tessellation import Mesh, SpaceTessellation, Tessellation

AnyMesh = TypeVar("AnyMesh", bound=Mesh)
SpaceMesh = TypeVar("SpaceMesh", bound=SpaceTessellation)

# Faces of a cell whose normals differ by less, in radians, are of one side.
FLAT = 1e-5
# Of its diameter, by how much a new face may be off its plane; a mesh may have faces of 1e-6.
PLANE = 1e-7
# Of the diameter of a side, pieces that are split although the side is in several pieces.
LARGE = 0.6
# Of the diameter of a cell, by which its centre is at least behind the plane of every face.
BEHIND = 1e-6


# All faces, each as a polygon in its own plane, which is split as the cells of plane meshes are.


@dataclass(frozen=True, eq=False)
class Skin:
    """The faces of all cells, nodes in one place counted as one, and what comes of each when it is split."""

    points: Floats
    faces: Faces
    shapes: FaceShapes
    cell: Ints
    """(n_listed,) cell of each listed face"""
    signs: Floats
    """(n_listed,) 1 where a listed face runs outwards as it is stored"""
    polygons: Tessellation
    """faces in their own planes; its vertices are the corners of faces, numbered through"""
    splitting: Splitting
    centres: Floats
    """(n_faces, 3)"""
    seen: Bools
    """(n_faces,) whether the centre sees all of the face"""
    edge: Ints
    """(n_corners,) number of the edge that starts at each corner"""
    ends: Ints
    """(n_edges, 2) its nodes, the smaller first"""

    @property
    def nodes(self) -> Ints:
        """(n_corners,) the node at each corner."""
        return self.faces.face_vertices


def skin_of(mesh: SpaceTessellation) -> Skin:
    """Lay every face of a mesh into its plane and find where it is to be split."""
    place = places_of(pairs_of(mesh.interfaces), mesh.points)
    faces, shapes = mesh.faces, mesh._face_shapes
    if mesh.interfaces:
        listed = listed_faces(faces)
        faces = joined_faces(listed.offsets, place[listed.vertices], listed.cell_offsets)
        shapes = face_shapes(mesh.points, faces.face_offsets, faces.face_vertices)
    axes, owner = axes_in_planes(shapes), cell_of_corner(faces.face_offsets)
    corners = mesh.points[faces.face_vertices]
    flat = np.einsum("mai,mi->ma", axes[owner, :2], corners - shapes.centroids[owner])
    polygons = Tessellation.unchecked(flat, faces.face_offsets, np.arange(len(flat)))
    splitting = plane.splitting_of(polygons, every=True)
    middles, seen = plane.centres_of(polygons, splitting)
    # To the bit on a side of a box.
    low, high = (f.reduceat(corners, faces.face_offsets[:-1], axis=0) for f in (np.minimum, np.maximum))
    centres = np.clip(shapes.centroids + np.einsum("fai,fa->fi", axes[:, :2], middles), low, high)
    shared = shared_edges(faces.face_offsets, faces.face_vertices, mesh.n_nodes)
    edge = np.empty_like(shared.corners)
    edge[shared.corners] = np.repeat(np.arange(len(shared.first)), shared.counts)
    ends = directed_edges(faces.face_offsets, faces.face_vertices)[shared.corners[shared.first]]
    return Skin(
        points=mesh.points,
        faces=faces,
        shapes=shapes,
        cell=cell_of_corner(faces.cell_offsets),
        signs=signs_of(faces),
        polygons=polygons,
        splitting=splitting,
        centres=centres,
        seen=seen,
        edge=edge,
        ends=np.sort(ends, axis=1),
    )


# Sides of cells: one face, or several that are coplanar; and the straight edges of cells between two sides.


@dataclass(frozen=True, eq=False)
class CellSides:
    """Sides of all cells, and their edges."""

    rows: Ints
    """(n_listed + 1,) where in `corners` each listed face begins"""
    corners: Ints
    """corners of faces, in the order of the listed faces"""
    side: Ints
    """(n_listed,) the side: the first listed face of it"""
    pieces: Ints
    """(n_listed,) of how many faces that consists"""
    outer: Bools
    """(like `corners`) whether the edge that starts there is between two sides of the cell"""
    cell: Ints
    """(x,) cells of the edges between two sides, once a cell"""
    edge: Ints
    chain: Ints
    """(x,) edges of one line of a cell have one number"""
    keys: Ints
    """sorted cell * n_nodes + node, of the nodes on these edges"""
    degrees: Ints
    """how many of them end there"""

    def degree(self, cell: Ints, node: Ints, n_nodes: int) -> Ints:
        """How many edges between sides of a cell end at a node; 0 for those inside of sides, and new ones."""
        wanted = np.where(node < n_nodes, cell * n_nodes + node, -1)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[at] == wanted, self.degrees[at], 0)


def sides_of(skin: Skin) -> CellSides:
    """Join the coplanar faces of all cells, and the edges between their sides to lines."""
    faces, n_nodes, n_listed = skin.faces, len(skin.points), len(skin.cell)
    rows, corners = rows_in_order(faces.face_offsets, np.arange(len(skin.nodes)), faces.cell_faces)
    listing = cell_of_corner(rows)
    cell, edge = skin.cell[listing], skin.edge[corners]
    pairs = np.argsort(cell * len(skin.ends) + edge, kind="stable").reshape(-1, 2)
    one, other = listing[pairs].T
    normals = skin.signs[:, None] * skin.shapes.normals[faces.cell_faces]
    along = np.einsum("ij,ij->i", normals[one], normals[other])
    near = np.flatnonzero(along > 0.9)
    flat = np.linalg.norm(np.cross(normals[one[near]], normals[other[near]]), axis=1) <= FLAT
    side = np.arange(n_listed)
    if flat.any():
        side = smallest_linked(np.column_stack([one, other])[near[flat]], n_listed)
    between = pairs[side[one] != side[other]]
    outer = np.zeros(len(corners), dtype=bool)
    outer[between] = True
    first = between[:, 0]
    cell, edge = cell[first], edge[first]
    keys, number, degrees = np.unique(
        (cell[:, None] * n_nodes + skin.ends[edge]).ravel(), return_inverse=True, return_counts=True
    )
    order = np.argsort(number.ravel(), kind="stable") // 2
    begin = offsets_of(degrees)[:-1][degrees == 2]
    chain = smallest_linked(np.column_stack([order[begin], order[begin + 1]]), len(edge))
    return CellSides(
        rows=rows,
        corners=corners,
        side=side,
        pieces=np.bincount(side, minlength=n_listed)[side],
        outer=outer,
        cell=cell,
        edge=edge,
        chain=chain,
        keys=keys,
        degrees=degrees,
    )


class Corners(NamedTuple):
    """Corners of sides of cells, each with the part of its side that becomes a face of the child there."""

    listed: Ints
    """listed face of which the part is, or which it is"""
    node: Ints
    before: Ints
    """the middle of the edge before the corner, around the side as its faces are stored"""
    after: Ints
    centre: Ints
    """the centre of the side, -1 in triangles"""
    row: Ints
    """the first of the new faces that make the part"""
    rows: Ints
    """how many they are"""


def corners_in_pieces(skin: Skin, sides: CellSides) -> tuple[Corners, Bools]:
    """Corners of sides that consist of the parts into which they would be split; and which listed faces are of such.

    These are n quadrilaterals about a common node, each with one corner of the side, or four triangles, one of which
    has none.
    """
    n_nodes, many = len(skin.points), np.flatnonzero(sides.pieces > 1)
    parted = np.zeros(len(skin.cell), dtype=bool)
    rows, position = rows_in_order(sides.rows, np.arange(len(sides.corners)), many)
    before = position[previous_corner(rows)] if len(position) else position
    bend = skin.splitting.bend[sides.corners[position]]
    own = (bend & sides.outer[position] & sides.outer[before])[bend]
    owner = cell_of_corner(rows)[bend]
    counts = np.bincount(owner, minlength=len(many))
    node, ring = skin.nodes[sides.corners[position[bend]]], offsets_of(counts)
    own_counts = np.bincount(owner, own, minlength=len(many)).astype(np.int64)
    side = sides.side[many]

    def all_of(flags: Bools) -> Bools:
        bad = np.bincount(side, ~flags, minlength=len(skin.cell))
        return bad[side] == 0

    corner = np.flatnonzero(own)
    piece = owner[corner]
    place, size = corner - ring[piece], counts[piece]
    around = [node[ring[piece] + (place + step) % size] for step in (-1, 0, 1, 2)]
    cell = skin.cell[many[piece]]
    on_line = sides.degree(cell, around[0], n_nodes) == 2
    on_line &= sides.degree(cell, around[2], n_nodes) == 2
    good = np.ones(len(many), dtype=bool)
    good[piece[~on_line]] = False
    # Quadrilaterals about one node inside.
    centre = np.full(len(many), -1)
    centre[piece] = around[3]
    lowest, highest = np.full(len(skin.cell), len(skin.points)), np.full(len(skin.cell), -1)
    np.minimum.at(lowest, side, centre)
    np.maximum.at(highest, side, centre)
    inside = sides.degree(skin.cell[many], centre, n_nodes) == 0
    quads = all_of(good & (counts == 4) & (own_counts == 1) & inside) & (lowest == highest)[side]
    quads &= sides.pieces[many] > 2
    bare = np.bincount(side, own_counts == 0, minlength=len(skin.cell))[side]
    triangles = all_of(good & (counts == 3) & (own_counts <= 1)) & (bare == 1) & (sides.pieces[many] == 4)
    parted[many[quads | triangles]] = True
    kept = parted[many[piece]]
    found = Corners(
        many[piece], around[1], around[0], around[2], np.where(quads[piece], around[3], -1), *np.empty((2, 0), int)
    )
    return Corners(*(values[kept] for values in found[:5]), *found[5:]), parted


# Grading. A side of an unrefined cell has one face, or those into which it would be split itself; a line between two
# of its sides has one node inside at most. A cell that would get more is refined, too, and so on.


@dataclass(frozen=True, eq=False)
class Asked:
    """What marked cells ask for."""

    skin: Skin
    sides: CellSides
    wants: Bools
    """(n_listed,) faces that their cell would have split"""

    def faces(self, marked: Bools) -> Bools:
        """Faces to split, (n_faces,)."""
        split = np.zeros(len(self.skin.seen), dtype=bool)
        split[self.skin.faces.cell_faces[self.wants & marked[self.skin.cell]]] = True
        return split

    def edges(self, split: Bools) -> Bools:
        """Edges that are halved with given faces (n_faces,), (n_edges,)."""
        skin, halved = self.skin, np.zeros(len(self.skin.ends), dtype=bool)
        owner = cell_of_corner(skin.faces.face_offsets)
        halved[skin.edge[skin.splitting.edge & (split & skin.seen)[owner]]] = True
        return halved

    def closed(self, marked: Bools) -> Bools:
        """Cells marked, and those that would get more faces or nodes than they may have."""
        skin, sides, marked = self.skin, self.sides, marked.copy()
        nodes = np.bincount(sides.chain) - 1
        while True:
            split = self.faces(marked)
            halved = self.edges(split)
            new = np.bincount(sides.chain, halved[sides.edge])
            crowded = ((new > 0) & (new + nodes > 1))[sides.chain]
            before = np.count_nonzero(marked)
            marked[sides.cell[crowded]] = True
            marked[skin.cell[split[skin.faces.cell_faces] & (sides.pieces > 1)]] = True
            if np.count_nonzero(marked) == before:
                return marked


def asked_of(skin: Skin, sides: CellSides, parted: Bools) -> Asked:
    """Single faces are split, and of sides in several pieces those that are nearly as large as all."""
    sizes = skin.polygons.diameters[skin.faces.cell_faces]
    wants = sides.pieces == 1
    several = np.flatnonzero(~wants & ~parted)
    if len(several):
        listing = cell_of_corner(sides.rows)
        chosen = np.zeros(len(wants), dtype=bool)
        chosen[several] = True
        at = chosen[listing]
        x, of = skin.points[skin.nodes[sides.corners[at]]], sides.side[listing[at]]
        low, high = np.full((len(wants), 3), np.inf), np.full((len(wants), 3), -np.inf)
        np.minimum.at(low, of, x)
        np.maximum.at(high, of, x)
        whole = np.linalg.norm(high - low, axis=1)
        wants[several] = sizes[several] > LARGE * whole[sides.side[several]]
    return Asked(skin, sides, wants)


# Split faces.


@dataclass(frozen=True, eq=False)
class Cut:
    """New faces, and the new nodes on edges and in faces.

    Nodes are numbered: those in the old places, middles of edges, centres of faces, centres of cells.
    """

    outlines: Outlines
    """old faces with the new middles, of corners, middles and centres numbered as below"""
    kinds: Kinds
    number: Ints
    """the node that is each corner of an old face, each middle and each centre"""
    offsets: Ints
    vertices: Ints
    first: Ints
    """(n_faces + 1,) where the new faces of each begin"""
    halved: Ints
    """(h,) edges with a new middle"""
    centred: Ints
    """(c,) faces with a new centre"""
    points: Floats
    """of old nodes, middles and centres"""


def cut_faces(asked: Asked, marked: Bools) -> Cut:
    """Split the faces that marked cells ask for."""
    skin = asked.skin
    split = asked.faces(marked)
    halved = np.flatnonzero(asked.edges(split))
    plane.check_lengths(skin.points, skin.ends[halved])
    n_nodes, n_corners = len(skin.points), len(skin.nodes)
    middle = np.full(len(skin.ends), -1)
    middle[halved] = n_corners + np.arange(len(halved))
    kinds = Kinds.of(skin.splitting, split, skin.seen)
    outlines = plane.outlines_of(skin.polygons, skin.splitting, kinds, middle[skin.edge])
    offsets, vertices, parents = plane.children_of(outlines, kinds, skin.polygons.points, n_corners + len(halved))
    centred = np.flatnonzero(kinds.centred)
    number = np.concatenate([skin.nodes, n_nodes + np.arange(len(halved) + len(centred))])
    middles = skin.points[skin.ends[halved]].mean(axis=1)
    return Cut(
        outlines=outlines,
        kinds=kinds,
        number=number,
        offsets=offsets,
        vertices=number[vertices],
        first=offsets_of(np.bincount(parents, minlength=len(skin.seen))),
        halved=halved,
        centred=centred,
        points=np.concatenate([skin.points, middles, skin.centres[centred]]),
    )


def corners_of_cut(skin: Skin, cut: Cut, listed: Ints) -> tuple[Corners, Bools]:
    """Corners of single faces that have been split; and which of these have one corner in each part."""
    outlines = cut.outlines
    bend = np.append(skin.splitting.bend, np.zeros(len(cut.number) - len(skin.nodes), dtype=bool))[outlines.nodes]
    bends, before = np.flatnonzero(bend), offsets_of(bend.astype(np.int64))
    # Marks of faces in the order of the faces, as their parts are.
    begin = offsets_of(np.bincount(outlines.cell, minlength=len(skin.seen)))
    inside = before[outlines.stop] - before[np.minimum(outlines.marks + 1, len(bend))]
    bad = np.bincount(outlines.cell, inside != 1, minlength=len(skin.seen)) > 0
    regular = ~bad & (cut.kinds.centred | cut.kinds.medial)
    face = skin.faces.cell_faces[listed]
    good = regular[face]
    listed, face = listed[good], face[good]
    counts = np.diff(begin)[face]
    mark = spans(begin[face], counts)
    owner = np.repeat(face, counts)
    node = bends[before[np.minimum(outlines.marks[mark] + 1, len(bend))]] if len(mark) else mark
    known = cut.number[outlines.nodes]
    n_middles = len(skin.points) + len(cut.halved)
    centre = np.full(len(skin.seen), -1)
    centre[cut.centred] = n_middles + np.arange(len(cut.centred))
    return Corners(
        listed=np.repeat(listed, counts),
        node=known[node],
        before=known[outlines.marks[mark]],
        after=known[outlines.follower[mark]],
        centre=centre[owner],
        row=cut.first[owner] + mark - begin[owner],
        rows=np.ones(len(mark), dtype=np.int64),
    ), good


# Kinds of cells.


@dataclass(frozen=True, eq=False)
class Solids:
    """Marked cells whose sides are all split at their corners, by these, and the kind of each cell."""

    corners: Corners
    """oriented outwards"""
    cell: Ints
    side: Ints
    vertex: Ints
    """(k,) the vertex of a cell that each corner is at: numbers of pairs of both"""
    follower: Ints
    """(k,) the corner of the next side around the vertex, which has the edge after this one before it"""
    kind: Ints
    """(n_cells,)"""
    centre: Floats
    """(n_cells, 3), of cells that are split about it"""


STAYS, CONES, VERTICES, TETRA, OCTA, PYRAMID, WEDGE = range(7)


def solids_of(asked: Asked, cut: Cut, marked: Bools, parted: Bools) -> Solids:
    """Tell the kinds of marked cells."""
    skin, sides = asked.skin, asked.sides
    single = np.flatnonzero(marked[skin.cell] & (sides.pieces == 1))
    one, good = corners_of_cut(skin, cut, single)
    bad = np.zeros(len(skin.cell), dtype=bool)
    bad[single[~good]] = True
    bad[(sides.pieces > 1) & ~parted] = True
    n_cells = len(skin.faces.cell_offsets) - 1
    whole = marked & (np.bincount(skin.cell, bad, minlength=n_cells) == 0)
    two = corners_in_pieces(skin, sides)[0]
    face = skin.faces.cell_faces[two.listed]
    two = two._replace(row=cut.first[face], rows=np.diff(cut.first)[face])
    corners = Corners(*(np.concatenate(pair) for pair in zip(one, two, strict=True)))
    corners = _of(corners, whole[skin.cell[corners.listed]])
    inwards = skin.signs[corners.listed] < 0.0
    before, after = corners.before, corners.after
    corners = corners._replace(before=np.where(inwards, after, before), after=np.where(inwards, before, after))
    return _with_kinds(asked, cut, marked, _around_vertices(skin, sides, corners))


def _of(corners: Corners, kept: Bools) -> Corners:
    return Corners(*(values[kept] for values in corners))


def _around_vertices(skin: Skin, sides: CellSides, corners: Corners) -> tuple[Corners, Ints, Ints]:
    """The corners of cells at whose vertices they close, with the numbers of vertices and followers."""
    n_nodes, n_cells = len(skin.points), len(skin.faces.cell_offsets) - 1
    cell = skin.cell[corners.listed]
    places, vertex = np.unique(cell * n_nodes + corners.node, return_inverse=True)
    most = int(max(corners.before.max(initial=0), corners.after.max(initial=0))) + 1
    wanted, there = vertex * most + corners.after, vertex * most + corners.before
    order = np.argsort(there, kind="stable")
    at = np.searchsorted(there[order], wanted)
    follower = order[np.minimum(at, max(len(order) - 1, 0))]
    bad = there[follower] != wanted
    bad |= np.bincount(follower, minlength=len(follower)) != 1
    label = smallest_linked(np.column_stack([np.arange(len(follower)), follower]), len(follower))
    least = np.full(len(places), len(label))
    np.minimum.at(least, vertex, label)
    bad |= label != least[vertex]
    bad |= sides.degree(cell, corners.node, n_nodes) != np.bincount(vertex, minlength=len(places))[vertex]
    ends = np.bincount(sides.keys[sides.degrees > 2] // n_nodes, minlength=n_cells)
    odd = np.bincount(places // n_nodes, minlength=n_cells) != ends
    odd[cell[bad]] = True
    kept = ~odd[cell]
    place = np.cumsum(kept) - 1
    return _of(corners, kept), vertex[kept], place[follower[kept]]


def _with_kinds(asked: Asked, cut: Cut, marked: Bools, closed: tuple[Corners, Ints, Ints]) -> Solids:
    skin, (corners, vertex, follower) = asked.skin, closed
    n_cells = len(marked)
    cell, side = skin.cell[corners.listed], asked.sides.side[corners.listed]

    def counted(values: Ints, flags: Bools) -> Ints:
        """How many different values each cell has, of the flagged corners."""
        return np.bincount(cell[flags][np.unique(values[flags], return_index=True)[1]], minlength=n_cells)

    triangle, any_one = corners.centre < 0, np.ones(len(cell), dtype=bool)
    triangles, others = counted(side, triangle), counted(side, ~triangle)
    n_vertices, degree = counted(vertex, any_one), np.zeros(n_cells, dtype=np.int64)
    np.maximum.at(degree, cell, np.bincount(vertex)[vertex] if len(vertex) else vertex)
    concave = ~skin.splitting.convex[skin.faces.cell_faces]
    convex = np.bincount(skin.cell, concave, minlength=n_cells) == 0
    kind = np.where(marked, CONES, STAYS)
    kind[(triangles == 4) & (others == 0) & (n_vertices == 4)] = TETRA
    kind[(triangles == 8) & (others == 0) & (n_vertices == 6) & (degree == 4)] = OCTA
    kind[(triangles == 4) & (others == 1) & (n_vertices == 5) & convex] = PYRAMID
    kind[(triangles == 2) & (others == 3) & (n_vertices == 6) & convex] = WEDGE
    kind[(triangles == 0) & (others > 3)] = VERTICES
    found = Solids(corners, cell, side, vertex, follower, kind, _centres(skin, cut, kind, closed, others))
    bent = cell[_not_plane(found, cut)]
    kind[bent] = CONES
    behind = _behind(skin, found.centre)
    kind[skin.cell[behind & np.isin(kind[skin.cell], (VERTICES, OCTA))]] = CONES
    coned = kind == CONES
    centre = np.where(coned[:, None], _centroids(skin), found.centre)
    hidden = np.flatnonzero(_behind(skin, centre) & coned[skin.cell])
    if len(hidden):
        k = hidden[0]
        raise MeshError(
            f"cell {skin.cell[k]} is not star-shaped about its centroid, which does not see the inside of its face at "
            f"{skin.shapes.centroids[skin.faces.cell_faces[k]]}: it cannot be refined; cut it into convex cells first."
        )
    return replace(found, centre=centre)


def _centroids(skin: Skin) -> Floats:
    return volumes_and_centroids(skin.shapes, skin.faces.cell_offsets, skin.faces.cell_faces, skin.signs)[1]


def _behind(skin: Skin, centre: Floats) -> Bools:
    """A mask of the listed faces whose inside the centres of their cells do not see."""
    face = skin.faces.cell_faces
    arm = skin.shapes.centroids[face] - centre[skin.cell]
    size = np.sqrt(np.maximum.reduceat(np.einsum("ij,ij->i", arm, arm), skin.faces.cell_offsets[:-1]))
    height = skin.signs * np.einsum("ij,ij->i", arm, skin.shapes.normals[face])
    hidden: Bools = height <= BEHIND * size[skin.cell]
    return hidden


def _centres(skin: Skin, cut: Cut, kind: Ints, closed: tuple[Corners, Ints, Ints], others: Ints) -> Floats:
    """Means of vertices, but where there are more than six sides or not all have four corners: nearest to the planes.

    These are the planes through the middle of an edge and the centres of the sides beside it.
    """
    corners, vertex, follower = closed
    n_cells, cell = len(kind), skin.cell[corners.listed]
    once = np.unique(vertex, return_index=True)[1]
    counts = np.maximum(np.bincount(cell[once], minlength=n_cells), 1)
    origin = skin.points[skin.nodes[skin.faces.face_offsets[skin.faces.cell_faces[skin.faces.cell_offsets[:-1]]]]]
    arms = skin.points[corners.node[once]] - origin[cell[once]]
    means = np.column_stack([np.bincount(cell[once], arm, n_cells) for arm in arms.T]) / counts[:, None] + origin
    many = (kind == VERTICES) & ((others != 6) | (counts != 8))
    some = np.flatnonzero(many[cell])
    if not len(some):
        return means
    of = cell[some]
    at, normal = _middle_planes(corners, follower, cut.points, some)
    height = np.einsum("ij,ij->i", normal, at - means[of])
    number = np.cumsum(many) - 1
    matrix = np.zeros((np.count_nonzero(many), 3, 3))
    right = np.zeros((len(matrix), 3))
    np.add.at(matrix, number[of], normal[:, :, None] * normal[:, None, :])
    np.add.at(right, number[of], normal * height[:, None])
    means[many] += np.einsum("cij,cj->ci", np.linalg.pinv(matrix, hermitian=True), right)
    return means


def _middle_planes(corners: Corners, follower: Ints, points: Floats, some: Ints) -> tuple[Floats, Floats]:
    """The middle of the edge after each corner, and the normal of the plane through it and the centres beside it."""
    at = points[corners.after[some]]
    one, other = (points[corners.centre[k]] - at for k in (some, follower[some]))
    normal = np.cross(one, other)
    length = np.linalg.norm(normal, axis=1)
    return at, normal / np.where(length > 0.0, length, 1.0)[:, None]


def _not_plane(solids: Solids, cut: Cut) -> Ints:
    """Corners at which a new quadrilateral inside would not be plane."""
    corners, follower, kind = solids.corners, solids.follower, solids.kind[solids.cell]
    some = np.flatnonzero(kind == VERTICES)
    at, normal = _middle_planes(corners, follower, cut.points, some)
    arm = solids.centre[solids.cell[some]] - at
    off = np.abs(np.einsum("ij,ij->i", normal, arm)) > PLANE * np.linalg.norm(arm, axis=1)
    bent = some[off | (np.einsum("ij,ij->i", normal, normal) < 0.5)]
    some = np.flatnonzero((kind == WEDGE) & (corners.centre < 0))
    one = follower[some]
    quads = np.stack(
        [corners.before[some], corners.after[some], corners.centre[one], corners.centre[follower[one]]], axis=1
    )
    x = cut.points[quads]
    arms = x[:, 1:] - x[:, :1]
    volume = np.abs(np.einsum("ij,ij->i", arms[:, 2], np.cross(arms[:, 0], arms[:, 1])))
    return np.concatenate([bent, some[volume > PLANE * np.prod(np.linalg.norm(arms, axis=2), axis=1)]])


# Children.


class Outer(NamedTuple):
    """New faces on the skin of old cells, for children by keys that are unique within their parent."""

    key: Ints
    listed: Ints
    row: Ints
    rows: Ints


class Inner(NamedTuple):
    """New faces between children."""

    cell: Ints
    key: Ints
    offsets: Ints
    vertices: Ints

    @classmethod
    def of(cls, cell: Ints, key: Ints, *columns: Ints) -> Inner:
        """Faces with the same number of vertices, column by column."""
        vertices = np.column_stack(columns)
        return cls(cell, key, np.arange(len(cell) + 1) * len(columns), vertices.ravel())


def joined(parts: list[Inner]) -> Inner:
    """All of several lots."""
    counts = [np.diff(part.offsets) for part in parts]
    cell, key, vertices = (np.concatenate([getattr(p, name) for p in parts]) for name in ("cell", "key", "vertices"))
    return Inner(cell, key, offsets_of(np.concatenate(counts)), vertices)


def regular_children(asked: Asked, cut: Cut, solids: Solids, about: Ints) -> tuple[Outer, Inner]:
    """Children of all cells but those that stay or fall into cones; about (n_cells,) are the nodes in their centres."""
    corners, cell, side, vertex = solids.corners, solids.cell, solids.side, solids.vertex
    kind, many = solids.kind[cell], int(vertex.max(initial=0)) + 1
    n_listed, to = len(asked.skin.cell), solids.follower
    at_side, last = many + side, np.full(len(cell), many + n_listed)
    node, before, after, centre = corners.node, corners.before, corners.after, corners.centre
    parts: list[Inner] = []

    def add(some: Ints, key: Ints, *columns: Ints) -> None:
        parts.append(Inner.of(cell[some], key[some], *columns))

    # At each vertex a cell between its own edges, halved, and the centres.
    i = np.flatnonzero(kind == VERTICES)
    add(i, vertex, centre[i], after[i], centre[to[i]], about[cell[i]])
    # A tetrahedron at each vertex, and an octahedron between them.
    first = np.unique(vertex, return_index=True)[1]
    i = first[kind[first] == TETRA]
    cap = [after[i], after[to[i]], after[to[to[i]]]]
    add(i, vertex, *cap)
    add(i, last, *cap[::-1])
    # An octahedron at each vertex, a tetrahedron on each face.
    i = np.flatnonzero(kind == OCTA)
    add(i, vertex, before[i], after[i], about[cell[i]])
    add(i, at_side, after[i], before[i], about[cell[i]])
    # Pyramids at all vertices and upside down on the base, tetrahedra on the other faces.
    base = np.zeros(len(kind) and int(cell.max()) + 1, dtype=np.int64)
    quads = (kind == PYRAMID) & (centre >= 0)
    base[cell[quads]] = centre[quads]
    at_base = np.zeros(many, dtype=bool)
    at_base[vertex[quads]] = True
    i = np.flatnonzero((kind == PYRAMID) & (centre < 0))
    add(i, at_side, after[i], before[i], base[cell[i]])
    add(i, np.where(at_base[vertex], vertex, last), before[i], after[i], base[cell[i]])
    i = first[(kind[first] == PYRAMID) & ~at_base[vertex[first]]]
    cap = [after[i], after[to[i]], after[to[to[i]]], after[to[to[to[i]]]]]
    add(i, vertex, *cap)
    add(i, last, *cap[::-1])
    # Wedges below and above the middle of a wedge, at each vertex and on the faces.
    i = np.flatnonzero((kind == WEDGE) & (centre < 0))
    one, other = centre[to[i]], centre[to[to[i]]]
    add(i, vertex, before[i], after[i], one, other)
    add(i, vertex, one, after[to[i]], other)
    add(i, at_side, other, one, after[i], before[i])
    total = np.bincount(side[i], one, minlength=n_listed).astype(np.int64)
    k = np.unique(side[i], return_index=True)[1]
    add(i[k], at_side, one[k], other[k], total[side[i[k]]] - one[k] - other[k])
    outer = Outer(vertex, corners.listed, corners.row, corners.rows)
    middle = _middle_parts(asked, cut, solids)
    on = solids.kind[asked.skin.cell[middle.listed]]
    middle = middle._replace(key=np.where(on == TETRA, many + n_listed, many + asked.sides.side[middle.listed]))
    both = Outer(*(np.concatenate(pair) for pair in zip(outer, middle, strict=True)))
    kept = np.isin(solids.kind[asked.skin.cell[both.listed]], (VERTICES, TETRA, OCTA, PYRAMID, WEDGE))
    inner = joined(parts)
    return Outer(*(values[kept] for values in both)), _with_hanging(asked, cut, inner)


def _middle_parts(asked: Asked, cut: Cut, solids: Solids) -> Outer:
    """The middle of the four triangles of each triangular side."""
    corners, face = solids.corners, asked.skin.faces.cell_faces
    triangle = corners.centre < 0
    side, at = np.unique(solids.side[triangle], return_index=True)
    listed = corners.listed[triangle][at]
    single = asked.sides.pieces[listed] == 1
    # Of sides in four pieces, that one which has no corner of the side.
    bare, wanted = np.ones(len(face), dtype=bool), np.zeros(len(face), dtype=bool)
    bare[corners.listed] = False
    wanted[side[~single]] = True
    one, two = listed[single], np.flatnonzero(wanted[asked.sides.side] & bare)
    row = np.append(cut.first[face[one]] + 3, cut.first[face[two]])
    rows = np.append(np.ones(len(one), dtype=np.int64), np.diff(cut.first)[face[two]])
    listed = np.append(one, two)
    return Outer(np.zeros_like(listed), listed, row, rows)


def _with_hanging(asked: Asked, cut: Cut, inner: Inner) -> Inner:
    """New faces with the nodes that hang on their edges, where these are edges of pieces of sides already."""
    skin, outlines = asked.skin, cut.outlines
    pieces = np.unique(skin.faces.cell_faces[asked.sides.pieces > 1])
    if not len(pieces):
        return inner
    rows, position = rows_in_order(outlines.offsets, np.arange(len(outlines.nodes)), pieces)
    node = outlines.nodes[position]
    bend = np.append(skin.splitting.bend, np.zeros(len(cut.number) - len(skin.nodes), dtype=bool))[node]
    turn = rotation(rows, first_in_row(bend, rows))
    node, bend = cut.number[node[turn]], bend[turn]
    begin = np.flatnonzero(bend)
    many = np.diff(np.append(begin, len(bend))) - 1
    owner = cell_of_corner(rows)[begin]
    last = np.append(owner[1:] != owner[:-1], True)
    end = np.where(last, rows[owner], np.append(begin[1:], 0))
    kept = many > 0
    ends = np.column_stack([node[begin], node[end]])[kept]
    if not len(ends):
        return inner
    begin, many = begin[kept] + 1, many[kept]
    count = int(inner.vertices.max()) + 1
    keys, at = np.unique(edge_keys(ends, count), return_index=True)
    edges = directed_edges(inner.offsets, inner.vertices)
    wanted = edge_keys(edges, count)
    found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    corner = np.flatnonzero(keys[found] == wanted)
    line = at[found[corner]]
    new, size = spans(begin[line], many[line]), offsets_of(many[line])
    mirrored = np.repeat(begin[line] + begin[line] + many[line] - 1, many[line]) - new
    backwards = np.repeat(ends[line, 0] != edges[corner, 0], many[line])
    vertices = np.insert(inner.vertices, np.repeat(corner + 1, many[line]), node[np.where(backwards, mirrored, new)])
    more = np.bincount(cell_of_corner(inner.offsets)[corner], many[line], minlength=len(inner.cell))
    assert size[-1] == more.sum()
    return inner._replace(offsets=offsets_of(np.diff(inner.offsets) + more.astype(np.int64)), vertices=vertices)


def cones(asked: Asked, cut: Cut, solids: Solids, about: Ints) -> tuple[Outer, Inner]:
    """Children of cells that are joined to their centre, one a new face."""
    skin = asked.skin
    listed = np.flatnonzero(solids.kind[skin.cell] == CONES)
    face = skin.faces.cell_faces[listed]
    counts = np.diff(cut.first)[face]
    row, listed = spans(cut.first[face], counts), np.repeat(listed, counts)
    offsets, nodes = rows_in_order(cut.offsets, cut.vertices, row)
    nodes = turned(offsets, nodes, skin.signs[listed] < 0.0)
    of = cell_of_corner(offsets)
    cell = skin.cell[listed]
    degree = np.unique(cell[of] * len(cut.points) + nodes, return_inverse=True, return_counts=True)[1:]
    x = cut.points[nodes]
    step = x[next_corner(offsets)] - x if len(x) else x
    back = step[previous_corner(offsets)] if len(x) else x
    length, shorter = np.linalg.norm(step, axis=1), np.linalg.norm(back, axis=1)
    sine = np.linalg.norm(np.cross(back, step), axis=1)
    slack = 1e-6 * length * shorter + (rounding(x) if len(x) else length) * (length + shorter)
    bend = (sine > slack) | (np.einsum("ij,ij->i", back, step) <= 0.0) | (degree[1][degree[0]] > 2)
    if len(x):
        nodes, bend = (values[rotation(offsets, first_in_row(bend, offsets))] for values in (nodes, bend))
    begin = np.flatnonzero(bend)
    owner = of[begin]
    last = np.append(owner[1:] != owner[:-1], True)[: len(owner)]
    after = np.append(begin[1:], 0)[: len(owner)]
    stop, end = np.where(last, offsets[owner + 1], after), np.where(last, offsets[owner], after)
    pool, top = np.append(nodes, about[cell]), len(nodes) + owner
    starts, many = np.column_stack([begin, end, top]), np.column_stack([stop - begin, *np.ones((2, len(owner)), int)])
    rows = offsets_of(many.sum(axis=1))
    vertices = pool[spans(starts.ravel(), many.ravel())]
    vertices = turned(rows, vertices, np.ones(len(owner), dtype=bool))
    key = np.arange(len(listed))
    return Outer(key, listed, row, np.ones_like(row)), Inner(cell[owner], key[owner], rows, vertices)


# The refined mesh.


class Nodes(NamedTuple):
    """New nodes, numbered from n_nodes: middles of edges, centres of faces, centres of cells; at interfaces doubled."""

    ends: Ints
    """(e, 2) nodes of the old mesh that edges halved are between"""
    faces: Ints
    """(f,) faces of the old mesh with a centre"""
    cells: Ints
    """(c,) cells with a centre"""
    points: Floats
    """of all nodes, old ones first"""


def own_nodes(mesh: SpaceTessellation, skin: Skin, cut: Cut, cell: Ints, number: Ints) -> tuple[Ints, Ints, Ints]:
    """Of corners (m,) of children of cells (m,) the nodes of the bodies to which these belong.

    Besides, the ends (e, 2) of edges that are halved, and faces (f,) with a centre. Corners are numbered as in `Cut`.
    """
    n_nodes, n_faces = mesh.n_nodes, len(skin.seen)
    stops = n_nodes + np.cumsum([0, len(cut.halved), len(cut.centred)])
    old, middle, centre, inner = (np.flatnonzero(np.searchsorted(stops, number, side="right") == k) for k in range(4))
    offsets, nodes = mesh.cell_nodes
    key = cell_of_corner(offsets) * n_nodes + places_of(pairs_of(mesh.interfaces), mesh.points)[nodes]
    order = np.argsort(key)

    def own(cells: Ints, place: Ints) -> Ints:
        found: Ints = nodes[order[np.searchsorted(key, cells * n_nodes + place, sorter=order)]]
        return found

    numbers = np.empty_like(number)
    numbers[old] = own(cell[old], number[old])
    ends = skin.ends[cut.halved[number[middle] - stops[0]]]
    ends = np.sort(np.column_stack([own(cell[middle], end) for end in ends.T]), axis=1)
    found, at = np.unique(ends[:, 0] * n_nodes + ends[:, 1], return_inverse=True)
    numbers[middle] = n_nodes + at
    key = skin.cell * n_faces + skin.faces.cell_faces
    order = np.argsort(key)
    wanted = cell[centre] * n_faces + cut.centred[number[centre] - stops[1]]
    faces, at = np.unique(mesh.cell_faces[order[np.searchsorted(key, wanted, sorter=order)]], return_inverse=True)
    numbers[centre] = n_nodes + len(found) + at
    numbers[inner] = number[inner] + n_nodes + len(found) + len(faces) - stops[2]
    return numbers, np.column_stack(np.divmod(found, n_nodes)), faces


def refined(mesh: SpaceMesh, marked: Bools, balance: bool) -> tuple[SpaceMesh, Ints, Nodes]:
    """The refined mesh, the parents of its cells, and its new nodes."""
    skin = skin_of(mesh)
    sides = sides_of(skin)
    parted = corners_in_pieces(skin, sides)[1]
    asked = asked_of(skin, sides, parted)
    marked = asked.closed(marked) if balance else marked
    cut = cut_faces(asked, marked)
    solids = solids_of(asked, cut, marked, parted)
    inside = np.flatnonzero(np.isin(solids.kind, (CONES, VERTICES, OCTA)))
    about = np.full(mesh.n_cells, -1)
    about[inside] = len(cut.points) + np.arange(len(inside))
    lots = [regular_children(asked, cut, solids, about), cones(asked, cut, solids, about)]
    stays = np.flatnonzero(solids.kind[skin.cell] == STAYS)
    face = skin.faces.cell_faces[stays]
    outer = [*(lot[0] for lot in lots), Outer(np.zeros_like(stays), stays, cut.first[face], np.diff(cut.first)[face])]
    whole = Outer(*(np.concatenate(values) for values in zip(*outer, strict=True)))
    return _assembled(mesh, skin, cut, whole, joined([lot[1] for lot in lots]), (inside, solids.centre[inside]))


def _assembled(
    mesh: SpaceMesh, skin: Skin, cut: Cut, outer: Outer, inner: Inner, centres: tuple[Ints, Floats]
) -> tuple[SpaceMesh, Ints, Nodes]:
    listed, row = np.repeat(outer.listed, outer.rows), spans(outer.row, outer.rows)
    # New faces of every face of the old mesh; at interfaces there are two in one place.
    merged = np.empty(mesh.n_faces, dtype=np.int64)
    merged[mesh.cell_faces] = skin.faces.cell_faces
    own = offsets_of(np.diff(cut.first)[merged])
    face = mesh.cell_faces[listed]
    outside = own[face] + row - cut.first[merged[face]]
    number = np.append(outside, own[-1] + same_rows(inner.offsets, inner.vertices)[1])
    rows, nodes = rows_in_order(cut.offsets, cut.vertices, row)
    nodes = turned(rows, nodes, skin.signs[listed] < 0.0)
    rows, nodes = np.concatenate([rows, rows[-1] + inner.offsets[1:]]), np.append(nodes, inner.vertices)
    parent = np.append(skin.cell[listed], inner.cell)
    key = np.append(np.repeat(outer.key, outer.rows), inner.key)
    children, child = np.unique(parent * (key.max() + 1) + key, return_inverse=True)
    order = np.argsort(child, kind="stable")
    rows, nodes = rows_in_order(rows, nodes, order)
    ends, faces, points = skin.ends[cut.halved], cut.centred, cut.points
    if mesh.interfaces:
        place = nodes
        nodes, ends, faces = own_nodes(mesh, skin, cut, parent[order][cell_of_corner(rows)], nodes)
        points = np.empty((int(nodes.max()) + 1 - len(centres[0]), 3))
        points[nodes[place < len(cut.points)]] = cut.points[place[place < len(cut.points)]]
        points[: mesh.n_nodes] = mesh.points
    found = Nodes(ends, faces, centres[0], np.concatenate([points, centres[1]]))
    numbers, first, at = np.unique(number[order], return_index=True, return_inverse=True)
    rank = np.empty_like(first)
    rank[np.argsort(first)] = np.arange(len(first))
    joint = numbered_faces(Listed(rows, nodes, offsets_of(np.bincount(child))), np.sort(first), rank[at])
    place = np.full(own[-1], -1)
    place[numbers[numbers < own[-1]]] = rank[numbers < own[-1]]
    made = type(mesh).unchecked(found.points, *joint, box=mesh._box)
    parents = children // (key.max() + 1)
    return _carried(mesh, made, parents, own, place), parents, found


def _carried(mesh: SpaceMesh, made: SpaceMesh, parents: Ints, own: Ints, place: Ints) -> SpaceMesh:
    """The refined mesh with the names, interfaces and cell data of the old one.

    The faces ``place[own[f]:own[f + 1]]`` are what has become of face f of the boundary.
    """

    def parts(faces: Ints) -> Ints:
        return rows_in_order(own, place, faces)[1]

    data = check_cell_data({name: values[parents] for name, values in mesh.cell_data.items()}, made.n_cells)
    named = {name: read_only(np.sort(parts(faces))) for name, faces in mesh._named.items()}
    sides = {}
    for name, joint in mesh.interfaces.items():
        one, other = (mesh._boundary[faces_of(side, mesh._outlines)] for side in (joint.edges, joint.partners))
        mine, beside = (rows_in_order(made.face_offsets, made.face_vertices, parts(side)) for side in (one, other))
        across = turned(*beside, np.ones(len(beside[0]) - 1, dtype=bool))
        sides[name] = Interface(joint.bodies, padded(*mine), padded(beside[0], across))
    matched = on_faces(sides, made._outlines) if sides else {}
    return made._replace(_named=named, interfaces=MappingProxyType(matched), cell_data=MappingProxyType(data))


def refinement(mesh: AnyMesh, cells: ArrayLike | None = None, *, balance: bool = True) -> Refinement[AnyMesh]:
    """Split the given cells of a mesh, in the plane or in space.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        Any valid mesh.
    cells : (m,) array_like of int or (n_cells,) array_like of bool, optional
        Cells to split; by default all.
    balance : bool
        Also split every cell of which a side would get a new hanging node beside another one, until no side has
        two of them (if none had before). In space: every cell of which an edge would get a second hanging node, or
        a side more faces than it would be split into itself.

    Returns
    -------
    Refinement
        The new mesh, the parent of each cell, and the prolongation of nodal values.

    Raises
    ------
    MeshError
        ``cells`` are not numbers of cells or one bool a cell, or edges to split are as short as rounding; in space, a
        cell is not star-shaped about its centroid.
    """
    if isinstance(mesh, Tessellation):
        return plane.refinement(mesh, cells, balance=balance)
    if not isinstance(mesh, SpaceTessellation):
        raise MeshError(f"refinement: found {brief(mesh)} where a PolygonMesh or PolyhedralMesh is wanted.")
    made, parents, nodes = _checked(mesh, cells, balance)
    return Refinement(made, read_only(parents), prolongation(mesh, nodes))


def _checked(mesh: SpaceMesh, cells: ArrayLike | None, balance: bool) -> tuple[SpaceMesh, Ints, Nodes]:
    balance = flag(balance, "refinement: balance")
    return refined(mesh, check_marks(cells, mesh.n_cells), balance)


def refined_mesh(mesh: SpaceMesh, cells: ArrayLike | None, balance: bool) -> SpaceMesh:
    """The mesh of `refinement` alone."""
    return _checked(mesh, cells, balance)[0]


def prolongation(mesh: SpaceTessellation, nodes: Nodes) -> csr_array:
    """The matrix that takes nodal values of the old mesh to the new nodes: linear functions to themselves.

    Values at centres are those of the linear function that is nearest at the vertices of the face or cell.
    """
    first = mesh.n_nodes + len(nodes.ends)
    middle = first + len(nodes.faces)
    on_faces = rows_in_order(mesh.face_offsets, mesh.face_vertices, nodes.faces)
    in_cells = rows_in_order(*mesh.cell_nodes, nodes.cells)
    means = csr_array(
        (np.full(nodes.ends.size, 0.5), nodes.ends.ravel(), 2 * np.arange(len(nodes.ends) + 1)),
        (len(nodes.ends), mesh.n_nodes),
    )
    blocks = [
        eye_array(mesh.n_nodes),
        means,
        _nearest_linear(mesh.points, *on_faces, nodes.points[first:middle]),
        _nearest_linear(mesh.points, *in_cells, nodes.points[middle:]),
    ]
    return csr_array(vstack(blocks, format="csr"))


def _nearest_linear(points: Floats, offsets: Ints, rows: Ints, at: Floats) -> csr_array:
    """Values at points (m, 3) of linear functions that are nearest to those at a row of nodes each."""
    shape = (len(at), len(points))
    if not len(at):
        return csr_array(shape)
    counts, owner = np.diff(offsets), cell_of_corner(offsets)
    arm = points[rows] - at[owner]
    mean = np.add.reduceat(arm, offsets[:-1], axis=0) / counts[:, None]
    arm -= mean[owner]
    spread = np.add.reduceat(arm[:, :, None] * arm[:, None, :], offsets[:-1], axis=0)
    slope = np.einsum("cij,cj->ci", np.linalg.pinv(spread, rcond=1e-10, hermitian=True), -mean)
    weights = 1.0 / counts[owner] + np.einsum("ki,ki->k", arm, slope[owner])
    return csr_array((weights, rows, offsets), shape=shape)
