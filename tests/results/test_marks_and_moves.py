"""No user's file is lost if a list of our files is wrong, a file is a link, or a process dies while it writes."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest
from scenes import paper_scene, small

import vemcvx as vx
from vemcvx.base.owned_files import LIST
from vemcvx.stepping import Folder


def run(bound=4.0, steps=3, stream=None):
    return vx.simulate(paper_scene(bound=bound), small("squares", 3), np.linspace(0.0, 1.0, steps + 1), stream=stream)


def contents(folder):
    """Return path -> bytes of all files below a folder, except the lists of our files."""
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file() and path.name != LIST}


def write_list(folder, *names):
    """Make a folder with a list of our files."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / LIST).write_text("".join(f"{line}\n" for line in ("vemcvx files 1", *names)))


@pytest.mark.parametrize("name", ["../thesis/thesis.txt", "/tmp", "a/b.npy", "..", "", "thesis"], ids=repr)
def test_a_list_cannot_claim_files_outside_its_folder(tmp_path, name):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.txt").write_text("a thesis")
    folder = tmp_path / "run"
    write_list(folder, name)
    (folder / "thesis").mkdir()
    (folder / "thesis" / "thesis.txt").write_text("notes")
    kept = contents(tmp_path)
    with contextlib.suppress(vx.HistoryError):
        run(stream=folder)
    write_list(folder, name)
    with contextlib.suppress(vx.HistoryError), Folder(folder) as held:
        held.clear()
    assert kept.items() <= contents(tmp_path).items()


@pytest.mark.parametrize("kind", ["link to a file", "link to a folder", "folder"])
def test_only_regular_files_are_deleted_or_written_to(tmp_path, kind):
    folder, thesis = tmp_path / "run", tmp_path / "thesis"
    write_list(folder, "state.npy", "checkpoint.npy")
    thesis.mkdir()
    (thesis / "thesis.npy").write_text("a thesis")
    place = folder / "state.npy"
    if kind == "folder":
        place.mkdir()
        (place / "thesis.npy").write_text("a thesis")
    else:
        place.symlink_to(thesis if kind == "link to a folder" else thesis / "thesis.npy")
    kept = contents(tmp_path)
    with pytest.raises(vx.HistoryError, match=r"state\.npy: not made by a run of this version"):
        run(stream=folder)
    with Folder(folder) as held:
        held.clear()
    assert contents(tmp_path) == kept
    assert os.path.lexists(place)


class Died(BaseException):
    """Raised where a process would die."""


@pytest.mark.long
@pytest.mark.parametrize("move", [1, 2, 6, 9, 10])
def test_the_old_or_the_new_history_is_read_wherever_a_process_dies(tmp_path, monkeypatch, move):
    """Writing replaces nine files: the archive, then four steps, two tables, the series and the summary."""
    old, new = run(steps=5), run(bound=1.0)
    (tmp_path / "thesis.csv").write_text("a thesis")
    old.write(tmp_path)
    count, replace = [0], os.replace

    def counted(*where):
        count[0] += 1
        if count[0] == move:
            raise Died
        replace(*where)

    died = False
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", counted)
        try:
            new.write(tmp_path)
        except Died:
            died = True
    assert died == (move <= 9)
    written = old if move == 1 else new
    assert np.array_equal(vx.read_history(tmp_path).displacement, written.displacement)
    assert (tmp_path / "thesis.csv").read_text() == "a thesis"
    if not died:
        names = {"history.npz", "history.pvd", "summary.json", "steps.csv", "contact.csv", "thesis.csv"}
        assert {path.name for path in tmp_path.iterdir()} == names | {f"step_{n:04d}.vtu" for n in range(4)}
