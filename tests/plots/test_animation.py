"""A film has a frame for each stored step, all at one scale. A notebook shows a figure as a picture."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from matplotlib import image
from matplotlib.animation import writers
from PIL import Image
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.base.canvas import new_figure
from vemcvx.plots import animate


@pytest.fixture(scope="module")
def history():
    return vx.simulate(paper_scene(cyclic), small("squares", 4), np.linspace(0.0, 1.0, 5))


@pytest.mark.long
def test_a_gif_has_a_frame_for_each_stored_step(history, tmp_path):
    path = animate(history, tmp_path / "slip.gif", seconds=1.0, units={"length": "mm"})
    with Image.open(path) as film:
        assert film.n_frames == 5
        assert film.info["duration"] == 200
        sizes = set()
        for k in range(film.n_frames):
            film.seek(k)
            sizes.add(film.size)
    assert len(sizes) == 1


def test_films_that_cannot_be_written_are_refused_and_keep_older_files(history, tmp_path, monkeypatch):
    (tmp_path / "film.gif").write_bytes(b"earlier")
    for name, options, says in (
        ("slip.gif", {"seconds": 0}, "seconds = 0"),
        ("film.gif", {"magnify": -1}, "magnify: found -1"),
        ("none/slip.gif", {}, "cannot write a film"),
    ):
        with pytest.raises(vx.HistoryError, match=says):
            animate(history, tmp_path / name, **options)
    assert (tmp_path / "film.gif").read_bytes() == b"earlier"
    monkeypatch.setattr(type(writers), "is_available", lambda self, kind: False)
    for suffix, missing in ((".mp4", "ffmpeg"), (".gif", "pillow")):
        with pytest.raises(vx.VemcvxError, match=f"a film of this kind needs {missing}"):
            animate(history, tmp_path / f"slip{suffix}")


def test_a_figure_is_a_picture_in_notebooks():
    """IPython and marimo call `_repr_png_`, without pyplot."""
    figure = new_figure(3.0, 2.0)
    figure.add_subplot().plot([0, 1], [1, 0])
    pixels = image.imread(BytesIO(figure._repr_png_()))
    assert pixels.shape[:2] == (200, 300)
    assert pixels[..., :3].min() < 0.5


def test_a_figure_is_described_by_its_titles_and_labels():
    figure = new_figure()
    assert repr(figure) == "Picture: 0 axes without titles"
    left, right = figure.subplots(1, 2)
    figure.suptitle("a loop")
    left.set(title="force", xlabel="$t$", ylabel="F\nin N")
    right.set_ylabel("energy")
    assert repr(figure) == "Picture: a loop; force: F in N over t; energy"
