"""PETSc on two ranks under mpiexec: the same answers, shared work, and what happens when a rank fails."""

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


def started(*words):
    told = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    told["OMPI_MCA_rmaps_base_oversubscribe"] = "1"
    told["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    command = ["mpiexec", "-n", "2", sys.executable, *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=told)


def on_two_ranks(*words):
    with started(*words) as run:
        said = run.communicate(timeout=500)
    return subprocess.CompletedProcess(words, run.returncode, *said)


@ranked
@needs("pyamg")
@pytest.mark.slow
def test_two_ranks_have_the_answer_of_other_linear_solvers_within_both_certificates(tmp_path):
    given = ["run", "block_in_space", "--n", "6", "--steps", "4"]
    run = on_two_ranks("-m", "vemcvx", *given, "--linear", "petsc", "--out", str(tmp_path / "two"))
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
    """In operations, which no other program on the machine changes: of the busier of two ranks, and of one alone."""
    given = [str(Path(__file__).parents[1] / "benchmarks" / "ranks.py"), "--n", "20", "--solves", "1"]
    alone = subprocess.run([sys.executable, *given], check=True, capture_output=True, text=True).stdout
    shared = on_two_ranks(*given)
    one, two = (re.findall(r"rank \d: .*? ([\d.e+]+) operations", said) for said in (alone, shared.stdout))
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
def test_an_error_on_a_rank_ends_all_with_a_sentence():
    run = on_two_ranks("-c", FAILING)
    assert run.returncode != 0
    assert "PETSc: rank 1 of 2 failed, which ends all: no memory is left here" in run.stderr


@ranked
@pytest.mark.slow
def test_an_error_of_rank_0_ends_all_with_its_sentence():
    run = on_two_ranks("-m", "vemcvx", "run", "block_in_space", "--linear", "petsc", "--set", "nothing=1")
    assert run.returncode != 0
    assert "nothing" in run.stderr
    run = on_two_ranks("-m", "vemcvx", "run", "block_in_space", "--linear", "petsc", "--solver", "nobody")
    assert run.returncode == 2
    assert run.stderr.count("there is no solver 'nobody'") == 1
