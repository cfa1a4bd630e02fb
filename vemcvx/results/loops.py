"""The loop of force against displacement, for a driven boundary, a driven body or a load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.effects import BodyForce, PrescribedDisplacement, Rigid, nodes_of, where
from vemcvx.results.probe import places
from vemcvx.results.results import Results


@dataclass(frozen=True)
class Loop:
    """The mean displacement and force of a boundary, body or load along an axis, at S stored instants."""

    on: str
    axis: int
    motion: Floats  # mean displacement (S,)
    force: Floats  # (S,)
    kind: str  # "reaction" of a support, "force" of contact, or "load"


def loop_of(history: Results, on: str | None = None) -> Loop | None:
    """Return the loop of a boundary, by default of the driven boundary that moves most."""
    ways = _find_driven(history) if on is None else {on: _motion(history, on)}
    if not ways:
        return _find_load_loop(history)
    lengths = {name: np.abs(np.diff(way, axis=0)).sum(axis=0) for name, way in ways.items()}
    name = max(ways, key=lambda one: float(lengths[one].max()))
    axis = int(np.argmax(lengths[name]))
    if name in history.mesh.boundaries:
        kinds = {"reaction": history.reaction(name)[:, axis], "force": history.force(name)[:, axis]}
    else:
        mover = next(one for one in _movers(history) if name in np.atleast_1d(one.on))
        kinds = {"reaction": history.force(mover)[:, axis]}
    kind = "reaction" if kinds["reaction"].any() else "force"
    return Loop(name, axis, ways[name][:, axis], kinds[kind], kind)


def _find_load_loop(history: Results) -> Loop | None:
    if history.scene is None:
        return None
    changes = np.ptp(history.acting.loads, axis=0)
    for k in np.argsort(-changes.max(axis=1, initial=0.0)):
        effect = history.scene.canonical[history.acting.load_causes[k]]
        axis = int(np.argmax(changes[k]))
        if changes[k, axis] > 0 and (on := getattr(effect, "on", None)) and not isinstance(effect, BodyForce):
            name, motion = where(on), _motion(history, on)
        elif changes[k, axis] > 0 and (at := getattr(effect, "at", None)) is not None:
            motion = places(history.mesh, np.atleast_2d(at), "hysteresis_loop").at_nodes(history.displacement)
            name, motion = "the points", motion.mean(axis=1)
        else:
            continue
        return Loop(name, axis, motion[:, axis], history.acting.loads[:, k, axis], "load")
    return None


def _motion(history: Results, on: str | Sequence[str]) -> Floats:
    """Return the mean displacement (S, dim) of a boundary or body."""
    space = history._space
    if isinstance(on, str) and on not in space.mesh.boundaries and on in space.mesh.cell_data:
        return np.asarray(history.displacement[:, nodes_of(space, on, "hysteresis_loop")].mean(axis=1))
    part = space.part(on, "hysteresis_loop", contact=True)
    return np.einsum("smd,m->sd", history.displacement[:, part.nodes], part.node_lengths / part.measures.sum())


def _movers(history: Results) -> list[PrescribedDisplacement | Rigid]:
    kinds = PrescribedDisplacement, Rigid
    return [one for one in history.scene or () if isinstance(one, kinds) and getattr(one, "motion", ()) is not None]


def _find_driven(history: Results) -> dict[str, Floats]:
    names, along = [str(name) for effect in _movers(history) for name in np.atleast_1d(effect.on)], {}
    if history.scene is None:  # Boundaries with a reaction are treated as driven.
        held = {
            name.removeprefix("reaction of "): R for name, R in history.resultants.items() if "reaction of " in name
        }
        names, along = list(held), {name: np.abs(R).max(axis=0) > 1e-9 * np.abs(R).max() for name, R in held.items()}
    rounding = 1e-9 * float(np.abs(history.displacement).max())
    ways = {name: _motion(history, name) * along.get(name, 1.0) for name in names}
    return {name: way for name, way in ways.items() if np.ptp(way, axis=0).max() > rounding}
