"""`vemcvx fit`: fit parameters of a problem to a measured loop."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import ProblemError
from vemcvx.cli.options import NONE, File, Mesh, N, Settings
from vemcvx.cli.problem_file import read_problem
from vemcvx.cli.terminal import say
from vemcvx.scene import Scene
from vemcvx.sensitivity import fit


@dataclass(frozen=True, kw_only=True)
class Fitting:
    """The command `vemcvx fit`."""

    file: File
    measured: Annotated[Path, typer.Option(metavar="FILE.csv", help="A table of t and measured values.")]
    by: Annotated[str, typer.Option(metavar="NAME,NAME", help="Parameters to fit; they keep their signs.")]
    mesh: Mesh = None
    n: N = None
    settings: Settings = NONE

    def __call__(self) -> None:
        """Fit parameters of a problem to a measured loop, and print them with standard errors."""
        problem, (times, measured) = read_problem(self.file), read_measured(self.measured)
        names, given = tuple(name.strip() for name in self.by.split(",")), problem.numbers(self.settings)
        if not given.keys() >= set(names):
            known = ", ".join(given) or "none"
            raise ProblemError(f"--by: found {self.by}; wanted parameters of the scene that are numbers: {known}.")
        start = np.array([given[name] for name in names])
        mesh = problem.mesh(self.n or problem.default_n(16, self.mesh), self.mesh, self.settings)
        others = [setting for setting in self.settings if setting.partition("=")[0] not in names]

        def scene_of(theta: Floats) -> Scene:
            return problem.scene([*others, *(f"{name}={x!r}" for name, x in zip(names, theta.tolist(), strict=True))])

        signs = np.where(start < 0, -np.inf, 0.0), np.where(start < 0, 0.0, np.inf)
        found = fit(scene_of, start, mesh, times, measured, bounds=signs, names=names, initial=problem.initial)
        say(found.outline().text())


def read_measured(path: Path) -> tuple[Floats, dict[str, Floats]]:
    """Return the instants and the measured columns of a CSV file."""
    import csv

    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            columns = list(zip(*filter(None, csv.reader(file)), strict=True))
        found = {name.strip(): np.array([cell.strip() or "nan" for cell in cells], float) for name, *cells in columns}
        if len(found) < len(columns):
            raise ValueError("a name is repeated")
        return found.pop("t"), found
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise ProblemError(
            f"--measured: {path} cannot be read: {error}. Wanted a table with commas. Its first line names a column t "
            'and quantities such as "reaction of top x". Each later line has a number or nothing in each column.'
        ) from error
