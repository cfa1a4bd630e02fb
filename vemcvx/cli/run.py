"""`vemcvx run` and `vemcvx export`: a problem solved, written, drawn; its programs for other solvers."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from vemcvx.base.arrays import Floats
from vemcvx.base.canvas import new_figure
from vemcvx.base.errors import ProblemError, VemcvxError, quietly
from vemcvx.base.outline import coordinates
from vemcvx.base.owned_files import Owned
from vemcvx.cli.options import CELLS, NONE, Accuracy, Condense, File, Linear, Mesh, N, Of, Settings, SolverName
from vemcvx.cli.problem_file import SPACE_N, Problem, is_file, read_problem
from vemcvx.cli.report import REPORT, check_report, with_errors, write_report
from vemcvx.cli.show import mesh_name
from vemcvx.cli.solver_names import named_linear, named_solver, served
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import EVERY, INVALID, NOT_CERTIFIED, Shown, listed, progress_bar, say
from vemcvx.cost import Ingredients, study
from vemcvx.cost.foreseen import Growth, check_fits
from vemcvx.cost.workers import DONE, outcome, pool
from vemcvx.cost.workers import NOT_CERTIFIED as MISSED
from vemcvx.estimate.adapt import OF, Pass
from vemcvx.exchange import FORMATS, encoded
from vemcvx.history import History
from vemcvx.meshes import Mesh as AnyMesh
from vemcvx.plots import write_plots
from vemcvx.plots.pictures import PICTURES, check_pictures, left_out
from vemcvx.plots.style import Units, in_units
from vemcvx.results import files
from vemcvx.results.files import ARCHIVE, SERIES, SUMMARY, Origin, write_results
from vemcvx.results.probe import places
from vemcvx.results.results import programs_of_steps
from vemcvx.results.tables import FILES
from vemcvx.simulation import warn_of_turns
from vemcvx.stepping import CHECKPOINT, Folder, stored_steps

ROWS = "rows"
"""The folder, in the output folder, in which a run keeps completed steps until the history is written."""


SPELT = {"settings": "set", "probes": "probe"}
"""Options whose names are not those of their fields."""


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
        float | None, typer.Option(metavar="X", help="Choose mesh and instants for this relative error: 0.02.")
    ] = None
    of: Of = "energy"
    bound: Annotated[
        bool, typer.Option("--bound", help="Bound the error of the mesh in every step, from both sides: a theorem.")
    ] = False
    probes: Annotated[
        list[str], typer.Option("--probe", metavar="X,Y", help="A point (X,Y,Z in space) to follow; may be repeated.")
    ] = NONE
    settings: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="NAME=VALUE,...",
            help="A parameter of the scene; of several values, and of several parameters, all combinations are run.",
        ),
    ] = NONE
    results: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help=f"Results that such a study shows. (default: {','.join(study.USUAL)})"),
    ] = None
    workers: Annotated[int, typer.Option(min=1, help="Processes at once, of a study.")] = 2

    def __call__(self) -> None:
        """Simulate, write and draw what is asked for, and say what came out."""
        problem = read_problem(self.file)
        several = problem.studied(self.settings)
        if served(self.linear, len(several)):
            return
        if len(several) > 1:
            self._study(problem, several)
        elif self.results:
            raise ProblemError("--results: chooses what a study shows; give a parameter several values, --set a=1,2.")
        else:
            say("\n".join(self.made(problem)[1]))

    def made(self, problem: Problem) -> tuple[History, list[str]]:
        """The history, written and drawn as asked for, and what there is to say of it."""
        if self.resume is not None and self.out is not None:
            raise ProblemError("--resume: a run continues in the folder that holds it; omit --out.")
        folder = self.out or self.resume
        drawings = folder or Path("results") / problem.name
        self._refuse_early(folder, drawings)
        usual = 64 if self.target is None else 8
        steps, n = self.steps or usual, self.n or problem.usual_n(usual, self.mesh)
        # The folder is held until the history is written: of two runs with one folder the second is refused.
        held = nullcontext() if folder is None else Folder(folder / ROWS, self.resume is not None)
        with held as rows, progress_bar("meshing") as shown:
            if self.target is None:
                self._foresee(problem, n, steps, folder)
            mesh, left = problem.mesh(n, self.mesh, self.settings), ""
            file = (self.n is not None or self.report) and problem.ignores_n(mesh, n, self.mesh)
            if file and self.n is not None:
                same = "this mesh is the same for every n, as that of a file is"
                say(f"vemcvx: --n: {self.n} changes nothing; {same}.", err=True)
            if self.points is not None:
                places(mesh, self.points, "--probe")
            if self.target is None:
                history, told = self.simulated(problem, mesh, steps, self._stored, shown=shown, rows=rows)
            else:
                history, told = self._adapted(problem, mesh, steps, self.target, shown)
            if self.report:
                shown("estimating errors, in finer steps and on a finer mesh", 0, None)
                history, left = with_errors(history)
            lines = self._said(history, problem, folder, n, shown)
            if rows is not None:
                rows.clear()
        if self.plot:
            drawn = write_plots(history, drawings, units=problem.units)
            lines.append(f"pictures    {drawings}: {', '.join(path.name for path in drawn)}")
            lines += [f"left out    {why}" for why in dict.fromkeys(left_out(history).values())]
        if self.report:
            path = write_report(
                drawings,
                problem,
                history,
                settings=self.settings,
                mesh=mesh_name(problem, self.mesh, None if file else n) + ", adapted" * (self.target is not None),
                points=self.points,
                command=self._command(problem, None if file else n, steps, folder),
                why=left,
            )
            lines.append(f"report      {path}")
        made = {REPORT: self.report} | {f"{name}.png": self.plot for name in PICTURES}
        earlier = [name for name, anew in made.items() if folder is not None and not anew and (folder / name).exists()]
        if earlier:
            lines.append(f"remain      {', '.join(earlier)}: of an earlier run; --report and --plot make them anew")
        return history, [f"{problem.name}: {problem.title}", *told, *lines]

    def _study(self, problem: Problem, several: list[tuple[str, ...]]) -> None:
        """Run all combinations, each in a process and a folder of its own, and say what came out."""
        chosen = study.chosen_results(self.results.split(",") if self.results else ())
        if self.resume is not None or (self.report and self.out is None):
            raise ProblemError(
                "--set: several runs have folders of their own in DIR of --out DIR; none can be resumed."
            )
        drawings = self.out or Path("results") / problem.name
        if self.plot:
            new_figure()
        if self.plot or self.out:
            study.claim(drawings)
        folders = [self.out and self.out / name for name in study.folder_names(several)]
        runs = [
            (k, replace(self, settings=list(each), out=out, plot=False))
            for k, (each, out) in enumerate(zip(several, folders, strict=True))
        ]
        found: dict[int, study.Row] = {}
        with progress_bar("runs") as shown, pool(self.workers, None) as run:
            shown("runs", 0, len(runs))
            for k, row in run(_attempted, runs):
                found[k] = row
                shown("runs", len(found), len(runs))
        rows, title = [found[k] for k in range(len(runs))], f"{problem.name}: {problem.title}"
        figure = study.picture(rows, chosen, title) if self.plot and study.shown(rows, chosen) else None
        lines = [title, study.table(rows, chosen).text(), *study.said_of(rows)]
        if self.out:
            lines.append(f"files       {self.out}: {', '.join(study.write(rows, self.out, figure))}, a folder a run")
        elif figure is not None:
            (name,) = study.write(rows, drawings, figure, tables=False)
            lines.append(f"picture     {drawings / name}")
        say("\n".join(lines))
        if failed := {row.status for row in rows} - {DONE}:
            raise typer.Exit(NOT_CERTIFIED if failed == {MISSED} else INVALID)

    def _foresee(self, problem: Problem, n: int, steps: int, folder: Path | None) -> None:
        """Say what a long run will take; refuse one that this machine has no memory or no room for."""
        # Of up to 256 steps, on meshes of the usual size, all runs take seconds.
        if (n <= SPACE_N and steps <= 256) or (self.mesh is not None and is_file(self.mesh)):
            return
        stored = len(stored_steps(self._stored, steps))
        try:
            if n <= problem.usual_n(64, self.mesh) and steps <= 256:
                return
            with quietly():
                growth = Growth.of(lambda n: problem.mesh(n, self.mesh))
        except VemcvxError:
            return  # The file may know no coarse meshes.
        found = check_fits(growth, n, steps, stored, named_linear(self.linear), folder=folder)
        if found.seconds > EVERY:
            say(f"foreseen    {found}", err=True)

    @property
    def _stored(self) -> int | str:
        return int(self.store) if self.store.isdecimal() else self.store

    @property
    def points(self) -> Floats | None:
        """The probes as points (p, dim), None without any."""
        if not self.probes:
            return None
        try:
            points = np.array([[float(word) for word in probe.split(",")] for probe in self.probes])
            if points.shape[1] not in (2, 3):
                raise ValueError
            return points
        except ValueError:
            found = ", ".join(map(repr, self.probes))
            raise ProblemError(f"--probe: found {found}; wanted points, such as 0.5,0.25.") from None

    def simulated(
        self,
        problem: Problem,
        mesh: AnyMesh,
        steps: int,
        store: int | str | Sequence[int],
        *,
        shown: Shown,
        rows: Folder | None = None,
    ) -> tuple[History, list[str]]:
        """The history, and a line where it was resumed; it is `shown` how far that is."""
        made, resumed = [], self.resume is not None
        shown("assembling", 0, None)

        def advance(n: int, steps: int) -> None:
            made.append(n)
            shown("marching", n, steps)

        linear, posed = named_linear(self.linear), self._posed(problem, mesh, steps)
        warn_of_turns(posed.scene, mesh, posed.times)
        how: dict[str, Any] = {"condense": self.condense, "linear": linear, "bound": self.bound, "stream": rows}
        history = posed.simulated(store=store, progress=advance, resume=resumed, **how)
        return history, [f"resumed     after step {history.steps - len(made)} of {history.steps}"] if resumed else []

    def _posed(self, problem: Problem, mesh: AnyMesh, steps: int) -> Ingredients:
        return problem.posed(self.settings, mesh, steps, named_solver(self.solver, self.accuracy))

    def _adapted(
        self, problem: Problem, mesh: AnyMesh, steps: int, target: float, shown: Shown
    ) -> tuple[History, list[str]]:
        """The history on a mesh, and at instants, chosen for the target; those given are where that begins."""
        if self.resume or self.store != "all" or self.linear is not None or not self.condense:
            raise ProblemError("--target: adaptive runs take neither --resume, --store, --linear nor --no-condense.")
        posed = self._posed(problem, mesh, steps)
        shown("adapting", 0, None)

        def told(now: Pass) -> None:
            shown(f"adapting, {now.unknowns} unknowns and {now.steps} steps have {now.total:.1%}", 0, None)

        estimate = "bound" if self.bound else "residual"
        found = posed.adapted(posed.times[1:], target, progress=told, of=self.of, estimate=estimate)
        return found.history, [found.summary()]

    def _refuse_early(self, folder: Path | None, drawings: Path) -> None:
        if self.of not in OF:
            raise ProblemError(f"--of: found {self.of!r}; a target is of {', '.join(OF)}.")
        if self.of != "energy" and self.target is None:
            raise ProblemError(f"--of: {self.of} goes with --target X, the relative error that mesh and steps are for.")
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
            files.writable_folder(drawings)
        if folder:
            files.check_replaceable(folder)

    def _said(self, history: History, problem: Problem, folder: Path | None, n: int, shown: Shown) -> list[str]:
        """The summary and the extremes of a history in words, and the files to which it is written."""
        shown("extremes", 0, None)
        extremes, start = list(_extremes(history, problem.units)), time.perf_counter()
        if folder is None:
            none = "files       none; --out DIR keeps the history, --plot draws it"
            return [history.summary(), *extremes, *([] if self.plot or self.report else [none])]
        mesh = self.mesh or problem.family
        origin = Origin(problem.name, mesh, None if mesh is not None and is_file(mesh) else n)
        write_results(history, folder, origin, self.points, lambda *now: shown("writing", *now))
        seconds = {**history.seconds, "write": time.perf_counter() - start}
        names = SUMMARY, ARCHIVE, *sorted(name for name in FILES.values() if (folder / name).is_file())
        told = f"files       {folder}: {SERIES} with {len(history.stored)} instants, {', '.join(names)}"
        return [replace(history, seconds=seconds).summary(), *extremes, told]

    def _command(self, problem: Problem, n: int | None, steps: int, folder: Path | None) -> str:
        """The command that repeats the run."""
        # Problems that came with the package go by their names.
        file = problem.name if problem.path.parent == problems_folder() else str(problem.path)
        words, mesh = [file], self.mesh or (problem.family if n is not None else None)
        same = replace(self, mesh=mesh, n=n, steps=steps, out=folder, resume=None)
        usual = {field.name: field.default for field in fields(Run) if field.name not in ("file", "solver")}
        for name, value in asdict(same).items():
            option = f"--{SPELT.get(name, name)}"
            if name == "condense":
                words += [] if value else ["--no-condense"]
            elif isinstance(value, list | tuple):
                words += [word for one in value for word in (option, one)]
            elif name != "file" and value != usual.get(name):
                words += [option] if value is True else [option, str(value)]
        return shlex.join(["vemcvx", "run", *words])


def _attempted(number: int, run: Run) -> tuple[int, study.Row]:
    """The row of one run of a study, made in a process of its own."""
    settings = dict(setting.split("=", 1) for setting in run.settings)
    status, found = outcome(_made, run)
    if status != DONE:
        return number, study.Row(settings, status=status, message=found)
    return number, study.Row(settings, str(run.out) if run.out else None, **found)


def _made(run: Run) -> dict[str, Any]:
    """The results of a run, and its warnings."""
    with study.heard() as said:
        history, _ = run.made(problem := read_problem(run.file))
    met, aim = None, (history.quantities or {}).get(run.of)
    if run.target is not None and history.errors is not None:
        met = (history.errors["total"] if aim is None else history.errors["algebra"] + aim.relative) <= run.target
    return {"warnings": tuple(dict.fromkeys(said)), "met": met, **study.results_of(history, problem.units)}


def _extremes(history: History, units: Units | None) -> Iterator[str]:
    for one in history.extremes:
        where = f"at {coordinates(one.place)}, t = {one.time:.6g} {(units or {}).get('time', '')}".rstrip()
        yield f"{one.name:36s}{one.value:12.6g} {in_units(one.unit, units):14s} {where if one.value else ''}".rstrip()
        if one.unbounded:
            yield f"{'':48s} {one.unbounded}"


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the convex programs of some steps, for other solvers, with their certified optima."""

    file: File
    steps: Annotated[
        str, typer.Option(metavar="N,N-N,...", help="The steps to write, 1-8 for a range; 1 is the first.")
    ]
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
        if served(self.linear):
            return
        problem = read_problem(self.file)
        such = f"numbers from 1 to {self.of} with commas between, or ranges, such as 1,{self.of} or 1-{self.of}"
        runs = listed("--steps", self.steps, self._steps, f"{such}; --of says how many steps the run has")
        numbers = tuple(dict.fromkeys(n for run in runs for n in run))
        if self.form not in FORMATS:
            raise ProblemError(f"--format: there is no format {self.form!r}; there are {', '.join(FORMATS)}.")
        with Owned(self.out or Path("results") / f"programs_{problem.name}") as folder:
            kept = sorted({m for n in numbers for m in (n - 1, n)})
            mesh = problem.mesh(self.n or problem.usual_n(16, self.mesh), self.mesh, self.settings)
            same = ("file", "solver", "accuracy", "condense", "linear", "settings")
            run = Run(**{name: getattr(self, name) for name in same})
            with progress_bar("assembling") as shown:
                history, _ = run.simulated(problem, mesh, self.of, kept, shown=shown)
            lines = [f"{problem.name}: {problem.title}", f"files       {folder.path}"]
            for program in programs_of_steps(history, numbers, self.condense):
                origin = {"problem": problem.name, "settings": list(self.settings), **program.origin}
                name, own = f"{problem.name}_{program.step}", replace(program, origin=origin)
                for end, data in encoded(own, self.form).items():
                    folder.write(f"{name}{end}", data)
                low, high = program.bounds
                counts = f"{len(program.g)} unknowns, {len(program.w)} norm terms, {len(program.e)} limits"
                lines.append(f"{name}.{self.form}  {counts}; the optimum is between {low:.17g} and {high:.17g}")
        say("\n".join(lines))

    def _steps(self, words: str) -> range:
        first, dash, last = words.partition("-")
        last = last if dash else first
        if not (first.isdecimal() and last.isdecimal() and 1 <= int(first) <= int(last) <= self.of):
            raise ValueError
        return range(int(first), int(last) + 1)
