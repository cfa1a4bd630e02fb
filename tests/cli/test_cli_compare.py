"""`vemcvx compare`: certificates bound the distances of solutions, and failed solvers have rows."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small
from texts import ROOT, page
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli.compare import Row, bounds_distance, distance, judge
from vemcvx.scene import pose_scene
from vemcvx.solvers import list_installed

PROBLEM = str(ROOT / "problems" / "feng_han_huang.py")
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
import numpy as np
import vemcvx as vx

class Failing:
    def solve(self, program, target):
        raise KeyError("eq_dual")

class Full(vx.Newton):
    def prepare(self, operators):
        raise MemoryError

class Nan:
    def solve(self, program, target):
        return np.full(len(program.g), np.nan)

class Huge:
    def solve(self, program, target):
        return np.full(len(program.g), 1e200)
"""


def invoke(*arguments):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)], env={"COLUMNS": "200"})


def compare(*options):
    """Compare solvers on PROBLEM with a small mesh; return the output."""
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, *options)
    assert done.exit_code == 0, done.output
    return done.output


def read_rows(output):
    """Return (solver, settings) -> words of the line in the table."""
    lines = [*output.splitlines(), ""]
    start = next(i for i, line in enumerate(lines) if line.split()[:1] == ["solver"])
    body = [line.split() for line in lines[start + 1 : lines.index("", start)]]
    return {(line[0], line[1]): line[2:] for line in body}


def read_outcomes(output):
    """Return (solver, settings) -> outcome below the table."""
    found = re.findall(r"^(\w+)(?: \((\w+)\))?: (refused|missed|failed): (.*)$", output, re.MULTILINE)
    return {(solver, settings or "own"): f"{end} {says}" for solver, settings, end, says in found}


@pytest.fixture(scope="module")
def attempts():
    """Runs by Newton, Clarabel, and Clarabel with few iterations, under a load that reverses."""
    solvers = (vx.Newton(), vx.Clarabel(), vx.Clarabel(options={"max_iter": 5}))
    scene, mesh, times = paper_scene(cyclic), small("voronoi"), np.linspace(0.0, 1.0, 7)
    ran = [vx.simulate(scene, mesh, times, solver=s, check=False) for s in solvers]
    made = [
        (Row(solver=s.name, settings="own", asked=s.accuracy), h.trajectory) for s, h in zip(solvers, ran, strict=True)
    ]
    return pose_scene(scene, mesh).system, made


@pytest.mark.long
def test_all_solvers_that_accept_the_program_agree():
    done = invoke(PROBLEM, "--n", 6, "--steps", 4)
    assert done.exit_code == 0, done.output
    told = read_rows(done.output)
    both = [(name, settings) for name in ("Clarabel", "OSQP") for settings in ("tuned", "default")]
    assert list(told) == [("Newton", "own"), *both, ("Direct", "own")]
    assert told["Direct", "own"][1:] == 7 * ["-"]
    assert read_outcomes(done.output)["Direct", "own"].startswith("refused the program has absolute values")
    for name, settings in both:
        asked, certified, good, apart, allowed, honest = told[name, settings][:6]
        assert float(asked) == 1e-6
        assert good == ("yes" if float(certified) <= 1e-6 else "no")
        if apart == "-":  # This solution is the reference.
            continue
        assert 0 < float(apart) <= float(allowed) <= 2 * 4 * float(certified)
        assert honest == "yes"
        assert good == "yes" or settings == "default"
    assert sum(line[3] == "-" for line in told.values()) == 2
    assert "36 cells, 49 nodes, 78 unknowns, 4 steps" in done.output


@pytest.mark.long
def test_solvers_that_miss_the_accuracy_or_are_not_installed_have_a_row():
    output = compare("--steps", 3, "--accuracy", "1e-12", "--solvers", "newton,clarabel,Mosek")
    outcomes = read_outcomes(output)
    assert outcomes["Clarabel", "tuned"].startswith("missed misses its accuracy at ")
    assert outcomes["MOSEK", "default"].startswith("refused cvxpy does not find it here")
    assert [read_rows(output)["Clarabel", "tuned"][k] for k in (2, 5)] == ["no", "yes"]


@pytest.mark.long
def test_run_and_compare_print_the_same_error():
    ran = CliRunner().invoke(app, ["run", PROBLEM, "--n", "4", "--steps", "2"]).output
    (said,) = re.findall(r"certified +(\S+) relative", ran)
    assert read_rows(compare("--solvers", "newton"))["Newton", "own"][1] == said


def test_the_summary_gives_the_reason_for_an_error_above_the_requested_accuracy():
    """The reason is rounding, or a duality gap."""
    history = vx.simulate(paper_scene(), small("squares"), np.linspace(0.0, 1.0, 9))
    unit = history.trajectory.unit

    def find_line(**parts):
        changed = replace(history, trajectory=replace(history.trajectory, **parts))
        return next(line for line in changed.summary().splitlines() if line.startswith("certified"))

    assert "asked for" not in find_line()
    assert "; round-off leaves " in find_line(floor=np.full(9, 0.5e-14) * unit**2)
    missed = find_line(gap=np.where(np.arange(9) > 6, 0.5e-10, 0.0) * unit**2)
    assert missed.endswith("; asked for 1e-08, missed at 2 of 9 instants")


@pytest.mark.long
def test_the_command_exits_with_three_if_no_solver_is_certified():
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, "--accuracy", "1e-17", "--solvers", "newton,osqp")
    assert done.exit_code == 3
    assert "Traceback" not in done.output


@pytest.mark.long
def test_solvers_all_gives_a_row_to_every_installed_solver():
    output = compare("--solvers", "all")
    told = {name.lower() for name, _ in [*read_rows(output), *read_outcomes(output)]}
    assert told == {"newton", "direct"} | {name.lower() for name in list_installed()}
    # cvxpy's interface to SciPy solves linear programs only.
    assert read_outcomes(output)["SCIPY", "default"].startswith("refused the program has quadratic")


@pytest.fixture
def broken(tmp_path):
    (tmp_path / "broken.py").write_text(BROKEN)
    return tmp_path / "broken.py"


@pytest.mark.long
def test_solvers_that_fail_have_a_row_and_no_other_solver_is_called_wrong(broken):
    names = [f"{broken}:{name}" for name in ("Failing", "Full", "Nan", "Huge")]
    for order in (["newton", *names], [*names, "newton"]):
        output = compare("--solvers", ",".join(order))
        assert "WRONG" not in output
        told = {name: words for (name, _), words in read_outcomes(output).items()}
        assert told["Failing"] == "failed it failed: KeyError: 'eq_dual'"
        assert told["Full"] == "failed it ran out of memory"
        assert told["Huge"].startswith("failed d reaches 1.0e+200")
        assert told["Nan"].startswith("missed misses its accuracy")
        assert read_rows(output)["Newton", "own"][2] == "yes"


@pytest.mark.long
@pytest.mark.filterwarnings("default")
def test_an_error_of_the_problem_is_printed_once(tmp_path):
    """The initial state contradicts the supports."""
    warn = "import warnings\n    warnings.warn('a mistake', vx.SceneWarning, stacklevel=1)\n    return vx.Scene("
    (tmp_path / "jump.py").write_text(ONE_SIDED.replace('initial = "settled"', "").replace("return vx.Scene(", warn))
    done = invoke(tmp_path / "jump.py", "--n", 2, "--steps", 1, "--solvers", "newton,direct,clarabel")
    assert done.exit_code == 2, done.output
    told = " ".join(done.output.split())
    assert told.count("contradicts its supports at t = 0, by 0.01") == told.count("a mistake") == 1


@pytest.mark.long
def test_a_json_file_has_the_rows(tmp_path):
    compare("--solvers", "newton,clarabel,direct", "--json", tmp_path / "told.json")
    told = json.loads((tmp_path / "told.json").read_text())
    names = [("Newton", "own"), ("Clarabel", "tuned"), ("Clarabel", "default"), ("Direct", "own")]
    assert [(row["solver"], row["settings"]) for row in told["rows"]] == names
    assert [row["outcome"] for row in told["rows"]][::3] == ["certified", "refused"]
    assert told["trustworthy"] is True


def test_certificates_bound_distances_unless_limits_meet_friction_or_damping():
    K, load, one = np.eye(2), lambda t: np.ones(2), np.eye(2)[:1]
    norms, limits, damping = vx.Norms(one, [1.0]), vx.Limits(one, [1.0]), vx.Damping(np.eye(2))
    law = vx.Norms(one, [1.0], law=vx.Law(lambda t, p, past, slip: p))
    for given, bounds in (
        ({}, True),
        ({"norms": norms, "damping": damping}, True),
        ({"limits": limits}, True),
        ({"limits": limits, "norms": norms}, False),
        ({"limits": limits, "damping": damping}, False),
        ({"limits": limits, "norms": law}, False),
    ):
        assert bounds_distance(vx.System(K, load, **given)) is bounds, given


@pytest.mark.long
def test_distances_are_measured_in_the_energy_norm(attempts):
    system, (newton, _, poor) = (attempts[0], [run for _, run in attempts[1]])
    apart = (newton.state - poor.state) @ np.linalg.cholesky(system.K.toarray())
    relative = np.linalg.norm(apart, axis=1)[1:] / np.maximum.accumulate(newton.norm)[1:]
    found, _, kept = distance(system, newton, poor)
    assert found == pytest.approx(relative.max(), rel=1e-9)
    assert kept


@pytest.mark.long
def test_a_false_certificate_is_called_wrong(attempts):
    """The false certificate claims a tenth of the distance."""
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
def test_the_page_of_solvers_shows_the_table_of_its_command():
    command, block = re.search(r"`vemcvx (compare [^`]*)`[^`]*```text\n(.*?)```", page("solvers"), re.DOTALL).groups()
    done = CliRunner().invoke(app, command.split(), env={"COLUMNS": "80"})
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[:5] == block.splitlines()[:5]
    shown, found = read_rows(block), read_rows(done.output)
    assert set(found) >= set(shown)
    for key, line in shown.items():
        if key[0] not in ("Newton", "HIGHS") and line[1] != "-":
            # Certified errors depend on the machine, so a factor of 20 is allowed.
            one, two = float(found[key][1]), float(line[1])
            assert max(one, two) < 1e-10 or 0.05 < one / two < 20
