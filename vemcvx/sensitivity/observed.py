"""Quantities of a run: their values, and their derivatives with respect to displacements and contact forces.

Let A be the stiffness, A_1 the viscosity, and f the loads. Friction has the rows B^ and the forces lam. Obstacles have
the rows D^ and the forces p. The displacement is u = P y + u_D(t) with free unknowns y. The force of the supports is
R = A u + A_1 du/dt - f + B^'lam + D^'p with P'R = 0. A quantity is the energy, the losses, or a'u + h'R with vectors
a and h. If A_1 = 0, the derivatives of h'R by y, lam and p are P'A h, B^ h and D^ h.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats, directions, lengths
from vemcvx.base.errors import SceneError
from vemcvx.history import History
from vemcvx.program.system import DRAG_ROUNDING
from vemcvx.results.forces import support_shares
from vemcvx.results.probe import places
from vemcvx.scene.pose import PosedScene
from vemcvx.stepping import PreparedRun

FORM = re.compile(r"(reaction of|displacement at|slip at) (.+) ([xyz])")
FORMS = '"reaction of left x", "displacement at (1, 0.5) y", "slip at (0.5, 0) x", "energy" and "dissipated"'


@dataclass(frozen=True, eq=False)
class Observed:
    """The states of a run at T instants, under the data of a posed scene."""

    values: Floats  # (Q, T) quantities
    k: Floats  # (T,) length of the step to each instant; zero at the first instant
    forces: Floats  # (n_u, T) forces R of supports
    off: Floats  # (T, rows) slips of the step, and then D^ u - gap - compliance * p
    w: Floats  # (T, acting) friction bounds
    lam: Floats  # (T, terms, block) forces of friction; dragged nodes come last
    elastic: Floats  # (n_u, T) A u
    stored: Floats  # (T, r) spring displacements in soft contact


Gradients = tuple[Floats, Floats, Floats]
"""Derivatives (Q, T, ...) by contact unknowns, by previous contact unknowns, and by (lam, p). Losses are per step."""


@dataclass(frozen=True, eq=False)
class Quantities:
    """Q sums of a'u, h'R, `energy` times the energy, and `losses` times the losses so far."""

    a: Floats  # (Q, n_u)
    h: Floats  # (Q, n_u)
    energy: Floats  # (Q,)
    losses: Floats  # (Q,)

    def observe(self, posed: PosedScene, history: History) -> Observed:
        """Evaluate a posed scene at the states of a run."""
        run, terms, obstacles, supports = history.trajectory, posed.terms, posed.obstacles, posed.supports
        times, p, k = run.times.tolist(), run.pressures, np.diff(run.times, prepend=run.times[0])
        loads, gap = np.array([posed.force(t) for t in times]).T, np.array([obstacles.gap(t) for t in times])
        u = supports.P @ run.state.T
        if not supports.still:
            u += np.array([supports.motion(t) for t in times]).T
        du = np.diff(u, axis=1, prepend=u[:, :1])
        if history.begins == "settled":
            du[:, 0] = supports.P @ run.state[0]
        elastic, slips = posed.A @ u, (terms.rows @ du).T
        if terms.ground is not None:
            slips -= np.diff([terms.ground(t) for t in times], axis=0, prepend=[terms.ground(times[0])])
        law, none, under = terms.law_of(slice(None)), np.zeros(len(terms)), zip(times, p, strict=True)
        w = np.array([terms.weights(t) if law is None else law.weights(t, force, none, none) for t, force in under])
        # Supports determine the slips of dragged nodes, which come last. Rounding errors in slips are set to zero.
        lam, acting, size = run.multipliers.copy(), terms.acting, np.abs(u).max()
        drawn = slips.reshape(lam.shape)[:, acting:].reshape(-1, terms.block)
        drawn = np.where(np.abs(drawn) > DRAG_ROUNDING * size, drawn, 0.0)
        lam[:, acting:] = w[:, acting:, None] * directions(drawn, lengths(drawn)).reshape(len(k), -1, terms.block)
        by_row = lam.reshape(slips.shape)
        forces = elastic - loads + terms.rows.T @ by_row.T + obstacles.rows.T @ p.T
        if posed.viscosity is not None:
            forces[:, 1:] += (posed.viscosity @ du)[:, 1:] / k[1:]
        soft = p * obstacles.compliance
        rates = (obstacles.rows @ du).T - np.diff(gap, axis=0, prepend=gap[:1]) - k[:, None] * soft
        excess = np.where(obstacles.rates, rates, (obstacles.rows @ u).T - gap - soft)
        stored = soft * ~obstacles.rates
        energy = 0.5 * (np.einsum("it,it->t", u, elastic) + np.einsum("tr,tr->t", p, stored))
        losses = np.cumsum(np.where(k > 0, np.einsum("tj,tj->t", by_row, slips), 0.0))
        return Observed(
            values=self.a @ u + self.h @ forces + np.outer(self.energy, energy) + np.outer(self.losses, losses),
            k=k,
            forces=forces,
            off=np.hstack([slips[:, : acting * terms.block], excess]),
            w=w[:, :acting],
            lam=lam,
            elastic=elastic,
            stored=stored,
        )

    def differentiate(self, posed: PosedScene, at: Observed, run: PreparedRun) -> tuple[Gradients, Floats]:
        """Return `Gradients`, and derivatives (Q, n_u, T or 1) by nodal forces at fixed contact unknowns."""
        count, after, by_u = run.operators.B.shape[0], at.k[:, None] > 0, self.a + self.h @ posed.A
        P, outer = posed.supports.P, np.multiply.outer
        own, response = condense(run, P, by_u.T)
        y, inner = own[:, None], response.T[:, :, None]
        if self.energy.any():
            own, response = condense(run, P, at.elastic)
            y, inner = y + outer(self.energy, own), inner + outer(self.energy, response)
        # Losses begin with the first step.
        before = -outer(self.losses, (after * at.lam.reshape(len(at.k), -1)[:, :count]) @ run.operators.B)
        if posed.viscosity is not None:
            before[:, 1:] -= condense(run, P, (self.h @ posed.viscosity).T)[0][:, None] / at.k[1:, None]
        x = self.h @ sp.vstack([posed.terms.acting_rows, posed.obstacles.rows]).T
        by_losses, by_energy = np.zeros((2, *at.off.shape))
        by_losses[:, :count], by_energy[:, count:] = after * at.off[:, :count], at.stored
        x = x[:, None] + outer(self.losses, by_losses) + outer(self.energy, by_energy)
        return (y - before, before, x), inner


def condense(run: PreparedRun, P: sp.csr_matrix, forces: Floats) -> tuple[Floats, Floats]:
    """Return forces (k, m) condensed to contact unknowns, and motions (n_u, k) of the interior."""
    f, c = P.T @ forces, run.condensation.retained
    xi = run.condensation.solve_interior(f)
    return (f[c] - run.system.K[c] @ xi).T, P @ xi


def find_quantities(names: Sequence[str], posed: PosedScene) -> Quantities:
    """Return the quantities with these names, or raise SceneError."""
    dim, mesh = posed.space.dim, posed.space.mesh
    a, h = np.zeros((2, len(names), mesh.points.size))
    for name, of_u, of_forces in zip(names, a, h, strict=True):
        if name == "energy" or (name == "dissipated" and not posed.system.is_viscous):
            continue
        match = FORM.fullmatch(name)
        if match is None or "xyz".index(match[3]) >= dim:
            raise SceneError(f'of: found {name!r}; there are {FORMS}; dashpots exclude "dissipated".')
        axis = np.eye(dim)["xyz".index(match[3])]
        if match[1] == "reaction of":
            of_forces[:] = posed.supports.H @ support_shares(posed, match[2], axis)
            continue
        try:
            point = np.array([match[2].strip("()").split(",")], dtype=float)
        except ValueError:
            raise SceneError(f"of: found the point {match[2]!r} in {name!r}; wanted numbers, as in (1, 0.5).") from None
        if match[1] == "slip at":
            of_u[:] = _slip_row(posed, point, axis, name)
        else:
            of_u[:] = np.kron(places(mesh, point, f"of: {name}").nodes.toarray()[0], axis)
    energy, losses = (np.array([name == word for name in names], dtype=float) for word in ("energy", "dissipated"))
    return Quantities(a, h, energy, losses)


def _slip_row(posed: PosedScene, point: Floats, axis: Floats, name: str) -> Floats:
    surface, mesh, still = posed.surface, posed.space.mesh, posed.terms.ground is None
    apart = mesh.points[surface.nodes] - (point if point.shape[1] == posed.space.dim else np.inf)
    near = surface[np.flatnonzero(still & (lengths(apart) <= SAME * mesh.h))[:1]]
    if len(near) == 0:
        raise SceneError(f"of: found {name!r}; a slip needs a contact node on ground that does not move.")
    along = axis - (axis @ near.normals[0]) * near.normals[0]
    return near.matrix(along[None, None], mesh.points).toarray()[0]
