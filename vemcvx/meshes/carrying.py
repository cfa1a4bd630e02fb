"""Transfer of names, interfaces and data from a mesh to its refinement."""

from __future__ import annotations

from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, Ints, brief, plain, read_only
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.box import WHOLE, check_cell_data
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary, pad_rows, partners_of
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygons import edge_keys, find_in, rounding, rows_in_order

Kind = TypeVar("Kind", bound=Mesh)


def inherit_parts(mesh: Kind, made: Kind, parents: Ints, parts: Ints, places: Ints) -> Kind:
    """Return the new mesh with the boundaries, interfaces and cell data of the old mesh.

    The new cell k is part of the old cell `parents[k]`. The new boundary side k is part of the old side `parts[k]`.
    """
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
    return made._replace(_named=named, interfaces=matched, cell_data=MappingProxyType(data))


def middle_places(places: Ints, ends: Ints) -> Ints:
    """Return the node numbers (e,) of midpoints. Coinciding midpoints share a number."""
    keys = edge_keys(places[ends], len(places))
    return len(places) + find_in(keys, keys)


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
        f"{subject} must be cell numbers (0 to {n_cells - 1}), or one bool for each of the {n_cells} cells; got "
        f"{brief(cells)}."
    )


def check_lengths(points: Floats, ends: Ints) -> None:
    """Raise MeshError if an edge is too short for a midpoint."""
    one, other = points[ends[:, 0]], points[ends[:, 1]]
    short = np.flatnonzero(np.abs(other - one).max(axis=1) <= 4.0 * rounding(one, other))
    if len(short):
        a, b = ends[short[0]]
        raise MeshError(
            f"the edge ({a}, {b}) at {coordinates(points[a], 6)} is only "
            f"{np.linalg.norm(points[b] - points[a]):.2g} long: its midpoint would be lost in rounding errors. "
            "Refine elsewhere, or move the origin of the coordinates close to this edge."
        )
