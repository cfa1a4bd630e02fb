"""The error of time steps: a comparison with the same run in finer steps, with instants where data bend and jump.

The run is repeated on the same mesh, with each step split into FINER steps, more where data vary faster. For the run u
and the finer run v, |u_n - v_n|_a^2 = (y_n - z_n)' S (y_n - z_n), with contact unknowns y of u and z of v, and the
condensed matrix S (docs/theory/error_estimates.md).

If errors are of first order, |u_n - u(t_n)|_a <= |u_n - v_n|_a / (1 - 1/FINER). Without friction, viscosity and
VelocityContact, nothing depends on the path, and steps make no error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.stepping import PreparedRun, StepData, make_given_state, settle_from, step
from vemcvx.stepping.course import Course, sample_course, subdivide

FINER, TO_EXACT = 4, 1.25
"""Number of finer steps per step, and factor of |u_n - v_n|_a. In tests, 1.25 suffices in place of 4/3."""


@dataclass(frozen=True)
class Finer:
    """The comparison of a run with a run in finer steps; `bends` and `jumps` are as in the :class:`Course` of data."""

    errors: Floats  # (N + 1,) estimated |u_n - u(t_n)|_a, with the factor TO_EXACT
    added: Floats  # (N,) error added by each step: TO_EXACT times the energy norm of the change of u - v
    times: Floats  # (q,) the finer instants
    norm: float  # largest energy norm of the finer run
    bends: Floats
    jumps: tuple[str, ...]


def compare_finer_steps(run: PreparedRun, times: Floats, initial: Floats, known: Course | None = None) -> Finer:
    """Compare a run from a state (n,) at times[0] with a run in finer steps; `known` is the course of the data."""
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
    """Return finer instants: `parts` pieces per step, at least 8 * `parts` in all, and bends, jumps and samples.

    Samples are added where linear interpolation between the instants is too far from the data.
    """
    chosen, width = np.union1d(subdivide(times, parts, 8 * parts), known.bends), np.diff(known.times)
    slopes = np.diff(known.values, axis=0) / width[:, None]
    curved = 0.5 * np.abs(np.diff(slopes, axis=0)).max(axis=1) * (width[:-1] + width[1:])
    # Linear interpolation on a piece of length h has the error h^2 f'' / 8. It is 2e-3 of the size of the data if
    # int (f'' / .016)^{1/2} dt = 1 over each piece.
    piece = np.floor(np.cumsum(np.sqrt(curved / 0.016)))
    return np.union1d(chosen, known.times[1:-1][np.diff(piece, prepend=0.0) > 0.0])


def _march_retained(run: PreparedRun, times: Floats, initial: Floats) -> tuple[Floats, float]:
    """March a run; return the retained unknowns (N + 1, m) at the instants, and the largest energy norm."""
    state = settle_from(run, make_given_state(run, StepData.evaluate(run.condensation, float(times[0])), initial))
    found = np.empty((len(times), len(state.y)))
    found[0] = state.y
    for n, t in enumerate(times[1:], start=1):
        state = step(run, state, n, float(t))
        found[n] = state.y
    return found, state.scale
