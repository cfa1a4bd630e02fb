"""Folders that runs write to: files of others stay, one run at a time, and a killed one holds nothing up."""

from __future__ import annotations

import signal
import subprocess
import sys

import numpy as np
import pytest
from conftest import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.stepping import lock
from vemcvx.stepping.storage import Folder

TIMES = np.linspace(0.0, 1.0, 5)
OURS = {"state.npy", "checkpoint.npz", ".vemcvx"}


def run(folder, **options):
    return vx.simulate(paper_scene(cyclic), small("squares", 3), TIMES, stream=folder, **options)


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["state.npy", "checkpoint.npz", ".checkpoint.npz", "displacement.npy", ".vemcvx"])
def test_files_of_others_are_neither_written_to_nor_deleted(tmp_path, name):
    (tmp_path / name).write_bytes(b"a thesis")
    for options in ({}, {"resume": True}):
        with pytest.raises(vx.HistoryError, match=f"{name}: not made by a run of this version, so it is not touched"):
            run(tmp_path, **options)
    assert (tmp_path / name).read_bytes() == b"a thesis"


def test_what_else_is_there_stays(tmp_path):
    folder = tmp_path / "rows"
    folder.mkdir()
    (folder / "thesis.npy").write_bytes(b"a thesis")
    run(folder)
    run(folder)
    assert names(folder) >= OURS | {"thesis.npy"}
    with Folder(folder) as mine:
        mine.remove()
    assert names(folder) == {"thesis.npy"}
    assert (folder / "thesis.npy").read_bytes() == b"a thesis"


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_goes_if_it_was_made_for_the_run(tmp_path, there):
    folder = tmp_path / "rows"
    if there:
        folder.mkdir()
    run(folder)
    with Folder(folder) as mine:
        mine.remove()
    assert folder.exists() == there


def test_earlier_histories_keep_what_they_show(tmp_path):
    first = run(tmp_path)
    shown = first.displacement.copy()
    vx.simulate(paper_scene(bound=1.0), small("squares", 3), TIMES, stream=tmp_path)
    assert np.array_equal(first.displacement, shown)


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
from vemcvx.stepping.storage import Folder
held = Folder(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("sent", ["SIGKILL", "SIGTERM", "SIGINT"])
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
    def no_locks(_):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(lock, "_lock", no_locks)
    run(tmp_path)
    assert "cannot be locked ([Errno 37] No locks available); see to it that no two runs share" in caplog.text


@pytest.mark.parametrize(
    "wrong", [5, True, 1.5, b"rows", ["rows"], "", "a\0b", "\ud800", "x" * 300, "x/" + "y" * 300, object()], ids=repr
)
def test_what_is_no_folder_is_said(wrong, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(vx.HistoryError, match="wanted a path, such as|cannot be made a folder"):
        run(wrong)
