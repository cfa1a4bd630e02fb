"""`vemcvx benchmark`: times to true errors, whatever tolerances mean, and whatever becomes of a solver."""

from __future__ import annotations

import csv
import json
import math
import shutil
import time
from dataclasses import replace

import numpy as np
import pytest
from scenes import mostly_long
from test_cli import invoke

import vemcvx as vx
from vemcvx.cli.collection import INSTANCES, CollectionInstance, write_collection
from vemcvx.cli.collection.benchmark import (
    ANSWERED,
    FAILED,
    LATE,
    REFUSED,
    Trial,
    fate,
    geometric_mean,
    in_words,
    journal,
    measure,
    profile,
    remaining_work,
    scores,
    seconds_to,
    select_common,
)
from vemcvx.program import StepProgram

SMALL = [one for one in INSTANCES if one.grade == "easy" and one.problem == "frictional_hysteresis"]


def trial(tolerance, seconds, true, certified=None, outcome=ANSWERED, says="optimal", instance="a"):
    certified = true if certified is None else certified
    return Trial(instance, "d", 10.0, tolerance, outcome, seconds, true, certified, message=says)


def instance(name="a", certified=1e-8, **words):
    return {"name": name, "sha256": "d", "certified": certified, "optimum": {}, "steps": 1, "block": 1, **words}


ENTRIES = {
    "quick": {"a": [trial(1e-2, 0.1, 1e-4, 1e-1), trial(1e-6, 0.3, 1e-7, 1e-4)]},
    "sure": {"a": [trial(1e-2, 0.2, 1e-2), trial(1e-6, 0.4, 1e-10)]},
    "claims": {"a": [trial(1e-6, 0.01, 0.2)]},
}


def test_the_cheapest_trial_that_reaches_an_error_counts():
    """By hand: quick reaches 1e-3 with its loosest tolerance, sure only with its tightest."""
    assert seconds_to(ENTRIES["quick"]["a"], 1e-3) == 0.1
    assert seconds_to(ENTRIES["sure"]["a"], 1e-3) == 0.4
    assert seconds_to(ENTRIES["quick"]["a"], 1e-9) == math.inf
    assert profile(ENTRIES, ["a"], 1e-6) == {"quick": [1.0], "sure": [0.4 / 0.3], "claims": [math.inf]}
    # A clock that ticks slowly may count nothing: that is a tick.
    idle = {"idle": {"a": [trial(1e-2, 0.0, 1e-9)]}, "sure": ENTRIES["sure"]}
    ticks = 0.4 / time.get_clock_info("process_time").resolution
    assert profile(idle, ["a"], 1e-6) == {"idle": [1.0], "sure": [pytest.approx(ticks)]}


def test_means_are_shifted_and_geometric():
    """Of .09 and .39 with a shift of .01: (.1 * .4)^(1/2) - .01 = .19; what is not reached counts as the limit."""
    assert geometric_mean([0.09, 0.39], 10.0) == pytest.approx(0.19, rel=1e-12)
    assert geometric_mean([0.09, math.inf], 0.39) == pytest.approx(0.19, rel=1e-12)


def test_fates_are_told_apart():
    assert fate(ENTRIES["quick"]["a"], 1e-3) == "reached"
    assert fate(ENTRIES["claims"]["a"], 1e-3) == "missed"
    late = [trial(1e-2, 1.0, 1e-2), trial(1e-4, None, None, outcome=LATE)]
    assert fate(late, 1e-3) == LATE
    assert fate([trial(1e-2, None, None, outcome=FAILED)], 1e-3) == FAILED
    instances = [instance()]
    assert select_common(ENTRIES, instances, "plane", 1e-6)[1] == ["a"]
    assert select_common(ENTRIES, instances, "plane", 1e-8)[1] == []
    rows = scores(ENTRIES, instances, kind="plane", limit=10.0).rows
    # Solver, reached to 1e-3, 1e-6 and 1e-9 (for which the optimum is not known well enough), sure, missed.
    assert [row[:6] for row in rows] == [
        ["quick", "1/1", "1/1", "0/0", "0", "0"],
        ["sure", "1/1", "1/1", "0/0", "1", "0"],
        ["claims", "0/1", "0/1", "0/0", "0", "1"],
    ]
    # Who takes less than others has no better mean for that.
    both = {**ENTRIES, "picky": {"a": ENTRIES["quick"]["a"], "b": [trial(None, None, None, outcome=REFUSED)]}}
    both["sure"] = {**ENTRIES["sure"], "b": [trial(1e-2, 9.0, 1e-10)]}
    found = scores(both, [*instances, instance("b")], kind="plane", limit=10.0).rows
    assert {row[0]: row[8:] for row in found}["sure"] == [".4000", ".4000", "-"]
    assert {row[0]: row[8:] for row in found}["picky"] == [".1000", ".3000", "-"]


def test_no_number_is_cut_in_eighty_columns(monkeypatch):
    """The widest cells that there are: names that fold, three digits of instances, seconds of a long limit."""
    monkeypatch.setenv("COLUMNS", "80")
    names = [f"a{k}" for k in range(138)]
    tried = {name: [trial(1e-6, 1234.5, 1e-12, instance=name)] for name in names}
    late = {name: [trial(1e-6, None, None, outcome=LATE, instance=name)] for name in names}
    labels = "clarabel max_iter=200 0.11.1", "ASolverWithALongNameOfItsOwn 0123abcd"
    text, _ = in_words(dict(zip(labels, (tried, late), strict=True)), [instance(name) for name in names], 3600.0)
    table = text.split("\n\n")[0].splitlines()
    assert max(map(len, table)) <= 80
    rows = [line.split() for line in table if "/138" in line]
    assert rows[0][1:] == [*["138/138"] * 2, "0/0", "138", "0", "0", "0", "1.23e+03", "1.23e+03", "-"]
    assert rows[1][1:] == [*["0/138"] * 2, "0/0", "0", "0", "0", "138", "3.6e+03", "3.6e+03", "-"]


def test_what_is_left_is_what_no_trial_answers():
    def work(*ladder, sha256="d", limit=1.0):
        return [(Trial("a", sha256, limit), ladder)]

    new = work(1e-2, 1e-4, 1e-6)
    assert list(remaining_work([], new)) == new
    assert list(remaining_work([trial(1e-2, 0.1, 1e-3)], new)) == work(1e-4, 1e-6)
    assert list(remaining_work([trial(1e-2, 0.1, 1e-11)], new)) == []
    late = [trial(1e-2, None, None, outcome=LATE)]
    assert list(remaining_work(late, work(1e-2, 1e-4, limit=10.0))) == []
    assert list(remaining_work(late, work(1e-2, 1e-4, limit=20.0))) == work(1e-2, 1e-4, limit=20.0)
    assert list(remaining_work([trial(None, None, None, outcome=REFUSED)], new)) == []
    assert list(remaining_work([trial(1e-2, 0.1, 1e-11)], work(1e-2, sha256="other"))) == work(1e-2, sha256="other")


def paper_step():
    history = vx.simulate(
        vx.Scene(
            vx.Elasticity(1.0, 0.3),
            vx.Clamp(on="right"),
            vx.Traction(vx.Tabulated([0.0, 1.0], [(0.0, 0.0), (1.0, 0.0)]), on="left"),
            vx.BilateralContact(on="bottom"),
            vx.TrescaFriction(0.3, on="bottom"),
        ),
        vx.meshes.squares(4),
        [0.0, 1.0],
    )
    return history.program(1)


def test_the_true_error_is_the_distance_from_the_optimum():
    """An answer that is 3 % of the optimum too long is 3 % off; it is never certified to less."""
    program = paper_step()
    longer = replace(program.answer, d=1.03 * program.answer.d)
    found = measure([lambda *_: (0.5, longer, "solved")], [program], 1e-3)
    assert found["true"] == pytest.approx(0.03, rel=1e-12)
    assert found["certified"] >= found["true"]
    assert found["seconds"] == 0.5
    for answer in (replace(longer, d=np.nan * longer.d), None):
        with pytest.raises(vx.SolverFailed, match="without an answer of finite numbers"):
            measure([lambda *_, answer=answer: (0.5, answer, "solved")], [program], 1e-3)


@mostly_long("says", ["infeasible", "unbounded", "infeasible_inaccurate"])
def test_a_status_is_right_or_wrong_whatever_the_error(says):
    """The exact optimum earns nothing if it is called infeasible; without an optimum nothing else counts."""
    program = paper_step()
    ask = [lambda *_: (0.5, program.answer, says)]
    assert measure(ask, [program], 1e-3)["true"] == math.inf
    plain = StepProgram(program.operators, *program.data)
    for status in ("infeasible", "unbounded"):
        right = says.startswith(status)
        assert measure(ask, [plain], 1e-3, status)["true"] == (0.0 if right else math.inf)


@pytest.mark.long
def test_a_sequence_is_as_good_as_its_worst_step():
    """By hand: steps off by 3 % and 1 % of their own size, in units of the larger; each begins with the one before."""
    programs = [paper_step(), replace(paper_step(), g=2.0 * paper_step().g)]
    programs[1] = replace(programs[1], answer=replace(programs[0].answer, d=2.0 * programs[0].answer.d))
    begun = []

    def ask(off, program):
        def answered(tolerance, memory):
            begun.append(dict(memory))
            memory["lam"] = off
            return 0.5, replace(program.answer, d=(1 + off) * program.answer.d, iterations=7), "solved"

        return answered

    found = measure([ask(0.03, programs[0]), ask(0.01, programs[1])], programs, 1e-3)
    assert (found["seconds"], found["iterations"], begun) == (1.0, 14, [{}, {"lam": 0.03}])
    assert found["true"] == pytest.approx(0.015, rel=1e-12)


OWN = '''
import os
import time

import numpy as np

import vemcvx as vx


class Mine:
    """The package's own method, under another name."""

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
'''


@pytest.fixture(scope="module")
def collection(tmp_path_factory):
    folder = tmp_path_factory.mktemp("collection")
    write_collection(folder, instances=SMALL)
    (folder / "own.py").write_text(OWN)
    return folder


@pytest.mark.slow
def test_solvers_are_compared_stored_and_merged(collection, tmp_path):
    asked = ["--solvers", f"newton,clarabel,scipy,{collection / 'own.py'}:Mine", "--tolerances", "1e-2,1e-6,1e-10"]
    done = invoke("benchmark", collection, *asked, "--out", tmp_path / "one", "--time-limit", "20")
    assert done.exit_code == 0, done.output
    assert "Absolute values and bounds: 2 instances" in done.output
    rows = list(csv.DictReader((tmp_path / "one" / "trials.csv").read_text().splitlines()))
    assert {row["outcome"] for row in rows if row["solver"].startswith("scipy")} == {REFUSED}
    answered = [row for row in rows if row["outcome"] == ANSWERED]
    assert {row["solver"].split()[0] for row in answered} == {"newton", "clarabel", "Mine"}
    # Certificates are bounds of true errors, but for what is open about the optimum itself.
    assert all(float(row["true"]) <= float(row["certified"]) + 1e-12 for row in answered)
    for name in ("benchmark.md", "profiles.png"):
        assert (tmp_path / "one" / name).stat().st_size > 500
    before = {path.name: path.read_bytes() for path in (tmp_path / "one").glob("*.jsonl")}
    again = invoke("benchmark", collection, *asked, "--out", tmp_path / "one", "--time-limit", "20")
    assert again.exit_code == 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "one").glob("*.jsonl")} == before
    # Results of another machine are copied into the folder, and stand in the table.
    asked = ["--solvers", "osqp", "--out", tmp_path / "two"]
    assert invoke("benchmark", collection, *asked, "--tolerances", "1e-2,1e-6").exit_code == 0
    for path in (tmp_path / "one").glob("*.jsonl"):
        shutil.copy(path, tmp_path / "two")
    merged = invoke("benchmark", collection, "--out", tmp_path / "two")
    assert all(name in merged.output for name in ("newton", "clarabel", "Mine", "osqp"))


ADMM = """
        from scipy.linalg import cho_factor, cho_solve

        A, a, terms = np.vstack([B.toarray(), D.toarray()]), np.append(b, e), len(b)
        rho = np.mean(K.diagonal()) / np.mean(np.sum(A * A, axis=1))
        held = cho_factor(np.asarray(K + rho * A.T @ A))
        y, u = np.zeros(len(a)), np.zeros(len(a))
        for iterations in range(1, 3001):
            d = cho_solve(held, g + rho * A.T @ (y + a - u))
            v = A @ d - a + u
            s, z = v[:terms].reshape(-1, block), v[terms:]
            size = np.maximum(np.linalg.norm(s, axis=1), 1e-300)
            shrunk = np.maximum(1 - w / rho / size, 0)[:, None] * s
            pressed = np.maximum(z, 0) * rho * c / (1 + rho * c) + np.minimum(z, 0)
            y = np.append(shrunk.ravel(), pressed)
            u = v - y
            lam, p = program.project(rho * u[:terms].reshape(-1, block)), np.maximum(rho * u[terms:], 0)
            d = program.feasible(d)
            if program.duality_gap(d, lam, p) <= target:
                break
"""


@pytest.mark.slow
def test_an_author_gets_a_profile_with_the_readme_alone(tmp_path, monkeypatch):
    """The file that it shows with an ADMM in place of its dots, and the command that it shows."""
    wanted = {"block_between_dies-n12-2of8", "block_in_space-n4-4of8", "feng_han_huang-n8-4of8"}
    write_collection(tmp_path, instances=[one for one in INSTANCES if one.name in wanted])
    lines = (tmp_path / "README.md").read_text().splitlines()
    begin = lines.index("    import numpy as np")
    end = next(k for k in range(begin, len(lines)) if lines[k].startswith("    vemcvx benchmark"))
    code = [line.removeprefix("    ") for line in lines[begin:end] if line[:4].isspace()]
    dots = [k for k, line in enumerate(code) if line.lstrip().startswith("...")]
    (tmp_path / "mine.py").write_text("\n".join([*code[: dots[0]], ADMM.strip("\n"), *code[dots[-1] + 1 :], ""]))
    monkeypatch.chdir(tmp_path)
    # Seconds are by the clock, which goes on where others work beside.
    done = invoke(*lines[end].replace("--time-limit 2", "--time-limit 60").split()[1:])
    assert done.exit_code == 0, done.output
    rows = list(csv.DictReader((tmp_path / "benchmark" / "trials.csv").read_text().splitlines()))
    best = {
        name: min(float(row["true"]) for row in rows if row["instance"] == name and row["solver"].startswith("Mine"))
        for name in wanted
    }
    assert max(best.values()) <= 1e-9, best
    assert {row["solver"].split()[0] for row in rows} == {"Mine", "newton", "scs"}
    assert (tmp_path / "benchmark" / "profiles.png").stat().st_size > 500


SEEN = """
import numpy as np
import vemcvx as vx

class Seen:
    def solve(self, program, target, lam, p):
        answer = vx.Newton().prepare(program.operators).solve(program, target, lam, p)
        return answer.d, answer.lam, answer.p, int(np.abs(lam).max() > 0)
"""


@pytest.mark.slow
def test_steps_of_a_sequence_begin_with_what_is_left(tmp_path):
    """Ours begins with its own multipliers, all steps but the first; OSQP with its answer; SCS is asked as well."""
    short = CollectionInstance(grade="sequences", problem="feng_han_huang", n=8, of=8, step=8, steps=8)
    write_collection(tmp_path / "all", instances=[short])
    (tmp_path / "seen.py").write_text(SEEN)
    solvers = f"{tmp_path / 'seen.py'}:Seen,osqp,scs"
    done = invoke(
        "benchmark", tmp_path / "all", "--solvers", solvers, "--tolerances", "1e-8", "--out", tmp_path / "out"
    )
    assert done.exit_code == 0, done.output
    assert "each with a warm start from the previous answer: 1 instances" in done.output
    trials = {path.name.split("_")[0]: journal(path) for path in (tmp_path / "out").glob("*.jsonl")}
    assert [one.iterations for one in trials["Seen"]] == [7]
    assert [one.outcome for one in trials["scs"] + trials["osqp"]] == [ANSWERED] * 2


@pytest.mark.slow
def test_whatever_becomes_of_a_solver_is_a_fate(collection, tmp_path):
    solvers = ",".join(f"{collection / 'own.py'}:{name}" for name in ("Hangs", "Crashes", "Raises", "Mine"))
    done = invoke("benchmark", collection, "--solvers", solvers, "--out", tmp_path / "out", "--time-limit", "1")
    assert done.exit_code == 0, done.output
    rows = {}
    for path in (tmp_path / "out").glob("*.jsonl"):
        rows[path.name.split("_")[0]] = {one.outcome for one in journal(path)}
    assert rows == {"Hangs": {LATE}, "Crashes": {FAILED}, "Raises": {FAILED}, "Mine": {ANSWERED}}
    assert "no pivot" in (tmp_path / "out" / "trials.csv").read_text()
    assert "exit code 7" in (tmp_path / "out" / "trials.csv").read_text()


@pytest.mark.long
def test_what_cannot_be_compared_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    for given, said in (
        ([tmp_path / "empty"], "has no manifest.json of a collection"),
        ([tmp_path / "empty", "--time-limit", "0"], "--time-limit: found 0"),
    ):
        done = invoke("benchmark", *given)
        assert done.exit_code == 2
        assert said in " ".join(done.output.split())
    (tmp_path / "manifest.json").write_text(json.dumps({"instances": [instance(grade="easy")]}))
    for given, said in (
        (["--only", "hard"], "--only: no grade or name has 'hard'; the grades are easy; core is the core set."),
        (["--tolerances", "2"], "--tolerances: found 2; wanted numbers between 0 and 1."),
        (["--solvers", "nobody"], "--solvers: there is no solver 'nobody'"),
        ([], "no results are stored there; name solvers by --solvers."),
    ):
        done = invoke("benchmark", tmp_path, *given)
        assert done.exit_code == 2
        assert said in " ".join(done.output.split())
