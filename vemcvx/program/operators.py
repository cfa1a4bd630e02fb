"""What all steps of a run share: K, where the norm terms act (B), and where the limits do (D)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.linear import SAMPLES, DenseCholesky, Factor, Matrix, SuperLU
from vemcvx.outline import ArrayRecord
from vemcvx.program.kernel import KernelBalance
from vemcvx.program.terms import Rows

QUADRATIC = "quadratic"
ABSOLUTE_VALUES = "absolute values"
SECOND_ORDER_CONES = "second-order cones"
BOUNDS = "bounds"
SQUARED_POSITIVE_PARTS = "squared positive parts"
FEATURES = frozenset({QUADRATIC, ABSOLUTE_VALUES, SECOND_ORDER_CONES, BOUNDS, SQUARED_POSITIVE_PARTS})
"""All that a program can have."""
MOTION_ROUNDING = 64 * float(np.finfo(float).eps)
"""Of motions, in parts of their largest entries: they are made orthonormal, in columns of many entries."""


def _none() -> sp.csr_matrix:
    return sp.csr_matrix((0, 0))


@dataclass(frozen=True, repr=False, eq=False)
class Operators(ArrayRecord):
    """The data of a step's program that do not change.

    Parameters
    ----------
    K : (n, n) dense array (condensed) or sparse matrix (full), symmetric positive definite
    B : (m * block, n) sparse matrix
        Rows i * block ... (i + 1) * block make the vector B_i d of norm term i: a slip, but for the motion of supports.
    block : int
        Components of such a vector: 1 makes absolute values, more make second-order cones.
    given_factor : Factor, optional
        `factor`, K (with the anchors' stiffness) ready to be solved with; made if it is not given.
    kernel : (n, k) array, optional
        Where K is only semidefinite: its kernel, orthonormal (:mod:`vemcvx.program.kernel`).
    anchor : (n,) array, optional
        With a kernel: stiffness that makes K + diag(anchor) positive definite.
    D : (r, n) sparse matrix, optional
        Row j reads how far limit j is approached, positive towards it.
    compliance : (r,) array, optional
        c_j >= 0 of the limits; zero makes them bounds.
    """

    K: Matrix
    B: sp.csr_matrix
    block: int = 1
    given_factor: Factor | None = None
    kernel: Floats | None = None
    anchor: Floats | None = None
    D: sp.csr_matrix = field(default_factory=_none)
    compliance: Floats = field(default_factory=lambda: np.zeros(0))
    factor: Factor = field(init=False, repr=False)
    _principal: dict[bytes, Factor] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.D.shape[0] == 0:
            object.__setattr__(self, "D", sp.csr_matrix((0, self.B.shape[1])))
        elif len(self.compliance) == 0:
            object.__setattr__(self, "compliance", np.zeros(self.D.shape[0]))
        object.__setattr__(self, "factor", self.given_factor or self._factorised())

    def _factorised(self) -> Factor:
        if self.anchor is not None:
            return self.regular.factor
        return DenseCholesky(self.K) if isinstance(self.K, np.ndarray) else SuperLU().factorise(self.K)

    @cached_property
    def regular(self) -> Operators:
        """The operators with K + diag(anchor), which is positive definite; itself where there is no kernel."""
        if self.anchor is None:
            return self
        return replace(self, K=shifted(self.K, self.anchor), kernel=None, anchor=None)

    @cached_property
    def kernel_balance(self) -> KernelBalance:
        """What norm terms and limits feel of the kernel."""
        kernel = np.zeros((len(self.K.diagonal()), 0)) if self.kernel is None else self.kernel
        stop = self.D @ kernel
        # A motion along an obstacle does not run into it because of the rounding of its largest entries.
        largest = np.abs(kernel).max(axis=0, initial=0.0)
        rounding = MOTION_ROUNDING * np.outer(np.asarray(abs(self.D).sum(axis=1)), largest)
        stop[np.abs(stop) <= rounding] = 0.0
        return KernelBalance((self.B @ kernel).reshape(self.count, self.block, kernel.shape[1]), stop)

    def principal(self, F: Ints) -> Factor:
        """A factor of K on the unknowns F alone; the last one is remembered: most steps ask for the same again."""
        which = F.tobytes()
        factor = self._principal.get(which)
        if factor is None:
            # Before there is another, lest memory hold two.
            self._principal.clear()
            factor = self._principal[which] = self.factor.within(restricted(self.K, F), F)
        return factor

    def force(self, d: Floats) -> Floats:
        """K d, which does no work on K's kernel: what it rounds to does not either."""
        force: Floats = self.K @ d
        return force if self.kernel is None else force - self.kernel @ (self.kernel.T @ force)

    def multiplier_force(self, lam: Floats, p: Floats) -> Floats:
        """B'lam + D'p, the forces (n,) of norm terms and limits."""
        force = self.rows.force_of(lam.ravel())
        return force + self.limits.force_of(p) if len(p) else force

    @cached_property
    def rows(self) -> Rows:
        """B, ready to be applied."""
        return Rows(self.B)

    @cached_property
    def limits(self) -> Rows:
        """D, ready to be applied."""
        return Rows(self.D)

    @cached_property
    def own_columns(self) -> tuple[Ints, Ints] | None:
        """The unknowns that the rows of B and of D read, if each reads one of its own; else None."""
        rows, limits = self.rows.columns, self.limits.columns
        if rows is None or limits is None or len(np.union1d(rows, limits)) < len(rows) + len(limits):
            return None
        return rows, limits

    @cached_property
    def absolute(self) -> Matrix:
        """|K|, entry by entry, for bounds on rounding."""
        return np.abs(self.K) if isinstance(self.K, np.ndarray) else sp.csr_matrix(abs(self.K))

    @property
    def count(self) -> int:
        """The number of norm terms m."""
        return self.B.shape[0] // self.block

    @cached_property
    def features(self) -> frozenset[str]:
        """What a solver must accept: a subset test matches the two."""
        found = {QUADRATIC}
        if self.count:
            found.add(ABSOLUTE_VALUES if self.block == 1 else SECOND_ORDER_CONES)
        if (self.compliance == 0).any():
            found.add(BOUNDS)
        if (self.compliance > 0).any():
            found.add(SQUARED_POSITIVE_PARTS)
        return frozenset(found)

    @cached_property
    def norm_flexibility(self) -> Floats:
        """(m,) largest diagonal entry of B_i K^{-1} B_i': |B_i d| <= its root times |d|_K."""
        largest: Floats = self.blocks(self._response(self.B)).max(axis=1)
        return largest

    @cached_property
    def limit_flexibility(self) -> Floats:
        """(r,) D_j K^{-1} D_j'."""
        return self._response(self.D)

    @cached_property
    def norm_stiffness(self) -> Floats:
        """(m,) one over the flexibility; one where rows read nothing."""
        return 1.0 / np.where(self.norm_flexibility > 0, self.norm_flexibility, 1.0)

    @cached_property
    def limit_stiffness(self) -> Floats:
        """(r,) one over the flexibility and the compliance; one where rows read nothing."""
        softness = self.limit_flexibility + self.compliance
        return 1.0 / np.where(softness > 0, softness, 1.0)

    def _response(self, rows: sp.csr_matrix) -> Floats:
        """The diagonal of rows K^{-1} rows'; of an iterative factor an estimate, the largest share of a few."""
        return self.factor.energies(rows) if self.factor.exact else self._sampled(rows)

    def _sampled(self, rows: sp.csr_matrix) -> Floats:
        """What single unknowns would answer, times the most that some rows answer more than that."""
        alone: Floats = rows.multiply(rows) @ (1.0 / self.K.diagonal())
        some = np.unique(np.linspace(0, len(alone) - 1, min(SAMPLES, len(alone))).astype(np.int64))
        return alone * max((self.factor.energy(rows[i].toarray()[0]) / alone[i] for i in some), default=1.0)

    def stiffened(self, H: Floats, stiffness: Floats | None = None) -> Matrix:
        """K + B'HB + D' diag(stiffness) D with a symmetric matrix H_i (m, block, block) a norm term."""
        return self.plus(self.stiffening(H, stiffness))

    def stiffening(self, H: Floats, stiffness: Floats | None = None) -> sp.csr_matrix:
        """B'HB + D' diag(stiffness) D."""
        added: sp.csr_matrix = sp.csr_matrix(self.K.shape)
        if self.count and (own := self.rows.columns) is not None:
            columns, coefficient = own.reshape(self.count, self.block), self.blocks(self.B.data)
            entries = coefficient[:, :, None] * H * coefficient[:, None, :]
            at = np.repeat(columns, self.block, axis=1).ravel(), np.tile(columns, self.block).ravel()
            added = sp.csr_matrix((entries.ravel(), at), shape=self.K.shape)
        elif self.count:
            blocks = sp.csr_matrix(sp.bsr_matrix((H, np.arange(self.count), np.arange(self.count + 1))))
            added = sp.csr_matrix(self.B.T @ blocks @ self.B)
        if stiffness is not None and len(stiffness):
            added = sp.csr_matrix(added + self.D.T @ sp.diags_array(stiffness) @ self.D)
        return added

    def plus(self, added: sp.csr_matrix) -> Matrix:
        """K + added."""
        return self.K + added.toarray() if isinstance(self.K, np.ndarray) else sp.csr_matrix(self.K + added)

    def energy_norm(self, d: Floats) -> float:
        """|d|_K of increments d (n,)."""
        return energy_norm(self.K, d)

    def blocks(self, x: Floats) -> Floats:
        """View (m * block,) entries as (m, block)."""
        return x.reshape(self.count, self.block)


def restricted(K: Matrix, F: Ints) -> Matrix:
    """K_FF, the principal submatrix of the unknowns F."""
    # Of dense matrices `take` copies three times as fast as an index does.
    return K.take(F, 0).take(F, 1) if isinstance(K, np.ndarray) else K[F][:, F]


def shifted(K: Matrix, diagonal: Floats) -> Matrix:
    """K + diag(diagonal)."""
    return K + np.diag(diagonal) if isinstance(K, np.ndarray) else sp.csr_matrix(K + sp.diags_array(diagonal))


def energy_norm(K: Matrix, d: Floats) -> float:
    """|d|_K of increments d (n,)."""
    return float(np.sqrt(max(float(d @ (K @ d)), 0.0))) if d.any() else 0.0
