"""The program and its commands.

Results go to standard output; errors, warnings and the progress bar (on a terminal only) go to standard error.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from vemcvx.base.errors import ProblemError
from vemcvx.base.version import __version__
from vemcvx.cli.collection import Collection
from vemcvx.cli.collection.benchmark import Benchmark
from vemcvx.cli.compare import Compare
from vemcvx.cli.cost import Cost
from vemcvx.cli.doctor import Doctor
from vemcvx.cli.live_page import App
from vemcvx.cli.options import add_command, lesson_numbers
from vemcvx.cli.run import Export, Run
from vemcvx.cli.show import Show
from vemcvx.cli.supplied import copy_lesson, lessons, problem_files, problems_folder
from vemcvx.cli.terminal import say
from vemcvx.results.table import Table


@dataclass(frozen=True)
class Problems:
    """List the problem files that came with the package; run, show, compare, cost and export take their names."""

    def __call__(self) -> None:
        """Print a sentence on each."""
        typer.echo(Table((), [(name, file.sentence) for name, file in problem_files().items()]).text())
        say(f"\nvemcvx run NAME simulates one. The files are in {problems_folder()}")


@dataclass(frozen=True)
class Lesson:
    """List the lessons, or copy lesson N and its solutions into this folder; no file is overwritten."""

    number: Annotated[
        int | None,
        typer.Argument(metavar="[N]", autocompletion=lesson_numbers, help="Its number; without it they are listed."),
    ] = None
    notebook: Annotated[bool, typer.Option("--notebook", help="Copy them as notebooks, .ipynb.")] = False
    no_solutions: Annotated[
        bool, typer.Option("--no-solutions", help="Copy the lesson alone, as one hands it out for homework.")
    ] = False

    def __call__(self) -> None:
        """List or copy."""
        given = [name for name, set_ in (("--notebook", self.notebook), ("--no-solutions", self.no_solutions)) if set_]
        if self.number is None and given:
            raise ProblemError(f"lesson: found {given[0]} without a number; `vemcvx lesson` lists the lessons.")
        if self.number is None:
            rows = [(str(n), file.sentence.removeprefix(f"Lesson {n}, ")) for n, file in lessons().items()]
            typer.echo(Table((), rows).text())
            say("\nvemcvx lesson N copies lesson N and its solutions into this folder.")
            return
        for path in copy_lesson(self.number, Path(), self.notebook, not self.no_solutions):
            say(f"{path}")
        say(
            "Open it in Jupyter or VS Code."
            if self.notebook
            else "Open it as a notebook in VS Code, Jupyter (jupytext) or marimo, or run it by python."
        )


app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Quasistatic frictional contact on polygonal meshes, posed as certified convex programs.",
    epilog="Exit codes: 0 done, 2 invalid input, 3 not certified.",
)
for kind in (Run, Show, Compare, Export, Collection, Benchmark, Cost, Problems, Lesson, App, Doctor):
    add_command(app, kind)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"vemcvx {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    """Options of the program itself."""


def main() -> None:
    """Run the command line on the program's arguments."""
    app(prog_name="vemcvx")
