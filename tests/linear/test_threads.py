"""PARDISO on several threads: the answer of one, threads by name and by the environment, and errors without oneMKL."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from installed import needs, threaded
from scenes import cyclic, paper_scene, small
from threadpoolctl import ThreadpoolController
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli.solver_names import on_threads
from vemcvx.linear import default, pardiso
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 7)
NAMES = pardiso.THREADS, "MKL_NUM_THREADS", "OMP_NUM_THREADS"


@pytest.fixture(autouse=True)
def _without_variables(monkeypatch):
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.long
@threaded
@pytest.mark.parametrize("condense", [True, False], ids=["condensed", "all unknowns"])
@pytest.mark.parametrize("viscous", [False, True])
def test_two_threads_have_the_answer_of_one_within_both_certificates(condense, viscous):
    scene = vx.Scene(*paper_scene(cyclic), *([vx.Viscosity(0.1, 0.1)] if viscous else []))
    mesh = small("voronoi", 16)
    one, two = (vx.simulate(scene, mesh, TIMES, linear=vx.Pardiso(k), condense=condense) for k in (1, 2))
    A = pose_scene(scene, mesh).A
    apart = (two.displacement - one.displacement).reshape(len(TIMES), -1)
    energy = np.sqrt(np.maximum(np.einsum("ni,ni->n", apart, (A @ apart.T).T), 0.0))
    bounds = one.certificate * one.trajectory.unit + two.certificate * two.trajectory.unit
    assert (energy <= np.cumsum(bounds)).all()
    assert two.certificate.max() <= 1e-8
    assert two.trajectory.linear == "Pardiso(threads=2)"


@threaded
def test_factors_on_two_threads_solve_halve_and_refuse():
    system = pose_scene(paper_scene(), small("squares", 24)).system
    K, last = system.K, system.retained
    (one, S), (two, T) = (vx.Pardiso(k).eliminate(K, np.arange(system.n), last) for k in (1, 2))
    assert np.abs(S - T).max() < 1e-12 * np.abs(S).max()
    b = np.random.default_rng(0).normal(size=(system.n, 3))
    assert np.abs(K @ two.solve(b) - b).max() < 1e-9
    z, tau = two.halves.halved(b[:, 0])
    assert np.abs(tau - one.halves.halved(b[:, 0])[1]).max() < 1e-9
    assert np.abs(two.halves.completed(z, one.solve(b[:, 0])[last]) - one.solve(b[:, 0])).max() < 1e-9
    with pytest.raises(vx.SceneError, match="singular or indefinite"):
        vx.Pardiso(threads=2).factorise(sp.csr_matrix([[1.0, 2.0], [2.0, 1.0]]))


BOTH = """
import sys, numpy as np, vemcvx as vx
from scenes import paper_scene
from vemcvx.scene import pose_scene
system = pose_scene(paper_scene(), vx.meshes.squares(128)).system
for threads in map(int, sys.argv[1]):
    S = vx.Pardiso(threads).eliminate(system.K, np.arange(system.n), system.retained)[1]
    if threads == 1:
        print(S.tobytes().hex())
"""


@pytest.mark.long
@threaded
@needs("pymklpardiso")
def test_one_thread_has_its_digits_whatever_ran_before_in_the_process():
    told = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    before, after = (
        subprocess.run([sys.executable, "-c", BOTH, order], capture_output=True, text=True, check=True, env=told).stdout
        for order in ("1", "21")
    )
    assert before == after != ""


@threaded
@pytest.mark.parametrize("name", NAMES)
def test_the_environment_says_how_many(monkeypatch, name):
    assert vx.Pardiso().cores == 1
    monkeypatch.setenv(name, "2")
    assert vx.Pardiso().cores == 2
    assert vx.Pardiso(threads=1).cores == 1
    monkeypatch.setenv(name, "many")
    assert vx.Pardiso().cores == 1


def test_the_first_variable_counts(monkeypatch):
    assert pardiso.threads_of_environment() == 1
    monkeypatch.setenv("OMP_NUM_THREADS", "8,2")
    assert pardiso.threads_of_environment() == 8
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    assert pardiso.threads_of_environment() == 3
    with on_threads(1):
        assert pardiso.threads_of_environment() == 1
        with on_threads(None):
            assert os.environ[pardiso.THREADS] == "1"
    assert pardiso.THREADS not in os.environ


@pytest.mark.long
def test_without_a_threaded_library_threads_are_refused_in_a_sentence(monkeypatch):
    monkeypatch.setattr(pardiso, "_threaded", lambda: None)
    K = sp.eye_array(3, format="csr")
    with pytest.raises(vx.NotAccepted, match=r"^Pardiso: 4 threads need .*libmkl_rt.* pip install 'vemcvx\[threads\]'"):
        vx.Pardiso(threads=4).factorise(K)
    run = CliRunner().invoke(app, ["run", "feng_han_huang", "--n", "4", "--steps", "2", "--threads", "4"])
    assert run.exit_code == 2
    assert "pip install 'vemcvx[threads]'" in " ".join(run.output.split())
    # Who names none, but an environment that asks for several, gets the one thread that there is.
    monkeypatch.setenv("MKL_NUM_THREADS", "4")
    assert vx.Pardiso().cores == 1


@pytest.mark.long
def test_linear_solvers_of_one_thread_say_so():
    given = ["run", "feng_han_huang", "--n", "4", "--steps", "2", "--threads", "2", "--linear", "superlu"]
    run = CliRunner().invoke(app, given)
    assert run.exit_code == 2
    assert "--threads: the linear solver superlu has one thread; take --linear pardiso." in " ".join(run.output.split())


@pytest.mark.long
@threaded
@pytest.mark.parametrize(
    "command", [("run",), ("compare", "--solvers", "newton"), ("cost", "--steps", "4", "--mesh", "squares")]
)
def test_commands_take_threads(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = [
        command[0],
        "feng_han_huang",
        "--n",
        "24" if command[0] != "cost" else "24,28",
        *command[1:],
        "--threads",
        "2",
    ]
    run = CliRunner().invoke(app, given)
    assert run.exit_code == 0, run.output
    assert command[0] != "cost" or "with 2 threads of PARDISO" in run.output
    assert pardiso.THREADS not in os.environ


def test_large_dense_matrices_have_as_many_threads():
    def of_blas():
        found = ThreadpoolController().info()
        return {
            one["num_threads"] for one in found if Path(one["filepath"]).parent.name in ("numpy.libs", "scipy.libs")
        }

    before = of_blas()
    if not before:
        pytest.skip("NumPy and SciPy have no BLAS of their own")
    with default.one_thread(3_000, cores=2):
        assert of_blas() == {2}
    assert of_blas() == before
    with default.one_thread(100, cores=2):
        assert of_blas() == {1}
