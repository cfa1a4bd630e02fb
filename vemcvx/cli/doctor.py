"""`vemcvx doctor`: list the installed packages, and test the solvers against a closed form."""

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
PACKAGES = {"pardiso": "py-mkl-pardiso", "iterative": "pyamg", "petsc": "petsc4py"}  # Linear solver -> package.
Finding = tuple[str, str, bool]
"""The name of a package or solver, the result in words, and False for a failure."""


@dataclass(frozen=True)
class Doctor:
    """The command `vemcvx doctor`."""

    def __call__(self) -> None:
        """List the installed packages, and test the solvers by a closed form; the exit code is 1 after a failure."""
        failed = []
        for subject, words, works in findings():
            typer.echo(Table((), [(f"{subject:14}", words)]).text())
            failed += [] if works else [subject]
        say(f"\nFailed: {', '.join(failed)}." if failed else "\nAll is well.")
        if failed:
            raise typer.Exit(1)


def findings() -> Iterator[Finding]:
    """Yield the findings one by one: packages, solvers and linear solvers."""
    yield "vemcvx", name_platform(), True
    for name in NEEDED:
        found = version_of(name)
        yield name, found or "missing: install vemcvx again", found is not None
    for name, extra in EXTRAS.items():
        yield name, version_of(name) or f"not installed; optional: pip install 'vemcvx[{extra}]'", True
    for name in ("newton", "clarabel", "osqp"):
        yield _test_chain(name, NAMES[name](), None)
    for name, kind in LINEAR.items():
        if name == "superlu" or version_of(PACKAGES[name]):
            yield _test_chain(name, Newton(), kind())


def name_platform() -> str:
    """Return the versions of vemcvx and Python, and the name of the system."""
    return f"{__version__}, Python {platform.python_version()} on {platform.platform()}"


def version_of(package: str) -> str | None:
    """Return the installed version of a package, or None."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _test_chain(name: str, solver: Solver, linear: LinearSolver | None) -> Finding:
    """Test a solver by a chain of four blocks with friction; one block is pulled."""
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
