"""PETSc behind the seam: steps, bounds and errors as with Iterative; on one rank, and on two under mpiexec."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import assert_within_both_certificates, block, on_floor
from installed import needs
from scenes import cyclic, paper_scene, small

import block_in_space
import vemcvx as vx
from vemcvx.cli.run import ROWS
from vemcvx.linear import SuperLU
from vemcvx.scene import pose_scene
from vemcvx.stepping import CHECKPOINT, march

TIMES = np.linspace(0.0, 1.0, 5)
here = needs("petsc4py")
ranked = pytest.mark.skipif(
    find_spec("petsc4py") is None or shutil.which("mpiexec") is None, reason="petsc4py or mpiexec is not installed"
)


def test_what_is_missing_is_named(monkeypatch):
    monkeypatch.setattr("vemcvx.linear.petsc.find_spec", lambda name: None)
    vx.linear.petsc.all_ranks.cache_clear()
    with pytest.raises(vx.NotAccepted, match=r"^PETSc: petsc4py and mpi4py cannot be imported; install Debian's"):
        vx.PETSc().factorise(sp.eye_array(3, format="csr"))


@here
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_steps_in_space_are_those_of_direct_factors(contact):
    def turning(t):
        angle, pull = 2 * np.pi * t, 0.5 * min(1.0, 4 * t)
        return np.array([pull * np.cos(angle), pull * np.sin(angle), -0.2 * pull - (contact == "unilateral") * t])

    system = on_floor(block(4), turning, contact=contact, bound=0.2)
    direct, iterative = (march(system, TIMES, linear=linear) for linear in (SuperLU(), vx.PETSc()))
    assert_within_both_certificates(system, direct, iterative)


@here
def test_histories_in_the_plane_are_those_of_direct_factors():
    scene, mesh = vx.Scene(*paper_scene(cyclic), vx.Viscosity(0.1, 0.1)), small("voronoi", 12)
    one, two = (vx.simulate(scene, mesh, TIMES, linear=linear) for linear in (SuperLU(), vx.PETSc()))
    assert two.certificate.max() <= 1e-8
    assert np.abs(two.displacement - one.displacement).max() < 1e-7 * np.abs(one.displacement).max()


@here
@pytest.mark.parametrize("tolerance", [0.5, 1e-4, 1e-12])
def test_energies_of_inexact_solves_are_bounds(tolerance):
    """From above, and not by more than the roughness of the solve and the bound on the spectrum account for."""
    system = pose_scene(paper_scene(), small("voronoi", 14)).system
    exact = SuperLU().factorise(system.K)
    inexact = vx.PETSc(tolerance).factorise(system.K, system.near_kernel)
    smooth, rough = system.force(1.0), np.random.default_rng(4).normal(size=system.n)
    for b in (smooth, rough, np.eye(1, system.n, 7)[0], system.K @ rough, smooth - system.K @ inexact.solve(smooth)):
        energy = exact.energy(b)
        assert energy <= inexact.energy(b) * (1 + 1e-9)
        assert inexact.energy(b) < 1.5 * energy


@here
def test_solves_that_do_not_converge_and_indefinite_matrices_are_refused_in_a_sentence():
    system = pose_scene(paper_scene(), small("voronoi", 14)).system
    with pytest.raises(vx.SceneError, match=r"^PETSc: 2 iterations left a residual of"):
        vx.PETSc(max_iterations=2).factorise(system.K, system.near_kernel).solve(system.force(1.0))
    with pytest.raises(vx.SceneError, match="singular or indefinite"):
        vx.PETSc().factorise(sp.csr_matrix([[1.0, 2.0], [2.0, 1.0]]))


def push(x, t):
    return t * np.column_stack([8 * (1.25 - x[:, 2]), np.full(len(x), 2.0), np.full(len(x), -4.0)])


HELD = vx.Elasticity(young=200.0, poisson=0.3), vx.Traction(push, on="left"), vx.TrescaFriction(bound=1.0, on="bottom")
SCENES = {
    "bilateral": (*HELD, vx.Clamp(on="right"), vx.BilateralContact(on="bottom")),
    "one-sided": (*HELD, vx.Clamp(on="right"), vx.UnilateralContact(on="bottom")),
    "moved": (
        *HELD,
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.01 * t, 0.0, -0.02 * t], (len(x), 1)), on="right"),
        vx.UnilateralContact(on="bottom"),
    ),
    "viscous": (*HELD, vx.Clamp(on="right"), vx.BilateralContact(on="bottom"), vx.Viscosity(0.1, 0.1)),
}


@here
@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_scenes_have_the_steps_and_forces_of_direct_factors(name):
    scene, mesh = vx.Scene(*SCENES[name]), vx.meshes.cubes(4)
    direct, iterative = (vx.simulate(scene, mesh, TIMES, linear=linear) for linear in (SuperLU(), vx.PETSc()))
    posed = pose_scene(scene, mesh)
    one, two = direct.trajectory, iterative.trajectory
    assert_within_both_certificates(posed.system, one, two)
    claimed = sum(run.certificate_total + run.certificate_floor for run in (one, two)) * one.scale
    # |A e| <= |A|^(1/2) |e|_A, and the norm of A is at most its largest sum of a row; viscous forces have rates of e.
    stiff = abs(posed.A).sum(axis=1).max()
    if posed.viscosity is not None:
        stiff += abs(posed.viscosity).sum(axis=1).max() * 2 / np.diff(TIMES).min()
    rounding = 1e-13 * np.abs(abs(posed.A) @ np.abs(direct.displacement).max(axis=0).ravel()).max()
    apart = np.linalg.norm((iterative.forces - direct.forces).reshape(len(TIMES), -1), axis=1)
    assert (apart <= np.sqrt(stiff) * claimed + rounding).all()
    assert np.array_equal(iterative.contact.closed, direct.contact.closed)


@here
@needs("cvxpy")
@pytest.mark.long
def test_solvers_that_read_all_entries_have_them():
    scene, mesh = vx.Scene(*SCENES["bilateral"]), vx.meshes.cubes(3)
    runs = [vx.simulate(scene, mesh, TIMES[:3], linear=vx.PETSc(), solver=s).trajectory for s in (None, vx.Clarabel())]
    K, apart = pose_scene(scene, mesh).system.K, runs[0].state - runs[1].state
    claimed = sum(run.certificate_total + run.certificate_floor for run in runs) * runs[0].scale
    assert (np.sqrt(np.maximum(np.einsum("si,si->s", apart, (K @ apart.T).T), 0.0)) <= claimed).all()


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


def rank_of(pid):
    try:
        words = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return None
    return next((int(word.split(b"=")[1]) for word in words if word.startswith(b"OMPI_COMM_WORLD_RANK=")), None)


def steps_kept(checkpoint):
    """How many steps a run may go on after; where the machine is busy, the first checkpoint has none."""
    if not checkpoint.exists():
        return 0
    with np.load(checkpoint) as kept:
        return int(kept["step"])


@ranked
@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are found in /proc")
def test_what_was_done_before_a_rank_is_killed_is_kept(tmp_path):
    folder = tmp_path / "out"
    given = ["-m", "vemcvx", "run", "block_in_space", "--n", "4", "--steps", "60", "--linear", "petsc"]
    with started(*given, "--out", str(folder)) as run:
        until = time.monotonic() + 240
        while not steps_kept(folder / ROWS / CHECKPOINT):
            assert run.poll() is None, run.communicate()
            assert time.monotonic() < until
            time.sleep(0.05)
        mine = [int(child) for child in Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()]
        killed = [pid for pid in mine if rank_of(pid) == 1]
        assert len(killed) == 1
        os.kill(killed[0], signal.SIGKILL)
        _, said = run.communicate(timeout=60)
    assert run.returncode != 0
    assert "signal 9 (Killed)" in said
    resumed = on_two_ranks(*given, "--resume", str(folder))
    assert resumed.returncode == 0, resumed.stderr
    assert int(re.search(r"resumed +after step (\d+) of 60", resumed.stdout)[1]) > 0
    assert vx.read_history(folder).certificate.max() <= 1e-8
