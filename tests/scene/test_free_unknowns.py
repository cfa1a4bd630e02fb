"""The stiffness on the unknowns that supports leave free."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from vemcvx.scene.pose import _principal


@pytest.mark.parametrize("n", [0, 1, 30])
@pytest.mark.parametrize("density", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("ascending", [True, False])
def test_the_principal_submatrix_is_scipys(n, density, ascending):
    """Rows without entries included, as those of viscosity on a part of the body."""
    rng = np.random.default_rng(n)
    A = sp.csr_matrix(sp.random_array((n, n), density=density, rng=rng))
    for share in (0.0, 0.3, 0.9, 1.0):
        free = np.flatnonzero(rng.random(n) < share)
        free = free if ascending else free[::-1]
        found, wanted = _principal(A, free), sp.csr_matrix(A[free][:, free])
        assert found.has_sorted_indices or not ascending
        for name in ("indptr", "indices", "data") if ascending else ():
            assert np.array_equal(getattr(found, name), getattr(wanted, name))
        assert np.array_equal(found.toarray(), wanted.toarray())
