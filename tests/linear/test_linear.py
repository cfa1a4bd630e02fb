"""Linear solvers: conformance suite, memory, and user-defined classes."""

import os
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from installed import needs
from scenes import long_cases, paper_scene, small

import vemcvx as vx
from vemcvx.linear import Iterative, Pardiso, SuperLU
from vemcvx.results.files import peak_memory_mb
from vemcvx.scene import pose_scene
from vemcvx.testing import linear_suite

DIRECT = [SuperLU(), pytest.param(Pardiso(), marks=needs("pymklpardiso"))]


test_superlu = long_cases(linear_suite(SuperLU()), lambda case: "runs agree" in case)
test_pardiso = needs("pymklpardiso")(
    long_cases(linear_suite(Pardiso()), lambda case: "runs agree" in case and not case.endswith(": friction"))
)
test_iterative = pytest.mark.long(needs("pyamg")(linear_suite(Iterative())))
test_petsc = needs("petsc4py")(linear_suite(vx.PETSc()))


MANY_FACTORS_SCRIPT = """
import numpy as np, vemcvx as vx
from vemcvx.linear import order_by_minimum_degree
from vemcvx.results.files import peak_memory_mb
from vemcvx.vem import Space, stiffness
mesh = vx.meshes.squares(48)
K = stiffness(Space(mesh), np.ones(mesh.n_cells), np.ones(mesh.n_cells))[98:, 98:].tocsr()
order, peaks = order_by_minimum_degree(K), []
for _ in range(12):
    factor, S = vx.{linear}.eliminate(K, order, np.arange(96))
    factor.solve(np.ones(K.shape[0]))
    peaks.append(peak_memory_mb())
print(peaks[1] - peaks[0], peaks[-1] - peaks[3])
"""


@pytest.mark.long
@pytest.mark.skipif(peak_memory_mb() is None, reason="only Linux gives the peak memory of a process")
@pytest.mark.parametrize("linear", DIRECT, ids=str)
def test_unused_factors_free_their_memory(linear):
    """Peak memory does not grow from the 4th to the 12th factor."""
    # By default, the C library keeps a varying part of the freed memory.
    environment = {**os.environ, "MALLOC_MMAP_THRESHOLD_": "65536"}
    command = [sys.executable, "-c", MANY_FACTORS_SCRIPT.format(linear=linear)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    second, later = map(float, run.stdout.split())
    assert later < max(second, 1.0)


@dataclass(frozen=True)
class Minimal(vx.LinearSolver):
    """A user-defined linear solver with only the method that the base class requires."""

    def factorise(self, K, near_kernel=None):
        return SuperLU().factorise(K)


class Eliminating(Minimal):
    eliminates = True

    def eliminate(self, K, order, last):
        assert np.array_equal(np.sort(order), np.arange(K.shape[0]))
        return SuperLU().eliminate(K, order, last)


def test_programs_are_condensed_by_linear_solvers_with_elimination():
    system = pose_scene(paper_scene(), small("squares", 6)).system
    ours, full, condensed = (
        next(vx.programs(paper_scene(), small("squares", 6), [0.0, 1.0], linear=linear))
        for linear in (SuperLU(), Minimal(), Eliminating())
    )
    assert len(full.g) == system.n
    assert len(condensed.g) == len(ours.g) == len(np.unique(system.norms.B.indices))
    assert np.array_equal(condensed.operators.K, ours.operators.K)
    with pytest.raises(vx.NotAccepted, match=r"^linear solver Minimal: it computes no Schur complements"):
        Minimal().eliminate(sp.eye_array(2, format="csr"), np.arange(2), np.arange(1))
