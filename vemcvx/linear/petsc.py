"""PETSc's conjugate gradients with algebraic multigrid (GAMG) over the ranks of MPI, for K beyond one machine's cores.

Rank 0 poses the problem, holds K and steps. Every rank holds a block of K's rows in PETSc, in the order of the
unknowns, its part of the hierarchy, and its part of vectors. The other ranks wait for the calls of rank 0
(:func:`serve`). A call names a method of :class:`RankSolver` that all ranks then execute together.

GAMG smooths its aggregates from the rigid motions, as :mod:`vemcvx.linear.iterative` does, and smooths by Chebyshev
polynomials of the same degree before and after the coarse correction. The polynomial is self-adjoint in the energy. The
coarse correction is a projection there, or an operator with eigenvalues of at most one. So the cycle M is symmetric, no
eigenvalue of MK exceeds one, and the bounds of that module hold.
"""

from __future__ import annotations

import atexit
import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SOME, Floats, power_of_two
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.linear.iterative import Iterative, IterativeFactor, lowest_eigenvalue
from vemcvx.linear.superlu import SuperLU

PREFIX = "vemcvx_"
"""Prefix of the options of this module in PETSc's data base, which all of the process shares."""
OPTIONS = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "gamg",
    # All couplings count. For 200,080 unknowns in space set-up takes 4.9 s on one rank, and a solve 4.7 s in 33
    # iterations. With .01, which leaves weak couplings out, coarse matrices are fuller: 75 s, 13.4 s, 29 iterations.
    "pc_gamg_threshold": "-1",
    # Otherwise the coarsest matrix is solved by blocks, one a rank, and eigenvalues of MK could exceed one.
    "mg_coarse_pc_type": "redundant",
    # Aggregates of fewer unknowns than rigid motions leave coarse unknowns without stiffness; factors divide by zero.
    "mg_coarse_redundant_pc_type": "svd",
}
SMALL = 1_000
"""Unknowns below which K is factorised, too: GAMG may then have a single level, and the factor takes 5 ms."""
CALL, BLOCK = 1, 2
"""Tags of messages: the call of a method, and a block of rows."""
log = logging.getLogger("vemcvx")


@dataclass(frozen=True)
class PETSc(Iterative):
    """PETSc (extra ``petsc``): K in row blocks over the ranks of MPI, conjugate gradients with multigrid.

    On one rank it needs no mpiexec. ``mpiexec -n 8 vemcvx run FILE --linear petsc`` shares hierarchy and solves among
    eight ranks; in scripts under mpiexec, ranks above 0 call :func:`vemcvx.linear.petsc.serve` in place of the
    simulation. Rank 0 holds all of K, too.

    Parameters, certificates and the bodies that it suits are those of ``Iterative``.
    """

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PETScFactor:
        ranks = all_ranks()
        if ranks.comm.rank > 0:
            raise NotAccepted("PETSc: ranks above 0 do not simulate; they call vemcvx.linear.petsc.serve() instead.")
        K = sp.csr_matrix(K)
        held = OverRanks(ranks, K, near_kernel)
        if K.shape[0] < SMALL:  # The inverse on the coarsest level would hide that K is singular.
            SuperLU().factorise(K)
        return PETScFactor(self, K, held, lowest_eigenvalue(K, held.cycle, "PETSc"))


class PETScFactor(IterativeFactor):
    """The factor of a K that all ranks solve with."""

    def __init__(self, limits: PETSc, K: sp.csr_matrix, held: OverRanks, lowest: float):
        super().__init__(limits, K, held.cycle, lowest)
        self._held = held

    def _iterate(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        return self._held.solve(b, tolerance, self._limits.max_iterations) if b.any() else (np.zeros_like(b), 0)


class OverRanks:
    """Rank 0's view of a hierarchy that all ranks hold: its methods are called on all of them."""

    def __init__(self, ranks: Ranks, K: sp.csr_matrix, near_kernel: Floats | None):
        self._ranks, self._number = ranks, ranks.next_number()
        # PETSc takes singular values below 1e-12 for zeros, whatever the unit.
        self._unit = float(power_of_two(K.diagonal().max(initial=0.0)))
        motions = np.zeros((K.shape[0], 0)) if near_kernel is None else np.linalg.qr(near_kernel)[0]
        ranks.call(self._number, "set_up", (K.shape[0],), K / self._unit, motions)

    def __del__(self) -> None:
        # All ranks free the memory together, when they set up the next matrix.
        self._ranks.forgotten.append(self._number)

    def solve(self, b: Floats, tolerance: float, iterations: int) -> tuple[Floats, int]:
        """Return an approximation of K^{-1} b, and 0 if its residual meets the tolerance."""
        x, failed = self._ranks.call(self._number, "solve", (tolerance, iterations), b)
        return x / self._unit, failed

    def cycle(self, b: Floats) -> Floats:
        """Return M b."""
        found: Floats = self._ranks.call(self._number, "cycle", (), b)
        return found / self._unit


class Ranks:
    """The ranks of a process: what this rank holds of every matrix, by number, and the messages between ranks."""

    def __init__(self) -> None:
        # A rank that spins while it waits takes cores from the ranks that work, if other programs use cores, too:
        # solves took five times as long on two cores with a load of ten.
        os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
        import petsc4py

        petsc4py.init(["vemcvx", "-no_signal_handler"])  # Signals end a command in order.
        from mpi4py import MPI

        self.comm, self._number = MPI.COMM_WORLD.Dup(), 0
        self.held: dict[int, RankSolver] = {}
        self.forgotten: list[int] = []
        if self.comm.rank == 0:
            atexit.register(self._tell, None)

    def next_number(self) -> int:
        """Return a number that no matrix had."""
        self._number += 1
        return self._number

    def call(self, number: int, name: str, shared: tuple[Any, ...], *own: Any) -> Any:
        """Call a method on all ranks, with `shared` arguments, and on rank 0 with its `own` arguments after these."""
        if name == "set_up":
            self.forgotten, gone = [], self.forgotten
            shared = gone, *shared
        self._tell((number, name, shared))
        try:
            return self.obey(number, name, shared, *own)
        except Exception as error:
            if self.comm.size == 1:
                raise SceneError(f"PETSc: {_first_words(error)}") from error
            self.end_all(error)

    def obey(self, number: int, name: str, shared: tuple[Any, ...], *own: Any) -> Any:
        """Execute a call on this rank."""
        if name != "set_up":
            return getattr(self.held[number], name)(*shared, *own)
        gone, *rest = shared
        for old in gone:
            self.held.pop(old).destroy()
        self.held[number] = RankSolver(self.comm, *rest, *own)
        return None

    def _tell(self, call: object) -> None:
        for rank in range(1, self.comm.size):
            self.comm.send(call, dest=rank, tag=CALL)

    def end_all(self, error: BaseException) -> None:
        """End the processes of all ranks: other ranks may wait for this one in the middle of a solve, for ever."""
        words = "PETSc: rank %d of %d failed, which ends all: %s"
        log.error(words, self.comm.rank, self.comm.size, _first_words(error))
        self.comm.Abort(2)


class RankSolver:
    """A block of K's rows on this rank, with its part of the hierarchy; all ranks call a method together.

    Rank 0 is given K (n, n), motions (n, k) and vectors (n,) as a whole, and returns whole vectors.
    """

    def __init__(self, comm: Any, n: int, K: sp.csr_matrix | None = None, motions: Floats | None = None):
        from petsc4py import PETSc as petsc

        self._petsc, self._comm, self._ends = petsc, comm, _ends(comm, n)
        block, size = self._receive(K), (self._ends[comm.rank + 1] - self._ends[comm.rank], n)
        csr = [part.astype(petsc.IntType, copy=False) for part in (block.indptr, block.indices)]
        self._K = petsc.Mat().createAIJ((size, size), csr=[*csr, block.data], comm=comm)
        self._K.setOption(petsc.Mat.Option.SPD, True)
        own = self._receive(motions)
        vectors = [petsc.Vec().createWithArray(column.copy(), size, comm=comm) for column in own.T]
        self._near = petsc.NullSpace()
        if vectors:
            self._near = petsc.NullSpace().create(vectors=vectors, comm=comm)
            self._K.setNearNullSpace(self._near)
        with self._options():
            self._ksp = petsc.KSP().create(comm)
            self._ksp.setOptionsPrefix(PREFIX)
            self._ksp.setOperators(self._K)
            self._ksp.setFromOptions()
            self._ksp.setUp()
        # The vectors of answers and right sides, and the whole vector of rank 0 that both are exchanged with.
        self._x, self._b = self._K.createVecs()
        self._scatter, self._whole = petsc.Scatter.toZero(self._x)

    def solve(self, tolerance: float, iterations: int, b: Floats | None = None) -> tuple[Floats | None, int]:
        """Return an approximation of K^{-1} b on rank 0, and 0 if its residual meets the tolerance."""
        self._spread(b)
        self._ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=iterations)
        self._ksp.solve(self._b, self._x)
        return self._gathered(), 0 if self._ksp.getConvergedReason() > 0 else 1

    def cycle(self, b: Floats | None = None) -> Floats | None:
        """Return M b on rank 0."""
        self._spread(b)
        self._ksp.getPC().apply(self._b, self._x)
        return self._gathered()

    def destroy(self) -> None:
        """Free what this rank holds."""
        for one in (self._ksp, self._near, self._x, self._b, self._scatter, self._whole, self._K):
            one.destroy()

    def _receive(self, rows: Any) -> Any:
        """Return the rows of this rank of a matrix or an array (n, ...) that rank 0 has, sent SOME rows at a time."""
        comm, ends = self._comm, self._ends
        if rows is None:
            count = -(-(ends[comm.rank + 1] - ends[comm.rank]) // SOME)
            pieces = [comm.recv(source=0, tag=BLOCK) for _ in range(max(count, 1))]
            return sp.vstack(pieces, format="csr") if sp.issparse(pieces[0]) else np.concatenate(pieces)
        for rank in range(1, comm.size):
            for start in range(ends[rank], max(ends[rank + 1], ends[rank] + 1), SOME):
                comm.send(rows[start : min(start + SOME, ends[rank + 1])], dest=rank, tag=BLOCK)
        return rows[: ends[1]]

    @contextmanager
    def _options(self) -> Iterator[None]:
        """Keep OPTIONS in PETSc's data base inside the block: PETSc reads them when it sets a hierarchy up."""
        base = self._petsc.Options()
        for name, value in OPTIONS.items():
            base.setValue(PREFIX + name, value)
        try:
            yield
        finally:
            for name in OPTIONS:
                base.delValue(PREFIX + name)

    def _spread(self, b: Floats | None) -> None:
        if b is not None:
            self._whole.getArray()[:] = b
        self._scatter.scatter(self._whole, self._b, mode=self._petsc.ScatterMode.REVERSE)

    def _gathered(self) -> Floats | None:
        self._scatter.scatter(self._x, self._whole)
        return self._whole.getArray().copy() if self._comm.rank == 0 else None


def _ends(comm: Any, n: int) -> list[int]:
    """Return the first row of each rank, and the end of the last rank; numbers of rows differ by one at most."""
    return [n * rank // comm.size for rank in range(comm.size + 1)]


@cache
def all_ranks() -> Ranks:
    """Return the ranks of this run: a single one if it was started without mpiexec."""
    if missing := [package for package in ("petsc4py", "mpi4py") if find_spec(package) is None]:
        raise NotAccepted(
            f"PETSc: {' and '.join(missing)} cannot be imported; install Debian's python3-petsc4py and python3-mpi4py, "
            "or conda-forge's petsc4py and mpi4py, or build them (pip install 'vemcvx[petsc]'), or use Iterative()."
        )
    try:
        return Ranks()
    except ImportError as error:
        raise NotAccepted(f"PETSc: petsc4py is there, but does not load here: {_first_words(error)}") from error


def serve() -> bool:
    """Hold rows and solve until rank 0 ends, on ranks above 0; return False at once on rank 0.

    Examples
    --------
    A script under mpiexec begins with ::

        if vemcvx.linear.petsc.serve():
            raise SystemExit
    """
    ranks = all_ranks()
    if ranks.comm.rank == 0:
        return False
    try:
        while True:
            # A rank that waits in a broadcast would keep a core busy while rank 0 steps.
            while not ranks.comm.iprobe(source=0, tag=CALL):
                time.sleep(1e-4)
            call = ranks.comm.recv(source=0, tag=CALL)
            if call is None:
                return True
            ranks.obey(*call)
    except Exception as error:
        ranks.end_all(error)
        raise


def _first_words(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
