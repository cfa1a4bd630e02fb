"""Nothing of a user's is lost: lists that lie, links, processes that die while they write a history."""

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

TIMES = np.linspace(0.0, 1.0, 4)


def history(bound=4.0, times=TIMES, stream=None):
    return vx.simulate(paper_scene(bound=bound), small("squares", 3), times, stream=stream)


def everything(folder):
    """path -> bytes of all files below a folder, marks left out."""
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file() and path.name != LIST}


def listed(folder, *names):
    """A folder whose list of our files has these names."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / LIST).write_text("".join(f"{line}\n" for line in ("vemcvx files 1", *names)))


@pytest.mark.parametrize("name", ["../thesis/thesis.txt", "/tmp", "a/b.npy", "..", "", "thesis"], ids=repr)
def test_a_list_names_files_of_its_folder_alone(tmp_path, name):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.txt").write_text("a thesis")
    run = tmp_path / "run"
    listed(run, name)
    (run / "thesis").mkdir()
    (run / "thesis" / "thesis.txt").write_text("notes")
    kept = everything(tmp_path)
    with contextlib.suppress(vx.HistoryError):
        history(stream=run)
    listed(run, name)
    with contextlib.suppress(vx.HistoryError), Folder(run) as held:
        held.clear()
    assert kept.items() <= everything(tmp_path).items()


@pytest.mark.parametrize("kind", ["link", "hanging link", "folder", "text", *["fifo"] * hasattr(os, "mkfifo")])
def test_a_list_that_is_no_file_of_ours_is_refused(tmp_path, kind):
    run, other = tmp_path / "run", tmp_path / "other"
    run.mkdir()
    other.write_text("vemcvx files 1\n")
    place = run / LIST
    if kind == "text":
        place.write_bytes(b"\xff" * 1000)
    elif "link" in kind:
        place.symlink_to(other if kind == "link" else tmp_path / "nowhere")
    else:
        place.mkdir() if kind == "folder" else os.mkfifo(place)
    with pytest.raises(vx.HistoryError, match="not made by a run of this version|cannot be used as a folder"):
        history(stream=run)
    assert other.read_text() == "vemcvx files 1\n"
    assert not (tmp_path / "nowhere").exists()


def test_a_disk_that_was_full_holds_nobody_off(tmp_path):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    full = Folder(tmp_path)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        with pytest.raises(vx.HistoryError, match="cannot be written: .*File too large"), full:
            full.take("state.npy")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with Folder(tmp_path) as folder:
        folder.take("state.npy")
        assert (tmp_path / LIST).read_text() == "vemcvx files 1\nstate.npy\n"


@pytest.mark.parametrize("kind", ["link to a file", "link to a folder", "folder"])
def test_only_regular_files_are_deleted_or_written_to(tmp_path, kind):
    run, thesis = tmp_path / "run", tmp_path / "thesis"
    listed(run, "state.npy", "checkpoint.npy")
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
    with Folder(run) as held:
        held.clear()
    assert everything(tmp_path) == kept
    assert os.path.lexists(place)


@pytest.mark.long
def test_a_summary_that_lists_tables_of_others_takes_none_away(tmp_path):
    history().write(tmp_path)
    for name in ("thesis.csv", "probes.csv"):
        (tmp_path / name).write_text("a thesis")
    summary = tmp_path / "summary.json"
    summary.write_text(summary.read_text().replace('"contact.csv"', '"contact.csv", "thesis.csv", "../thesis.csv"'))
    history(bound=1.0).write(tmp_path)
    assert (tmp_path / "thesis.csv").read_text() == (tmp_path / "probes.csv").read_text() == "a thesis"


class Died(BaseException):
    """A process that dies."""


@pytest.mark.long
@pytest.mark.parametrize("first", [True, False], ids=["first", "over another"])
@pytest.mark.parametrize("move", range(1, 11))
def test_what_is_read_is_old_or_new_wherever_a_process_dies(tmp_path, monkeypatch, first, move):
    old, new = history(times=np.linspace(0.0, 1.0, 6)), history(bound=1.0)
    (tmp_path / "thesis.csv").write_text("a thesis")
    if not first:
        old.write(tmp_path)
    made, replace = [0], os.replace

    def counted(*where):
        made[0] += 1
        if made[0] == move:
            raise Died
        replace(*where)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", counted)
        try:
            new.write(tmp_path)
            died = False
        except Died:
            died = True
    # Of new: the archive, four steps, two tables, the series, the summary.
    assert died == (move <= 9)
    if first and move == 1:
        with pytest.raises(vx.HistoryError, match="a history is a folder that contains history.npz"):
            vx.read_history(tmp_path)
    else:
        is_of = old if move == 1 else new
        assert np.array_equal(vx.read_history(tmp_path).displacement, is_of.displacement)
    assert (tmp_path / "thesis.csv").read_text() == "a thesis"
    if not died:
        assert {path.name for path in tmp_path.iterdir()} == {
            "history.npz", "history.pvd", "summary.json", "steps.csv", "contact.csv", "thesis.csv",
            *(f"step_{n:04d}.vtu" for n in range(4)),
        }  # fmt: skip
