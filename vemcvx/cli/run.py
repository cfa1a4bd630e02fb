"""`vemcvx run` and `vemcvx export`: a problem solved, written, drawn; its programs for other solvers."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from vemcvx.cli.problem_file import Problem, is_file
from vemcvx.cli.run_options import RunOptions
from vemcvx.cli.solver_names import named_linear
from vemcvx.cli.terminal import listed, progress_bar
from vemcvx.errors import ProblemError
from vemcvx.estimate.adapt import adapt
from vemcvx.exchange import FORMATS, encoded, put
from vemcvx.history import History
from vemcvx.meshes import AnyMesh
from vemcvx.outline import coordinates
from vemcvx.owned_files import Owned
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


def simulate_problem(problem: Problem, asked: RunOptions) -> str:
    """Simulate a problem, write what is asked for, and return the summary in words."""
    drawings = asked.drawings(problem)
    _refuse_early(asked, drawings)
    # The folder is held until the history is written: of two runs with one folder the second is refused.
    with nullcontext() if asked.out is None else Folder(asked.out / ROWS, asked.resume) as rows:
        if asked.target is None:
            history, told = simulated(problem, asked, rows)
        else:
            history, told = _adapted(problem, asked, asked.target)
        lines = [f"{problem.name}: {problem.title}", *told, history.summary(), *_extremes(history)]
        mesh = asked.family or problem.family
        n = None if mesh is not None and is_file(mesh) else asked.n
        lines += _written(history, asked, Origin(problem.name, mesh, n))
        if rows is not None:
            rows.remove()
    if asked.plot:
        from vemcvx.plots import write_plots
        from vemcvx.plots.pictures import left_out

        lines.append(f"pictures    {drawings}: {', '.join(path.name for path in write_plots(history, drawings))}")
        lines += [f"left out    {why}" for why in dict.fromkeys(left_out(history).values())]
    if asked.report:
        from vemcvx.cli.report import write_report

        lines.append(f"report      {write_report(problem, asked, history)}")
    return "\n".join(lines)


def _extremes(history: History) -> Iterator[str]:
    """Largest displacement, stress, and so on over all stored steps, a line each."""
    for one in history.extremes:
        where = f"at {coordinates(one.place)}, t = {one.time:.6g}"
        yield f"{one.name:36s}{one.value:12.6g} {one.unit:14s} {where}"


def simulated(problem: Problem, asked: RunOptions, rows: Folder | None = None) -> tuple[History, list[str]]:
    """The history on the mesh and at the instants asked for, and a line where it was resumed."""
    solver, made, store = asked.make_solver(), [], asked.store
    with progress_bar("assembling") as shown:

        def advance(n: int, steps: int) -> None:
            made.append(n)
            shown("marching", n, steps)

        history = simulate(
            problem.scene(asked.settings),
            _mesh(problem, asked),
            problem.times(asked.steps),
            solver=solver,
            initial=problem.initial,
            store=int(store) if isinstance(store, str) and store.isdecimal() else store,
            condense=asked.condense,
            linear=named_linear(asked.linear),
            progress=advance,
            stream=rows,
            resume=asked.resume,
        )
    return history, [f"resumed     after step {history.steps - len(made)} of {history.steps}"] if asked.resume else []


def _adapted(problem: Problem, asked: RunOptions, target: float) -> tuple[History, list[str]]:
    """The history on a mesh, and at instants, chosen for the target; those asked for are where the choice begins."""
    if asked.resume or asked.store != "all" or asked.linear is not None or not asked.condense:
        raise ProblemError("--target: adaptive runs take neither --resume, --store, --linear nor --no-condense.")
    scene, mesh, times = problem.scene(asked.settings), _mesh(problem, asked), problem.times(asked.steps)
    found = adapt(scene, mesh, times, target, solver=asked.make_solver(), initial=problem.initial)
    return found.history, [found.summary()]


def _mesh(problem: Problem, asked: RunOptions) -> AnyMesh:
    """The mesh, which has the probes in it."""
    mesh = problem.mesh(asked.n, asked.family)
    if asked.points is not None:
        places(mesh, asked.points, "--probe")
    return mesh


def _refuse_early(asked: RunOptions, drawings: Path) -> None:
    """Refuse a run that could not be resumed, written or drawn before it begins."""
    if asked.resume and not (asked.out and os.path.isfile(asked.out / ROWS / CHECKPOINT)):
        raise ProblemError(f"--resume: {asked.out} holds no interrupted run; begin one with --out {asked.out}.")
    if asked.points is not None and asked.out is None and not asked.report:
        raise ProblemError("--probe: displacements of points are written to DIR of --out DIR, or told by --report.")
    if asked.plot or asked.report:
        from vemcvx.canvas import new_figure
        from vemcvx.cli.report import check_report
        from vemcvx.plots.pictures import check_pictures

        new_figure()
        for wanted, check in ((asked.plot, check_pictures), (asked.report, check_report)):
            if wanted:
                check(drawings)
    if asked.plot or asked.report or asked.out:
        writable_folder(drawings)
    if asked.out:
        check_replaceable(asked.out)


def _written(history: History, asked: RunOptions, origin: Origin) -> list[str]:
    if asked.out is None:
        return [] if asked.plot or asked.report else ["files       none; --out DIR keeps the history, --plot draws it"]
    folder = write_results(history, asked.out, origin, asked.points)
    tables = ", ".join(sorted(listed_tables(folder / SUMMARY)))
    return [f"files       {folder}: {SERIES} with {len(history.stored)} instants, {SUMMARY}, {ARCHIVE}, {tables}"]


def export_programs(problem: Problem, asked: RunOptions, steps: str, form: str) -> str:
    """Simulate, write the programs of the steps "3,17" with words beside them, and say what was written."""

    def number(word: str) -> int:
        if not (word.isdecimal() and 1 <= int(word) <= asked.steps):
            raise ValueError
        return int(word)

    such = (
        f"numbers from 1 to {asked.steps} with commas between, such as 1,{asked.steps}; --of says how many steps the "
    )
    numbers = listed("--steps", steps, number, f"{such}run has")
    if form not in FORMATS:
        raise ProblemError(f"--format: there is no format {form!r}; there are {', '.join(FORMATS)}.")
    with Owned(asked.out or Path("results") / f"programs_{problem.name}") as folder:
        kept = sorted({m for n in numbers for m in (n - 1, n)})
        history, _ = simulated(problem, replace(asked, store=tuple(kept)))
        lines = [f"{problem.name}: {problem.title}", f"files       {folder.path}"]
        for program in programs_of_steps(history, numbers, asked.condense):
            origin = {"problem": problem.name, "settings": list(asked.settings), **program.origin}
            name = f"{problem.name}_{program.step}"
            files = {f"{name}{end}": data for end, data in encoded(replace(program, origin=origin), form).items()}
            put({file: data for file, data in files.items() if data or file in folder.names}, folder.take)
            low, high = program.bounds
            counts = f"{len(program.g)} unknowns, {len(program.w)} norm terms, {len(program.e)} limits"
            lines.append(f"{name}.{form}  {counts}; the optimum is between {low:.17g} and {high:.17g}")
    return "\n".join(lines)
