"""`vemcvx run`: simulate a problem, once or for all combinations of several settings."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from logging.handlers import BufferingHandler
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from vemcvx.base.canvas import new_figure
from vemcvx.base.errors import ProblemError, quietly
from vemcvx.base.outline import coordinates, count_steps
from vemcvx.base.owned_files import Owned
from vemcvx.cli.options import NONE, Accuracy, Condense, File, FineN, Linear, Mesh, SolverName
from vemcvx.cli.problem_file import Posed, Problem, is_file, mesh_name, read_problem
from vemcvx.cli.solver_names import make_linear_solver, make_solver, serve_ranks
from vemcvx.cli.terminal import INVALID, NOT_CERTIFIED, ShowProgress, progress_bar, say
from vemcvx.cost import study
from vemcvx.cost.rows import Row, figures, units_of
from vemcvx.cost.workers import DONE, call_safely
from vemcvx.cost.workers import NOT_CERTIFIED as MISSED
from vemcvx.history import History, joined
from vemcvx.meshes import Mesh as AnyMesh
from vemcvx.plots.style import Units, in_units
from vemcvx.results import files, largest
from vemcvx.results.files import ARCHIVE, SERIES, SUMMARY, Origin, write_results
from vemcvx.results.tables import FILES
from vemcvx.stepping import CHECKPOINT, Folder

REPORT = "report.html"
ROWS = "rows"
"""Subfolder for completed steps, until the history is written."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """The command `vemcvx run`."""

    file: File
    mesh: Mesh = None
    n: FineN = None
    steps: Annotated[int | None, typer.Option(min=1, help="Time steps. (default: 64; 8 with --target)")] = None
    solver: SolverName = "newton"
    accuracy: Accuracy = None
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write the history to DIR, for ParaView.")] = None
    plot: Annotated[bool, typer.Option("--plot", help="Write pictures into DIR, or results/<problem>.")] = False
    report: Annotated[bool, typer.Option("--report", help="Write report.html into the same folder.")] = False
    store: Annotated[str, typer.Option(metavar="all|last|N", help="Steps to keep: all, the last, every N-th.")] = "all"
    condense: Condense = True
    resume: Annotated[Path | None, typer.Option(metavar="DIR", help="Continue the interrupted run in DIR.")] = None
    linear: Linear = None
    target: Annotated[float | None, typer.Option(metavar="X", help="Choose mesh and steps for this error.")] = None
    bound: Annotated[bool, typer.Option("--bound", help="Guaranteed bounds on the mesh error of every step.")] = False
    settings: Annotated[
        list[str], typer.Option("--set", metavar="NAME=VALUE,...", help="A parameter; several values make a study.")
    ] = NONE
    results: Annotated[str | None, typer.Option(metavar="NAME,...", help="Results in the table of a study.")] = None
    workers: Annotated[int, typer.Option(min=1, help="Number of parallel processes of a study.")] = 2

    def __call__(self) -> None:
        """Simulate a problem, and print the results and how certain they are."""
        problem = read_problem(self.file)
        several = problem.combine_settings(self.settings)
        if serve_ranks(self.linear, len(several)):
            return
        if len(several) > 1:
            self._study(problem, several)
        elif self.results:
            raise ProblemError("--results: found only one run. Give a parameter several values, such as --set a=1,2.")
        else:
            say("\n".join(self.execute(problem)[1]))

    def execute(self, problem: Problem) -> tuple[History, list[str]]:
        """Return the history of a single run, and the lines to print."""
        folder, drawings = self._refuse_early(problem)
        default = 64 if self.target is None else 8
        steps, n = self.steps or default, self.n or problem.default_n(default, self.mesh)
        stored = int(self.store) if self.store.isdecimal() else self.store
        locked = nullcontext() if folder is None else Folder(folder / ROWS, self.resume is not None)
        with locked as rows, progress_bar("meshing") as show:
            if self.target is None:
                check_memory(problem, n, self.mesh)
            mesh = problem.mesh(n, self.mesh, self.settings)
            if problem.has_stages:
                history, words = self._simulate_stages(problem, mesh, stored, show=show, folder=folder)
            else:
                posed = problem.pose(self.settings, mesh, steps, make_solver(self.solver, self.accuracy))
                show("assembling", 0, None)
                if self.target is None:
                    how = {"bound": self.bound, "resume": self.resume is not None, "store": stored, "stream": rows}
                    history, words = self._march(posed, progress=partial(show, "marching"), **how), []
                else:
                    history, words = self._adapt(posed, self.target, show)
            history = replace(history, units=problem.units)
            summary = self._write(history, problem, folder, n, show)
            if rows is not None:
                rows.clear()
        lines = [f"{problem.name}: {problem.title}", *words, *summary]
        if self.plot:
            from vemcvx.plots.pictures import omissions, write_plots

            drawn = write_plots(history, drawings)
            lines.append(f"pictures    {drawings}: {', '.join(path.name for path in drawn)}")
            lines += [f"left out    {why}" for why in omissions(history)]
        if self.report:
            from vemcvx.cli.report import report_page

            name = mesh_name(problem, self.mesh, n) + ", adapted" * (self.target is not None)
            results = "\n".join(lines)
            page = report_page(problem, history, settings=self.settings, mesh=name, results=results)
            with Owned(drawings) as own:
                lines.append(f"report      {drawings / own.write(REPORT, page)}")
        return history, lines

    def _study(self, problem: Problem, several: list[tuple[str, ...]]) -> None:
        chosen = study.chosen_results(self.results.split(",") if self.results else ())
        if self.resume is not None or self.plot or (self.out is None and self.report):
            raise ProblemError("--set: several values exclude --resume and --plot, and --report needs --out DIR.")
        if self.out:
            study.reserve_files(self.out)
        folders = [self.out and self.out / name for name in study.folder_names(several)]
        runs = [replace(self, settings=list(each), out=out) for each, out in zip(several, folders, strict=True)]
        rows, units = list[Row](), dict[str, str]()
        with progress_bar("runs") as show, ThreadPool(self.workers) as threads:
            for row, own in threads.imap(_attempt, runs):
                rows.append(row)
                units |= own
                show("runs", len(rows), len(runs))
        title = f"{problem.name}: {problem.title}"
        lines = [title, study.table(rows, chosen, units).text(), *study.remarks(rows)]
        if self.out:
            lines.append(f"files       {self.out}: {', '.join(study.write(rows, self.out))}, folders of runs")
        say("\n".join(lines))
        if failed := {row["status"] for row in rows} - {DONE}:
            raise typer.Exit(NOT_CERTIFIED if failed == {MISSED} else INVALID)

    def _march(self, posed: Posed, **how: Any) -> History:
        return posed.simulate(condense=self.condense, linear=make_linear_solver(self.linear), **how)

    def _simulate_stages(
        self, problem: Problem, mesh: AnyMesh, store: int | str, *, show: ShowProgress, folder: Path | None
    ) -> tuple[History, list[str]]:
        solver, found, lines = make_solver(self.solver, self.accuracy), list[History](), list[str]()
        for k, (scene, times) in enumerate(problem.stages(self.settings), start=1):
            posed = Posed(scene, mesh, times, solver, found[-1] if found else problem.initial)
            history = self._march(posed, store=store, progress=partial(show, f"stage {k}, marching"))
            found.append(replace(history, units=problem.units))
            own = folder and write_results(found[-1], folder / f"stage_{k}", Origin(problem.name))
            where = f", in {own}" if own else ""
            lines.append(f"stage {k:<6d}t = {times[0]:.6g} ... {times[-1]:.6g}, {count_steps(found[-1].steps)}{where}")
        return joined(found), lines

    def _adapt(self, posed: Posed, target: float, show: ShowProgress) -> tuple[History, list[str]]:
        def show_estimate(now: Any) -> None:
            show(f"adapting, {now.unknowns} unknowns and {count_steps(now.steps)}, error {now.total:.1%}", 0, None)

        found = posed.adapt(posed.times[1:], target, progress=show_estimate)
        return found.history, [found.summary()]

    def _refuse_early(self, problem: Problem) -> tuple[Path | None, Path]:
        """Return the folders of the history (or None) and of the pictures."""
        folder = self.out or self.resume
        drawings = folder or Path("results") / problem.name
        if self.resume is not None and self.out is not None:
            raise ProblemError("--resume: a run continues in the folder that holds it; omit --out.")
        given = {"--steps": self.steps, "--target": self.target, "--resume": self.resume, "--bound": self.bound or None}
        given["--store last"] = True if self.store == "last" else None
        if problem.has_stages and (found := [option for option, value in given.items() if value is not None]):
            left = ", ".join(given)
            raise ProblemError(f"{found[0]}: {problem.name} has stages with their own instants; leave out {left}.")
        fixed = self.bound or self.resume or self.store != "all" or self.linear is not None or not self.condense
        if self.target is not None and fixed:
            raise ProblemError("--target: adaptive runs take no --bound, --resume, --store, --linear, --no-condense.")
        if self.resume and not os.path.isfile(self.resume / ROWS / CHECKPOINT):
            raise ProblemError(f"--resume: {folder} holds no interrupted run; begin one with --out {folder}.")
        if self.plot or self.report:
            new_figure()
        if self.plot or self.report or folder:
            files.writable_folder(drawings)
        if folder:
            files.check_replaceable(folder)
        if self.report:
            with Owned(drawings) as own:
                own.take(REPORT)
        return folder, drawings

    def _write(self, history: History, problem: Problem, folder: Path | None, n: int, show: ShowProgress) -> list[str]:
        show("extremes", 0, None)
        extremes, start = list(_extremes(history, problem.units)), time.perf_counter()
        if folder is None:
            none = "files       none; --out DIR keeps the history, --plot draws it"
            return [history.summary(), *extremes, *([] if self.plot or self.report else [none])]
        mesh = self.mesh or problem.family
        origin = Origin(problem.name, mesh, None if mesh is not None and is_file(mesh) else n)
        write_results(history, folder, origin)
        seconds = {**history.seconds, "write": time.perf_counter() - start}
        names = SUMMARY, ARCHIVE, *sorted(name for name in FILES.values() if (folder / name).is_file())
        words = f"files       {folder}: {SERIES} with {len(history.stored)} instants, {', '.join(names)}"
        return [replace(history, seconds=seconds).summary(), *extremes, words]


LEAST_MEMORY = 2000.0  # bytes per unknown


def check_memory(problem: Problem, n: int, family: str | None) -> None:
    """Raise ProblemError if the mesh would need more memory than the machine has."""
    if n <= 64 or (family is not None and is_file(family)):
        return
    dimension = 3 if problem.in_space(family) else 2
    needed, most = LEAST_MEMORY * dimension * float(n) ** dimension, machine_memory()
    if needed > most:
        raise ProblemError(
            f"--n {n}: this mesh needs at least {needed / 1e9:.2g} GB of memory, and this machine has "
            f"{most / 1e9:.2g} GB. Take fewer cells, or --target 0.02, which refines only where the error is large."
        )


def machine_memory() -> float:
    """Return the memory of the machine in bytes, or infinity if unknown."""
    with suppress(AttributeError, OSError, ValueError):
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    return np.inf


def _attempt(run: Run) -> tuple[Row, dict[str, str]]:
    row: Row = {f"{study.SET}{name}": value for name, value in (one.split("=", 1) for one in run.settings)}
    status, found = call_safely(_execute, run)
    folder = run.out and status == DONE and str(run.out)
    own, words = found if status == DONE else ({"message": found}, {})
    return row | {"status": status, "folder": folder or None} | own, words


def _execute(run: Run) -> tuple[Row, dict[str, str]]:
    logged = BufferingHandler(10**6)
    logged.setLevel(logging.WARNING)
    logging.getLogger("vemcvx").addHandler(logged)
    with quietly() as caught:
        history, _ = run.execute(problem := read_problem(run.file))
    warned = [*(str(warning.message) for warning in caught), *(record.getMessage() for record in logged.buffer)]
    remarks = {
        "met": None if history.errors is None else history.errors["total"] <= history.errors["target"],
        "unbounded": " ".join(one.key for one in history.extremes if one.unbounded),
        "warnings": list(dict.fromkeys(warned)),
    }
    return figures(history) | remarks, units_of(history, problem.units) if problem.units else {}


def _extremes(history: History, units: Units | None) -> Iterator[str]:
    for one in history.extremes:
        where = f"at {coordinates(one.place)}, t = {one.time:.6g} {(units or {}).get('time', '')}".rstrip()
        yield f"{one.name:36s}{one.value:12.6g} {in_units(one.unit, units):14s} {where if one.value else ''}".rstrip()
        if one.unbounded:
            yield f"{'':12s}{one.unbounded}"
    for name, forces in history.resultants.items():
        row = largest(forces)
        where = f"t = {history.times[row]:.6g} {(units or {}).get('time', '')}".rstrip()
        value = "(" + ", ".join(f"{x:.6g}" for x in forces[row]) + ")"
        yield f"{'largest ' + name:36s}{value} {in_units('force', units)}, {where}"
