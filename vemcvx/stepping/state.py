"""What a march carries from step to step: what all steps of a run share, and everything known at an instant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vemcvx.linear import LinearSolver
from vemcvx.program.certificate import EPS, Certificate
from vemcvx.program.condensation import Condensation
from vemcvx.program.form import Form
from vemcvx.program.refinement import needs_refinement
from vemcvx.program.scaling import Scaling, scaling
from vemcvx.program.system import System
from vemcvx.solvers import Newton, Prepared, Solver, choose
from vemcvx.solvers.response import Response
from vemcvx.stepping.acceptance import insist
from vemcvx.stepping.ledger import Drive, Ledger

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """What all steps share."""

    system: System
    condensation: Condensation
    scaling: Scaling
    solver: Solver
    prepared: Prepared
    check: bool
    refines: bool
    """whether the factors are too coarse for the accuracy, so that every step is refined"""

    share: float = 1.0
    """of the solver's accuracy that steps are solved to, where answers are but a part of something"""

    @property
    def accuracy(self) -> float:
        """To which steps are solved."""
        return self.share * self.solver.accuracy

    def insist(self, state: State, n: int) -> None:
        """Raise NotCertified when the state after step `n` misses the solver's accuracy."""
        insist(
            self.solver,
            self.system.norms,
            state.certificate,
            state.unit(self.solver.accuracy),
            state.status,
            n,
            state.t,
        )

    @property
    def most(self) -> float:
        """Iterations that a step may take; no end of them where the solver's settings do not say."""
        return getattr(self.solver, "max_iterations", np.inf)

    def after(self, iterations: int) -> Run:
        """The run whose solver has taken so many of them."""
        if iterations == 0 or type(self.solver) is not Newton:
            return self
        solver = replace(self.solver, max_iterations=max(self.solver.max_iterations - iterations, 1))
        return replace(self, solver=solver, prepared=solver.prepare(asked_of(solver, self.scaling)))

    @cached_property
    def response(self) -> Response:
        """How norm terms and limits of the scaled form move under each other's forces."""
        return Response(self.scaling.form)

    @property
    def form(self) -> Form:
        """The condensed form, in the units of the system."""
        return self.condensation.form


@dataclass(frozen=True)
class Dragged:
    """What supports drag along against friction, after a step: see :mod:`vemcvx.stepping.dragged`."""

    weights: Floats
    """(q,)"""
    lam: Floats
    """(q, block) multipliers, the bias included"""
    still: NDArray[np.bool_]
    """(q,) which did not slip"""
    worn: Floats
    """(q,) cumulative loss"""


@dataclass(frozen=True)
class State:
    """Everything known at an instant; touched unknowns only."""

    t: float
    y: Floats
    """(m,)"""
    unbalanced: Floats
    """(m,) load - K y, which the norm terms hold"""
    drive: Drive
    weights: Floats
    """(m,) of the friction bounds"""
    walls: Floats
    """(m,) the weights, those far above every multiplier lowered"""
    lam: Floats
    p: Floats
    """(r,) forces of the limits"""
    slip: Floats
    """(m, block) s of the step that led here"""
    certificate: Certificate
    ledger: Ledger
    scale: float
    """largest energy norm of the states so far"""
    iterations: int
    status: str = ""
    """in the solver's own words"""
    safeguards: int = 0
    """how many of the iterations stood in for faster ones"""
    rate: float = np.nan
    """with which the fixed point of pressure-dependent weights contracted"""
    full: Floats | None = None
    """(n,) all unknowns, once somebody has asked for them"""
    size: float = 0.0
    """largest energy norm that the data could cause, looked at while the states are nothing beside it"""
    noise: float = 0.0
    """what friction's own forces could, where this state is but their rounding"""
    dragged: Dragged | None = None
    """always known between steps"""
    velocity: Floats | None = None
    """(n,) their increments over the length of the step, where rates cost"""

    def unit(self, accuracy: float) -> float:
        """The energy norm that errors are relative to: see :mod:`vemcvx.stepping.acceptance`."""
        size = max(self.size, self.noise)
        return size if self.scale <= accuracy * size else self.scale

    def accepted(self, accuracy: float) -> bool:
        """Whether the certified error is within the accuracy."""
        return self.certificate.error <= accuracy * self.unit(accuracy)


def sticking(run: Run, state: State) -> NDArray[np.bool_]:
    """Increments that the certificate cannot tell from zero: |s_i - s_i*| <= compliance^{1/2} |d - d*|."""
    form = run.form
    if form.count == 0:
        return np.zeros(0, dtype=bool)
    blur = EPS * np.abs(form.blocks(form.rows.absolute.read(np.abs(state.y)))).max(axis=1)
    error = state.certificate.error + state.certificate.error_floor
    return np.linalg.norm(state.slip, axis=1) <= error * np.sqrt(form.compliance) + blur


def asked_of(solver: Solver, scales: Scaling) -> Form:
    """The scaled form that the solver is asked for: with a kernel only where it takes one."""
    return scales.form if solver.semidefinite else scales.form.regular


def prepare(
    system: System, solver: Solver | None, check: bool, condense: bool, linear: LinearSolver | None = None
) -> Run:
    """Factorise, condense, scale, and let the solver do what all steps share."""
    condensation = Condensation(system, condense, linear)
    chosen = choose(condensation.form, solver)
    scales = scaling(condensation.form)
    plain = condensation.form.separate and not condensation.form.softness.any()
    refines = plain and needs_refinement(condensation, chosen.accuracy)
    return Run(system, condensation, scales, chosen, chosen.prepare(asked_of(chosen, scales)), check, refines)
