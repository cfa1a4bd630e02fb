"""What a march through time leaves: states, multipliers, the energy ledger and the certificates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.outline import ArrayRecord


@dataclass(frozen=True, kw_only=True, repr=False)
class Trajectory(ArrayRecord):
    """The backward-Euler solution of a System; scalars for all N + 1 instants, arrays for the stored S.

    Attributes
    ----------
    times : (N + 1,) array
    stored : (S,) array
        Step numbers of the rows of `state`, `multipliers` and `sticking`.
    state : (S, n) array
        y at the stored instants.
    multipliers : (S, m, block) array
        lam with K y = load - B'lam - D'p and |lam_i - c_i| <= w_i, c the bias, zero unless given.
    pressures : (S, r) array
        p >= 0 of the limits.
    weights : (S, m) array
        w of the norm terms.
    sticking : (S, m) array of bool
        Whether the increment B_i (y - y_prev) cannot be told from zero; true in row 0.
    worn : (S, m) array
        Work of each norm term since the initial instant, the cumulative sum of its w_i |s_i| over all steps, stored or
        not; a row sums to `dissipated`, but for what damping loses. Terms whose slip is given, where supports drag
        (:class:`vemcvx.program.norms.DraggedTerms`), follow the others here as in `multipliers`, `weights`,
        `sticking` and `stuck`.
    slipped : (S, m) array
        How far each norm term has slipped since the initial instant: the cumulative sum of its |s_i|, likewise.
    stuck : (N + 1,) array of int
        How many norm terms have such an increment, step by step.
    energy, dissipated, work : (N + 1,) arrays
        1/2 a(u, u); cumulative sum of w_i |s_i|; cumulative end-of-step forces times increments.
    norm : (N + 1,) array
        Energy norm |u_n|_a.
    gap, floor : (N + 1,) arrays
        Certified duality gap of each step, and what of it round-off alone may account for. Weights far above every
        multiplier count as lowered (:mod:`vemcvx.program.scaling`), here and in `dissipated`: the minimiser is the
        same.
    iterations, safeguards : (N + 1,) arrays of int
        Of the solver, and how many of them a globally convergent method had to stand in for a faster one.
    contraction : (N + 1,) array
        Rate with which the fixed point of friction that follows the answer contracted; NaN where there was none.
    estimated : (N + 1,) array of bool
        Where the certificate is an estimate and no bound: weights depend on the answer, and no solution was found to
        hold it against (:mod:`vemcvx.stepping.fixed_point`).
    unit : (N + 1,) array
        The energy norm that errors are relative to: the largest so far, or what the data could cause where all so far
        are zero at the accuracy asked (:mod:`vemcvx.stepping.acceptance`).
    seconds : dict
        "prepare" (factorisation, condensation, compilation) and "solve" (all steps).
    solver : str
        Name and settings of the solver that answered.
    linear : str
        Name and settings of the linear solver; "" in files that were written without it.
    accuracy : float or None
        The certified relative energy error that was asked of a step; None in files that were written without it.
    initial : (n,) array or None
        y at the initial instant, stored or not.
    velocity : (S, n) array or None
        (y_n - y_{n-1}) / k_n, where rates cost; zero in row 0, to which no step leads.
    """

    times: Annotated[Floats, "N"]
    stored: Annotated[Ints, "S"]
    state: Annotated[Floats, "S n"]
    multipliers: Annotated[Floats, "S terms block"]
    pressures: Annotated[Floats, "S limits"]
    weights: Annotated[Floats, "S terms"]
    sticking: Annotated[Bools, "S terms"]
    worn: Annotated[Floats, "S terms"]
    slipped: Annotated[Floats, "S terms"]
    stuck: Annotated[Ints, "N"]
    energy: Annotated[Floats, "N"]
    dissipated: Annotated[Floats, "N"]
    work: Annotated[Floats, "N"]
    norm: Annotated[Floats, "N"]
    gap: Annotated[Floats, "N"]
    floor: Annotated[Floats, "N"]
    iterations: Annotated[Ints, "N"]
    safeguards: Annotated[Ints, "N"]
    contraction: Annotated[Floats, "N"]
    estimated: Annotated[Bools, "N"]
    seconds: dict[str, float]
    solver: str
    linear: str = ""
    accuracy: float | None = None
    unit: Annotated[Floats | None, "N"] = None
    initial: Annotated[Floats | None, "n"] = None
    velocity: Annotated[Floats | None, "S n"] = None

    @property
    def certificate(self) -> Floats:
        """(N + 1,) certified relative energy error of each step: sqrt(2 gap_n) / max over m <= n of |u_m|_a.

        While all |u_m|_a are zero at the accuracy asked, relative to what the data could cause instead.
        """
        return relative(np.sqrt(2 * self.gap), self.scale)

    @property
    def certificate_kind(self) -> str:
        """What `certificate` is: "bound", or "estimate" if in some step it is no more than that."""
        return "estimate" if self.estimated.any() else "bound"

    @property
    def certificate_floor(self) -> Floats:
        """(N + 1,) the rounding floor of `certificate`: sqrt(2 floor_n) / max over m <= n of |u_m|_a."""
        return relative(np.sqrt(2 * self.floor), self.scale)

    @property
    def certificate_total(self) -> Floats:
        """(N + 1,) certified relative error of u_n, all steps' errors accumulated.

        The step map u_prev -> u_n of norms with given weights is nonexpansive in the energy norm, so
        |u_n - u_n*|_a <= sum over m <= n of sqrt(2 gap_m). With limits it is only if they never act; else the sum is
        that of the steps' own errors and no bound.
        """
        return relative(np.cumsum(np.sqrt(2 * self.gap)), self.scale)

    @property
    def scale(self) -> Floats:
        """(N + 1,) the energy norms that errors are relative to."""
        return np.maximum.accumulate(self.norm) if self.unit is None else self.unit


def relative(error: Floats, scale: Floats) -> Floats:
    """error / scale with 0/0 = 0; infinite where this is no number, which certifies nothing."""
    known = (error >= 0) & (scale > 0) & (scale < np.inf)
    ratio = np.divide(error, scale, out=np.full(np.shape(error), np.inf), where=known)
    return np.where((error == 0) & (scale == 0), 0.0, ratio)
