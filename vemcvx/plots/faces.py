"""Faces of contact in space, seen along the mean normal.

In each adjacent mesh face, a node owns a quadrilateral. The corners are the node, two edge midpoints, and the centroid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vemcvx.base import canvas
from vemcvx.base.arrays import SAME, Bools, Floats, Ints, are_among, choice
from vemcvx.base.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.plots import style
from vemcvx.plots.contact import pressures, require_contact
from vemcvx.plots.style import Units, Window, amount, instant, is_idle, label, label_axes, units_of, within
from vemcvx.results import ALONG, Contact, Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HIDDEN = "contact goes round the body, and no view shows all of it; open the VTU files of the history"


@dataclass(frozen=True)
class ContactFace:
    """A face of contact in space, projected into the plane of the picture."""

    history: Results  # the history at the contact nodes of this face
    frame: Floats  # (2, 3) unit vectors to the right and up
    labels: tuple[str, str]  # names of the coordinates to the right and up
    corners: Floats  # (k, 4, 2) quadrilaterals that make up the face
    owners: Ints  # (k,) positions of the owners in the contact arrays

    @property
    def places(self) -> Floats:
        """The coordinates (m, 2) of the contact nodes in the picture."""
        return self.flat(self.history.contact.points)

    def flat(self, vectors: Floats) -> Floats:
        """Project vectors (..., 3) into the picture (..., 2)."""
        return vectors @ self.frame.T


def contact_faces(history: Results, on: str | None = None) -> dict[str, ContactFace]:
    """Return the visible faces of contact, by interface name or "obstacles"."""
    mesh = history.mesh
    if not isinstance(mesh, PolyhedralMesh):
        raise HistoryError("contact_face: this body is plane; friction_traction and stick_slip_map draw its contact.")
    contact = require_contact(history, "contact_face")
    pairs = np.column_stack([contact.nodes, contact.partners])
    rows = {name: are_among(pairs, found.pairs) for name, found in mesh.interfaces.items()}
    rows["obstacles"] = contact.partners < 0
    known = [name for name, some in rows.items() if some.any()]
    if on is not None and on not in known:
        raise HistoryError(f"contact_face: there is no contact on {on!r}; give on={' or '.join(map(repr, known))}.")
    known = known if on is None else [on]
    # If the mean normal is nearly zero, no view shows the whole face.
    means = {name: contact.normals[rows[name]].mean(axis=0) for name in known}
    return {name: _face(history, rows[name], mean) for name, mean in means.items() if np.linalg.norm(mean) >= 0.5}


def _face(history: Results, rows: Bools, normal: Floats) -> ContactFace:
    contact, mesh = history.contact.take(np.flatnonzero(rows)), history.mesh
    assert isinstance(mesh, PolyhedralMesh)
    frame, labels = _frame(normal)
    corners, owners = _parts(contact, mesh)
    return ContactFace(replace(history, contact=contact), frame, labels, corners @ frame.T, owners)


def _frame(mean: Floats) -> tuple[Floats, tuple[str, str]]:
    length, axis = np.linalg.norm(mean), int(np.argmax(np.abs(mean)))
    right, up = (k for k in range(3) if k != axis)
    if abs(mean[axis]) > (1 - SAME) * length:
        return np.eye(3)[[right, up]], (f"$x_{right + 1}$", f"$x_{up + 1}$")
    along = np.eye(3)[right] - mean[right] / length**2 * mean
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(mean / length, along)]), ("right", "up")


def _parts(contact: Contact, mesh: PolyhedralMesh) -> tuple[Floats, Ints]:
    normal, joined = np.zeros_like(mesh.points), contact.partners >= 0
    normal[contact.nodes] = contact.normals
    # Row 0: contact with obstacles. Row 1: contact at interfaces.
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
    step: int | None = None,
    *,
    on: str | None = None,
    ax: Axes | None = None,
    show: str = "states",
    window: Window | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the faces of contact in space at a stored step, seen along the mean normal.

    Parameters
    ----------
    history, step, ax, units : as for `friction_traction`
    on : str, optional
        An interface, or "obstacles"; by default there is a panel for each interface and one for all obstacles.
    show : {"states", "pressure", "friction", "wear"}
        Colours show stick, slip and open contact, or the size of a field.
    window : ((low, high), (low, high)), optional
        Draw only this part, in units of length.

    Returns
    -------
    matplotlib Figure
        Each node colours a part of the face. Arrows show the slip of the first body since the last stored step. The
        title contains the largest slip.

    Raises
    ------
    SceneError, HistoryError
        The body is plane, no face of contact is visible, `ax` is given for several faces, the step was not stored, or
        an argument is invalid.

    Examples
    --------
    >>> base = vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement((0.01, 0.0, -0.01), on="top")
    >>> scene = vx.Scene(*base, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"))
    >>> history = vx.simulate(scene, vx.meshes.cubes(2), [0.0, 1.0], initial="settled")
    >>> figure = vx.plots.contact_face(history, show="pressure")
    """
    units = units_of(history, units)
    row = history.row(step)
    choice(show, "contact_face", "show", ["states", *FIELDS], HistoryError)
    window = style.window_of(window)
    for panel, name, face in _panels(history, on, ax):
        if show == "states":
            _fill_states(panel, face, row)
        else:
            quantity, words, values = FIELDS[show]
            found, drawn = values(face.history), canvas.draw_polygons(panel, face.corners, None)
            drawn.set_array(found[row, face.owners])
            drawn.set(cmap=style.SIZE, clim=(min(0.0, float(found.min())), float(found.max()) or 1.0))
            canvas.colour_bar(panel, drawn, label(words, quantity, units))
        title = f"{name}{instant(history.times[row], units)}{_slip_arrows(panel, face, row, window, units)}"
        panel.locator_params(nbins=5)
        if window is None:
            panel.autoscale_view()
        x, y = (label(words, "length", units) for words in face.labels)
        figure = label_axes(panel, x, y, title, size="small", window=window, aspect="equal")
    return figure


def _panels(history: Results, on: str | None, ax: Axes | None) -> Iterator[tuple[Axes, str, ContactFace]]:
    faces = contact_faces(history, on)
    if not faces:
        raise HistoryError(f"contact_face: {HIDDEN}.")
    if ax is not None and len(faces) > 1:
        names = ", ".join(map(repr, faces))
        raise HistoryError(f"contact_face: ax= shows only one contact face; select one of {names} by on=.")
    panels = [ax] if ax is not None else canvas.row_of_axes(len(faces), 6.0, 5.0)
    for panel, (name, face) in zip(panels, faces.items(), strict=True):
        yield panel, f"{name}, " * (len(faces) > 1), face


def _states(face: ContactFace, row: int) -> Ints:
    contact = face.history.contact
    return np.where(is_idle(face.history)[row], 2, np.where(contact.sticking[row], 0, 1))


def _fill_states(ax: Axes, face: ContactFace, row: int) -> None:
    states, colours = _states(face, row), list(AREAS.values())
    canvas.draw_polygons(ax, face.corners, [colours[state] for state in states[face.owners]])
    for state, (words, colour) in enumerate(AREAS.items()):
        if (states == state).any():
            ax.plot([], [], "s", color=colour, markeredgecolor="0.6", markersize=8, label=words)
    canvas.legend_under(ax)


def _slip_arrows(ax: Axes, face: ContactFace, row: int, window: Window | None, units: Units) -> str:
    """Draw the slips of a step, and return the largest slip in words."""
    contact, stored, places = face.history.contact, face.history.stored, face.places
    shown = np.flatnonzero((_states(face, row) == 1) & within(places, window) & (row > 0))
    moved = face.flat(contact.slip[row] - contact.slip[max(row - 1, 0)])[shown]
    size = float(np.ptp(places if window is None else np.transpose(window), axis=0).max())
    size = size or float(np.ptp(face.corners, axis=(0, 1)).max())
    places, largest = places[shown], float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if largest == 0.0:
        return ""
    # Draw at most one arrow in each square of width size / 14.
    _, kept = np.unique(np.floor((places - places.min(axis=0)) * 14 / size + 0.5), axis=0, return_index=True)
    arrows = moved[kept] * 0.085 * size / largest
    canvas.draw_arrows(ax, places[kept], arrows, colour=style.PUSH, pivot="mid", width=0.005).set_in_layout(False)
    since = "of the step" if stored[row - 1] == stored[row] - 1 else "since the last stored step"
    return f", slip {since} at most {amount(largest, 'length', units)}"
