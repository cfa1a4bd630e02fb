"""Factors of symmetric positive definite matrices: their interface, dense Cholesky, and a factor in other units.

Everything above asks a :class:`LinearSolver` for factors. If the unknowns c come last in K = L L', the Schur complement
onto them is S = L_cc L_cc', the trailing block of the factor, which costs no more than the factorisation; one solve an
unknown of c would cost six factorisations on the paper's reference (h = 1/256).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dlauum, dpotrf, dpotrs, dtrtri
from scipy.sparse.linalg import LinearOperator, cg

from vemcvx.arrays import Bools, Floats, Ints, power_of_two
from vemcvx.errors import NotAccepted, SceneError
from vemcvx.linear.products import Congruent, Elsewhere

Matrix = Floats | sp.csr_matrix
"""Of a program: dense where it was condensed, sparse where it was not. Where solves are iterative a `Congruent` may
stand for a sparse one: it is multiplied by, added to and restricted, and its entries are not read."""

Cycle = Callable[[Floats], Floats]
"""b (n,) -> an approximation of K^{-1} b, linear, symmetric and positive definite in b."""

SAMPLES = 8
"""Random forces or motions from which energies of others are estimated."""
AT_ONCE = 2**25
"""The most entries, 256 MB of them, of right sides that are solved for together."""


class Halves(Protocol):
    """Forward and backward substitution with K = L L', the unknowns c eliminated last and all others i.

    The force on c while it is held needs the first half alone; a combination of forces needs the second half once.
    """

    def halved(self, b: Floats) -> tuple[Floats, Floats]:
        """z (n,), L_ii^{-1} b_i in some unit, zero on c; and b_c - K_ci K_ii^{-1} b_i, its force on c if c is held."""

    def completed(self, z: Floats, x_c: Floats) -> Floats:
        """x (n,) with these x_c and (K x)_i = b_i, from the half z of b; or (n, k), column by column."""

    def product(self, z: Floats, other: Floats) -> float:
        """a_i'K_ii^{-1} b_i of two forces a and b, from their halves z."""


class Factor(ABC):
    """A matrix ready to be solved with."""

    exact: bool = True
    """True if it solves to rounding; an iterative one takes less time for less sharp answers."""

    @property
    def halves(self) -> Halves | None:
        """The two halves of a solve, where it has them; None where it solves for all unknowns only."""
        return None

    @property
    def lost(self) -> float:
        """The square of the part of an energy norm that one solve loses at most, estimated; infinite where unknown."""
        return np.inf

    @abstractmethod
    def solve(self, b: Floats) -> Floats:
        """x with K x = b; (n,) or (n, k)."""

    @abstractmethod
    def within(self, K_FF: Matrix, F: Ints) -> Factor:
        """A factor of a matrix on the unknowns F alone, K_FF being K there up to added stiffness; to solve with."""

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle | None:
        """A preconditioner of K + S on the `free` unknowns, where solving is iterative."""
        return None

    def rough(self, b: Floats) -> Floats:
        """K^{-1} b (n,), for sizes: an iterative one is not sharp."""
        return self.solve(b)

    def energy(self, b: Floats) -> float:
        """b'K^{-1}b of a force (n,); if it is solved inexactly a bound from above: certificates rest on it."""
        return abs(float(b @ self.solve(b)))

    def energies_of_columns(self, b: Floats) -> Floats:
        """b'K^{-1}b of every column of an array (n, k), (k,), each as `energy` has it but for rounding."""
        return np.array([self.energy(one) for one in b.T])

    def energies(self, rows: sp.csr_matrix) -> Floats:
        """b'K^{-1}b of every row b of a matrix (m, n), (m,)."""
        each = (rows[part].toarray() for part in parts(*rows.shape))
        found = [np.einsum("ij,ji->i", part, self.solve(np.ascontiguousarray(part.T))) for part in each]
        return np.concatenate([np.zeros(0), *found])

    def flexibility(self, some: Ints, n: int) -> Floats:
        """K^{-1} (n, n) of the unknowns `some` (k,) alone, (k, k)."""
        found = np.empty((len(some), len(some)))
        for part in parts(len(some), n):
            own = some[part]
            unit = np.zeros((n, len(own)))
            unit[own, np.arange(len(own))] = 1.0
            found[:, part] = self.solve(unit)[some]
        return found

    def random_energy(self, size: Floats) -> float:
        """The mean of b'K^{-1}b over forces b of independent entries, of mean zero and deviations `size` (n,).

        That is sum size_i^2 (K^{-1})_ii, estimated by the mean of SAMPLES of them: one may be far too small.
        """
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (SAMPLES, len(size)))
        return float(np.mean([self.energy(size * sign) for sign in signs]))


def parts(count: int, n: int) -> Iterator[slice]:
    """Slices of so many right sides (n,), each of at most AT_ONCE entries: 708 of a million unknowns take 6 GB."""
    together = max(1, AT_ONCE // max(n, 1))
    return (slice(first, first + together) for first in range(0, count, together))


class DirectFactor(Factor):
    """K = L L' of a sparse matrix, and estimates from motions x = L'^{-1} z, z normal, whose covariance is K^{-1}."""

    _K: sp.csr_matrix
    unit: float
    """A power of two near the entries of K: roots are taken of the same numbers in all units."""

    @abstractmethod
    def random_motions(self) -> Floats:
        """Motions (n, SAMPLES) of the covariance (K / unit)^{-1}."""

    @cached_property
    def _samples(self) -> tuple[Floats, Floats]:
        """One of the random motions, and the diagonal of K^{-1} from the mean squares of all; (n,) each."""
        x = self.random_motions()
        return x[:, 0].copy(), np.einsum("ij,ij->i", x, x) / (SAMPLES * self.unit)

    @property
    def compliance(self) -> Floats:
        """(n,) the diagonal of K^{-1}, estimated; less than a tenth of it once in a thousand times."""
        return self._samples[1]

    def random_energy(self, size: Floats) -> float:
        # Squares of forces below 1e-154 would be none.
        largest = float(power_of_two(size.max(initial=0.0)))
        return largest * (largest * float((size / largest) ** 2 @ self.compliance))

    @cached_property
    def lost(self) -> float:
        """The energy of the error of one solve for a random motion.

        With LL' in place of K its mean is |E|^2, E = L^{-1}(K - LL')L'^{-1}, the sum of squares of the entries of E.
        """
        x = self._samples[0]
        off = self.solve(self._K @ x) - x
        return float(off @ (self._K @ off)) / self.unit


class DenseCholesky(Factor):
    """K = R'R of a dense matrix."""

    _upper: Floats

    def __init__(self, K: Floats):
        # LAPACK without SciPy's checks: they take longer than factorising 100 unknowns. It reads columns: as rows of
        # K', which is K, these are copied in half the time that it takes to factorise 256.
        self._upper, info = dpotrf(K.T, lower=0) if len(K) else (K, 0)
        if info > 0:
            raise singular()

    def solve(self, b: Floats) -> Floats:
        if len(self._upper) == 0:
            return b.copy()
        # For one right side LAPACK takes the path of many: five times as long at 256 unknowns.
        one = b.ndim == 1
        return dtrsv(self._upper, dtrsv(self._upper, b, trans=1)) if one else dpotrs(self._upper, b, lower=0)[0]

    def energy(self, b: Floats) -> float:
        z = dtrsv(self._upper, b, trans=1) if len(b) else b
        return float(z @ z)

    def energies(self, rows: sp.csr_matrix) -> Floats:
        if len(self._upper) == 0:
            return np.zeros(rows.shape[0])
        if (np.diff(rows.indptr) == 1).all():
            return rows.data**2 * self._compliance[rows.indices]
        moved = rows @ self._inverse
        return np.einsum("ij,ij->i", moved, moved)

    @cached_property
    def _compliance(self) -> Floats:
        """(n,) the diagonal of K^{-1}."""
        return np.einsum("ij,ij->i", self._inverse, self._inverse)

    @cached_property
    def _inverse(self) -> Floats:
        """R^{-1}, which takes a sixth of the work of solving for as many right sides; zero below the diagonal, as R."""
        return np.asarray(dtrtri(self._upper, lower=0)[0])

    def flexibility(self, some: Ints, n: int) -> Floats:
        if n == 0:
            return np.zeros((0, 0))
        # Zero below the diagonal, as R^{-1} is.
        upper = dlauum(self._inverse, lower=0)[0]
        whole = upper + upper.T
        whole[np.diag_indices(n)] *= 0.5
        return np.asarray(whole if len(some) == n else whole.take(some, 0).take(some, 1))

    def within(self, K_FF: Matrix, F: Ints) -> DenseCholesky:
        return DenseCholesky(K_FF if isinstance(K_FF, np.ndarray) else K_FF.toarray())


class Scaled(Factor):
    """A factor of D K D / kappa, from one of K: K is factorised once for both."""

    def __init__(self, factor: Factor, D: Floats, kappa: float):
        self._factor, self._D, self._kappa, self.exact = factor, D, kappa, factor.exact

    def solve(self, b: Floats) -> Floats:
        D = self._D if b.ndim == 1 else self._D[:, None]
        return self._kappa * (self._factor.solve(b / D) / D)

    def within(self, K_FF: Matrix, F: Ints) -> Scaled:
        return Scaled(self._factor.within(self._unscaled(K_FF, self._D[F]), F), self._D[F], self._kappa)

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle | None:
        D, kappa, inner = self._D, self._kappa, self._factor.cycle(self._unscaled(S, self._D), free)
        return None if inner is None else lambda b: kappa * (inner(b / D) / D)

    def _unscaled(self, A: Matrix, D: Floats) -> Any:
        if isinstance(A, Congruent):
            return A.scaled(1.0 / D, self._kappa)
        unscaled = sp.csr_matrix(A, copy=True)
        unscaled.data *= self._kappa / D[unscaled.indices] / np.repeat(D, np.diff(unscaled.indptr))
        return unscaled

    def rough(self, b: Floats) -> Floats:
        return self._kappa * (self._factor.rough(b / self._D) / self._D)

    def energy(self, b: Floats) -> float:
        return self._kappa * self._factor.energy(b / self._D)

    def energies(self, rows: sp.csr_matrix) -> Floats:
        return self._kappa * self._factor.energies(sp.csr_matrix(rows @ sp.diags_array(1.0 / self._D)))

    def flexibility(self, some: Ints, n: int) -> Floats:
        undo = 1.0 / self._D[some]
        return np.asarray(self._kappa * undo[:, None] * self._factor.flexibility(some, n) * undo)


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
    """True if it gives Schur complements, so that programs are condensed."""
    orders: ClassVar[bool] = False
    """True if it orders the unknowns by itself; none is then computed for it."""

    @property
    def cores(self) -> int:
        """Threads that it takes; dense matrices of steps, where they are large, take as many.

        Where they are several, answers need not have the digits of one thread: steps are then solved for together.
        """
        return 1

    def memory_in_space(self, unknowns: int) -> float:
        """Bytes that a factor takes in space, about, where factors are fullest; nan where it is not known."""
        return np.nan

    def held(self, made: Callable[[int, int], sp.csr_matrix], n: int) -> Elsewhere | None:
        """K (n, n) where this solver holds it; None where K is to be a sparse matrix here.

        `made` makes the rows of K from one number to another.
        """
        return None

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


def singular() -> SceneError:
    """The error for a stiffness matrix that some motion does not feel, or that some motion gains energy from."""
    return SceneError(
        "the stiffness matrix is singular or indefinite: some motion of the body costs no energy, or gains some. "
        "Add supports (Clamp, PrescribedDisplacement, BilateralContact) that exclude it; the K of a System must be "
        "positive definite."
    )
