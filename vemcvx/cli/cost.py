"""`vemcvx cost`: sweep meshes, steps and solvers, and recommend settings for each accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from vemcvx.base.canvas import as_png
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.base.outline import count_steps
from vemcvx.base.owned_files import Owned
from vemcvx.cli.options import CELLS, NONE, File, Settings
from vemcvx.cli.problem_file import Posed, Problem, read_problem
from vemcvx.cli.solver_names import make_solver
from vemcvx.cli.terminal import FRACTIONS, fraction, parse_list, progress_bar, say
from vemcvx.cost.sweeping import Point, Sweep, sweep
from vemcvx.cost.table import advice, answers, growing_extremes, in_words, picture, table
from vemcvx.cost.workers import DONE
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES

DEFAULT_FAMILIES = ("squares", "triangles", "voronoi")
DEFAULT_N, DEFAULT_TARGETS = "8,16,32,64,128", "0.05,0.02,0.01"
DEFAULT_SPACE_FAMILIES, SPACE_N, SPACE_TARGETS = ("cubes", "tetrahedra"), "3,6,12", "0.2,0.1"
OTHER_SOLVERS = "clarabel", "osqp"
TABLE, PICTURE, ARCHIVE = "cost.csv", "cost.png", "reference.npz"


def pose_point(path: Path, settings: Sequence[str], point: Point) -> Posed:
    """Return the arguments of `simulate` for one run of the sweep."""
    problem, solver = read_problem(path), make_solver(point.solver, point.accuracy)
    return problem.pose(settings, problem.mesh(point.n, point.family), point.steps or 2, solver)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """The command `vemcvx cost`."""

    file: File
    mesh: Annotated[str | None, typer.Option(metavar="A,B,...", help="Families of meshes.")] = None
    n: Annotated[str | None, typer.Option("--n", metavar="N,...", help=CELLS)] = None
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="Steps of backward Euler.")] = "8,32"
    solver: Annotated[str | None, typer.Option(metavar="A,B,...", help="Solvers. (default: newton and others)")] = None
    accuracy: Annotated[str | None, typer.Option(metavar="X,...", help="Accuracies of a step. (default: 1e-8)")] = None
    target: Annotated[str | None, typer.Option(metavar="X,...", help="Target errors of adaptive runs.")] = None
    workers: Annotated[int, typer.Option(min=1, help="Number of parallel processes.")] = 2
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="(default: results/cost_<problem>)")] = None
    settings: Settings = NONE

    def __call__(self) -> None:
        """Measure the cost of accuracy: true errors against seconds and unknowns, for meshes, steps and solvers."""
        problem = read_problem(self.file)
        usual = SPACE_TARGETS if problem.in_space() else DEFAULT_TARGETS
        typed = self.target or (usual if self.n is None else None)
        targets = sorted(parse_list("--target", typed, fraction, FRACTIONS), reverse=True) if typed else []
        points, path = self.points(problem, targets), problem.path.resolve()
        folder = self.out or Path("results") / f"cost_{problem.name}"
        recipe = partial(pose_point, path, tuple(self.settings))
        posed = recipe(points[-1])  # An invalid problem raises one error before the sweep.
        if posed.scene.is_axisymmetric:
            raise ProblemError("cost: found a body of revolution, for which energy errors are not measured.")
        with Owned(folder) as files:
            for name in (TABLE, PICTURE):
                files.take(name)
            with progress_bar("starting") as show:
                found = sweep(recipe, points, files.take(ARCHIVE), workers=self.workers, report=show)
            written = _write_files(found, targets, files, f"{problem.name}: what accuracy costs")
        lines = [f"{problem.name}: {problem.title}", *_describe_reference(found), *_describe_rows(found), ""]
        say("\n".join([*lines, *advice(found.rows, targets or [0.05]), "", written]))

    def points(self, problem: Problem, targets: Sequence[float]) -> list[Point]:
        """Return the settings of all runs."""
        kinds = self._families(problem)
        ns = parse_list("--n", self.n or (SPACE_N if problem.in_space() else DEFAULT_N), _whole, WHOLE)
        steps = parse_list("--steps", self.steps, _whole, WHOLE)
        solvers = ("newton",) if self.solver is None else parse_list("--solver", self.solver, str, ONE_OR_MORE)
        for solver in solvers:
            make_solver(solver, None)
        accuracies = (1e-8,) if self.accuracy is None else parse_list("--accuracy", self.accuracy, fraction, FRACTIONS)
        found = [Point(*one) for one in product(kinds, ns, steps, solvers, accuracies)]
        if self.solver is None and self.accuracy is None:
            where = sorted(ns)[1:-1:2] or ns[:1]
            found += [Point(*one) for one in product(kinds[:1], where, steps[-1:], OTHER_SOLVERS, (1e-3, 1e-6))]
        found.sort(key=lambda point: (point.n, point.steps), reverse=True)
        first = Point(None, min(ns), None, solvers[0], min(accuracies))
        found = [replace(first, family=kind, target=target) for kind, target in product(kinds, targets)] + found
        return list(dict.fromkeys(found))

    def _families(self, problem: Problem) -> tuple[str | None, ...]:
        if self.mesh is None:
            if problem.family in SPACE_FAMILIES:
                return DEFAULT_SPACE_FAMILIES
            return DEFAULT_FAMILIES if problem.family in FAMILIES else (None,)
        known = dict.fromkeys([*problem.families, *([problem.family] if problem.family else [])])
        families = parse_list("--mesh", self.mesh, str, ONE_OR_MORE)
        for family in families:
            if family not in known:
                raise ProblemError(f"--mesh: there is no family {family!r}; there are {', '.join(known)}.")
        return families


ONE_OR_MORE = "one or more, separated by commas"
WHOLE = "whole numbers from 1, such as 8,16,32"


def _whole(word: str) -> int:
    if int(word) < 1:
        raise ValueError
    return int(word)


def _describe_reference(found: Sweep) -> list[str]:
    run, instants = found.reference, ", ".join(f"{t:g}" for t in found.instants)
    known = run["estimated_error"]
    own = "without an estimate of its error" if known is None else f"estimated error {known:.2%}"
    size = f"{run['cells']} cells, {run['unknowns']} unknowns, {count_steps(run['steps'])}"
    lines = [
        f"reference   {size}, {own}, {run['seconds']:.3g} s",
        f"errors      in the energy norm, the largest over t = {instants}, relative to the largest norm",
        "seconds     in one thread, from assembly to answer, without making the first mesh",
    ]
    if known is not None and any(row["error"] < 4 * known for row in answers(found.rows)):
        lines.append(f"uncertain   errors below {4 * known:.2%}, 4 times the error of the reference: use a larger --n")
    return lines


def _describe_rows(found: Sweep) -> list[str]:
    rows, lines = found.rows, list[str]()
    ratios = [row["estimated_error"] / row["error"] for row in answers(rows) if row["estimated_error"] and row["error"]]
    if ratios:
        lines.append(f"estimates   {min(ratios):.2g} to {max(ratios):.2g} times the true error")
    lines += [f"{row['status']:11s} {in_words(row)}: {row['message']}" for row in rows if row["status"] != DONE]
    lines += [f"extremes    {words}" for words in growing_extremes(rows)]
    warned = dict.fromkeys(row["message"] for row in answers(rows) if row["message"])
    return [*lines, *(f"warning     {words}" for words in warned)]


def _write_files(found: Sweep, targets: Sequence[float], files: Owned, title: str) -> str:
    words = f"files       {files.path}: {files.write(TABLE, table(found.rows))}"
    try:
        drawn = picture(found.rows, targets, found.reference["estimated_error"], title)
    except VemcvxError as error:
        return f"{words}\npicture     none: {error}"
    return f"{words}, {files.write(PICTURE, as_png(drawn, 160))}"
