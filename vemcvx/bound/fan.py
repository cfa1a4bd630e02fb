"""The fan of a star-shaped polygon: triangles around a centre, each split at the centroid into three parts.

Let m be the centre and x_i the vertices. The matrix B has the columns x_i - m and x_{i+1} - m. The map m + B x^ takes
points x^ of the reference triangle (0,0), (1,0), (0,1) to a triangle of the fan. Fields are quadratic on each part,
with values at six *stations*: three corners, and three edge midpoints.

The body force in a cell is f = a_0 + x a_1 + y a_2, with coordinates x and y relative to the centre. Let lambda_k be
the barycentric coordinates of a triangle. The forces on the triangle are F_k = int f lambda_k.

The *form* of a cell is the matrix of an energy after all unknowns inside the cell are eliminated. With n vertices, the
form has 4 n rows for values on edges, and 6 rows for a_0, a_1 and a_2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import SINGLE_EPS, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.meshes.polygons import RADON_POINTS, RADON_WEIGHTS, cross, polygon_centroids, right_of
from vemcvx.vem import Space

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
PARTS = np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3]])  # corners of each part; number 3 is the centroid
FORCES = 6  # number of coefficients of the body force in a cell


def distinct(arrays: Sequence[Floats]) -> tuple[Ints | slice, Ints]:
    """Group equal arrays, and return one member per group and the group numbers (c,)."""
    rows = np.hstack([each.reshape(len(each), -1) for each in arrays])
    # If most of the first 64 cells differ, no cells are grouped.
    if len(np.unique(rows[:64], axis=0)) > 32:
        return slice(None), np.arange(len(rows))
    _, some, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return some, same.ravel()


def monomials(x: Floats) -> Floats:
    """Return 1, x, y, x^2, xy, y^2 at each point."""
    one, two = x.T
    return np.column_stack([np.ones(len(x)), one, two, one * one, one * two, two * two])


def monomial_slopes(x: Floats) -> Floats:
    """Return the derivatives (q, 2, 6) of the monomials."""
    (one, two), none, unit = x.T, np.zeros(len(x)), np.ones(len(x))
    along_x = np.column_stack([none, unit, none, 2.0 * one, two, none])
    return np.stack([along_x, np.column_stack([none, none, unit, none, one, 2.0 * two])], axis=1)


TRIANGLES = np.concatenate([CORNERS, CORNERS.mean(axis=0)[None]])[PARTS]
STATIONS = np.concatenate([TRIANGLES, 0.5 * (TRIANGLES + np.roll(TRIANGLES, -1, axis=1))], axis=1)
"""The stations (3, 6, 2): in each part three corners, then three middles of edges."""
COEFFICIENTS = np.linalg.inv(np.stack([monomials(part) for part in STATIONS]))
"""The monomial coefficients (3, 6, 6) of the Lagrange functions on parts."""
RULE, RULE_WEIGHTS = np.stack([RADON_POINTS @ part for part in TRIANGLES]), np.tile(RADON_WEIGHTS / 6.0, 3)
"""Radon's points (3, 7, 2) in the three parts, and weights (21,): exact for degree 5."""
_LAGRANGE = monomials(RULE[0]) @ COEFFICIENTS[0]
MASS = np.einsum("q,qi,qj->ij", RADON_WEIGHTS / 6.0, _LAGRANGE, _LAGRANGE)
"""The integrals (6, 6) of products of Lagrange functions over a part."""
LINEAR_MASS_INVERSE = 24.0 * np.linalg.inv(np.ones((3, 3)) + np.eye(3))
"""The inverse (3, 3) of int lambda_j lambda_k over the reference triangle."""


@dataclass(frozen=True, eq=False)
class Fans:
    """The fans of c cells with n vertices."""

    cells: Ints  # (c,) cell numbers
    nodes: Ints  # (c, n) vertices
    corners: Floats  # (c, n, 2) relative to the centre of the fan
    centres: Floats  # (c, 2)
    C: Floats  # (c, 3, 3) elastic matrices for strains (e_xx, e_yy, 2 e_xy)

    @cached_property
    def alike(self) -> tuple[Ints | slice, Ints]:
        """One cell per shape, and the shape numbers (c,). Cells of a shape have equal corners and C."""
        return distinct([self.corners, self.C])

    def expand(self, matrices: Floats) -> Floats:
        """Return the matrices of all cells, given one matrix per shape."""
        some, same = self.alike
        return matrices if isinstance(some, slice) and some == slice(None) else matrices[same]

    @property
    def shapes(self) -> Fans:
        """The fans of one cell per shape."""
        rows = self.alike[0]
        return replace(self, **{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def apply(self, matrices: Floats, data: Floats) -> Floats:
        """Multiply the vector of every cell by the matrix of its shape."""
        if len(matrices) == 1:
            return np.asarray(data @ matrices[0].T)
        return np.asarray(np.matmul(self.expand(matrices), data[:, :, None])[:, :, 0])

    @property
    def rule(self) -> tuple[Floats, Ints, Floats]:
        """Quadrature of degree 5: points (c, 21 n, 2), cell numbers, and weights."""
        x = self.centres[:, None, None] + np.einsum("qa,ctba->ctqb", RULE.reshape(-1, 2), self.B)
        x = x.reshape(len(x), -1, 2)
        weights = RULE_WEIGHTS * self.doubled_areas[..., None]
        return x, np.repeat(self.cells, x.shape[1]), weights.reshape(len(x), -1)

    @property
    def n(self) -> int:
        """The number of triangles per fan."""
        return int(self.nodes.shape[1])

    @cached_property
    def B(self) -> Floats:
        """The matrices B (c, n, 2, 2) of the maps from the reference triangle."""
        return np.stack([self.corners, np.roll(self.corners, -1, axis=1)], axis=3)

    @cached_property
    def back(self) -> Floats:
        """The inverses (c, n, 2, 2) of B."""
        return np.asarray(np.linalg.inv(self.B), dtype=np.float64)

    @cached_property
    def doubled_areas(self) -> Floats:
        """The determinants (c, n) of B."""
        return cross(self.corners, np.roll(self.corners, -1, axis=1))

    @cached_property
    def areas(self) -> Floats:
        """The areas (c,) of the cells."""
        return np.asarray(0.5 * self.doubled_areas.sum(axis=1))

    @cached_property
    def normals(self) -> Floats:
        """The outward normals (c, n, 2) of outer edges, scaled by edge length."""
        return right_of(np.roll(self.corners, -1, axis=1) - self.corners)

    @cached_property
    def outline(self) -> Floats:
        """The vertices and the middles of outer edges, (c, 2 n, 2)."""
        return np.concatenate([self.corners, 0.5 * (self.corners + np.roll(self.corners, -1, axis=1))], axis=1)

    @cached_property
    def gradients(self) -> Floats:
        """The mean gradients (c, 2 n, 2) of quadratic basis functions on the outline."""
        both = self.normals + np.roll(self.normals, 1, axis=1)
        return np.asarray(np.concatenate([both, 4.0 * self.normals], axis=1) / (6.0 * self.areas[:, None, None]))

    @cached_property
    def forces(self) -> Floats:
        """The matrices (c, n, 6, 6) from the coefficients of f to the forces F_k."""
        corners = np.concatenate([0.0 * self.corners[:, :, None], self.B.swapaxes(2, 3)], axis=2)
        values = np.concatenate([np.ones((*corners.shape[:3], 1)), corners], axis=3)
        mass = (np.ones((3, 3)) + np.eye(3)) / 24.0 * self.doubled_areas[..., None, None]
        scalar = np.matmul(mass, values)
        return np.asarray(np.einsum("ctkj,ab->ctkajb", scalar, np.eye(2)).reshape(*scalar.shape[:2], 6, FORCES))


def condense(M: Floats, first: int) -> Floats:
    """Eliminate the leading unknowns from symmetric matrices."""
    # Explicit inverses lose digits near Poisson's ratio 1/2.
    inner = np.linalg.solve(M[..., :first, :first], M[..., :first, first:])
    left = M[..., first:, first:] - np.matmul(M[..., first:, :first], inner)
    return np.asarray(0.5 * (left + left.swapaxes(-1, -2)))


def condense_to_outlines(fans: Fans, each: Floats, slots: Ints) -> Floats:
    """Assemble triangle matrices, and return the forms of cells."""
    inside = int(slots.max()) + 1 - 4 * fans.n
    places = np.concatenate([slots, np.tile(int(slots.max()) + 1 + np.arange(FORCES), (fans.n, 1))], axis=1)
    by_force = np.zeros((*each.shape[:2], 18, 12 + FORCES))
    by_force[..., :12, :12], by_force[..., 12:, 12:] = np.eye(12), fans.forces
    each = np.matmul(by_force.swapaxes(-1, -2), np.matmul(each, by_force))
    whole = np.zeros((len(each), places.max() + 1, places.max() + 1))
    for triangle, at in enumerate(places):
        whole[:, at[:, None], at] += each[:, triangle]
    return condense(whole, inside)


def gather(places: Sequence[Ints], values: Sequence[Floats], size: int) -> Floats:
    """Add the values of all chunks, and return a vector (size,)."""
    where, what = (np.concatenate([one.ravel() for one in each]) for each in (places, values))
    return totals(where, what, size)


def fans_of(space: Space, C: Floats) -> tuple[Fans, ...]:
    """Return the fans of all cells, in chunks of cells with equally many vertices."""
    found = []
    for chunk in (chunk for group in space.groups for chunk in group.chunks()):
        centres = polygon_centroids(chunk.corners)[1]
        fans = Fans(
            cells=chunk.cells,
            nodes=chunk.nodes,
            corners=chunk.corners - centres[:, None],
            centres=space.mesh.points[chunk.nodes[:, 0]] + centres,
            C=C[chunk.cells],
        )
        _refuse_cells(fans)
        found.append(fans)
    return tuple(found)


SHORTEST_EDGE = 1e-3  # smallest accepted length of an edge, relative to the radius of the cell


def _refuse_cells(fans: Fans) -> None:
    """Raise SceneError for short edges, and for cells that are not star-shaped."""
    lengths = np.linalg.norm(fans.normals, axis=2)
    ratio = lengths.min(axis=1) / np.linalg.norm(fans.corners, axis=2).max(axis=1)
    if ratio.min() < SHORTEST_EDGE:
        worst = int(np.argmin(ratio))
        cell, side = int(fans.cells[worst]), int(np.argmin(lengths[worst]))
        raise SceneError(
            f"error_bound: an edge of cell {cell}, from node {fans.nodes[worst, side]}, is {ratio[worst]:.2g} of "
            f"the cell's radius; bounds are useless if this ratio is below {SHORTEST_EDGE:g}. Merge the nodes of the "
            "edge, or refine the cell there."
        )
    dented = np.flatnonzero(fans.doubled_areas.min(axis=1) <= SINGLE_EPS * fans.areas)
    if len(dented):
        raise SceneError(
            f"error_bound: cell {fans.cells[dented[0]]} is not star-shaped about its centroid; cut it into pieces "
            "that are."
        )
