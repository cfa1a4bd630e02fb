"""Local refinement of polygonal meshes: chosen cells are split, their neighbours get the new vertices and stay.

The middles of the sides of a cell (`sides`) are joined to its centre (`centres`): n sides, n quadrilaterals. A triangle
has its middles joined to each other instead (four similar triangles), a long thin convex cell with two middles is cut
across, and a cell without a centre is first cut into convex pieces between its own vertices. New vertices hang on the
straight sides of unrefined neighbours; virtual elements take them as any vertex, so no closure is needed.

Grading: an unrefined cell of which a side would get a new hanging node beside another one is refined too, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array, eye_array, vstack

from vemcvx.arguments import flag
from vemcvx.arrays import Bools, Floats, Ints, brief, plain, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.names import check_boundaries, check_cell_data
from vemcvx.meshes.interfaces import Interface, on_boundary
from vemcvx.meshes.interpolation import projected_values
from vemcvx.meshes.local_refinement.centres import centres_of
from vemcvx.meshes.local_refinement.children import children_of, kinds_of, outlines_of
from vemcvx.meshes.local_refinement.sides import Splitting, splitting_of
from vemcvx.meshes.polygons.segments import rounding
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    first_in_row,
    positions,
    rotation,
)
from vemcvx.meshes.tessellation import Tessellation

Mesh = TypeVar("Mesh", bound=Tessellation)


@dataclass(frozen=True, eq=False)
class Edges:
    """One number for each undirected edge."""

    of_corner: Ints
    """(n_corners,) number of the edge that starts at each corner of the mesh"""
    ends: Ints
    """(n_edges, 2) its nodes, the smaller first; edges are in the order of these pairs"""
    twins: Ints
    """(q, 2) numbers of the edges of both bodies in one place at interfaces"""


@dataclass(frozen=True, eq=False)
class Refinement(Generic[Mesh]):
    """A refined mesh, and where its cells and nodes come from.

    Attributes
    ----------
    mesh : PolygonMesh
        Children stand in the place of their parent; old nodes first, then middles of edges, then centres of cells.
        Names of boundaries and cell data are those of the parents.
    parents : (n_new_cells,) int
        Old cell that each cell is, or is part of.
    prolongation : (n_new_nodes, n_old_nodes) sparse array
        Nodal values of the old mesh at the new nodes: kept; mean of the two ends of the edge; projection Pi at
        centres (the linear function that the element of the cell computes with). Exact for linear functions.
    """

    mesh: Mesh
    parents: Ints
    prolongation: csr_array


def refinement(mesh: Mesh, cells: ArrayLike | None = None, *, balance: bool = True) -> Refinement[Mesh]:
    """Split the given cells of a mesh.

    Parameters
    ----------
    mesh : PolygonMesh
        Any valid mesh.
    cells : (m,) array_like of int or (n_cells,) array_like of bool, optional
        Cells to split; by default all.
    balance : bool
        Also split every cell of which a side would get a new hanging node beside another one, until no side has
        two of them (if none had before).

    Returns
    -------
    Refinement
        The new mesh, the parent of each cell, and the prolongation of nodal values.

    Raises
    ------
    MeshError
        ``cells`` are not numbers of cells or one bool a cell, or edges to split are as short as rounding.
    """
    if not isinstance(mesh, Tessellation):
        raise MeshError(f"refinement: found {brief(mesh)} where a PolygonMesh is wanted.")
    balance, marked = flag(balance, "refinement: balance"), check_marks(cells, mesh.n_cells)
    splitting, edges = splitting_of(mesh), _edges_of(mesh)
    centres, seen = centres_of(mesh, splitting)
    seen &= splitting.places >= 2
    wanted = splitting.edge & seen[cell_of_corner(mesh.offsets)]
    if balance:
        marked = closed(marked, wanted, mesh, splitting, edges)
    split = _split(marked, wanted, mesh, edges)
    ends = edges.ends[split]
    _check_lengths(mesh.points, ends)
    middle = np.full(len(split), -1)
    middle[split] = mesh.n_nodes + np.arange(len(ends))
    kinds = kinds_of(splitting, marked, seen)
    outlines = outlines_of(mesh, splitting, kinds, middle[edges.of_corner])
    offsets, vertices, parents = children_of(outlines, kinds, mesh.points, mesh.n_nodes + len(ends))
    inner = centres[kinds.centred]
    points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1), inner])
    refined = _carried(mesh, type(mesh).unchecked(points, offsets, vertices, mesh._box), parents, edges, middle)
    at_centres = projected_values(mesh, np.flatnonzero(kinds.centred), inner)
    return Refinement(refined, read_only(parents), _prolongation(mesh.n_nodes, ends, at_centres))


def check_marks(cells: ArrayLike | None, n_cells: int, subject: str = "cells to refine") -> Bools:
    """Which cells are meant, (n_cells,) bool, or MeshError."""
    if cells is None:
        return np.ones(n_cells, dtype=bool)
    what = f"{subject} must be numbers of cells (0 to {n_cells - 1}), or one bool for each of the {n_cells} cells"
    given = plain(cells)
    if given is None:
        raise MeshError(f"{what}; got {brief(cells)}, masked or rows of different lengths.")
    if given.ndim == 1 and not given.size:
        return np.zeros(n_cells, dtype=bool)
    if given.ndim != 1 or given.dtype.kind not in "biu" or (given.dtype == bool and len(given) != n_cells):
        example = f", for example {given.ravel()[0]!r}" if given.size and given.dtype.kind not in "biu" else ""
        raise MeshError(f"{what}; got {given.dtype} of shape {given.shape}{example}.")
    if given.dtype == bool:
        return given.copy()
    if given.min() < 0 or given.max() >= n_cells:
        raise MeshError(f"{what}; got numbers from {given.min()} to {given.max()}.")
    marked = np.zeros(n_cells, dtype=bool)
    marked[given.astype(np.int64)] = True
    return marked


def _edges_of(mesh: Tessellation) -> Edges:
    shared = mesh.shared_edges
    of_corner = np.empty_like(shared.corners)
    of_corner[shared.corners] = np.repeat(np.arange(len(shared.first)), shared.counts)
    ends = np.sort(directed_edges(mesh.offsets, mesh.vertices)[shared.corners[shared.first]], axis=1)
    sides = [np.empty((0, 4), dtype=np.int64), *(np.hstack([i.edges, i.partners]) for i in mesh.interfaces.values())]
    twins = positions(np.concatenate(sides).reshape(-1, 2), ends, mesh.n_nodes).reshape(-1, 2)
    return Edges(of_corner, ends, twins)


def _check_lengths(points: Floats, ends: Ints) -> None:
    """MeshError if an edge is so short that its halves would be rounding of the coordinates."""
    one, other = points[ends[:, 0]], points[ends[:, 1]]
    short = np.flatnonzero(np.abs(other - one).max(axis=1) <= 4.0 * rounding(one, other))
    if len(short):
        a, b = ends[short[0]]
        raise MeshError(
            f"the edge ({a}, {b}) at ({points[a, 0]:.6g}, {points[a, 1]:.6g}) is only "
            f"{np.hypot(*(points[b] - points[a])):.2g} long: its middle would be rounding of the coordinates. Refine "
            "elsewhere, or put the origin there."
        )


def _split(marked: Bools, wanted: Bools, mesh: Tessellation, edges: Edges) -> Bools:
    """Edges to split: those that marked cells want split, and what is in the same place of another body, (n_edges,)."""
    split = np.zeros(len(edges.ends), dtype=bool)
    split[edges.of_corner[wanted & marked[cell_of_corner(mesh.offsets)]]] = True
    split[edges.twins] = split[edges.twins].any(axis=1, keepdims=True)
    return split


def closed(marked: Bools, wanted: Bools, mesh: Tessellation, splitting: Splitting, edges: Edges) -> Bools:
    """Cells marked, and those that would get a new node beside another one between two bends of their outline."""
    marked, cell = marked.copy(), cell_of_corner(mesh.offsets)
    order = rotation(mesh.offsets, first_in_row(splitting.bend, mesh.offsets))
    begin = np.flatnonzero(splitting.bend[order])
    edge, hanging = edges.of_corner[order], np.diff(np.append(begin, len(order))) - 1
    while True:
        new = np.add.reduceat(_split(marked, wanted, mesh, edges)[edge].astype(np.int64), begin)
        crowded = (new > 0) & (new + hanging > 1)
        before = np.count_nonzero(marked)
        marked[cell[begin[crowded]]] = True
        if np.count_nonzero(marked) == before:
            return marked


def _carried(mesh: Mesh, refined: Mesh, parents: Ints, edges: Edges, middle: Ints) -> Mesh:
    """The refined mesh with the names, interfaces and cell data of the old one."""

    def halved(part: Ints) -> Ints:
        new = middle[positions(part, edges.ends, mesh.n_nodes)]
        cut, whole = new >= 0, part[new < 0]
        first, second = np.column_stack([part[cut, 0], new[cut]]), np.column_stack([new[cut], part[cut, 1]])
        return np.concatenate([whole, first, second])

    data = check_cell_data({name: values[parents] for name, values in mesh.cell_data.items()}, refined.n_cells)
    named = {name: halved(part) for name, part in mesh._named.items()}
    named = check_boundaries(named, refined._boundary, refined.n_nodes, None) if named else {}
    sides = {k: Interface(i.bodies, halved(i.edges), halved(i.partners)) for k, i in mesh.interfaces.items()}
    matched = on_boundary(sides, refined._boundary, refined.n_nodes) if sides else {}
    return refined._replace(_named=named, interfaces=MappingProxyType(matched), cell_data=MappingProxyType(data))


def _prolongation(n_nodes: int, ends: Ints, inner: csr_array) -> csr_array:
    """Rows of the identity, of means over edges, and of the inner nodes, one below the other."""
    middles = csr_array((np.full(ends.size, 0.5), ends.ravel(), 2 * np.arange(len(ends) + 1)), (len(ends), n_nodes))
    return csr_array(vstack([eye_array(n_nodes), middles, inner], format="csr"))
