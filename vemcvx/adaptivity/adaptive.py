"""A mesh and instants for the accuracy asked: solve, estimate, mark, refine, until the budget is met.

Each pass simulates the whole history on the mesh of that pass: friction remembers its path, and a history that was
carried over from another mesh would bring that mesh's errors along. Passes grow by factors, so that all of them cost
little more than twice the last one.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.adaptivity.instants import follow_load
from vemcvx.adaptivity.marking import cells_to_refine, steps_to_split
from vemcvx.budget import ErrorBudget, budget_of, check_estimable
from vemcvx.budget.missed import PROBES
from vemcvx.errors import SceneError
from vemcvx.history import History
from vemcvx.history.outputs import record
from vemcvx.meshes import PolygonMesh
from vemcvx.program.condensation import Condensation
from vemcvx.real import brief
from vemcvx.scene import Scene
from vemcvx.scene.pose import Posed, pose
from vemcvx.simulate import check_kinds
from vemcvx.solvers import Solver
from vemcvx.stepping.march import checked_times, march
from vemcvx.stepping.storage import Memory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Marks = tuple[NDArray[np.bool_], Floats]

log = logging.getLogger("vemcvx")

TIME_SHARE, LOAD_SHARE, ALGEBRA_SHARE = 0.3, 0.05, 0.01
"""Parts of the target for time as a whole, for what steps miss of the load, and for the algebra."""
THETA = 0.6
NEAR = 1.5
"""Steps are split once the error of the mesh is this near to what it may be: before, they would be for nothing."""
MOST_LOOKED_AT = 8
"""Instants at which the mesh is judged; each costs one back-substitution a pass."""


@dataclass(frozen=True)
class Pass:
    """One pass: sizes, the parts of its estimated relative error, and its seconds."""

    cells: int
    unknowns: int
    steps: int
    algebra: float
    space: float
    time: float
    seconds: float

    @property
    def total(self) -> float:
        """The sum of the three parts."""
        return self.algebra + self.space + self.time


@dataclass(frozen=True, eq=False)
class Adapted:
    """What :func:`adapt` returns.

    Attributes
    ----------
    history : History
        The last pass; `history.errors` names the three parts of its error, which files keep.
    budget : ErrorBudget
        Of the last pass.
    passes : tuple of Pass
        From the coarse mesh to the last.
    target : float
        The relative energy error that was asked for.
    """

    history: History
    budget: ErrorBudget
    passes: tuple[Pass, ...]
    target: float

    @property
    def met(self) -> bool:
        """Whether the estimated error is within the target."""
        return self.passes[-1].total <= self.target

    def summary(self) -> str:
        """The passes as a table."""
        head = "cells   unknowns  steps   algebra     space      time     total   seconds"
        rows = [
            f"{p.cells:<7d} {p.unknowns:<9d} {p.steps:<5d} {p.algebra:9.1e} "
            f"{p.space:9.2%} {p.time:9.2%} {p.total:9.2%} {p.seconds:8.2f}"
            for p in self.passes
        ]
        met = "met" if self.met else "not met"
        return "\n".join([head, *rows, f"target {self.target:.2%} of the energy norm: {met}"])


def adapt(
    scene: Scene,
    mesh: PolygonMesh,
    times: ArrayLike,
    target: float = 0.02,
    *,
    solver: Solver | None = None,
    initial: ArrayLike | str | None = None,
    most_unknowns: int = 400_000,
    theta: float = THETA,
    progress: Callable[[Pass], None] | None = None,
) -> Adapted:
    """Simulate with a mesh and instants chosen so that the estimated relative energy error is within `target`.

    Parameters
    ----------
    scene : Scene
    mesh : PolygonMesh
        To begin with, coarse; it must have the boundaries that the scene names.
    times : increasing sequence of instants
        The first, the last, and those at which the answer is wanted, which the history stores; others are put between.
    target : float
        Relative energy error: :class:`vemcvx.budget.ErrorBudget`, the largest over the instants looked at.
    solver : Solver, optional
        Its accuracy is lowered to a hundredth of the target where it asks for more than that and need not.
    initial : None, "equilibrium" or "settled"
        As in :func:`vemcvx.simulate`.
    most_unknowns : int
        No pass is begun that is expected to have more (the first one aside); the result then says that the target was
        not met.
    theta : float
        Part of the squared error that is refined in a pass, in (0, 1).
    progress : callable, optional
        Told of each pass.

    Raises
    ------
    SceneError
        The target is not in (0, 1), or scene, mesh and times make no well-posed problem.
    NotCertified
        A step misses the accuracy.
    """
    check_kinds(scene, mesh)
    _check(target, theta, initial, most_unknowns, progress)
    wanted = checked_times(times)
    if len(wanted) < 2:
        raise SceneError("adapt: found one instant; give the first and the last at least, such as [0, 1].")
    instants, passes = wanted, []
    while True:
        start = time.perf_counter()
        posed = pose(scene, mesh, instants)
        check_estimable(posed, "adapt")
        if not passes:
            # Nothing is left out here: what is zero at the instants asked for need not be so between them.
            instants, missed = _begin(pose(scene, mesh), instants, target)
            posed = pose(scene, mesh, instants)
        looked_at = _looked_at(instants, wanted)
        kept = np.searchsorted(instants, wanted)
        trajectory = march(posed.system, instants, solver=_lenient(solver, target), initial=initial, store=kept)
        history = record(posed, trajectory, time.perf_counter() - start - sum(trajectory.seconds.values()), Memory())
        # Known from the first pass, and no more since: steps were but split.
        known = np.append(missed, np.zeros(len(instants) - 2))
        budget = budget_of(posed, history, [history.row(int(n)) for n in looked_at], known)
        worst = budget.largest
        now = Pass(mesh.n_cells, posed.system.n, len(instants) - 1, *_parts(worst), time.perf_counter() - start)
        passes.append(now)
        log.info("pass %d: %d cells, %d steps, estimated error %.3g", len(passes), now.cells, now.steps, now.total)
        if progress is not None:
            progress(now)
        marked, finer = _next(budget, worst, target, theta, instants)
        done = now.total <= target or not (marked.any() or len(finer) > len(instants))
        if done or now.unknowns * (1 + 3 * marked.mean()) > most_unknowns:
            return Adapted(replace(history, errors={**worst, "target": target}), budget, tuple(passes), target)
        mesh = mesh.refine(marked) if marked.any() else mesh
        instants = finer


def _next(budget: ErrorBudget, worst: dict[str, float], target: float, theta: float, instants: Floats) -> Marks:
    """Cells to refine, and the instants of the next pass; these wait until the mesh is nearly good enough."""
    for_space = max(target - worst["algebra"] - min(worst["time"], TIME_SHARE * target), 0.5 * target)
    marked = cells_to_refine(budget.cells**2, for_space**2, theta)
    if worst["space"] > NEAR * for_space:
        return marked, instants
    parts = steps_to_split(budget.lags, (TIME_SHARE * target) ** 2)
    pieces = [np.linspace(a, b, m + 1)[1:] for (a, b), m in zip(pairwise(instants), parts, strict=True)]
    return marked, np.concatenate([instants[:1], *pieces])


def _check(target: object, theta: object, initial: object, most: object, progress: object) -> None:
    if not (isinstance(target, Real) and not isinstance(target, bool) and 0 < target < 1):
        raise SceneError(
            f"adapt: found target = {brief(target)}; it is a relative error, between 0 and 1, such as 0.02."
        )
    if not (isinstance(theta, Real) and 0 < theta < 1):
        raise SceneError(f"adapt: found theta = {brief(theta)}; it is a part, between 0 and 1, such as 0.6.")
    if not (isinstance(most, Real) and most >= 1):
        raise SceneError(f"adapt: found most_unknowns = {brief(most)}; it is a number of unknowns, such as 400_000.")
    if not (progress is None or callable(progress)):
        raise SceneError(f"adapt: found progress = {brief(progress)}; it is a function that is told of each Pass.")
    if not (initial is None or isinstance(initial, str)):
        raise SceneError(
            "adapt: found an initial displacement, which belongs to one mesh; begin from None, 'equilibrium' or "
            "'settled'."
        )


def _begin(posed: Posed, instants: Floats, target: float) -> tuple[Floats, float]:
    """Instants that follow the load, and what their steps still miss of it, on the coarse mesh.

    Its energy is that of the body but for the mesh's error.
    """
    solve = Condensation(posed.system, condense=False).solve
    # Loads with a whole number of cycles vanish at the ends, but for rounding.
    between = [a + s * (b - a) for a, b in pairwise(instants) for s in PROBES]
    seen = np.union1d(instants, between)
    sizes = [float(f @ solve(f)) for f in (posed.system.force(float(t)) for t in seen)]
    times, missed = follow_load(posed, instants, LOAD_SHARE * target * float(np.sqrt(max(sizes))), solve)
    return times, float(np.linalg.norm(missed))


def _lenient(solver: Solver | None, target: float) -> Solver | None:
    """Algebra well below the error of the mesh is enough; what is no solver is refused by the march."""
    if not isinstance(solver, Solver) or solver.accuracy >= ALGEBRA_SHARE * target:
        return solver
    return replace(solver, accuracy=ALGEBRA_SHARE * target)


def _looked_at(instants: Floats, wanted: Floats) -> Ints:
    """Steps at which the mesh is judged: those asked for, or some of them, and the last."""
    steps = np.searchsorted(instants, wanted[1:])
    if len(steps) > MOST_LOOKED_AT:
        steps = steps[np.linspace(0, len(steps) - 1, MOST_LOOKED_AT).round().astype(int)]
    return steps


def _parts(worst: dict[str, float]) -> Sequence[float]:
    return worst["algebra"], worst["space"], worst["time"]
