"""A parameter study: values with commas between are runs, in folders of their own; a table, files and a picture."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from called import call

import vemcvx as vx
from vemcvx.base.errors import ProblemError
from vemcvx.cli.problem_file import read_problem, split_values
from vemcvx.cost import study

PAD = '''"""A pad."""
import numpy as np
import vemcvx as vx

def scene(friction=0.3, push=(0.1, -0.02), kind="hard"):
    if kind == "gone":
        raise SystemExit(1)
    young = {"hard": 20.0, "soft": 10.0}[kind]
    plate = lambda x, t: np.tile(np.array(push) * (t, 1.0), (len(x), 1))
    contact = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(friction, on="bottom")
    return vx.Scene(vx.Elasticity(young, 0.3), vx.PrescribedDisplacement(plate, on="top"), *contact)

def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, 2.0), (0.0, 1.0)))

def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)

initial = "settled"
'''
SMALL = ("--n", "4", "--steps", "4")


@pytest.fixture
def pad(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    path = tmp_path / "pad.py"
    path.write_text(PAD)
    return path


@pytest.mark.parametrize(
    ("typed", "values"),
    [
        (".1", [".1"]),
        (".1,.2, .3", [".1", ".2", ".3"]),
        ("(1,2)", ["(1,2)"]),
        ("[1,2]", ["[1,2]"]),
        ("(1,2),(3,4)", ["(1,2)", "(3,4)"]),
        ("1,", ["1"]),
        ("hard,soft", ["hard", "soft"]),
        ("hard,2-ply", ["hard", "2-ply"]),
        ("'hard,soft'", ["'hard,soft'"]),
        ("'hard','soft'", ["'hard'", "'soft'"]),
        ("f(1,2)x", ["f(1,2)x"]),
        ("", [""]),
        (",", [","]),
    ],
)
def test_values_between_commas(typed, values):
    assert split_values(typed) == values


def test_combinations(pad):
    problem = read_problem(pad)
    found = problem.combine_settings(["friction=.1,.2", "kind=hard,soft"])
    assert found == [
        ("friction=.1", "kind=hard"),
        ("friction=.1", "kind=soft"),
        ("friction=.2", "kind=hard"),
        ("friction=.2", "kind=soft"),
    ]
    # The scene's own push is a pair, so that two numbers are one, as ever; two settings of one are refused.
    assert problem.combine_settings(["push=.1,-.02"]) == [("push=.1,-.02",)]
    assert problem.combine_settings(["push=(.1,-.02),(.2,-.02)"]) == [("push=(.1,-.02)",), ("push=(.2,-.02)",)]
    with pytest.raises(ProblemError, match="friction is given twice"):
        problem.combine_settings(["friction=.1", "friction=.2"])
    assert problem.combine_settings([]) == [()]


@pytest.mark.long
def test_a_study_is_a_table_and_files(pad, tmp_path):
    words = ("--set", "friction=.1,.3", "--set", "kind=hard,soft", "--results", "slip,pressure,sticking")
    code, said = call("run", str(pad), *SMALL, *words, "--out", "study", "--plot")
    assert code == 0, said
    rows = list(csv.DictReader((tmp_path / "study" / "study.csv").read_text().splitlines()))
    assert [(row["set.friction"], row["set.kind"], row["status"]) for row in rows] == [
        (".1", "hard", "done"),
        (".1", "soft", "done"),
        (".3", "hard", "done"),
        (".3", "soft", "done"),
    ]
    told = json.loads((tmp_path / "study" / "study.json").read_text())
    for row, words in zip(rows, told, strict=True):
        # Each run by itself says the same, to the bit.
        history = vx.read_history(words["folder"])
        assert words["folder"] == f"study/friction={row['set.friction']},kind={row['set.kind']}"
        alone = vx.simulate(
            read_problem(pad).scene([f"friction={row['set.friction']}", f"kind={row['set.kind']}"]),
            read_problem(pad).mesh(4),
            np.linspace(0.0, 1.0, 5),
            initial="settled",
        )
        assert np.array_equal(alone.displacement, history.displacement)
        assert float(row["slip"]) == max(np.abs(history.contact.slip).ravel())
        assert words["pressure"] == float(row["pressure"]) == history.contact.pressure.max()
        numbers = " +".join(f"{float(row[name]):.5g}" for name in ("slip", "pressure", "sticking"))
        assert re.search(rf"{re.escape(row['set.friction'])} +{row['set.kind']} +{numbers}", said), said
    assert (tmp_path / "study" / "study.png").stat().st_size > 10_000
    assert not list((tmp_path / "study" / "friction=.1,kind=hard").glob("*.png"))


@pytest.mark.long
def test_a_run_that_fails_is_a_row(pad):
    code, said = call("run", str(pad), *SMALL, "--set", "friction=.1,-1", "--set", "kind=soft", "--out", "study")
    assert code == 2, said
    assert re.search(r"^ *\.1 .*\d+ *$", said, re.MULTILINE)
    assert re.search(r"^ *-1 .*- +refused *$", said, re.MULTILINE)
    assert re.search(r"^refused +friction=-1: CoulombFriction on bottom: .*must be >= 0", said, re.MULTILINE), said
    told = json.loads((pad.parent / "study" / "study.json").read_text())
    assert [row["status"] for row in told] == ["done", "refused"]
    assert "must be >= 0" in told[1]["message"]
    assert told[1]["folder"] is None


@pytest.mark.slow
def test_a_run_that_misses_its_accuracy_has_the_other_exit_code(pad):
    words = ("--set", "friction=.1,.2", "--solver", "osqp", "--accuracy", "1e-15")
    code, said = call("run", str(pad), *SMALL, *words)
    assert code == 3, said
    assert said.count("not certified") >= 2


@pytest.mark.long
def test_a_code_of_the_problem_that_ends_its_process(pad):
    code, said = call("run", str(pad), *SMALL, "--set", "kind=hard,gone")
    assert code == 2
    assert re.search(r"^ *gone .* refused *$", said, re.MULTILINE), said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--results", "slips"), "--results: there is no result 'slips'; there are energy, dissipated"),
        (("--report",), "Each has its own folder in DIR of --out DIR, which --report needs"),
        (("--resume", "old"), "none of them can be resumed"),
    ],
)
def test_what_a_study_cannot_do(pad, words, message):
    code, said = call("run", str(pad), "--set", "friction=.1,.2", *words)
    assert code == 2
    assert message in " ".join(said.split())


def test_files_of_others_are_refused_before_any_run(pad, tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.csv").write_text("mine")
    code, said = call("run", str(pad), *SMALL, "--set", "friction=.1,.2", "--out", "study")
    assert code == 2
    assert "study.csv: not made by a run of this version" in said
    assert [path.name for path in (tmp_path / "study").iterdir() if path.is_dir()] == []


@pytest.mark.long
def test_where_all_runs_fail_there_is_no_picture(pad, tmp_path):
    code, said = call("run", str(pad), *SMALL, "--set", "friction=-1,-2", "--out", "study", "--plot")
    assert code == 2
    assert said.count("must be >= 0") == 2
    assert not (tmp_path / "study" / "study.png").exists()


def test_folders_say_the_settings():
    assert study.folder_names([("a=.1", "b=x y"), ("a=.2", "b=x y")]) == ["a=.1,b=x_y", "a=.2,b=x_y"]
    assert study.folder_names([("a=x y",), ("a=x:y",)]) == ["run_1", "run_2"]
    assert study.folder_names([("a=" + "x" * 200,), ("a=1",)]) == ["run_1", "run_2"]


def test_the_picture_has_a_line_for_each_value_of_the_second_parameter():
    pytest.importorskip("matplotlib")
    rows = [
        {"set.a": a, "set.b": b, "set.c": "1", "status": "done", "slip": float(a) * k}
        for a in ("2", "1", "10")
        for k, b in enumerate(("x", "y"))
    ]
    failed = {"set.a": "3", "set.b": "x", "set.c": "1", "status": "refused", "message": "no"}
    labels = {"slip": "largest slip"}
    figure = study.picture([*rows, failed], ["slip", "pressure"], labels, "title")
    (ax,) = (ax for ax in figure.axes if ax.lines)
    assert [line.get_label() for line in ax.lines] == ["b = x", "b = y"]
    assert ax.lines[1].get_xydata().tolist() == [[1.0, 1.0], [2.0, 2.0], [10.0, 10.0]]
    assert np.isnan(ax.lines[0].get_ydata()[2])
    assert ax.get_xlabel() == "a"
    words = study.picture([{"set.a": a, "status": "done", "slip": 1.0} for a in "xy"], ["slip"], labels)
    assert [tick.get_text() for tick in words.axes[0].get_xticklabels()] == ["x", "y"]
