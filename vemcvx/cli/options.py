"""Arguments and options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

from vemcvx.cli import completion

File = Annotated[
    str,
    typer.Argument(
        metavar="FILE",
        autocompletion=completion.problems,
        help="A problem file: Python with scene(**parameters), mesh(n), times(steps); or a name that `problems` lists.",
    ),
]
Mesh = Annotated[
    str | None,
    typer.Option(
        autocompletion=completion.families,
        help="Family of meshes: squares ...; or a mesh file that has its boundaries. (default: its own)",
    ),
]
Accuracy = Annotated[
    float | None, typer.Option(help="Certified relative energy error of a step. (default: the solver's own)")
]
Linear = Annotated[
    str | None,
    typer.Option(
        autocompletion=completion.linear_solvers,
        help="superlu, pardiso or multigrid. (default: by size and what is installed)",
    ),
]
N = Annotated[int | None, typer.Option("--n", min=1, help="Cells across the shortest side. (default: 16; 8 in space)")]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the scene; may be repeated.")
]
Solver = Annotated[
    str,
    typer.Option(
        autocompletion=completion.solvers,
        help="newton, clarabel, osqp, direct, what cvxpy finds: scs, highs ...; FILE.py:CLASS.",
    ),
]
