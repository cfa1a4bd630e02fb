"""What was typed is taken as it stands, or refused with its reason; and what is said back is true of it."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import paper_scene
from test_cli_supplied import call
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.base.errors import ProblemError
from vemcvx.cli import app, report
from vemcvx.cli.problem_file import Problem, read_problem
from vemcvx.cli.report import _unit, _without_limit
from vemcvx.cost import study

PAPER = read_problem("feng_han_huang")
HELD = vx.Elasticity(200.0, 0.3), vx.Clamp(on="left")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (["bound=1,"], "found 'bound=1,'; several values have commas between, bound=1,2"),
        (["young=100,200", "young=300"], "young is given twice; give several values in one --set"),
        (["bound=1,2,1"], "bound is 1 twice in 'bound=1,2,1'"),
    ],
)
def test_settings_that_are_no_study_are_refused(settings, says):
    with pytest.raises(ProblemError, match=f"^--set: {says}"):
        PAPER.studied(settings)


@pytest.mark.long
def test_settings_given_twice_are_refused_by_all_commands():
    with pytest.raises(ProblemError, match="young is given twice"):
        PAPER.scene(["young=1", "young=2"])
    code, said = call("show", "feng_han_huang", "--set", "young=1", "--set", "young=2")
    assert code == 2
    assert "young is given twice" in said


def test_a_tuple_of_one_is_a_value_where_the_scene_takes_tuples():
    module = SimpleNamespace(scene=lambda axes=(1, 0): axes)
    assert Problem(PAPER.path, module).studied(["axes=1,"]) == [("axes=1,",)]


@pytest.mark.long
@pytest.mark.parametrize("probe", ["1", "1,2,3,4", "a,b"])
def test_a_probe_that_is_no_point_is_called_so(probe):
    code, said = call("run", "feng_han_huang", "--n", "2", "--steps", "1", "--probe", probe)
    assert code == 2
    assert f"--probe: found '{probe}'; wanted points" in said
    assert "--out" not in said


def test_warnings_of_a_study_name_their_runs():
    rows = [study.Row({"a": a, "b": "1"}, warnings=("all do", *said)) for a, said in (("1", ()), ("2", ("only one",)))]
    assert list(study.said_of(rows)) == ["warning     all runs: all do", "warning     a=2: only one"]


def test_warnings_of_a_study_that_differ_by_numbers_are_one():
    rows = [study.Row({"a": a}, warnings=(f"work is {a}e-05, of 2.5",)) for a in ("1", "2")]
    assert list(study.said_of(rows)) == ["warning     all runs: work is 1e-05, of 2.5 (numbers of a=1)"]


def test_a_study_says_what_has_no_limit_and_which_target_is_missed():
    rows = [
        study.Row({"a": a}, results={"slip": 1.0, "estimated_error": error}, unbounded=without, met=error < 0.1)
        for a, error, without in (("1", 0.05, {}), ("2", 0.2, {"slip": "at a corner: grows"}))
    ]
    (line,) = study.said_of(rows)
    assert line.startswith("no limit    a=2: slip may grow without limit as the mesh is refined")
    table = study.table(rows, ["slip"]).text().splitlines()
    assert "error" in table[1]
    assert table[-1].endswith("target not met")
    assert not table[-2].endswith("target not met")


@pytest.mark.long
def test_a_report_names_the_stage_in_which_it_estimates(tmp_path, monkeypatch):
    stages = []
    spied = nullcontext(lambda doing, *_: stages.append(doing))
    monkeypatch.setattr("vemcvx.cli.run.progress_bar", lambda *_: spied)
    monkeypatch.setattr("vemcvx.cli.run.with_errors", lambda history: (history, ""))
    monkeypatch.setattr("vemcvx.cli.run.write_report", lambda *_, **__: tmp_path)
    given = ("run", "feng_han_huang", "--n", "2", "--steps", "2", "--out", str(tmp_path))
    for more in ((), ("--report",)):
        assert CliRunner().invoke(app, [*given, *more]).exit_code == 0
    assert stages.count("estimating errors, in finer steps and on a finer mesh") == 1


@pytest.mark.long
def test_a_run_names_the_report_that_an_earlier_one_left(tmp_path, monkeypatch):
    given = ("run", "feng_han_huang", "--n", "2", "--steps", "2", "--out", str(tmp_path))
    (tmp_path / "report.html").write_text("an earlier one")
    said = CliRunner().invoke(app, given).output
    assert "remain      report.html: of an earlier run; --report and --plot make them anew" in said
    (tmp_path / "report.html").unlink()
    assert "an earlier run" not in CliRunner().invoke(app, given).output


def test_contact_is_told_where_there_is_some_and_slip_where_there_is_friction():
    pull = vx.Traction((0.0, -1.0), on="top")
    free, touching = (
        vx.simulate(vx.Scene(*HELD, pull, *more), vx.meshes.squares(2), [0.0, 1.0], initial="settled").summary()
        for more in ((), (vx.BilateralContact(on="bottom"),))
    )
    assert "contact    " not in free
    assert "2 nodes touch, without friction in the last step" in touching


def test_names_and_units_of_the_report():
    extreme = SimpleNamespace(name="largest von Mises stress", unbounded="it grows")
    assert _without_limit(SimpleNamespace(extremes=[extreme])) == "<p>Largest von Mises stress: it grows.</p>"
    assert _unit("energy/length", None) == "force"
    assert _unit("energy/length²", None) == "force / length"
    assert _unit("energy/length", {"energy per length": "J/m²"}) == "J / m²"
    assert _unit("force × length", {"force": "N", "length": "mm"}) == "N mm"


def test_units_of_energies_are_products_of_those_given():
    assert _unit("energy", {"length": "mm", "force": "N"}) == "N mm"
    assert _unit("force × length", {"length": "mm", "force": "N"}) == "N mm"


def test_a_mesh_that_n_does_not_change_is_known(tmp_path):
    """Such as that of a file, which a problem reads or the command names."""
    vx.meshes.squares(2).write(tmp_path / "two.msh")
    head = "import vemcvx as vx\ndef scene(): return vx.Scene()\ndef times(steps): return [0.0, 1.0]\n"
    own, read = tmp_path / "own.py", tmp_path / "read.py"
    own.write_text(f"{head}def mesh(n): return vx.meshes.squares(n)\n")
    read.write_text(f"{head}def mesh(n): return vx.meshes.read({str(tmp_path / 'two.msh')!r})\n")
    for path, family, ignores in ((own, None, False), (read, None, True), (own, "two.msh", True)):
        assert read_problem(path).ignores_n(read_problem(path).mesh(4), 4, family) == ignores


def test_a_report_judges_the_mesh_at_all_steps_or_at_the_largest_energy(monkeypatch):
    history = vx.simulate(paper_scene(lambda t: np.sin(np.pi * t)), vx.meshes.squares(2), np.linspace(0.0, 1.0, 9))
    assert report._looked_at(history) == list(range(1, 9))
    monkeypatch.setattr(report, "BUDGETED", 2)
    assert report._looked_at(history) == [1, int(np.argmax(history.trajectory.norm)), 8]
