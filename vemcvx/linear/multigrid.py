"""Conjugate gradients with smoothed aggregation from PyAMG, for meshes too large to factorise.

PyAMG finds the prolongations P by smoothed aggregation. All matrices are Galerkin's, A_1 = P'A P, the smoother is a
Chebyshev polynomial in D^{-1}A, D the diagonal: symmetric and positive definite as long as the spectrum ends where
it is said to. The near-kernel (the rigid motions, three in the plane and six in space) is what makes it converge: 15
iterations to 1e-8 at 131k unknowns in the plane with it, none without; 16 at 44k in space. Close to incompressibility
(nu > .49) it does not, and says so.

A cycle for all of K serves K + S on the free unknowns F badly, S the stiffness of what acts at contact: it lets go what
is held (sixteen corrections in a block of 44,400 unknowns took 641 conjugate gradients with it, and take 64). So the
coarse matrices know what is held and what is stiff. With P_F = P - Q, Q the rows of P that are held,

    P_F'(K + S)P_F = P'KP - X - X' + P_F'S P_F,    X = Q'(KP - 1/2 KQ).

Few rows are held, so that this costs a few cycles. On the finest level the spectrum needs no new bound: by
Rayleigh's quotient (D + D_S)^{-1}(K + S) ends where D^{-1}K or D_S^{-1}S does, and S <= q D_S with at most q
entries in a row.

Its solves are inexact, so no certificate may rest on one. With x any approximation of K^{-1}b, rho = b - K x, M the
multigrid cycle, symmetric positive definite, and l <= lambda_min(MK) a bound on the spectrum from below,

    b'K^{-1}b = b'x + x'rho + rho'K^{-1}rho <= b'x + x'rho + rho'M rho / l,

because x'Kx = x'(b - rho) and M^{1/2}K M^{1/2} >= l is K^{-1} <= M / l. It holds whatever the tolerance of x is; on
a principal part K_FF, stiffened or not, with M_FF, as (K_FF)^{-1} <= (K^{-1})_FF. The bound l is from k steps of
Lanczos' method for MK, whose extreme Ritz values xi lie within the spectrum. Started from a direction that is
uniformly distributed in n dimensions it misses the largest eigenvalue of a positive semidefinite matrix by more
than the part eps with probability < 1.648 sqrt(n) exp(-sqrt(eps) (2k - 1)) (Kuczynski and Wozniakowski, SIAM J.
Matrix Anal. Appl. 13, 1992). Applied to MK and to lambda_max - MK,

    lambda_max <= xi_max / (1 - eps),    lambda_min >= xi_min - eps lambda_max =: l.

The start is a random force: uniform but for the condition of M, by whose root at most (1e8 in double precision) the
probability grows. eps is taken so that it stays below MISSED, and k so that l is at least a tenth of xi_min.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh_tridiagonal
from scipy.sparse.linalg import LinearOperator, cg, eigsh

from vemcvx.arrays import EPS, Bools, Floats, Ints, part, whole
from vemcvx.errors import NotAccepted, SceneError
from vemcvx.linear.factor import Cycle, DenseCholesky, Factor, LinearSolver, Matrix, SuperLU, singular

DEGREE = 2
"""Of the smoother: 1 takes a half more cycles of two thirds the time."""


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
        root = np.sqrt(weight)
        scaled = LinearOperator(K.shape, matvec=lambda v: root * (K @ (root * v)), dtype=np.float64)
        start = np.random.default_rng(0).normal(size=len(root))
        end = float(eigsh(scaled, k=1, which="LA", v0=start, tol=0.1, return_eigenvectors=False)[0])
        return cls(K=K, S=None, diagonal=diagonal, weight=weight, end=1.1 * end, P=P)  # Of what was found to a tenth.

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
        # It serves the upper part of the spectrum, from the end over this.
        begin = self.end / 30.0
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
        # Motions of what is all held have no stiffness.
        return cls(levels, matrices[-1], 1e-12 * float(matrices[-1].diagonal().max()))

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


MISSED = 1e-9
"""Probability, over the random start, that the bound on the spectrum does not hold."""
MOST_LANCZOS = 400
COARSE = 500
"""Nodes of the coarsest level, in the plane; the cost of its inverse grows with their unknowns, three or six each."""


@dataclass(frozen=True)
class Multigrid(LinearSolver):
    """PyAMG (extra ``multigrid``): the default beyond two million unknowns, where it is installed.

    Programs are not condensed: contact is solved matrix-free. Bodies that friction and contact alone hold are not
    taken, and contact on faces that meet, at edges and corners, takes long or is refused.

    Certificates take into account that its solves are inexact.

    Parameters
    ----------
    tolerance : float
        Residual of every solve, relative to its right side; in (0, 1).
    max_iterations : int
        Of every solve, at least 1.
    """

    tolerance: float = 1e-12
    max_iterations: int = 200

    def __post_init__(self) -> None:
        part(self.tolerance, "Multigrid", "tolerance", "a relative residual", "1e-12")
        whole(self.max_iterations, "Multigrid", "max_iterations", "iterations")

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> MultigridFactor:
        if importlib.util.find_spec("pyamg") is None:
            raise NotAccepted(
                "Multigrid: the package pyamg is not installed; pip install 'vemcvx[multigrid]', or use SuperLU()."
            )
        if K.shape[0] <= COARSE:
            # One level only, whose pseudo-inverse would hide that K is singular.
            SuperLU().factorise(K)
        modes = 3 if near_kernel is None else max(3, near_kernel.shape[1])
        coarse = COARSE * 9 // modes**2
        hierarchy = Hierarchy.of(sp.csr_matrix(K), near_kernel, coarse)
        return WholeFactor(self, K, hierarchy, lowest_eigenvalue(K, hierarchy.cycle))


class MultigridFactor(Factor):
    """K with a multigrid cycle M as preconditioner, and a bound from below on the eigenvalues of MK."""

    def __init__(self, settings: Multigrid, K: sp.csr_matrix, cycle: Cycle, lowest: float):
        self._settings, self._K, self._lowest = settings, K, lowest
        self._cycle = LinearOperator(K.shape, matvec=cycle, dtype=np.float64)

    @property
    def exact(self) -> bool:
        return False

    def solve(self, b: Floats) -> Floats:
        if b.ndim == 2:
            return np.column_stack([self.solve(column) for column in b.T]) if b.shape[1] else np.zeros_like(b)
        if not b.any():
            return np.zeros_like(b)
        settings = self._settings
        x, iterations = self._descended(b, settings.tolerance)
        if iterations > 0:
            left = np.linalg.norm(b - self._K @ x) / np.linalg.norm(b)
            raise SceneError(
                f"Multigrid: {settings.max_iterations} iterations left a residual of {left:.1e}, asked was "
                f"{settings.tolerance:.1e}. {SUITED}"
            )
        return x

    def rough(self, b: Floats) -> Floats:
        return self._descended(b, 0.1)[0] if b.any() else np.zeros_like(b)

    def energy(self, b: Floats) -> float:
        """A bound on b'K^{-1}b from above, whatever the tolerance."""
        if not b.any():
            return 0.0
        # Sharper residuals than a tenth change the bound by a hundredth.
        x, _ = self._descended(b, 0.1)
        left = b - self._K @ x
        return abs(float(b @ x + x @ left + left @ (self._cycle.matvec(left)) / self._lowest))

    def within(self, K_FF: Matrix, F: Ints) -> MultigridFactor:
        """The cycle for all of K, restricted to F, is a preconditioner there too: symmetric positive definite."""

        def cycle(b: Floats) -> Floats:
            whole = np.zeros(self._K.shape[0])
            whole[F] = b
            return self._cycle.matvec(whole)[F]

        return MultigridFactor(self._settings, sp.csr_matrix(K_FF), cycle, self._lowest)

    def _descended(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        """An approximation of K^{-1} b, and how many iterations did not suffice for it; 0 if they did."""
        most = self._settings.max_iterations
        found: tuple[Floats, int] = cg(self._K, b, rtol=tolerance, atol=0.0, maxiter=most, M=self._cycle)
        return found


class WholeFactor(MultigridFactor):
    """The multigrid factor of all of K; its hierarchy also serves K + S, with S on some of the unknowns."""

    def __init__(self, settings: Multigrid, K: sp.csr_matrix, hierarchy: Hierarchy, lowest: float):
        super().__init__(settings, K, hierarchy.cycle, lowest)
        self._hierarchy = hierarchy

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle:
        return self._hierarchy.within(S, free).cycle


SUITED = (
    "It suits compressible materials (poisson < 0.49), cells of good shape and contact without edges or corners; use "
    "linear=vx.SuperLU() for others."
)


def lowest_eigenvalue(K: sp.csr_matrix, cycle: Cycle) -> float:
    """A bound from below on the eigenvalues of MK, or SceneError if K is not positive definite or M serves it badly."""
    failure = np.log(1.648 * np.sqrt(K.shape[0]) * 1e8 / MISSED)
    low = high = 1.0
    for k, (low, high) in enumerate(islice(_ritz_values(K, cycle), MOST_LANCZOS), start=1):
        if low <= 0:
            raise singular()
        part = (failure / (2 * k - 1)) ** 2
        if part < 1 and (bound := low - part * high / (1 - part)) > 0.1 * low:
            return float(bound)
    if k < MOST_LANCZOS:
        return 0.5 * low  # Every direction has been seen: these are the eigenvalues, but for rounding.
    raise SceneError(
        f"Multigrid: the cycle serves this matrix too badly to bound its errors: condition {high / low:.1e} after "
        f"{MOST_LANCZOS} steps. {SUITED}"
    )


def _ritz_values(K: sp.csr_matrix, cycle: Cycle) -> Iterator[tuple[float, float]]:
    """The extreme Ritz values of MK after every step of Lanczos' method in the inner product of M."""
    diagonal: list[float] = []
    beside: list[float] = []
    force, before = np.random.default_rng(0).normal(size=K.shape[0]), np.zeros(K.shape[0])
    while True:
        answer = cycle(force)
        square = float(force @ answer)
        if not diagonal:
            start = square
            if not start > 0:
                raise singular()
        elif square > EPS**2 * start:
            beside.append(np.sqrt(square))
        else:
            return
        now, direction = force / np.sqrt(square), answer / np.sqrt(square)
        force = K @ direction - (beside[-1] * before if beside else 0.0)
        diagonal.append(float(direction @ force))
        force, before = force - diagonal[-1] * now, now
        ritz = eigh_tridiagonal(np.array(diagonal), np.array(beside), eigvals_only=True)
        yield float(ritz[0]), float(ritz[-1])
