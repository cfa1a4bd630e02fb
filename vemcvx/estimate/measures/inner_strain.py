"""Strains inside cells: of Pi u, constant; and of the virtual function itself where it is known.

On a triangle the virtual function of (3.11), harmonic with linear edges, is linear. On a rectangle with sides e_1, e_2
and centre c it is, with xi = 2 e_1.(x - c) / |e_1|^2, eta likewise and the vertex values u_1 ... u_4 in turn,

    u(x) = mean + grad(Pi u) (x - c) + b xi eta,    b = (u_1 - u_2 + u_3 - u_4) / 4,

for xi eta is harmonic and linear on the sides. So strains are eps(Pi u) + (x - c) . slope, the slope being that of
sym(b (x) grad(xi eta)). On other cells nothing but Pi u is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.estimate.measures.field import Field
from vemcvx.vem import CellGroup

# How far, in parts of its size, a cell may be from a rectangle: coordinates of a box rounded to twelve digits.
RECTANGLE = 1e-10


@dataclass(frozen=True, eq=False)
class InnerStrain:
    """Strains that are linear in every cell."""

    mean: Floats
    """(n_cells, 3) e_xx, e_yy, 2 e_xy at the centre"""
    slope: Floats | None
    """(n_cells, 2, 3) their gradients; None if strains are constant"""
    centre: Floats
    """(n_cells, 2)"""

    def at(self, cells: Ints, points: Floats | None) -> Floats:
        """Strains (q, 3) at points (q, 2) of cells (q,)."""
        if self.slope is None or points is None:
            return self.mean[cells]
        off_centre: Floats = np.einsum("qk,qkl->ql", points - self.centre[cells], self.slope[cells])
        return self.mean[cells] + off_centre


def projected_strain(field: Field) -> InnerStrain:
    """Strains of Pi u."""
    return InnerStrain(field.strain, None, field.mesh.centroids)


def virtual_strain(field: Field, subject: str) -> InnerStrain:
    """Strains of the virtual function, or MeshError if some cell is neither a triangle nor a rectangle."""
    slope = np.zeros((field.mesh.n_cells, 2, 3))
    for group in field.space.groups:
        n = group.nodes.shape[1]
        bad = ~_rectangles(group.corners) if n == 4 else np.full(len(group.cells), n != 3)
        if bad.any():
            raise MeshError(
                f"{subject}: cell {group.cells[bad][0]}, of {n} vertices, is neither a triangle nor a rectangle, and "
                "inside others virtual functions are not known. Measure their projections: kind='projected'."
            )
        if n == 4:
            slope[group.cells] = _slopes(group, field.displacement)
    return InnerStrain(field.strain, slope, field.mesh.centroids)


def _rectangles(corners: Floats) -> Bools:
    """Which quadrilaterals (c, 4, 2) are rectangles."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    lengths = np.hypot(*first.T), np.hypot(*second.T)
    closes = np.abs(corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]).max(axis=1)
    skew = np.abs(np.sum(first * second, axis=1)) / np.maximum(*lengths)
    rectangles: Bools = np.maximum(closes, skew) <= RECTANGLE * np.minimum(*lengths)
    return rectangles


def _slopes(group: CellGroup, displacement: Floats) -> Floats:
    """Gradients (c, 2, 3) of the strains of b xi eta on rectangles."""
    corners, u = group.corners, displacement[group.nodes]
    b = 0.25 * ((u[:, 0] - u[:, 1]) + (u[:, 2] - u[:, 3]))
    sides = [corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]]
    g, h = (2.0 * side / np.sum(side**2, axis=1)[:, None] for side in sides)
    # grad(xi eta) = xi h + eta g, of which the derivative along x_k is g_k h + h_k g.
    turn = g[:, :, None] * h[:, None, :] + h[:, :, None] * g[:, None, :]
    xx, yy = b[:, None, 0] * turn[:, :, 0], b[:, None, 1] * turn[:, :, 1]
    return np.stack([xx, yy, b[:, None, 0] * turn[:, :, 1] + b[:, None, 1] * turn[:, :, 0]], axis=2)
