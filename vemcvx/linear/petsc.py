"""PETSc's conjugate gradients with algebraic multigrid (GAMG) over the ranks of MPI, for K beyond one machine's cores.

Rank 0 poses the problem and steps; every rank holds a block of K's rows in the order of the unknowns, its part of the
hierarchy, and its part of vectors. The other ranks wait for the calls of rank 0 (:func:`serve`), which names a method
of :class:`RankRows` that all of them then call together. Neither K nor the stiffness of all nodal values ever stands
whole: rank 0 makes some rows at a time, from the cells around their nodes, and sends them to the rank that holds them.
All that a run asks of K afterwards, products, its diagonal and residuals in extended precision, is asked of the ranks
(:class:`OverRanks`).

GAMG smooths its aggregates from the rigid motions, as :mod:`vemcvx.linear.multigrid` does, and smooths by Chebyshev
polynomials of the same degree before and after the coarse correction. The polynomial is self-adjoint in the energy,
the coarse correction a projection there, or one with eigenvalues of at most one: so the cycle M is symmetric, no
eigenvalue of MK exceeds one, and bounds are those of that module. Options may ask for other cycles, which are therefore
tested: for symmetry, and for eigenvalues above one.

Contact changes K to K + S on the free unknowns. A second hierarchy keeps the prolongations P of K's, and its coarse
matrices are Galerkin's for the matrix in which what is held has no coupling and almost no stiffness: P_F'(K + S)P_F.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import SOME, Bools, Floats, Ints, brief, by_rows, power_of_two
from vemcvx.errors import NotAccepted, SceneError
from vemcvx.linear.factor import Cycle, LinearSolver
from vemcvx.linear.multigrid import MultigridFactor, Stopping, lowest_eigenvalue
from vemcvx.linear.products import Elsewhere, residual, sizes
from vemcvx.linear.superlu import SuperLU

PREFIX = "vemcvx_"
"""Options of ours in PETSc's data base, which all of the process shares."""
USUAL = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_rtol": "1e-12",
    "ksp_max_it": "200",
    "pc_type": "gamg",
    # All couplings count. Of 200,080 unknowns in space set-up takes 4.9 s on one rank, and a solve 4.7 s in 33
    # iterations; with .01, which leaves weak ones out, coarse matrices are fuller: 75 s, 13.4 s and 29 iterations.
    "pc_gamg_threshold": "-1",
    # Else the coarsest matrix is solved by blocks, one a rank, and eigenvalues of MK could exceed one.
    "mg_coarse_pc_type": "redundant",
    # Aggregates of fewer unknowns than rigid motions leave coarse unknowns without stiffness; factors divide by zero.
    "mg_coarse_redundant_pc_type": "svd",
    "pc_gamg_reuse_interpolation": "true",
}
CALL, BLOCK = 1, 2
"""Tags of messages: the call of a method, and a block of rows."""
log = logging.getLogger("vemcvx")


@dataclass(frozen=True)
class PETSc(LinearSolver):
    """PETSc (extra ``petsc``): K in row blocks over the ranks of MPI, conjugate gradients with multigrid.

    On one rank it needs no mpiexec. ``mpiexec -n 8 vemcvx run FILE --linear petsc`` shares hierarchy and solves among
    eight; in scripts under mpiexec, ranks above 0 call :func:`vemcvx.linear.petsc.serve` in place of the simulation.

    Programs are not condensed, contact is solved matrix-free, and certificates take into account that solves are
    inexact, all as with ``Multigrid``: it suits the same bodies.

    Parameters
    ----------
    options : str
        Options of PETSc as on its command line, such as "-pc_gamg_threshold 0.02 -ksp_rtol 1e-11"; they replace ours. A
        cycle that is not symmetric, or has eigenvalues above one, is refused.
    """

    options: str = ""

    def __post_init__(self) -> None:
        options_of(self.options)

    def held(self, made: Callable[[int, int], sp.csr_matrix], n: int) -> OverRanks:
        ranks = all_ranks()
        if ranks.comm.rank > 0:
            raise NotAccepted("PETSc: ranks above 0 do not simulate; they call vemcvx.linear.petsc.serve() instead.")
        return OverRanks(ranks, made, n)

    def factorise(self, K: Any, near_kernel: Floats | None = None) -> PETScFactor:
        if not isinstance(K, OverRanks):
            rows = sp.csr_matrix(K)
            K = self.held(lambda start, stop: rows[start:stop], rows.shape[0])
        n = K.shape[0]
        motions = np.zeros((n, 0)) if near_kernel is None else np.linalg.qr(near_kernel)[0]
        levels, limits = K.set_up(options_of(self.options), motions)
        if levels < 2:  # The inverse of a single level would hide that K is singular.
            SuperLU().factorise(K.whole())
        b, c = np.random.default_rng(1).normal(size=(2, n))
        one, two = float(b @ K.cycle(c)), float(c @ K.cycle(b))
        size = np.sqrt(abs(float(b @ K.cycle(b)) * float(c @ K.cycle(c))))
        if not abs(one - two) <= 1e-8 * size:
            raise NotAccepted(f"PETSc: with the options {self.options!r} the cycle is not symmetric; omit some.")
        return PETScFactor(K, limits, lowest_eigenvalue(K, K.cycle, "PETSc"))


class PETScFactor(MultigridFactor):
    """The factor of all of K, whose rows all ranks hold and multiply."""

    def __init__(self, K: OverRanks, limits: Stopping, lowest: float):
        super().__init__(limits, K, K.cycle, lowest)
        self._rows = K

    def cycle(self, S: sp.csr_matrix, free: Bools) -> Cycle:
        return self._rows.within(S, free)

    def _descended(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        return self._rows.solve(b, tolerance) if b.any() else (np.zeros_like(b), 0)


class OverRanks(Elsewhere):
    """Rank 0's view of a matrix whose rows all ranks hold: its methods are called on all of them.

    The rows are made on rank 0, some at a time, and sent to the rank that holds them.
    """

    def __init__(self, ranks: Ranks, made: Callable[[int, int], sp.csr_matrix], n: int):
        self.shape, self._ranks, self._number = (n, n), ranks, ranks.next_number()
        self._diagonal, self._mark = np.empty(n), hashlib.blake2b(digest_size=16)

        def noted(start: int, stop: int) -> sp.csr_matrix:
            rows = made(start, stop)
            self._diagonal[start:stop] = rows.diagonal(start)
            for part in (rows.data, rows.indices, np.diff(rows.indptr)):
                self._mark.update(np.ascontiguousarray(part).data)
            return rows

        self._ranks.call(self._number, "hold", (n,), noted)
        self._unit = ranks.held[self._number].unit

    def __repr__(self) -> str:
        # By this a run that is resumed knows its K again.
        return f"{self.shape} in rows over ranks of MPI, {self._mark.hexdigest()}"

    def __del__(self) -> None:
        # Memory is freed on all ranks at once, when they hold the next matrix.
        self._ranks.forgotten.append(self._number)

    def __matmul__(self, x: Floats) -> Floats:
        if x.ndim == 2:
            return np.column_stack([self @ column for column in x.T]) if x.shape[1] else np.zeros(x.shape)
        return self._ranks.call(self._number, "product", (), x)

    matvec = __matmul__  # so that SciPy's iterations take it

    def diagonal(self) -> Floats:
        return self._diagonal

    def sizes(self, x: Floats) -> Floats:
        return self._ranks.call(self._number, "sizes", (), x)

    def residual(self, force: Floats, y: Floats, held: Floats) -> Floats:
        return self._ranks.call(self._number, "residual", (), y, np.column_stack([force, held]))

    def whole(self) -> sp.csr_matrix:
        return sp.csr_matrix(self._ranks.call(self._number, "whole", ()))

    def set_up(self, options: dict[str, str], motions: Floats) -> tuple[int, Stopping]:
        """Set the hierarchy up, with these rigid motions (n, k); its levels, and where solves stop."""
        found: tuple[int, Stopping] = self._ranks.call(self._number, "set_up", (options,), motions)
        return found

    def solve(self, b: Floats, tolerance: float) -> tuple[Floats, int]:
        """An approximation of K^{-1} b, and 0 if its residual meets the tolerance."""
        x, missed = self._ranks.call(self._number, "solve", (tolerance,), b)
        return x / self._unit, missed

    def cycle(self, b: Floats) -> Floats:
        """M b."""
        found: Floats = self._ranks.call(self._number, "cycle", (False,), b)
        return found / self._unit

    def within(self, S: sp.csr_matrix, free: Bools) -> Cycle:
        """The cycle of K + S on the free unknowns; it serves until the next one is asked for."""
        # The stiffness of what is held in the second hierarchy: coarse matrices do not feel a millionth of K's least.
        least = 1e-6 * float(self._diagonal.min()) / self._unit
        self._ranks.call(self._number, "stiffen", (sp.csr_matrix(S / self._unit), np.flatnonzero(~free), least))

        def cycle(b: Floats) -> Floats:
            found: Floats = self._ranks.call(self._number, "cycle", (True,), np.where(free, b, 0.0))
            return np.where(free, found / self._unit, 0.0)

        return cycle


class Ranks:
    """The ranks of a process: what this one holds of every matrix, by number, and the messages between them."""

    def __init__(self) -> None:
        # Where other programs use the cores, too, a rank that spins while it waits takes them from those it waits for:
        # solves took five times as long on two cores with a load of ten.
        os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
        import petsc4py

        petsc4py.init(["vemcvx", "-no_signal_handler"])  # Signals end a command in order.
        from mpi4py import MPI

        self.comm, self.held, self.forgotten, self._number = MPI.COMM_WORLD.Dup(), dict[int, RankRows](), list[int](), 0
        if self.comm.rank == 0:
            atexit.register(self._tell, None)

    def next_number(self) -> int:
        """A number that no matrix had."""
        self._number += 1
        return self._number

    def call(self, number: int, name: str, shared: tuple[Any, ...], *own: Any) -> Any:
        """Call a method of all ranks' rows; what is its `own` only rank 0 has."""
        if name == "hold":
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
        """Carry out a call on this rank."""
        if name != "hold":
            return getattr(self.held[number], name)(*shared, *own)
        gone, *rest = shared
        for old in gone:
            self.held.pop(old).destroy()
        self.held[number] = RankRows(self.comm, *rest, *own)
        return None

    def _tell(self, call: object) -> None:
        for rank in range(1, self.comm.size):
            self.comm.send(call, dest=rank, tag=CALL)

    def end_all(self, error: BaseException) -> None:
        """End the processes of all ranks: others may wait for this one in the middle of a solve, for ever."""
        words = "PETSc: rank %d of %d failed, which ends all: %s"
        log.error(words, self.comm.rank, self.comm.size, _first_words(error))
        self.comm.Abort(2)


class RankRows:
    """A block of K's rows on this rank, with its part of the hierarchy; all ranks call a method together.

    Vectors are given to rank 0, and returned by it, as a whole.
    """

    def __init__(self, comm: Any, n: int, made: Callable[[int, int], sp.csr_matrix] | None = None):
        from petsc4py import PETSc as petsc

        self._petsc, self._comm, self._ends = petsc, comm, _ends(comm, n)
        self._block = self._taken(made)
        self._size = self._block.shape
        self._ksp, self._near = petsc.KSP(), petsc.NullSpace()
        self._stiffened: Any = None

    @cached_property
    def _K(self) -> Any:
        """K / unit in PETSc: made when it is first asked for, because rank 0 has more while it makes rows."""
        petsc, block = self._petsc, self._block
        del self._block
        csr = [part.astype(petsc.IntType, copy=False) for part in (block.indptr, block.indices)]
        block.data /= self.unit
        matrix = petsc.Mat().createAIJ((self._size, self._size), csr=[*csr, block.data], comm=self._comm)
        matrix.setOption(petsc.Mat.Option.SPD, True)
        return matrix

    @cached_property
    def _vectors(self) -> tuple[Any, Any, Any, Any]:
        """The vectors of answers and right sides, and the whole one of rank 0 that they are sent to and from."""
        x, b = self._K.createVecs()
        return x, b, *self._petsc.Scatter.toZero(x)

    def _taken(self, made: Callable[[int, int], sp.csr_matrix] | None) -> sp.csr_matrix:
        """The rows of this rank, made by rank 0, and sent by it, some at a time; its own ones are made last."""
        comm, ends = self._comm, self._ends
        if made is not None:
            for rank in range(1, comm.size):
                for start in range(ends[rank], ends[rank + 1], SOME):
                    comm.send(made(start, min(start + SOME, ends[rank + 1])), dest=rank, tag=BLOCK)

        def own(start: int, stop: int) -> sp.csr_matrix:
            return comm.recv(source=0, tag=BLOCK) if made is None else made(start, stop)

        first, last = ends[comm.rank : comm.rank + 2]
        block = by_rows(own, last - first, 0, (last - first, ends[-1]))
        # PETSc takes singular values below 1e-12 for zeros, whatever the unit.
        self.unit = float(power_of_two(max(comm.allgather(block.diagonal(first).max(initial=0.0)))))
        return block

    def set_up(self, options: dict[str, str], motions: Floats | None = None) -> tuple[int, Stopping]:
        """Set the hierarchy of K / unit up; its levels, and where solves stop."""
        petsc, comm, self._names = self._petsc, self._comm, options
        for one in (self._ksp, *(self._stiffened or ())):  # of other options
            one.destroy()
        self._stiffened, own = None, self._dealt(motions)
        if own.shape[1]:
            vectors = [petsc.Vec().createWithArray(column.copy(), self._size, comm=comm) for column in own.T]
            self._near = petsc.NullSpace().create(vectors=vectors, comm=comm)
            self._K.setNearNullSpace(self._near)
        self._ksp = self._solver(self._K)
        tolerance, _, _, most = self._ksp.getTolerances()
        pc = self._ksp.getPC()
        levels = pc.getMGLevels() if pc.getType() == "gamg" else 2
        return levels, Stopping("PETSc", float(tolerance), int(most))

    def _solver(self, matrix: Any) -> Any:
        """Conjugate gradients with the cycle of a matrix."""
        with self._options():
            ksp = self._petsc.KSP().create(self._comm)
            ksp.setOptionsPrefix(PREFIX)
            ksp.setOperators(matrix)
            ksp.setFromOptions()
            ksp.setUp()
        return ksp

    @contextmanager
    def _options(self) -> Iterator[None]:
        """Our options in PETSc's data base, which it reads until a hierarchy is set up."""
        base = self._petsc.Options()
        for name, value in self._names.items():
            base.setValue(PREFIX + name, value)
        try:
            yield
        finally:
            for name in self._names:
                base.delValue(PREFIX + name)

    def solve(self, tolerance: float, b: Floats | None = None) -> tuple[Floats | None, int]:
        """K^{-1} b on rank 0, about, and 0 if its residual meets the tolerance."""
        self._spread(b)
        self._ksp.setTolerances(rtol=tolerance, atol=0.0)
        answer, right, _, _ = self._vectors
        self._ksp.solve(right, answer)
        return self._gathered(), 0 if self._ksp.getConvergedReason() > 0 else 1

    def product(self, x: Floats | None = None) -> Floats | None:
        """K x on rank 0."""
        self._spread(x)
        found, factor, _, _ = self._vectors
        self._K.mult(factor, found)
        return self._gathered(self.unit)

    def sizes(self, x: Floats | None = None) -> Floats | None:
        """|K| |x| on rank 0."""
        return self._joined(sizes(self._rows(), self._comm.bcast(x)))

    def residual(self, y: Floats | None = None, forces: Floats | None = None) -> Floats | None:
        """force - held - K y on rank 0, in extended precision; of both `forces` (n, 2) rank 0 has all."""
        force, held = self._dealt(forces).T
        return self._joined(residual(force, self._rows(), self._comm.bcast(y), held))

    def whole(self) -> sp.csr_matrix | None:
        """All of K on rank 0."""
        parts = self._comm.gather(self._rows())
        return None if parts is None else sp.csr_matrix(sp.vstack(parts, format="csr"))

    def _rows(self) -> sp.csr_matrix:
        """The rows of this rank, which PETSc has in two parts: a copy that is gone after its use."""
        indptr, indices, data = self._K.getValuesCSR()
        data *= self.unit
        return sp.csr_matrix((data, indices, indptr), shape=self._size)

    def _dealt(self, rows: Floats | None) -> Floats:
        """The part of this rank of an array (n, ...) that rank 0 has."""
        if rows is None:
            return self._comm.recv(source=0, tag=BLOCK)
        for rank, (i, j) in enumerate(pairwise(self._ends)):
            if rank > 0:
                self._comm.send(rows[i:j], dest=rank, tag=BLOCK)
        return rows[: self._ends[1]]

    def _joined(self, own: Floats) -> Floats | None:
        """A vector on rank 0, from what each rank has of it."""
        parts = self._comm.gather(own)
        return None if parts is None else np.concatenate(parts)

    def cycle(self, stiffened: bool, b: Floats | None = None) -> Floats | None:
        """M b on rank 0, M the cycle of K, or of K + S on the free unknowns."""
        self._spread(b)
        found, right, _, _ = self._vectors
        (self._stiffened[1] if stiffened else self._ksp).getPC().apply(right, found)
        return self._gathered()

    def stiffen(self, S: sp.csr_matrix, held: Ints, least: float) -> None:
        """Set the second hierarchy up for K + S on what is not `held`, whose stiffness becomes `least`."""
        petsc = self._petsc
        if self._stiffened is None:
            copied = self._K.duplicate(copy=True)
            if self._near:
                copied.setNearNullSpace(self._near)
            # Set up once for all of K, whose prolongations are kept.
            self._stiffened = copied, self._solver(copied)
        matrix, ksp = self._stiffened
        alike = matrix.getInfo()["nz_used"] == self._K.getInfo()["nz_used"]
        pattern = petsc.Mat.Structure.SAME_NONZERO_PATTERN if alike else petsc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        self._K.copy(matrix, pattern)
        # S may couple what K, where its entries are zero and left out, does not.
        matrix.setOption(petsc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        begin, end = matrix.getOwnershipRange()
        own = S[begin:end].tocoo()
        for i, j, value in zip(own.row.tolist(), own.col.tolist(), own.data.tolist(), strict=True):
            matrix.setValue(begin + i, j, value, addv=petsc.InsertMode.ADD_VALUES)
        matrix.assemble()
        matrix.setOption(petsc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.zeroRowsColumns(held[(held >= begin) & (held < end)].astype(petsc.IntType), diag=least)
        with self._options():
            ksp.setOperators(matrix)
            ksp.setUp()

    def destroy(self) -> None:
        """Free what this rank holds."""
        made = vars(self)
        standing = *made.get("_vectors", ()), *((self._K,) if "_K" in made else ())
        for one in (self._ksp, self._near, *(self._stiffened or ()), *standing):
            one.destroy()

    def _spread(self, b: Floats | None) -> None:
        _, right, scatter, whole = self._vectors
        if b is not None:
            whole.getArray()[:] = b
        scatter.scatter(whole, right, mode=self._petsc.ScatterMode.REVERSE)

    def _gathered(self, unit: float = 1.0) -> Floats | None:
        x, _, scatter, whole = self._vectors
        scatter.scatter(x, whole)
        return whole.getArray() * unit if self._comm.rank == 0 else None


def _ends(comm: Any, n: int) -> list[int]:
    """The first row of each rank, and the end of the last one: ranks have as many rows, but for one."""
    return [n * rank // comm.size for rank in range(comm.size + 1)]


@cache
def all_ranks() -> Ranks:
    """The ranks of this run; one where it was started without mpiexec."""
    if missing := [package for package in ("petsc4py", "mpi4py") if find_spec(package) is None]:
        raise NotAccepted(
            f"PETSc: {' and '.join(missing)} cannot be imported; install Debian's python3-petsc4py and python3-mpi4py, "
            "or conda-forge's petsc4py and mpi4py, or build them (pip install 'vemcvx[petsc]'), or use Multigrid()."
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
            # In a broadcast a rank that waits would keep a core busy while rank 0 steps.
            while not ranks.comm.iprobe(source=0, tag=CALL):
                time.sleep(1e-4)
            call = ranks.comm.recv(source=0, tag=CALL)
            if call is None:
                return True
            ranks.obey(*call)
    except Exception as error:
        ranks.end_all(error)
        raise


def options_of(words: object) -> dict[str, str]:
    """The options of PETSc in a text, by name without the dash, over ours."""
    wanted = 'options of PETSc as on its command line, such as "-pc_gamg_threshold 0.02"'
    if not isinstance(words, str):
        raise SceneError(f"PETSc: found options = {brief(words)}; wanted a text, {wanted}.")
    found, name = dict(USUAL), ""
    try:
        parts = shlex.split(words)
    except ValueError as error:
        raise SceneError(f"PETSc: found options = {words!r} ({error}); wanted {wanted}.") from None
    for part in parts:
        if part.startswith("-") and not part[1:2].isdigit():
            name = part[1:]
            found[name] = ""
        elif name:
            found[name], name = part, ""
        else:
            raise SceneError(f"PETSc: found {part!r} in options = {words!r}, which belongs to none; wanted {wanted}.")
    return found


def _first_words(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
