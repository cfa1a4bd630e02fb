"""The common style of all pictures: colours, labels and scales.

Colour-blind readers can tell the colours apart (Okabe and Ito). Areas also differ in grey print. Labels contain the
units, or quantities if the units have no names. Magnifications and colour scales are the same at all steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import ROUNDING, SAME, Bools, Floats, as_shaped_array, brief, is_real
from vemcvx.base.canvas import figure_of
from vemcvx.base.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons import corner_edges
from vemcvx.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STICK, SLIP = "#0072B2", "#D55E00"
STICK_AREA, FORWARD, BACKWARD = "#B3D7EE", "#D55E00", "#3B1C6B"
"""Colours of areas: stick (light), slip towards larger positions (middle), slip towards smaller positions (dark)."""
SLIP_AREA, OPEN_AREA = "#E59866", "#F7F7F7"
WORK, STORED, DISSIPATED, NUMERICAL = "#000000", "#0072B2", "#D55E00", "#009E73"
OUTLINE, PUSH = "0.45", "0.2"
COMPUTED, SECOND, THIRD = "#0072B2", "#D55E00", "#009E73"
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#3B1C6B", "#000000")
MARKERS = "osD^vPX*"  # markers of curves, for grey print
TENSION, COMPRESSION, SIZE = "Reds", "Blues_r", "viridis"  # colour maps; SIZE is for fields without a sign
SIGNED = ("#C8EEFF", "#52B5F2", "#8F8F94", "#C0392B", "#5A0012")
"""Colours from compression (light) to tension (dark)."""
EARLY_TO_LATE = ("#BDBDBD", "#9FC9E2", "#0072B2", "#3B1C6B")  # colours of curves, darker with time

Units = Mapping[str, str]
Window = tuple[tuple[float, float], tuple[float, float]]
DERIVED = {
    "force per length": "{force}/{length}",
    "force per area": "{force}/{length}²",
    "energy": "{force} {length}",
    "energy per length": "{force} {length}/{length}",
    "energy per area": "{force} {length}/{length}²",
}
THICKNESS = {"force per length": "force per area", "energy per length": "energy per area"}
"""Quantity per length -> quantity per length and thickness."""
WORDS = {
    "force/length": "force per length",
    "force/length²": "force per area",
    "force × length": "energy",
    "energy/length": "energy per length",
    "energy/length²": "energy per area",
}
"""Unit in tables -> quantity."""
QUANTITIES = ("length", "force", "time", *DERIVED)


def units_of(history: Results, units: Units | None) -> Units:
    """Return `units`, or by default the units of the history."""
    return check_units(history.units if units is None else units)


def unit(units: Units | None, quantity: str) -> str:
    """Return the unit of a quantity, or the quantity if it has no unit."""
    given = units or {}
    if quantity not in given and THICKNESS.get(quantity) in given:
        quantity = THICKNESS[quantity]
    if quantity not in given and quantity in DERIVED and {"force", "length"} <= set(given):
        return DERIVED[quantity].format(**given)
    return given.get(quantity, quantity)


def amount(value: float, quantity: str, units: Units) -> str:
    """Return a number with its unit in words."""
    return f"{value:.3g} {unit(units, quantity) if units else ''}".rstrip()


def in_units(product: str, units: Units | None) -> str:
    """Replace quantities in a unit such as "force/length²" by names of units."""
    return unit(units, WORDS.get(product, product)) if units else product


def label(words: str, quantity: str, units: Units | None) -> str:
    """Return words, and in brackets the unit of the quantity."""
    return f"{words}{'' if words.endswith(chr(10)) else ' '}({unit(units, quantity)})"


def instant(t: float, units: Units | None) -> str:
    """Return an instant with its unit in words."""
    return f"t = {t:.4g} {(units or {}).get('time', '')}".rstrip()


def check_units(units: Units | None, subject: str = "units") -> Units:
    """Return the names of units by quantity; raise HistoryError for unknown quantities."""
    if units is None:
        return {}
    known = ", ".join(map(repr, QUANTITIES))
    if not isinstance(units, Mapping):
        raise HistoryError(f"{subject}: found {brief(units)}; wanted a dict like {{'length': 'mm'}}; keys: {known}.")
    for name, word in units.items():
        if name not in QUANTITIES or not isinstance(word, str):
            raise HistoryError(f"{subject}: found {brief(name)}: {brief(word)}; wanted strings; known keys: {known}.")
    return units


def label_axes(
    ax: Axes, x: str, y: str, title: str, *, size: str = "large", window: Window | None = None, **more: Any
) -> Figure:
    """Set labels, title and the visible window of axes, and return their figure."""
    ax.set(xlabel=x, ylabel=y, **more)
    ax.set_title(title, fontsize=size)
    if window is not None:
        ax.set(xlim=window[0], ylim=window[1])
    return figure_of(ax)


def window_of(raw: ArrayLike | None) -> Window | None:
    """Return the visible intervals of both axes, or None for the whole plane."""
    if raw is None:
        return None
    wanted = "((low, high), (low, high)), the range of each axis"
    found = as_shaped_array(raw, "window", wanted, (2, 2))
    if not (np.isfinite(found).all() and (found[:, 0] < found[:, 1]).all()):
        raise HistoryError(f"window: found {brief(raw)}; wanted {wanted}.")
    (left, right), (bottom, top) = found.tolist()
    return (left, right), (bottom, top)


def within(points: Floats, window: Window | None) -> Bools:
    """Return a mask of the points (k, 2) inside a window."""
    low, high = np.transpose(window if window is not None else [[-np.inf, np.inf]] * 2)
    return np.all((points >= low) & (points <= high), axis=1)


def is_idle(history: Results) -> Bools:
    """Return a mask (steps, m) of open contact nodes without friction."""
    contact = history.contact
    friction = np.linalg.norm(contact.traction, axis=2)
    return np.asarray(~contact.closed & (friction <= ROUNDING * friction.max(initial=0.0)))


def round_down(wanted: float, largest: float) -> float:
    """Return the greatest f = 1, 2 or 5 times a power of ten with f * largest <= wanted."""
    if not largest > 0.0 or not np.isfinite(wanted / largest):
        return 1.0
    factor = wanted / largest
    power = 10.0 ** np.floor(np.log10(factor))
    # Without the tolerance SAME, rounding could turn 5 into 2.
    return float(max(f for f in (power, 2 * power, 5 * power) if f <= factor * (1 + SAME)))


def positive(raw: object, found: str, wanted: str) -> float:
    """Return a finite number above zero, or raise HistoryError."""
    if not is_real(raw) or not 0 < raw < np.inf:
        raise HistoryError(f"{found} {brief(raw)}; wanted {wanted}.")
    return float(raw)


def common_magnification(history: Results, size: float, magnify: float | None, nodes: Bools | None = None) -> float:
    """Return `magnify`, or by default a round magnification for all stored steps."""
    if magnify is not None:
        return positive(magnify, "magnify: found", "a positive number, or None for an automatic one")
    u, kept = history.displacement, slice(None) if nodes is None else nodes
    largest = max(float(np.linalg.norm(row[kept], axis=1).max(initial=0.0)) for row in u)
    if largest == 0.0:
        return 1.0
    mesh = history.mesh
    sides = (mesh.face_offsets, mesh.face_vertices) if isinstance(mesh, PolyhedralMesh) else mesh.cell_nodes
    a, b = np.unique(np.sort(corner_edges(*sides), axis=1), axis=0).T
    lengths = np.linalg.norm(mesh.points[b] - mesh.points[a], axis=1)
    # At least 99 % of the edges stretch by at most half their length.
    strain = max(float(np.percentile(np.linalg.norm(row[b] - row[a], axis=1) / lengths, 99.0)) for row in u)
    return min(round_down(0.15 * size, largest), round_down(0.5, strain))


def extent(history: Results, factor: float) -> Floats:
    """Return the lowest and highest coordinates (2, dim) of the body at all stored steps."""
    places = [history.mesh.points, *(history.mesh.points + factor * u for u in history.displacement)]
    return np.array([np.min([p.min(axis=0) for p in places], axis=0), np.max([p.max(axis=0) for p in places], axis=0)])
