"""The error of the time steps: by a comparison with finer ones, and by what instants lack of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.program.system import System
from vemcvx.stepping.backward_euler import QuasistaticSteps, settled_from
from vemcvx.stepping.state import PreparedRun

# The course of a system's data in time: where they bend, and where they jump.
#
# Data are sampled at instants 1/256 of the run apart, or at the ends and middles of the steps where these are
# shorter: what is over between two of them is not seen. Of every kind (load, bounds of friction, gaps, moving
# supports and ground) a few weighted sums are kept, with weights that have nothing in common with any scene, so that
# what changes changes them.
#
# - A *bend* lies where the straight lines on both sides of an interval meet; a second look from nearby finds it to
#   round-off.
# - A datum *turns* where it is largest or smallest: what slips one way there slips the other way from then on. The
#   vertex of the parabola through three samples, and again through three nearby, counts as a bend.
# - A *jump* is what is left of a change when the interval is halved, and halved again, down to round-off.


SUMS = 3
BENT = 1e-6
"""Part of a datum's size: lines on two sides of an interval that miss each other by less are one."""
SUDDEN, STEEP = 0.02, 4.0
"""Change of a datum within an interval, in parts of its size and of its neighbours' changes, that may be a jump."""
NEARBY = 1.0 / 64.0
ACROSS = 1e-9
"""Steps of no more than this part of the run are those across a jump."""
MOST = 200
"""Bends and jumps are looked for in no more intervals than this, the largest first."""


@dataclass(frozen=True)
class Course:
    """The data in time: samples, bends, turns and jumps."""

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
    # Data are looked at at 256 instants of the run at least.
    sampled = divided(times, 2, 256)
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
            bounds = np.append(system.norms.weights_under(t, np.ones(len(gap))), system.bias(t))
            blocks.append(("bound of friction", bounds))
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
    # A bend stands out eight times from the curvature on either side.
    bent = np.flatnonzero((apart * width > BENT) & (apart > 8.0 * far))
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
    """The vertex of the parabola through three points; the middle one, if they lie on a line."""
    left, right = (d[1] - d[0]) / (t[1] - t[0]), (d[2] - d[1]) / (t[2] - t[1])
    if left == right:
        return float(t[1])
    return float(0.5 * (t[0] + t[1]) + 0.5 * (t[2] - t[0]) * left / (left - right))


def _meeting(a: float, b: float, values: Floats, times: Floats, value: Callable[[float], Floats]) -> float | None:
    """The bend where the line through the first two points meets that through the last two, refined twice."""
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
        # Where data jump a quarter of the change is left, however short the interval.
        if apart.max() >= 0.25 * change[j]:
            instants += [a, b]
            sentences.append(f"the {names[np.argmax(apart)]} jumps at t = {b:.9g}; no step is put inside")
    return np.array(instants), tuple(sentences)


def _narrowed(
    a: float, b: float, left: Floats, right: Floats, value: Callable[[float], Floats]
) -> tuple[float, float, Floats, Floats]:
    """The interval halved towards the larger change until that falls, or down to round-off; the data at its ends."""
    whole = np.abs(right - left).max()
    for _ in range(30):
        t = 0.5 * (a + b)
        if not a < t < b:
            break
        middle = value(t)
        if np.abs(middle - left).max() >= np.abs(right - middle).max():
            b, right = t, middle
        else:
            a, left = t, middle
        if np.abs(right - left).max() < 0.25 * whole:
            break
    return a, b, left, right


# What steps cost: the run beside the same run in finer steps.
#
# Steps of a condensed system are cheap. The run is marched again, on the same mesh, at its own instants and at finer
# ones: PARTS in every step, more where data turn faster than that, and wherever they bend or jump
# (:mod:`.data_in_time`). At the instants of the run both are driven by the same data, so that they differ by what
# their contact forces do, and with S the condensed stiffness
#
#     |u_n - u_n'|_a^2 = (y_n - y_n')' S (y_n - y_n')     on the unknowns that friction and limits read.
#
# Finer steps have an error, too. Where it is of first order it is 1/PARTS of what is looked for, and
#
#     |u_n - u(t_n)|_a <= |u_n - u_n'|_a / (1 - 1/PARTS);
#
# MARGIN is more than that, for orders that are not clean. Without friction nothing depends on the path, and no step
# loses anything.


PARTS = 4
MARGIN = 1.25


@dataclass(frozen=True)
class Finer:
    """A run beside one of finer steps; bends and jumps are those of its :class:`.data_in_time.Course`."""

    errors: Floats
    """(N + 1,) estimated |u_n - u(t_n)|_a, MARGIN included"""
    added: Floats
    """(N,) what each step adds: the energy norm of the change of the difference, MARGIN included"""
    times: Floats
    """(q,) the finer instants"""
    norm: float
    """largest energy norm of the finer run"""
    bends: Floats
    jumps: tuple[str, ...]


def beside_finer(run: PreparedRun, times: Floats, initial: Floats, known: Course | None = None) -> Finer:
    """Compare a run from a state (n,) at times[0] with one in finer steps; `known` is what is known of its data."""
    known = course(run.system, times) if known is None else known
    if run.operators.count == 0 or len(times) == 1:
        none = np.zeros(len(times))
        return Finer(errors=none, added=none[1:], times=times, norm=0.0, bends=known.bends, jumps=known.jumps)
    finer = finer_instants(times, known)
    run = replace(run, check=False)
    own, _ = _followed(run, times, initial)
    other, norm = _followed(run, finer, initial)
    apart = own - other[np.searchsorted(finer, times)]
    K = run.operators.K
    errors, added = (
        MARGIN * np.sqrt(np.maximum(np.einsum("ni,ni->n", d, (K @ d.T).T), 0.0))
        for d in (apart, np.diff(apart, axis=0))
    )
    return Finer(errors=errors, added=added, times=finer, norm=norm, bends=known.bends, jumps=known.jumps)


def finer_instants(times: Floats, known: Course) -> Floats:
    """PARTS in every step, at least 32 in all, bends and jumps, and samples where straight lines miss the data."""
    chosen = np.union1d(divided(times, PARTS, 32), known.bends)
    for _ in range(int(np.ceil(np.log2(len(known.times))))):
        missed = _worst_between(chosen, known)
        if len(missed) == 0:
            break
        chosen = np.union1d(chosen, missed)
    return chosen


def _worst_between(chosen: Floats, known: Course) -> Floats:
    """In every interval of `chosen`, the sample that the straight line between its ends misses most, if too much."""
    at = np.stack([np.interp(chosen, known.times, column) for column in known.values.T], axis=1)
    line = np.stack([np.interp(known.times, chosen, column) for column in at.T], axis=1)
    off = np.abs(known.values - line).max(axis=1)
    interval = np.searchsorted(chosen, known.times, side="right") - 1
    order = np.lexsort((-off, interval))
    first: Ints = order[np.append(True, np.diff(interval[order]) > 0)]
    samples = known.times[first]
    # Data between two finer instants are straight but for this part of their size.
    missed: Bools = (off[first] > 2e-3) & ~np.isin(samples, chosen)
    return samples[missed]


def _followed(run: PreparedRun, times: Floats, initial: Floats) -> tuple[Floats, float]:
    """Retained unknowns (N + 1, m) at the instants, and the largest energy norm."""
    state = settled_from(run, float(times[0]), initial)
    found = np.empty((len(times), len(state.y)))
    found[0] = state.y
    for n, t in enumerate(times[1:], start=1):
        state = QuasistaticSteps(run).step(state, n, float(t))
        found[n] = state.y
    return found, state.scale
