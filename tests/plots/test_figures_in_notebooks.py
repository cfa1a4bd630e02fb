"""A figure as the last line of a cell is a picture, without %matplotlib and without pyplot."""

from __future__ import annotations

from io import BytesIO

import pytest

from vemcvx.base.canvas import new_figure

image = pytest.importorskip("matplotlib.image")


@pytest.mark.long
def test_a_figure_says_its_picture_to_notebooks():
    """IPython and marimo ask an object for `_repr_png_`."""
    figure = new_figure(3.0, 2.0)
    figure.add_subplot().plot([0, 1], [1, 0])
    pixels = image.imread(BytesIO(figure._repr_png_()))
    assert pixels.shape[:2] == (200, 300)
    assert pixels[..., :3].min() < 0.5, "nothing is drawn"


def test_a_figure_says_in_words_what_it_shows():
    figure = new_figure()
    assert repr(figure) == "Picture: 0 axes without titles"
    left, right = figure.subplots(1, 2)
    figure.suptitle("a loop")
    left.set(title="force", xlabel="$t$", ylabel="F\nin N")
    right.set_ylabel("energy")
    assert repr(figure) == "Picture: a loop; force: F in N over t; energy"
