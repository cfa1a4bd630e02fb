"""PETSc's conjugate gradients with algebraic multigrid (GAMG) over the ranks of MPI, on one or more machines.

Rank 0 poses the problem, holds the whole matrix K and computes the steps. Each rank holds some rows of K and a part of
the multigrid hierarchy. Ranks above 0 wait in :func:`serve` until rank 0 sends the name of a method of :class:`Ranks`.
All ranks then execute the method.

GAMG smooths by Chebyshev polynomials of the same degree before and after the coarse correction. Therefore the multigrid
cycle is a symmetric matrix M, and no eigenvalue of M K exceeds 1.
"""

from __future__ import annotations

import atexit
import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, power_of_two
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.linear.iterative import Iterative, IterativeFactor
from vemcvx.linear.superlu import SuperLU

PREFIX = "vemcvx_"
"""Prefix of this module's options in PETSc's options database, which the whole process shares."""
OPTIONS = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "gamg",
    "pc_gamg_threshold": "-1",  # with other thresholds, coarse matrices have more entries
    "mg_coarse_pc_type": "redundant",  # with one block per rank, eigenvalues of M K may exceed 1
    "mg_coarse_redundant_pc_type": "svd",  # some coarse unknowns may have no stiffness
}
SMALL = 1_000
"""Number of unknowns below which GAMG may have a single level."""
CALL, BLOCK = 1, 2
"""Tags of MPI messages: a method call, and a block of rows."""
log = logging.getLogger("vemcvx")


@dataclass(frozen=True)
class PETSc(Iterative):
    """PETSc (extra ``petsc``): conjugate gradients with multigrid, distributed over the ranks of MPI.

    A run on one rank needs no mpiexec. ``mpiexec -n 8 vemcvx run FILE --linear petsc`` distributes the hierarchy and
    the solves over eight ranks. In scripts under mpiexec, ranks above 0 call :func:`vemcvx.linear.petsc.serve` instead
    of simulating. Rank 0 holds the whole stiffness matrix. For parameters and certificates, see ``Iterative``.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.BodyForce(lambda x, t: t + 0 * x))
    >>> history = vx.simulate(scene, vx.meshes.cubes(64), [0.0, 1.0], linear=vx.PETSc())  # doctest: +SKIP
    """

    def factorise(self, K: sp.csr_matrix, near_kernel: Floats | None = None) -> PETScFactor:
        ranks = all_ranks()
        if ranks.comm.rank > 0:
            raise NotAccepted("PETSc: ranks above 0 do not simulate; they call vemcvx.linear.petsc.serve() instead.")
        K = sp.csr_matrix(K)
        if K.shape[0] < SMALL:  # With a single level, GAMG would not detect a singular K.
            SuperLU().factorise(K)
        return PETScFactor(self, K, near_kernel, ranks)


class PETScFactor(IterativeFactor):
    """A distributed matrix K. The ranks hold one matrix at a time."""

    def __init__(self, limits: PETSc, K: sp.csr_matrix, near_kernel: Floats | None, ranks: Ranks):
        # PETSc treats singular values below 1e-12 as zero, whatever the unit, so K is scaled.
        self._ranks, self._key, self._unit = ranks, object(), float(power_of_two(K.diagonal().max(initial=0.0)))
        self._motions = np.zeros((K.shape[0], 0)) if near_kernel is None else np.linalg.qr(near_kernel)[0]
        super().__init__(limits, K)

    def cycle(self, b: Floats) -> Floats:
        return self._call("cycle", (), b)[0]

    def iterate(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        if not b.any():
            return np.zeros_like(b), 0
        return self._call("solve", (tolerance, self._limits.max_iterations), b)

    def _call(self, name: str, shared: tuple[Any, ...], b: Floats) -> tuple[Floats, int]:
        ranks = self._ranks
        if ranks.key is not self._key:
            ranks.key = None
            ranks.call("set_up", (len(b),), self._K / self._unit, self._motions)
            ranks.key = self._key
        x, failed = ranks.call(name, shared, b)
        return x / self._unit, failed


class Ranks:
    """The data of one rank, and messages to other ranks."""

    def __init__(self) -> None:
        # A rank that spins while it waits would take cores from ranks that compute.
        os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
        import petsc4py

        petsc4py.init(["vemcvx", "-no_signal_handler"])  # The command line handles signals itself.
        from mpi4py import MPI
        from mpi4py.util import pkl5
        from petsc4py import PETSc as petsc

        for name, value in OPTIONS.items():
            petsc.Options().setValue(PREFIX + name, value)
        self.comm: Any = MPI.COMM_WORLD.Dup()
        self._large, self._petsc = pkl5.Intracomm(self.comm), petsc  # allows messages of any size
        self.key: object = None
        self._objects: list[Any] = []
        if self.comm.rank == 0:
            atexit.register(self._tell, None)

    def call(self, name: str, shared: tuple[Any, ...], *own: Any) -> Any:
        """Call a method on all ranks. Rank 0 passes `own` as further arguments."""
        self._tell((name, shared))
        return self.act(name, *shared, *own)

    def act(self, name: str, *arguments: Any) -> Any:
        """Call a method on this rank. If the method fails, end all ranks."""
        try:
            return getattr(self, name)(*arguments)
        except Exception as error:
            if self.comm.size == 1:
                raise SceneError(f"PETSc: {_shorten(error)}") from error
            words = "PETSc: rank %d of %d failed, which ends all ranks: %s"
            log.error(words, self.comm.rank, self.comm.size, _shorten(error))
            self.comm.Abort(2)

    def _tell(self, call: object) -> None:
        for rank in range(1, self.comm.size):
            self.comm.send(call, dest=rank, tag=CALL)

    def set_up(self, n: int, K: sp.csr_matrix | None = None, motions: Floats | None = None) -> None:
        """Replace the distributed matrix by K, and build the multigrid hierarchy."""
        for one in self._objects:
            one.destroy()
        petsc, comm = self._petsc, self.comm
        ends = [n * rank // comm.size for rank in range(comm.size + 1)]
        block, own = self._own_rows(K, ends), self._own_rows(motions, ends)
        size, pattern = (block.shape[0], n), (block.indptr, block.indices)
        csr = [*(part.astype(petsc.IntType, copy=False) for part in pattern), block.data]
        A = petsc.Mat().createAIJ((size, size), csr=csr, comm=comm)
        A.setOption(petsc.Mat.Option.SPD, True)
        near = petsc.NullSpace()
        if own.shape[1]:
            vectors = [petsc.Vec().createWithArray(column.copy(), size, comm=comm) for column in own.T]
            near = petsc.NullSpace().create(vectors=vectors, comm=comm)
            A.setNearNullSpace(near)
        ksp = petsc.KSP().create(comm)
        ksp.setOptionsPrefix(PREFIX)
        ksp.setOperators(A)
        ksp.setFromOptions()
        ksp.setUp()
        # Rank 0 scatters the right side b, and gathers the solution x, through `whole`.
        x, b = A.createVecs()
        scatter, whole = petsc.Scatter.toZero(x)
        self._objects = [ksp, near, x, b, scatter, whole, A]

    def solve(self, tolerance: float, iterations: int, b: Floats | None = None) -> tuple[Floats | None, int]:
        """Return (x, 0) with K x = b, or (x, 1) without convergence; x is None above rank 0."""
        ksp = self._objects[0]
        ksp.setTolerances(rtol=tolerance, atol=0.0, max_it=iterations)
        x = self._exchange(ksp.solve, b)
        return x, 0 if ksp.getConvergedReason() > 0 else 1

    def cycle(self, b: Floats | None = None) -> tuple[Floats | None, int]:
        """Return (M b, 0) on rank 0, else (None, 0)."""
        return self._exchange(self._objects[0].getPC().apply, b), 0

    def _exchange(self, act: Callable[[Any, Any], object], right: Floats | None) -> Floats | None:
        """Apply `act` to a vector of rank 0, and return the result (None above rank 0)."""
        _, _, x, b, scatter, whole, _ = self._objects
        if right is not None:
            whole.getArray()[:] = right
        scatter.scatter(whole, b, mode=self._petsc.ScatterMode.REVERSE)
        act(b, x)
        scatter.scatter(x, whole)
        return whole.getArray().copy() if self.comm.rank == 0 else None

    def _own_rows(self, rows: Any, ends: list[int]) -> Any:
        if self.comm.rank > 0:
            return self._large.recv(source=0, tag=BLOCK)
        for rank in range(1, self.comm.size):
            self._large.send(rows[ends[rank] : ends[rank + 1]], dest=rank, tag=BLOCK)
        return rows[: ends[1]]


@cache
def all_ranks() -> Ranks:
    """Return the ranks of this run."""
    try:
        return Ranks()
    except ImportError as error:
        raise NotAccepted(
            f"PETSc: petsc4py or mpi4py cannot be loaded ({_shorten(error)}); install Debian's python3-petsc4py and "
            "python3-mpi4py, or conda-forge's petsc4py and mpi4py, or build them (pip install 'vemcvx[petsc]'), or use "
            "Iterative()."
        ) from error


def serve() -> bool:
    """Return False on rank 0. On other ranks, serve rank 0 until the end of the run, and return True.

    Examples
    --------
    A script under mpiexec begins with ::

        if vemcvx.linear.petsc.serve():
            raise SystemExit
    """
    ranks = all_ranks()
    if ranks.comm.rank == 0:
        return False
    while True:
        # A rank that waits in a broadcast would keep a core busy while rank 0 computes a step.
        while not ranks.comm.iprobe(source=0, tag=CALL):
            time.sleep(1e-4)
        call = ranks.comm.recv(source=0, tag=CALL)
        if call is None:
            return True
        name, shared = call
        ranks.act(name, *shared)


def _shorten(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
