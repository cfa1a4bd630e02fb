"""Nothing of a user's is lost: marks that lie, links, processes that die at any move of a file."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import paper_scene, small

import vemcvx as vx
from vemcvx.base.owned_files import MARK
from vemcvx.results.files import WRITING
from vemcvx.stepping.trajectory import Folder

TIMES = np.linspace(0.0, 1.0, 4)
PATHS = ["..", "", ".", "/tmp", "../thesis", "a/b.npy", "a\0.npy", "x\\y.npy"]
HOSTILE = [*PATHS, "thesis.txt", "thesis", "..npy", ".vemcvx"]


def history(bound=4.0, times=TIMES, stream=None):
    return vx.simulate(paper_scene(bound=bound), small("squares", 3), times, stream=stream)


def everything(folder):
    """path -> bytes of all files below a folder, marks left out."""
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file() and path.name != MARK}


def mark(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).write_text("".join(f"{line}\n" for line in ("vemcvx files 1", *names)))


@pytest.mark.parametrize("name", HOSTILE, ids=repr)
@pytest.mark.parametrize("use", ["stream", "write", "remove"])
def test_a_mark_that_names_what_no_run_writes_is_refused(tmp_path, name, use):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.txt").write_text("a thesis")
    run = tmp_path / "run"
    mark(run / WRITING if use == "write" else run, name)
    (run / "thesis.txt").write_text("notes")
    kept = everything(tmp_path)
    act = {
        "stream": lambda: history(stream=run),
        "write": lambda: history().write(run),
        "remove": lambda: Folder(run).remove(),
    }[use]
    with pytest.raises(vx.HistoryError, match="which no run writes there, so nothing there is touched"):
        act()
    assert everything(tmp_path) == kept


@pytest.mark.parametrize("kind", ["link", "hanging link", "folder", "fifo", "large"])
def test_a_mark_that_is_no_file_of_ours_is_refused(tmp_path, kind):
    run, other = tmp_path / "run", tmp_path / "other"
    run.mkdir()
    other.write_text("vemcvx files 1\n")
    place = run / MARK
    if kind == "large":
        place.write_bytes(b"x" * 10**6)
    elif "link" in kind:
        place.symlink_to(other if kind == "link" else tmp_path / "nowhere")
    else:
        place.mkdir() if kind == "folder" else os.mkfifo(place)
    with pytest.raises(vx.HistoryError, match=f"{MARK}: not made by a run of this version, so it is not touched"):
        history(stream=run)
    assert other.read_text() == "vemcvx files 1\n"
    assert not (tmp_path / "nowhere").exists()


def test_a_disk_that_was_full_holds_nobody_off(tmp_path, monkeypatch):
    write = os.write

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(vx.HistoryError, match="cannot be written: .*No space left"):
        Folder(tmp_path)
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:3]))  # A part at a time.
    with Folder(tmp_path) as folder:
        folder.take("state.npy")
        assert (tmp_path / MARK).read_text() == "vemcvx files 1\nstate.npy\n"


@pytest.mark.parametrize("kind", ["link to a file", "link to a folder", "folder"])
def test_only_regular_files_are_taken_away_or_written_to(tmp_path, kind):
    run, thesis = tmp_path / "run", tmp_path / "thesis"
    mark(run, "state.npy", "checkpoint.npz")
    thesis.mkdir()
    (thesis / "thesis.npy").write_text("a thesis")
    place = run / "state.npy"
    if kind == "folder":
        place.mkdir()
        (place / "thesis.npy").write_text("a thesis")
    else:
        place.symlink_to(thesis if kind == "link to a folder" else thesis / "thesis.npy")
    kept = everything(tmp_path)
    with pytest.raises(vx.HistoryError, match="state.npy: not made by a run of this version"):
        history(stream=run)
    Folder(run).remove()
    assert everything(tmp_path) == kept
    assert os.path.lexists(place)


def test_drafts_of_others_stay(tmp_path):
    mark(tmp_path / WRITING, "new")
    new = tmp_path / WRITING / "new"
    new.mkdir()
    (new / "thesis.txt").write_text("a thesis")
    (new / "step_0000.vtu").write_text("half")
    with pytest.raises(vx.HistoryError, match="new: not made by a run of this version"):
        history().write(tmp_path)
    assert everything(tmp_path) == {new / "thesis.txt": b"a thesis"}


def test_a_link_where_a_history_is_made_is_refused(tmp_path):
    other = tmp_path / "other"
    mark(other, "new")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / WRITING).symlink_to(other)
    with pytest.raises(vx.HistoryError, match="a link, and a history is made in its folder itself"):
        history().write(tmp_path / "run")


@pytest.mark.long
def test_a_summary_that_lists_tables_of_others_takes_none_away(tmp_path):
    history().write(tmp_path)
    (tmp_path / "thesis.csv").write_text("a thesis")
    summary = tmp_path / "summary.json"
    summary.write_text(summary.read_text().replace('"contact.csv"', '"contact.csv", "thesis.csv", "../thesis.csv"'))
    history(bound=1.0).write(tmp_path)
    assert (tmp_path / "thesis.csv").read_text() == "a thesis"


class Died(BaseException):
    """A process that dies."""


def dying_at(monkeypatch, move):
    """Die at the move of that number, before it is made."""
    made, replace = [0], os.replace

    def counted(*where):
        made[0] += 1
        if made[0] == move:
            raise Died
        replace(*where)

    monkeypatch.setattr(os, "replace", counted)
    return made


@pytest.mark.long
@pytest.mark.parametrize("first", [True, False], ids=["first", "over another"])
@pytest.mark.parametrize("move", range(1, 11))
def test_a_folder_is_old_or_new_wherever_a_process_dies(tmp_path, monkeypatch, first, move):
    old, new = history(times=np.linspace(0.0, 1.0, 6)), history(bound=1.0)
    (tmp_path / "thesis.csv").write_text("a thesis")
    if not first:
        old.write(tmp_path)
    with monkeypatch.context() as patch:
        dying_at(patch, move)
        try:
            new.write(tmp_path)
            died = False
        except Died:
            died = True
    # Of new: the archive, four steps, two tables, the series, the summary.
    assert died == (move <= 9)
    assert np.array_equal(vx.read_history(tmp_path).displacement, new.displacement)
    assert {path.name for path in tmp_path.iterdir()} == {
        "history.npz", "history.pvd", "summary.json", "steps.csv", "contact.csv", "thesis.csv",
        *(f"step_{n:04d}.vtu" for n in range(4)),
    }  # fmt: skip
    expected = tmp_path / "expected"
    new.write(expected)
    for path in expected.iterdir():
        if path.name not in ("summary.json", "history.npz"):
            assert path.read_bytes() == (tmp_path / path.name).read_bytes()
    assert f'"dissipated": {float(new.dissipated[-1])!r}' in (tmp_path / "summary.json").read_text()
    old.write(tmp_path)
    assert np.array_equal(vx.read_history(tmp_path).displacement, old.displacement)


@pytest.mark.long
@pytest.mark.parametrize("first", [True, False], ids=["first", "over another"])
def test_a_process_that_dies_before_all_is_made_leaves_the_older_history(tmp_path, monkeypatch, first):
    old = history()
    if not first:
        old.write(tmp_path)
    kept = everything(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("vemcvx.results.files.summary", lambda *_, **__: os._exit(3))
        if (child := os.fork()) == 0:
            history(bound=1.0).write(tmp_path)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
    assert {path: data for path, data in everything(tmp_path).items() if WRITING not in str(path)} == kept
    if first:
        with pytest.raises(vx.HistoryError, match="a history is a folder with history.npz in it"):
            vx.read_history(tmp_path)
    else:
        assert np.array_equal(vx.read_history(tmp_path).displacement, old.displacement)
    assert everything(tmp_path) == kept
    history(bound=1.0).write(tmp_path)


KILLED = """
import os, sys
import numpy as np
import vemcvx as vx
folder, move = sys.argv[1], int(sys.argv[2])
history, replace, made = vx.read_history(sys.argv[3]), os.replace, [0]
def counted(*where):
    made[0] += 1
    if made[0] == move:
        os.kill(os.getpid(), 9)
    replace(*where)
os.replace = counted
history.write(folder)
"""


@pytest.mark.slow
@pytest.mark.parametrize("move", range(1, 11))
def test_a_process_that_is_killed_leaves_old_or_new(tmp_path, move):
    new, out = history(bound=1.0), tmp_path / "out"
    new.write(tmp_path / "new")
    code = subprocess.run([sys.executable, "-c", KILLED, out, str(move), tmp_path / "new"]).returncode
    assert code == (-9 if move <= 9 else 0)
    assert np.array_equal(vx.read_history(out).displacement, new.displacement)
    assert not (out / WRITING).exists()
    history().write(out)


@pytest.mark.long
def test_a_folder_for_reading_only_gives_the_new_history(tmp_path, monkeypatch):
    new = history(bound=1.0)
    with monkeypatch.context() as patch:
        dying_at(patch, 1)
        with pytest.raises(Died):
            new.write(tmp_path)

    def refused(*_):
        raise vx.HistoryError("read-only")

    monkeypatch.setattr("vemcvx.results.files.Owned", refused)
    assert np.array_equal(vx.read_history(tmp_path).displacement, new.displacement)


@pytest.mark.slow
def test_random_marks_lose_nothing(tmp_path):
    """Five hundred marks of pieces of paths, names of ours, and rubbish."""
    random = np.random.default_rng(0)
    pieces = [*PATHS, "/", "\n", "state.npy", "new", "checkpoint.npz", "thesis", "\0", "run", ".vemcvx", "\\", "\xff"]
    for number in range(500):
        here = tmp_path / str(number)
        (here / "thesis").mkdir(parents=True)
        (here / "thesis" / "thesis.npy").write_text("a thesis")
        run = here / "run"
        (run / "thesis").mkdir(parents=True)
        (run / "thesis" / "new").write_text("notes")
        (run / "thesis.npy").write_text("notes")
        text = "vemcvx files 1\n" + "".join(random.choice(pieces, random.integers(1, 12)))
        (run / MARK).write_text(text)
        kept = everything(here)
        try:
            with Folder(run) as mine:
                mine.remove()
        except vx.HistoryError:
            pass
        assert everything(here) == kept, text
