"""Quantities of a run: their values, and their derivatives with respect to displacements and contact forces.

Let A be the stiffness, A_1 the viscosity, and f the loads. Friction has the rows B^ and the forces lam. Obstacles have
the rows D^ and the forces p. The displacement is u = P y + u_D(t) with free unknowns y. The force of the supports is
R = A u + A_1 du/dt - f + B^'lam + D^'p with P'R = 0. A quantity is the energy, the losses, or a'u + h'R with vectors
a and h. If A_1 = 0, the derivatives of h'R by y, lam and p are P'A h, B^ h and D^ h.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError
from vemcvx.history import History
from vemcvx.meshes.polygons import nearest
from vemcvx.results.forces import support_shares
from vemcvx.results.probe import places
from vemcvx.results.results import displacement
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import jump_rows
from vemcvx.stepping.state import evaluate_dragged

FORM = re.compile(r"(reaction of|displacement at|slip at) (.+) ([xyz])")
FORMS = '"reaction of left x", "displacement at (1, 0.5) y", "slip at (0.5, 0) x", "energy" and "dissipated"'


@dataclass(frozen=True, eq=False)
class Observed:
    """The states of a run at T instants."""

    k: Floats  # (T,) length of the step to each instant; zero at the first instant
    u: Floats  # (T, n_u) displacements
    elastic: Floats  # (T, n_u) A u
    forces: Floats  # (T, n_u) forces R of supports
    lam: Floats  # (T, terms, block) forces of friction; dragged nodes come last
    slips: Floats  # (T, terms * block) in the step to the instant
    p: Floats  # (T, r) forces of obstacles
    excess: Floats  # (T, r) motion beyond the gap, minus compliance times force
    stored: Floats  # (T, r) spring displacements in soft contact
    w: Floats  # (T, m) friction bounds

    @classmethod
    def evaluate(cls, posed: PosedScene, history: History) -> Observed:
        """Evaluate a posed scene at the states of a run."""
        run, terms, obstacles, norms = history.trajectory, posed.terms, posed.obstacles, posed.system.norms
        times, p, k = run.times.tolist(), run.pressures, np.diff(run.times, prepend=run.times[0])
        u = np.array([displacement(posed, y, t) for y, t in zip(run.state, times, strict=True)])
        du = np.diff(u, axis=0, prepend=u[:1])
        if history.begins == "settled":
            du[0] = posed.supports.P @ run.state[0]
        under = list(zip([times[0], *times[:-1]], times, p, strict=True))
        w = [np.zeros(0) if norms is None else norms.weights_under(t, force) for _, t, force in under]
        dragged = [evaluate_dragged(posed.system, (s, t), force, np.zeros(0))[0] for s, t, force in under]
        lam = np.concatenate([run.multipliers[:, : terms.acting], dragged], axis=1)
        elastic, slips, gap = u @ posed.A, du @ terms.rows.T, np.array([obstacles.gap(t) for t in times])
        loads = np.array([posed.force(t) for t in times])
        forces = elastic + lam.reshape(slips.shape) @ terms.rows + p @ obstacles.rows - loads
        if posed.viscosity is not None:
            forces[1:] += (du @ posed.viscosity)[1:] / k[1:, None]
        if terms.ground is not None:
            slips -= np.diff([terms.ground(t) for t in times], axis=0, prepend=[terms.ground(times[0])])
        soft = p * obstacles.compliance
        rates = du @ obstacles.rows.T - np.diff(gap, axis=0, prepend=gap[:1]) - k[:, None] * soft
        return cls(
            k=k,
            u=u,
            elastic=elastic,
            forces=forces,
            lam=lam,
            slips=slips,
            p=p,
            excess=np.where(obstacles.rates, rates, u @ obstacles.rows.T - gap - soft),
            stored=soft * ~obstacles.rates,
            w=np.array(w),
        )

    @property
    def losses(self) -> Floats:
        """The losses (T,) by friction in the step to each instant; zero at the first instant."""
        return np.append(0.0, np.einsum("tmb,tmb->t", self.lam, self.slips.reshape(self.lam.shape))[1:])


@dataclass(frozen=True, eq=False)
class Gradients:
    """The derivatives of Q quantities; "dissipated" is here the loss in the step to each instant."""

    y: Floats  # (Q, T, m) by the contact unknowns
    before: Floats  # (Q, T, m) by the contact unknowns one instant before
    x: Floats  # (Q, T, rows) by lam and p
    inner: Floats  # (Q, T or 1, n) by forces on the interior, while the contact unknowns are fixed


@dataclass(frozen=True, eq=False)
class Quantities:
    """Q quantities a'u + h'R + `energy` times the energy + `losses` times the losses so far."""

    a: Floats  # (Q, n_u)
    h: Floats  # (Q, n_u)
    energy: Floats  # (Q,)
    losses: Floats  # (Q,)

    def values(self, at: Observed) -> Floats:
        """Return the values (Q, T)."""
        energy = 0.5 * (np.einsum("ti,ti->t", at.u, at.elastic) + np.einsum("tr,tr->t", at.p, at.stored))
        found: Floats = self.a @ at.u.T + self.h @ at.forces.T + np.outer(self.energy, energy)
        return found + np.outer(self.losses, np.cumsum(at.losses))

    def differentiate(
        self, posed: PosedScene, at: Observed, E: Any, solve_interior: Callable[[Floats], Floats]
    ) -> Gradients:
        """Return the derivatives; E (n, m) maps contact unknowns to free unknowns y."""
        gather, terms, acting = posed.supports.gather, posed.terms, posed.system.B.shape[0]
        after = at.k[:, None] > 0  # Losses begin with the first step.
        fixed, outer = gather((self.a + self.h @ posed.A).T), np.multiply.outer
        before = -outer(self.losses, gather((after * at.lam.reshape(at.slips.shape) @ terms.rows).T).T @ E)
        if posed.viscosity is not None:
            before[:, 1:] -= (gather((self.h @ posed.viscosity).T).T @ E)[:, None] / at.k[1:, None]
        stored = gather(at.elastic.T) if self.energy.any() else np.zeros((len(fixed), 1))
        x = self.h @ sp.vstack([terms.rows[:acting], posed.obstacles.rows]).T
        by_losses, by_energy = np.zeros((2, len(at.u), x.shape[1]))
        by_losses[:, :acting], by_energy[:, acting:] = after * at.slips[:, :acting], at.stored
        return Gradients(
            y=(fixed.T @ E)[:, None] + outer(self.energy, stored.T @ E) - before,
            before=before,
            x=x[:, None] + outer(self.losses, by_losses) + outer(self.energy, by_energy),
            inner=solve_interior(fixed).T[:, None] + outer(self.energy, solve_interior(stored).T),
        )


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
            point = np.array([[float(word) for word in match[2].strip("()").split(",")]])
        except ValueError:
            raise SceneError(f"of: found the point {match[2]!r} in {name!r}; wanted coordinates: (1, 0.5).") from None
        if match[1] == "slip at":
            of_u[:] = _slip_row(posed, point, axis, name)
        else:
            of_u[:] = np.kron(places(mesh, point, f"of: {name}").nodes.toarray()[0], axis)
    energy, losses = (np.array([name == word for name in names], dtype=float) for word in ("energy", "dissipated"))
    return Quantities(a, h, energy, losses)


def _slip_row(posed: PosedScene, point: Floats, axis: Floats, name: str) -> Floats:
    surface, mesh = posed.surface, posed.space.mesh
    if not len(surface) or point.shape[1] != posed.space.dim or posed.terms.ground is not None:
        raise SceneError(f"of: found {name!r}; slips are those of contact nodes, on ground that does not move.")
    away, (row,) = nearest(mesh.points[surface.nodes], point)
    if away[0] > SAME * mesh.h:
        raise SceneError(f"of: found {name!r}; the nearest contact node is at {mesh.points[surface.nodes[row]]}.")
    along = axis - (axis @ surface.normals[row]) * surface.normals[row]
    return jump_rows(surface.nodes[[row]], surface.partners[[row]], along[None, None], mesh.points).toarray()[0]
