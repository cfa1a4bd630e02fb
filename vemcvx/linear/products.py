"""Products with K: in extended precision, of a K whose rows stand elsewhere, and of what is made of it.

Of a K that is beyond one memory nothing is formed. Scaled, restricted to some unknowns, stiffened by contact, bordered
by what supports hold, it is L K L' + S with an L that has one entry a row at most, and is applied as it is written.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from vemcvx.arrays import SOME, Floats, Ints


class Elsewhere(ABC):
    """A symmetric matrix K (n, n) whose rows stand elsewhere."""

    shape: tuple[int, int]

    @abstractmethod
    def __matmul__(self, x: Floats) -> Floats:
        """K x, of vectors (n,) or columns (n, k)."""

    @abstractmethod
    def diagonal(self) -> Floats:
        """K's diagonal (n,)."""

    @abstractmethod
    def sizes(self, x: Floats) -> Floats:
        """|K| x, K entry by entry, of a vector (n,)."""

    @abstractmethod
    def residual(self, force: Floats, y: Floats, held: Floats) -> Floats:
        """The residual of :func:`residual`, by these products."""

    @abstractmethod
    def whole(self) -> sp.csr_matrix:
        """All of K, here, for what cannot do without."""

    def __abs__(self) -> LinearOperator:
        return LinearOperator(self.shape, matvec=self.sizes, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Congruent:
    """unit L K L' + S (m, m), of which nothing is formed."""

    L: sp.csr_matrix
    """(m, n) with at most one entry a row"""
    K: Any
    """(n, n) sparse matrix, or one that stands elsewhere, or |K| of that"""
    S: sp.csr_matrix
    """(m, m), symmetric"""
    unit: float = 1.0

    @classmethod
    def of(cls, K: sp.csr_matrix | Elsewhere) -> Congruent:
        """K itself."""
        return cls(sp.csr_matrix(sp.eye_array(K.shape[0])), K, sp.csr_matrix(K.shape))

    @property
    def shape(self) -> tuple[int, int]:
        """(m, m)."""
        m, _ = self.S.shape
        return m, m

    def __matmul__(self, x: Floats) -> Floats:
        product: Floats = self.L @ (self.K @ (self.L.T @ x))
        product *= self.unit
        return product + self.S @ x if self.S.nnz else product

    matvec = __matmul__  # so that SciPy's iterations take it

    def __add__(self, added: sp.csr_matrix) -> Congruent:
        return replace(self, S=sp.csr_matrix(self.S + added))

    def __abs__(self) -> Congruent:
        return Congruent(abs(self.L), abs(self.K), abs(self.S), self.unit)

    def diagonal(self) -> Floats:
        """The diagonal (m,)."""
        return self.unit * (self.L.multiply(self.L) @ self.K.diagonal()) + self.S.diagonal()

    def scaled(self, D: Floats, unit: float) -> Any:
        """D (L K L' + S) D times a unit, D diagonal."""
        each = sp.diags_array(D)
        S = sp.csr_matrix(unit * (each @ self.S @ each))
        return replace(self, L=sp.csr_matrix(each @ self.L), S=S, unit=unit * self.unit)

    def principal(self, F: Ints) -> Any:
        """On the unknowns F alone."""
        return replace(self, L=self.L[F], S=self.S[F][:, F])

    def whole(self) -> sp.csr_matrix:
        """All of it, here, for what cannot do without."""
        K = self.K.whole() if isinstance(self.K, Elsewhere) else self.K
        return sp.csr_matrix(self.unit * (self.L @ K @ self.L.T) + self.S)


def residual(force: Floats, K: sp.csr_matrix | Elsewhere, y: Floats, held: Floats) -> Floats:
    """force - held - K y, (k,) or (k, c), in extended precision, rounded to double once; half as dear as a solve.

    K may be k rows of a matrix.
    """
    if not y.any():
        return force - held
    if isinstance(K, Elsewhere):
        return K.residual(force, y, held)
    r, exact = np.empty_like(force), np.atleast_2d(y.T).astype(np.longdouble, order="C")
    each = [np.atleast_2d(one.T) for one in (r, force, held)]
    for part, rows in _in_parts(K, lambda entries: entries.astype(np.longdouble)):
        for left, f, h, x in zip(*each, exact, strict=True):
            left[part] = f[part].astype(np.longdouble) - h[part] - rows @ x
    return r


def sizes(K: sp.csr_matrix | Elsewhere, y: Floats) -> Floats:
    """|K| |y|, (k,) or (k, c), in parts: 0.7 of the time that it takes with all of |K|, and none of the memory."""
    if isinstance(K, Elsewhere):
        return K.sizes(np.abs(y))
    found, size = np.empty((K.shape[0], *y.shape[1:])), np.ascontiguousarray(np.abs(y))
    for part, rows in _in_parts(K, np.abs):
        found[part] = rows @ size
    return found


def _in_parts(
    K: sp.csr_matrix, changed: Callable[[Floats], NDArray[np.floating]]
) -> Iterator[tuple[slice, sp.csr_matrix]]:
    """SOME rows of K at a time: which, and these with their entries changed."""
    for start in range(0, K.shape[0], SOME):
        stop = min(start + SOME, K.shape[0])
        first, last = K.indptr[start], K.indptr[stop]
        entries = changed(K.data[first:last]), K.indices[first:last], K.indptr[start : stop + 1] - first
        yield slice(start, stop), sp.csr_matrix(entries, shape=(stop - start, K.shape[1]))
