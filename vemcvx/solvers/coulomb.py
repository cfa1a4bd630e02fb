"""Coulomb's law solved whole: weights that follow the forces of the limits, on sets that are proven right.

With weights w(p) a step is a *quasi*-variational inequality, which no energy minimises: find d, lam, p with

    K d = g - B'lam - D'p,      |lam_i| <= w_i(p),   lam_i . s_i = w_i(p) |s_i|,         s = B d - b
                                p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0    z = D d - e       (Q)

On given sets, and with w(p) = w_0 + J (p - p_0) near p_0, (Q) is one linear system, not symmetric because of J:

    s_i = 0  on sticking terms,           lam_i = q_i w_i(p) + h_i (I - q_i q_i') s_i  on slipping ones,
    z_j = c_j p_j  on acting limits,      p_j = 0  on the others.

The unknowns that no row reads are eliminated once: K stands for what is left of it, with the terms h B'(I - qq')B and
D'D / c of slipping terms and soft limits added. Sticking terms and acting bounds hold d to L'v + Z y, A Z = 0 for their
rows A, and carry L (g - K d - B'lam) with L the inverse of A' on its range. So the forces of limits are p = p_0 + P y,
and only motions y are unknown,

    M y = Z' (g - K L'v - B'(q w(p_0))),        M = Z'KZ + Z'B'q J P,

symmetric but for weights that follow p. Where all sticks y is nothing; a sparse K, a large one or one with a kernel
make no difference. Where rows share nodes, at edges, Z and L come from reflections. Where most limits are open, their
unknowns are eliminated as well.

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

In blocks of two and more the directions of slip turn with the answer, and the step is no linear system. Let d_0, x_0 =
(lam, p) solve the system of some sets, linearised with directions q_i and curvatures h_i on slipping terms. The
residual of the law on these terms is

    psi_i(s, p) = w_i(p) s_i / |s_i| - q_i (w(p_0) + J (p - p_0))_i - h_i (I - q_i q_i') s_i,

and (Q) on the sets is the same system with lam_i + psi_i(s, p) in place of lam_i. Its answer d_0 + d to psi is bounded
in the norm of N = K + h B'(I - qq')B + ..., the stiffness of M: if y'My >= y'Z'NZy / c for all y, then, psi_i being at
most t_i along q_i and r_i across it,

    |d| <= E = c sum_i (phi_i t_i + chi_i r_i),          phi_i^2 >= |B_i K^{-1} B_i'|,   chi_i = min(phi_i, h_i^{-1/2}),

and slips move by at most alpha_i = phi_i E along q_i and gamma_i = chi_i E across it; what reads d - forces of what is
held, excesses of other limits - follows from Schwarz's inequality. Otherwise c = |N^{1/2} M^{-1} N^{1/2}|. With v_i =
|s_i|, u_i = s_i / v_i, delta_i = |u_i - q_i|, pi_j >= |p_j - p_j0| let

    turn_i = (gamma_i + delta_i alpha_i) / (v_i - alpha_i - gamma_i),
    R_i = w_i ((turn_i + delta_i) (alpha_i + gamma_i) / v_i + turn_i^2 / 2) + (|J| pi)_i (delta_i + turn_i).

Theorem 2. If for some t, r >= 0: alpha_i + gamma_i < v_i; psi_i(s_0, p_0) and R_i together are at most t_i along q_i,
and with |w_i / v_i - h_i| gamma_i at most r_i across it; w is affine on |p - p_0| <= pi, and the inequalities of the
sets hold for all such psi, then (Q) has a solution d with |d - d_0|_K <= E.

Proof. Let s_i move by a along q_i and by g across it. Its direction turns by at most turn_i: a has delta_i |a| across
u_i. Across u_i it moves by what of (a, g) is across u_i, over |s_i|, which differs from g / v_i by at most turn_i
(alpha_i + gamma_i) / v_i + delta_i (alpha_i + gamma_i) / v_i; along u_i by at most turn_i^2 / 2. From w_i g / v_i psi
takes h_i g, across q_i. What w adds is along u_i - q_i. So (s, p) -> what the answer to psi(s, p) has for them is
continuous and maps this convex compact set into itself: Brouwer gives a fixed point, which solves (Q). QED Rounding is
that of x_0 and of the inequalities; no coefficient need be small.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, lapack, qr, solve_triangular
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from vemcvx.arrays import EPS, Floats, Ints
from vemcvx.linear import Factor
from vemcvx.program.operators import Operators, restricted, transverse
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.newton import FOLLOWS, Iterate, Sets, Shifts, sets_at, without_redundant_rows
from vemcvx.weight_law import Piece, PressureLaw


class Response:
    """The rows A = [B; D] of operators, and the stiffness K_r of the unknowns that they read, the others left free."""

    def __init__(self, operators: Operators):
        self.operators, self.A = operators, sp.csr_matrix(sp.vstack([operators.B, operators.D]))
        self.norms, self.limits = slice(operators.B.shape[0]), slice(operators.B.shape[0], None)
        anchor = np.zeros(self.A.shape[1]) if operators.anchor is None else operators.anchor
        self.read: Ints = np.flatnonzero((np.bincount(self.A.indices, minlength=len(anchor)) > 0) | (anchor > 0))
        """(u,) the unknowns, those of anchors among them"""
        self.rows = sp.csr_matrix(self.A[:, self.read])
        """(m * block + r, u) A on these"""
        self.anchor: Floats = anchor[self.read]
        """(u,) the stiffness of the anchors, without which K_r is K"""
        self._transposed = sp.csr_matrix(self.A.T)

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self._transposed @ x

    @cached_property
    def _inner(self) -> tuple[Ints, Factor]:
        """The unknowns that no row reads, and a factor of K on them."""
        rest = np.setdiff1d(np.arange(self.A.shape[1]), self.read)
        return rest, self.operators.factor.within(restricted(self.operators.K, rest), rest)

    @cached_property
    def stiffness(self) -> Floats:
        """(u, u) K_r on the unknowns."""
        K = restricted(self.operators.regular.K, self.read)
        if len(self.read) == self.A.shape[1]:
            return np.ascontiguousarray(K if isinstance(K, np.ndarray) else K.toarray())
        rest, factor = self._inner
        coupling = self.operators.K[rest][:, self.read]
        coupling = coupling if isinstance(coupling, np.ndarray) else coupling.toarray()
        return np.ascontiguousarray(K - coupling.T @ factor.solve(coupling))

    def passed_on(self, force: Floats) -> Floats:
        """(u,) the force on the unknowns that does as much to them as a force (n,) on all."""
        if len(self.read) == self.A.shape[1]:
            return force
        rest, factor = self._inner
        spread = np.zeros(len(force))
        spread[rest] = factor.solve(force[rest])
        passed: Floats = (force - self.operators.K @ spread)[self.read]
        return passed

    @cached_property
    def flexibility(self) -> Floats:
        """(u, u) the part of K_r^{-1} that rows read."""
        unit = np.zeros((self.A.shape[1], len(self.read)))
        unit[self.read, np.arange(len(self.read))] = 1.0
        found: Floats = self.operators.factor.solve(unit)[self.read]
        return found

    @cached_property
    def reach(self) -> Floats:
        """(m * block + r,) bounds on what rows read of motions, (A d)_i <= reach_i |d|, and on |B_i'x| in K_r^{-1}."""
        operators = self.operators
        norms = np.repeat(operators.block * operators.norm_flexibility, operators.block)
        reach: Floats = np.sqrt(np.concatenate([norms, operators.limit_flexibility]))
        return reach

    @cached_property
    def step(self) -> Floats:
        """(m * block + r,) by which multipliers may follow gradients: 1 / step exceeds W + C.

        The largest eigenvalue of W + C, its diagonal made one, is that of twenty power iterations, and a tenth more.
        """
        diagonal = self.reach**2
        diagonal[self.limits] += self.operators.compliance
        root, largest = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0
        x = np.random.default_rng(0).standard_normal(len(root))
        for _ in range(20 if len(x) else 0):
            y = root * x / np.linalg.norm(x)
            spread = self.A @ self.operators.factor.solve(self.act(y))
            spread[self.limits] += self.operators.compliance * y[self.limits]
            x = root * spread
            largest = float(np.linalg.norm(x))
        step: Floats = root**2 / (1.1 * largest if largest > 0 else 1.0)
        return step


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
    d, x = np.zeros(len(program.g)), np.zeros(response.A.shape[0])
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
    size, last = np.abs(x), np.abs(more).max(initial=0.0)
    force, free = np.abs(program.g).max(initial=0.0), operators.factor.energy(program.g)
    norm = np.sqrt(free) + np.sqrt(operators.factor.energy(response.act(x)))
    solved = last <= SOLVED * max(force, size.max(initial=0.0)) and error <= SOLVED * norm
    reach, off = abs(response.A) @ np.abs(d), response.A @ step
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


def held_by(A: sp.csr_matrix) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """(L, Z) of rows A (h, c) that hold: A d = v has the solutions d = L'v + Z y, and A'x = f, if any, x = L f.

    A row that reads an unknown of its own holds that one; the others are reflected, together with those that share
    unknowns with them.

    Raises
    ------
    LinAlgError
        A row follows from others.
    """
    own, readers = np.diff(A.indptr) == 1, np.bincount(A.indices, minlength=A.shape[1])
    own[own] = readers[A.indices[A.indptr[:-1][own]]] == 1
    first, shared, free = A.indptr[:-1][own], np.flatnonzero(~own), np.flatnonzero(readers == 0)
    L = [(np.flatnonzero(own), A.indices[first], 1.0 / A.data[first])]
    Z = [(free, np.arange(len(free)), np.ones(len(free)))]
    f = len(free)
    if len(shared):
        groups = connected_components(abs(A[shared]) @ abs(A[shared]).T, directed=False)[1]
        for group in range(groups.max() + 1):
            rows = shared[groups == group]
            some = np.unique(A[rows].indices)
            Q, R = qr(A[rows][:, some].toarray().T)
            h, rest = len(rows), np.arange(f, f + len(some) - len(rows))
            if h > len(some) or (np.abs(np.diagonal(R)) <= FOLLOWS * np.linalg.norm(R, axis=0)).any():
                raise LinAlgError("singular")
            L.append((np.repeat(rows, len(some)), np.tile(some, h), solve_triangular(R[:h], Q[:, :h].T).ravel()))
            Z.append((np.repeat(some, len(rest)), np.tile(rest, len(some)), Q[:, h:].ravel()))
            f += len(rest)
    return _assembled(L, A.shape), _assembled(Z, (A.shape[1], f))


def _assembled(parts: list[tuple[Ints, Ints, Floats]], shape: tuple[int, int]) -> sp.csr_matrix:
    """The matrix with the entries (row, column, value)."""
    rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=shape)


class SetsSystem:
    """The system of some sets, reduced to the motions y that they leave, and factorised.

    Raises
    ------
    LinAlgError
        It is singular: the sets hold nothing, or hold something twice.
    """

    def __init__(self, operators: Operators, sets: Sets, J: sp.csr_matrix, response: Response):
        block, norms, r = operators.block, operators.B.shape[0], len(sets.act)
        self._operators, self._response, self._sets, self._J = operators, response, sets, J
        soft = sets.act & (operators.compliance > 0)
        self._spring = np.divide(1.0, operators.compliance, out=np.zeros(r), where=soft)
        self._hard, stick = np.flatnonzero(sets.act & ~soft), np.flatnonzero(np.repeat(sets.stick, block))
        self._own = np.setdiff1d(stick, sets.idle)
        self._q = _blockwise(sets.direction[:, :, None])
        self._H = _blockwise(sets.curvature[:, None, None] * transverse(sets.direction))
        follows = sp.csr_matrix(self._q @ J @ sp.diags_array(sets.act.astype(float)))
        follows.eliminate_zeros()
        # Unknowns that the sets do nothing with are free; where most are, these are eliminated.
        concerned = np.concatenate([np.repeat(sets.stick | (sets.curvature > 0), block), sets.act])
        concerned[:norms] |= np.diff(follows.indptr) > 0
        some = np.flatnonzero((abs(response.rows).T @ concerned > 0) | (response.anchor > 0))
        if 2 * len(some) < len(response.read):
            self._S = np.asarray(np.linalg.inv(np.asarray(restricted(response.flexibility, some))))
        else:
            some, self._S = np.arange(len(response.read)), response.stiffness
        self._some, A = some, response.rows[:, some]
        self._B, self._D = A[:norms], A[norms:]
        soften = self._D.T @ sp.diags_array(self._spring) @ self._D - sp.diags_array(response.anchor[some])
        self._T = sp.csr_matrix(self._B.T @ self._H @ self._B + soften)
        self._L, self._Z = held_by(sp.csr_matrix(sp.vstack([self._D[self._hard], self._B[self._own]])))
        self._choose()
        # p = E^{-1} (what limits would carry alone), where terms that slip pull at what limits hold.
        h = len(self._hard)
        self._press = sp.csr_matrix((np.ones(h), (self._hard, np.arange(h))), shape=(r, h)) @ self._react[:h]
        tied = sp.csc_matrix(self._press @ self._B.T @ follows)
        one = sp.eye_array(r, format="csc")
        self._untie = sp.csr_matrix(splu(sp.csc_matrix(one + tied)).solve(np.eye(r)) if tied.nnz else one)
        self._pull = sp.csr_matrix(follows @ self._untie)
        f, tests = self._Z.shape[1], sp.csr_matrix(sp.vstack([self._Z.T, -self._react[:h]]))
        answered = np.asarray(_plus(tests @ self._S, tests @ self._T) @ self._Z)
        self._K = answered[:f]
        self._P = _plus(np.zeros((r, f)), sp.diags_array(self._spring) @ self._D @ self._Z)
        self._P[self._hard] += answered[f:]
        self._M = self._K + (self._Z.T @ self._B.T @ self._pull) @ self._P
        self._lu = lu = lapack.dgetrf(self._M) if len(self._M) else (self._M, self._M, 0)
        if lu[2] > 0 or not np.isfinite(lu[0]).all():
            raise LinAlgError("singular")

    def _choose(self) -> None:
        """x = react f + given (shares of x), of limits that hold, terms that stick, and idle rows, in this order."""
        idle, shares, h = self._sets.idle, self._sets.shares, len(self._hard)
        self._rows = np.concatenate([self._response.limits.start + self._hard, self._own, idle])
        if not len(idle):
            self._react, self._given = self._L, np.zeros((len(self._rows), 0))
            return
        pushed, own = (self._L @ self._B[idle].T).toarray(), shares[:, self._own]
        chosen = np.linalg.inv(shares[:, idle] - own @ pushed[h:])
        self._given = np.concatenate([-pushed @ chosen, chosen])
        self._react = sp.csr_matrix(sp.vstack([self._L, sp.csr_matrix((len(idle), self._L.shape[1]))]))
        self._react = sp.csr_matrix(self._react - sp.csr_matrix(self._given @ (own @ self._L[h:])))

    def _opened(self, rest: Floats) -> Floats:
        """M^{-1} rest."""
        return np.asarray(lapack.dgetrs(*self._lu[:2], rest)[0]) if len(rest) else rest

    def solve(self, force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """(d, x) with K d = force - A'x, where the equation of every row misses by `wanted` (N,)."""
        response, factor, h = self._response, self._operators.factor, len(self._hard)
        norms, limits = response.norms, response.limits
        own, sprung = np.concatenate([wanted[limits][self._hard], wanted[self._own]]), self._spring * wanted[limits]
        given = self._given @ wanted[self._sets.idle]
        x = wanted.copy()
        x[norms][np.repeat(self._sets.stick, self._operators.block)] = 0.0
        x[limits][self._sets.act] = 0.0
        x[norms] += self._q @ (self._J @ x[limits])
        d = self._L.T @ own
        unknowns, passed = response.read[self._some], response.passed_on(force - response.act(x))
        rest = passed[self._some] + self._D.T @ sprung - self._S @ d - self._T @ d
        # As motions, forces on the unknowns would lose the digits that K lacks of definiteness.
        passed[self._some] = 0.0
        if passed.any():
            rest += self._S @ (response.flexibility @ passed)[self._some]
        p = self._press @ rest + self._spring * (self._D @ d) - sprung
        p[self._hard] += given[:h]
        y = self._opened(self._Z.T @ (rest - self._B.T @ (self._pull @ p)))
        p, more = p + self._P @ y, self._Z @ y
        rest -= self._S @ more + self._T @ more + self._B.T @ (self._pull @ p)
        d = d + more
        x[norms] += self._H @ (self._B @ d) + self._pull @ p
        x[limits] += self._untie @ p
        x[self._rows] = self._react @ rest + given
        push = force - response.act(x)
        push[unknowns] += response.anchor[self._some] * d
        return factor.solve(push), x

    @cached_property
    def gain(self) -> float:
        """c of the theorem."""
        if len(self._M) == 0:
            return 0.0
        anchors = sp.diags_array(self._response.anchor[self._some])
        N = _plus(self._K.copy(), self._Z.T @ anchors @ self._Z)
        # y'My >= y'Ny / 2 where J is small, which a factorisation shows in a tenth of the work of the norm.
        if lapack.dpotrf(self._M + self._M.T - N)[1] == 0:
            return 2.0
        root, info = lapack.dpotrf(N)
        return np.inf if info else float(np.linalg.norm(np.triu(root) @ self._opened(np.triu(root).T)))

    @cached_property
    def _moving(self) -> Floats:
        """(m * block + r,) `reach` of rows, zero for those that what is held does not let move."""
        A, free = self._response.rows, self._response.rows[:, self._some] @ self._Z
        within = np.diff(A[:, self._some].indptr) == np.diff(A.indptr)
        held = abs(free).max(axis=1).toarray().ravel() <= FOLLOWS * abs(A).max(axis=1).toarray().ravel()
        return np.where(within & held, 0.0, self._response.reach)

    def answers(self, along: Floats, across: Floats) -> Answers:
        """Bounds on the answers to psi, its parts being at most `along` and `across` (m,)."""
        response, block, h = self._response, self._operators.block, self._sets.curvature
        # A term moves if one of its rows does.
        phi = self._operators.blocks(self._moving[response.norms]).max(axis=1)
        limits = self._moving[response.limits]
        chi = np.minimum(phi, 1.0 / np.sqrt(np.where(h > 0, h, np.inf)), where=h > 0, out=phi.copy())
        psi = np.repeat(np.hypot(along, across), block)
        tied = _sizes(abs(self._pull @ self._press @ self._B.T) @ psi, block)
        energy = self.gain * float(response.reach[response.norms][::block] @ tied + phi @ along + chi @ across)
        excess = limits * energy
        # |K_r d| on an unknown, by Schwarz's inequality; anchors pull with no more than the root of their stiffness.
        force = (np.sqrt(np.diagonal(self._S)) + np.sqrt(response.anchor[self._some])) * energy
        force += abs(self._D).T @ (self._spring * excess)
        pulls = psi + np.repeat(h * chi * energy, block)
        press = abs(self._press) @ force + abs(self._press @ self._B.T) @ pulls + self._spring * excess
        held = np.zeros(len(self._moving))
        held[self._rows] = abs(self._react) @ force
        held[self._rows] += abs(self._react @ self._B.T) @ (pulls + abs(self._pull) @ press)
        multipliers = _sizes(held[response.norms], block)
        return Answers(energy, phi * energy, chi * energy, excess, multipliers, abs(self._untie) @ press)


class Answers(NamedTuple):
    """Bounds on how a state answers psi."""

    energy: float
    along: Floats
    """(m,) slips along q"""
    across: Floats
    """(m,)"""
    excess: Floats
    """(r,)"""
    multipliers: Floats
    """(m,) of terms that stick"""
    forces: Floats
    """(r,)"""


def _plus(dense: Floats, sparse: sp.csr_matrix) -> Floats:
    """The dense matrix, to which the sparse one is added."""
    entries = sp.coo_matrix(sparse)
    np.add.at(dense, (entries.row, entries.col), entries.data)
    return dense


def _sizes(x: Floats, block: int) -> Floats:
    """(m,) norms of the blocks of x (m * block,)."""
    return np.asarray(np.linalg.norm(x.reshape(-1, block), axis=1))


def _blockwise(blocks: Floats) -> sp.csr_matrix:
    """The block diagonal matrix of blocks (m, i, j)."""
    m, i, j = blocks.shape
    return sp.csr_matrix(sp.bsr_matrix((blocks, np.arange(m), np.arange(m + 1)), shape=(m * i, m * j)))


def distance_to_a_solution(program: StepProgram, law: PressureLaw, sets: Sets, found: Found) -> float | None:
    """A bound on |d - d*|_K to a solution d* of (Q), from what the sets miss of it; None if there is no proof."""
    p, s = np.where(found.sets.act, np.maximum(found.point.p, 0.0), 0.0), program.slip(found.point.d)
    w, J, v = law.weights(p), abs(law.slope(p)), np.linalg.norm(s, axis=1)
    blur = found.motions.max(initial=0.0)
    # What slips by no more than rounding is held by others, wherever lam_i points.
    slides, held = ~sets.stick & (w > 0) & (v > blur), ~sets.stick & (w > 0) & (v <= blur)
    if not slides.any():
        return 0.0 if found.holds(program, law, sets) else None
    v = np.where(slides, v, 1.0)
    u = np.where(slides[:, None], s / v[:, None], 0.0)
    q, h = sets.direction, sets.curvature
    delta, off, rounding = np.linalg.norm(u - q, axis=1), np.abs(w / v - h), blur / v
    missed = found.point.lam - w[:, None] * u
    along = np.einsum("ij,ij->i", missed, q)
    across = np.linalg.norm(missed - along[:, None] * q, axis=1) + found.forces + w * rounding
    along = np.abs(along) + found.forces + w * rounding * (delta + rounding)
    first = np.stack([along, across]) * slides
    t = 2.0 * first
    for _ in range(8):  # Twice what the last bounds lead to: where psi changes little, the first do.
        answers = found.system.answers(*t)
        alpha, gamma = answers.along * slides, answers.across * slides
        if not (alpha + gamma < v).all():
            return None
        turn = (gamma + delta * alpha) / (v - alpha - gamma)
        common = w * ((turn + delta) * (alpha + gamma) / v + turn**2 / 2) + (J @ answers.forces) * (delta + turn)
        led = first + np.stack([common, common + off * gamma]) * slides
        if (led <= t).all():
            proven = (answers.along[held] <= blur).all() and _hold(program, law, sets, found, answers)
            return answers.energy if proven else None
        t = np.maximum(t, 2.0 * led)
    return None


def _hold(program: StepProgram, law: PressureLaw, sets: Sets, found: Found, answers: Answers) -> bool:
    """True if the sets' inequalities hold, to rounding, whatever psi is answered, and the law is affine there."""
    act, pressure, pi = found.sets.act, found.point.p, np.where(found.sets.act, answers.forces, 0.0)
    p, z = np.where(act, np.maximum(pressure, 0.0), 0.0), program.excess(found.point.d) + answers.excess
    low, high = (law.slope(np.maximum(p + sign * pi, 0.0)) for sign in (-1.0, 1.0))
    w, J = law.weights(p), law.slope(p)
    affine = abs(low - J).sum() == 0 and abs(high - J).sum() == 0
    size = np.linalg.norm(found.point.lam, axis=1) + answers.multipliers
    within = ~sets.stick | (size <= w - abs(J) @ pi + found.forces)
    pressed = np.where(sets.act, pressure - pi >= -found.forces, z <= found.motions[program.b.size :])
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
    away = distance_to_a_solution(program, law, sets, found) if program.operators.block > 1 else 0.0
    return SetsSolution(point, law.weights(point.p), found.error + (away or 0.0), away is not None)


SWEEPS = 50
"""Projected gradients before the first sets of discs. Of 420 discs that press on a plane eight steps took 74 systems
without, 50 after 30 of them, 31 after 100; a system costs as much as 80."""


def swept(program: StepProgram, law: PressureLaw, start: Iterate, response: Response) -> Iterate:
    """A point near a solution of (Q): projected gradients with momentum, on the multipliers x = (lam, p).

    x becomes the projection of y + r (A K^{-1} g - [b; e] - (W + c) y) on discs of the radius w(p) and on p >= 0, y
    being ahead of x (Nesterov 1983), and x itself where that led back (O'Donoghue and Candes 2015). By Gershgorin's
    theorem diag(1 / r) - W - c is semidefinite for 1 / r_i = c_i + sum_j |W_ij|, the largest of each disc.
    """
    operators, limits, step = program.operators, response.limits, response.step
    x = y = np.concatenate([start.lam.ravel(), start.p])
    momentum = 1.0
    for _ in range(SWEEPS):
        lam, p = operators.blocks(y[response.norms]), y[limits]
        d = operators.factor.solve(program.g - operators.multiplier_force(lam, p))
        ahead_of = np.concatenate([program.slip(d).ravel(), program.excess(d) - operators.compliance * p])
        new = y + step * ahead_of
        p = np.maximum(new[limits], 0.0)
        lam = replace(program, w=law.weights(p)).project(operators.blocks(new[response.norms]))
        last, x = x, np.concatenate([lam.ravel(), p])
        if (y - x) / step @ (x - last) > 0:
            momentum = 1.0
        ahead = 0.5 + np.sqrt(0.25 + momentum**2)
        y, momentum = x + (momentum - 1.0) / ahead * (x - last), ahead
    return Iterate(operators.factor.solve(program.g - operators.multiplier_force(lam, p)), lam, p)


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
