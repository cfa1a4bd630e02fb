"""The interface of linear solvers: :class:`LinearSolver` makes a :class:`Factor` of K, which solves K x = b.

If the unknowns c come last in K = L L', their Schur complement is S = L_cc L_cc', where L_cc is the last block of L.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints
from vemcvx.base.errors import NotAccepted, SceneError

Matrix = Floats | sp.csr_matrix
"""Matrix of a program: dense if the program is condensed, else sparse."""

SAMPLES = 8
"""Number of samples in estimates of energies."""
CHUNK_SIZE = 2**25
"""Largest number of entries (256 MB) in one batch of right-hand sides."""


class Factor(ABC):
    """A factorised symmetric positive definite matrix K (n, n), which solves K x = b."""

    exact: bool = True
    """True if `solve` is exact up to rounding."""

    @abstractmethod
    def solve(self, b: Floats) -> Floats:
        """Return x with K x = b, for one right-hand side (n,) or for several columns (n, k)."""

    def energy(self, b: Floats) -> float:
        """Return b'K^{-1}b for a force b (n,), or an upper bound if `exact` is False."""
        return abs(float(b @ self.solve(b)))

    def energies_of_columns(self, b: Floats) -> Floats:
        """Return the energy of each column of b (n, k)."""
        if self.exact:
            return np.abs(np.einsum("ij,ij->j", b, self.solve(b)))
        return np.array([self.energy(column) for column in b.T])

    def energies(self, rows: sp.csr_matrix) -> Floats:
        """Return b'K^{-1}b for each row b of a sparse matrix (m, n)."""
        found = [np.zeros(0)]
        for chunk in chunks(*rows.shape):
            dense = rows[chunk].toarray()
            found.append(np.einsum("ij,ji->i", dense, self.solve(np.ascontiguousarray(dense.T))))
        return np.concatenate(found)

    def flexibility(self, some: Ints, n: int) -> Floats:
        """Return the block of K^{-1} for the unknowns in `some` (k,)."""
        found = np.empty((len(some), len(some)))
        for chunk in chunks(len(some), n):
            own = some[chunk]
            unit = np.zeros((n, len(own)))
            unit[own, np.arange(len(own))] = 1.0
            found[:, chunk] = self.solve(unit)[some]
        return found


def chunks(count: int, n: int) -> Iterator[slice]:
    """Split `count` right-hand sides (n,) into slices of at most CHUNK_SIZE entries."""
    together = max(1, CHUNK_SIZE // max(n, 1))
    return (slice(first, first + together) for first in range(0, count, together))


class LinearSolver(ABC):
    """The settings of a linear solver.

    A run factorises K once. With viscosity, a run factorises once for every step length. The run calls `eliminate` if
    `eliminates` is True, else `factorise`.

    Attributes
    ----------
    eliminates : bool
        True if the class computes Schur complements, so that programs are condensed.
    orders : bool
        True if the class orders the unknowns itself, so that `eliminate` needs no order.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> solver: vx.LinearSolver = vx.SuperLU()
    >>> solver.factorise(sp.csr_matrix([[4.0, 2.0], [2.0, 2.0]])).energy(np.array([2.0, 2.0]))
    2.0
    """

    eliminates: ClassVar[bool] = False
    orders: ClassVar[bool] = False

    @abstractmethod
    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> Factor:
        """Factorise K (n, n), symmetric positive definite.

        Parameters
        ----------
        near_kernel : (n, k) array, optional
            Motions of little energy, such as rigid motions, for iterative solvers.

        Returns
        -------
        Factor

        Raises
        ------
        SceneError
            The matrix is singular or indefinite, or an iterative solver does not converge.
        """

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[Factor, Floats]:
        """Factorise K (n, n), symmetric positive definite, and eliminate the unknowns in `last` at the end.

        Parameters
        ----------
        order : (n,) permutation
            An order of elimination with little fill. Ignored if `orders` is True.
        last : (m,) array
            Indices of the unknowns of the Schur complement.

        Returns
        -------
        factor : Factor
            The factor of K, as from `factorise`.
        S : (m, m) array
            Schur complement onto `last`, in the order of `last`, symmetric.

        Raises
        ------
        NotAccepted, SceneError
            The class computes no Schur complements, or the matrix is not positive definite.
        """
        raise NotAccepted(f"linear solver {type(self).__name__}: it computes no Schur complements; use SuperLU().")


def singular_matrix_error() -> SceneError:
    """Return the error for a stiffness matrix with a motion of zero or negative energy."""
    return SceneError(
        "the stiffness matrix is singular or indefinite: some motion of the body has zero or negative energy. "
        "Add supports (Clamp, PrescribedDisplacement, BilateralContact) that prevent it; the K of a System must be "
        "positive definite."
    )
