"""The shape of cells: the constants that Assumption 3.3 of the paper asks of them, cell by cell.

Assumption 3.3 wants every cell K cut into triangles, shape regular and of a size comparable to h_K, each edge of K a
side of one. It holds with constants that depend on two ratios alone (L. Chen and J. Huang, Some error analysis on
virtual element methods, Calcolo 55, 2018; S. Brenner and L.-Y. Sung, Virtual element methods on meshes with small edges
or faces, 2018), which are

    star    rho_K / h_K,    rho_K the radius of the largest ball from all of whose points all of K is seen,
    edge    the shortest edge / h_K.

All of K is seen from x if x is on the inner side of all edges (faces), so that

    rho_K = max over x of min over e of n_e . (a_e - x),     n_e outwards, a_e on e,

which is the radius of the inscribed circle (sphere) where K is convex, and less than zero where K is not star-shaped:
star is 0 then. In x and rho this is a linear program with a row n_e . x + rho <= n_e . a_e for every side, and its
answer is where dim + 1 of them meet. The dual simplex method finds it, all cells at once: from dim + 1 sides that are
far away, the side that is violated most enters, and that one leaves without which the multipliers of the others stay
positive. In boxes many are tied: so sides are moved by some 1e-9 of the size of the cell, each by another, and rho is
made larger along a direction by as much.

What they cost: the stabilisation S is to be of the size of the energy a_mu of what Pi misses, (2.9). On a regular
hexagon S / a_mu is 1.0 to 1.9. Stretched, it is .20 to 18 at ten to one (star .043), .020 to 195 at a hundred to one:
both ways by the aspect. Square cells with a dent that leaves star .01 have .47 to 9.5. A short edge costs a logarithm:
.65 to 2.5 at edge .1 and .13 to 2.5 at 1e-4 (problems/stabilisation_spectrum.py).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import ROUNDING, SAME, Bools, Floats, Ints
from vemcvx.base.errors import MeshWarning
from vemcvx.base.outline import Outline, Outlined
from vemcvx.meshes.polygons import next_corner, right_of
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation

STAR, EDGE = 0.05, 1e-4
"""Ratios below which a warning is due: stretched by nine to one, where S / a_mu spreads over a factor of seventy, and
edges that leave an eighth of the energy."""


@dataclass(frozen=True, eq=False, repr=False)
class Quality(Outlined):
    """Shapes of the cells of a mesh, by the two ratios on which the constants of Assumption 3.3 depend.

    Attributes
    ----------
    star : (n_cells,)
        The radius of the largest ball from which all of the cell is seen, in parts of its diameter; 0 where there is
        none. At most 1/2; of a square .35, of a regular hexagon .43, of a cube .29.
    edge : (n_cells,)
        The shortest edge in parts of the diameter.
    in_plane : bool
        Whether short edges are remarked: of polyhedra what they cost is not measured.
    """

    star: Floats
    edge: Floats
    in_plane: bool = True

    @property
    def poor(self) -> Bools:
        """(n_cells,) whether constants grow there: star below .05, or in the plane edge below 1e-4."""
        poor: Bools = (self.star < STAR) | ((self.edge < EDGE) & self.in_plane)
        return poor

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about cells where constants grow; none where all are well shaped."""
        said = []
        for ratio, least, words in (
            (
                self.star,
                STAR,
                "are stretched, dented or not star-shaped (star < .05): the stabilisation is off by their aspect, both "
                "ways; halve them along, or cut them",
            ),
            (
                self.edge if self.in_plane else np.ones_like(self.edge),
                EDGE,
                "have edges below 1e-4 of their diameter: the stabilisation falls with the logarithm of that; "
                "collapse them",
            ),
        ):
            if (count := int((ratio < least).sum())) > 0:
                worst = int(np.argmin(ratio))
                said.append(f"{count} of {len(ratio)} cells {words}. The worst is cell {worst}, {ratio[worst]:.2g}.")
        return tuple(said)

    def in_a_line(self) -> str:
        """Ranges of the ratios, and how many cells are poor."""
        ranges = [f"{name} {values.min():.2g} to {values.max():.2g}" for name, values in self._named]
        good = f" (good above {STAR:g} and {EDGE:g})" if self.in_plane else f" (star is good above {STAR:g})"
        count = int(self.poor.sum())
        return ", ".join(ranges) + good + (f"; constants grow in {count} of {len(self.star)} cells" if count else "")

    @property
    def _named(self) -> tuple[tuple[str, Floats], ...]:
        return ("star", self.star), ("edge", self.edge)

    def outline(self) -> Outline:
        """The outline for prompts and notebooks."""
        ranges = [
            (name, f"{values.min():.3g} to {values.max():.3g}, in the median {np.median(values):.3g}")
            for name, values in self._named
        ]
        return Outline(
            f"Quality: shapes of {len(self.star)} cells", [*ranges, *(("grows", words) for words in self.remarks)]
        )


def quality_of(mesh: Tessellation | SpaceTessellation, *, warned: bool = True) -> Quality:
    """The shapes of all cells; a MeshWarning says where constants grow, unless it is not `warned`."""
    if isinstance(mesh, Tessellation):
        along = _along(mesh.points, mesh.offsets, mesh.vertices)
        lengths = np.linalg.norm(along, axis=1)
        offsets, normals, places = mesh.offsets, right_of(along) / lengths[:, None], mesh.points[mesh.vertices]
    else:
        faces, along = mesh.cell_faces, _along(mesh.points, mesh.face_offsets, mesh.face_vertices)
        lengths = np.minimum.reduceat(np.linalg.norm(along, axis=1), mesh.face_offsets[:-1])[faces]
        offsets, normals = mesh.cell_offsets, mesh.face_signs[:, None] * mesh.face_normals[faces]
        places = mesh.face_centroids[faces]
    star = np.maximum(_radii(offsets, normals, places, mesh.centroids), 0.0) / mesh.diameters
    edge = np.minimum.reduceat(lengths, offsets[:-1]) / mesh.diameters
    found = Quality(star, edge, in_plane=isinstance(mesh, Tessellation))
    for words in found.remarks if warned else ():
        warnings.warn(f"quality: {words}", MeshWarning, stacklevel=3)
    return found


def _along(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """The edges that start at corners, as vectors."""
    return points[vertices[next_corner(offsets)]] - points[vertices]


def _radii(offsets: Ints, normals: Floats, places: Floats, centres: Floats) -> Floats:
    """rho_K (n_cells,) from outward unit normals (k, dim) of sides and places (k, dim) on them, cell by cell."""
    counts, radii = np.diff(offsets), np.zeros(len(offsets) - 1)
    for n in np.unique(counts):
        cells = np.flatnonzero(counts == n)
        sides = offsets[cells][:, None] + np.arange(n)
        away = np.einsum("cni,cni->cn", normals[sides], places[sides] - centres[cells][:, None])
        radii[cells] = _largest(normals[sides], away)
    return radii


def _largest(normals: Floats, away: Floats) -> Floats:
    """max over x of min over sides of away - n . x, (c,), from normals (c, n, dim) and distances (c, n)."""
    count, n, dim = normals.shape
    size = np.abs(away).max(axis=1)
    # The sides that a search begins with are farther than all others.
    first = np.vstack([np.eye(dim), -np.ones(dim) / np.sqrt(dim)])
    rows = np.concatenate([np.tile(first, (count, 1, 1)), normals], axis=1)
    rows = np.concatenate([rows, np.ones((count, n + dim + 1, 1))], axis=2)
    shift = SAME * (np.arange(n) * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0)
    right = np.concatenate(
        [np.tile(np.abs(away).sum(axis=1, keepdims=True), dim + 1), away + size[:, None] * shift], axis=1
    )
    met, at, radii = np.tile(np.arange(dim + 1), (count, 1)), np.arange(count), np.full(count, np.nan)
    for _ in range(8 * (n + dim)):
        best = np.linalg.solve(rows[at[:, None], met[at]], right[at[:, None], met[at]][..., None])
        slack = right[at] - (rows[at] @ best)[..., 0]
        done = slack.min(axis=1) >= -ROUNDING * size[at]
        at_best = np.einsum("cni,ci->cn", normals[at[done]], best[done, :dim, 0])
        radii[at[done]] = (away[at[done]] - at_best).min(axis=1)
        at, entering = at[~done], slack[~done].argmin(axis=1)
        if not len(at):
            break
        met[at] = _exchanged(rows[at], met[at], entering)
    # Where two sides take turns: none such has been met.
    for cell in at:
        radii[cell] = _by_linear_program(rows[cell], right[cell])
    return radii


def _exchanged(rows: Floats, met: Ints, entering: Ints) -> Ints:
    """The sides that meet (c, dim + 1) once another enters, for the one whose leaving keeps multipliers positive."""
    count, size = met.shape
    tried = np.repeat(met[:, None], size, axis=1)
    tried[:, np.arange(size), np.arange(size)] = entering[:, None]
    matrix = rows[np.arange(count)[:, None, None], tried].transpose(0, 1, 3, 2)
    singular = np.abs(np.linalg.det(matrix)) < ROUNDING
    matrix[singular] = np.eye(size)
    cost = np.append(SAME * np.sqrt(np.arange(1.0, size)), 1.0)  # What is maximised: rho, and a little of x.
    least = np.linalg.solve(matrix, cost[:, None])[..., 0].min(axis=2)
    chosen: Ints = np.where(singular, -np.inf, least).argmax(axis=1)
    return np.asarray(tried[np.arange(count), chosen])


def _by_linear_program(rows: Floats, right: Floats) -> float:
    from scipy.optimize import linprog  # Importing it takes a fifth of a second, and few cells come here.

    size = rows.shape[1]
    found = linprog(-np.eye(size)[-1], A_ub=rows, b_ub=right, bounds=[(None, None)] * size)
    return float(found.x[-1]) if found.x is not None else np.nan
