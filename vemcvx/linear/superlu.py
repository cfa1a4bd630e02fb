"""SciPy's sparse direct solver, SuperLU, and orders of elimination with little fill."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spilu, splu

from vemcvx.base.arrays import EPS, Floats, Ints
from vemcvx.linear.factor import Factor, LinearSolver, singular_matrix_error


@dataclass(frozen=True)
class SuperLU(LinearSolver):
    """Sparse LU with diagonal pivots. Without Pardiso, SuperLU is the default up to two million unknowns in the plane.

    Attributes
    ----------
    largest_in_space : int
        The largest number of unknowns for which SuperLU is the default in space. The factors then take 8 GB.

    Examples
    --------
    >>> import scipy.sparse as sp
    >>> factor = vx.SuperLU().factorise(sp.csr_matrix([[4.0, 2.0], [2.0, 2.0]]))
    >>> factor.solve(np.array([2.0, 2.0]))
    array([0., 1.])
    """

    eliminates: ClassVar[bool] = True
    largest_in_space: ClassVar[int] = 140_000

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> SuperLUFactor:
        return SuperLUFactor(K)

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[SuperLUFactor, Floats]:
        factor = SuperLUFactor(K, np.concatenate([order[~np.isin(order, last)], last]), len(last))
        return factor, factor.schur


class SuperLUFactor(Factor):
    """Factors of K, and the Schur complement `schur` of the last m unknowns."""

    def __init__(self, K: sp.csr_matrix, order: Ints | None = None, m: int = 0):
        self._K, self._order = K, np.arange(K.shape[0]) if order is None else order
        columns: Literal["MMD_AT_PLUS_A", "NATURAL"] = "MMD_AT_PLUS_A" if order is None else "NATURAL"
        ordered = sp.csc_matrix(K if order is None else K[order][:, order])
        # Symmetric mode halves the time. Without equilibration, powers of two in K do not change rounding errors.
        options = {"SymmetricMode": True, "Equil": False}
        try:
            self._lu = splu(ordered, permc_spec=columns, diag_pivot_thresh=0.0, options=options)
        except RuntimeError as error:
            raise singular_matrix_error() from error
        self.schur = self._schur_complement(m)

    def _schur_complement(self, m: int) -> Floats:
        """Return the Schur complement L_cc U_cc of the last m unknowns c, or raise SceneError.

        K = L D L' is positive definite if and only if all pivots D_ii are positive. So D_ii must exceed the rounding
        error of K_ii.
        """
        L, U, place = self._lu.L, self._lu.U, self._lu.perm_c
        D, diagonal = U.diagonal(), self._K.diagonal()[self._order[np.argsort(place)]]
        if not np.array_equal(self._lu.perm_r, place) or not (EPS * diagonal < D).all():
            raise singular_matrix_error()
        c = place[len(place) - m :]
        S: Floats = (L[:, c][c] @ U[:, c][c]).toarray()
        # SciPy keeps the copies L and U of the factors. Delete the entries to free memory.
        for kept in (L, U):
            kept.data, kept.indices, kept.indptr = kept.data[:0].copy(), kept.indices[:0].copy(), kept.indptr[:1].copy()
        return 0.5 * (S + S.T)

    def solve(self, b: Floats) -> Floats:
        if not b.any():
            return np.zeros_like(b)
        x = np.empty_like(b)
        x[self._order] = self._lu.solve(b[self._order])
        return x


def order_by_minimum_degree(K: sp.csr_matrix) -> Ints:
    """Return an elimination order (n,) of K by minimum degree."""
    # An incomplete factorisation without fill is cheap, and cannot fail with a dominant diagonal.
    pattern = sp.csc_matrix(K, copy=True)
    pattern.data[:] = 1.0
    dominant = pattern + K.shape[0] * sp.eye_array(K.shape[0], format="csc")
    return np.argsort(spilu(dominant, drop_tol=1e6, fill_factor=1, permc_spec="MMD_AT_PLUS_A").perm_c)


def order_by_nested_dissection(graph: sp.csr_matrix, points: Floats) -> Ints:
    """Return an elimination order (n,) of a symmetric matrix with this graph.

    Parts are halved along the longest axis. Vertices of the upper half that have neighbours in the lower half form the
    separator.
    """
    n = len(points)
    part = np.zeros(n, dtype=np.int64)  # one bit per level
    for _ in range((n // 8).bit_length()):  # Halving smaller parts would save no fill.
        order = np.argsort(part, kind="stable")
        starts = np.flatnonzero(np.diff(part[order], prepend=-1))
        number, sizes = np.empty(n, dtype=np.int64), np.diff(starts, append=n)
        number[order] = np.repeat(np.arange(len(starts)), sizes)
        least, most = (extreme.reduceat(points[order], starts) for extreme in (np.minimum, np.maximum))
        axis = np.argmax(most - least, axis=1)
        along, least = points[np.arange(n), axis[number]], least[np.arange(len(axis)), axis]
        cut = along[np.lexsort((along, number))][starts + sizes // 2]
        # Vertices at the cut join the upper half, unless the lower half would be empty.
        part = 2 * part + np.where((cut > least)[number], along >= cut[number], along > cut[number])
    tail, head = graph.tocoo().coords
    differ = part[tail] > part[head]
    _, first = np.frexp((part[tail] ^ part[head])[differ].astype(float))
    height = np.zeros(n, dtype=np.int64)
    np.maximum.at(height, tail[differ], first)
    # Separators come after the parts on both sides.
    return np.lexsort((height, part | ((1 << height) - 1)))
