"""The error of time steps, estimated by a run in finer steps (docs/theory/error_estimates.md).

Let u_n be the displacement of a run at the instant t_n, and u(t_n) the solution that is exact in time. Let v_n be the
displacement of a run that splits each step into FINER steps. If errors are of first order, the error of v_n in the
energy norm |.|_a is 1 / FINER of the error of u_n. The triangle inequality then gives

    |u_n - u(t_n)|_a <= |u_n - v_n|_a / (1 - 1 / FINER).

Let y_n and z_n be the contact unknowns of both runs, and S the stiffness condensed to the contact unknowns. Then
|u_n - v_n|_a^2 = (y_n - z_n)' S (y_n - z_n).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.stepping import PreparedRun, StepData, make_given_state, settle_from, step
from vemcvx.stepping.course import Course, sample_course, subdivide

FINER = 4  # least number of steps of the finer run in each step
TO_EXACT = 1.0 / (1.0 - 1.0 / FINER)


@dataclass(frozen=True)
class Finer:
    """The comparison of a run with a run in finer steps."""

    errors: Floats  # (N + 1,) estimated |u_n - u(t_n)|_a
    added: Floats  # (N,) estimated error that each step adds
    times: Floats  # (q,) the finer instants
    norm: float  # largest energy norm of the finer run
    bends: Floats  # (k,) instants of bends, turns and jumps of the data
    jumps: tuple[str, ...]


def compare_finer_steps(run: PreparedRun, times: Floats, initial: Floats, known: Course | None = None) -> Finer:
    """Compare a run from an initial state with a run in finer steps."""
    known = sample_course(run.system, times) if known is None else known
    if run.operators.count == 0 or len(times) == 1:
        none = np.zeros(len(times))
        return Finer(errors=none, added=none[1:], times=times, norm=0.0, bends=known.bends, jumps=known.jumps)
    finer = finer_instants(times, known)
    run = replace(run, check=False)
    own, _ = _march_retained(run, times, initial)
    other, norm = _march_retained(run, finer, initial)
    apart = own - other[np.searchsorted(finer, times)]
    K = run.operators.K
    errors, added = (
        TO_EXACT * np.sqrt(np.maximum(np.einsum("ni,ni->n", d, (K @ d.T).T), 0.0))
        for d in (apart, np.diff(apart, axis=0))
    )
    return Finer(errors=errors, added=added, times=finer, norm=norm, bends=known.bends, jumps=known.jumps)


def finer_instants(times: Floats, known: Course, parts: int = FINER) -> Floats:
    """Return instants that split each step into at least `parts` steps."""
    chosen, width = np.union1d(subdivide(times, parts, 8 * parts), known.bends), np.diff(known.times)
    slopes = np.diff(known.values, axis=0) / width[:, None]
    curved = 0.5 * np.abs(np.diff(slopes, axis=0)).max(axis=1) * (width[:-1] + width[1:])
    # `piece` is the index of an interval. Its length h obeys h^2 |f''| / 8 = .002, an interpolation error of data f.
    piece = np.floor(np.cumsum(np.sqrt(curved / 0.016)))
    return np.union1d(chosen, known.times[1:-1][np.diff(piece, prepend=0.0) > 0.0])


def _march_retained(run: PreparedRun, times: Floats, initial: Floats) -> tuple[Floats, float]:
    """Return the contact unknowns (N + 1, m) of a run, and the largest energy norm."""
    state = settle_from(run, make_given_state(run, StepData.evaluate(run.condensation, float(times[0])), initial))
    found = np.empty((len(times), len(state.y)))
    found[0] = state.y
    for n, t in enumerate(times[1:], start=1):
        state = step(run, state, n, float(t))
        found[n] = state.y
    return found, state.scale
