"""A figure as the last line of a cell is a picture, without %matplotlib and without pyplot."""

from __future__ import annotations

from io import BytesIO

import pytest

from vemcvx.canvas import new_figure

image = pytest.importorskip("matplotlib.image")


def test_a_figure_says_its_picture_to_notebooks():
    """IPython and marimo ask an object for `_repr_png_`."""
    figure = new_figure(3.0, 2.0)
    figure.add_subplot().plot([0, 1], [1, 0])
    pixels = image.imread(BytesIO(figure._repr_png_()))
    assert pixels.shape[:2] == (200, 300)
    assert pixels[..., :3].min() < 0.5, "nothing is drawn"
