"""A multigrid cycle for K, and for K + S on some of its unknowns, S the stiffness of what acts at contact.

PyAMG finds the prolongations P by smoothed aggregation. All matrices are Galerkin's, A_1 = P'A P, the smoother is a
Chebyshev polynomial in D^{-1}A, D the diagonal: symmetric and positive definite as long as the spectrum ends where it
is said to.

A cycle for all of K serves K + S on the free unknowns F badly: it lets go what is held (sixteen corrections in a block
of 44,400 unknowns took 641 conjugate gradients with it, however it was scaled, and take 64). Here the coarse matrices
know what is held and what is stiff. With P_F = P - Q, Q the rows of P that are held,

    P_F'(K + S)P_F = P'KP - X - X' + P_F'S P_F,    X = Q'(KP - 1/2 KQ).

Few rows are held, so that this costs a few cycles. On the finest level the spectrum needs no new bound: by Rayleigh's
quotient (D + D_S)^{-1}(K + S) ends where D^{-1}K or D_S^{-1}S does, and S <= q D_S with at most q entries in a row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from vemcvx.arrays import Bools, Floats
from vemcvx.linear.factor import Cycle, DenseCholesky

DEGREE = 2
"""Of the smoother: 1 takes a half more cycles of two thirds the time."""
SMOOTHED = 30.0
"""It serves the upper part of the spectrum, from the end over this."""
BEYOND, SHARP = 1.1, 0.1
"""The end of the spectrum is taken so many times as large as it was found, which is to that part."""
NOTHING = 1e-12
"""Of the largest stiffness of K on the coarsest level: so much is added, as motions of what is all held have none."""


@dataclass(frozen=True, kw_only=True)
class Level:
    """A = K + S with the prolongation P to it from the next one; what is held has the weight zero, and stays zero."""

    K: sp.csr_matrix
    S: sp.csr_matrix | None
    diagonal: Floats
    """Of K"""
    weight: Floats
    """D^{-1}"""
    end: float
    """Of the spectrum of D^{-1}A"""
    P: sp.csr_matrix

    @classmethod
    def of(cls, K: sp.csr_matrix, P: sp.csr_matrix) -> Level:
        diagonal = K.diagonal()
        weight = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
        if not weight.any():
            return cls(K=K, S=None, diagonal=diagonal, weight=weight, end=1.0, P=P)
        root, shape = np.sqrt(weight), K.shape
        scaled = LinearOperator(shape, matvec=lambda v: root * (K @ (root * v)), dtype=np.float64)
        start = np.random.default_rng(0).normal(size=len(root))
        end = float(eigsh(scaled, k=1, which="LA", v0=start, tol=SHARP, return_eigenvectors=False)[0])
        return cls(K=K, S=None, diagonal=diagonal, weight=weight, end=BEYOND * end, P=P)

    def within(self, S: sp.csr_matrix, free: Bools) -> Level:
        """The finest level of K + S on the free unknowns."""
        end = max(self.end, float(np.diff(S.indptr).max(initial=0)))
        return replace(self, S=S, weight=np.where(free, 1.0 / (self.diagonal + S.diagonal()), 0.0), end=end)

    def residual(self, b: Floats, x: Floats) -> Floats:
        """b - A x."""
        left: Floats = b - self.K @ x
        return left if self.S is None else left - self.S @ x

    def smoothed(self, b: Floats, x: Floats | None = None) -> Floats:
        """x after DEGREE steps of Chebyshev's method; from zero, if none is given."""
        begin = self.end / SMOOTHED
        centre, half = 0.5 * (self.end + begin), 0.5 * (self.end - begin)
        step = self.weight * (b if x is None else self.residual(b, x)) / centre
        x = step if x is None else x + step
        rate = half / centre
        for _ in range(DEGREE - 1):
            following = 1.0 / (2.0 * centre / half - rate)
            step = following * rate * step + 2.0 * following / half * (self.weight * self.residual(b, x))
            x, rate = x + step, following
        return x

    def cycle(self, b: Floats, coarser: Cycle) -> Floats:
        """x near K^{-1}b: smoothed, corrected by what the next level makes of the rest, and smoothed again."""
        moves = self.weight > 0
        x = self.smoothed(b)
        left = np.where(moves, self.residual(b, x), 0.0)
        return self.smoothed(b, x + np.where(moves, self.P @ coarser(self.P.T @ left), 0.0))


class Hierarchy:
    """Levels from fine to coarse, the coarsest factorised with `least` on its diagonal."""

    def __init__(self, levels: list[Level], coarsest: sp.csr_matrix, least: float):
        self.levels, self.coarsest, self._least = levels, coarsest, least
        self._factor = DenseCholesky(coarsest.toarray() + least * np.eye(coarsest.shape[0]))

    @classmethod
    def of(cls, K: sp.csr_matrix, near_kernel: Floats | None, coarse: int) -> Hierarchy:
        """Smoothed aggregation of K, with at most `coarse` unknowns on the coarsest level."""
        from pyamg import smoothed_aggregation_solver

        found = smoothed_aggregation_solver(K, B=near_kernel, max_coarse=coarse).levels
        matrices = [sp.csr_matrix(level.A) for level in found]
        levels = [Level.of(A, sp.csr_matrix(level.P)) for A, level in zip(matrices[:-1], found, strict=False)]
        return cls(levels, matrices[-1], NOTHING * float(matrices[-1].diagonal().max()))

    def cycle(self, b: Floats, depth: int = 0) -> Floats:
        """K^{-1}b (n,), about: linear, symmetric and positive definite in b."""
        if depth == len(self.levels):
            return self._factor.solve(b)
        return self.levels[depth].cycle(b, lambda left: self.cycle(left, depth + 1))

    def within(self, S: sp.csr_matrix, free: Bools) -> Hierarchy:
        """The hierarchy of K + S on the `free` unknowns, for forces that vanish on the others."""
        if not self.levels:
            keep = sp.diags_array(free.astype(float))
            return Hierarchy([], sp.csr_matrix(keep @ (self.coarsest + S) @ keep), self._least)
        first = self.levels[0].within(S, free)
        levels, A = [first], self._coarser(S, free)
        for level in self.levels[1:]:
            levels.append(Level.of(A, level.P))
            A = sp.csr_matrix(level.P.T @ (A @ level.P))
        return Hierarchy(levels, A, self._least)

    def _coarser(self, S: sp.csr_matrix, free: Bools) -> sp.csr_matrix:
        """P_F'(K + S)P_F, from P'KP."""
        K, P, held = self.levels[0].K, self.levels[0].P, np.flatnonzero(~free)
        A = self.levels[1].K if len(self.levels) > 1 else self.coarsest
        rows, Q = K[held], P[held]
        X = Q.T @ (rows @ P - 0.5 * (rows[:, held] @ Q))
        stiff = np.flatnonzero(free & (np.diff(S.indptr) > 0))
        R = P[stiff]
        return sp.csr_matrix(A - X - X.T + R.T @ (S[stiff][:, stiff] @ R))
