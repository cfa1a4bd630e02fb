"""The system of given sets: what sticks, what slips and where to, which limits act.

With terms |B_i d - b_i| of multipliers lam_i, limits D d - e of forces p, slipping directions q_i of curvatures h_i,
and weights w(p) = w_0 + J (p - p_0), find d, lam and p with K d = g - B'lam - D'p and

    s_i = 0  on sticking terms,           lam_i = q_i w_i(p) + h_i (I - q_i q_i') s_i  on slipping ones,    s = B d - b,
    z_j = c_j p_j  on acting limits,      p_j = 0  on the others,                                           z = D d - e.

The unknowns that no row reads are eliminated once: S is K of the others. Let T = B'hB - with h_i (I - q_i q_i') in its
blocks - and D'D / c of soft limits that act. Sticking terms and acting bounds, A d = a, leave d = L'a + Z y with A Z =
0 and A L' = I, and carry L f, f being the force that is left on them. So the forces of limits are affine in y, with the
derivative P = E^{-1} (D Z / c - L (S + T) Z), E = I + L B'q J where terms that slip pull at what limits hold, and y has

    M y = Z' (all known forces),          M = Z'(S + T)Z + Z'B'q J P,

symmetric but for weights that follow p: as many equations as motions are left, none where all sticks. Z and L are unit
vectors where rows read unknowns of their own, and come from reflections where they share nodes, at edges. Where most
limits are open, their unknowns are eliminated with the others. A kernel of K needs no care: K_r = K + diag(a), definite
by the stiffness a of anchors, stands for K where a factor is wanted, and T has -a.

If forces -B'psi act on slipping terms, y moves by -M^{-1} Z'B'(psi + q J psi_p), psi_p = E^{-1} L B'psi being what the
forces of limits answer at once. With N = S + T + diag(a), c such that y'My >= y'Z'NZ y / c for all y, and phi_i^2 >=
|B_i K_r^{-1} B_i'|, the motion d that answers |psi_i| <= t_i along q_i and <= r_i across it is bounded by

    |d|_N  <=  E_psi = c sum_i (phi_i (t_i + |q J psi_p|_i) + chi_i r_i),               chi_i = min(phi_i, h_i^{-1/2}),

for B_i d has at most phi_i |d| along q_i, and chi_i |d| across it. Forces of what is held follow from Schwarz's
inequality. The norm of (Z'NZ)^{1/2} M^{-1} (Z'NZ)^{1/2} is such a c, and 2 often one that a factorisation proves.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, lapack, qr, solve_triangular
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from vemcvx.arrays import Floats, Ints
from vemcvx.linear import Factor
from vemcvx.program.operators import Operators, restricted, transverse
from vemcvx.solvers.newton import FOLLOWS, Sets


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

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self.operators.multiplier_force(x[self.norms], x[self.limits])

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
        """(m * block + r,) by which multipliers may follow gradients: 1 / step is to exceed W + C.

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
        """c of theorem 2."""
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
        return Answers(
            energy=energy,
            along=phi * energy,
            across=chi * energy,
            excess=excess,
            multipliers=_sizes(held[response.norms], block),
            forces=abs(self._untie) @ press,
        )


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
