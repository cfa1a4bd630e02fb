"""oneMKL's PARDISO: the supernodal Cholesky factorisation, through the package py-mkl-pardiso (extra ``mkl``).

PARDISO's array `perm` marks m unknowns c. With the setting iparm[35] = 2, phase 12 factorises all of K = L L', and
returns the Schur complement onto c as m x m numbers at the beginning of the solution array. Phase 33 solves with these
factors; phase 333 substitutes backward, and leaves x_c unchanged. PARDISO orders the unknowns itself, on one thread.

The package's public class factorises before `perm` can be set, so we use its base class, _PardisoSolver. We do not
request blocks of unknowns whose rows have the same pattern (iparm[36]): blocks of more than 256 crash the process.
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

    If it is installed, it is the default from a thousand unknowns on (:func:`vemcvx.linear.choose_linear`).

    Attributes
    ----------
    largest_in_space : int
        In space, this solver is the default up to this number of unknowns; its factors then take 8 GB.

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
        """Return True if the package is installed."""
        return _find_solver_class() is not None

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PardisoFactor:
        return PardisoFactor(K, np.zeros(0, dtype=np.int64))

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[PardisoFactor | SuperLUFactor, Floats]:
        inner = np.delete(np.arange(K.shape[0]), last)
        # If K_ii is diagonal, PARDISO's Schur complement reads uninitialised memory.
        if len(last) and all(K[some][:, inner].nnz <= len(some) for some in (inner[:64], inner)):
            return SuperLU().eliminate(K, order, last)
        factor = PardisoFactor(K, last)
        return factor, factor.schur


class PardisoFactor(Factor):
    """The factors K = L L'; `schur` (m, m) is the Schur complement onto the unknowns `last`, in this order."""

    def __init__(self, K: sp.csr_matrix, last: Ints):
        n, m, diagonal = K.shape[0], len(last), K.diagonal()
        # PARDISO crashes the process if an entry of the diagonal is missing.
        if not (diagonal > 0).all():
            raise singular_matrix_error()
        self.unit = float(power_of_two(diagonal.max(initial=0.0)))
        self._pardiso = _create_solver(K, last, self.unit)
        # PARDISO fills columns of n numbers with the m^2 entries of the Schur complement S, for the sorted `last`.
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
        # K is singular up to rounding if EPS K_ii (K^{-1})_ii is not small. Estimate (K^{-1})_ii from random vectors x
        # whose covariance is `self.unit` times K^{-1}.
        z = np.random.default_rng(0).standard_normal((SAMPLES, n)).T
        z[last] = solve_triangular(upper, z[last], check_finite=False) if m else z[last]
        x = self._run(333, z)
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
    """Return the solver class of the package, or None if it is not installed."""
    with suppress(ImportError):
        return getattr(import_module(PACKAGE), "_PardisoSolver", None)
    return None


def _create_solver(K: sp.csr_matrix, last: Ints, unit: float) -> Any:
    """Return a solver of the package that holds the upper triangle of K / unit."""
    if (kind := _find_solver_class()) is None:
        raise NotAccepted(
            "Pardiso: the package py-mkl-pardiso (0.0.6 or a later 0.0) is not installed; pip install 'vemcvx[mkl]' "
            "(x86-64 on Linux and Windows), or use SuperLU()."
        )
    n = K.shape[0]
    if n == 0:
        return None
    if not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    upper = K.indices >= np.repeat(np.arange(n, dtype=K.indices.dtype), np.diff(K.indptr))
    solver = kind(POSITIVE_DEFINITE, 0)
    # Use our settings in place of the defaults: nested dissection, factorisation in two levels, indices from zero.
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
