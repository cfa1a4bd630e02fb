"""One step as a convex program, in the increment d = y - y_prev.

    minimise  1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i|                                              (2.34)
    dual      K d = g - B'lam,   |lam_i| <= w_i,   lam_i . s_i = w_i |s_i|,   s = B d - b

with g = load(t_n) - K y_prev, the force out of balance when the step begins. Working in increments keeps
all digits of d when steps are tiny beside y. The program is data; each solver reads it its own way.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.kernel import nearest
from vemcvx.linear import DenseCholesky, Factor, SuperLU
from vemcvx.rows import Rows

Floats = NDArray[np.float64]

QUADRATIC = "quadratic"
ABSOLUTE_VALUES = "absolute values"
SECOND_ORDER_CONES = "second-order cones"


@dataclass(frozen=True)
class Form:
    """What all steps of a run share: K, and where the norm terms act.

    Parameters
    ----------
    K : (n, n) dense array (condensed) or sparse matrix (full), symmetric positive definite
    B : (m * block, n) sparse matrix
    block : int
    factor : Factor, optional
        K factorised (with the anchors' stiffness); needed only where K is sparse.
    kernel : (n, k) array, optional
        Where K is only semidefinite: its kernel, orthonormal (:mod:`vemcvx.kernel`).
    anchor : (n,) array, optional
        With a kernel: stiffness that makes K + diag(anchor) positive definite.
    """

    K: Floats | sp.csr_matrix
    B: sp.csr_matrix
    block: int = 1
    factor: Factor = None  # type: ignore[assignment]
    kernel: Floats | None = None
    anchor: Floats | None = None

    def __post_init__(self) -> None:
        if self.factor is None:
            K = self.regular.K
            object.__setattr__(self, "factor", SuperLU().factorise(K) if sp.issparse(K) else DenseCholesky(K))

    @cached_property
    def regular(self) -> Form:
        """The form with K + diag(anchor), which is positive definite; itself where there is no kernel."""
        if self.anchor is None:
            return self
        added = sp.diags_array(self.anchor)
        K = sp.csr_matrix(self.K + added) if sp.issparse(self.K) else self.K + np.diag(self.anchor)
        return Form(K, self.B, self.block, self.factor)

    @cached_property
    def grip(self) -> Floats:
        """(m, block, k) B_i N: what the norm terms feel of the kernel."""
        kernel = np.zeros((len(self.K.diagonal()), 0)) if self.kernel is None else self.kernel
        return (self.B @ kernel).reshape(self.count, self.block, -1)

    @cached_property
    def rows(self) -> Rows:
        """B, ready to be applied."""
        return Rows(self.B)

    @cached_property
    def absolute(self) -> Floats | sp.csr_matrix:
        """|K|, entry by entry, for bounds on rounding."""
        return abs(self.K)

    @property
    def count(self) -> int:
        """The number of norm terms m."""
        return self.B.shape[0] // self.block

    @cached_property
    def features(self) -> frozenset[str]:
        """What a solver must accept: a subset test matches the two."""
        if self.count == 0:
            return frozenset({QUADRATIC})
        return frozenset({QUADRATIC, ABSOLUTE_VALUES if self.block == 1 else SECOND_ORDER_CONES})

    @cached_property
    def compliance(self) -> Floats:
        """(m,) largest diagonal entry of B_i K^{-1} B_i': |s_i| <= compliance^{1/2} |d|_K."""
        B = self.B.toarray()
        response = self.factor.solve(np.ascontiguousarray(B.T))
        return self.blocks(np.einsum("ij,ji->i", B, response)).max(axis=1)

    def stiffened(self, H: Floats) -> Floats | sp.csr_matrix:
        """K + B'HB with a symmetric matrix H_i (m, block, block) a term."""
        H_B = sp.csr_matrix(sp.bsr_matrix((H, np.arange(self.count), np.arange(self.count + 1)))) @ self.B
        added = self.B.T @ H_B
        return self.K + added if sp.issparse(self.K) else self.K + added.toarray()

    def blocks(self, x: Floats) -> Floats:
        """View (m * block,) entries as (m, block)."""
        return x.reshape(self.count, self.block)


@dataclass(frozen=True)
class StepProgram:
    """One step's data: minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i|.

    Parameters
    ----------
    form : Form
    g : (n,) array, forces out of balance
    w : (m,) array, weights >= 0 (forces)
    b : (m * block,) array, motion of the supports against the norm terms
    """

    form: Form
    g: Floats
    w: Floats
    b: Floats

    def slip(self, d: Floats) -> Floats:
        """s = B d - b, as (m, block)."""
        return self.form.blocks(self.form.rows.read(d) - self.b)

    def residual(self, d: Floats, lam: Floats) -> Floats:
        """r = g - B'lam - K d, the forces that do not balance, (n,)."""
        return self.g - self.form.rows.pull(lam.ravel()) - self.form.K @ d

    def objective(self, d: Floats) -> float:
        """The energy that the step minimises."""
        norms = np.linalg.norm(self.slip(d), axis=1)
        return float(0.5 * d @ (self.form.K @ d) - self.g @ d + self.w @ norms)

    def project(self, lam: Floats) -> Floats:
        """The admissible multipliers nearest to `lam` (m, block): |lam_i| <= w_i, in balance on K's kernel."""
        if self.form.kernel is not None:
            lam = nearest(lam, self.w, self.form.grip, self.form.kernel.T @ self.g)[0]
        size = np.linalg.norm(lam, axis=1)
        over = size > self.w
        scale = np.ones_like(size)
        scale[over] = self.w[over] / size[over]
        shrunk = lam * scale[:, None]
        if self.form.block == 1:
            # The projection onto an interval is exact; scaling would leave one rounding error.
            shrunk = np.clip(lam, -self.w[:, None], self.w[:, None])
        return shrunk


@dataclass(frozen=True)
class Answer:
    """A solver's answer to one step; nothing is claimed about it before it is certified.

    Parameters
    ----------
    d : (n,) increments
    lam : (m, block) multipliers of the norm terms: K d = g - B'lam
    iterations : int
    status : str
        In the solver's own words.
    safeguards : int
        How many of the iterations were steps of a globally convergent method that stood in for a faster one.
    """

    d: Floats
    lam: Floats
    iterations: int
    status: str = ""
    safeguards: int = 0
