"""`vemcvx show`: a problem's scene, its convex program and its solvers, in words."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from vemcvx.cli.problem_file import Problem
from vemcvx.condensation import Condensation
from vemcvx.form import QUADRATIC
from vemcvx.pose import pose
from vemcvx.solvers.choose import BY_SIZE, words


def print_scene(problem: Problem, family: str | None, n: int, settings: tuple[str, ...]) -> None:
    """Print the table to standard output; without colours and frames it reads the same."""
    console = Console(highlight=False)
    console.print(f"{problem.name}: {problem.title}", markup=False)
    console.print(table(problem, family, n, settings))


def table(problem: Problem, family: str | None, n: int, settings: tuple[str, ...] = ()) -> Table:
    """The scene as rows of a name and words."""
    scene, mesh = problem.scene(settings), problem.mesh(n, family)
    posed = pose(scene, mesh)
    seen = Condensation(posed.system)
    size = f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, h = {mesh.h:.4g}"
    rows = [
        ("effects", "\n".join(effect.describe() for effect in scene.canonical)),
        ("mesh", f"{family or problem.family or 'its own'}, n = {n}: {size}"),
        ("unknowns", f"{posed.system.n} in all, {len(seen.touched)} after condensation"),
        *_program(seen),
        *_solvers(seen),
        ("linear solve", _linear(posed.system.K.nnz, posed.system.n, seen)),
    ]
    made = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    made.add_column(style="bold", no_wrap=True)
    made.add_column(overflow="fold")
    for name, text in rows:
        # Square brackets in a user's words are no markup.
        made.add_row(name, text.replace("[", r"\["))
    return made


def _program(seen: Condensation) -> list[tuple[str, str]]:
    form = seen.form
    if form.count == 0:
        return [("program", "minimise 1/2 d'Kd - g'd: quadratic, no norm terms")]
    kind = words(form.features - {QUADRATIC})
    size = "" if form.block == 1 else f" of {form.block + 1} components"
    return [
        ("program", "minimise 1/2 d'Kd - g'd + sum of w_i |B_i d - b_i|, once a step"),
        ("norm terms", f"{form.count} {kind}{size}"),
    ]


def _solvers(seen: Condensation) -> list[tuple[str, str]]:
    able = [solver.name for solver in BY_SIZE if seen.form.features <= solver.accepts]
    unable = [
        f"{solver.name} (no {words(seen.form.features - solver.accepts)})"
        for solver in BY_SIZE
        if not seen.form.features <= solver.accepts
    ]
    rows = [("solvers", f"{', '.join(able)}; the smallest is {able[0]}")]
    return [*rows, ("not", ", ".join(unable))] if unable else rows


def _linear(nonzeros: int, n: int, seen: Condensation) -> str:
    once = f"{type(seen.linear).__name__} on {n} x {n} with {nonzeros} nonzeros, once"
    m = len(seen.touched)
    if m == 0:
        return f"{once}; then a back-substitution for every new shape of the load"
    return f"{once}; then dense {m} x {m} each step" if m < n else f"{once} a step"
