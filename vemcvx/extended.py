"""Residuals in extended precision: what is left of f - K y when almost everything cancels.

On x86 a long double has 64 bits of mantissa against 53; where it is no longer than a double, the rounding unit
says so and nothing else changes. A product costs about as much as one solve with the factors.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Floats = NDArray[np.float64]

UNIT = float(np.finfo(np.longdouble).eps)
"""Rounding unit of the sums below: 1.1e-19 on x86."""


def residual(force: Floats, K: sp.csr_matrix, y: Floats, pulled: Floats) -> Floats:
    """force - pulled - K y, (n,), rounded to double once, at the end."""
    products = K.data.astype(np.longdouble)
    products *= y[K.indices]
    filled = np.diff(K.indptr) > 0
    sums = np.zeros(len(y), dtype=np.longdouble)
    sums[filled] = np.add.reduceat(products, K.indptr[:-1][filled]) if len(products) else 0.0
    return (force.astype(np.longdouble) - pulled - sums).astype(float)
