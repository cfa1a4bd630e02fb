"""`vemcvx export`: write the convex programs of some steps, for other solvers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from vemcvx.base.arrays import choice
from vemcvx.base.errors import ProblemError
from vemcvx.base.owned_files import Owned
from vemcvx.cli.options import NONE, Accuracy, Condense, File, Mesh, N, Settings, SolverName
from vemcvx.cli.problem_file import read_problem
from vemcvx.cli.solver_names import make_solver
from vemcvx.cli.terminal import parse_list, progress_bar, say
from vemcvx.exchange import FORMATS, encode_program
from vemcvx.results import programs_of_steps


@dataclass(frozen=True, kw_only=True)
class Export:
    """The command `vemcvx export`."""

    file: File
    steps: Annotated[str, typer.Option(metavar="N,N-N,...", help="The steps to write; 1 is the first.")]
    form: Annotated[str, typer.Option("--format", help="npz, mtx, cbf, qps, mps or hdf5.")] = "npz"
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="(default: results/programs_<problem>)")] = None
    mesh: Mesh = None
    n: N = None
    of: Annotated[int, typer.Option(min=1, help="Number of steps of the run.")] = 64
    solver: SolverName = "newton"
    accuracy: Accuracy = None
    condense: Condense = True
    settings: Settings = NONE

    def __call__(self) -> None:
        """Write the convex programs of some steps, for other solvers, with their certified optima."""
        problem = read_problem(self.file)
        such = f"numbers or ranges from 1 to {self.of}, such as 1,{self.of} or 1-{self.of}; --of is the number of steps"
        runs = parse_list("--steps", self.steps, self._steps, such)
        numbers = tuple(dict.fromkeys(n for run in runs for n in run))
        choice(self.form, "--format", "format", list(FORMATS), ProblemError)
        with Owned(self.out or Path("results") / f"programs_{problem.name}") as folder:
            kept = sorted({m for n in numbers for m in (n - 1, n)})
            mesh = problem.mesh(self.n or problem.default_n(16, self.mesh), self.mesh, self.settings)
            posed = problem.pose(self.settings, mesh, self.of, make_solver(self.solver, self.accuracy))
            with progress_bar("assembling") as show:
                history = posed.simulate(condense=self.condense, store=kept, progress=partial(show, "marching"))
            lines = [f"{problem.name}: {problem.title}", f"files       {folder.path}"]
            for program in programs_of_steps(history, numbers, self.condense):
                origin = {"problem": problem.name, "settings": list(self.settings), **program.origin}
                name, own = f"{problem.name}_{program.step}", replace(program, origin=origin)
                for end, data in encode_program(own, self.form).items():
                    folder.write(f"{name}{end}", data)
                low, high = program.bounds
                counts = f"{len(program.g)} unknowns, {len(program.w)} norm terms, {len(program.e)} limits"
                lines.append(f"{name}.{self.form}  {counts}; the optimum is between {low:.17g} and {high:.17g}")
        say("\n".join(lines))

    def _steps(self, words: str) -> range:
        first, dash, last = words.partition("-")
        steps = range(int(first), int(last if dash else first) + 1)
        if not steps or steps[0] < 1 or steps[-1] > self.of:
            raise ValueError
        return steps
