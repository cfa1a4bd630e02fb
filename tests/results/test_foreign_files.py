"""Folders that runs write to: files of others stay, one run at a time, and a killed one holds nothing up."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import cyclic, mostly_long, paper_scene, small
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli import run as simulation
from vemcvx.stepping import Folder

TIMES = np.linspace(0.0, 1.0, 5)
OURS = {"state.npy", "checkpoint.npy", ".vemcvx"}


def run(folder, **options):
    return vx.simulate(paper_scene(cyclic), small("squares", 3), TIMES, stream=folder, **options)


def names(folder):
    return {path.name for path in folder.iterdir()}


@mostly_long("name", ["state.npy", "checkpoint.npy", "displacement.npy", ".vemcvx"], 0, 3)
def test_files_of_others_are_neither_written_to_nor_deleted(tmp_path, name):
    (tmp_path / name).write_bytes(b"a thesis")
    for options in ({}, {"resume": True}):
        with pytest.raises(vx.HistoryError, match=f"{name}: not made by a run of this version, so it is not touched"):
            run(tmp_path, **options)
    assert (tmp_path / name).read_bytes() == b"a thesis"


@pytest.mark.long
def test_a_mistake_leaves_the_earlier_run_as_it_was(tmp_path):
    run(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(vx.SceneError):
        vx.simulate(paper_scene(cyclic), small("squares", 3), [1.0, 0.0], stream=tmp_path)
    with pytest.raises(vx.NotAccepted):
        run(tmp_path, solver=vx.Direct())
    with pytest.raises(vx.SceneError, match="initial"):
        run(tmp_path, initial="unsettled")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.long
def test_the_second_of_two_runs_is_refused(tmp_path):
    told = []

    def another(n, _):
        if n == 2:
            with pytest.raises(vx.HistoryError, match="another run is writing there. Wait until it ha"):
                run(tmp_path)
            with pytest.raises(vx.HistoryError, match="another run is writing there"):
                run(tmp_path, resume=True)
            told.append(n)

    first = run(tmp_path, progress=another)
    assert told == [2]
    assert np.array_equal(first.displacement, vx.simulate(first.scene, first.mesh, TIMES).displacement)
    # And it is let go of at the end, and by a run that fails.
    with pytest.raises(ZeroDivisionError):
        run(tmp_path, progress=lambda *_: 1 / 0)
    run(tmp_path)


HELD = """
import sys
from vemcvx.stepping.trajectory import Folder
held = Folder(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


SLOW = [pytest.param(sent, marks=pytest.mark.slow) for sent in ("SIGTERM", "SIGINT")]


@pytest.mark.long
@pytest.mark.parametrize("sent", ["SIGKILL", *SLOW])
def test_a_process_that_is_killed_holds_nothing(tmp_path, sent):
    command = [sys.executable, "-c", HELD, str(tmp_path)]
    with subprocess.Popen(command, stdin=-1, stdout=-1, stderr=-1) as other:
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(vx.HistoryError, match="another run is writing there"):
            Folder(tmp_path)
        other.send_signal(getattr(signal, sent))
        other.wait()
        Folder(tmp_path).close()


def test_where_files_cannot_be_locked_it_is_said(tmp_path, monkeypatch, caplog):
    def no_locks(*_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(pytest.importorskip("fcntl"), "flock", no_locks)
    run(tmp_path)
    assert "cannot be locked ([Errno 37] No locks available); make sure that no two runs share" in caplog.text


PROBLEM = str(Path(vx.__file__).parent.parent / "problems" / "feng_han_huang.py")
SMALL = ("--n", "3", "--steps", "3")


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in ("run", PROBLEM, *SMALL, *arguments)])


@pytest.mark.parametrize("name", ["rows/state.npy", "history.npz"])
def test_a_command_replaces_nothing_of_others(tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("a thesis")
    done = invoke("--out", tmp_path)
    assert done.exit_code == 2
    assert path.read_text() == "a thesis"
    assert names(path.parent) == {path.name}


def test_of_two_commands_the_second_is_refused(tmp_path):
    with Folder(tmp_path / "rows"):
        for options in (("--out", tmp_path), ("--out", tmp_path, "--target", 0.5)):
            done = invoke(*options)
            assert done.exit_code == 2
            assert "another run is writing there" in " ".join(done.output.split())
    assert names(tmp_path) == set()


@pytest.mark.slow
def test_commands_at_once_leave_the_history_of_one(tmp_path):
    commands = [[*SMALL, "--set", f"bound={bound}", "--out", tmp_path / "out"] for bound in range(1, 5)]
    program = [sys.executable, "-m", "vemcvx", "run", PROBLEM]
    for _ in range(3):
        at_once = [subprocess.Popen([*program, *map(str, one)], stdout=-3, stderr=-3) for one in commands]
        codes = [one.wait() for one in at_once]
        assert set(codes) <= {0, 2}
        assert 0 in codes
        history = vx.read_history(tmp_path / "out")
        bound = history.contact.bound.max()
        assert codes[int(bound) - 1] == 0
        told = json.loads((tmp_path / "out" / "summary.json").read_text())
        assert told["dissipated"] == history.dissipated[-1]
        assert names(tmp_path / "out") >= {"history.npz"}
        assert not (tmp_path / "out" / "rows").exists()


@pytest.mark.long
def test_a_command_says_where_it_went_on(tmp_path, monkeypatch):
    write = simulation.write_results

    def full(*_):
        raise vx.HistoryError("the disk is full")

    monkeypatch.setattr(simulation, "write_results", full)
    assert invoke("--out", tmp_path, "--store", "last").exit_code == 2
    monkeypatch.setattr(simulation, "write_results", write)
    done = invoke("--resume", tmp_path, "--store", "last")
    assert done.exit_code == 0, done.output
    assert "resumed     after step 3 of 3" in done.output
    assert "holds no interrupted run" in invoke("--resume", tmp_path).output
