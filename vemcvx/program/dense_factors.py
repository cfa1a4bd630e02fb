"""Factors of dense matrices."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

from vemcvx.base.arrays import Floats, Ints
from vemcvx.linear import Factor, singular


class DenseCholesky(Factor):
    """K = R'R of a dense matrix, by LAPACK without SciPy's checks: they take longer than 100 unknowns."""

    def __init__(self, K: Floats):
        # K' = K is read by columns, which takes half the time.
        upper, info = dpotrf(K.T, lower=0) if len(K) else (K, 0)
        self._upper: Floats = upper
        if info > 0:
            raise singular()

    def solve(self, b: Floats) -> Floats:
        if len(self._upper) == 0:
            return b.copy()
        # For one right side LAPACK takes the path of many: five times as long at 256 unknowns.
        one = b.ndim == 1
        return dtrsv(self._upper, dtrsv(self._upper, b, trans=1)) if one else dpotrs(self._upper, b, lower=0)[0]

    def energy(self, b: Floats) -> float:
        z = dtrsv(self._upper, b, trans=1) if len(b) else b
        return float(z @ z)

    def energies(self, rows: sp.csr_matrix) -> Floats:
        return np.asarray(rows.multiply(rows @ self._inverse).sum(axis=1)).ravel()

    def flexibility(self, some: Ints, n: int) -> Floats:
        return np.asarray(self._inverse if len(some) == n else self._inverse.take(some, 0).take(some, 1))

    @cached_property
    def _inverse(self) -> Floats:
        """(n, n) K^{-1}, a sixth of the work of solving for as many right sides."""
        if len(self._upper) == 0:
            return self._upper
        upper = np.triu(dpotri(self._upper, lower=0)[0])
        return np.asarray(upper + np.triu(upper, 1).T)
