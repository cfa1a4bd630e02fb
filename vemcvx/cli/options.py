"""Options that several commands share."""

from __future__ import annotations

from typing import Annotated, Any

import typer

File = Annotated[
    str,
    typer.Argument(
        metavar="FILE",
        help="A problem file: Python with scene(**parameters), mesh(n), times(steps); or a name that `problems` lists.",
    ),
]
Mesh = Annotated[
    str | None,
    typer.Option(
        help="Family of meshes, such as squares; or a mesh file that names its parts. (default: the problem's)",
    ),
]
Accuracy = Annotated[
    float | None, typer.Option(help="Certified relative energy error of a step. (default: the solver's own)")
]
Linear = Annotated[
    str | None,
    typer.Option(
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
        help="newton, clarabel, osqp, direct, any solver that cvxpy finds (scs, highs ...), or FILE.py:CLASS.",
    ),
]
Options = Annotated[
    list[str], typer.Option("--option", metavar="SOLVER.NAME=VALUE", help="A setting of a solver; may be repeated.")
]
NONE: Any = ()  # The default of options that may be repeated.
