"""The error of the time steps: the run beside the same run in finer steps, which go to where its data bend and jump.

Steps of a condensed system are cheap. The run is marched again, on the same mesh, at its own instants and at finer
ones: FINER in every step, more where data turn faster than that, and wherever they bend or jump
(:mod:`vemcvx.stepping.course`). At the instants of the run both are driven by the same data, so that they differ by
what their contact forces do, and with S the condensed stiffness

    |u_n - u_n'|_a^2 = (y_n - y_n')' S (y_n - y_n')     on the unknowns that friction and limits read.

Finer steps have an error, too. Where it is of first order it is 1/FINER of what is looked for, and

    |u_n - u(t_n)|_a <= |u_n - u_n'|_a / (1 - 1/FINER).

Without friction nothing depends on the path, and no step loses anything.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.stepping import PreparedRun, StepData, make_given_state, settle_from, step
from vemcvx.stepping.course import Course, sample_course, subdivide

FINER, TO_EXACT = 4, 1.25
"""TO_EXACT stands for 1 / (1 - 1/FINER): the slow tests hold it to 1 to 5 times the truth on 40 random scenes."""


@dataclass(frozen=True)
class Finer:
    """A run beside one of finer steps; bends and jumps are those of its :class:`Course`."""

    errors: Floats
    """(N + 1,) estimated |u_n - u(t_n)|_a, TO_EXACT included"""
    added: Floats
    """(N,) what each step adds: the energy norm of the change of the difference, TO_EXACT included"""
    times: Floats
    """(q,) the finer instants"""
    norm: float
    """largest energy norm of the finer run"""
    bends: Floats
    jumps: tuple[str, ...]


def beside_finer(run: PreparedRun, times: Floats, initial: Floats, known: Course | None = None) -> Finer:
    """Compare a run from a state (n,) at times[0] with one in finer steps; `known` is what is known of its data."""
    known = sample_course(run.system, times) if known is None else known
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
        TO_EXACT * np.sqrt(np.maximum(np.einsum("ni,ni->n", d, (K @ d.T).T), 0.0))
        for d in (apart, np.diff(apart, axis=0))
    )
    return Finer(errors=errors, added=added, times=finer, norm=norm, bends=known.bends, jumps=known.jumps)


def finer_instants(times: Floats, known: Course, parts: int = FINER) -> Floats:
    """Parts of every step, 8 times as many in all, bends and jumps, and samples where straight lines miss the data."""
    chosen, width = np.union1d(subdivide(times, parts, 8 * parts), known.bends), np.diff(known.times)
    slopes = np.diff(known.values, axis=0) / width[:, None]
    curved = 0.5 * np.abs(np.diff(slopes, axis=0)).max(axis=1) * (width[:-1] + width[1:])
    # Lines over pieces of the length h miss data by h^2 f'' / 8: by 2e-3 of their size, if int (f'' / .016)^{1/2} dt
    # is one over each piece.
    piece = np.floor(np.cumsum(np.sqrt(curved / 0.016)))
    return np.union1d(chosen, known.times[1:-1][np.diff(piece, prepend=0.0) > 0.0])


def _followed(run: PreparedRun, times: Floats, initial: Floats) -> tuple[Floats, float]:
    """Retained unknowns (N + 1, m) at the instants, and the largest energy norm."""
    state = settle_from(run, make_given_state(run, StepData.evaluate(run.condensation, float(times[0])), initial))
    found = np.empty((len(times), len(state.y)))
    found[0] = state.y
    for n, t in enumerate(times[1:], start=1):
        state = step(run, state, n, float(t))
        found[n] = state.y
    return found, state.scale
