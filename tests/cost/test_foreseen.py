"""Memory and time of a run, foreseen before its mesh is made; what the machine has not is refused with a way out."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import feng_han_huang
import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli import run as command
from vemcvx.cost import foreseen as laws
from vemcvx.cost.foreseen import LAWS, Growth, check_fits, foreseen, machine_memory

ROOT = Path(__file__).parents[2]


def call(*words):
    done = CliRunner().invoke(app, words)
    return done.exit_code, done.output


FAMILIES = {**vx.meshes.FAMILIES, **vx.meshes.SPACE_FAMILIES}


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_coarse_meshes_tell_the_size_of_fine_ones(family):
    n = 10 if family in vx.meshes.SPACE_FAMILIES else 32
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mesh = FAMILIES[family](n)
        found = foreseen(Growth.of(FAMILIES[family]), n, 8, 9, streamed=False)
    assert found.cells == pytest.approx(mesh.n_cells, rel=0.05)
    assert found.unknowns == pytest.approx(mesh.points.size, rel=0.05)


def test_meshes_that_do_not_grow_with_n():
    fixed = vx.meshes.squares(12)
    found = foreseen(Growth.of(lambda n: fixed), 5000, 8, 9, streamed=False)
    assert found.memory < 1e9


def test_laws_grow_with_cells_steps_and_what_is_stored():
    growth = Growth.of(vx.meshes.squares)
    for linear in (vx.SuperLU(), vx.Pardiso(), vx.Iterative()):
        small, large = (foreseen(growth, n, 8, 9, linear, streamed=False) for n in (100, 200))
        assert 3.5 < large.memory / small.memory < 6
        assert small.seconds < large.seconds
        more = foreseen(growth, 100, 800, 801, linear, streamed=False)
        assert more.memory - small.memory == pytest.approx(792 * 24 * small.unknowns)
        files = foreseen(growth, 100, 800, 801, linear, streamed=True)
        assert files.memory == pytest.approx(small.memory - 9 * 24 * small.unknowns)
        assert files.disk > 801 * 24 * small.unknowns
    assert {name for name, _ in LAWS} == {"SuperLU", "Pardiso", "Iterative"}


@pytest.fixture
def small_machine(monkeypatch):
    monkeypatch.setattr(laws, "machine_memory", lambda: 8e9)


@pytest.mark.long
def test_5000_squares_a_side_are_refused_before_they_are_made(small_machine, monkeypatch):
    made = []
    mesh = command.Problem.mesh
    monkeypatch.setattr(command.Problem, "mesh", lambda self, n, family=None: made.append(n) or mesh(self, n, family))
    code, said = call("run", "feng_han_huang", "--n", "5000")
    assert code == 2
    said = " ".join(said.split())
    assert "--n 5000: 25,000,000 cells, 50,000,000 unknowns: " in said
    assert "are foreseen, and this machine has 8 GB of memory. Take at most --n " in said
    assert "or --target 0.02, which makes cells small only where the error is" in said
    assert max(made) <= 16
    # The way out is one.
    way = int(said.split("at most --n ")[1].split(",")[0])
    growth = Growth.of(vx.meshes.squares)
    fits = foreseen(growth, way, 64, 65, streamed=False)
    assert 0.6 * 8e9 < fits.memory < 0.8 * 8e9


def test_what_is_stored_may_be_what_is_too_much(small_machine):
    growth = Growth.of(vx.meshes.squares)
    with pytest.raises(vx.ProblemError, match="Take --store last, or --target"):
        check_fits(growth, 200, 10_000, 10_001, None, folder=None)


def test_in_space_adaptive_meshes_are_no_way_out(small_machine):
    with pytest.raises(vx.ProblemError, match=r"has 8 GB of memory. Take at most --n \d+\.$"):
        check_fits(Growth.of(vx.meshes.cubes), 100, 8, 9, vx.SuperLU(), folder=None)


def test_a_disk_that_is_too_small(tmp_path):
    growth = Growth.of(vx.meshes.squares)
    with pytest.raises(
        vx.ProblemError, match=r"--out: .* GB of files are foreseen, and .* GB are free at .*Store fewer"
    ):
        check_fits(growth, 100, 10**9, 10**9 + 1, None, folder=tmp_path)
    assert check_fits(growth, 100, 10**9, 1, None, folder=tmp_path).disk < 1e8


def test_the_machine_has_memory():
    assert 1e8 < machine_memory() < 1e15


@pytest.mark.long
def test_long_runs_are_announced(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "EVERY", 0.01)
    code, said = call("run", "feng_han_huang", "--n", "65", "--steps", "2", "--store", "last")
    assert code == 0, said
    assert "foreseen    4,200 cells, 8,700 unknowns: 0.0" in said
    assert "foreseen" not in call("run", "feng_han_huang", "--n", "16", "--steps", "2")[1]
    # A problem that cannot make coarse meshes, or has a mesh of its own, is run as it is.
    (tmp_path / "own.py").write_text(
        "from feng_han_huang import *\nfrom feng_han_huang import mesh as made\n"
        "def mesh(n, family='squares'):\n    if n < 65: raise ValueError\n    return made(n - 60)\n"
    )
    code, said = call("run", "own.py", "--n", "65", "--steps", "2")
    assert code == 0, said
    assert "foreseen" not in said


@pytest.mark.slow
@pytest.mark.parametrize(
    "word", ["squares:300:SuperLU", "squares:300:Pardiso", "voronoi:100:SuperLU", "cubes:18:Pardiso"]
)
def test_memory_is_what_was_foreseen(word):
    family, n, linear = word.split(":")
    if linear == "Pardiso" and not vx.Pardiso.installed():
        pytest.skip("PARDISO is not installed")
    script = ROOT / "tests" / "benchmarks" / "growth_laws.py"
    run = subprocess.run([sys.executable, script, "--one", word], capture_output=True, text=True, check=True)
    measured = 1e6 * float(run.stdout.split()[-1])
    growth = Growth.of(FAMILIES[family] if family == "cubes" else lambda n: feng_han_huang.mesh(n, family=family))
    found = foreseen(growth, int(n), 8, 9, getattr(vx, linear)(), streamed=False)
    assert 0.6 < found.memory / measured < 1.7


def test_free_memory_of_a_control_group(monkeypatch):
    monkeypatch.setattr(Path, "read_text", lambda self: "123456789\n")
    assert machine_memory() == 123456789.0
    monkeypatch.setattr(Path, "read_text", lambda self: "max\n")
    assert machine_memory() > 123456789.0
    assert np.isfinite(machine_memory())
