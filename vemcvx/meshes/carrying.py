"""Transfer of names, interfaces, data and nodal values from a mesh to its refinement."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from vemcvx.base.arrays import Bools, Floats, Ints, brief, plain, read_only
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.box import WHOLE, check_cell_data
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary, pad_rows, partners_of
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygons import (
    cell_of_corner,
    edge_keys,
    find_in,
    rounding,
    rows_in_order,
)

Kind = TypeVar("Kind", bound=Mesh)


@dataclass(frozen=True, eq=False)
class Refinement(Generic[Kind]):
    """A refined mesh with the parents of its cells and the prolongation of nodal values.

    Attributes
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        The refined mesh. The parts of a cell take its position. Old nodes come first, then midpoints of edges, centres
        of faces (in space), and centres of cells. Boundaries and cell data are inherited.
    parents : (n_new_cells,) int
        The old cell that contains each new cell.
    prolongation : (n_new_nodes, n_old_nodes) sparse array
        Interpolation of nodal values, exact for linear functions. Old nodes keep their value, and a midpoint gets the
        mean of its two ends. A centre gets the value of the least-squares linear fit to the nodes of its cell or face.

    Examples
    --------
    >>> fine = vx.meshes.refinement(vx.meshes.squares(2), cells=[0])
    >>> fine.parents, fine.prolongation.shape
    (array([0, 0, 0, 0, 1, 2, 3]), (14, 9))
    """

    mesh: Kind
    parents: Ints
    prolongation: csr_array


class Origins(NamedTuple):
    """Origins of the cells, boundary edges or faces, and nodes of a refined mesh."""

    parents: Ints  # (n_new_cells,) old cell of each cell
    parts: Ints  # (m,) for each new boundary edge or face, the position of its parent in the old boundary
    places: Ints  # (n_new_nodes,) for each node, the first node with the same coordinates
    prolongation: csr_array


def inherit_parts(mesh: Kind, made: Kind, origins: Origins) -> Refinement[Kind]:
    """Return the refinement; the new mesh `made` inherits the boundaries, interfaces and cell data of `mesh`."""
    parents, parts, places, prolongation = origins
    data = check_cell_data({name: values[parents] for name, values in mesh.cell_data.items()}, made.n_cells)

    def pieces(old: Ints) -> Ints:
        return np.flatnonzero(np.isin(parts, old))

    named = {
        name: read_only(made._boundary[pieces(mesh._places(old))])
        for name, old in mesh.boundaries.items()
        if name != WHOLE and name not in mesh.interfaces
    }
    sides = {}
    for name, joint in mesh.interfaces.items():
        one, other = (
            rows_in_order(*made._outlines, pieces(faces_of(side, mesh._outlines)))
            for side in (joint.edges, joint.partners)
        )
        sides[name] = Interface(joint.bodies, pad_rows(*one), pad_rows(one[0], partners_of(one, other, places)))
    matched = MappingProxyType(on_boundary(sides, made._outlines))
    made = made._replace(_named=named, interfaces=matched, cell_data=MappingProxyType(data))
    return Refinement(made, read_only(parents), prolongation)


def middle_places(places: Ints, ends: Ints) -> Ints:
    """Return, for the midpoint of each edge (e, 2), the first midpoint in its place; numbers follow the old nodes."""
    keys = edge_keys(places[ends], len(places))
    return len(places) + find_in(keys, keys)


def middle_values(ends: Ints, count: int) -> csr_array:
    """Return the matrix (e, count) that maps nodal values to their means over the ends (e, 2) of edges."""
    return csr_array((np.full(ends.size, 0.5), ends.ravel(), 2 * np.arange(len(ends) + 1)), (len(ends), count))


def centre_values(points: Floats, rows: tuple[Ints, Ints], centres: Floats) -> csr_array:
    """Return the matrix (c, n_nodes) that maps nodal values to those of least-squares linear fits at centres."""
    offsets, nodes = rows
    shape = (len(centres), len(points))
    if not len(centres):
        return csr_array(shape)
    counts, owner = np.diff(offsets), cell_of_corner(offsets)
    arm = points[nodes] - centres[owner]
    mean = np.add.reduceat(arm, offsets[:-1], axis=0) / counts[:, None]
    arm -= mean[owner]
    spread = np.add.reduceat(arm[:, :, None] * arm[:, None, :], offsets[:-1], axis=0)
    slope = np.einsum("cij,cj->ci", np.linalg.pinv(spread, rcond=1e-10, hermitian=True), -mean)
    weights = 1.0 / counts[owner] + np.einsum("ki,ki->k", arm, slope[owner])
    return csr_array((weights, nodes, offsets), shape=shape)


def check_marks(cells: ArrayLike | None, n_cells: int, subject: str = "cells to refine") -> Bools:
    """Return a mask (n_cells,) of the marked cells, or raise MeshError."""
    if cells is None:
        return np.ones(n_cells, dtype=bool)
    given, marked = plain(cells), np.zeros(n_cells, dtype=bool)
    if given is not None and given.ndim == 1:
        if not given.size:
            return marked
        are_flags = given.dtype == bool and len(given) == n_cells
        if are_flags or (given.dtype.kind in "iu" and 0 <= given.min() <= given.max() < n_cells):
            marked[given] = True
            return marked
    raise MeshError(
        f"{subject} must be numbers of cells (0 to {n_cells - 1}), or one bool for each of the {n_cells} cells; got "
        f"{brief(cells)}."
    )


def check_lengths(points: Floats, ends: Ints) -> None:
    """Raise MeshError if the midpoint of an edge would be lost in the rounding of the coordinates."""
    one, other = points[ends[:, 0]], points[ends[:, 1]]
    short = np.flatnonzero(np.abs(other - one).max(axis=1) <= 4.0 * rounding(one, other))
    if len(short):
        a, b = ends[short[0]]
        raise MeshError(
            f"the edge ({a}, {b}) at {coordinates(points[a], 6)} is only "
            f"{np.linalg.norm(points[b] - points[a]):.2g} long: its midpoint would be lost in rounding errors. "
            "Refine elsewhere, or move the origin of the coordinates close to this edge."
        )
