"""A scene: what is to be simulated, free of any mesh."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vemcvx.effects import Effect, Elasticity
from vemcvx.errors import SceneError
from vemcvx.real import brief


class Scene:
    """A set of effects: one material, and whatever supports, loads, contact and friction it calls for.

    The order of the effects changes nothing; a scene runs on every mesh that has the boundaries it names.

    Parameters
    ----------
    *effects : Effect
        Exactly one of them an Elasticity.

    Raises
    ------
    SceneError
        Something is not an effect, or there is not exactly one material.

    Examples
    --------
    >>> import vemcvx as vx
    >>> scene = vx.Scene(vx.Elasticity(young=200.0, poisson=0.3), vx.Clamp(on="right"))
    """

    def __init__(self, *effects: Effect):
        for effect in effects:
            if not isinstance(effect, Effect):
                raise SceneError(
                    f"Scene: found {_found(effect)}; a scene is made of effects, one by one, such as "
                    'Scene(Elasticity(young=200.0, poisson=0.3), Clamp(on="right")).'
                )
        materials = sum(isinstance(effect, Elasticity) for effect in effects)
        if materials != 1:
            raise SceneError(
                f"Scene: found {materials} materials; a scene has exactly one, such as "
                "Elasticity(young=200.0, poisson=0.3). Moduli may vary from cell to cell."
            )
        self._effects = tuple(effects)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, in the order given."""
        return self._effects

    @property
    def canonical(self) -> tuple[Effect, ...]:
        """The effects in the order in which they are summed, the same for every permutation."""
        return tuple(sorted(self._effects, key=_rank))

    def __iter__(self) -> Iterator[Effect]:
        return iter(self._effects)

    def __repr__(self) -> str:
        return "Scene(\n" + "".join(f"    {effect!r},\n" for effect in self._effects) + ")"


def _found(thing: object) -> str:
    if isinstance(thing, type) and issubclass(thing, Effect):
        return f"{thing.__name__}, the class, where an effect {thing.__name__}(...) is wanted"
    return f"{brief(thing)}, which is not an effect"


def _rank(effect: Effect) -> tuple[str, list[bytes], list[int]]:
    settings = list(vars(effect).values())
    # Functions by where they are written, so that two runs of one script sum alike; their addresses decide last.
    return type(effect).__name__, [_content(v) for v in settings], [id(v) for v in settings if callable(v)]


def _content(setting: object) -> bytes:
    if isinstance(setting, np.ndarray):
        # Printed, arrays are cut short and rounded to eight digits.
        return setting.tobytes()
    if callable(setting):
        line = getattr(getattr(setting, "__code__", None), "co_firstlineno", 0)
        return f"{getattr(setting, '__module__', '')}.{getattr(setting, '__qualname__', '')}:{line:09}".encode()
    return repr(setting).encode()
