"""A scene: what is to be simulated, free of any mesh."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vemcvx.arrays import brief
from vemcvx.effects import Effect, MaterialLaw
from vemcvx.errors import SceneError
from vemcvx.outline import Outline


class Scene:
    """A set of effects: materials, and whatever supports, loads, contact and friction it calls for.

    The order of the effects changes nothing; a scene runs on every mesh that has the boundaries it names.

    Parameters
    ----------
    *effects : Effect
        At least one of them a material; several name their cells by `on`, so that every cell has exactly one.

    Raises
    ------
    SceneError
        Something is not an effect, or there is no material.

    Examples
    --------
    >>> import vemcvx as vx
    >>> scene = vx.Scene(vx.Elasticity(young=200.0, poisson=0.3), vx.Clamp(on="right"))
    """

    def __init__(self, *effects: Effect):
        self._effects = _checked(effects)
        self.require_material()

    @classmethod
    def _unfinished(cls, effects: tuple[Effect, ...]) -> Scene:
        """A scene that may lack a material as yet."""
        scene = cls.__new__(cls)
        scene._effects = _checked(effects)
        return scene

    def require_material(self) -> None:
        """Raise SceneError if the scene has no material: it cannot run."""
        if not any(isinstance(effect, MaterialLaw) for effect in self._effects):
            raise SceneError(
                "Scene: found 0 materials; a scene has at least one, such as Elasticity(young=200.0, poisson=0.3)."
            )

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, in the order given."""
        return self._effects

    @property
    def canonical(self) -> tuple[Effect, ...]:
        """The effects in the order in which they are summed, the same for every permutation."""
        return tuple(sorted(self._effects, key=_rank))

    def with_(self, *effects: Effect) -> Scene:
        """The scene with these effects besides its own."""
        return self._unfinished((*self._effects, *effects))

    def without(self, *kinds: type[Effect] | Effect) -> Scene:
        """The scene without all effects of these classes, or without these very effects.

        Without its material a scene is unfinished: it runs once :meth:`Scene.with_` has given it another.

        Parameters
        ----------
        *kinds : subclass of Effect, or Effect

        Raises
        ------
        SceneError
            The scene has no such effect.
        """
        for kind in kinds:
            if not (isinstance(kind, Effect) or (isinstance(kind, type) and issubclass(kind, Effect))):
                raise SceneError(
                    f"Scene.without: found {brief(kind)}; give the class of an effect, such as "
                    "vemcvx.TrescaFriction, or an effect of the scene."
                )
            if not any(_is(effect, kind) for effect in self._effects):
                there = ", ".join(dict.fromkeys(type(effect).__name__ for effect in self._effects))
                name = kind.__name__ if isinstance(kind, type) else brief(kind)
                raise SceneError(f"Scene.without: there is no {name} in this scene; it has {there}.")
        return self._unfinished(
            tuple(effect for effect in self._effects if not any(_is(effect, kind) for kind in kinds))
        )

    def __iter__(self) -> Iterator[Effect]:
        return iter(self._effects)

    def __repr__(self) -> str:
        return "Scene(\n" + "".join(f"    {effect!r},\n" for effect in self._effects) + ")"

    def _repr_html_(self) -> str:
        said = [effect.describe().partition(": ") for effect in self._effects]
        return Outline("Scene", [(name, words) for name, _, words in said]).html()


def _checked(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    for effect in effects:
        if not isinstance(effect, Effect):
            raise SceneError(
                f"Scene: found {_found(effect)}; a scene is made of effects, one by one, such as "
                'Scene(Elasticity(young=200.0, poisson=0.3), Clamp(on="right")).'
            )
    return effects


def _is(effect: Effect, kind: type[Effect] | Effect) -> bool:
    return isinstance(effect, kind) if isinstance(kind, type) else effect is kind


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
    if isinstance(setting, (tuple, list)) and any(map(callable, setting)):
        return b", ".join(map(_content, setting))
    if callable(setting):
        line = getattr(getattr(setting, "__code__", None), "co_firstlineno", 0)
        return f"{getattr(setting, '__module__', '')}.{getattr(setting, '__qualname__', '')}:{line:09}".encode()
    return repr(setting).encode()
