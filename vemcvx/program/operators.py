"""The matrices that all steps share: K, and the rows of norm terms and limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse.linalg import LinearOperator, lsqr

from vemcvx.base.arrays import (
    Bools,
    Floats,
    Ints,
    as_real_array,
    as_shaped_array,
    as_sparse_matrix,
    brief,
    finite,
    is_whole,
    read_only,
    shape_in_words,
)
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.linear import SAMPLES, Factor, Matrix, SuperLU, singular_matrix_error
from vemcvx.program.certificate import ROUNDED
from vemcvx.program.kernel import add_anchors, choose_anchors

QUADRATIC = "quadratic"
ABSOLUTE_VALUES = "absolute values"
SECOND_ORDER_CONES = "second-order cones"
BOUNDS = "bounds"
SQUARED_POSITIVE_PARTS = "squared positive parts"
FEATURES = frozenset({QUADRATIC, ABSOLUTE_VALUES, SECOND_ORDER_CONES, BOUNDS, SQUARED_POSITIVE_PARTS})

SYMMETRY_TOLERANCE = 1e-10
"""The largest accepted entry of K - K', relative to the largest entry of K."""


def check_symmetric(K: Any, subject: str) -> None:
    """Raise SceneError unless K is square and Kx = K'x for a random x."""
    if K.shape[0] != K.shape[1]:
        raise SceneError(f"{subject}: found a matrix of shape {K.shape}; it must be square.")
    x = np.random.default_rng(0).uniform(-1.0, 1.0, K.shape[0])
    apart, largest = np.abs(K @ x - x @ K), abs(K).max() if K.shape[0] else 0.0
    if (apart > SYMMETRY_TOLERANCE * largest).any():
        i = int(np.argmax(apart))
        raise SceneError(
            f"{subject}: row {i} differs from column {i}; the matrix must be symmetric. For the energy 1/2 y'Ky, give "
            "(K + K.T) / 2."
        )


def as_read_only_rows(raw: Any, subject: str) -> sp.csr_matrix:
    """Convert a matrix into a read-only sparse matrix of finite numbers."""
    matrix = as_sparse_matrix(raw, subject)
    if not matrix.has_canonical_format:  # SciPy sorts entries in place, which fails for read-only arrays.
        matrix = matrix.copy()
        matrix.sum_duplicates()
    read_only(matrix.data)
    return matrix


def as_read_only_symmetric(raw: Any, subject: str) -> Matrix:
    """Convert a symmetric matrix, dense or sparse, into a read-only matrix."""
    if sp.issparse(raw):
        K: Matrix = as_read_only_rows(raw, subject)
    else:
        fixed = isinstance(raw, np.ndarray) and raw.dtype == np.float64 and not raw.flags.writeable
        K = raw if fixed else as_real_array(raw, subject, "a matrix")
        if K.ndim != 2:
            raise SceneError(f"{subject}: found {shape_in_words(K)}; wanted a matrix, dense or sparse.")
        finite(read_only(K), subject)
    check_symmetric(K, subject)
    return K


def whole_blocks(block: Any, rows: int, subject: str) -> int:
    """Return `block`, which must divide the number of rows of B."""
    if not is_whole(block) or block < 1 or rows % block:
        raise SceneError(
            f"{subject}: found B with {rows} rows and block = {brief(block)}; "
            "the number of rows must be a multiple of block=."
        )
    return int(block)


@dataclass(frozen=True, repr=False, eq=False)
class Operators(ArrayRecord):
    """The read-only matrices that all steps of a run share.

    Parameters
    ----------
    K : (n, n) array or sparse matrix
        Symmetric positive definite, or semidefinite with a `kernel`; dense after condensation.
    B : (m * block, n) matrix
        Rows of norm terms. Norm term i has the rows B_i, from i * block to (i + 1) * block - 1, and the slip B_i d.
    block : int
        Number of components of B_i d: 1 for absolute values, more for second-order cones.
    given_factor : Factor, optional
        Factor of K, computed by default.
    kernel : (n, k) array, optional
        The kernel of a semidefinite K, orthonormal (:mod:`vemcvx.program.kernel`).
    D : (r, n) matrix, optional
        Rows of limits; D_j d is the motion towards limit j.
    compliance : (r,) array, optional
        Compliances c_j >= 0 of the limits. Limit j is a bound if c_j = 0.

    Examples
    --------
    >>> operators = vx.Operators(K=2 * np.eye(2), B=np.eye(2))
    >>> sorted(operators.features)
    ['absolute values', 'quadratic']
    """

    K: Any
    B: Any
    block: int = 1
    given_factor: Factor | None = None
    kernel: Floats | None = None
    D: Any = None
    compliance: Any = None

    def __post_init__(self) -> None:
        read: dict[str, Any] = {"K": as_read_only_symmetric(self.K, "Operators: K")}
        n = read["K"].shape[0]
        for name in ("B", "D"):
            raw = getattr(self, name)
            read[name] = rows = as_read_only_rows(sp.csr_matrix((0, n)) if raw is None else raw, f"Operators: {name}")
            if rows.shape[1] != n:
                raise SceneError(f"Operators: {name}: found {rows.shape[1]} columns; K has {n} unknowns.")
        read["block"], r = whole_blocks(self.block, read["B"].shape[0], "Operators"), read["D"].shape[0]
        given = np.zeros(r) if self.compliance is None else self.compliance
        c = finite(
            as_shaped_array(given, "Operators: compliance", f"one number per limit, shape ({r},)", (r,)),
            "Operators: compliance",
        )
        if (c < 0).any():
            raise SceneError(f"Operators: found the compliance {c.min():.6g}; it must be >= 0.")
        read["compliance"] = read_only(c)
        for name, value in read.items():
            object.__setattr__(self, name, value)

    @property
    def count(self) -> int:
        """The number of norm terms m."""
        return self.B.shape[0] // self.block

    @cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """The lengths of the vectors g, w, b and e of a program."""
        return self.K.shape[0], self.count, self.B.shape[0], self.D.shape[0]

    @cached_property
    def features(self) -> frozenset[str]:
        """The features of the programs."""
        has = {
            QUADRATIC: True,
            ABSOLUTE_VALUES: self.count > 0 and self.block == 1,
            SECOND_ORDER_CONES: self.count > 0 and self.block > 1,
            BOUNDS: (self.compliance == 0).any(),
            SQUARED_POSITIVE_PARTS: (self.compliance > 0).any(),
        }
        return frozenset(name for name, found in has.items() if found)

    @cached_property
    def regular(self) -> Matrix:
        """The matrix K, made positive definite by added stiffness if K has a kernel."""
        return self.K if self.kernel is None else add_anchors(self.K, choose_anchors(self.kernel, self.K.diagonal()))

    @cached_property
    def factor(self) -> Factor:
        """The factor of `regular`."""
        if self.given_factor is not None:
            return self.given_factor
        K = self.regular
        return DenseInverse(K) if isinstance(K, np.ndarray) else SuperLU().factorise(K)

    @cached_property
    def kernel_modes(self) -> Floats:
        """The product (N, k) of `A` and `kernel`."""
        return np.asarray(self.A @ (np.zeros((self.K.shape[0], 0)) if self.kernel is None else self.kernel))

    @cached_property
    def A(self) -> sp.csr_matrix:
        """The rows [B; D] (N, n) of norm terms and limits."""
        return sp.csr_matrix(sp.vstack([self.B, self.D], format="csr"))

    @cached_property
    def _transposed(self) -> sp.csr_matrix:
        return sp.csr_matrix(self.A.T)

    @cached_property
    def absolute(self) -> tuple[Matrix, sp.csr_matrix]:
        """The absolute values of the entries of K and A."""
        return abs(self.K), abs(self.A)

    def multiplier_force(self, lam: Floats, p: Floats) -> Floats:
        """Return B'lam + D'p, the forces (n,) of norm terms and limits."""
        return np.asarray(self._transposed @ np.append(lam, p))

    def force(self, d: Floats) -> Floats:
        """Return K d, without rounding errors in the kernel of K."""
        force = product(self.K, d)
        return force if self.kernel is None else force - self.kernel @ (self.kernel.T @ force)

    def energy_norm(self, d: Floats) -> float:
        """Return the energy norm of d."""
        return energy_norm(self.K, d)

    def blocks(self, x: Floats) -> Floats:
        """Return a view (m, block) of a vector."""
        return x.reshape(-1, self.block)

    @cached_property
    def own_columns(self) -> tuple[Ints, Ints] | None:
        """The columns of B and D, or None if rows have several entries or share columns."""
        columns, rows = self.A.indices.astype(np.int64), self.A.shape[0]
        single = (np.diff(self.A.indptr) == 1).all() and self.A.data.all() and len(np.unique(columns)) == rows
        return (columns[: self.B.shape[0]], columns[self.B.shape[0] :]) if single else None

    def move(self, held: Bools, x: Floats) -> Floats:
        """Return v with A v = x on the rows in the mask `held`."""
        v, A = np.zeros(self.A.shape[1]), self.A[held]
        if self.own_columns is None:
            return np.asarray(lsqr(A, x, atol=1e-15, btol=1e-15, iter_lim=4 * len(x))[0])
        v[A.indices] = x / A.data
        return v

    @cached_property
    def flexibilities(self) -> Floats:
        """The diagonal of A K^{-1} A', estimated if the factor is iterative."""
        return self.factor.energies(self.A) if self.factor.exact else self._estimate_energies(self.A)

    @cached_property
    def norm_flexibility(self) -> Floats:
        """The largest diagonal entries (m,) of the blocks B_i K^{-1} B_i'."""
        return np.asarray(self.blocks(self.flexibilities[: self.B.shape[0]]).max(axis=1))

    @property
    def limit_flexibility(self) -> Floats:
        """The flexibilities D_j K^{-1} D_j' (r,)."""
        return self.flexibilities[self.B.shape[0] :]

    @cached_property
    def compliances(self) -> Floats:
        """The diagonal of the inverse of `regular`, estimated if K is sparse."""
        unit = sp.csr_matrix(sp.eye_array(self.K.shape[0]))
        return self.factor.energies(unit) if isinstance(self.K, np.ndarray) else self._estimate_energies(unit)

    def rounding(self, forces: Floats, y: Floats) -> Floats:
        """Return bounds on rounding errors of x - K z, for |x| = `forces` and |z| = `y`."""
        return ROUNDED * (forces + product(self.absolute[0], y))

    def energies_of_rounding(self, rounding: Floats) -> Floats:
        """Return the energies of residuals with entries of size `rounding`."""
        energies: Floats = 0.5 * rounding.T**2 @ self.compliances
        return energies

    def _estimate_energies(self, rows: sp.csr_matrix) -> Floats:
        alone: Floats = rows.multiply(rows) @ (1.0 / self.regular.diagonal())
        some = np.unique(np.linspace(0, len(alone) - 1, min(SAMPLES, len(alone))).astype(np.int64))
        energies = self.factor.energies_of_columns(np.ascontiguousarray(rows[some].toarray().T))
        return alone * np.max(energies / alone[some], initial=0.0)


class DenseInverse(Factor):
    """The inverse of a dense K."""

    def __init__(self, K: Floats):
        # LAPACK reads matrices by columns, so K.T needs no copy.
        upper, info = dpotrf(K.T, lower=0) if len(K) else (K, 0)
        if info > 0:
            raise singular_matrix_error()
        half = np.triu(dpotri(upper, lower=0)[0]) if len(K) else K
        self._inverse: Floats = half + np.triu(half, 1).T

    def solve(self, b: Floats) -> Floats:
        """Return K^{-1} b."""
        return product(self._inverse, b) if b.ndim == 1 else np.asarray(self._inverse @ b)

    def energies(self, rows: sp.csr_matrix) -> Floats:
        """Return b'K^{-1}b of every row b."""
        return np.asarray(rows.multiply(rows @ self._inverse).sum(axis=1)).ravel()

    def flexibility(self, some: Ints, n: int) -> Floats:
        """Return the block of K^{-1} on some unknowns."""
        return self._inverse if len(some) == n else np.asarray(self._inverse.take(some, 0).take(some, 1))


def product(K: Matrix | LinearOperator, d: Floats) -> Floats:
    """Return K d. Only one triangle of a dense K is read."""
    if not isinstance(K, np.ndarray) or len(d) == 0:
        return np.asarray(K @ d)
    return np.asarray(dsymv(1.0, K if K.flags.f_contiguous else K.T, d, lower=1))


def energy_norm(K: Matrix, d: Floats) -> float:
    """Return the energy norm of d."""
    return float(np.sqrt(max(float(d @ product(K, d)), 0.0))) if d.any() else 0.0
