"""The command line: what it prints, what it writes, how it fails, and that it stays light."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
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


def written(tmp_path, text, name="problem.py"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.long
def test_run_writes_what_it_says(tmp_path):
    done = invoke("run", PROBLEM, "--n", 8, "--steps", 8, "--store", 4, "--out", tmp_path / "out", "--plot")
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["problem"] == "feng_han_huang"
    assert (told["mesh"]["family"], told["mesh"]["n"], told["steps"]) == ("squares", 8, 8)
    # Pinned: Newton's answer, which Clarabel's at 1e-6 shares in 12 digits.
    assert told["energy"] == pytest.approx(0.051934851760595, rel=1e-12)
    assert told["dissipated"] == pytest.approx(0.008598564142584, rel=1e-12)
    history = vx.read_history(tmp_path / "out")
    assert history.stored.tolist() == [0, 4, 8]
    assert history.summary() in done.output
    for one in history.extremes:
        unit, at = in_units(one.unit, feng_han_huang.UNITS), rf"at \(.*\), t = {one.time:.6g} s$"
        assert re.search(rf"^{one.name} +{one.value:.6g} {unit} +{at}", done.output, re.M)
    bodies, along = ["deformed_mesh.png", "stressed_body.png"], ["contact_pressure.png", "contact_slip.png", "wear.png"]
    pictures = [
        *bodies,
        *along,
        "energy_ledger.png",
        "friction_traction.png",
        "hysteresis_loop.png",
        "forces_over_time.png",
        "stick_slip_map.png",
    ]
    files = [
        "contact.csv",
        "history.npz",
        "history.pvd",
        "step_0000.vtu",
        "step_0004.vtu",
        "step_0008.vtu",
        "steps.csv",
        "summary.json",
    ]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(pictures + files)
    told = "history.pvd with 3 instants, summary.json, history.npz, contact.csv, steps.csv"
    assert f"files       {tmp_path / 'out'}: {told}" in done.output
    assert f"pictures    {tmp_path / 'out'}: deformed_mesh.png" in done.output


@pytest.mark.long
def test_probes_are_written(tmp_path):
    done = invoke("run", PROBLEM, "--n", 4, "--steps", 2, "--out", tmp_path, "--probe", "0,0", "--probe", "0.3,0.4")
    assert done.exit_code == 0, done.output
    assert "contact.csv, probes.csv, steps.csv" in done.output
    lines = (tmp_path / "probes.csv").read_text().splitlines()
    assert lines[0] == "step,time,point,x,y,displacement_x,displacement_y"
    found = np.array([[float(word) for word in line.split(",")] for line in lines[1:]])
    assert found[:, 3:5].tolist() == 3 * [[0.0, 0.0], [0.3, 0.4]]
    probed = vx.read_history(tmp_path).probe([[0.0, 0.0], [0.3, 0.4]])
    assert np.array_equal(found[:, 5:], probed.reshape(-1, 2))
    outside = invoke("run", PROBLEM, "--n", 4, "--steps", 2, "--out", tmp_path, "--probe", "2,0")
    assert outside.exit_code == 2
    assert "--probe: point 0 at [2. 0.] lies outside the body" in outside.output


@pytest.mark.long
def test_settings_reach_the_scene(tmp_path):
    frozen = invoke("run", PROBLEM, "--n", 4, "--steps", 2, "--set", "bound=1e6", "--out", tmp_path)
    assert frozen.exit_code == 0
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["dissipated"] == 0.0
    assert "TrescaFriction: |friction| <= 1000000.0 on bottom" in told["effects"]
    moved = written(tmp_path, MINIMAL)
    assert "Clamp: u = 0 on top" in invoke("show", moved, "--n", 2, "--set", "on=top").output


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "says"),
    [("Newton", "Newton("), ("clarabel", "Clarabel("), ("osqp", "OSQP("), ("SCS", "ThroughCvxpy(solver='SCS'")],
)
def test_solvers_by_name(solver, says):
    accuracy = "1e-3" if solver == "SCS" else "1e-5"
    done = invoke("run", PROBLEM, "--n", 3, "--steps", 2, "--solver", solver, "--accuracy", accuracy)
    assert done.exit_code == 0, done.output
    assert f"solver      {says}" in done.output
    assert f"accuracy={float(accuracy)}" in done.output


@pytest.mark.long
def test_mesh_store_and_condensation_by_name(tmp_path):
    options = ("--n", 3, "--steps", 4, "--mesh", "voronoi", "--store", "last", "--no-condense", "--out", tmp_path)
    done = invoke("run", PROBLEM, *options)
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "summary.json").read_text())["mesh"]["family"] == "voronoi"
    assert vx.read_history(tmp_path).stored.tolist() == [4]


@pytest.mark.long
def test_a_mesh_file_in_place_of_a_family(tmp_path):
    path = tmp_path / "part.vtu"
    vx.meshes.voronoi(3).write(path)
    done = invoke("run", PROBLEM, "--steps", 2, "--mesh", path, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "out" / "summary.json").read_text())["mesh"]
    assert (found["family"], found["n"], found["cells"]) == (str(path), None, 9)
    assert "9 cells" in " ".join(invoke("show", PROBLEM, "--mesh", path).output.split())
    missing = invoke("run", PROBLEM, "--mesh", tmp_path / "gone.vtu")
    assert missing.exit_code == 2
    assert "gone.vtu" in missing.output


@pytest.mark.long
def test_pictures_alone_go_where_results_go(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = invoke("run", written(tmp_path, MINIMAL, "loose.py"), "--n", 2, "--steps", 1, "--plot")
    assert done.exit_code == 0, done.output
    folder = tmp_path / "results" / "loose"
    assert sorted(path.name for path in folder.iterdir()) == [
        "deformed_mesh.png",
        "energy_ledger.png",
        "forces_over_time.png",
        "stressed_body.png",
    ]


@pytest.mark.long
def test_a_miss_exits_with_three(tmp_path):
    missed = invoke("run", PROBLEM, "--n", 4, "--steps", 2, "--accuracy", "1e-17", "--out", tmp_path / "out")
    assert missed.exit_code == 3
    assert "step 1 at t = 0.5: Newton reached a certified relative energy error" in missed.output
    assert "Traceback" not in missed.output
    # The steps that were completed stay, for --resume; a history there is none.
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["rows"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--mesh", "penrose"],
            "--mesh: there is no family 'penrose'; there are squares, triangles, hexagons, voronoi",
        ),
        (
            ["--solver", "Guroby"],
            "--solver: there is no solver 'Guroby'; there are newton, clarabel, osqp, direct, those that cvxpy finds",
        ),
        (["--solver", "Gurobi"], "solver 'GUROBI': cvxpy does not find it here; it finds .*CLARABEL"),
        (["--solver", "direct"], "Direct: the program has absolute values.*accept the program: Newton, OSQP, Clarabel"),
        (["--set", "gravity=9.81"], "has no parameter 'gravity'; its scene has young=200.0, poisson=0.3, bound=4.0"),
        (["--set", "young"], "--set: found 'young'; wanted name=value, such as young=1"),
        (["--set", "poisson=0.5"], r"Elasticity: found poisson = 0\.5 in cell 0"),
        (["--set", "young=stiff"], "Elasticity: young"),
        (["--store", "some"], "store: found 'some'; there are 'all', 'last', an integer"),
        (["--accuracy", "2"], "accuracy = 2.0; it is a relative energy error between 0 and 1"),
        (["--n", "0"], "Invalid value for '--n'"),
        (["--steps", "many"], "Invalid value for '--steps'"),
        (["--results", "slip"], "--results: found a single run"),
        (["--probe", "0,0"], "--probe: displacements of points are written to DIR"),
        (["--probe", "here", "--out", "o"], "--probe: found 'here'; wanted points, such as 0.5,0.25"),
        (["--probe", "0,0", "--probe", "2", "--out", "o"], "--probe: found '0,0', '2'; wanted points"),
        (["--out", PROBLEM], "cannot be used as a folder"),
    ],
)
def test_invalid_options_exit_with_two(options, says):
    refused = invoke("run", PROBLEM, "--n", 4, "--steps", 2, *options)
    assert refused.exit_code == 2, refused.output
    assert "Traceback" not in refused.output
    # Usage errors come in a frame, broken into lines.
    flat = " ".join(refused.output.replace("│", " ").split())
    assert re.search(says, flat), flat


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "import nowhere",
            "line 1: executing it failed: ModuleNotFoundError: No module named 'nowhere'; modules that a file imports "
            "must be installed, or be in the folder of the file",
        ),
        ("def scene(:", "executing it failed: SyntaxError: invalid syntax"),
        (
            "def scene(): ...",
            'does not define mesh(n, family="squares") nor times(steps); a problem file defines scene(',
        ),
        (MINIMAL + "scene = None", "does not define scene(**parameters);"),
        (MINIMAL + "def scene(): return 3", "scene(...) returned 3; wanted a vemcvx.Scene"),
        (MINIMAL + "def mesh(n): return [n]", "mesh(...) returned [2]; wanted a vemcvx.PolygonMesh"),
        (MINIMAL + "def mesh(n):\n    return 1 / 0", "line 10: mesh(2) failed: ZeroDivisionError: division by zero"),
        (
            MINIMAL + "def mesh(n):\n    return {4: 1}[n]",
            "line 10: mesh(2) failed: KeyError: 2. The function mesh of the problem file must return a mesh for "
            "every number n of cells across the shortest side.",
        ),
        ("import sys; sys.exit(3)", "line 1: executing it failed: SystemExit: 3"),
        (MINIMAL + "def mesh(n):\n    exit('enough')", "line 10: mesh(2) failed: SystemExit: enough"),
        (MINIMAL.replace("t + 0 * x", "exit(4)"), "its function failed when called as f(x, t)"),
        (MINIMAL + "def mesh(n): return [0] * 2**60", "mesh(2) failed: MemoryError"),
        (MINIMAL + "def times(n): return [0, 0]", "times: instant 1 is 0, which does not come after instant 0"),
    ],
)
def test_invalid_problem_files_exit_with_two(tmp_path, text, says):
    refused = invoke("run", written(tmp_path, text), "--n", 2)
    assert refused.exit_code == 2, refused.output
    named = (str(tmp_path / "problem.py"), "times:", "BodyForce")
    assert any(words in refused.output for words in named)
    assert says in refused.output


def test_problem_files_that_are_not_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    empty = invoke("show", "problem.py")
    assert empty.exit_code == 2
    assert "problem.py: there is no such problem file; found here: no Python files." in empty.output
    (tmp_path / "problems").mkdir()
    written(tmp_path / "problems", MINIMAL, "slope.py")
    assert f"found here: {Path('problems') / 'slope.py'}." in invoke("run", "problem.py").output
    assert "The package has this problem: run feng_han_huang." in invoke("run", "x/feng_han_huang.py").output
    foreign = invoke("run", written(tmp_path, "{}", "scene.json"))
    assert foreign.exit_code == 2
    assert "scene.json: a problem file is a Python file, whose name ends in .py" in foreign.output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("show", "p" * 300), "there is no such problem file"),
        (("run", PROBLEM, "--resume", "r" * 300), "holds no interrupted run"),
        (("run", PROBLEM, "--out", "o" * 300), "cannot be used as a folder"),
        (("cost", PROBLEM, "--out", "o" * 300), "cannot be used as a folder"),
        (("run", PROBLEM, "--store", "9" * 30, "--n", "2", "--steps", "2"), ""),
        (("run", PROBLEM, "--set", "bound=" + "(" * 5000), "bound: found"),
    ],
    ids=lambda words: " ".join(words)[:20],
)
def test_names_of_300_characters_and_the_like(tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    done = invoke(*arguments)
    assert done.exit_code == (2 if says else 0), done.output
    assert says in " ".join(done.output.split())


def test_too_little_memory_is_said(monkeypatch):
    def hungry(*_, **__):
        raise MemoryError("Unable to allocate 7 EiB")

    monkeypatch.setattr("vemcvx.cli.problem_file.simulate", hungry)
    refused = invoke("run", PROBLEM)
    assert refused.exit_code == 2
    assert "not enough memory: Unable to allocate 7 EiB; take a coarser mesh" in refused.output


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are a matter of Unix")
@pytest.mark.parametrize("name", ["SIGTERM", pytest.param("SIGHUP", marks=pytest.mark.slow)])
def test_a_command_that_is_ended_shows_the_cursor_again(tmp_path, name):
    import pty

    main, side = pty.openpty()
    code = f"""
import os, signal
from vemcvx.cli import app
from vemcvx.cli import problem_file
def simulate(*_, progress, **__):
    progress(1, 9)
    os.kill(os.getpid(), signal.{name})
    progress(2, 9)
problem_file.simulate = simulate
app(['run', {PROBLEM!r}, '--n', '2', '--out', {str(tmp_path)!r}])
"""
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    ended = subprocess.run([sys.executable, "-c", code], stderr=side, env=environment, check=False)
    os.close(side)
    said = b""
    with contextlib.suppress(OSError):
        while piece := os.read(main, 4096):
            said += piece
    os.close(main)
    assert ended.returncode == 128 + getattr(signal, name)
    assert b"Traceback" not in said
    assert said.rfind(b"\x1b[?25h") > said.rfind(b"\x1b[?25l") > -1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_warnings_are_a_line(tmp_path):
    text = MINIMAL.replace("vx.meshes.squares(n)", "vx.meshes.triangles(n)").replace("0.3", "0.4999")
    done = invoke("run", written(tmp_path, text), "--n", 2, "--steps", 1)
    assert done.exit_code == 0, done.output
    assert "vemcvx: warning: Elasticity: poisson = 0.4999 on a mesh of triangles" in done.output
    assert "vemcvx/" not in done.output


def test_show_says_the_scene_in_words(tmp_path):
    shown = invoke("show", PROBLEM, "--n", 8)
    assert "Elasticity: E = 200.0, nu = 0.3, plane strain, shear stabilisation" in " ".join(shown.output.split())
    assert shown.exit_code == 0
    rows = {line[:14].strip(): line[14:].strip() for line in shown.output.splitlines() if line[:14].strip()}
    assert rows["unknowns"] == "136 in all, 8 after condensation"
    assert rows["terms"] == "8 absolute values"
    unused = rows["not simulated"].split(", ")
    assert unused == sorted(unused)
    assert {"BodyForce", "CoulombFriction"} <= set(unused)
    assert "left out" not in rows
    assert rows["solvers"] == "Newton, OSQP, Clarabel; the default is Newton"
    assert rows["not accepting"] == "Direct (no absolute values)"
    assert rows["mesh"] == "squares, n = 8: 64 cells, 81 nodes, h = 0.1768"
    assert rows["shapes"] == "star 0.35 to 0.35, edge 0.71 to 0.71 (good above 0.05 and 0.0001)"
    assert rows["linear solve"].startswith("SuperLU on 136 x 136 with ")
    for effect in (
        "Clamp: u = 0 on right",
        "Traction: pull(x, t) on left",
        "TrescaFriction: |friction| <= 4.0 on bottom",
    ):
        assert effect in shown.output
    loose = invoke("show", written(tmp_path, MINIMAL), "--n", 3).output
    assert "quadratic, no convex terms" in loose
    assert "none; no cones" in loose
    assert "Direct, Newton, OSQP, Clarabel; the default is Direct" in loose
    assert "Direct (no" not in loose
    assert "mesh           the problem's own, n = 3: 9 cells" in loose


def test_resuming_needs_something_to_resume(tmp_path):
    nothing = invoke("run", PROBLEM, "--resume", tmp_path / "typo")
    assert nothing.exit_code == 2
    assert "typo holds no interrupted run; begin one with --out" in nothing.output.replace("\n", " ")
    both = invoke("run", PROBLEM, "--resume", tmp_path, "--out", tmp_path)
    assert "--resume: a run continues in the folder that holds it" in both.output


@pytest.mark.long
def test_a_target_chooses_mesh_and_instants(tmp_path):
    done = invoke("run", PROBLEM, "--target", 0.1, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert "target 10.00% of the energy norm: met" in done.output
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["estimated_energy_errors"]["total"] <= 0.1
    assert told["mesh"]["cells"] > 64
    wrong = invoke("run", PROBLEM, "--target", 0.1, "--store", "last")
    assert wrong.exit_code == 2
    assert "--target: adaptive runs take neither --resume" in wrong.output
    assert invoke("run", PROBLEM, "--target", 3).exit_code == 2


@pytest.mark.long
def test_a_target_may_be_of_friction_work(tmp_path):
    done = invoke("run", PROBLEM, "--target", 0.1, "--of", "dissipated", "--n", 4, "--steps", 4, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert "target 10.00% of the energy that friction dissipates: met" in done.output
    told = json.loads((tmp_path / "summary.json").read_text())["quantities"]["dissipated"]
    assert 0 < told["error"] <= 0.1 * told["value"]
    assert re.search(rf"dissipated +{told['value']:.6g}, estimated error {told['error']:.2g}", done.output)
    assert "--of: found quantity 'stress'; there are 'energy', 'dissipated', 'work' and 'wear'" in invoke(
        "run", PROBLEM, "--target", 0.1, "--of", "stress"
    ).output.replace("\n", " ")
    assert "--of: work needs --target X" in invoke("run", PROBLEM, "--of", "work").output.replace("\n", " ")


def test_version_and_help():
    assert invoke("--version").output == f"vemcvx {vx.__version__}\n"
    said = invoke("--help").output
    for word in ("run", "show", "0 done, 2 invalid input, 3 not certified"):
        assert word in said


@pytest.mark.long
def test_help_and_newton_are_light():
    """Neither needs cvxpy (2 s), matplotlib or meshio; the modules of commands need no rich, and a run only its own."""
    code = f"""
import sys
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
    told = dict(line.split(" ", 1) for line in ran.stdout.splitlines() if line.startswith(("heavy", "light")))
    assert told == {"heavy": "[]", "light": "[]"}
    assert ran.stderr == ""


@pytest.mark.long
def test_only_the_command_line_itself_imports_typer():
    code = "import sys, vemcvx, vemcvx.cli.problem_file; print(sorted({'typer', 'rich'} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "[]\n"


@pytest.mark.long
def test_without_a_terminal_long_runs_say_a_line_at_times(tmp_path):
    words = ["run", PROBLEM, "--n", "16", "--steps", "200", "--out", str(tmp_path / "out")]
    code = f"from vemcvx.cli import app, terminal; terminal.LINE_INTERVAL = 0.02; app({words!r})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    lines = run.stderr.splitlines()
    assert all(re.fullmatch(r"vemcvx: [a-z]+( \d+ of 20[01])?, \d+ s(, \d+ s left)?", line) for line in lines), lines
    assert any(re.match(r"vemcvx: marching \d+ of 200, \d+ s, \d+ s left", line) for line in lines), lines
    assert any(line.startswith("vemcvx: writing ") for line in lines), lines
    assert re.search(r"seconds +assemble .*, write \S+$", run.stdout, re.MULTILINE)


MINE = """
import dataclasses, vemcvx as vx

@dataclasses.dataclass(frozen=True)
class Mine(vx.LinearSolver):
    def factorise(self, K, near_kernel=None):
        return vx.SuperLU().factorise(K)

three = 3
"""


@pytest.mark.long
def test_a_linear_solver_can_be_in_a_file(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)

    def run(linear):
        return invoke("run", PROBLEM, "--n", 4, "--steps", 2, "--out", tmp_path / "out", "--linear", linear)

    done = run(f"{tmp_path / 'mine.py'}:Mine")
    assert done.exit_code == 0, done.output
    assert vx.read_history(tmp_path / "out").trajectory.linear == "Mine()"
    wrong = {"Other": "has no 'Other'; its linear solvers are Mine.", "three": "wanted a class with the base"}
    for name, words in wrong.items():
        refused = run(f"{tmp_path / 'mine.py'}:{name}")
        assert refused.exit_code == 2
        assert words in " ".join(refused.output.split())


def test_meshes_beyond_the_memory_are_refused_before_they_are_made(monkeypatch):
    made, mesh = [], command.Problem.mesh
    monkeypatch.setattr(command.Problem, "mesh", lambda self, n, family=None: made.append(n) or mesh(self, n, family))
    monkeypatch.setattr(command, "machine_memory", lambda: 8e9)
    refused = invoke("run", "feng_han_huang", "--n", 5000)
    assert refused.exit_code == 2
    said = " ".join(refused.output.split())
    assert re.search(
        r"--n 5000: about [\d.]+e\+07 unknowns need at least \d+ GB of memory, and this machine has 8 GB", said
    )
    assert "--target 0.02, which refines only where the error is large" in said
    assert max(made) == 16
    # A mesh that does not grow with n is none to refuse.
    problem = SimpleNamespace(mesh=lambda n, family: vx.meshes.squares(12))
    command.check_memory(problem, 5000, None, 65)


def test_the_machine_has_memory(monkeypatch):
    assert 1e8 < command.machine_memory() < 1e15
    monkeypatch.setattr(Path, "read_text", lambda self: "123456789\n")
    assert command.machine_memory() == 123456789.0
