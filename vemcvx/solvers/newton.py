r"""Semismooth Newton on active sets, for the contact forces x = (lam, p) of a step (docs/theory/semismooth_newton.md).

Norm terms have the forces lam, the slips s and the weights w. The limits have the forces p. Let x_law be x, but with
the forces of the law on slipping terms and open limits. The next x is x_law + Q z. The unknowns z are changes of

- forces of sticking terms,
- forces of acting limits, which change friction by J = dw/dp,
- forces across the direction of slip, with the compliance |s|/w,
- forces along the direction of slip if w depends on |s|, with the compliance 1 / (dw/d|s|).

Let P be Q' without J, and W the Delassus matrix (:mod:`vemcvx.program.forces`). The matrix of the system is
P W Q + diag(compliance). If the stiffness matrix K has a kernel, the forces must also balance on the kernel.

If active sets recur, we take projected-gradient steps, or search between the last two points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.sparse.linalg import LinearOperator, gmres

from vemcvx.base.arrays import Bools, Floats, directions, lengths, onto_discs, whole
from vemcvx.program.forces import Delassus, Point, build_reflections
from vemcvx.program.operators import FEATURES, Operators
from vemcvx.program.step_program import Answer, StepProgram, has_diverged
from vemcvx.solvers.law import Weights, resolve_slips
from vemcvx.solvers.solver import Solver

SHIFT = 0.1
"""Factor of slips and gaps `off` in x + SHIFT * off, which predicts active sets."""
REGULARISATION = 1e-11
"""Number added to the diagonal of P W Q, because rows may be linearly dependent."""
CORRECTION_TOLERANCE, STEP_TOLERANCE, STALL_TOLERANCE = 1e-13, 1e-11, 1e-7
"""Tolerances of the relative law error: in corrections, in a step, and in a step without progress."""
MAX_CORRECTIONS = 20  # largest number of corrections with one factorisation
FIRST_SWEEPS = 100  # gradient steps in the first call of `_sweep`
SWEEP_TOLERANCE = 1e-6  # relative error of weights in `_sweep`
SWEEPS_PER_WEIGHTS = 10  # gradient steps per evaluation of weights
MAX_SAFEGUARDS = 10  # largest number of calls of `_sweep` in a step
SWEEPS_PER_MULTIPLIER = 20  # gradient steps per update of kernel coordinates


@dataclass(frozen=True, eq=False)
class ActiveSets:
    """The active sets of a point."""

    stick: Bools  # (m,) sticking terms
    act: Bools  # (r,) acting limits
    direction: Floats  # (m, block) unit vectors of slips
    along: Floats  # (m,) components of slips along `direction`, >= 0
    w: Floats  # (m,) weights at the slips in `along`
    size: Floats  # (m,) lengths of the predicted forces x + SHIFT * off

    @classmethod
    def at(cls, delassus: Delassus, point: Point, law: Weights, s: Floats | None = None) -> ActiveSets:
        """Return the active sets that q = x + SHIFT * off predicts."""
        q, press = delassus.split(point.x + SHIFT * point.off)
        s = delassus.split(point.off)[0] if s is None else s
        size, p = lengths(q), delassus.split(point.x)[1]
        direction = directions(q, size)
        if rises := law.is_monotone and not law.is_given:
            along = resolve_slips(law, p, size, SHIFT)
        else:
            along = np.maximum(np.einsum("ij,ij->i", direction, s), 0.0)
        w = law.at(p, along)
        stick = (along == 0.0 if rises else size <= w) & (w > 0)
        return cls(stick=stick, act=press > 0, direction=direction, along=along, w=w, size=size)

    @cached_property
    def held(self) -> Bools:
        """The rows (N,) that must not move: sticking terms and acting limits."""
        return np.append(np.repeat(self.stick, self.direction.shape[1]), self.act)

    @property
    def key(self) -> bytes:
        signs = (self.direction > 0) & ~self.stick[:, None]
        return self.held.tobytes() + (signs.tobytes() if self.direction.shape[1] == 1 else b"")

    def apply_law(self, x: Floats, w: Floats, direction: Floats) -> Floats:
        """Return x_law (N,) for weights w and directions of slip."""
        w = np.where(self.stick, 0.0, w)  # The weight of a sticking term may be infinite.
        return np.where(self.held, x, np.append(w[:, None] * direction, np.zeros(len(self.act))))

    def law_error(self, point: Point) -> float:
        parts = self.apply_law(point.x, self.w, self.direction) - point.x, SHIFT * point.off[self.held], point.rest
        return max(float(np.abs(part).max(initial=0.0)) for part in parts)


@dataclass(frozen=True, eq=False)
class ActiveSetSystem:
    """The factorised linear system of active sets."""

    sets: ActiveSets
    P: sp.csr_matrix  # (k, N)
    Q: sp.csc_matrix  # (N, k)
    solve: Callable[[Floats], Floats]

    @classmethod
    def assemble(cls, delassus: Delassus, sets: ActiveSets, point: Point, law: Weights) -> ActiveSetSystem:
        P, Qt, compliance = build_columns(sets, delassus.split(point.x)[1], law)
        Q, R, W, count = Qt.T, delassus.R, delassus.W, P.shape[0]
        if isinstance(W, np.ndarray):
            M = build_matrix(W, R, P, Qt, compliance)
            lu = dgetrf(M, overwrite_a=True)[:2] if len(M) else None
            return cls(sets, P, Q, lambda b: b if lu is None else np.asarray(dgetrs(*lu, b)[0]))

        def product(z: Floats) -> Floats:
            x, a = Q @ z[:count], z[count:]
            return np.append(P @ (W @ x - R @ a) + (REGULARISATION + compliance) * z[:count], R.T @ x)

        operator = LinearOperator((count + R.shape[1],) * 2, product, dtype=float)
        return cls(sets, P, Q, lambda b: gmres(operator, b, rtol=1e-6, restart=60, maxiter=5)[0] if len(b) else b)


def build_columns(sets: ActiveSets, p: Floats, law: Weights) -> tuple[sp.csr_matrix, sp.csr_matrix, Floats]:
    """Return P, Q' and the compliances for active sets and forces p of limits."""
    J, slope = law.slopes(p, sets.along)
    P, compliance = _columns(sets, slope)
    return P, P if J is None else _with_pressure(P, sets, J), compliance


def build_matrix(W: Floats, R: Floats, P: sp.csr_matrix, Qt: sp.csr_matrix, compliance: Floats) -> Floats:
    """Return the matrix of the system, with a border R for the kernel of K."""
    count = P.shape[0]
    M = np.zeros((count + R.shape[1],) * 2, order="F")
    M[:count, :count] = P @ (Qt @ W).T
    M[:count, count:], M[count:, :count] = -(P @ R), (Qt @ R).T
    M[range(count), range(count)] += REGULARISATION + compliance
    return M


def _columns(sets: ActiveSets, slope: Floats | None) -> tuple[sp.csr_matrix, Floats]:
    (m, block), act = sets.direction.shape, np.flatnonzero(sets.act)
    moves = ~sets.stick & (sets.w > 0)
    picked, compliance = np.tile(sets.stick[:, None], block), np.zeros((m, block))
    picked[moves, 1:] = True
    compliance[moves, 1:] = ((sets.size[moves] - sets.w[moves]) / (SHIFT * sets.w[moves]))[:, None]
    if slope is not None:
        sloped = moves & (np.abs(slope) > 1e-12)
        picked[sloped, 0], compliance[sloped, 0] = True, 1.0 / slope[sloped]
    frames = np.where(sets.stick[:, None, None], np.eye(block), build_reflections(sets.direction))
    i, j = np.nonzero(picked)
    entries = np.append(frames[i, :, j], np.ones(len(act)))
    at = np.append(i[:, None] * block + np.arange(block), m * block + act)
    starts = np.append(block * np.arange(len(i)), block * len(i) + np.arange(len(act) + 1))
    P = sp.csr_matrix((entries, at, starts), shape=(len(i) + len(act), m * block + len(sets.act)))
    return P, np.append(compliance[i, j], np.zeros(len(act)))


def _with_pressure(P: sp.csr_matrix, sets: ActiveSets, J: sp.csr_matrix) -> sp.csr_matrix:
    """Return Q': P plus the friction that acting limits cause."""
    block, acting = sets.direction.shape[1], sp.csc_matrix(J)[:, sets.act]
    ways = np.where(sets.stick[:, None], 0.0, sets.direction)[acting.indices] * acting.data[:, None]
    at = acting.indices[:, None] * block + np.arange(block)
    starts = np.append(np.zeros(P.shape[0] - acting.shape[1]), block * acting.indptr)
    return sp.csr_matrix(P + sp.csr_matrix((ways.ravel(), at.ravel(), starts), shape=P.shape))


@dataclass(eq=False)
class Search:
    """The search for the forces of one step."""

    delassus: Delassus
    law: Weights  # in the units of `delassus`
    most: int  # largest number of systems
    count: int = 0
    safeguards: int = 0

    def find_solution(self, point: Point, system: ActiveSetSystem | None) -> tuple[Point, ActiveSetSystem, float]:
        """Return the solution, the last system, and the error of the law."""
        system = system or self._first_system(point)
        s, z = self.delassus.split(point.off)
        least = 0.01 * max(np.abs(s).max(initial=0.0), z.max(initial=0.0)) or 1e-300
        seen, swept, cycles, last = set[bytes](), None, 0, np.inf
        while True:
            before, (point, sets, error) = point, self._correct(point, system, least)
            ends = self.count >= self.most or self.safeguards > MAX_SAFEGUARDS
            if error <= STEP_TOLERANCE or (error <= STALL_TOLERANCE and error > 0.5 * last) or ends:
                return point, replace(system, sets=sets), error
            again = sets.key in seen and sets.key != system.sets.key
            cycles += again
            seen.add(sets.key)
            starts = self.delassus.operators.block > 1 and swept is None
            if starts or error == np.inf or (again and (self.law.is_monotone or cycles % 4 == 0)):
                swept = point = self._sweep(swept if swept is not None and self.law.is_monotone else point)
                sets = ActiveSets.at(self.delassus, point, self.law)
            elif again:
                point, sets = self._search_between(before, point)
            system, last = self.system(sets, point), error

    def _first_system(self, point: Point) -> ActiveSetSystem:
        sets = ActiveSets.at(self.delassus, point, self.law, np.zeros_like(self.delassus.split(point.x)[0]))
        if len(point.a):
            sets = replace(sets, stick=np.ones_like(sets.stick), act=np.ones_like(sets.act))
        return self.system(sets, point)

    def system(self, sets: ActiveSets, point: Point) -> ActiveSetSystem:
        self.count += 1
        return ActiveSetSystem.assemble(self.delassus, sets, point, self.law)

    def _correct(self, point: Point, system: ActiveSetSystem, least: float) -> tuple[Point, ActiveSets, float]:
        """Return the corrected point, active sets, and error of the law."""
        delassus, old, limits = self.delassus, system.sets, np.zeros(len(system.sets.act))
        s, direction, w, last = old.along[:, None] * old.direction, old.direction, None, np.inf
        for _ in range(MAX_CORRECTIONS):
            w = self.law.at(delassus.split(point.x)[1], old.along) if w is None else w
            dx = old.apply_law(point.x, w, direction) - point.x
            push = point.off - delassus.W @ dx - np.append(np.where(old.stick[:, None], 0.0, s), limits)
            z = system.solve(np.append(system.P @ push, point.rest - delassus.R.T @ dx))
            if not np.isfinite(z).all():
                new = ActiveSets.at(delassus, point, self.law, s)
                return point, new, 0.0 if new.law_error(point) <= STEP_TOLERANCE * least else np.inf
            count = system.P.shape[0]
            point = delassus.move(point, dx + system.Q @ z[:count], z[count:])
            s = delassus.split(point.off)[0]
            # Slips at rounding level, or against the force, do not define a direction.
            turns = (SHIFT * lengths(s) > STALL_TOLERANCE * w) & (np.einsum("ij,ij->i", s, direction) > 0)
            direction = np.where(turns[:, None], directions(s, lengths(s)), direction)
            new = ActiveSets.at(delassus, point, self.law)
            error = new.law_error(point) / max(float(np.abs(point.x).max(initial=0.0)), least)
            if error <= CORRECTION_TOLERANCE or error > 0.5 * last or not np.array_equal(new.held, old.held):
                break
            last, w = error, new.w
        return point, new, error

    def _search_between(self, before: Point, point: Point) -> tuple[Point, ActiveSets]:
        dx, da = point.x - before.x, point.a - before.a
        tried = [self.delassus.move(before, part * dx, part * da) for part in (0.7, 0.5, 0.3, 0.1)]
        found = [(one, ActiveSets.at(self.delassus, one, self.law)) for one in tried]
        return min(found, key=lambda pair: pair[1].law_error(pair[0]))

    def _sweep(self, point: Point) -> Point:
        """Return a point nearer to the solution, by projected gradients."""
        # If K has a kernel, the method is an augmented Lagrangian with multipliers `a`.
        delassus, norm, R, floats = self.delassus, self.delassus.norm, self.delassus.R, len(point.a) > 0
        most, length = min(2**self.safeguards, 16) * FIRST_SWEEPS, 1.0 / (2.0 * norm if floats else norm)
        self.safeguards += 1
        for sweep in range(most):
            if sweep % (SWEEPS_PER_MULTIPLIER if floats else most) == 0:
                point = delassus.move(point, np.zeros_like(point.x), norm * point.rest)
                momentum, ahead, off = 1.0, point.x, point.off + R @ (norm * point.rest)
                now = off
            if has_diverged(off):
                break  # Nothing holds the body.
            lam, p = delassus.split(ahead + length * off)
            p = np.maximum(p, 0.0)
            if self.law.is_monotone and not self.law.is_given:
                w = self.law.at(p, resolve_slips(self.law, p, lengths(lam), length, SWEEP_TOLERANCE))
            elif sweep % SWEEPS_PER_WEIGHTS == 0:
                w = self.law.at(p, lengths(delassus.split(point.off)[0]))
            x = np.append(onto_discs(lam, w), p)
            dx, before = x - point.x, now
            point = delassus.move(point, dx)
            if not floats and np.abs(dx).max(initial=0.0) <= 1e-3 / most * np.abs(x).max(initial=0.0):
                break
            restart = float((x - ahead) @ dx) < 0
            momentum, last = (1.0, 1.0) if restart else (0.5 + np.sqrt(0.25 + momentum**2), momentum)
            now, follow = point.off + R @ (norm * point.rest), (last - 1.0) / momentum
            ahead, off = x + follow * dx, now + follow * (now - before)
        return delassus.move(point, np.zeros_like(point.x), norm * point.rest)


@dataclass(frozen=True)
class Newton(Solver):
    """The semismooth Newton method of this package, for all terms and all laws of friction.

    Parameters
    ----------
    accuracy : float
        Requested relative energy error of a step.
    max_iterations : int
        Largest number of linear systems per step.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> vx.march(system, [0.0, 1.0], solver=vx.Newton(accuracy=1e-10)).state[-1]
    array([2.])
    """

    accuracy: float = 1e-8
    max_iterations: int = 60

    accepts: ClassVar[frozenset[str]] = FEATURES
    semidefinite = any_units = True

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_iterations, "Newton", "max_iterations", "linear solves")

    def prepare(self, operators: Operators) -> PreparedNewton:
        return PreparedNewton(operators, self.max_iterations)


@dataclass(eq=False)
class PreparedNewton:
    """Newton's method for the programs of one run."""

    operators: Operators
    most: int
    system: ActiveSetSystem | None = None  # the last system

    @cached_property
    def delassus(self) -> Delassus:
        return Delassus(self.operators)

    def solve(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        law, p = law or Weights(program.w), np.zeros_like(program.e) if p is None else np.maximum(p, 0.0)
        return self._answer(program, law, self.delassus.begin(program, lam, p))

    def solve_from(self, program: StepProgram, law: Weights, answer: Answer) -> Answer:
        """Solve a step, starting from the active sets of an answer."""
        return self._answer(program, law, self.delassus.begin(program, answer.lam, answer.p, answer.d), near=True)

    def _answer(self, program: StepProgram, law: Weights, point: Point, near: bool = False) -> Answer:
        delassus, rows = self.delassus, program.operators.B.shape[0]
        u = delassus.u
        own = replace(law, term_units=u[: rows : program.operators.block], limit_units=u[rows:])
        search = Search(delassus, own, self.most)
        # The last system is used only if all terms of infinite weight stick.
        last = self.system if self.system is None or (self.system.sets.stick | ~program.stuck).all() else None
        begin = search.system(ActiveSets.at(delassus, point, own), point) if near else last
        point, system, error = search.find_solution(point, begin)
        self.system = None if near else system
        status = "converged" if error <= STALL_TOLERANCE else f"sets did not settle in {search.count} systems"
        d, lam, p = apply_law_to_answer(delassus, program, point, system, law)
        return Answer(d, lam, max(search.count, 1), status, p=p)


def apply_law_to_answer(
    delassus: Delassus, program: StepProgram, point: Point, system: ActiveSetSystem, law: Weights
) -> tuple[Floats, Floats, Floats]:
    """Return increments d and forces lam, p that obey the law."""
    operators, sets = program.operators, system.sets
    d, point = correct_answer(delassus, program, point, system, law)
    if operators.own_columns is not None:
        of_terms, of_limits = operators.own_columns
        stick, act = np.repeat(sets.stick, operators.block), sets.act & (operators.compliance == 0)
        d[of_terms[stick]] = program.b[stick] / operators.B.data[stick]
        d[of_limits[act]] = program.e[act] / operators.D.data[act]
    lam, p = delassus.forces(point)
    p, s = np.maximum(p, 0.0), program.slip(d)
    size = lengths(s)
    w = law.at(p, np.where(sets.stick, 0.0, size))
    lam = onto_discs(lam, w)
    slips = ~sets.stick & (np.einsum("ij,ij->i", s, lam) > 0)
    lam = np.where(slips[:, None], np.where(slips, w, 0.0)[:, None] * directions(s, size), lam)
    return d, lam, p


def correct_answer(
    delassus: Delassus, program: StepProgram, point: Point, system: ActiveSetSystem, law: Weights
) -> tuple[Floats, Point]:
    """Return corrected increments and the corrected point."""
    operators, sets, count = delassus.operators, system.sets, system.P.shape[0]
    d, (lam, p) = delassus.increments(program, point), delassus.forces(point)
    left = program.residual(d, lam, p)
    d = d + operators.factor.solve(left)
    off, n = delassus.u * delassus.excess(program, d, p), directions(lam, lengths(lam))
    s = delassus.split(off)[0]
    along = sets.along if law.reads_slip else np.einsum("ij,ij->i", s, n)
    other = np.append(s - along[:, None] * n, np.zeros_like(p))
    z = system.solve(np.append(system.P @ np.where(sets.held, off, other), delassus.N.T @ left))
    if not np.abs(z).max(initial=0.0) <= np.abs(point.x).max(initial=0.0):  # The active sets do not hold the body.
        return d, point
    dx, da = system.Q @ z[:count], z[count:]
    d = d - operators.factor.solve(operators.multiplier_force(*delassus.split(delassus.u * dx))) + delassus.N @ da
    return d, delassus.move(point, dx, da)


def gap_of_law(program: StepProgram, law: Weights, answer: Answer) -> float:
    """Return the duality gap of an answer under the weights of the law."""
    followed = replace(program, w=law.at(answer.p, lengths(program.slip(answer.d))))
    return followed.duality_gap(*followed.admissible_point(answer.d, answer.lam, answer.p))
