"""oneMKL's PARDISO: the supernodal Cholesky factorisation, through the package py-mkl-pardiso (extra ``mkl``).

With the unknowns c of a Schur complement named in `perm` and iparm[35] = 2, phase 12 factorises all of K and gives
S = K_cc - K_ci K_ii^{-1} K_ic, m x m numbers at the beginning of the solution array; phase 33 solves with the same
factors, 331 and 333 substitute forward and backward, K = L L', and leave x_c as it is.

That package runs on one thread. On several, the same phases are those of a threaded oneMKL (package mkl, extra
``threads``), with the same settings.

It orders the unknowns by itself (METIS). Unknowns whose rows have the same pattern, those of a node, it takes as one
(iparm[36] = -100: variable blocks, of equal rows only), which saves a fifth. Blocks of more
than 256 unknowns, those of cells of as many vertices, end the process. So blocks are asked for where rows are short:
unknowns of a block are all coupled to each other, and none is larger than a row.
"""

from __future__ import annotations

import ctypes
import os
import sys
import weakref
from collections.abc import Callable
from contextlib import suppress
from ctypes.util import find_library
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf
from scipy.sparse.linalg import splu

from vemcvx.arrays import EPS, Floats, Ints, power_of_two, whole
from vemcvx.errors import NotAccepted
from vemcvx.linear.factor import SAMPLES, DirectFactor, LinearSolver, Matrix, parts, singular
from vemcvx.linear.superlu import SuperLU, SuperLUFactor

PACKAGE = "pymklpardiso"
THREADS = "VEMCVX_THREADS"
"""The variable of the environment by which `--threads` reaches the processes of a study or a sweep."""


@dataclass(frozen=True)
class Pardiso(LinearSolver):
    """oneMKL's PARDISO (extra ``mkl``; x86-64 on Linux and Windows): a few times as fast as SuperLU.

    The default from a thousand unknowns on where it is installed (:func:`vemcvx.linear.choose_linear`).

    Parameters
    ----------
    threads : int, optional
        Threads that factorise and solve, and that the dense matrices of steps take where they are large. More than one
        need the extra ``threads``, a threaded oneMKL (x86-64 on Linux). By default as many as the environment says,
        VEMCVX_THREADS before MKL_NUM_THREADS before OMP_NUM_THREADS, where that is installed; else one. Answers on one
        thread and on several differ by rounding, within their certificates.
    """

    eliminates: ClassVar[bool] = True
    orders: ClassVar[bool] = True

    threads: int | None = None

    def __post_init__(self) -> None:
        if self.threads is not None:
            whole(self.threads, "Pardiso", "threads", "threads")

    @property
    def cores(self) -> int:
        if self.threads is not None:
            return self.threads
        asked = threads_of_environment()
        return asked if asked > 1 and _threaded() is not None else 1

    @staticmethod
    def installed() -> bool:
        """Return True if the package that has it is there, and has what is used of it."""
        return _solver_class() is not None or Pardiso().cores > 1

    def memory_in_space(self, unknowns: int) -> float:
        # Measured on cubes: .19, .39 GB of 26,040 and 44,400 unknowns.
        return float(190.0 * unknowns ** (4 / 3) + 2e3 * unknowns)

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PardisoFactor:
        factor = PardisoFactor(K, threads=self.cores)
        factor.check_definite()
        return factor

    def eliminate(self, K: sp.csr_matrix, order: Ints, last: Ints) -> tuple[PardisoFactor | SuperLUFactor, Floats]:
        inner = np.delete(np.arange(K.shape[0]), last)
        # Of a diagonal K_ii PARDISO's Schur complements read memory that nobody has written; a few rows tell.
        if len(last) and all(K[some][:, inner].nnz <= len(some) for some in (inner[:64], inner)):
            return SuperLU().eliminate(K, order, last)
        factor = PardisoFactor(K, last, self.cores)
        factor.check_definite()
        return factor, factor.schur


class PardisoFactor(DirectFactor):
    """K = L L' of a K that is positive definite; `schur` (m, m) is its Schur complement onto `last`, in their order."""

    def __init__(self, K: sp.csr_matrix, last: Ints | None = None, threads: int = 1):
        self._threads = threads
        self._exactly: tuple[Ints, Floats] = np.zeros(0, dtype=np.int64), np.zeros(0)
        self._K, self._last = K, np.zeros(0, dtype=np.int64) if last is None else last
        n, m, diagonal = K.shape[0], len(self._last), K.diagonal()
        # PARDISO ends the process where an entry of the diagonal is missing.
        if not (diagonal > 0).all():
            raise singular()
        self.unit = float(power_of_two(diagonal.max(initial=0.0)))
        self._pardiso = _with_values(K, self._last, self.unit, threads)
        # S comes in as many columns of n numbers as it needs, its unknowns in rising order.
        own = np.zeros((n, max(1, -(-m * m // max(n, 1)))), order="F")
        try:
            if n > 0:
                self._pardiso.run_phase_into(12, np.zeros_like(own, order="F"), own)
            S = own.ravel(order="F")[: m * m].reshape(m, m)
            if (np.diff(self._last) < 0).any():
                rank = np.argsort(np.argsort(self._last))
                S = S[np.ix_(rank, rank)]
        except RuntimeError as error:
            raise singular() from error
        upper, info = dpotrf(S.T, lower=0, clean=0) if m else (S, 0)
        if info > 0:
            raise singular()
        self._upper: Floats = upper
        self.schur: Floats = self.unit * S

    def check_definite(self) -> None:
        """Raise SceneError if K differs by no more than rounding from a singular matrix.

        That is where EPS K_ii (K^{-1})_ii >= 1 for some i, by an estimate that is taken for ten times as large.
        """
        if (EPS * self._K.diagonal() * self.compliance >= 0.1).any():
            raise singular()

    def random_motions(self) -> Floats:
        z = self._normal(SAMPLES)
        if len(self._last):
            z[self._last] = solve_triangular(self._upper, z[self._last], check_finite=False)
        return self._run(333, z)

    def _normal(self, count: int) -> Floats:
        """(n, count) the numbers z that random motions are made of, the first of them whatever their count."""
        return np.random.default_rng(0).standard_normal((count, self._K.shape[0])).T

    def solve(self, b: Floats) -> Floats:
        return self._run(33, b) / self.unit

    def energy(self, b: Floats) -> float:
        return float(self.energies_of_columns(b[:, None])[0])

    def energies(self, rows: sp.csr_matrix) -> Floats:
        if not (np.diff(rows.indptr) == 1).all():
            return super().energies(rows)
        # Those of 30,000 unknowns take minutes, and are asked for in two systems of units.
        if not np.array_equal(rows.indices, self._exactly[0]):
            unit = sp.csr_matrix((np.ones(rows.nnz), rows.indices, rows.indptr), shape=rows.shape)
            found = [self.energies_of_columns(unit[part].toarray().T) for part in parts(*rows.shape)]
            self._exactly = rows.indices.astype(np.int64), np.concatenate([np.zeros(0), *found])
        return np.asarray(rows.data**2 * self._exactly[1])

    def energies_of_columns(self, b: Floats) -> Floats:
        z = self._forward(b)
        return np.einsum("ij,ij->j", z, z) / self.unit

    @cached_property
    def lost(self) -> float:
        """|E z|^2 as L^{-1}K x - z of a random motion x = L'^{-1}z, by the forward half of a solve."""
        off = self._forward((self._K @ self._samples[0] / self.unit)[:, None]) - self._normal(1)
        return float(np.vdot(off, off))

    def _forward(self, b: Floats) -> Floats:
        """L^{-1} b of columns (n, k)."""
        z = self._run(331, b)
        if len(self._last):
            z[self._last] = solve_triangular(self._upper, z[self._last], trans=1, check_finite=False)
        return z

    @property
    def halves(self) -> PardisoFactor | None:
        return self if len(self._last) else None

    def halved(self, b: Floats) -> tuple[Floats, Floats]:
        z = self._run(331, b)
        tau = z[self._last]
        z[self._last] = 0.0
        return z, tau

    def completed(self, z: Floats, x_c: Floats) -> Floats:
        x = z / self.unit
        x[self._last] = x_c
        return self._run(333, x)

    def product(self, z: Floats, other: Floats) -> float:
        return float(z @ other) / self.unit

    def within(self, K_FF: Matrix, F: Ints) -> PardisoFactor:
        return PardisoFactor(sp.csr_matrix(K_FF), threads=self._threads)

    def _run(self, phase: int, b: Floats) -> Floats:
        b = np.asfortranarray(b, dtype=float)
        x = np.zeros_like(b)
        if b.any():
            self._pardiso.run_phase_into(phase, b, x)
        return x


def _solver_class() -> Any:
    """The solver of the package, if that is there and has it; else None.

    Not its class for users, which looks at every row in a Python loop first: a fifth of the factorisation.
    """
    with suppress(ImportError):
        return getattr(import_module(PACKAGE), "_PardisoSolver", None)
    return None


def _with_values(K: sp.csr_matrix, last: Ints, unit: float, threads: int) -> Any:
    """A solver that holds K / unit, by its upper triangle: the package's on one thread, else :class:`Threaded`."""
    n = K.shape[0]
    if n == 0:
        return None
    if not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    # SciPy's triu orders entries anew, which takes half as long again.
    upper = K.indices >= np.repeat(np.arange(n, dtype=K.indices.dtype), np.diff(K.indptr))
    # Settings of its own, METIS (on several threads the same order, in .19 s where it takes .30 at 131,000 unknowns in
    # the plane), factorisation in two levels, indices from zero.
    settings = {0: 1, 1: 3 if threads > 1 else 2, 23: 1, 34: 1}
    if len(last):
        settings[35] = 2
    if np.diff(K.indptr).max() <= 128:  # Half of the largest block that PARDISO takes.
        settings[36] = -100
    values, ja = K.data[upper] / unit, K.indices[upper].astype(np.int64)
    ia = np.append(0, np.cumsum(upper))[K.indptr].astype(np.int64)
    chosen = np.zeros(n, dtype=np.int64)
    chosen[last] = 1
    if threads > 1:
        return Threaded(threads, settings, (values, ia, ja, chosen))
    if (kind := _solver_class()) is None:
        raise NotAccepted(
            "Pardiso: the package py-mkl-pardiso (0.0.6 or a later 0.0) is not installed; pip install 'vemcvx[mkl]' "
            "(x86-64 on Linux and Windows), or use SuperLU()."
        )
    solver = kind(POSITIVE_DEFINITE, 0)
    for number, value in settings.items():
        solver.set_iparm(number, value)
    solver.set_pattern(ia=ia, ja=ja, n=n)
    if len(last):
        solver.set_perm(chosen)
    solver.set_values(values)
    return solver


def opened(M: sp.csr_matrix) -> Callable[[Floats], Floats]:
    """M^{-1} of vectors (n,), of an M that is not symmetric; by SuperLU where PARDISO is not installed.

    RuntimeError where M is singular; but PARDISO shifts pivots that vanish, which residuals show.
    """
    if (kind := _solver_class()) is None:
        return splu(sp.csc_matrix(M), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1).solve
    solver, n = kind(UNSYMMETRIC, 0), M.shape[0]
    M.sort_indices()
    for number, value in ((0, 1), (1, 2), (9, 13), (34, 1)):
        solver.set_iparm(number, value)
    solver.set_pattern(ia=M.indptr.astype(np.int64), ja=M.indices.astype(np.int64), n=n)
    solver.set_values(M.data)
    solver.run_phase_into(12, np.zeros(n), np.zeros(n))

    def solve(b: Floats) -> Floats:
        x = np.zeros(n)
        solver.run_phase_into(33, b, x)
        return x

    return solve


POSITIVE_DEFINITE, UNSYMMETRIC = 2, 11
"""PARDISO's numbers for real matrices that are symmetric and positive definite, and for any."""


class Threaded:
    """PARDISO of a threaded oneMKL, which runs phases as the solver of py-mkl-pardiso does.

    The number of threads is set for the calling thread, for as long as a phase takes: the rest of the process keeps its
    own.
    """

    def __init__(self, threads: int, settings: dict[int, int], matrix: tuple[Floats, Ints, Ints, Ints]):
        check_threads(threads)
        self._library, self._threads, self._matrix = _threaded(), threads, matrix
        self._handle, self._iparm = np.zeros(64, dtype=np.int64), np.zeros(64, dtype=np.int64)
        self._iparm[list(settings)] = list(settings.values())
        weakref.finalize(self, _call, self._library, threads, self._arguments(-1, np.zeros(1), np.zeros(1)))

    def run_phase_into(self, phase: int, b: Floats, x: Floats) -> None:
        if error := _call(self._library, self._threads, self._arguments(phase, b, x)):
            raise RuntimeError(f"PARDISO: phase {phase} ended with error {error}.")

    def _arguments(self, phase: int, b: Floats, x: Floats) -> list[Any]:
        """The arguments of pardiso_64, but for the error; arrays are kept alive by whoever holds them."""
        columns, n = 1 if b.ndim == 1 else b.shape[1], len(self._matrix[-1])
        return [self._handle, 1, 1, POSITIVE_DEFINITE, phase, n, *self._matrix, columns, self._iparm, 0, b, x]


def _call(library: Any, threads: int, given: list[Any]) -> int:
    """PARDISO's error, zero where there is none."""
    error, before = ctypes.c_int64(), library.MKL_Set_Num_Threads_Local(threads)
    try:
        library.pardiso_64(*map(_pointer, given), ctypes.byref(error))
    finally:
        library.MKL_Set_Num_Threads_Local(before)
    return error.value


def _pointer(value: Any) -> Any:
    return (
        value.ctypes.data_as(ctypes.c_void_p) if isinstance(value, np.ndarray) else ctypes.byref(ctypes.c_int64(value))
    )


def threads_of_environment() -> int:
    """The threads that the first of these variables asks for; one where none does."""
    for name in (THREADS, "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        first = os.environ.get(name, "").partition(",")[0].strip()
        if first.isdecimal() and int(first) > 0:
            return int(first)
    return 1


def check_threads(threads: int) -> None:
    """Raise NotAccepted where more than one thread is asked for and there is no threaded oneMKL."""
    if threads > 1 and _threaded() is None:
        raise NotAccepted(
            f"Pardiso: {threads} threads need a threaded oneMKL, libmkl_rt, which is not installed; pip install "
            "'vemcvx[threads]' (the package mkl, x86-64 on Linux), or use Pardiso(threads=1)."
        )


@cache
def _threaded() -> Any:
    """The threaded oneMKL of this environment or of the system, None where there is none."""
    # Its symbols are global: the package, were it imported later, would run in it, on its threads and with its digits.
    _solver_class()
    found = [*map(str, sorted((Path(sys.prefix) / "lib").glob("libmkl_rt.so*"))), find_library("mkl_rt")]
    for name in found:
        with suppress(OSError, AttributeError):
            library = ctypes.CDLL(name or "")
            if name and library.pardiso_64 and library.MKL_Set_Num_Threads_Local:
                return library
    return None
