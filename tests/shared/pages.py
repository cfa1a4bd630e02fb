"""What every picture must keep to."""

from __future__ import annotations


def assert_drawn_within_the_page(figure):
    """Nothing is cut off at the edge of the page."""
    figure.draw_without_rendering()
    page, ink = figure.bbox_inches, figure.get_tightbbox()
    assert min(ink.x0, ink.y0) >= -0.01
    assert ink.x1 <= page.width + 0.01
    assert ink.y1 <= page.height + 0.01
