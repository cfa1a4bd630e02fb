"""Conjugate gradients with smoothed aggregation from PyAMG, for meshes too large to factorise.

PyAMG aggregates unknowns and smooths the prolongations P from the near-kernel, the rigid motions: without them the
iteration does not converge at 131k unknowns in the plane. The cycle M sweeps Gauss-Seidel forward before and backward
after the coarse correction, whose matrix is Galerkin's, P'KP. So M is symmetric and positive definite, and no
eigenvalue of MK exceeds one. Close to incompressibility (nu > .49) its smallest eigenvalues are too small to be of use.

Contact changes K to K + S on the free unknowns F, S the stiffness of what acts. The cycle of K serves this matrix
badly: it lets go what is held (sixteen corrections in a block of 44,400 unknowns took 641 conjugate gradients). The
coarse matrices are therefore updated. With Q the rows of P that are held and P_F = P - Q,

    P_F'(K + S)P_F = P'KP - X - X' + P_F'S P_F,    X = Q'(KP - 1/2 KQ).

Solves are inexact, so that no certificate may rest on one. With x any approximation of K^{-1}b, rho = b - K x, and
l <= lambda_min(MK),

    b'K^{-1}b = b'x + x'rho + rho'K^{-1}rho <= b'x + x'rho + rho'M rho / l,

because x'Kx = x'(b - rho), and M^{1/2}K M^{1/2} >= l means K^{-1} <= M / l. This holds for every x, and on a principal
part K_FF, stiffened or not, with M_FF, as (K_FF)^{-1} <= (K^{-1})_FF.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh_tridiagonal, pinvh
from scipy.sparse.linalg import LinearOperator, cg

from vemcvx.arrays import EPS, Bools, Floats, Ints, part, spread, whole
from vemcvx.errors import NotAccepted, SceneError
from vemcvx.linear.factor import Cycle, Factor, LinearSolver, Matrix, singular
from vemcvx.linear.products import Congruent, Elsewhere
from vemcvx.linear.superlu import SuperLU

SUITED = (
    "It suits compressible materials (poisson < 0.49), cells of good shape and contact without edges or corners; use "
    "linear=vx.SuperLU() for others."
)


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
        hierarchy = Hierarchy.of(K, near_kernel)
        if not hierarchy.P:  # The pseudo-inverse of a single level would hide that K is singular.
            SuperLU().factorise(K)
        limits = Stopping("Multigrid", self.tolerance, self.max_iterations)
        return WholeFactor(limits, K, hierarchy, lowest_eigenvalue(K, hierarchy.cycle, "Multigrid"))


@dataclass(frozen=True)
class Stopping:
    """The name of a linear solver, the relative residual that its solves are to have, and their most iterations."""

    name: str
    tolerance: float
    max_iterations: int


class Hierarchy:
    """Matrices A from fine to coarse and the prolongations P between them; the coarsest matrix is inverted."""

    def __init__(self, A: list[sp.csr_matrix], P: list[sp.csr_matrix]):
        from pyamg.relaxation.relaxation import gauss_seidel

        self.A, self.P, self._sweep = A, P, gauss_seidel
        # Where all of an aggregate is held its coarse unknowns have no stiffness, and the pseudo-inverse leaves them.
        self._inverse: Floats = pinvh(A[-1].toarray(), check_finite=False)

    @classmethod
    def of(cls, K: sp.csr_matrix, near_kernel: Floats | None) -> Hierarchy:
        """Smoothed aggregation of K."""
        from pyamg import smoothed_aggregation_solver

        # PyAMG draws vectors from the generator that a process shares, for eigenvalues: here the same ones each time.
        # Weights by sums of rows in their place would take a fifth more iterations.
        shared = np.random.get_state()  # noqa: NPY002
        np.random.seed(0)  # noqa: NPY002
        try:
            levels = smoothed_aggregation_solver(K, B=near_kernel, max_coarse=50).levels
        finally:
            np.random.set_state(shared)  # noqa: NPY002
        return cls([sp.csr_matrix(level.A) for level in levels], [sp.csr_matrix(level.P) for level in levels[:-1]])

    def cycle(self, b: Floats, depth: int = 0) -> Floats:
        """K^{-1}b (n,), about: linear, symmetric and positive definite in b."""
        if depth == len(self.P):
            return self._inverse @ b
        A, P, x = self.A[depth], self.P[depth], np.zeros(len(b))
        self._sweep(A, x, b, sweep="forward")
        x += P @ self.cycle(P.T @ (b - A @ x), depth + 1)
        self._sweep(A, x, b, sweep="backward")
        return x

    def within(self, S: sp.csr_matrix, free: Bools) -> Hierarchy:
        """The hierarchy of K + S on the `free` unknowns alone."""
        F, held = np.flatnonzero(free), np.flatnonzero(~free)
        A = [sp.csr_matrix((self.A[0] + S)[F][:, F])]
        if not self.P:
            return Hierarchy(A, [])
        P, rows = self.P[0], self.A[0][held]
        Q, stiff = P[held], np.flatnonzero(free & (np.diff(S.indptr) > 0))
        X, R = Q.T @ (rows @ P - 0.5 * (rows[:, held] @ Q)), P[stiff]
        # A coarse unknown that moves no free one has the stiffness zero, not the rounding of a difference.
        moves = sp.diags_array(np.isin(np.arange(P.shape[1]), P[F].indices).astype(float))
        A.append(sp.csr_matrix(moves @ (self.A[1] - X - X.T + R.T @ (S[stiff][:, stiff] @ R)) @ moves))
        for coarser in self.P[1:]:
            A.append(sp.csr_matrix(coarser.T @ (A[-1] @ coarser)))
        return Hierarchy(A, [sp.csr_matrix(P[F]), *self.P[1:]])


class MultigridFactor(Factor):
    """K with a multigrid cycle M as preconditioner, and a bound from below on the eigenvalues of MK."""

    exact = False

    def __init__(self, limits: Stopping, K: sp.csr_matrix | Congruent | Elsewhere, cycle: Cycle, lowest: float):
        self._limits, self._K, self._lowest = limits, K, lowest
        self._cycle = LinearOperator(K.shape, matvec=cycle, dtype=np.float64)

    def solve(self, b: Floats) -> Floats:
        if b.ndim == 2:
            return np.column_stack([self.solve(column) for column in b.T]) if b.shape[1] else np.zeros_like(b)
        limits = self._limits
        x, missed = self._descended(b, limits.tolerance)
        if missed:
            left = np.linalg.norm(b - self._K @ x) / np.linalg.norm(b)
            raise SceneError(
                f"{limits.name}: {limits.max_iterations} iterations left a residual of {left:.1e}, asked was "
                f"{limits.tolerance:.1e}. {SUITED}"
            )
        return x

    def rough(self, b: Floats) -> Floats:
        return self._descended(b, 0.1)[0]

    def energy(self, b: Floats) -> float:
        """A bound on b'K^{-1}b from above, whatever the tolerance."""
        # Sharper residuals than a tenth change the bound by a hundredth.
        x = self.rough(b)
        left = b - self._K @ x
        return abs(float(b @ x + x @ left + left @ self._cycle.matvec(left) / self._lowest))

    def within(self, K_FF: Matrix, F: Ints) -> MultigridFactor:
        """The cycle for all of K, restricted to F, is a preconditioner there too: symmetric positive definite."""
        n = self._K.shape[0]
        return MultigridFactor(
            self._limits,
            K_FF if isinstance(K_FF, Congruent) else sp.csr_matrix(K_FF),
            lambda b: self._cycle.matvec(spread(b, F, n))[F],
            self._lowest,
        )

    def _descended(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        """An approximation of K^{-1} b, and 0 if it meets the tolerance."""
        most = self._limits.max_iterations
        K: Any = self._K
        found: tuple[Floats, int] = cg(K, b, rtol=tolerance, atol=0.0, maxiter=most, M=self._cycle)
        return found


class WholeFactor(MultigridFactor):
    """The multigrid factor of all of K; its hierarchy also serves K + S on the free unknowns."""

    def __init__(self, limits: Stopping, K: sp.csr_matrix, hierarchy: Hierarchy, lowest: float):
        super().__init__(limits, K, hierarchy.cycle, lowest)
        self._hierarchy = hierarchy

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle:
        hierarchy, F = self._hierarchy.within(S, free), np.flatnonzero(free)
        return lambda b: spread(hierarchy.cycle(b[F]), F, len(b))


def lowest_eigenvalue(K: sp.csr_matrix | Elsewhere, cycle: Cycle, name: str) -> float:
    """A bound from below on the eigenvalues of MK, by Lanczos' method in the inner product of M from a random force.

    After k steps from a direction that is uniformly distributed in n dimensions, the largest Ritz value of a positive
    semidefinite matrix falls short of its largest eigenvalue by more than the part eps with probability less than
    1.648 sqrt(n) exp(-sqrt(eps) (2k - 1)) (Kuczynski and Wozniakowski, SIAM J. Matrix Anal. Appl. 13, 1992). With
    1 - MK, whose smallest Ritz value of MK is xi, this says

        lambda_min(MK) >= 1 - (1 - xi) / (1 - eps).

    The force is uniform but for the condition of M, by whose root, at most 1e8 in double precision, the probability
    grows; eps is taken so that it stays below 1e-9. SceneError where K is not positive definite, or where 400 steps do
    not bound lambda_min within a tenth of xi, because M serves K too badly.
    """
    failure = np.log(1.648 * np.sqrt(K.shape[0]) * 1e8 / 1e-9)
    diagonal: list[float] = []
    beside: list[float] = []
    force, before, low = np.random.default_rng(0).normal(size=K.shape[0]), np.zeros(K.shape[0]), 1.0
    start = float(force @ cycle(force))
    if not start > 0:
        raise singular()
    for k in range(1, 401):
        answer = cycle(force)
        square = float(force @ answer)
        if not square > EPS**2 * start:
            return 0.5 * low  # Every direction has been seen: xi is the lowest eigenvalue, but for rounding.
        if k > 1:
            beside.append(np.sqrt(square))
        now, direction = force / np.sqrt(square), answer / np.sqrt(square)
        force = K @ direction - (beside[-1] * before if beside else 0.0)
        diagonal.append(float(direction @ force))
        force, before = force - diagonal[-1] * now, now
        low, high = eigh_tridiagonal(np.array(diagonal), np.array(beside), eigvals_only=True)[[0, -1]].tolist()
        if low <= 0:
            raise singular()
        if high > 1 + 1e-6:
            raise NotAccepted(
                f"{name}: the cycle has an eigenvalue of {high:.3g}, above 1, so that nothing is bounded."
            )
        eps = (failure / (2 * k - 1)) ** 2
        if eps < 1 and (bound := 1.0 - (1.0 - low) / (1.0 - eps)) > 0.1 * low:
            return float(bound)
    raise SceneError(
        f"{name}: the cycle serves this matrix too badly to bound its errors: eigenvalues down to {low:.1e} after "
        f"400 steps. {SUITED}"
    )
