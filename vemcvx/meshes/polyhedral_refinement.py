"""Local refinement of polyhedral meshes: chosen cells are split, neighbours take new coplanar faces and stay.

A cell is split at the middles of its edges and the centres of its faces; which children it has depends on its kind
(:mod:`.cell_sides`, :mod:`.cell_kinds`, :mod:`.cell_children`):

    triangular faces    four triangles                          other faces     n quadrilaterals about the centre
    tetrahedra          a tetrahedron at each vertex, an octahedron between them
    octahedra           an octahedron at each vertex, a tetrahedron on each face
    pyramids            a pyramid at each vertex, one upside down, a tetrahedron on each triangle
    wedges              eight wedges
    parallelepipeds, prisms, all others between whose edges new plane faces fit
                        a cell at each vertex, spanned by the middles of its edges, the centres of its faces, and the
                        centre of the cell: cubes become eight cubes, prisms those over the children of their polygons
    all others that are star-shaped about their centroid
                        joined to it: one child a new face, or a group of these (:mod:`.cell_children`)

New faces are always plane. A hanging node near the middle of a straight edge is its middle; coplanar faces that a
neighbour has made already are taken as they are if they are those into which the side would be split, so that a cell
beside finer ones is split as any other.

*Grading.* An unrefined cell is refined, too, if one of its straight edges would get a second hanging node, or a face of
one of its sides that is in several pieces would be split; and so on.

*Shapes.* Children of tetrahedra and octahedra have the shape of the tetrahedron or of the octahedron in it, up to a
reflection at a point: two shapes for ever, where eight tetrahedra (J. Bey, Computing 55 (1995), 355-378) have three and
need a diagonal chosen (for the two: G. Greiner, R. Grosso, The Visual Computer 16 (2000), 357-369). For with corners a,
b, c, d the tetrahedron at a is (T + a) / 2; and if O is the octahedron of the six middles, with centre m, those at its
vertices v are (O + v) / 2, while the faces of O with m span images of T under x -> p - x / 2 or p + x / 2. Wedges and
parallelepipeds are halves of their parents. So are the pyramids over a parallelogram, the one upside down reflected;
their tetrahedra all have the halves of the four rising edges and, opposite each other, of two sides of the base: one
shape. Other quadrilaterals are split at the crossing of their middle lines, so that the quarters of quarters tend to
parallelograms. What is joined to a centroid falls into tetrahedra and pyramids, so that all is settled from the second
pass on but where edges are tiny.

Measured over twelve passes at a point, and along a line and a plane as far as two cells from a point of these, the
least of all cells and passes: volume over diameter^3, angle at corners of faces, distance of centroids from the planes
of faces in diameters; and the largest condition number of the stiffness scaled by its diagonal, rigid motions left out,
of up to 1,300 nodes (tests/meshes/test_polyhedral_refine.py):

    cubes(2)          .19       90       .29       135      as they began
    tetrahedra(2)     .032      35       .10       333      as they began
    prisms(3)         .034      45       .039      370      began with .19, 89 and .28
    kelvin(2)         .0073     13       .037      247      began with .10, 45 and .16
    voronoi3(2)       2e-5      .45      8e-4      330      began with .15, 22 and .20

Voronoi cells in space may have edges and faces as short as chance makes them. Where cones about these cannot be joined,
because the centroid would not see all of the child, they are as slender as the edges are short.

Virtual elements take the hanging nodes and coplanar faces as they are; their number being bounded is what adaptive
methods ask for (L. Beirao da Veiga et al., SIAM J. Numer. Anal. 61 (2023), 457-494).
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, eye_array, vstack

from vemcvx.base.arrays import Bools, Floats, Ints, brief, flag, read_only
from vemcvx.base.errors import MeshError
from vemcvx.meshes import local_refinement as plane
from vemcvx.meshes.cell_children import Inner, Outer, cones, joined, regular_children
from vemcvx.meshes.cell_kinds import (
    ABOUT_CENTRES,
    STAYS,
    Cut,
    check_seen,
    cut_faces,
    solids_of,
    with_regular_ones_whole,
)
from vemcvx.meshes.cell_sides import Skin, asked_of, sides_of, skin_of
from vemcvx.meshes.interfaces import pairs_of, places_of
from vemcvx.meshes.local_refinement import Nodes, Refinement, carried, check_lengths, check_marks
from vemcvx.meshes.polygons import cell_of_corner, found_in, offsets_of, rows_in_order, same_rows, spans, turned
from vemcvx.meshes.polyhedra import Listed, numbered_faces
from vemcvx.meshes.tessellation import Mesh, SpaceTessellation, Tessellation, projected_values

AnyMesh = TypeVar("AnyMesh", bound=Mesh)
SpaceMesh = TypeVar("SpaceMesh", bound=SpaceTessellation)


def refined(mesh: SpaceMesh, marked: Bools, balance: bool) -> tuple[SpaceMesh, Ints, Nodes]:
    """The refined mesh, the parents of its cells, and its new nodes."""
    skin = skin_of(mesh)
    sides = sides_of(skin)
    skin = with_regular_ones_whole(skin, sides)
    asked = asked_of(skin, sides)
    marked = asked.closed(marked) if balance else marked
    cut = cut_faces(asked, marked)
    check_lengths(skin.points, skin.ends[cut.halved])
    solids = solids_of(asked, cut, marked)
    check_seen(skin, solids)
    inside = np.flatnonzero(np.isin(solids.kind, ABOUT_CENTRES))
    about = np.full(mesh.n_cells, -1)
    about[inside] = len(cut.points) + np.arange(len(inside))
    lots = [regular_children(asked, cut, solids, about), cones(asked, cut, solids, about)]
    stays = np.flatnonzero(solids.kind[skin.cell] == STAYS)
    face = skin.faces.cell_faces[stays]
    outer = [*(lot[0] for lot in lots), Outer(np.zeros_like(stays), stays, cut.first[face], np.diff(cut.first)[face])]
    whole = Outer(*(np.concatenate(values) for values in zip(*outer, strict=True)))
    laid = _laid_out(mesh, skin, cut, whole, joined([lot[1] for lot in lots]))
    return _assembled(mesh, skin, cut, laid, (inside, solids.centre[inside]))


class Laid(NamedTuple):
    """New cells, their nodes numbered as in `Cut`."""

    listed: Listed
    parents: Ints
    number: Ints  # which new face each listed one is: first those of faces of the old mesh, in their order
    own: Ints  # (n_faces + 1,) where the new faces of each face of the old mesh begin


def _laid_out(mesh: SpaceTessellation, skin: Skin, cut: Cut, outer: Outer, inner: Inner) -> Laid:
    """The cells that new faces make; of each face at an interface there are two."""
    merged = np.empty(mesh.n_faces, dtype=np.int64)
    merged[mesh.cell_faces] = skin.faces.cell_faces
    own = offsets_of(np.diff(cut.first)[merged])
    listed, row = np.repeat(outer.listed, outer.rows), spans(outer.row, outer.rows)
    face = mesh.cell_faces[listed]
    outside = own[face] + row - cut.first[merged[face]]
    number = np.append(outside, own[-1] + same_rows(inner.offsets, inner.vertices)[1])
    rows, nodes = rows_in_order(cut.offsets, cut.vertices, row)
    nodes = turned(rows, nodes, skin.signs[listed] < 0.0)
    rows, nodes = np.concatenate([rows, rows[-1] + inner.offsets[1:]]), np.append(nodes, inner.vertices)
    key = np.append(np.repeat(outer.key, outer.rows), inner.key)
    many = int(key.max()) + 1
    children, child = np.unique(np.append(skin.cell[listed], inner.cell) * many + key, return_inverse=True)
    order = np.argsort(child, kind="stable")
    cells = Listed(*rows_in_order(rows, nodes, order), offsets_of(np.bincount(child)))
    return Laid(cells, children // many, number[order], own)


def _assembled(
    mesh: SpaceMesh, skin: Skin, cut: Cut, laid: Laid, centres: tuple[Ints, Floats]
) -> tuple[SpaceMesh, Ints, Nodes]:
    """The mesh of new cells, and its new nodes; those in cells, and their places, are given."""
    listed, found, points = laid.listed, Nodes(skin.ends[cut.halved], cut.centred, centres[0]), cut.points
    if mesh.interfaces:
        cell = np.repeat(laid.parents, np.diff(listed.cell_offsets))[cell_of_corner(listed.offsets)]
        vertices, found, points = own_nodes(mesh, skin, cut, cell, listed.vertices)
        listed = listed._replace(vertices=vertices)
    numbers, first, at = np.unique(laid.number, return_index=True, return_inverse=True)
    rank = np.empty_like(first)
    rank[np.argsort(first)] = np.arange(len(first))
    joint = numbered_faces(listed, np.sort(first), rank[at])
    outside, place = numbers < laid.own[-1], np.full(laid.own[-1], -1)
    place[numbers[outside]] = rank[outside]
    made = type(mesh).unchecked(np.concatenate([points, centres[1]]), *joint, box=mesh._box)
    first, parts = rows_in_order(laid.own, place, mesh._boundary)
    return carried(mesh, made, laid.parents, first, made._places(parts)), laid.parents, found._replace(cells=centres[0])


def own_nodes(mesh: SpaceTessellation, skin: Skin, cut: Cut, cell: Ints, number: Ints) -> tuple[Ints, Nodes, Floats]:
    """The nodes of the own body for corners (m,), numbered as in `Cut`, of children of cells (m,).

    Besides, the new nodes on edges and in faces, and the places of all.
    """
    n_nodes, n_faces = mesh.n_nodes, len(skin.seen)
    stops = n_nodes + np.cumsum([0, len(cut.halved), len(cut.centred)])
    old, middle, centre, inner = (np.flatnonzero(np.searchsorted(stops, number, side="right") == k) for k in range(4))
    offsets, nodes = mesh.cell_nodes
    key = cell_of_corner(offsets) * n_nodes + places_of(pairs_of(mesh.interfaces), mesh.points)[nodes]

    def own(cells: Ints, place: Ints) -> Ints:
        return nodes[found_in(key, cells * n_nodes + place)]

    numbers = np.empty_like(number)
    numbers[old] = own(cell[old], number[old])
    ends = skin.ends[cut.halved[number[middle] - stops[0]]]
    ends = np.sort(np.column_stack([own(cell[middle], end) for end in ends.T]), axis=1)
    found, at = np.unique(ends[:, 0] * n_nodes + ends[:, 1], return_inverse=True)
    numbers[middle] = n_nodes + at
    wanted = cell[centre] * n_faces + cut.centred[number[centre] - stops[1]]
    listed = found_in(skin.cell * n_faces + skin.faces.cell_faces, wanted)
    faces, at = np.unique(mesh.cell_faces[listed], return_inverse=True)
    numbers[centre] = n_nodes + len(found) + at
    numbers[inner] = number[inner] + n_nodes + len(found) + len(faces) - stops[2]
    points = np.empty((n_nodes + len(found) + len(faces), 3))
    points[: mesh.n_nodes] = mesh.points
    for new in (middle, centre):
        points[numbers[new]] = cut.points[number[new]]
    return numbers, Nodes(np.column_stack(np.divmod(found, n_nodes)), faces, faces[:0]), points


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
    made, parents, nodes = _refined(mesh, cells, balance)
    return Refinement(made, read_only(parents), _prolongation(mesh, made.points, nodes))


def refined_mesh(mesh: AnyMesh, cells: ArrayLike | None, balance: bool) -> AnyMesh:
    """The mesh of `refinement` alone, which is spared the prolongation."""
    return _refined(mesh, cells, balance)[0]


def _refined(mesh: AnyMesh, cells: ArrayLike | None, balance: bool) -> tuple[AnyMesh, Ints, Nodes]:
    if not isinstance(mesh, (Tessellation, SpaceTessellation)):
        raise MeshError(f"refinement: found {brief(mesh)} where a PolygonMesh or PolyhedralMesh is wanted.")
    balance, marked = flag(balance, "refinement: balance"), check_marks(cells, mesh.n_cells)
    return plane.refined(mesh, marked, balance) if isinstance(mesh, Tessellation) else refined(mesh, marked, balance)


def _prolongation(mesh: Mesh, points: Floats, nodes: Nodes) -> csr_array:
    """Rows of the identity, of means over edges, and of values at centres, one below the other."""
    count, (ends, faces, cells) = mesh.n_nodes, nodes
    middles = csr_array((np.full(ends.size, 0.5), ends.ravel(), 2 * np.arange(len(ends) + 1)), (len(ends), count))
    in_faces, in_cells = np.split(points[count + len(ends) :], [len(faces)])
    if isinstance(mesh, Tessellation):
        inner = [projected_values(mesh, cells, in_cells)]
    elif isinstance(mesh, SpaceTessellation):
        of_faces = rows_in_order(mesh.face_offsets, mesh.face_vertices, faces)
        of_cells = rows_in_order(*mesh.cell_nodes, cells)
        inner = [_nearest_linear(mesh.points, *of_faces, in_faces), _nearest_linear(mesh.points, *of_cells, in_cells)]
    return csr_array(vstack([eye_array(count), middles, *inner], format="csr"))


def _nearest_linear(points: Floats, offsets: Ints, rows: Ints, at: Floats) -> csr_array:
    """Values at points (m, 3) of linear functions that are nearest to those at a row of nodes each.

    Linear functions are taken to themselves.
    """
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
