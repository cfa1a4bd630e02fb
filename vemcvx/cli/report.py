"""`vemcvx run --report`: a report of a run, in one HTML file."""

from __future__ import annotations

import base64
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from string import Template

from vemcvx.base.canvas import as_png
from vemcvx.base.errors import VemcvxError
from vemcvx.base.outline import Outline
from vemcvx.base.version import __version__
from vemcvx.cli.doctor import EXTRAS, NEEDED, name_platform, version_of
from vemcvx.cli.problem_file import Problem
from vemcvx.cli.show import problem_in_words
from vemcvx.estimate.budget import error_budget
from vemcvx.history import History
from vemcvx.plots.pictures import draw_pictures, omissions

TEMPLATE = Path(__file__).with_name("page.html")


def page(title: str, body: str, style: str = "") -> str:
    """Return an HTML page with a title (text), a body (HTML), and further CSS rules."""
    template = Template(TEMPLATE.read_text(encoding="utf-8"))
    return template.substitute(title=escape(title), body=body, style=style, version=__version__)


def report_page(problem: Problem, history: History, *, settings: Sequence[str], mesh: str, results: str) -> str:
    """Return the report of a run as an HTML page."""
    rows = problem_in_words(problem, settings, history.mesh, mesh)
    parameters = problem.parameters(settings)
    source = problem.path.read_text(encoding="utf-8", errors="replace")
    packages = {name: found for name in (*NEEDED, *EXTRAS) if (found := version_of(name))}
    run = [
        ("command", shlex.join(["vemcvx", *sys.argv[1:]])),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("vemcvx", name_platform()),
        ("with", ", ".join(f"{name} {version}" for name, version in packages.items())),
    ]
    sections = {
        "What was simulated": f"<pre>{escape(problem.text.strip())}</pre>"
        + Outline("The scene (as by vemcvx show)", rows).html(),
        "Pictures": _pictures(history, problem),
        "Results": f"<pre>{escape(results)}</pre>",
        "Error budget": _budget(history),
        "How to repeat it": (
            f"{Outline('The run', run).html()}{Outline('Parameters of the scene', parameters).html()}"
            f"<h3>{escape(problem.path.name)}</h3><pre>{escape(source)}</pre>"
        ),
    }
    body = "".join(f"<section><h2>{title}</h2>{text}</section>\n" for title, text in sections.items())
    return page(f"{problem.name}: {problem.title}", body)


def _pictures(history: History, problem: Problem) -> str:
    figures = ""
    for name, drawn in draw_pictures(history, problem.units).items():
        words, data = name.replace("_", " "), base64.b64encode(as_png(drawn, 130)).decode()
        figures += f'<figure><img src="data:image/png;base64,{data}" alt="{words}"><figcaption>{words}</figcaption>'
        figures += "</figure>"
    return figures + "".join(f"<p>Left out: {escape(why)}.</p>" for why in omissions(history))


def _budget(history: History) -> str:
    if history.errors:  # Adaptive runs have an error budget.
        return "<p>The error budget of the adaptive run is part of the results.</p>"
    try:
        return error_budget(history).outline().html()
    except VemcvxError as error:
        return f"<p>There is no error budget. {escape(str(error))}</p>"
