"""The operators that all steps share: K, the rows of norm terms and limits, and their responses to forces.

`Norms` are terms w_i |B_i y| of a system, with the laws of their weights. `Operators` are the parts of a system that do
not change in a run, as solvers get them; `Rows` applies B or D as cheaply as its pattern allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.linalg.blas import dsymv
from scipy.sparse.linalg import LinearOperator, lsqr

from vemcvx.base.arrays import (
    EPS,
    Bools,
    Floats,
    Ints,
    MatrixLike,
    as_real_array,
    at_instant,
    brief,
    called,
    checked_matrix,
    finite,
    function,
    instance,
    is_whole,
    read_only,
    shape_in_words,
    shaped,
)
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.base.weight_law import Law
from vemcvx.linear import AT_ONCE, SAMPLES, Factor, Matrix, SuperLU
from vemcvx.program.dense_factors import DenseCholesky
from vemcvx.program.kernel import KernelBalance

SAY = "take the number of a term and say where it acts"


class Rows:
    """B (k, n), with B d and B'lam as cheap as its pattern allows."""

    def __init__(self, B: sp.csr_matrix):
        self.B = B
        single = np.diff(B.indptr) == 1
        self.single = single
        """(k,) which rows have one entry"""
        self.columns: Ints | None = None
        """(k,) the unknown that each row reads, if every row reads its own and no other; else None"""
        if single.all() and len(np.unique(B.indices)) == B.shape[0]:
            self.columns = B.indices.astype(np.int64)

    @cached_property
    def transposed(self) -> sp.csr_matrix:
        """B', (n, k)."""
        return sp.csr_matrix(self.B.T)

    def read(self, d: Floats) -> Floats:
        """B d, (k,)."""
        return self.B @ d if self.columns is None else self.B.data * d[self.columns]

    def force_of(self, lam: Floats) -> Floats:
        """B'lam, (n,): the force of multipliers."""
        if self.columns is None:
            return self.transposed @ lam
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
        # SciPy refuses intervals of length zero.
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


@dataclass(frozen=True, repr=False)
class Norms(ArrayRecord):
    """The terms w_i |B_i v|: rows i * block ... (i + 1) * block of B make the vector B_i v.

    Parameters
    ----------
    B : (m * block, n) array or sparse matrix
    w : (m,) array, or callable t -> (m,)
        Weights >= 0.
    block : int
        Components of one vector: 1 on a curve in the plane, 2 on a surface in space.
    places : callable i -> str, optional
        Where term i acts, in words, for messages.
    law : Law, optional
        Weights that follow the answer of a step (:mod:`vemcvx.base.weight_law`); `w` are then the weights where no
        limit acts.
    ground : callable t -> (m * block,), optional
        The displacement g of the ground: slips are relative to it, w_i |B_i (y - y_prev) - (g_i - g_i,prev)|, and its
        motion does work.
    """

    B: sp.csr_matrix
    w: ArrayLike | Callable[[float], ArrayLike]
    block: int = 1
    places: Callable[[int], str] | None = None
    law: Law | None = None
    ground: Callable[[float], ArrayLike] | None = None

    if TYPE_CHECKING:  # B is given as any matrix

        def __init__(
            self,
            B: MatrixLike,
            w: ArrayLike | Callable[[float], ArrayLike],
            block: int = 1,
            places: Callable[[int], str] | None = None,
            law: Law | None = None,
            ground: Callable[[float], ArrayLike] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        B = checked_matrix(self.B, "Norms: B")
        if not is_whole(self.block) or self.block < 1 or B.shape[0] % self.block:
            raise SceneError(
                f"Norms: found B with {B.shape[0]} rows and block = {brief(self.block)}; "
                "B must have a whole number of blocks of rows."
            )
        object.__setattr__(self, "B", B)
        object.__setattr__(self, "block", int(self.block))
        function(self.places, "Norms: found places", "a function of i that says where term i acts")
        function(self.ground, "Norms: found ground", "a function of t that says how far the ground has moved")
        instance(self.law, Law, "Norms: found law", "a Law(weights)")
        if self.law is not None and self.law.softening is not None:
            softening = self._checked(self.law.softening, "softening")
            object.__setattr__(self, "law", replace(self.law, softening=softening))
        if not callable(self.w):
            object.__setattr__(self, "w", self._checked(self.w))

    @property
    def count(self) -> int:
        """The number of terms m."""
        return self.B.shape[0] // self.block

    def name(self, i: int) -> str:
        """The place of term `i`, in words."""
        return f"norm term {i}" if self.places is None else str(called(self.places, (i,), "Norms: places failed", SAY))

    def weights(self, t: float) -> Floats:
        """Weights (m,) at the instant `t`."""
        w = self.w
        # An array was checked when it was given.
        return w if isinstance(w, np.ndarray) else self._checked(at_instant(w, t, "Norms: w"))

    @property
    def softening(self) -> Floats | None:
        """The rate (m,) at which weights fall with slip at most, if it is known."""
        known = None if self.law is None else self.law.softening
        return None if known is None else np.asarray(known, dtype=float)

    @property
    def sloped(self) -> bool:
        """True if the derivative of the law by the forces of the limits is known."""
        return self.law is not None and self.law.slope is not None

    @property
    def remembers(self) -> bool:
        """True if weights depend on slips."""
        return self.law is not None and self.law.slips

    def weights_under(self, t: float, p: Floats, past: Floats | None = None, slip: Floats | None = None) -> Floats:
        """Weights (m,) at `t` under forces `p` (r,) of the limits, after slips (m,) before the step and in it."""
        if self.law is None:
            return self.weights(t)
        none = np.zeros(self.count)
        slips = none if past is None else past, none if slip is None else slip
        failed = f"Norms: law: its function failed when called as f(t, p, past, slip) with t = {t:.6g}"
        return self._checked(called(self.law.weights, (t, p, *slips), failed, "return weights"))

    def slope_by_forces(self, t: float, p: Floats, past: Floats) -> sp.csr_matrix:
        """The derivative (m, r) of a `sloped` law by the forces p (r,) of the limits, at `t` after slips (m,)."""
        law = self.law
        if law is None or law.slope is None:
            raise LookupError("Norms: the law has no slope; `sloped` says so.")
        failed = f"Norms: slope: its function failed when called as f(t, p, past) with t = {t:.6g}"
        J = called(law.slope, (t, p, past), failed, "return the law's derivative")
        return checked_matrix(J, "Norms: slope", (self.count, len(p)))

    def moved(self, t: float) -> Floats:
        """The motion of the ground up to the instant `t`, (m * block,); zero if it stands still."""
        rows, subject = self.B.shape[0], "Norms: ground"
        if self.ground is None:
            return np.zeros(rows)
        raw = at_instant(self.ground, t, subject)
        return finite(shaped(raw, subject, f"({rows},) ways, one a row of B", (rows,)), subject)

    def _checked(self, raw: ArrayLike, name: str = "w") -> Floats:
        what = "weight" if name == "w" else name
        wanted = f"a {what}, or ({self.count},) of them, one a term"
        w = finite(shaped(raw, f"Norms: {name}", wanted, (), (self.count,)), f"Norms: {name}")
        if (w < 0).any():
            worst = self.name(int(np.argmin(w)))
            raise SceneError(f"Norms: found the {what} {w.min():.6g} of {worst}; it must be >= 0.")
        return np.full(self.count, w)


QUADRATIC = "quadratic"
ABSOLUTE_VALUES = "absolute values"
SECOND_ORDER_CONES = "second-order cones"
BOUNDS = "bounds"
SQUARED_POSITIVE_PARTS = "squared positive parts"
FEATURES = frozenset({QUADRATIC, ABSOLUTE_VALUES, SECOND_ORDER_CONES, BOUNDS, SQUARED_POSITIVE_PARTS})
"""All that a program can have."""


SYMMETRIC = 1e-10


def check_symmetric(K: Any, subject: str) -> None:
    """Raise SceneError unless K is square and symmetric."""
    if K.shape[0] != K.shape[1]:
        raise SceneError(f"{subject}: found a matrix of shape {K.shape}; it must be square.")
    # Kx = K'x for one x without structure: a tenth of the cost of K - K', which is formed only to name the place.
    x = np.random.default_rng(0).uniform(-1.0, 1.0, K.shape[0])
    entries = K if isinstance(K, np.ndarray) else K.data
    largest = max(entries.max(initial=0.0), -entries.min(initial=0.0))
    doubtful = np.abs(K @ x - x @ K).max(initial=0.0) > 0.01 * SYMMETRIC * largest
    apart = sp.coo_matrix(abs(K - K.T)) if doubtful else sp.coo_matrix(K.shape)
    if apart.nnz and apart.data.max() > SYMMETRIC * largest:
        worst = int(np.argmax(apart.data))
        i, j = int(apart.row[worst]), int(apart.col[worst])
        raise SceneError(
            f"{subject}: found {K[i, j]:.6g} at [{i}, {j}] but {K[j, i]:.6g} at [{j}, {i}]; it must be symmetric. "
            "For the energy 1/2 y'Ky, give (K + K.T) / 2."
        )


def _locked(matrix: Any) -> Any:
    """A view of a matrix that refuses to be written to; matrices without entries of their own are returned as given."""
    if isinstance(matrix, np.ndarray):
        return read_only(matrix.view())
    if not isinstance(matrix, sp.csr_matrix):
        return matrix
    if not matrix.has_canonical_format:  # SciPy would order the entries in place, at the first product that wants it.
        matrix = matrix.copy()
        matrix.sum_duplicates()
    entries = read_only(matrix.data.view()), matrix.indices, matrix.indptr
    return sp.csr_matrix(entries, shape=matrix.shape)


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
        `factor`; made when it is first asked for if it is not given.
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
    D: sp.csr_matrix = field(default_factory=lambda: sp.csr_matrix((0, 0)))
    compliance: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self._check()
        # Solvers have them, and answers are certified by them afterwards.
        for name in ("K", "B", "D", "compliance"):
            object.__setattr__(self, name, _locked(getattr(self, name)))

    def _check(self) -> None:
        """Read matrices given as lists or dense arrays, and raise SceneError for those that do not fit each other."""
        K = self.K
        if not (isinstance(K, np.ndarray | sp.csr_matrix) and K.dtype.char == "d"):
            K = checked_matrix(K, "Operators: K") if sp.issparse(K) else as_real_array(K, "Operators: K", "a matrix")
        if K.ndim != 2:
            raise SceneError(f"Operators: K: found {shape_in_words(np.asarray(K))}; wanted a matrix, dense or sparse.")
        finite(K if isinstance(K, np.ndarray) else K.data, "Operators: K")
        check_symmetric(K, "Operators: K")
        object.__setattr__(self, "K", K)
        n = K.shape[0]
        for name in ("B", "D"):
            rows = getattr(self, name)
            if getattr(rows, "shape", None) == (0, 0):
                rows = sp.csr_matrix((0, n))
            if not isinstance(rows, sp.csr_matrix):
                rows = checked_matrix(rows, f"Operators: {name}")
            if rows.shape[1] != n:
                raise SceneError(f"Operators: {name}: found {rows.shape[1]} columns; K has {n} unknowns.")
            object.__setattr__(self, name, rows)
        if not is_whole(self.block) or self.block < 1 or self.B.shape[0] % self.block:
            raise SceneError(
                f"Operators: found B with {self.B.shape[0]} rows and block = {brief(self.block)}; "
                "B must have a whole number of blocks of rows."
            )
        r = self.D.shape[0]
        given = self.compliance if np.size(self.compliance) else np.zeros(r)
        c = shaped(given, "Operators: compliance", f"({r},) numbers, one a limit", (r,))
        if not (finite(c, "Operators: compliance") >= 0).all():
            raise SceneError(f"Operators: found the compliance {c.min():.6g}; it must be >= 0.")
        object.__setattr__(self, "compliance", c)

    @cached_property
    def factor(self) -> Factor:
        """K, with the anchors' stiffness, ready to be solved with."""
        if self.given_factor is not None:
            return self.given_factor
        if self.anchor is not None:
            return self.regular.factor
        return DenseCholesky(self.K) if isinstance(self.K, np.ndarray) else SuperLU().factorise(self.K)

    @cached_property
    def regular(self) -> Operators:
        """The operators with K + diag(anchor), which is positive definite; itself where there is no kernel."""
        if self.anchor is None:
            return self
        return replace(self, K=self.plus(sp.diags_array(self.anchor)), kernel=None, anchor=None)

    @cached_property
    def kernel_balance(self) -> KernelBalance:
        """The balance of norm terms and limits on the kernel."""
        kernel = np.zeros((len(self.K.diagonal()), 0)) if self.kernel is None else self.kernel
        stop = self.D @ kernel
        # A motion along an obstacle does not run into it because of the rounding of its largest entries.
        largest = np.abs(kernel).max(axis=0, initial=0.0)
        rounding = 64 * EPS * np.outer(np.asarray(abs(self.D).sum(axis=1)), largest)
        stop[np.abs(stop) <= rounding] = 0.0
        return KernelBalance((self.B @ kernel).reshape(self.count, self.block, kernel.shape[1]), stop)

    def force(self, d: Floats) -> Floats:
        """K d, without the part along K's kernel, which is rounding."""
        force = product(self.K, d)
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
    def A(self) -> sp.csr_matrix:
        """[B; D], all rows, (N, n)."""
        return sp.csr_matrix(sp.vstack([self.B, self.D], format="csr"))

    @cached_property
    def read(self) -> Ints:
        """(u,) the unknowns that rows read, those of anchors among them."""
        reads = np.bincount(self.A.indices, minlength=self.A.shape[1]) > 0
        return np.flatnonzero(reads if self.anchor is None else reads | (self.anchor > 0))

    @cached_property
    def sparse(self) -> bool:
        """True if systems of sets are to be sparse, on all unknowns: rows read too many for dense matrices of these.

        Anchors of bodies that are not held have dense matrices; systems of these stay dense.
        """
        return not isinstance(self.K, np.ndarray) and self.anchor is None and len(self.read) ** 2 > AT_ONCE

    @cached_property
    def flexibility(self) -> Floats:
        """(u, u) the inverse of K, with the anchors' stiffness, on the unknowns that rows read."""
        return self.factor.flexibility(self.read, self.A.shape[1])

    @cached_property
    def softness(self) -> tuple[Floats, Floats | LinearOperator]:
        """Units u (N,) of multipliers, alike in a block, and W + C in these, whose diagonal is near one.

        W = A K^{-1} A' and the compliances C say how far rows move under multipliers. W is kept in double precision:
        in single precision discs at their bounds that do not slip would stick and slip in turns. Where rows are too
        many for W to be formed, each product with it takes a solve.
        """
        diagonal = np.append(np.repeat(self.norm_flexibility, self.block), 1.0 / self.limit_stiffness)
        u = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        yielding = u**2 * np.append(np.zeros(self.B.shape[0]), self.compliance)
        A = sp.csr_matrix(sp.diags_array(u) @ self.A)
        if self.sparse:
            W = LinearOperator(2 * u.shape, lambda x: A @ self.factor.solve(A.T @ x) + yielding * x, dtype=float)
            return u, W
        rows = Rows(sp.csr_matrix(A[:, self.read]))
        if rows.columns is None:
            softness = np.asarray(rows.B @ (rows.B @ self.flexibility).T)
        else:
            softness = np.asarray(restricted(self.flexibility, rows.columns))
            softness *= rows.B.data[:, None]
            softness *= rows.B.data
        softness[np.diag_indices(len(u))] += yielding
        return u, softness

    @property
    def entries(self) -> Floats | sp.csr_matrix:
        """K entry by entry, for solvers that take no products in its place."""
        return self.K

    @cached_property
    def absolute(self) -> Matrix:
        """|K|, entry by entry, for bounds on rounding."""
        return np.abs(self.K) if isinstance(self.K, np.ndarray) else abs(self.K)

    @property
    def count(self) -> int:
        """The number of norm terms m."""
        return self.B.shape[0] // self.block

    @cached_property
    def sizes(self) -> tuple[int, int, int, int]:
        """The numbers of unknowns, of norm terms, of their rows and of limits: the lengths of g, w, b and e."""
        return self.K.shape[0], self.count, self.B.shape[0], self.D.shape[0]

    @cached_property
    def features(self) -> frozenset[str]:
        """The features that a solver must accept: a subset test matches the two."""
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
        return np.asarray(self.blocks(self._flexibilities[: self.B.shape[0]]).max(axis=1))

    @cached_property
    def limit_flexibility(self) -> Floats:
        """(r,) D_j K^{-1} D_j'."""
        return self._flexibilities[self.B.shape[0] :]

    @cached_property
    def limit_stiffness(self) -> Floats:
        """(r,) one over the flexibility and the compliance; one where rows read nothing."""
        softness = self.limit_flexibility + self.compliance
        return 1.0 / np.where(softness > 0, softness, 1.0)

    @cached_property
    def _flexibilities(self) -> Floats:
        """(N,) the diagonal of A K^{-1} A'; estimated where the factor is iterative."""
        return self.factor.energies(self.A) if self.factor.exact else self._estimated(self.A)

    def _estimated(self, rows: sp.csr_matrix) -> Floats:
        """The diagonal of rows diag(K)^{-1} rows', times the largest ratio of b'K^{-1}b to it on sampled rows b."""
        alone: Floats = rows.multiply(rows) @ (1.0 / self.regular.K.diagonal())
        some = np.unique(np.linspace(0, len(alone) - 1, min(SAMPLES, len(alone))).astype(np.int64))
        return alone * max((self.factor.energy(rows[i].toarray()[0]) / alone[i] for i in some), default=1.0)

    def move(self, held: Bools, x: Floats) -> Floats:
        """A move v (n,) that takes rows `held` (N,) of A by x (k,): A v = x but for rounding."""
        v, A = np.zeros(self.A.shape[1]), self.A[held]
        if self.own_columns is not None:
            v[A.indices] = x / A.data
            return v
        return np.asarray(lsqr(A, x, atol=1e-15, btol=1e-15, iter_lim=4 * len(x))[0])

    @cached_property
    def compliances(self) -> Floats:
        """(n,) the diagonal of K^{-1}, with the anchors' stiffness; estimated where K is sparse."""
        unit = sp.csr_matrix(sp.eye_array(self.A.shape[1]))
        return self.factor.energies(unit) if isinstance(self.K, np.ndarray) else self._estimated(unit)

    def plus(self, added: sp.csr_matrix | sp.dia_array) -> Matrix:
        """K + added."""
        if isinstance(self.K, sp.csr_matrix):
            return sp.csr_matrix(self.K + added)
        return self.K + added.toarray() if isinstance(self.K, np.ndarray) else self.K + added

    def energy_norm(self, d: Floats) -> float:
        """|d|_K of increments d (n,)."""
        return energy_norm(self.K, d)

    def blocks(self, x: Floats) -> Floats:
        """View (m * block,) entries as (m, block)."""
        return x.reshape(-1, self.block)


def product(K: Matrix | LinearOperator, d: Floats) -> Floats:
    """K d, of a vector d (n,).

    Of a dense K, which is symmetric, one half is read: of 3,267 unknowns, more than caches hold, in half the time. The
    lower half of columns takes a tenth less than the upper one.
    """
    if not isinstance(K, np.ndarray) or len(d) == 0:
        return np.asarray(K @ d)
    return np.asarray(dsymv(1.0, K if K.flags.f_contiguous else K.T, d, lower=1))


def restricted(K: Matrix, F: Ints) -> Matrix:
    """K_FF, the principal submatrix of the unknowns F."""
    # Of dense matrices `take` copies three times as fast as an index does.
    if isinstance(K, np.ndarray):
        return K.take(F, 0).take(F, 1)
    return K[F][:, F]


def energy_norm(K: Matrix, d: Floats) -> float:
    """|d|_K of increments d (n,)."""
    return float(np.sqrt(max(float(d @ product(K, d)), 0.0))) if d.any() else 0.0
