"""Effects without influence are dropped before assembly and reported.

A load that is zero at every instant, friction whose bound is, springs and dashpots without strength: the scene
without them has the same unknowns, terms and cones, and the same answer to the last bit. Supports and outputs of
contact stay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.effects import Contribution, Effect, Friction, Obstacle
from vemcvx.errors import VemcvxError
from vemcvx.scene.freedom import normal_rows, on_free
from vemcvx.scene.jumps import Jumps
from vemcvx.scene.supports import Supports
from vemcvx.scene.terms import Terms

Said = list[str]


class Named(Protocol):
    """What has a name for messages."""

    @property
    def subject(self) -> str:
        """The name."""


T = TypeVar("T", bound=Named)
# A force of contact under which friction that depends on pressure shows itself, whatever the units.
PRESSED = 1e100


def without_inactive(effect: Effect, part: Contribution, times: Sequence[float], said: Said) -> Contribution:
    """What an effect contributes without what is zero at all of `times`; a sentence is added for each thing dropped.

    Data are evaluated until the first instant at which they are not zero; without instants they are all kept.
    """

    def alive(things: tuple[T, ...], value: Callable[[T], Callable[[float], Floats]], what: str) -> tuple[T, ...]:
        keep = [len(times) == 0 or not _zero(value(thing), times) for thing in things]
        said.extend(
            f"{thing.subject}: its {what} is zero at all instants"
            for thing, kept in zip(things, keep, strict=True)
            if not kept
        )
        return tuple(thing for thing, kept in zip(things, keep, strict=True) if kept)

    def strong(matrix: sp.csr_matrix | None, what: str) -> sp.csr_matrix | None:
        if matrix is None or part.material is not None or matrix.data.any():
            return matrix
        said.append(f"{type(effect).__name__}: its {what} is zero")
        return None

    return replace(
        part,
        stiffness=strong(part.stiffness, "stiffness"),
        viscosity=strong(part.viscosity, "viscosity"),
        loads=alive(part.loads, lambda load: load.vector, "force"),
        frictions=tuple(_grounded(f, times, said) for f in alive(part.frictions, _bound, "bound")),
        eigenstrains=alive(part.eigenstrains, lambda eigenstrain: eigenstrain.value, "strain"),
        initial_stresses=alive(part.initial_stresses, lambda stress: stress.value, "stress"),
    )


def _grounded(friction: Friction, times: Sequence[float], said: Said) -> Friction:
    """The friction, its ground left out if it is where it was at all of `times`."""
    ground = friction.ground
    if ground is None or len(times) == 0:
        return friction
    start = float(times[0])
    if not _zero(lambda t: ground.vector(t) - ground.vector(start), times):
        return friction
    said.append(f"{ground.subject} stands still at all instants")
    return replace(friction, ground=None)


def out_of_reach(terms: Terms, obstacles: Sequence[Obstacle], supports: Supports) -> Said:
    """A sentence for each friction and obstacle none of whose nodes can move, or is moved: it does nothing."""
    moving = np.arange(len(terms.nodes)) < terms.acting
    if terms.dragged is not None:
        moving = moving | terms.dragged
    held = [f.subject for f in terms.frictions if not np.isin(f.nodes, terms.nodes[moving]).any()]
    rows = (normal_rows(Jumps.of([o]), o.normals, supports.points) for o in obstacles)
    held += [o.subject for o, row in zip(obstacles, rows, strict=True) if on_free(row, supports).nnz == 0]
    return [f"{subject}: all its nodes are held otherwise" for subject in held]


def _bound(friction: Friction) -> Callable[[float], Floats]:
    law = friction.law
    if friction.slip_law is not None:
        return lambda t: np.ones(1)  # What it is once there is slip, nobody knows beforehand.
    if law is None:
        return friction.weights
    pressed = np.full(len(friction.nodes), PRESSED)
    return lambda t: friction.weights(t) + law(t, pressed)


def _zero(value: Callable[[float], Floats], times: Sequence[float]) -> bool:
    try:
        return not any(np.any(value(float(t))) for t in times)
    except VemcvxError:
        return False  # The step that needs the datum says what is wrong with it.
