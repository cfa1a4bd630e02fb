"""Quantities of a run: their values, and their derivatives with respect to displacements and contact forces.

With u = P y + u_D(t), the viscosity A_1, and rows B^ and D^ on nodal values, supports exert the forces
R = A u + A_1 u' - f + B^'lam + D^'p; on free unknowns P'R = 0. A reaction is h'R with h = H d, where d has, for each
row of the supports, its component along an axis times its share in the boundary (:mod:`vemcvx.results.forces`).
Displacements and slips are a'u. Derivatives of h'R by y (if A_1 = 0), lam and p are P'A h, B^ h, D^ h; of a'u, P'a.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError
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
class Course:
    """The states of a run at its N + 1 instants."""

    times: Floats
    y: Floats  # (N + 1, n) free unknowns
    lam: Floats  # (N + 1, terms, block) friction forces; terms that supports drag are last
    p: Floats  # (N + 1, r) contact forces
    settles: bool  # True if the state at the initial instant is the result of a step from zero

    @property
    def durations(self) -> Floats:
        """The lengths k (N + 1,) of the steps to all instants; zero at the first one."""
        return np.diff(self.times, prepend=self.times[0])

    @property
    def rates(self) -> Floats:
        """The inverse lengths 1 / k (N + 1,); zero at the first instant."""
        return np.append(0.0, 1.0 / self.durations[1:])


@dataclass(frozen=True, eq=False)
class Observed:
    """The quantities of a scene at given states, with one row for each instant."""

    u: Floats  # (., n_u)
    forces: Floats  # (., n_u) R
    lam: Floats  # (., terms * block); friction on dragged nodes follows its bound
    slips: Floats  # (., terms * block) in the step to the instant
    excess: Floats  # (., r) motion beyond the gap, minus compliance times force
    w: Floats  # (., m)

    @classmethod
    def evaluate(cls, posed: PosedScene, course: Course) -> Observed:
        """Evaluate a posed scene at the states of a course."""
        times, p, terms, obstacles = course.times.tolist(), course.p, posed.terms, posed.obstacles
        u = np.array([displacement(posed, y, t) for y, t in zip(course.y, times, strict=True)])
        du = np.diff(u, axis=0, prepend=u[:1])
        if course.settles:
            du[0] = posed.supports.P @ course.y[0]
        norms, under = posed.system.norms, zip(times, p, strict=True)
        w = [np.zeros(0) if norms is None else norms.weights_under(t, force) for t, force in under]
        lam = course.lam.copy()
        if (dragged := posed.system.dragged) is not None:
            spans, none = zip([times[0], *times[:-1]], times, strict=True), np.zeros(dragged.count)
            for row, span, force in zip(lam[:, terms.acting :], spans, p, strict=True):
                row[:] = evaluate_dragged(posed.system, span, force, none)[0]
        flat = lam.reshape(len(times), -1)
        forces = u @ posed.A + flat @ terms.rows + p @ obstacles.rows - np.array([posed.force(t) for t in times])
        if posed.viscosity is not None:
            forces += course.rates[:, None] * (du @ posed.viscosity)
        slips, gap = du @ terms.rows.T, np.array([obstacles.gap(t) for t in times])
        if terms.ground is not None:
            ground = np.array([terms.ground(t) for t in times])
            slips -= np.diff(ground, axis=0, prepend=ground[:1])
        in_step = du @ obstacles.rows.T - np.diff(gap, axis=0, prepend=gap[:1])
        soft = obstacles.compliance * np.where(obstacles.rates, course.durations[:, None], 1.0)
        excess = np.where(obstacles.rates, in_step, u @ obstacles.rows.T - gap) - soft * p
        return cls(u=u, forces=forces, lam=flat, slips=slips, excess=excess, w=np.array(w))


@dataclass(frozen=True, eq=False)
class Gradient:
    """The derivatives of a quantity, with a row for each instant; "dissipated" is represented by its increments."""

    y: Floats  # by free unknowns
    before: Floats  # by free unknowns one instant before
    x: Floats  # by lam and p


@dataclass(frozen=True, eq=False)
class Quantities:
    """Named quantities: rows `a` (n_u,) of displacements and slips, and `h` (n_u,) of reactions."""

    names: tuple[str, ...]
    a: dict[str, Floats]
    h: dict[str, Floats]

    def values(self, posed: PosedScene, at: Observed, p: Floats) -> Floats:
        """Return the values (Q, N + 1)."""
        found = {name: at.u @ a for name, a in self.a.items()} | {name: at.forces @ h for name, h in self.h.items()}
        if "energy" in self.names:
            stored = posed.obstacles.compliance * ~posed.obstacles.rates
            found["energy"] = 0.5 * (np.einsum("ti,ti->t", at.u, at.u @ posed.A) + p**2 @ stored)
        if "dissipated" in self.names:
            found["dissipated"] = np.cumsum(np.append(0.0, np.einsum("ti,ti->t", at.lam, at.slips)[1:]))
        return np.array([found[name] for name in self.names])

    def gradients(self, posed: PosedScene, at: Observed, course: Course) -> list[Gradient]:
        """Return the derivatives of all quantities."""
        terms, rows, gather, found = posed.terms, len(course.times), posed.supports.gather, []
        m, viscosity = terms.acting * terms.block, posed.viscosity
        for name in self.names:
            by_u, before = np.zeros_like(at.u), np.zeros_like(at.u)
            by_lam, by_p = np.zeros_like(at.lam), np.zeros_like(course.p)
            if name == "energy":
                by_u, by_p = at.u @ posed.A, course.p * posed.obstacles.compliance * ~posed.obstacles.rates
            elif name == "dissipated":
                by_lam[1:], by_u[1:] = at.slips[1:], at.lam[1:] @ terms.rows
                before = -by_u
            elif name in self.a:
                by_u[:] = self.a[name]
            else:
                h = self.h[name]
                before -= 0.0 if viscosity is None else np.outer(course.rates, viscosity @ h)
                by_u = posed.A @ h - before
                by_lam[:], by_p = terms.rows @ h, np.tile(posed.obstacles.rows @ h, (rows, 1))
            found.append(Gradient(gather(by_u.T).T, gather(before.T).T, np.hstack([by_lam[:, :m], by_p])))
        return found


def find_quantities(names: Sequence[str], posed: PosedScene) -> Quantities:
    """Return the quantities with these names; raise SceneError for a name that does not fit the scene."""
    found, dim = Quantities(tuple(names), {}, {}), posed.space.dim
    for name in found.names:
        if name == "energy" or (name == "dissipated" and not posed.system.is_viscous):
            continue
        match = FORM.fullmatch(name)
        if match is None or "xyz".index(match[3]) >= dim:
            raise SceneError(f"of: found {name!r}; there are {FORMS} (without dashpots).")
        axis = np.eye(dim)["xyz".index(match[3])]
        if match[1] == "reaction of":
            found.h[name] = posed.supports.H @ support_shares(posed, match[2], axis)
            continue
        try:
            point = np.array([[float(word) for word in match[2].strip("()").split(",")]])
        except ValueError:
            raise SceneError(f"of: found the point {match[2]!r} in {name!r}; wanted coordinates: (1, 0.5).") from None
        if match[1] == "slip at":
            found.a[name] = _slip_row(posed, point, axis, name)
        else:
            found.a[name] = np.kron(places(posed.space.mesh, point, f"of: {name}").nodes.toarray()[0], axis)
    return found


def _slip_row(posed: PosedScene, point: Floats, axis: Floats, name: str) -> Floats:
    """Return the row (n_u,) of the slip at a contact node along an axis."""
    surface, mesh = posed.surface, posed.space.mesh
    if not len(surface) or point.shape[1] != posed.space.dim or posed.terms.ground is not None:
        raise SceneError(f"of: found {name!r}; slips are those of contact nodes, on ground that does not move.")
    away, (row,) = nearest(mesh.points[surface.nodes], point)
    if away[0] > SAME * mesh.h:
        raise SceneError(f"of: found {name!r}; the nearest contact node is at {mesh.points[surface.nodes[row]]}.")
    along = axis - (axis @ surface.normals[row]) * surface.normals[row]
    return jump_rows(surface.nodes[[row]], surface.partners[[row]], along[None, None], mesh.points).toarray()[0]
