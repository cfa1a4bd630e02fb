"""Semismooth Newton on active sets, in the forces of contact (:mod:`vemcvx.program.forces`).

On sets (what sticks, which limits act, where to the others slip) the forces are x_law + Q z. x_law has w s/|s| on what
slips and nothing on open limits; z are changes of what sticks (a column of the identity), of what acts (likewise, and
J = dw/dp along what slips), across slips (with the compliance |s|/w) and, where w reads |s|, along them (1/w'). They
are to leave still what sticks or acts, and to what slips the motion s at which the law was linearised: with P as Q,
but without J,

    (P (W + C) Q + diag(compliance)) z = P (off - s of what slips),

the Newton step for x = projection of x + SHIFT off onto discs of radius w(p, |s|) and half-lines p >= 0. Slips have no
unknown in the plane, and one in space. The matrix is lifted by LIFT, as rows may follow from others, and is factorised
only where sets change or the error of the law no longer halves; else corrections on the last factors, those of the
step before too, remove what the lift and turning slips leave. The error of the law tells when to stop, not sets: these
may change for ever by rounding. Where K has a kernel, N'A'x = N'g borders the system.

Where W is an operator (iterative linear solvers, very many rows) the system is solved by GMRES.

Safeguard. For given w a step is the dual of its program, min 1/2 x'(W + C)x - x'free over discs and half-lines, whose
gradient is -off. Accelerated projected gradients (Nesterov 1983; begun anew where they turn back, O'Donoghue and Candes
2015) converge to a solution of it: the set is convex, W positive semidefinite. They start discs, and take over where
sets come back; then active sets again, and they go on where they ended. For laws nothing is proven for them; the point
of least error on the way to the last one is tried first. A kernel enters by the augmented Lagrangian, multipliers a.
Where all that misses the accuracy of a run, Clarabel is asked, and the sets of its answer are tried
(:class:`vemcvx.solvers.default.LastResort`).
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
from vemcvx.program.forces import Delassus, Point, reflected
from vemcvx.program.operators import FEATURES, Operators
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.solvers.law import GivenWeights, Weights, WeightsInUnits
from vemcvx.solvers.solver import Solver

SHIFT = 0.1
"""Of off against x in the sets, both in units in which W has a diagonal of ones. At 1 sets cycle more often."""
LIFT = 1e-11
"""Added to a diagonal of ones: rows that follow from others share their force, and corrections remove the rest."""
SHARP, ENOUGH, FAIR = 1e-13, 1e-11, 1e-7
"""Errors of the law in parts of the largest force: of corrections, of a step, and of one that gains no more."""
TURNS = 20
"""Corrections on one factorisation: together they take as long as the next one of 2,000 unknowns."""
SWEEPS = 100
"""Projected gradients at first; they double each time, up to sixteen times as many."""
REREAD = 10
"""Projected gradients on one reading of a law's weights."""
MOST_SAFEGUARDS = 10
"""Times that they are asked in a step before that is given up."""
RUNAWAY = 1e6
"""Growth of forces beyond which nothing balances a body that floats: Coulomb friction would grow for ever."""
FEW = 20
"""Of them for one part of the increments in a kernel."""


@dataclass(frozen=True, eq=False)
class Sets:
    """What sticks (m,), which limits act (r,), where the others slip to (m, block), how far, and w and |q| (m,)."""

    stick: Bools
    act: Bools
    way: Floats
    along: Floats
    w: Floats
    size: Floats

    @classmethod
    def at(cls, delassus: Delassus, point: Point, law: Weights, s: Floats | None = None) -> Sets:
        """Return the sets at q = x + SHIFT off, with the law at the slips s (m, block), by default the point's."""
        q, press = delassus.parts(point.x + SHIFT * point.off)
        s = delassus.parts(point.off)[0] if s is None else s
        size = lengths(q)
        way = directions(q, size)
        along = np.maximum(np.einsum("ij,ij->i", way, s), 0.0)
        w = law.at(delassus.parts(point.x)[1], along)
        return cls(stick=(size <= w) & (w > 0), act=press > 0, way=way, along=along, w=w, size=size)

    @cached_property
    def still(self) -> Bools:
        """(N,) the rows that are not to move."""
        return np.append(np.repeat(self.stick, self.way.shape[1]), self.act)

    @property
    def key(self) -> bytes:
        """The sets in bytes: with the directions of slips, where these are two."""
        return self.still.tobytes() + ((self.way > 0).tobytes() if self.way.shape[1] == 1 else b"")

    def lawful(self, x: Floats, w: Floats, way: Floats) -> Floats:
        """Return x_law: x with w along what slips, and nothing on open limits."""
        return np.where(self.still, x, np.append(w[:, None] * way, np.zeros(len(self.act))))

    def missed(self, point: Point) -> float:
        """Return the error of the law at a point whose sets these are."""
        parts = self.lawful(point.x, self.w, self.way) - point.x, SHIFT * point.off[self.still], point.rest
        return max(float(np.abs(part).max(initial=0.0)) for part in parts)


@dataclass(frozen=True, eq=False)
class SetsSystem:
    """The system of some sets, ready to be solved: P (k, N) and Q (N, k), and a solve with its matrix."""

    sets: Sets
    P: sp.csr_matrix
    Q: sp.csc_matrix
    solve: Callable[[Floats], Floats]

    @classmethod
    def of(cls, delassus: Delassus, sets: Sets, point: Point, law: Weights) -> SetsSystem:
        """Return the system with the slopes of the law at a point."""
        J, slope = law.slopes(delassus.parts(point.x)[1], sets.along)
        P, compliance = _columns(sets, slope)
        Qt = P if J is None else _with_pressure(P, sets, J)
        Q, R, W, count = Qt.T, delassus.R, delassus.W, P.shape[0]
        if isinstance(W, np.ndarray):
            M = np.zeros((count + R.shape[1],) * 2, order="F")
            M[:count, :count] = P @ (Qt @ W).T
            M[:count, count:], M[count:, :count] = -(P @ R), (Qt @ R).T
            M[range(count), range(count)] += LIFT + compliance
            lu = dgetrf(M, overwrite_a=True)[:2] if len(M) else None
            return cls(sets, P, Q, lambda b: b if lu is None else np.asarray(dgetrs(*lu, b)[0]))

        def product(z: Floats) -> Floats:
            x, a = Q @ z[:count], z[count:]
            return np.append(P @ (W @ x - R @ a) + (LIFT + compliance) * z[:count], R.T @ x)

        operator = LinearOperator((count + R.shape[1],) * 2, product, dtype=float)
        return cls(sets, P, Q, lambda b: gmres(operator, b, rtol=1e-6, restart=60, maxiter=5)[0] if len(b) else b)


def _columns(sets: Sets, slope: Floats | None) -> tuple[sp.csr_matrix, Floats]:
    """Return P (k, N) and its compliances (k,).

    Columns are those of the identity for still rows; of slips those across, and along where the weight reads them.
    """
    (m, block), act = sets.way.shape, np.flatnonzero(sets.act)
    moves = ~sets.stick & (sets.w > 0)
    picked, compliance = np.tile(sets.stick[:, None], block), np.zeros((m, block))
    picked[moves, 1:] = True
    compliance[moves, 1:] = ((sets.size - sets.w)[moves] / (SHIFT * sets.w[moves]))[:, None]
    if slope is not None:
        seen = moves & (np.abs(slope) > 1e-12)
        picked[seen, 0], compliance[seen, 0] = True, 1.0 / slope[seen]
    frames = np.where(sets.stick[:, None, None], np.eye(block), reflected(sets.way))
    i, j = np.nonzero(picked)
    entries = np.append(frames[i, :, j], np.ones(len(act)))
    at = np.append(i[:, None] * block + np.arange(block), m * block + act)
    starts = np.append(block * np.arange(len(i)), block * len(i) + np.arange(len(act) + 1))
    P = sp.csr_matrix((entries, at, starts), shape=(len(i) + len(act), m * block + len(sets.act)))
    return P, np.append(compliance[i, j], np.zeros(len(act)))


def _with_pressure(P: sp.csr_matrix, sets: Sets, J: sp.csr_matrix) -> sp.csr_matrix:
    """Return Q' (k, N): P, and what forces of acting limits add to those of what slips, w' = J p' on the way."""
    block, acting = sets.way.shape[1], sp.csc_matrix(J)[:, sets.act]
    ways = np.where(sets.stick[:, None], 0.0, sets.way)[acting.indices] * acting.data[:, None]
    at = acting.indices[:, None] * block + np.arange(block)
    starts = np.append(np.zeros(P.shape[0] - acting.shape[1]), block * acting.indptr)
    return sp.csr_matrix(P + sp.csr_matrix((ways.ravel(), at.ravel(), starts), shape=P.shape))


@dataclass(eq=False)
class Search:
    """The search for the forces of one step.

    Parameters
    ----------
    delassus : Delassus
    law : Weights
        In its units.
    most : int
        Systems of sets before it ends.
    """

    delassus: Delassus
    law: Weights
    most: int
    count: int = 0
    safeguards: int = 0

    def solution(self, point: Point, system: SetsSystem | None) -> tuple[Point, SetsSystem, float]:
        """Return the point of the step, the last system of sets, and the error of the law; begun on another system."""
        system = system or self._first(point)
        s, z = self.delassus.parts(point.off)  # Gaps far from closing are no measure of forces.
        least = 0.01 * max(np.abs(s).max(initial=0.0), z.max(initial=0.0)) or 1e-300
        seen, swept, cycles, last, start = set[bytes](), None, 0, np.inf, point
        limit = RUNAWAY * max(float(np.abs(start.x).max(initial=0.0)), float(np.abs(start.off).max(initial=0.0)))
        while True:
            before, (point, sets, missed) = point, self._corrected(point, system, least)
            if len(point.a) and np.abs(point.x).max(initial=0.0) > limit:
                return start, replace(system, sets=Sets.at(self.delassus, start, self.law)), np.inf
            ends = self.count >= self.most or self.safeguards > MOST_SAFEGUARDS
            if missed <= ENOUGH or (missed <= FAIR and missed > 0.5 * last) or ends:
                return point, replace(system, sets=sets), missed
            again = sets.key in seen and not np.array_equal(sets.still, system.sets.still)
            cycles += again
            seen.add(sets.key)
            starts = self.delassus.operators.block > 1 and swept is None
            if starts or missed == np.inf or (again and (self.law.given or cycles % 4 == 0)):
                swept = point = self._swept(swept if swept is not None and self.law.given else point)
                sets = Sets.at(self.delassus, point, self.law)
            elif again:
                point, sets = self._between(before, point)
            system, last = self.system(sets, point), missed

    def _first(self, point: Point) -> SetsSystem:
        """Return the system of the sets at a guess, where nothing has slipped; a body that floats is held, at first."""
        sets = Sets.at(self.delassus, point, self.law, np.zeros_like(self.delassus.parts(point.x)[0]))
        if len(point.a):
            sets = replace(sets, stick=np.ones_like(sets.stick), act=np.ones_like(sets.act))
        return self.system(sets, point)

    def system(self, sets: Sets, point: Point) -> SetsSystem:
        """Return the system of some sets, and count it."""
        self.count += 1
        return SetsSystem.of(self.delassus, sets, point, self.law)

    def _corrected(self, point: Point, system: SetsSystem, least: float) -> tuple[Point, Sets, float]:
        """Return the point that the system leads to, by corrections on its factors; the sets and the law's error there.

        The error is infinite where sets hold nothing of a body that floats.
        """
        delassus, old, limits = self.delassus, system.sets, np.zeros(len(system.sets.act))
        s, way, w, last = old.along[:, None] * old.way, old.way, None, np.inf
        for _ in range(TURNS):
            w = self.law.at(delassus.parts(point.x)[1], old.along) if w is None else w
            dx = old.lawful(point.x, w, way) - point.x
            push = point.off - delassus.W @ dx - np.append(np.where(old.stick[:, None], 0.0, s), limits)
            z = system.solve(np.append(system.P @ push, point.rest - delassus.R.T @ dx))
            if not np.isfinite(z).all():
                return point, Sets.at(delassus, point, self.law, s), np.inf
            count = system.P.shape[0]
            point = delassus.moved(point, dx + system.Q @ z[:count], z[count:])
            s = delassus.parts(point.off)[0]
            # Slips of rounding, or against their force, have no direction to turn to.
            turns = (SHIFT * lengths(s) > FAIR * w) & (np.einsum("ij,ij->i", s, way) > 0)
            way = np.where(turns[:, None], directions(s, lengths(s)), way)
            new = Sets.at(delassus, point, self.law)
            missed = new.missed(point) / max(float(np.abs(point.x).max(initial=0.0)), least)
            if missed <= SHARP or missed > 0.5 * last or not np.array_equal(new.still, old.still):
                break
            last, w = missed, new.w
        return point, new, missed

    def _between(self, before: Point, point: Point) -> tuple[Point, Sets]:
        """Return the point of least error on the way from one to the other, the other one left out."""
        dx, da = point.x - before.x, point.a - before.a
        tried = [self.delassus.moved(before, part * dx, part * da) for part in (0.7, 0.5, 0.3, 0.1)]
        found = [(one, Sets.at(self.delassus, one, self.law)) for one in tried]
        return min(found, key=lambda pair: pair[1].missed(pair[0]))

    def _swept(self, point: Point) -> Point:
        """Return a point nearer to the solution, by projected gradients; in a kernel for one part a after another."""
        most = min(2**self.safeguards, 16) * SWEEPS
        rounds = most // FEW if len(point.a) else 1
        self.safeguards += 1
        for _ in range(rounds):
            point = self._descended(point, most // rounds)
            point = self.delassus.moved(point, np.zeros_like(point.x), self.delassus.norm * point.rest)
        return point

    def _descended(self, point: Point, most: int) -> Point:
        """Return the point after projected gradients, with the penalty norm |rest|^2 / 2 in a kernel.

        As R is orthonormal, the penalty doubles the bound on their curvature.
        """
        delassus, norm, R = self.delassus, self.delassus.norm, self.delassus.R
        length = 1.0 / (2.0 * norm if len(point.a) else norm)
        momentum, ahead, now = 1.0, point.x, point.off + R @ (norm * point.rest)
        off = now
        for sweep in range(most):
            lam, p = delassus.parts(ahead + length * off)
            p = np.maximum(p, 0.0)
            if sweep % REREAD == 0:
                w = self.law.at(p, lengths(delassus.parts(point.off)[0]))
            x = np.append(onto_discs(lam, w), p)
            dx, before = x - point.x, now
            point = delassus.moved(point, dx)
            if np.abs(dx).max(initial=0.0) <= 1e-3 / most * np.abs(x).max(initial=0.0):
                break
            restart = float((x - ahead) @ dx) < 0
            momentum, last = (1.0, 1.0) if restart else (0.5 + np.sqrt(0.25 + momentum**2), momentum)
            now, follow = point.off + R @ (norm * point.rest), (last - 1.0) / momentum
            ahead, off = x + follow * dx, now + follow * (now - before)
        return point


@dataclass(frozen=True)
class Newton(Solver):
    """Hand-written semismooth Newton method; takes every kind of term, and laws of friction.

    Parameters
    ----------
    accuracy : float
        Certified relative energy error asked of a step.
    max_iterations : int
        Systems of sets a step before it gives up; the answer so far is returned and will not be certified.
    """

    accuracy: float = 1e-8
    max_iterations: int = 60

    accepts: ClassVar[frozenset[str]] = FEATURES
    semidefinite = any_units = True

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_iterations, "Newton", "max_iterations", "linear solves")

    @property
    def advice(self) -> str:
        return "raise max_iterations"

    def prepare(self, operators: Operators) -> PreparedNewton:
        return PreparedNewton(operators, self.max_iterations)


@dataclass(eq=False)
class PreparedNewton:
    """Newton's method for the programs of one run; it keeps the last system of sets."""

    operators: Operators
    most: int
    system: SetsSystem | None = None

    @cached_property
    def delassus(self) -> Delassus:
        """W of the run."""
        return Delassus(self.operators)

    def solve(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        """Answer one step, under given weights or a law of them."""
        law, p = law or GivenWeights(program.w), np.zeros_like(program.e) if p is None else np.maximum(p, 0.0)
        return self._answer(program, law, self.delassus.begin(program, lam, p))

    def begun_at(self, program: StepProgram, law: Weights, answer: Answer) -> Answer:
        """Return the answer found from the sets of another one; of at most one system, one Newton step from it."""
        return self._answer(program, law, self.delassus.begin(program, answer.lam, answer.p, answer.d), near=True)

    def _answer(self, program: StepProgram, law: Weights, point: Point, near: bool = False) -> Answer:
        """Return the answer begun at a point, on its own sets if it is near; else on the last system, which is kept."""
        delassus, rows = self.delassus, program.operators.B.shape[0]
        own = WeightsInUnits(law, delassus.u[: rows : program.operators.block], delassus.u[rows:])
        search = Search(delassus, own, self.most)
        begin = search.system(Sets.at(delassus, point, own), point) if near else self.system
        point, system, missed = search.solution(point, begin)
        self.system = None if near else system
        status = "converged" if missed <= FAIR else f"sets did not settle in {search.count} systems"
        d, lam, p = recorded(delassus, program, point, system, law)
        return Answer(d, lam, max(search.count, 1), status, safeguards=search.safeguards, p=p)


def recorded(
    delassus: Delassus, program: StepProgram, point: Point, system: SetsSystem, law: Weights
) -> tuple[Floats, Floats, Floats]:
    """Return increments and forces of a point as the law has them: still rows do not move, and slips have w s/|s|."""
    operators, sets = program.operators, system.sets
    d, point = corrected(delassus, program, point, system)
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
    slips = ~(sets.stick | program.still(d)) & (np.einsum("ij,ij->i", s, lam) > 0)
    lam = np.where(slips[:, None], w[:, None] * directions(s, size), lam)
    if len(point.a) and operators.block > 1 and slips.any():
        # What that leaves out of balance on the kernel is taken by what holds still, and across slips: it costs least.
        rest = delassus.N.T @ (program.g - operators.multiplier_force(lam, p))
        z = np.linalg.lstsq(delassus.R.T @ system.Q, rest, rcond=None)[0]
        more = delassus.parts(delassus.u * (system.Q @ z))
        lam, p = lam + more[0], np.maximum(p + more[1], 0.0)
    return d, lam, p


def corrected(delassus: Delassus, program: StepProgram, point: Point, system: SetsSystem) -> tuple[Floats, Point]:
    """Return the increments of a point, and the point, corrected once by what is out of balance and by rows.

    Still rows do not move, and slips are along their forces. Where contact holds back most of a load, increments are a
    small difference of large ones.
    """
    operators, sets, count = delassus.operators, system.sets, system.P.shape[0]
    d, (lam, p) = delassus.increments(program, point), delassus.forces(point)
    left = program.residual(d, lam, p)
    d = d + operators.factor.solve(left)
    off, n = delassus.u * delassus.excess(program, d, p), directions(lam, lengths(lam))
    s = delassus.parts(off)[0]
    across = np.append(s - np.einsum("ij,ij->i", s, n)[:, None] * n, np.zeros_like(p))
    z = system.solve(np.append(system.P @ np.where(sets.still, off, across), delassus.N.T @ left))
    if not np.abs(z).max(initial=0.0) <= np.abs(point.x).max(initial=0.0):  # Sets that hold nothing.
        return d, point
    dx, da = system.Q @ z[:count], z[count:]
    d = d - operators.factor.solve(operators.multiplier_force(*delassus.parts(delassus.u * dx))) + delassus.N @ da
    return d, delassus.moved(point, dx, da)


def gap_under(program: StepProgram, law: Weights, answer: Answer) -> float:
    """Return the gap of an answer under the weights of its own pressure and slip."""
    followed = replace(program, w=law.at(answer.p, lengths(program.slip(answer.d))))
    return followed.duality_gap(*followed.admissible_point(answer.d, answer.lam, answer.p))
