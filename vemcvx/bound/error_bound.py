"""Guaranteed bounds on the error of mesh and steps.

A step: :mod:`.hypercircle`. A whole history, if nothing but friction with a given bound acts: let v and tau be
admissible at all instants, r = tau - sigma_0 - C eps(v) and X = tau - sigma, so that X = r + C eps(v - u). From Green's
formula, and from what q of tau_t = -q and its bound g let u and v dissipate,

    d/dt |X|^2 / 2  =  <r', X> + (X, eps(v' - u'))  <=  |r'| |X| + D',      D' = int g |s'| - q s',

s' being the rate of slip of v, both norms in C^-1. Between two instants everything is taken for linear in time, and
with Brezis' lemma (y^2 / 2 <= a^2 / 2 + int m y implies y <= a + int m)

    |X| <= y_n = (y_{n-1}^2 + 2 D_n)^{1/2} + |r_n - r_{n-1}|.

The path of v and tau between the instants of a run is free, and none is far from the exact one that is linear over long
steps: friction that grows to its bound while something slips already lacks half of g |s| of Tresca's law. So the path
is that of the same run in finer steps, PATH in all at least, and at the instants at which data bend, turn or jump; and
on cells within its own (:mod:`.within`). At the instants of the run, with its own displacement v_n in place of v, r_n =
tau - sigma_0 - C eps(v_n) and C eps(u - v_n) = r_n - X,

    |u - v_n|_a^2  <=  y_n^2 + 2 y_n |r_n| + |r_n|^2  =  (y_n + |r_n|)^2.

(By the paths of runs themselves bounds on cycles of five to eight steps were twice to three times as large; by their
cells twice as large on cycles of 20.)

y never forgets, and no better can be had without knowing where the exact history slips: two exact histories come no
farther apart, but two that differ by a slip which friction bears stay so, as long as nothing slips there. So y grows by
as much in each cycle, the error does not, and what has to be had is a path by which y grows so little that many cycles
do not matter. Three things make it grow. The first is r, which comes and goes with the load: mostly in few cells, as at
corners where something is held. The second is friction that lacks of its law within steps. The third is loads that bend
within a step of the path, if v does not follow them: a sine in 20 steps misses its chords by 1.2 %, and v answers to
that, although r is small, by 1.2 % of itself, there and back, in every step: of three cycles on 8 x 8 squares y was .19
with it and .04 without, on the same cells.

For v and v_n one may take v + w of :mod:`.hypercircle`, richer inside of the body and on contact the same: r is smaller
by half, and only in the last square it is that of v_n, because X is orthogonal to C eps(w). y_0 is |r_0| of v: the
exact history is one that begins like the run. What linear moments miss of loads is a stress of its own in tau, no
larger than osc_T, and so are its changes in time.

So the theorem is about data that are linear in time between the instants of the path. What is missed of others is added
as an estimate, and `kind` says so (:mod:`.data_in_time`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, overload

import numpy as np

from vemcvx.base.arrays import Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.data_in_time import OFF_LINE, Followed, followed, readings
from vemcvx.bound.hypercircle import Hypercircle, Pair, hypercircle
from vemcvx.bound.quantity import Dual, Fields, QuantityBound, quantity_bound
from vemcvx.bound.skeleton import Instant, instant
from vemcvx.bound.within import Inner, Within, within_cells
from vemcvx.effects import Effect, PrescribedDisplacement
from vemcvx.history import History, scene_of
from vemcvx.results.results import loop_of
from vemcvx.scene import Scene
from vemcvx.scene.pose import PosedScene, pose_scene, unwarned
from vemcvx.stepping.course import course, divided, inside_steps

log = logging.getLogger("vemcvx")
PATH = 32
"""Steps of the path, at least: with twice as many bounds of cycles were lower by 3 %."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBound(Outlined):
    """Bounds on the distance |u - v|_a of the exact displacement u from the computed one, v.

    v is a conforming function: it has the nodal values of the history, is linear on the edges of cells, and inside
    them it has the least energy among functions of degree two on a fine split. For a step, u is the exact answer of
    that step on the continuum, given the displacement before it; for a history, the exact history.

    Attributes
    ----------
    steps : (S,) int
        The steps looked at.
    upper, lower : (S,)
        Bounds on |u - v|_a from above and below; a number each where one step was asked for. For whole histories lower
        is zero: nothing is known from below.
    energy : ((S,), (S,))
        Bounds on the elastic energy of u, 1/2 a(u, u).
    potential : ((S,), (S,))
        Bounds on what the step minimises, energy less the work of loads, plus the cost of friction; of whole histories
        infinite.
    cells : (n_cells,)
        Parts of the square of the (largest) upper.
    parts : mapping of str to (S,)
        Of upper: "mesh", what stress and strain differ by; "contact", what friction and contact do; "data", what is
        missed of loads that are not polynomials; "reading", the allowance for what points may misread of these, and
        instants of data that are not linear in time between them, an estimate, zero if two readings agree; "algebra",
        the certified error of the solver, which is in the others; of whole histories also "steps", y.
    bends : (k,)
        Of whole histories the instants inside steps at which data bend, turn or jump, which the run does not know: more
        steps, or these instants (:func:`vemcvx.instants`), bring it nearer.
    kind : str
        "bound", a theorem for data that are known at the points where bounds read them (:mod:`vemcvx.bound`): loads
        that are polynomials of degree three on the triangles of cells are. "bound for loads as read at points" where
        a finer reading of loads differs: `upper`, `lower`, `energy` and `potential` then have the part "reading" in
        them. "bound for the given friction", or "... the given friction and loads as read at points", where the bound
        of friction follows the pressure of the answer. "... data as read at instants" for a history if its data were
        found not to be linear between those of its path: `upper` less "reading" is then a theorem for data that are
        linear there, and "reading" an estimate of the effect of the rest.
    history : History
        The run.
    """

    steps: Ints
    upper: Floats
    lower: Floats
    energy: tuple[Floats, Floats]
    potential: tuple[Floats, Floats]
    cells: Floats
    parts: dict[str, Floats]
    kind: str
    history: History
    bends: Floats = field(default_factory=lambda: np.zeros(0))

    def at(self, k: int) -> ErrorBound:
        """The bound of the k-th of the steps alone."""
        one = {name: getattr(self, name)[k] for name in ("steps", "upper", "lower")}
        (low, high), (least, most) = self.energy, self.potential
        parts = {name: part[k] for name, part in self.parts.items()}
        return replace(self, **one, energy=(low[k], high[k]), potential=(least[k], most[k]), parts=parts)

    @property
    def relative(self) -> Floats:
        """`upper` in parts of the largest energy norm of the run."""
        return self.upper / (float(self.history.trajectory.norm.max()) or 1.0)

    def kept(self) -> dict[str, Any]:
        """The fields of a history that say it: `bound`, `energy_bounds` and `cell_bounds`."""
        energies = np.full((self.history.steps + 1, 2), np.nan)
        energies[0] = self.history.trajectory.energy[0]
        energies[self.steps] = np.column_stack([np.atleast_1d(side) for side in self.energy])
        return {"bound": self.largest, "energy_bounds": energies, "cell_bounds": self.cells}

    @property
    def largest(self) -> dict[str, Any]:
        """The "upper" and "lower" of the "step" for which upper is largest, it as "relative", "reading" and "kind"."""
        k = int(np.argmax(self.upper))
        each = {"upper": self.upper, "lower": self.lower, "step": self.steps, "relative": self.relative}
        each["reading"] = self.parts["reading"]
        return {**{name: float(np.atleast_1d(values)[k]) for name, values in each.items()}, "kind": self.kind}

    def outline(self) -> Outline:
        """The outline for prompts and notebooks: the step where the bound is largest."""
        steps, upper, lower = (np.atleast_1d(one) for one in (self.steps, self.upper, self.lower))
        k = int(np.argmax(upper))
        parts = [(name, f"{np.atleast_1d(value)[k]:.3g}") for name, value in self.parts.items()]
        low, high = (np.atleast_1d(one)[k] for one in self.energy)
        lines = [
            ("error", f"{lower[k]:.4g} ... {upper[k]:.4g} in the energy norm"),
            ("energy", f"{low:.6g} ... {high:.6g}"),
            *parts,
            *(("inside a step", f"data bend, turn or jump at t = {t:.6g}") for t in self.bends[:5]),
        ]
        return Outline(f"ErrorBound: {self.kind} at step {steps[k]} ({len(steps)} looked at)", lines)


@overload
def error_bound(history: History, step: int | None = None, of: None = None) -> ErrorBound: ...


@overload
def error_bound(history: History, step: int, of: Effect | Sequence[Effect]) -> QuantityBound: ...


def error_bound(
    history: History, step: int | None = None, of: Effect | Sequence[Effect] | None = None
) -> ErrorBound | QuantityBound:
    """Guaranteed bounds on the error in the energy norm: of the mesh in one step, or of mesh and steps in a history.

    Or, of one step, on a linear quantity of the exact displacement.

    Parameters
    ----------
    history : History
    step : int, optional
        A stored step after which the one before it was stored, too; -1 is the last one. By default the whole history,
        every step of which must be stored, and in which nothing but friction with a given bound acts
        (BilateralContact and TrescaFriction). Its bound is a theorem for data that are linear in time between the
        instants of a path: those of the run, 32 steps at least, bends, turns and jumps, and where data are found to be
        off lines. What others do besides is in it by an estimate, and where that may be much a warning names instants.
    of : Effect or sequence of Effect, optional
        A linear quantity, given as the load that does its work: ``Traction((1.0 / length, 0.0), on="top")`` is the mean
        displacement along x of a side, ``BodyForce((1.0 / area, 0.0))`` that of the body, ``Prestress((-1.0 / area,
        0.0, 0.0))`` its mean strain, and a PrescribedDisplacement on a support the work that the support's force on the
        body does on it: ``(1.0, 0.0)`` is the force along x. Several add up. This needs a step.

    Returns
    -------
    ErrorBound, or with `of` QuantityBound
        Their docstrings say of which displacement, of which error, and where an interval is a theorem.

    Raises
    ------
    HistoryError
        The history was read from files, so that its scene is not known.
    SceneError
        A step was not stored, or the scene has something for which there is no bound.

    Notes
    -----
    The mathematics, and how data are read at points, are in :mod:`vemcvx.bound`.
    """
    scene = scene_of(history, "error_bound")
    if step is None and of is None:
        return _of_history(scene, history)
    if step is None:
        raise SceneError("error_bound: a quantity is bounded in one step; give its number, such as step=-1, with of=.")
    circle = hypercircle(pose_scene(scene, history.mesh, history.trajectory.times.tolist()))
    stepped = pairs_of(circle, history, [step])
    if of is None:
        return of_steps(circle, history, stepped).at(0)
    return quantity_bound(history, stepped[0].n, stepped[0].pair, of)


# Steps.


class Stepped(NamedTuple):
    """The pair of a step, and how far its displacement is from that of the run."""

    n: int
    pair: Pair
    moved: float


def pairs_of(circle: Hypercircle, history: History, steps: Sequence[int]) -> list[Stepped]:
    """The pairs of stored steps, each given the one before, whose displacements obstacles admit."""
    found = []
    for step in steps:
        n = int(history.stored[history.row(step)])
        if n == 0:
            raise SceneError("error_bound: step 0 is where the run begins; the first step that has a bound is 1.")
        if n - 1 not in history.stored:
            raise SceneError(
                f"error_bound: step {n} is bounded given the one before, and step {n - 1} was not stored; simulate "
                "with store='all'."
            )
        now, before = (instant(history, history.row(k)) for k in (n, n - 1))
        u = circle.boundary.admitted(now.u, now.t)
        found.append(Stepped(n, circle.pair(replace(now, u=u), before), circle.distance(now.u, u)))
    return found


def of_steps(circle: Hypercircle, history: History, stepped: Sequence[Stepped]) -> ErrorBound:
    """The bounds of steps whose pairs these are."""
    numbers, pairs, apart = zip(*stepped, strict=True)
    at, moved, (eta, misread) = np.array(numbers), np.array(apart), np.transpose([pair.allowances() for pair in pairs])
    names = "upper", "norm", "potential", "lowered", "A2", "lacking"
    upper, norm, potential, lowered, A2, gap = (np.array([getattr(pair, name) for pair in pairs]) for name in names)
    upper = upper + moved + eta
    worst, outer = pairs[int(np.argmax(upper))], circle.boundary.edges.outer
    shares = worst.cells + totals(outer, 2.0 * worst.surface.gap + worst.springs, len(worst.cells))
    laws = any(friction.law is not None for friction in circle.boundary.frictions)
    return ErrorBound(
        steps=at,
        upper=upper,
        lower=np.maximum(lowered - moved - eta, 0.0),
        energy=_energies(norm, upper - moved),
        potential=(potential - 0.5 * (A2 + eta**2) - gap - misread, potential - 0.5 * lowered**2 + misread),
        cells=upper.max() ** 2 * shares / (shares.sum() or 1.0),
        parts={
            "mesh": np.sqrt([pair.squares.sum() for pair in pairs]),
            "contact": np.sqrt(2.0 * gap),
            "data": np.sqrt([np.sum(pair.oscillation**2) for pair in pairs]),
            "reading": eta,
            "algebra": np.sqrt(2.0 * history.trajectory.gap[at]),
        },
        kind=_kind({"the given friction": laws, "loads as read at points": eta.any()}),
        history=history,
    )


def _kind(supposed: Mapping[str, bool | np.bool]) -> str:
    """The kind of a bound that supposes some of these."""
    given = " and ".join(name for name, so in supposed.items() if so)
    return f"bound for {given}" if given else "bound"


def certain_intervals(circle: Hypercircle, stepped: Sequence[Stepped], of: Effect) -> Floats:
    """(k, 2) intervals of a quantity in steps, each given the one before, by a theorem.

    Raises
    ------
    SceneError
        There is none for this quantity.
    """
    dual = Dual.of(circle, of)
    return np.array([dual.certain(Fields(one.pair)) for one in stepped])


def bounds_of_runs(posed: PosedScene) -> Callable[[History], History]:
    """Return the function that adds the bounds of all steps to a history; SceneError where there are none."""
    circle = hypercircle(posed)

    def bounded(history: History) -> History:
        stepped = pairs_of(circle, history, range(1, history.steps + 1))
        bounds = of_steps(circle, history, stepped).kept()
        return replace(history, **bounds, **_bounds_of_force(circle, history, stepped))

    return bounded


def _bounds_of_force(circle: Hypercircle, history: History, stepped: Sequence[Stepped]) -> dict[str, Any]:
    """The fields of a history that bound the force by which a boundary is moved; none where nothing moves."""
    if (loop := loop_of(history)) is None:
        return {}
    moved = PrescribedDisplacement(tuple(np.eye(2)[loop.axis]), on=loop.on)
    try:
        found = np.vstack([[np.nan, np.nan], certain_intervals(circle, stepped, moved)])
    except SceneError as error:
        log.info("no bounds of the force of %s: %s", loop.on, error)
        return {}
    return {"force_bounds": found, "bounded_force": {loop.on: loop.axis}} if np.isfinite(found).any() else {}


def _energies(norm: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Bounds on the energy of what is no farther than so much from a displacement of this norm."""
    return 0.5 * np.maximum(norm - upper, 0.0) ** 2, 0.5 * (norm + upper) ** 2


# Histories.


def _check_history(posed: PosedScene, history: History) -> None:
    """Raise SceneError where there is no bound over a whole history, or not all of it is stored."""
    count = history.steps + 1
    laws = [friction.subject for friction in posed.terms.frictions if friction.law is not None]
    if posed.springs is not None:
        laws = [*laws, "ElasticFoundation"]
    if len(posed.obstacles) or laws:
        raise SceneError(
            f"error_bound: {', '.join((*posed.obstacles.subjects, *laws))}: a bound over a whole history is known only "
            "where nothing but friction with a given bound acts, on contact that holds (BilateralContact); "
            "error_bound(history, step=-1) gives the bound of a step, given the one before."
        )
    if len(history.stored) < count:
        raise SceneError(
            f"error_bound: {len(history.stored)} of {count} instants were stored, and the bound over a whole history "
            "needs all of them (store='all'); error_bound(history, step=-1) gives the bound of a step."
        )


def _of_history(scene: Scene, history: History) -> ErrorBound:
    mesh, times = history.mesh, history.trajectory.times
    read, bends = Followed(times), np.zeros(0)
    with unwarned():
        posed = pose_scene(scene, mesh)
    _check_history(posed, history)
    if len(times) > 1:
        bends = inside_steps(times, course(posed.system, times).bends)
        read = followed(posed, divided(np.union1d(times, bends), 1, PATH))
    # A load that comes and goes within a step is left out by runs, and leaves friction behind.
    _warn_between(bends, read.missed)
    within, inner, path = within_cells(scene, history, read.path, readings(read.path).tolist())
    found, worst = _along(within, inner, path, history)
    y, D, norm, A, richer, mesh_part, data, at_points = np.array(found).T
    eta = at_points + read.allowance(posed, history)
    upper = np.sqrt(np.square(y) + 2.0 * richer * y + A**2) + eta
    nothing = np.full(len(times), np.inf)
    return ErrorBound(
        steps=history.stored.copy(),
        upper=upper,
        lower=np.zeros(len(times)),
        energy=_energies(norm, upper),
        potential=(-nothing, nothing),
        cells=upper.max() ** 2 * worst / (worst.sum() or 1.0),
        parts={
            "mesh": mesh_part,
            "contact": np.sqrt(2.0 * D),
            "data": data,
            "reading": eta,
            "algebra": np.sqrt(2.0 * history.trajectory.gap),
            "steps": y,
        },
        kind=_kind({"loads as read at points": at_points.any(), "data as read at instants": len(read.between) > 0}),
        history=history,
        bends=bends,
    )


def _along(
    within: Within, inner: Sequence[Inner], path: Sequence[Instant], history: History
) -> tuple[list[tuple[float, ...]], Floats]:
    """The terms of the bounds at the instants of a run, along a path on cells within its own.

    Besides, the squares (n_cells,) of its cells at the instant that has the largest y.
    """
    circle, times, last = within.circle, history.trajectory.times, path[0]
    pair = circle.pair(last, last)
    start = within.sizes(last, history.displacement[0], inner[0])
    reached, dissipated, misread = start.defect, 0.0, pair.reading.energy
    found: list[tuple[float, ...]] = [(reached, dissipated, *start[:-1], 2.0 * misread)]
    worst = 0.0, start.cells
    for ahead in path[1:]:
        beyond = circle.pair(ahead, last)
        lost = circle.boundary.lacking(pair.surface, beyond.surface)
        change = float(np.sqrt(circle.squares_of_change(pair, beyond).sum()))
        reached, dissipated = float(np.sqrt(reached**2 + 2.0 * lost)) + change, dissipated + lost
        misread += (beyond.reading - pair.reading).energy
        pair, last = beyond, ahead
        n = int(np.searchsorted(times, last.t))
        if times[n] == last.t:
            own = within.sizes(last, history.displacement[n], inner[n])
            found.append((reached, dissipated, *own[:-1], misread + pair.reading.energy))
            worst = max(worst, (reached, own.cells), key=lambda one: one[0])
    return found, worst[1]


def _warn_between(bends: Floats, missed: Floats) -> None:
    """Log warnings of what data do inside steps of the run, and between readings of the bound."""
    if len(bends):
        log.warning(
            f"error_bound: data bend, turn or jump inside steps, at t = {', '.join(f'{t:.6g}' for t in bends[:5])}"
            f"{' ...' if len(bends) > 5 else ''}; the run misses it. The bound reads data there, too, and takes "
            "them for linear between its readings. Simulate at vemcvx.instants(scene, mesh, times), which has these "
            "instants."
        )
    if len(missed):
        log.warning(
            f"error_bound: data are not linear between the instants at which the bound reads them, at t = "
            f"{', '.join(f'{t:.6g}' for t in missed[:5])}{' ...' if len(missed) > 5 else ''} by more than "
            f"{OFF_LINE:.0%} of their size. It reads them there, too, and estimates what it misses between. Simulate "
            "in steps that follow the data."
        )
