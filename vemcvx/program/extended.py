"""Residuals in extended precision: what is left of f - K y when almost everything cancels.

On x86 a long double has 64 bits of mantissa against 53; where it is no longer than a double, the rounding unit
says so and nothing else changes. A product costs about as much as one solve with the factors.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats

# Rows at a time: their products, 16 bytes each, then stay in a second-level cache, which halves the time.
CHUNK = 2048


def residual(force: Floats, K: sp.csr_matrix, y: Floats, pulled: Floats) -> Floats:
    """force - pulled - K y, (n,), rounded to double once, at the end."""
    n = len(y)
    r = np.empty(n)
    for start in range(0, n, CHUNK):
        stop = min(start + CHUNK, n)
        first, last = K.indptr[start], K.indptr[stop]
        products = K.data[first:last].astype(np.longdouble)
        products *= y[K.indices[first:last]]
        starts = K.indptr[start:stop] - first
        filled = np.diff(K.indptr[start : stop + 1]) > 0
        sums = np.zeros(stop - start, dtype=np.longdouble)
        if len(products):
            sums[filled] = np.add.reduceat(products, starts[filled])
        r[start:stop] = force[start:stop].astype(np.longdouble) - pulled[start:stop] - sums
    return r
