"""`vemcvx cost`: sweep a problem, write the table and the picture, and say what to use for which accuracy."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from vemcvx.base.canvas import as_png
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.base.owned_files import Owned
from vemcvx.base.version import __version__
from vemcvx.cli.options import CELLS, NONE, File, Of, Settings, families, solver_names
from vemcvx.cli.problem_file import Problem, read_problem
from vemcvx.cli.solver_names import named_solver
from vemcvx.cli.terminal import listed, progress_bar, say
from vemcvx.cost import Ingredients, Point, Sweep, advice, sweep
from vemcvx.cost.sweeping import JOURNAL, Grid
from vemcvx.cost.table import Row, answers, effectivities, picture, table, within_reach, without_limit
from vemcvx.cost.workers import REFUSED
from vemcvx.estimate.adapt import OF
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES

USUAL = ("squares", "triangles", "voronoi")
USUAL_N, USUAL_TARGETS = "8,16,32,64,128", "0.05,0.02,0.01"
IN_SPACE, N_IN_SPACE, TARGETS_IN_SPACE = ("cubes", "tetrahedra"), "3,6,12", "0.2,0.1"
TABLE, PICTURE, RATIOS = "cost.csv", "cost.png", "effectivity.png"


@dataclass(frozen=True)
class FromFile:
    """The ingredients of points, of a problem file: each process reads it anew."""

    path: str
    settings: tuple[str, ...]

    @property
    def mark(self) -> str:
        """A hash of the problem file's contents; files that it imports are not read."""
        words = [__version__.encode(), Path(self.path).read_bytes(), *map(os.fsencode, self.settings)]
        return hashlib.sha256(b"\0".join(words)).hexdigest()[:16]

    def __call__(self, point: Point) -> Ingredients:
        """Read the file, and make what `simulate` takes."""
        problem, solver = read_problem(self.path), named_solver(point.solver, point.accuracy)
        return problem.posed(self.settings, problem.mesh(point.n, point.family), point.steps or 2, solver)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Measure what accuracy costs: true errors against seconds and unknowns, over meshes, steps and solvers."""

    file: File
    mesh: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=families,
            help="Families of meshes. (default: squares,triangles,voronoi; in space cubes,tetrahedra)",
        ),
    ] = None
    n: Annotated[
        str | None, typer.Option("--n", metavar="N,N,...", help=f"{CELLS} (default: 8,16,32,64,128; in space 3,6,12)")
    ] = None
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="Steps of backward Euler.")] = "8,32"
    solver: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=solver_names,
            help="Solvers. (default: newton, and clarabel and osqp at a few points)",
        ),
    ] = None
    accuracy: Annotated[
        str | None, typer.Option(metavar="X,X,...", help="Certified relative energy errors of a step. (default: 1e-8)")
    ] = None
    adaptive: Annotated[bool, typer.Option(help="Adaptive runs beside the uniform ones.")] = True
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X,X,...",
            help="Relative errors to aim at, and to give advice for. (default: 0.05,0.02,0.01, in space 0.2,0.1; none, "
            "with --n)",
        ),
    ] = None
    of: Of = "energy"
    bound: Annotated[
        bool,
        typer.Option("--bound", help="Guaranteed bounds beside estimates, and a picture of both over true errors."),
    ] = False
    workers: Annotated[int, typer.Option(help="Processes at once.")] = 2
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Take the workers of this dask.distributed scheduler.")
    ] = None
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Table, picture, journal. (default: results/cost_<problem>)")
    ] = None
    resume: Annotated[
        bool, typer.Option("--resume/--fresh", help="Leave out the runs that DIR holds already, or begin anew.")
    ] = True
    settings: Settings = NONE

    def __call__(self) -> None:
        """Sweep, write the table and the picture, and say what came out."""
        problem = read_problem(self.file)
        grid = self.grid(problem)
        if self.of not in OF:
            raise ProblemError(f"--of: found {self.of!r}; errors are of {', '.join(OF)}.")
        if self.bound and self.of != "energy":
            raise ProblemError(f"--bound: bounds are of the energy norm alone; omit --of {self.of}.")
        if self.workers < 1:
            raise ProblemError(f"--workers: found {self.workers}; wanted at least one.")
        recipe = FromFile(str(problem.path.resolve()), tuple(self.settings))
        folder = self.out or Path("results") / f"cost_{problem.name}"
        recipe(grid.coarsest)  # A problem that cannot be posed is an error here, and not in every point.
        with Owned(folder) as own:
            # A folder whose files could not be written is refused before the sweep begins.
            for name in (TABLE, PICTURE, JOURNAL, *([RATIOS] if self.bound else [])):
                own.take(name)
        with progress_bar("starting") as shown:
            how: dict[str, Any] = {"workers": self.workers, "scheduler": self.scheduler, "fresh": not self.resume}
            found = sweep(recipe, grid, folder, told=shown, **how)
        lines = [f"{problem.name}: {problem.title}", *_of_reference(found), *_of_points(found), ""]
        lines += advice(found.rows, grid.targets or within_reach(found.rows))
        say("\n".join([*lines, "", _written(found, grid, folder, problem)]))

    def grid(self, problem: Problem) -> Grid:
        """The grid that is asked for."""
        several = "one or more, with commas between"
        known = dict.fromkeys([*problem.families, *([problem.family] if problem.family else [])])
        space = problem.in_space()
        families: tuple[str | None, ...] = USUAL if problem.family in FAMILIES else (None,)
        families = IN_SPACE if problem.family in SPACE_FAMILIES else families
        if self.mesh is not None:
            families = listed("--mesh", self.mesh, str, several)
            for family in families:
                if family not in known:
                    raise ProblemError(f"--mesh: there is no family {family!r}; there are {', '.join(known)}.")
        solvers = None if self.solver is None else listed("--solver", self.solver, str, several)
        for solver in solvers or ():
            named_solver(solver, None)
        # Who says how fine meshes are to be asks for no others, be they adaptive or those of a far finer reference.
        usual = TARGETS_IN_SPACE if space else USUAL_TARGETS
        targets = self.target or (usual if self.n is None else None)
        return Grid(
            families=families,
            ns=listed("--n", self.n or (N_IN_SPACE if space else USUAL_N), _whole, WHOLE),
            steps=listed("--steps", self.steps, _whole, WHOLE),
            solvers=solvers,
            accuracies=None if self.accuracy is None else listed("--accuracy", self.accuracy, _share, SHARES),
            targets=tuple(sorted(listed("--target", targets, _share, SHARES), reverse=True)) if targets else (),
            adaptive=self.adaptive,
            of=self.of,
            bounded=self.bound,
        )


WHOLE = "whole numbers from 1, such as 8,16,32"
SHARES = "relative errors between 0 and 1, such as 0.05,0.01"


def _whole(word: str) -> int:
    if not (word.isdecimal() and int(word) > 0):
        raise ValueError
    return int(word)


def _share(word: str) -> float:
    if not 0 < float(word) < 1:
        raise ValueError
    return float(word)


def _of_reference(found: Sweep) -> list[str]:
    it = found.reference
    own = "with no estimate of its own error" if it.estimated is None else f"its own error estimated {it.estimated:.2%}"
    size = f"{it.cells} cells, {it.unknowns} unknowns, {it.made} steps"
    instants = ", ".join(f"{t:g}" for t in it.instants)
    errors = f"in the energy norm, the largest at t = {instants}, relative to the largest norm"
    if it.value is not None:
        errors = f"of {OF[it.of]} at the end, {it.value:.6g} by the reference, relative to that"
    lines = [
        f"reference   {size}, {own} (wanted: {it.goal:.2%}), {it.seconds:.3g} s",
        f"errors      {errors}",
        "seconds     in one thread, from assembly to answer; the first mesh is made before",
    ]
    if it.estimated is not None and it.estimated > it.goal:
        lines.append("            more than was wanted: true errors below four times that are uncertain themselves")
    if it.common:
        lines.append(
            "            meshes do not cover one domain: errors are measured where they overlap the reference's"
        )
    return lines


def _of_points(found: Sweep) -> list[str]:
    rows = found.rows
    lines = [f"points      {len(rows)}, {found.kept} of them finished before"]
    ratios = [one.row.estimated / one.error for one in answers(rows) if one.row.estimated is not None and one.error > 0]
    if ratios:
        lines.append(f"estimates   {min(ratios):.2g} to {max(ratios):.2g} times the true error")
    lines += _of_bounds(rows)
    for row in rows:
        if not row.done:
            words = " ".join(row.message.split())
            words = words.split("; ")[0] if row.status == REFUSED else words
            lines.append(f"            {row.status}: {row.settings}: {words}")
    lines += [f"extremes    {words}" for words in without_limit(rows)]
    warned = dict.fromkeys(row.message for row in rows if row.done and row.message)
    return [*lines, *(f"warning     {words}" for words in warned)]


def _of_bounds(rows: Sequence[Row]) -> list[str]:
    known = [(one.row.bound_of, one.row.bound or 0.0, one.error) for one in answers(rows)]
    ratios = [bound / error for of, bound, error in known if of == "history" and error > 0]
    sizes = [bound for of, bound, _ in known if of == "step"]
    lines = []
    if ratios:
        lines.append(f"bounds      {min(ratios):.2g} to {max(ratios):.2g} times the true error, guaranteed")
    if sizes:
        lines.append(
            f"bounds      of the mesh in a step, given the one before: {min(sizes):.2%} to {max(sizes):.2%}, "
            "guaranteed, with Coulomb's law for the friction that the run's pressure gives"
        )
    if any(row.done and row.bounded and row.bound is None for row in rows):
        lines.append("bounds      none for this scene, or part of it; vemcvx run --bound says why")
    return lines


def _written(found: Sweep, grid: Grid, folder: Path, problem: Problem) -> str:
    files, title = f"files       {folder}: {TABLE}, {JOURNAL}", f"{problem.name}: what accuracy costs"
    with Owned(folder) as own:
        own.write(TABLE, table(found.rows))
        if not any(row.done for row in found.rows):
            return f"{files}\npicture     none: no run has an answer"
        try:
            drawn = picture(found.rows, grid.targets, found.reference.estimated, title, OF[grid.of])
            pictures = {PICTURE: drawn, RATIOS: effectivities(found.rows, title)}
        except VemcvxError as error:
            return f"{files}\npicture     none: {error}"
        names = [own.write(name, as_png(figure, 160)) for name, figure in pictures.items() if figure is not None]
    return ", ".join([files, *names])
