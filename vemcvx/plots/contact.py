"""Contact in pictures: along a line in the plane, on a face in space; friction between its bounds, stick, slip, wear.

In the plane the contact nodes are laid out on a line: an axis where all of them lie along it, otherwise the arc length,
counter-clockwise, part after part; a node owns the halves of its edges. In space they are seen along their mean normal;
of every face at it a node owns the quadrilateral between itself, the middles of the two edges there and the centre.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base import canvas
from vemcvx.base.arrays import SAME, Bools, Floats, Ints, choice
from vemcvx.base.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh, plane_mesh
from vemcvx.meshes.polygons import right_of
from vemcvx.plots import style
from vemcvx.plots.style import Units, Window, idle, instant, label, named, unit, value_range, within
from vemcvx.results.contact import Contact
from vemcvx.results.results import Results
from vemcvx.vem.boundary import CURVE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALONG = float(np.cos(0.5 * CURVE))
"""Cosine between normals above which an edge or face at a contact node belongs to contact, half of the turn of a curve:
a corner flatter than that passes for straight, which costs half an edge in a picture."""
ARC = "$s$"


@dataclass(frozen=True)
class ContactLine:
    """Contact nodes of a plane body in the order of a line."""

    order: Ints  # (m,) rows of the contact arrays
    position: Floats  # (m,) places on the line
    limits: Floats  # (m, 2) the part of the line that each node owns
    tangents: Floats  # (m, 2) unit vectors towards larger positions
    symbol: str  # what the line measures

    @property
    def label(self) -> str:
        """The name of what the line measures."""
        return "arc length $s$" if self.symbol == ARC else self.symbol

    def along(self, vectors: Floats) -> Floats:
        """(..., m) components along the line of vectors (..., m, 2) at the contact nodes, in the line's order."""
        return np.einsum("...md,md->...m", vectors[..., self.order, :], self.tangents)

    @property
    def gaps(self) -> Ints:
        """Nodes between which and their predecessors the line is broken."""
        return 1 + np.flatnonzero(self.limits[1:, 0] - self.limits[:-1, 1] > SAME * np.abs(self.limits).max())

    def broken(self, values: Floats) -> tuple[Floats, Floats]:
        """Positions and values (m,), with NaN where the line is broken."""
        return np.insert(self.position, self.gaps, np.nan), np.insert(values, self.gaps, np.nan)

    def spans(self, chosen: Bools) -> Floats:
        """(k, 2) stretches of the line that the chosen nodes (m,), in the line's order, own together."""
        starts = chosen & ~np.append(False, chosen[:-1])
        starts[self.gaps] |= chosen[self.gaps]
        ends = np.append(starts[1:] | ~chosen[1:], True) & chosen
        return np.column_stack([self.limits[starts, 0], self.limits[ends, 1]])

    def framed(
        self, ax: Axes, y: str, title: str, units: Units | None, ends: tuple[float, float], size: str = "medium"
    ) -> Figure:
        """Return the figure of axes along the line, which go from end to end, with labels, a title and a legend."""
        whole = (self.limits.min(), self.limits.max())
        named(ax, label(self.label, "length", units), y, title, size=size, window=(whole, ends))
        canvas.legend_below(ax)
        return canvas.figure_of(ax)


def contact_line(history: Results, picture: str) -> ContactLine:
    """Return the contact nodes of a plane history laid out, or raise HistoryError if there are none."""
    mesh = plane_mesh(history.mesh, picture, "contact_face and friction_disc draw contact in space")
    contact, normal = _with_nodes(history, picture), np.zeros_like(mesh.points)
    normal[contact.nodes] = contact.normals
    edges = mesh.boundaries["boundary"]
    chord = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    length = np.linalg.norm(chord, axis=1)
    # Nodes without contact have no normal, and cosine 0.
    touching = np.einsum("end,ed->en", normal[edges], right_of(chord) / length[:, None]).max(axis=1) > ALONG
    order, arc = _walk(edges[touching], history)
    halves = np.zeros((2, mesh.n_nodes))
    halves[[[1], [0]], edges[touching].T] = 0.5 * length[touching]
    nodes, normals = contact.nodes[order], contact.normals[order]
    limits = np.column_stack([arc - halves[0, nodes], arc + halves[1, nodes]])
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    spread = np.ptp(contact.points, axis=0)
    flat = spread <= SAME * max(float(spread.max()), float(np.abs(contact.points).max()))
    if not flat.any():
        return ContactLine(order, arc, limits, tangents, ARC)
    axis = int(np.argmax(spread if spread.any() else np.abs(tangents[0])))  # One node has no spread.
    position, sign = contact.points[order, axis], 1 if tangents[:, axis].sum() >= 0 else -1
    owned = np.sort(position[:, None] + sign * (limits - arc[:, None]), axis=1)
    turn = slice(None, None, sign)
    return ContactLine(order[turn], position[turn], owned[turn], (sign * tangents)[turn], f"$x_{axis + 1}$")


def _with_nodes(history: Results, picture: str) -> Contact:
    if len(history.contact.nodes) == 0:
        raise HistoryError(f"{picture}: this history has no contact nodes; the scene names no contact or friction.")
    return history.contact


def _walk(edges: Ints, history: Results) -> tuple[Ints, Floats]:
    """Contact nodes in counter-clockwise order, part after part, and their arc length."""
    points, row = history.mesh.points, {int(node): i for i, node in enumerate(history.contact.nodes)}
    following = {int(a): int(b) for a, b in edges if int(a) in row and int(b) in row}
    preceded, arc, here = set(following.values()), dict[int, float](), 0.0
    # Parts begin where nothing leads; what is left then are closed curves.
    for start in [n for n in row if n not in preceded] + list(row):
        node: int | None = start
        while node is not None and node not in arc:
            arc[node] = here
            ahead = following.get(node)
            # Separate parts are two cells apart on the line.
            here += float(np.linalg.norm(points[ahead] - points[node])) if ahead is not None else 2 * history.mesh.h
            node = ahead
    return np.array([row[node] for node in arc]), np.array(list(arc.values()))


def friction_traction(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the friction traction on the body against +-g at a stored step: at g it slips, inside it sticks.

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
    row, contact = history.row(step), history.contact
    line = contact_line(history, "friction_traction")
    traction = line.along(contact.traction[row])
    touches, still = ~idle(history)[row, line.order], contact.sticking[row, line.order]
    sticks, slips = touches & still, touches & ~still
    kinds = (sticks, style.STICK, "o", "stick"), (slips, style.SLIP, "s", "slip")
    ax = canvas.axes_or_new(ax, 6.4, 3.6)
    for chosen, colour, _, state in kinds:
        for start, stop in line.spans(chosen):
            # Hatched, for print in grey.
            ax.axvspan(start, stop, color=colour, alpha=0.13, linewidth=0, hatch="//" if state == "slip" else "")
    top, bound, far = _reach(contact), contact.bound[row, line.order], ""
    ends = value_range(limits, (-top, top))
    if bound.min() > min(-ends[0], ends[1]):
        far = f" off the axis, {bound.min():.3g} {unit(units, 'force per length') if units else ''}".rstrip()
        far += " or more" * bool(np.ptp(bound) > 0)
    for side, name in ((bound, f"bound $\\pm g${far}"), (-bound, None)):
        ax.plot(*line.broken(side), color="black", linestyle="--", linewidth=1.2, label=name)
    ax.plot(*line.broken(traction), color="0.35", linewidth=1.0, zorder=1.5)
    marks = {"linestyle": "none", "markersize": np.clip(150 / len(sticks), 1.5, 4), "clip_on": False, "zorder": 3}
    for chosen, colour, marker, word in kinds:
        if chosen.any():
            ax.plot(line.position[chosen], traction[chosen], marker=marker, color=colour, label=word, **marks)
    gone = "" if touches.all() else f", {(~touches).sum()} are open"
    canvas.light_grid(ax)
    did = f"{sticks.sum()} contact nodes stick, {slips.sum()} slip" if rubs(history) else "there is no friction"
    title = f"{instant(history.times[row], units)}: {did}{gone}"
    words = label("friction on the body\n", "force per length", units)
    return line.framed(ax, words, title, units, ends, size="large")


def _reach(contact: Contact) -> float:
    """The end of an axis of friction: beyond bound and friction; beyond friction alone where bounds are far larger."""
    friction = float(np.abs(contact.traction).max(initial=0.0))
    bound = float(np.abs(contact.bound).max(initial=0.0))
    # Within a fifth of the axis friction is still seen, and rounding is not to be.
    far = 1e-8 * bound < friction < 0.2 * bound
    return 1.2 * (friction if far else max(bound, friction)) or 1.0


def rubs(history: Results) -> bool:
    """Return True if there is friction, or a bound on it, at some stored instant."""
    contact = history.contact
    return bool(contact.bound.any() or contact.traction.any())


STATES = (
    (-1, style.BACKWARD, "slip towards smaller {}"),
    (0, style.STICK_AREA, "stick"),
    (1, style.FORWARD, "slip towards larger {}"),
)


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
    line, steps = contact_line(history, "stick_slip_map"), _later(history, "stick_slip_map")
    states = directions(history, line)
    ax = canvas.axes_or_new(ax, 6.4, 4.2)
    edges = history.trajectory.times[np.concatenate([[0], steps])]
    colours = canvas.distinct([colour for _, colour, _ in STATES])
    # What no node owns, between the columns, is left blank.
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
    return line.framed(ax, label("t", "time", units), title, units, (edges[0], edges[-1]))


def _later(history: Results, picture: str) -> Ints:
    """Stored steps after the initial instant, of which there must be some."""
    steps = history.stored[history.stored > 0]
    if len(steps) == 0:
        raise HistoryError(f"{picture}: this history has no step after the initial instant.")
    return steps


def directions(history: Results, line: ContactLine) -> Floats:
    """0 where a node sticks, 1 or -1 where it slips towards larger or smaller positions; a row a stored step > 0.

    NaN where contact is open, and nothing rubs.

    Friction opposes the slip of its step, whether or not the step before is stored; where there is no friction
    the slip since the last stored step tells.
    """
    contact = history.contact
    against = line.along(contact.traction)
    moved = np.diff(line.along(contact.slip), axis=0, prepend=0.0)
    way = np.sign(np.where(against == 0.0, moved, -against))
    way = np.where(contact.sticking[:, line.order], 0.0, way)
    return np.where(idle(history)[:, line.order], np.nan, way)[history.stored > 0]


def pressures(history: Results) -> Floats:
    """(S, m) the contact pressure that all pictures show, without the ripple of nodal forces.

    It is zero where all of it is rounding beside the stresses: a picture would fill its axis with 1e-14.
    """
    found, keys = history.contact.pressure_recovered, ("largest_principal_stress", "smallest_principal_stress")
    stress = max((abs(one.value) for one in history.extremes if one.key in keys), default=0.0)
    return found if np.abs(found).max(initial=0.0) > 1e-10 * stress else np.zeros_like(found)


def slips(history: Results) -> Floats:
    """(S, m, dim) the slip, zero where all of it is rounding beside the displacements."""
    slip, largest = history.contact.slip, float(np.abs(history.displacement).max(initial=0.0))
    return slip if np.abs(slip).max(initial=0.0) > 1e-10 * largest else np.zeros_like(slip)


Along = Callable[[Results, ContactLine], Floats]
PROFILES: dict[str, tuple[str, str, str, Along]] = {
    "pressure": ("force per length", "contact pressure", "Contact pressure", lambda h, on: pressures(h)[:, on.order]),
    "slip": ("length", "slip towards larger {}", "Slip since the beginning", lambda h, on: on.along(slips(h))),
    "wear": ("energy per length", "friction work", "Wear, as friction work", lambda h, on: h.contact.wear[:, on.order]),
}
"""Along the contact boundary: quantity, label, title, and values (S, m) in the order of the line."""


def along_contact(
    history: Results,
    show: str = "pressure",
    steps: int | Iterable[int] | None = None,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the contact pressure, the slip or the wear along the contact boundary at some steps.

    Parameters
    ----------
    history, ax, units : as of `friction_traction`
    show : {"pressure", "slip", "wear"}
        Pressure and slip at these instants, or the friction work per length until then.
    steps : int or sequence of int, optional
        Stored steps, at most four; by default as many, evenly apart, the last among them.
    limits : (low, high), optional
        Ends of the axis of values; by default from 0, or less, to a little more than the largest of all steps.

    Raises
    ------
    HistoryError
        The history has no contact, or no step; or too many steps are asked for, or what there is no picture of.
    """
    choice(show, "along_contact", "show", list(PROFILES), HistoryError)
    picture, most = "wear" if show == "wear" else "along_contact", len(style.EARLY_TO_LATE)
    line, later = contact_line(history, picture), _later(history, picture)
    evenly = later[np.unique(np.linspace(0, len(later), min(most, len(later)) + 1)[1:].round().astype(int)) - 1]
    asked = evenly.tolist() if steps is None else steps if isinstance(steps, Iterable) else [steps]
    rows = [history.row(step) for step in asked]
    if not 0 < len(rows) <= most:
        raise HistoryError(f"{picture}: found {len(rows)} steps; it draws 1 to {most} of them.")
    quantity, words, title, found = PROFILES[show]
    values, ax = found(history, line), canvas.axes_or_new(ax, 6.4, 3.6)
    for row, colour, mark in zip(rows, style.EARLY_TO_LATE[-len(rows) :], style.MARKERS, strict=False):
        (drawn,) = ax.plot(*line.broken(values[row]), f"{mark}-", color=colour, linewidth=1.4, markersize=3.5)
        drawn.set(label=instant(history.times[row], units), markevery=max(1, len(line.order) // 30))
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    canvas.light_grid(ax)
    ends = value_range(limits, (1.05 * low, 1.05 * high if high > low else 1.0))
    return line.framed(ax, label(f"{words.format(line.symbol)}\n", quantity, units), title, units, ends)


def wear(
    history: Results,
    steps: int | Iterable[int] | None = None,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the friction work until some steps, as `along_contact`: wear is in proportion to it (Archard 1953)."""
    return along_contact(history, "wear", steps, ax=ax, limits=limits, units=units)


@dataclass(frozen=True)
class FaceLayout:
    """Contact nodes of a body in space in the plane of the picture."""

    frame: Floats  # (2, 3) unit vectors to the right and up
    labels: tuple[str, str]  # what they measure
    places: Floats  # (m, 2) of the contact nodes
    corners: Floats  # (k, 4, 2) quadrilaterals that make up the face
    owners: Ints  # (k,) rows of the contact arrays, of the nodes that own them

    def flat(self, vectors: Floats) -> Floats:
        """Vectors (..., 3) in the picture, (..., 2)."""
        return vectors @ self.frame.T


def face_layout(history: Results, picture: str) -> FaceLayout:
    """The contact nodes of a history in space laid out; HistoryError where there are none, or no view shows them."""
    mesh = history.mesh
    if not isinstance(mesh, PolyhedralMesh):
        raise HistoryError(f"{picture}: this body is plane; friction_traction and stick_slip_map draw its contact.")
    contact = _with_nodes(history, picture)
    if not seen(contact):
        raise HistoryError(hidden(picture))
    frame, labels = _frame(contact.normals.mean(axis=0))
    corners, owners = _parts(contact, mesh)
    return FaceLayout(frame, labels, contact.points @ frame.T, corners @ frame.T, owners)


def seen(contact: Contact) -> bool:
    """Return True if one view shows contact: it is on one side, or the mean of the unit normals were short."""
    return bool(np.linalg.norm(contact.normals.mean(axis=0)) >= 0.5)


def hidden(picture: str) -> str:
    """Return the sentence that refuses a picture of contact on all sides."""
    return f"{picture}: contact goes round the body, and no view shows all of it; look at the VTU files of the history"


def _frame(mean: Floats) -> tuple[Floats, tuple[str, str]]:
    """Right and up, across the mean normal: axes where it is one, then as if looked at from inside the body."""
    length, axis = np.linalg.norm(mean), int(np.argmax(np.abs(mean)))
    right, up = (k for k in range(3) if k != axis)
    if abs(mean[axis]) > (1 - SAME) * length:
        return np.eye(3)[[right, up]], (f"$x_{right + 1}$", f"$x_{up + 1}$")
    along = np.eye(3)[right] - mean[right] / length**2 * mean
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(mean / length, along)]), ("right", "up")


def _parts(contact: Contact, mesh: PolyhedralMesh) -> tuple[Floats, Ints]:
    """Quadrilaterals (k, 4, 3) of the faces of contact, and their owners (k,)."""
    normal, joined = np.zeros_like(mesh.points), contact.partners >= 0
    normal[contact.nodes] = contact.normals
    # Nodes at the rim of an interface own parts of its faces, not of those beside it.
    rows = np.full((2, mesh.n_nodes), -1)
    rows[joined.astype(int), contact.nodes] = np.arange(len(contact.nodes))
    inner = np.isin(np.arange(mesh.n_faces), np.concatenate([[], *(mesh.boundaries[name] for name in mesh.interfaces)]))
    corners, owners = [], []
    for face in mesh.boundaries["boundary"]:
        nodes = mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]]
        if (normal[nodes] @ mesh.face_normals[face]).max() <= ALONG:
            continue
        x = mesh.points[nodes]
        after, before = 0.5 * (x + np.roll(x, -1, axis=0)), 0.5 * (x + np.roll(x, 1, axis=0))
        corners.append(np.stack([x, after, np.broadcast_to(mesh.face_centroids[face], x.shape), before], axis=1))
        owners.append(rows[int(inner[face])][nodes])
    held, quadrilaterals = np.concatenate(owners), np.concatenate(corners)
    return quadrilaterals[held >= 0], held[held >= 0]


AREAS = {"sticks": style.STICK_AREA, "slips": style.SLIP_AREA, "is open": style.OPEN_AREA}
FIELDS: dict[str, tuple[str, str, Callable[[Results], Floats]]] = {
    "pressure": ("force per area", "contact pressure", pressures),
    "friction": ("force per area", "friction", lambda history: np.linalg.norm(history.contact.traction, axis=2)),
    "wear": ("energy per area", "friction work", lambda history: history.contact.wear),
}


def contact_face(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    show: str = "states",
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
    row, layout, contact = history.row(step), face_layout(history, "contact_face"), history.contact
    choice(show, "contact_face", "show", ["states", *FIELDS], HistoryError)
    window = style.window_of(window)
    ax = canvas.axes_or_new(ax, 6.0, 5.0)
    states = np.where(idle(history)[row], 2, np.where(contact.sticking[row], 0, 1))  # Numbers of `AREAS`.
    if show == "states":
        canvas.draw_polygons(ax, layout.corners, [list(AREAS.values())[state] for state in states[layout.owners]])
        for state, (words, colour) in enumerate(AREAS.items()):
            if (states == state).any():
                ax.plot([], [], "s", color=colour, markeredgecolor="0.6", markersize=8, label=words)
        canvas.legend_under(ax)
    else:
        quantity, words, values = FIELDS[show]
        field = values(history)
        drawn = canvas.draw_polygons(ax, layout.corners, None)
        drawn.set_array(field[row, layout.owners])
        ends = value_range(limits, (min(0.0, float(field.min())), float(field.max()) or 1.0))
        drawn.set(cmap=style.SIZE, clim=ends)
        canvas.colour_bar(ax, drawn, label(words, quantity, units))
    shown = np.flatnonzero((states == 1) & within(layout.places, window) & (row > 0))
    moved = layout.flat(contact.slip[row] - contact.slip[max(row - 1, 0)])[shown]
    size = float(np.ptp(layout.places if window is None else np.transpose(window), axis=0).max())
    size = size or float(np.ptp(layout.corners, axis=(0, 1)).max())  # One node alone.
    places, largest = layout.places[shown], float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if largest > 0.0:
        # One in each square of a grid of 14, so that what is left out is left out evenly.
        _, kept = np.unique(np.floor((places - places.min(axis=0)) * 14 / size + 0.5), axis=0, return_index=True)
        arrows = moved[kept] * 0.085 * size / largest
        canvas.draw_arrows(ax, places[kept], arrows, colour=style.PUSH, pivot="mid", width=0.005).set_in_layout(False)
    ax.locator_params(nbins=5)
    if window is None:
        ax.autoscale_view()
    last = row > 0 and history.stored[row - 1] == history.stored[row] - 1
    since = "of the step" if last else "since the last stored step"
    most = f"{largest:.3g} {unit(units, 'length') if units else ''}".rstrip()
    told = f", slip {since} at most {most}" if largest else ""
    x, y = (label(words, "length", units) for words in layout.labels)
    return named(ax, x, y, f"{instant(history.times[row], units)}{told}", size="small", window=window, aspect="equal")


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
    ax = canvas.axes_or_new(ax, 5.0, 5.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    ax.plot(np.cos(angle), np.sin(angle), "--", color="black", linewidth=1.2, label="bound", zorder=2)
    for chosen, colour, marker, word in ((sticks, style.STICK, "o", "sticks"), (~sticks, style.SLIP, "s", "slips")):
        if chosen.any():
            rays = np.full((chosen.sum(), 3, 2), [[0.0], [0.0], [np.nan]])
            rays[:, 1] = share[chosen]
            ax.plot(*rays.reshape(-1, 2).T, color=colour, linewidth=0.5, alpha=0.35, zorder=1.5)
            ax.plot(*share[chosen].T, marker, color=colour, markersize=4, label=word, zorder=3)
    canvas.light_grid(ax)
    canvas.legend_under(ax)
    title = f"{instant(history.times[row], units)}: {sticks.sum()} contact nodes stick, {(~sticks).sum()} slip"
    x = f"friction on the body / bound, along {layout.labels[0]}"
    disc: Window = ((-1.15, 1.15), (-1.15, 1.15))
    return named(ax, x, f"along {layout.labels[1]}", title, size="small", window=disc, aspect="equal")
