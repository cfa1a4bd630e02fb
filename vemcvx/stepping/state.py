"""What a march carries from step to step: what all steps of a run share, and everything known at an instant."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vemcvx.arrays import EPS, Bools, Floats, lengths
from vemcvx.linear import LinearSolver
from vemcvx.program.answer import Answer
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation
from vemcvx.program.iterative_refinement import needs_refinement
from vemcvx.program.operators import Operators
from vemcvx.program.scaling import Scaling, scaling
from vemcvx.program.system import System
from vemcvx.solvers import Prepared, Solver, Solves, choose_solver
from vemcvx.solvers.response import Response
from vemcvx.solvers.semidefinite import ProximalPoints
from vemcvx.solvers.solver import named_failures
from vemcvx.stepping.ledger import Ledger, StepData, step_data
from vemcvx.stepping.softening import Stability, stability_of


@dataclass(frozen=True, kw_only=True)
class PreparedRun:
    """What all steps share."""

    system: System
    condensation: Condensation
    scaling: Scaling
    solver: Solver
    prepared: Prepared
    check: bool
    refines: bool
    """whether the factors are too coarse for the accuracy, so that every step is refined"""

    default: bool = False
    """whether nobody asked for the solver's accuracy: at the rounding floor an answer is then good enough"""

    begin: tuple[StepData, ...] = ()
    """what drives the system at the first instants, solved for beforehand"""

    share: float = 1.0
    """of the solver's accuracy that steps are solved to, where answers are but a part of something"""

    @property
    def accuracy(self) -> float:
        """To which steps are solved."""
        return self.share * self.solver.accuracy

    @property
    def most(self) -> float:
        """Iterations that a step may take."""
        return self.solver.max_iterations

    def driven(self, t: float) -> StepData:
        """What drives the system at an instant."""
        known = (data for data in self.begin if data.t == t)
        return next(known, None) or step_data(self.system, self.condensation, t)

    def after(self, iterations: int) -> PreparedRun:
        """The run whose solver has taken so many of them."""
        solver = self.solver.after(iterations)
        return self if solver is self.solver else self.asking(solver)

    def asking(self, solver: Solver) -> PreparedRun:
        """The run that asks another solver."""
        return replace(self, solver=solver, prepared=prepared_solver(solver, self.scaling.operators, self.system))

    @cached_property
    def response(self) -> Response:
        """How norm terms and limits of the scaled operators move under each other's forces."""
        return Response(self.scaling.operators)

    @cached_property
    def stability(self) -> Stability | None:
        """Of weights that fall with slip; None where it is not known how fast they do."""
        norms = self.system.norms
        return None if norms is None else stability_of(self.operators, norms)

    @property
    def operators(self) -> Operators:
        """The condensed operators, in the units of the system."""
        return self.condensation.operators


@dataclass(frozen=True)
class Dragged:
    """What supports drag along against friction, after a step: see :mod:`vemcvx.stepping.dragged`."""

    weights: Floats
    """(q,)"""
    lam: Floats
    """(q, block) multipliers, the bias included"""
    still: Bools
    """(q,) which did not slip"""
    worn: Floats
    """(q,) cumulative loss"""
    slipped: Floats
    """(q,) and cumulative slip"""

    @classmethod
    def nothing(cls, q: int, block: int) -> Dragged:
        """No loss and no weight."""
        return cls(np.zeros(q), np.zeros((q, block)), np.ones(q, dtype=bool), np.zeros(q), np.zeros(q))


@dataclass(frozen=True)
class Earlier:
    """Multipliers of the step before: from them and its own a state expects the next ones."""

    t: float
    lam: Floats
    """(m, block)"""
    p: Floats
    """(r,)"""


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything known at an instant; retained unknowns only."""

    t: float
    y: Floats
    """(m,)"""
    unbalanced: Floats
    """(m,) load - K y, which the norm terms hold"""
    data: StepData
    weights: Floats
    """(m,) of the friction bounds"""
    capped_weights: Floats
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
    """estimated constant of contraction of the fixed point, where weights depend on the answer"""
    full: Floats | None = None
    """(n,) `unknowns`, once somebody has asked for them"""
    size: float = 0.0
    """largest energy norm that the data could cause; computed only while the states are far smaller"""
    noise: float = 0.0
    """largest energy norm that friction's forces alone could cause, of a state that is no more than their rounding"""
    earlier: Earlier | None = None
    """multipliers of the step before, if there was one"""
    dragged: Dragged = field(default_factory=lambda: Dragged.nothing(0, 1))
    """as of the step before while the step is on"""
    velocity: Floats | None = None
    """(n,) their increments over the length of the step, where rates cost"""

    @classmethod
    def still(cls, operators: Operators, data: StepData, y: Floats, weights: Floats, energy: float = 0.0) -> State:
        """The state y (m,) with that energy, whatever led to it: as far as is known, nothing slipped or pressed."""
        nothing, none = np.zeros((operators.count, operators.block)), np.zeros(len(operators.compliance))
        ledger = Ledger.opening(energy, operators.count)
        return cls(
            t=data.t,
            y=y,
            unbalanced=data.force.retained - operators.force(y),
            data=data,
            weights=weights,
            capped_weights=weights,
            lam=nothing,
            p=none,
            slip=nothing,
            certificate=Certificate(0.0, np.zeros(operators.count), 0.0, none),
            ledger=ledger,
            scale=ledger.norm,
            iterations=0,
        )

    @property
    def unknowns(self) -> Floats:
        """(n,) all unknowns, of a state that is certified in full."""
        if self.full is None:
            raise LookupError("state: the unknowns inside are not recovered; certified_in_full() does.")
        return self.full

    def answer(self, d: Floats, lam: Floats, p: Floats) -> Answer:
        """An answer (d, lam, p) that took what this state took."""
        return Answer(d=d, lam=lam, p=p, iterations=self.iterations, status=self.status, safeguards=self.safeguards)

    def expected(self, t: float) -> tuple[Floats, Floats]:
        """Multipliers (m, block) and (r,) to begin with at the next instant `t`: they go on as they changed last.

        That is in proportion to time, by no more than they changed then, and p >= 0. On the paper's scene,
        h = k = 1/256, a second active set is then needed in 19 steps instead of 116.
        """
        before = self.earlier
        if before is None or not before.t < self.t:
            return self.lam, self.p
        share = min(1.0, (t - self.t) / (self.t - before.t))
        lam, p = self.lam + share * (self.lam - before.lam), self.p + share * (self.p - before.p)
        return lam, np.maximum(p, 0.0)

    def unit(self, accuracy: float) -> float:
        """The energy norm that errors are relative to: see :mod:`vemcvx.stepping.acceptance`."""
        size = max(self.size, self.noise)
        return size if self.scale <= accuracy * size else self.scale

    def accepted(self, accuracy: float) -> bool:
        """Whether the certified error is within the accuracy."""
        return self.certificate.error <= accuracy * self.unit(accuracy)


def sticking(run: PreparedRun, state: State) -> Bools:
    """Increments that the certificate cannot tell from zero: |s_i - s_i*| <= flexibility^{1/2} |d - d*|."""
    operators = run.operators
    if operators.count == 0:
        return np.zeros(0, dtype=bool)
    blur = EPS * np.abs(operators.blocks(operators.rows.absolute.read(np.abs(state.y)))).max(axis=1)
    error = state.certificate.error + state.certificate.error_floor
    sticks: Bools = lengths(state.slip) <= error * np.sqrt(operators.norm_flexibility) + blur
    return sticks


def prepared_solver(solver: Solver, operators: Operators, system: System) -> Prepared:
    """The solver, prepared for scaled operators; by proximal points where K has a kernel and it takes none."""
    with named_failures(solver.name):
        if operators.kernel is None or solver.semidefinite:
            return solver.prepare(operators)
        return ProximalPoints(solver, operators, follows=system.norms is not None and system.norms.ground is not None)


def prepare(
    system: System,
    solver: Solver | Solves | None,
    check: bool,
    condense: bool,
    linear: LinearSolver | None = None,
    begin: Iterable[float] = (),
) -> PreparedRun:
    """Factorise, condense, scale, and let the solver do what all steps share.

    What drives the system at the instants `begin`, those which the run asks for first, is solved for beside the samples
    that tell how sharp the factor is.
    """
    condensation = Condensation(system, condense, linear)
    chosen = choose_solver(condensation.operators, solver)
    scales = scaling(condensation.operators)
    prepared = prepared_solver(chosen, scales.operators, system)
    driven = tuple(step_data(system, condensation, t) for t in begin)
    refines = condensation.refinable and needs_refinement(condensation, chosen.accuracy)
    return PreparedRun(
        system=system,
        condensation=condensation,
        scaling=scales,
        solver=chosen,
        prepared=prepared,
        check=check,
        refines=refines,
        default=solver is None,
        begin=driven,
    )
