"""What the steps of a run share, what drives it at an instant, and the state after a step.

States keep the unknowns that friction and limits read; what is inside follows from them and from the load. With
dashpots it depends on the past, too, and states keep all unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.operators import Operators
from vemcvx.program.scaling import LARGEST_NORM, checked_norm
from vemcvx.program.step_program import Answer
from vemcvx.program.system import System, on_part
from vemcvx.solvers import Solver
from vemcvx.solvers.default import FixedPoint, LastResort, prepare_run
from vemcvx.solvers.solver import SHARE

MOST_LENGTHS = 4
"""Lengths of steps whose factors are kept, where there are dashpots; two that take turns need two."""


@dataclass(frozen=True, kw_only=True)
class StepData:
    """The data of a system at an instant, on the unknowns that states keep."""

    t: float
    force: Reduced  # load minus Dirichlet force
    prescribed_slip: Floats
    remaining_gap: Floats  # (r,) gaps of the limits at y = 0
    ground: Floats | None  # (m * block,) the motion of the ground, subtracted in `prescribed_slip`
    push: Reduced  # the Dirichlet force alone
    field: Floats  # (n_u,) u_m of the ledger, less a rigid motion; empty if no supports move

    @classmethod
    def of(cls, condensation: Condensation, t: float) -> StepData:
        """Evaluate load and supports at `t`; SceneError where the energy of their response overflows."""
        system, motion = condensation.system, condensation.system.motion
        forces, rows = system.load_on_part(t)
        force = condensation.reduce(forces, rows=rows)
        if not force.norm <= LARGEST_NORM:
            checked_norm(force.norm, t)
        push, field = force - force, np.zeros(0)
        if motion is not None:
            forces, rows = on_part(motion.dirichlet_force, t)
            push = condensation.reduce(forces, rows=rows)
            field = motion.frame(t, -push.x)
        slip, gap, ground = system.prescribed_slip(t), system.remaining_gap(t), system.ground(t)
        return cls(t=t, force=force, prescribed_slip=slip, remaining_gap=gap, ground=ground, push=push, field=field)

    def still_as(self, other: StepData) -> bool:
        """Return True if nothing differs between the two instants."""
        return (
            self.force.shares == other.force.shares
            and np.array_equal(self.prescribed_slip, other.prescribed_slip)
            and np.array_equal(self.remaining_gap, other.remaining_gap)
            and self.push.shares == other.push.shares
        )


@dataclass(frozen=True, eq=False)
class Frame:
    """What steps of one length share: the condensed system, and the solver prepared for it."""

    condensation: Condensation
    solver: Solver

    @property
    def operators(self) -> Operators:
        """The condensed operators, in the units of the system."""
        return self.condensation.operators

    @cached_property
    def prepared(self) -> LastResort | FixedPoint:
        """The prepared solver."""
        return prepare_run(self.solver, self.operators)


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedRun:
    """What all steps of a run share."""

    system: System
    elastic: Frame  # of K; states are kept on its unknowns
    solver: Solver
    check: bool
    default: bool  # nobody asked for the accuracy: an answer at the rounding floor is good enough
    condense: bool
    viscous: dict[str, Frame] = field(default_factory=dict)

    @property
    def condensation(self) -> Condensation:
        """The system on the unknowns that states keep."""
        return self.elastic.condensation

    @property
    def operators(self) -> Operators:
        """K, B and D on the unknowns that states keep."""
        return self.elastic.operators

    @property
    def terms(self) -> int:
        """The number of norm terms, those that supports drag included."""
        return self.operators.count + (0 if self.system.dragged is None else self.system.dragged.count)

    def frame(self, k: float) -> Frame:
        """What steps of length k share, with K + C / k in place of K; lengths that differ by rounding share it."""
        damping, key = self.system.damping, f"{k:.11e}"
        if damping is None or k == 0.0:
            return self.elastic
        if key not in self.viscous:
            stiffness = sp.csr_matrix(self.system.K + damping.C / k)
            alone = replace(self.system, K=stiffness, damping=None, motion=None)
            self.viscous[key] = Frame(Condensation(alone, self.condense, self.condensation.linear), self.solver)
            if len(self.viscous) > MOST_LENGTHS:
                del self.viscous[next(iter(self.viscous))]
        return self.viscous[key]


@dataclass(frozen=True)
class Ledger:
    """Energy at an instant, cumulative dissipation and work, and the energy norm |u|_a."""

    energy: float
    dissipated: float
    work: float
    worn: Floats  # (terms,) cumulative lam_i . s_i of every term; they sum to `dissipated`, but for what damping loses
    slipped: Floats  # (terms,) cumulative |s_i|, which laws of friction may see
    dissipated_second_order: float
    worn_second_order: Floats  # (terms,) of `worn`, likewise

    @classmethod
    def opening(cls, energy: float, count: int) -> Ledger:
        """Nothing is lost or done yet, in any of `count` terms."""
        none = np.zeros(count)
        return cls(energy, 0.0, 0.0, worn=none, slipped=none, dissipated_second_order=0.0, worn_second_order=none)

    @property
    def norm(self) -> float:
        """|u|_a = sqrt(2 E)."""
        return math.sqrt(2.0 * max(self.energy, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """Everything known at an instant. Terms are the m of the program, and then those that supports drag."""

    t: float
    y: Floats  # the unknowns that are kept
    unbalanced: Floats  # load - K y there, which norm terms, limits and dashpots balance
    data: StepData
    weights: Floats  # (terms,) of the step that led here
    bound: Floats  # (terms,) weights at the slip after it, where a law reads slips
    lam: Floats  # (terms, block)
    p: Floats  # (r,) forces of the limits
    slip: Floats  # (terms, block) s of the step that led here
    sticks: Bools  # (terms,) increments that the certificate cannot tell from zero
    certificate: Certificate
    ledger: Ledger
    scale: float  # largest energy norm of the states so far
    size: float = 0.0  # largest energy norm that the data could cause; computed only while the states are far smaller
    iterations: int = 0
    status: str = ""  # in the solver's own words
    safeguards: int = 0  # how many of the iterations stood in for faster ones
    full: Floats | None = None  # (n,) all unknowns, once they are recovered and certified
    velocity: Floats | None = None  # (n,) their increments over the length of the step, with dashpots
    earlier: tuple[float, Floats, Floats] | None = None  # t, lam and p of the step before, if there was one

    @property
    def unknowns(self) -> Floats:
        """(n,) all unknowns, of a state that is certified in full."""
        if self.full is None:
            raise LookupError("state: the unknowns inside are not recovered; certified_in_full() does.")
        return self.full

    def answer(self, d: Floats, lam: Floats) -> Answer:
        """An answer of increments d and multipliers lam (m, block) that took what this state took."""
        return Answer(d, lam, self.iterations, self.status, self.safeguards, p=self.p)

    def expected(self, t: float, m: int) -> tuple[Floats, Floats]:
        """Multipliers (m, block) and (r,) to begin with at the next instant `t`: they go on as they changed last.

        That is in proportion to time, by no more than they changed then, and p >= 0.
        """
        before, lam, p = self.earlier or (self.t, self.lam, self.p), self.lam, self.p
        share = min(1.0, (t - self.t) / (self.t - before[0])) if before[0] < self.t else 0.0
        if share > 0.0:
            lam, p = lam + share * (lam - before[1]), np.maximum(p + share * (p - before[2]), 0.0)
        return lam[:m], p

    def unit(self, accuracy: float) -> float:
        """The energy norm that errors are relative to: see :mod:`vemcvx.stepping.backward_euler`."""
        return self.size if self.scale <= accuracy * self.size else self.scale

    def accepted(self, accuracy: float) -> bool:
        """Return True if the certified error is within the accuracy."""
        return self.certificate.error <= accuracy * self.unit(accuracy)


def recovered(
    condensation: Condensation,
    kept: Sequence[tuple[Floats, Reduced]],
    held: Sequence[Floats],
    most: Sequence[float],
    before: Floats | float = 0.0,
) -> tuple[Floats, Floats, Floats]:
    """All unknowns (n, k) of states (y, force), the energies (k,) that r = force - held - K y could still gain, floors.

    They are corrected once by what r leaves inside, if some energy is above `most`. Motions of no energy feel no r:
    multipliers balance the force on them, and not the anchors. Floors (k,) are of r, with y added to `before`.
    """
    system, (y_c, forces) = condensation.system, zip(*kept, strict=True)
    push = np.array([force.phi - own for force, own in zip(forces, held, strict=True)]).T
    size = np.array([np.abs(force.phi) + np.abs(own) for force, own in zip(forces, held, strict=True)]).T

    def left(y: Floats) -> Floats:
        r: Floats = push - system.K @ y
        return r if (kernel := system.kernel) is None else r - kernel.basis @ (kernel.basis.T @ r)

    y = condensation.completed(np.array([force.xi for force in forces]).T, np.array(y_c).T)
    r = left(y)
    energies = 0.5 * condensation.factor.energies_of_columns(r)
    if not condensation.whole and (energies > most).any():
        y = y + condensation.held(r)
        energies = 0.5 * condensation.factor.energies_of_columns(left(y))
    return y, energies, condensation.rounding_floors(size, (np.abs(y.T) + np.abs(before)).T)


def certified_together(run: PreparedRun, states: Sequence[State]) -> list[State]:
    """The states with all their unknowns and certificates of the full system.

    Rows see the unknowns that are kept: their parts of it are those of the step's certificate.
    """
    if run.condensation.whole:
        return [state if state.full is not None else replace(state, full=state.y) for state in states]
    if not (some := [state for state in states if state.full is None]):
        return list(states)
    accuracy, m = run.solver.accuracy, run.operators.count
    held = [run.system.multiplier_force(state.lam[:m], state.p) for state in some]
    most = [0.5 * (SHARE * accuracy * state.unit(accuracy)) ** 2 for state in some]
    y, *energies = recovered(run.condensation, [(state.y, state.data.force) for state in some], held, most)

    def in_full(state: State, full: Floats, energy: float, floor: float) -> State:
        return replace(state, full=full, certificate=state.certificate.in_full(energy, floor))

    found = map(in_full, some, y.T, *(each.tolist() for each in energies))
    return [state if state.full is not None else next(found) for state in states]


def certified_in_full(run: PreparedRun, state: State) -> State:
    """The state with all its unknowns and the certificate of the full system."""
    return state if state.full is not None else certified_together(run, [state])[0]
