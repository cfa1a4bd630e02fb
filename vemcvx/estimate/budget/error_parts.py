"""Where the error of a run comes from: the algebra, the mesh, the steps.

    total = algebra + space + time

algebra is certified: the steps' duality gaps added up (:attr:`vemcvx.History.certificate_total`). space is estimated,
by the residuals of :mod:`.residual`. time is the distance from the same run in finer steps, on the same mesh
(:mod:`.finer_steps`). All are relative energy errors: parts of the largest energy norm of the run; where nothing has
moved, of the estimate, so that all is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints, brief, plain
from vemcvx.errors import HistoryError, SceneError
from vemcvx.estimate.budget.data_oscillation import DataOscillation
from vemcvx.estimate.budget.finer_steps import Finer, beside_finer
from vemcvx.estimate.budget.residual import indicators
from vemcvx.estimate.budget.skeleton import skeleton
from vemcvx.estimate.budget.surface_forces import instant
from vemcvx.history import History
from vemcvx.meshes import plane_mesh
from vemcvx.outline import Outline, Outlined
from vemcvx.results.from_march import displacement
from vemcvx.scene.composition import InitialStresses
from vemcvx.scene.pose import PosedScene, pose_scene
from vemcvx.stepping.state import prepare
from vemcvx.stepping.trajectory import Trajectory


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBudget(Outlined):
    """Relative energy errors of a run, part by part.

    Attributes
    ----------
    steps : (S,) int
        The steps looked at.
    algebra, space, time : (S,)
        Certified, estimated and estimated: see :mod:`vemcvx.estimate.budget.error_parts`.
    parts : mapping of str to (S,)
        The shares of space: "volume", "jumps", "boundary", "stabilisation" and "data"; space^2 is the sum of their
        squares.
    cells : (n_cells,)
        The largest eta_K (:mod:`vemcvx.estimate.budget.residual`) of each cell over the steps looked at.
    added : (N,)
        What each step adds to the error of time: the norm of the change.
    jumps : tuple of str
        A sentence for each instant at which data jump.
    scale : float
        The energy norm to which all are relative, the root of force times length.
    """

    steps: Ints
    algebra: Floats
    space: Floats
    time: Floats
    parts: dict[str, Floats]
    cells: Floats
    added: Floats
    jumps: tuple[str, ...]
    scale: float

    def outline(self) -> Outline:
        """What prompts and notebooks show: the parts where their sum is largest."""
        worst = self.steps[np.argmax(self.total)]
        parts = [(name, f"{value:.1e}") for name, value in self.largest.items()]
        return Outline(
            f"ErrorBudget: estimated relative energy errors at step {worst}, the largest of {len(self.steps)} steps",
            [*parts, *(("jump", words) for words in self.jumps)],
        )

    @property
    def total(self) -> Floats:
        """(S,) the sum of the three."""
        return self.algebra + self.space + self.time

    @property
    def largest(self) -> dict[str, float]:
        """The three parts and their sum, where the sum is largest."""
        worst = int(np.argmax(self.total))
        return {name: float(getattr(self, name)[worst]) for name in ("algebra", "space", "time", "total")}


def error_budget(history: History, steps: int | Sequence[int] | None = None) -> ErrorBudget:
    """Estimate the errors of a run: algebra, mesh and time steps.

    Parameters
    ----------
    history : History
    steps : int or sequence of int, optional
        Stored steps to examine; by default all but the initial instant.

    Raises
    ------
    HistoryError
        The history was read from files, so that its scene is not known.
    SceneError
        A step was not stored, or the scene has Viscosity or a PointLoad, for which there is no estimate.
    """
    if not isinstance(history, History):
        raise HistoryError(f"error_budget: found {brief(history)} where a History is wanted.")
    if history.scene is None:
        raise HistoryError(
            "error_budget: this history was read from files, and its scene is not among them; simulate the scene."
        )
    mesh = plane_mesh(history.mesh, "error_budget", "compare runs on finer meshes and in finer steps")
    posed = pose_scene(history.scene, mesh, history.trajectory.times.tolist())
    wanted = history.stored[history.stored > 0] if len(history.stored) > 1 else history.stored
    rows = [history.row(n) for n in (wanted.tolist() if steps is None else _whole_numbers(steps))]
    return budget_of(posed, history, rows)


def _whole_numbers(steps: int | Sequence[int]) -> list[int]:
    given = plain(steps)
    wanted = np.zeros(0) if given is None or given.dtype.kind not in "iuf" else np.atleast_1d(given)
    if wanted.ndim != 1 or len(wanted) == 0 or not np.all(np.abs(wanted) < 2**53) or np.any(wanted % 1):
        raise HistoryError(f"error_budget: found steps = {brief(steps)}; wanted numbers of stored steps, such as [-1].")
    return [int(n) for n in wanted]


def budget_of(posed: PosedScene, history: History, rows: Sequence[int], finer: Finer | None = None) -> ErrorBudget:
    """The budget of a run whose posed scene is at hand, at rows of its arrays; `finer` if that is known."""
    check_estimable(posed, "error_budget")
    run, edges = history.trajectory, skeleton(posed)
    oscillation = DataOscillation(posed, edges)
    squares = [indicators(posed, edges, oscillation, instant(history, k)) for k in rows]
    steps = history.stored[np.asarray(rows, dtype=np.int64)]
    finer = in_time(posed, run) if finer is None else finer
    parts = {name: np.sqrt([part[name].sum() for part in squares]) for name in squares[0]}
    space = np.sqrt(np.sum([share**2 for share in parts.values()], axis=0))
    time = np.maximum.accumulate(finer.errors)[steps]
    scale = float(run.norm.max())
    unit = scale or float((space + time).max()) or 1.0
    return ErrorBudget(
        steps=steps,
        algebra=run.certificate_total[steps] * run.scale[steps] / unit,
        space=space / unit,
        time=time / unit,
        parts={name: share / unit for name, share in parts.items()},
        cells=np.sqrt(np.max([np.sum(list(part.values()), axis=0) for part in squares], axis=0)) / unit,
        added=finer.added / unit,
        jumps=finer.jumps,
        scale=scale,
    )


def in_time(posed: PosedScene, run: Trajectory) -> Finer:
    """A run of a posed scene beside one in finer steps.

    What was left out because it is zero at the run's instants may act between them: nothing is left out here.
    """
    if run.initial is None:
        raise HistoryError("error_budget: this run does not say where it began; simulate the scene again.")
    whole = pose_scene(posed.scene, posed.space.mesh) if posed.inactive else posed
    start, y = float(run.times[0]), run.initial
    if whole is not posed:
        y = whole.supports.gather(displacement(posed, y, start) - whole.supports.motion(start))
    return beside_finer(prepare(whole.system, None, False, True), run.times, y)


def check_estimable(posed: PosedScene, subject: str) -> None:
    """Raise SceneError where there is no estimate."""
    if posed.system.damping is not None:
        raise SceneError(
            f"{subject}: there is no estimate for scenes with Viscosity; compare meshes and steps of your own choice."
        )
    for friction in posed.terms.frictions:
        if friction.slip_law is not None or friction.directions is not None:
            raise SceneError(
                f"{subject}: there is no estimate for {friction.subject}: its weights depend on slip, or act along "
                "given directions; compare meshes and steps of your own choice."
            )
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is None and load.edges is None:
            raise SceneError(
                f"{subject}: there is no estimate for {load.subject}: a force on a point does infinite work on an "
                "elastic body, and no mesh comes near that energy. Spread it over a part of the boundary by Traction."
            )
