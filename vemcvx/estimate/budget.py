"""The error of a run, part by part: the algebra, the mesh, the steps.

    total = algebra + space + time

algebra is certified: the steps' duality gaps added up (:attr:`vemcvx.History.certificate_total`). space is estimated
by the residuals below. time is the distance from the same run in finer steps, on the same mesh (:mod:`.finer_steps`).
All are relative energy errors: parts of the largest energy norm of the run; where nothing has moved, parts of the
estimate, because all is missing.

The mesh is judged by the residuals of states, cell by cell: :mod:`.residual`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import SAME, Floats, Ints, brief, plain
from vemcvx.base.errors import HistoryError, SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.skeleton import check_estimable, instant
from vemcvx.estimate.finer_steps import Finer, beside_finer
from vemcvx.estimate.quantities import quantities
from vemcvx.estimate.residual import Residuals
from vemcvx.history import History, scene_of
from vemcvx.results import Quantity, displacement
from vemcvx.scene import PosedScene, pose_scene
from vemcvx.stepping import Trajectory, prepare
from vemcvx.vem import cell_energies


def require_same_form(posed: PosedScene, u: Floats) -> None:
    """Raise SceneError unless the stiffness is a^h of the material, by the energy of displacements (n_nodes, dim).

    An effect of one's own may bring a stiffness of one form and a material of another.
    """
    stiffness = posed.A if posed.springs is None else posed.A - posed.springs
    about = u - u.mean(axis=0)
    energy = float(about.ravel() @ (stiffness @ about.ravel()))
    material = posed.material
    parts = cell_energies(posed.space, material.moduli, material.stabilised(posed.space.dim), about)
    apart = abs(energy - float(parts.sum()))
    # What the energies of rotations, which are zero, are rounded by.
    rounding = 1e-14 * float(np.abs(about).ravel() @ (abs(stiffness) @ np.abs(about).ravel()))
    if apart > SAME * max(energy, float(parts.sum())) + rounding:
        raise SceneError(
            f"error_budget: the stiffness of the scene gives a state the energy {energy:.9g}, and {material.subject} "
            f"by its moduli and stabilisation {parts.sum():.9g}: they are not of one form a^h, and there is no "
            "estimate. Give the material's Contribution the stabilisation that its stiffness has, as "
            "Elasticity(stabilisation=...) does of any vx.Stabilisation."
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBudget(Outlined):
    """Relative energy errors of a run, part by part.

    Attributes
    ----------
    steps : (S,) int
        The steps looked at.
    algebra, space, time : (S,)
        Certified, estimated and estimated: see :mod:`vemcvx.estimate.budget`.
    parts : mapping of str to (S,)
        The shares of space: "volume", "jumps", "boundary", "stabilisation" and "data", in space "pressure", too;
        space^2 is the sum of their squares.
    cells : (n_cells,)
        The largest eta_K (:mod:`vemcvx.estimate.residual`) of each cell over the steps looked at.
    added : (N,)
        What each step adds to the error of time: the norm of the change.
    jumps : tuple of str
        A sentence for each instant at which data jump.
    scale : float
        The energy norm to which all are relative, the root of force times length: the largest of the run, in which
        springs (ElasticFoundation) count as stiffness does. Measured errors (:class:`.measures.Measured`) are relative
        to the strain energy of the reference at one instant: where springs act, or the load is not at its largest, the
        two are not parts of one number.
    history : History
        The run.
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
    history: History

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """Friction work, work and wear of second order in the steps, with estimated errors: two more simulations.

        See :func:`vemcvx.quantities`.
        """
        return quantities(self.history)

    def outline(self) -> Outline:
        """The outline for prompts and notebooks: the parts where their sum is largest."""
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
    scene = scene_of(history, "error_budget")
    posed = pose_scene(scene, history.mesh, history.trajectory.times.tolist())
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
    require_same_form(posed, history.displacement[rows[-1]])
    run, of_state = history.trajectory, Residuals(posed)
    squares = [of_state.indicators(instant(history, k)) for k in rows]
    steps = history.stored[np.asarray(rows, dtype=np.int64)]
    finer = in_time(posed, run) if finer is None else finer
    parts = {name: np.sqrt([part[name].sum() for part in squares]) for name in squares[0]}
    space = np.sqrt(np.sum([share**2 for share in parts.values()], axis=0))
    time = np.maximum.accumulate(finer.errors)[steps]
    scale = float(run.norm.max())
    unit = scale or float((space + time).max()) or 1.0
    return ErrorBudget(
        steps=steps,
        algebra=run.certificate_total[steps] * run.unit[steps] / unit,
        space=space / unit,
        time=time / unit,
        parts={name: share / unit for name, share in parts.items()},
        cells=np.sqrt(np.max([np.sum(list(part.values()), axis=0) for part in squares], axis=0)) / unit,
        added=finer.added / unit,
        jumps=finer.jumps,
        scale=scale,
        history=history,
    )


def in_time(posed: PosedScene, run: Trajectory) -> Finer:
    """A run of a posed scene beside one in finer steps.

    What was left out because it is zero at the run's instants may act between them: nothing is left out here.
    """
    if run.initial is None:
        raise HistoryError("error_budget: this run does not say where it began; simulate the scene again.")
    whole = pose_scene(posed.scene, posed.space.mesh, between=run.times.tolist()) if posed.inactive else posed
    start, y = float(run.times[0]), run.initial
    if whole is not posed:
        y = whole.supports.gather(whole.at_rest(displacement(posed, y, start)) - whole.supports.motion(start))
    return beside_finer(prepare(whole.system, None, False, True), run.times, y)
