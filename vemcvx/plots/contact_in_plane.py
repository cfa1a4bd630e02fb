"""Contact of plane bodies along a line: friction traction, stick and slip, wear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.canvas import axes_or_new, distinct, figure_of, legend_below, light_grid
from vemcvx.errors import HistoryError
from vemcvx.meshes import plane_mesh
from vemcvx.meshes.polygons.geometry import right_of
from vemcvx.plots.style import (
    BACKWARD,
    EARLY_TO_LATE,
    FORWARD,
    SLIP,
    STICK,
    STICK_AREA,
    Units,
    instant,
    unit,
    value_range,
)
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# The contact boundary laid out on a line: where each contact node goes, and which part of the line it owns.
#
# A node owns the halves of its edges on Gamma_C. Where Gamma_C lies along an axis the line is that axis;
# otherwise it is the arc length, counter-clockwise, part after part.


# An edge that ends in a held node belongs to Gamma_C if it runs along the contact node's tangent; a corner
# flatter than 25 degrees passes for straight, which costs half an edge in a picture.
ALONG = 0.9
FLAT = 1e-9
ROUNDING = 1e-12  # of the largest friction of a history: where contact is open, this is none
ARC = "$s$"


@dataclass(frozen=True)
class ContactLine:
    """Contact nodes in the order of the line."""

    order: Ints
    """(m,) rows of the contact arrays"""
    position: Floats
    """(m,) places on the line"""
    limits: Floats
    """(m, 2) the part of the line that each node owns"""
    tangents: Floats
    """(m, 2) unit vectors towards larger positions"""
    symbol: str
    """what the line measures"""

    @property
    def label(self) -> str:
        """The axis label: the quantity along the line."""
        return "arc length $s$" if self.symbol == ARC else self.symbol

    def along(self, vectors: Floats) -> Floats:
        """(..., m) components along the line of vectors (..., m, 2) at the contact nodes, in the line's order."""
        components: Floats = np.einsum("...md,md->...m", vectors[..., self.order, :], self.tangents)
        return components

    @property
    def gaps(self) -> Ints:
        """Nodes between which and their predecessors the line is broken."""
        apart = self.limits[1:, 0] - self.limits[:-1, 1]
        return 1 + np.flatnonzero(apart > FLAT * np.abs(self.limits).max())

    def broken(self, values: Floats) -> tuple[Floats, Floats]:
        """Positions and values (m,), with NaN where the line is broken."""
        return np.insert(self.position, self.gaps, np.nan), np.insert(values, self.gaps, np.nan)

    def spans(self, chosen: Bools) -> Floats:
        """(k, 2) stretches of the line that the chosen nodes (m,), in the line's order, own together."""
        starts = chosen & ~np.append(False, chosen[:-1])
        starts[self.gaps] |= chosen[self.gaps]
        ends = np.append(starts[1:] | ~chosen[1:], True) & chosen
        return np.column_stack([self.limits[starts, 0], self.limits[ends, 1]])


def apart(history: Results, line: ContactLine) -> Bools:
    """(S, m) where contact is open and nothing rubs, along the line: nothing sticks or slips there."""
    contact = history.contact
    traction = np.abs(line.along(contact.traction))
    idle: Bools = ~contact.closed[:, line.order] & (traction <= ROUNDING * traction.max())
    return idle


def contact_line(history: Results, picture: str) -> ContactLine:
    """The contact nodes of a history laid out, or HistoryError if there are none."""
    contact = history.contact
    plane_mesh(history.mesh, picture, "contact_face and friction_disc draw contact in space")
    if len(contact.nodes) == 0:
        raise HistoryError(f"{picture}: this history has no contact nodes; the scene names no contact or friction.")
    edges = _edges(history)
    order, arc = _walk(edges, history)
    half = 0.5 * np.linalg.norm(np.diff(history.mesh.points[edges], axis=1)[:, 0], axis=1)
    before, after = np.zeros(history.mesh.n_nodes), np.zeros(history.mesh.n_nodes)
    after[edges[:, 0]], before[edges[:, 1]] = half, half
    nodes, normals = contact.nodes[order], contact.normals[order]
    limits = np.column_stack([arc - before[nodes], arc + after[nodes]])
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    axis = _axis(contact.points)
    if axis is None:
        return ContactLine(order, arc, limits, tangents, ARC)
    position = contact.points[order, axis]
    sign = float(np.sign(tangents[0, axis]))
    owned = np.sort(position[:, None] + sign * (limits - arc[:, None]), axis=1)
    turn = slice(None, None, int(sign))
    return ContactLine(order[turn], position[turn], owned[turn], (sign * tangents)[turn], f"$x_{axis + 1}$")


def _axis(points: Floats) -> int | None:
    """The axis along which all points lie, if there is one."""
    spread = np.ptp(points, axis=0)
    flat = spread <= FLAT * max(float(spread.max()), float(np.abs(points).max()))
    return int(np.argmin(flat)) if flat.any() else None


def _edges(history: Results) -> Ints:
    """Boundary edges of Gamma_C: both ends in contact, or one, and along its tangent."""
    contact, points = history.contact, history.mesh.points
    normal = np.zeros_like(points)
    normal[contact.nodes] = contact.normals
    edges = history.mesh.boundaries["boundary"]
    chord = points[edges[:, 1]] - points[edges[:, 0]]
    outward = right_of(chord) / np.linalg.norm(chord, axis=1)[:, None]
    cosines = np.einsum("end,ed->en", normal[edges], outward)
    # Nodes without contact have no normal, and cosine 0.
    touching: Bools = cosines.max(axis=1) > ALONG
    return edges[touching]


def _walk(edges: Ints, history: Results) -> tuple[Ints, Floats]:
    """Contact nodes in counter-clockwise order, part after part, and their arc length."""
    points, nodes = history.mesh.points, history.contact.nodes
    row = {int(node): i for i, node in enumerate(nodes)}
    following = {int(a): int(b) for a, b in edges if int(a) in row and int(b) in row}
    preceded = set(following.values())
    order: list[int] = []
    arc: list[float] = []
    here, seen = 0.0, set()
    room = 2.0 * history.mesh.h  # on the line between separate parts: two cells
    # Parts begin where nothing leads; what is left then are closed curves.
    for start in [n for n in row if n not in preceded] + list(row):
        node: int | None = start
        while node is not None and node not in seen:
            seen.add(node)
            order.append(row[node])
            arc.append(here)
            ahead = following.get(node)
            here += float(np.linalg.norm(points[ahead] - points[node])) if ahead is not None else room
            node = ahead
    return np.array(order), np.array(arc)


# Friction traction along the contact boundary, between its bounds: at them it slips, inside them it sticks.


def friction_traction(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the friction traction on the body against +-g at a stored step.

    Parameters
    ----------
    history : History
    step : int
        A stored step; negative ones count from the end.
    ax : Axes, optional
        Where to draw; by default on a new figure.
    limits : (low, high), optional
        Ends of the axis of forces; by default the same for all steps.
    units : mapping of str to str, optional
        Names of units: see :mod:`vemcvx.plots.style`.

    Raises
    ------
    HistoryError
        The history has no contact.
    """
    row = history.row(step)
    line = contact_line(history, "friction_traction")
    traction = line.along(history.contact.traction[row])
    low, high = _range(history, row, line)
    touches, still = ~apart(history, line)[row], history.contact.sticking[row, line.order]
    sticks, slips = touches & still, touches & ~still
    ax = axes_or_new(ax, 6.4, 3.6)
    for chosen, colour in ((sticks, STICK), (slips, SLIP)):
        for start, stop in line.spans(chosen):
            ax.axvspan(start, stop, color=colour, alpha=0.13, linewidth=0)
    for bound, label in ((high, "bound $\\pm g$"), (low, None)):
        ax.plot(*line.broken(bound), color="black", linestyle="--", linewidth=1.2, label=label)
    ax.plot(*line.broken(traction), color="0.35", linewidth=1.0, zorder=1.5)
    style = {"linestyle": "none", "markersize": np.clip(150 / len(sticks), 1.5, 4), "clip_on": False, "zorder": 3}
    for chosen, colour, marker, word in ((sticks, STICK, "o", "stick"), (slips, SLIP, "s", "slip")):
        if chosen.any():
            ax.plot(line.position[chosen], traction[chosen], marker=marker, color=colour, label=word, **style)
    contact, gone = history.contact, "" if touches.all() else f", {(~touches).sum()} are open"
    top = 1.2 * max(float(np.abs(force).max()) for force in (contact.bound, contact.backward, contact.traction)) or 1.0
    ax.set(
        xlim=(line.limits.min(), line.limits.max()),
        ylim=value_range(limits, (-top, top)),
        xlabel=f"{line.label} ({unit(units, 'length')})",
        ylabel=f"friction on the body\n({unit(units, 'force per length')})",
        title=f"{instant(history.times[row], units)}: {sticks.sum()} contact nodes stick, {slips.sum()} slip{gone}",
    )
    light_grid(ax)
    legend_below(ax)
    return figure_of(ax)


def _range(history: Results, row: int, line: ContactLine) -> tuple[Floats, Floats]:
    """The least and the largest friction along the line: against slip forward, and against slip backward."""
    contact = history.contact
    tangents = np.column_stack([-contact.normals[:, 1], contact.normals[:, 0]])
    onward = line.along(tangents) > 0
    forward, backward = contact.bound[row, line.order], contact.backward[row, line.order]
    return -np.where(onward, forward, backward), np.where(onward, backward, forward)


# Where and when the contact boundary sticks or slips, and which way: a map over position and time.


STATES = ((-1, BACKWARD, "slip towards smaller {}"), (0, STICK_AREA, "stick"), (1, FORWARD, "slip towards larger {}"))


def stick_slip_map(history: Results, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw, for every contact node and stored step, whether it sticks or slips and which way.

    A step fills the time from the stored instant before it to its own. Where steps between the two were not stored, the
    band still shows its last step alone, and the title says so.

    Parameters
    ----------
    history, ax, units : as of `friction_traction`

    Raises
    ------
    HistoryError
        The history has no contact, or no step.
    """
    line = contact_line(history, "stick_slip_map")
    steps = history.stored[history.stored > 0]
    if len(steps) == 0:
        raise HistoryError("stick_slip_map: this history has no step after the initial instant.")
    times, states = history.trajectory.times, directions(history, line)
    ax = axes_or_new(ax, 6.4, 4.2)
    edges = times[np.concatenate([[0], steps])]
    colours = distinct([colour for _, colour, _ in STATES])
    ax.pcolormesh(line.limits.ravel(), edges, _with_gaps(states), cmap=colours, vmin=-1.5, vmax=1.5)
    for state, colour, words in STATES:
        if (states == state).any():
            ax.plot([], [], "s", markersize=9, color=colour, label=words.format(line.symbol))
    missing = history.steps - len(steps)
    ax.set(
        ylim=(edges[0], edges[-1]),
        xlabel=f"{line.label} ({unit(units, 'length')})",
        ylabel=f"t ({unit(units, 'time')})",
    )
    bands = f"\neach band: its last step ({missing} of {history.steps} steps not stored)" if missing else ""
    ax.set_title("Stick and slip on the contact boundary" + bands, fontsize="medium")
    legend_below(ax)
    return figure_of(ax)


def directions(history: Results, line: ContactLine) -> Floats:
    """0 where a node sticks, 1 or -1 where it slips towards larger or smaller positions; a row a stored step > 0.

    NaN where contact is open, and nothing rubs.

    Friction opposes the slip of its step, whether or not the step before is stored; where there is no friction
    the slip since the last stored step tells.
    """
    contact, rows = history.contact, history.stored > 0
    against = line.along(contact.traction)
    moved = np.diff(line.along(contact.slip), axis=0, prepend=0.0)
    way = np.sign(np.where(against == 0.0, moved, -against))
    way = np.where(contact.sticking[:, line.order], 0.0, way)
    return np.where(apart(history, line), np.nan, way)[rows]


def _with_gaps(states: Floats) -> Floats:
    """Columns of NaN between those of `states`: what no node owns."""
    rows, columns = states.shape
    whole = np.full((rows, 2 * columns - 1), np.nan)
    whole[:, ::2] = states
    return whole


# How friction wears the contact boundary: the depth worn off is in proportion to friction work (Archard 1953).


MOST = len(EARLY_TO_LATE)


def wear(
    history: Results,
    steps: Sequence[int] | None = None,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the friction work per length of the contact boundary that was done until some steps.

    Parameters
    ----------
    history, ax, units : as of `friction_traction`
    steps : sequence of int, optional
        Stored steps, at most `MOST`; by default as many, evenly apart, the last among them.
    limits : (low, high), optional
        Ends of the axis of wear; by default from 0 to a little more than the largest of all steps.

    Raises
    ------
    HistoryError
        The history has no contact, or no step; or too many steps are asked for.
    """
    line = contact_line(history, "wear")
    later = history.stored[history.stored > 0]
    if len(later) == 0:
        raise HistoryError("wear: this history has no step after the initial instant.")
    evenly = later[np.unique(np.linspace(0, len(later), min(MOST, len(later)) + 1)[1:].round().astype(int)) - 1]
    rows = [history.row(step) for step in (evenly.tolist() if steps is None else steps)]
    if not 0 < len(rows) <= MOST:
        raise HistoryError(f"wear: found {len(rows)} steps; it draws 1 to {MOST} of them.")
    ax = axes_or_new(ax, 6.4, 3.6)
    for row, colour in zip(rows, EARLY_TO_LATE[-len(rows) :], strict=True):
        worn = line.broken(history.contact.wear[row, line.order])
        ax.plot(*worn, ".-", color=colour, linewidth=1.4, markersize=4, label=instant(history.times[row], units))
    top = 1.05 * float(history.contact.wear.max()) or 1.0
    ax.set(
        xlim=(line.limits.min(), line.limits.max()),
        ylim=value_range(limits, (0.0, top)),
        xlabel=f"{line.label} ({unit(units, 'length')})",
        ylabel=f"friction work\n({unit(units, 'energy per length')})",
    )
    ax.set_title("Wear of the contact boundary, in proportion to friction work", fontsize="medium")
    light_grid(ax)
    legend_below(ax)
    return figure_of(ax)
