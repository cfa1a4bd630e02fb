"""Contact of bodies in space: the face of contact laid out in a plane, stick and slip on it, friction in its disc."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, Ints, choice
from vemcvx.canvas import axes_or_new, colour_bar, draw_arrows, draw_polygons, figure_of, legend_under, light_grid
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.plots.style import OPEN_AREA, SIZE, SLIP, SLIP_AREA, STICK, STICK_AREA, Units, instant, unit, value_range
from vemcvx.results.contact import Contact
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# The face of contact of a body in space laid out in a plane, and the part of it that each contact node owns.
#
# It is seen along its mean normal. A node owns of every face at it the quadrilateral between itself, the middles of
# the two edges there and the centre of the face.


ALONG = 0.9
"""A face belongs to contact if the cosine between its normal and that of a contact node at it is larger."""
SEEN = 0.5
"""Length of the mean of unit normals below which contact goes round the body, and nobody sees all of it."""
AXIS = 1.0 - 1e-9


@dataclass(frozen=True)
class FaceLayout:
    """Contact nodes in the plane of the picture."""

    frame: Floats
    """(2, 3) unit vectors to the right and up"""
    labels: tuple[str, str]
    """what they measure"""
    places: Floats
    """(m, 2) of the contact nodes"""
    corners: Floats
    """(k, 4, 2) quadrilaterals that make up the face"""
    owners: Ints
    """(k,) rows of the contact arrays, of the nodes that own them"""

    def flat(self, vectors: Floats) -> Floats:
        """Vectors (..., 3) in the picture, (..., 2)."""
        return vectors @ self.frame.T


def face_layout(history: Results, picture: str) -> FaceLayout:
    """The contact nodes of a history laid out.

    Raises
    ------
    HistoryError
        There are none, the body is plane, or contact goes round it.
    """
    contact, mesh = history.contact, history.mesh
    if not isinstance(mesh, PolyhedralMesh):
        raise HistoryError(f"{picture}: this body is plane; friction_traction and stick_slip_map draw its contact.")
    if len(contact.nodes) == 0:
        raise HistoryError(f"{picture}: this history has no contact nodes; the scene names no contact or friction.")
    if not seen(contact):
        raise HistoryError(hidden(picture))
    frame, labels = _frame(contact.normals.mean(axis=0))
    corners, owners = _parts(contact, mesh)
    return FaceLayout(frame, labels, contact.points @ frame.T, corners @ frame.T, owners)


def apart(history: Results) -> Bools:
    """(S, m) where contact is open and nothing rubs."""
    contact = history.contact
    traction = np.linalg.norm(contact.traction, axis=2)
    idle: Bools = ~contact.closed & (traction <= 1e-12 * traction.max())
    return idle


def seen(contact: Contact) -> bool:
    """Return True if contact is on one side of the body, so that one view shows it."""
    return bool(np.linalg.norm(contact.normals.mean(axis=0)) >= SEEN)


def hidden(picture: str) -> str:
    """The sentence that refuses a picture of contact on all sides."""
    return f"{picture}: contact goes round the body, and no view shows all of it; look at the VTU files of the history"


def _frame(mean: Floats) -> tuple[Floats, tuple[str, str]]:
    """Right and up, across the mean normal: axes where it is one, then as if looked at from inside the body."""
    length = np.linalg.norm(mean)
    axis = int(np.argmax(np.abs(mean)))
    right, up = (k for k in range(3) if k != axis)
    if abs(mean[axis]) > AXIS * length:
        return np.eye(3)[[right, up]], (f"$x_{right + 1}$", f"$x_{up + 1}$")
    along = np.eye(3)[right] - mean[right] / length**2 * mean
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(mean / length, along)]), ("right", "up")


def _parts(contact: Contact, mesh: PolyhedralMesh) -> tuple[Floats, Ints]:
    """Quadrilaterals (k, 4, 3) of the faces of contact, and their owners (k,)."""
    normal, row = np.zeros_like(mesh.points), np.full(mesh.n_nodes, -1)
    normal[contact.nodes], row[contact.nodes] = contact.normals, np.arange(len(contact.nodes))
    corners, owners = [], []
    for face in mesh.boundaries["boundary"]:
        nodes = mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]]
        # Nodes without contact have no normal, and cosine 0.
        if (normal[nodes] @ mesh.face_normals[face]).max() <= ALONG:
            continue
        x = mesh.points[nodes]
        after, before = 0.5 * (x + np.roll(x, -1, axis=0)), 0.5 * (x + np.roll(x, 1, axis=0))
        corners.append(np.stack([x, after, np.broadcast_to(mesh.face_centroids[face], x.shape), before], axis=1))
        owners.append(row[nodes])
    held, quadrilaterals = np.concatenate(owners), np.concatenate(corners)
    return quadrilaterals[held >= 0], held[held >= 0]


# Which part of a face of contact in space sticks, which slips and where to; pressure, friction and wear on it.


Window = tuple[tuple[float, float], tuple[float, float]]
AREAS = {"sticks": STICK_AREA, "slips": SLIP_AREA, "is open": OPEN_AREA}
STICKS, SLIPS, OPEN = range(3)
STATES = "states"
FIELDS: dict[str, tuple[str, str, Callable[[Contact], Floats]]] = {
    "pressure": ("force per area", "contact pressure", lambda contact: contact.pressure),
    "friction": ("force per area", "friction", lambda contact: np.linalg.norm(contact.traction, axis=2)),
    "wear": ("energy per area", "friction work", lambda contact: contact.wear),
}
LONGEST, MOST = 0.085, 14
"""The longest arrow as part of the picture's size, and how many there are across it, about."""


def contact_face(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    show: str = STATES,
    window: Window | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the face of contact of a body in space at a stored step, seen along its normal.

    Parameters
    ----------
    history, step, ax, units : as of `friction_traction`
    show : {"states", "pressure", "friction", "wear"}
        What colours say: what nodes do, or how large these are.
    window : ((low, high), (low, high)), optional
        Draw this part only, in units of length.
    limits : (low, high), optional
        Ends of the colour scale of what has one; by default the same for all stored steps.

    Returns
    -------
    matplotlib Figure
        Colours are those of the part of the face that each node owns; arrows are the slip since the last
        stored step, the longest as the title says.

    Raises
    ------
    HistoryError
        The body is plane, has no contact, or contact goes round it; or nothing of that name can be shown.
    """
    row, layout = history.row(step), face_layout(history, "contact_face")
    choice(show, "contact_face", "show", [STATES, *FIELDS], HistoryError)
    ax = axes_or_new(ax, 6.0, 5.0)
    if show == STATES:
        _colour_states(ax, layout, _states(history, row))
    else:
        quantity, words, values = FIELDS[show]
        field = values(history.contact)
        scale = value_range(limits, (min(0.0, float(field.min())), float(field.max()) or 1.0))
        drawn = draw_polygons(ax, layout.corners, None)
        drawn.set_array(field[row, layout.owners])
        drawn.set(cmap=SIZE, clim=scale)
        colour_bar(ax, drawn, f"{words} ({unit(units, quantity)})")
    largest = _arrows(ax, history, row, layout, window)
    length = unit(units, "length")
    ax.set(xlabel=f"{layout.labels[0]} ({length})", ylabel=f"{layout.labels[1]} ({length})", aspect="equal")
    ax.locator_params(nbins=5)
    if window is None:
        ax.autoscale_view()
    else:
        ax.set(xlim=window[0], ylim=window[1])
    last = row > 0 and history.stored[row - 1] == history.stored[row] - 1
    moved = f", slip {'of the step' if last else 'since the last stored step'} at most {largest:.3g}" if largest else ""
    ax.set_title(f"{instant(history.times[row], units)}{moved}", fontsize="small")
    return figure_of(ax)


def _colour_states(ax: Axes, layout: FaceLayout, states: Ints) -> None:
    """Colour what nodes do, and say which colour is what."""
    colours = list(AREAS.values())
    draw_polygons(ax, layout.corners, [colours[state] for state in states[layout.owners]])
    for state, (words, colour) in enumerate(AREAS.items()):
        if (states == state).any():
            ax.plot([], [], "s", color=colour, markeredgecolor="0.6", markersize=8, label=words)
    legend_under(ax)


def _states(history: Results, row: int) -> Ints:
    """(m,) what each contact node does."""
    return np.where(apart(history)[row], OPEN, np.where(history.contact.sticking[row], STICKS, SLIPS))


def _arrows(ax: Axes, history: Results, row: int, layout: FaceLayout, window: Window | None) -> float:
    """Draw how far nodes slipped since the last stored step; returns the largest, 0 if none did."""
    if row == 0:
        return 0.0
    low, high = np.transpose(window) if window is not None else (-np.inf, np.inf)
    shown = np.flatnonzero(
        (_states(history, row) == SLIPS) & ((layout.places >= low) & (layout.places <= high)).all(axis=1)
    )
    moved = layout.flat(history.contact.slip[row] - history.contact.slip[row - 1])[shown]
    largest = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    places = layout.places[shown]
    size = float(np.ptp(layout.places if window is None else np.transpose(window), axis=0).max())
    # One in each square of a grid, so that what is left out is left out evenly.
    squares = np.floor((places - places.min(axis=0)) * MOST / size + 0.5)
    _, kept = np.unique(squares, axis=0, return_index=True)
    arrows = moved[kept] * LONGEST * size / largest
    draw_arrows(ax, places[kept], arrows, colour=SLIP, pivot="mid", width=0.005).set_in_layout(False)
    return largest


# Friction in space against its bound: vectors in a disc, on whose rim nodes slip.


REACH = 1.15


def friction_disc(history: Results, step: int = -1, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw the friction on the body at every contact node over its bound, as points in the unit disc.

    Parameters
    ----------
    history, step, ax, units : as of `friction_traction`

    Raises
    ------
    HistoryError
        The body is plane, has no contact or no friction at that step, or contact goes round it.
    """
    row, layout, contact = history.row(step), face_layout(history, "friction_disc"), history.contact
    rubs = contact.bound[row] > 0
    if not rubs.any():
        raise HistoryError(f"friction_disc: there is no friction at step {history.stored[row]}; draw another step.")
    share = layout.flat(contact.traction[row, rubs]) / contact.bound[row, rubs, None]
    sticks = contact.sticking[row, rubs]
    ax = axes_or_new(ax, 5.0, 5.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    ax.plot(np.cos(angle), np.sin(angle), "--", color="black", linewidth=1.2, label="bound", zorder=2)
    for chosen, colour, marker, word in ((sticks, STICK, "o", "sticks"), (~sticks, SLIP, "s", "slips")):
        if chosen.any():
            ends = np.zeros((chosen.sum(), 3, 2))
            ends[:, 1], ends[:, 2] = share[chosen], np.nan
            ax.plot(*ends.reshape(-1, 2).T, color=colour, linewidth=0.5, alpha=0.35, zorder=1.5)
            ax.plot(*share[chosen].T, marker, color=colour, markersize=4, label=word, zorder=3)
    ax.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), aspect="equal")
    ax.set(xlabel=f"friction on the body / bound, along {layout.labels[0]}", ylabel=f"along {layout.labels[1]}")
    ax.set_title(
        f"{instant(history.times[row], units)}: {sticks.sum()} contact nodes stick, {(~sticks).sum()} slip",
        fontsize="small",
    )
    light_grid(ax)
    legend_under(ax)
    return figure_of(ax)
