"""`vemcvx cost`: rows are what simulate gives, a killed sweep goes on, failures are rows, a cluster gives the same."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pages import assert_drawn_within_the_page
from scenes import paper_scene, small
from typer.testing import CliRunner

import feng_han_huang
import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cost import Ingredients, Point, Row, advice, front
from vemcvx.cost.sweeping import (
    REFERENCE_PART,
    Grid,
    Reference,
    build_reference,
    common_instants,
    errors,
    finished_row,
    read_reference,
    run_point,
)
from vemcvx.cost.table import append, read_journal, table, without_limit
from vemcvx.cost.workers import alone
from vemcvx.estimate.measures import energy_distance
from vemcvx.results.files import peak_memory_mb, read_archive

ROOT = Path(vx.__file__).parent.parent
PROBLEM = str(ROOT / "problems" / "feng_han_huang.py")
GRID = ("--mesh", "squares", "--n", "2,4,6", "--steps", "4", "--solver", "newton", "--target", "0.4")
UNIFORM = Point("squares", 4, 4, "newton", 1e-8)
NUMBERS = ("cells", "unknowns", "steps", "error", "error_end", "estimated", "certificate")


def cost(*arguments):
    return CliRunner().invoke(app, ["cost", *map(str, arguments)])


def journal(folder):
    """The rows without their seals."""
    path = folder / "journal.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    return [{key: value for key, value in json.loads(line).items() if key != "seal"} for line in lines]


def rows(folder):
    with (folder / "cost.csv").open() as stream:
        return list(csv.DictReader(stream))


def stay_at_home(monkeypatch):
    """Every run of a sweep in this process, which is quicker."""
    monkeypatch.setattr("vemcvx.cost.workers.alone", lambda function, *given: function(*given))


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """A sweep killed after its first point, a torn line in its journal, and what it says when it is started again."""
    folder = tmp_path_factory.mktemp("sweep")
    command = [sys.executable, "-m", "vemcvx", "cost", PROBLEM, *GRID, "--workers", "1", "--out", str(folder)]
    env = {**os.environ, "TMPDIR": str(tmp_path_factory.mktemp("tmp"))}
    process = subprocess.Popen(command, cwd=ROOT, env=env, start_new_session=True)
    try:
        while not journal(folder):
            assert process.poll() is None
            time.sleep(0.02)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    before = journal(folder)
    with (folder / "journal.jsonl").open("a") as stream:
        stream.write('{"family": "squares", "n": 2, "ta')
    with pytest.MonkeyPatch.context() as patch:
        stay_at_home(patch)
        return folder, before, cost(PROBLEM, *GRID, "--workers", "1", "--out", folder)


@pytest.mark.long
def test_a_killed_sweep_goes_on_and_repeats_nothing(killed):
    folder, before, done = killed
    assert done.exit_code == 0, done.output
    assert 1 <= len(before) < 4
    assert f"points      4, {len(before)} of them finished before" in done.output
    kept = read_journal(folder / "journal.jsonl")
    assert len(kept) == 4
    # To the bit, seconds and time of day among them.
    assert [asdict(kept[row["key"]]) for row in before] == before
    whole = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines() if line.endswith("}")]
    keys = [row["key"] for row in whole]
    assert len(keys) == len(set(keys)) == 4
    assert sorted(row["key"] for row in rows(folder)) == sorted(keys)
    assert [(row["target"], row["n"]) for row in rows(folder)] == [("", "2"), ("", "4"), ("", "6"), ("0.4", "2")]


@pytest.mark.long
def test_rows_are_what_simulate_gives(killed):
    folder, _, _ = killed
    reference = read_archive(folder / "reference.npz")
    instants = [0.25, 0.5, 0.75, 1.0]
    assert reference.times.tolist() == [0.0, *instants] or reference.times.tolist() == instants
    for row in rows(folder):
        if row["target"]:
            wanted = np.append(0.0, instants)
            history = vx.adapt(paper_scene(), vx.meshes.squares(2), wanted, 0.4, solver=vx.Newton(1e-8)).history
        else:
            history = vx.simulate(paper_scene(), vx.meshes.squares(int(row["n"])), np.linspace(0, 1, 5))
        apart = [energy_distance(history, reference, time=t) for t in instants]
        scale = max(found.reference for found in apart)
        # The same arithmetic in another process.
        assert float(row["error"]) == pytest.approx(max(found.absolute for found in apart) / scale, rel=1e-9)
        assert float(row["error_end"]) == pytest.approx(apart[-1].absolute / scale, rel=1e-9)
        assert float(row["estimated"]) == pytest.approx(vx.error_budget(history, None).largest["total"], rel=1e-6)
        assert float(row["certificate"]) == pytest.approx(history.certified_total.max(), abs=1e-12)
        assert int(row["cells"]) == history.mesh.n_cells
        assert int(row["unknowns"]) == history.trajectory.state.shape[1]
        assert int(row["steps"]) == history.steps
        parts = [float(row[name]) for name in ("assemble", "prepare", "solve", "adapt")]
        assert min(parts[:3]) > 0
        assert (parts[3] > 0) == bool(row["target"])
        assert float(row["seconds"]) == pytest.approx(sum(parts))
        assert float(row["wall"]) > int(row["repeats"]) / 3 * float(row["seconds"])


@pytest.mark.long
def test_it_says_what_to_use_and_how_certain_the_reference_is(killed):
    folder, _, done = killed
    reference = read_reference(folder)
    assert reference.goal == 0.1
    assert reference.estimated <= 0.1
    assert f"its own error estimated {reference.estimated:.2%} (wanted: 10.00%)" in done.output
    good = [row for row in rows(folder) if float(row["error"]) <= 0.4]
    cheapest = min(good, key=lambda row: float(row["seconds"]))
    assert f"costs {float(cheapest['seconds']):.2g} s, error" in done.output
    pytest.importorskip("matplotlib")
    assert (folder / "cost.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_who_says_n_gets_these_meshes_and_no_finer_ones(tmp_path, monkeypatch):
    """Nothing is adapted, and the reference is as fine as the errors of these runs need: a quarter of the smallest."""
    stay_at_home(monkeypatch)
    asked = ("--mesh", "squares", "--n", "2,4", "--steps", "2", "--solver", "newton", "--workers", "1")
    done = cost(PROBLEM, *asked, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    found = rows(tmp_path)
    assert sorted((row["n"], row["steps"], row["target"]) for row in found) == [("2", "2", ""), ("4", "2", "")]
    finest = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(4), feng_han_huang.times(2))
    told = json.loads((tmp_path / "reference.json").read_text())
    # It is rounded to two digits.
    assert told["goal"] == pytest.approx(REFERENCE_PART * vx.error_budget(finest).largest["total"], rel=0.05)
    assert told["estimated"] <= told["goal"]
    assert min(float(row["error"]) for row in found) <= 0.5
    assert "for 50 %: use squares n = " in done.output


@pytest.mark.long
def test_errors_may_be_those_of_friction_work(tmp_path, monkeypatch):
    stay_at_home(monkeypatch)
    asked = ("--mesh", "squares", "--n", "3,6", "--steps", "2", "--solver", "newton", "--workers", "1")
    done = cost(PROBLEM, *asked, "--target", ".2", "--of", "dissipated", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    told, found = json.loads((tmp_path / "reference.json").read_text()), rows(tmp_path)
    assert told["of"] == "dissipated"
    assert told["estimated"] <= told["goal"] == 0.05
    assert f"errors      of the energy that friction dissipates at the end, {told['value']:.6g} by the" in done.output
    assert sorted((row["n"], row["target"]) for row in found) == [("3", ""), ("3", "0.2"), ("6", "")]
    for row in found:
        value = float(row["value"])
        assert float(row["error"]) == pytest.approx(abs(value - told["value"]) / told["value"])
        if not row["target"]:
            run = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(int(row["n"])), feng_han_huang.times(2))
            assert value == pytest.approx(run.dissipated_second_order[-1])
            assert float(row["estimated"]) == pytest.approx(vx.quantities(run)["dissipated"].relative)
        else:
            assert float(row["error"]) <= 0.2
    assert "--of: found 'heat'; errors are of energy" in cost(PROBLEM, "--of", "heat").output


@pytest.mark.long
def test_a_finer_reference_moves_errors_by_no_more_than_its_own(tmp_path):
    recipe, instants, found = Recipe(), np.array([0.5, 1.0]), []
    history, _ = run_point(recipe, UNIFORM, instants)
    for goal in (0.1, 0.04):
        reference = build_reference(recipe, UNIFORM, UNIFORM, instants, goal, tmp_path)
        assert reference.estimated <= goal
        assert read_reference(tmp_path) == reference
        found.append(errors(history, tmp_path, reference)[0])
    assert found[0] != found[1]
    assert abs(found[0] - found[1]) <= 0.1 + 0.04


def test_references_serve_what_they_were_made_for():
    made = Reference("p", (0.5, 1.0), 0.01, 0.009, 8, 4, True, False, 1, 1, 1, 0.0)
    finest = replace(UNIFORM, n=16)
    assert made.serves("p", [0.5, 1.0], 0.0095, finest)
    assert not made.serves("p", [0.5, 1.0], 0.008, finest)
    assert not made.serves("other", [0.5, 1.0], 0.01, finest)
    assert not made.serves("p", [1.0], 0.01, finest)
    # As good as memory allows is not tried again.
    assert replace(made, estimated=0.02).serves("p", [0.5, 1.0], 0.01, finest)
    uniform = replace(made, estimated=None, adapted=False)
    assert not uniform.serves("p", [0.5, 1.0], 0.01, finest)
    assert uniform.serves("p", [0.5, 1.0], 0.01, replace(finest, n=8))


@dataclass(frozen=True)
class Recipe:
    """The paper's scene; some solvers' names bring trouble."""

    mark: str = "paper"

    def __call__(self, point):
        if point.solver == "kills" and point.n > 4:
            os.kill(os.getpid(), signal.SIGKILL)
        if point.solver == "raises":
            raise ArithmeticError("no such number")
        solver = vx.Newton(1e-8)
        scene = paper_scene().without(vx.Elasticity) if point.solver == "ill-posed" else paper_scene()
        if point.solver == "viscous":
            scene = scene.with_(vx.Viscosity(10.0, 10.0))
        return Ingredients(scene, small("squares", point.n), np.linspace(0, 1, (point.steps or 2) + 1), solver)


@pytest.mark.long
@pytest.mark.parametrize(
    ("solver", "status", "words"),
    [
        ("kills", "crashed", "killed by signal 9, as the system does"),
        ("raises", "crashed", "ArithmeticError: no such number"),
        ("ill-posed", "refused", "Elasticity"),
    ],
)
def test_failures_are_rows(tmp_path, solver, status, words):
    reference = Reference("paper", (1.0,), 0.1, 0.1, 4, 4, True, False, 1, 1, 1, 0.0)
    row = finished_row(Recipe(), replace(UNIFORM, n=5, solver=solver), "key", tmp_path, reference)
    assert (row.status, row.error, row.key) == (status, None, "key")
    assert words in row.message
    append(tmp_path / "journal", row)
    # What crashed may have lacked memory, and is tried again; what was refused is refused for good.
    assert list(read_journal(tmp_path / "journal")) == (["key"] if status == "refused" else [])


def hold(megabytes):
    return len(np.ones(megabytes * 2**17)), peak_memory_mb(), os.environ["OMP_NUM_THREADS"]


@pytest.mark.long
def test_memory_is_that_of_the_run_alone():
    mine = np.ones(200 * 2**17)
    length, peak, threads = alone(hold, 50)
    assert length == 50 * 2**17
    # Its 50 MB beside the 80 MB of a process that has imported the package, and not ours.
    assert 50 < peak < 200 < peak_memory_mb()
    assert threads == "1"
    assert len(mine) == 200 * 2**17


def made(error, seconds, unknowns=10, **others):
    settings = {"family": "squares", "n": 8, "target": None, "solver": "newton", "accuracy": 1e-8, "steps": 4}
    found = {"error": error, "seconds": seconds, "unknowns": unknowns, "peak_mb": 80.0}
    return Row(**{**settings, "status": "done", "key": f"{error} {seconds}", **found, **others})


def test_journals_survive_torn_lines(tmp_path):
    path, one, two = tmp_path / "journal", made(0.1, 1.0), made(0.2, 2.0)
    assert read_journal(path) == {}
    append(path, one)
    whole = path.read_bytes()
    for cut in (1, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole + whole[:cut])
        append(path, two)
        again = read_journal(path)
        assert again == {one.key: one, two.key: two}
    path.write_text('{"of": "another format"}\n[]\n\xff\n')
    assert read_journal(path) == {}
    with pytest.raises(vx.HistoryError, match="cannot write the journal"):
        append(tmp_path, one)


def test_the_front_is_what_nothing_beats():
    assert front([], []) == []
    assert front([3.0, 1.0, 2.0, 2.0, 4.0], [0.1, 0.5, 0.5, 0.2, 0.0999]) == [1, 3, 0]
    rng = np.random.default_rng(0)
    costs, errors = np.exp(rng.normal(size=(2, 200)))
    kept = front(costs.tolist(), errors.tolist())
    for k in range(200):
        as_good = (costs <= costs[k]) & (errors <= errors[k]) & (np.arange(200) != k)
        if as_good.any():
            assert k not in kept
        elif k not in kept:
            cheaper = errors[costs < costs[k]].min()
            assert errors[k] > 0.99 * cheaper


def test_extremes_without_a_limit_are_told():
    def row(n, peak):
        return Row("squares", n, None, "newton", 1e-8, 8, "done", str(n), von_mises=peak, pressure=2.0 - 1.0 / n)

    rows = [row(n, n**0.3) for n in (16, 4, 8)]
    assert without_limit(rows) == [
        "the largest von Mises stress grew by a factor 1.23 from h = 0.125 to 0.0625 (squares, n = 4, 8, 16)"
    ]
    assert without_limit(rows[:1]) == []


def test_advice_is_the_cheapest_run_that_is_good_enough():
    found = [made(0.04, 1.0), made(0.019, 3.0, n=32), made(0.018, 2.0, target=0.02, steps=9), made(0.5, 0.1)]
    found.append(Row("squares", 8, None, "osqp", 1e-3, 4, "refused", "r", message="no"))
    lines = advice(found, (0.05, 0.02, 0.01))
    assert lines[0].startswith(
        "for 5 %: use squares n = 8, 4 steps, newton at 1e-08: costs 1 s, error 4 % (10 unknowns"
    )
    assert lines[1].startswith(
        "for 2 %: use squares refined adaptively from n = 8, target 2 %, newton at 1e-08: costs 2 s"
    )
    assert lines[2].startswith("for 1 %: no run of this sweep is as good; the best is squares refined adaptively")
    assert advice(found[-1:], (0.05,)) == ["for 5 %: no run of this sweep has an answer."]
    marked = {row["key"]: row["front_seconds"] for row in csv.DictReader(table(found).splitlines())}
    assert marked == {"0.04 1.0": "1", "0.019 3.0": "0", "0.018 2.0": "1", "0.5 0.1": "1", "r": "0"}


@pytest.mark.long
def test_the_picture_stays_within_the_page():
    pytest.importorskip("matplotlib")
    from vemcvx.cost.table import picture

    found = [made(0.1 / k, 0.01 * k**2, 10 * k**2, family=family) for k in (1, 2, 4) for family in ("squares", None)]
    found += [made(0.02, 0.3, 100, target=0.05), made(0.1, 0.02, solver="osqp")]
    for drawn in (picture(found, (0.05, 0.02), 0.005, "title"), picture(found[:1], (0.05,), None)):
        assert_drawn_within_the_page(drawn)
    # Families and solvers are apart without their colours, too.
    found += [made(0.1, 0.03, solver="clarabel")]
    drawn = picture(found, (0.05, 0.02), 0.005, "title")
    runs = [line for line in drawn.axes[0].lines if "," in line.get_label()]
    marks = {line.get_label().split(",")[0]: line.get_marker() for line in runs}
    assert len(set(marks.values())) == len(marks) == 2
    assert len({(line.get_marker(), line.get_markersize(), line.get_fillstyle()) for line in runs}) == len(runs) == 5


def test_grids():
    grid = Grid(("squares", "voronoi"), (8, 16, 32), (4, 8), None, None, (0.05, 0.01))
    points = grid.points
    assert len(points) == len(set(points)) == 2 * 3 * 2 + 2 * 2 + 4
    assert {(p.solver, p.accuracy) for p in points if p.target is None and p.n != 16} == {("newton", 1e-8)}
    assert [p.work for p in points] == sorted((p.work for p in points), reverse=True)
    product = replace(grid, solvers=("newton", "osqp"), accuracies=(1e-3, 1e-6), adaptive=False)
    assert len(product.points) == 2 * 3 * 2 * 4
    keys = {point.key(mark) for point in points for mark in ("a", "b")}
    assert len(keys) == 2 * len(points)


def test_instants_are_those_that_all_have():
    def course(steps):
        return np.linspace(0.0, 3.0, steps + 1)

    assert common_instants([course(8), course(32)]).tolist() == [0.75, 1.5, 2.25, 3.0]
    assert common_instants([course(6), course(9)]).tolist() == [1.0, 2.0, 3.0]
    assert common_instants([course(2), course(3)]).tolist() == [3.0]
    with pytest.raises(vx.ProblemError, match=r"times\(4\) runs from 0 to 3, times\(5\) from 0 to 2"):
        common_instants([course(4), np.linspace(0.0, 2.0, 6)])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--n", "8,x"), r"--n: found '8,x'; wanted whole numbers from 1"),
        (("--n", "0"), r"--n: found '0'"),
        (("--steps", ","), r"--steps: found ','; wanted whole numbers from 1"),
        (("--target", "5"), r"--target: found '5'; wanted relative errors between 0 and 1"),
        (("--accuracy", "nan"), r"--accuracy: found 'nan'"),
        (("--mesh", "squares,pentagons"), r"--mesh: there is no family 'pentagons'; there are squares"),
        (("--solver", "newtn"), r"--solver: there is no solver 'newtn'; there are newton"),
        (("--workers", "0"), r"--workers: found 0; wanted at least one"),
        (("--set", "grip=1"), r"--set: .* has no parameter 'grip'"),
    ],
)
def test_mistakes_are_told_before_anything_runs(tmp_path, arguments, says):
    done = cost(PROBLEM, "--out", tmp_path / "out", *arguments)
    assert done.exit_code == 2
    assert re.search(says, done.output), done.output
    assert not (tmp_path / "out").exists()


def test_clusters_that_are_not_there(tmp_path, monkeypatch):
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "distributed", None)
        done = cost(PROBLEM, "--out", tmp_path, "--scheduler", "tcp://127.0.0.1:1")
        assert done.exit_code == 2
        assert "pip install 'vemcvx[cluster]'" in done.output
    pytest.importorskip("distributed")
    import dask

    with dask.config.set({"distributed.comm.timeouts.connect": 0.2}):
        done = cost(PROBLEM, "--out", tmp_path, "--scheduler", "tcp://127.0.0.1:1")
    assert done.exit_code == 2
    assert "no dask scheduler answers at 'tcp://127.0.0.1:1'" in done.output


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_numbers(killed, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        done = cost(PROBLEM, *GRID, "--out", tmp_path, "--scheduler", cluster.scheduler_address)
    assert done.exit_code == 0, done.output
    here, there = rows(killed[0]), rows(tmp_path)
    assert len(here) == 4
    for name in (*NUMBERS, "family", "n", "target", "solver", "accuracy", "status"):
        assert [row[name] for row in here] == [row[name] for row in there], name


TWO_MATERIALS = '''"""Two materials."""
import numpy as np, vemcvx as vx

def scene():
    young = lambda x: np.where(x[:, 0] < 0.5, 100.0, 200.0)
    push = vx.Traction(lambda x, t: np.tile([0.0, -t], (len(x), 1)), on="top")
    return vx.Scene(vx.Elasticity(young, 0.3), vx.Clamp(on="bottom"), push)

def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n)

def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)
'''


@pytest.mark.slow
def test_cells_across_the_border_of_two_materials_are_told(tmp_path, monkeypatch):
    """Of three squares a side one column lies across the border, of an even number none."""
    stay_at_home(monkeypatch)
    (tmp_path / "two.py").write_text(TWO_MATERIALS)
    asked = ("--mesh", "squares", "--n", "3,4", "--steps", "2", "--solver", "newton", "--workers", "1")
    done = cost(tmp_path / "two.py", *asked, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    said = {row["n"]: row["message"] for row in rows(tmp_path / "out")}
    assert said["3"].startswith("in places the material of its mesh is not that of the reference's mesh")
    assert not said["4"]


@pytest.mark.slow
def test_scenes_without_an_estimate_have_a_reference(tmp_path):
    point, instants = replace(UNIFORM, solver="viscous"), np.array([0.5, 1.0])
    reference = build_reference(Recipe(), point, point, instants, 0.1, tmp_path)
    assert (reference.estimated, reference.cells, reference.made) == (None, 64, 16)
    history, columns = run_point(Recipe(), point, instants)
    assert columns["estimated"] is None
    assert 0 < errors(history, tmp_path, reference)[0] < 0.5


@pytest.mark.long
def test_bounds_stand_beside_estimates(tmp_path, monkeypatch):
    """Guaranteed, they are no smaller than the true error, but for what the reference is off by."""
    stay_at_home(monkeypatch)
    given = ("--mesh", "squares", "--n", "4,6", "--steps", "4", "--solver", "newton", "--no-adaptive")
    done = cost(PROBLEM, *given, "--bound", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    reference = json.loads((tmp_path / "reference.json").read_text())
    for row in journal(tmp_path):
        assert row["bound_of"] == "history"
        assert row["bound"] >= row["error"] - reference["estimated"]
        assert row["bound"] <= 2.0 * row["error"]
    assert "times the true error, guaranteed" in done.output
    assert (tmp_path / "effectivity.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_bounds_of_steps_are_told_apart(tmp_path):
    scene = paper_scene().without(vx.BilateralContact).with_(vx.UnilateralContact(on="bottom"))
    made = Ingredients(scene, vx.meshes.squares(3), np.linspace(0.0, 1.0, 3), vx.Newton(1e-8))
    _, columns = run_point(lambda point: made, replace(UNIFORM, bounded=True), np.array([1.0]))
    history = made.simulated()
    assert columns["bound_of"] == "step"
    assert columns["bound"] == pytest.approx(float(vx.error_bound(history, step=-1).relative), rel=1e-6)


def test_bounds_are_of_the_energy_norm(tmp_path):
    done = cost(PROBLEM, *GRID, "--bound", "--of", "work", "--out", tmp_path)
    assert done.exit_code == 2
    assert "omit --of work" in done.output
