"""Conjugate gradients with smoothed aggregation from PyAMG, for meshes too large to factorise.

Let K be the stiffness matrix. A multigrid cycle multiplies by a symmetric positive definite matrix M near K^{-1}. No
eigenvalue of MK exceeds 1. Let x approximate K^{-1}b, let rho = b - K x be the residual, and let l > 0 be at most the
lowest eigenvalue of MK. Then K^{-1}b = x + K^{-1}rho and K^{-1} <= M / l, so that certificates can use the bound

    b'K^{-1}b = b'x + x'rho + rho'K^{-1}rho <= b'x + x'rho + rho'M rho / l.
"""

from __future__ import annotations

import importlib.util
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh_tridiagonal
from scipy.sparse.linalg import cg

from vemcvx.base.arrays import EPS, Floats, part
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.linear.factor import Factor, LinearSolver, singular_matrix_error
from vemcvx.linear.superlu import SuperLU

ADVICE = "It suits compressible materials (poisson < 0.49) and cells of good shape; use linear=vx.SuperLU() for others."


@dataclass(frozen=True)
class Iterative(LinearSolver):
    """Multigrid of PyAMG (extra ``multigrid``), for meshes too large to factorise.

    Use `Iterative` for large bodies with few contact nodes. Every unknown of contact and friction costs one solve
    before the first step. `Iterative` does not accept bodies that only friction and contact hold.

    Parameters
    ----------
    tolerance : float
        Relative residual of every solve, between 0 and 1.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.BodyForce(lambda x, t: t + 0 * x))
    >>> history = vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0], linear=vx.Iterative())  # doctest: +SKIP
    """

    tolerance: float = 1e-12
    max_iterations: ClassVar[int] = 200

    def __post_init__(self) -> None:
        part(self.tolerance, type(self).__name__, "tolerance", "a relative residual", "1e-12")

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> IterativeFactor:
        if importlib.util.find_spec("pyamg") is None:
            raise NotAccepted(
                "Iterative: the package pyamg is not installed; pip install 'vemcvx[multigrid]', or use SuperLU()."
            )
        return PyAMGFactor(self, K, near_kernel)


class IterativeFactor(Factor):
    """A matrix K with a multigrid cycle M as preconditioner."""

    exact = False

    def __init__(self, limits: Iterative, K: sp.csr_matrix):
        self._limits, self._K, self._name = limits, K, type(limits).__name__
        self._lowest = bound_lowest_eigenvalue(K, self.cycle, self._name)

    @abstractmethod
    def cycle(self, b: Floats) -> Floats:
        """Return M b, for a symmetric positive definite matrix M."""

    @abstractmethod
    def iterate(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        """Return an approximation of K^{-1} b, and 0 if the residual meets the tolerance."""

    def solve(self, b: Floats) -> Floats:
        if b.ndim == 2:
            return np.column_stack([self.solve(column) for column in b.T]) if b.shape[1] else np.zeros_like(b)
        x, failed = self.iterate(b, self._limits.tolerance)
        if failed:
            left = np.linalg.norm(b - self._K @ x) / np.linalg.norm(b)
            raise SceneError(
                f"{self._name}: {self._limits.max_iterations} iterations left a residual of {left:.1e} instead of "
                f"{self._limits.tolerance:.1e}. {ADVICE}"
            )
        return x

    def energy(self, b: Floats) -> float:
        x = self.iterate(b, 0.1)[0]  # A smaller tolerance would lower the bound by only 1 %.
        left = b - self._K @ x
        return abs(float(b @ x + x @ left + left @ self.cycle(left) / self._lowest))


class PyAMGFactor(IterativeFactor):
    """A matrix K with PyAMG's V-cycle; the coarsest matrix is inverted."""

    def __init__(self, limits: Iterative, K: sp.csr_matrix, near_kernel: Floats | None):
        from pyamg import smoothed_aggregation_solver

        sweeps = [("gauss_seidel", {"sweep": sweep}) for sweep in ("forward", "backward")]
        # PyAMG uses NumPy's global generator. Runs must be repeatable.
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


def bound_lowest_eigenvalue(K: sp.csr_matrix, cycle: Callable[[Floats], Floats], name: str) -> float:
    """Return a lower bound on the eigenvalues of MK, by Lanczos' method in the inner product of M.

    Let xi be the least Ritz value after k steps from a random direction in R^n, and 0 < eps < 1. All eigenvalues are at
    least 1 - (1 - xi) / (1 - eps), except with a probability below p = 1.648 sqrt(n) exp(-sqrt(eps) (2k - 1))
    (Kuczynski and Wozniakowski, SIAM J. Matrix Anal. Appl. 13, 1992, for 1 - MK). Our direction is
    random in the Euclidean norm, so the probability is below p times the root of the condition number of M. We set this
    root to 1e8, and 1e8 p to 1e-9.
    """
    failure = np.log(1.648 * np.sqrt(K.shape[0]) * 1e8 / 1e-9)
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    force, before, low = np.random.default_rng(0).normal(size=K.shape[0]), np.zeros(K.shape[0]), 1.0
    start = float(force @ cycle(force))
    if not start > 0:
        raise singular_matrix_error()
    for k in range(1, 401):
        answer = cycle(force)
        square = float(force @ answer)
        if not square > EPS**2 * start:
            return 0.5 * low  # The Krylov space is complete: `low` is the lowest eigenvalue.
        if k > 1:
            off_diagonal.append(np.sqrt(square))
        now, direction = force / np.sqrt(square), answer / np.sqrt(square)
        force = K @ direction - (off_diagonal[-1] * before if off_diagonal else 0.0)
        diagonal.append(float(direction @ force))
        force, before = force - diagonal[-1] * now, now
        low, high = eigh_tridiagonal(np.array(diagonal), np.array(off_diagonal), eigvals_only=True)[[0, -1]].tolist()
        if low <= 0:
            raise singular_matrix_error()
        if high > 1 + 1e-6:
            raise NotAccepted(f"{name}: the multigrid cycle has an eigenvalue {high:.3g}; error bounds need at most 1.")
        eps = (failure / (2 * k - 1)) ** 2
        if eps < 1 and (bound := 1.0 - (1.0 - low) / (1.0 - eps)) > 0.1 * low:
            return float(bound)
    raise SceneError(
        f"{name}: the multigrid cycle approximates the inverse of this matrix too poorly to bound errors: eigenvalues "
        f"down to {low:.1e} after 400 steps. {ADVICE}"
    )
