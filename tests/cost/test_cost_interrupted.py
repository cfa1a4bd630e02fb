"""Sweeps that end before their time: nothing of theirs stays behind, and the next one mends what is damaged."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from test_cost import GRID, PROBLEM, ROOT, UNIFORM, Recipe, cost, made, stay_at_home

import vemcvx as vx
from vemcvx.base.owned_files import Owned
from vemcvx.cost.sweeping import Grid, finished_row, read_reference, sweep
from vemcvx.cost.table import append, read_journal
from vemcvx.cost.workers import Crashed, alone

LINUX = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")
SMALLEST = Grid(("squares",), (2,), (2,), ("newton",), (1e-8,), (0.5,), adaptive=False)


def children(pid):
    """Processes that a process has started, and theirs."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if state != "Z":
            parents.setdefault(int(parent), []).append(int(stat.parent.name))
    found = parents.get(pid, [])
    return found + [one for child in found for one in children(child)]


def wait_for(what):
    """Until something holds; how long that takes is not judged."""
    for _ in range(6000):
        if found := what():
            return found
        time.sleep(0.01)
    raise AssertionError("it never did")


def ended(command, sent, folder):
    """End a command while it has a process of its own at work; all that it started must end, and leave no files."""
    environment = {**os.environ, "TMPDIR": str(folder)}
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=-3, stderr=-3) as process:
        started = wait_for(lambda: children(process.pid))
        process.send_signal(getattr(signal, sent))
        process.wait()
    wait_for(lambda: not any(Path(f"/proc/{one}").exists() for one in started))
    assert list(folder.iterdir()) == []
    return process.returncode


@pytest.mark.long
@LINUX
@pytest.mark.parametrize("sent", ["SIGKILL", pytest.param("SIGINT", marks=pytest.mark.slow)])
def test_a_process_ends_with_the_one_that_started_it(tmp_path, sent):
    program = "import time; from vemcvx.cost.workers import alone; alone(time.sleep, 3600)"
    ended([sys.executable, "-c", program], sent, tmp_path)


@LINUX
@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code"), [("SIGKILL", -9), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_sweep_that_is_ended_leaves_nothing_at_work(tmp_path, sent, code):
    folders = tmp_path / "out", tmp_path / "tmp"
    folders[1].mkdir()
    command = [sys.executable, "-m", "vemcvx", "cost", PROBLEM, *GRID, "--workers", "2", "--out", str(folders[0])]
    assert ended(command, sent, folders[1]) == code
    # And it goes on.
    assert cost(PROBLEM, *GRID, "--out", folders[0]).exit_code == 0


def leave(code):
    print("said before")
    os._exit(code)


def talk():
    print("said")
    os.write(1, b"written")
    return "answered"


@pytest.mark.long
def test_what_a_function_says_does_not_come_between():
    with pytest.raises(Crashed, match="said before"):
        alone(leave, 0)
    assert alone(talk) == "answered"


@pytest.fixture
def at_home(monkeypatch):
    stay_at_home(monkeypatch)


@pytest.mark.long
@pytest.mark.usefixtures("at_home")
def test_a_damaged_reference_is_computed_again_and_no_point_suffers(tmp_path):
    first = sweep(Recipe(), SMALLEST, tmp_path, workers=1)
    file = tmp_path / "reference.npz"
    file.write_bytes(file.read_bytes()[:-100])
    assert read_reference(tmp_path) is None
    again = sweep(Recipe(), replace(SMALLEST, ns=(2, 3)), tmp_path, workers=1)
    assert {row.status for row in again.rows} == {"done"}
    assert again.reference.digest == read_reference(tmp_path).digest
    assert first.reference.seconds != again.reference.seconds


@pytest.mark.long
@pytest.mark.usefixtures("at_home")
def test_a_point_that_finds_no_reference_is_tried_again(tmp_path):
    reference = sweep(Recipe(), SMALLEST, tmp_path, workers=1).reference
    (tmp_path / "reference.npz").write_bytes(b"damaged")
    row = finished_row(Recipe(), replace(UNIFORM, n=2, steps=2), "key", tmp_path, reference)
    assert row.status == "crashed"
    append(tmp_path / "journal", row)
    assert read_journal(tmp_path / "journal") == {}


@pytest.mark.long
@pytest.mark.usefixtures("at_home")
def test_references_of_other_kinds_are_none(tmp_path):
    made = sweep(Recipe(), SMALLEST, tmp_path, workers=1).reference
    told = json.loads((tmp_path / "reference.json").read_text())
    assert read_reference(tmp_path) == made
    for name in told:
        for other in ([[]], {"a": 1}, "x" if name not in ("problem", "digest") else 5, float("nan")):
            (tmp_path / "reference.json").write_text(json.dumps({**told, name: other}))
            assert read_reference(tmp_path) is None, (name, other)
    for text in ("[]", "5", "{}", "[" * 10**5, "\x00"):
        (tmp_path / "reference.json").write_text(text)
        assert read_reference(tmp_path) is None


def test_journals_with_values_of_other_kinds(tmp_path):
    path, row = tmp_path / "journal", made(0.1, 1.0)
    append(path, row)
    whole = json.loads(path.read_text())
    for name in whole:
        for other in ([1], {"a": 1}, "x" if not isinstance(whole[name], str) else 5, float("nan"), True):
            path.write_text(json.dumps({**whole, name: other}) + "\n")
            kept = read_journal(path)
            assert kept == {}, (name, other)
    for name in ("error", "seconds", "unknowns"):
        path.write_text(json.dumps({**whole, name: None}) + "\n")
        assert read_journal(path) == {}
    path.write_text("[" * 10**5 + "\n" + json.dumps(whole) + "\n")
    assert read_journal(path) == {row.key: row}


@pytest.mark.parametrize("name", ["journal.jsonl", "cost.csv", "cost.png", "reference.npz", "reference.json"])
@pytest.mark.parametrize("options", [(), ("--fresh",)], ids=["", "fresh"])
def test_files_of_others_stay(tmp_path, name, options):
    (tmp_path / name).write_text("a thesis")
    done = cost(PROBLEM, *GRID, "--out", tmp_path, *options)
    assert done.exit_code == 2
    assert f"{name}: not made by a run of this version, so it is not touched" in " ".join(done.output.split())
    assert (tmp_path / name).read_text() == "a thesis"


def test_one_sweep_a_folder(tmp_path):
    with Owned(tmp_path / "out"):
        done = cost(PROBLEM, *GRID, "--out", tmp_path / "out")
        assert done.exit_code == 2
        assert "another run is writing there" in " ".join(done.output.split())
        with pytest.raises(vx.HistoryError, match="another run is writing there"):
            sweep(Recipe(), SMALLEST, tmp_path / "out")
