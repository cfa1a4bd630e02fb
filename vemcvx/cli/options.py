"""Options that several commands share."""

from __future__ import annotations

from typing import Annotated, Any

import typer

File = Annotated[str, typer.Argument(metavar="FILE", help="A problem file, or a name that `problems` lists.")]
Mesh = Annotated[str | None, typer.Option(help="Family of meshes, or a mesh file. (default: the problem's)")]
Accuracy = Annotated[float | None, typer.Option(help="Certified relative energy error of a step. (default: solver's)")]
Linear = Annotated[str | None, typer.Option(help="superlu, pardiso, iterative, petsc or FILE.py:CLASS.")]
CELLS = "Cells across the shortest side."
N = Annotated[int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 16; 8 in space)")]
FineN = Annotated[int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 64; 8 in space or with --target)")]
Condense = Annotated[bool, typer.Option(help="Solve for the contact unknowns only, or for all.")]
Settings = Annotated[list[str], typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the scene.")]
SolverName = Annotated[str, typer.Option(help="newton, clarabel, osqp, direct, a cvxpy solver, or FILE.py:CLASS.")]
NONE: Any = ()  # The default of options that may be repeated.
