"""Products with K a part of its rows at a time."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

from vemcvx.arrays import EPS, SOME
from vemcvx.linear.products import residual, sizes

pytestmark = pytest.mark.arithmetic
ROWS = 2 * SOME + 3


@pytest.fixture(scope="module")
def K():
    rng, ends = np.random.default_rng(0), sp.csr_matrix(([1.0, 1.0], ([0, ROWS - 1], [ROWS - 1, 0])), (ROWS, ROWS))
    bands = sp.diags_array(list(rng.normal(size=(3, ROWS))), offsets=[-1, 0, 1], shape=(ROWS, ROWS))
    return sp.csr_matrix(bands + ends)


def test_sizes_are_those_of_all_of_k_to_the_bit(K):
    y = np.random.default_rng(1).normal(size=ROWS)
    assert np.array_equal(sizes(K, y), abs(K) @ np.abs(y))


def test_residuals_are_rounded_once(K):
    """Of sums that cancel: exact ones by fractions, in rows at both ends of each part."""
    y, held = np.random.default_rng(2).normal(size=(2, ROWS))
    force = K @ y + held
    found, size = residual(force, K, y, held), np.abs(force) + np.abs(held) + abs(K) @ np.abs(y)
    for i in (0, 1, SOME - 1, SOME, 2 * SOME - 1, 2 * SOME, ROWS - 1):
        row = K[[i]]
        terms = (Fraction(a) * Fraction(y[j]) for j, a in zip(row.indices.tolist(), row.data.tolist(), strict=True))
        exact = Fraction(force[i]) - Fraction(held[i]) - sum(terms)
        # Six terms at most, rounded as long doubles are, and the sum as a double is.
        allowed = 6 * float(np.finfo(np.longdouble).eps) * size[i] + EPS * abs(float(exact))
        assert abs(float(Fraction(found[i]) - exact)) <= allowed
