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

In blocks of two and more the directions of slip turn with the answer, and the step is no linear system. Let d_0, x_0 =
(lam, p) solve the system of some sets, linearised with directions q_i and curvatures h_i on slipping terms. The
residual of the law on these terms is

    psi_i(s, p) = w_i(p) s_i / |s_i| - q_i (w(p_0) + J (p - p_0))_i - h_i (I - q_i q_i') s_i,

and (Q) on the sets is their system with psi_i(s, p) added to lam_i. The answers to |psi_i| <= t_i along q_i and <= r_i
across it move d_0 by at most E in energy, slips by at most alpha_i along q_i and gamma_i across it, and forces of
limits by at most pi_j (:meth:`vemcvx.solvers.sets_system.SetsSystem.answers`). With v_i = |s_i|, u_i = s_i / v_i at d_0
and delta_i = |u_i - q_i| let

    turn_i = (gamma_i + delta_i alpha_i) / (v_i - alpha_i - gamma_i),
    R_i = w_i ((turn_i + delta_i) (alpha_i + gamma_i) / v_i + turn_i^2 / 2) + (|J| pi)_i (delta_i + turn_i).

Theorem 2. Let t, r >= 0 be such that alpha_i + gamma_i < v_i on slipping terms, |psi_i(s_0, p_0) . q_i| + R_i <= t_i,
and what psi_i(s_0, p_0) has across q_i, with R_i and |w_i / v_i - h_i| gamma_i added, is at most r_i. If w is affine on
|p - p_0| <= pi, and the inequalities of the sets hold for all answers to such psi, then (Q) has a solution d with |d -
d_0|_K <= E.

Proof. Let s_i move by a q_i + g, |a| <= alpha_i and |g| <= gamma_i, g across q_i. Of a q_i the part delta_i |a| is
across u_i, so that the direction of s_i turns by at most turn_i. It moves across u_i by (what a q_i + g has across u_i)
/ |s_i|; this and g / v_i differ by at most (turn_i + delta_i) (alpha_i + gamma_i) / v_i. Along u_i it moves by at most
turn_i^2 / 2. Of w_i g / v_i psi_i keeps (w_i / v_i - h_i) g, across q_i. The change of w counts along s_i / |s_i| -
q_i, which is at most delta_i + turn_i. So (s, p) -> what the answer to psi(s, p) has for them is continuous and maps
this convex compact set into itself: Brouwer gives a fixed point, which solves (Q). QED Rounding is that of d_0 and of
the inequalities; rows of which what is held leaves less than FOLLOWS count as held. No coefficient need be small.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError
from scipy.linalg.blas import dsymv

from vemcvx.arrays import EPS, Floats, lengths
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.newton import Iterate, Sets, Shifts, most_curved, sets_at, without_redundant_rows
from vemcvx.solvers.sets_system import Answers, Response, SetsSystem
from vemcvx.weight_law import Piece, PressureLaw

SOLVED = 1e-6
"""Part of the answer above which a correction shows a nearly singular system, whose sets leave a motion free."""
SETTLED = 1e-12
"""Part of the answer below which a correction is the last."""
ROUNDINGS = 64.0
"""Rounding units by which an inequality may fail."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """The solution of the system of some sets, its last correction, and the rounding of its rows."""

    sets: Sets
    point: Iterate
    error: float
    forces: float
    """what multipliers may be off by"""
    motions: Floats
    """(m * block + r,) what s and z may be off by"""
    system: SetsSystem

    def holds(self, program: StepProgram, law: PressureLaw, sets: Sets) -> bool:
        """Return True if the inequalities that the sets stand for hold, to rounding."""
        point, operators = self.point, program.operators
        if not np.isfinite(self.error):
            return False
        w, size = law.weights(np.maximum(point.p, 0.0)), np.linalg.norm(point.lam, axis=1)
        s, z = program.slip(point.d), program.excess(point.d)
        blur = operators.blocks(self.motions[: s.size]).max(axis=1), self.motions[s.size :]
        slips = np.linalg.norm(s, axis=1)
        within = np.where(sets.stick, size <= w + self.forces, np.abs(size - w) <= self.forces)
        turned = np.linalg.norm(slips[:, None] * point.lam - size[:, None] * s, axis=1)
        forth = sets.stick | (turned <= 2 * (self.forces * slips + size * blur[0]))
        # Bounds that follow from others may have been dropped from the system, and must hold nevertheless.
        pressed = np.where(self.sets.act, point.p >= -self.forces, z <= blur[1])
        # Where rows follow from others', what sticks is held by these.
        still = ~sets.stick | (slips <= self.motions.max(initial=0.0))
        return bool(within.all() and forth.all() and pressed.all() and still.all())

    def next_point(self, program: StepProgram, law: PressureLaw, sets: Sets) -> Iterate:
        """The point to take the next sets at, where others decide what discs do that share their nodes, at edges.

        A disc that sticks, but is moved by others, is made to slip that way: one that slides along another face until
        it meets its own moves by the remaining gap there. A disc that slips, but is held by others, is made to slip
        again: two of them that together are too weak would stick in turns.
        """
        point, s = self.point, program.slip(self.point.d)
        if program.operators.block == 1:
            return point
        size, w, blur = np.linalg.norm(s, axis=1), law.weights(np.maximum(point.p, 0.0)), self.motions.max(initial=0.0)
        moved, held = sets.stick & (size > blur), ~sets.stick & (size <= blur)
        lam = np.where(held[:, None], (1.0 + ROUNDINGS * EPS) * point.lam, point.lam)
        lam[moved] = (w[moved] / size[moved])[:, None] * s[moved]
        return replace(point, lam=lam)


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
    """Solve the system of the sets, corrected by its residual until that is rounding, twice at most."""
    operators, norms, limits = program.operators, response.norms, response.limits
    system = SetsSystem(operators, sets, law.slope, response)
    d, x = np.zeros(len(program.g)), np.zeros(response.A.shape[0])
    free = np.sqrt(operators.factor.energy(program.g))
    for turn in range(3):
        point = Iterate(d, operators.blocks(x[norms]), x[limits])
        bound = sets.direction * (law.weights + law.slope @ (point.p - law.forces))[:, None]
        bound += sets.bent(program.slip(d))
        step, more = system.solve(program.residual(*_parts(point)), _missing(program, sets, point, bound, near))
        d, x, error = d + step, x + more, operators.energy_norm(step)
        norm = free + np.sqrt(operators.factor.energy(response.act(x)))
        if turn and error <= SETTLED * norm:
            break
    size, last = np.abs(x), np.abs(more).max(initial=0.0)
    solved = last <= SOLVED * max(np.abs(program.g).max(initial=0.0), size.max(initial=0.0)) and error <= SOLVED * norm
    reach, off = response.sizes @ np.abs(d[response.read]), response.rows @ step[response.read]
    # Sets that leave a rigid motion free put the body anywhere along it; the work of multipliers on it shows that.
    solved = solved and size @ np.abs(off) <= SOLVED * norm**2
    point = Iterate(d, operators.blocks(x[norms]), x[limits])
    if not solved or not _balances(program, point.lam, point.p):
        raise LinAlgError("singular")
    return Found(
        sets=sets,
        point=point,
        error=error,
        forces=8 * last + ROUNDINGS * EPS * size.max(initial=0.0),
        motions=8 * np.abs(off) + ROUNDINGS * EPS * (reach + np.abs(np.concatenate([program.b, program.e]))),
        system=system,
    )


def _parts(point: Iterate) -> tuple[Floats, Floats, Floats]:
    return point.d, point.lam, point.p


def _missing(program: StepProgram, sets: Sets, at: Iterate, bound: Floats, near: Floats) -> Floats:
    """(N,) what a point misses of the equations of the sets, slipping terms having the multipliers `bound`."""
    stick = sets.stick[:, None]
    norms = np.where(stick, -program.slip(at.d), bound - at.lam).ravel()
    if len(sets.idle):
        norms[sets.idle] = sets.shares @ (near - at.lam).ravel()
    compliance = program.operators.compliance
    return np.concatenate([norms, np.where(sets.act, compliance * at.p - program.excess(at.d), -at.p)])


TURNS = 12
"""Corrections on one factor while the directions of slip turn; each leaves less than half."""


def turned(program: StepProgram, law: Piece, found: Found, near: Floats) -> Found:
    """The point corrected, on the same factor, by what it misses of the law itself, while that halves."""
    sets, point, least = found.sets, found.point, np.inf
    for _ in range(TURNS):
        w, s = law.at(point.p), program.slip(point.d)
        v = lengths(s)
        slides = ~sets.stick & (v > found.motions.max(initial=0.0))
        bound = np.where(slides[:, None], (w / np.where(slides, v, 1.0))[:, None] * s, point.lam)
        missed = np.abs(bound - point.lam)[slides].max(initial=0.0)
        if missed <= found.forces or missed > 0.5 * least:
            break
        least, wanted = missed, _missing(program, sets, point, bound, near)
        step, more = found.system.solve(program.residual(*_parts(point)), wanted)
        lam = point.lam + program.operators.blocks(more[: s.size])
        point = Iterate(point.d + step, lam, point.p + more[s.size :])
    return replace(found, point=point)


def distance_to_a_solution(
    program: StepProgram, law: PressureLaw, sets: Sets, found: Found, response: Response
) -> float | None:
    """A bound on |d - d*|_K to a solution d* of (Q), by theorem 2; None if there is no proof."""
    point, act = found.point, found.sets.act
    p, s = np.where(act, np.maximum(point.p, 0.0), 0.0), program.slip(point.d)
    w, J, v, blur = law.weights(p), law.slope(p), lengths(s), found.motions.max(initial=0.0)
    # What slips by no more than rounding is held by others, wherever lam_i points.
    slides, held = ~sets.stick & (w > 0) & (v > blur), ~sets.stick & (w > 0) & (v <= blur)
    if not slides.any():
        return 0.0 if found.holds(program, law, sets) else None
    v = np.where(slides, v, 1.0)
    u, h = s / v[:, None], np.minimum(w / v, most_curved(program))
    own = replace(
        found.sets,
        direction=np.where(slides[:, None], u, sets.direction),
        curvature=np.where(slides, h, sets.curvature),
    )
    with suppress(LinAlgError):
        system = SetsSystem(program.operators, own, J, response)
        missed = point.lam - w[:, None] * u
        along = np.einsum("ij,ij->i", missed, u)
        first = np.stack([np.abs(along), lengths(missed - along[:, None] * u)])
        first = (first + found.forces + w * np.stack([(blur / v) ** 2, blur / v])) * slides
        t = 2.0 * first
        for _ in range(8):  # Twice what the last bounds lead to: where psi changes little, the first do.
            answers = system.answers(*t)
            alpha, gamma = answers.along * slides, answers.across * slides
            if not (alpha + gamma < v).all():
                return None
            turn = gamma / (v - alpha - gamma)
            common = turn * (w * ((alpha + gamma) / v + turn / 2) + abs(J) @ answers.forces)
            led = first + np.stack([common, common + (w / v - h) * gamma]) * slides
            if (led <= t).all():
                proven = (answers.along[held] <= blur).all() and _hold(program, law, sets, found, answers)
                return answers.energy if proven else None
            t = np.maximum(t, 2.0 * led)
    return None


def _hold(program: StepProgram, law: PressureLaw, sets: Sets, found: Found, answers: Answers) -> bool:
    """True if the sets' inequalities hold, to rounding, whatever psi is answered, and the law is affine there."""
    act, pressure, pi = found.sets.act, found.point.p, np.where(found.sets.act, answers.forces, 0.0)
    p, z = np.where(act, np.maximum(pressure, 0.0), 0.0), program.excess(found.point.d) + answers.excess
    w, J = law.weights(p), law.slope(p)
    corners = [np.maximum(p + sign * pi, 0.0) - p for sign in (-1.0, 1.0)]
    affine = all(
        abs(law.slope(p + c) - J).sum() == 0 and (np.abs(law.weights(p + c) - w - J @ c) <= found.forces).all()
        for c in corners
    )
    size = np.linalg.norm(found.point.lam, axis=1) + answers.multipliers
    within = ~sets.stick | (size <= w - abs(J) @ pi + found.forces)
    pressed = np.where(act, pressure - pi >= -found.forces, z <= found.motions[program.b.size :])
    silent = sets.stick | (w > 0) | (abs(J) @ pi == 0)
    still = ~sets.stick | (np.linalg.norm(program.slip(found.point.d), axis=1) <= found.motions.max(initial=0.0))
    return bool(affine and within.all() and pressed.all() and silent.all() and still.all())


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

    Parameters
    ----------
    program : StepProgram
        `start` is its answer.
    response : Response
        Of its operators.
    rounds : iterator
        One is taken for the system of every sets; it gives up where there are no more.
    """
    near = start if program.operators.block == 1 or response.anchor.any() else swept(program, law, start, response)
    met = _from_sets(program, law, near, response, rounds)
    met = met or _from_sets(program, law, start=start, response=response, rounds=rounds, w=program.w)
    met = met or _by_softer_laws(program, law, start, response, rounds)
    if met is None:
        return None
    (sets, found), point = met, met.point(program, law)
    away = distance_to_a_solution(program, law, sets, found, response) if program.operators.block > 1 else 0.0
    # Where the point is moved within bounds and into place, that counts.
    error = found.error + program.operators.energy_norm(point.d - found.point.d) + (away or 0.0)
    return SetsSolution(point, law.weights(point.p), error, away is not None)


SWEEPS = 50
"""Projected gradients before the first sets of discs. Of 420 discs that press on a plane eight steps took 74 systems
without, 50 after 30 of them, 31 after 100; a system costs as much as 80."""


def swept(program: StepProgram, law: PressureLaw, start: Iterate, response: Response) -> Iterate:
    """A point near a solution of (Q): projected gradients with momentum, on the multipliers x = (lam, p).

    x becomes the projection of y + r (A K^{-1} g - [b; e] - (W + C) y) on discs of the radius w(p) and on p >= 0, y
    being ahead of x (Nesterov 1983), and x itself where that led back (O'Donoghue and Candes 2015); r is
    :attr:`Response.step`.
    """
    operators, norms, limits, step = program.operators, response.norms, response.limits, response.step
    free, piece = operators.factor.solve(program.g), law.piece(start.p)
    apart = np.concatenate([program.slip(free).ravel(), program.excess(free)])
    x = y = np.concatenate([start.lam.ravel(), start.p])
    momentum = 1.0
    for _ in range(SWEEPS):
        last, x = x, y + step * (apart - dsymv(1.0, response.softness, y))
        np.maximum(x[limits], 0.0, out=x[limits])
        w, size = piece.at(x[limits]), lengths(operators.blocks(x[norms]))
        share = np.divide(w, size, out=np.ones_like(size), where=size > w)
        x[norms] *= np.repeat(share, operators.block)
        if (y - x) / step @ (x - last) > 0:
            momentum = 1.0
        ahead = 0.5 + np.sqrt(0.25 + momentum**2)
        y, momentum = x + (momentum - 1.0) / ahead * (x - last), ahead
    return Iterate(operators.factor.solve(program.g - response.act(x)), operators.blocks(x[norms]), x[limits])


def _by_softer_laws(
    program: StepProgram, law: PressureLaw, start: Iterate, response: Response, rounds: Iterator[int]
) -> _Settled | None:
    """A solution by way of laws that are softened at first."""
    share, point, factor = 1e-6, start, STEEPER
    last: tuple[Iterate, float] | None = None
    while True:
        softer = law if share >= 1.0 else law.scaled(np.ones(len(program.w)), np.full(len(start.p), share))
        met = _from_sets(program, softer, point, response, rounds)
        if met is not None and share >= 1.0:
            return met
        if met is not None:
            last = met.point(program, softer), share
        elif last is None or program.operators.block == 1 or factor < 1.7:
            return None
        else:
            factor = factor**0.5  # Where a steeper law of discs does not settle, one less steep is tried.
        point, share = replace(last[0], p=last[0].p / factor), last[1] * factor


class _Settled(NamedTuple):
    """Sets whose inequalities hold, and what their system led to."""

    sets: Sets
    found: Found

    def point(self, program: StepProgram, law: PressureLaw) -> Iterate:
        """The point, admissible."""
        at, p = self.found.point, np.maximum(self.found.point.p, 0.0)
        d = program.feasible(_stuck_in_place(program, self.sets, at.d))
        return Iterate(d, replace(program, w=law.weights(p)).project(at.lam), p)


def _from_sets(
    program: StepProgram,
    law: PressureLaw,
    start: Iterate,
    response: Response,
    rounds: Iterator[int],
    w: Floats | None = None,
) -> _Settled | None:
    """A solution from the sets at `start`, beside weights `w` (m,) if given.

    Absolute values settle in fewer than ten rounds, or come back to sets that they have left and cycle for ever;
    directions of discs turn for longer, and may come back six times.
    """
    shift, point = Shifts.of(program.operators), start
    turns = program.operators.block > 1
    met: list[bytes] = []
    returns = 0
    for _ in islice(rounds, 40 if turns else 25):
        sets, piece = _sets(program, law, point, shift, None if met else w)
        # The same terms may stick and press on another piece of the law: on its slope, and then on its level.
        parts = sets.stick, sets.act, piece.slope.data, piece.slope.indices, piece.slope.indptr
        mark = b"".join(part.tobytes() for part in (parts if turns else (*parts, sets.direction)))
        returns += mark in met and not (turns and mark == met[-1])
        if returns > (6 if turns else 0):
            return None
        met.append(mark)
        found = _tried(program, piece, sets, response, point.lam)
        if found is None:
            return None
        if turns:
            found = turned(program, piece, found, point.lam)
        if found.holds(program, law, sets):
            return _Settled(sets, found)
        point = found.next_point(program, law, sets)
    return None


def _tried(program: StepProgram, law: Piece, sets: Sets, response: Response, lam: Floats) -> Found | None:
    """The solution of the system of the sets near the multipliers `lam`; None if their system is singular."""
    with suppress(LinAlgError):
        return on_sets(program, law, sets, response, lam)
    with suppress(LinAlgError):
        once = without_redundant_rows(program.operators, sets, lam, law.weights)
        return on_sets(program, law, once, response, lam)
    return None


def _stuck_in_place(program: StepProgram, sets: Sets, d: Floats) -> Floats:
    """The increments with those that stick where they are, to the last bit: large weights make work of the rest."""
    still = np.flatnonzero(np.repeat(sets.stick, program.operators.block) & program.operators.rows.single)
    entry = program.operators.B.indptr[still]
    d = d.copy()
    d[program.operators.B.indices[entry]] = program.b[still] / program.operators.B.data[entry]
    return d


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
