"""Dense matrices: Cholesky."""

from __future__ import annotations

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from vemcvx.linear.factor import singular

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class DenseCholesky:
    """K = R'R."""

    def __init__(self, K: Floats):
        try:
            self._factor = sla.cho_factor(K, check_finite=False) if len(K) else None
        except sla.LinAlgError as error:
            raise singular() from error

    def solve(self, b: Floats) -> Floats:
        return b.copy() if self._factor is None else sla.cho_solve(self._factor, b, check_finite=False)

    def within(self, K_FF: Floats, F: Ints) -> DenseCholesky:
        return DenseCholesky(K_FF)
