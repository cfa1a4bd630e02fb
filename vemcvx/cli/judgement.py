"""Answers of several solvers to one problem, held against each other and their certificates.

Steps with given weights are nonexpansive in the energy norm, so two answers y, z to the same steps obey

    |y_n - z_n|_K <= sum over m <= n of sqrt(2 gap_m) + sqrt(2 floor_m), of y, plus the same of z.

The left side is exact: K is the matrix of the scene. Against the most certain answer, whose right side is the
smallest, that is a test of every certificate: those that keep it are *honest*. A certificate that is as small as was
asked for is *good*; an honest one need not be. Where the weights follow the answer, or friction or rates meet
limits, a step depends on the one before in ways that the sum does not bound
(:class:`vemcvx.stepping.trajectory.Trajectory`); the distance is then told only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.program.system import System
from vemcvx.stepping.trajectory import Trajectory

CERTIFIED, MISSED, REFUSED, FAILED, STOPPED = "certified", "missed", "refused", "failed", "stopped"
"""What became of a solver: good; not as good as asked; unable to take the program; broken down; out of time."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """What one solver, with some settings, made of the problem: a trajectory, or why not."""

    solver: str
    settings: str
    """own, tuned, or default"""
    accuracy: float
    trajectory: Trajectory | None = None
    seconds: dict[str, float] | None = None
    """assemble, prepare, solve"""
    outcome: str = CERTIFIED
    says: str = ""

    @property
    def label(self) -> str:
        """Solver and settings, as messages call them."""
        return self.solver if self.settings == "own" else f"{self.solver} ({self.settings})"

    @property
    def in_words(self) -> str:
        """What came of it, before it is held against others."""
        if self.trajectory is None or self.seconds is None:
            return f"{self.label}: {self.outcome}"
        certified, seconds = self.trajectory.certificate.max(), sum(self.seconds.values())
        return f"{self.label}: certified to {certified:.1e} in {seconds:.2f} s"


@dataclass(frozen=True)
class Apart:
    """Distance of two answers and what their certificates allow, relative, where it matters most."""

    distance: float
    allowed: float
    kept: bool


@dataclass(frozen=True, kw_only=True)
class Row:
    """What is told of an attempt; errors are relative to the largest energy norm of the states so far."""

    solver: str
    settings: str
    outcome: str
    asked: float
    certified: float | None = None
    floor: float | None = None
    distance: float | None = None
    allowed: float | None = None
    honest: bool | None = None
    good: bool | None = None
    iterations: int | None = None
    """at the median step"""
    safeguards: int | None = None
    """in all steps"""
    assemble_seconds: float | None = None
    prepare_seconds: float | None = None
    solve_seconds: float | None = None
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """All rows, in the order asked for, and the solver that the others are held against."""

    rows: tuple[Row, ...]
    most_certain: str | None
    rigorous: bool
    """whether certificates bound distances here"""

    @property
    def liars(self) -> tuple[str, ...]:
        """Whose answers are farther from the most certain one than both certificates allow."""
        return tuple(f"{row.solver} ({row.settings})" for row in self.rows if row.honest is False)

    @property
    def trustworthy(self) -> bool:
        """Whether some answer is certified as asked, and no certificate was contradicted."""
        return any(row.good for row in self.rows) and not self.liars


def judged(system: System, attempts: Sequence[Attempt]) -> Judged:
    """A row for every attempt, each held against the most certain one."""
    answered = [a.trajectory for a in attempts if a.trajectory is not None and _bounded(a.trajectory)]
    best = min(answered, key=lambda trajectory: allowed(trajectory)[-1], default=None)
    rigorous = bounds_distance(system)
    rows = tuple(_row(system, attempt, best, rigorous) for attempt in attempts)
    certain = next((a.label for a in attempts if best is not None and a.trajectory is best), None)
    return Judged(rows=rows, most_certain=certain, rigorous=rigorous)


def _bounded(trajectory: Trajectory) -> bool:
    """Whether it is an answer at all: numbers, with certificates that are no infinities."""
    return bool(np.isfinite(trajectory.state).all() and np.isfinite(allowed(trajectory)).all())


def allowed(trajectory: Trajectory) -> Floats:
    """(N + 1,) how far the certificates allow the states to be from the exact ones, in energy norm."""
    total: Floats = np.cumsum(np.sqrt(2 * trajectory.gap) + np.sqrt(2 * trajectory.floor))
    return total


def distance(system: System, one: Trajectory, other: Trajectory) -> Apart:
    """How far two answers are apart: where the certificates allow less, else where it is largest."""
    apart = one.state - other.state
    length = np.sqrt(np.maximum(np.einsum("ni,in->n", apart, system.K @ apart.T), 0.0))
    limit, unit = allowed(one) + allowed(other), np.where(one.scale > 0, one.scale, 1.0)
    excess = length - limit
    n = int(np.argmax(excess)) if (excess > 0).any() else int(np.argmax(length / unit))
    return Apart(float(length[n] / unit[n]), float(limit[n] / unit[n]), bool((excess <= 0).all()))


def bounds_distance(system: System) -> bool:
    """Whether the certificates of all steps, added up, bound the distance of two answers."""
    if system.limits is None:
        return not system.follows_answer
    # Without norm terms and rates a step knows nothing of the one before, and only its own certificate counts.
    return system.norms is None and system.damping is None


def _row(system: System, attempt: Attempt, best: Trajectory | None, rigorous: bool) -> Row:
    told = Row(
        solver=attempt.solver,
        settings=attempt.settings,
        outcome=attempt.outcome,
        asked=attempt.accuracy,
        says=attempt.says,
    )
    run, seconds = attempt.trajectory, attempt.seconds or {}
    if run is None:
        return told
    apart = None if best is None or run is best or not _bounded(run) else distance(system, best, run)
    missed = np.flatnonzero(run.certificate > attempt.accuracy)
    return replace(
        told,
        outcome=MISSED if len(missed) else CERTIFIED,
        certified=float(run.certificate.max()),
        floor=float(run.certificate_floor.max()),
        distance=None if apart is None else apart.distance,
        allowed=None if apart is None else apart.allowed,
        honest=apart.kept if apart is not None and rigorous else None,
        good=len(missed) == 0,
        iterations=int(np.median(run.iterations[1:])) if len(run.times) > 1 else 0,
        safeguards=int(run.safeguards.sum()),
        assemble_seconds=seconds.get("assemble"),
        prepare_seconds=seconds.get("prepare"),
        solve_seconds=seconds.get("solve"),
        says=_of_misses(run, missed),
    )


def _of_misses(run: Trajectory, missed: Ints) -> str:
    if len(missed) == 0:
        return ""
    n, later = missed[0], np.count_nonzero(missed)
    # A settled state is solved for, too, and is none of the steps.
    where = (["at the start"] if n == 0 else []) + ([f"in {later} of {len(run.times) - 1} steps"] if later else [])
    return (
        f"misses its accuracy {' and '.join(where)}, "
        f"first in step {n} at t = {run.times[n]:.6g}, where it reached {run.certificate[n]:.1e}"
    )
