"""Conjugate gradients with smoothed aggregation from PyAMG, for meshes too large to factorise.

PyAMG aggregates unknowns and smooths the prolongations P from the near-kernel, the rigid motions. The cycle M sweeps
Gauss-Seidel forward before and backward after the coarse correction, whose matrix is Galerkin's, P'KP. So M is
symmetric and positive definite, and no eigenvalue of MK exceeds one. Close to incompressibility (nu > .49) its smallest
eigenvalues are too small to be of use.

Solves are inexact, so that no certificate may rest on one. With x any approximation of K^{-1}b, rho = b - K x, and
l <= lambda_min(MK),

    b'K^{-1}b = b'x + x'rho + rho'K^{-1}rho <= b'x + x'rho + rho'M rho / l,

because x'Kx = x'(b - rho), and M^{1/2}K M^{1/2} >= l means K^{-1} <= M / l.
"""

from __future__ import annotations

import importlib.util
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh_tridiagonal
from scipy.sparse.linalg import cg

from vemcvx.base.arrays import EPS, Floats, part, whole
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.linear.factor import Factor, LinearSolver, singular
from vemcvx.linear.superlu import SuperLU

SUITED = "It suits compressible materials (poisson < 0.49) and cells of good shape; use linear=vx.SuperLU() for others."


@dataclass(frozen=True)
class Iterative(LinearSolver):
    """PyAMG (extra ``multigrid``): the default for meshes too large to factorise, if it is installed.

    Take it for large bodies with few contacts: every unknown that contact and friction read costs one solve before the
    first step, which a direct solver gets from its factors. Bodies that friction and contact alone hold are refused.
    Certificates take into account that solves are inexact.

    Parameters
    ----------
    tolerance : float
        Residual of every solve, relative to its right side; in (0, 1).
    max_iterations : int
        Largest number of iterations of a solve, at least 1.
    """

    tolerance: float = 1e-12
    max_iterations: int = 200

    def __post_init__(self) -> None:
        name = type(self).__name__
        part(self.tolerance, name, "tolerance", "a relative residual", "1e-12")
        whole(self.max_iterations, name, "max_iterations", "iterations")

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> IterativeFactor:
        if importlib.util.find_spec("pyamg") is None:
            raise NotAccepted(
                "Iterative: the package pyamg is not installed; pip install 'vemcvx[multigrid]', or use SuperLU()."
            )
        return PyAMGFactor(self, K, near_kernel)


class IterativeFactor(Factor):
    """K with a cycle M as preconditioner, and a lower bound of the eigenvalues of MK."""

    exact = False

    def __init__(self, limits: Iterative, K: sp.csr_matrix):
        self._limits, self._K, self._name = limits, K, type(limits).__name__
        self._lowest = lowest_eigenvalue(K, self.cycle, self._name)

    @abstractmethod
    def cycle(self, b: Floats) -> Floats:
        """Return M b (n,), an approximation of K^{-1} b: linear, symmetric and positive definite in b."""

    @abstractmethod
    def iterate(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        """Return an approximation of K^{-1} b (n,), and 0 if its residual meets the tolerance."""

    def solve(self, b: Floats) -> Floats:
        if b.ndim == 2:
            return np.column_stack([self.solve(column) for column in b.T]) if b.shape[1] else np.zeros_like(b)
        x, failed = self.iterate(b, self._limits.tolerance)
        if failed:
            left = np.linalg.norm(b - self._K @ x) / np.linalg.norm(b)
            raise SceneError(
                f"{self._name}: {self._limits.max_iterations} iterations left a residual of {left:.1e}, asked was "
                f"{self._limits.tolerance:.1e}. {SUITED}"
            )
        return x

    def energy(self, b: Floats) -> float:
        x = self.iterate(b, 0.1)[0]  # Smaller residuals would change the bound by a hundredth.
        left = b - self._K @ x
        return abs(float(b @ x + x @ left + left @ self.cycle(left) / self._lowest))


class PyAMGFactor(IterativeFactor):
    """K with PyAMG's V-cycle; the coarsest matrix is inverted."""

    def __init__(self, limits: Iterative, K: sp.csr_matrix, near_kernel: Floats | None):
        from pyamg import smoothed_aggregation_solver

        sweeps = [("gauss_seidel", {"sweep": sweep}) for sweep in ("forward", "backward")]
        # PyAMG draws vectors for eigenvalues from NumPy's global generator: here the same ones each time.
        shared = np.random.get_state()  # noqa: NPY002
        np.random.seed(0)  # noqa: NPY002
        try:
            levels = smoothed_aggregation_solver(
                K, B=near_kernel, presmoother=sweeps[0], postsmoother=sweeps[1], max_coarse=50, coarse_solver="pinv"
            )
        finally:
            np.random.set_state(shared)  # noqa: NPY002
        if len(levels.levels) == 1:  # The pseudo-inverse of a single level would hide that K is singular.
            SuperLU().factorise(K)
        self._cycle = levels.aspreconditioner()
        super().__init__(limits, K)

    def cycle(self, b: Floats) -> Floats:
        return np.asarray(self._cycle.matvec(b))

    def iterate(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        most = self._limits.max_iterations
        found: tuple[Floats, int] = cg(self._K, b, rtol=tolerance, atol=0.0, maxiter=most, M=self._cycle)
        return found


def lowest_eigenvalue(K: sp.csr_matrix, cycle: Callable[[Floats], Floats], name: str) -> float:
    """Return a lower bound of the eigenvalues of MK, by Lanczos' method in the inner product of M from a random force.

    After k steps from a uniformly distributed direction in n dimensions, the largest Ritz value of a positive
    semidefinite matrix falls short of its largest eigenvalue by more than the part eps with probability less than
    1.648 sqrt(n) exp(-sqrt(eps) (2k - 1)) (Kuczynski and Wozniakowski, SIAM J. Matrix Anal. Appl. 13, 1992). For
    1 - MK, with xi the smallest Ritz value of MK, lambda_min(MK) >= 1 - (1 - xi) / (1 - eps). The root of the condition
    of M, at most 1e8, multiplies the probability, because the force is uniform in another inner product; eps keeps it
    below 1e-9. Raise SceneError if K is not positive definite, or if the bound after 400 steps is less than xi / 10.
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
            return 0.5 * low  # The Krylov space is complete: xi is the lowest eigenvalue, but for rounding.
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
            raise NotAccepted(f"{name}: the cycle has an eigenvalue of {high:.3g}: above 1 nothing is bounded.")
        eps = (failure / (2 * k - 1)) ** 2
        if eps < 1 and (bound := 1.0 - (1.0 - low) / (1.0 - eps)) > 0.1 * low:
            return float(bound)
    raise SceneError(
        f"{name}: the cycle serves this matrix too badly to bound its errors: eigenvalues down to {low:.1e} after "
        f"400 steps. {SUITED}"
    )
