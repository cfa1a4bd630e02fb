"""Data in time: the instants at which bounds of histories read them, and what they may miss between these.

A path has instants where data are not linear in time within one of its steps, by what they are at READINGS instants of
it. Between any two readings they are looked at once more. Where they miss the line by more than OFF_LINE of their size
that is an instant of the path, too, data are read at the quarters around it, and a warning names it.

The bound is a theorem for data that are linear between the instants of the path. Under others the exact history is
another one. For certain it is off by no more than the variation in time of what the lines miss, in the energy norm of
an elastic body; but of a sine at 128 instants that is pi^2 / 128 of its amplitude, 8 %, where nothing is lost if its
turns are among them: one place that slips (the play operator) loses no more than the most that lines miss by. So what
is lost is estimated, by the run on its own cells at the instants of the path and at those looked at: under the data as
they are, and under the lines. What the two differ by in the energy norm up to an instant of the run, times SAFETY, is
added to the bound there.

Without this a bound sinks below the error as its path gets better: the load of a pulse, .622 at its top, was .620 at
the nearest instant, the error .122, and the bound .120, as it should be under such data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.history import History
from vemcvx.program.operators import energy_norm
from vemcvx.program.system import System
from vemcvx.scene.pose import PosedScene
from vemcvx.stepping import march
from vemcvx.stepping.course import ACROSS

READINGS = 4
"""Instants in each step of a path at which data are read."""
OFF_LINE = 0.02
"""Part of their size by which data may differ from lines between readings without a word: with readings 1/128 of the
run apart, waves of more than eight periods do."""
SAFETY = 3.0
"""What is convex or concave between two instants is at most so many times as far from the line between them as it is at
any one place in the middle third, which is where it is looked at."""


def readings(path: Floats) -> Floats:
    """The instants at which data may be read: READINGS in each step of a path."""
    parts = np.linspace(0.0, 1.0, READINGS + 1)
    return np.unique(path[:-1, None] + parts * np.diff(path)[:, None]) if len(path) > 1 else path


@dataclass(frozen=True, eq=False)
class Followed:
    """A path that follows data in time."""

    path: Floats
    """instants"""
    missed: Floats = field(default_factory=lambda: np.zeros(0))
    """instants at which data were found off the lines between readings, by more than OFF_LINE; they are of the path"""
    between: Floats = field(default_factory=lambda: np.zeros(0))
    """instants at which data are not as they are on the lines of the path"""

    def allowance(self, posed: PosedScene, history: History) -> Floats:
        """(N + 1,) for what is lost between the instants of the path, at those of the run: an estimate."""
        times = history.trajectory.times
        if len(self.between) == 0:
            return np.zeros(len(times))
        instants, system, supports = np.union1d(self.path, self.between), posed.system, posed.supports
        start = supports.P.T @ (history.displacement[0].ravel() - supports.motion(float(times[0])))
        at = np.searchsorted(instants, times).tolist()
        read, lines = (
            march(one, instants, initial=start, check=False, store=at).state for one in (system, self._lines(system))
        )
        apart = np.array([energy_norm(system.K, d) for d in read - lines])
        return SAFETY * np.maximum.accumulate(apart)

    def _lines(self, system: System) -> System:
        """The system under data that are linear between the instants of the path."""
        norms, motion = system.norms, system.motion
        if norms is not None:
            ground = None if norms.ground is None else _line(self.path, norms.ground)
            norms = replace(norms, w=_line(self.path, norms.weights), ground=ground)
        if motion is not None:
            force, slip = (_line(self.path, one) for one in (motion.dirichlet_force, motion.prescribed_slip))
            motion = replace(motion, dirichlet_force=force, prescribed_slip=slip)
        return replace(system, load=_line(self.path, system.force), norms=norms, motion=motion)


def _line(known: Floats, datum: Callable[[float], Floats]) -> Callable[[float], Floats]:
    """The function of time that has the values of a datum at known instants and is linear between them."""
    kept = lru_cache(maxsize=2)(datum)

    def line(t: float) -> Floats:
        a, b = _around(known, t)
        s = (t - a) / (b - a)
        return (1.0 - s) * kept(a) + s * kept(b)

    return line


def _around(known: Floats, t: float) -> tuple[float, float]:
    """The two of the known instants between which an instant is."""
    k = int(np.clip(np.searchsorted(known, t), 1, len(known) - 1))
    return float(known[k - 1]), float(known[k])


def followed(posed: PosedScene, path: Floats) -> Followed:
    """The path that follows the data of a scene, from one with the instants at which these bend, turn or jump."""
    read = readings(path)
    # Between the sides of a jump there may be no other number: such a step has fewer readings.
    step = np.searchsorted(path, read[:-1], side="right")
    bent = np.isin(step, step[_apart(posed, path, read[:-1]) > SAME])
    path = np.union1d(path, read[:-1][bent])
    missed = _off(posed, read, _between(read), OFF_LINE)
    if len(missed):
        path = np.union1d(path, missed)
        # At the quarters of what is left: a pulse that is as short as readings are apart has its top there.
        read = readings(path)
        path = np.union1d(path, _off(posed, path, read, OFF_LINE))
        path = np.union1d(path, _off(posed, read, _between(read), OFF_LINE))
    known = np.union1d(path, read)
    return Followed(path, missed, _off(posed, path, np.union1d(known, _between(known)), SAME))


def _between(instants: Floats) -> Floats:
    """A random instant in the middle third of every interval; evenly spaced ones could be in step with waves."""
    return instants[:-1] + np.random.default_rng(0).uniform(1.0, 2.0, len(instants) - 1) / 3.0 * np.diff(instants)


def _off(posed: PosedScene, known: Floats, at: Floats, part: float) -> Floats:
    """The instants at which data miss the lines between known ones by more than this part of their size."""
    missing: Floats = at[_apart(posed, known, at) > part]
    return missing


def _apart(posed: PosedScene, known: Floats, at: Floats) -> Floats:
    """(k,) by which data at instants (k,) miss the lines between known ones, in parts of the largest of their kind.

    Nothing is looked at within the two sides of a jump.
    """
    data = lru_cache(maxsize=4)(lambda t: _data(posed, t))
    found, sizes = [], []
    for t in at:
        a, b = _around(known, t)
        s = (t - a) / (b - a) if b - a > 2.0 * ACROSS * (known[-1] - known[0]) else 0.0
        start, middle, stop = (data(float(x)) for x in (a, t if s else a, b))
        rows = [m - f - s * (g - f) for f, m, g in zip(start, middle, stop, strict=True)]
        found.append([np.abs(one).max(initial=0.0) for one in rows])
        sizes.append(np.max([[np.abs(one).max(initial=0.0) for one in each] for each in (start, middle, stop)], axis=0))
    largest = np.max(sizes, axis=0)
    apart: Floats = np.max(np.array(found) / np.where(largest > 0.0, largest, 1.0), axis=1)
    return apart


def _data(posed: PosedScene, t: float) -> list[Floats]:
    """The data of a scene at an instant: motions of supports, forces, weights, and motions of the ground."""
    terms = posed.terms
    kinds = [posed.supports.motion(t), posed.force(t), terms.weights(t)]
    return kinds + ([] if terms.ground is None else [terms.ground(t)])
