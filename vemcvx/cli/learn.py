"""`vemcvx problems`, `lesson`, `app` and `doctor`: what came with the package, and whether it works here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vemcvx.cli import completion
from vemcvx.cli.terminal import reported, say, say_words
from vemcvx.errors import ProblemError


def problems() -> None:
    """List the problem files that came with the package; run, show, compare, cost and export take their names."""
    with reported():
        from vemcvx.cli.supplied import problem_files, problems_folder

        say_words((name, file.sentence) for name, file in problem_files().items())
        say(f"\nvemcvx run NAME simulates one. The files are in {problems_folder()}")


def lesson(
    number: Annotated[
        int | None,
        typer.Argument(metavar="[N]", autocompletion=completion.lessons, help="Which one; without it they are listed."),
    ] = None,
) -> None:
    """List the lessons, or copy lesson N and its solutions into this folder; no file is overwritten."""
    with reported():
        from vemcvx.cli.supplied import copy_lesson, lessons

        if number is None:
            say_words((str(n), file.sentence.removeprefix(f"Lesson {n}, ")) for n, file in lessons().items())
            say("\nvemcvx lesson N copies lesson N and its solutions into this folder.")
            return
        for path in copy_lesson(number, Path()):
            say(f"{path}")
        say("Open it as a notebook in VS Code, Jupyter (jupytext) or marimo, or run it by python.")


def app(
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Where it listens, on this machine. (default: a free one)")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    check: Annotated[bool, typer.Option("--check", help="Run it without a browser, and say whether it works.")] = False,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write it as a page that needs no Python.")] = None,
) -> None:
    """Open a live page: change scene, mesh, friction, load and solver, and see what sticks and slips (extra app)."""
    with reported():
        from vemcvx.cli import live_page
        from vemcvx.cli.compare import check_writable

        if check and html is not None:
            raise ProblemError("app: found --check and --html; give one of them.")
        if html is not None:
            check_writable(html, "--html")
            say(live_page.write(html))
        elif check:
            say(live_page.check())
        else:
            try:
                live_page.serve(port, browser)
            except KeyboardInterrupt:
                say("The page has ended.")


def doctor() -> None:
    """Say what is installed and which solvers work, and test a closed form; exit code 1 if not all is well."""
    with reported():
        from vemcvx.cli.doctor import findings

        ill = []
        for found in findings():
            say_words([(f"{found.subject:14}", found.words)])
            ill += [] if found.well else [found.subject]
        say(f"\nNot well: {', '.join(ill)}." if ill else "\nAll is well.")
        if ill:
            raise typer.Exit(1)
