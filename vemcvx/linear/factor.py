"""Factors of K: what they promise, dense Cholesky, and SciPy's sparse direct solver with orders of little fill.

This is the seam for linear algebra: everything above asks a :class:`LinearSolver` for factors, and a parallel one
(PETSc, say) would stand here. If the unknowns c come last in K = L U, the Schur complement onto them is S = L_cc U_cc,
the trailing block of the factors: it costs no more than the factorisation, where one solve an unknown of c would cost
six of them on the paper's reference (h = 1/256).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtri
from scipy.sparse.linalg import LinearOperator, cg, spilu, splu

from vemcvx.arrays import EPS, Bools, Floats, Ints, power_of_two
from vemcvx.errors import NotAccepted, SceneError

Matrix = Floats | sp.csr_matrix
"""Of a program: dense where it was condensed, sparse where it was not."""

SAMPLES = 8
"""Random forces from which the energy of others is estimated."""


def weighted(size: Floats, compliance: Floats) -> float:
    """sum size_i^2 compliance_i, a number where the squares of forces are none."""
    unit = float(power_of_two(size.max(initial=0.0)))
    return unit * (unit * float((size / unit) ** 2 @ compliance))


Cycle = Callable[[Floats], Floats]
"""b (n,) -> an approximation of K^{-1} b, linear, symmetric and positive definite in b."""


class Halves(Protocol):
    """Forward and backward substitution with K = L L', the unknowns c eliminated last and all others i.

    The force on c while it is held needs the first half alone, and what several forces do together the second one once.
    """

    def halved(self, b: Floats) -> tuple[Floats, Floats]:
        """z (n,), L_ii^{-1} b_i in some unit, zero on c; and b_c - K_ci K_ii^{-1} b_i, its force on c if c is held."""

    def completed(self, z: Floats, x_c: Floats) -> Floats:
        """x (n,) with these x_c and (K x)_i = b_i, from the half z of b."""

    def product(self, z: Floats, other: Floats) -> float:
        """a_i'K_ii^{-1} b_i of two forces a and b, from their halves z."""


class Factor(Protocol):
    """A matrix ready to be solved with."""

    @property
    def exact(self) -> bool:
        """True if it solves to rounding; an iterative one takes less time for less sharp answers."""
        return True

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle | None:
        """A preconditioner of K + S on the `free` unknowns, where solving is iterative."""
        return None

    def solve(self, b: Floats) -> Floats:
        """x with K x = b; (n,) or (n, k)."""

    @property
    def halves(self) -> Halves | None:
        """The two halves of a solve, where it has them; None where it solves for all unknowns only."""
        return None

    def rough(self, b: Floats) -> Floats:
        """K^{-1} b (n,), for sizes: an iterative one is not sharp."""
        return self.solve(b)

    def energy(self, b: Floats) -> float:
        """b'K^{-1}b of a force (n,); if it is solved inexactly a bound from above: certificates rest on it."""
        return abs(float(b @ self.solve(b)))

    def random_energy(self, size: Floats) -> float:
        """The mean of b'K^{-1}b over forces b of independent entries, of mean zero and deviations `size` (n,).

        That is sum size_i^2 (K^{-1})_ii, estimated by the mean of SAMPLES of them: one may be far too small.
        """
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (SAMPLES, len(size)))
        return float(np.mean([self.energy(size * sign) for sign in signs]))

    @property
    def lost(self) -> float:
        """The square of the part of an energy norm that one solve loses at most, estimated.

        With LL' in place of K that is |E|^2, E = L^{-1}(K - LL')L'^{-1}, at most the sum of squares of its entries:
        the mean of |Ez|^2 for z normal, of which this is one. Infinite where it is not known.
        """
        return np.inf

    def energies(self, rows: sp.csr_matrix) -> Floats:
        """b'K^{-1}b of every row b of a matrix (m, n), (m,)."""
        dense = rows.toarray()
        responses: Floats = np.einsum("ij,ji->i", dense, self.solve(np.ascontiguousarray(dense.T)))
        return responses

    def within(self, K_FF: Matrix, F: Ints) -> Factor:
        """A factor of a matrix on the unknowns F alone, K_FF being K there up to added stiffness; to solve with."""


class DenseCholesky(Factor):
    """K = R'R of a dense matrix."""

    _upper: Floats

    def __init__(self, K: Floats):
        # LAPACK without SciPy's checks: they take longer than factorising 100 unknowns.
        self._upper, info = dpotrf(K, lower=0, clean=0) if len(K) else (K, 0)
        if info > 0:
            raise singular()

    def solve(self, b: Floats) -> Floats:
        if len(self._upper) == 0:
            return b.copy()
        # For one right side LAPACK takes the path of many: five times as long at 256 unknowns.
        one = b.ndim == 1
        x: Floats = dtrsv(self._upper, dtrsv(self._upper, b, trans=1)) if one else dpotrs(self._upper, b, lower=0)[0]
        return x

    def energy(self, b: Floats) -> float:
        z = dtrsv(self._upper, b, trans=1) if len(b) else b
        return float(z @ z)

    @cached_property
    def _inverse(self) -> Floats:
        """R^{-1}: a sixth of the work of solving for as many right sides."""
        inverse: Floats = np.triu(dtrtri(self._upper, lower=0)[0]) if len(self._upper) else self._upper
        return inverse

    def energies(self, rows: sp.csr_matrix) -> Floats:
        energies: Floats = np.square(rows @ self._inverse).sum(axis=1)
        return energies

    def within(self, K_FF: Matrix, F: Ints) -> DenseCholesky:
        return DenseCholesky(K_FF if isinstance(K_FF, np.ndarray) else K_FF.toarray())


class Scaled(Factor):
    """A factor of D K D / kappa, from one of K: K is factorised once for both."""

    def __init__(self, factor: Factor, D: Floats, kappa: float):
        self._factor, self._D, self._kappa = factor, D, kappa

    def solve(self, b: Floats) -> Floats:
        D = self._D if b.ndim == 1 else self._D[:, None]
        return self._kappa * (self._factor.solve(b / D) / D)

    @property
    def exact(self) -> bool:
        return self._factor.exact

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle | None:
        D, kappa = self._D, self._kappa
        undo = sp.diags_array(1.0 / D)
        inner = self._factor.cycle(sp.csr_matrix(undo @ S @ undo) * kappa, free)
        return None if inner is None else lambda b: kappa * (inner(b / D) / D)

    def rough(self, b: Floats) -> Floats:
        return self._kappa * (self._factor.rough(b / self._D) / self._D)

    def energy(self, b: Floats) -> float:
        return self._kappa * self._factor.energy(b / self._D)

    def energies(self, rows: sp.csr_matrix) -> Floats:
        return self._kappa * self._factor.energies(sp.csr_matrix(rows @ sp.diags_array(1.0 / self._D)))

    def within(self, K_FF: Matrix, F: Ints) -> Scaled:
        D = self._D[F]
        undo = sp.diags_array(1.0 / D)
        plain = sp.csr_matrix(undo @ K_FF @ undo) * self._kappa
        return Scaled(self._factor.within(plain, F), D, self._kappa)


def corrected(M: Matrix, x: Floats, b: Floats, free: Bools, *, cycle: Cycle, part: float) -> Floats:
    """x (n,) changed on the `free` unknowns until b - M x is, there, only `part` of what it was.

    By at most 100 conjugate gradients on the principal part of M, K up to added stiffness, for which the principal part
    of K's cycle is a preconditioner, too.
    """

    def within(v: Floats) -> Floats:
        return np.where(free, M @ np.where(free, v, 0.0), 0.0)

    def conditioned(v: Floats) -> Floats:
        return np.where(free, cycle(v), 0.0)

    shape = (len(b), len(b))
    apply, before = (LinearOperator(shape, matvec=f, dtype=np.float64) for f in (within, conditioned))
    step, _ = cg(apply, np.where(free, b - M @ x, 0.0), rtol=part, atol=0.0, maxiter=100, M=before)
    return x + np.where(free, step, 0.0)


class LinearSolver(ABC):
    """Settings of a linear solver; frozen.

    A run factorises its K once; where there is viscosity, once for every length of step. A solver that eliminates is
    asked by `eliminate`: programs are condensed to the unknowns that contact and friction read, and the cost of a step
    depends on their number alone. Another one, or any with ``condense=False``, is asked by `factorise`: every step is
    then solved on all unknowns. Where none is asked for, :func:`vemcvx.linear.choose_linear` chooses by size.
    """

    eliminates: ClassVar[bool] = False
    """Whether it can give Schur complements, so that programs are condensed."""
    orders: ClassVar[bool] = False
    """Whether it orders the unknowns by itself; none is then computed for it."""

    def memory_in_space(self, unknowns: int) -> float:
        """Bytes that a factor takes in space, about, where factors are fullest; nan where it is not known."""
        return np.nan

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[Factor, Floats]:
        """Factorise K (n, n), symmetric positive definite, with the unknowns `last` last.

        This should cost little more than to factorise. It is called only where the class says that it `eliminates`.

        Parameters
        ----------
        order : (n,) permutation
            An order of elimination with little fill; a solver may take another. Any, where the class says it `orders`.
        last : (m,) array
            Numbers of the unknowns that are not eliminated.

        Returns
        -------
        factor : Factor
            Of all of K, as `factorise` gives it.
        S : (m, m) array
            Schur complement onto `last`, in their order, symmetric.

        Raises
        ------
        NotAccepted
            It cannot: see `eliminates`.
        SceneError
            The matrix is not positive definite.
        """
        raise NotAccepted(
            f"linear solver {type(self).__name__}: it gives no Schur complements, so that nothing can be condensed; "
            "SuperLU() does. With condense=False programs are solved on all unknowns."
        )

    @abstractmethod
    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> Factor:
        """Factorise K (n, n), symmetric positive definite.

        Parameters
        ----------
        near_kernel : (n, k) array, optional
            Motions of little energy (the rigid ones): iterative solvers need them.

        Raises
        ------
        SceneError
            The matrix is singular, or an iterative solver does not converge.
        """


def singular() -> SceneError:
    """The error for a stiffness matrix that some motion does not feel, or that some motion gains energy from."""
    return SceneError(
        "the stiffness matrix is singular or indefinite: some motion of the body costs no energy, or gains some. "
        "Add supports (Clamp, PrescribedDisplacement, BilateralContact) that exclude it; the K of a System must be "
        "positive definite."
    )


def nested_dissection(graph: sp.csr_matrix, points: Floats) -> Ints:
    """Order the n vertices of `graph` (n, n), symmetric, placed at `points` (n, dim), separators last."""
    n = len(points)
    order, part, ends = np.empty(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.array([n])
    tail = np.repeat(np.arange(n, dtype=graph.indices.dtype), np.diff(graph.indptr))
    once = tail < graph.indices
    tail, head = tail[once], graph.indices[once]
    # The vertices without a place yet, part by part, sorted along every axis.
    members = np.argsort(points, axis=0, kind="stable").T
    while members.size:
        sizes = np.bincount(part[members[0]], minlength=len(ends))
        upper = _upper_halves(points, members, part, sizes)
        # What goes last in its part: separators, and all of a small one.
        last = np.zeros(n, dtype=bool)
        # Sets this small are ordered as they come; with 48 there is 9 % more fill at 131k unknowns, with 4 none less.
        last[members[0]] = (sizes <= 8)[part[members[0]]]
        crossing = upper[tail] != upper[head]
        last[np.where(upper[tail[crossing]], tail[crossing], head[crossing])] = True
        placed = members[0][last[members[0]]]
        counts = np.bincount(part[placed], minlength=len(ends))
        ends = ends - counts
        order[(ends + counts - np.cumsum(counts))[part[placed]] + np.arange(len(placed))] = placed
        within = ~(last[tail] | last[head])
        tail, head = tail[within], head[within]
        members = members[~last[members]].reshape(len(members), -1)
        half = 2 * part + upper
        # Halves become parts, sorted as they were: stable sorts of short integers take linear time.
        short = half[members].astype(np.min_scalar_type(2 * len(ends)))
        members = np.take_along_axis(members, np.argsort(short, axis=1, kind="stable"), axis=1)
        left = np.bincount(half[members[0]], minlength=2 * len(ends))
        ends = np.column_stack([ends - left[1::2], ends]).ravel()[left > 0]
        part = (np.cumsum(left > 0) - 1)[half]
    return order


def _upper_halves(points: Floats, members: Ints, part: Ints, sizes: Ints) -> Bools:
    """(n,) which vertices are beyond the middle of their part along its longest direction."""
    stop = np.cumsum(sizes)
    start, middle = stop - sizes, stop - (sizes + 1) // 2
    reach = [points[along[stop - 1], axis] - points[along[start], axis] for axis, along in enumerate(members)]
    longest = np.argmax(reach, axis=0)
    cut, least = (points[members[longest, at], longest] for at in (middle, start))
    upper, all_of = np.zeros(len(points), dtype=bool), members[0]
    upper[all_of] = points[all_of, longest[part[all_of]]] >= cut[part[all_of]]
    for level in np.flatnonzero(cut == least):
        upper[members[longest[level], start[level] : middle[level]]] = False
    return upper


def minimum_degree(K: sp.csr_matrix) -> Ints:
    """The sparse solver's own order of K, for matrices without coordinates.

    An incomplete factorisation that drops everything costs little more than its order. It is taken of the pattern of
    K with a dominant diagonal, so that no pivot can fail.
    """
    pattern = sp.csc_matrix(K, copy=True)
    pattern.data[:] = 1.0
    dominant = pattern + K.shape[0] * sp.eye_array(K.shape[0], format="csc")
    return np.argsort(spilu(dominant, drop_tol=1e6, fill_factor=1, permc_spec="MMD_AT_PLUS_A").perm_c)


@dataclass(frozen=True)
class SuperLU(LinearSolver):
    """Sparse LU with diagonal pivots: the default up to two million unknowns."""

    eliminates: ClassVar[bool] = True

    def memory_in_space(self, unknowns: int) -> float:
        # Measured on cubes, on nested dissection, at the peak: .25, .66 GB of 13,600 and 26,040 unknowns.
        return float(236.0 * unknowns**1.46)

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PositiveFactor:
        return PositiveFactor(K)

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[PositiveFactor, Floats]:
        at_end = np.zeros(K.shape[0], dtype=bool)
        at_end[last] = True
        factor = PositiveFactor(K, np.concatenate([order[~at_end[order]], last]), len(last))
        return factor, factor.schur


class SparseFactor(Factor):
    """K = L U, in a given order of the unknowns, or in that of minimum degree; to solve with."""

    def __init__(self, K: sp.csr_matrix, order: Ints | None = None):
        self._order = np.arange(K.shape[0]) if order is None else order
        columns: Literal["MMD_AT_PLUS_A", "NATURAL"] = "MMD_AT_PLUS_A" if order is None else "NATURAL"
        ordered = sp.csc_matrix(K if order is None else K[order][:, order])
        # Symmetric mode: pivots stay on the diagonal, which a positive definite matrix allows, and which halves the
        # time (1.3 s against 3.1 s at 100k unknowns). Without equilibration powers of two stay powers of two.
        options = {"SymmetricMode": True, "Equil": False}
        try:
            self._lu = splu(ordered, permc_spec=columns, diag_pivot_thresh=0.0, options=options)
        except RuntimeError as error:
            raise singular() from error

    def solve(self, b: Floats) -> Floats:
        if not b.any():
            return np.zeros_like(b)
        x = np.empty_like(b)
        x[self._order] = self._lu.solve(b[self._order])
        return x

    def within(self, K_FF: Matrix, F: Ints) -> SparseFactor:
        return SparseFactor(sp.csr_matrix(K_FF))


class PositiveFactor(SparseFactor):
    """K = L U of a K that is positive definite by its pivots, and what can be read off the factors.

    Attributes
    ----------
    schur : (m, m) array
        The Schur complement L_cc U_cc onto the last m unknowns in the order.

    Raises
    ------
    SceneError
        K is not positive definite: pivots left the diagonal, or one is no larger than the rounding of what it is
        the rest of. With the diagonal's pivots K = L D L', and by Sylvester's law of inertia they have the signs
        of the eigenvalues. Of a K with a kernel and as many anchors this says that K is semidefinite: the Schur
        complements of [[K + E, P], [P', E_aa^{-1}]] onto either block have the same inertia (Haynsworth 1968),
        and that onto the second, of as many unknowns as there are modes, vanishes.
    """

    def __init__(self, K: sp.csr_matrix, order: Ints | None = None, m: int = 0):
        super().__init__(K, order)
        self._K = K
        L, U, pivoted = self._lu.L, self._lu.U, self._order[np.argsort(self._lu.perm_c)]
        pivots = U.diagonal()
        if not np.array_equal(self._lu.perm_r, self._lu.perm_c) or not (pivots > EPS * K.diagonal()[pivoted]).all():
            raise singular()
        # The solver may renumber within its elimination tree; that permutes L and U but changes no entry.
        place = self._lu.perm_c[len(self._order) - m :]
        S: Floats = (L[:, place][place] @ U[:, place][place]).toarray()
        self.schur = 0.5 * (S + S.T)
        self._unit, self._forces = self._random(L, pivots)
        for copied in (L, U):
            _release(copied)

    def random_energy(self, size: Floats) -> float:
        return weighted(size, self.compliance)

    @cached_property
    def lost(self) -> float:
        b, x, _ = self._samples
        return self._unit * self.energy(b - self._K @ x)

    @property
    def compliance(self) -> Floats:
        """(n,) the diagonal of K^{-1}, estimated once: the mean squares of x = K^{-1} b for the forces b of _random."""
        return self._samples[2]

    @cached_property
    def _samples(self) -> tuple[Floats, Floats, Floats]:
        """One of the forces of _random, its response x, and unit times the mean squares of all x; (n,) each."""
        x, b = self.solve(self._forces), self._forces[:, 0].copy()
        del self._forces
        return b, x[:, 0].copy(), self._unit / SAMPLES * np.einsum("ij,ij->i", x, x)

    def _random(self, L: sp.csc_array, D: Floats) -> tuple[float, Floats]:
        """A unit u, and forces (n, SAMPLES) L (D / u)^{1/2} z of the covariance K / u; z is normal.

        Their responses are of the covariance K^{-1} / u. With u a power of two roots are taken of the same numbers in
        all units.
        """
        unit = float(power_of_two(D.max(initial=0.0)))
        z = np.random.default_rng(0).standard_normal((len(D), SAMPLES))
        z *= np.sqrt(D / unit)[:, None]
        place = np.empty_like(self._order)
        place[self._order] = self._lu.perm_c
        return unit, (L @ z)[place]


def _release(factor: sp.csc_array) -> None:
    """Give back the memory of a copy of a factor.

    SciPy makes these copies beside the factors it solves with and keeps them for the next time they are asked for:
    22 million entries, 265 MB, on the paper's reference (h = 1/256). Nobody asks again.
    """
    for name, kept in (("data", 0), ("indices", 0), ("indptr", 1)):
        setattr(factor, name, getattr(factor, name)[:kept].copy())
