"""Bends (kinks), turns (extrema) and jumps of loads, gaps, friction bounds and motions in time.

All data of one kind, such as all gaps, are added with random weights. The sums are sampled at ends and midpoints of
steps, and at least 256 times in a run. A change that begins and ends between two samples is not found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.program.system import System

BEND_TOLERANCE = 1e-6
"""Smallest (change of slope) x (interval) at a bend, relative to the largest value."""
JUMP_WIDTH = 1e-9
"""Largest length of a step across a jump, relative to the run."""


@dataclass(frozen=True)
class Course:
    """Samples of data in time, with bends, turns and jumps."""

    times: Floats  # (q,) instants of the samples
    values: Floats  # (q, k) weighted sums of data, scaled to at most 1
    bends: Floats  # (b,) instants of bends and turns, and two instants per jump
    jumps: tuple[str, ...]  # one sentence for each jump


def sample_course(system: System, times: Floats) -> Course:
    """Evaluate the data of a system over a run, and find bends, turns and jumps."""
    sampled, draw = subdivide(times, 2, 256), np.random.default_rng(0)
    names, weights = zip(*((name, draw.uniform(0.5, 1.5, len(x))) for name, x in inputs(system, times[0])), strict=True)

    def sums(t: float) -> Floats:
        return np.array([w @ x for w, (_, x) in zip(weights, inputs(system, t), strict=True)])

    values = np.array([sums(t) for t in sampled.tolist()])
    scale = np.where((size := np.abs(values).max(axis=0)) > 0, size, 1.0)
    instants, sentences = _jumps(sampled, values / scale, lambda t: sums(t) / scale, names)
    bends = np.union1d(instants, _bends(sampled, values / scale))
    turns = _turns(sampled, values / scale)
    # Discard each turn next to a bend.
    before, after = (sampled[np.clip(np.searchsorted(sampled, turns) + k, 0, len(sampled) - 1)] for k in (-2, 1))
    smooth = np.searchsorted(bends, before) == np.searchsorted(bends, after, side="right")
    return Course(sampled, values / scale, np.union1d(bends, turns[smooth]), sentences)


def subdivide(times: Floats, least: int, in_all: int) -> Floats:
    """Split steps into `least` or more parts, except steps across jumps."""
    span = times[-1] - times[0]
    parts = []
    for a, b in pairwise(times):
        count = 1 if b - a <= JUMP_WIDTH * span else max(least, int(np.ceil(in_all * (b - a) / span - 1e-9)))
        parts.append(np.linspace(a, b, count + 1)[:-1])
    return np.concatenate([*parts, times[-1:]])


def inside_steps(times: Floats, bends: Floats) -> Floats:
    """Return the distinct instants of bends inside steps."""
    span = float(times[-1] - times[0])
    inside = np.sort(bends[np.abs(bends[:, None] - times).min(axis=1, initial=np.inf) > JUMP_WIDTH * span])
    # Bends of two data at the same instant differ by rounding.
    return inside[np.diff(inside, prepend=-np.inf) > 1e-13 * span]


def inputs(system: System, t: float) -> list[tuple[str, Floats]]:
    """Return the names and arrays of all data of a system at an instant."""
    gap, motion, ground = system.remaining_gap(t), system.motion, system.ground(t)
    found = [("load", system.force(t)), ("gap", gap)]
    if system.norms is not None:
        w = system.norms.weights_under(t, np.ones(len(gap)))
        found.append(("bound of friction", np.where(w == np.inf, 0.0, w)))  # Terms of infinite weight do not slip.
    found += [] if ground is None else [("ground", ground)]
    return found + ([] if motion is None else [("support", motion.prescribed_slip(t))])


def _bends(times: Floats, values: Floats) -> Floats:
    width = np.diff(times)
    slopes = np.diff(values, axis=0) / width[:, None]
    apart, curved = slopes[2:] - slopes[:-2], np.abs(np.diff(slopes, axis=0)).max(axis=1)
    size, far = np.abs(apart).max(axis=1), np.maximum(np.append(0.0, curved[:-2]), np.append(curved[2:], 0.0))
    # At a bend, the slope changes more than eight times as much as in neighbouring intervals.
    j = np.flatnonzero((size * width[1:-1] > BEND_TOLERANCE) & (size > 8.0 * far))
    k = np.abs(apart[j]).argmax(axis=1)
    after = (values[j + 1, k] + slopes[j + 2, k] * width[j + 1] - values[j + 2, k]) / apart[j, k]
    found: Floats = (times[j + 1] + after)[(after >= 0.0) & (after <= width[j + 1])]
    return found


def _turns(times: Floats, values: Floats) -> Floats:
    width = np.diff(times)[:, None]
    slopes, half = np.diff(values, axis=0) / width, 0.5 * (width[1:] + width[:-1])
    left, right = slopes[:-1], slopes[1:]
    j, k = np.nonzero((left * right < 0.0) & (half * np.abs(right - left) > BEND_TOLERANCE))
    steep = left[j, k] / (left[j, k] - right[j, k])
    return np.sort(0.5 * (times[j] + times[j + 1]) + steep * half[j, 0])


def _jumps(
    times: Floats, values: Floats, value: Callable[[float], Floats], names: tuple[str, ...]
) -> tuple[Floats, tuple[str, ...]]:
    """Return two instants and a sentence for each jump."""
    change = np.abs(np.diff(values, axis=0)).max(axis=1)
    usual, instants, sentences = np.median(change) if len(change) else 0.0, [], []
    # A jump is large compared with the data and with the median change.
    for j in np.flatnonzero((change > 0.02) & (change > 4.0 * usual)).tolist():
        a, b, left, right = times[j], times[j + 1], values[j], values[j + 1]
        # After thirty halvings, only a jump keeps a quarter of the change.
        for _ in range(30):
            t = 0.5 * (a + b)
            middle = value(t)
            if np.abs(middle - left).max() >= np.abs(right - middle).max():
                b, right = t, middle
            else:
                a, left = t, middle
        apart = np.abs(right - left)
        if apart.max() >= 0.25 * change[j]:
            instants += [a, b]
            sentences.append(f"the {names[int(np.argmax(apart))]} jumps at t = {b:.9g}; no step size resolves the jump")
    return np.array(instants), tuple(sentences)
