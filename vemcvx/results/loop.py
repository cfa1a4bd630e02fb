"""The loop of a boundary that is moved to and fro: which boundary, along which axis, and its mean motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import PrescribedDisplacement
from vemcvx.results.results import Results
from vemcvx.vem import Space


@dataclass(frozen=True)
class Loop:
    """The boundary `on`, which moves along `axis`, and its mean displacement there, (S,)."""

    on: str
    axis: int
    motion: Floats


def loop_of(history: Results, on: str | None = None) -> Loop | None:
    """The loop of a boundary along the axis on which its way to and fro is longest.

    By default of the prescribed displacements that of the longest way; None where none moves, and of scenes that are
    not known.
    """
    ways = _driven(history) if on is None else {on: _motion(history, on)}
    if not ways:
        return None
    lengths = {name: np.abs(np.diff(way, axis=0)).sum(axis=0) for name, way in ways.items()}
    name = max(ways, key=lambda one: float(lengths[one].max()))
    axis = int(np.argmax(lengths[name]))
    return Loop(name, axis, ways[name][:, axis])


def _motion(history: Results, name: str) -> Floats:
    """The mean displacement (S, dim) of a boundary."""
    part = Space(history.mesh).part(name, "hysteresis_loop", contact=True)
    return np.einsum("smd,m->sd", history.displacement[:, part.nodes], part.node_lengths / part.measures.sum())


def _driven(history: Results) -> dict[str, Floats]:
    """The mean motions of the boundaries that a prescribed displacement moves, by name."""
    moved = [effect.on for effect in history.scene or () if isinstance(effect, PrescribedDisplacement)]
    names = [name for on in moved for name in ([on] if isinstance(on, str) else on)]
    rounding = 1e-9 * float(np.abs(history.displacement).max())
    return {name: way for name in names if np.ptp(way := _motion(history, name), axis=0).max() > rounding}
