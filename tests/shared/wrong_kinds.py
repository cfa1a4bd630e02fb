"""Values of every wrong kind, and every place of the package where a user can hand one in."""

from __future__ import annotations

import datetime
import decimal
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

import vemcvx as vx


class Hostile:
    """Raises whatever it is asked for."""

    def _refuse(self, *_: object, **__: object) -> Any:
        raise RuntimeError("hostile")

    __array__ = __float__ = __int__ = __index__ = __len__ = __iter__ = __bool__ = __eq__ = _refuse
    __hash__ = None


def endless() -> list[Any]:
    """A list that contains itself."""
    inner: list[Any] = []
    inner.append(inner)
    return inner


def leave(*_: object) -> None:
    sys.exit(0)


def exhaust(*_: object) -> None:
    raise MemoryError


NUMBERS: dict[str, Any] = {"zero": 0.0, "minus one": -1.0, "a half": 0.5, "two and a half": 2.5, "seven": 7}
WRONG: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "NaN": lambda: np.nan,
    "infinity": lambda: np.inf,
    "no words": lambda: "",
    "a word": lambda: "a",
    "a number in words": lambda: "1",
    "a flag in words": lambda: "False",
    "bytes": lambda: b"",
    "no list": list,
    "no dict": dict,
    "a set": lambda: {1.0},
    "an object": object,
    "a class": lambda: int,
    "complex": lambda: 1j,
    "Decimal": lambda: decimal.Decimal(1),
    "datetime": lambda: datetime.datetime(2020, 1, 1),
    "timedelta": lambda: datetime.timedelta(seconds=1),
    "timedelta of numpy": lambda: np.timedelta64(3, "s"),
    "timedeltas": lambda: np.array([3, 4], dtype="m8[s]"),
    "datetimes": lambda: np.array(["2020-01-01"], dtype="M8[D]"),
    "a masked array": lambda: np.ma.masked_array([1.0, 2.0], [False, True]),
    "masked": lambda: [np.ma.masked, 1.0],
    "flags": lambda: np.array([True, False]),
    "an array": lambda: np.array([1.0, 2.0]),
    "an array of words": lambda: np.array(["a", "b"]),
    "an array of objects": lambda: np.array([object()]),
    "a record": lambda: np.zeros(2, dtype=[("a", float)]),
    "no array": lambda: np.zeros(0),
    "an array of one word": lambda: np.array("a"),
    "a cube": lambda: np.zeros((3, 3, 3)),
    "a sparse matrix": lambda: sp.csr_matrix(np.eye(2)),
    "ragged": lambda: [[1.0], [1.0, 2.0]],
    "endless": endless,
    "huge": lambda: 10**400,
    "negative": lambda: -(10.0**9),
    "a generator": lambda: (x for x in (1.0, 2.0)),
    "hostile": Hostile,
    "hostile inside": lambda: [Hostile()],
    "without arguments": lambda: lambda: 1.0,
    "gives None": lambda: lambda *_: None,
    "gives words": lambda: lambda *_: "1",
    "gives NaN": lambda: lambda *_: np.nan,
    "gives masked": lambda: lambda *_: np.ma.masked_array([1.0, 2.0], [False, True]),
    "gives hostile": lambda: lambda *_: Hostile(),
    "leaves": lambda: leave,
    "out of memory": lambda: exhaust,
}


MESH = vx.meshes.squares(1)
STEEL = vx.Elasticity(200.0, 0.3)
HELD = vx.Clamp("right")
PUSH = vx.Traction(lambda x, t: np.tile([t, -t], (len(x), 1)), "left")
PRESSED = vx.Pressure(lambda x, t: t * np.ones(len(x)), "top")
K = np.array([[4.0, -1.0], [-1.0, 3.0]])


def run(*effects: Any, **options: Any) -> vx.History:
    return vx.simulate(vx.Scene(*effects), MESH, options.pop("times", [0.0, 1.0]), **options)


def load(t: float) -> Any:
    return np.array([t, -2 * t])


def marched(system: Any = None, times: Any = (0.0, 1.0), **options: Any) -> vx.Trajectory:
    return vx.march(vx.System(K, load) if system is None else system, times, **options)
