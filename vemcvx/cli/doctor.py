"""`vemcvx doctor`: what is installed, and which solvers get a closed form right on this machine."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import scipy.sparse as sp
import typer

from vemcvx.base.errors import VemcvxError
from vemcvx.base.table import Table
from vemcvx.base.version import __version__
from vemcvx.cli.solver_names import LINEAR, NAMES
from vemcvx.cli.terminal import say
from vemcvx.linear import LinearSolver
from vemcvx.program import Norms, System
from vemcvx.solvers import Newton, Solver
from vemcvx.stepping import march

NEEDED = "numpy", "scipy", "cvxpy", "clarabel", "osqp", "meshio", "threadpoolctl", "typer", "rich"
EXTRAS = {
    **{"matplotlib": "plot", "py-mkl-pardiso": "mkl", "pyamg": "multigrid", "petsc4py": "petsc"},
    **{"pandas": "pandas", "pyvista": "view", "marimo": "app"},
}
PACKAGES = {"pardiso": "py-mkl-pardiso", "iterative": "pyamg", "petsc": "petsc4py"}
"""Packages of linear solvers, by the names of these."""


Finding = tuple[str, str, bool]
"""A line of the doctor: the subject, what was found in words, and whether vemcvx can work with that."""


@dataclass(frozen=True)
class Doctor:
    """List what is installed and which solvers work, and test a closed form; exit code 1 if not all is well."""

    def __call__(self) -> None:
        """Print the findings, each as soon as it is there."""
        ill = []
        for subject, words, well in findings():
            typer.echo(Table((), [(f"{subject:14}", words)]).text())
            ill += [] if well else [subject]
        say(f"\nNot well: {', '.join(ill)}." if ill else "\nAll is well.")
        if ill:
            raise typer.Exit(1)


def findings() -> Iterator[Finding]:
    """Yield the findings, each as soon as it is there: packages, solvers and linear solvers."""
    yield "vemcvx", here(), True
    for name in NEEDED:
        found = version_of(name)
        yield name, found or "missing: install vemcvx anew", found is not None
    for name, extra in EXTRAS.items():
        yield name, version_of(name) or f"not installed; optional: pip install 'vemcvx[{extra}]'", True
    for name in ("newton", "clarabel", "osqp"):
        yield _chain(name, NAMES[name](), None)
    for name, kind in LINEAR.items():
        if name == "superlu" or version_of(PACKAGES[name]):
            yield _chain(name, Newton(), kind())


def here() -> str:
    """The version of vemcvx, of Python, and the machine."""
    return f"{__version__}, Python {platform.python_version()} on {platform.platform()}"


def version_of(package: str) -> str | None:
    """The installed version of a package, None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _chain(name: str, solver: Solver, linear: LinearSolver | None) -> Finding:
    """Four blocks in a row with friction .5 each, pulled by 1.2: two slip, by .9 and .2, and two stick."""
    K = sp.csr_matrix(np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1))
    system = System(K, lambda t: [1.2 * t, 0.0, 0.0, 0.0], Norms(sp.csr_matrix(np.eye(4)), np.full(4, 0.5)))
    try:
        run = march(system, [0.0, 1.0], solver=solver, linear=linear)
    except VemcvxError as failure:
        return name, f"does not work: {failure}", False
    off = run.state[-1] - [0.9, 0.2, 0.0, 0.0]
    error, certified = float(np.sqrt(off @ (K @ off))), float((np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor)).sum())
    words = f"error {error:.0e}, certified {certified:.0e}" + ": above its certificate" * (error > certified)
    return name, words, error <= certified
