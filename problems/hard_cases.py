"""Hard cases: the required behaviour of a correct program, and the behaviour of this package with every solver.

    python problems/hard_cases.py [--picture FILE]

For every case the table states what is required: an answer, an answer with a warning, or a refusal in one clear
sentence. For Newton, Clarabel and OSQP the table also has maxima over the steps: the certified relative energy error,
the rounding error of the certificate (floor), and the number of iterations. It also has seconds, and the true error if
a closed form exists. A solver that misses its accuracy reports that it cannot solve the case. Wrong behaviour is marked
WRONG below its case; the command then fails.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hard import broken, cells, friction, material, solvers, supports, time_and_load, units
from hard.case import REFUSAL, Case, Finding, table
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import MARKERS, SERIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUBJECTS = {
    "material": material,
    "cells": cells,
    "broken input": broken,
    "friction": friction,
    "supports": supports,
    "time and load": time_and_load,
    "units": units,
    "solvers": solvers,
}
CASES = tuple((subject, case) for subject, module in SUBJECTS.items() for case in module.CASES)
ASKED = {"Newton": 1e-8, "Clarabel": 1e-6, "OSQP": 1e-6}
Row = tuple[str, Case, list[Finding]]


def format_finding(case: Case, finding: Finding) -> str:
    """Return one solver's finding in a line."""
    if np.isnan(finding.certified):
        return f"    {finding.solver:<18} {finding.did}: {finding.words}"
    true = "" if np.isnan(finding.error) else f"  true {finding.error:.0e}"
    return (
        f"    {finding.solver:<18} {finding.did:<22} certified {finding.certified:.0e}  floor {finding.floor:.0e}{true}"
        f"  {finding.iterations} iterations  {finding.seconds:.2f} s"
    )


def format_rows(rows: Sequence[Row]) -> str:
    """Return the table as text."""
    lines, before = [], ""
    for subject, case, findings in rows:
        if subject != before:
            lines += ["", subject.upper()]
            before = subject
        lines.append(f"  {case.name}: must {case.must}")
        if case.must == REFUSAL and len({f.words for f in findings}) == 1:
            lines.append(f"    all solvers         {findings[0].did}: {findings[0].words}")
        else:
            lines += [format_finding(case, finding) for finding in findings]
        able = [f.solver for f in findings if f.did == case.must]
        if len(able) == 1 and len(findings) > 1:
            lines.append(f"    only {able[0]} solves this case")
        lines += [f"    WRONG: {f.solver}: {f.complaint}" for f in findings if f.complaint]
    return "\n".join(lines)


def count_rows(rows: Sequence[Row]) -> str:
    """Return a line: the number of all cases, and the number of cases that each solver can solve."""
    findings = [finding for _, _, found in rows for finding in found]
    able = {
        name: sum(f.solver == name and f.did != "says it cannot" for f in findings)
        for name in ("Newton", "Clarabel", "OSQP")
    }
    asked = {name: sum(f.solver == name for f in findings) for name in able}
    wrong = sum(bool(f.complaint) for f in findings)
    words = ", ".join(f"{name} does {able[name]} of {asked[name]}" for name in able)
    return f"{len(rows)} cases; {words}; solvers report that they cannot do the other cases; {wrong} findings are wrong"


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the certified errors of each solver in all answered cases, and the requested accuracies."""
    answered = [row for row in rows if any(np.isfinite(f.certified) for f in row[2])]
    half = (len(answered) + 1) // 2
    figure = new_figure(11.0, 0.21 * half + 1.3)
    panels = figure.subplots(1, 2, sharex=True)
    for axes, part in zip(panels, (answered[:half], answered[half:]), strict=True):
        draw_cases(axes, part, half)
    figure.supxlabel("certified relative energy error of the worst step", fontsize="medium")
    hollow = "hollow: the solver reports that it misses its accuracy"
    panels[0].plot([], [], "o", color="0.3", markerfacecolor="none", markersize=6, label=hollow)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=120)


def draw_cases(axes: Axes, answered: Sequence[Row], lines: int) -> None:
    """Draw cases one below the other, with room for `lines` lines."""
    place = lines - 1 - np.arange(len(answered))
    for name, colour, marker in zip(ASKED, SERIES, MARKERS, strict=False):
        found = [next((f for f in row[2] if f.solver == name), None) for row in answered]
        value = np.array([np.nan if f is None else max(f.certified, 1e-17) for f in found])
        good = np.array([f is not None and f.did != "says it cannot" for f in found])
        axes.plot(value[good], place[good], marker, color=colour, markersize=5, label=name)
        axes.plot(np.minimum(value, 10.0)[~good], place[~good], marker, mfc="none", color=colour, markersize=6)
    for asked, style in ((1e-8, "--"), (1e-6, ":")):
        names = " and ".join(name for name in ASKED if ASKED[name] == asked)
        axes.axvline(asked, color="0.3", linewidth=1.0, linestyle=style, label=f"asked of {names}")
    axes.set_xscale("log")
    axes.set_yticks(place, [row[1].name for row in answered], fontsize=8)
    axes.set_ylim(-0.7, lines - 0.3)
    light_grid(axes)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="where to draw the certified errors (PNG)")
    chosen = parser.parse_args()
    rows = table(CASES)
    print(format_rows(rows))
    print()
    print(count_rows(rows))
    if chosen.picture:
        draw(rows, chosen.picture)
    return any(f.complaint for _, _, found in rows for f in found)


if __name__ == "__main__":
    sys.exit(main())
