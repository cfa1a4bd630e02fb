"""`vemcvx compare`: every solver's answer against the most certain one, within what both certificates allow."""

from __future__ import annotations

import csv
import json
import re
import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small
from texts import page
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli.compare import Row, bounds_distance, distance, judge, warn_once
from vemcvx.scene import pose_scene
from vemcvx.solvers import list_installed

ROOT = Path(vx.__file__).parent.parent
PROBLEM = str(ROOT / "problems" / "feng_han_huang.py")
TIMES = np.linspace(0.0, 1.0, 7)
ONE_SIDED = """
import numpy as np, vemcvx as vx
def scene(coefficient=0.2):
    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.array([0.01 * t, -0.01]) + 0 * x, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom"),
    )
def mesh(n):
    return vx.meshes.squares(n)
def times(steps):
    return np.linspace(0, 1, steps + 1)
initial = "settled"
"""


BROKEN = """
import os, time
import numpy as np
import vemcvx as vx

class Sleeping:
    def solve(self, program, target):
        time.sleep(60)

class Dying:
    def solve(self, program, target):
        os._exit(3)

class Failing:
    def solve(self, program, target):
        raise KeyError("eq_dual")

class Leaving(vx.Newton):
    def prepare(self, operators):
        raise SystemExit(7)

class Full(vx.Newton):
    def prepare(self, operators):
        raise MemoryError


class Nan:
    def solve(self, program, target):
        return np.full(len(program.g), np.nan)


class Huge:
    def solve(self, program, target):
        return np.full(len(program.g), 1e200)


class Complaining:
    def solve(self, program, target):
        raise vx.SceneError("my own complaint; and more")
"""


def invoke(*arguments):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)], env={"COLUMNS": "200"})


def rows(output):
    """The table: (solver, settings) -> words of its line."""
    lines = [*output.splitlines(), ""]
    start = next(i for i, line in enumerate(lines) if line.split()[:1] == ["solver"])
    body = [line.split() for line in lines[start + 1 : lines.index("", start)]]
    return {(line[0], line[1]): line[2:] for line in body}


def words(output):
    """What happened to solvers, from the lines below the table: (solver, settings) -> words."""
    found = re.findall(r"^(\w+)(?: \((\w+)\))?: (refused|missed|failed|stopped): (.*)$", output, re.MULTILINE)
    return {(solver, settings or "own"): f"{end} {says}" for solver, settings, end, says in found}


@pytest.fixture(scope="module")
def attempts():
    """Newton, Clarabel and a poor Clarabel on a load that reverses."""
    solvers = (vx.Newton(), vx.Clarabel(), vx.Clarabel(options={"max_iter": 5}))
    scene, mesh = paper_scene(cyclic), small("voronoi")
    ran = [vx.simulate(scene, mesh, TIMES, solver=s, check=False) for s in solvers]
    made = [
        (Row(solver=s.name, settings="own", asked=s.accuracy), h.trajectory) for s, h in zip(solvers, ran, strict=True)
    ]
    return pose_scene(scene, mesh).system, made


@pytest.mark.long
def test_all_that_accept_the_program_agree():
    done = invoke(PROBLEM, "--n", 6, "--steps", 4)
    assert done.exit_code == 0, done.output
    told = rows(done.output)
    both = [(name, settings) for name in ("Clarabel", "OSQP") for settings in ("tuned", "default")]
    assert list(told) == [("Newton", "own"), *both, ("Direct", "own")]
    assert told["Direct", "own"][1:] == 7 * ["-"]
    assert words(done.output)["Direct", "own"].startswith("refused the program has absolute values, which it does not")
    for name, settings in both:
        asked, certified, good, apart, allowed, honest = told[name, settings][:6]
        assert float(asked) == 1e-6
        assert good == ("yes" if float(certified) <= 1e-6 else "no")
        if apart == "-":  # The most certain is compared with nobody: polished answers are as sharp as Newton's.
            continue
        assert 0 < float(apart) <= float(allowed) <= 2 * 4 * float(certified)
        assert honest == "yes"
        assert good == "yes" or settings == "default"
    assert sum(line[3] == "-" for line in told.values()) == 2
    assert "the most certain" in done.output
    assert "36 cells, 49 nodes, 78 unknowns, 4 steps" in done.output


@pytest.mark.long
def test_a_miss_stands_in_the_table_and_is_no_failure_of_the_others():
    options = ["--accuracy", "1e-12", "--solvers", "newton,clarabel,Mosek"]
    done = invoke(PROBLEM, "--n", 4, "--steps", 3, *options)
    assert done.exit_code == 0, done.output
    says = r"Clarabel \(tuned\): missed: misses its accuracy in \d of 3 steps, first in step \d"
    assert re.search(says, done.output)
    assert words(done.output)["MOSEK", "default"].startswith("refused cvxpy does not find it here")
    assert rows(done.output)["Clarabel", "tuned"][2] == "no"
    assert rows(done.output)["Clarabel", "tuned"][5] == "yes"


@pytest.mark.long
@pytest.mark.parametrize(("solvers", "accuracy"), [("newton,osqp", "1e-17"), ("direct", "1e-6")])
def test_nobody_certified_exits_with_three(solvers, accuracy):
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, "--accuracy", accuracy, "--solvers", solvers)
    assert done.exit_code == 3
    assert "Traceback" not in done.output


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--solvers", "newton,simplex"], "--solvers: there is no solver 'simplex'; there are newton, clarabel"),
        (["--solvers", " , "], "--solvers: found ' , '; wanted names such as newton,clarabel,SCS, or all."),
        (["--set", "bond=3"], "--set: .* has no parameter 'bond'"),
        (["--accuracy", "2"], "found accuracy = 2.0; it is a relative energy error between 0 and 1"),
        (["--option", "clarabel=3"], r"--option: found 'clarabel=3'; wanted SOLVER\.NAME=VALUE, such as clarabel\.max"),
        (["--option", "scs.max_iters=3"], "--option: 'scs' is none of the chosen solvers, newton, clarabel, osqp"),
        (["--option", "newton.speed=3"], "--option: newton has no setting 'speed'; it has accuracy, max_iterations"),
        (["--option", "newton.max_iterations=many"], "Newton: found max_iterations = 'many'"),
        (["--time-limit", "0"], "--time-limit: found 0; wanted seconds, more than zero"),
        (["--csv", "nowhere/a.csv"], "--csv: nowhere/a.csv cannot be written: its folder must exist"),
        pytest.param(
            ["--solvers", "newton", "--json", "/dev/full"],
            "--json: /dev/full cannot be written: No space left on device",
            marks=pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no full disk to write to"),
        ),
    ],
)
def test_mistakes(options, says):
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, *options)
    assert done.exit_code == 2, done.output
    assert re.search(says, " ".join(done.output.split()))


@pytest.mark.long
def test_all_asks_whatever_cvxpy_finds():
    """No solver that is installed is left out, and what becomes of each is a row."""
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, "--solvers", "all")
    told = {name.lower() for name, _ in [*rows(done.output), *words(done.output)]}
    assert told == {"newton", "direct"} | {name.lower() for name in list_installed()}
    # cvxpy's interface to SciPy knows linear programs only.
    assert words(done.output)["SCIPY", "default"].startswith("refused the program has quadratic, which it does not")
    assert "Traceback" not in done.output


@pytest.mark.long
def test_options_reach_solvers_and_are_told():
    options = [
        "--option",
        "clarabel.max_iter=5",
        "--option",
        "Newton.max_iterations=40",
        "--solvers",
        "newton,CLARABEL",
    ]
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, *options)
    # A step that missed is asked again, and once more where that was better.
    assert 2 * 5 <= int(rows(done.output)["Clarabel", "default"][6]) <= 3 * 5
    assert "max_iter = 5 (by --option)" in done.output
    refused = invoke(PROBLEM, "--n", 4, "--steps", 2, "--option", "clarabel.speed=9", "--solvers", "newton,clarabel")
    assert re.search(r"Clarabel \(tuned\): refused: refused the options \{'speed': 9\}", refused.output)
    assert rows(refused.output)["Newton", "own"][2] == "yes"


@pytest.fixture
def broken(tmp_path):
    (tmp_path / "broken.py").write_text(BROKEN)
    return tmp_path / "broken.py"


@pytest.mark.long
def test_whatever_breaks_down_is_a_row(broken):
    names = ["Failing", "Leaving", "Full"]
    done = invoke(PROBLEM, "--n", 3, "--steps", 1, "--solvers", ",".join(["newton", *(f"{broken}:{x}" for x in names)]))
    assert done.exit_code == 0, done.output
    told = words(done.output)
    assert told["Failing", "own"] == "failed it failed: KeyError: 'eq_dual'"
    assert told["Leaving", "own"] == "failed it failed: SystemExit: 7"
    assert told["Full", "own"] == "failed it ran out of memory"
    assert rows(done.output)["Newton", "own"][2] == "yes"


@pytest.mark.long
def test_answers_that_are_none_are_rows_and_make_no_liars(broken):
    """NaN was the most certain answer, to which Newton was wrong; 1e200 and errors of this package ended the table."""
    names = ["Nan", "Huge", "Complaining"]
    for order in (["newton", *(f"{broken}:{x}" for x in names)], [*(f"{broken}:{x}" for x in names), "newton"]):
        done = invoke(PROBLEM, "--n", 3, "--steps", 2, "--solvers", ",".join(order))
        assert done.exit_code == 0, done.output
        assert "WRONG" not in done.output
        told = words(done.output)
        assert told["Complaining", "own"] == "failed my own complaint; and more"
        assert told["Huge", "own"] == "failed d reaches 1.0e+200: the solver has diverged"
        assert told["Nan", "own"].startswith("missed misses its accuracy")
        assert rows(done.output)["Newton", "own"][2] == "yes"


@pytest.mark.long
def test_an_error_of_the_problem_is_told_once(tmp_path):
    """Its first state contradicts its supports, whoever is asked; a solver that takes no such program is not."""
    (tmp_path / "jump.py").write_text(ONE_SIDED.replace('initial = "settled"', ""))
    done = invoke(tmp_path / "jump.py", "--n", 2, "--steps", 1, "--solvers", "newton,direct,clarabel")
    assert done.exit_code == 2, done.output
    assert " ".join(done.output.split()).count("contradicts its supports at t = 0, by 0.01") == 1


@pytest.mark.slow
def test_a_time_limit_ends_a_solver_and_its_process(broken):
    """The sleeper would take a minute; the others are done in the limit, the most certain among them."""
    solvers = f"newton,{broken}:Sleeping,{broken}:Dying,clarabel"
    done = invoke(PROBLEM, "--n", 3, "--steps", 1, "--time-limit", "20", "--solvers", solvers)
    assert done.exit_code == 0, done.output
    assert {key: told for key, told in words(done.output).items() if key[1] == "own"} == {
        ("Sleeping", "own"): "stopped stopped after 20 s",
        ("Dying", "own"): "failed its process ended: ended with exit code 3",
    }
    answered = [key for key, line in rows(done.output).items() if line[1] != "-"]
    assert answered == [("Newton", "own"), ("Clarabel", "tuned"), ("Clarabel", "default")]


PROBLEMS = sorted(path for path in (ROOT / "problems").glob("*.py") if "\ndef times(" in path.read_text())


def test_warnings_are_told_once_where_all_solvers_fail():
    """What was wrong with the problem may be in them."""

    def fail():
        for _ in range(2):
            warnings.warn("held on one side", vx.SceneWarning, stacklevel=1)
        raise vx.SceneError("no solver answers")

    told = pytest.warns(vx.SceneWarning, match="held on one side")
    with told as warned, pytest.raises(vx.SceneError, match="no solver answers"), warn_once():
        fail()
    assert len(warned) == 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_whatever_is_installed_makes_rows_of_every_problem(path, tmp_path):
    """No traceback, no dishonest certificate, a row for each solver; what may take hours is given seconds."""
    own = import_module(path.stem)
    in_space = own.mesh(2).points.shape[1] == 3
    limit = ["--time-limit", "15"] if in_space or "SCIP" in list_installed() else []
    # As accurate as the problem's rounding allows, where it says that this is less than 1e-8.
    accuracy = getattr(own, "SMALL", {}).get("accuracy", 1e-8)
    asked = ["--steps", 2, "--accuracy", accuracy, "--json", tmp_path / "told.json", *limit]
    done = invoke(path, "--n", 2 if in_space else 4, "--solvers", "all", *asked)
    assert done.exit_code in (0, 3), done.output
    assert "Traceback" not in done.output
    told = json.loads((tmp_path / "told.json").read_text())["rows"]
    assert {row["solver"].lower() for row in told} == {"newton", "direct"} | {name.lower() for name in list_installed()}
    assert all(row["honest"] is not False for row in told)
    assert all(row["certified"] is not None or row["message"] for row in told)
    assert all(row["good"] for row in told if row["solver"] == "Newton")


@pytest.mark.long
def test_files(tmp_path):
    paths = {kind: tmp_path / f"told.{kind}" for kind in ("json", "csv")}
    written = [part for kind, path in paths.items() for part in (f"--{kind}", path)]
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, "--solvers", "newton,clarabel,direct", *written)
    assert done.exit_code == 0, done.output
    told = json.loads(paths["json"].read_text())
    names = [("Newton", "own"), ("Clarabel", "tuned"), ("Clarabel", "default"), ("Direct", "own")]
    assert [(row["solver"], row["settings"]) for row in told["rows"]] == names
    assert [row["outcome"] for row in told["rows"]][::3] == ["certified", "refused"]
    assert told["trustworthy"] is True
    assert "max_threads = 1" in told["rows"][1]["options"]
    assert "static_regularization_constant = 1e-13 if K is only semidefinite" in told["rows"][1]["options"]
    with paths["csv"].open(newline="") as file:
        for line, row in zip(csv.DictReader(file), told["rows"], strict=True):
            assert line == {key: "" if value is None else str(value) for key, value in row.items()}


@pytest.mark.long
def test_where_the_sum_bounds_nothing_it_says_so(tmp_path):
    (tmp_path / "pressed.py").write_text(ONE_SIDED)
    done = invoke(tmp_path / "pressed.py", "--n", 4, "--steps", 2, "--solvers", "newton,clarabel")
    assert done.exit_code == 0, done.output
    assert rows(done.output)["Clarabel", "tuned"][5] == "-"
    assert "no bound here: friction depends on pressure or slip" in done.output


def test_what_bounds_a_distance():
    K, load, one = np.eye(2), lambda t: np.ones(2), np.eye(2)[:1]
    norms, limits, damping = vx.Norms(one, [1.0]), vx.Limits(one, [1.0]), vx.Damping(np.eye(2))
    law = vx.Norms(one, [1.0], law=vx.Law(lambda t, p, past, slip: p))
    for given, bounds in (
        ({}, True),
        ({"norms": norms}, True),
        ({"norms": norms, "damping": damping}, True),
        ({"limits": limits}, True),
        ({"limits": limits, "norms": norms}, False),
        ({"limits": limits, "damping": damping}, False),
        ({"limits": limits, "norms": law}, False),
    ):
        assert bounds_distance(vx.System(K, load, **given)) is bounds, given


@pytest.mark.long
def test_distances_are_those_of_the_energy_norm(attempts):
    system, (newton, clarabel, poor) = (attempts[0], [run for _, run in attempts[1]])
    apart = (newton.state - poor.state) @ np.linalg.cholesky(system.K.toarray())
    scale = np.maximum.accumulate(newton.norm)
    relative = np.linalg.norm(apart, axis=1)[1:] / scale[1:]
    found, _, kept = distance(system, newton, poor)
    assert found == pytest.approx(relative.max(), rel=1e-9)
    assert kept
    assert distance(system, newton, clarabel)[0] < 1e-3 * found


def test_a_false_certificate_is_called_wrong(attempts):
    """An answer whose certificate claims a thousandth of its error: the table says so, and the command fails."""
    system, (newton, clarabel, poor) = attempts
    assert judge(system, [newton, clarabel, poor]).trustworthy
    apart, allowed, _ = distance(system, newton[1], poor[1])
    lie = 0.01 * (apart / allowed) ** 2 * poor[1].gap
    liar = replace(poor[0], settings="tuned"), replace(poor[1], gap=lie)
    found = judge(system, [newton, liar])
    assert not found.trustworthy
    assert [row.honest for row in found.rows] == [None, False]
    assert list(found.remarks)[-1] == "WRONG: Clarabel (tuned) is farther from Newton than both certificates allow"


@pytest.mark.long
def test_the_page_of_solvers_shows_this_table():
    text = page("solvers")
    command, block = re.search(r"`vemcvx (compare [^`]*)`[^`]*```text\n(.*?)```", text, re.DOTALL).groups()
    arguments = command.split()[1:]
    done = CliRunner().invoke(app, ["compare", str(ROOT / arguments[0]), *arguments[1:]], env={"COLUMNS": "80"})
    assert done.exit_code == 0, done.output
    # The title, the size, and both lines of the head.
    assert done.stdout.splitlines()[:5] == block.splitlines()[:5]
    shown, found = rows(block), rows(done.output)
    assert set(found) >= set(shown)
    for key, line in shown.items():
        if key[0] not in ("Newton", "HIGHS") and line[1] != "-":
            # Certified errors are of the size that is printed, unless both are of rounding.
            one, two = float(found[key][1]), float(line[1])
            assert max(one, two) < 1e-10 or 0.05 < one / two < 20
