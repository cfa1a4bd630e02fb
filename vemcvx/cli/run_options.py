"""The options of a run, and the command that repeats it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.cli.problem_file import Problem, is_file
from vemcvx.cli.solver_names import named_solver
from vemcvx.cli.supplied import problems_folder
from vemcvx.errors import ProblemError
from vemcvx.solvers import Solver


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """The options of the command; `target` is a relative energy error, `probes` are points "x,y"."""

    family: str | None
    n: int
    steps: int
    solver: str
    accuracy: float | None
    out: Path | None
    condense: bool
    settings: tuple[str, ...]
    linear: str | None
    plot: bool = False
    report: bool = False
    store: str | tuple[int, ...] = "all"
    resume: bool = False
    target: float | None = None
    probes: tuple[str, ...] = ()

    def make_solver(self) -> Solver:
        """The solver of that name, asked for that accuracy."""
        return named_solver(self.solver, self.accuracy)

    @property
    def points(self) -> Floats | None:
        """The probes as points (p, dim), None without any."""
        if not self.probes:
            return None
        try:
            return np.array([[float(word) for word in probe.split(",")] for probe in self.probes])
        except ValueError:
            found = ", ".join(map(repr, self.probes))
            raise ProblemError(f"--probe: found {found}; wanted points, such as 0.5,0.25.") from None

    def drawings(self, problem: Problem) -> Path:
        """The folder of pictures and of the report."""
        return self.out or Path("results") / problem.name

    def command(self, problem: Problem) -> str:
        """The command that repeats the run."""
        family = self.family or problem.family
        given = [
            ("--mesh", family),
            ("--n", None if family is not None and is_file(family) else self.n),
            ("--steps", self.steps),
            ("--solver", self.solver),
            *(("--set", setting) for setting in self.settings),
            *(("--probe", probe) for probe in self.probes),
            ("--accuracy", self.accuracy),
            ("--linear", self.linear),
            ("--target", self.target),
            ("--out", self.out),
            ("--store", None if self.store == "all" else self.store),
        ]
        flags = {"--no-condense": not self.condense, "--plot": self.plot, "--report": self.report}
        words = [str(word) for name, value in given if value is not None for word in (name, value)]
        # Problems that came with the package go by their names.
        file = problem.name if problem.path.parent == problems_folder() else str(problem.path)
        return shlex.join(["vemcvx", "run", file, *words, *(name for name, is_set in flags.items() if is_set)])
