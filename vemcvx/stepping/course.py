"""The course of a run's data in time: samples of all that drives it, and where that bends, turns or jumps.

Data are sampled at instants 1/256 of the run apart, or at the ends and middles of the steps where these are shorter:
a change that is over between two of them is not seen. For every kind (load, bounds of friction, gaps, moving supports
and ground) a weighted sum is kept, with random weights, so that every change of the data changes it. A *bend* lies
where the straight lines on both sides of an interval meet. A datum *turns* where it is largest or smallest: what slips
one way there slips the other way from then on; the vertex of the parabola through three samples counts as a bend. Turns
are those of entries (the load at an unknown, the gap at a node), for a sum of two data turns where neither does; and of
entries that are a part TURNING of all that curves there, for under a wave that travels one node or another turns at
every instant. A *jump* is what is left of a change when the interval is halved, and halved again, down to round-off.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats
from vemcvx.errors import WORTH_A_WORD
from vemcvx.program.system import System

BENT = 1e-6  # Part of a datum's size: lines on two sides of an interval that miss each other by less are one.
TURNING = 0.25
"""Part of all that curves: of a wave along twelve nodes an eighth turns at once, of loads on two sides a half."""
ACROSS = 1e-9  # Steps of no more than this part of the run are those across a jump.


@dataclass(frozen=True)
class Course:
    """The data in time: samples, bends, turns and jumps."""

    times: Floats  # (q,) instants at which data were sampled
    values: Floats  # (q, k) weighted sums there, in parts of their largest size
    bends: Floats  # (b,) instants where they bend, turn or jump; those of a jump are two, ACROSS apart at most
    jumps: tuple[str, ...]  # sentences

    def missed(self, times: Floats) -> Floats:
        """Bends inside the steps of a run in which straight lines between its instants miss the data by a twentieth."""
        known = self.values[np.abs(self.times - times[:, None]).argmin(axis=1)]
        lines = np.column_stack([np.interp(self.times, times, datum) for datum in known.T])
        apart = np.abs(self.values - lines).max(axis=1, initial=0.0)
        inside = inside_steps(times, self.bends)
        of_samples, of_bends = np.searchsorted(times, self.times), np.searchsorted(times, inside)
        far = np.unique(of_samples[apart > WORTH_A_WORD])
        found: Floats = inside[np.isin(of_bends, far)]
        return found


Value = Callable[[float], Floats]


def course(system: System, times: Floats) -> Course:
    """Sample the data of a system over a run, and find bends and jumps."""
    sampled = divided(times, 2, 256)
    first = _blocks(system, float(times[0]))
    draw = np.random.default_rng(0)
    weights = [draw.uniform(0.5, 1.5, len(block)) for block in first.values()]

    def summed(blocks: dict[str, Floats]) -> Floats:
        return np.array([w @ block for w, block in zip(weights, blocks.values(), strict=True)])

    raw, turned, size_of_blocks = [], [], np.zeros(len(first))
    last: deque[dict[str, Floats]] = deque(maxlen=3)
    for t in sampled.tolist():
        last.append(_blocks(system, t))
        raw.append(summed(last[-1]))
        size_of_blocks = np.maximum(size_of_blocks, [np.abs(block).sum() for block in last[-1].values()])
        if len(last) == 3:
            around = sampled[len(raw) - 3 : len(raw)]
            turned.append([_turned(around, *three) for three in zip(*(at.values() for at in last), strict=True)])
    size = np.abs(raw).max(axis=0)
    scale = np.where(size > 0, size, 1.0)
    values = np.array(raw) / scale

    def value(t: float) -> Floats:
        return summed(_blocks(system, t)) / scale

    jumps, sentences = _jumps(sampled, values, value, np.array(list(first)))
    bends = np.union1d(jumps, _bends(sampled, values, value))
    # Between a bend's two neighbours nothing is smooth.
    smooth = np.searchsorted(bends, sampled[:-2]) == np.searchsorted(bends, sampled[2:], side="right")
    amounts, turns = np.moveaxis(np.reshape(turned, (-1, len(first), 2)), 2, 0)
    turns = turns[smooth[:, None] & (amounts > BENT * size_of_blocks)]
    return Course(sampled, values, np.union1d(bends, turns), sentences)


def divided(times: Floats, least: int, in_all: int) -> Floats:
    """The instants with every step in at least so many equal parts, and the run in at least `in_all`.

    Steps across a jump stay whole.
    """
    span = times[-1] - times[0]
    parts = []
    for a, b in pairwise(times):
        count = 1 if b - a <= ACROSS * span else max(least, int(np.ceil(in_all * (b - a) / span - 1e-9)))
        parts.append(np.linspace(a, b, count + 1)[:-1])
    return np.concatenate([*parts, times[-1:]])


def _blocks(system: System, t: float) -> dict[str, Floats]:
    """Everything that drives a system, at an instant, by name."""
    gap = system.remaining_gap(t)
    blocks = {"load": system.force(t), "gap": gap}
    if system.norms is not None:
        under = system.norms.weights_under(t, np.ones(len(gap)))
        blocks["bound of friction"] = np.append(under, system.bias(t))
        if system.norms.ground is not None:
            blocks["ground"] = system.norms.moved(t)
    if system.motion is not None:
        blocks["support"] = system.motion.prescribed_slip(t)
    return blocks


def _bends(times: Floats, values: Floats, value: Value) -> Floats:
    """Instants inside intervals where the lines on both sides meet."""
    if len(times) < 4:
        return np.zeros(0)
    slopes = np.diff(values, axis=0) / np.diff(times)[:, None]
    turns = np.abs(np.diff(slopes, axis=0)).max(axis=1)
    # An interval's lines are those of its two neighbours; curvature is how these turn on their far sides.
    apart = np.abs(slopes[2:] - slopes[:-2]).max(axis=1)
    far = np.maximum(np.append(0.0, turns[:-2]), np.append(turns[2:], 0.0))
    # A bend stands out eight times from the curvature on either side.
    bent = np.flatnonzero((apart * np.diff(times)[1:-1] > BENT) & (apart > 8.0 * far))
    found = [_meeting(times[j : j + 4], values[j : j + 4], value) for j in bent]
    return np.array([t for t in found if t is not None])


def _meeting(times: Floats, values: Floats, value: Value) -> float | None:
    """The instant in the middle interval where the outer lines meet; found again from data nearby, twice."""
    (left, a, b, right), meet = times, _crossing(times, values)
    if not a <= meet <= b:
        return None
    for step in ((b - a) / 64.0, (b - a) / 64.0**2):
        # Data need not exist outside the run, and other bends may be next door.
        nearby = np.clip(meet + step * np.array([-2.0, -1.0, 1.0, 2.0]), left, right)
        if np.diff(nearby).min() <= 0.0:
            return meet
        better = _crossing(nearby, np.array([value(float(t)) for t in nearby]))
        if not nearby[0] < better < nearby[-1]:
            return meet
        meet = better
    return meet


def _crossing(times: Floats, values: Floats) -> float:
    """The instant where the lines through the first two and the last two points meet, of the sum that turns most."""
    left, _, right = np.diff(values, axis=0) / np.diff(times)[:, None]
    k = int(np.argmax(np.abs(left - right)))
    if left[k] == right[k]:
        return float(times[1])
    rest = (values[2, k] - right[k] * (times[2] - times[1])) - values[1, k]
    return float(times[1] + rest / (left[k] - right[k]))


def _turned(times: Floats, before: Floats, at: Floats, after: Floats) -> tuple[float, float]:
    """The amount by which entries turn back near the middle one of three instants, and the instant at which they do.

    It is zero where these entries are a small part of all that curves there.
    """
    left, right = (at - before) / (times[1] - times[0]), (after - at) / (times[2] - times[1])
    half = 0.5 * (times[2] - times[0])
    curved = half * np.abs(right - left)
    turning = np.where(left * right < 0.0, curved, 0.0)
    amount = float(turning.sum())
    if amount <= TURNING * curved.sum():
        return 0.0, float(times[1])
    k = int(np.argmax(turning))  # The vertex of the parabola of the entry that turns most.
    return amount, float(0.5 * (times[0] + times[1]) + half * left[k] / (left[k] - right[k]))


def _jumps(times: Floats, values: Floats, value: Value, names: NDArray[np.str_]) -> tuple[Floats, tuple[str, ...]]:
    """Two instants for each sudden change, and a sentence for each jump."""
    change = np.abs(np.diff(values, axis=0)).max(axis=1)
    # A jump is large beside the datum's size, and beside its usual change in an interval.
    usual = np.median(change) if len(change) else 0.0
    sudden = np.flatnonzero((change > 0.02) & (change > 4.0 * usual))
    instants, sentences = [], []
    for j in sudden:
        a, b, left, right = times[j], times[j + 1], values[j], values[j + 1]
        # Where data jump a quarter of the change is left, however short the interval.
        for _ in range(30):
            t = 0.5 * (a + b)
            if not a < t < b or np.abs(right - left).max() < 0.25 * change[j]:
                break
            middle = value(float(t))
            if np.abs(middle - left).max() >= np.abs(right - middle).max():
                b, right = t, middle
            else:
                a, left = t, middle
        apart = np.abs(right - left)
        if apart.max() >= 0.25 * change[j]:
            instants += [a, b]
            sentences.append(f"the {names[np.argmax(apart)]} jumps at t = {b:.9g}; no step is put inside")
    return np.array(instants), tuple(sentences)


def inside_steps(times: Floats, bends: Floats) -> Floats:
    """The bends at which there is no instant, each once; the two sides of a jump are two."""
    span = float(times[-1] - times[0])
    apart = np.abs(bends[:, None] - times).min(axis=1, initial=np.inf)
    inside = np.sort(bends[apart > ACROSS * span])
    # The same bend of two data is found twice, apart by rounding.
    return inside[np.diff(inside, prepend=-np.inf) > 1e-13 * span]
