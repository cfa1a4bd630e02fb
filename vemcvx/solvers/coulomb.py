"""Coulomb's law solved whole: weights that follow the forces of the limits, on sets that are proven right.

With weights w(p) a step is a *quasi*-variational inequality, which no energy minimises: find d, lam, p with

    K d = g - B'lam - D'p,      |lam_i| <= w_i(p),   lam_i . s_i = w_i(p) |s_i|,         s = B d - b
                                p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0    z = D d - e       (Q)

On given sets, and with w(p) = w_0 + J (p - p_0) near p_0, (Q) is one linear system, not symmetric because of J:

    s_i = 0  on sticking terms,           lam_i = q_i w_i(p) + h_i (I - q_i q_i') s_i  on slipping ones,
    z_j = c_j p_j  on acting limits,      p_j = 0  on the others.

:mod:`vemcvx.solvers.sets_system` reduces it to the motions that the sets leave, and solves it.

The sets are those of the last answer, as in :mod:`vemcvx.solvers.newton`: a semismooth Newton method on (Q) (Alart and
Curnier 1991; Hueber, Stadler and Wohlmuth 2008); those of discs are sought by projected gradients first, which cost a
product with W each. It may cycle, and is then begun anew from answers of convex programs with weights held fast
(:mod:`vemcvx.stepping.fixed_point`).

Theorem 1. Let the terms be absolute values (block 1). If the solution of the system of some sets
has |lam_i| <= w_i(p) where it sticks, q_i s_i >= 0 where it slips, p_j >= 0 where limits act, z_j <= 0 where they do
not, and w at p is the affine one of the system, then it solves (Q). Proof. Every line of (Q) is an equation of the
system or one of these inequalities.  QED  Where rows follow from one another, at corners, the system is singular and
what each carries is chosen (:mod:`vemcvx.solvers.newton`); that s_i = 0 and z_j <= 0 nevertheless is looked at.

Any other d is thus at a known distance from *a* solution: |d - d_sets|_K, plus the error of d_sets, the last correction
of its iterative refinement. (Where coefficients are not small there may be more solutions than one.)

In blocks of two and more the directions of slip turn with the answer, and the step is no linear system. Sets are solved
with directions q_i and curvatures h_i at first; then d and x = (lam, p) are corrected on the same factor by what they
miss of the law itself, w_i(p) s_i / |s_i| - lam_i, while that halves. Let d_0, x_0 be what this leads to, s_i^0 = v_i
n_i the slips there, |n_i| = 1, and delta_i = |n_i - q_i| <= 1. The law on the sets is their system with psi_i^0 +
psi_i(s, p) added to lam_i,

    psi_i(s, p) = w_i(p) s_i / |s_i| - q_i (w(p_0) + J (p - p_0))_i - h_i (I - q_i q_i') s_i - psi_i^0,

where psi^0 is such that d_0 and x_0 solve it without psi: there psi_i is w_i n_i - lam_i. Where psi has at most t_i
along q_i and at most u_i across it, the solution differs from d_0 by at most E in energy, its slips by at most alpha_i
along q_i and gamma_i across it, and its forces of limits by at most pi_j
(:meth:`vemcvx.solvers.sets_system.SetsSystem.answers`). Let

    turn_i = (gamma_i + delta_i alpha_i) / (v_i - alpha_i - gamma_i),
    rho_i = (delta_i + turn_i) (w_i ((alpha_i + gamma_i) / v_i + turn_i / 2) + (|J| pi)_i).

Theorem 2. Let t, u >= 0 be such that alpha_i + gamma_i < v_i on slipping terms, |psi_i(s_0, p_0) . q_i| + rho_i is at
most t_i, and what psi_i(s_0, p_0) has across q_i, with rho_i added, at most u_i; let E, alpha, gamma, pi be those for
|w_i / v_i - h_i| times what motions of energy E move across q_i besides. If w is affine on |p - p_0| <= pi, and the
inequalities of the sets hold for all answers to such psi, then (Q) has a solution d with |d - d_0|_K <= E. Terms of
weight zero slip with h_i = 0, and psi_i = -lam_i is all that they miss.

Proof. Let s_i move by e = a q_i + g, |a| <= alpha_i and |g| <= gamma_i, g across q_i. Its part across n_i, g_n, is at
most gamma_i + delta_i alpha_i, so that the direction of s_i turns by at most turn_i: across n_i by |g_n| / |s_i|, which
differs from |g_n| / v_i by at most turn_i (alpha_i + gamma_i) / v_i, and along n_i by at most turn_i^2 / 2. And g_n - g
= (q_i q_i' - n_i n_i') e is at most delta_i (alpha_i + gamma_i). Of w_i g / v_i psi_i keeps (w_i / v_i - h_i) g, which
is what may be besides. The change of w counts along s_i / |s_i| - q_i, which is at most delta_i + turn_i. So (d, p) ->
the answer to psi(s, p) is continuous and maps the convex compact set of all motions within E and forces within pi into
itself: Brouwer gives a fixed point, which solves (Q). QED Rounding is that of d_0 and of the inequalities; rows of
which what is held leaves less than FOLLOWS count as held. No coefficient need be small.

The system that was solved is one of these, with directions of a point near d_0: its factor serves for the proof. Where
bounds are not found on it, that of q_i = n_i and h_i = w_i / v_i is made, for which delta_i = 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy.linalg import LinAlgError

from vemcvx.arrays import EPS, Bools, Floats, lengths
from vemcvx.program.operators import OnceForEach, Piece, PressureLaw, Rows
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.newton import Sets, Shifts, most_curved, sets_at, without_redundant_rows
from vemcvx.solvers.projected_gradients import swept
from vemcvx.solvers.sets_system import Answers, Response, SetsSystem
from vemcvx.solvers.solver import Iterate

SOLVED = 1e-6
"""Part of the answer above which a correction shows a nearly singular system, whose sets leave a motion free."""
SETTLED = 1e-12
"""Part of the answer below which a correction of a linear system is the last: the next would be below rounding."""
ROUNDINGS = 64.0
"""Rounding units by which an inequality may fail."""
OFF = 8.0
"""Last corrections by which an inequality may fail: the energy of the next is less than that of the last, but entries
of it may be larger."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """A point that solves the equations of some sets, and by how much it may be off."""

    sets: Sets
    once: Sets
    """the sets of the system: those without rows that follow from others"""
    law: Piece
    weights: Floats
    """(m,) of the law at the point"""
    point: Iterate
    error: float
    """the last correction of the linear system, in energy"""
    forces: float
    """what multipliers may be off by"""
    motions: Floats
    """(m * block + r,) what s and z may be off by"""
    system: SetsSystem

    @property
    def blur(self) -> float:
        """The length below which slips are rounding."""
        return float(self.motions.max(initial=0.0))

    def holds(self, program: StepProgram) -> bool:
        """Return True if the point obeys the law, to rounding."""
        lam, s, w = self.point.lam, program.slip(self.point.d), self.weights
        size, slips = lengths(lam), lengths(s)
        blur = program.operators.blocks(self.motions[: s.size]).max(axis=1)
        bound = np.abs(size - w) <= self.forces
        forth = lengths(slips[:, None] * lam - size[:, None] * s) <= 2 * (self.forces * slips + size * blur)
        slides = self.sets.stick | (bound & forth)
        return bool(slides.all()) and self.stands(program)

    def stands(self, program: StepProgram, answers: Answers | None = None) -> bool:
        """Return True if what sticks may stick, what acts presses, and the rest is open, whatever is answered."""
        act, stick, z, p = self.once.act, self.sets.stick, program.excess(self.point.d), self.point.p
        size, w = lengths(self.point.lam), self.weights
        if answers is not None:
            pi = np.where(act, answers.forces, 0.0)
            size, w, p, z = size + answers.multipliers, w - self.system.J.absolute.read(pi), p - pi, z + answers.excess
        within = ~stick | (size <= w + self.forces)
        # Bounds that follow from others may have been dropped from the system, and must hold nevertheless.
        pressed = np.where(act, p >= -self.forces, z <= self.motions[program.b.size :])
        # Where rows follow from others', what sticks is held by these.
        still = ~stick | (lengths(program.slip(self.point.d)) <= self.blur)
        return bool(within.all() and pressed.all() and still.all())

    def affine(self, law: PressureLaw, pi: Floats) -> bool:
        """Return True if weights are those of the piece at forces within pi (r,), as far as corners tell."""
        p = np.maximum(self.point.p, 0.0)
        for there in (np.maximum(p - pi, 0.0), p + pi):
            off = law.weights(there) - self.weights - self.system.J.read(there - p)
            if (np.abs(off) > self.forces).any() or not law.slope(there).same(self.law.slope):
                return False
        return True

    def next_point(self, program: StepProgram) -> Iterate:
        """The point to take the next sets at, where others decide what discs do that share their nodes, at edges.

        A disc that sticks, but is moved by others, is made to slip that way: one that slides along another face until
        it meets its own moves by the remaining gap there. A disc that slips, but is held by others, is made to slip
        again: two of them that together are too weak would stick in turns.
        """
        point, s = self.point, program.slip(self.point.d)
        if program.operators.block == 1:
            return point
        size = lengths(s)
        moved, held = self.sets.stick & (size > self.blur), ~self.sets.stick & (size <= self.blur)
        lam = np.where(held[:, None], (1.0 + ROUNDINGS * EPS) * point.lam, point.lam)
        lam[moved] = (self.weights[moved] / size[moved])[:, None] * s[moved]
        return replace(point, lam=lam)

    def admissible(self, program: StepProgram) -> Iterate:
        """The point within its bounds; what sticks or acts is in place, what slips at its weight to the last bit.

        What rounding leaves of a gap does work with the force there, and what it leaves between a multiplier and its
        weight on the slip: 7e-13 of a weight were 3e-7 in energy on a block that slides as a whole, and as much were
        gaps of 2e-18 under a body on springs of 1e-8 of its modulus.
        """
        operators, d = program.operators, self.point.d.copy()
        held = np.repeat(self.sets.stick, operators.block), self.once.act & (operators.compliance == 0)
        for rows, still, place in zip((operators.rows, operators.limits), held, (program.b, program.e), strict=True):
            k = np.flatnonzero(still & rows.single)
            entry = rows.B.indptr[k]
            d[rows.B.indices[entry]] = place[k] / rows.B.data[entry]
        lam, size = replace(program, w=self.weights).project(self.point.lam), lengths(self.point.lam)
        slides = ~self.sets.stick & (size > 0)
        lam[slides] = (self.weights[slides] / size[slides])[:, None] * self.point.lam[slides]
        return Iterate(program.feasible(d), lam, np.maximum(self.point.p, 0.0))


def _balances(program: StepProgram, lam: Floats, p: Floats) -> bool:
    """Return True if forces balance, to SOLVED of the loads, on motions that K does not feel.

    Sets that leave such a motion free make the system singular up to rounding. Its solution is huge, and residuals that
    are measured relative to it look small.
    """
    operators = program.operators
    if operators.kernel is None:
        return True
    pushed = np.abs(operators.kernel).T @ np.abs(program.g)
    left, blur = operators.kernel_balance.imbalance(lam, p, operators.kernel.T @ program.g, pushed)
    return bool((np.abs(left) <= blur + SOLVED * pushed).all())


def on_sets(program: StepProgram, law: Piece, sets: Sets, response: Response, near: Floats) -> Found:
    """Solve the system of the sets, corrected by its residual until that is rounding, twice at most.

    LinAlgError where the system is singular.
    """
    operators, system = program.operators, SetsSystem(program.operators, sets, law.slope, response)
    point = Iterate(np.zeros(len(program.g)), np.zeros_like(near), np.zeros(len(sets.act)))
    force, free = program.g, np.sqrt(operators.factor.energy(program.g))
    for turn in range(3):
        bound = sets.direction * (law.weights + system.J.read(point.p - law.forces))[:, None]
        bound += sets.bent(program.slip(point.d))
        step, more = system.solve(force, _missing(program, sets, point, bound, near))
        point = _moved(point, step, more)
        x = np.concatenate([point.lam.ravel(), point.p])
        if turn:
            error, norm = operators.energy_norm(step), free + np.sqrt(operators.factor.energy(response.act(x)))
            if error <= SETTLED * norm:
                break
        force = program.residual(point.d, point.lam, point.p)
    size, last, off = np.abs(x), np.abs(more).max(initial=0.0), response.rows.read(step)
    solved = last <= SOLVED * max(np.abs(program.g).max(initial=0.0), size.max(initial=0.0)) and error <= SOLVED * norm
    # Sets that leave a rigid motion free put the body anywhere along it; the work of multipliers on it shows that.
    solved = solved and size @ np.abs(off) <= SOLVED * norm**2
    if not solved or not _balances(program, point.lam, point.p):
        raise LinAlgError("singular")
    reach = response.rows.absolute.read(np.abs(point.d)) + np.abs(np.concatenate([program.b, program.e]))
    return Found(
        sets=sets,
        once=sets,
        law=law,
        weights=law.weights,
        point=point,
        error=error,
        forces=OFF * last + ROUNDINGS * EPS * size.max(initial=0.0),
        motions=OFF * np.abs(off) + ROUNDINGS * EPS * reach,
        system=system,
    )


def _moved(point: Iterate, step: Floats, more: Floats) -> Iterate:
    """The point, moved by increments (n,) and multipliers (m * block + r,)."""
    norms = point.lam.size
    return Iterate(point.d + step, point.lam + more[:norms].reshape(point.lam.shape), point.p + more[norms:])


def _missing(program: StepProgram, sets: Sets, at: Iterate, bound: Floats, near: Floats) -> Floats:
    """(N,) what a point misses of the equations of the sets, slipping terms having the multipliers `bound`."""
    norms = np.where(sets.stick[:, None], -program.slip(at.d), bound - at.lam).ravel()
    if len(sets.idle):
        norms[sets.idle] = sets.shares @ (near - at.lam).ravel()
    touching = program.operators.compliance * at.p - program.excess(at.d)
    return np.concatenate([norms, np.where(sets.act, touching, -at.p)])


ROUGH = 1e-6
"""Part of its bound by which what sticks may exceed it while directions still turn."""
TURNS = 12
"""Corrections on one factor while directions turn. Each leaves a tenth to a third of what the one before left; where it
leaves more than half, a new factor is worth its while."""


def turned(program: StepProgram, found: Found, near: Floats) -> Found:
    """The point corrected on the same factor by what it misses of the law itself, while sets stand and that halves."""
    sets, best, point, least = found.once, found.point, found.point, np.inf
    law, J = found.law, found.system.J
    for _ in range(TURNS):
        w, s = np.maximum(law.weights + J.read(point.p - law.forces), 0.0), program.slip(point.d)
        v, size = lengths(s), lengths(point.lam)
        slides = ~sets.stick & (v > found.blur)
        bound = np.where(slides[:, None], (w / np.where(slides, v, 1.0))[:, None] * s, point.lam)
        missed = np.abs(bound - point.lam).max(initial=0.0)
        back = slides & (np.einsum("ij,ij->i", s, sets.direction) <= 0)
        if missed > 0.5 * least or back.any() or (sets.stick & (size > w + ROUGH * size)).any():
            break
        best, least = point, missed
        if missed <= found.forces:
            break
        force = program.residual(point.d, point.lam, point.p)
        point = _moved(point, *found.system.solve(force, _missing(program, sets, point, bound, near)))
    return replace(found, point=best)


def distance_to_a_solution(program: StepProgram, law: PressureLaw, found: Found, response: Response) -> float | None:
    """A bound on |d - d*|_K to a solution d* of (Q), by theorem 2; None if there is no proof."""
    stick, bears, s = found.sets.stick, found.weights > 0, program.slip(found.point.d)
    slides = ~stick & bears & (lengths(s) > found.blur)
    left = ~stick & ~bears & (found.point.lam != 0).any(axis=1)
    if not (slides.any() or left.any()):
        return 0.0 if found.holds(program) else None
    with suppress(LinAlgError):
        for sets, system in _systems_of_proof(program, found, response, slides, s):
            answers = _bounded_answers(system, sets, found, slides, s)
            if answers is None:
                continue
            pi = np.where(found.once.act, answers.forces, 0.0)
            # What slips by no more than rounding is held by others, wherever lam_i points.
            held = (answers.along[~stick & bears & ~slides] <= found.blur).all()
            silent = (stick | bears | (found.system.J.absolute.read(pi) == 0)).all()
            if held and silent and found.affine(law, pi) and found.stands(program, answers):
                return answers.energy
    return None


def _systems_of_proof(
    program: StepProgram, found: Found, response: Response, slides: Bools, s: Floats
) -> Iterator[tuple[Sets, SetsSystem]]:
    """The system that the point was found on, where nothing bends that bears nothing; then that of the point itself."""
    sets, w, bears = found.once, found.weights, found.weights > 0
    if (bears | (sets.curvature == 0)).all():
        yield sets, found.system
    v = np.where(slides, lengths(s), 1.0)
    direction = np.where(slides[:, None], s / v[:, None], sets.direction)
    curvature = np.where(slides, np.minimum(w / v, most_curved(program)), bears * sets.curvature)
    own = replace(sets, direction=direction, curvature=curvature)
    yield own, SetsSystem(program.operators, own, found.law.slope, response)


DOUBLED = 4
"""Bounds (t, u) that are tried, each twice what the last lead to: where psi changes little, the first do."""


def _bounded_answers(system: SetsSystem, sets: Sets, found: Found, slides: Bools, s: Floats) -> Answers | None:
    """Answers to all psi within bounds (t, u) as theorem 2 wants them, in its letters; None where none are found.

    The system is that of the sets, s (m, block) are the slips of the point.
    """
    w, lam, q, blur = found.weights, found.point.lam, sets.direction, found.blur
    v = np.where(slides, lengths(s), np.inf)
    n = np.where(slides[:, None], s, 0.0) / v[:, None]
    delta, missed = slides * lengths(n - q), slides[:, None] * (w[:, None] * n - lam)
    along = np.einsum("ij,ij->i", missed, q)
    psi = np.stack([np.abs(along), lengths(missed - along[:, None] * q)])
    psi += slides * (found.forces + w * np.stack([blur / v * (blur / v + delta), blur / v]))
    psi += np.where(sets.stick | (w > 0), 0.0, lengths(lam))
    lacking = np.where(slides, np.abs(w / v - sets.curvature), 0.0)
    J, bounds = found.system.J.absolute, 2.0 * psi
    for _ in range(DOUBLED):
        answers = system.answers(bounds[0], bounds[1], lacking)
        if answers is None:
            return None
        alpha, gamma = answers.along * slides, answers.across * slides
        if not (alpha + gamma < v).all():
            return None
        turn = (gamma + delta * alpha) / (v - alpha - gamma)
        rho = (delta + turn) * (w * ((alpha + gamma) / v + turn / 2) + J.read(answers.forces))
        led = psi + rho * slides
        if (led <= bounds).all():
            return answers
        bounds = np.maximum(bounds, 2.0 * led)
    return None


STEEPER = 10**0.5
"""The factor by which softened laws become steeper at a time. Of 180 random problems with a steep law, sets did not
settle in 4; of the first 60 in 6 with a factor of 10, and in 18 where the law was steep at once."""


@dataclass(frozen=True)
class SetsSolution:
    """A point that solves (Q) to rounding."""

    point: Iterate
    weights: Floats
    error: float
    """of the solve; and the distance to a solution of (Q), where that is not the sets' own"""
    proven: bool
    """True if one of the theorems says that there is a solution; else this is the limit of Newton's method"""


def solution_near(
    program: StepProgram, law: PressureLaw, start: Iterate, response: Response, rounds: Iterator[int]
) -> SetsSolution | None:
    """A solution of (Q) from the sets at `start`; None where the sets do not settle.

    Newton's method on a law that rises steeply and levels off jumps between its level and zero, and misses its slope.
    The softer law w(share p), share = 1e-6, is solved on its slope, and steeper ones are begun from its answer, up to
    share = 1: with p / STEEPER in place of p each begins on the same piece. Terms that slip under given weights may
    seem to stick under the larger weights of their own pressures: a second attempt takes the sets of the given weights.

    The point `start` is the answer to the program with given weights, and `response` is that of its operators. The
    system of every sets takes one of the `rounds`; where there are no more of these there is no solution.
    """
    near = swept(program, law, start) if program.operators.sweepable else start
    found = _from_sets(program, law, near, response, rounds)
    found = found or _from_sets(program, law, start=start, response=response, rounds=rounds, w=program.w)
    found = found or _by_softer_laws(program, law, start, response, rounds)
    if found is None:
        return None
    point = found.admissible(program)
    away = distance_to_a_solution(program, law, found, response) if program.operators.block > 1 else 0.0
    # Where the point is moved within bounds and into place, that counts.
    error = found.error + program.operators.energy_norm(point.d - found.point.d) + (away or 0.0)
    return SetsSolution(point, found.weights, error, away is not None)


def _softened(law: PressureLaw, share: float) -> PressureLaw:
    """The law w(share p)."""
    soften = OnceForEach(lambda J: Rows(share * J.B))
    return PressureLaw(lambda p: law.weights(share * p), lambda p: soften(law.slope(share * p)))


def _by_softer_laws(
    program: StepProgram, law: PressureLaw, start: Iterate, response: Response, rounds: Iterator[int]
) -> Found | None:
    """A solution by way of laws that are softened at first."""
    share, point, factor = 1e-6, start, STEEPER
    last: tuple[Iterate, float] | None = None
    while True:
        softer = law if share >= 1.0 else _softened(law, share)
        found = _from_sets(program, softer, point, response, rounds)
        if found is not None and share >= 1.0:
            return found
        if found is not None:
            last = found.admissible(program), share
        elif last is None or program.operators.block == 1 or factor < STEEPER**0.5:
            return None
        else:
            factor = factor**0.5  # Where a steeper law of discs does not settle, one less steep is tried, twice.
        point, share = replace(last[0], p=last[0].p / factor), last[1] * factor


MOST_SETS = 40
"""Sets that are tried from a point: absolute values settle in fewer than ten, directions of discs turn for longer."""
RETURNS = 6
"""Times that discs may come back to what they have left; absolute values that do cycle for ever."""


def _from_sets(
    program: StepProgram,
    law: PressureLaw,
    start: Iterate,
    response: Response,
    rounds: Iterator[int],
    w: Floats | None = None,
) -> Found | None:
    """A solution from the sets at `start`, beside weights `w` (m,) if given."""
    shift, point, discs = Shifts.of(program.operators), start, program.operators.block > 1
    met: list[bytes] = []
    returns = 0
    for _ in islice(rounds, MOST_SETS):
        sets, piece = _sets(program, law, point, shift, None if met else w)
        # The same terms may stick and press on another piece of the law: on its slope, and then on its level.
        J = piece.slope.B
        parts = sets.stick, sets.act, J.data, J.indices, J.indptr
        mark = b"".join(part.tobytes() for part in (parts if discs else (*parts, sets.direction)))
        returns += mark in met and not (discs and mark == met[-1])
        if returns > (RETURNS if discs else 0):
            return None
        met.append(mark)
        found = _tried(program, piece, sets, response, point.lam)
        if found is None:
            return None
        found = turned(program, found, point.lam) if discs else found
        found = replace(found, weights=law.weights(np.maximum(found.point.p, 0.0)))
        if found.holds(program):
            return found
        point = found.next_point(program)
    return None


def _tried(program: StepProgram, law: Piece, sets: Sets, response: Response, lam: Floats) -> Found | None:
    """The solution of the system of the sets near the multipliers `lam`; None if their system is singular."""
    with suppress(LinAlgError):
        return on_sets(program, law, sets, response, lam)
    with suppress(LinAlgError):
        once = without_redundant_rows(program.operators, sets, lam, law.weights)
        return replace(on_sets(program, law, once, response, lam), sets=sets)
    return None


def _sets(
    program: StepProgram, law: PressureLaw, at: Iterate, shift: Shifts, w: Floats | None = None
) -> tuple[Sets, Piece]:
    """The sets at a point, and the piece of the law there."""
    pressed = np.maximum(at.p + shift.limits * (program.excess(at.d) - program.operators.compliance * at.p), 0.0)
    piece = law.piece(pressed)
    w = piece.weights if w is None else w
    sets = sets_at(replace(program, w=w), at, shift)
    # A weight of nothing holds nothing: as a row that sticks it may double another one, at a corner.
    return replace(sets, stick=sets.stick & (w > 0)), piece
