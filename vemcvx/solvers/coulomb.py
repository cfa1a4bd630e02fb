"""Coulomb's law solved whole: weights that follow the forces of the limits, on sets that are proven right.

With weights w(p) a step is a *quasi*-variational inequality, which no energy minimises: find d, lam, p with

    K d = g - B'lam - D'p,      |lam_i| <= w_i(p),   lam_i . s_i = w_i(p) |s_i|,         s = B d - b
                                p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0    z = D d - e       (Q)

On given sets, and with w(p) = w_0 + J (p - p_0) near p_0, (Q) is one linear system, not symmetric because of J:

    s_i = 0  on sticking terms,           lam_i = q_i w_i(p) + h_i (I - q_i q_i') s_i  on slipping ones,
    z_j = c_j p_j  on acting limits,      p_j = 0  on the others.

All unknowns but the multipliers are eliminated: with A = [B; D], x = [lam; p] and W = A K^{-1} A', slips and excesses
are A K^{-1} g - W x - [b; e]. Where K has a kernel, K = K_r - R' diag(a) R with the stiffness a of the anchors R d, and
R joins A as limits of compliance -1/a that always act: a body that nothing else holds costs what any other does. The
unknowns y that sets leave open are the multipliers of sticking terms, the parts of slipping ones across q_i, and the
forces of acting limits. With these in their places, Z y, and the increase of slipping terms along q_i, F x = x + q J p,

    (Z'W F Z + C) y = Z' (A K^{-1} g - [b; e]) - Z'W F x_known,     C: compliances, 1 / h_i across q_i, else 0,

symmetric and semidefinite but for F. A term that slips in blocks of two leaves one unknown, a limit that is off none.

The sets are those of the last answer, as in :mod:`vemcvx.solvers.newton`: a semismooth Newton method on (Q) (Alart and
Curnier 1991; Hueber, Stadler and Wohlmuth 2008); those of discs are sought by projected gradients first, which cost a
product with W each. It may cycle, and is then begun anew from answers of convex programs with weights held fast
(:mod:`vemcvx.stepping.fixed_point`).

Theorem 1. Let the terms be absolute values (block 1). If the solution of the system of some sets
has |lam_i| <= w_i(p) where it sticks, q_i s_i >= 0 where it slips, p_j >= 0 where limits act, z_j <= 0 where they do
not, and w at p is the affine one of the system, then it solves (Q). Proof. Every line of (Q) is an equation of the
system or one of these inequalities.  QED  Where rows follow from one another, at corners, the system is singular and
what each carries is chosen (:mod:`vemcvx.solvers.newton`); that s_i = 0 nevertheless is looked at afterwards.

Any other d is thus at a known distance from *a* solution: |d - d_sets|_K, plus the error of d_sets, the last correction
of its iterative refinement. (Where coefficients are not small there may be more solutions than one.)

In blocks of two and more the directions of slip turn with the answer, and the step is no linear system. Let x_0 =
(lam, p) solve the system M x = r of some sets, linearised with directions q_i and curvatures h_i on slipping terms. The
residual of the law on these terms is

    psi_i(s, p) = w_i(p) s_i / |s_i| - q_i (w(p_0) + J (p - p_0))_i - h_i (I - q_i q_i') s_i,

and (Q) on the sets is x = x_0 + G psi(s, p), with G the columns of M^{-1} for the rows of these terms. At x_0 let
v_i = |s_i|, u_i = s_i / v_i, delta_i = |u_i - q_i|; let A_ij, C_ij and P_ji be the norms of the blocks by which s_i
along u_i, s_i across it and p_j answer psi_j. For bounds t_j on |psi_j| let

    alpha = A t,    gamma = C t,    pi = P t,    turn_i = gamma_i / (v_i - alpha_i),
    L_i = |w_i / v_i - h_i| gamma_i + w_i turn_i ((alpha_i + gamma_i) / v_i + turn_i / 2)
          + h_i delta_i (alpha_i + gamma_i) + (|J| pi)_i (delta_i + turn_i).

Theorem 2. If for some t >= 0: alpha_i < v_i and |psi_i(s_0, p_0)| + L_i <= t_i, w is affine on |p - p_0| <= pi, and the
inequalities of the sets hold at x_0 + G psi for all |psi| <= t, then (Q) has a solution d with |d - d_0|_K <=
sum_j n_j t_j, n_j the largest energy norm of an answer to a unit psi_j.

Proof. Let s_i move by a along u_i and by c across it, |a| <= alpha_i, |c| <= gamma_i. Its angle with u_i is at most
arctan turn_i, and its direction is c / |s_i| across u_i and at least 1 - turn_i^2 / 2 along it, where c / |s_i| differs
from c / v_i by at most turn_i (alpha_i + gamma_i) / v_i. From w_i times that psi_i takes h_i times (I - q q')(a u + c),
which differs from c by at most delta_i (alpha_i + gamma_i), as |uu' - qq'| <= |u - q|. With what w adds along u - q,
psi changes by at most L. So (s, p) -> what x_0 + G psi(s, p) has for them is continuous and maps this convex compact
set into itself: Brouwer gives a fixed point, and x_0 + G psi there solves (Q).  QED  Rounding is that of x_0 and of the
inequalities; no coefficient need be small.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, lapack

from vemcvx.arrays import EPS, Bools, Floats, Ints
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.newton import Iterate, Sets, Shifts, sets_at, without_redundant_rows
from vemcvx.weight_law import Piece, PressureLaw


class Response:
    """A K^{-1} A' for the rows A = [B; D; R] of operators, and its parts: (N, N) with N = m * block + r + anchors."""

    def __init__(self, operators: Operators):
        n = operators.B.shape[1]
        anchor = np.zeros(n) if operators.anchor is None else operators.anchor
        anchored = np.flatnonzero(anchor)
        self.anchored = np.ones(len(anchored), dtype=bool)
        """one True an anchor: they always act"""
        R = sp.csr_matrix((np.ones(len(anchored)), (np.arange(len(anchored)), anchored)), shape=(len(anchored), n))
        self.operators, self.A = operators, sp.csr_matrix(sp.vstack([operators.B, operators.D, R]))
        self.compliance = np.zeros(self.A.shape[0])
        self.norms = slice(0, operators.B.shape[0])
        self.limits = slice(operators.B.shape[0], operators.B.shape[0] + operators.D.shape[0])
        self.compliance[self.limits] = operators.compliance
        self.compliance[self.limits.stop :] = -1.0 / anchor[anchored]
        self.matrix = self.A @ operators.factor.solve(self.A.T.toarray())
        self.absolute, self._transposed = abs(self.A), sp.csr_matrix(self.A.T)

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self._transposed @ x


SOLVED = 1e-6
"""Part of the answer above which a correction shows a nearly singular system, whose sets leave a motion free."""
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
        pressed = np.where(sets.act, point.p >= -self.forces, z <= blur[1])
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
    """Solve the system of the sets, with two corrections by its residual."""
    operators = program.operators
    system = SetsSystem(operators, sets, law.slope, response)
    d, x = np.zeros(len(program.g)), np.zeros(len(response.compliance))
    norms, limits = response.norms, response.limits
    stick, act = np.repeat(sets.stick, operators.block), sets.act
    step, error = d, np.inf
    for _ in range(3):
        lam, p = operators.blocks(x[norms]), x[limits]
        bound = sets.direction * (law.weights + law.slope @ (p - law.forces))[:, None] + _bend(sets, program.slip(d))
        slip = operators.rows.read(d) - program.b
        wanted = np.zeros_like(x)
        wanted[norms] = np.where(stick, -slip, (bound - lam).ravel())
        if len(sets.idle):
            wanted[norms][sets.idle] = sets.shares @ (near - lam).ravel()
        wanted[limits] = np.where(act, operators.compliance * p - program.excess(d), -p)
        step, more = system.solve(program.residual(d, lam, p), wanted)
        d, x = d + step, x + more
        error = operators.energy_norm(step)
    size, last = np.abs(x[: limits.stop]), np.abs(more[: limits.stop]).max(initial=0.0)
    force, free = np.abs(program.g).max(initial=0.0), program.g @ operators.factor.solve(program.g)
    # Multipliers of anchors are no forces of the step: they are proportional to any error of a rigid motion.
    held = x[: limits.stop]
    norm = np.sqrt(abs(free)) + np.sqrt(abs(held @ response.matrix[: limits.stop, : limits.stop] @ held))
    solved = last <= SOLVED * max(force, size.max(initial=0.0)) and error <= SOLVED * norm
    reach, off = (response.absolute @ np.abs(d))[: limits.stop], (response.A @ step)[: limits.stop]
    # Sets that leave a rigid motion free put the body anywhere along it; the work of multipliers on it shows that.
    solved = solved and size @ np.abs(off) <= SOLVED * norm**2
    if not solved or not _balances(program, operators.blocks(x[norms]), x[limits]):
        raise LinAlgError("singular")
    forces = 8 * last + ROUNDINGS * EPS * size.max(initial=0.0)
    motions = 8 * np.abs(off) + ROUNDINGS * EPS * (reach + np.abs(np.concatenate([program.b, program.e])))
    return Found(
        sets=sets,
        point=Iterate(d, operators.blocks(x[norms]), x[limits]),
        error=error,
        forces=forces,
        motions=motions,
        system=system,
    )


def _bend(sets: Sets, s: Floats) -> Floats:
    """h (I - q q') s, of vectors (m, block)."""
    along = np.einsum("ij,ij->i", sets.direction, s)
    bent: Floats = sets.curvature[:, None] * (s - sets.direction * along[:, None])
    return bent


class SetsSystem:
    """The system of some sets, reduced to the multipliers y that they leave open, and factorised.

    Raises
    ------
    LinAlgError
        It is singular: the sets hold nothing.
    """

    def __init__(self, operators: Operators, sets: Sets, J: sp.csr_matrix, response: Response):
        self._operators, self._response, self._J, self._q = operators, response, J, sets.direction
        self._stick = np.flatnonzero(np.repeat(sets.stick, operators.block))
        self._bent = np.flatnonzero(sets.curvature > 0)
        self._tangents = across(sets.direction[self._bent])
        self._press = response.limits.start + np.flatnonzero(np.append(sets.act, response.anchored))
        self._off = response.limits.start + np.flatnonzero(~sets.act)
        bends = np.repeat(1.0 / sets.curvature[self._bent], operators.block - 1)
        self._C = np.concatenate([np.zeros(len(self._stick)), bends, response.compliance[self._press]])
        self._seen = self._read(response.matrix)
        M = self._read(self._seen.T)
        M[np.diag_indices_from(M)] += self._C
        # Transposed: what acts pulls, through its share of weights, along the directions of terms that slip.
        acting = slice(len(M) - len(self._press), len(M) - len(response.anchored))
        M[acting] += (J.T @ np.einsum("mb,mbk->mk", self._q, self._blocks(self._seen.T)))[sets.act]
        self._idle = np.searchsorted(self._stick, sets.idle)
        if len(self._idle):
            M[:, self._idle] = 0.0
            M[: len(self._stick), self._idle] = sets.shares[:, self._stick].T
        lu: tuple[Any, Any, int] = lapack.dgetrf(M.T, overwrite_a=1) if len(M) else (M, M, 0)
        self._lu, self._pivots, info = lu
        if info > 0 or not np.isfinite(self._lu).all():
            raise LinAlgError("singular")

    def solve(self, force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """(d, x) with K d = force - A'x, where the equation of every row misses by `wanted` (N,)."""
        factor, known = self._operators.factor, wanted.copy()
        slip = self._response.A @ factor.solve(force)
        for met in (self._stick, self._press):
            known[met], slip[met] = 0.0, slip[met] - wanted[met]
        known = self._pulled(known[:, None])
        rest = self._read(slip[:, None]) - self._seen @ known
        rest[self._idle, 0] = wanted[self._stick[self._idle]]
        x = (known + self._placed(self._opened(rest)))[:, 0]
        return factor.solve(force - self._response.act(x)), x

    def answers(self, rows: Ints) -> tuple[Floats, Floats]:
        """Multipliers (N, k), and W times these, that answer multipliers of one on each of k rows that slip."""
        rest = -self._seen[:, rows]
        rest[self._idle] = 0.0
        y = self._opened(rest)
        x = self._placed(y)
        x[rows, np.arange(len(rows))] += 1.0
        W, moved, gives, q = self._response.matrix, np.zeros_like(x), self._C[:, None] * y, self._q[self._bent]
        along = np.einsum("kb,kbn->kn", q, self._blocks(W)[self._bent]) @ x
        self._blocks(moved)[self._bent] = q[:, :, None] * along[:, None] - self._turned(gives)
        moved[self._press] = -gives[len(y) - len(self._press) :]
        moved[self._off] = W[self._off] @ x
        return x, moved

    def _opened(self, rest: Floats) -> Floats:
        """The open multipliers y (open, k) with (Z'W F Z + C) y = rest."""
        return np.asarray(lapack.dgetrs(self._lu, self._pivots, rest)[0]) if len(rest) else rest

    def _placed(self, y: Floats) -> Floats:
        """F Z y (N, k)."""
        x = np.zeros((len(self._response.compliance), y.shape[1]))
        x[self._stick], x[self._press] = y[: len(self._stick)], y[len(y) - len(self._press) :]
        self._blocks(x)[self._bent] = self._turned(y)
        return self._pulled(x)

    def _blocks(self, x: Floats) -> Floats:
        """View the rows of norm terms of (N, k) as (m, block, k)."""
        return x[self._response.norms].reshape(*self._q.shape, x.shape[1])

    def _read(self, x: Floats) -> Floats:
        """Z'x of (N, k)."""
        bent = np.matmul(self._tangents, self._blocks(x)[self._bent])
        return np.concatenate([x[self._stick], bent.reshape(self._tangents[..., 0].size, x.shape[1]), x[self._press]])

    def _turned(self, y: Floats) -> Floats:
        """The part of Z y (terms, block, k) that is across the directions of terms that slip."""
        bent = y[len(self._stick) : len(y) - len(self._press)].reshape(*self._tangents.shape[:2], y.shape[1])
        return np.asarray(np.matmul(self._tangents.swapaxes(1, 2), bent))

    def _pulled(self, x: Floats) -> Floats:
        """F x (N, k): terms that slip carry, along their directions, what their weights gain from x."""
        x = x.copy()
        self._blocks(x)[...] += self._q[:, :, None] * (self._J @ x[self._response.limits])[:, None]
        return x


def across(q: Floats) -> Floats:
    """(k, block - 1, block) orthonormal vectors across unit vectors q (k, block): Householder's reflection of q."""
    v = q + np.where(q[:, :1] < 0, -1.0, 1.0) * np.eye(1, q.shape[1])
    v = v / np.sqrt(np.einsum("ij,ij->i", v, v))[:, None]
    reflection = np.eye(q.shape[1]) - 2.0 * v[:, :, None] * v[:, None, :]
    return np.asarray(reflection[:, 1:])


@dataclass(frozen=True)
class _Answers:
    """Bounds, as norms of blocks, on how slips, multipliers and energy respond to psi on the k terms that slip."""

    slips: Floats
    """(m, k)"""
    along: Floats
    """(k, k), A"""
    across: Floats
    """(k, k), C"""
    multipliers: Floats
    """(m, k)"""
    forces: Floats
    """(r, k), P"""
    excess: Floats
    """(r, k)"""
    energy: Floats
    """(k,), n"""

    @staticmethod
    def of(found: Found, response: Response, slides: Bools, u: Floats) -> _Answers:
        """The answers to psi on the terms `slides` (m,), of directions u (k, block)."""
        block = u.shape[1]
        rows = np.flatnonzero(np.repeat(slides, block))
        G, moved = found.system.answers(rows)
        norms, limits = response.norms, response.limits
        energy = np.einsum("ij,ij->j", G, moved).reshape(-1, block).sum(axis=1)
        own = moved[rows].reshape(len(u), block, -1)
        along = np.einsum("ib,ibj->ij", u, own)
        across = (own - u[:, :, None] * along[:, None]).reshape(len(rows), -1)
        return _Answers(
            slips=_blocks(moved[norms], block),
            along=np.linalg.norm(along.reshape(len(u), -1, block), axis=2),
            across=_blocks(across, block),
            multipliers=_blocks(G[norms], block),
            forces=np.linalg.norm(G[limits].reshape(len(G[limits]), -1, block), axis=2),
            excess=np.linalg.norm(moved[limits].reshape(len(G[limits]), -1, block), axis=2),
            energy=np.sqrt(np.maximum(energy, 0.0)),
        )


def _blocks(matrix: Floats, block: int) -> Floats:
    """(m, k) Frobenius norms of blocks, which are no smaller than their spectral ones."""
    rows, columns = (n // block for n in matrix.shape)
    return np.asarray(np.linalg.norm(matrix.reshape(rows, block, columns, block), axis=(1, 3)))


def distance_to_a_solution(
    program: StepProgram, law: PressureLaw, sets: Sets, found: Found, response: Response
) -> float | None:
    """A bound on |d - d*|_K to a solution d* of (Q), from what the sets miss of it; None if there is no proof."""
    p, s = np.where(found.sets.act, np.maximum(found.point.p, 0.0), 0.0), program.slip(found.point.d)
    w, J, v = law.weights(p), law.slope(p), np.linalg.norm(s, axis=1)
    blur = found.motions.max(initial=0.0)
    # What slips by no more than rounding is held by others, wherever lam_i points.
    slides, held = ~sets.stick & (w > 0) & (v > blur), ~sets.stick & (w > 0) & (v <= blur)
    if not slides.any():
        return 0.0 if found.holds(program, law, sets) else None
    u, q, h = s[slides] / v[slides, None], sets.direction[slides], sets.curvature[slides]
    answers = _Answers.of(found, response, slides, u)
    W, v, steep = w[slides], v[slides], abs(J)[slides]
    missed = np.linalg.norm(found.point.lam[slides] - W[:, None] * u, axis=1) + found.forces + W * blur / v
    delta, off = np.linalg.norm(u - q, axis=1), np.abs(W / v - h)
    t = 2.0 * missed
    for _ in range(8):  # Each t is twice what the one before leads to: where psi changes little, the first does.
        alpha, gamma, pi = answers.along @ t, answers.across @ t, answers.forces @ t
        if (alpha >= v).any():
            return None
        turn, far = gamma / (v - alpha), alpha + gamma
        changed = off * gamma + W * turn * (far / v + turn / 2) + h * delta * far + (steep @ pi) * (delta + turn)
        if (missed + changed <= t).all():
            moved = (answers.slips[held] @ t).max(initial=0.0)
            proven = moved <= blur and _hold(program, law, sets, found, (answers, t))
            return float(answers.energy @ t) if proven else None
        t = 2.0 * np.maximum(t, missed + changed)
    return None


def _hold(program: StepProgram, law: PressureLaw, sets: Sets, found: Found, ball: tuple[_Answers, Floats]) -> bool:
    """True if the sets' inequalities hold, to rounding, wherever psi is at most t, and the law is affine there."""
    answers, t = ball
    act, pressure, pi = found.sets.act, found.point.p, answers.forces @ t
    pi[~act] = 0.0
    p, z = np.where(act, np.maximum(pressure, 0.0), 0.0), program.excess(found.point.d) + answers.excess @ t
    low, high = (law.slope(np.maximum(p + sign * pi, 0.0)) for sign in (-1.0, 1.0))
    w, J = law.weights(p), law.slope(p)
    affine = abs(low - J).sum() == 0 and abs(high - J).sum() == 0
    size = np.linalg.norm(found.point.lam, axis=1) + answers.multipliers @ t
    within = ~sets.stick | (size <= w - abs(J) @ pi + found.forces)
    # What others hold does not answer at all, but for the rounding of the answers.
    blur = found.motions[program.b.size :] + ROUNDINGS * EPS * (answers.excess.max(axis=0, initial=0.0) @ t)
    pressed = np.where(sets.act, pressure - pi >= -found.forces, z <= blur)
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
    near = start if program.operators.block == 1 or len(response.anchored) else swept(program, law, start, response)
    met = _from_sets(program, law, near, response, rounds)
    met = met or _from_sets(program, law, start=start, response=response, rounds=rounds, w=program.w)
    met = met or _by_softer_laws(program, law, start, response, rounds)
    if met is None:
        return None
    (sets, found), point = met, met.point(program, law)
    away = distance_to_a_solution(program, law, sets, found, response) if program.operators.block > 1 else 0.0
    return SetsSolution(point, law.weights(point.p), found.error + (away or 0.0), away is not None)


SWEEPS = 100
"""Projected gradients before the first sets of discs. Of 420 discs that press on a plane eight steps took 74 systems
without, 50 after 30 of them, 31 after 100; a system costs as much as 80."""


def swept(program: StepProgram, law: PressureLaw, start: Iterate, response: Response) -> Iterate:
    """A point near a solution of (Q): projected gradients with momentum, on the multipliers x = (lam, p).

    x becomes the projection of y + r (A K^{-1} g - [b; e] - (W + c) y) on discs of the radius w(p) and on p >= 0, y
    being ahead of x (Nesterov 1983), and x itself where that led back (O'Donoghue and Candes 2015). By Gershgorin's
    theorem diag(1 / r) - W - c is semidefinite for 1 / r_i = c_i + sum_j |W_ij|, the largest of each disc.
    """
    operators, some = program.operators, slice(response.limits.stop)
    W, c = response.matrix[some, some], response.compliance[some]
    most = c + np.abs(W).sum(axis=1)
    most[response.norms] = np.repeat(operators.blocks(most[response.norms]).max(axis=1), operators.block)
    step = 1.0 / np.where(most > 0, most, 1.0)
    free = response.A[some] @ operators.factor.solve(program.g) - np.concatenate([program.b, program.e])
    x = y = np.concatenate([start.lam.ravel(), start.p])
    momentum = 1.0
    for _ in range(SWEEPS):
        new = y + step * (free - W @ y - c * y)
        p = np.maximum(new[response.limits], 0.0)
        lam = replace(program, w=law.weights(p)).project(operators.blocks(new[response.norms]))
        last, x = x, np.concatenate([lam.ravel(), p])
        if (y - x) * most @ (x - last) > 0:
            momentum = 1.0
        ahead = 0.5 + np.sqrt(0.25 + momentum**2)
        y, momentum = x + (momentum - 1.0) / ahead * (x - last), ahead
    force = program.g - response.act(np.append(x, np.zeros(len(response.anchored))))
    return Iterate(operators.factor.solve(force), lam, p)


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
