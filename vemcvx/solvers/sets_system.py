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

from vemcvx.arrays import Bools, Floats, Ints, lengths
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
        self.readers = sp.csr_matrix(abs(self.rows).T)
        """(u, m * block + r) |A'| on these"""
        self.turned = sp.csr_matrix(self.rows[self.norms].T)
        """(u, m * block) B' on these"""
        self.anchor: Floats = anchor[self.read]
        """(u,) the stiffness of the anchors, without which K_r is K"""
    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self.operators.multiplier_force(x[self.norms], x[self.limits])

    @cached_property
    def _pairs(self) -> tuple[Ints, Ints, Floats, Ints]:
        """(row, column, factor, number) of the entries of A'XA, X the block diagonal matrix of numbers (m * b * b + r,)."""
        b, norms, N = self.operators.block, self.norms.stop, self.A.shape[0]
        i = np.concatenate([np.arange(norms).repeat(b), np.arange(norms, N)])
        j = np.concatenate([(np.arange(norms).reshape(-1, 1, b).repeat(b, 1)).ravel(), np.arange(norms, N)])
        count = np.diff(self.rows.indptr)
        number = np.arange(len(i)).repeat(count[i] * count[j])
        within = np.arange(len(number)) - (np.cumsum(count[i] * count[j]) - count[i] * count[j])[number]
        left, right = (self.rows.indptr[i[number]] + within // count[j[number]], self.rows.indptr[j[number]] + within % count[j[number]])
        indices, data = self.rows.indices, self.rows.data
        return indices[left].astype(np.int64), indices[right].astype(np.int64), data[left] * data[right], number

    def stiffened(self, S: Floats, some: Ints, H: Floats, spring: Floats) -> Floats:
        """S + B'HB + D'diag(spring) D - diag(anchor), on `some` of the unknowns."""
        S, place = S.copy(), np.empty(len(self.read), dtype=np.int64)
        place[some] = np.arange(len(some))
        row, column, factor, number = self._pairs
        values = factor * np.concatenate([H.ravel(), spring])[number]
        there = np.flatnonzero(values)
        flat = S.reshape(-1)
        np.add.at(flat, place[row[there]] * len(S) + place[column[there]], values[there])
        flat[:: len(S) + 1] -= self.anchor[some]
        return S

    def following(self, q: Floats, J: sp.csr_matrix, act: Bools) -> sp.csr_matrix:
        """q J (m * block, r): how multipliers along directions q (m, block) follow the forces of limits that act."""
        Q = sp.csr_matrix((q.ravel(), np.repeat(np.arange(len(q)), q.shape[1]), np.arange(q.size + 1)), (q.size, len(q)))
        follows = sp.csr_matrix(Q @ J)
        follows.data *= act[follows.indices]
        follows.eliminate_zeros()
        return follows

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
        self._operators, self._response, self._sets = operators, response, sets
        hard, stick = sets.act & (operators.compliance == 0), np.repeat(sets.stick, operators.block)
        self._spring = np.divide(1.0, operators.compliance, out=np.zeros(len(hard)), where=sets.act & ~hard)
        self._slips, self._hard = np.flatnonzero(~stick), np.flatnonzero(hard)
        stick[sets.idle] = False
        self._held = np.concatenate([response.limits.start + self._hard, np.flatnonzero(stick)])
        follows = response.following(sets.direction, J, sets.act)
        self._place(np.repeat(sets.stick | (sets.curvature > 0), operators.block) | (np.diff(follows.indptr) > 0))
        self._choose()
        # p = E^{-1} (what limits would carry alone), where terms that slip pull at what limits hold.
        r, self._untie = len(hard), None
        self._pull, self._tug = follows, self._turned @ follows
        if (tied := self._press @ self._tug).nnz:
            E = np.eye(r)
            E[self._hard] += tied.toarray()
            self._untie = sp.csr_matrix(np.linalg.inv(E))
            self._pull, self._tug = follows @ self._untie, self._tug @ self._untie
        self._P = np.zeros((r, len(self._free)))
        self._P[self._hard] = -(self._press @ self._stiff).take(self._free, 1)
        if self._spring.any():
            _add(self._P, sp.diags_array(self._spring) @ self._A[response.limits][:, self._free])
        self._M = restricted(self._stiff, self._free)
        if self._tug.nnz:
            self._M += self._tug[self._free] @ self._P
        # LAPACK reads columns: it gets the transpose, as it stands.
        self._lu = lu = lapack.dgetrf(self._M.T) if len(self._M) else (self._M, self._M, 0)
        if lu[2] > 0 or not np.isfinite(lu[0]).all():
            raise LinAlgError("singular")

    def _place(self, concerned: Bools) -> None:
        """Choose coordinates of the unknowns, G of them, such that what holds reads one a row, and S + T in these."""
        response, sets = self._response, self._sets
        # Unknowns that the sets do nothing with are free; where most are, these are eliminated.
        some = np.flatnonzero((response.readers @ np.concatenate([concerned, sets.act]) > 0) | (response.anchor > 0))
        if 2 * len(some) < len(response.read):
            self._S, self._A = np.linalg.inv(restricted(response.flexibility, some)), sp.csr_matrix(response.rows[:, some])
            self._turned = sp.csr_matrix(self._A[response.norms].T)
        else:
            some, self._S, self._A = np.arange(len(response.read)), response.stiffness, response.rows
            self._turned = response.turned
        self._some, self._G, holding = some, None, self._A[self._held]
        H = sets.curvature[:, None, None] * transverse(sets.direction)
        self._stiff = response.stiffened(self._S, some, H, self._spring)
        columns = holding.indices.astype(np.int64)
        if (np.diff(holding.indptr) == 1).all() and len(np.unique(columns)) == len(columns):
            self._L = sp.csr_matrix((1.0 / holding.data, columns, holding.indptr), shape=holding.shape)
        else:
            L, Z = held_by(holding)
            self._G = G = sp.csr_matrix(sp.hstack([L.T, Z]))
            self._A, self._stiff, columns = sp.csr_matrix(self._A @ G), G.T @ (self._stiff @ G), np.arange(L.shape[0])
            self._L, self._turned = sp.eye_array(*L.shape, format="csr"), sp.csr_matrix(self._A[response.norms].T)
        free = np.ones(len(self._stiff), dtype=bool)
        free[columns] = False
        self._free = np.flatnonzero(free)

    def _choose(self) -> None:
        """x = react f + given (shares of x), of limits that hold, terms that stick, and idle rows, in this order."""
        idle, shares, h = self._sets.idle, self._sets.shares, len(self._hard)
        self._rows, self._react, self._given = np.concatenate([self._held, idle]), self._L, np.zeros((len(self._held), 0))
        if len(idle):
            pushed, own = (self._L @ self._A[idle].T).toarray(), shares[:, self._held[h:]]
            chosen = np.linalg.inv(shares[:, idle] - own @ pushed[h:])
            self._given = np.concatenate([-pushed @ chosen, chosen])
            react = sp.vstack([self._L, sp.csr_matrix((len(idle), self._L.shape[1]))])
            self._react = sp.csr_matrix(react - sp.csr_matrix(self._given @ (own @ self._L[h:])))
        self._press = self._react[:h]

    def _opened(self, rest: Floats) -> Floats:
        """M^{-1} rest."""
        return np.asarray(lapack.dgetrs(*self._lu[:2], rest, trans=1)[0]) if len(rest) else rest

    def _passed(self, force: Floats) -> Floats:
        """The force (n,) on all, as one on the coordinates."""
        passed = self._response.passed_on(force)
        on = passed[self._some]
        if len(on) < len(passed):
            # As motions, forces on the unknowns would lose the digits that K lacks of definiteness.
            passed[self._some] = 0.0
            if passed.any():
                on = on + self._S @ (self._response.flexibility @ passed)[self._some]
        return on if self._G is None else self._G.T @ on

    def solve(self, force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """(d, x) with K d = force - A'x, where the equation of every row misses by `wanted` (N,)."""
        response, sets, h, y = self._response, self._sets, len(self._hard), np.zeros(len(self._stiff))
        norms, limits, x = response.norms, response.limits, np.zeros(len(wanted))
        x[self._slips], x[limits] = wanted[self._slips], -self._spring * wanted[limits]
        d, rest = self._L.T @ wanted[self._held], self._passed(force - response.act(x))
        rest -= self._stiff @ d
        given = self._given @ wanted[sets.idle]
        p = x[limits] + self._spring * (self._A @ d)[limits]
        p[self._hard] += self._press @ rest + given[:h]
        y[self._free] = self._opened((rest - self._tug @ p)[self._free])
        p += self._P @ y[self._free]
        rest -= self._stiff @ y + self._tug @ p
        d += y
        if self._sets.curvature.any():
            x[norms] += sets.bent(self._operators.blocks((self._A @ d)[norms])).ravel()
        x[norms] += self._pull @ p
        x[limits] = p if self._untie is None else self._untie @ p
        x[self._rows] = self._react @ rest + given
        d = d if self._G is None else self._G @ d
        if len(d) == len(force):
            return d, x
        push = force - response.act(x)
        push[response.read[self._some]] += response.anchor[self._some] * d
        return self._operators.factor.solve(push), x

    @cached_property
    def gain(self) -> float:
        """c of theorem 2."""
        if len(self._M) == 0:
            return 0.0
        N = restricted(self._stiff, self._free)
        if (anchor := self._response.anchor[self._some]).any():
            anchors = sp.diags_array(anchor) if self._G is None else self._G.T @ sp.diags_array(anchor) @ self._G
            _add(N, sp.csr_matrix(anchors)[self._free][:, self._free])
        # y'My >= y'Ny / 2 where J is small, which a factorisation shows in a tenth of the work of the norm.
        if lapack.dpotrf(self._M + self._M.T - N)[1] == 0:
            return 2.0
        root, info = lapack.dpotrf(N)
        return np.inf if info else float(np.linalg.norm(np.triu(root) @ self._opened(np.triu(root).T)))

    @cached_property
    def _sizes(self) -> sp.csr_matrix:
        """|A| in the coordinates, (N, u)."""
        return abs(self._A)

    @cached_property
    def _stiffest(self) -> Floats:
        """(u,) the most that |K_r d| is on a coordinate, of |d| = 1 in K_r + anchors' stiffness."""
        anchor, G = self._response.anchor[self._some], self._G
        if G is None:
            return np.asarray(np.sqrt(np.diagonal(self._S)) + np.sqrt(anchor))
        own = np.asarray(G.multiply(self._S @ G).sum(axis=0)).ravel()
        return np.asarray(np.sqrt(np.maximum(own, 0.0)) + np.sqrt(G.multiply(G).T @ anchor))

    @cached_property
    def _moving(self) -> Floats:
        """(m * block + r,) `reach` of rows, zero for those that what is held does not let move."""
        response, free = self._response, np.zeros(len(self._stiff))
        free[self._free] = 1.0
        beyond = np.ones(len(response.read))
        beyond[self._some] = 0.0
        held = self._sizes @ free <= FOLLOWS * (self._sizes @ np.ones(len(free)))
        return np.where(held & (beyond @ response.readers == 0), 0.0, response.reach)

    def answers(self, along: Floats, across: Floats) -> Answers:
        """Bounds on the answers to psi, its parts being at most `along` and `across` (m,), none of what sticks."""
        response, block, h = self._response, self._operators.block, self._sets.curvature
        norms, limits, pull, press = response.norms, response.limits, abs(self._pull), abs(self._press)
        # A term moves if one of its rows does.
        phi = self._operators.blocks(self._moving[norms]).max(axis=1)
        chi = np.minimum(phi, 1.0 / np.sqrt(np.where(h > 0, h, np.inf)), where=h > 0, out=phi.copy())
        x = np.zeros(len(response.reach))
        x[norms] = psi = np.repeat(np.hypot(along, across), block)
        tied = lengths(self._operators.blocks(pull @ self._on_limits(press @ (x @ self._sizes))))
        energy = self.gain * float(response.reach[norms][::block] @ tied + phi @ along + chi @ across)
        excess = self._moving[limits] * energy
        x[norms], x[limits] = psi + np.repeat(h * chi * energy, block), self._spring * excess
        # Schwarz's inequality; anchors pull with no more than the root of their stiffness.
        force = self._stiffest * energy + x @ self._sizes
        forces = self._on_limits(press @ force) + self._spring * excess
        x[norms], x[limits] = pull @ forces, 0.0
        held = np.zeros(len(x))
        held[self._rows] = abs(self._react) @ (force + x @ self._sizes)
        return Answers(
            energy=energy,
            along=phi * energy,
            across=chi * energy,
            excess=excess,
            multipliers=lengths(self._operators.blocks(held[norms])),
            forces=forces if self._untie is None else abs(self._untie) @ forces,
        )

    def _on_limits(self, forces: Floats) -> Floats:
        """(r,) forces of the limits that hold, among those of all."""
        p = np.zeros(len(self._spring))
        p[self._hard] = forces
        return p


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


def _add(dense: Floats, sparse: sp.csr_matrix) -> None:
    """Add a sparse matrix to a dense one, in place."""
    entries = sp.coo_matrix(sparse)
    entries.sum_duplicates()
    dense[entries.row, entries.col] += entries.data
