"""Matrices that are multiplied by and not formed: each is the dense one, to rounding."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from vemcvx.arrays import EPS
from vemcvx.linear import Congruent, Elsewhere, residual, sizes

N = 40


class There(Elsewhere):
    """A matrix of which only this class has the entries."""

    def __init__(self, K):
        self.shape, self._K = K.shape, K

    def __matmul__(self, x):
        return self._K @ x

    def diagonal(self):
        return self._K.diagonal()

    def sizes(self, x):
        return abs(self._K) @ x

    def residual(self, force, y, held):
        return residual(force, self._K, y, held)

    def whole(self):
        return self._K


@pytest.fixture(scope="module")
def K():
    rng = np.random.default_rng(0)
    A = sp.random_array((N, N), density=0.2, random_state=rng)
    return sp.csr_matrix(A @ A.T - sp.diags_array(rng.uniform(1.0, 2.0, N)))


def made(K, elsewhere):
    """K scaled, stiffened and restricted, and bordered; and the same in dense arrays."""
    rng = np.random.default_rng(1)
    D, F = rng.uniform(0.5, 2.0, N), np.sort(rng.permutation(N)[: N // 2])
    S = np.diag(np.where(np.arange(N) % 3, 0.0, rng.uniform(size=N)))
    whole, dense = Congruent.of(There(K) if elsewhere else K), K.toarray()
    yield whole, dense
    yield whole.scaled(D, 0.25), 0.25 * D[:, None] * dense * D
    yield whole.scaled(D, 0.25) + sp.csr_matrix(S), 0.25 * D[:, None] * dense * D + S
    stiff = (whole + sp.csr_matrix(S)).scaled(D, 3.0), 3.0 * D[:, None] * (dense + S) * D
    yield stiff
    yield stiff[0].principal(F), stiff[1][np.ix_(F, F)]
    P = np.eye(N + 2)[:, 1:-1]
    border = np.zeros((N + 2, N + 2))
    border[0], border[:, 0] = rng.uniform(size=(2, N + 2))
    border = border + border.T
    yield Congruent(sp.csr_matrix(P), whole.K, sp.csr_matrix(border)), P @ dense @ P.T + border


@pytest.mark.parametrize("elsewhere", [False, True])
def test_each_is_the_dense_one(K, elsewhere):
    for one, dense in made(K, elsewhere):
        n = len(dense)
        x = np.random.default_rng(2).normal(size=(n, 3))
        # A sum of n products of at most six factors each.
        rounding = (n + 6) * EPS * (np.abs(dense) @ np.abs(x)).max()
        assert one.shape == dense.shape
        for right in (x[:, 0], x):
            assert np.abs(one @ right - dense @ right).max() <= rounding
        assert np.abs(one.diagonal() - np.diag(dense)).max() <= (n + 6) * EPS * np.abs(dense).max()
        assert np.abs(one.whole().toarray() - dense).max() <= (n + 6) * EPS * np.abs(dense).max()


def test_sizes_bound_those_of_the_entries(K):
    """Of a sum they are the sum of the sizes of both; else they are those of the entries."""
    y = np.abs(np.random.default_rng(3).normal(size=N))
    for one, dense in made(K, True):
        own = np.resize(y, len(dense))
        exact = np.abs(dense) @ own
        assert (abs(one) @ own >= exact * (1 - (N + 8) * EPS)).all()
        if not one.S.nnz:
            assert (abs(one) @ own <= exact * (1 + (N + 8) * EPS)).all()


def test_a_matrix_elsewhere_is_asked_there(K):
    force, y, held = np.random.default_rng(4).normal(size=(3, N))
    assert np.array_equal(residual(force, There(K), y, held), residual(force, K, y, held))
    assert np.array_equal(residual(force, There(K), np.zeros(N), held), force - held)
    assert np.array_equal(sizes(There(K), y), sizes(K, y))
