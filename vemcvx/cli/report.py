"""`vemcvx run --report`: a page of HTML that says what was simulated, what came out, and how to repeat it.

Pictures and style stand in the page, so that it needs nothing else. It is written when a run has succeeded.
"""

from __future__ import annotations

import base64
import os
import shlex
import sys
import textwrap
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from string import Template

import numpy as np

from vemcvx.base.canvas import as_png
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.base.outline import Outline
from vemcvx.base.version import __version__
from vemcvx.cli.doctor import EXTRAS, NEEDED, here, version_of
from vemcvx.cli.problem_file import Problem
from vemcvx.cli.show import problem_in_words
from vemcvx.cli.terminal import write_text
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.quantities import with_quantities
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh
from vemcvx.plots.pictures import draw_pictures, left_out

TEMPLATE = Path(__file__).with_name("page.html")
MARK = '<meta name="generator" content="vemcvx">'
"""The mark in the template by which pages of ours are known, so that no other is replaced."""
REPORT = "report.html"
BUDGETED = 64  # Steps at which a report judges the mesh at most: each takes residuals on all cells.


def page(title: str, body: str, style: str = "") -> str:
    """Return a page of a title in words and a body of HTML, with rules of style beside those of all pages."""
    template = Template(TEMPLATE.read_text(encoding="utf-8"))
    return template.substitute(title=escape(title), body=body, style=style, version=__version__)


def check_report(folder: Path) -> None:
    """Refuse a folder in which a file of that name is no page of ours."""
    path = folder / REPORT
    if os.path.lexists(path) and not (path.is_file() and MARK.encode() in path.read_bytes()[:1000]):
        raise ProblemError(f"{path}: not written by vemcvx, so it is not replaced. Choose another folder, or move it.")


def write_report(
    folder: Path,
    problem: Problem,
    history: History,
    *,
    settings: Sequence[str],
    mesh: str,
    results: str,
) -> Path:
    """Write the page: `results` are those of the terminal, `mesh` is the mesh in words."""
    rows = problem_in_words(problem, settings, history.mesh, mesh)
    parameters = problem.parameters(settings)
    text = problem.path.read_text(encoding="utf-8", errors="replace")
    packages = {name: found for name in (*NEEDED, *EXTRAS) if (found := version_of(name))}
    run = [
        ("command", shlex.join(["vemcvx", *sys.argv[1:]])),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("vemcvx", here()),
        ("with", ", ".join(f"{name} {version}" for name, version in packages.items())),
    ]
    sections = {
        "What was simulated": _prose(problem.text) + Outline("The scene, as vemcvx show has it", rows).html(),
        "Pictures": _pictures(history, problem),
        "Results": f"<pre>{escape(results)}</pre>",
        "Error budget": _budget(history),
        "How to repeat it": (
            f"{Outline('The run', run).html()}{Outline('Parameters of the scene', parameters).html()}"
            f"<h3>{escape(problem.path.name)}</h3><pre>{escape(text)}</pre>"
        ),
    }
    body = "".join(f"<section><h2>{title}</h2>{said}</section>\n" for title, said in sections.items())
    path = folder / REPORT
    write_text(path, page(f"{problem.name}: {problem.title}", body), "--report")
    return path


def _prose(text: str) -> str:
    """Return paragraphs; indented ones are formulas or commands, and stay as they are set."""
    parts = [part.strip("\n") for part in text.split("\n\n")]
    kinds = [("pre" if part.startswith(" ") else "p", textwrap.dedent(part)) for part in parts if part.strip()]
    return "".join(f"<{kind}>{escape(said)}</{kind}>" for kind, said in kinds)


def _pictures(history: History, problem: Problem) -> str:
    figures = ""
    for name, drawn in draw_pictures(history, problem.units).items():
        words, data = name.replace("_", " "), base64.b64encode(as_png(drawn, 130)).decode()
        figures += f'<figure><img src="data:image/png;base64,{data}" alt="{words}"><figcaption>{words}</figcaption>'
        figures += "</figure>"
    return figures + "".join(f"<p>Left out: {escape(why)}.</p>" for why in dict.fromkeys(left_out(history).values()))


def _budget(history: History) -> str:
    """Return the error budget, or the reason why there is none."""
    if history.errors:  # of an adaptive run, which the results have
        return "<p>That of the adaptive run stands among the results.</p>"
    try:
        return error_budget(history, _looked_at(history)).outline().html()
    except VemcvxError as error:
        return f"<p>There is none. {escape(str(error))}</p>"


def _looked_at(history: History) -> list[int]:
    """Return the stored steps at which the mesh is judged: all, or BUDGETED of them and that of the largest energy."""
    steps = history.stored[history.stored > 0] if len(history.stored) > 1 else history.stored
    if len(steps) > BUDGETED:
        evenly = steps[np.linspace(0, len(steps) - 1, BUDGETED).round().astype(int)]
        steps = np.union1d(evenly, steps[np.argmax(history.trajectory.norm[steps])])
    return steps.tolist()


def with_errors(history: History) -> tuple[History, str]:
    """Return the history with its quantities and their errors, and a line that says why it has none."""
    if history.quantities is not None:
        return history, ""
    plane, unknowns = isinstance(history.mesh, PolygonMesh), history.trajectory.state.shape[1]
    # Unasked, as many as an adaptive run has at most; in space, where each costs more, a quarter of that.
    refined, most = (4 * unknowns, 400_000) if plane else (8 * unknowns, 100_000)
    why = f"the refined mesh has some {refined} unknowns; vemcvx.quantities(history) simulates on it."
    if refined <= most:
        try:
            return with_quantities(history)[0], ""
        except VemcvxError as error:
            why = str(error)
    return history, f"estimated   no errors of friction work, work and wear: {why}"
