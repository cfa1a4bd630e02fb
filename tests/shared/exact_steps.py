"""One step of backward Euler, solved in fixed-point numbers with 512 fractional bits.

This module poses the program of a step again, without rounding. Unknowns are the increment d, the multipliers lam of
norm terms B d - b, and the pressures p of limits D d <= e. The sets of sticking terms, slipping terms and active limits
determine a linear system,

    K d + B'lam + D'p = g,    B_i d = b_i  or  lam_i = +-w_i(p),    p_j = 0  or  D_j d - c_j p_j = e_j,

with the stiffness K, load g, weights w and compliances c. Iterative refinement reduces the residual below 1e-60. A
primal-dual active set method corrects the sets until every inequality holds to 1e-48. If sets repeat, the method
changes one member of a set at a time (Murty 1974). With weights that do not depend on p, the solution is unique in the
seminorm of K.

All equations are scaled by powers of two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

BITS = 512
ONE = 1 << BITS
SHARP = ONE >> 200
"""Residuals below this number, 6e-61, count as zero."""
TIGHT = ONE >> 160
"""Allowed violation of inequalities, 7e-49."""
MOST_SETS = 400
STICKS = 0


def fixed(values):
    """Convert doubles to fixed-point numbers, which are integers in units of 2^-BITS."""
    values = np.asarray(values, dtype=float)
    mantissa, exponent = np.frexp(values)
    whole, exponent = (mantissa * 2.0**53).astype(np.int64), exponent + (BITS - 53)
    out = np.empty(values.size, dtype=object)
    for i, (m, e) in enumerate(zip(whole.ravel().tolist(), exponent.ravel().tolist(), strict=True)):
        out[i] = m << e if e >= 0 else m >> -e
    return out.reshape(values.shape)


def floats(values):
    """Convert an array of fixed-point numbers to doubles."""
    return np.array([np.ldexp(float(v), -BITS) for v in np.ravel(values)]).reshape(np.shape(values))


class Matrix:
    """A sparse matrix with fixed-point entries."""

    def __init__(self, rows, columns, entries, shape):
        order = np.argsort(rows, kind="stable")
        self.rows, self.columns, self.entries, self.shape = rows[order], columns[order], entries[order], shape
        self._starts = np.flatnonzero(np.append(True, self.rows[1:] != self.rows[:-1])) if len(rows) else []

    @classmethod
    def from_matrix(cls, matrix):
        """Return the fixed-point copy of a matrix of doubles."""
        found = sp.coo_matrix(matrix)
        return cls(found.row.astype(int), found.col.astype(int), fixed(found.data), found.shape)

    def __matmul__(self, x):
        out = np.zeros(self.shape[0], dtype=object)
        if len(self.rows):
            sums = np.add.reduceat(self.entries * x[self.columns], self._starts)
            out[self.rows[self._starts]] = [v >> BITS for v in sums]
        return out

    @property
    def T(self):
        return Matrix(self.columns, self.rows, self.entries, self.shape[::-1])

    def whole(self):
        """Return the dense matrix of fixed-point numbers."""
        out = np.zeros(self.shape, dtype=object)
        for i, j, v in zip(self.rows, self.columns, self.entries, strict=True):
            out[i, j] += int(v)
        return out

    def dense(self):
        """Return the dense matrix of doubles."""
        out = np.zeros(self.shape)
        np.add.at(out, (self.rows, self.columns), floats(self.entries))
        return out


def block(parts, shape):
    """Build a matrix from blocks (matrix, first row, first column)."""
    rows = np.concatenate([m.rows + i for m, i, _ in parts])
    columns = np.concatenate([m.columns + j for m, _, j in parts])
    return Matrix(rows, columns, np.concatenate([m.entries for m, _, _ in parts]), shape)


def _multiply(A, B):
    """Return the product of dense fixed-point matrices."""
    return np.dot(A, B) >> BITS


def _project_out(K, N):
    """Return P K P, with the orthogonal projection P onto the complement of the kernel N."""
    gram = [[int(v) for v in row] for row in _multiply(N.T, N)]
    size = max(gram[i][i] for i in range(len(gram))).bit_length() - BITS
    N = N >> (size // 2) if size > 0 else N << (-size // 2)
    gram = _multiply(N.T, N)
    inverse = np.stack([eliminate(gram, one) for one in fixed(np.eye(len(gram)))], axis=1)
    full = K.whole()
    left = _multiply(N, inverse)
    force = _multiply(full, N)
    full = full - _multiply(force, left.T) - _multiply(left, force.T)
    full = full + _multiply(left, _multiply(_multiply(N.T, force), left.T))
    rows, columns = np.indices(K.shape)
    return Matrix(rows.ravel(), columns.ravel(), full.ravel(), K.shape)


def eliminate(matrix, right):
    """Solve a dense fixed-point linear system by elimination."""
    A, x, n = matrix.copy(), right.copy(), len(right)
    pivots, k = [], 0
    for column in range(n):
        i = k + int(np.argmax(np.abs(A[k:, column])))
        if abs(A[i, column]) <= TIGHT:
            continue
        if i != k:
            A[[i, k]], x[[i, k]] = A[[k, i]], x[[k, i]]
        below = k + 1 + np.flatnonzero(A[k + 1 :, column] != 0)
        if len(below):
            factors = np.array([(int(v) << BITS) // int(A[k, column]) for v in A[below, column]], dtype=object)
            A[below, column:] -= np.multiply.outer(factors, A[k, column:]) >> BITS
            x[below] -= (factors * x[k]) >> BITS
        pivots.append(column)
        k += 1
        if k == n:
            break
    if any(abs(int(v)) > TIGHT for v in x[k:]):
        raise Stuck("no solution on these sets")
    found = np.zeros(n, dtype=object)
    for k, column in reversed(list(enumerate(pivots))):
        rest = int((A[k, column + 1 :] * found[column + 1 :]).sum()) >> BITS
        found[column] = ((int(x[k]) - rest) << BITS) // int(A[k, column])
    return found


class Stuck(Exception):
    """Raised if no sets satisfy all conditions."""


@dataclass(frozen=True)
class Step:
    """The exact solution of a step, in scaled fixed-point numbers."""

    d: np.ndarray
    lam: np.ndarray
    p: np.ndarray
    unit: int
    """exponent: the unit of displacements is 2^unit"""
    K: Matrix
    slip_sets: np.ndarray
    acts: np.ndarray

    def distance(self, increment):
        """Return |increment - d|_K for a scaled fixed-point increment."""
        return self.size(increment - self.d)

    def size(self, d):
        square = int(((self.K @ d) * d).sum() >> BITS)
        return float(np.ldexp(np.sqrt(floats(max(square, 0))), self.unit))


class Steps:
    """Steps of a System whose norm terms are absolute values."""

    def __init__(self, system):
        assert system.norms is None or system.norms.block == 1
        self.system, n = system, system.n
        self.power = -(np.frexp(system.K.diagonal())[1] // 2)
        D = sp.diags_array(np.ldexp(1.0, self.power))
        self.K = Matrix.from_matrix(D @ system.K @ D)
        self.C = None if system.damping is None else Matrix.from_matrix(D @ system.damping.C @ D)
        if system.kernel is not None:
            modes = fixed(system.kernel.modes * np.ldexp(1.0, -self.power)[:, None] / np.abs(system.kernel.modes).max())
            self.K = _project_out(self.K, modes)
            self.C = None if self.C is None else _project_out(self.C, modes)
        B = sp.csr_matrix((0, n)) if system.norms is None else system.norms.B
        E = sp.csr_matrix((0, n)) if system.limits is None else system.limits.D
        self.compliance = np.zeros(0) if system.limits is None else system.limits.compliance
        self.sigma, B = _scale_rows(B @ D)
        self.tau, E = _scale_rows(E @ D)
        self.B, self.E = Matrix.from_matrix(B), Matrix.from_matrix(E)

    def step(self, before, s, t, guess, settled=False, weights=None):
        """Return the exact step from the state `before` at the instant s to the instant t.

        `guess` = (d, lam, p), in the package's units, determines the first sets. `weights` replace the weights
        of the system. If `settled`, damping and prescribed slips are left out.
        """
        system, power, norms, limits = self.system, self.power, self.system.norms, self.system.limits
        load = np.asarray(system.load(t), dtype=float)
        motion = system.motion
        still = settled or motion is None
        drags = [np.zeros(system.B.shape[0])] * 2 if still else [motion.prescribed_slip(s), motion.prescribed_slip(t)]
        ground = None if settled or norms is None else norms.ground
        if ground is not None:
            drags = [drag - ground(x) for drag, x in zip(drags, (s, t), strict=True)]
        gap = np.zeros(0) if limits is None else limits.remaining_gap(t)
        a = _choose_unit(load, before, drags[0] - drags[1], guess[0], power)
        y = fixed(np.ldexp(before, -power - a))
        K, g = self.K, fixed(np.ldexp(load, power - a)) - self.K @ y
        if self.C is not None and not settled:
            k = int(fixed(np.array([t]))[0] - fixed(np.array([s]))[0])
            rate = Matrix(self.C.rows, self.C.columns, np.array([(c << BITS) // k for c in self.C.entries]), K.shape)
            K = block([(K, 0, 0), (rate, 0, 0)], K.shape)
            moved = system.damping.motion
            if moved is not None:
                change = [fixed(np.ldexp(moved.dirichlet_force(x), power - a)) for x in (t, s)]
                g = g - np.array([(int(x) << BITS) // k for x in change[0] - change[1]], dtype=object)
        b = fixed(np.ldexp(drags[0], -self.sigma - a)) - fixed(np.ldexp(drags[1], -self.sigma - a))
        e = fixed(np.ldexp(gap, -self.tau - a)) - self.E @ y
        if motion is not None and motion.remaining_gap is not None:
            e = e - fixed(np.ldexp(motion.remaining_gap(t), -self.tau - a))
        soft = fixed(np.ldexp(self.compliance, -2 * self.tau))
        law = self._scale_law(t, weights, a)
        start = (
            fixed(np.ldexp(guess[0], -power - a)),
            fixed(np.ldexp(guess[1], self.sigma - a)),
            fixed(np.ldexp(guess[2], self.tau - a)),
        )
        d, lam, p, slips, acts = _Conditions(K, self.B, self.E, g, b, e, soft, law).solve(start)
        return Step(d, lam, p, a, K, slips, acts)

    def scaled(self, before, after, unit):
        """Return after - before in the units of a step."""
        return fixed(np.ldexp(after, -self.power - unit)) - fixed(np.ldexp(before, -self.power - unit))

    def unscaled(self, d, unit):
        """Convert a scaled fixed-point increment to the package's units."""
        return np.ldexp(floats(d), self.power + unit)

    def _scale_law(self, t, weights, a):
        """Return the scaled w and M of the weights w + M p."""
        norms = self.system.norms
        m, r = self.B.shape[0], self.E.shape[0]
        none = Matrix.from_matrix(sp.csr_matrix((m, r)))
        if norms is None:
            return fixed(np.zeros(0)), none
        if weights is not None or norms.law is None:
            w = norms.weights(t) if weights is None else weights
            return fixed(np.ldexp(w, self.sigma - a)), none
        base = norms.weights(t)
        M = np.column_stack([norms.weights_under(t, one) - base for one in np.eye(r)])
        M = np.ldexp(M, self.sigma[:, None] - self.tau[None, :])
        return fixed(np.ldexp(base, self.sigma - a)), Matrix.from_matrix(sp.csr_matrix(M))


def _scale_rows(matrix):
    """Return the exponents of the row sizes, and the matrix with rows of size one."""
    matrix = sp.csr_matrix(matrix)
    size = abs(matrix).max(axis=1).toarray().ravel() if matrix.shape[0] else np.zeros(0)
    power = np.frexp(size)[1]
    return power, sp.csr_matrix(sp.diags_array(np.ldexp(1.0, -power)) @ matrix)


def _choose_unit(load, before, drag, d, power):
    sizes = [np.ldexp(load, power), np.ldexp(before, -power), drag, np.ldexp(d, -power)]
    top = max(np.abs(x).max(initial=0.0) for x in sizes)
    return int(np.frexp(top)[1])


@dataclass
class _Conditions:
    """The optimality conditions of a step, in scaled fixed-point numbers."""

    K: Matrix
    B: Matrix
    E: Matrix
    g: np.ndarray
    b: np.ndarray
    e: np.ndarray
    soft: np.ndarray
    law: tuple

    def solve(self, start):
        """Return (d, lam, p, slips, acts) that satisfy all conditions."""
        d, lam, p = start
        slips, acts = self._choose_sets(d, lam, p, shift=ONE // 8)
        seen, single, pairs = set(), False, self._find_parallel_rows()
        for _ in range(MOST_SETS):
            slips = self._release_terms(slips, acts, pairs)
            x = self._solve_on_sets(slips, acts)
            d, lam, p = np.split(x, [len(self.g), len(self.g) + len(self.b)])
            next_slips, next_acts = self._correct_sets(d, lam, p, slips, acts)
            wrong = np.flatnonzero(np.append(next_slips != slips, next_acts != acts))
            if len(wrong) == 0:
                return d, lam, p, slips, acts
            key = slips.tobytes() + acts.tobytes()
            single, _ = single or key in seen, seen.add(key)
            if single:
                i, m = wrong[0], len(slips)
                if i < m:
                    slips = np.where(np.arange(m) == i, next_slips, slips)
                else:
                    acts = np.where(np.arange(len(acts)) == i - m, next_acts, acts)
            else:
                slips, acts = next_slips, next_acts
        raise Stuck("the sets cycle")

    def _find_parallel_rows(self):
        """Return (norm term, limit, ratio) for all pairs of rows that contain the same single unknown."""
        rows = []
        for matrix in (self.B, self.E):
            single = np.flatnonzero(np.bincount(matrix.rows.astype(int), minlength=matrix.shape[0]) == 1)
            at = np.searchsorted(matrix.rows, single)
            rows.append(
                {int(i): (int(matrix.columns[k]), int(matrix.entries[k])) for i, k in zip(single, at, strict=True)}
            )
        return [
            (i, j, (b << BITS) // e)
            for i, (column, b) in rows[0].items()
            for j, (other, e) in rows[1].items()
            if column == other and self.soft[j] == 0
        ]

    def _release_terms(self, slips, acts, pairs):
        """Mark terms as slipping if an active limit prescribes a nonzero slip."""
        slips = slips.copy()
        for i, j, ratio in pairs:
            slip = (ratio * int(self.e[j]) >> BITS) - int(self.b[i])
            if acts[j] and slips[i] == STICKS and abs(slip) > TIGHT:
                slips[i] = 1 if slip > 0 else -1
        return slips

    def _compute_weights(self, p):
        w, M = self.law
        return w + M @ p

    def _choose_sets(self, d, lam, p, shift):
        w, s, z = self._compute_weights(p), self.B @ d - self.b, self.E @ d - self.e
        q = np.array([int(x) + (int(y) * shift >> BITS) for x, y in zip(lam, s, strict=True)], dtype=object)
        slips = np.array([0 if abs(x) <= y and y > 0 else (1 if x >= 0 else -1) for x, y in zip(q, w, strict=True)])
        acts = np.array([int(x) + (int(y) * shift >> BITS) > 0 for x, y in zip(p, z, strict=True)])
        return slips.astype(int), acts.astype(bool)

    def _correct_sets(self, d, lam, p, slips, acts):
        """Return the sets with every violation corrected."""
        w, s, z = self._compute_weights(p), self.B @ d - self.b, self.E @ d - self.e
        new, pressed = slips.copy(), acts.copy()
        for i, (x, y, v) in enumerate(zip(lam, s, w, strict=True)):
            if slips[i] == STICKS:
                if abs(x) > v + TIGHT:
                    new[i] = 1 if x > 0 else -1
            elif y * int(slips[i]) < -TIGHT and v > TIGHT:
                new[i] = STICKS
        for j, (x, y) in enumerate(zip(p, z, strict=True)):
            if acts[j] and x < -TIGHT:
                pressed[j] = False
            elif not acts[j] and y > TIGHT:
                pressed[j] = True
        return new, pressed

    def _solve_on_sets(self, slips, acts):
        """Return the refined solution on given sets."""
        matrix, right = self._assemble(slips, acts)
        dense = matrix.dense()
        solve = _factor(dense)
        if solve is None:
            return eliminate(matrix.whole(), right)
        x, last = np.zeros(len(right), dtype=object), None
        for _ in range(200):
            r = right - matrix @ x
            top = max(abs(int(v)) for v in r) if len(r) else 0
            if top <= SHARP:
                return x
            if last is not None and top > last >> 3:
                return eliminate(matrix.whole(), right)
            last, shift = top, top.bit_length() - 1
            unit = np.array([float((int(v) << 60) >> shift) * 2.0**-60 for v in r])
            x = x + np.array([int(v) * (1 << shift) >> BITS for v in fixed(solve(unit))], dtype=object)
        return eliminate(matrix.whole(), right)

    def _assemble(self, slips, acts):
        n, m, r = len(self.g), len(self.b), len(self.e)
        w, M = self.law
        size = n + m + r
        stick, slide = np.flatnonzero(slips == STICKS), np.flatnonzero(slips != STICKS)
        act, open_ = np.flatnonzero(acts), np.flatnonzero(~acts)
        parts = [(self.K, 0, 0), (self.B.T, 0, n), (self.E.T, 0, n + m)]
        parts += [(_select_rows(self.B, stick), n, 0), (_unit_rows(slide, m), n, n)]
        signs = np.array([int(v) for v in slips], dtype=object)
        pressed = Matrix(M.rows, M.columns, -M.entries * signs[M.rows] if len(M.rows) else M.entries, M.shape)
        parts += [(_select_rows(pressed, slide), n, n + m)]
        gives = Matrix(act, act, -self.soft[act], (r, r))
        parts += [(_select_rows(self.E, act), n + m, 0), (gives, n + m, n + m), (_unit_rows(open_, r), n + m, n + m)]
        right = np.concatenate([self.g, np.where(slips == STICKS, self.b, signs * w), np.where(acts, self.e, 0)])
        return block(parts, (size, size)), right


def _select_rows(matrix, rows):
    """Return the matrix with zeros in all rows except `rows`."""
    keep = np.isin(matrix.rows, rows)
    return Matrix(matrix.rows[keep], matrix.columns[keep], matrix.entries[keep], matrix.shape)


def _unit_rows(rows, size):
    return Matrix(rows, rows, np.array([ONE] * len(rows), dtype=object), (size, size))


def _factor(dense):
    """Return a function that solves systems with this matrix of doubles, or None if the matrix is singular."""
    size = np.abs(dense).max(axis=1, initial=0.0)
    row = np.ldexp(1.0, -np.frexp(np.where(size > 0, size, 1.0))[1])
    factors, pivots, info = la.lapack.dgetrf(row[:, None] * dense)
    if info != 0 or np.abs(np.diag(factors)).min(initial=1.0) < 1e-13:
        return None
    return lambda r: la.lapack.dgetrs(factors, pivots, row * r)[0]
