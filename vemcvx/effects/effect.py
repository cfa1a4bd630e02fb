"""The base of effects: settings of a piece of physics, and one pure method that turns them into arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from vemcvx.arrays import brief, read_only
from vemcvx.effects.contribution import Contribution
from vemcvx.vem import Space


class Effect(ABC):
    """One piece of physics of a scene, free of any mesh.

    Effects are frozen: names of boundaries, constants and callables. They know nothing of each other, of
    solvers or of time stepping, and the order in which a scene names them changes nothing. Arrays are copied when an
    effect is made: what becomes of those given later changes nothing either.
    """

    def __post_init__(self) -> None:
        """Keep copies of arrays and lists; subclasses that are no dataclasses need not call it."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value.copy()))
            elif type(value) is list:
                object.__setattr__(self, name, [x.copy() if isinstance(x, np.ndarray) else x for x in value])

    @abstractmethod
    def contribute(self, space: Space) -> Contribution:
        """The contribution of this effect on the mesh of `space`.

        Pure: equal calls give equal arrays. Nothing is evaluated in time here; data f(x, t) are carried
        along and evaluated at t_n. Effects of contact are asked again with the planes of symmetry that the supports
        of the scene make (`space.mirrors`), which turn normals at the ends of curves.

        Raises
        ------
        SceneError
            A boundary's name is unknown, or a datum that does not depend on time has a wrong shape,
            sign or value.
        """

    @abstractmethod
    def describe(self) -> str:
        """One line of words for `vemcvx show`."""


def where(on: str | Sequence[str]) -> str:
    """The boundary names of `on` in words; what is no name is refused later, by name, on the mesh."""
    return ", ".join(map(str, on)) if isinstance(on, Sequence) and not isinstance(on, str) else str(on)


def amount(value: object, arguments: str = "x, t") -> str:
    """A datum in words, in one line: its number, or how it varies."""
    if callable(value):
        return f"{getattr(value, '__name__', 'function')}({arguments})"
    if isinstance(value, np.ndarray) and value.size > 3:
        return f"array of shape {value.shape}"
    return str(value) if isinstance(value, (float, int, np.ndarray)) else brief(value)
