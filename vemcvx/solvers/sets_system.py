"""The system of given sets: what sticks, what slips and where to, which limits act.

With terms |B_i d - b_i| of multipliers lam_i, limits D d - e of forces p, slipping directions q_i of curvatures h_i,
and weights w(p) = w_0 + J (p - p_0), find d, lam and p with K d = g - B'lam - D'p and

    s_i = 0  on sticking terms,           lam_i = q_i w_i(p) + h_i (I - q_i q_i') s_i  on slipping ones,    s = B d - b,
    z_j = c_j p_j  on acting limits,      p_j = 0  on the others,                                           z = D d - e.

The unknowns that no row reads are eliminated: S is K of the others, or, where most limits are open, of those that the
sets do something with. In coordinates of which sticking terms and acting bounds read one a row (:class:`Place`), these
are held, and all others are the motions y. Let T = B'hB - with h_i (I - q_i q_i') in its blocks - and D'D / c of soft
limits that act. A row that holds carries the force that is left on its coordinate. So the forces of limits are affine
in y, with the derivative P = L^{-1} (D / c - (S + T)), of the rows of limits, and L = I + B'q J of these rows, where
terms that slip pull at what limits hold; and y has

    M y = (all known forces on y),        M = S + T + B'q J P  on y,

symmetric but for weights that follow p: as many equations as motions are left, none where all sticks. Where rows read
too many unknowns for dense matrices of these (`Operators.sparse`) nothing is eliminated: S is K, and M is sparse. A
kernel of K needs no care: K_r = K + diag(a), definite by the stiffness a of anchors, stands for K where a factor is
wanted, and T has -a.

If forces -B'psi act on slipping terms, y moves by -M^{-1} B'(psi - q J psi_p), -psi_p = -L^{-1} B'psi being how the
forces of limits change while y is held. With N = S + T + diag(a), which is not less than K, c such that M^{-1} f has at
most c times the norm of f, |M^{-1} f|_N <= c |f| in N^{-1}, and phi_i^2 >= |B_i K_r^{-1} B_i'|, the motion d that
answers |psi_i| <= t_i along q_i and <= u_i across it is bounded by

    |d|_N  <=  E = c sum_i (phi_i (t_i + |q J psi_p|_i) + chi_i u_i),               chi_i = min(phi_i, h_i^{-1/2}),

for B_i d has at most phi_i |d| along q_i, and chi_i |d| across it. Forces of what is held follow from Schwarz's
inequality. The norm of N^{1/2} M^{-1} N^{1/2} is such a c; so is any with y'My >= y'Ny / c for all y, which a
factorisation proves.

Where psi_i may have l_i |g_i| across q_i besides, g_i being what a motion e with |e|_N <= E moves there, the work of
this on y is at most sum_i l_i |g_i| |y_i|, y_i the part of B_i y across q_i. For sum_i h_i |g_i|^2 <= E^2, and likewise
of y, terms with l_i <= r h_i do no more work than r E |y|_N together; of all others each does l_i chi_i^2 E |y|_N. So

    E  <=  c sum_i (phi_i (t_i + |q J psi_p|_i) + chi_i u_i) + c kappa E,     kappa = min (r + sum l_i chi_i^2),

the sum being over terms with l_i > r h_i; psi_p has l_i chi_i E besides, too. Term by term kappa would be a sum over
all of them, which grows with their number.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, lapack, qr, solve_triangular
from scipy.sparse.csgraph import connected_components

from vemcvx.arrays import Bools, Floats, Ints, lengths
from vemcvx.errors import SceneError
from vemcvx.linear import Factor, Matrix, direct_solver, opened
from vemcvx.program.operators import Operators, Rows, product, restricted, transverse
from vemcvx.solvers.newton import FOLLOWS, Sets


class RowsOfTerms(Rows):
    """Rows A of terms and limits, m * block of them of terms, and what matrices of blocks add to a stiffness."""

    def __init__(self, A: sp.csr_matrix, block: int, of_terms: int):
        super().__init__(A)
        self._block, self._of_terms = block, of_terms

    @cached_property
    def pairs(self) -> tuple[Ints, Ints, sp.csr_matrix]:
        """Places (i, j) where A'HA may have entries, H a block a term and limit; and what these are, of H's entries."""
        A, block, m = self.B, self._block, self._of_terms
        row = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
        term = np.where(row < m, row // block, row - m + m // block)
        alike = sp.csr_matrix((np.ones(len(row)), term, np.arange(len(row) + 1)))
        one, other = (alike @ alike.T).nonzero()
        # Entry (k, l) of the block of a term, or the one of a limit.
        entry = np.where(row[one] < m, row[one] * block + row[other] % block, row[one] + m * (block - 1))
        place, slot = np.unique(A.indices[one].astype(np.int64) * A.shape[1] + A.indices[other], return_inverse=True)
        made = sp.csr_matrix(
            (A.data[one] * A.data[other], (slot, entry)), shape=(len(place), A.shape[0] + m * (block - 1))
        )
        return *np.divmod(place, A.shape[1]), made


class Response:
    """The rows A = [B; D] of operators, and how the unknowns that they read answer forces: K_r with all others free."""

    def __init__(self, operators: Operators):
        self.operators, self.A = operators, operators.A
        self.rows = RowsOfTerms(self.A, operators.block, operators.B.shape[0])
        self.norms, self.limits = slice(operators.B.shape[0]), slice(operators.B.shape[0], None)
        self.anchor: Floats = np.zeros(self.A.shape[1]) if operators.anchor is None else operators.anchor
        """(n,) the stiffness of the anchors, without which K_r is K"""
        self.read: Ints = np.arange(self.A.shape[1]) if operators.sparse else operators.read
        self._last: Place | None = None
        self._rooms: dict[str, Floats] = {}

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self.operators.multiplier_force(x[self.norms], x[self.limits])

    def room(self, use: str, rows: int, columns: int) -> Floats:
        """(rows, columns), as yet of no values, in the memory that had the last array of this use.

        Of 3,267 rows each system has four matrices of 20 to 60 MB; fresh memory for them was a tenth of a run's time.
        """
        if use not in self._rooms:
            self._rooms[use] = np.empty(len(self.read) ** 2)
        return self._rooms[use][: rows * columns].reshape(rows, columns)

    def place(self, held: Ints, touched: Bools) -> Place:
        """Coordinates of the unknowns that rows `touched` (N,) read, or of all if these are most, for rows `held` (h,).

        The last are remembered: sets that hold the same are asked for again while directions turn.
        """
        some = self.read
        if 2 * np.count_nonzero(touched) < len(touched):
            few = np.flatnonzero((self.rows.absolute.force_of(touched.astype(float)) > 0) | (self.anchor > 0))
            some = few if 2 * len(few) < len(self.read) else some
        if self._last is None or not (np.array_equal(held, self._last.held) and np.array_equal(some, self._last.some)):
            self._last = None  # Before there is another, lest memory hold two.
            self._last = Place(self, held, some)
        return self._last

    @cached_property
    def _inner(self) -> tuple[Ints, Factor]:
        """The unknowns that no row reads, and a factor of K on them."""
        rest = np.setdiff1d(np.arange(self.A.shape[1]), self.read)
        return rest, self.operators.factor.within(restricted(self.operators.K, rest), rest)

    def passed_on(self, force: Floats) -> Floats:
        """(n,) the force, zero where no row reads, that does as much to the other unknowns as a force (n,) on all.

        As motions, forces on unknowns that no row reads would lose the digits that K lacks of definiteness.
        """
        if len(self.read) == len(force):
            return force
        rest, factor = self._inner
        spread = np.zeros(len(force))
        spread[rest] = factor.solve(force[rest])
        passed: Floats = force - self.operators.K @ spread
        passed[rest] = 0.0
        return passed

    @cached_property
    def stiffness(self) -> Matrix:
        """(u, u) its inverse: K_r of these unknowns, all others being free."""
        K = self.operators.regular.K
        if self.operators.sparse:
            return K
        if len(self.read) == self.A.shape[1]:
            return _dense(K)
        K, (rest, factor) = restricted(K, self.read), self._inner
        coupling = _dense(self.operators.K[rest][:, self.read])
        return _dense(K - coupling.T @ factor.solve(coupling))

    @cached_property
    def reach(self) -> Floats:
        """(m * block + r,) bounds on what rows read of motions, (A d)_i <= reach_i |d|, and on |B_i'x| in K_r^{-1}."""
        operators = self.operators
        norms = np.repeat(operators.block * operators.norm_flexibility, operators.block)
        reach: Floats = np.sqrt(np.concatenate([norms, operators.limit_flexibility]))
        return reach


def unit_rows(A: sp.csr_matrix) -> sp.csr_matrix:
    """G (c, c) with A G = [I, 0], of rows A (h, c) that hold.

    A row that reads an unknown of its own is scaled; the others are reflected, together with those that share unknowns
    with them, and unknowns that none reads follow as they are. LinAlgError where a row follows from others.
    """
    h, c = A.shape
    own, readers = np.diff(A.indptr) == 1, np.bincount(A.indices, minlength=c)
    own[own] = readers[A.indices[A.indptr[:-1][own]]] == 1
    first, shared, unread = A.indptr[:-1][own], np.flatnonzero(~own), np.flatnonzero(readers == 0)
    f = h + len(unread)
    parts = [(A.indices[first], np.flatnonzero(own), 1.0 / A.data[first])]
    parts += [(unread, np.arange(h, f), np.ones(len(unread)))]
    groups = connected_components(abs(A[shared]) @ abs(A[shared]).T, directed=False)[1]
    for group in range(groups.max(initial=-1) + 1):
        rows = shared[groups == group]
        some, k = np.unique(A[rows].indices), len(rows)
        Q, R = qr(A[rows][:, some].toarray().T)
        if k > len(some) or (np.abs(np.diagonal(R)) <= FOLLOWS * np.linalg.norm(R, axis=0)).any():
            raise LinAlgError("singular")
        Q[:, :k] = solve_triangular(R[:k], Q[:, :k].T).T
        columns = np.append(rows, np.arange(f, f + len(some) - k))
        parts.append((np.repeat(some, len(some)), np.tile(columns, len(some)), Q.ravel()))
        f += len(some) - k
    i, j, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    return sp.csr_matrix((values, (i, j)), shape=(c, c))


class Place:
    """Coordinates y of some unknowns d = G y, in which every row that holds reads one coordinate of its own.

    Where every row that holds reads an unknown of its own, the coordinates are the unknowns, and there is no G.
    LinAlgError where a row that holds follows from others.
    """

    def __init__(self, response: Response, held: Ints, some: Ints):
        self.held, self.some, self.anchor, self.G = held, some, response.anchor[some], None
        self._room = response.room
        if len(some) == len(response.read):
            self.inner = response.stiffness
        else:
            among = np.searchsorted(response.read, some)
            self.inner = np.linalg.inv(np.asarray(restricted(response.operators.flexibility, among)))
        """K_r of the unknowns, all others being free"""
        whole = len(some) == response.A.shape[1]
        A = response.A if whole else sp.csr_matrix(response.A[:, some])
        single = (A.indptr[held + 1] - A.indptr[held] == 1).all()
        S, columns = self.inner, A.indices[A.indptr[held]].astype(np.int64) if single else held
        if single and len(np.unique(columns)) == len(columns):
            entries = A.data[A.indptr[held]]
        else:
            self.G = G = unit_rows(A[held])
            A, S, columns, entries = sp.csr_matrix(A @ G), G.T @ (S @ G), np.arange(len(held)), np.ones(len(held))
        own = whole and self.G is None
        self.rows = response.rows if own else RowsOfTerms(A, response.operators.block, response.norms.stop)
        self.norms = response.operators.rows if own else Rows(sp.csr_matrix(A[response.norms]))
        """A and B in the coordinates"""
        if self.anchor.any():
            S = S - self.anchors
        self.S: Matrix = S
        """K of them"""
        self.columns, self.entries = columns, entries
        """(h,) the coordinates that are held, and what the rows that hold them have there"""
        free = np.ones(len(some), dtype=bool)
        free[columns] = False
        self.free: Ints = np.flatnonzero(free)

    @cached_property
    def beside(self) -> Matrix:
        """S, all coordinates beside the free ones."""
        if not isinstance(self.S, np.ndarray):
            return self.S[:, self.free]
        return self.S.take(self.free, 1, self._room("beside", len(self.some), len(self.free)), "clip")

    @cached_property
    def pushing(self) -> sp.csr_matrix:
        """B' on the free coordinates."""
        return self.norms.transposed[self.free]

    @property
    def anchors(self) -> Floats:
        """(c, c) the stiffness of the anchors."""
        return np.diag(self.anchor) if self.G is None else np.asarray((self.G.T * self.anchor) @ self.G.toarray())

    def beside_free(self, T: Floats | None, rows: Ints, use: str) -> Matrix:
        """S + T, these coordinates beside the free ones, of the entries that T has at the places of `rows.pairs`.

        It stands in the memory of the last that had this use.
        """
        S: Matrix
        if isinstance(self.beside, np.ndarray):
            S = self.beside.take(rows, 0, self._room(use, len(rows), len(self.free)), "clip")
        else:
            S = self.beside[rows]
        if T is not None:
            i, j, _ = self.rows.pairs
            row, column = np.full((2, len(self.some)), -1)
            row[rows], column[self.free] = np.arange(len(rows)), np.arange(len(self.free))
            i, j = row[i], column[j]
            there = (i >= 0) & (j >= 0)
            if isinstance(S, np.ndarray):
                S[i[there], j[there]] += T[there]
            else:
                S = S + sp.csr_matrix((T[there], (i[there], j[there])), shape=S.shape)
        return S


class SetsSystem:
    """The system of some sets, reduced to the motions y that they leave, and factorised once it is solved.

    Its matrices stand in the memory of the last one of the same response, which is no longer solved with. LinAlgError
    where it is singular: the sets hold too little, or hold something twice.
    """

    def __init__(self, operators: Operators, sets: Sets, J: Rows, response: Response):
        self._operators, self._response, self._sets = operators, response, sets
        self._slope: Floats | sp.csr_matrix = J.B
        self.J = J
        """the slope (m, r) of the law"""
        self._follow: Callable[[Floats], Floats] = self.J.read
        self._steep: Callable[[Floats], Floats] = self.J.absolute.read
        hard, stick = sets.act & (operators.compliance == 0), np.repeat(sets.stick, operators.block)
        self._spring = np.divide(1.0, operators.compliance, out=np.zeros(len(hard)), where=sets.act & ~hard)
        self._slips, self._hard = np.flatnonzero(~stick), np.flatnonzero(hard)
        stick[sets.idle] = False
        follows = self._steep(sets.act.astype(float)) > 0
        concerned = np.repeat(sets.stick | (sets.curvature > 0) | follows, operators.block)
        held = np.concatenate([response.limits.start + self._hard, np.flatnonzero(stick)])
        self._place = place = response.place(held, np.append(concerned, sets.act))
        self._T: Floats | None = None
        """the entries of T at the places of `rows.pairs`, if there are any"""
        if sets.curvature.any() or self._spring.any():
            blocks = sets.curvature[:, None, None] * transverse(sets.direction)
            self._T = np.asarray(place.rows.pairs[2] @ np.append(blocks, self._spring))
        self._share()
        self._feedback: Floats | None = None
        pulls = (np.abs(sets.direction) * self._steep(np.ones(len(hard)))[:, None]).ravel()
        if place.norms.absolute.force_of(pulls)[place.columns].any():
            self._close_loop(J.B)
        self._reactions = self._forces_of_limits()

    def _forces_of_limits(self) -> Matrix:
        """P (r, y): how the forces of limits follow the motions y, as if nothing pulled at what they hold."""
        place, h = self._place, len(self._hard)
        count = len(place.columns) if self._R is not None else h
        force = place.beside_free(self._T, place.columns[:count], "reactions")
        P: Any = self._carried(force, -place.entries[:count])[:h]
        if h < len(self._spring):
            P = sp.csr_matrix((np.ones(h), (self._hard, np.arange(h))), shape=(len(self._spring), h)) @ P
        if self._spring.any():
            bent = sp.diags_array(self._spring) @ place.rows.B[self._response.limits][:, place.free]
            P = P + (bent.toarray() if isinstance(P, np.ndarray) else bent)
        return P

    def _share(self) -> None:
        """x = R f + given (shares of x) of limits that hold, terms that stick and idle rows, f the force on what holds.

        Without idle rows, which share what others carry, R is one.
        """
        idle, h, place = self._sets.idle, len(self._hard), self._place
        self._rows, self._given, self._R = np.append(place.held, idle), np.zeros((len(place.held), 0)), None
        if len(idle):
            pushed = place.norms.B[idle][:, place.columns].toarray().T / place.entries[:, None]
            own = np.concatenate([np.zeros((len(idle), h)), self._sets.shares[:, place.held[h:]]], axis=1)
            chosen = np.linalg.inv(self._sets.shares[:, idle] - own @ pushed)
            self._given = np.concatenate([-pushed @ chosen, chosen])
            self._R = np.eye(len(self._rows), len(place.held)) - self._given @ own

    def _carried(self, force: Matrix, entries: Floats) -> Any:
        """R f, of forces (h,) or (h, k) on the coordinates that are held, of such entries; they are overwritten."""
        if isinstance(force, np.ndarray):
            own: Any = np.divide(force.T, entries, out=force.T).T
        else:
            own = sp.diags_array(1.0 / entries) @ force
        return own if self._R is None else self._R @ own

    def _close_loop(self, J: sp.csr_matrix) -> None:
        """p = L^{-1} (what limits would carry alone), where terms that slip pull at what limits hold."""
        L, place = np.eye(len(self._spring)), self._place
        pulled = (self._sets.direction[:, :, None] * J.toarray()[:, None, :]).reshape(-1, len(L))
        pulled = (place.norms.B[:, place.columns].T @ pulled).reshape(len(place.columns), len(L))
        L[self._hard] += self._carried(pulled, place.entries)[: len(self._hard)]
        self._feedback = feedback = np.asarray(np.linalg.inv(L))
        self._slope = slope = np.asarray(J @ feedback)
        self._follow, self._steep = slope.__matmul__, np.abs(slope).__matmul__

    def _followed(self, p: Floats) -> Floats:
        """(m * block,) q J p: what multipliers of slipping terms follow of the forces of limits (r,)."""
        followed: Floats = (self._sets.direction * self._follow(p)[:, None]).ravel()
        return followed

    def _pull(self, p: Floats) -> Floats:
        """B'q J p, on the coordinates."""
        return self._place.norms.force_of(self._followed(p))

    def _stiff(self, d: Floats) -> Floats:
        """(S + T) d."""
        place, force = self._place, product(self._place.S, d)
        if self._T is None:
            return force
        read = place.rows.read(d)
        bent = self._sets.bent(self._operators.blocks(read[self._response.norms])).ravel()
        return np.asarray(force + place.rows.force_of(np.append(bent, self._spring * read[self._response.limits])))

    @cached_property
    def _pulled(self) -> Any:
        """B'q J P on y, what M has beside S + T."""
        place, q, pushing = self._place, self._sets.direction, self._place.pushing
        along = pushing.data * q.ravel()[pushing.indices], pushing.indices // q.shape[1], pushing.indptr
        pulling = sp.csr_matrix(along, shape=(len(place.free), len(q)))
        return (pulling @ self._slope) @ self._reactions

    def _motions(self, use: str) -> Any:
        """M, made anew for each use, which overwrites it: another copy of it takes longer than that."""
        M: Any = self._place.beside_free(self._T, self._place.free, use)
        M += self._pulled
        return M

    @cached_property
    def _opened(self) -> Callable[[Floats], Floats]:
        """M^{-1} of forces."""
        M = self._motions("factor")
        if not isinstance(M, np.ndarray):
            with suppress(RuntimeError):
                return opened(sp.csr_matrix(M))
            raise LinAlgError("singular")
        # LAPACK reads columns: these are factors of M'.
        lu, pivots, info = lapack.dgetrf(M.T, overwrite_a=True)
        if info > 0 or not np.isfinite(lu).all():
            raise LinAlgError("singular")
        return lambda rest: np.asarray(lapack.dgetrs(lu, pivots, rest, trans=1)[0])

    def _passed(self, force: Floats) -> Floats:
        """The force (n,) on all, as one on the coordinates."""
        place, others = self._place, self._response.passed_on(force).copy()
        on = others[place.some]
        if len(on) < len(force):
            others[place.some] = 0.0
            if others.any():
                on = on + place.inner @ self._operators.factor.solve(others)[place.some]
        return on if place.G is None else place.G.T @ on

    def solve(self, force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """(d, x) with K d = force - A'x, where the equation of every row misses by `wanted` (N,)."""
        response, sets, place, h = self._response, self._sets, self._place, len(self._hard)
        norms, limits, x = response.norms, response.limits, np.zeros(len(wanted))
        x[self._slips], x[limits] = wanted[self._slips], -self._spring * wanted[limits]
        given, y = self._given @ wanted[sets.idle], np.zeros(len(place.some))
        d = np.zeros(len(place.some))
        d[place.columns], rest = wanted[place.held] / place.entries, self._passed(force - response.act(x))
        if d.any():
            rest = rest - self._stiff(d)
        p = x[limits] + self._spring * place.rows.read(d)[limits]
        p[self._hard] += (self._carried(rest[place.columns], place.entries) + given)[:h]
        if len(place.free):
            y[place.free] = self._opened((rest - self._pull(p))[place.free])
        p += self._reactions @ y[place.free]
        d += y
        if len(self._rows) > h:
            rest = rest - self._stiff(y) - self._pull(p)
        x[norms] += sets.bent(self._operators.blocks(place.norms.read(d))).ravel() + self._followed(p)
        x[limits] = p if self._feedback is None else self._feedback @ p
        x[self._rows[h:]] = (self._carried(rest[place.columns], place.entries) + given)[h:]
        d = d if place.G is None else np.asarray(place.G @ d)
        if len(d) == len(force):
            return d, x
        push = force - response.act(x)
        push[place.some] += place.anchor * d
        return self._operators.factor.solve(push), x

    @cached_property
    def gain(self) -> float:
        """c of theorem 2."""
        place = self._place
        if len(place.free) == 0:
            return 0.0
        anchors = place.anchors[np.ix_(place.free, place.free)] if place.anchor.any() else None
        # y'My >= y'Ny / 2 where J is small: M + M' - N is definite, which shows in a tenth of the work of the norm.
        twice = self._motions("proof")
        twice += self._pulled.T
        if not isinstance(twice, np.ndarray):
            # The norm of an inverse is not at hand; y'My >= y'Ny / c serves for every c.
            stiff = place.beside_free(self._T, place.free, "proof")
            for c in (2.0, 8.0, 32.0):
                with suppress(SceneError):
                    direct_solver(len(place.free)).factorise(sp.csr_matrix(twice + (1.0 - 2.0 / c) * stiff))
                    return c
            return np.inf
        if anchors is not None:
            twice -= anchors
        if lapack.dpotrf(twice.T, lower=1, clean=0, overwrite_a=True)[1] == 0:
            return 2.0
        stiff = place.beside_free(self._T, place.free, "proof")
        if anchors is not None:
            stiff += anchors
        root, info = lapack.dpotrf(stiff)
        return np.inf if info else float(np.linalg.norm(np.triu(root) @ self._opened(np.triu(root).T)))

    def answers(self, along: Floats, across: Floats, lacking: Floats) -> Answers | None:
        """Bounds on the answers to psi of at most `along`, `across` (m,), none of what sticks; None if none is known.

        Across q_i may be `lacking` (m,) times what motions of the energy of the answers move there, besides.
        """
        response, place, block, h = self._response, self._place, self._operators.block, self._sets.curvature
        norms, limits, push, steep = response.norms, response.limits, place.norms.absolute.force_of, self._steep
        moving, phi, chi, root = self._moving
        pulls = lengths(self._sets.direction) * response.reach[norms][::block]
        besides = lacking * chi

        def tied(psi: Floats) -> float:
            return float(pulls @ steep(self._on_limits(push(np.repeat(psi, block)))))

        share = self.gain * (self._bent_by(lacking) + tied(besides))
        if not share < 1.0:
            return None
        pushed = tied(np.hypot(along, across)) + float(phi @ along + chi @ across)
        energy = self.gain * pushed / (1.0 - share)
        psi = np.repeat(np.hypot(along, across + besides * energy), block)
        excess = moving[limits] * energy
        # Of K, curvatures and springs.
        bent = np.append(psi + np.repeat(h * chi * energy, block), self._spring * excess)
        force = root * energy + place.rows.absolute.force_of(bent)
        forces = self._on_limits(force) + self._spring * excess
        held = np.zeros(len(moving))
        followed = np.abs(self._sets.direction) * steep(forces)[:, None]
        held[self._rows] = self._bounded(force + push(followed.ravel()))
        return Answers(
            energy=energy,
            along=phi * energy,
            across=chi * energy,
            excess=excess,
            multipliers=lengths(self._operators.blocks(held[norms])),
            forces=forces if self._feedback is None else abs(self._feedback) @ forces,
        )

    def _bent_by(self, lacking: Floats) -> float:
        """kappa: at most what forces `lacking` (m,) times motions across q are in energy, for motions of norm one."""
        h, alone = self._sets.curvature, lacking * self._moving[2] ** 2
        ratio = np.divide(lacking, h, out=np.where(lacking > 0, np.inf, 0.0), where=h > 0)
        order = np.argsort(-ratio, kind="stable")
        return float((np.append(ratio[order], 0.0) + np.append(0.0, np.cumsum(alone[order]))).min())

    @cached_property
    def _moving(self) -> tuple[Floats, Floats, Floats, Floats]:
        """(m * block + r,) `reach` of rows, zero for those that what is held does not let move; phi, chi (m,); forces.

        The last are what K pulls at coordinates with, by Schwarz's inequality, for motions of energy norm one.
        """
        response, place, sizes = self._response, self._place, self._place.rows.absolute
        free, others = np.zeros(len(place.some)), np.ones(len(response.anchor))
        free[place.free], others[place.some] = 1.0, 0.0
        # By lengths of the rows themselves: of rows that nearly follow from others, those in coordinates are longer.
        own = response.rows.absolute.read
        held = (sizes.read(free) <= FOLLOWS * own(np.ones(len(others)))) & (own(others) == 0)
        moving, h = np.where(held, 0.0, response.reach), self._sets.curvature
        # A term moves if one of its rows does.
        phi = self._operators.blocks(moving[response.norms]).max(axis=1)
        chi = np.minimum(phi, 1.0 / np.sqrt(np.where(h > 0, h, np.inf)), where=h > 0, out=phi.copy())
        root = np.sqrt(place.S.diagonal())
        if place.anchor.any():  # They pull with no more than the root of their stiffness.
            anchors = np.diagonal(place.anchors)
            root = np.sqrt(place.S.diagonal() + anchors) + np.sqrt(anchors)
        return moving, phi, chi, root

    def _bounded(self, force: Floats) -> Floats:
        """Bounds on R f, from bounds on the forces on all coordinates."""
        own: Floats = force[self._place.columns] / np.abs(self._place.entries)
        return own if self._R is None else np.abs(self._R) @ own

    def _on_limits(self, force: Floats) -> Floats:
        """(r,) of these, those of the limits that hold."""
        p = np.zeros(len(self._spring))
        p[self._hard] = self._bounded(force)[: len(self._hard)]
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


def _dense(K: Floats | sp.csr_matrix) -> Floats:
    """The matrix as an array by rows."""
    return np.ascontiguousarray(K if isinstance(K, np.ndarray) else K.toarray())
