"""Linear fits to the data of a scene, and an estimate of the errors due to the fits.

Error bounds evaluate data on pieces of edges (:mod:`vemcvx.bound.fine_boundary`) and at quadrature points in cells. The
bounds hold for linear fits to these values. The fits are called data *as read*.

A remainder is a datum minus the fit. On a displacement w, all remainders do the work l_0(w). The functional l_0 has the
norm eta = sup l_0(w) / |w|, with the energy norm |w|. We estimate eta^2 by the sum of the energies below. Here mu is
the shear modulus, l_e the length of an edge, d_K the size of a cell (:func:`.skeleton.extents`), and w_t the slip of w.
The L2 norms on an edge and in a cell are |.|_e and |.|_K.

    remainder of        work on w                    energy
    tractions t         int t . w                    l_e / (4 mu) |t|^2_e
    friction bounds g   int g |w_t|                  l_e / (4 mu) |g|^2_e
    body forces f       int f . w                    d_K^2 / (18 mu) |f|^2_K
    gaps d              none                         2 mu max |d|^2

The solutions for the data and for the fits differ by at most eta, also with friction. The energies of t and f are half
of the bounds from Poincare inequalities, because these remainders are orthogonal to linear functions. Changes of data
between the evaluated points may be missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import SAME, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.fan import Fans
from vemcvx.bound.fine_boundary import PIECES, FineBoundary, fine_boundary
from vemcvx.bound.skeleton import Instant, Skeleton, pressures_at_ends
from vemcvx.effects import Contribution, Effect, Friction, Load, MaterialLaw, Obstacle, Support
from vemcvx.meshes.polygons import positions
from vemcvx.scene import PosedScene, contributions, suppress_scene_warnings
from vemcvx.vem import Space
from vemcvx.vem.tensors import elastic_matrix

POINCARE = 1.0 / 9.0  # Poincare constant 1 / pi^2 of a convex cell in a unit box, plus 10 %


@dataclass(frozen=True, eq=False)
class Reading:
    """The linear fits to the data at an instant."""

    tractions: Floats  # (b, 2, 2) tractions at the ends of edges
    friction: Floats  # (b, 2) friction bounds at the ends of edges
    body: Floats  # (n_cells, 6) coefficients of body forces
    omitted: Floats  # scaled remainders, with the norm eta

    @property
    def eta(self) -> float:
        """The estimated norm of the functional l_0."""
        return float(np.linalg.norm(self.omitted))


@dataclass(frozen=True, eq=False)
class Reader:
    """The effects of a posed scene, evaluated on a finer boundary and in cells."""

    posed: PosedScene
    edges: Skeleton
    fans: Sequence[Fans] = ()  # cells with fits to body forces
    effects: Sequence[Effect] | None = None  # None for the effects of the scene

    @cached_property
    def fine(self) -> FineBoundary:
        """The mesh with boundary edges cut into pieces."""
        return fine_boundary(self.edges.mesh, self.edges)

    @cached_property
    def parts(self) -> list[Contribution]:
        """The contributions of the effects to the fine mesh."""
        return list_parts(self.posed, Space(self.fine.mesh), self.effects)

    @property
    def frictions(self) -> list[Friction]:
        """The frictions in `parts`."""
        return [friction for part in self.parts for friction in part.frictions]

    @property
    def obstacles(self) -> list[Obstacle]:
        """The obstacles in `parts`."""
        return [obstacle for part in self.parts for obstacle in part.obstacles]

    @property
    def supports(self) -> list[Support]:
        """The supports in `parts`."""
        return [support for part in self.parts for support in part.supports]

    @cached_property
    def body_loads(self) -> list[Load]:
        """The body forces in `parts`."""
        loads = [load for part in self.parts for load in part.loads if load.cells is not None]
        for load in loads:
            if load.is_scalar:
                raise SceneError(
                    f"error_bound: there is no bound for {load.subject}, a body force of one component; give it as a "
                    "vector, as BodyForce does."
                )
        return loads

    def at(self, now: Instant) -> Reading:
        """Return the data at an instant."""
        self._check_lines(now.t)
        edges, shear, s = self.edges, self.edges.shear[self.edges.outer], np.arange(1, PIECES) / PIECES
        tractions, on_edges = _fit_lines(np.append(s, 1.0) - 0.5 / PIECES, self._tractions(now.t))
        friction, of_bounds = _fit_lines(s, self._friction_bounds(now.t))
        body, in_cells = self.body_forces(now.t)
        scale = edges.lengths[:, None, None] / np.sqrt(4.0 * shear[:, None, None] * PIECES)
        remainders = scale * on_edges, scale * of_bounds, in_cells, np.sqrt(2.0 * shear) * self._deviations_of_gaps(now)
        omitted = np.concatenate([one.ravel() for one in remainders])
        return Reading(tractions, np.maximum(friction[..., 0], 0.0), body, omitted)

    def local_errors(self, now: Instant, means: Floats) -> Floats:
        """Return the energies (b,) of remainders on edges."""
        edges, shear, squares = self.edges, self.edges.shear[self.edges.outer], np.zeros(len(self.edges.outer))
        tractions = self._tractions(now.t)
        squares += np.mean(np.sum(_remove_rounding(tractions, tractions - means[:, None]) ** 2, axis=2), axis=1)
        for friction in (one for one in self.frictions if one.law is None):
            at, bound, line = self.fine.read(friction, (friction.weights(now.t) / friction.lengths)[:, None])
            squares += totals(self.fine.owner[at], (bound - line)[:, 0] ** 2 / PIECES, len(squares))
        return edges.lengths**2 / (2.0 * shear) * squares + 2.0 * shear * self._deviations_of_gaps(now) ** 2

    def _tractions(self, t: float) -> Floats:
        """Return the mean tractions (b, PIECES, 2) on pieces of edges."""
        fine, force = self.fine, np.zeros(self.fine.pieces.shape)
        for load in (load for part in self.parts for load in part.loads):
            if load.edges is not None:
                np.add.at(force, positions(load.edges, fine.pieces, fine.mesh.n_nodes), load.forces(t))
        return force.reshape(-1, PIECES, 2) * (PIECES / self.edges.lengths[:, None, None])

    def _friction_bounds(self, t: float) -> Floats:
        """Return friction bounds (b, PIECES - 1, 1) at new nodes."""
        g = np.zeros((len(self.fine.owner), 1))
        for friction in (one for one in self.frictions if one.law is None):
            at, bound, _ = self.fine.read(friction, (friction.weights(t) / friction.lengths)[:, None])
            g[at] += bound
        return g.reshape(-1, PIECES - 1, 1)

    def body_forces(self, t: float) -> tuple[Floats, Floats]:
        """Return linear fits (n_cells, 6) to body forces, and the scaled remainders."""
        found, scaled = np.zeros((len(self.edges.mesh.areas), 6)), [np.zeros(0)]
        factor = np.sqrt(0.5 * POINCARE / self.edges.shear) * self.edges.sizes
        for fans in self.fans if self.body_loads else ():
            (x, owner, weights), h = fans.rule, np.sqrt(fans.areas)[:, None, None]
            f = np.sum([load.in_cells(x.reshape(-1, 2), owner, t) for load in self.body_loads], axis=0).reshape(x.shape)
            basis = np.concatenate([np.ones((*x.shape[:2], 1)), (x - fans.centres[:, None]) / h], axis=2)
            weighed = (weights[..., None] * basis).swapaxes(1, 2)
            fit = np.linalg.solve(weighed @ basis, weighed @ f)
            left = _remove_rounding(f, f - basis @ fit)
            fit[:, 1:] /= h
            found[fans.cells] = fit.reshape(-1, 6)
            scaled.append(np.ravel(factor[fans.cells, None, None] * np.sqrt(weights)[..., None] * left))
        return found, np.concatenate(scaled)

    def _deviations_of_gaps(self, now: Instant) -> Floats:
        """Return the largest |gap - interpolant| (b,) on edges in contact."""
        fine, edges, highest = self.fine, self.edges, np.zeros(len(self.edges.outer))
        if not self.obstacles:
            return highest
        pressed = np.any(pressures_at_ends(self.posed, edges, now) > 0.0, axis=1)[fine.owner]
        outward = fine.between(np.einsum("bd,bsd->bs", edges.units, edges.jumps(now.u)))
        for obstacle in self.obstacles:
            at, gap, line = (one.ravel() for one in fine.read(obstacle, obstacle.gap(now.t)[:, None]))
            touches = pressed[at] | (outward[at] > gap)
            np.maximum.at(highest, fine.owner[at], np.where(touches, np.abs(gap - line), 0.0))
        return highest

    def _check_lines(self, t: float) -> None:
        given = list[tuple[Friction | Obstacle, str, Floats]]()
        given += [(one, "ground", one.ground.vector(t)) for one in self.frictions if one.ground is not None]
        given += [(one, "stiffness", stiffness_of(one)[:, None]) for one in self.obstacles]
        for one, name, values in given:
            _, found, line = self.fine.read(one, values)
            if (found != line).any():
                raise SceneError(
                    f"error_bound: there is no bound for {one.subject}, whose {name} is not linear between nodes; "
                    "give a function that is linear on edges."
                )

    def varies_inside_cells(self, t: float) -> bool:
        """Return True if moduli, eigenstrains or prestress vary inside cells."""
        unit = np.ones((len(self.edges.mesh.areas), 3))
        return varies_in_place(self.parts) and any(
            compare_stresses(self.posed, self.parts, (fans.rule[0].reshape(-1, 2), fans.rule[1]), t, strain)[0].any()
            for fans in self.fans
            for strain in (0.0 * unit, unit)
        )


def stiffness_of(obstacle: Obstacle) -> Floats:
    """Return the stiffness per length (m,) of an obstacle, zero if rigid."""
    soft = obstacle.compliance > 0
    return np.divide(1.0, obstacle.compliance * obstacle.lengths, out=np.zeros(len(soft)), where=soft)


def _fit_lines(s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the end values (b, 2, d) of linear fits on edges, and the remainders."""
    basis = np.column_stack([1.0 - s, s])
    found = np.matmul(np.linalg.pinv(basis), values)
    return found, _remove_rounding(values, values - np.matmul(basis, found))


def _remove_rounding(values: Floats, left: Floats) -> Floats:
    return np.where(np.abs(left) <= SAME * np.abs(values).max(initial=0.0), 0.0, left)


def list_parts(posed: PosedScene, space: Space, effects: Sequence[Effect] | None = None) -> list[Contribution]:
    """Return the contributions of effects to a space, and the materials of the posed scene."""
    others = [effect for effect in effects or posed.scene.canonical if not isinstance(effect, MaterialLaw)]
    with suppress_scene_warnings():
        return [*(part for _, part in contributions(others, space)), *posed.laws]


def varies_in_place(parts: Sequence[Contribution]) -> bool:
    """Return True if moduli, eigenstrains or prestress vary with position."""
    laws = any(part.material is not None and part.material.at is not None for part in parts)
    swell = any(one.at is not None for part in parts for one in part.eigenstrains)
    return laws or swell or any(one.at is not None for part in parts for one in part.initial_stresses)


def compare_stresses(
    posed: PosedScene, parts: Sequence[Contribution], at: tuple[Floats, Ints], t: float, strain: Floats
) -> tuple[Floats, Floats]:
    """Return stress errors (q, m) of cell-wise constant data, and elastic matrices."""
    (x, owner), material, dim = at, posed.material, posed.space.dim
    C_K, blocked_K = elastic_matrix(material.moduli, dim), material.thermal_stress_moduli
    C, blocked = C_K[owner], blocked_K[owner]
    for law in (part.material for part in parts if part.material):
        if law.at:
            here = np.ones(len(owner), dtype=bool) if law.cells is None else law.cells[owner]
            moduli, blocked[here] = law.at(x[here], owner[here])
            C[here] = elastic_matrix(moduli, dim)
    apart = np.einsum("qij,qj->qi", C - C_K[owner], strain[owner])
    for part in parts:
        for swelling in part.eigenstrains:
            if swelling.at:
                rest = blocked * swelling.at(x, owner, t)[:, None]
                apart += blocked_K[owner] * swelling.value(t)[owner, None] - rest
        for stress in part.initial_stresses:
            apart += 0.0 if stress.at is None else stress.at(x, owner, t) - stress.value(t)[owner]
    return apart, C
