"""oneMKL's PARDISO: the supernodal Cholesky factorisation, through the package py-mkl-pardiso (extra ``mkl``).

With the unknowns c of a Schur complement named in `perm` and iparm[35] = 2, phase 12 factorises all of K and gives
S = K_cc - K_ci K_ii^{-1} K_ic, m x m numbers at the beginning of the solution array; phase 33 solves with the same
factors. Phase 333 is the backward substitution of K = L L' alone: of z normal, x = L'^{-1} z has the covariance K^{-1}.
With a Schur complement it takes x_c as it is, so that x_c = R^{-1} z_c there, S = R'R.

It orders the unknowns by itself (METIS) and runs on one thread in the wheel of that package. Unknowns whose rows have
the same pattern, those of a node, it takes as one (iparm[36] = -100: variable blocks, of equal rows only), which saves
a fifth. Blocks of more than 256 unknowns, those of cells of as many vertices, end the process. So blocks are asked for
where rows are short: unknowns of a block are all coupled to each other, and none is larger than a row.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cholesky, solve_triangular

from vemcvx.arrays import EPS, Floats, Ints, power_of_two
from vemcvx.errors import NotAccepted
from vemcvx.linear.factor import SAMPLES, Factor, LinearSolver, Matrix, singular, weighted

PACKAGE = "pymklpardiso"
FACTORISE, SOLVE, FORWARD, BACKWARD = 12, 33, 331, 333
OWN_SETTINGS, METIS, TWO_LEVELS, FROM_ZERO = (0, 1), (1, 2), (23, 1), (34, 1)
SCHUR_AND_FACTORS, EQUAL_ROWS = (35, 2), (36, -100)


@dataclass(frozen=True)
class Pardiso(LinearSolver):
    """oneMKL's PARDISO (extra ``mkl``; x86-64 on Linux and Windows): a few times as fast as SuperLU, on one thread.

    The default from a thousand unknowns on where it is installed (:func:`vemcvx.linear.choose_linear`).
    """

    eliminates: ClassVar[bool] = True
    orders: ClassVar[bool] = True

    @staticmethod
    def installed() -> bool:
        """Return True if the package that has it is there, and has what is used of it."""
        return _solver_class() is not None

    def memory_in_space(self, unknowns: int) -> float:
        # Measured on cubes: .19, .39 GB of 26,040 and 44,400 unknowns.
        return float(190.0 * unknowns ** (4 / 3) + 2e3 * unknowns)

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PardisoFactor:
        return PardisoFactor(K).definite()

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[PardisoFactor, Floats]:
        factor = PardisoFactor(K, last).definite()
        return factor, factor.schur


class PardisoFactor(Factor):
    """K = L L' of a K that is positive definite.

    Attributes
    ----------
    schur : (m, m) array
        The Schur complement onto the unknowns `last`, in their order.

    Raises
    ------
    SceneError
        A pivot is not positive, or an entry of the diagonal.
    """

    def __init__(self, K: sp.csr_matrix, last: Ints | None = None):
        last = np.zeros(0, dtype=np.int64) if last is None else last
        self._K, self._diagonal = K, K.diagonal()
        if not (self._diagonal > 0).all():
            # PARDISO ends the process where an entry of the diagonal is missing.
            raise singular()
        self._rising = np.argsort(last)
        self._n, rising = K.shape[0], last[self._rising]
        # Roots are taken of the same numbers in all units.
        self._unit = float(power_of_two(self._diagonal.max(initial=0.0)))
        isolated = _schur_of_isolated(K, rising)
        self._last = rising if isolated is None else rising[:0]
        longest = np.diff(K.indptr).max(initial=0)
        if not K.has_canonical_format:
            K = K.copy()
            K.sum_duplicates()
        upper = sp.triu(K, format="csr")
        upper.data /= self._unit
        # Blocks are asked for where rows have at most 128 entries, half of the largest block that PARDISO takes.
        self._pardiso = _with_values(upper, self._last, longest <= 128)
        own = self._factorised()
        self._upper: Floats = _cholesky(own)
        rank = np.argsort(self._rising)
        self.schur: Floats = (self._unit * own if isolated is None else isolated)[np.ix_(rank, rank)]

    def definite(self) -> PardisoFactor:
        """The factor itself; SceneError if K differs by no more than rounding from a singular matrix.

        That is where EPS K_ii (K^{-1})_ii >= 1 for some i, by an estimate that is taken for ten times as large.
        """
        # The mean of SAMPLES squares is less than a tenth of (K^{-1})_ii once in a thousand times.
        if (EPS * self._diagonal * self.compliance >= 0.1).any():
            raise singular()
        return self

    def solve(self, b: Floats) -> Floats:
        return self._run(SOLVE, b) / self._unit if b.any() else np.zeros_like(b)

    @property
    def halves(self) -> PardisoFactor | None:
        return self if len(self._last) else None

    def halved(self, b: Floats) -> tuple[Floats, Floats]:
        z, tau = self._run(FORWARD, b) if b.any() else np.zeros_like(b), np.empty(len(self._last))
        tau[self._rising] = z[self._last]
        z[self._last] = 0.0
        return z, tau

    def completed(self, z: Floats, x_c: Floats) -> Floats:
        x = z / self._unit
        x[self._last] = x_c[self._rising]
        return self._run(BACKWARD, x) if x.any() else x

    def product(self, z: Floats, other: Floats) -> float:
        return float(z @ other) / self._unit

    def energy(self, b: Floats) -> float:
        z = self._forward(b)
        return float(z @ z) / self._unit

    def random_energy(self, size: Floats) -> float:
        return weighted(size, self.compliance)

    @cached_property
    def lost(self) -> float:
        if self._n == 0:
            return 0.0
        z, x, _ = self._samples
        # L z would be K x / unit if nothing were lost.
        off = self._forward(self._K @ x / self._unit) - z
        return float(off @ off)

    @property
    def compliance(self) -> Floats:
        """(n,) the diagonal of K^{-1}, estimated once: the mean squares of SAMPLES x of the covariance K^{-1}."""
        return self._samples[2]

    @cached_property
    def _samples(self) -> tuple[Floats, Floats, Floats]:
        """z (n,) normal and x = L'^{-1} z, K / unit = L L', for one; and the mean squares of SAMPLES x / unit^{1/2}."""
        if self._n == 0:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        z = np.random.default_rng(0).standard_normal((SAMPLES, self._n)).T
        one = z[:, 0].copy()
        if len(self._last):
            z[self._last] = solve_triangular(self._upper, z[self._last])
        x = self._run(BACKWARD, z)
        return one, x[:, 0].copy(), np.einsum("ij,ij->i", x, x) / (SAMPLES * self._unit)

    def _forward(self, b: Floats) -> Floats:
        """L^{-1} b (n,), K / unit = L L'."""
        z = self._run(FORWARD, b) if b.any() else np.zeros_like(b)
        if len(self._last):  # PARDISO leaves out the factor of S.
            z[self._last] = solve_triangular(self._upper, z[self._last], trans=1)
        return z

    def within(self, K_FF: Matrix, F: Ints) -> PardisoFactor:
        return PardisoFactor(sp.csr_matrix(K_FF))

    def _factorised(self) -> Floats:
        """S (m, m), the unknowns in rising order; it comes in as many columns of n numbers as it needs."""
        m = len(self._last)
        if self._n == 0:
            return np.zeros((0, 0))
        shape = (self._n, max(1, -(-m * m // self._n)))
        x = np.zeros(shape, order="F")
        try:
            self._pardiso.run_phase_into(FACTORISE, np.zeros(shape, order="F"), x)
        except RuntimeError as error:
            raise singular() from error
        S: Floats = x.ravel(order="F")[: m * m].reshape(m, m).copy()
        return S

    def _run(self, phase: int, b: Floats) -> Floats:
        b = np.asfortranarray(b, dtype=float)
        x = np.empty_like(b)
        self._pardiso.run_phase_into(phase, b, x)
        return x


def _solver_class() -> Any:
    """The solver of the package, if that is there and has it; else None.

    Not its class for users, which looks at every row in a Python loop first: a fifth of the factorisation.
    """
    with suppress(ImportError):
        return getattr(import_module(PACKAGE), "_PardisoSolver", None)
    return None


def _with_values(upper: sp.csr_matrix, last: Ints, blocks: bool) -> Any:
    """A solver of the package that holds a matrix, given by its upper triangle, unknowns of equal rows in `blocks`."""
    if (kind := _solver_class()) is None:
        raise NotAccepted(
            "Pardiso: the package py-mkl-pardiso (0.0.6 or a later 0.0) is not installed; pip install 'vemcvx[mkl]' "
            "(x86-64 on Linux and Windows), or use SuperLU()."
        )
    n, solver = upper.shape[0], kind(2, 0)  # 2: symmetric positive definite
    for number, value in (OWN_SETTINGS, METIS, TWO_LEVELS, FROM_ZERO):
        solver.set_iparm(number, value)
    if len(last):
        solver.set_iparm(*SCHUR_AND_FACTORS)
    if blocks:
        solver.set_iparm(*EQUAL_ROWS)
    if n == 0:
        return solver
    solver.set_pattern(ia=upper.indptr.astype(np.int64), ja=upper.indices.astype(np.int64), n=n)
    if len(last):
        chosen = np.zeros(n, dtype=np.int64)
        chosen[last] = 1
        solver.set_perm(chosen)
    solver.set_values(upper.data)
    return solver


def _schur_of_isolated(K: sp.csr_matrix, last: Ints) -> Floats | None:
    """S (m, m) where all other unknowns are coupled to those of S alone, if at all; None where some are to each other.

    Of a diagonal K_ii PARDISO's Schur complements read memory that nobody has written, and may end the process.
    """
    inner = np.ones(K.shape[0], dtype=bool)
    inner[last] = False
    others = np.flatnonzero(inner)
    # A few rows tell, as a rule.
    for some in (others[:64], others):
        if K[some][:, others].nnz > len(some):
            return None
    K_ci = K[last][:, others]
    S: Floats = K[last][:, last].toarray() - (K_ci @ sp.diags_array(1.0 / K.diagonal()[others]) @ K_ci.T).toarray()
    return 0.5 * (S + S.T)


def _cholesky(S: Floats) -> Floats:
    """R with S = R'R."""
    if len(S) == 0:
        return S
    try:
        upper: Floats = cholesky(S)
    except np.linalg.LinAlgError as error:
        raise singular() from error
    return upper
