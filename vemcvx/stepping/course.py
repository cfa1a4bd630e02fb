"""The course of a run's data in time: samples of all that drives it, and where that bends, turns or jumps.

Data are sampled at instants 1/256 of the run apart, or at the ends and middles of shorter steps: a change that is over
between two samples is not seen. Of every kind of data a sum with random weights is kept. A *bend* lies where the lines
on both sides of an interval meet. A *turn* is the vertex of the parabola through three samples of an entry (the load at
an unknown, the gap at a node) that changes its direction. Entries that turn must be the part TURNING of all that curves
there: under a wave that travels some node turns at every instant. A *jump* is a change that halving leaves large.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import WORTH_A_WORD
from vemcvx.program.system import System

BENT = 1e-6  # Lines on two sides of an interval that miss each other by this part of the largest datum are one.
TURNING = 0.25  # Of a wave along twelve nodes an eighth turns at once, of loads on two sides a half.
ACROSS = 1e-9  # Steps of no more than this part of the run are those across a jump.


@dataclass(frozen=True)
class Course:
    """The data in time: samples, bends, turns and jumps."""

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
    names = list(first := _data(system, float(times[0])))
    weights = [draw.uniform(0.5, 1.5, len(block)) for block in first.values()]

    def summed(blocks: dict[str, Floats]) -> Floats:
        return np.array([w @ block for w, block in zip(weights, blocks.values(), strict=True)])

    sums, turned, largest = [], [], np.zeros(len(first))
    last: deque[dict[str, Floats]] = deque(maxlen=3)
    for n, t in enumerate(sampled.tolist()):
        last.append(_data(system, t))
        sums.append(summed(last[-1]))
        largest = np.maximum(largest, [np.abs(block).sum() for block in last[-1].values()])
        if n >= 2:
            turned.append(
                [_turn(sampled[n - 2 : n + 1], *three) for three in zip(*map(dict.values, last), strict=True)]
            )
    scale = np.where((size := np.abs(sums).max(axis=0)) > 0, size, 1.0)
    values = np.array(sums) / scale
    instants, sentences = _jumps(sampled, values, lambda t: summed(_data(system, t)) / scale, names)
    bends = np.union1d(instants, _bends(sampled, values))
    # Between a bend's two neighbours nothing is smooth.
    smooth = np.searchsorted(bends, sampled[:-2]) == np.searchsorted(bends, sampled[2:], side="right")
    amounts, turns = np.moveaxis(np.reshape(turned, (-1, len(first), 2)), 2, 0)
    return Course(sampled, values, np.union1d(bends, turns[smooth[:, None] & (amounts > BENT * largest)]), sentences)


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


def _data(system: System, t: float) -> dict[str, Floats]:
    """Evaluate everything that drives a system, at an instant, by name."""
    blocks = {"load": system.force(t), "gap": system.remaining_gap(t)}
    if system.norms is not None:
        blocks["bound of friction"] = system.norms.weights_under(t, np.ones(len(blocks["gap"])))
    if (ground := system.ground(t)) is not None:
        blocks["ground"] = ground
    if system.motion is not None:
        blocks["support"] = system.motion.prescribed_slip(t)
    return blocks


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


def _turn(times: Floats, before: Floats, at: Floats, after: Floats) -> tuple[float, float]:
    """Return by how much entries turn back near the middle of three instants, and when the first of them does."""
    left, right, half = (at - before) / (times[1] - times[0]), (after - at) / (times[2] - times[1]), times[2] - times[0]
    curved = 0.5 * half * np.abs(right - left)
    turning = np.where(left * right < 0.0, curved, 0.0)
    if (amount := float(turning.sum())) <= TURNING * curved.sum():
        return 0.0, float(times[1])
    k = int(np.argmax(turning))
    return amount, float(0.5 * (times[0] + times[1]) + 0.5 * half * left[k] / (left[k] - right[k]))


def _jumps(
    times: Floats, values: Floats, value: Callable[[float], Floats], names: list[str]
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
