"""A scene: what is to be simulated, free of any mesh."""

from __future__ import annotations

from collections.abc import Iterator

from vemcvx.effects import Effect, Elasticity
from vemcvx.errors import SceneError


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
                hint = " (an effect's class: call it, to make an effect)" if isinstance(effect, type) else ""
                raise SceneError(
                    f"Scene: found {effect!r}{hint}, which is not an effect; a scene is made of effects such as "
                    "Elasticity, Clamp, Traction, BilateralContact, TrescaFriction."
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
        return tuple(sorted(self._effects, key=lambda effect: (type(effect).__name__, repr(effect))))

    def __iter__(self) -> Iterator[Effect]:
        return iter(self._effects)

    def __repr__(self) -> str:
        return "Scene(\n" + "".join(f"    {effect!r},\n" for effect in self._effects) + ")"
