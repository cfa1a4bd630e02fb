"""Dense matrices: Cholesky."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from vemcvx.arrays import Floats, Ints
from vemcvx.linear.factor import Factor, Matrix, singular


class DenseCholesky(Factor):
    """K = R'R."""

    _upper: Floats

    def __init__(self, K: Floats):
        # LAPACK without SciPy's checks: they take longer than factorising 100 unknowns.
        self._upper, info = dpotrf(K, lower=0, clean=0) if len(K) else (K, 0)
        if info > 0:
            raise singular()

    def solve(self, b: Floats) -> Floats:
        return dpotrs(self._upper, b, lower=0)[0] if len(self._upper) else b.copy()

    def within(self, K_FF: Matrix, F: Ints) -> DenseCholesky:
        return DenseCholesky(K_FF if isinstance(K_FF, np.ndarray) else K_FF.toarray())
