"""A mesh and instants for the accuracy asked: solve, estimate, mark, refine, until the budget is met.

Each pass simulates the whole history on the mesh of that pass: friction remembers its path, and a history that was
carried over from another mesh would bring that mesh's errors along. Passes grow by factors, so that all of them cost
little more than twice the last one.

Refined is the smallest set of cells that carries a given part theta of the squared indicators (Dorfler, *A convergent
adaptive algorithm for Poisson's equation*, SIAM J. Numer. Anal. 33, 1996). Where less is enough to reach the target,
less is taken: the squared indicator of a cell drops to a quarter when it is split in four, as h^2 does.

The error of steps is that at the instants of the run, and no estimate sees a load that comes and goes between two of
them. Where data bend, turn or jump inside a step, there is an instant from the beginning (:mod:`vemcvx.stepping.course`
finds what lasts longer than 1/256 of the run). Then steps that lose much are halved: those that together make up a
given part of the loss at once, the smallest set, as of cells.

Where the target is of friction work, work or wear, the errors of mesh and steps are those of that quantity
(:mod:`.quantities`), found by two more runs a pass; cells are still marked by energy indicators, scaled to its error.
"""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, Ints, brief, check_takes, choice, is_real, largest, part
from vemcvx.base.errors import SceneError, SceneWarning
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.error_bound import ErrorBound, of_steps, pairs_of
from vemcvx.bound.hypercircle import hypercircle
from vemcvx.bound.skeleton import check_estimable
from vemcvx.estimate.budget import ErrorBudget, budget_of, in_time
from vemcvx.estimate.finer_steps import Finer, beside_finer
from vemcvx.estimate.quantities import StepErrors, errors_of_steps, value_of, with_quantities
from vemcvx.history import History
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.bisection import check_tetrahedra
from vemcvx.results import SINGULAR, growth, largest_values, record, warn_of_large_strains, warn_of_lost_work
from vemcvx.scene import PosedScene, Scene, pose_scene
from vemcvx.simulation import Projected, begins, check_kinds, free_unknowns
from vemcvx.solvers import Solver, Solves, as_solver
from vemcvx.stepping import Memory, certify_in_full, check_times, initial_state, march, prepare
from vemcvx.stepping.course import JUMP_WIDTH, inside_steps, sample_course

GAIN = 0.75
"""Part of its squared indicator that a smooth cell loses when it is split."""
MARGIN = 0.9
"""Part of the target that a pass aims at, so that the last one need not be followed by another."""
UNSEEN = 0.01
"""Part of the target within which steps are solved: errors of the mesh are far larger."""
TIME_SHARE = 0.3
"""Part of the target for time."""
THETA = 0.6
MOST_STEPS = 4000
"""Beyond so many, steps are not split before the mesh is."""
STALL = 4
"""Passes after which the error of the mesh has fallen, if it ever does: cells are three to eight times as many then."""
OF = {
    "energy": "the energy norm",
    "dissipated": "the energy that friction dissipates",
    "work": "the work",
    "wear": "the largest wear",
}
"""Quantities whose relative error a target may be of, in words."""


def cells_to_refine(squares: Floats, goal: float, theta: float) -> Bools:
    """The cells whose squared indicators (n_cells,) make up `theta` of the sum, or fewer if that reaches the goal."""
    total = float(squares.sum())
    excess = (total - MARGIN**2 * goal) / (GAIN * total) if total > 0 else 0.0
    chosen = np.zeros(len(squares), dtype=bool)
    if excess > 0.0:
        chosen[largest(squares, min(theta, excess))] = True
    return chosen


@dataclass(frozen=True)
class Lost:
    """The relative error that steps make, and what each adds to it."""

    error: float
    squares: Floats
    """(N,) parts that add up, of energy errors their squares"""
    bends: Floats

    @classmethod
    def of_energy(cls, finer: Finer, unit: float) -> Lost:
        """By the energy norm, relative to `unit`."""
        return cls(float(finer.errors.max()) / (unit or 1.0), finer.added**2, finer.bends)

    @classmethod
    def of_quantity(cls, found: StepErrors, of: str, value: float) -> Lost:
        """By a quantity."""
        return cls(float(found.errors[of][-1]) / (abs(value) or 1.0), found.added[of], found.bends)


def split_steps(times: Floats, lost: Lost, allowed: float) -> Floats:
    """The instants (N + 1,) of a run, more where its steps lose most, if its relative error is beyond the one allowed.

    Where loads are smooth errors fall with the square of the step: beyond four times what is allowed steps are cut into
    more than two at once.
    """
    squares = np.where(np.diff(times) > JUMP_WIDTH * (times[-1] - times[0]), lost.squares, 0.0)
    if lost.error <= allowed or not squares.any():
        return times
    parts = 2 if lost.error <= 4.0 * allowed else 3
    new = [times]
    # Steps with .8 of the squared loss are split at once.
    for n in largest(squares, 0.8):
        a, b = times[n], times[n + 1]
        inside = lost.bends[(lost.bends > a) & (lost.bends < b)]
        new.append(inside if len(inside) else np.linspace(a, b, parts + 1)[1:-1])
    return np.unique(np.concatenate(new))


@dataclass(frozen=True, kw_only=True)
class Pass:
    """One pass: sizes, the parts of its estimated relative error, and its seconds.

    `space` and `time` are of what the target is of, `algebra` is certified of the energy norm.
    """

    cells: int
    unknowns: int
    steps: int
    algebra: float
    space: float
    time: float
    seconds: float
    extremes: dict[str, tuple[float, float]]
    """by key, those that may grow without limit: the size of the cells where it stands, and its value"""

    @property
    def total(self) -> float:
        """The sum of the three parts."""
        return self.algebra + self.space + self.time


def stalled(passes: Sequence[Pass]) -> bool:
    """True where the error of the mesh does not fall any more: the quantity has no limit, as of a singular pressure.

    Where it has one, a pass that refines half of the squared error takes a fifth of it away at least.
    """
    return len(passes) > STALL and passes[-1].space > 0.9 * min(one.space for one in passes[:-STALL])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Adapted(Outlined):
    """The result of :func:`adapt`.

    Attributes
    ----------
    history : History
        The last pass; `history.errors` names the three parts of its error, which files keep.
    budget : ErrorBudget
        Of the last pass.
    passes : tuple of Pass
        From the coarse mesh to the last.
    target : float
        The relative error that was asked for.
    of : {"energy", "dissipated", "work", "wear"}
        The quantity that it is of; `history.quantities` has the last three with their errors, if it is one of them.
    bound : ErrorBound or None
        Of the last pass, with ``estimate="bound"``; `budget.space` and `budget.cells` are then its.
    """

    history: History
    budget: ErrorBudget
    passes: tuple[Pass, ...]
    target: float
    of: str = "energy"
    bound: ErrorBound | None = None

    @property
    def met(self) -> bool:
        """True if the estimated error is within the target."""
        return self.passes[-1].total <= self.target

    def outline(self) -> Outline:
        """The outline for prompts and notebooks: whether the target is met, and the last pass."""
        last, met = self.passes[-1], "met" if self.met else "not met"
        parts = ", ".join(f"{name} {getattr(last, name):.1e}" for name in ("algebra", "space", "time"))
        lines = [
            ("estimated", f"{last.total:.2%} of {OF[self.of]} ({parts})"),
            ("passes", f"{len(self.passes)}; last: cells {last.cells}, unknowns {last.unknowns}, steps {last.steps}"),
            *(("jump", words) for words in self.budget.jumps),
        ]
        return Outline(f"Adapted: target {self.target:.2%}, {met}", lines)

    def summary(self) -> str:
        """The passes as a table."""
        head = "cells   unknowns  steps   algebra     space      time     total   seconds"
        rows = [
            f"{p.cells:<7d} {p.unknowns:<9d} {p.steps:<5d} {p.algebra:9.1e} "
            f"{p.space:9.2%} {p.time:9.2%} {p.total:9.2%} {p.seconds:8.2f}"
            for p in self.passes
        ]
        met = "met" if self.met else "not met"
        if self.of != "energy" and not self.met and stalled(self.passes):
            met += (
                ", and its error does not fall as the mesh is refined: there is no limit, as where stress is singular"
            )
        aim = (self.history.quantities or {}).get(self.of)
        met += f"; the value on this mesh stands {aim.unbounded}" if aim is not None and aim.unbounded else ""
        return "\n".join([head, *rows, *self.budget.jumps, f"target {self.target:.2%} of {OF[self.of]}: {met}"])


def adapt(
    scene: Scene,
    mesh: Mesh,
    times: ArrayLike,
    target: float = 0.02,
    *,
    of: str = "energy",
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | Projected | None = None,
    most_unknowns: int = 400_000,
    theta: float = THETA,
    progress: Callable[[Pass], None] | None = None,
    estimate: str = "residual",
) -> Adapted:
    """Simulate with a mesh and time steps chosen so that the estimated relative error is at most `target`.

    Parameters
    ----------
    scene : Scene
    mesh : PolygonMesh or PolyhedralMesh
        A coarse mesh to begin with, in space of tetrahedra; it must have the boundaries that the scene names.
    times : increasing sequence of instants
        The first and the last instant, and those at which the history stores the answer. It also stores those between
        them at which data bend, turn or jump (:func:`vemcvx.instants`); others are inserted where steps lose much.
    target : float
        Relative energy error (:class:`vemcvx.estimate.budget.ErrorBudget`), the largest over the instants examined, at
        most eight of those given and eight at which data turn between them; or the relative error of another quantity
        at the last instant, see `of`.
    of : {"energy", "dissipated", "work", "wear"}
        The quantity whose error is meant: the displacement in the energy norm; the energy that friction dissipates; the
        work; the largest wear (:func:`vemcvx.quantities`), which has no limit where pressure is singular: passes
        end when the error has not fallen in four of them. Each pass costs two more runs, one with all cells refined.
    solver : Solver, or object with solve(program, target), optional
        An accuracy finer than a hundredth of the target is replaced by that: nothing finer is needed.
    initial : None, "equilibrium", "settled" or vx.projected(u_0)
        As in :func:`vemcvx.simulate`.
    most_unknowns : int
        No pass after the first is started that is expected to have more unknowns; the result then says that the target
        was not met.
    theta : float
        Fraction of the squared error whose cells are refined in a pass, in (0, 1).
    progress : callable, optional
        Called with each finished :class:`Pass`.
    estimate : {"residual", "bound"}
        What the mesh is judged by: residuals, which are quick and estimate its error; or the guaranteed bound of the
        error in a step, given the one before (:func:`vemcvx.error_bound`), which takes longer, and is nearer to the
        error. That error is the conforming displacement's of :class:`ErrorBound`; the stresses that a history gives in
        cells, and which residuals judge, are farther off: up to 1.9 times the bound in 40 random scenes (target 8 %).
        The history then has the steps before those looked at, too. Time is estimated in either case.

    Warns
    -----
    SceneWarning
        Conditions on normals hold along a curve: refined meshes keep the corners of the coarse one, and a body that
        slides along them is held there.

    Raises
    ------
    MeshError
        The mesh is one in space, and a cell of it is no tetrahedron.
    SceneError
        The target is not in (0, 1), or scene, mesh and times make no well-posed problem.
    NotCertified
        A step misses the accuracy.
    """
    check_kinds(scene, mesh)
    if isinstance(mesh, PolyhedralMesh):
        check_tetrahedra(mesh, "adapt")
    _check(target, of, theta=theta, most=most_unknowns, progress=progress)
    bounded = choice(estimate, "adapt", "estimate", ("residual", "bound")) == "bound"
    if bounded and of != "energy":
        raise SceneError(f"adapt: found estimate='bound' beside of={of!r}; bounds are of the energy norm alone.")
    aim = _Aim(target, of, bounded, _begun(initial), _wanted(times), solver=_lenient(solver, target))
    passes, start = list[Pass](), time.perf_counter()
    aim, instants = _begin(scene, mesh, aim)
    while True:
        posed, history, bound = _simulated(scene, mesh, instants, aim, start)
        finer = in_time(posed, history.trajectory)
        budget = _judged(posed, history, bound, aim, finer)
        history, lost, parts, indicators = _missed(history, budget, finer, of)
        now = Pass(
            cells=mesh.n_cells,
            unknowns=posed.system.n,
            steps=len(instants) - 1,
            seconds=time.perf_counter() - start,
            extremes=_extremes(history),
            **parts,
        )
        passes.append(now)
        _tell(passes, budget, progress)
        marked, split = _next(now, indicators, (instants, lost), target, theta)
        done = now.total <= target or not (marked.any() or len(split) > len(instants))
        done = done or (of != "energy" and stalled(passes))
        # A cell that is split becomes four; in space it is cut in two, and so are some three beside it.
        if done or now.unknowns * (1 + 3 * marked.mean()) > most_unknowns:
            return _adapted(posed, history, (budget, bound), aim, passes)
        start = time.perf_counter()
        mesh, instants = mesh.refine(marked) if marked.any() else mesh, split


@dataclass(frozen=True)
class _Aim:
    """The target of an adaptive run, and how its passes are simulated and judged."""

    target: float
    of: str
    bounded: bool
    initial: str | Projected | None
    wanted: Floats
    """instants that are asked for"""
    solver: Solver | None
    turns: Floats = field(default_factory=lambda: np.zeros(0))
    """instants between these at which data bend, turn or jump"""

    @property
    def stored(self) -> Floats:
        """The instants that the history stores."""
        return np.union1d(self.wanted, self.turns)

    def steps(self, instants: Floats) -> Ints:
        """Steps at which the mesh is judged: those asked for, the last, and where data turn between; or some of them.

        A load that comes and goes between two instants is largest where it turns.
        """
        # The mesh is judged at eight instants of either kind at most: each costs one back-substitution a pass.
        judged = np.union1d(_some(self.wanted[1:], 8), _some(self.turns, 8))
        return np.searchsorted(instants, judged)


def _some(instants: Floats, most: int) -> Floats:
    """At most so many of the instants, evenly between the first and the last."""
    few = len(instants) <= most
    return instants if few else instants[np.linspace(0, len(instants) - 1, most).round().astype(int)]


def _begun(initial: ArrayLike | str | Projected | None) -> str | Projected | None:
    if initial is None or isinstance(initial, (str, Projected)):
        return initial
    raise SceneError(
        "adapt: found an initial displacement, which belongs to one mesh; begin from None, 'equilibrium', 'settled' or "
        "vx.projected(u_0)."
    )


def _wanted(times: ArrayLike) -> Floats:
    wanted = check_times(times)
    if len(wanted) < 2:
        raise SceneError("adapt: found one instant; give the first and the last at least, such as [0, 1].")
    return wanted


def _simulated(
    scene: Scene, mesh: Mesh, instants: Floats, aim: _Aim, start: float
) -> tuple[PosedScene, History, ErrorBound | None]:
    """The run of a pass that began at `start`, and the bound of the steps at which the mesh is judged, if wanted."""
    posed = pose_scene(scene, mesh, instants.tolist())
    circle, steps = hypercircle(posed) if aim.bounded else None, aim.steps(instants)
    kept = np.union1d(np.searchsorted(instants, aim.stored), steps - 1 if aim.bounded else steps).tolist()
    begun = free_unknowns(aim.initial, posed, instants)
    trajectory = march(posed.system, instants, solver=aim.solver, initial=begun, store=kept)
    assembled = time.perf_counter() - start - sum(trajectory.seconds.values())
    history = History.of(record(posed, trajectory, assembled, Memory()), begins(aim.initial))
    if circle is None:
        return posed, history, None
    return posed, history, of_steps(circle, history, pairs_of(circle, history, steps.tolist()))


def _missed(
    history: History, budget: ErrorBudget, finer: Finer, of: str
) -> tuple[History, Lost, dict[str, float], Floats]:
    """The history with the quantity aimed at, what steps lose of it, the parts of its error, and squared indicators."""
    parts = {name: budget.largest[name] for name in ("algebra", "space", "time")}
    indicators = budget.cells**2
    if of == "energy":
        return history, Lost.of_energy(finer, budget.scale or finer.norm), parts, indicators
    history, found = with_quantities(history)
    aim = (history.quantities or {})[of]
    lost = Lost.of_quantity(found, of, aim.value)
    parts |= {"space": aim.mesh / (abs(aim.value) or 1.0), "time": lost.error}
    return history, lost, parts, indicators * (parts["space"] ** 2 / (indicators.sum() or 1.0))


def _adapted(
    posed: PosedScene,
    history: History,
    judged: tuple[ErrorBudget, ErrorBound | None],
    aim: _Aim,
    passes: Sequence[Pass],
) -> Adapted:
    """The result of the last pass; its budget is of the energy norm, whatever the target is of."""
    budget, bound = judged
    asked, known = {"target": aim.target} if aim.of == "energy" else {}, {} if bound is None else bound.kept()
    history = replace(history, errors={**budget.largest, **asked}, growth=_growth(passes), **known)
    warn_of_lost_work(history.trajectory)
    warn_of_large_strains(posed, history)
    passes = tuple(passes)
    return Adapted(history=history, budget=budget, passes=passes, target=aim.target, of=aim.of, bound=bound)


def _tell(passes: Sequence[Pass], budget: ErrorBudget, progress: Callable[[Pass], None] | None) -> None:
    """Log the last pass, and hand it to whoever asked for progress."""
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
            # Of a contact node, the smallest cell nearby, whose centroid is not a cell's width away.
            near = np.linalg.norm(mesh.centroids - one.place, axis=1)
            found[one.key] = float(mesh.measures[np.argmin(near)] ** (1.0 / mesh.points.shape[1])), one.value
    return found


def _growth(passes: Sequence[Pass]) -> dict[str, str]:
    """The extremes that grew on the last meshes, and by how much."""
    keys = set.intersection(*(set(one.extremes) for one in passes))
    told = {key: growth(*zip(*(one.extremes[key] for one in passes), strict=True)) for key in SINGULAR if key in keys}
    return {key: words for key, words in told.items() if words}


def _judged(posed: PosedScene, history: History, bound: ErrorBound | None, aim: _Aim, finer: Finer) -> ErrorBudget:
    """The budget at some steps, of a bound if there is one."""
    rows = [history.row(int(n)) for n in aim.steps(history.trajectory.times)]
    budget = budget_of(posed, history, rows, finer)
    if bound is None:
        return budget
    unit = budget.scale or float(bound.upper.max()) or 1.0
    return replace(budget, space=bound.upper / unit, cells=np.sqrt(bound.cells) / unit)


def _next(now: Pass, squares: Floats, steps: tuple[Floats, Lost], target: float, theta: float) -> tuple[Bools, Floats]:
    """Cells to refine, and the instants of the next pass; these wait until the mesh is nearly good enough."""
    # The tolerance of the mesh is what algebra and steps leave of the target.
    for_space = max(target - now.algebra - min(now.time, TIME_SHARE * target), 0.5 * target)
    marked = cells_to_refine(squares, for_space**2, theta)
    # Steps are split once the error of the mesh is this near to what it may be.
    if now.space > 1.5 * for_space or now.time <= TIME_SHARE * target:
        return marked, steps[0]
    return marked, split_steps(*steps, TIME_SHARE * target)


def _check(target: object, of: object, theta: object, most: object, progress: object) -> None:
    part(target, "adapt", "target", "a relative error,", "0.02")
    if not (isinstance(of, str) and of in OF):
        raise SceneError(f"adapt: found of = {brief(of)}; a target is of {', '.join(map(repr, OF))}.")
    part(theta, "adapt", "theta", "a part,", "0.6")
    if not (is_real(most) and 1 <= most <= float(np.finfo(float).max)):
        raise SceneError(f"adapt: found most_unknowns = {brief(most)}; it is a number of unknowns, such as 400_000.")
    if not (progress is None or callable(progress)):
        raise SceneError(f"adapt: found progress = {brief(progress)}; it is a function that is told of each Pass.")
    check_takes(progress, 1, "adapt: progress", "each Pass")


def _begin(scene: Scene, mesh: Mesh, aim: _Aim) -> tuple[_Aim, Floats]:
    """Instants with which the coarse mesh loses little to time.

    Those where data bend, turn or jump are among them, and the aim that is returned knows them: errors are those at the
    instants of a run, where a load that comes and goes inside a step is zero, and no estimate sees it. Nothing is left
    out here: what is zero at the instants asked for need not be so between them.
    """
    posed = pose_scene(scene, mesh, between=aim.wanted.tolist())
    check_estimable(posed, "adapt")
    if posed.curves:
        warnings.warn(
            f"adapt: {' and '.join(posed.curves)} acts along a curve, which the coarse mesh draws as a polygon. "
            "Refined meshes keep this polygon: answers converge to those of a body with its corners, over which "
            "nothing slides, and errors are estimated against these. If something slides there, simulate on finer "
            "meshes of the curve itself.",
            SceneWarning,
            stacklevel=3,
        )
    run, begun = prepare(posed.system, None, False, True), free_unknowns(aim.initial, posed, aim.wanted)
    state = certify_in_full(run, initial_state(run, aim.wanted, begun))
    known = sample_course(posed.system, aim.wanted)
    aim = replace(aim, turns=inside_steps(aim.wanted, known.bends))
    times = aim.stored
    while True:
        if aim.of == "energy":
            finer = beside_finer(run, times, state.unknowns, known)
            lost = Lost.of_energy(finer, finer.norm)
        else:
            last = march(posed.system, times, initial=begun, store="last", check=False)
            history = History.of(record(posed, last, 0.0, Memory()))
            lost = Lost.of_quantity(errors_of_steps(history), aim.of, value_of(history, aim.of))
        split = split_steps(times, lost, TIME_SHARE * aim.target)
        if len(split) == len(times) or len(split) > MOST_STEPS:
            return aim, times
        times = split


def _lenient(given: Solver | Solves | None, target: float) -> Solver | None:
    """Algebra well below the error of the mesh is enough."""
    if given is None:
        return None
    solver = as_solver(given)
    solver.check_accuracy()
    return solver if solver.accuracy >= UNSEEN * target else solver.with_accuracy(UNSEEN * target)
