"""Sides of polyhedral cells: coplanar faces joined, every face laid into its plane, and which of them are split.

A cell beside smaller ones has several coplanar faces, which together are one *side* of it; the edges between two sides
follow each other on *lines*, with hanging nodes between them. Every face is a polygon of a plane mesh in a plane of its
own, so that it is split as cells of plane meshes are (:mod:`.local_refinement`): the middles of its edges are joined to
its centre, those of a triangle to each other. How it is split depends on nothing but the face, its edges and the
cells beside these: whichever of its two cells asks for it, both get the same new faces.

Edges that are tiny beside the cells around them are not split, and neither are faces that are tiny beside the cell that
asks for it. Every pass halves the cells, so that the share of such edges and faces doubles until they are split, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.meshes.interfaces import pairs_of, places_of
from vemcvx.meshes.local_refinement import Splitting, centres_of, splitting_of
from vemcvx.meshes.polygons import (
    cell_of_corner,
    offsets_of,
    previous_corner,
    rows_in_order,
    shared_edges,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import Faces, FaceShapes, axes_in_planes, face_shapes, joined_faces, listed_faces, signs_of
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

FLAT = 1e-5  # Faces of a cell whose normals differ by less, in radians, are of one side.
TINY = 0.07  # Of the size of a cell (see `Skin`), below which its edges and faces are not split.
LARGE = 0.75  # Of the diameter of a side, pieces that are split although the side is in several pieces.


@dataclass(frozen=True, eq=False)
class Skin:
    """The faces of all cells, nodes in one place counted as one, and what comes of each when it is split."""

    points: Floats
    faces: Faces
    shapes: FaceShapes
    cell: Ints  # (n_listed,) cell of each listed face
    signs: Floats  # (n_listed,) 1 where a listed face runs outwards as it is stored
    sizes: Floats  # (n_cells,) nine volumes over the area, 1.5 widths of a cube; 0 where nothing is tiny
    polygons: Tessellation  # faces in their own planes; its vertices are the corners of faces, numbered through
    edge: Ints  # (n_corners,) number of the edge that starts at each corner
    ends: Ints  # (n_edges, 2) its nodes, the smaller first

    @property
    def nodes(self) -> Ints:
        """(n_corners,) the node at each corner."""
        return self.faces.face_vertices

    @cached_property
    def least(self) -> Floats:
        """(n_edges,) lengths below which edges are tiny: beside the smallest cell at a face of theirs."""
        one, other = self.faces.face_cells.T
        of_face = np.minimum(self.sizes[one], self.sizes[np.where(other < 0, one, other)])
        smallest = np.full(len(self.ends), np.inf)
        np.minimum.at(smallest, self.edge, np.repeat(of_face, np.diff(self.faces.face_offsets)))
        return TINY * smallest

    def tiny_parts(self) -> Bools:
        """A mask of the cells that have tiny edges or faces."""
        faces, cells = self.faces, np.zeros(len(self.sizes), dtype=bool)
        short = np.linalg.norm(self.points[self.ends[:, 1]] - self.points[self.ends[:, 0]], axis=1) < self.least
        beside = np.logical_or.reduceat(short[self.edge], faces.face_offsets[:-1])[faces.cell_faces]
        cells[self.cell[beside | (self.polygons.diameters[faces.cell_faces] < TINY * self.sizes[self.cell])]] = True
        return cells

    @cached_property
    def splitting(self) -> Splitting:
        """The faces that are split."""
        return splitting_of(self.polygons, self.least[self.edge])

    @cached_property
    def _middles(self) -> tuple[Floats, Bools]:
        return centres_of(self.polygons, self.splitting)

    @property
    def seen(self) -> Bools:
        """(n_faces,) whether a face has a centre that sees all of it."""
        return self._middles[1] & (self.splitting.places > 1)

    @cached_property
    def centres(self) -> Floats:
        """(n_faces, 3) the centres of faces; of those on a side of a box, on it to the bit."""
        corners, begin = self.points[self.nodes], self.faces.face_offsets[:-1]
        low, high = (f.reduceat(corners, begin, axis=0) for f in (np.minimum, np.maximum))
        inside = np.einsum("fai,fa->fi", axes_in_planes(self.shapes)[:, :2], self._middles[0])
        centres: Floats = np.clip(self.shapes.centroids + inside, low, high)
        return centres


def skin_of(mesh: SpaceTessellation) -> Skin:
    """Lay every face of a mesh into its plane and find where it is to be split."""
    faces, shapes = mesh.faces, mesh._face_shapes
    if mesh.interfaces:
        listed, place = listed_faces(faces), places_of(pairs_of(mesh.interfaces), mesh.points)
        faces = joined_faces(listed.offsets, place[listed.vertices], listed.cell_offsets)
        shapes = face_shapes(mesh.points, faces.face_offsets, faces.face_vertices)
    axes, owner = axes_in_planes(shapes), cell_of_corner(faces.face_offsets)
    corners = mesh.points[faces.face_vertices]
    flat = np.einsum("mai,mi->ma", axes[owner, :2], corners - shapes.centroids[owner])
    polygons = Tessellation.unchecked(flat, faces.face_offsets, np.arange(len(flat)))
    shared = shared_edges(faces.face_offsets, faces.face_vertices, mesh.n_nodes)
    sizes = 9.0 * mesh.volumes / np.add.reduceat(shapes.areas[faces.cell_faces], faces.cell_offsets[:-1])
    return Skin(
        points=mesh.points,
        faces=faces,
        shapes=shapes,
        cell=cell_of_corner(faces.cell_offsets),
        signs=signs_of(faces),
        sizes=sizes,
        polygons=polygons,
        edge=shared.number,
        ends=shared.ends,
    )


@dataclass(frozen=True, eq=False)
class CellSides:
    """Sides of all cells, and their edges."""

    rows: Ints  # (n_listed + 1,) where in `corners` each listed face begins
    corners: Ints  # corners of faces, in the order of the listed faces
    side: Ints  # (n_listed,) the side: the first listed face of it
    pieces: Ints  # (n_listed,) of how many faces that consists
    outer: Bools  # (like `corners`) whether the edge that starts there is between two sides of the cell
    cell: Ints  # (x,) cells of the edges between two sides, once a cell
    edge: Ints
    chain: Ints  # (x,) edges of one line of a cell have one number
    keys: Ints  # sorted cell * n_nodes + node, of the nodes on these edges
    degrees: Ints  # how many of them end there

    def degree(self, cell: Ints, node: Ints, n_nodes: int) -> Ints:
        """The number of edges between sides of a cell that end at a node; 0 for nodes inside of sides, and new ones."""
        wanted = np.where((node >= 0) & (node < n_nodes), cell * n_nodes + node, -1)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        degrees: Ints = np.where(self.keys[at] == wanted, self.degrees[at], 0)
        return degrees


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

    listed: Ints  # listed face of which the part is, or which it is
    node: Ints
    before: Ints  # the middle of the edge before the corner, around the side as its faces are stored
    after: Ints
    centre: Ints  # the centre of the side, -1 in triangles
    row: Ints  # the first of the new faces that make the part
    rows: Ints  # how many they are

    def where(self, kept: Bools) -> Corners:
        """The corners that a mask selects."""
        return Corners(*(values[kept] for values in self))


def corners_in_pieces(skin: Skin, sides: CellSides) -> tuple[Corners, Bools]:
    """Corners of sides that consist of the parts into which they would be split; and which listed faces are of such.

    These are n quadrilaterals about a common node, each with one corner of the side, or four triangles, one of which
    has none.
    """
    many = np.flatnonzero(sides.pieces > 1)
    rows, position = rows_in_order(sides.rows, np.arange(len(sides.corners)), many)
    before = position[previous_corner(rows)] if len(position) else position
    bend = skin.splitting.bend[sides.corners[position]]
    own = (sides.outer[position] & sides.outer[before])[bend]
    owner = cell_of_corner(rows)[bend]
    counts = np.bincount(owner, minlength=len(many))
    node, ring, corner = skin.nodes[sides.corners[position[bend]]], offsets_of(counts), np.flatnonzero(own)
    piece = owner[corner]
    place = corner - ring[piece]
    around = [node[ring[piece] + (place + step) % counts[piece]] for step in (-1, 0, 1, 2)]
    alone = np.bincount(piece, minlength=len(many)) < 2
    centre = np.full(len(many), -1)
    centre[piece] = around[3]
    # Beside a corner are nodes inside of lines.
    good = alone.copy()
    for there in (around[0], around[2]):
        good[piece[sides.degree(skin.cell[many[piece]], there, len(skin.points)) != 2]] = False
    middles = np.column_stack([around[0], around[2]])
    good[piece[_apart(skin, sides.side[many[piece]], around[1], middles)]] = False
    quads, triangles = _sides_in_parts(skin, sides, (many, np.where(good, counts, 0), centre))
    parted = np.zeros(len(skin.cell), dtype=bool)
    parted[many[quads | triangles]] = True
    kept = parted[many[piece]]
    middle = np.where(quads[piece], around[3], -1)
    row, rows = np.zeros((2, len(piece)), dtype=np.int64)  # known once faces are cut
    found = Corners(many[piece], around[1], around[0], around[2], centre=middle, row=row, rows=rows)
    return found.where(kept), parted


def _apart(skin: Skin, side: Ints, node: Ints, middles: Ints) -> Bools:
    """A mask of the corners of sides of whose nodes (k, 2) beside them one is not near the middle of its line."""
    lengths = np.linalg.norm(skin.points[middles] - skin.points[node][:, None], axis=2)
    line = np.unique(side[:, None] * len(skin.points) + middles, return_inverse=True)[1].reshape(middles.shape)
    shortest, longest = np.full(line.max(initial=-1) + 1, np.inf), np.zeros(line.max(initial=-1) + 1)
    np.minimum.at(shortest, line, lengths)
    np.maximum.at(longest, line, lengths)
    # A node is taken for the middle of a line from .3 to .7 of its length.
    apart: Bools = (longest > 2.4 * shortest)[line].any(axis=1)
    return apart


def _sides_in_parts(skin: Skin, sides: CellSides, pieces: tuple[Ints, Ints, Ints]) -> tuple[Bools, Bools]:
    """Masks of the pieces that belong to sides of quadrilaterals about a node, and to sides of four triangles.

    Pieces are listed faces, how many corners they have, and the node opposite to that of the side, -1 if there is none.
    """
    many, counts, centre = pieces
    side, n_listed = sides.side[many], len(skin.cell)

    def number(flags: Bools) -> Ints:
        return np.bincount(side[flags], minlength=n_listed)[side]

    lowest, highest = np.full(n_listed, len(skin.points)), np.full(n_listed, -1)
    np.minimum.at(lowest, side, centre)
    np.maximum.at(highest, side, centre)
    inside = sides.degree(skin.cell[many], centre, len(skin.points)) == 0
    number_of_all = sides.pieces[many]
    quads = number((counts == 4) & (centre >= 0) & inside) == number_of_all
    quads &= (lowest == highest)[side] & (number_of_all > 2)
    triangles = (number(counts == 3) == number_of_all) & (number(centre < 0) == 1) & (number_of_all == 4)
    return quads, triangles


@dataclass(frozen=True, eq=False)
class Asked:
    """The faces and edges that marked cells have split, and the cells that grading adds to these.

    A side of an unrefined cell has one face, or those into which it would be split itself; a line between two of its
    sides has one node inside at most. A cell that would get more is refined, too, and so on.
    """

    skin: Skin
    sides: CellSides
    corners: Corners  # of sides that are in the parts into which they would be split
    parted: Bools  # (n_listed,) the faces of these
    wants: Bools  # (n_listed,) faces that their cell would have split

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


def asked_of(skin: Skin, sides: CellSides) -> Asked:
    """Faces are split that are not tiny, and of sides in several pieces those that are nearly as large as all."""
    in_pieces, parted = corners_in_pieces(skin, sides)
    sizes = skin.polygons.diameters[skin.faces.cell_faces]
    single = sides.pieces == 1
    wants = single & (sizes >= TINY * skin.sizes[skin.cell])
    several = np.flatnonzero(~single & ~parted)
    rows, corners = rows_in_order(sides.rows, sides.corners, several)
    x, side = skin.points[skin.nodes[corners]], sides.side[several]
    low, high = np.full((len(single), 3), np.inf), np.full((len(single), 3), -np.inf)
    np.minimum.at(low, side[cell_of_corner(rows)], x)
    np.maximum.at(high, side[cell_of_corner(rows)], x)
    wants[several] = sizes[several] > LARGE * np.linalg.norm(high[side] - low[side], axis=1)
    return Asked(skin, sides, in_pieces, parted, wants)
