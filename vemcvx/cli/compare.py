"""`vemcvx compare`: one problem by several solvers, against each other and their certificates.

Steps with given weights are nonexpansive in the energy norm, so two answers y, z to the same steps obey

    |y_n - z_n|_K <= sum over m <= n of sqrt(2 gap_m) + sqrt(2 floor_m), of y, plus the same of z.

The left side is exact: K is the matrix of the scene. Against the most certain answer, whose right side is the
smallest, that is a test of every certificate. Where the weights follow the pressure, or friction or rates meet
limits, a step depends on the one before in ways that the sum does not bound
(:class:`vemcvx.stepping.trajectory.Trajectory`); it is then printed only.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.cli.problem_file import Problem
from vemcvx.cli.solver_names import NAMES, named_solver
from vemcvx.errors import NotAccepted, NotCertified, NotContracting, ProblemError
from vemcvx.program.system import System
from vemcvx.scene.pose import pose_scene
from vemcvx.simulation import simulate
from vemcvx.solvers import Solver
from vemcvx.solvers.conic import installed
from vemcvx.stepping.time_loop import checked_times
from vemcvx.stepping.trajectory import Trajectory

COLUMNS = "solver      asked  certified  floor  distance  allowed  kept  iterations  safeguards"
SECONDS = ("assemble", "prepare", "solve")


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What the command line asks for."""

    family: str | None
    n: int
    steps: int
    solvers: str
    accuracy: float | None
    settings: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What one solver made of the problem, and the seconds it took."""

    solver: Solver
    trajectory: Trajectory
    seconds: dict[str, float]

    @property
    def missed(self) -> Ints:
        """The steps whose certified error is above the accuracy asked for."""
        return np.flatnonzero(self.trajectory.certificate > self.solver.accuracy)

    @property
    def allowed(self) -> Floats:
        """(N + 1,) how far the certificates allow the states to be from the exact ones, in energy norm."""
        return np.cumsum(np.sqrt(2 * self.trajectory.gap) + np.sqrt(2 * self.trajectory.floor))


@dataclass(frozen=True)
class Refusal:
    """Why a solver made nothing of it."""

    solver: Solver
    words: str


@dataclass(frozen=True)
class Apart:
    """Distance of two answers and what their certificates allow, relative, where it matters most."""

    distance: float
    allowed: float
    kept: bool


@dataclass(frozen=True)
class Found:
    """The table, and whether some solver certified its answer while no certificate was contradicted."""

    text: str
    trustworthy: bool


def compare_solvers(problem: Problem, asked: Comparison) -> Found:
    """Simulate the problem by all solvers asked for.

    Raises
    ------
    VemcvxError
        The problem itself cannot be posed, or names of solvers mean nothing.
    """
    solvers = _named(asked)
    scene, mesh = problem.scene(asked.settings), problem.mesh(asked.n, asked.family)
    times = problem.times(asked.steps)

    def attempt(solver: Solver) -> Outcome | Refusal:
        try:
            history = simulate(scene, mesh, times, solver=solver, initial=problem.initial, check=False)
        except (NotAccepted, NotCertified, NotContracting) as error:
            return Refusal(solver, clause(str(error)))
        return Outcome(solver, history.trajectory, history.seconds)

    with warned_once():
        system = pose_scene(scene, mesh, checked_times(times).tolist()).system
        outcomes = [attempt(solver) for solver in solvers]
    size = f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, {system.n} unknowns, {asked.steps} steps"
    return judged(f"{problem.name}: {problem.title}\n{size}", system, outcomes)


@contextmanager
def warned_once() -> Iterator[None]:
    """Say each warning once, however many solvers meet it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for words, kind in dict.fromkeys((str(warning.message), warning.category) for warning in caught):
        warnings.warn(words, kind, stacklevel=2)


def judged(title: str, system: System, outcomes: Sequence[Outcome | Refusal]) -> Found:
    """The table of all outcomes, each against the most certain one."""
    answered = [outcome for outcome in outcomes if isinstance(outcome, Outcome)]
    best = min(answered, key=lambda outcome: outcome.allowed[-1], default=None)
    rigorous = bounds_distance(system)
    lines, trustworthy = [title, "", COLUMNS + "".join(f"{name:>10}" for name in SECONDS)], False
    broken = []
    for outcome in outcomes:
        if isinstance(outcome, Refusal):
            lines.append(f"{outcome.solver.name:<11} cannot: {outcome.words}")
            continue
        trustworthy = trustworthy or len(outcome.missed) == 0
        apart = None if best is None or outcome is best else distance(system, best, outcome)
        lines.append(_line(outcome, apart, rigorous))
        if rigorous and apart is not None and not apart.kept:
            broken.append(outcome.solver.name)
    lines += ["", *_remarks(answered, best, rigorous)]
    if best is not None:
        lines += [f"WRONG: {name} is farther from {best.solver.name} than both certificates allow" for name in broken]
    return Found("\n".join(lines), trustworthy and not broken)


def distance(system: System, one: Outcome, other: Outcome) -> Apart:
    """How far two answers are apart: where the certificates allow less, else where it is largest."""
    apart = one.trajectory.state - other.trajectory.state
    length = np.sqrt(np.maximum(np.einsum("ni,in->n", apart, system.K @ apart.T), 0.0))
    allowed = one.allowed + other.allowed
    scale = one.trajectory.scale
    unit = np.where(scale > 0, scale, 1.0)
    excess = length - allowed
    n = int(np.argmax(excess)) if (excess > 0).any() else int(np.argmax(length / unit))
    return Apart(float(length[n] / unit[n]), float(allowed[n] / unit[n]), bool((excess <= 0).all()))


def bounds_distance(system: System) -> bool:
    """Whether the certificates of all steps, added up, bound the distance of two answers."""
    if system.limits is None:
        return system.norms is None or system.norms.law is None
    # Without norm terms and rates a step knows nothing of the one before, and only its own certificate counts.
    return system.norms is None and system.damping is None


def clause(message: str) -> str:
    """An error's first clause, without the name of the solver before it."""
    return re.split(r"[;.](?:\s|$)", re.sub(r"^solver \S+: ", "", message), maxsplit=1)[0]


def _named(asked: Comparison) -> list[Solver]:
    if asked.solvers.strip().lower() == "all":
        names = [*NAMES, *(name for name in installed() if name.lower() not in NAMES)]
    else:
        names = list(dict.fromkeys(name.strip() for name in asked.solvers.split(",") if name.strip()))
    if not names:
        raise ProblemError(f"--solvers: found {asked.solvers!r}; wanted names such as newton,clarabel,SCS, or all.")
    solvers = [named_solver(name, asked.accuracy, "--solvers") for name in names]
    # So that the first of them does not pay for the import of cvxpy.
    installed()
    return solvers


def _line(outcome: Outcome, apart: Apart | None, rigorous: bool) -> str:
    run, seconds = outcome.trajectory, outcome.seconds
    iterations = int(np.median(run.iterations[1:])) if len(run.times) > 1 else 0
    against = " " * 23
    if apart is not None:
        kept = ("yes" if apart.kept else "NO") if rigorous else "-"
        against = f"{apart.distance:8.1e}  {apart.allowed:7.1e}  {kept:<4}"
    figures = (
        f"{outcome.solver.name:<11} {outcome.solver.accuracy:.0e}  {run.certificate.max():9.1e}  "
        f"{run.certificate_floor.max():.0e}  {against}  {iterations:10}  {run.safeguards.sum():10}"
    )
    return figures + "".join(f"{seconds[name]:10.3f}" for name in SECONDS)


def _remarks(answered: list[Outcome], best: Outcome | None, rigorous: bool) -> list[str]:
    lines = []
    for outcome in answered:
        missed = outcome.missed
        if len(missed):
            run, n = outcome.trajectory, missed[0]
            lines.append(
                f"{outcome.solver.name} misses its accuracy in {len(missed)} of {len(run.times) - 1} steps, "
                f"first in step {n} at t = {run.times[n]:.6g}, where it reached {run.certificate[n]:.1e}"
            )
    if best is not None and len(answered) > 1:
        lines.append(f"distance: of the states to those by {best.solver.name}, the most certain, in energy norm")
    if best is not None and not rigorous:
        lines.append("allowed: no bound here, where weights follow the pressure or friction or rates meet limits")
    return lines
