"""A run locks its output folder, and keeps foreign files."""

from __future__ import annotations

import signal
import subprocess
import sys

import numpy as np
import pytest
from scenes import cyclic, mostly_long, paper_scene, small
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli import run as simulation
from vemcvx.stepping import Folder

TIMES = np.linspace(0.0, 1.0, 5)
BUSY = "another run is writing there"


def run(folder, times=TIMES, **options):
    return vx.simulate(paper_scene(cyclic), small("squares", 3), times, stream=folder, **options)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@mostly_long("name", ["state.npy", "checkpoint.npy", "displacement.npy", ".vemcvx"], 0, 3)
def test_foreign_files_are_neither_written_nor_deleted(tmp_path, name):
    (tmp_path / name).write_bytes(b"a thesis")
    for resume in (False, True):
        with pytest.raises(vx.HistoryError, match=f"{name}: not made by a run of this version"):
            run(tmp_path, resume=resume)
    assert contents(tmp_path)[name] == b"a thesis"


HOLD = """
import sys
from vemcvx.stepping.trajectory import Folder
held = Folder(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.long
@pytest.mark.parametrize("sent", ["SIGKILL", pytest.param("SIGTERM", marks=pytest.mark.slow)])
def test_a_killed_process_releases_its_folder(tmp_path, sent):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=-1, stdout=-1, stderr=-1) as other:
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(vx.HistoryError, match=BUSY):
            Folder(tmp_path)
        other.send_signal(getattr(signal, sent))
        other.wait()
        Folder(tmp_path).close()


def invoke(*arguments):
    words = "run", "feng_han_huang", "--n", "3", "--steps", "3", *map(str, arguments)
    return CliRunner().invoke(app, words)


@pytest.mark.long
def test_a_command_whose_write_failed_is_resumed(tmp_path, monkeypatch, caplog):
    def full(*_, **__):
        raise vx.HistoryError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(simulation, "write_results", full)
        assert invoke("--out", tmp_path, "--store", "last").exit_code == 2
    caplog.set_level("INFO", logger="vemcvx")
    done = invoke("--resume", tmp_path, "--store", "last")
    assert done.exit_code == 0, done.output
    assert "resuming after step 3 of 3" in caplog.text
    assert "holds no interrupted run" in invoke("--resume", tmp_path).output
