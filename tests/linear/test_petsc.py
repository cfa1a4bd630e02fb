"""PETSc on two ranks under mpiexec."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from installed import needs

import block_in_space
import vemcvx as vx
from vemcvx.scene import pose_scene

ranked = pytest.mark.skipif(
    find_spec("petsc4py") is None or shutil.which("mpiexec") is None, reason="petsc4py or mpiexec is not installed"
)


def run_on_two_ranks(*words):
    environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    environment |= {"OMPI_MCA_rmaps_base_oversubscribe": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = ["mpiexec", "-n", "2", sys.executable, *words]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=500)


@ranked
@needs("pyamg")
@pytest.mark.slow
def test_two_ranks_have_the_answer_of_other_linear_solvers_within_both_certificates(tmp_path):
    given = ["run", "block_in_space", "--n", "6", "--steps", "4"]
    run = run_on_two_ranks("-m", "vemcvx", *given, "--linear", "petsc", "--out", str(tmp_path / "two"))
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.count("block_in_space:") == 1
    two = vx.read_history(tmp_path / "two")
    assert "PETSc" in two.trajectory.linear
    A = pose_scene(block_in_space.scene(), two.mesh).A
    for other in ("superlu", "iterative"):
        run = [sys.executable, "-m", "vemcvx", *given, "--linear", other, "--out", str(tmp_path / other)]
        subprocess.run(run, check=True, capture_output=True)
        one = vx.read_history(tmp_path / other)
        apart = (two.displacement - one.displacement).reshape(len(one.times), -1)
        distance = np.sqrt(np.maximum(np.einsum("si,si->s", apart, (A @ apart.T).T), 0.0))
        bounds = one.certificate * one.trajectory.unit + two.certificate * two.trajectory.unit
        assert (distance <= np.cumsum(bounds)).all()


@ranked
@pytest.mark.slow
def test_two_ranks_share_set_up_and_solves():
    """One rank alone does at least 1.6 times as many floating-point operations as the busier of two ranks."""
    given = [str(Path(__file__).parents[1] / "benchmarks" / "ranks.py"), "--n", "20", "--solves", "1"]
    alone = subprocess.run([sys.executable, *given], check=True, capture_output=True, text=True).stdout
    shared = run_on_two_ranks(*given)
    one, two = (re.findall(r"rank \d: .*? ([\d.e+]+) operations", output) for output in (alone, shared.stdout))
    assert (len(one), len(two)) == (1, 2), (shared.returncode, shared.stdout, shared.stderr)
    assert float(one[0]) > 1.6 * max(map(float, two))


FAILING = """
import sys, numpy as np, vemcvx as vx
from vemcvx.linear import petsc
from mpi4py import MPI
if MPI.COMM_WORLD.rank == 1:
    def solve(self, *given):
        raise MemoryError("no memory is left here")
    petsc.Ranks.solve = solve
if petsc.serve():
    raise SystemExit
K = 3 * np.eye(40) - np.eye(40, k=1) - np.eye(40, k=-1)
vx.march(vx.System(K, lambda t: t * np.ones(40)), [0, 1], linear=vx.PETSc())
"""


@ranked
@pytest.mark.slow
def test_an_error_of_rank_1_ends_all_ranks_with_a_sentence():
    run = run_on_two_ranks("-c", FAILING)
    assert run.returncode != 0
    assert "PETSc: rank 1 of 2 failed, which ends all ranks: no memory is left here" in run.stderr


@ranked
@pytest.mark.slow
def test_an_error_of_rank_0_ends_all_ranks_with_a_sentence():
    run = run_on_two_ranks("-m", "vemcvx", "run", "block_in_space", "--linear", "petsc", "--solver", "nobody")
    assert run.returncode == 2
    assert run.stderr.count("there is no solver 'nobody'") == 1
