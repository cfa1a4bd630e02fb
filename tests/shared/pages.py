"""Checks that every picture must pass."""

from __future__ import annotations

from itertools import combinations

SMALLEST = 8.0
"""Smallest font size in points: smaller letters cannot be read in print."""
TOUCHING = 1.0
"""Pixels by which the boxes of two texts may overlap, because boxes are higher than most letters."""


def assert_drawn_within_the_page(figure):
    """Check the positions and sizes of texts, and the form of tick labels."""
    figure.draw_without_rendering()
    words = texts_of(figure)
    assert words
    assert min(text.get_fontsize() for text in words) >= SMALLEST
    for ax in figure.axes:
        ticks = [*ax.get_xticklabels(which="both"), *ax.get_yticklabels(which="both")]
        assert not [label.get_text() for label in ticks if r"\times" in label.get_text()]
    page, ink = figure.bbox_inches, figure.get_tightbbox()
    assert min(ink.x0, ink.y0) >= -0.01
    assert ink.x1 <= page.width + 0.01
    assert ink.y1 <= page.height + 0.01
    assert_words_do_not_collide(figure)


def assert_words_do_not_collide(figure):
    """Check that no two texts of a drawn figure overlap."""
    boxes = [(text, text.get_window_extent()) for text in words_drawn(figure)]
    for (one, a), (two, b) in combinations(boxes, 2):
        apart = max(a.x0, b.x0) + TOUCHING > min(a.x1, b.x1) or max(a.y0, b.y0) + TOUCHING > min(a.y1, b.y1)
        assert apart, f"{one.get_text()!r} and {two.get_text()!r} collide"


def words_drawn(figure):
    """Return the visible texts of a figure."""
    axes = [ax for panel in figure.axes for ax in (panel, *panel.child_axes)]
    beyond, hidden = set(), set()
    for ax in axes:
        for axis in ax._axis_map.values():
            low, high = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            beyond |= {
                label
                for tick in ticks
                if not low - 1e-9 * (high - low) <= tick.get_loc() <= high + 1e-9 * (high - low)
                for label in (tick.label1, tick.label2)
            }
            if not ax.axison or not axis.get_visible():
                hidden |= {
                    axis.label,
                    axis.offsetText,
                    *(label for tick in ticks for label in (tick.label1, tick.label2)),
                }
    texts = [one for one in texts_of(figure) if one.get_text().strip() and one not in beyond | hidden]
    return [one for one in texts if one.get_window_extent().width > 0]


def texts_of(figure):
    return [text for text in figure.findobj(lambda part: hasattr(part, "get_fontsize")) if text.get_visible()]
