"""A parameter study makes one run per combination of values, and writes a table, and a folder for each run."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from called import call

import vemcvx as vx
from vemcvx.cli.problem_file import read_problem
from vemcvx.cost import study

PAD = '''"""A pad."""
import numpy as np, vemcvx as vx
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


@pytest.fixture
def pad(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    path = tmp_path / "pad.py"
    path.write_text(PAD)
    return path


def run(pad, *words):
    return call("run", str(pad), "--n", "4", "--steps", "4", *words)


def test_settings_are_combined_and_brackets_are_single_values(pad):
    problem = read_problem(pad)
    assert problem.combine_settings(["friction=.1,.2", "kind=hard,soft"]) == [
        (f"friction={friction}", f"kind={kind}") for friction in (".1", ".2") for kind in ("hard", "soft")
    ]
    assert problem.combine_settings(["kind=2-ply, hard,hard"]) == [("kind=2-ply",), ("kind=hard",)]
    assert problem.combine_settings(["push=(.1,-.02),(.2,-.02)"]) == [("push=(.1,-.02)",), ("push=(.2,-.02)",)]
    assert problem.combine_settings([]) == [()]


@pytest.mark.long
def test_a_study_writes_a_table_and_the_files_of_each_run(pad, tmp_path):
    words = ("--set", "friction=.1,.3", "--set", "kind=hard,soft", "--results", "slip,pressure,sticking")
    code, printed = run(pad, *words, "--out", "study")
    assert code == 0, printed
    rows = list(csv.DictReader((tmp_path / "study" / "study.csv").read_text().splitlines()))
    assert [(row["set.friction"], row["set.kind"], row["status"]) for row in rows] == [
        (friction, kind, "done") for friction in (".1", ".3") for kind in ("hard", "soft")
    ]
    told = json.loads((tmp_path / "study" / "study.json").read_text())
    for row, words in zip(rows, told, strict=True):
        history, settings = (
            vx.read_history(words["folder"]),
            [f"{name}={row[f'set.{name}']}" for name in ("friction", "kind")],
        )
        assert words["folder"] == f"study/{','.join(settings)}"
        problem = read_problem(pad)
        alone = problem.pose(settings, problem.mesh(4), 4).simulate()
        assert np.array_equal(alone.displacement, history.displacement)
        assert float(row["slip"]) == max(np.abs(history.contact.slip).ravel())
        assert words["pressure"] == float(row["pressure"]) == history.contact.pressure.max()
        numbers = " +".join(f"{float(row[name]):.5g}" for name in ("slip", "pressure", "sticking"))
        assert re.search(rf"{re.escape(row['set.friction'])} +{row['set.kind']} +{numbers}", printed), printed


@pytest.mark.long
def test_a_refused_run_has_a_row_in_the_table(pad, tmp_path):
    code, printed = run(pad, "--set", "friction=.1,-1", "--set", "kind=soft", "--out", "study")
    assert code == 2, printed
    assert re.search(r"^ *\.1 .*\d+ *$", printed, re.MULTILINE)
    assert re.search(r"^ *-1 .*- +refused *$", printed, re.MULTILINE)
    assert re.search(r"^refused +friction=-1: CoulombFriction on bottom: ", printed, re.MULTILINE), printed
    done, refused = json.loads((tmp_path / "study" / "study.json").read_text())
    assert (done["status"], refused["status"], refused["folder"]) == ("done", "refused", None)
    # A problem file that exits Python is refused, too.
    code, printed = run(pad, "--set", "kind=gone,rock", "--out", "other")
    assert code == 2
    assert re.search(r"^ *gone .* refused *$", printed, re.MULTILINE), printed


@pytest.mark.long
def test_a_study_with_missed_accuracies_exits_with_three(pad):
    code, printed = run(pad, "--set", "friction=.1,.2", "--accuracy", "1e-17")
    assert code == 3, printed
    assert printed.count("not certified") >= 2


def test_foreign_files_are_refused_before_any_run(pad, tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.csv").write_text("mine")
    code, printed = run(pad, "--set", "friction=.1,.2", "--out", "study")
    assert code == 2
    assert "study.csv: not made by a run of this version" in printed
    assert [path.name for path in (tmp_path / "study").iterdir() if path.is_dir()] == []


def test_folders_are_named_after_settings_or_numbered():
    assert study.folder_names([("a=.1", "b=x y"), ("a=.2", "b=x y")]) == ["a=.1,b=x_y", "a=.2,b=x_y"]
    assert study.folder_names([("a=x y",), ("a=x:y",)]) == ["run_1", "run_2"]
    assert study.folder_names([("a=" + "x" * 200,), ("a=1",)]) == ["run_1", "run_2"]


def test_remarks_name_the_runs_with_failures_warnings_and_unbounded_extremes():
    done = {"set.b": "0", "status": "done", "slip": 1.0}
    rows = [
        {"set.a": "1", **done, "unbounded": "", "met": True, "warnings": ["all do"]},
        {"set.a": "2", **done, "unbounded": "slip", "met": False, "warnings": ["all do", "only one"]},
    ]
    assert list(study.remarks(rows)) == [
        "warning     all runs: all do",
        "warning     a=2: only one",
        "no limit    a=2: slip may grow without limit as the mesh is refined",
    ]
    failed = {"set.a": "3", "set.b": "0", "status": "refused", "message": "no"}
    assert next(study.remarks([failed, *rows])) == "refused     a=3: no"
    rows[1]["estimated_error"] = 0.2
    table = study.table(rows, ["slip"], {}).text().splitlines()
    assert "error" in table[1]
    assert [line.endswith("target not met") for line in table[-2:]] == [False, True]


def test_a_mesh_file_has_several_bodies_if_the_scene_names_its_parts(tmp_path):
    file = str(Path(__file__).parents[1] / "meshes" / "files" / "a1_two_parts.inp")
    (tmp_path / "two.py").write_text(
        "import vemcvx as vx\n"
        "def scene(upon): return vx.Scene(vx.Elasticity(1.0, 0.3), vx.BilateralContact(on=upon))\n"
        "def mesh(n): return vx.meshes.squares(n)\ndef times(steps): return [0.0, 1.0]\n"
    )
    problem = read_problem(tmp_path / "two.py")
    mesh = problem.mesh(4, file, ["upon=Lower-1|Upper-1"])
    assert list(mesh.interfaces) == ["Lower-1|Upper-1"]
    with pytest.raises(vx.MeshError, match="If 'Lower-1', 'Upper-1' are bodies"):
        problem.mesh(4, file, ["upon=bottom"])
