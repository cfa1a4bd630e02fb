"""Samples of effects, in scenes in which they do something, and everything that they contribute as plain data."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.effects import Effect, GivenDatum, MaterialLaw
from vemcvx.history import History
from vemcvx.meshes import FAMILIES, PolygonMesh
from vemcvx.scene import Scene
from vemcvx.simulation import simulate

TIMES = np.array([0.0, 0.4, 1.0])


@dataclass(frozen=True)
class Other:
    """Another value of a field that asks for more: for changes of other fields, or for effects beside."""

    value: object
    changes: Mapping[str, object] = field(default_factory=dict)
    beside: tuple[Effect, ...] = ()


@dataclass(frozen=True)
class EffectSample:
    """An effect, and a scene in which it does something, on a square mesh of the unit square.

    Parameters
    ----------
    effect : Effect
    beside : tuple of Effect
        What stands in the scene beside it.
    instead : tuple of Effect
        What stands in its place when it is left out.
    data : mapping of names to numbers
        The fields that carry data f(x, t), or f(x), and the number of components of each.
    others : mapping of names to values
        For every field another value, with which the answer differs; :class:`Other` where that asks for more.
    pairs : tuple of str
        Names of the fields whose value is a pair of data.
    """

    effect: Effect
    beside: tuple[Effect, ...]
    instead: tuple[Effect, ...] = ()
    data: Mapping[str, int] = field(default_factory=dict)
    others: Mapping[str, object] = field(default_factory=dict)
    pairs: tuple[str, ...] = ()

    def with_datum(self, name: str, value: object) -> Effect:
        """The effect with a datum replaced; in a pair the second."""
        first = getattr(self.effect, name)
        return self.changed(**{name: (first[0], value) if name in self.pairs else value})

    def changed(self, **fields: object) -> Effect:
        """The effect with other fields."""
        effect: Any = self.effect
        changed: Effect = dataclasses.replace(effect, **fields)
        return changed

    @property
    def name(self) -> str:
        """The name of its class."""
        return type(self.effect).__name__

    @property
    def fields(self) -> list[str]:
        """The names of its fields."""
        effect: Any = self.effect
        return [setting.name for setting in dataclasses.fields(effect)]

    @property
    def on(self) -> list[str] | None:
        """The boundaries that it is on; None if it is on none."""
        effect: Any = self.effect
        return list(np.atleast_1d(effect.on)) if hasattr(effect, "on") and not isinstance(effect, MaterialLaw) else None


@cache
def mesh(family: str = "squares", n: int = 3) -> PolygonMesh:
    """A mesh of the unit square, with the cell data "west" and "east"."""
    made: PolygonMesh = FAMILIES[family](n)
    west = made.centroids[:, 0] < 0.5
    return made.with_cell_data("west", west).with_cell_data("east", ~west)


def answer(*effects: Effect, on: PolygonMesh | None = None) -> History:
    """The history of a scene of these effects."""
    return simulate(Scene(*effects), on or mesh(), TIMES)


def content(thing: Any, rows: int = 1) -> Any:
    """Everything that a contribution says, as comparable plain data; functions by their values, of so many rows."""
    if isinstance(thing, GivenDatum):
        values = tuple(content(_at_places(thing, t)) for t in TIMES)
        return thing.kind, content(thing.edges), content(thing.cells), values
    if dataclasses.is_dataclass(thing):
        rows = len(getattr(thing, "nodes", range(rows)))
        told = {f.name: content(getattr(thing, f.name), rows) for f in dataclasses.fields(thing) if f.name != "value"}
        return told | {"at": _at_times(thing)}
    if isinstance(thing, (sp.csr_matrix, sp.csr_array)):
        return content((thing.shape, thing.indptr, thing.indices, thing.data))
    if isinstance(thing, np.ndarray):
        return thing.shape, thing.dtype.str, thing.tobytes()
    if isinstance(thing, tuple):
        return tuple(content(part, rows) for part in thing)
    if callable(thing):
        # Functions of friction take forces, and slips, of all rows.
        more = [np.full(rows, 0.5)] * (len(inspect.signature(thing).parameters) - 1)
        return tuple(content(thing(t, *more)) for t in TIMES)
    return thing


def _at_places(given: GivenDatum, t: float) -> Any:
    """A datum as a function of place, at points of the first cell."""
    x, cells = np.random.default_rng(0).uniform(0.0, 0.3, (5, 2)), np.zeros(5, dtype=np.int64)
    more: dict[str, tuple[Any, ...]] = {
        "bound": (t, np.ones(5)),
        "spring": (t, np.ones(5)),
        "foundation": (),
        "moduli": (cells,),
        "eigenstrain": (cells, t),
    }
    return given.value(x, *more.get(given.kind, (t,)))


def _at_times(thing: Any) -> Any:
    """A load or a support as a function of time."""
    if hasattr(thing, "vector"):
        return tuple(content(thing.vector(t)) for t in TIMES)
    return content(thing.value) if callable(getattr(thing, "value", None)) else None


def nameless(thing: Any) -> Any:
    """Content without the words that name its subject."""
    if isinstance(thing, dict):
        return {name: nameless(value) for name, value in thing.items() if name != "subject"}
    return tuple(map(nameless, thing)) if isinstance(thing, tuple) else thing
