"""`vemcvx benchmark`: times until a true error is reached, and the outcomes of solvers that do not reach it."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import mostly_long
from test_cli import invoke, output_of

import vemcvx as vx
from vemcvx.cli.collection import INSTANCES, write_collection
from vemcvx.cli.collection.benchmark import (
    ANSWERED,
    FAILED,
    LATE,
    REFUSED,
    Trial,
    geometric_mean,
    measure,
    outcome_at,
    profile,
    score_table,
    seconds_to,
    select_common,
)
from vemcvx.program import StepProgram


def make_trial(tolerance, seconds=None, true=None, certified=None, outcome=ANSWERED, instance="a"):
    certified = true if certified is None else certified
    return Trial(instance, tolerance, outcome, seconds, true, certified, message="optimal")


def make_instance(name="a", **words):
    return {"name": name, "certified": 1e-8, "optimum": {}, "steps": 1, "block": 1, **words}


ENTRIES = {
    "quick": {"a": [make_trial(1e-2, 0.1, 1e-4, 1e-1), make_trial(1e-6, 0.3, 1e-7, 1e-4)]},
    "sure": {"a": [make_trial(1e-2, 0.2, 1e-2), make_trial(1e-6, 0.4, 1e-10)]},
    "false": {"a": [make_trial(1e-6, 0.01, 0.2)]},
}


def test_the_cheapest_trial_that_reaches_an_error_counts():
    """The solver "quick" reaches 1e-3 at both tolerances, the solver "sure" only at the tighter tolerance."""
    assert seconds_to(ENTRIES["quick"]["a"], 1e-3) == 0.1
    assert seconds_to(ENTRIES["sure"]["a"], 1e-3) == 0.4
    assert seconds_to(ENTRIES["quick"]["a"], 1e-9) == math.inf
    assert profile(ENTRIES, ["a"], 1e-6) == {"quick": [1.0], "sure": [0.4 / 0.3], "false": [math.inf]}


def test_means_are_shifted_and_geometric():
    """With a shift of .01, the mean of .09 and .39 is (.1 * .4)^.5 - .01 = .19. Infinity becomes the time limit."""
    assert geometric_mean([0.09, math.inf], 0.39) == pytest.approx(0.19, rel=1e-12)


def test_outcomes_are_distinguished_and_counted():
    assert outcome_at(ENTRIES["quick"]["a"], 1e-3) == "reached"
    assert outcome_at(ENTRIES["false"]["a"], 1e-3) == "missed"
    assert outcome_at([make_trial(1e-2, 1.0, 1e-2), make_trial(1e-4, outcome=LATE)], 1e-3) == LATE
    assert outcome_at([make_trial(1e-2, outcome=FAILED)], 1e-3) == FAILED
    instances = [make_instance()]
    assert select_common(ENTRIES, instances, "plane", 1e-6)[1] == ["a"]
    assert select_common(ENTRIES, instances, "plane", 1e-8)[1] == []
    rows = score_table(ENTRIES, instances, kind="plane", limit=10.0).rows
    # Columns: solver; instances solved to 1e-3, to 1e-6, to 1e-9; certified; missed. The optimum is known to 1e-8 only.
    assert [row[:6] for row in rows] == [
        ["quick", "1/1", "1/1", "0/0", "0", "0"],
        ["sure", "1/1", "1/1", "0/0", "1", "0"],
        ["false", "0/1", "0/1", "0/0", "0", "1"],
    ]
    # A refused instance does not improve the mean of a solver.
    both = {**ENTRIES, "picky": {"a": ENTRIES["quick"]["a"], "b": [make_trial(None, outcome=REFUSED)]}}
    both["sure"] = {**ENTRIES["sure"], "b": [make_trial(1e-2, 9.0, 1e-10)]}
    found = {
        row[0]: row[8:] for row in score_table(both, [*instances, make_instance("b")], kind="plane", limit=10.0).rows
    }
    assert found["sure"] == [".4000", ".4000", "-"]
    assert found["picky"] == [".1000", ".3000", "-"]


@pytest.fixture(scope="module")
def program():
    pull = vx.Traction(vx.Tabulated([0.0, 1.0], [(0.0, 0.0), (1.0, 0.0)]), on="left")
    floor = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.3, on="bottom")
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on="right"), pull, *floor)
    return vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0]).program(1)


def test_the_true_error_is_the_distance_from_the_optimum(program):
    """A solution that is the optimum times 1.03 has an error of 3 %."""
    longer = replace(program.answer, d=1.03 * program.answer.d)
    found = measure([lambda *_: (0.5, longer, "solved")], [program], 1e-3)
    assert found["true"] == pytest.approx(0.03, rel=1e-12)
    assert found["certified"] >= found["true"]
    assert found["seconds"] == 0.5
    for answer in (replace(longer, d=np.nan * longer.d), None):
        with pytest.raises(vx.SolverFailed, match="without an answer of finite numbers"):
            measure([lambda *_, answer=answer: (0.5, answer, "solved")], [program], 1e-3)


@mostly_long("status", ["infeasible", "unbounded", "infeasible_inaccurate"])
def test_a_wrong_status_counts_as_an_infinite_error(program, status):
    """An instance without optimum is judged by the status alone."""
    ask = [lambda *_: (0.5, program.answer, status)]
    assert measure(ask, [program], 1e-3)["true"] == math.inf
    plain = StepProgram(program.operators, *program.data)
    for wanted in ("infeasible", "unbounded"):
        assert measure(ask, [plain], 1e-3, wanted)["true"] == (0.0 if status.startswith(wanted) else math.inf)


@pytest.mark.long
def test_the_error_of_a_sequence_is_that_of_its_worst_step(program):
    """With the first optimum d*, the errors are .03 |d*| and .02 |d*|, and the second optimum is 2 d*."""
    second = replace(program, g=2.0 * program.g, answer=replace(program.answer, d=2.0 * program.answer.d))
    starts = []

    def ask(off, program):
        def answer(tolerance, memory):
            starts.append(dict(memory))
            memory["lam"] = off
            return 0.5, replace(program.answer, d=(1 + off) * program.answer.d, iterations=7), "solved"

        return answer

    found = measure([ask(0.03, program), ask(0.01, second)], [program, second], 1e-3)
    assert (found["seconds"], found["iterations"], starts) == (1.0, 14, [{}, {"lam": 0.03}])
    assert found["true"] == pytest.approx(0.015, rel=1e-12)


OWN = """
import os, time
import numpy as np, vemcvx as vx

class Mine:
    def solve(self, program, target):
        prepared = vx.Newton().prepare(program.operators)
        return prepared.solve(program, target, np.zeros((len(program.w), 1)), np.zeros(len(program.e)))

class Hangs(Mine):
    def solve(self, program, target):
        time.sleep(100)

class Crashes(Mine):
    def solve(self, program, target):
        os._exit(7)

class Raises(Mine):
    def solve(self, program, target):
        raise RuntimeError("no pivot")
"""


@pytest.fixture(scope="module")
def collection(tmp_path_factory):
    folder = tmp_path_factory.mktemp("collection")
    small = [one for one in INSTANCES if one.grade == "easy" and one.problem == "frictional_hysteresis"]
    write_collection(folder, instances=small)
    (folder / "own.py").write_text(OWN)
    return folder


def benchmark(*words):
    done = invoke("benchmark", *words)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow
def test_solvers_are_compared(collection, tmp_path):
    asked = ["--solvers", f"newton,clarabel,scipy,{collection / 'own.py'}:Mine", "--tolerances", "1e-2,1e-6,1e-10"]
    asked += ["--out", tmp_path / "one", "--time-limit", "20"]
    assert "Absolute values and bounds: 2 instances" in benchmark(collection, *asked)
    rows = list(csv.DictReader((tmp_path / "one" / "trials.csv").read_text().splitlines()))
    assert {row["outcome"] for row in rows if row["solver"].startswith("scipy")} == {REFUSED}
    answered = [row for row in rows if row["outcome"] == ANSWERED]
    assert {row["solver"].split()[0] for row in answered} == {"newton", "clarabel", "Mine"}
    # Certificates bound true errors up to the uncertainty of the optimum.
    assert all(float(row["true"]) <= float(row["certified"]) + 1e-12 for row in answered)
    for name in ("benchmark.txt", "profiles.png"):
        assert (tmp_path / "one" / name).stat().st_size > 500


NEWTON = """
        import vemcvx as vx

        answer = vx.Newton().prepare(operators).solve(program, target, np.zeros((len(w), block)), np.zeros(len(e)))
        d, lam, p, iterations = answer.d, answer.lam, answer.p, answer.iterations
"""


@pytest.mark.slow
def test_the_readme_of_a_collection_shows_a_solver_and_a_command_that_run(tmp_path, monkeypatch):
    """The test writes Newton's method in place of the dots."""
    wanted = {"block_between_dies-n12-2of8", "block_in_space-n4-4of8", "feng_han_huang-n8-4of8"}
    write_collection(tmp_path, instances=[one for one in INSTANCES if one.name in wanted])
    lines = (tmp_path / "README.md").read_text().splitlines()
    begin = lines.index("    import numpy as np")
    end = next(k for k in range(begin, len(lines)) if lines[k].startswith("    vemcvx benchmark"))
    code = [line.removeprefix("    ") for line in lines[begin:end] if line[:4].isspace()]
    dots = [k for k, line in enumerate(code) if line.lstrip().startswith("...")]
    (tmp_path / "mine.py").write_text("\n".join([*code[: dots[0]], NEWTON.strip("\n"), *code[dots[-1] + 1 :], ""]))
    monkeypatch.chdir(tmp_path)
    # On a busy machine, the solvers need more wall-clock time.
    benchmark(*lines[end].replace("--time-limit 2", "--time-limit 60").split()[2:])
    rows = list(csv.DictReader((tmp_path / "benchmark" / "trials.csv").read_text().splitlines()))
    for name in wanted:
        own = [row for row in rows if row["instance"] == name and row["solver"].startswith("Mine")]
        assert min(float(row["true"]) for row in own) <= 1e-9
    assert {row["solver"].split()[0] for row in rows} == {"Mine", "newton", "scs"}


@pytest.mark.slow
def test_solvers_that_hang_crash_or_raise_have_rows(collection, tmp_path):
    solvers = ",".join(f"{collection / 'own.py'}:{name}" for name in ("Hangs", "Crashes", "Raises", "Mine"))
    benchmark(collection, "--solvers", solvers, "--out", tmp_path, "--time-limit", "1")
    written = (tmp_path / "trials.csv").read_text()
    found = {(row["solver"], row["outcome"]) for row in csv.DictReader(written.splitlines())}
    ends = {"Hangs": LATE, "Crashes": FAILED, "Raises": FAILED, "Mine": ANSWERED}
    assert found == {(f"{name} own.py", outcome) for name, outcome in ends.items()}
    assert "no pivot" in written
    assert "exit code 7" in written


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (None, "has no manifest.json of a collection"),
        (["--only", "hard"], "--only: no grade or name has 'hard'"),
        (["--tolerances", "2"], "--tolerances: found '2'"),
        (["--solvers", "nobody"], "--solvers: there is no solver 'nobody'"),
    ],
)
def test_invalid_options_are_refused(tmp_path, options, says):
    if options is not None:
        (tmp_path / "manifest.json").write_text(json.dumps({"instances": [make_instance(grade="easy")]}))
    done = invoke("benchmark", tmp_path, "--solvers", "newton", *(options or []))
    assert done.exit_code == 2
    assert says in output_of(done)
