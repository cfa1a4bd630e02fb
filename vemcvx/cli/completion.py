"""Completion in the shell of problems, families, solvers and lessons; `vemcvx --install-completion` turns it on.

Packages are imported when a name is asked for; where nothing fits, shells go on with the names of files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path


def _completing(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """A function for typer; of words with commas it completes the last."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in names() if name.startswith(last)]

    return complete


def _problems() -> list[str]:
    from vemcvx.cli.supplied import problem_files

    return [*problem_files(), *(path.name for path in sorted(Path().glob("*.py")))]


def _families() -> list[str]:
    from vemcvx.meshes import FAMILIES

    return list(FAMILIES)


def _solvers() -> list[str]:
    from vemcvx.cli.solver_names import NAMES
    from vemcvx.solvers.conic import TUNED

    return sorted({*NAMES, *(name.lower() for name in TUNED)})


def _linear_solvers() -> list[str]:
    from vemcvx.cli.solver_names import LINEAR

    return list(LINEAR)


def _lessons() -> list[str]:
    from vemcvx.cli.supplied import lessons

    return [str(number) for number in lessons()]


problems, families, solvers = _completing(_problems), _completing(_families), _completing(_solvers)
linear_solvers, lessons = _completing(_linear_solvers), _completing(_lessons)
