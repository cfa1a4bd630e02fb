"""Guaranteed error bounds of a step, of a history, or of a linear quantity."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np

from vemcvx.base.arrays import Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.hypercircle import Hypercircle, Pair, hypercircle
from vemcvx.bound.quantity import Dual, QuantityBound, quantity_bound
from vemcvx.bound.skeleton import instant
from vemcvx.bound.whole_history import check_history, collect_terms
from vemcvx.effects import Effect, PrescribedDisplacement
from vemcvx.history import History, scene_of
from vemcvx.results import loop_of
from vemcvx.scene import PosedScene, pose_scene

log = logging.getLogger("vemcvx")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBound(Outlined):
    """Bounds on the error |u - v|_a in the energy norm, for the exact displacement u and the computed v.

    v has the nodal values of the history, and is linear on the edges of cells (:mod:`vemcvx.bound.displacement`). For a
    step, u is the exact solution of the step, given the computed displacement before the step. For a history, u is the
    exact history. With initial="equilibrium" or "settled" it begins in exact equilibrium, else at v(0).

    Attributes
    ----------
    steps : (S,) int
        The examined steps.
    upper, lower : (S,)
        Bounds on |u - v|_a. For a single step, both are numbers. For whole histories, `lower` is zero.
    energy : ((S,), (S,))
        Lower and upper bounds on the elastic energy of u, 1/2 a(u, u).
    potential : ((S,), (S,))
        Bounds on the minimum of (energy) - (work of loads) + (friction work) in a step. The bounds are infinite for
        whole histories, and for data that are not linear on edges and in cells.
    cells : (n_cells,)
        The square of the largest upper bound, split among the cells.
    parts : mapping of str to (S,)
        Parts of `upper`. "mesh": the distance between the stress of v and a stress in equilibrium. "contact": the
        defect in the laws of friction and contact. "data": the estimated effect of data that are not linear on edges,
        in cells, or in time between instants. "algebra": the certified error of the solver, also included in other
        parts. "steps", for whole histories: the bound y_n on the stress error (:mod:`vemcvx.bound.whole_history`).
    bends : (k,)
        For whole histories: instants inside steps at which data are not linear in time (:func:`vemcvx.instants`).
    kind : str
        "bound": `upper` is proved. "bound for data as read at points": `upper` contains the estimate "data". "bound for
        the given friction": friction bounds follow from the computed pressure. "bound for data as read at instants":
        data are not linear within steps.
    history : History
        The run.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    >>> bound = vx.error_bound(history, step=-1)
    >>> bool(bound.lower < bound.upper), bound.kind
    (True, 'bound')
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
        """Return the bound of the k-th examined step alone."""
        one = {name: getattr(self, name)[k] for name in ("steps", "upper", "lower")}
        (low, high), (least, most) = self.energy, self.potential
        parts = {name: part[k] for name, part in self.parts.items()}
        return replace(self, **one, energy=(low[k], high[k]), potential=(least[k], most[k]), parts=parts)

    @property
    def relative(self) -> Floats:
        """The upper bound relative to the largest energy norm of the run."""
        return self.upper / (float(self.history.trajectory.norm.max()) or 1.0)

    def as_fields(self) -> dict[str, Any]:
        """Return the fields `bound`, `energy_bounds` and `cell_bounds` of a history."""
        energies = np.full((self.history.steps + 1, 2), np.nan)
        energies[0] = self.history.trajectory.energy[0]
        energies[self.steps] = np.column_stack([np.atleast_1d(side) for side in self.energy])
        return {"bound": self.largest, "energy_bounds": energies, "cell_bounds": self.cells}

    @property
    def largest(self) -> dict[str, Any]:
        """The largest bound, with keys "step", "upper", "lower", "relative", "kind" and "reading" (`parts["data"]`)."""
        k = int(np.argmax(self.upper))
        each = {"upper": self.upper, "lower": self.lower, "step": self.steps, "relative": self.relative}
        each["reading"] = self.parts["data"]
        return {name: float(np.atleast_1d(values)[k]) for name, values in each.items()} | {"kind": self.kind}

    def outline(self) -> Outline:
        """Return the outline of the step with the largest bound."""
        worst, k = self.largest, int(np.argmax(self.upper))
        low, high = (np.atleast_1d(one)[k] for one in self.energy)
        lines = [
            ("error", f"{worst['lower']:.4g} ... {worst['upper']:.4g} in the energy norm"),
            ("energy", f"{low:.6g} ... {high:.6g}"),
            *((name, f"{np.atleast_1d(value)[k]:.3g}") for name, value in self.parts.items()),
            *(("inside a step", f"data are not linear at t = {t:.6g}") for t in self.bends[:5]),
        ]
        head = f"ErrorBound: {self.kind} at step {worst['step']:.0f} ({np.size(self.steps)} examined)"
        return Outline(head, lines)


@overload
def error_bound(history: History, step: int | None = None, of: None = None) -> ErrorBound: ...


@overload
def error_bound(history: History, step: int, of: Effect | Sequence[Effect]) -> QuantityBound: ...


def error_bound(
    history: History, step: int | None = None, of: Effect | Sequence[Effect] | None = None
) -> ErrorBound | QuantityBound:
    """Return bounds on the energy error of a step or of a history, or on a linear quantity in a step.

    Parameters
    ----------
    history : History
    step : int, optional
        A stored step whose predecessor was also stored; -1 is the last step. `of` requires a step. Without a step,
        the bounds hold for the whole history. All steps must then be stored, and contact must be bilateral with a given
        friction bound (BilateralContact, TrescaFriction). A warning lists instants inside steps at which data are
        not linear in time.
    of : Effect or sequence of Effect, optional
        A linear quantity, given as the load whose work equals the quantity. ``Traction((1.0 / length, 0.0), on="top")``
        gives the mean of u_x on the top, ``BodyForce((1.0 / area, 0.0))`` the mean of u_x over the body, and
        ``Prestress((-1.0 / area, 0.0, 0.0))`` the mean strain e_xx. ``PrescribedDisplacement((1.0, 0.0), on="left")``
        gives the force along x of the support on the left. A sequence gives the sum.

    Returns
    -------
    ErrorBound, or with `of` QuantityBound

    Raises
    ------
    HistoryError
        The history was read from files, which do not contain its scene.
    SceneError
        A step was not stored, there is no bound for some effect, or a whole history begins at ``vx.projected(u_0)``.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    >>> extension = vx.error_bound(history, step=-1, of=vx.Traction((1.0, 0.0), "right"))
    >>> extension.low < extension.high
    True
    """
    scene = scene_of(history, "error_bound")
    if step is None and of is not None:
        raise SceneError("error_bound: a quantity (of=) has bounds in a single step only; give step=, such as step=-1.")
    posed = pose_scene(scene, history.mesh, history.trajectory.times.tolist())
    if step is None:
        return _bound_history(posed, history)
    n = int(history.stored[history.row(step)])
    pairs = pairs_of(hypercircle(posed), history, [n])
    return bound_steps(history, [n], pairs).at(0) if of is None else quantity_bound(history, n, pairs[0], of)


def pairs_of(circle: Hypercircle, history: History, steps: Sequence[int]) -> list[Pair]:
    """Return the pair (displacement, stress) of each step."""
    found = []
    for n in steps:
        if n == 0:
            raise SceneError("error_bound: step 0 is the start of the run; the first step with a bound is 1.")
        if n - 1 not in history.stored:
            raise SceneError(
                f"error_bound: the bound of step {n} needs the step before, and step {n - 1} was not stored; simulate "
                "with store='all'."
            )
        now, before = (instant(history, history.row(k)) for k in (n, n - 1))
        found.append(circle.pair(now, before))
    return found


def bound_steps(history: History, steps: Sequence[int], pairs: Sequence[Pair]) -> ErrorBound:
    """Return the bounds of steps, given the pairs (displacement, stress)."""
    at, circle = np.array(steps), pairs[0].circle
    eta = np.array([pair.read.eta for pair in pairs])
    names = "upper", "norm", "potential", "lower", "A2", "law_defect"
    upper, norm, potential, lower, A2, gap = (np.array([getattr(pair, name) for pair in pairs]) for name in names)
    upper = upper + eta
    worst, outer = pairs[int(np.argmax(upper))], circle.boundary.edges.outer
    shares = worst.cells + totals(outer, 2.0 * worst.surface.gap, len(worst.cells))
    unknown = np.where(eta > 0.0, np.inf, 0.0)
    return ErrorBound(
        steps=at,
        upper=upper,
        lower=np.maximum(lower - eta, 0.0),
        energy=_energies(norm, upper),
        potential=(potential - 0.5 * A2 - gap - unknown, potential - 0.5 * lower**2 + unknown),
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
    given = " and ".join(name for name, so in supposed.items() if so)
    return f"bound for {given}" if given else "bound"


def _energies(norm: Floats, upper: Floats) -> tuple[Floats, Floats]:
    return 0.5 * np.maximum(norm - upper, 0.0) ** 2, 0.5 * (norm + upper) ** 2


def _bound_history(posed: PosedScene, history: History) -> ErrorBound:
    check_history(posed, history)
    found, cells, bends = collect_terms(hypercircle(posed), history)
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


def bounds_of_runs(posed: PosedScene) -> Callable[[History], History]:
    """Return a function that adds bounds to a history, or raise SceneError."""
    circle = hypercircle(posed)

    def add_bounds(history: History) -> History:
        steps = range(1, history.steps + 1)
        pairs = pairs_of(circle, history, steps)
        return replace(history, **bound_steps(history, steps, pairs).as_fields(), **_bounds_of_force(history, pairs))

    return add_bounds


def _bounds_of_force(history: History, pairs: Sequence[Pair]) -> dict[str, Any]:
    """Return fields with bounds on the force of a moving boundary."""
    if (loop := loop_of(history)) is None or loop.kind == "load":
        return {}
    moved = PrescribedDisplacement(tuple(np.eye(2)[loop.axis]), on=loop.on)
    try:
        dual = Dual.from_effects(pairs[0].circle, moved)
        found = np.array([(np.nan, np.nan), *(dual.interval(pair) for pair in pairs)])
    except SceneError as error:
        log.info("no bounds on the force that moves boundary %s: %s", loop.on, error)
        return {}
    return {"force_bounds": found, "bounded_force": {loop.on: loop.axis}} if np.isfinite(found).any() else {}
