"""Films: every stored step a frame, all of one scale; a sentence where they cannot be written."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.base.canvas import new_figure
from vemcvx.plots.pictures import _frames

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def history():
    return vx.simulate(paper_scene(cyclic), small("squares", 4), np.linspace(0.0, 1.0, 5))


@pytest.mark.long
def test_a_gif_has_a_frame_a_stored_step(history, tmp_path):
    path = history.animate(tmp_path / "slip.gif", seconds=1.0, units={"length": "mm"})
    with Image.open(path) as film:
        assert film.n_frames == 5
        assert film.info["duration"] == 200
        sizes = set()
        for k in range(film.n_frames):
            film.seek(k)
            sizes.add(film.size)
    assert len(sizes) == 1


@pytest.mark.long
def test_frames_keep_their_place_and_scale(history):
    figure, seen = new_figure(), []
    for _ in _frames(history, figure):
        figure.draw_without_rendering()
        ax = figure.axes[0]
        seen.append((ax.get_position().bounds, ax.get_xlim(), ax.get_ylim(), ax.collections[0].get_clim()))
    assert len(seen) == 5
    for other in seen[1:]:
        assert np.concatenate(other) == pytest.approx(np.concatenate(seen[0]), abs=1e-12)


def test_what_cannot_be_filmed_is_said(history, tmp_path, monkeypatch):
    with pytest.raises(vx.HistoryError, match=r"animate: found .*slip\.avi'; films end in \.gif or \.mp4"):
        history.animate(tmp_path / "slip.avi")
    with pytest.raises(vx.HistoryError, match=r"animate: found seconds = 0; wanted a positive number"):
        history.animate(tmp_path / "slip.gif", seconds=0)
    (tmp_path / "film.gif").write_bytes(b"earlier")
    with pytest.raises(vx.HistoryError, match="magnify: found -1; wanted a positive number"):
        history.animate(tmp_path / "film.gif", magnify=-1)
    assert (tmp_path / "film.gif").read_bytes() == b"earlier"
    with pytest.raises(vx.HistoryError, match=re.escape(str(tmp_path / "none" / "slip.gif")) + ": cannot write a film"):
        history.animate(tmp_path / "none" / "slip.gif")
    from matplotlib.animation import writers

    monkeypatch.setattr(type(writers), "is_available", lambda self, kind: False)
    for suffix, missing in ((".mp4", "ffmpeg, which is not installed: write a .gif"), (".gif", "pillow, which is not")):
        with pytest.raises(vx.VemcvxError, match=f"a film of this kind needs {missing}"):
            history.animate(tmp_path / f"slip{suffix}")
