"""Adaptive meshes and instants for a requested accuracy: solve, estimate, mark and refine until the target is met.

Each pass simulates the whole history, and estimates the squared error of each cell. The pass refines the fewest cells
that have the fraction THETA of the sum of squares (Dorfler, *A convergent adaptive algorithm for Poisson's equation*,
SIAM J. Numer. Anal. 33, 1996). Steps with large time errors are split.
"""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, Ints, brief, check_takes, is_real, largest, part
from vemcvx.base.errors import SceneError, SceneWarning
from vemcvx.bound.skeleton import check_estimable
from vemcvx.estimate.budget import ErrorBudget, budget_of, estimate_time_error
from vemcvx.estimate.finer_steps import Finer, compare_finer_steps
from vemcvx.history import History
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.bisection import check_tetrahedra
from vemcvx.results import SINGULAR, growth, largest_values, record, warn_of_large_strains
from vemcvx.scene import PosedScene, Scene, pose_scene
from vemcvx.simulation import Projected, begins, check_kinds, free_unknowns
from vemcvx.solvers import Solver, Solves
from vemcvx.stepping import Memory, certify_in_full, check_times, initial_state, march, prepare
from vemcvx.stepping.course import JUMP_WIDTH, inside_steps, sample_course

GAIN = 0.75  # Fraction of a cell's squared error that refinement removes, for smooth solutions
MARGIN = 0.9  # Expected error after refinement, as a fraction of the target
TIME_FRACTION = 0.3  # Allowed time error as a fraction of the target
THETA = 0.6  # Fraction of the squared error in the refined cells
MOST_STEPS = 4000  # Largest number of steps of the first pass


def cells_to_refine(squares: Floats, goal: float, theta: float) -> Bools:
    """Return a mask (n_cells,) of the cells to refine."""
    total = float(squares.sum())
    excess = (total - MARGIN**2 * goal) / (GAIN * total) if total > 0 else 0.0
    chosen = np.zeros(len(squares), dtype=bool)
    if excess > 0.0:
        chosen[largest(squares, min(theta, excess))] = True
    return chosen


def split_steps(times: Floats, finer: Finer, unit: float, allowed: float) -> Floats:
    """Return the instants after a split of steps with large errors."""
    error = float(finer.errors.max()) / (unit or 1.0)
    squares = np.where(np.diff(times) > JUMP_WIDTH * (times[-1] - times[0]), finer.added**2, 0.0)
    if error <= allowed or not squares.any():
        return times
    # With smooth loads, two half steps have a quarter of the error.
    parts = 2 if error <= 4.0 * allowed else 3
    new = [times]
    # Split the fewest steps with 0.8 of the squared error.
    for n in largest(squares, 0.8):
        a, b = times[n], times[n + 1]
        inside = finer.bends[(finer.bends > a) & (finer.bends < b)]
        new.append(inside if len(inside) else np.linspace(a, b, parts + 1)[1:-1])
    return np.unique(np.concatenate(new))


@dataclass(frozen=True, kw_only=True)
class Pass:
    """The sizes, estimated relative errors and seconds of a pass."""

    cells: int
    unknowns: int
    steps: int
    algebra: float
    space: float
    time: float
    seconds: float
    extremes: dict[str, tuple[float, float]]
    """for quantities that may be unbounded: cell size, and largest value"""

    @property
    def total(self) -> float:
        """The sum of algebra, space and time."""
        return self.algebra + self.space + self.time


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Adapted:
    """The result of :func:`adapt`.

    Attributes
    ----------
    history : History
        The run of the last pass, with the estimated error in `history.errors`.
    budget : ErrorBudget
        The budget of the last pass.
    passes : tuple of Pass
        All passes from the coarse mesh to the last mesh.
    target : float
        The requested relative error.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right"))
    >>> adapted = vx.adapt(scene, vx.meshes.squares(4), [0.0, 1.0], target=0.3, initial="settled")
    >>> adapted.met
    True
    """

    history: History
    budget: ErrorBudget
    passes: tuple[Pass, ...]
    target: float

    @property
    def met(self) -> bool:
        """True if the estimated error is within the target."""
        return self.passes[-1].total <= self.target

    def summary(self) -> str:
        """Return the passes as a table."""
        head = "cells   unknowns  steps   algebra     space      time     total   seconds"
        rows = [
            f"{p.cells:<7d} {p.unknowns:<9d} {p.steps:<5d} {p.algebra:9.1e} "
            f"{p.space:9.2%} {p.time:9.2%} {p.total:9.2%} {p.seconds:8.2f}"
            for p in self.passes
        ]
        met = "met" if self.met else "not met"
        return "\n".join([head, *rows, *self.budget.jumps, f"target {self.target:.2%} of the energy norm: {met}"])

    def __repr__(self) -> str:
        return self.summary()


def adapt(
    scene: Scene,
    mesh: Mesh,
    times: ArrayLike,
    target: float = 0.02,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | Projected | None = None,
    most_unknowns: int = 400_000,
    progress: Callable[[Pass], None] | None = None,
) -> Adapted:
    """Simulate on an adaptive mesh with adaptive steps, such that the estimated relative error is at most `target`.

    Parameters
    ----------
    scene : Scene
    mesh : PolygonMesh or PolyhedralMesh
        Coarse initial mesh with the boundaries that the scene names. In space, all cells must be tetrahedra.
    times : increasing sequence of instants
        Instants to store. The run begins at the first and ends at the last. The history also stores instants at which
        data bend, turn or jump (:func:`vemcvx.instants`). More instants are inserted where steps cause large errors.
    target : float
        Allowed relative error in the energy norm. The error is estimated at up to eight given instants, and at up to
        eight instants at which data bend, turn or jump (:func:`vemcvx.error_budget`).
    solver : Solver, or object with solve(program, target), optional
        As for :func:`vemcvx.simulate`. An accuracy of target / 100 suffices.
    initial : None, "equilibrium", "settled" or vx.projected(u_0)
        As in :func:`vemcvx.simulate`.
    most_unknowns : int
        A pass that is expected to exceed this number does not begin, even if the target is not met.
    progress : callable, optional
        Function that is called with each finished :class:`Pass`.

    Returns
    -------
    Adapted

    Raises
    ------
    MeshError
        A cell of a mesh in space is not a tetrahedron.
    SceneError
        The target is not in (0, 1), there is no estimate for the scene, or scene, mesh and times are not well-posed.
    NotCertified
        A step misses the accuracy of the solver.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right"))
    >>> adapted = vx.adapt(scene, vx.meshes.squares(4), [0.0, 1.0], target=0.3, initial="settled")
    >>> adapted.history.mesh.n_cells >= 16
    True
    """
    check_kinds(scene, mesh)
    if isinstance(mesh, PolyhedralMesh):
        check_tetrahedra(mesh, "adapt")
    _check(target, most_unknowns, progress)
    if not (initial is None or isinstance(initial, (str, Projected))):
        raise SceneError(
            "adapt: found an array of initial displacements, which fits one mesh only; give None, 'equilibrium', "
            "'settled' or vx.projected(u_0)."
        )
    wanted = check_times(times)
    if len(wanted) < 2:
        raise SceneError("adapt: found one instant; give at least the first and the last, such as [0, 1].")
    aim = _Aim(target, initial, wanted, solver=solver)
    passes, start = list[Pass](), time.perf_counter()
    aim, instants = _begin(scene, mesh, aim)
    while True:
        posed, history = _simulate_pass(scene, mesh, instants, aim, start)
        finer = estimate_time_error(posed, history.trajectory)
        budget = budget_of(posed, history, [history.row(n) for n in aim.steps(instants).tolist()], finer)
        now = Pass(
            cells=mesh.n_cells,
            unknowns=posed.system.n,
            steps=len(instants) - 1,
            seconds=time.perf_counter() - start,
            extremes=_extremes(history),
            **{name: budget.largest[name] for name in ("algebra", "space", "time")},
        )
        passes.append(now)
        _tell(passes, budget, progress)
        marked, split = _next(now, budget, (instants, finer), target)
        done = now.total <= target or not (marked.any() or len(split) > len(instants))
        # Refinement of a cell adds about three cells.
        if done or now.unknowns * (1 + 3 * marked.mean()) > most_unknowns:
            return _make_result(posed, history, budget, aim, passes)
        start = time.perf_counter()
        mesh, instants = mesh.refine(marked) if marked.any() else mesh, split


@dataclass(frozen=True)
class _Aim:
    """The target and the settings of an adaptive run."""

    target: float
    initial: str | Projected | None
    wanted: Floats  # given instants
    solver: Solver | Solves | None
    turns: Floats = field(default_factory=lambda: np.zeros(0))
    """further instants, at which data bend, turn or jump"""

    @property
    def stored(self) -> Floats:
        return np.union1d(self.wanted, self.turns)

    def steps(self, instants: Floats) -> Ints:
        """Return the steps with an estimate of the mesh error."""
        # Every estimate costs a back-substitution, so few instants are chosen.
        judged = np.union1d(_choose_evenly(self.wanted[1:], 8), _choose_evenly(self.turns, 8))
        return np.searchsorted(instants, judged)


def _choose_evenly(instants: Floats, most: int) -> Floats:
    few = len(instants) <= most
    return instants if few else instants[np.linspace(0, len(instants) - 1, most).round().astype(int)]


def _simulate_pass(scene: Scene, mesh: Mesh, instants: Floats, aim: _Aim, start: float) -> tuple[PosedScene, History]:
    posed = pose_scene(scene, mesh, instants.tolist())
    kept = np.union1d(np.searchsorted(instants, aim.stored), aim.steps(instants)).tolist()
    begun = free_unknowns(aim.initial, posed, instants)
    trajectory = march(posed.system, instants, solver=aim.solver, initial=begun, store=kept)
    assembled = time.perf_counter() - start - sum(trajectory.seconds.values())
    return posed, History.from_results(record(posed, trajectory, assembled, Memory()), begins(aim.initial))


def _make_result(
    posed: PosedScene,
    history: History,
    budget: ErrorBudget,
    aim: _Aim,
    passes: Sequence[Pass],
) -> Adapted:
    errors = {**budget.largest, "target": aim.target}
    history = replace(history, errors=errors, growth=_growth(passes))
    warn_of_large_strains(posed, history)
    return Adapted(history=history, budget=budget, passes=tuple(passes), target=aim.target)


def _tell(passes: Sequence[Pass], budget: ErrorBudget, progress: Callable[[Pass], None] | None) -> None:
    now, log = passes[-1], logging.getLogger("vemcvx")
    for words in budget.jumps if len(passes) == 1 else ():
        log.info("%s", words)
    log.info("pass %d: %d cells, %d steps, estimated error %.3g", len(passes), now.cells, now.steps, now.total)
    if progress is not None:
        progress(now)


def _extremes(history: History) -> dict[str, tuple[float, float]]:
    mesh, found = history.mesh, {}
    for one, *_ in largest_values(history):
        if one.key in SINGULAR:
            near = np.linalg.norm(mesh.centroids - one.place, axis=1)
            found[one.key] = float(mesh.measures[np.argmin(near)] ** (1.0 / mesh.points.shape[1])), one.value
    return found


def _growth(passes: Sequence[Pass]) -> dict[str, str]:
    keys = set.intersection(*(set(one.extremes) for one in passes))
    found = {key: growth(*zip(*(one.extremes[key] for one in passes), strict=True)) for key in SINGULAR if key in keys}
    return {key: words for key, words in found.items() if words}


def _next(now: Pass, budget: ErrorBudget, steps: tuple[Floats, Finer], target: float) -> tuple[Bools, Floats]:
    """Return a mask of cells to refine, and the instants of the next pass."""
    # At least half the target remains for the mesh error.
    for_space = max(target - now.algebra - min(now.time, TIME_FRACTION * target), 0.5 * target)
    marked = cells_to_refine(budget.cells**2, for_space**2, THETA)
    if now.space > 1.5 * for_space or now.time <= TIME_FRACTION * target:
        return marked, steps[0]
    (instants, finer), unit = steps, budget.scale
    return marked, split_steps(instants, finer, unit or finer.norm, TIME_FRACTION * target)


def _check(target: object, most: object, progress: object) -> None:
    part(target, "adapt", "target", "a relative error,", "0.02")
    if not (is_real(most) and 1 <= most <= float(np.finfo(float).max)):
        raise SceneError(f"adapt: found most_unknowns = {brief(most)}; it is a number of unknowns, such as 400_000.")
    if not (progress is None or callable(progress)):
        raise SceneError(f"adapt: found progress = {brief(progress)}; it is a function that is called with each Pass.")
    check_takes(progress, 1, "adapt: progress", "each Pass")


def _begin(scene: Scene, mesh: Mesh, aim: _Aim) -> tuple[_Aim, Floats]:
    """Return the completed aim, and instants with a small time error."""
    # Effects that are zero at all given instants may act between them.
    posed = pose_scene(scene, mesh, between=aim.wanted.tolist())
    check_estimable(posed, "adapt")
    if posed.curves:
        warnings.warn(
            f"adapt: the curve of {' and '.join(posed.curves)} is a polygon on the coarse mesh. "
            "Refined meshes keep the corners of this polygon, over which nothing can slide. Solutions converge to the "
            "solution for the polygon, and errors are relative to the polygon. If something slides there, simulate on "
            "finer meshes of the curve itself.",
            SceneWarning,
            stacklevel=3,
        )
    run, begun = prepare(posed.system, None, False, True), free_unknowns(aim.initial, posed, aim.wanted)
    state = certify_in_full(run, initial_state(run, aim.wanted, begun))
    known = sample_course(posed.system, aim.wanted)
    aim = replace(aim, turns=inside_steps(aim.wanted, known.bends))
    times = aim.stored
    while True:
        finer = compare_finer_steps(run, times, state.unknowns, known)
        split = split_steps(times, finer, finer.norm, TIME_FRACTION * aim.target)
        if len(split) == len(times) or len(split) > MOST_STEPS:
            return aim, times
        times = split
