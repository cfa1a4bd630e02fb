"""The part of the residual due to data: energies, in each cell, of data errors (data minus assembled data).

In the plane, data are evaluated at many points of edges and cells (:mod:`vemcvx.bound.reading` lists the energies). The
differences are tractions minus their assembled mean t_e, body forces minus the assembled f_K, and given friction bounds
g minus their linear interpolation g_h. g - g_h counts where friction is at its bound, where a node has slipped, or
where g is less than the friction. The means of these differences act as forces on the whole body.

In space, tractions are evaluated at quadrature points, body forces and stresses at vertices. Variations between nodes
are ignored for friction laws and springs; in space, also for friction bounds, gaps and supports.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import Bools, Floats, totals
from vemcvx.bound.fine_boundary import SamplePoints, without_rounding
from vemcvx.bound.reading import Reader, compare_stresses
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends, body_forces
from vemcvx.effects import Contribution, Friction, Support
from vemcvx.scene import PosedScene


@dataclass(frozen=True)
class DataErrors:
    """The differences between data and assembled data of a plane scene."""

    posed: PosedScene
    edges: Skeleton

    @cached_property
    def reader(self) -> Reader:
        """The reader of the data at points of edges and cells."""
        return Reader(self.posed, self.edges, self.edges.mesh.centroids)

    def squares(self, now: Instant, strain: Floats, forces: Floats) -> Floats:
        """Return the squared energy norms (n_cells,) of the differences; `forces` (b, 2) are loads on edges."""
        reader, edges, posed, t = self.reader, self.edges, self.posed, now.t
        traction, on_pieces = reader.pieces.compare_means(reader.on_pieces(t), forces / edges.lengths[:, None])
        body, in_cells = np.zeros((len(edges.mesh.areas), 2)), np.zeros((0, 2))
        if any(callable(load.value) for load in reader.body_loads):
            body, in_cells = reader.cells.compare_means(
                reader.body_force(reader.inside, t), body_forces(posed, t) / edges.mesh.areas[:, None]
            )
            # The mean difference counts twice: in each cell, and as a force on the whole body.
            in_cells = in_cells + body[reader.inside.owner]
        force, on_edges = edges.lengths[:, None] * traction, reader.between_nodes(now, compliant=True)
        for friction in (one for one in reader.frictions if one.law is None):
            squares, missing = self._bound(friction, now)
            on_edges, force = on_edges + squares, force + missing
        on_edges += np.sum([self._support(support, now) for support in reader.supports], axis=0)
        local = totals(edges.outer, on_edges, len(body)) + reader.energies(on_pieces, in_cells)
        local += stress_squares(posed, reader.parts, reader.inside, t, strain)
        return local + reader.body_energies(force, edges.mesh.areas[:, None] * body)

    def _bound(self, friction: Friction, now: Instant) -> tuple[Floats, Floats]:
        """Return the squared errors (b,) due to g - g_h, and the forces (b, 2) due to the mean of g - g_h on edges."""
        reader, fine, edges = self.reader, self.reader.fine, self.edges
        lam, bound, slipped, along = self._friction(now)
        at, g, line = fine.read(friction, (friction.weights(now.t) / friction.lengths)[:, None])
        differs = (g - line)[:, 0]
        exceeds = np.maximum(fine.between(lam, at) - g[:, 0], 0.0)
        # Friction of at least .99 of its bound counts as being at its bound.
        active = np.any(slipped | (lam >= 0.99 * bound), axis=1)[fine.owner[at]]
        apart = np.where(active, differs, -np.minimum(exceeds, np.abs(differs)))
        total = reader.sums(at, apart)
        scatter = np.maximum(reader.sums(at, apart**2) - total**2 / edges.lengths, 0.0)
        force = (total * along)[:, None] * edges.tangents
        weight = reader.compliance_sums(reader.compliances, edges.tangents)
        return weight * scatter, force + edges.joints.reaction(force)

    def _friction(self, now: Instant) -> tuple[Floats, Floats, Bools, Floats]:
        """Return the friction, its bound, and whether there was slip, at the ends of edges (b, 2); and a sign (b,).

        The sign is the direction of friction along the tangent, or of the motion of the edge if there is no friction.
        """
        terms, edges = self.posed.terms, self.edges
        acting = np.einsum("mb,mbd->md", now.lam, terms.tangents)
        values = np.column_stack([np.linalg.norm(acting, axis=1), now.weights, (now.worn > 0) * terms.lengths, acting])
        read = at_ends(edges, terms, values / terms.lengths[:, None])
        size, bound, worn = np.moveaxis(read[..., :3], 2, 0)
        acts, goes = (np.einsum("bed,bd->b", each, edges.tangents) for each in (read[..., 3:], edges.jumps(now.u)))
        return size, bound, worn > 0, np.sign(np.where(acts != 0.0, acts, goes))

    def _support(self, support: Support, now: Instant) -> Floats:
        """Return the squared errors (b,) due to prescribed displacements that are not linear between nodes."""
        fine, new = self.reader.fine, support.nodes >= self.reader.fine.old
        if support.value is None:
            return np.zeros(len(self.edges.outer))
        at, directions = support.nodes[new] - fine.old, support.directions[new]
        line = np.einsum("qd,qd->q", directions, fine.between(now.u[self.edges.outer_edges], at))
        value, line = without_rounding(support.value(now.t)[new], line)
        return self.reader.motion_energies(at, (value - line)[:, None] * directions)


def stress_squares(posed: PosedScene, parts: list[Contribution], at: SamplePoints, t: float, strain: Floats) -> Floats:
    """Return |(C - C_K) eps + sigma_0 - sigma_0K|^2_K in C^-1, (n_cells,)."""
    laws = [part.material.at for part in parts if part.material is not None]
    rest = [[*(one.at for one in part.eigenstrains), *(one.at for one in part.initial_stresses)] for part in parts]
    if not any(laws) and not any(map(any, rest)):
        return np.zeros(len(strain))
    apart, C = compare_stresses(posed, parts, at, t, strain)
    squares = np.einsum("qi,qi->q", apart, np.linalg.solve(C, apart[..., None])[..., 0])
    return totals(at.owner, at.weights * squares, len(strain))
