"""What steps cost: the run beside the same run in finer steps.

Steps of a condensed system are cheap. The run is marched again, on the same mesh, at its own instants and at finer
ones: PARTS in every step, more where data turn faster than that, and wherever they bend or jump
(:mod:`.data_in_time`). At the instants of the run both are driven by the same data, so that they differ by what
their contact forces do, and with S the condensed stiffness

    |u_n - u_n'|_a^2 = (y_n - y_n')' S (y_n - y_n')     on the unknowns that friction and limits read.

Finer steps have an error, too. Where it is of first order it is 1/PARTS of what is looked for, and

    |u_n - u(t_n)|_a <= |u_n - u_n'|_a / (1 - 1/PARTS);

MARGIN is more than that, for orders that are not clean. Without friction nothing depends on the path, and no step
loses anything.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.estimate.budget.data_in_time import Course, course, divided
from vemcvx.stepping.backward_euler import QuasistaticSteps
from vemcvx.stepping.initial import settled_from
from vemcvx.stepping.state import PreparedRun

PARTS = 4
AT_LEAST = 32
"""Finer steps in the whole run."""
MARGIN = 1.25
FOLLOWED = 2e-3
"""Data between two finer instants are straight but for this part of their size."""


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
    """PARTS in every step, AT_LEAST in all, bends and jumps, and samples where straight lines between miss the data."""
    chosen = np.union1d(divided(times, PARTS, AT_LEAST), known.bends)
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
    missed: Bools = (off[first] > FOLLOWED) & ~np.isin(samples, chosen)
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
