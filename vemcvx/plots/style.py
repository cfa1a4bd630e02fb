"""Colours, units and scales that pictures share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats, brief
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons.topology import directed_edges
from vemcvx.results.results import Results

# Colours by what they mean, apart for colour-blind eyes (after Okabe and Ito) and, as areas, in grey print.


STICK, SLIP = "#0072B2", "#D55E00"
STICK_AREA, FORWARD, BACKWARD = "#B3D7EE", "#D55E00", "#3B1C6B"
"""Areas: light, middle, dark; slip towards larger and towards smaller positions."""
SLIP_AREA, OPEN_AREA = "#F6CDB0", "#EDEDED"
WORK, STORED, DISSIPATED, NUMERICAL = "#000000", "#0072B2", "#D55E00", "#009E73"
OUTLINE = "0.45"
COMPUTED, EXACT = "#0072B2", "#000000"
SECOND, THIRD = "#D55E00", "#009E73"
"""Marks of what was computed, the line of a closed form, and further curves beside these."""
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#3B1C6B", "#000000")
MARKERS = "osD^vPX*"
"""Many series: colours, and marks for print without them."""
PUSH = "0.2"
SIGNED, TENSION, COMPRESSION, SIZE = "RdBu_r", "Reds", "Blues_r", "viridis"
"""Colour maps: tension red and compression blue, both or one; and of what has no sign."""
EARLY_TO_LATE = ("#D8D8D8", "#9FC9E2", "#0072B2", "#3B1C6B")
"""Curves of ever later instants: ever darker."""


# Names of units in the labels of pictures; what has none given is named by what it is.


Units = Mapping[str, str]
DERIVED = {
    "force per length": "{force}/{length}",
    "force per area": "{force}/{length}$^2$",
    "energy": "{force} {length}",
    "energy per length": "{force} {length}/{length}",
    "energy per area": "{force} {length}/{length}$^2$",
}
QUANTITIES = ("length", "force", "time", *DERIVED)


def unit(units: Units | None, quantity: str) -> str:
    """The name of the unit of a quantity: as given, put together from force and length, or the quantity itself."""
    given = checked_units(units)
    if quantity in given:
        return given[quantity]
    if quantity in DERIVED and {"force", "length"} <= set(given):
        return DERIVED[quantity].format(**given)
    return quantity


def instant(t: float, units: Units | None) -> str:
    """An instant in words, with the name of its unit if it has one."""
    given = checked_units(units)
    return f"t = {t:.4g} {given['time']}" if "time" in given else f"t = {t:.4g}"


def checked_units(units: Units | None) -> Units:
    """Units as given, none for None, or HistoryError if they are no mapping from known quantities to words."""
    if units is None:
        return {}
    known = ", ".join(map(repr, QUANTITIES))
    if not isinstance(units, Mapping):
        raise HistoryError(f"units: found {brief(units)}; wanted a mapping such as {{'length': 'mm'}} of {known}.")
    for name, word in units.items():
        if name not in QUANTITIES or not isinstance(word, str):
            raise HistoryError(f"units: found {brief(name)}: {brief(word)}; wanted words for {known}.")
    return units


# One scale for all stored steps of a history: how far displacements are magnified, and what values and places span.
#
# Pictures of different steps can so be laid side by side, or be the frames of a film.


SHOWN = 0.15
"""Displacements are magnified to about this part of the body's size at most."""
MOST_STRAIN, STRAINED_EDGES = 0.5, 99.0
"""Edges may move by this part of their length, all but one in a hundred: more turns cells inside out."""

Range = tuple[float, float]


def rounded_down(wanted: float, largest: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that keeps `largest` times it within `wanted`; 1 of nothing."""
    if not largest > 0.0 or not np.isfinite(wanted / largest):
        return 1.0
    factor = wanted / largest
    power = 10.0 ** np.floor(np.log10(factor))
    # Powers of ten are rounded: 1 + 1e-9 keeps a wanted 5 from becoming 2.
    return float(max(f for f in (power, 2 * power, 5 * power) if f <= factor * (1 + 1e-9)))


def common_magnification(history: Results, size: float, magnify: float | None, nodes: Bools | None = None) -> float:
    """The magnification of the displacements of all stored steps: as asked, or so that `nodes` stay in the picture."""
    if magnify is not None:
        return _positive(magnify)
    kept = slice(None) if nodes is None else nodes
    largest = max(float(np.linalg.norm(u[kept], axis=1).max(initial=0.0)) for u in history.displacement)
    whole = rounded_down(SHOWN * size, largest)
    return min(whole, rounded_down(MOST_STRAIN, _stretch(history))) if largest > 0.0 else 1.0


def _positive(raw: object) -> float:
    if not isinstance(raw, (int, float, np.number)) or isinstance(raw, bool) or not 0 < float(raw) < np.inf:
        raise HistoryError(
            f"magnify: found {brief(raw)}; wanted a positive number, or None for one that suits all steps."
        )
    return float(raw)


def _stretch(history: Results) -> float:
    """The stretch and turn of edges, relative to their lengths."""
    mesh = history.mesh
    # Edges are those of polygons: cells of the plane, faces in space.
    polygons = (
        (mesh.face_offsets, mesh.face_vertices) if isinstance(mesh, PolyhedralMesh) else (mesh.offsets, mesh.vertices)
    )
    ends = np.unique(np.sort(directed_edges(*polygons), axis=1), axis=0)
    lengths = np.linalg.norm(mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]], axis=1)
    return max(
        float(np.percentile(np.linalg.norm(u[ends[:, 1]] - u[ends[:, 0]], axis=1) / lengths, STRAINED_EDGES))
        for u in history.displacement
    )


def extent(history: Results, factor: float) -> Floats:
    """(2, dim) lowest and highest corner of all that the body fills, undeformed and at all stored steps."""
    places = [history.mesh.points, *(history.mesh.points + factor * u for u in history.displacement)]
    return np.array([np.min([p.min(axis=0) for p in places], axis=0), np.max([p.max(axis=0) for p in places], axis=0)])


def value_range(limits: ArrayLike | None, default: Iterable[float]) -> Range:
    """The two ends of a range of values: as asked, or else the default; HistoryError if they are not two that grow."""
    if limits is None:
        low, high = default
        return float(low), float(high)
    try:
        low, high = (float(end) for end in np.asarray(limits))
    except (TypeError, ValueError):
        low = high = np.nan
    if not -np.inf < low < high < np.inf:
        raise HistoryError(f"limits: found {brief(limits)}; wanted two numbers, the smaller one first.")
    return low, high
