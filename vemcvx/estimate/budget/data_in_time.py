"""The course of a system's data in time: where they bend, and where they jump.

Data are sampled at instants 1/256 of the run apart, or at the ends and middles of the steps where these are shorter:
what is over between two of them is not seen. Of every kind (load, bounds of friction, gaps, moving supports and
ground) a few weighted sums are kept, with weights that have nothing in common with any scene, so that what changes
changes them.

- A *bend* lies where the straight lines on both sides of an interval meet; a second look from nearby finds it to
  round-off.
- A datum *turns* where it is largest or smallest: what slips one way there slips the other way from then on. The vertex
  of the parabola through three samples, and again through three nearby, counts as a bend.
- A *jump* is what is left of a change when the interval is halved, and halved again, down to round-off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats
from vemcvx.program.system import System

SAMPLES = 256
"""Instants of the run at which data are looked at, at least."""
SUMS = 3
BENT = 1e-6
"""Part of a datum's size: lines on two sides of an interval that miss each other by less are one."""
SHARP = 8.0
"""Times that a bend stands out from the curvature on either side."""
SUDDEN, STEEP = 0.02, 4.0
"""Change of a datum within an interval, in parts of its size and of its neighbours' changes, that may be a jump."""
HALVINGS = 30
STAYS = 0.25
"""Part of a change that is left, however short the interval, where data jump."""
NEARBY = 1.0 / 64.0
ACROSS = 1e-9
"""Steps of no more than this part of the run are those across a jump."""
MOST = 200
"""Bends and jumps are looked for in no more intervals than this, the largest first."""


@dataclass(frozen=True)
class Course:
    """What is known of the data in time."""

    times: Floats
    """(q,) instants at which data were sampled"""
    values: Floats
    """(q, k) weighted sums there, in parts of their largest size"""
    bends: Floats
    """(b,) instants where they bend, turn or jump; those of a jump are two, ACROSS apart at most"""
    jumps: tuple[str, ...]
    """sentences"""


def course(system: System, times: Floats) -> Course:
    """Sample the data of a system over a run, and find bends and jumps."""
    sampled = divided(times, 2, SAMPLES)
    read = _Sums(system)
    raw = np.array([read(float(t)) for t in sampled])
    size = np.abs(raw).max(axis=0)
    scale = np.where(size > 0, size, 1.0)

    def value(t: float) -> Floats:
        return read(t) / scale

    values = raw / scale
    jumps, sentences = _jumps(sampled, values, value, np.repeat(read.names, SUMS))
    bends = np.union1d(jumps, _bends(sampled, values, value))
    return Course(sampled, values, np.union1d(bends, _turns(sampled, values, value, bends)), sentences)


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


class _Sums:
    """Weighted sums of everything that drives a system, at an instant: (k,)."""

    def __init__(self, system: System):
        self._system = system
        self.names: list[str] = []
        self._weights: list[Floats] = []

    def __call__(self, t: float) -> Floats:
        blocks = list(self._blocks(t))
        if not self.names:
            self.names = [name for name, _ in blocks]
            self._weights = [_weights(len(block)) for _, block in blocks]
        return np.concatenate([W @ block for W, (_, block) in zip(self._weights, blocks, strict=True)])

    def _blocks(self, t: float) -> list[tuple[str, Floats]]:
        system = self._system
        gap = system.remaining_gap(t)
        blocks = [("load", system.force(t)), ("gap", gap)]
        if system.norms is not None:
            blocks.append(("bound of friction", system.norms.weights_under(t, np.ones(len(gap)))))
            blocks += [] if system.norms.ground is None else [("ground", system.norms.moved(t))]
        if system.motion is not None:
            blocks.append(("support", system.motion.prescribed_slip(t)))
        return blocks


def _weights(n: int) -> Floats:
    """(SUMS, n) numbers between 1/2 and 3/2, without a pattern."""
    k = np.arange(1, n + 1)
    return np.stack([0.5 + np.modf(k * np.sqrt(prime))[0] for prime in (2.0, 3.0, 5.0)[:SUMS]])


def _bends(times: Floats, values: Floats, value: Callable[[float], Floats]) -> Floats:
    """Instants inside intervals where the lines on both sides meet."""
    if len(times) < 4:
        return np.zeros(0)
    slopes = np.diff(values, axis=0) / np.diff(times)[:, None]
    turns = np.abs(np.diff(slopes, axis=0)).max(axis=1)
    # An interval's lines are those of its two neighbours; curvature is how these turn on their far sides.
    apart = np.abs(slopes[2:] - slopes[:-2]).max(axis=1)
    far = np.maximum(np.append(0.0, turns[:-2]), np.append(turns[2:], 0.0))
    width = np.diff(times)[1:-1]
    bent = np.flatnonzero((apart * width > BENT) & (apart > SHARP * far))
    bent = bent[np.argsort(-(apart * width)[bent], kind="stable")[:MOST]]
    found = [_meeting(times[j + 1], times[j + 2], values[j : j + 4], times[j : j + 4], value) for j in bent]
    return np.array([t for t in found if t is not None])


def _turns(times: Floats, values: Floats, value: Callable[[float], Floats], bends: Floats) -> Floats:
    """Instants where a datum is largest or smallest, and does not bend nor jump."""
    steps = np.diff(values, axis=0)
    smooth = np.searchsorted(bends, times[:-2]) == np.searchsorted(bends, times[2:], side="right")
    turning = (steps[:-1] * steps[1:] < 0) & (np.abs(np.diff(steps, axis=0)) > BENT)
    found = []
    for j in np.flatnonzero(turning.any(axis=1) & smooth)[:MOST]:
        k = int(np.argmax(turning[j] * np.abs(steps[j + 1] - steps[j])))
        about, data = times[j : j + 3], values[j : j + 3, k]
        top = _vertex(about, data)
        near = np.clip(top + NEARBY * (about[2] - about[0]) * np.array([-1.0, 0.0, 1.0]), about[0], about[2])
        if np.diff(near).min() > 0.0:
            better = _vertex(near, np.array([value(float(t))[k] for t in near]))
            top = better if near[0] < better < near[2] else top
        found.append(top)
    return np.array(found)


def _vertex(t: Floats, d: Floats) -> float:
    """Where the parabola through three points is level; the middle one, if they lie on a line."""
    left, right = (d[1] - d[0]) / (t[1] - t[0]), (d[2] - d[1]) / (t[2] - t[1])
    if left == right:
        return float(t[1])
    return float(0.5 * (t[0] + t[1]) + 0.5 * (t[2] - t[0]) * left / (left - right))


def _meeting(a: float, b: float, values: Floats, times: Floats, value: Callable[[float], Floats]) -> float | None:
    """Where the line through the first two points and that through the last two meet, looked at twice from nearby."""
    meet = _crossing(times, values)
    step = NEARBY * (b - a)
    for _ in range(2):
        if not a <= meet <= b:
            return None
        # Data need not exist outside the run, and other bends may be next door.
        nearby = np.clip(meet + step * np.array([-2.0, -1.0, 1.0, 2.0]), times[0], times[-1])
        if np.diff(nearby).min() <= 0.0:
            return meet
        better = _crossing(nearby, np.array([value(float(t)) for t in nearby]))
        if not nearby[0] < better < nearby[-1]:
            return meet
        meet, step = better, NEARBY * step
    return meet


def _crossing(times: Floats, values: Floats) -> float:
    left, right = (values[k + 1] - values[k] for k in (0, 2))
    left, right = left / (times[1] - times[0]), right / (times[3] - times[2])
    k = int(np.argmax(np.abs(left - right)))
    if left[k] == right[k]:
        return float(times[1])
    rest = (values[2, k] - right[k] * (times[2] - times[1])) - values[1, k]
    return float(times[1] + rest / (left[k] - right[k]))


def _jumps(
    times: Floats, values: Floats, value: Callable[[float], Floats], names: NDArray[np.str_]
) -> tuple[Floats, tuple[str, ...]]:
    """Two instants for each sudden change, and a sentence for each jump."""
    change = np.abs(np.diff(values, axis=0)).max(axis=1)
    usual = np.median(change)
    sudden = np.flatnonzero((change > SUDDEN) & (change > STEEP * usual))
    sudden = sudden[np.argsort(-change[sudden], kind="stable")[:MOST]]
    instants, sentences = [], []
    for j in np.sort(sudden):
        a, b, left, right = _narrowed(times[j], times[j + 1], values[j], values[j + 1], value)
        apart = np.abs(right - left)
        if apart.max() >= STAYS * change[j]:
            instants += [a, b]
            sentences.append(f"the {names[np.argmax(apart)]} jumps at t = {b:.9g}; no step is put inside")
    return np.array(instants), tuple(sentences)


def _narrowed(
    a: float, b: float, left: Floats, right: Floats, value: Callable[[float], Floats]
) -> tuple[float, float, Floats, Floats]:
    """The interval halved towards the larger change until that falls, or down to round-off; the data at its ends."""
    whole = np.abs(right - left).max()
    for _ in range(HALVINGS):
        t = 0.5 * (a + b)
        if not a < t < b:
            break
        middle = value(t)
        if np.abs(middle - left).max() >= np.abs(right - middle).max():
            b, right = t, middle
        else:
            a, left = t, middle
        if np.abs(right - left).max() < STAYS * whole:
            break
    return a, b, left, right
