r"""The estimated error of a run, due to the solver, the mesh and the steps.

$$ \text{total} = \text{algebra} + \text{space} + \text{time} $$

- "algebra" is the sum of the certified errors of all steps (:attr:`vemcvx.History.certificate_total`).
- "space" is estimated by residuals in each cell (:mod:`.residual`).
- "time" is estimated by a second run on the same mesh with finer steps (:mod:`.finer_steps`).

All parts are energy norms, relative to the largest energy norm of the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import SAME, Floats, Ints
from vemcvx.base.errors import HistoryError, SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.skeleton import check_estimable, instant
from vemcvx.estimate.finer_steps import Finer, compare_finer_steps
from vemcvx.estimate.residual import Residuals
from vemcvx.history import History, scene_of
from vemcvx.results import displacement
from vemcvx.scene import PosedScene, pose_scene
from vemcvx.stepping import Trajectory, prepare
from vemcvx.vem.elasticity import cell_energies


def require_same_form(posed: PosedScene, u: Floats) -> None:
    """Raise SceneError if the stiffness and the material give different energies of u."""
    posed.space.refuse_revolution("error estimates")
    stiffness = posed.A if posed.springs is None else posed.A - posed.springs
    about = u - u.mean(axis=0)
    energy = float(about.ravel() @ (stiffness @ about.ravel()))
    material = posed.material
    parts = cell_energies(posed.space, material.moduli, material.choose_stabilisation(posed.space.dim), about)
    apart = abs(energy - float(parts.sum()))
    # The computed energy of a rotation is at most `rounding`.
    rounding = 1e-14 * float(np.abs(about).ravel() @ (abs(stiffness) @ np.abs(about).ravel()))
    if apart > SAME * max(energy, float(parts.sum())) + rounding:
        raise SceneError(
            f"error_budget: a state has the energy {energy:.9g} by the scene's stiffness, but {parts.sum():.9g} by "
            f"the moduli and stabilisation of {material.subject}. The two energies must agree; there is no estimate. "
            "In the material's Contribution, set the stabilisation that its stiffness contains, as "
            "Elasticity(stabilisation=...) does for any vx.Stabilisation."
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBudget(Outlined):
    """The relative energy errors of a run, due to the solver, the mesh and the steps.

    Attributes
    ----------
    steps : (S,) int
        The examined steps.
    algebra, space, time : (S,)
        The errors of solver, mesh and steps; `algebra` is certified, `space` and `time` are estimated.
    parts : mapping of str to (S,)
        Parts of `space`: "volume", "jumps", "boundary", "stabilisation", "data" and, for bodies in space, "pressure".
        The sum of squared parts is space^2.
    cells : (n_cells,)
        The largest estimated error eta_K of each cell over all steps (:mod:`vemcvx.estimate.residual`).
    scale : float
        The largest energy norm of the run, including springs. All errors are divided by this norm.

    Examples
    --------
    >>> steel, held, pull = vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right")
    >>> mesh = vx.meshes.squares(4)
    >>> history = vx.simulate(vx.Scene(steel, held, pull), mesh, [0.0, 1.0], initial="settled")
    >>> budget = vx.error_budget(history)
    >>> sorted(budget.largest)
    ['algebra', 'space', 'time', 'total']
    """

    steps: Ints
    algebra: Floats
    space: Floats
    time: Floats
    parts: dict[str, Floats]
    cells: Floats
    jumps: tuple[str, ...]  # one sentence for each discontinuity of the data in time
    scale: float
    history: History

    def outline(self) -> Outline:
        """Return the outline of the step with the largest total."""
        worst = self.steps[np.argmax(self.total)]
        parts = [(name, f"{value:.1e}") for name, value in self.largest.items()]
        return Outline(
            f"ErrorBudget: largest estimated relative energy errors, at step {worst} ({len(self.steps)} examined)",
            [*parts, *(("jump", words) for words in self.jumps)],
        )

    @property
    def total(self) -> Floats:
        """The sum (S,) of algebra, space and time."""
        return self.algebra + self.space + self.time

    @property
    def largest(self) -> dict[str, float]:
        """The three errors and the sum, at the step with the largest sum."""
        worst = int(np.argmax(self.total))
        return {name: float(getattr(self, name)[worst]) for name in ("algebra", "space", "time", "total")}


def error_budget(history: History, steps: int | Sequence[int] | None = None) -> ErrorBudget:
    """Estimate the errors of a run: algebra, mesh and time steps.

    Parameters
    ----------
    history : History
    steps : int or sequence of int, optional
        Stored steps to examine; by default all steps after step 0.

    Returns
    -------
    ErrorBudget

    Raises
    ------
    HistoryError
        The history was read from files, which do not contain its scene.
    SceneError
        A step was not stored, or there is no estimate for the scene, for example due to Viscosity or a PointLoad.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    >>> bool(vx.error_budget(history).total[0] < 0.5)
    True
    """
    scene = scene_of(history, "error_budget")
    posed = pose_scene(scene, history.mesh, history.trajectory.times.tolist())
    wanted = history.stored[history.stored > 0] if len(history.stored) > 1 else history.stored
    given = steps if isinstance(steps, (list, tuple, np.ndarray)) else [steps]
    chosen = wanted.tolist() if steps is None else list(given)
    if not chosen:
        raise HistoryError("error_budget: found no steps; give numbers of stored steps, such as [-1].")
    rows = [history.row(n) for n in chosen]
    return budget_of(posed, history, rows)


def budget_of(posed: PosedScene, history: History, rows: Sequence[int], finer: Finer | None = None) -> ErrorBudget:
    """Return the error budget at some rows of a history."""
    check_estimable(posed, "error_budget")
    require_same_form(posed, history.displacement[rows[-1]])
    run, residuals = history.trajectory, Residuals(posed)
    squares = [residuals.indicators(instant(history, k)) for k in rows]
    steps = history.stored[np.asarray(rows, dtype=np.int64)]
    finer = estimate_time_error(posed, run) if finer is None else finer
    parts = {name: np.sqrt([part[name].sum() for part in squares]) for name in squares[0]}
    space = np.sqrt(np.sum([values**2 for values in parts.values()], axis=0))
    time = np.maximum.accumulate(finer.errors)[steps]
    scale = float(run.norm.max())
    unit = scale or float((space + time).max()) or 1.0
    return ErrorBudget(
        steps=steps,
        algebra=run.certificate_total[steps] * run.unit[steps] / unit,
        space=space / unit,
        time=time / unit,
        parts={name: values / unit for name, values in parts.items()},
        cells=np.sqrt(np.max([np.sum(list(part.values()), axis=0) for part in squares], axis=0)) / unit,
        jumps=finer.jumps,
        scale=scale,
        history=history,
    )


def estimate_time_error(posed: PosedScene, run: Trajectory) -> Finer:
    """Repeat a run with finer steps, and return the comparison."""
    assert run.initial is not None
    # Friction that is zero at all instants of the run may act in finer steps.
    whole = pose_scene(posed.scene, posed.space.mesh, between=run.times.tolist()) if posed.inactive else posed
    start, y = float(run.times[0]), run.initial
    if whole is not posed:
        y = whole.supports.gather(whole.at_rest(displacement(posed, y, start)) - whole.supports.motion(start))
    return compare_finer_steps(prepare(whole.system, None, False, True), run.times, y)
