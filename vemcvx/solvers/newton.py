"""Semismooth Newton: active sets first, a proximal point method when they fail, the duality gap as the judge of both.

Active sets. On given sets (what sticks, what slips and where to, which limits act) a sticking term gives equations
B_i d = b_i; a slipping one, with direction q_i and curvature h_i, the linearised multiplier
lam_i = w_i q_i + h_i (I - q_i q_i') (B_i d - b_i). An acting limit gives D_j d = e_j where it is a bound, and
p_j = (D_j d - e_j) / c_j where it is soft, so that

    (K + B'HB + D'C^{-1}D) d = g - B'(w q) + B'H b + D'C^{-1}e  on slipping terms and soft limits that act,
    B_i d = b_i  on the sticking terms,   D_j d = e_j  on the bounds that act.

That is a Newton step on F(d, lam) = (K d - g + B'lam, lam - P_w(lam + a s)), s = B d - b, and likewise for limits. On
absolute values (block 1) H vanishes, and the answer on the right sets is the solution itself.

Dependent rows, at edges, corners and beside supports, make that system singular: the multiplier of each of them is not
determined. Bounds that follow from others get the multiplier zero. The multipliers of discs that share a node are those
nearest to the previous ones in the metric sum_i |dlam_i|^2 / w_i^2: with a dependence nu among their rows,
sum_i nu_i . dlam_i / w_i^2 = 0.

The safeguard is the proximal point method on the multipliers. With centre (lam, p) and shifts a > 0, minimise the
convex, continuously differentiable function

    psi(d) = 1/2 d'Kd - g'd + sum_i [ |q_i|^2 - (|q_i| - w_i)_+^2 - |lam_i|^2 ] / (2 a_i)    q = lam + a (Bd - b)
             + sum_j [ (x_j)_+^2 / (1 + a_j c_j) - p_j^2 ] / (2 a_j)                         x = p + a (Dd - e)

(every term replaced by its Moreau envelope), whose gradient is K d - g + B'P_w(q) + D' x_+ / (1 + a c), then move the
centre to (P_w(q), x_+ / (1 + a c)). The outer iteration is Rockafellar's proximal point algorithm on the dual (SIAM J.
Control Optim. 14, 1976), which converges from any centre and for any a; the inner one is a semismooth Newton method
with Armijo's rule on a strongly convex function (Li, Sun and Toh, SIAM J. Optim. 28, 2018), which converges from any
start, and in finitely many steps where the envelope is piecewise quadratic (block 1). Armijo's rule is read off
derivatives: psi is convex, so psi(d + v) - psi(d) <= (psi'(d + v / 2) + psi'(d + v)) / 2 along v, which keeps its
digits where differences of psi are rounding.

The two together, after the adaptive method of Xiao, Li, Wen and Zhang (J. Sci. Comput. 2018; the paper's [24]): a
Newton point is *accepted* while it brings progress; otherwise a *safeguard* step is taken, and Newton is tried again
from where it ends. Merit and stopping test are one number, the certified duality gap, which is zero only at the
solution and needs no scaling. The safeguard starts from the best point at its first call, and goes on from where its
own last step ended ever after, whatever Newton found in between: begun anew from the best point it might repeat itself
for ever, for a proximal step need not lessen the gap (K = 1, g = .5, w = 1, a = 1: from d = 0, lam = .4, gap .005, to
d = .05, lam = .45, gap .0275).

Theorem. Let K be positive definite, some d obey the bounds, linear systems be solved exactly, and every centre be moved
once psi is minimised. Then the gaps of the best points tend to 0.

Proof. If the safeguard is called finitely often, the last run of Newton has no end, and that halves the best gap at
least once in PATIENCE points. Otherwise the safeguard's points are those of one proximal point algorithm: each of its
minimisations ends, and its centres (lam, p) converge to a solution of the dual, since there is one (constraints are
linear) and the shifts stay above the first, a. At a minimiser the residual r vanishes. With dlam, dp what the centre
moves by, s = dlam / a + n where lam is the point of the ball nearest to lam + a n, so that w |n| = lam.n and w |s| -
lam.s <= 2 w |dlam| / a; likewise the part of a soft limit is dp^2 times a bounded factor, and a rigid one is
overstepped by |dp| / a at most, while |z| <= |dp| / a where p > 0. The step tends to 0, so these do. Points are moved
back within the bounds before they are judged, by no more than a multiple of what they overstep, and the gap is
continuous there. The best gap is at most theirs.  QED

Here a centre is moved earlier, as soon as a Newton step on psi would gain less than .01 of what the centre moves by:
that is a criterion of the kind of Rockafellar's (B), which saves steps, and not in the theorem; nor are iterative
solvers. Nothing rests on either: what has not converged has a gap. On absolute values the sets are finitely many and,
where no sticking term has |lam_i| = w_i and no slipping one s_i = 0, found after finitely many steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, Bools, Floats, Ints, directions, lengths, whole
from vemcvx.linear import Factor, Matrix, corrected
from vemcvx.program.operators import (
    FEATURES,
    Operators,
    PressureLaw,
    Rows,
    product,
    restricted,
    transverse,
)
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.program.tolerances import UNSEEN
from vemcvx.solvers.projected_gradients import SWEPT, swept
from vemcvx.solvers.solver import Iterate, Solver

SHIFT = 0.1
"""Of the sets, in units of one over the flexibilities. At .1 the paper's scene takes 3-7 iterations from a cold start;
at 1 and beyond undamped active sets cycle on it, and degenerate terms (|lam_i| = w_i, s_i = 0) count as slipping for a
rounding error of s_i: the gap is linear in that slip."""


@dataclass(frozen=True)
class Sets:
    """Sticking terms, direction (m, block) and curvature (m,) of the others (0 where they stick), acting limits."""

    stick: Bools
    direction: Floats
    curvature: Floats
    act: Bools
    idle: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(k,) rows of sticking terms that follow from others' rows"""
    shares: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, m * block) of their equations shares @ lam = shares @ (previous lam), which determine their multipliers"""

    def bent(self, s: Floats) -> Floats:
        """h (I - q q') s, of vectors (m, block)."""
        along = np.einsum("ij,ij->i", self.direction, s)
        across: Floats = self.curvature[:, None] * (s - self.direction * along[:, None])
        return across

    def same(self, other: Sets) -> bool:
        """Return True if the other sets lead to the same answer."""
        return (
            self.stick.tobytes() == other.stick.tobytes()
            and self.act.tobytes() == other.act.tobytes()
            and np.array_equal(self.direction, other.direction)
        )


@dataclass(frozen=True)
class Shifts:
    """The weights of slips (m,) and excesses (r,) against multipliers; units of stiffness."""

    norms: Floats
    limits: Floats

    def __mul__(self, factor: float) -> Shifts:
        return Shifts(factor * self.norms, factor * self.limits)

    @staticmethod
    def of(operators: Operators) -> Shifts:
        """SHIFT times the stiffness that norm terms and limits feel."""
        return Shifts(SHIFT * operators.norm_stiffness, SHIFT * operators.limit_stiffness)


def sets_at(program: StepProgram, at: Iterate, shift: Shifts) -> Sets:
    """The sets at a point: q = lam + shift s sticks where |q| <= w, else slips along q; p + shift (z - c p) > 0 acts.

    The curvature shift w / (|q| - w) is that of Newton's method on lam = P_w(lam + shift s) after lam is
    eliminated (Kunisch and Stadler 2005; Hueber, Stadler and Wohlmuth 2008); at a solution it is w / |s|.
    """
    q = at.lam + shift.norms[:, None] * program.slip(at.d)
    size = lengths(q)
    stick = size <= program.w
    slip, curvature = ~stick, np.zeros(len(size))
    direction = slip[:, None] * directions(q, size)
    if program.operators.block > 1:
        stiff = shift.norms[slip] * program.w[slip]
        curvature[slip] = stiff / np.maximum(size[slip] - program.w[slip], stiff / most_curved(program)[slip])
    act = np.zeros(len(at.p), dtype=bool)
    if len(act):
        act = at.p + shift.limits * (program.excess(at.d) - program.operators.compliance * at.p) > 0
    return Sets(stick, direction, curvature, act)


def most_curved(program: StepProgram) -> Floats:
    """(m,) the most that curvatures of slipping discs are: 1e8 over their flexibility.

    Where several discs share a node, more would leave too little of the stiffness of the body beside it.
    """
    return 1e8 * program.operators.norm_stiffness


TURNS = 20
"""Corrections of discs on a factor, at most: together they take as long as factorising 2,178 unknowns."""


def answer_on(program: StepProgram, sets: Sets, near: Iterate | None = None) -> Iterate:
    """The point that the sets lead to; its multipliers are not yet projected.

    Where every row reads an unknown of its own, those of what is held are known, and the others are solved for. Where
    linear systems are solved iteratively, from the point `near`, if there is one, and as far as UNSEEN says.
    """
    operators = program.operators
    stick, hard = np.repeat(sets.stick, operators.block), sets.act & (operators.compliance == 0)
    spring = np.divide(1.0, operators.compliance, out=np.zeros(len(hard)), where=sets.act & ~hard)
    at_bound, bends = program.w[:, None] * sets.direction, bool(sets.curvature.any())
    M, load = operators.K, program.g - operators.multiplier_force(at_bound, -spring * program.e)
    S: sp.csr_matrix | None = None
    if bends or spring.any():
        S = operators.stiffening(sets.curvature[:, None, None] * transverse(sets.direction), spring)
        M, load = operators.plus(S), load + operators.rows.force_of(sets.bent(operators.blocks(program.b)).ravel())

    def carried(d: Floats, reaction: Floats, lam: Floats | None = None) -> Iterate:
        """The point whose slipping terms carry lam, by default as the sets have it, and what is held its reaction."""
        if lam is None:
            lam = at_bound + sets.bent(program.slip(d)) if bends else at_bound
        p, lam, held = spring * program.excess(d), lam.copy(), np.count_nonzero(stick)
        lam.ravel()[stick], p[hard] = reaction[:held], reaction[held:]
        return Iterate(d, lam, p)

    own = operators.own_columns
    if own is None:
        return carried(*_held(M, load, program, stick, hard))
    columns = np.concatenate([own[0][stick], own[1][hard]])
    coefficient = np.concatenate([operators.B.data[stick], operators.D.data[hard]])
    d, free = np.zeros(len(load)), np.ones(len(load), dtype=bool)
    d[columns], free[columns] = np.concatenate([program.b[stick], program.e[hard]]) / coefficient, False
    F, iterative = np.flatnonzero(free), not operators.factor.exact
    cycle = operators.factor.cycle(sp.csr_matrix(M.shape) if S is None else S, free) if near and iterative else None
    if near and cycle:
        d = corrected(M, np.where(free, near.d, d), load, free, cycle=cycle, part=UNSEEN)
    else:
        factor = operators.principal(F) if S is None else operators.factor.within(restricted(M, F), F)
        d[F] = factor.solve((load - product(M, d))[F] if d.any() else load[F])
    linear = carried(d, (load - product(M, d))[columns] / coefficient)
    if not bends or iterative or (lengths(linear.lam) > program.w)[sets.stick].any():
        return linear
    d, lam = _turned(program, sets, linear, spring, (F, factor))
    if d is linear.d:
        return linear
    return carried(d, program.residual(d, lam, spring * program.excess(d))[columns] / coefficient, lam)


def _turned(
    program: StepProgram, sets: Sets, linear: Iterate, spring: Floats, free: tuple[Ints, Factor]
) -> tuple[Floats, Floats]:
    """d and lam of the point of a linear system, corrected on its factor of the free unknowns where sets stand.

    By what it misses of the law, while that halves: the directions of slips turn, and where they have nearly been found
    a product and two triangular solves stand for the next factorisation. Multipliers stay those of the linear system:
    w s / |s| has the rounding of small slips.
    """
    (F, factor), d, lam = free, linear.d, linear.lam
    s, best, least = program.slip(d), (d, lam), np.inf
    for _ in range(TURNS):
        if (~sets.stick & (np.einsum("ij,ij->i", s, sets.direction) <= 0)).any():
            break
        law = np.where(sets.stick[:, None], 0.0, program.w[:, None] * directions(s, lengths(s)))
        force = program.residual(d, law, spring * program.excess(d))[F]
        missed = float(np.abs(force).max(initial=0.0))
        if missed > 0.5 * least:
            break
        best, least, before, d = (d, lam), missed, s, d.copy()
        d[F] += factor.solve(force)
        s = program.slip(d)
        lam = law + sets.bent(s - before)
    return best


def _held(M: Matrix, load: Floats, program: StepProgram, stick: Bools, hard: Bools) -> tuple[Floats, Floats]:
    """Minimise 1/2 d'Md - load'd subject to B_i d = b_i and D_j d = e_j on the rows given; d and the reactions."""
    operators = program.operators
    A = sp.vstack([operators.B[stick], operators.D[hard]], format="csr")
    value = np.concatenate([program.b[stick], program.e[hard]])
    factor = operators.factor.within(M, np.arange(len(load)))
    spread = factor.solve(A.T.toarray())
    small = A @ spread

    def correct(force: Floats, gap: Floats) -> tuple[Floats, Floats]:
        free = factor.solve(force)
        # Redundant rows make the small system singular; least squares picks one of the equal reactions.
        push = np.linalg.lstsq(small, A @ free - gap, rcond=None)[0] if len(gap) else gap
        return free - spread @ push, push

    d, reaction = correct(load, value)
    # One step of refinement: A d = value then holds to the rounding of d instead of cond(K) times that.
    more, push = correct(load - M @ d - A.T @ reaction, value - A @ d)
    return d + more, reaction + push


FOLLOWS = 1e-6
"""Part of a row's length that others leave of it, below which it follows from them."""


def without_redundant_rows(operators: Operators, sets: Sets, lam: Floats, w: Floats) -> Sets:
    """The sets with equations for linearly independent rows alone: those of bounds first, then of sticking terms.

    An absolute value whose row depends on those before it is taken to slip: it carries the share lam_i / w_i of its
    weight. Such a bound carries nothing.
    """
    block = operators.block
    stops, sticks = np.flatnonzero(sets.act & (operators.compliance == 0)), np.flatnonzero(sets.stick)
    own = np.flatnonzero(np.repeat(sets.stick, block))
    rows = sp.csr_matrix(sp.vstack([operators.D[stops], operators.B[own]]))
    # Only rows that share unknowns, or read none, can depend on others.
    shared = np.bincount(rows.indices, minlength=rows.shape[1]) > 1
    some = np.flatnonzero((abs(rows) @ shared > 0) | (abs(rows) @ np.ones(rows.shape[1]) == 0))
    free = np.ones(rows.shape[0], dtype=bool)
    free[some] = independent(rows[some].toarray())
    act = sets.act.copy()
    act[stops] = free[: len(stops)]
    if block > 1:
        idle = own[~free[len(stops) :]]
        shares = np.zeros((len(idle), len(lam) * block))
        shares[:, own] = _shares(rows, free, some, own, w[own // block])
        return replace(sets, act=act, idle=idle, shares=shares)
    stick = sets.stick.copy()
    stick[sticks] = free[len(stops) :]
    most = np.maximum(w, np.linalg.norm(lam, axis=1))[:, None]
    share = np.divide(lam, most, out=np.zeros_like(lam), where=most > 0)
    direction = np.where((sets.stick & ~stick)[:, None], share, sets.direction)
    return replace(sets, act=act, stick=stick, direction=direction)


def _shares(rows: sp.csr_matrix, free: Bools, some: Ints, own: Ints, w: Floats) -> Floats:
    """(k, len(own)) how k sticking rows depend on others, over w (len(own),) squared; bounds come first in `rows`."""
    stops = rows.shape[0] - len(own)
    basis, rest = some[free[some]], some[~free[some] & (some >= stops)]
    dependence = np.zeros((len(rest), rows.shape[0]))
    dependence[:, basis] = -np.linalg.lstsq(rows[basis].toarray().T, rows[rest].toarray().T, rcond=None)[0].T
    dependence[np.arange(len(rest)), rest] = 1.0
    own_part = dependence[:, stops:]
    involved = np.abs(own_part) > FOLLOWS * np.abs(own_part).max(axis=1, initial=0.0, keepdims=True)
    least = np.where(involved, w, np.inf).min(axis=1, initial=np.inf, keepdims=True)
    # Discs of no radius carry nothing, whatever the others do.
    nearness = np.divide(least, w, out=np.ones_like(own_part), where=involved & (w > 0))
    weighted = np.where(involved, own_part * nearness**2, 0.0)
    return np.asarray(weighted / np.abs(weighted).max(axis=1, initial=0.0, keepdims=True))


def independent(rows: Floats) -> Bools:
    """A mask (k,) of the rows (k, n) that do not depend linearly on those before them."""
    basis, found = np.zeros_like(rows), np.zeros(len(rows), dtype=bool)
    for i, row in enumerate(rows):
        rest = row - basis.T @ (basis @ row)
        rest = rest - basis.T @ (basis @ rest)
        size = np.linalg.norm(rest)
        found[i] = size > FOLLOWS * np.linalg.norm(row)
        basis[i] = rest / size if found[i] else 0.0
    return found


def proximal_points(program: StepProgram, start: Iterate, shift: Shifts) -> Iterator[tuple[Iterate, Shifts]]:
    """Yield a point and its shifts after every Newton step, centre after centre, for ever; the caller stops.

    Shifts grow fourfold from centre to centre: the method converges for any, faster for larger ones. Beyond 1e8 of the
    first a B'B in the Hessian would leave K no digits.
    """
    grown = 1.0
    point = Iterate(start.d, program.project(start.lam), np.maximum(start.p, 0.0))
    while True:
        centre = point
        for _ in range(60):
            d, moved = _newton_step(program, point.d, centre, shift)
            point = Iterate(d, *_multipliers(program, d, centre, shift))
            yield point, shift
            if not moved:
                break
        if grown < 1e8:
            grown, shift = 4.0 * grown, shift * 4.0


def _unprojected(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> tuple[Floats, Floats]:
    return centre.lam + shift.norms[:, None] * program.slip(d), centre.p + shift.limits * program.excess(d)


def _multipliers(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> tuple[Floats, Floats]:
    q, x = _unprojected(program, d, centre, shift)
    return program.project(q), np.maximum(x, 0.0) / (1.0 + shift.limits * program.operators.compliance)


def _newton_step(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> tuple[Floats, bool]:
    """One damped Newton step on psi, and True if another one is worth its while at this centre."""
    lam, p = _multipliers(program, d, centre, shift)
    hessian = _hessian(program, *_unprojected(program, d, centre, shift), shift)
    force = program.residual(d, lam, p)
    step = program.operators.factor.within(hessian, np.arange(len(d))).solve(force)
    decrement = float(force @ step)
    if decrement <= 4 * EPS * float(np.abs(program.g) @ np.abs(d)):
        return d + step, False

    def rises(length: float) -> float:
        ahead = d + length * step
        return -float(program.residual(ahead, *_multipliers(program, ahead, centre, shift)) @ step)

    length = 1.0
    while length > 1e-12 and 0.5 * (rises(0.5 * length) + rises(length)) > -1e-4 * decrement:
        length *= 0.5
    dlam, dp = lam - centre.lam, p - centre.p
    moved = float(np.einsum("ij,ij->i", dlam, dlam) @ (1 / shift.norms) + dp * dp @ (1 / shift.limits))
    # The next centre is wanted once the decrement is .01 of how far this one would move: with Rockafellar's criterion
    # (B) the outer iteration then converges as fast as with exact minimisers.
    return d + length * step, length > 1e-12 and decrement > 0.01 * moved


def _hessian(program: StepProgram, q: Floats, x: Floats, shift: Shifts) -> Matrix:
    """K + B'HB + D'diag D with H_i = a on sticking blocks, a (w/|q|)(I - qq'/|q|^2) on slipping ones."""
    operators, size = program.operators, lengths(q)
    slip = size > program.w
    share = np.divide(program.w, size, out=np.ones_like(size), where=slip)
    pressed = np.where(x > 0, shift.limits / (1.0 + shift.limits * operators.compliance), 0.0)
    bends = (shift.norms * share)[:, None, None] * transverse(slip[:, None] * directions(q, size))
    return operators.plus(operators.stiffening(bends, pressed))


PATIENCE = 8
"""Newton points in a row that may fail to halve the best gap before the safeguard is called."""
OVERRELAXATION = 0.01
"""Part of their bound by which multipliers of discs that were on it begin a step beyond it, so that they slip in its
first sets, with SHIFT / OVERRELAXATION times the stiffness that they feel for a curvature. Begun on the bound, where
they stick first, 64 steps take a tenth to a quarter more solves; begun .03 or .1 beyond it, a few more."""


@dataclass(frozen=True)
class Newton(Solver):
    """Hand-written semismooth Newton method, globally convergent; takes every kind of term.

    Parameters
    ----------
    accuracy : float
        Certified relative energy error asked of a step.
    max_iterations : int
        Linear solves a step before it gives up; the answer so far is returned and will not be certified.
    """

    accuracy: float = 1e-8
    max_iterations: int = 400

    accepts: ClassVar[frozenset[str]] = FEATURES

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_iterations, "Newton", "max_iterations", "linear solves")

    @property
    def solves_on_sets(self) -> bool:
        return True

    @property
    def advice(self) -> str:
        return "raise max_iterations"

    def limited(self, max_iterations: int) -> Newton:
        return replace(self, max_iterations=max_iterations)

    def prepare(self, operators: Operators) -> Newton:
        return self

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one scaled step."""
        run = _Search(program, target, self.max_iterations)
        shift = Shifts.of(program.operators)
        pressed = np.zeros(len(program.e)) if p is None else np.maximum(p, 0.0)
        # Terms that were at their bound slip again, as under most loads they do.
        beyond = 4 * EPS if program.operators.block == 1 else OVERRELAXATION
        start = Iterate(np.zeros(len(program.g)), (1.0 + beyond) * program.project(lam), pressed)
        operators = program.operators
        if operators.sweepable and isinstance(operators.K, np.ndarray) and operators.own_columns is not None:
            none = Rows(sp.csr_matrix((len(program.w), len(program.e))))
            start = swept(program, PressureLaw(lambda p: program.w, lambda p: none), start, SWEPT**0.5)
        run.newton(start, shift)
        # The safeguard's first shifts are a hundred of the active sets'.
        safeguard = proximal_points(program, run.best, shift * 100.0)
        while not run.done:
            point, shift = next(safeguard)
            run.offer(point, "proximal")
            if not run.done:
                run.newton(point, shift, patience=1)
        status = "converged" if run.gap <= target or run.gap <= run.floor else "iteration limit"
        best, safeguards = run.best, run.safeguards
        return Answer(best.d, best.lam, run.iterations, status, safeguards=safeguards, p=best.p)


@dataclass
class _Search:
    """The best point of one step, and how many linear solves it took."""

    program: StepProgram
    target: float
    max_iterations: int
    iterations: int = 0
    safeguards: int = 0
    first: Iterate = field(init=False)
    best: Iterate = field(init=False)
    gap: float = np.inf
    stationary: bool = False

    def offer(self, point: Iterate, kind: str) -> None:
        """Count a linear solve, and keep its point, moved within the bounds, if it is the best."""
        self.iterations += 1
        self.safeguards += kind == "proximal"
        offered = Iterate(*self.program.admissible_point(point.d, point.lam, point.p))
        gap = self.program.duality_gap(offered.d, offered.lam, offered.p)
        if self.iterations == 1:
            self.first = offered
        if self.iterations == 1 or gap < self.gap:
            self.best, self.gap = offered, gap

    @cached_property
    def floor(self) -> float:
        """The rounding floor, of the first point or the best, taken once if at all.

        The lower one: a limit that is not met to the last digit may count far more at one point than at another, and
        what is above the target is worth further steps.
        """
        return min(self.program.rounding_floor(x.d, x.lam, x.p) for x in (self.first, self.best))

    @property
    def done(self) -> bool:
        """Sharp enough, at the rounding floor, at the target and no longer improving, or out of iterations."""
        return self.gap <= self.enough or self.iterations >= self.max_iterations or self.gap <= self.floor

    @property
    def enough(self) -> float:
        """The gap at which to stop; below the target iterations go on, where each is cheap and gains."""
        return self.target if self.stationary or not self.exact else UNSEEN**2 * self.target

    @property
    def exact(self) -> bool:
        """True if linear systems are solved to rounding: the same sets then have the same answer."""
        return self.program.operators.factor.exact

    def newton(self, point: Iterate, shift: Shifts, patience: int = PATIENCE) -> None:
        """Active-set steps while one in `patience` halves the best gap and the sets change.

        Those of discs change with every direction: where their answer is sharp enough, nothing more is to be learnt.
        """
        converges = self.program.operators.block > 1 or not self.exact
        seen: Sets | None = None
        waited = 0
        while waited < patience and self.iterations < self.max_iterations:
            sets = sets_at(self.program, point, shift)
            if self.exact and seen is not None and sets.same(seen):
                self.stationary = True
                return
            before = self.gap
            point = answer_on(self.program, sets, point)
            self.offer(point, "newton")
            waited = 0 if self.gap <= 0.5 * before else waited + 1
            if waited and self.gap <= self.target:
                self.stationary = True
                return
            # The floor is that of a point that is no longer improved: far from the solution it is higher.
            if converges and (self.gap <= self.enough or waited) and self.done:
                return
            seen = sets
