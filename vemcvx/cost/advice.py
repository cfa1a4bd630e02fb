"""What to use for an accuracy: the run of a sweep that costs least among those whose true error is within it."""

from __future__ import annotations

from collections.abc import Sequence

from vemcvx.cost.row import Row, percent


def cheapest(rows: Sequence[Row], level: float) -> Row | None:
    """The run that takes the fewest seconds with an error of no more than `level`; None if there is none."""
    return min((row for row in rows if row.done and row.error <= level), key=lambda row: row.seconds, default=None)


def advice(rows: Sequence[Row], levels: Sequence[float]) -> list[str]:
    """One line a level."""
    best = min((row for row in rows if row.done), key=lambda row: row.error, default=None)
    lines = []
    for level in levels:
        row = cheapest(rows, level)
        if row is not None:
            lines.append(
                f"for {percent(level)}: use {row.settings}: costs {row.seconds:.2g} s, error {percent(row.error)} "
                f"({row.unknowns} unknowns, {row.steps} steps, {row.peak_mb or float('nan'):.0f} MB)"
            )
        elif best is not None:
            lines.append(
                f"for {percent(level)}: no run of this sweep is as good; the best is {best.settings} with "
                f"{percent(best.error)}. Ask for larger --n, or a smaller --target."
            )
        else:
            lines.append(f"for {percent(level)}: no run of this sweep has an answer.")
    return lines
