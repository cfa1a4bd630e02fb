"""The rows B of a program's terms, which in a contact scene read one unknown each.

Such rows are a selection with coefficients: B d and B'lam are then index operations, a tenth of the cost
of a small sparse product, and a sticking B_i d = b_i holds exactly.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints


class Rows:
    """B (k, n), with B d and B'lam as cheap as its pattern allows."""

    def __init__(self, B: sp.csr_matrix):
        self.B = B
        single = np.diff(B.indptr) == 1
        self.single = single
        """(k,) which rows have one entry"""
        self.exact = single.copy()
        """(k,) which rows have one entry, a power of two: reading them rounds nothing"""
        self.exact[single] = np.abs(np.frexp(B.data[B.indptr[:-1][single]])[0]) == 0.5
        self.columns: Ints | None = None
        """(k,) the unknown that each row reads, if every row reads its own and no other; else None"""
        if single.all() and len(np.unique(B.indices)) == B.shape[0]:
            self.columns = B.indices.astype(np.int64)

    @cached_property
    def _transposed(self) -> sp.csr_matrix:
        return sp.csr_matrix(self.B.T)

    def read(self, d: Floats) -> Floats:
        """B d, (k,)."""
        return self.B @ d if self.columns is None else self.B.data * d[self.columns]

    def force_of(self, lam: Floats) -> Floats:
        """B'lam, (n,): the force of multipliers."""
        if self.columns is None:
            return self._transposed @ lam
        force = np.zeros(self.B.shape[1])
        force[self.columns] = self.B.data * lam
        return force

    def nearest(self, force: Floats, inverse_metric: Floats) -> Floats:
        """The multipliers lam (k,) with B'lam nearest to the force (n,); of those the least, in the metric given."""
        if self.columns is not None:
            own: Floats = force[self.columns] / self.B.data
            return own
        (touched, A), root = self._touching, np.sqrt(inverse_metric)
        least: Floats = root * np.linalg.lstsq(A * root, force[touched], rcond=None)[0]
        return least

    def nearest_within(self, force: Floats, low: Floats, high: Floats) -> Floats:
        """The multipliers lam (k,) between bounds with B'lam nearest to the force (n,)."""
        from scipy.optimize import lsq_linear

        touched, A = self._touching
        # An interval of nothing is refused there.
        free, lam = low < high, low.copy()
        if free.any():
            rest = force[touched] - A[:, ~free] @ low[~free]
            lam[free] = lsq_linear(A[:, free], rest, (low[free], high[free]), method="bvls").x
        return lam

    @cached_property
    def _touching(self) -> tuple[Ints, Floats]:
        """The unknowns that some row reads, and B' on these, dense."""
        touched = np.unique(self.B.indices).astype(np.int64)
        return touched, self.B[:, touched].toarray().T

    @cached_property
    def absolute(self) -> Rows:
        """|B|, entry by entry, for bounds on rounding."""
        return Rows(abs(self.B))
