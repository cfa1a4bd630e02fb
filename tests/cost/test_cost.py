"""The command `vemcvx cost`: rows of finished and of failed runs, advice, and the picture."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pages import assert_drawn_within_the_page
from scenes import paper_scene, small
from texts import ROOT
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli.cost import Cost
from vemcvx.cli.problem_file import Posed, read_problem
from vemcvx.cost.sweeping import Point, common_instants, measure_point, run_to_row
from vemcvx.cost.table import advice, front, growing_extremes, picture, table
from vemcvx.estimate.measures import energy_distance
from vemcvx.results.files import read_archive

PROBLEM = str(ROOT / "problems" / "feng_han_huang.py")
GRID = ("--mesh", "squares", "--n", "2,4,6", "--steps", "4", "--solver", "newton", "--target", "0.4")
UNIFORM = Point("squares", 4, 4, "newton", 1e-8)


def cost(*arguments):
    return CliRunner().invoke(app, ["cost", *map(str, arguments)])


def read_table(folder):
    with (folder / "cost.csv").open() as stream:
        return list(csv.DictReader(stream))


def call_here(function, *given):
    return "done", function(*given)


@pytest.fixture
def in_process(monkeypatch):
    monkeypatch.setattr("vemcvx.cost.sweeping.call_safely", call_here)


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_rows_have_the_results_of_single_runs(tmp_path):
    done = cost(PROBLEM, *GRID, "--workers", "1", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    found, reference = read_table(tmp_path), read_archive(tmp_path / "reference.npz")
    assert [(row["target"], row["n"]) for row in found] == [("0.4", "2"), ("", "6"), ("", "4"), ("", "2")]
    fine = vx.simulate(paper_scene(), vx.meshes.squares(12), np.linspace(0, 1, 17))
    assert reference.mesh.n_cells == 144
    assert np.abs(reference.displacement[-1] - fine.displacement[-1]).max() < 1e-12
    assert f"estimated error {vx.error_budget(fine).largest['total']:.2%}" in done.output
    instants = [0.25, 0.5, 0.75, 1.0]
    for row in found:
        if row["target"]:
            wanted = np.append(0.0, instants)
            history = vx.adapt(paper_scene(), vx.meshes.squares(2), wanted, 0.4, solver=vx.Newton(1e-8)).history
        else:
            history = vx.simulate(paper_scene(), vx.meshes.squares(int(row["n"])), np.linspace(0, 1, 5))
        apart = [energy_distance(history, reference, time=t) for t in instants]
        scale = max(one.reference for one in apart)
        # Arithmetic in another process may round differently.
        assert float(row["error"]) == pytest.approx(max(one.absolute for one in apart) / scale, rel=1e-9)
        assert float(row["error_end"]) == pytest.approx(apart[-1].absolute / scale, rel=1e-9)
        estimated = vx.error_budget(history, None).largest["total"]
        assert float(row["estimated_error"]) == pytest.approx(estimated, rel=1e-6)
        assert float(row["certified_total"]) == pytest.approx(history.certified_total.max(), abs=1e-12)
        counts = history.mesh.n_cells, history.trajectory.state.shape[1], history.steps
        assert tuple(int(row[name]) for name in ("cells", "unknowns", "steps")) == counts
        assert float(row["von_mises"]) == pytest.approx(next(e.value for e in history.extremes if e.key == "von_mises"))
        assert float(row["seconds"]) > 0
    good = [row for row in found if float(row["error"]) <= 0.4]
    cheapest = min(good, key=lambda row: float(row["seconds"]))
    assert f"costs {float(cheapest['seconds']):.2g} s, error" in done.output
    assert (tmp_path / "cost.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
@pytest.mark.usefixtures("in_process")
def test_a_sweep_with_given_meshes_adapts_no_mesh(tmp_path):
    done = cost(PROBLEM, "--mesh", "squares", "--n", "2,4", "--steps", "2", "--solver", "newton", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    found = read_table(tmp_path)
    assert sorted((row["n"], row["steps"], row["target"]) for row in found) == [("2", "2", ""), ("4", "2", "")]
    assert "for 5 %: no run of this sweep is as good; the best is squares n = 4" in done.output
    assert "uncertain   errors below " in done.output


def pose(point):
    """Pose a run of the paper's scene that fails if the solver is called "kills", "raises" or "ill-posed"."""
    if point.solver == "kills" and point.n > 4:
        os.kill(os.getpid(), signal.SIGKILL)
    if point.solver == "raises":
        raise ArithmeticError("no such number")
    scene = paper_scene().without(vx.Elasticity) if point.solver == "ill-posed" else paper_scene()
    return Posed(scene, small("squares", point.n), np.linspace(0, 1, (point.steps or 2) + 1), vx.Newton(1e-8))


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "status", "words"),
    [
        ("kills", "crashed", "killed by signal 9"),
        ("raises", "crashed", "ArithmeticError: no such number"),
        ("ill-posed", "refused", "Elasticity"),
    ],
)
def test_failed_runs_have_rows_in_the_table(tmp_path, solver, status, words):
    point = replace(UNIFORM, n=5, solver=solver)
    row = run_to_row(point, partial(measure_point, pose, point, np.array([1.0]), tmp_path / "none"))
    assert (row["status"], row["n"]) == (status, 5)
    assert words in row["message"]
    assert table([row]).splitlines()[1].endswith(",0,0")


def list_children(pid):
    """Return the process ids of all children of a process."""
    return [child for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()]


def wait_for(condition):
    """Call `condition` for up to a minute, and return the first true result."""
    for _ in range(6000):
        if found := condition():
            return found
        time.sleep(0.01)
    raise AssertionError("the condition was never true")


@pytest.mark.skipif(not list(Path("/proc/self/task").glob("*/children")), reason="child processes are not listed")
@pytest.mark.long
@pytest.mark.parametrize(("sent", "code"), [("SIGKILL", -9), ("SIGINT", 130)])
def test_an_ended_sweep_leaves_no_process(tmp_path, sent, code):
    command = [sys.executable, "-m", "vemcvx", "cost", PROBLEM, *GRID, "--workers", "2", "--out", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=-3, stderr=-3) as process:
        started = wait_for(lambda: list_children(process.pid))
        process.send_signal(getattr(signal, sent))
        assert process.wait() == code
    wait_for(lambda: not any(Path(f"/proc/{one}").exists() for one in started))


def make_row(error, seconds, unknowns=10, **others):
    settings = {"family": "squares", "n": 8, "target": None, "solver": "newton", "accuracy": 1e-8, "steps": 4}
    found = {"error": error, "seconds": seconds, "unknowns": unknowns, "peak_mb": 80.0}
    return {**settings, "status": "done", **found, **others}


def test_no_run_is_better_than_a_run_on_the_front():
    assert front([], "seconds") == []
    seconds, errors = (
        [3, 1, 2, 2, 4],
        [0.1, 0.5, 0.5, 0.2, 0.0999],
    )  # the last run is hardly more accurate than the first
    found = [make_row(*pair) for pair in zip(errors, seconds, strict=True)]
    assert front(found, "seconds") == [found[1], found[3], found[0]]


def test_extremes_that_grow_with_the_mesh_are_named():
    found = [make_row(0.1, 1.0, n=n, von_mises=n**0.3, pressure=2.0 - 1.0 / n) for n in (16, 4, 8)]
    assert list(growing_extremes(found)) == [
        "the largest von Mises stress grew by a factor 1.23 from h = 0.125 to 0.0625 (squares, n = 4, 8, 16)"
    ]
    assert list(growing_extremes(found[:1])) == []


def test_the_advice_is_the_cheapest_run_that_is_accurate_enough():
    found = [make_row(0.04, 1.0), make_row(0.019, 3.0, n=32), make_row(0.018, 2.0, target=0.02, steps=9)]
    found += [make_row(0.5, 0.1), {**asdict(UNIFORM), "status": "refused", "message": "no"}]
    lines = list(advice(found, (0.05, 0.02, 0.01)))
    assert lines[0].startswith("for 5 %: use squares n = 8, 4 steps, newton at 1e-08: costs 1 s, error 4 %")
    adapted = "squares refined adaptively from n = 8"
    assert lines[1].startswith(f"for 2 %: use {adapted}, target 2 %, newton at 1e-08: costs 2 s")
    assert re.match(rf"for 1 %: no run .*{adapted}", lines[2])
    assert re.match("for 5 %: no run ", next(iter(advice(found[-1:], (0.05,)))))
    marked = [row["front_seconds"] for row in csv.DictReader(table(found).splitlines())]
    assert marked == ["1", "0", "1", "1", "0"]


@pytest.mark.long
def test_the_picture_stays_within_the_page_and_needs_no_colours():
    pytest.importorskip("matplotlib")
    found = [
        make_row(0.1 / k, 0.01 * k**2, 10 * k**2, family=family) for k in (1, 2, 4) for family in ("squares", None)
    ]
    found += [make_row(0.02, 0.3, 100, target=0.05), *(make_row(0.1, 0.02, solver=one) for one in ("osqp", "clarabel"))]
    assert_drawn_within_the_page(picture(found[:1], (0.05,), None, ""))
    drawn = picture(found, (0.05, 0.02), 0.005, "title")
    assert_drawn_within_the_page(drawn)
    runs = [line for line in drawn.axes[0].lines if "," in line.get_label()]
    assert len({line.get_marker() for line in runs}) == len(runs) == 5


def test_points_are_all_combinations_of_settings():
    grid, problem = partial(Cost, file="", mesh="squares,voronoi", n="8,16,32", steps="4,8"), read_problem(PROBLEM)
    points = grid().points(problem, (0.05, 0.01))
    assert len(points) == len(set(points)) == 2 * 3 * 2 + 2 * 2 + 4
    assert {(p.solver, p.accuracy) for p in points if p.target is None and p.n != 16} == {("newton", 1e-8)}
    work = [(p.target is not None, p.n * (p.target is None)) for p in points]
    assert work == sorted(work, reverse=True)
    assert len(grid(solver="newton,osqp", accuracy="1e-3,1e-6").points(problem, ())) == 2 * 3 * 2 * 4


def test_errors_are_compared_at_common_instants():
    courses = {steps: np.linspace(0.0, 3.0, steps + 1) for steps in (2, 3, 4, 6, 8, 9, 32)}
    assert common_instants([courses[8], courses[32]]).tolist() == [0.75, 1.5, 2.25, 3.0]
    assert common_instants([courses[6], courses[9]]).tolist() == [1.0, 2.0, 3.0]
    assert common_instants([courses[2], courses[3]]).tolist() == [3.0]
    with pytest.raises(vx.ProblemError, match=r"times\(4\) runs from 0 to 3 and times\(5\) runs from 0 to 2"):
        common_instants([courses[4], np.linspace(0.0, 2.0, 6)])
