"""oneMKL's PARDISO: the Cholesky factorisation K = L L', through the package py-mkl-pardiso (extra ``mkl``).

PARDISO's array `perm` selects m unknowns c. With the setting iparm[35] = 2, phase 12 factorises K and computes the
Schur complement S of c. The solution array then begins with the m^2 entries of S. Phase 33 solves K x = b. Phase 333
solves L'x = b, but keeps x_c = b_c.

We use the private class _PardisoSolver, because the public class factorises before `perm` can be set. The setting
iparm[36] is off, because blocks of more than 256 rows with the same pattern crash the process.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from vemcvx.base.arrays import EPS, Floats, Ints, power_of_two
from vemcvx.base.errors import NotAccepted
from vemcvx.linear.factor import SAMPLES, Factor, LinearSolver, singular_matrix_error
from vemcvx.linear.superlu import SuperLU, SuperLUFactor

PACKAGE = "pymklpardiso"
POSITIVE_DEFINITE = 2
"""PARDISO's number for real matrices that are symmetric and positive definite."""


@dataclass(frozen=True)
class Pardiso(LinearSolver):
    """oneMKL's PARDISO (extra ``mkl``; x86-64 on Linux and Windows): a few times as fast as SuperLU, on one thread.

    An installed PARDISO is the default from a thousand unknowns on (:func:`vemcvx.linear.choose_linear`).

    Attributes
    ----------
    largest_in_space : int
        The largest number of unknowns for which PARDISO is the default in space. The factors then take 8 GB.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.BodyForce(lambda x, t: t + 0 * x))
    >>> history = vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0], linear=vx.Pardiso())  # doctest: +SKIP
    """

    eliminates: ClassVar[bool] = True
    orders: ClassVar[bool] = True
    largest_in_space: ClassVar[int] = 450_000

    @staticmethod
    def is_installed() -> bool:
        """Return True if py-mkl-pardiso is installed."""
        return _find_solver_class() is not None

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PardisoFactor:
        return PardisoFactor(K, np.zeros(0, dtype=np.int64))

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[PardisoFactor | SuperLUFactor, Floats]:
        inner = np.delete(np.arange(K.shape[0]), last)
        # PARDISO reads uninitialised memory if the block of the unknowns outside `last` is diagonal.
        if len(last) and all(K[some][:, inner].nnz <= len(some) for some in (inner[:64], inner)):
            return SuperLU().eliminate(K, order, last)
        factor = PardisoFactor(K, last)
        return factor, factor.schur


class PardisoFactor(Factor):
    """The factors of K, and the Schur complement `schur` (m, m) of the unknowns in `last`."""

    def __init__(self, K: sp.csr_matrix, last: Ints):
        n, m, diagonal = K.shape[0], len(last), K.diagonal()
        # PARDISO crashes the process if an entry of the diagonal is missing.
        if not (diagonal > 0).all():
            raise singular_matrix_error()
        self.unit = float(power_of_two(diagonal.max(initial=0.0)))
        self._pardiso = _create_solver(K, last, self.unit)
        # The array `own` begins with S, and S has the unknowns in ascending order.
        own = np.zeros((n, max(1, -(-m * m // max(n, 1)))), order="F")
        try:
            if n > 0:
                self._pardiso.run_phase_into(12, np.zeros_like(own, order="F"), own)
            S = own.ravel(order="F")[: m * m].reshape(m, m)
            rank = np.argsort(np.argsort(last))
            S = S[np.ix_(rank, rank)]
        except RuntimeError as error:
            raise singular_matrix_error() from error
        upper, info = dpotrf(S.T, lower=0, clean=0) if m else (S, 0)
        if info > 0:
            raise singular_matrix_error()
        self.schur: Floats = self.unit * S
        # K is singular if EPS K_ii (K^{-1})_ii is large.
        z = np.random.default_rng(0).standard_normal((SAMPLES, n)).T
        z[last] = solve_triangular(upper, z[last], check_finite=False) if m else z[last]
        x = self._run(333, z)  # The mean of x_i^2 is `self.unit` times (K^{-1})_ii.
        if (EPS * diagonal * np.einsum("ij,ij->i", x, x) >= 0.1 * SAMPLES * self.unit).any():
            raise singular_matrix_error()

    def solve(self, b: Floats) -> Floats:
        return self._run(33, b) / self.unit

    def _run(self, phase: int, b: Floats) -> Floats:
        b = np.asfortranarray(b, dtype=float)
        x = np.zeros_like(b)
        if b.any():
            self._pardiso.run_phase_into(phase, b, x)
        return x


def _find_solver_class() -> Any:
    with suppress(ImportError):
        return getattr(import_module(PACKAGE), "_PardisoSolver", None)
    return None


def _create_solver(K: sp.csr_matrix, last: Ints, unit: float) -> Any:
    """Return a solver of py-mkl-pardiso that holds the upper triangle of K / unit."""
    if (kind := _find_solver_class()) is None:
        raise NotAccepted(
            "Pardiso: the package py-mkl-pardiso (0.0.6 or later, below 0.1) is not installed; pip install "
            "'vemcvx[mkl]' (x86-64 on Linux and Windows), or use SuperLU()."
        )
    n = K.shape[0]
    if n == 0:
        return None
    if not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    upper = K.indices >= np.repeat(np.arange(n, dtype=K.indices.dtype), np.diff(K.indptr))
    solver = kind(POSITIVE_DEFINITE, 0)
    # iparm[0]: no default settings. [1]: nested dissection. [23]: factorisation in two levels. [34]: indices from zero.
    settings = {0: 1, 1: 2, 23: 1, 34: 1}
    if len(last):
        settings[35] = 2
    for number, value in settings.items():
        solver.set_iparm(number, value)
    ia = np.append(0, np.cumsum(upper))[K.indptr].astype(np.int64)
    solver.set_pattern(ia=ia, ja=K.indices[upper].astype(np.int64), n=n)
    if len(last):
        chosen = np.zeros(n, dtype=np.int64)
        chosen[last] = 1
        solver.set_perm(chosen)
    solver.set_values(K.data[upper] / unit)
    return solver
