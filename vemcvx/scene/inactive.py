"""Effects without influence are dropped and reported.

They are a load that is zero at every instant, friction whose bound is, ground that does not move along the boundary,
springs and dashpots without strength. The scene without them has the same unknowns, terms and cones, and the same
answer to the last bit. Supports and outputs of contact stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from vemcvx.arrays import Bools, Floats, fading
from vemcvx.effects import Contribution, Effect, Eigenstrain, Friction, InitialStress, Load
from vemcvx.errors import VemcvxError
from vemcvx.program.motion import DRAG_ROUNDING
from vemcvx.scene.freedom import along
from vemcvx.scene.mirrors import contributions
from vemcvx.vem import Space, tangents_of

Varying = TypeVar("Varying", Load, Friction, Eigenstrain, InitialStress)
# A force of contact under which friction that depends on pressure shows itself, whatever the units.
PRESSED = 1e100


def active_parts(
    effects: Iterable[Effect], space: Space, times: Sequence[float]
) -> tuple[list[Contribution], list[str]]:
    """What the effects contribute, without what is zero at all of `times`; a sentence for each thing dropped."""
    said: list[str] = []
    return [_without_inactive(effect, part, times, said) for effect, part in contributions(effects, space)], said


def _without_inactive(effect: Effect, part: Contribution, times: Sequence[float], said: list[str]) -> Contribution:
    """What an effect contributes without what is zero at all of `times`; a sentence is added for each thing dropped.

    Data are evaluated until the first instant at which they are not zero; without instants they are all kept.
    """

    def alive(
        data: tuple[Varying, ...], value: Callable[[Varying], Callable[[float], Floats]], what: str
    ) -> tuple[Varying, ...]:
        zero = [len(times) > 0 and _zero(value(datum), times) for datum in data]
        said.extend(f"{data[i].subject}: its {what} is zero at all instants" for i in np.flatnonzero(zero))
        return tuple(data[i] for i in np.flatnonzero(~np.array(zero, dtype=bool)))

    matrices = () if part.material is not None else ("stiffness", "viscosity")
    weak = [name for name in matrices if (A := getattr(part, name)) is not None and not A.data.any()]
    none: dict[str, Any] = dict.fromkeys(weak)
    said.extend(f"{type(effect).__name__}: its {name} is zero" for name in weak)
    return replace(
        part,
        **none,
        loads=tuple(replace(x, times=tuple(times)) for x in alive(part.loads, lambda load: load.vector, "force")),
        supports=tuple(x if x.value is None else replace(x, value=fading(x.value, times)) for x in part.supports),
        frictions=tuple(_grounded(f, times, said) for f in alive(part.frictions, _bound, "bound")),
        eigenstrains=tuple(
            replace(x, value=fading(x.value, times)) for x in alive(part.eigenstrains, lambda x: x.value, "strain")
        ),
        initial_stresses=tuple(
            replace(x, value=fading(x.value, times)) for x in alive(part.initial_stresses, lambda x: x.value, "stress")
        ),
    )


def _grounded(friction: Friction, times: Sequence[float], said: list[str]) -> Friction:
    """The friction, its ground left out if it is where it was along the boundary at all of `times`."""
    ground = friction.ground
    if ground is None or len(times) == 0:
        return friction
    start = float(times[0])

    # Directions that are given are checked where norm terms are made of them.
    tangents = None if friction.directions is not None else tangents_of(friction.normals)

    def rubs(t: float) -> Bools:
        began, at = ground.vector(start), ground.vector(t)
        if tangents is None:
            return np.asarray(at != began)
        size = max(np.abs(began).max(initial=0.0), np.abs(at).max(initial=0.0))
        drags: Bools = np.abs(along(tangents, at - began)) > DRAG_ROUNDING * size
        return drags

    if not _zero(rubs, times):
        return friction
    still = _zero(lambda t: ground.vector(t) - ground.vector(start), times)
    does = "stands still at all instants" if still else "moves along the normal only, which friction does not feel"
    said.append(f"{ground.subject} {does}")
    return replace(friction, ground=None)


def _bound(friction: Friction) -> Callable[[float], Floats]:
    law = friction.law
    if friction.slip_law is not None:
        return lambda t: np.ones(1)  # What it is once there is slip, nobody knows beforehand.
    if law is None:
        return friction.weights
    pressed = np.full(len(friction.nodes), PRESSED)
    return lambda t: friction.weights(t) + law(t, pressed)


def _zero(value: Callable[[float], Floats | Bools], times: Sequence[float]) -> bool:
    try:
        return not any(np.any(value(float(t))) for t in times)
    except VemcvxError:
        return False  # The step that needs the datum says what is wrong with it.
