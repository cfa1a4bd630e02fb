"""Factors of dense matrices."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dlauum, dpotrf, dpotrs, dtrtri

from vemcvx.base.arrays import Floats, Ints
from vemcvx.linear import Factor, singular


class DenseCholesky(Factor):
    """K = R'R of a dense matrix."""

    _upper: Floats

    def __init__(self, K: Floats):
        # LAPACK without SciPy's checks: they take longer than factorising 100 unknowns. It reads columns: as rows of
        # K', which is K, these are copied in half the time that it takes to factorise 256.
        self._upper, info = dpotrf(K.T, lower=0) if len(K) else (K, 0)
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
        if len(self._upper) == 0:
            return np.zeros(rows.shape[0])
        if (np.diff(rows.indptr) == 1).all():
            return rows.data**2 * self._compliance[rows.indices]
        moved = rows @ self._inverse
        return np.einsum("ij,ij->i", moved, moved)

    @cached_property
    def _compliance(self) -> Floats:
        """(n,) the diagonal of K^{-1}."""
        return np.einsum("ij,ij->i", self._inverse, self._inverse)

    @cached_property
    def _inverse(self) -> Floats:
        """R^{-1}, which takes a sixth of the work of solving for as many right sides; zero below the diagonal, as R."""
        return np.asarray(dtrtri(self._upper, lower=0)[0])

    def flexibility(self, some: Ints, n: int) -> Floats:
        if n == 0:
            return np.zeros((0, 0))
        # Zero below the diagonal, as R^{-1} is.
        upper = dlauum(self._inverse, lower=0)[0]
        whole = upper + upper.T
        whole[np.diag_indices(n)] *= 0.5
        return np.asarray(whole if len(some) == n else whole.take(some, 0).take(some, 1))
