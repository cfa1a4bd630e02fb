"""What was typed is taken as it stands, or refused with its reason; and what is said back is true of it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import paper_scene

import vemcvx as vx
from vemcvx.base.errors import ProblemError
from vemcvx.cli import report
from vemcvx.cli.problem_file import Problem, read_problem
from vemcvx.cost import study

PAPER = read_problem("feng_han_huang")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (["bound=1,"], "found 'bound=1,', with a comma at the end; commas separate several values, bound=1,2"),
        (["young=100,200", "young=300"], "young is given twice; give several values in one --set"),
        (["bound=1,2,1"], "bound is 1 twice in 'bound=1,2,1'"),
    ],
)
def test_settings_that_are_no_study_are_refused(settings, says):
    with pytest.raises(ProblemError, match=f"^--set: {says}"):
        PAPER.combine_settings(settings)


def test_a_tuple_of_one_is_a_value_where_the_scene_takes_tuples():
    module = SimpleNamespace(scene=lambda axes=(1, 0): axes)
    assert Problem(PAPER.path, module).combine_settings(["axes=1,"]) == [("axes=1,",)]


def test_a_study_says_what_has_failed_warned_or_no_limit_and_of_which_runs():
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
    assert table[-1].endswith("target not met")
    assert not table[-2].endswith("target not met")


def test_a_mesh_file_is_several_bodies_where_the_scene_names_their_parts(tmp_path):
    """Of the scene that the settings make: its names may depend on them."""
    file = str(Path(__file__).parents[1] / "meshes" / "files" / "a1_two_parts.inp")
    (tmp_path / "two.py").write_text(
        "import vemcvx as vx\n"
        "def scene(upon): return vx.Scene(vx.Elasticity(1.0, 0.3), vx.BilateralContact(on=upon))\n"
        "def mesh(n): return vx.meshes.squares(n)\ndef times(steps): return [0.0, 1.0]\n"
    )
    problem = read_problem(tmp_path / "two.py")
    mesh = problem.mesh(4, file, ["upon=Lower-1|Upper-1"])
    assert list(mesh.interfaces) == ["Lower-1|Upper-1"]
    with pytest.raises(vx.MeshError, match="If 'Lower-1', 'Upper-1' are bodies, read the file with bodies='physical'"):
        problem.mesh(4, file, ["upon=bottom"])


def test_a_report_judges_the_mesh_at_all_steps_or_at_the_largest_energy(monkeypatch):
    history = vx.simulate(paper_scene(lambda t: np.sin(np.pi * t)), vx.meshes.squares(2), np.linspace(0.0, 1.0, 9))
    assert report._choose_steps(history) == list(range(1, 9))
    monkeypatch.setattr(report, "MOST_STEPS", 2)
    assert report._choose_steps(history) == [1, int(np.argmax(history.trajectory.norm)), 8]
