"""The cost of a run: memory, seconds and room on disk, foreseen from n before its mesh is made.

Coarse meshes of the problem tell how its cells, nodes and pairs of nodes in a cell grow with n, and the laws below what
these cost. Powers of memory in space are those of nested dissection, others were fitted, as the factors were, to peaks
of memory and CPU seconds of 60 runs that store 8 steps, each in a process of its own, by
`python tests/benchmarks/growth_laws.py`. In the plane they have 8,000 to a million unknowns, in space 1,900 to
44,400:

=================  ========  =================  ==================  ====================
mesh               unknowns  solver             measured            foreseen
=================  ========  =================  ==================  ====================
squares, 512       524,800   SuperLU, PARDISO   2.6 GB, 1.3 GB      3.3 GB, 1.4 GB
hexagons, 512      1.05e6    SuperLU, PARDISO   10 GB, 3.7 GB       10 GB, 3.9 GB
voronoi, 256       260,828   SuperLU            2.3 GB              2.3 GB
cubes, 24          44,400    PARDISO            .57 GB              .78 GB
kelvin, 6          8,632     SuperLU, PARDISO   .35 GB, .20 GB      .56 GB, .34 GB
=================  ========  =================  ==================  ====================

Beside it the program and its libraries take .12 GB. Of more than 100,000 unknowns in the plane, memory was .69 to
1.24 of what is foreseen, CPU time .5 to 1.4; smaller runs take more than that, and wait for nobody. Wall time
is more where other programs run.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import time
from bisect import bisect
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import ProblemError
from vemcvx.linear import LinearSolver
from vemcvx.linear.default import LARGEST_FACTOR, direct_solver
from vemcvx.meshes import Mesh, PolygonMesh


class CostLaw(NamedTuple):
    """Factors and powers of the pairs: bytes at the peak, seconds before the first step, seconds of a stored one."""

    memory: tuple[float, float]
    prepare: tuple[float, float]
    step: tuple[float, float]


LAWS = {
    ("SuperLU", True): CostLaw((221.0, 1.12), (1.32e-7, 1.26), (1.32e-8, 1.2)),
    ("Pardiso", True): CostLaw((379.0, 1.02), (3.0e-7, 1.12), (3.9e-8, 1.05)),
    ("Iterative", True): CostLaw((443.0, 1.0), (1.2e-6, 1.05), (1.8e-6, 1.05)),
    ("SuperLU", False): CostLaw((43.4, 4 / 3), (7.3e-10, 1.83), (8.6e-9, 4 / 3)),
    ("Pardiso", False): CostLaw((22.0, 4 / 3), (5.5e-10, 1.75), (5.5e-9, 4 / 3)),
    ("Iterative", False): CostLaw((913.0, 1.0), (2.2e-6, 1.1), (4.0e-6, 1.05)),
}
"""By linear solver, and whether the body is plane."""

DENSITY = {True: 4.5, False: 8.5}  # Pairs to an unknown on squares, and on cubes.
COARSE = {True: (8, 16), False: (2, 4, 6)}
"""Cells across the shortest side of the coarse meshes, in the plane and in space: as many as there are powers of n."""


@dataclass(frozen=True)
class Growth:
    """The growth of a problem's meshes with n: their cells, nodes and pairs as sums of powers of n."""

    plane: bool
    coefficients: Floats  # (2 or 3, 3) of cells, nodes and pairs of nodes in a cell, that of the highest power first
    meshing: float  # seconds that a cell takes to make; of Voronoi meshes 4e-4

    @classmethod
    def of(cls, mesh: Callable[[int], Mesh]) -> Growth:
        """The growth of the meshes that a function makes, from coarse ones."""
        plane, sizes, seconds = isinstance(mesh(COARSE[True][0]), PolygonMesh), [], []
        for n in COARSE[plane]:
            start = time.perf_counter()
            made = mesh(n)
            seconds.append(time.perf_counter() - start)
            offsets, nodes = (made.offsets, made.vertices) if isinstance(made, PolygonMesh) else made.cell_nodes
            within = sp.csr_array((np.ones(len(nodes)), nodes, offsets), shape=(made.n_cells, made.n_nodes))
            sizes.append((made.n_cells, made.n_nodes, (within.T @ within).nnz))
        meshing = (seconds[-1] - seconds[0]) / max(sizes[-1][0] - sizes[0][0], 1)
        powers = _powers(COARSE[plane], len(COARSE[plane]))
        return cls(plane, np.linalg.solve(powers, np.array(sizes, dtype=float)), max(meshing, 0.0))

    def at(self, n: int) -> Floats:
        """Cells, nodes and pairs."""
        sizes: Floats = (_powers((n,), len(self.coefficients)) @ self.coefficients)[0]
        # A mesh that does not grow with n makes the highest power vanish, but for rounding.
        return np.maximum(sizes, 1.0)


def _powers(ns: Sequence[int], most: int) -> Floats:
    return np.array(ns, dtype=float)[:, None] ** np.arange(most, 0, -1)


@dataclass(frozen=True)
class Foreseen:
    """The foreseen cost of a run: bytes of memory and of files, seconds."""

    cells: float
    unknowns: float
    linear: str
    memory: float
    disk: float
    seconds: float

    def __str__(self) -> str:
        # Two digits, in a unit that is read without counting.
        name, unit = ("h", 3600.0) if self.seconds >= 7200.0 else ("min", 60.0) if self.seconds >= 120.0 else ("s", 1.0)
        size = f"{_rounded(self.cells)} cells, {_rounded(self.unknowns)} unknowns"
        time = f"{_rounded(self.seconds / unit)} {name}"
        return f"{size}: {_rounded(self.memory / 1e9)} GB of memory and {time} with {self.linear}"


def _rounded(value: float) -> str:
    two = float(f"{value:.2g}")
    return f"{two:,.0f}" if two >= 10 else f"{two:g}"


def foreseen(
    growth: Growth, n: int, steps: int, stored: int, linear: LinearSolver | None = None, *, streamed: bool
) -> Foreseen:
    """Return what a run of so many steps takes; what is stored is in memory, or in files where it is `streamed`."""
    cells, nodes, pairs = growth.at(n)
    unknowns = len(growth.coefficients) * nodes
    name = type(linear).__name__
    if linear is None:  # the one that `choose_linear` takes, as far as the unknowns tell
        direct = direct_solver(int(unknowns))
        fits = unknowns <= (LARGEST_FACTOR if growth.plane else direct.largest_in_space)
        large = not fits and importlib.util.find_spec("pyamg") is not None
        name = "Iterative" if large else type(direct).__name__
    # PETSc's hierarchy on one rank is of the kind of Iterative's.
    law = LAWS["Iterative" if name == "PETSc" else name, growth.plane]
    # The factor of triangles or tetrahedra is as full as that of squares or cubes with these nodes.
    filled = max(pairs, DENSITY[growth.plane] * unknowns)
    memory, prepare, step = (factor * filled**power for factor, power in law)
    # A step takes .5 ms of 256 unknowns in contact beside what all unknowns take.
    seconds = growth.meshing * cells + prepare + stored * step + 1e-3 * steps
    # The files of a stored step: 3.9 MB of 24,649 squares and 49,928 unknowns.
    disk = stored * (48.0 * unknowns + 80.0 * cells) if streamed else 0.0
    return Foreseen(
        cells=cells,
        unknowns=unknowns,
        linear=name,
        # In memory a stored step has state, displacement and force of every unknown.
        memory=memory + (0.0 if streamed else 24.0 * unknowns * stored),
        disk=disk,
        seconds=seconds + (1.3e-6 * stored * cells if streamed else 0.0),
    )


def check_fits(
    growth: Growth, n: int, steps: int, stored: int, linear: LinearSolver | None, *, folder: Path | None
) -> Foreseen:
    """The cost of a run with its stored steps in `folder`, or in memory; ProblemError where it does not fit."""

    def at(n: int, stored: int = stored) -> Foreseen:
        return foreseen(growth, n, steps, stored, linear, streamed=folder is not None)

    found, most = at(n), machine_memory()
    if found.memory > most:
        # Forecasts are off by a third at times, and there are other programs.
        fits = bisect(range(1, n), 0.7 * most, key=lambda k: at(k).memory)
        ways = ["--store last"] if at(n, 1).memory < 0.7 * most else [f"at most --n {fits}"] if fits else []
        if growth.plane:
            ways.append("--target 0.02, which makes cells small only where the error is")
        raise ProblemError(
            f"--n {n}: {found} are foreseen, and this machine has {_rounded(most / 1e9)} GB of memory. Take "
            f"{', or '.join(ways) or 'fewer cells'}."
        )
    free = np.inf if folder is None else shutil.disk_usage(folder).free
    if found.disk > free:
        raise ProblemError(
            f"--out: {_rounded(found.disk / 1e9)} GB of files are foreseen, and {_rounded(free / 1e9)} GB are free at "
            f"{folder}. "
            "Store fewer steps (--store last, or every N-th by --store N), or choose another disk."
        )
    return found


def machine_memory() -> float:
    """Bytes of memory that the machine has, or that its control group may take; infinite where nobody says."""
    found = [np.inf]
    with suppress(AttributeError, OSError, ValueError):
        found.append(float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError):
        found.append(float(Path("/sys/fs/cgroup/memory.max").read_text()))
    return min(found)
