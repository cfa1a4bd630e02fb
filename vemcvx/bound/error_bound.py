"""Guaranteed bounds on the error of mesh and steps.

A step: :mod:`.hypercircle`; a whole history: :mod:`.whole_history`; a quantity: :mod:`.quantity`.
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
from vemcvx.bound.hypercircle import Hypercircle, Pair, hypercircle
from vemcvx.bound.quantity import Dual, Fields, QuantityBound, quantity_bound
from vemcvx.bound.skeleton import instant
from vemcvx.bound.whole_history import check_history, sizes_along
from vemcvx.effects import Effect, PrescribedDisplacement
from vemcvx.history import History, scene_of
from vemcvx.results import loop_of
from vemcvx.scene import PosedScene, pose_scene

log = logging.getLogger("vemcvx")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBound(Outlined):
    """Bounds on the distance |u - v|_a of the exact displacement u from the computed one, v.

    v is a conforming function: it has the nodal values of the history, is linear on the edges of cells, and inside
    them it has the least energy among functions of degree two on a fine split. For a step, u is the exact answer of
    that step on the continuum, given the displacement before it; for a history, the exact history, which begins at the
    run's v at times[0], or where the run begins at rest under its loads (initial="equilibrium" or "settled"), as the
    exact one does then.

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
        Of upper: "mesh", what stress and strain differ by; "contact", what friction and contact do; "data", the
        estimate of what data are beside what is linear on edges and in cells, and in time between the instants of the
        run, zero if they are; "algebra", the certified error of the solver, which is in the others; of whole histories
        also "steps", y.
    bends : (k,)
        Of whole histories instants inside steps at which data are found not to be linear between those of the run:
        more steps, or :func:`vemcvx.instants`, bring it nearer.
    kind : str
        "bound": a theorem, for data that are linear on edges and in cells as far as points tell
        (:mod:`vemcvx.bound.reading`). "bound for data as read at points" where some are not: `upper`, `lower`, `energy`
        and `potential` then have the estimate "data" in them. "bound for the given friction", or "... the given
        friction and data as read at points", where the bound of friction follows the pressure of the answer. "... data
        as read at instants" for a history whose data are not linear in time within its steps.
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
        """The "upper" and "lower" of the "step" for which upper is largest; "relative", "kind", "reading" ("data")."""
        k = int(np.argmax(self.upper))
        each = {"upper": self.upper, "lower": self.lower, "step": self.steps, "relative": self.relative}
        each["reading"] = self.parts["data"]
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
            *(("inside a step", f"data are not linear at t = {t:.6g}") for t in self.bends[:5]),
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
        instants of the run. What others do besides is in it by an estimate, and a warning names instants.
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
        A step was not stored, the scene has something for which there is no bound, or a whole history begins at
        ``vx.projected(u_0)``.

    Notes
    -----
    The mathematics, and how data are read at points, are in :mod:`vemcvx.bound`.
    """
    scene = scene_of(history, "error_bound")
    if step is None and of is not None:
        raise SceneError("error_bound: a quantity is bounded in one step; give its number, such as step=-1, with of=.")
    posed = pose_scene(scene, history.mesh, history.trajectory.times.tolist())
    if step is None:
        return _of_history(posed, history)
    circle = hypercircle(posed)
    stepped = pairs_of(circle, history, [step])
    if of is None:
        return of_steps(circle, history, stepped).at(0)
    return quantity_bound(history, stepped[0].n, stepped[0].pair, of)


class Stepped(NamedTuple):
    """A step and its pair."""

    n: int
    pair: Pair


def pairs_of(circle: Hypercircle, history: History, steps: Sequence[int]) -> list[Stepped]:
    """The pairs of stored steps, each given the one before."""
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
        found.append(Stepped(n, circle.pair(now, before)))
    return found


def of_steps(circle: Hypercircle, history: History, stepped: Sequence[Stepped]) -> ErrorBound:
    """The bounds of steps whose pairs these are."""
    at, pairs = np.array([one.n for one in stepped]), [one.pair for one in stepped]
    eta, misread = np.transpose([pair.allowances() for pair in pairs])
    names = "upper", "norm", "potential", "lowered", "A2", "lacking"
    upper, norm, potential, lowered, A2, gap = (np.array([getattr(pair, name) for pair in pairs]) for name in names)
    upper = upper + eta
    worst, outer = pairs[int(np.argmax(upper))], circle.boundary.edges.outer
    shares = worst.cells + totals(outer, 2.0 * worst.surface.gap + worst.springs, len(worst.cells))
    return ErrorBound(
        steps=at,
        upper=upper,
        lower=np.maximum(lowered - eta, 0.0),
        energy=_energies(norm, upper),
        potential=(potential - 0.5 * (A2 + eta**2) - gap - misread, potential - 0.5 * lowered**2 + misread),
        cells=upper.max() ** 2 * shares / (shares.sum() or 1.0),
        parts={
            "mesh": np.sqrt([pair.cells.sum() for pair in pairs]),
            "contact": np.sqrt(2.0 * gap),
            "data": eta,
            "algebra": np.sqrt(2.0 * history.trajectory.gap[at]),
        },
        kind=_kind({"the given friction": circle.boundary.follows_pressure, "data as read at points": eta.any()}),
        history=history,
    )


def _kind(supposed: Mapping[str, bool | np.bool]) -> str:
    """The kind of a bound that supposes some of these."""
    given = " and ".join(name for name, so in supposed.items() if so)
    return f"bound for {given}" if given else "bound"


def _energies(norm: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Bounds on the energy of what is no farther than so much from a displacement of this norm."""
    return 0.5 * np.maximum(norm - upper, 0.0) ** 2, 0.5 * (norm + upper) ** 2


def _of_history(posed: PosedScene, history: History) -> ErrorBound:
    check_history(posed, history)
    found, cells, bends = sizes_along(hypercircle(posed), history)
    y, D, norm, r, richer, points, instants = found.T
    eta, nothing = points + instants, np.full(len(y), np.inf)
    upper = np.sqrt(np.square(y) + 2.0 * richer * y + r**2) + eta
    return ErrorBound(
        steps=history.stored.copy(),
        upper=upper,
        lower=np.zeros(len(y)),
        energy=_energies(norm, upper),
        potential=(-nothing, nothing),
        cells=upper.max() ** 2 * cells / (cells.sum() or 1.0),
        parts={
            "mesh": r,
            "contact": np.sqrt(2.0 * D),
            "data": eta,
            "algebra": np.sqrt(2.0 * history.trajectory.gap),
            "steps": y,
        },
        kind=_kind({"data as read at points": points.any(), "data as read at instants": instants.any()}),
        history=history,
        bends=bends,
    )


# Runs that are asked for it.


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
    if (loop := loop_of(history)) is None or loop.kind == "load":
        return {}
    moved = PrescribedDisplacement(tuple(np.eye(2)[loop.axis]), on=loop.on)
    try:
        dual = Dual.of(circle, moved)
        found = np.array([(np.nan, np.nan), *(dual.interval(Fields(one.pair)) for one in stepped)])
    except SceneError as error:
        log.info("no bounds of the force of %s: %s", loop.on, error)
        return {}
    return {"force_bounds": found, "bounded_force": {loop.on: loop.axis}} if np.isfinite(found).any() else {}
