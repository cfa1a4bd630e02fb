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
        self.turned = sp.csr_matrix(self.rows.T)
        """(u, m * block + r) A' on these"""
        self._last: Place | None = None
        self.anchor: Floats = anchor[self.read]
        """(u,) the stiffness of the anchors, without which K_r is K"""

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self.operators.multiplier_force(x[self.norms], x[self.limits])

    @cached_property
    def sizes(self) -> sp.csr_matrix:
        """|A| on the unknowns."""
        return abs(self.rows)

    def blockwise(self, H: Floats, spring: Floats) -> sp.csr_matrix:
        """The block diagonal matrix (N, N) of blocks (m, block, block) of norm terms, and of numbers (r,) of limits."""
        m, b, r, end = *H.shape[:2], len(spring), H.size
        columns = np.arange(m * b).reshape(m, 1, b).repeat(b, 1).ravel()
        indices = np.concatenate([columns, np.arange(m * b, m * b + r)])
        indptr = np.concatenate([np.arange(0, end, b), np.arange(end, end + r + 1)])
        return sp.csr_matrix((np.concatenate([H.ravel(), spring]), indices, indptr))

    def following(self, q: Floats, J: sp.csr_matrix) -> sp.csr_matrix:
        """(N, r): q J, by which multipliers along directions q (m, block) follow the forces of limits; zero on limits."""
        indptr = np.minimum(np.arange(self.A.shape[0] + 1), q.size)
        Q = sp.csr_matrix((q.ravel(), np.arange(q.size) // q.shape[1], indptr), (self.A.shape[0], len(q)))
        follows = sp.csr_matrix(Q @ J)
        follows.eliminate_zeros()
        return follows

    def place(self, held: Ints, touched: Bools) -> Place:
        """The coordinates of the unknowns that some rows (N,) touch: of all, unless these are less than half.

        The last are remembered: sets that hold the same are asked for again while directions turn.
        """
        some = np.flatnonzero((touched @ self.sizes > 0) | (self.anchor > 0))
        some = some if 2 * len(some) < len(self.read) else np.arange(len(self.read))
        if self._last is None or not (np.array_equal(held, self._last.held) and np.array_equal(some, self._last.some)):
            self._last = None  # before there is another, lest memory hold two
            self._last = Place(self, held, some)
        return self._last

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
        root, info = lapack.dpotrf(self.stiffness)
        upper = lapack.dpotri(root)[0] if info == 0 else root
        return np.asarray(np.triu(upper) + np.triu(upper, 1).T)

    @cached_property
    def softness(self) -> Floats:
        """(N, N) W + C: how far rows move under multipliers of one, W = A K_r^{-1} A'; in LAPACK's order."""
        W = np.asfortranarray(self.rows @ (self.rows @ self.flexibility).T)
        W[np.arange(len(W))[self.limits], np.arange(len(W))[self.limits]] += self.operators.compliance
        return W

    @cached_property
    def reach(self) -> Floats:
        """(m * block + r,) bounds on what rows read of motions, (A d)_i <= reach_i |d|, and on |B_i'x| in K_r^{-1}."""
        operators = self.operators
        norms = np.repeat(operators.block * operators.norm_flexibility, operators.block)
        reach: Floats = np.sqrt(np.concatenate([norms, operators.limit_flexibility]))
        return reach

    @cached_property
    def step(self) -> Floats:
        """(m * block + r,) by which multipliers may follow gradients, alike in a block: 1 / step is to exceed W + C.

        The largest eigenvalue of W + C, its diagonal made one, is that of twenty power iterations, and a tenth more.
        """
        diagonal, block = np.diagonal(self.softness).copy(), self.operators.block
        diagonal[self.norms] = np.repeat(self.operators.blocks(diagonal[self.norms]).max(axis=1), block)
        root, largest = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0
        x = np.random.default_rng(0).standard_normal(len(root))
        for _ in range(20 if len(x) else 0):
            x = root * (self.softness @ (root * x / np.linalg.norm(x)))
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


class Place:
    """Coordinates d of some of the unknowns, G d, of which what holds reads one a row; all other coordinates are free.

    Raises
    ------
    LinAlgError
        A row that holds follows from others.
    """

    def __init__(self, response: Response, held: Ints, some: Ints):
        self.held, self.some, self.anchor = held, some, response.anchor[some]
        # Unknowns that the sets do nothing with are eliminated.
        every = len(some) == len(response.read)
        S = response.stiffness if every else np.linalg.inv(restricted(response.flexibility, some))
        A = response.rows if every else sp.csr_matrix(response.rows[:, some])
        holding, self.inner, self.G = A[held], S, None
        self.columns: Ints = holding.indices.astype(np.int64)
        """(h,) the coordinates that are held"""
        self.entries: Floats = holding.data
        """(h,) what their rows have there"""
        if (np.diff(holding.indptr) != 1).any() or len(np.unique(self.columns)) < len(self.columns):
            L, Z = held_by(holding)
            self.G = G = sp.csr_matrix(sp.hstack([L.T, Z]))
            A, S, self.columns, self.entries = sp.csr_matrix(A @ G), G.T @ (S @ G), np.arange(len(held)), np.ones(len(held))
        self.S, self.A, self.turned = S, A, response.turned if A is response.rows else sp.csr_matrix(A.T)
        self.free: Ints = np.setdiff1d(np.arange(len(S)), self.columns)

    def beside_free(self, T: sp.csr_matrix, rows: Ints) -> Floats:
        """S + T, these coordinates beside the free ones."""
        S = self.within.copy() if rows is self.free else self.S.take(rows, 0).take(self.free, 1)
        row, column, T = np.full(len(self.S), -1), np.full(len(self.S), -1), T.tocoo()
        row[rows], column[self.free] = np.arange(len(rows)), np.arange(len(self.free))
        i, j = row[T.row], column[T.col]
        there = (i >= 0) & (j >= 0)
        S[i[there], j[there]] += T.data[there]
        return S

    @cached_property
    def within(self) -> Floats:
        """S of the free coordinates."""
        return np.asarray(restricted(self.S, self.free))

    @cached_property
    def anchors(self) -> sp.csr_matrix:
        """The stiffness of the anchors, in the coordinates."""
        anchors, G = sp.diags_array(self.anchor, format="csr"), self.G
        return sp.csr_matrix(anchors if G is None else G.T @ anchors @ G)


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
        concerned = np.repeat(sets.stick | (sets.curvature > 0) | (abs(J) @ sets.act > 0), operators.block)
        held = np.concatenate([response.limits.start + self._hard, np.flatnonzero(stick)])
        self._place = place = response.place(held, np.concatenate([concerned, sets.act]))
        H = sets.curvature[:, None, None] * transverse(sets.direction)
        self._T = sp.csr_matrix(place.turned @ (response.blockwise(H, self._spring) @ place.A))
        if place.anchor.any():
            self._T = sp.csr_matrix(self._T - place.anchors)
        self._share()
        self._pull, self._untie = response.following(sets.direction, J), None
        self._tug = place.turned @ self._pull
        if np.diff(self._tug.indptr)[place.columns].any():
            self._tie()
        h, forces = len(self._hard), place.columns if self._R is not None else place.columns[: len(self._hard)]
        self._P = np.zeros((len(hard), len(place.free)))
        self._P[self._hard] = -self._carried(place.beside_free(self._T, forces), place.entries[: len(forces)])[:h]
        if self._spring.any():
            self._P += (sp.diags_array(self._spring) @ place.A[response.limits])[:, place.free].toarray()

    def _share(self) -> None:
        """x = R f + given (shares of x) of limits that hold, terms that stick and idle rows, f being forces on what holds."""
        idle, h, place = self._sets.idle, len(self._hard), self._place
        self._rows, self._given = np.concatenate([place.held, idle]), np.zeros((len(place.held), 0))
        self._R = None
        if len(idle):
            pushed = place.turned[:, idle].toarray()[place.columns] / place.entries[:, None]
            own = np.concatenate([np.zeros((len(idle), h)), self._sets.shares[:, place.held[h:]]], axis=1)
            chosen = np.linalg.inv(self._sets.shares[:, idle] - own @ pushed)
            self._given = np.concatenate([-pushed @ chosen, chosen])
            self._R = sp.csr_matrix(np.eye(len(self._rows), len(place.held)) - self._given @ own)

    def _carried(self, force: Floats, entries: Floats) -> Floats:
        """R f, of forces (h,) or (h, k) on the coordinates that are held, of such entries."""
        own = (force.T / entries).T
        return own if self._R is None else self._R @ own

    def _tie(self) -> None:
        """p = E^{-1} (what limits would carry alone), where terms that slip pull at what limits hold."""
        E = np.eye(len(self._spring))
        E[self._hard] += self._carried(self._tug.toarray()[self._place.columns], self._place.entries)[: len(self._hard)]
        self._untie = sp.csr_matrix(np.linalg.inv(E))
        self._pull, self._tug = self._pull @ self._untie, self._tug @ self._untie

    def _parts(self) -> tuple[Floats, Floats]:
        """Z'(S + T)Z and Z'B'q J P, which add up to M."""
        place = self._place
        return place.beside_free(self._T, place.free), np.asarray(self._tug[place.free] @ self._P)

    @cached_property
    def _lu(self) -> tuple[Floats, Ints]:
        """The factors of M'."""
        M, followed = self._parts()
        M += followed
        # LAPACK reads columns: it gets the transpose, as it stands.
        lu, pivots, info = lapack.dgetrf(M.T, overwrite_a=True)
        if info > 0 or not np.isfinite(lu).all():
            raise LinAlgError("singular")
        return lu, pivots

    def _opened(self, rest: Floats) -> Floats:
        """M^{-1} rest."""
        return np.asarray(lapack.dgetrs(*self._lu, rest, trans=1)[0]) if len(rest) else rest

    def _passed(self, force: Floats) -> Floats:
        """The force (n,) on all, as one on the coordinates."""
        passed = self._response.passed_on(force)
        on = passed[self._place.some]
        if len(on) < len(passed):
            # As motions, forces on the unknowns would lose the digits that K lacks of definiteness.
            passed[self._place.some] = 0.0
            if passed.any():
                on = on + self._place.inner @ (self._response.flexibility @ passed)[self._place.some]
        return on if self._place.G is None else self._place.G.T @ on

    def solve(self, force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """(d, x) with K d = force - A'x, where the equation of every row misses by `wanted` (N,)."""
        response, sets, h = self._response, self._sets, len(self._hard)
        norms, limits, x = response.norms, response.limits, np.zeros(len(wanted))
        x[self._slips], x[limits] = wanted[self._slips], -self._spring * wanted[limits]
        given, y, d = self._given @ wanted[sets.idle], np.zeros(len(self._place.S)), np.zeros(len(self._place.S))
        d[self._place.columns], rest = wanted[self._place.held] / self._place.entries, self._passed(force - response.act(x))
        if d.any():
            rest -= self._place.S @ d + self._T @ d
        p = x[limits] + self._spring * (self._place.A @ d)[limits]
        p[self._hard] += (self._carried(rest[self._place.columns], self._place.entries) + given)[:h]
        y[self._place.free] = self._opened((rest - self._tug @ p)[self._place.free])
        p += self._P @ y[self._place.free]
        if len(self._rows) > h:
            rest -= self._place.S @ y + self._T @ y + self._tug @ p
        d += y
        x[norms] += sets.bent(self._operators.blocks((self._place.A @ d)[norms])).ravel()
        x += self._pull @ p
        x[limits] = p if self._untie is None else self._untie @ p
        x[self._rows[h:]] = (self._carried(rest[self._place.columns], self._place.entries) + given)[h:]
        d = d if self._place.G is None else self._place.G @ d
        if len(d) == len(force):
            return d, x
        push = force - response.act(x)
        push[response.read[self._place.some]] += self._place.anchor * d
        return self._operators.factor.solve(push), x

    @cached_property
    def gain(self) -> float:
        """c of theorem 2."""
        place = self._place
        if len(place.free) == 0:
            return 0.0
        anchors = place.anchors[place.free][:, place.free].toarray() if place.anchor.any() else 0.0
        # y'My >= y'Ny / 2 where J is small: M + M' - N is definite, which shows in a tenth of the work of the norm.
        twice, followed = self._parts()
        twice += followed
        twice += followed.T - anchors
        if lapack.dpotrf(twice.T, overwrite_a=True)[1] == 0:
            return 2.0
        root, info = lapack.dpotrf(self._parts()[0] + anchors)
        return np.inf if info else float(np.linalg.norm(np.triu(root) @ self._opened(np.triu(root).T)))

    @cached_property
    def _stiffest(self) -> Floats:
        """(u,) bounds on |K_r d| on the coordinates, |d| in K_r and anchors being one."""
        # Schwarz's inequality; anchors pull with no more than the root of their stiffness.
        anchor = self._place.anchors.diagonal() if self._place.anchor.any() else 0.0
        return np.asarray(np.sqrt(np.diagonal(self._place.S)) + np.sqrt(anchor))

    @cached_property
    def _moving(self) -> Floats:
        """(m * block + r,) `reach` of rows, zero for those that what is held does not let move."""
        response, sizes, free = self._response, abs(self._place.A), np.zeros(len(self._place.S))
        free[self._place.free] = 1.0
        beyond = np.ones(len(response.read))
        beyond[self._place.some] = 0.0
        held = (sizes @ free <= FOLLOWS * (sizes @ np.ones(len(free)))) & (response.sizes @ beyond == 0)
        return np.where(held, 0.0, response.reach)

    def answers(self, along: Floats, across: Floats) -> Answers:
        """Bounds on the answers to psi, its parts being at most `along` and `across` (m,), none of what sticks."""
        response, block, h = self._response, self._operators.block, self._sets.curvature
        norms, limits, hard = response.norms, response.limits, len(self._hard)
        sizes, pull, columns, entries = abs(self._place.turned), abs(self._pull), self._place.columns, self._place.entries

        def carried(force: Floats) -> Floats:
            own = force[columns] / np.abs(entries)
            return own if self._R is None else abs(self._R) @ own

        def limited(force: Floats) -> Floats:
            p = np.zeros(len(self._spring))
            p[self._hard] = carried(force)[:hard]
            return p

        # A term moves if one of its rows does.
        phi = self._operators.blocks(self._moving[norms]).max(axis=1)
        chi = np.minimum(phi, 1.0 / np.sqrt(np.where(h > 0, h, np.inf)), where=h > 0, out=phi.copy())
        x = np.zeros(len(response.reach))
        x[norms] = psi = np.repeat(np.hypot(along, across), block)
        tied = lengths(self._operators.blocks((pull @ limited(sizes @ x))[norms]))
        energy = self.gain * float(response.reach[norms][::block] @ tied + phi @ along + chi @ across)
        excess = self._moving[limits] * energy
        x[norms], x[limits] = psi + np.repeat(h * chi * energy, block), self._spring * excess
        force = self._stiffest * energy + sizes @ x
        forces = limited(force) + self._spring * excess
        held = np.zeros(len(x))
        held[self._rows] = carried(force + sizes @ (pull @ forces))
        return Answers(
            energy=energy,
            along=phi * energy,
            across=chi * energy,
            excess=excess,
            multipliers=lengths(self._operators.blocks(held[norms])),
            forces=forces if self._untie is None else abs(self._untie) @ forces,
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

    @staticmethod
    def none(r: int, m: int) -> Answers:
        """The answers to no psi, of m terms and r limits."""
        return Answers(0.0, np.zeros(m), np.zeros(m), np.zeros(r), np.zeros(m), np.zeros(r))
