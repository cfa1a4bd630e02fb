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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
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
from vemcvx.solvers.law import GivenWeights, Weights
from vemcvx.solvers.solver import Prepared, Solver

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
MOST_SAFEGUARDS = 10
"""Times that they are asked in a step before that is given up."""
FEW = 20
"""Of them for one part of the increments in a kernel."""


@dataclass(eq=False)
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
        """The sets at q = x + SHIFT off, with the law at the slips s (m, block), by default those of the point."""
        q, press = delassus.parts(point.x + SHIFT * point.off)
        s = delassus.parts(point.off)[0] if s is None else s
        size = lengths(q)
        way = directions(q, size)
        along = np.maximum(np.einsum("ij,ij->i", way, s), 0.0)
        w = law.at(delassus.parts(point.x)[1], along)
        return cls(stick=(size <= w) & (w > 0), act=press > 0, way=way, along=along, w=w, size=size)

    def same(self, other: Sets) -> bool:
        """Return True if the same terms stick and the same limits act."""
        return np.array_equal(self.stick, other.stick) and np.array_equal(self.act, other.act)

    @property
    def still(self) -> Bools:
        """(N,) the rows that are not to move."""
        return np.append(np.repeat(self.stick, self.way.shape[1]), self.act)

    @property
    def key(self) -> bytes:
        """The sets in bytes: with the directions of slips, where these are two."""
        return self.still.tobytes() + ((self.way > 0).tobytes() if self.way.shape[1] == 1 else b"")

    def lawful(self, x: Floats, w: Floats, way: Floats) -> Floats:
        """x_law: x with w along what slips, and nothing on open limits."""
        slips = np.where(self.stick[:, None], 0.0, w[:, None] * way).ravel()
        return np.where(self.still, x, np.append(slips, np.zeros(len(self.act))))

    def missed(self, point: Point) -> float:
        """The error of the law at a point whose sets these are."""
        parts = self.lawful(point.x, self.w, self.way) - point.x, SHIFT * point.off[self.still], point.rest
        return max(float(np.abs(part).max(initial=0.0)) for part in parts)


@dataclass(eq=False)
class SetsSystem:
    """The system of some sets, ready to be solved: P and Q' (k, N), and a solve with its matrix."""

    sets: Sets
    P: sp.csr_matrix
    Qt: sp.csr_matrix
    solve: Callable[[Floats], Floats]

    @classmethod
    def of(cls, delassus: Delassus, sets: Sets, point: Point, law: Weights) -> SetsSystem:
        """The system with the slopes of the law at a point."""
        J, slope = law.slopes(delassus.parts(point.x)[1], sets.along)
        P, compliance = _columns(sets, slope)
        Qt = P if J is None else _leaning(P, sets, J)
        R, count = delassus.R, P.shape[0]
        if isinstance(delassus.W, np.ndarray):
            M = np.zeros((count + R.shape[1],) * 2, order="F")
            M[:count, :count] = P @ (Qt @ delassus.W).T
            M[:count, count:], M[count:, :count] = -(P @ R), (Qt @ R).T
            M[range(count), range(count)] += LIFT + compliance
            lu = dgetrf(M, overwrite_a=True)[:2] if len(M) else None
            return cls(sets, P, Qt, lambda b: b if lu is None else np.asarray(dgetrs(*lu, b)[0]))

        def product(z: Floats) -> Floats:
            own, a = z[:count], z[count:]
            moved = P @ (delassus.W @ (Qt.T @ own) - R @ a) + (LIFT + compliance) * own
            return np.append(moved, R.T @ (Qt.T @ own))

        operator = LinearOperator((count + R.shape[1],) * 2, product, dtype=float)
        return cls(sets, P, Qt, lambda b: gmres(operator, b, rtol=1e-6, restart=60, maxiter=5)[0] if len(b) else b)


def _columns(sets: Sets, slope: Floats | None) -> tuple[sp.csr_matrix, Floats]:
    """P (k, N) of what holds still, across slips, and along those whose weight reads them; the compliances (k,)."""
    block, still = sets.way.shape[1], np.flatnonzero(sets.still)
    slip = np.flatnonzero(~sets.stick & (sets.w > 0))
    column = reflected(sets.way[slip])[:, 1:].reshape(-1, block)
    owner = np.repeat(slip, block - 1)
    compliance = (sets.size[owner] - sets.w[owner]) / (SHIFT * sets.w[owner])
    if slope is not None:
        sees = slip[np.abs(slope[slip]) > 1e-12]
        column, owner = np.concatenate([column, sets.way[sees]]), np.append(owner, sees)
        compliance = np.append(compliance, 1.0 / slope[sees])
    at = np.append(still, owner[:, None] * block + np.arange(block))
    starts = np.append(np.arange(len(still)), len(still) + block * np.arange(len(owner) + 1))
    entries = np.append(np.ones(len(still)), column)
    P = sp.csr_matrix((entries, at, starts), shape=(len(still) + len(owner), len(sets.still)))
    return P, np.append(np.zeros(len(still)), compliance)


def _leaning(P: sp.csr_matrix, sets: Sets, J: sp.csr_matrix) -> sp.csr_matrix:
    """Q' (k, N): P, and what forces of acting limits add to those of what slips, w' = J p' on the way."""
    (m, block), first = sets.way.shape, int(np.count_nonzero(sets.stick)) * sets.way.shape[1]
    i, j = np.repeat(np.arange(m), np.diff(J.indptr)), J.indices
    felt = ~sets.stick[i] & sets.act[j]
    i, row = i[felt], first + np.cumsum(sets.act)[j[felt]] - 1
    entries = np.concatenate([P.data, (J.data[felt, None] * sets.way[i]).ravel()])
    rows = np.concatenate([np.repeat(np.arange(P.shape[0]), np.diff(P.indptr)), np.repeat(row, block)])
    columns = np.concatenate([P.indices, (i[:, None] * block + np.arange(block)).ravel()])
    return sp.csr_matrix((entries, (rows, columns)), shape=P.shape)


@dataclass(eq=False)
class Search:
    """The search for the forces of one step.

    Parameters
    ----------
    delassus : Delassus
    law : Weights
        In its units.
    most : int
        Factorisations before it ends.
    """

    delassus: Delassus
    law: Weights
    most: int
    count: int = 0
    safeguards: int = 0
    sweeps: int = field(default=SWEEPS, init=False)

    def solution(self, point: Point, system: SetsSystem | None) -> tuple[Point, SetsSystem, float]:
        """The point of the step, the last system of sets and the error of the law, begun on those of another step."""
        system = system or self._first(point)
        seen, swept, cycles, last = set[bytes](), None, 0, np.inf
        while True:
            before, (point, sets, missed) = point, self._corrected(point, system)
            ends = self.count >= self.most or self.safeguards > MOST_SAFEGUARDS
            if missed <= ENOUGH or (missed <= FAIR and missed > 0.5 * last) or ends:
                return point, replace(system, sets=sets), missed
            again = sets.key in seen and not sets.same(system.sets)
            cycles += again
            seen.add(sets.key)
            starts = self.delassus.operators.block > 1 and swept is None
            if starts or missed == np.inf or (again and (self.law.given or cycles % 4 == 0)):
                swept = point = self._swept(swept if swept is not None and self.law.given else point)
                sets = Sets.at(self.delassus, point, self.law)
            elif again:
                point, sets = self._between(before, point)
            system, last = self._system(sets, point), missed

    def _first(self, point: Point) -> SetsSystem:
        """The system of the sets at the guess; a body that floats is held, at first."""
        slips = None if point.a.any() else np.zeros_like(self.delassus.parts(point.x)[0])
        sets = Sets.at(self.delassus, point, self.law, slips)
        if len(point.a) and slips is not None:
            sets = replace(sets, stick=np.ones_like(sets.stick), act=np.ones_like(sets.act))
        return self._system(sets, point)

    def _system(self, sets: Sets, point: Point) -> SetsSystem:
        self.count += 1
        return SetsSystem.of(self.delassus, sets, point, self.law)

    def _corrected(self, point: Point, system: SetsSystem) -> tuple[Point, Sets, float]:
        """The point that the system leads to, by corrections on its factors; the sets there, and the law's error.

        Infinite where sets hold nothing of a body that floats.
        """
        delassus, old = self.delassus, system.sets
        s, way, last, new, missed = old.along[:, None] * old.way, old.way, np.inf, old, np.inf
        w = self.law.at(delassus.parts(point.x)[1], old.along)
        begun = (point.start or point).off  # Gaps far from closing are no measure of forces.
        least = (
            0.01 * max(float(begun.max(initial=0.0)), float(np.abs(delassus.parts(begun)[0]).max(initial=0.0)))
            or 1e-300
        )
        count, limits = system.P.shape[0], np.zeros(len(old.act))
        for turn in range(TURNS):
            if turn:
                new = Sets.at(delassus, point, self.law)
                missed = new.missed(point) / max(float(np.abs(point.x).max(initial=0.0)), least)
                if missed <= SHARP or missed > 0.5 * last or not new.same(old):
                    break
                last, w = missed, new.w
            dx = old.lawful(point.x, w, way) - point.x
            slips = np.append(np.where(old.stick[:, None], 0.0, s), limits)
            push = point.off - delassus.W @ dx - slips
            z = system.solve(np.append(system.P @ push, point.rest - delassus.R.T @ dx))
            if not np.isfinite(z).all():
                return point, Sets.at(delassus, point, self.law, s), np.inf
            point = delassus.moved(point, dx + system.Qt.T @ z[:count], z[count:])
            s = delassus.parts(point.off)[0]
            # Slips of rounding, or against their force, have no direction to turn to.
            turns = (SHIFT * lengths(s) > FAIR * w) & (np.einsum("ij,ij->i", s, way) > 0)
            way = np.where(turns[:, None], directions(s, lengths(s)), way)
        return point, new, missed

    def _between(self, before: Point, point: Point) -> tuple[Point, Sets]:
        """The point of least error on the way from one to the other, the other one left out."""
        dx, da = point.x - before.x, point.a - before.a
        tried = [self.delassus.moved(before, part * dx, part * da) for part in (0.7, 0.5, 0.3, 0.1)]
        found = [(one, Sets.at(self.delassus, one, self.law)) for one in tried]
        return min(found, key=lambda pair: pair[1].missed(pair[0]))

    def _swept(self, point: Point) -> Point:
        """A point nearer to the solution, by projected gradients; of bodies that float for one part a after another."""
        most, floats = self.sweeps, len(point.a) > 0
        self.sweeps, self.safeguards = min(2 * self.sweeps, 16 * SWEEPS), self.safeguards + 1
        if not floats:
            return self._descended(point, most)
        for _ in range(most // FEW):
            point = self._descended(point, FEW)
            point = self.delassus.moved(point, np.zeros_like(point.x), self.delassus.norm * point.rest)
        return point

    def _descended(self, point: Point, most: int) -> Point:
        """The point after projected gradients; R is orthonormal: the penalty norm |rest|^2 / 2 doubles their bound."""
        delassus, norm, R = self.delassus, self.delassus.norm, self.delassus.R
        length = 1.0 / (2.0 * norm if len(point.a) else norm)
        momentum, ahead, off = 1.0, point.x, point.off + R @ (norm * point.rest)
        for _ in range(most):
            x = self._projected(ahead + length * off, point)
            dx, before = x - point.x, point.off + R @ (norm * point.rest)
            point = delassus.moved(point, dx)
            if np.abs(dx).max(initial=0.0) <= 1e-3 / most * np.abs(x).max(initial=0.0):
                break
            restart = float((x - ahead) @ dx) < 0
            momentum, last = (1.0, 1.0) if restart else (0.5 + np.sqrt(0.25 + momentum**2), momentum)
            now, follow = point.off + R @ (norm * point.rest), (last - 1.0) / momentum
            ahead, off = x + follow * dx, now + follow * (now - before)
        return point

    def _projected(self, x: Floats, point: Point) -> Floats:
        """The forces x moved onto discs and half-lines; the law at the slips of a point."""
        lam, p = self.delassus.parts(x)
        p = np.maximum(p, 0.0)
        w = self.law.at(p, lengths(self.delassus.parts(point.off)[0]))
        return np.append(onto_discs(lam, w).ravel(), p)


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
    semidefinite: ClassVar[bool] = True
    follows: ClassVar[bool] = True
    any_units: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_iterations, "Newton", "max_iterations", "linear solves")

    @property
    def advice(self) -> str:
        return "raise max_iterations"

    def limited(self, max_iterations: int) -> Newton:
        return replace(self, max_iterations=max_iterations)

    def prepare(self, operators: Operators) -> Prepared:
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
        return Delassus.of(self.operators)

    def solve(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        """Answer one step, under given weights or a law of them."""
        law = law or GivenWeights(program.w)
        pressed = np.zeros_like(program.e) if p is None else np.maximum(p, 0.0)
        answer, self.system = self._taken(program, law, (lam, pressed), self.system)
        return answer

    def _taken(
        self, program: StepProgram, law: Weights, begin: Sequence[Floats], system: SetsSystem | None
    ) -> tuple[Answer, SetsSystem]:
        """The answer begun at forces lam and p, and increments d if they are given, and its system of sets."""
        delassus, rows = self.delassus, program.operators.B.shape[0]
        own = law.in_units(delassus.u[: rows : program.operators.block], delassus.u[rows:])
        search = Search(delassus, own, self.most)
        point, system, missed = search.solution(delassus.begin(program, *begin), system)
        status = "converged" if missed <= FAIR else f"sets did not settle in {search.count} systems"
        d, lam, p = recorded(delassus, program, point, system, law)
        return Answer(d, lam, max(search.count, 1), status, safeguards=search.safeguards, p=p), system

    def begun_at(self, program: StepProgram, law: Weights, answer: Answer) -> Answer:
        """The answer that is found from the sets of another one; of at most one system, one Newton step from it."""
        return self._taken(program, law, (answer.lam, answer.p, answer.d), None)[0]


def gap_under(program: StepProgram, law: Weights, answer: Answer) -> float:
    """The gap of an answer under the weights of its own pressure and slip."""
    followed = replace(program, w=law.at(answer.p, lengths(program.slip(answer.d))))
    return followed.duality_gap(*followed.admissible_point(answer.d, answer.lam, answer.p))


def within(program: StepProgram, law: Weights, answer: Answer, target: float) -> bool:
    """Return True if that gap is at the target, or no more than rounding."""
    gap = gap_under(program, law, answer)
    return gap <= target or gap <= program.rounding_floor(answer.d, answer.lam, answer.p)


def recorded(
    delassus: Delassus, program: StepProgram, point: Point, system: SetsSystem, law: Weights
) -> tuple[Floats, Floats, Floats]:
    """The increments and forces of a point, as its law has them: w s/|s| on what slips, within bounds on the rest."""
    operators, sets = program.operators, system.sets
    d, point = corrected(delassus, program, point, system)
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
        z = np.linalg.lstsq((system.Qt @ delassus.R).T, rest, rcond=None)[0]
        more = delassus.parts(delassus.u * (system.Qt.T @ z))
        lam, p = lam + more[0], np.maximum(p + more[1], 0.0)
    return d, lam, p


def corrected(delassus: Delassus, program: StepProgram, point: Point, system: SetsSystem) -> tuple[Floats, Point]:
    """The increments of a point, and the point, whose rows that hold still are so to the rounding of d.

    Where contact holds back most of a load, d is a small difference of large ones: what rows are off in it is put in
    place by changes, twice, and so are slips that do not point along their forces, and what is out of balance.
    """
    operators, sets, count = delassus.operators, system.sets, system.P.shape[0]
    d = delassus.increments(program, point)
    for _ in range(2):
        lam, p = delassus.forces(point)
        left = program.residual(d, lam, p)
        d = d + operators.factor.solve(left)
        off = delassus.u * delassus.excess(program, d, p)
        s, n = delassus.parts(off)[0], directions(lam, lengths(lam))
        # Of what slips the part across its force: the two have one direction.
        across = s - np.einsum("ij,ij->i", s, n)[:, None] * n
        off = np.where(sets.still, off, np.append(across.ravel(), np.zeros_like(p)))
        z = system.solve(np.append(system.P @ off, delassus.N.T @ left))
        if not np.isfinite(z).all():
            break
        dx, da = system.Qt.T @ z[:count], z[count:]
        small = np.abs(dx).max(initial=0.0) <= ENOUGH * np.abs(point.x).max(initial=0.0)
        point = delassus.moved(point, dx, da)
        d = d - operators.factor.solve(operators.multiplier_force(*delassus.parts(delassus.u * dx))) + delassus.N @ da
        if small:
            break
    return held(program, d, sets), point


def held(program: StepProgram, d: Floats, sets: Sets) -> Floats:
    """The increments with rows that hold still exactly where these read unknowns of their own."""
    operators = program.operators
    if operators.own_columns is None:
        return d
    d, (of_terms, of_limits) = d.copy(), operators.own_columns
    stick, act = np.repeat(sets.stick, operators.block), sets.act & (operators.compliance == 0)
    d[of_terms[stick]] = program.b[stick] / operators.B.data[stick]
    d[of_limits[act]] = program.e[act] / operators.D.data[act]
    return d
