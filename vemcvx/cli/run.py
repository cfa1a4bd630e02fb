"""`vemcvx run` and `vemcvx export`: a problem solved, written, drawn; its programs for other solvers."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from vemcvx.arrays import Floats
from vemcvx.canvas import new_figure
from vemcvx.cli.options import CELLS, NONE, Accuracy, Condense, File, Linear, Mesh, N, Settings, SolverName
from vemcvx.cli.problem_file import Problem, is_file, read_problem
from vemcvx.cli.report import check_report, write_report
from vemcvx.cli.show import mesh_name
from vemcvx.cli.solver_names import named_linear, named_solver
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import listed, progress_bar, say
from vemcvx.errors import ProblemError
from vemcvx.estimate.adapt import adapt
from vemcvx.exchange import FORMATS, encoded, put
from vemcvx.history import History
from vemcvx.meshes import AnyMesh
from vemcvx.outline import coordinates
from vemcvx.owned_files import Owned
from vemcvx.plots import write_plots
from vemcvx.plots.pictures import check_pictures, left_out
from vemcvx.results.files import (
    ARCHIVE,
    SERIES,
    SUMMARY,
    Origin,
    check_replaceable,
    listed_tables,
    writable_folder,
    write_results,
)
from vemcvx.results.probe import places
from vemcvx.results.results import programs_of_steps
from vemcvx.simulation import simulate
from vemcvx.stepping.trajectory import CHECKPOINT, Folder

ROWS = "rows"
"""The folder, in the output folder, in which a run keeps completed steps until the history is written."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Simulate a problem, and say what came out and how certain it is."""

    file: File
    mesh: Mesh = None
    n: Annotated[
        int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 64; 8 in space and with --target)")
    ] = None
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of backward Euler. (default: 64; 8, with --target)")
    ] = None
    solver: SolverName = "newton"
    accuracy: Accuracy = None
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the history there, for ParaView and scripts.")
    ] = None
    plot: Annotated[bool, typer.Option("--plot", help="Write pictures into DIR, or results/<problem>.")] = False
    report: Annotated[
        bool, typer.Option("--report", help="Write report.html there, too; a run that is refused writes none.")
    ] = False
    store: Annotated[str, typer.Option(metavar="all|last|N", help="Steps to keep: all, the last, every N-th.")] = "all"
    condense: Condense = True
    resume: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Continue the interrupted run whose --out was DIR.")
    ] = None
    linear: Linear = None
    target: Annotated[
        float | None, typer.Option(metavar="X", help="Choose mesh and instants for this relative energy error: 0.02.")
    ] = None
    bound: Annotated[
        bool, typer.Option("--bound", help="Bound the error of the mesh in every step, from both sides: a theorem.")
    ] = False
    probes: Annotated[
        list[str], typer.Option("--probe", metavar="X,Y", help="A point (X,Y,Z in space) to follow; may be repeated.")
    ] = NONE
    settings: Settings = NONE

    def __call__(self) -> None:
        """Simulate, write and draw what is asked for, and say what came out."""
        if self.resume is not None and self.out is not None:
            raise ProblemError("--resume: a run goes on in the folder that holds it; leave --out away.")
        problem, folder = read_problem(self.file), self.out or self.resume
        drawings = folder or Path("results") / problem.name
        self._refuse_early(folder, drawings)
        usual = 64 if self.target is None else 8
        steps, n = self.steps or usual, self.n or problem.usual_n(usual, self.mesh)
        # The folder is held until the history is written: of two runs with one folder the second is refused.
        with nullcontext() if folder is None else Folder(folder / ROWS, self.resume is not None) as rows:
            mesh = problem.mesh(n, self.mesh)
            if self.points is not None:
                places(mesh, self.points, "--probe")
            if self.target is None:
                store = int(self.store) if self.store.isdecimal() else self.store
                history, told = self.simulated(problem, mesh, steps, store, rows)
            else:
                history, told = self._adapted(problem, mesh, steps, self.target)
            lines = [f"{problem.name}: {problem.title}", *told, history.summary(), *_extremes(history)]
            lines += self._written(history, problem, folder, n)
            if rows is not None:
                rows.remove()
        if self.plot:
            lines.append(f"pictures    {drawings}: {', '.join(path.name for path in write_plots(history, drawings))}")
            lines += [f"left out    {why}" for why in dict.fromkeys(left_out(history).values())]
        if self.report:
            path = write_report(
                drawings,
                problem,
                history,
                settings=self.settings,
                mesh=mesh_name(problem, self.mesh, n) + ", adapted" * (self.target is not None),
                points=self.points,
                command=self._command(problem, n, steps, folder),
            )
            lines.append(f"report      {path}")
        say("\n".join(lines))

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

    def simulated(
        self, problem: Problem, mesh: AnyMesh, steps: int, store: int | str | Sequence[int], rows: Folder | None = None
    ) -> tuple[History, list[str]]:
        """The history, made with a progress bar, and a line where it was resumed."""
        made, resumed = [], self.resume is not None
        with progress_bar("assembling") as shown:

            def advance(n: int, steps: int) -> None:
                made.append(n)
                shown("marching", n, steps)

            history = simulate(
                problem.scene(self.settings),
                mesh,
                problem.times(steps),
                solver=named_solver(self.solver, self.accuracy),
                initial=problem.initial,
                store=store,
                condense=self.condense,
                linear=named_linear(self.linear),
                progress=advance,
                stream=rows,
                resume=resumed,
                bound=self.bound,
            )
        return history, [f"resumed     after step {history.steps - len(made)} of {history.steps}"] if resumed else []

    def _adapted(self, problem: Problem, mesh: AnyMesh, steps: int, target: float) -> tuple[History, list[str]]:
        """The history on a mesh, and at instants, chosen for the target; those given are where that begins."""
        if self.resume or self.store != "all" or self.linear is not None or not self.condense:
            raise ProblemError("--target: adaptive runs take neither --resume, --store, --linear nor --no-condense.")
        solver, times = named_solver(self.solver, self.accuracy), problem.times(steps)
        found = adapt(
            problem.scene(self.settings),
            mesh,
            times,
            target,
            solver=solver,
            initial=problem.initial,
            estimate="bound" if self.bound else "residual",
        )
        return found.history, [found.summary()]

    def _refuse_early(self, folder: Path | None, drawings: Path) -> None:
        """Refuse a run that could not be resumed, written or drawn before it begins."""
        if self.resume and not os.path.isfile(self.resume / ROWS / CHECKPOINT):
            raise ProblemError(f"--resume: {folder} holds no interrupted run; begin one with --out {folder}.")
        if self.points is not None and folder is None and not self.report:
            raise ProblemError("--probe: displacements of points are written to DIR of --out DIR, or told by --report.")
        if self.plot or self.report:
            new_figure()
        if self.plot:
            check_pictures(drawings)
        if self.report:
            check_report(drawings)
        if self.plot or self.report or folder:
            writable_folder(drawings)
        if folder:
            check_replaceable(folder)

    def _written(self, history: History, problem: Problem, folder: Path | None, n: int) -> list[str]:
        if folder is None:
            drawn = self.plot or self.report
            return [] if drawn else ["files       none; --out DIR keeps the history, --plot draws it"]
        mesh = self.mesh or problem.family
        origin = Origin(problem.name, mesh, None if mesh is not None and is_file(mesh) else n)
        folder = write_results(history, folder, origin, self.points)
        tables = ", ".join(sorted(listed_tables(folder / SUMMARY)))
        return [f"files       {folder}: {SERIES} with {len(history.stored)} instants, {SUMMARY}, {ARCHIVE}, {tables}"]

    def _command(self, problem: Problem, n: int, steps: int, folder: Path | None) -> str:
        """The command that repeats the run."""
        family = self.mesh or problem.family
        given = [
            ("--mesh", family),
            ("--n", None if family is not None and is_file(family) else n),
            ("--steps", steps),
            ("--solver", self.solver),
            *(("--set", setting) for setting in self.settings),
            *(("--probe", probe) for probe in self.probes),
            ("--accuracy", self.accuracy),
            ("--linear", self.linear),
            ("--target", self.target),
            ("--out", folder),
            ("--store", None if self.store == "all" else self.store),
        ]
        flags = {
            "--no-condense": not self.condense,
            "--plot": self.plot,
            "--report": self.report,
            "--bound": self.bound,
        }
        words = [str(word) for name, value in given if value is not None for word in (name, value)]
        # Problems that came with the package go by their names.
        file = problem.name if problem.path.parent == problems_folder() else str(problem.path)
        return shlex.join(["vemcvx", "run", file, *words, *(name for name, is_set in flags.items() if is_set)])


def _extremes(history: History) -> Iterator[str]:
    """Largest displacement, stress, and so on over all stored steps, a line each."""
    for one in history.extremes:
        where = f"at {coordinates(one.place)}, t = {one.time:.6g}"
        yield f"{one.name:36s}{one.value:12.6g} {one.unit:14s} {where}"


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the convex programs of some steps, for other solvers, with their certified optima."""

    file: File
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="The steps to write; 1 is the first.")]
    form: Annotated[str, typer.Option("--format", help="npz, mtx, cbf, qps, mps or hdf5.")] = "npz"
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="(default: results/programs_<problem>)")] = None
    mesh: Mesh = None
    n: N = None
    of: Annotated[int, typer.Option(min=1, help="Steps of backward Euler that the run has.")] = 64
    solver: SolverName = "newton"
    accuracy: Accuracy = None
    condense: Condense = True
    linear: Linear = None
    settings: Settings = NONE

    def __call__(self) -> None:
        """Simulate, write the programs with words beside them, and say what was written."""
        problem = read_problem(self.file)
        such = f"numbers from 1 to {self.of} with commas between, such as 1,{self.of}"
        numbers = listed("--steps", self.steps, self._step, f"{such}; --of says how many steps the run has")
        if self.form not in FORMATS:
            raise ProblemError(f"--format: there is no format {self.form!r}; there are {', '.join(FORMATS)}.")
        with Owned(self.out or Path("results") / f"programs_{problem.name}") as folder:
            kept = sorted({m for n in numbers for m in (n - 1, n)})
            mesh = problem.mesh(self.n or problem.usual_n(16, self.mesh), self.mesh)
            run = Run(
                file=self.file,
                solver=self.solver,
                accuracy=self.accuracy,
                condense=self.condense,
                linear=self.linear,
                settings=self.settings,
            )
            history, _ = run.simulated(problem, mesh, self.of, kept)
            lines = [f"{problem.name}: {problem.title}", f"files       {folder.path}"]
            for program in programs_of_steps(history, numbers, self.condense):
                origin = {"problem": problem.name, "settings": list(self.settings), **program.origin}
                name, own = f"{problem.name}_{program.step}", replace(program, origin=origin)
                files = {f"{name}{end}": data for end, data in encoded(own, self.form).items()}
                put({file: data for file, data in files.items() if data or file in folder.names}, folder.take)
                low, high = program.bounds
                counts = f"{len(program.g)} unknowns, {len(program.w)} norm terms, {len(program.e)} limits"
                lines.append(f"{name}.{self.form}  {counts}; the optimum is between {low:.17g} and {high:.17g}")
        say("\n".join(lines))

    def _step(self, word: str) -> int:
        if not (word.isdecimal() and 1 <= int(word) <= self.of):
            raise ValueError
        return int(word)
