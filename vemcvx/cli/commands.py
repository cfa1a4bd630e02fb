"""The commands of the program.

A command is a class. The fields are options, and the docstring of the method `__call__` is the help text.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperGroup

from vemcvx.base.table import Table
from vemcvx.base.version import __version__
from vemcvx.cli.supplied import copy_lesson, lessons, problem_files, problems_folder
from vemcvx.cli.terminal import report_errors, say

KINDS = {
    "run": ("run", "Run"),
    "show": ("show", "Show"),
    "compare": ("compare", "Compare"),
    "export": ("export", "Export"),
    "collection": ("collection", "Collection"),
    "benchmark": ("collection.benchmark", "Benchmark"),
    "cost": ("cost", "Cost"),
    "fit": ("fitting", "Fitting"),
    "problems": ("commands", "Problems"),
    "lesson": ("commands", "Lesson"),
    "app": ("live_page", "App"),
    "doctor": ("doctor", "Doctor"),
}
"""Command -> module in this folder, and class."""


class Commands(TyperGroup):
    """The commands of the program, made at first use."""

    def __init__(self, **given: Any):
        super().__init__(**given)
        self.commands: dict[str, Any] = dict.fromkeys(KINDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command with this name, or None."""
        if cmd_name in KINDS and self.commands[cmd_name] is None:
            module, kind = KINDS[cmd_name]
            self.commands[cmd_name] = make_command(cmd_name, getattr(import_module(f"vemcvx.cli.{module}"), kind))
        return self.commands.get(cmd_name)


def make_command(name: str, kind: type[Any]) -> Any:
    """Return the command of a class."""

    def command(**given: Any) -> None:
        with report_errors():
            kind(**given)()

    command.__doc__ = kind.__call__.__doc__
    command.__annotations__ = types = get_type_hints(kind, include_extras=True)
    parameters = inspect.signature(kind).parameters.values()
    typed = [parameter.replace(annotation=types[parameter.name]) for parameter in parameters]
    command.__signature__ = inspect.Signature(typed)  # type: ignore[attr-defined]
    alone = typer.Typer(add_completion=False)
    alone.command(name)(command)
    return typer.main.get_command(alone)


@dataclass(frozen=True)
class Problems:
    """The command `vemcvx problems`."""

    def __call__(self) -> None:
        """List the problem files of the package. Commands such as `run` and `show` take a name from this list."""
        typer.echo(Table((), [(name, file.sentence) for name, file in problem_files().items()]).text())
        say(f"\nvemcvx run NAME simulates one. The files are in {problems_folder()}")


@dataclass(frozen=True)
class Lesson:
    """The command `vemcvx lesson`."""

    number: Annotated[int | None, typer.Argument(metavar="[N]", help="Lesson number. (default: list all)")] = None
    notebook: Annotated[bool, typer.Option("--notebook", help="Copy the lesson as a notebook, .ipynb.")] = False

    def __call__(self) -> None:
        """List the lessons, or copy lesson N and its solutions into this folder; no file is overwritten."""
        if self.number is None:
            rows = [(str(n), file.sentence.removeprefix(f"Lesson {n}, ")) for n, file in lessons().items()]
            typer.echo(Table((), rows).text())
            say("\nvemcvx lesson N copies lesson N and its solutions into this folder.")
            return
        for path in copy_lesson(self.number, self.notebook):
            say(f"{path}")
        places = "VS Code, Jupyter (jupytext) or marimo, or run it with Python"
        say(f"Open the lesson {'in Jupyter or VS Code' if self.notebook else f'as a notebook in {places}'}.")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"vemcvx {__version__}")
        raise typer.Exit


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Quasistatic frictional contact on polygonal meshes, posed as certified convex programs.",
    epilog="Exit codes: 0 done, 2 invalid input, 3 not certified.",
)


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show version.")] = False,
) -> None:
    """Handle the options of the program itself."""


def main() -> None:
    """Run the command line on the program's arguments."""
    app(prog_name="vemcvx")
