"""What every picture must keep to."""

from __future__ import annotations

SMALLEST = 8.0
"""Points: what is smaller cannot be read in print."""


def assert_drawn_within_the_page(figure):
    """Nothing is cut off at the edge of the page, nothing too small to read, and no number is 6 x 10^0."""
    figure.draw_without_rendering()
    words = [text for text in figure.findobj(lambda part: hasattr(part, "get_fontsize")) if text.get_visible()]
    assert words
    assert min(text.get_fontsize() for text in words) >= SMALLEST
    for ax in figure.axes:
        ticks = [*ax.get_xticklabels(which="both"), *ax.get_yticklabels(which="both")]
        assert not [label.get_text() for label in ticks if r"\times" in label.get_text()]
    page, ink = figure.bbox_inches, figure.get_tightbbox()
    assert min(ink.x0, ink.y0) >= -0.01
    assert ink.x1 <= page.width + 0.01
    assert ink.y1 <= page.height + 0.01
