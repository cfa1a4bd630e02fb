"""Pictures of contact along a line, for plane bodies.

If all contact nodes lie along an axis, the position on the line is x_1 or x_2. Otherwise the position is the arc
length of :mod:`vemcvx.results.arc`. A node owns half of each adjacent contact edge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vemcvx.base import canvas
from vemcvx.base.arrays import SAME, Bools, Floats, Ints, choice
from vemcvx.base.errors import HistoryError
from vemcvx.meshes import plane_mesh
from vemcvx.plots import style
from vemcvx.plots.style import Units, instant, is_idle, label, label_axes, units_of
from vemcvx.results import Contact, Results, contact_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARC = "$s$"


@dataclass(frozen=True)
class ContactLine:
    """The contact nodes of plane bodies along a line."""

    order: Ints  # (m,) rows of the contact arrays
    position: Floats  # (m,) positions on the line
    limits: Floats  # (m, 2) interval that the node owns
    tangents: Floats  # (m, 2) unit vectors towards larger positions
    symbol: str  # the symbol of the position

    @property
    def label(self) -> str:
        """The name of the position on the line."""
        return "arc length $s$" if self.symbol == ARC else self.symbol

    def along(self, vectors: Floats) -> Floats:
        """Return the components of vectors along the line."""
        return np.einsum("...md,md->...m", vectors[..., self.order, :], self.tangents)

    @property
    def gaps(self) -> Ints:
        """The first node after each interruption of the line."""
        return 1 + np.flatnonzero(self.limits[1:, 0] - self.limits[:-1, 1] > SAME * np.abs(self.limits).max())

    def interrupt(self, values: Floats) -> tuple[Floats, Floats]:
        """Return positions and values, with NaN where the line is interrupted."""
        return np.insert(self.position, self.gaps, np.nan), np.insert(values, self.gaps, np.nan)

    def spans(self, chosen: Bools) -> Floats:
        """Return the intervals of chosen nodes, joined where adjacent."""
        starts = chosen & ~np.append(False, chosen[:-1])
        starts[self.gaps] |= chosen[self.gaps]
        ends = np.append(starts[1:] | ~chosen[1:], True) & chosen
        return np.column_stack([self.limits[starts, 0], self.limits[ends, 1]])

    def finish(
        self, ax: Axes, y: str, title: str, units: Units, ends: tuple[float, float], size: str = "medium"
    ) -> Figure:
        """Set labels, title and legend of the axes, and return the figure."""
        whole = (self.limits.min(), self.limits.max())
        label_axes(ax, label(self.label, "length", units), y, title, size=size, window=(whole, ends))
        canvas.legend_below(ax)
        return canvas.figure_of(ax)


def contact_line(history: Results, picture: str) -> ContactLine:
    """Return the contact nodes along a line, or raise HistoryError."""
    mesh = plane_mesh(history.mesh, picture, "contact_face draws contact in space")
    contact = require_contact(history, picture)
    path = contact_path(mesh, contact)
    sides, order = path.sides, path.rows
    length = np.linalg.norm(mesh.points[sides[:, 1]] - mesh.points[sides[:, 0]], axis=1)
    # Draw separate pieces of contact two cells apart.
    ends = path.s[np.append(np.diff(path.pieces) > 0, True)] + 2 * mesh.h
    arc = path.s + np.append(0.0, np.cumsum(ends))[path.pieces]
    halves = np.zeros((2, mesh.n_nodes))
    halves[[[1], [0]], sides.T] = 0.5 * length
    nodes, normals = contact.nodes[order], contact.normals[order]
    limits = np.column_stack([arc - halves[0, nodes], arc + halves[1, nodes]])
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    spread = np.ptp(contact.points, axis=0)
    flat = spread <= SAME * max(float(spread.max()), float(np.abs(contact.points).max()))
    if not flat.any():
        return ContactLine(order, arc, limits, tangents, ARC)
    axis = int(np.argmax(spread if spread.any() else np.abs(tangents[0])))  # A single node has no spread.
    position, sign = contact.points[order, axis], 1 if tangents[:, axis].sum() >= 0 else -1
    owned = np.sort(position[:, None] + sign * (limits - arc[:, None]), axis=1)
    turn = slice(None, None, sign)
    return ContactLine(order[turn], position[turn], owned[turn], (sign * tangents)[turn], f"$x_{axis + 1}$")


def require_contact(history: Results, picture: str) -> Contact:
    """Return the contact of a history, or raise HistoryError."""
    if len(history.contact.nodes) == 0:
        raise HistoryError(f"{picture}: this history has no contact nodes; the scene has no contact and no friction.")
    return history.contact


def friction_traction(
    history: Results, step: int | None = None, *, ax: Axes | None = None, units: Units | None = None
) -> Figure:
    """Draw the friction traction on the body at a stored step, with the friction bounds +-g.

    Parameters
    ----------
    history : History
    step : int, optional
        A stored step; negative numbers count from the end. By default `history.peak`, the step of the largest energy.
    ax : Axes, optional
        Where to draw; by default on a new figure.
    units : mapping of str to str, optional
        Names of units: see :mod:`vemcvx.plots.style`. By default `history.units`.

    Returns
    -------
    matplotlib Figure
        The line is the traction. Nodes stick in blue areas, and slip in hatched orange areas.

    Raises
    ------
    SceneError, HistoryError
        The body is in space, the step was not stored, or the history has no contact.

    Examples
    --------
    >>> base = vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement((0.01, -0.01), on="top")
    >>> scene = vx.Scene(*base, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"))
    >>> history = vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0], initial="settled")
    >>> figure = vx.plots.friction_traction(history)
    """
    units = units_of(history, units)
    row, contact = history.row(step), history.contact
    line = contact_line(history, "friction_traction")
    traction = line.along(contact.traction[row])
    touches, still = ~is_idle(history)[row, line.order], contact.sticking[row, line.order]
    sticks, slips = touches & still, touches & ~still
    kinds = (sticks, style.STICK, "o", "stick"), (slips, style.SLIP, "s", "slip")
    ax = canvas.axes_or_new(ax, 6.4, 3.6)
    for chosen, colour, _, state in kinds:
        for start, stop in line.spans(chosen):
            ax.axvspan(start, stop, color=colour, alpha=0.13, linewidth=0, hatch="//" if state == "slip" else "")
    bound = contact.bound[row, line.order]
    for side, name in ((bound, "bound $\\pm g$"), (-bound, None)):
        ax.plot(*line.interrupt(side), color="black", linestyle="--", linewidth=1.2, label=name)
    ax.plot(*line.interrupt(traction), color="0.35", linewidth=1.0, zorder=1.5)
    marks = {"linestyle": "none", "markersize": np.clip(150 / len(sticks), 1.5, 4), "clip_on": False, "zorder": 3}
    for chosen, colour, marker, word in kinds:
        if chosen.any():
            ax.plot(line.position[chosen], traction[chosen], marker=marker, color=colour, label=word, **marks)
    gone = "" if touches.all() else f", {(~touches).sum()} are open"
    canvas.light_grid(ax)
    did = (
        f"{sticks.sum()} contact nodes stick, {slips.sum()} slip"
        if history.contact.has_friction
        else "there is no friction"
    )
    title = f"{instant(history.times[row], units)}: {did}{gone}"
    words = label("friction on the body\n", "force per length", units)
    top = 1.2 * max(float(np.abs(shown).max(initial=0.0)) for shown in (contact.traction, contact.bound)) or 1.0
    return line.finish(ax, words, title, units, (-top, top), size="large")


STATES = (
    (-1, style.BACKWARD, "slip towards smaller {}"),
    (0, style.STICK_AREA, "stick"),
    (1, style.FORWARD, "slip towards larger {}"),
)


def stick_slip_map(history: Results, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw stick and slip of every contact node in every stored step.

    Parameters
    ----------
    history, ax, units : as for `friction_traction`

    Returns
    -------
    matplotlib Figure
        A band between two stored instants shows the state at the later instant.

    Raises
    ------
    SceneError, HistoryError
        The body is in space, or the history has no contact or no step.

    Examples
    --------
    >>> figure = vx.plots.stick_slip_map(history)
    """
    units = units_of(history, units)
    line, steps = contact_line(history, "stick_slip_map"), list_steps(history, "stick_slip_map")
    states = directions(history, line)
    ax = canvas.axes_or_new(ax, 6.4, 4.2)
    edges = history.trajectory.times[np.concatenate([[0], steps])]
    colours = canvas.distinct([colour for _, colour, _ in STATES])
    # Gaps between the intervals of nodes stay blank.
    drawn = np.insert(states, range(1, states.shape[1]), np.nan, axis=1)
    ax.pcolormesh(line.limits.ravel(), edges, drawn, cmap=colours, vmin=-1.5, vmax=1.5)
    for state, colour, words in STATES:
        if (states == state).any():
            ax.plot([], [], "s", markersize=9, color=colour, label=words.format(line.symbol))
    if np.isnan(states).any():
        ax.plot([], [], "s", markersize=9, color="white", markeredgecolor="0.6", label="open")
    missing = history.steps - len(steps)
    bands = f"\neach band: its last step ({missing} of {history.steps} steps not stored)" if missing else ""
    title = f"Stick and slip on the contact boundary{bands}"
    return line.finish(ax, label("t", "time", units), title, units, (edges[0], edges[-1]))


def list_steps(history: Results, picture: str) -> Ints:
    """Return the stored steps after the initial instant, or raise HistoryError."""
    steps = history.stored[history.stored > 0]
    if len(steps) == 0:
        raise HistoryError(f"{picture}: this history has no step after the initial instant.")
    return steps


def directions(history: Results, line: ContactLine) -> Floats:
    """Return 0 for stick, 1 or -1 for the direction of slip, NaN for open nodes."""
    contact = history.contact
    against = line.along(contact.traction)
    moved = np.diff(line.along(contact.slip), axis=0, prepend=0.0)
    way = np.sign(np.where(against == 0.0, moved, -against))
    way = np.where(contact.sticking[:, line.order], 0.0, way)
    return np.where(is_idle(history)[:, line.order], np.nan, way)[history.stored > 0]


def pressures(history: Results) -> Floats:
    """Return the contact pressure, or zero if all pressures are rounding errors."""
    found, keys = history.contact.pressure_recovered, ("largest_principal_stress", "smallest_principal_stress")
    stress = max((abs(one.value) for one in history.extremes if one.key in keys), default=0.0)
    return found if np.abs(found).max(initial=0.0) > 1e-10 * stress else np.zeros_like(found)


def slips(history: Results) -> Floats:
    """Return the slip, or zero if all slips are rounding errors."""
    slip, largest = history.contact.slip, float(np.abs(history.displacement).max(initial=0.0))
    return slip if np.abs(slip).max(initial=0.0) > 1e-10 * largest else np.zeros_like(slip)


Along = Callable[[Results, ContactLine], Floats]
PROFILES: dict[str, tuple[str, str, str, Along]] = {
    "pressure": ("force per length", "contact pressure", "Contact pressure", lambda h, on: pressures(h)[:, on.order]),
    "slip": ("length", "slip towards larger {}", "Slip since the beginning", lambda h, on: on.along(slips(h))),
    "wear": ("energy per length", "friction work", "Wear, as friction work", lambda h, on: h.contact.wear[:, on.order]),
}
"""Quantity, label, title and values of each curve."""


def along_contact(
    history: Results,
    show: str = "pressure",
    steps: int | Iterable[int] | None = None,
    *,
    ax: Axes | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the contact pressure, the slip or the wear along the contact boundary at some steps.

    Parameters
    ----------
    history, ax, units : as for `friction_traction`
    show : {"pressure", "slip", "wear"}
        The pressure, the slip, or the friction work per length since the beginning.
    steps : int or sequence of int, optional
        Stored steps, at most four; by default ``history.telling(4)``: the peak, reversals, and the last step.

    Returns
    -------
    matplotlib Figure
        One curve per step.

    Raises
    ------
    SceneError, HistoryError
        The body is in space, there is no contact or no step, a step was not stored, or an argument is invalid.

    Examples
    --------
    >>> figure = vx.plots.along_contact(history, show="slip")
    """
    units = units_of(history, units)
    choice(show, "along_contact", "show", list(PROFILES), HistoryError)
    most = len(style.EARLY_TO_LATE)
    line, _ = contact_line(history, "along_contact"), list_steps(history, "along_contact")
    chosen = history.telling(most).tolist() if steps is None else steps if isinstance(steps, Iterable) else [steps]
    rows = [history.row(step) for step in chosen]
    if not 0 < len(rows) <= most:
        raise HistoryError(f"along_contact: found {len(rows)} steps; it draws 1 to {most} of them.")
    quantity, words, title, found = PROFILES[show]
    values, ax = found(history, line), canvas.axes_or_new(ax, 6.4, 3.6)
    for row, colour, mark in zip(rows, style.EARLY_TO_LATE[-len(rows) :], style.MARKERS, strict=False):
        (drawn,) = ax.plot(*line.interrupt(values[row]), f"{mark}-", color=colour, linewidth=1.4, markersize=3.5)
        drawn.set(label=instant(history.times[row], units), markevery=max(1, len(line.order) // 30))
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    canvas.light_grid(ax)
    ends = 1.05 * low, 1.05 * high if high > low else 1.0
    return line.finish(ax, label(f"{words.format(line.symbol)}\n", quantity, units), title, units, ends)
