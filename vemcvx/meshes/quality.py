r"""The shape of cells: the constants that Assumption 3.3 of the paper asks of them, cell by cell.

Assumption 3.3 wants every cell K cut into triangles, shape regular and of a size comparable to h_K, each edge of K a
side of one. It holds with constants that depend on two ratios alone (L. Chen and J. Huang, Some error analysis on
virtual element methods, Calcolo 55, 2018; S. Brenner and L.-Y. Sung, Virtual element methods on meshes with small edges
or faces, 2018), which are

- star: rho_K / h_K, with rho_K the radius of the largest ball from all of whose points all of K is seen;
- edge: the shortest edge / h_K.

All of K is seen from x if x is on the inner side of all edges (faces), so that

$$ \rho_K = \max_x \min_e \, n_e \cdot (a_e - x), \qquad n_e \text{ outwards, } a_e \text{ on } e, $$

which is the radius of the inscribed circle (sphere) where K is convex, and less than zero where K is not star-shaped:
star is 0 then. In x and rho this is a linear program with a row n_e . x + rho <= n_e . a_e for every side; HiGHS solves
those of thousands of cells at once.

What they cost: the stabilisation S is to be of the size of the energy a_mu of what Pi misses, (2.9). On a regular
hexagon S / a_mu is 1.0 to 1.9. Stretched, it is .20 to 18 at ten to one (star .043), .020 to 195 at a hundred to one:
both ways by the aspect. Square cells with a dent that leaves star .01 have .47 to 9.5. A short edge costs a logarithm:
.65 to 2.5 at edge .1 and .13 to 2.5 at 1e-4 (problems/stabilisation_spectrum.py).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from vemcvx.base.arrays import CHUNK_SIZE, Bools, Floats, Ints
from vemcvx.base.errors import MeshWarning
from vemcvx.base.outline import Outline, Outlined
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import cell_of_corner, next_corner, right_of
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

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


def quality_of(mesh: Mesh, *, warned: bool = True) -> Quality:
    """The shapes of all cells; a MeshWarning says where constants grow, unless it is not `warned`."""
    offsets, normals, away, lengths = walls_of(mesh)
    star = np.maximum(largest_balls(offsets, normals, away)[1], 0.0)
    edge = np.minimum.reduceat(lengths, offsets[:-1]) / mesh.diameters
    found = Quality(star, edge, in_plane=isinstance(mesh, PolygonMesh))
    for words in found.remarks if warned else ():
        warnings.warn(f"quality: {words}", MeshWarning, stacklevel=3)
    return found


class Walls(NamedTuple):
    """The lines, or planes, of the sides of all cells, cell by cell."""

    offsets: Ints
    normals: Floats  # (k, dim) outward unit normals
    away: Floats  # (k,) how far they are from the centroid, in diameters
    lengths: Floats  # (k,) of edges, in space of the shortest edge of each face


def walls_of(mesh: Mesh) -> Walls:
    """The walls of all cells of a mesh."""
    if isinstance(mesh, PolygonMesh):
        along = _along(mesh.points, mesh.offsets, mesh.vertices)
        lengths = np.linalg.norm(along, axis=1)
        offsets, normals, places = mesh.offsets, right_of(along) / lengths[:, None], mesh.points[mesh.vertices]
    elif isinstance(mesh, PolyhedralMesh):
        faces, along = mesh.cell_faces, _along(mesh.points, mesh.face_offsets, mesh.face_vertices)
        lengths = np.minimum.reduceat(np.linalg.norm(along, axis=1), mesh.face_offsets[:-1])[faces]
        offsets, normals = mesh.cell_offsets, mesh.face_signs[:, None] * mesh.face_normals[faces]
        places = mesh.face_centroids[faces]
    owner = cell_of_corner(offsets)
    away = np.einsum("ki,ki->k", normals, places - mesh.centroids[owner]) / mesh.diameters[owner]
    return Walls(offsets, normals, away, lengths)


def _along(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """The edges that start at corners, as vectors."""
    return points[vertices[next_corner(offsets)]] - points[vertices]


def largest_balls(offsets: Ints, normals: Floats, away: Floats) -> tuple[Floats, Floats]:
    """Centres (c, dim) from the centroid, and radii rho_K (c,), both over h_K, for the walls of c cells."""
    from scipy.optimize import linprog

    size, cells = normals.shape[1] + 1, len(offsets) - 1
    found = np.empty((cells, size))
    for first in range(0, cells, CHUNK_SIZE):
        last = min(first + CHUNK_SIZE, cells)
        sides = slice(offsets[first], offsets[last])
        rows = np.column_stack([normals[sides], np.ones(len(normals[sides]))])
        columns = (cell_of_corner(offsets[first : last + 1])[:, None]) * size + np.arange(size)
        starts = size * np.arange(len(rows) + 1)
        matrix: Any = csr_array((rows.ravel(), columns.ravel(), starts), shape=(len(rows), size * (last - first)))
        cost = np.tile(np.append(np.zeros(size - 1), -1.0), last - first)
        solved: Any = linprog(cost, A_ub=matrix, b_ub=away[sides], bounds=(None, None))
        found[first:last] = solved.x.reshape(-1, size)
    return found[:, :-1], found[:, -1]
