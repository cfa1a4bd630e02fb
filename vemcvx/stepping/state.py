"""The state of a run after a step, and what a run prepares once.

When friction that weakens with slip leaves a step convex. With Phi_i the integral of the weights w_i over the slip of
the step, a step minimises

    1/2 d'Kd - g'd + sum_i Phi_i(|s_i|),     s = B d - b.

Weights that fall no faster than k_i per slip make Phi_i + k_i |s_i|^2 / 2 convex, and the step is strongly convex where
the sum of these squares is less than the elastic energy: with

    rho = the largest eigenvalue of  k^{1/2} B K^{-1} B' k^{1/2},      sum_i k_i |(B d)_i|^2 <= rho d'Kd,

as long as rho < 1. In a block of height H and shear modulus mu that shears uniformly that is k < mu / H per area: the
stability of a spring and a slider; other motions of a block may be softer, and rho larger. It does not depend on the
length of steps. Without it a step may have several answers, or jump, which a warning says.

Theorem. If rho < 1, the step has one solution. Proof. Let e be the difference of two solutions. Then
|e|^2_K = -(lam - lam*).Be - (p - p*).De. The last term is <= 0, and the one before it at most
sum (w_i - w*_i)(|s*_i| - |s_i|) <= sum k_i (|s_i| - |s*_i|)^2 <= sum k_i |(Be)_i|^2 <= rho |e|^2.  QED
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import eigh

from vemcvx.base.arrays import EPS, Bools, Floats, lengths
from vemcvx.base.errors import NotAccepted, SceneWarning
from vemcvx.linear import LinearSolver
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import Norms, Operators
from vemcvx.program.step_program import Answer
from vemcvx.program.system import System
from vemcvx.solvers import Prepared, Solver, Solves, choose_solver
from vemcvx.solvers.default import LastResort
from vemcvx.solvers.newton import PreparedNewton
from vemcvx.solvers.solver import InUnits, named_failures
from vemcvx.stepping.ledger import Ledger, StepData, step_data

STABLE = 0.999  # rho beyond which the rounding of answers counts for more than a thousand times itself.


@dataclass(frozen=True)
class Stability:
    """rho, and the term that has most of its eigenvector."""

    rho: float
    worst: int


def stability_of(operators: Operators, norms: Norms) -> Stability | None:
    """The stability of norm terms; a warning where they are not stable."""
    found = stability(operators, norms.softening)
    if found is not None and found.rho >= STABLE:
        warnings.warn(
            f"friction: weights may fall faster with slip than the body gives way, most at {norms.name(found.worst)} "
            f"(softening over stiffness is {found.rho:.3g}; less than {STABLE:g} makes steps convex). A step may have "
            "several answers, or jump. Take a law that falls over a longer slip, a "
            "stiffer body, or a law that reads the slip before the step alone.",
            SceneWarning,
            stacklevel=2,
        )
    return found


def stability(operators: Operators, softening: Floats | None) -> Stability | None:
    """The stability of weights that fall with the slip of a step by `softening` (m,) at most; None if that is unknown.

    For bodies without supports rho is infinite: their rigid motions have no elastic energy. With an iterative linear
    solver it is unknown: B K^{-1} B' would take a solve for every row.
    """
    if softening is None or (softening.any() and not operators.factor.exact):
        return None
    falls = np.flatnonzero(softening)
    if len(falls) == 0:
        return Stability(0.0, 0)
    if operators.kernel is not None:
        return Stability(np.inf, int(np.argmax(softening)))
    block = operators.block
    rows = (falls[:, None] * block + np.arange(block)).ravel()
    root = np.repeat(np.sqrt(softening[falls]), block)
    B = operators.B[rows].toarray()
    M = root[:, None] * (B @ operators.factor.solve(np.ascontiguousarray(B.T))) * root
    value, vector = eigh(0.5 * (M + M.T), subset_by_index=[len(M) - 1, len(M) - 1])
    return Stability(float(value[0]), int(falls[np.argmax(np.abs(vector[:, 0])) // block]))


@dataclass(frozen=True, kw_only=True)
class PreparedRun:
    """The prepared run: data that all steps share."""

    system: System
    condensation: Condensation
    solver: Solver
    prepared: Prepared
    check: bool

    default: bool = False  # nobody asked for the accuracy: an answer at the rounding floor is good enough

    share: float = 1.0  # of the solver's accuracy that steps are solved to, where answers are but a part of something

    @property
    def accuracy(self) -> float:
        """To which steps are solved."""
        return self.share * self.solver.accuracy

    def driven(self, t: float) -> StepData:
        """The data of the system at an instant."""
        return step_data(self.system, self.condensation, t)

    def after(self, iterations: int) -> PreparedRun:
        """The run whose solver has taken so many of them."""
        solver = self.solver.after(iterations) if iterations else self.solver
        if solver is self.solver:
            return self
        return replace(self, solver=solver, prepared=prepared_solver(solver, self.operators))

    @property
    def operators(self) -> Operators:
        """The condensed operators, in the units of the system."""
        return self.condensation.operators


@dataclass(frozen=True)
class Dragged:
    """The friction of nodes that supports drag along, after a step: see :mod:`vemcvx.stepping.backward_euler`."""

    weights: Floats  # (q,)
    lam: Floats  # (q, block) multipliers
    still: Bools  # (q,) which did not slip
    worn: Floats  # (q,) cumulative loss
    worn_second_order: Floats  # (q,) likewise, as the ledger has it
    slipped: Floats  # (q,) and cumulative slip

    @classmethod
    def nothing(cls, q: int, block: int) -> Dragged:
        """Terms that have lost nothing, and have no weight."""
        none = np.zeros(q)
        nothing, still = np.zeros((q, block)), np.ones(q, dtype=bool)
        return cls(none, nothing, still, worn=none, worn_second_order=none, slipped=none)


@dataclass(frozen=True)
class Earlier:
    """The step before: from it and its own a state expects the next one."""

    t: float
    lam: Floats  # (m, block)
    p: Floats  # (r,)

    def share(self, now: float, t: float) -> float:
        """Part of what has changed since, up to `now`, that is expected to change once more up to `t`."""
        return min(1.0, (t - now) / (now - self.t)) if self.t < now else 0.0


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything known at an instant, on the retained unknowns; `full`, once it is asked for, on all."""

    t: float
    y: Floats  # (m,)
    unbalanced: Floats  # (m,) load - K y, which norm terms and limits balance
    data: StepData
    weights: Floats  # (m,) of the step that led here
    bound: Floats  # (m,) weights at the slip after it, where a law reads slips
    lam: Floats
    p: Floats  # (r,) forces of the limits
    slip: Floats  # (m, block) s of the step that led here
    certificate: Certificate
    ledger: Ledger
    scale: float  # largest energy norm of the states so far
    iterations: int
    status: str = ""  # in the solver's own words
    safeguards: int = 0  # how many of the iterations stood in for faster ones
    full: Floats | None = None  # (n,) `unknowns`, once somebody has asked for them
    size: float = 0.0  # largest energy norm that the data could cause; computed only while the states are far smaller
    earlier: Earlier | None = None  # multipliers of the step before, if there was one
    dragged: Dragged = field(default_factory=lambda: Dragged.nothing(0, 1))  # before the step, while it is on
    velocity: Floats | None = None  # (n,) their increments over the length of the step, where rates cost

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
            bound=weights,
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
        share = 0.0 if before is None else before.share(self.t, t)
        if before is None or share == 0.0:
            return self.lam, self.p
        lam, p = self.lam + share * (self.lam - before.lam), self.p + share * (self.p - before.p)
        return lam, np.maximum(p, 0.0)

    def unit(self, accuracy: float) -> float:
        """The energy norm that errors are relative to: see :mod:`vemcvx.stepping.posed_step`."""
        return self.size if self.scale <= accuracy * self.size else self.scale

    def accepted(self, accuracy: float) -> bool:
        """Return True if the certified error is within the accuracy."""
        return self.certificate.error <= accuracy * self.unit(accuracy)


def sticking(run: PreparedRun, state: State) -> Bools:
    """Increments that the certificate cannot tell from zero: |s_i - s_i*| <= flexibility^{1/2} |d - d*|."""
    operators = run.operators
    if operators.count == 0:
        return np.zeros(0, dtype=bool)
    blur = EPS * operators.blocks(operators.rows.absolute.read(np.abs(state.y))).max(axis=1)
    error = state.certificate.error + state.certificate.error_floor
    sticks: Bools = lengths(state.slip) <= error * np.sqrt(operators.norm_flexibility) + blur
    return sticks


def prepared_solver(solver: Solver, operators: Operators) -> Prepared:
    """The solver, prepared for the operators of a run; NotAccepted where K has a kernel and it takes none."""
    if operators.kernel is not None and not solver.semidefinite:
        raise NotAccepted(
            f"solver {solver.name}: only friction and contact hold a body, so that K is semidefinite, which it does "
            "not take; a solver that does says so by `semidefinite = True`. Newton and Clarabel do."
        )
    with named_failures(solver.name):
        prepared = solver.prepare(operators) if solver.any_units else InUnits.of(solver, operators)
    return LastResort(prepared) if isinstance(prepared, PreparedNewton) else prepared


def prepare(
    system: System, solver: Solver | Solves | None, check: bool, condense: bool, linear: LinearSolver | None = None
) -> PreparedRun:
    """Factorise, condense, scale, and let the solver do what all steps share."""
    condensation = Condensation(system, condense, linear)
    chosen = choose_solver(condensation.operators, solver)
    prepared = prepared_solver(chosen, condensation.operators)
    if system.norms is not None:
        stability_of(condensation.operators, system.norms)
    return PreparedRun(
        system=system,
        condensation=condensation,
        solver=chosen,
        prepared=prepared,
        check=check,
        default=solver is None,
    )
