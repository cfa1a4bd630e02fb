"""`vemcvx run` and `vemcvx show`: output, files, refusals with exit codes, and few imports."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import feng_han_huang
import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli import run as command
from vemcvx.plots.style import in_units

PROBLEM = str(Path(vx.__file__).parent.parent / "problems" / "feng_han_huang.py")
MINIMAL = """
import numpy as np, vemcvx as vx
def scene(young=200.0, on="bottom"):
    return vx.Scene(vx.Elasticity(young, 0.3), vx.Clamp(on=on), vx.BodyForce(lambda x, t: t + 0 * x))
def mesh(n):
    return vx.meshes.squares(n)
def times(steps):
    return np.linspace(0, 1, steps + 1)
"""


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def run(*arguments):
    """Run PROBLEM on a small mesh, and return the output."""
    done = invoke("run", PROBLEM, "--n", 4, "--steps", 2, *arguments)
    assert done.exit_code == 0, done.output
    return done.output


def output_of(done):
    """Return the output on one line, without the frames of usage errors."""
    return " ".join(done.output.replace("│", " ").split())


def write_problem(tmp_path, text, name="problem.py"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.long
def test_run_prints_and_writes_the_history(tmp_path):
    done = invoke("run", PROBLEM, "--n", 8, "--steps", 8, "--store", 4, "--out", tmp_path / "out", "--plot")
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["problem"] == "feng_han_huang"
    assert (told["mesh"]["family"], told["mesh"]["n"], told["steps"]) == ("squares", 8, 8)
    # The energies of Newton and Clarabel agree in 12 digits.
    assert told["energy"] == pytest.approx(0.051934851760595, rel=1e-12)
    assert told["dissipated"] == pytest.approx(0.008598564142584, rel=1e-12)
    history = vx.read_history(tmp_path / "out")
    assert history.stored.tolist() == [0, 4, 8]
    assert history.summary() in done.output
    for one in history.extremes:
        unit, at = in_units(one.unit, feng_han_huang.UNITS), rf"at \(.*\), t = {one.time:.6g} s$"
        assert re.search(rf"^{one.name} +{one.value:.6g} {unit} +{at}", done.output, re.M)
    pictures = {"deformed_mesh", "stressed_body", "contact_pressure", "contact_slip", "wear", "energy_ledger"}
    pictures |= {"friction_traction", "hysteresis_loop", "forces_over_time", "stick_slip_map"}
    steps = {f"step_{n:04d}.vtu" for n in (0, 4, 8)}
    files = {"contact.csv", "history.npz", "history.pvd", "steps.csv", "summary.json"} | steps
    assert {path.name for path in (tmp_path / "out").iterdir()} == files | {f"{name}.png" for name in pictures}
    assert f"files       {tmp_path / 'out'}: history.pvd with 3 instants, summary.json" in done.output
    assert f"pictures    {tmp_path / 'out'}: deformed_mesh.png" in done.output


@pytest.mark.long
def test_the_options_set_and_mesh_and_store_and_no_condense_reach_the_run(tmp_path):
    run("--set", "bound=1e6", "--mesh", "voronoi", "--store", "last", "--no-condense", "--out", tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())
    assert (told["dissipated"], told["mesh"]["family"]) == (0.0, "voronoi")
    assert "TrescaFriction: |friction| <= 1000000.0 on bottom" in told["effects"]
    assert vx.read_history(tmp_path).stored.tolist() == [2]


@pytest.mark.long
def test_a_mesh_file_replaces_a_family(tmp_path):
    path = tmp_path / "part.vtu"
    vx.meshes.voronoi(3).write(path)
    run("--mesh", path, "--out", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "summary.json").read_text())["mesh"]
    assert (found["family"], found["n"], found["cells"]) == (str(path), None, 9)
    assert "9 cells" in output_of(invoke("show", PROBLEM, "--mesh", path))


@pytest.mark.long
def test_a_missed_accuracy_exits_with_three_and_keeps_its_steps(tmp_path):
    missed = invoke("run", PROBLEM, "--n", 4, "--steps", 2, "--accuracy", "1e-17", "--out", tmp_path / "out")
    assert missed.exit_code == 3
    assert re.search(r"step \d at t = \S+: Newton reached", missed.output)
    assert "Traceback" not in missed.output
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["rows"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--solver", "Guroby"], "--solver: there is no solver 'Guroby'"),
        (["--solver", "Gurobi"], "solver 'GUROBI': cvxpy does not find it here"),
        (["--n", "0"], "Invalid value for '--n'"),
        (["--out", PROBLEM], "cannot be used as a folder"),
    ],
)
def test_invalid_options_exit_with_two(options, says):
    refused = invoke("run", PROBLEM, "--n", 4, "--steps", 2, *options)
    assert refused.exit_code == 2, refused.output
    assert "Traceback" not in refused.output
    assert re.search(says, output_of(refused)), refused.output


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("import nowhere", "line 1: executing it failed: ModuleNotFoundError"),
        ("def scene(:", "executing it failed: SyntaxError"),
        ("def scene(): ...", 'does not define mesh(n, family="squares") nor times(steps)'),
        (MINIMAL + "def scene(): return 3", "scene(...) returned 3"),
        (MINIMAL + "def mesh(n):\n    return 1 / 0", "line 10: mesh(2) failed: ZeroDivisionError"),
        ("import sys; sys.exit(3)", "line 1: executing it failed: SystemExit: 3"),
        (MINIMAL.replace("t + 0 * x", "exit(4)"), "BodyForce"),
        (MINIMAL + "def times(n): return [0, 0]", "times: found [0, 0]"),
    ],
)
def test_invalid_problem_files_exit_with_two(tmp_path, text, says):
    refused = invoke("run", write_problem(tmp_path, text), "--n", 2)
    assert refused.exit_code == 2, refused.output
    assert says in refused.output


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line_without_paths(tmp_path):
    text = MINIMAL.replace("vx.meshes.squares(n)", "vx.meshes.triangles(n)").replace("0.3", "0.4999")
    done = invoke("run", write_problem(tmp_path, text), "--n", 2, "--steps", 1)
    assert done.exit_code == 0, done.output
    assert "vemcvx: warning: Elasticity: poisson = 0.4999 on a mesh of triangles" in done.output
    assert "vemcvx/" not in done.output


def test_show_describes_scene_mesh_program_and_solvers(tmp_path):
    shown = invoke("show", PROBLEM, "--n", 8)
    assert shown.exit_code == 0
    rows = {line[:14].strip(): line[14:].strip() for line in shown.output.splitlines() if line[:14].strip()}
    assert rows["unknowns"] == "136 in all, 8 after condensation"
    assert rows["terms"] == "8 absolute values"
    assert "left out" not in rows
    assert rows["solvers"] == "Newton, OSQP, Clarabel; the default is Newton"
    assert rows["not accepting"] == "Direct (no absolute values)"
    assert rows["mesh"] == "squares, n = 8: 64 cells, 81 nodes, h = 0.1768"
    for effect in (
        "Elasticity: E = 200.0, nu = 0.3, plane strain, shear stabilisation",
        "Clamp: u = 0 on right",
        "Traction: pull(x, t) on left",
        "TrescaFriction: |friction| <= 4.0 on bottom",
    ):
        assert effect in output_of(shown)
    loose = invoke("show", write_problem(tmp_path, MINIMAL), "--n", 3, "--set", "on=top").output
    own = "the problem's own, n = 3: 9 cells"
    for words in (own, "quadratic, no convex terms", "none; no cones", "the default is Direct", "Clamp: u = 0 on top"):
        assert words in loose


@pytest.mark.long
def test_a_target_chooses_mesh_and_instants(tmp_path):
    done = invoke("run", PROBLEM, "--target", 0.1, "--n", 4, "--steps", 4, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["mesh"]["cells"] > 16
    assert "target 10.00% of the energy norm: met" in done.output
    assert told["estimated_energy_errors"]["total"] <= 0.1


def test_version_and_exit_codes_are_printed():
    assert invoke("--version").output == f"vemcvx {vx.__version__}\n"
    assert "0 done, 2 invalid input, 3 not certified" in invoke("--help").output


@pytest.mark.long
def test_a_run_and_help_import_no_heavy_packages():
    """Importing cvxpy takes 2 s. A run imports neither rich nor the modules of other commands."""
    code = f"""
import sys
import vemcvx.cli.problem_file
print("typer", sorted({{"typer", "rich"}} & set(sys.modules)))
from vemcvx.cli import app
try:
    app(["run", {PROBLEM!r}, "--n", "4", "--steps", "32"])
except SystemExit as end:
    assert not end.code
print("light", sorted({{"rich", "vemcvx.cli.compare", "vemcvx.cli.report", "vemcvx.cli.doctor"}} & set(sys.modules)))
try:
    app(["--help"])
except SystemExit:
    pass
print("heavy", sorted({{"cvxpy", "matplotlib", "meshio", "clarabel", "osqp"}} & set(sys.modules)))
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert [line for line in ran.stdout.splitlines() if line.endswith("]")] == ["typer []", "light []", "heavy []"]
    assert ran.stderr == ""


@pytest.mark.long
def test_a_long_run_without_a_terminal_prints_its_progress_in_lines(tmp_path):
    words = ["run", PROBLEM, "--n", "16", "--steps", "200", "--out", str(tmp_path / "out")]
    code = f"from vemcvx.cli import app, terminal; terminal.LINE_INTERVAL = 0.02; app({words!r})"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    lines = ran.stderr.splitlines()
    assert all(re.fullmatch(r"vemcvx: [a-z]+( \d+ of 20[01])?, \d+ s", line) for line in lines), lines
    assert any(re.match(r"vemcvx: marching \d+ of 200, \d+ s", line) for line in lines), lines


MINE = """
import dataclasses, vemcvx as vx

@dataclasses.dataclass(frozen=True)
class Mine(vx.LinearSolver):
    def factorise(self, K, near_kernel=None):
        return vx.SuperLU().factorise(K)

three = 3
"""


@pytest.mark.long
def test_a_linear_solver_is_loaded_from_a_file(tmp_path):
    mine = write_problem(tmp_path, MINE, "mine.py")
    run("--out", tmp_path / "out", "--linear", f"{mine}:Mine")
    assert vx.read_history(tmp_path / "out").trajectory.linear == "Mine()"
    for name, says in {"Other": "has no 'Other'; its linear solvers are Mine.", "three": "wanted a class"}.items():
        refused = invoke("run", PROBLEM, "--linear", f"{mine}:{name}")
        assert refused.exit_code == 2
        assert says in output_of(refused)


def test_a_mesh_larger_than_the_memory_is_refused_before_it_is_made(monkeypatch):
    monkeypatch.setattr(command, "machine_memory", lambda: 8e9)
    refused = invoke("run", "feng_han_huang", "--n", 5000)
    assert refused.exit_code == 2
    assert "--n 5000: this mesh needs at least 1e+02 GB of memory, and this machine has 8 GB" in output_of(refused)
