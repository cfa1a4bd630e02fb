"""`vemcvx compare`: every solver's answer against the most certain one, within what both certificates allow."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli.compare import Outcome, bounds_distance, clause, distance, judged
from vemcvx.scene.pose import pose_scene
from vemcvx.solvers.conic import installed

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


def invoke(*arguments):
    return CliRunner().invoke(app, ["compare", *map(str, arguments)])


def rows(output):
    """The table as a dictionary: solver -> words of its line."""
    table = output.split("\n\n")[1].splitlines()[1:]
    return {line.split()[0]: line.split()[1:] for line in table}


@pytest.fixture(scope="module")
def outcomes():
    """Newton, Clarabel and a poor Clarabel on a load that reverses."""
    solvers = (vx.Newton(), vx.Clarabel(), vx.Clarabel(options={"max_iter": 5}))
    scene, mesh = paper_scene(cyclic), small("voronoi")
    ran = [vx.simulate(scene, mesh, TIMES, solver=s, check=False) for s in solvers]
    made = [Outcome(s, h.trajectory, h.seconds) for s, h in zip(solvers, ran, strict=True)]
    return pose_scene(scene, mesh).system, made


def test_all_that_accept_the_program_agree():
    done = invoke(PROBLEM, "--n", 6, "--steps", 4)
    assert done.exit_code == 0, done.output
    told = rows(done.output)
    assert list(told) == ["Newton", "Clarabel", "OSQP", "Direct"]
    assert " ".join(told["Direct"]) == "cannot: the program has absolute values, which it does not accept"
    for name, accuracy in (("Clarabel", 1e-6), ("OSQP", 1e-6)):
        asked, certified, floor, apart, allowed, kept = told[name][:6]
        assert float(asked) == accuracy
        assert float(certified) <= accuracy
        assert float(floor) < 1e-12
        assert 0 < float(apart) <= float(allowed) <= 4 * accuracy
        assert kept == "yes"
    # The most certain is compared with nobody: accuracy, certificate, floor, iterations, safeguards, three times.
    assert len(told["Newton"]) == 8
    assert "those by Newton, the most certain" in done.output
    assert "36 cells, 49 nodes, 78 unknowns, 4 steps" in done.output


def test_linear_problems_are_directs_too():
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, "--set", "bound=0.0", "--solvers", "direct,Newton,newton")
    assert done.exit_code == 0, done.output
    assert list(rows(done.output)) == ["Direct", "Newton"]
    assert rows(done.output)["Newton"][5] == "yes"


def test_a_miss_stands_in_the_table_and_is_no_failure_of_the_others():
    done = invoke(PROBLEM, "--n", 4, "--steps", 3, "--accuracy", "1e-12", "--solvers", "newton,clarabel,MOSEKK")
    assert done.exit_code == 0, done.output
    assert "Clarabel misses its accuracy in 3 of 3 steps, first in step 1 at t = 0.333333" in done.output
    assert " ".join(rows(done.output)["MOSEKK"]) == "cannot: cvxpy does not find it here"
    assert rows(done.output)["Clarabel"][5] == "yes"


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
    ],
)
def test_mistakes(options, says):
    done = invoke(PROBLEM, "--n", 4, "--steps", 2, *options)
    assert done.exit_code == 2
    assert re.search(says, " ".join(done.output.split()))


def test_all_asks_whatever_cvxpy_finds():
    told = rows(invoke(PROBLEM, "--n", 4, "--steps", 2, "--solvers", "all").output)
    assert {name.lower() for name in told} == {"newton", "direct"} | {name.lower() for name in installed()}
    # cvxpy's interface to SciPy knows linear programs only.
    assert " ".join(told["SCIPY"]) == "cannot: the program has quadratic, which it does not accept"


def test_where_the_sum_bounds_nothing_it_says_so(tmp_path):
    (tmp_path / "pressed.py").write_text(ONE_SIDED)
    done = invoke(tmp_path / "pressed.py", "--n", 4, "--steps", 2, "--solvers", "newton,clarabel")
    assert done.exit_code == 0, done.output
    assert rows(done.output)["Clarabel"][5] == "-"
    assert "no bound here, where weights follow the pressure" in done.output


def test_what_bounds_a_distance():
    K, load, one = np.eye(2), lambda t: np.ones(2), np.eye(2)[:1]
    norms, limits, damping = vx.Norms(one, [1.0]), vx.Limits(one, [1.0]), vx.Damping(np.eye(2))
    law = vx.Norms(one, [1.0], law=lambda t, p: p)
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


def test_distances_are_those_of_the_energy_norm(outcomes):
    system, (newton, clarabel, poor) = outcomes
    apart = (newton.trajectory.state - poor.trajectory.state) @ np.linalg.cholesky(system.K.toarray())
    scale = np.maximum.accumulate(newton.trajectory.norm)
    relative = np.linalg.norm(apart, axis=1)[1:] / scale[1:]
    found = distance(system, newton, poor)
    assert found.distance == pytest.approx(relative.max(), rel=1e-9)
    assert found.kept
    assert distance(system, newton, clarabel).distance < 1e-3 * found.distance


def test_a_false_certificate_is_called_wrong(outcomes):
    """An answer whose certificate claims a thousandth of its error: the table says so, and the command fails."""
    system, (newton, clarabel, poor) = outcomes
    assert judged("", system, [newton, clarabel, poor]).trustworthy
    share = distance(system, newton, poor)
    lie = 0.01 * (share.distance / share.allowed) ** 2 * poor.trajectory.gap
    liar = replace(poor, trajectory=replace(poor.trajectory, gap=lie))
    found = judged("", system, [newton, liar])
    assert not found.trustworthy
    assert "WRONG: Clarabel is farther from Newton than both certificates allow" in found.text
    assert rows("\n" + found.text)["Clarabel"][5] == "NO"


@pytest.mark.parametrize(
    ("message", "says"),
    [
        ("solver 'X': cvxpy does not find it here; it finds Y. Install it.", "cvxpy does not find it here"),
        ("step 1 at t = 0.5: it reached 1.5e-03. Ask for less.", "step 1 at t = 0.5: it reached 1.5e-03"),
    ],
)
def test_first_clauses(message, says):
    assert clause(message) == says


def test_the_readme_shows_this_table():
    text = (ROOT / "README.md").read_text()
    command, block = re.search(r"`vemcvx (compare [^`]*)`[^`]*```text\n(.*?)```", text, re.DOTALL).groups()
    arguments = command.split()[1:]
    done = invoke(str(ROOT / arguments[0]), *arguments[1:])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[:4] == block.splitlines()[:4]
    assert set(rows(done.output)) >= set(rows(block))
    for name, words in rows(block).items():
        if words[0] != "cannot:" and name not in ("Newton", "HIGHS"):
            # Certified errors are of the size that is printed.
            assert 0.05 < float(rows(done.output)[name][1]) / float(words[1]) < 20
