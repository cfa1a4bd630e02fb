"""Errors and warnings about steps and initial states."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from vemcvx.base.arrays import EPS, SAME, lengths
from vemcvx.base.errors import NotCertified, SceneError, SceneWarning
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.program.system import Norms, System
from vemcvx.stepping.state import PreparedRun, State, StepData

STABLE_RATIO = 0.999
"""Smallest ratio of softening to stiffness that causes a warning."""


def require_certified(run: PreparedRun, state: State, n: int) -> None:
    """Raise NotCertified if the state after step `n` misses the accuracy."""
    solver, certificate, unit = run.solver, state.certificate, state.unit(run.solver.accuracy)
    accuracy, norms = solver.accuracy, run.system.norms
    wanted = certificate.error <= accuracy * unit or (run.default and certificate.at_floor)
    # Rounding errors above a tenth of the energy norm are refused.
    if wanted and certificate.error_floor <= 0.1 * unit:
        return
    refuse_contradiction(run.system, state.data, f"step {n} at t = {state.t:.6g}")
    parts = certificate.error + certificate.error_floor, certificate.error_floor
    reached, floor = ((part / unit if unit > 0 else np.inf) for part in parts)
    worst = ""
    if norms is not None and np.isfinite(certificate.error) and certificate.friction.max(initial=0.0) > 0:
        worst = f" The largest part of the gap is at {norms.name(int(np.argmax(certificate.friction)))}."
    said = f" Status of the solver: {state.status}." if state.status else ""
    raise NotCertified(
        f"step {n} at t = {state.t:.6g}: {solver.name} reached a certified relative energy error of {reached:.1e}, "
        f"but {accuracy:.1e} was requested.{said}{worst} "
        f"{_advice(run, reached, floor)}. In Python, check=False continues without this accuracy.",
        step=n,
        time=state.t,
        reached=reached,
        asked=accuracy,
        floor=floor,
    )


def _advice(run: PreparedRun, reached: float, floor: float) -> str:
    accuracy, more = run.solver.accuracy, f"Ask for accuracy={2 * reached:.0e} or more"
    other = "raise max_iterations" if run.solver.name == "Newton" else "use vx.Newton()"
    if 0.1 < floor < np.inf and run.system.kernel is not None:
        return "Friction and contact hardly hold the body against this load: lower the load, or add a support"
    if 0.1 < floor < np.inf:
        return (
            f"Round-off in the last digits of the data alone may change the answer by {floor:.1e} of its energy norm: "
            "take data that are farther from singular, such as a Poisson ratio farther from .5 or less contrast"
        )
    if not reached < 0.5:
        return f"The answer is not reliable: {other}"
    return f"Round-off causes errors of {floor:.1e}: {more.lower()}" if floor > accuracy else f"{more}, or {other}"


def refuse_contradiction(system: System, now: StepData, when: str) -> None:
    """Raise SceneError if hard limits contradict each other (Farkas' lemma)."""
    from scipy.optimize import linprog

    limits = system.limits
    rigid = np.flatnonzero(np.zeros(0) if limits is None else limits.rigid)
    e = now.remaining_gap[rigid]
    if limits is None or not (e < 0).any():
        return
    balanced: Any = sp.vstack([limits.D[rigid].T, sp.csr_matrix(np.ones((1, len(rigid))))])
    # linprog has a tolerance of 1e-7 for costs of size one.
    p = linprog(1e7 * e / np.abs(e).max(), A_eq=balanced, b_eq=np.eye(balanced.shape[0])[-1]).x
    if p is None or not p @ e < -64 * EPS * np.abs(e).max():
        return
    against = [limits.name(int(rigid[j])) for j in np.flatnonzero(p > SAME)]
    raise SceneError(
        f"{when}: no displacement satisfies the limits at {' and '.join(against)}: they contradict each other by "
        f"{-(p @ e) / p.max():.6g}. Enlarge a gap, or give one of these limits a compliance."
    )


def refuse_unbalanced(condensation: Condensation, program: StepProgram, when: str) -> None:
    """Raise SceneError if friction and limits cannot hold a floating body."""
    kernel, norms, field = condensation.system.kernel, condensation.system.norms, program.find_unbalanced_motion()
    if kernel is None or field is None:
        return
    parts = np.linalg.lstsq(kernel.modes[condensation.retained], field, rcond=None)[0].astype(float)
    # Scale the largest displacement to one.
    field /= kernel.reach(parts)
    push = float(field @ program.g)
    holds = float(program.finite_weights @ lengths(program.operators.blocks(program.operators.B @ field)))
    holds = holds if holds > 1e-12 * push else 0.0  # smaller values are rounding errors
    by = "" if norms is None or norms.law is None else ", by the pressures and slips before the step,"
    raise SceneError(
        f"{when}: only friction and one-sided contact hold the body against {kernel.name(parts)}. The load pushes it "
        f"in this motion with a force of {push:.6g}, and friction{by} resists with at most {holds:.6g}: "
        f"{push - holds:.6g} is missing, and there is no equilibrium. Change the load, raise the bound, add a "
        "support, or move the body by PrescribedDisplacement instead."
    )


def refuse_floating_rates(system: System) -> None:
    """Raise SceneError if only friction that depends on slip rates holds a body."""
    if system.kernel is not None and system.norms is not None and system.norms.rule.rates:
        raise SceneError(
            "friction: found a law of slip rates, but nothing except friction and contact holds the body against "
            f"{' and '.join(system.kernel.names)}. Add a support, or weak springs (ElasticFoundation)."
        )


def refuse_start(run: PreparedRun, state: State, settled: State, jump: float) -> None:
    """Raise SceneError for an initial state that is not in equilibrium."""
    operators, norms, where = run.operators, run.system.norms, ""
    if norms is not None:
        way = lengths(operators.blocks(operators.B @ (settled.y - state.y)))
        worst = int(np.argmax(way))
        where = f" It slips most at {norms.name(worst)}, by {way[worst]:.3g}." if way[worst] > 0 else ""
    much = f"by {jump:.1e} of the energy norm, more than 1e-06" if np.isfinite(jump) else "from rest"
    raise SceneError(
        f"initial: the state at t = {state.t:.6g} is not {'in equilibrium' if norms is None else 'held by friction'} "
        f"(condition (2.1) of the theory): one step at this instant moves it {much}.{where} Begin with loads and gaps "
        "of zero, or give initial='settled' (the state after one step from zero), 'equilibrium' (the state without "
        "friction), or vx.projected(u_0) for a function u_0. After initial=history, loads and supports must begin as "
        "they ended in that history."
    )


def warn_of_softening(operators: Operators, norms: Norms, shortest: float) -> None:
    """Warn if softening may give a step several solutions (docs/theory/coulomb.md)."""
    softening, block = norms.softening, operators.block
    if softening is None or not softening.any() or not operators.factor.exact:
        return
    rho, worst = np.inf, int(np.argmax(softening))
    if operators.kernel is None:
        root = np.repeat(np.sqrt(softening / (shortest if norms.rule.rates else 1.0)), block)
        rows = root[:, None] * operators.B.toarray()
        M = rows @ operators.factor.solve(np.ascontiguousarray(rows.T))
        value, vector = eigh(0.5 * (M + M.T), subset_by_index=[len(M) - 1, len(M) - 1])
        rho, worst = float(value[0]), int(np.argmax(np.abs(vector[:, 0]))) // block
    if rho >= STABLE_RATIO:
        warnings.warn(
            f"friction: weights may fall faster with slip than the elastic forces, most at {norms.name(worst)} "
            f"(the ratio of softening to stiffness is {rho:.3g}; below {STABLE_RATIO:g} a step has one solution). A "
            "step may have several solutions, or jump. Take a law that falls over a longer slip, a "
            "stiffer body, or a law that depends only on the slip before the step. With a law of slip rates, take "
            "longer steps.",
            SceneWarning,
            stacklevel=2,
        )
