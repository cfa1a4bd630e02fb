"""The course of a run's data in time: samples of all that drives it, and where that bends, turns or jumps.

Of every kind of data a sum with random weights is sampled, at instants 1/256 of the run apart, or at the ends and
middles of shorter steps: a change that is over between two samples is not seen. A *bend* lies where the lines on both
sides of an interval meet, a *turn* at the vertex of the parabola through three samples of a sum that changes its
direction. A *jump* is a change that halving leaves large.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import WORTH_A_WORD
from vemcvx.program.system import System

BENT = 1e-6
"""Part of the largest datum by which lines on two sides of an interval miss each other, and by which data turn back."""
ACROSS = 1e-9
"""Part of the run that steps across a jump may take."""


@dataclass(frozen=True)
class Course:
    """The data in time: samples, bends and turns, and jumps."""

    times: Floats  # (q,) instants at which data were sampled
    values: Floats  # (q, k) weighted sums there, in parts of their largest size
    bends: Floats  # (b,) instants where data bend, turn or jump; those of a jump are two, ACROSS apart at most
    jumps: tuple[str, ...]  # sentences

    def missed(self, times: Floats) -> Floats:
        """Return the bends in steps of a run in which the line between the ends misses the data by a twentieth."""
        known = self.values[np.abs(self.times - times[:, None]).argmin(axis=1)]
        lines = np.column_stack([np.interp(self.times, times, datum) for datum in known.T])
        far = np.searchsorted(times, self.times[np.abs(self.values - lines).max(axis=1) > WORTH_A_WORD])
        inside = inside_steps(times, self.bends)
        found: Floats = inside[np.isin(np.searchsorted(times, inside), far)]
        return found


def course(system: System, times: Floats) -> Course:
    """Sample the data of a system over a run, and find bends, turns and jumps."""
    sampled, draw = divided(times, 2, 256), np.random.default_rng(0)
    names, weights = zip(*((name, draw.uniform(0.5, 1.5, len(x))) for name, x in inputs(system, times[0])), strict=True)

    def sums(t: float) -> Floats:
        return np.array([w @ x for w, (_, x) in zip(weights, inputs(system, t), strict=True)])

    values = np.array([sums(t) for t in sampled.tolist()])
    scale = np.where((size := np.abs(values).max(axis=0)) > 0, size, 1.0)
    instants, sentences = _jumps(sampled, values / scale, lambda t: sums(t) / scale, names)
    bends = np.union1d(instants, _bends(sampled, values / scale))
    turns = _turns(sampled, values / scale)
    # Between a bend's two neighbours nothing is smooth.
    before, after = (sampled[np.clip(np.searchsorted(sampled, turns) + k, 0, len(sampled) - 1)] for k in (-2, 1))
    smooth = np.searchsorted(bends, before) == np.searchsorted(bends, after, side="right")
    return Course(sampled, values / scale, np.union1d(bends, turns[smooth]), sentences)


def divided(times: Floats, least: int, in_all: int) -> Floats:
    """Return the instants with each step in `least` equal parts or more, and the run in at least `in_all`.

    Steps across a jump stay whole.
    """
    span = times[-1] - times[0]
    parts = []
    for a, b in pairwise(times):
        count = 1 if b - a <= ACROSS * span else max(least, int(np.ceil(in_all * (b - a) / span - 1e-9)))
        parts.append(np.linspace(a, b, count + 1)[:-1])
    return np.concatenate([*parts, times[-1:]])


def inside_steps(times: Floats, bends: Floats) -> Floats:
    """Return the bends at which there is no instant, each once; the two sides of a jump are two."""
    span = float(times[-1] - times[0])
    inside = np.sort(bends[np.abs(bends[:, None] - times).min(axis=1, initial=np.inf) > ACROSS * span])
    # The same bend of two data is found twice, apart by rounding.
    return inside[np.diff(inside, prepend=-np.inf) > 1e-13 * span]


def inputs(system: System, t: float) -> list[tuple[str, Floats]]:
    """Evaluate everything that drives a system, at an instant, with its name."""
    gap, motion, ground = system.remaining_gap(t), system.motion, system.ground(t)
    found = [("load", system.force(t)), ("gap", gap)]
    found += [] if system.norms is None else [("bound of friction", system.norms.weights_under(t, np.ones(len(gap))))]
    found += [] if ground is None else [("ground", ground)]
    return found + ([] if motion is None else [("support", motion.prescribed_slip(t))])


def _bends(times: Floats, values: Floats) -> Floats:
    """Return the instants inside intervals where the lines on both sides meet."""
    width = np.diff(times)
    slopes = np.diff(values, axis=0) / width[:, None]
    apart, curved = slopes[2:] - slopes[:-2], np.abs(np.diff(slopes, axis=0)).max(axis=1)
    size, far = np.abs(apart).max(axis=1), np.maximum(np.append(0.0, curved[:-2]), np.append(curved[2:], 0.0))
    # A bend stands out eight times from the curvature on either side.
    j = np.flatnonzero((size * width[1:-1] > BENT) & (size > 8.0 * far))
    k = np.abs(apart[j]).argmax(axis=1)
    after = (values[j + 1, k] + slopes[j + 2, k] * width[j + 1] - values[j + 2, k]) / apart[j, k]
    found: Floats = (times[j + 1] + after)[(after >= 0.0) & (after <= width[j + 1])]
    return found


def _turns(times: Floats, values: Floats) -> Floats:
    """Return the vertices of parabolas through three samples of which the middle one is the largest or the smallest."""
    width = np.diff(times)[:, None]
    slopes, half = np.diff(values, axis=0) / width, 0.5 * (width[1:] + width[:-1])
    left, right = slopes[:-1], slopes[1:]
    j, k = np.nonzero((left * right < 0.0) & (half * np.abs(right - left) > BENT))
    steep = left[j, k] / (left[j, k] - right[j, k])
    return np.sort(0.5 * (times[j] + times[j + 1]) + steep * half[j, 0])


def _jumps(
    times: Floats, values: Floats, value: Callable[[float], Floats], names: tuple[str, ...]
) -> tuple[Floats, tuple[str, ...]]:
    """Return two instants for each jump, and a sentence."""
    change = np.abs(np.diff(values, axis=0)).max(axis=1)
    usual, instants, sentences = np.median(change) if len(change) else 0.0, [], []
    # A jump is large beside the datum's size, and beside its usual change in an interval.
    for j in np.flatnonzero((change > 0.02) & (change > 4.0 * usual)).tolist():
        a, b, left, right = times[j], times[j + 1], values[j], values[j + 1]
        # Of a jump a quarter of the change is left, however short the interval; of a steep slope nothing.
        for _ in range(30):
            t = 0.5 * (a + b)
            if not a < t < b or np.abs(right - left).max() < 0.25 * change[j]:
                break
            middle = value(t)
            if np.abs(middle - left).max() >= np.abs(right - middle).max():
                b, right = t, middle
            else:
                a, left = t, middle
        apart = np.abs(right - left)
        if apart.max() >= 0.25 * change[j]:
            instants += [a, b]
            sentences.append(f"the {names[int(np.argmax(apart))]} jumps at t = {b:.9g}; no step is put inside")
    return np.array(instants), tuple(sentences)
