"""Options that several commands share, and the completion of their values in shells."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from vemcvx.cli.solver_names import LINEAR, completions
from vemcvx.cli.supplied import lessons, problem_files
from vemcvx.meshes import FAMILIES


def make_completion(names: Callable[[], Iterable[object]]) -> Callable[[str], list[str]]:
    """Return a function for typer that completes the last of several names separated by commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in names() if str(name).startswith(last)]

    return complete


families, solver_names = make_completion(lambda: FAMILIES), make_completion(completions)
lesson_numbers = make_completion(lessons)
problem_names = make_completion(lambda: [*problem_files(), *sorted(path.name for path in Path().glob("*.py"))])

File = Annotated[
    str,
    typer.Argument(
        metavar="FILE",
        autocompletion=problem_names,
        help="A problem file: Python with scene(**parameters), mesh(n), times(steps); or a name that `problems` lists.",
    ),
]
Mesh = Annotated[
    str | None,
    typer.Option(
        autocompletion=families,
        help="Family of meshes, such as squares; or a mesh file that names its parts. (default: the problem's)",
    ),
]
Accuracy = Annotated[
    float | None, typer.Option(help="Certified relative energy error of a step. (default: the solver's own)")
]
Linear = Annotated[
    str | None,
    typer.Option(
        autocompletion=make_completion(lambda: LINEAR),
        help="superlu, pardiso, iterative, petsc (also under mpiexec) or FILE.py:CLASS. (default: depends on the size "
        "and on what is installed)",
    ),
]
CELLS = "Cells across the shortest side."
N = Annotated[int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 16; 8 in space)")]
Steps = Annotated[int, typer.Option(min=1, help="Steps of backward Euler.")]
Of = Annotated[
    str,
    typer.Option(
        metavar="QUANTITY",
        autocompletion=make_completion(lambda: import_module("vemcvx.estimate.adapt").QUANTITIES),
        help="The quantity whose error counts: energy (the energy norm), dissipated, work or wear.",
    ),
]
Condense = Annotated[bool, typer.Option(help="Solve on the contact unknowns, or on all.")]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the scene; may be repeated.")
]
SolverName = Annotated[
    str,
    typer.Option(
        autocompletion=solver_names,
        help="newton, clarabel, osqp, direct, any solver that cvxpy finds (scs, highs ...), or FILE.py:CLASS.",
    ),
]
Options = Annotated[
    list[str], typer.Option("--option", metavar="SOLVER.NAME=VALUE", help="A setting of a solver; may be repeated.")
]
NONE: Any = ()  # The default of options that may be repeated.
