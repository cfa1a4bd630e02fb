"""`vemcvx app`: a marimo page in the browser, to change a problem and solve it."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from vemcvx.base.errors import ProblemError
from vemcvx.base.outline import count_steps
from vemcvx.cli.options import File
from vemcvx.cli.problem_file import execute_file, read_problem, run_user_code
from vemcvx.cli.report import page
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import say, write_text

GIVEN = "VEMCVX_APP"  # Environment variable with the problem file of the page.
PAGE = "live_page.py"
FRAMES = 11  # Number of evenly spaced steps on written pages.
STYLE = "dd b{font-size:1.4em}label{display:flex;gap:1em;flex-wrap:wrap}input{flex:1 1 12em}"
SHOW = """
const steps = [...document.querySelectorAll('section')];
steps.forEach((one, k) => one.hidden = k != this.value);
this.nextElementSibling.value = this.ariaValueText = steps[this.value].ariaLabel"""


@dataclass(frozen=True, kw_only=True)
class App:
    """The command `vemcvx app`."""

    file: File = ""
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="Port of the page. (default: a free one)")] = None
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True
    html: Annotated[Path | None, typer.Option(metavar="PAGE", help="Write a page that needs no Python.")] = None
    step: Annotated[int, typer.Option(min=1, help="The step that PAGE shows first.")] = 1

    def __call__(self) -> None:
        """Open a live page: change scene, mesh, friction, load and solver; see stick and slip (needs extra `app`)."""
        # The page reads this variable for each visitor.
        os.environ[GIVEN] = str(Path(self.file).resolve()) if Path(self.file).is_file() else self.file
        if self.file:
            read_problem(self.file).require("scene")
        if self.html is not None:
            say(write(self.html, self.step))
        else:
            serve(self.port, self.browser)


def serve(port: int | None, browser: bool) -> None:
    """Serve the page on this machine until Ctrl-C, with an access token."""
    _require_marimo()
    command = [sys.executable, "-m", "marimo", "run", str(problems_folder() / PAGE), "--token"]
    command += ["--port", str(port)] * (port is not None) + ["--headless"] * (not browser)
    try:
        ended = subprocess.run(command, check=False).returncode
    except KeyboardInterrupt:
        say("The page has ended.")
        return
    if ended:
        raise ProblemError("app: the server of the page has stopped; see its output above for the reason.")


def write(path: Path, first: int) -> str:
    """Write a page that opens at step `first`, and return a line to print."""
    module, found = _run()
    history, problem = found["history"], found["problem"]
    course, units = module.course_of(found["path"].value, problem), problem.units
    if not first <= history.steps:
        raise ProblemError(f"--step: found {first}; this run has the steps 1 to {history.steps}.")
    steps = sorted({first, *np.linspace(1, history.steps, FRAMES).round().astype(int).tolist()})
    at = {n: f"step {n} of {history.steps}, t = {history.times[history.row(n)]:.4g}" for n in steps}
    shown = "".join(
        f'<section aria-label="{at[n]}"{"" if n == first else " hidden"}>'
        f"{module.format_numbers(module.numbers_of(history, n))}"
        f"{module.format_pictures(module.pictures(history, n, course, units))}</section>"
        for n in steps
    )
    slider = (
        f'<label>time<input type="range" max="{len(steps) - 1}" value="{steps.index(first)}" autocomplete="off" '
        f'aria-valuetext="{at[first]}" oninput="{escape(SHOW)}"><output>{at[first]}</output></label>'
    )
    chosen = {name: found[name].value for name in ("scene", "family", "n")} | dict(found["settings"].value)
    chosen |= {"path": found["path"].value, "solver": found["solver"].value}
    words = ", ".join(f"{name} {value}" for name, value in chosen.items())
    write_text(path, page(problem.title, f"<p>{escape(words)}</p>{slider}{shown}", STYLE), "--html")
    return f"{path} shows {len(steps)} of {count_steps(history.steps)}."


def _run() -> tuple[Any, Mapping[str, Any]]:
    _require_marimo()
    path = problems_folder() / PAGE
    module = execute_file(path, "app")
    _, found = run_user_code(path, "running its cells", module.app.run)
    return module, found


def _require_marimo() -> None:
    if importlib.util.find_spec("marimo") is None:
        raise ProblemError("app: the live page needs marimo, which is not installed: pip install 'vemcvx[app]'")
