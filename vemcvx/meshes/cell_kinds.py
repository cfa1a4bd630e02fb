"""Kinds of polyhedral cells that are to be split, by the corners of their sides; and where they are split.

The sides of most cells are split with one part at each corner, or are in such parts already, made by a finer neighbour:
:class:`Corners` has both alike. Around a vertex of a cell the edge after a corner of one side is the edge before a
corner of the next; where this closes at all vertices, the numbers of sides and vertices tell tetrahedra, octahedra,
pyramids, and wedges. All other cells have a child at each vertex if the new faces between these are plane, or else a
cone on each new face.

The quadrilateral between two children at a vertex has for corners the middle of an edge of the cell, the centres of the
sides beside this, and the centre of the cell, which therefore has to lie in as many planes as there are edges. There is
such a point in parallelepipeds, in prisms over any polygon, and in cells all of whose vertices are on a sphere about a
point that projects to the centres of the sides, as those of Kelvin's foam. It is the mean of the vertices in convex
hexahedra, else the point nearest to all planes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import SINGLE, Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes.cell_sides import Asked, CellSides, Corners, Skin, asked_of
from vemcvx.meshes.local_refinement import Kinds, Outlines, children_of, outlines_of
from vemcvx.meshes.polygons import offsets_of, smallest_linked, spans
from vemcvx.meshes.polyhedra import volumes_and_centroids


@dataclass(frozen=True, eq=False)
class Cut:
    """New faces, and the new nodes on edges and in faces.

    Nodes are numbered: those in the old places, middles of edges, centres of faces, centres of cells.
    """

    outlines: Outlines  # old faces with the new middles, of corners, middles and centres numbered as below
    kinds: Kinds
    number: Ints  # the node that is each corner of an old face, each middle and each centre
    offsets: Ints
    vertices: Ints
    first: Ints  # (n_faces + 1,) where the new faces of each begin
    halved: Ints  # (h,) edges with a new middle
    centred: Ints  # (c,) faces with a new centre
    points: Floats  # of old nodes, middles and centres


def cut_faces(asked: Asked, marked: Bools) -> Cut:
    """Split the faces that marked cells ask for."""
    skin = asked.skin
    split = asked.faces(marked)
    halved = np.flatnonzero(asked.edges(split))
    n_nodes, n_corners = len(skin.points), len(skin.nodes)
    middle = np.full(len(skin.ends), -1)
    middle[halved] = n_corners + np.arange(len(halved))
    kinds = Kinds.of(skin.splitting, split, skin.seen)
    outlines = outlines_of(skin.polygons, skin.splitting, kinds, middle[skin.edge])
    offsets, vertices, parents = children_of(outlines, kinds, skin.polygons.points, n_corners + len(halved))
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
    """Corners of listed faces that have been split; and which of these have one corner in each part."""
    outlines, face = cut.outlines, skin.faces.cell_faces[listed]
    new = np.zeros(len(cut.number) - len(skin.nodes), dtype=bool)
    bend = np.append(skin.splitting.bend, new)[outlines.nodes]
    bends, before = np.append(np.flatnonzero(bend), -1), offsets_of(bend.astype(np.int64))
    # Marks stand in the order of the faces, as parts do.
    begin = offsets_of(np.bincount(outlines.cell, minlength=len(skin.seen)))
    next_bend = before[np.minimum(outlines.marks + 1, len(bend))]
    odd = before[outlines.stop] - next_bend != 1
    regular = np.bincount(outlines.cell, odd, minlength=len(skin.seen)) == 0
    good = (regular & (cut.kinds.centred | cut.kinds.medial))[face]
    listed, face = listed[good], face[good]
    counts = np.diff(begin)[face]
    mark, owner = spans(begin[face], counts), np.repeat(face, counts)
    centre = np.full(len(skin.seen), -1)
    centre[cut.centred] = len(skin.points) + len(cut.halved) + np.arange(len(cut.centred))
    known = cut.number[outlines.nodes]
    found = Corners(
        listed=np.repeat(listed, counts),
        node=known[bends[next_bend[mark]]],
        before=known[outlines.marks[mark]],
        after=known[outlines.follower[mark]],
        centre=centre[owner],
        row=cut.first[owner] + mark - begin[owner],
        rows=np.ones(len(mark), dtype=np.int64),
    )
    return found, good


@dataclass(frozen=True, eq=False)
class Solids:
    """Marked cells whose sides are all split at their corners, by these, and the kind of each cell."""

    corners: Corners  # oriented outwards
    cell: Ints
    side: Ints
    vertex: Ints  # (k,) the vertex of a cell that each corner is at: numbers of pairs of both
    first: Ints  # (v,) one of the corners at each vertex
    follower: Ints  # (k,) the corner of the next side around the vertex, which has the edge after this one before it
    kind: Ints  # (n_cells,)
    centre: Floats  # (n_cells, 3), of cells that are split about it
    others: Ints  # (n_cells,) how many sides are no triangles


STAYS, CONES, VERTICES, TETRA, OCTA, PYRAMID, WEDGE = range(7)
ABOUT_CENTRES = (CONES, VERTICES, OCTA)


def solids_of(asked: Asked, cut: Cut, marked: Bools) -> Solids:
    """Tell the kinds of marked cells."""
    skin, sides = asked.skin, asked.sides
    single = np.flatnonzero(marked[skin.cell] & (sides.pieces == 1))
    one, good = corners_of_cut(skin, cut, single)
    face = skin.faces.cell_faces[asked.corners.listed]
    two = asked.corners._replace(row=cut.first[face], rows=np.diff(cut.first)[face])
    corners = Corners(*(np.concatenate(pair) for pair in zip(one, two, strict=True)))
    odd = (sides.pieces > 1) & ~asked.parted
    odd[single[~good]] = True
    whole = marked & (np.bincount(skin.cell, odd, minlength=len(marked)) == 0)
    corners = corners.where(whole[skin.cell[corners.listed]])
    inwards = skin.signs[corners.listed] < 0.0
    before, after = corners.before, corners.after
    corners = corners._replace(before=np.where(inwards, after, before), after=np.where(inwards, before, after))
    return _settled(skin, cut, _about(skin, cut, _with_kinds(asked, marked, _around_vertices(skin, sides, corners))))


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
    return corners.where(kept), vertex[kept], place[follower[kept]]


def _with_kinds(asked: Asked, marked: Bools, closed: tuple[Corners, Ints, Ints]) -> Solids:
    """Solids by their numbers of triangular sides, of other sides and of vertices; without centres."""
    skin, (corners, vertex, follower) = asked.skin, closed
    n_cells = len(marked)
    cell, side = skin.cell[corners.listed], asked.sides.side[corners.listed]
    triangle = corners.centre < 0

    first = np.full(int(vertex.max(initial=-1)) + 1, -1)
    first[vertex] = np.arange(len(vertex))
    first = first[first >= 0]

    def counted(some: Bools) -> Ints:
        """The number of sides of each cell among those of these corners."""
        sides = np.zeros(len(skin.cell), dtype=bool)
        sides[side[some]] = True
        return np.bincount(skin.cell[sides], minlength=n_cells)

    triangles, others = counted(triangle), counted(~triangle)
    n_vertices = np.bincount(cell[first], minlength=n_cells)
    degree = np.zeros(n_cells, dtype=np.int64)
    np.maximum.at(degree, cell, np.bincount(vertex)[vertex] if len(vertex) else vertex)
    concave = ~skin.splitting.convex[skin.faces.cell_faces]
    convex = np.bincount(skin.cell, concave, minlength=n_cells) == 0
    kind = np.where(marked, CONES, STAYS)
    kind[(triangles == 0) & (others > 3)] = VERTICES
    kind[(triangles == 4) & (others == 0) & (n_vertices == 4)] = TETRA
    kind[(triangles == 8) & (others == 0) & (n_vertices == 6) & (degree == 4)] = OCTA
    kind[(triangles == 4) & (others == 1) & (n_vertices == 5) & convex] = PYRAMID
    kind[(triangles == 2) & (others == 3) & (n_vertices == 6) & convex] = WEDGE
    return Solids(
        corners=corners,
        cell=cell,
        side=side,
        vertex=vertex,
        first=first,
        follower=follower,
        kind=kind,
        centre=np.zeros((n_cells, 3)),
        others=others,
    )


def _settled(skin: Skin, cut: Cut, solids: Solids) -> Solids:
    """The solids with cones about their centroids in place of what would not be plane or is not seen."""
    kind = solids.kind.copy()
    kind[solids.cell[_not_plane(solids, cut)]] = CONES
    behind = skin.cell[_behind(skin, solids.centre)]
    kind[behind[np.isin(kind[behind], (VERTICES, OCTA))]] = CONES
    centroids = volumes_and_centroids(skin.shapes, skin.faces.cell_offsets, skin.faces.cell_faces, skin.signs)[1]
    return replace(solids, kind=kind, centre=np.where((kind == CONES)[:, None], centroids, solids.centre))


def check_seen(skin: Skin, solids: Solids) -> None:
    """MeshError if the centroid of a cell that is to fall into cones does not see all of it."""
    hidden = np.flatnonzero(_behind(skin, solids.centre) & (solids.kind == CONES)[skin.cell])
    if len(hidden):
        cell, place = skin.cell[hidden[0]], skin.shapes.centroids[skin.faces.cell_faces[hidden[0]]]
        raise MeshError(
            f"cell {cell} is not star-shaped about its centroid, which does not see the face at "
            f"({', '.join(f'{x:.6g}' for x in place)}) from inside: refine elsewhere, or cut it into convex cells."
        )


def with_regular_ones_whole(skin: Skin, sides: CellSides) -> Skin:
    """The skin with nothing tiny on cells that are split regularly if all their edges are: prisms stay prisms."""
    some = skin.tiny_parts()
    if not some.any():
        return skin
    whole = replace(skin, sizes=np.zeros_like(skin.sizes))
    asked = asked_of(whole, sides)
    regular = solids_of(asked, cut_faces(asked, some), some).kind > CONES
    return replace(skin, sizes=np.where(regular, 0.0, skin.sizes)) if regular.any() else skin


def _behind(skin: Skin, centre: Floats) -> Bools:
    """A mask of the listed faces whose inside the centres of their cells do not see."""
    face = skin.faces.cell_faces
    arm = skin.shapes.centroids[face] - centre[skin.cell]
    size = np.sqrt(np.maximum.reduceat(np.einsum("ij,ij->i", arm, arm), skin.faces.cell_offsets[:-1]))
    height = skin.signs * np.einsum("ij,ij->i", arm, skin.shapes.normals[face])
    hidden: Bools = height <= SINGLE * size[skin.cell]
    return hidden


def _about(skin: Skin, cut: Cut, solids: Solids) -> Solids:
    """The solids with their centres: means of vertices, and nearest to the planes where these say more.

    These are the planes through the middle of an edge and the centres of the sides beside it.
    """
    corners, cell, n_cells = solids.corners, solids.cell, len(solids.kind)
    once = solids.first
    counts = np.maximum(np.bincount(cell[once], minlength=n_cells), 1)
    origin = skin.points[skin.nodes[skin.faces.face_offsets[skin.faces.cell_faces[skin.faces.cell_offsets[:-1]]]]]
    arms = skin.points[corners.node[once]] - origin[cell[once]]
    means = np.column_stack([np.bincount(cell[once], arm, n_cells) for arm in arms.T]) / counts[:, None] + origin
    concave = np.bincount(skin.cell, ~skin.splitting.convex[skin.faces.cell_faces], minlength=n_cells) > 0
    many = (solids.kind == VERTICES) & ((solids.others != 6) | (counts != 8) | concave)
    some = np.flatnonzero(many[cell])
    of, number = cell[some], (np.cumsum(many) - 1)[cell[some]]
    at, normal = _middle_planes(corners, solids.follower, cut.points, some)
    matrix, right = np.zeros((np.count_nonzero(many), 3, 3)), np.zeros((np.count_nonzero(many), 3))
    np.add.at(matrix, number, normal[:, :, None] * normal[:, None, :])
    np.add.at(right, number, normal * np.einsum("ij,ij->i", normal, at - means[of])[:, None])
    means[many] += np.einsum("cij,cj->ci", np.linalg.pinv(matrix, hermitian=True), right)
    return replace(solids, centre=means)


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
    off = np.abs(np.einsum("ij,ij->i", normal, arm)) > SINGLE * np.linalg.norm(arm, axis=1)
    bent = some[off | (np.einsum("ij,ij->i", normal, normal) < 0.5)]
    some = np.flatnonzero((kind == WEDGE) & (corners.centre < 0))
    one = follower[some]
    quads = np.stack(
        [corners.before[some], corners.after[some], corners.centre[one], corners.centre[follower[one]]], axis=1
    )
    x = cut.points[quads]
    arms = x[:, 1:] - x[:, :1]
    volume = np.abs(np.einsum("ij,ij->i", arms[:, 2], np.cross(arms[:, 0], arms[:, 1])))
    return np.concatenate([bent, some[volume > SINGLE * np.prod(np.linalg.norm(arms, axis=2), axis=1)]])
