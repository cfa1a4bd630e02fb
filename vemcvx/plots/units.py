"""Names of units in the labels of pictures; what has none given is named by what it is."""

from __future__ import annotations

from collections.abc import Mapping

from vemcvx.arrays import brief
from vemcvx.errors import HistoryError

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
