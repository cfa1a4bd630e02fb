"""When a step has an answer, when an answer is good enough, and what to say when not.

Errors are relative to the largest energy norm of the states so far. A body that is carried without touching, or held
completely, has none: its norm is rounding, and accuracy relative to it means nothing. What the data can cause then
takes its place. With x = K^{-1} f the answer that nothing stops, f the load of the instant, Dirichlet force included
(and so x with the rigid motion in it), friction in no way,

    size = x'x / |x|_{K^{-1}} = min { |v|_K : x'v = x'x },

the least energy norm of a field that takes the motion back in the mean: what any contact or friction that is to stop
it has to spend. (Proof: x'v <= |x|_{K^{-1}} |v|_K, Cauchy and Schwarz, with equality for v along K^{-1}x. QED)  It is
an energy norm in every system of units, at most |x|_K, zero for x = 0 only; and for the same motion it does not depend
on h, as x'x has one sum over the nodes and x'K^{-1}x two (while |x|_K grows like h^{-1/2}: supports that move tear at
one layer of cells). A state whose norm and certified error are both at most accuracy times the largest size so far is
zero at the accuracy asked. A body that the ground carries along has no energy either: what the ground can cause counts
likewise (:func:`ground_norm`).
"""

from __future__ import annotations

import logging

import numpy as np

from vemcvx.arrays import Floats, power_of_two
from vemcvx.errors import NotCertified, SceneError
from vemcvx.program.condensation import Condensation
from vemcvx.program.forces import Reduced
from vemcvx.program.iterative_refinement import needs_refinement
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers import Solver
from vemcvx.stepping.ledger import StepData
from vemcvx.stepping.state import PreparedRun, State

log = logging.getLogger("vemcvx")

FLOORS = 10.0
"""Rounding floors that the norm of a state at the rounding floor is at most as large as."""
TRUST = 0.1
"""A relative rounding floor is also about how wrong K^{-1} is, and with it the certificate: beyond this, it is none."""
HOLDS_NOTHING = 1e-12
"""Part of a push that is rounding where friction holds it: no slip, or a bound that is zero one way."""


def data_norm(condensation: Condensation, force: Reduced) -> float:
    """The size above, of what a force can cause."""
    x = force.x
    unit = float(power_of_two(np.abs(x).max(initial=0.0)))
    x = x / unit
    square, soft = float(x @ x), float(x @ condensation.factor.solve(x))
    return unit * square / float(np.sqrt(soft)) if square > 0 else 0.0


def data_norms(
    condensation: Condensation, now: StepData, norm: float, floor: float, accuracy: float
) -> tuple[float, float]:
    """What the data can cause, and what friction's own forces can, if the state is at the rounding floor `floor`.

    Zero, unseen, where states of energy norm `norm` are not zero beside it.
    """
    data = _data_norm_if_large(condensation, now.pushed, norm, accuracy)
    return data, _data_norm_if_large(condensation, now.force, norm, accuracy) if norm <= FLOORS * floor else 0.0


def ground_norm(operators: Operators, ground: Floats | None, w: Floats) -> float:
    """The size of what ground that moves can cause.

    That is the least energy norm with which some B_i v goes as far as the ground under it, |g_i| / f_i^{1/2} with f_i
    the flexibility of the term; or if that is less, what all of friction can cause, sum_i w_i f_i^{1/2}.
    """
    if ground is None:
        return 0.0
    root = np.sqrt(operators.norm_flexibility)
    way = np.linalg.norm(operators.blocks(ground), axis=1)
    # No field goes anywhere where rows read nothing.
    far = np.divide(way, root, out=np.where(way > 0, np.inf, 0.0), where=root > 0)
    return float(min(far.max(initial=0.0), w @ root))


def _data_norm_if_large(condensation: Condensation, force: Reduced, norm: float, accuracy: float) -> float:
    return 0.0 if force.norm == 0.0 or not norm <= accuracy * force.norm else data_norm(condensation, force)


def require_certified(run: PreparedRun, state: State, n: int) -> None:
    """Raise NotCertified when the state after step `n` misses the solver's accuracy.

    Where nobody asked for one, nothing below the rounding floor is wanted.
    """
    solver, certificate, unit = run.solver, state.certificate, state.unit(run.solver.accuracy)
    accuracy, norms = solver.accuracy, run.system.norms
    wanted = certificate.error <= accuracy * unit or (run.default and certificate.at_floor)
    if wanted and certificate.error_floor <= TRUST * unit:
        return
    reached, floor = ((part / unit if unit > 0 else np.inf) for part in (certificate.error, certificate.error_floor))
    worst = ""
    # Where the gap is no number, or friction has none of it, it sits nowhere.
    if norms is not None and np.isfinite(certificate.error) and certificate.friction.max(initial=0.0) > 0:
        worst = f" The largest share of the gap sits at {norms.name(int(np.argmax(certificate.friction)))}."
    said = f" The solver said: {state.status}." if state.status else ""
    raise NotCertified(
        f"step {n} at t = {state.t:.6g}: {solver.name} reached a certified relative energy error of {reached:.1e}, "
        f"asked was {accuracy:.1e} (round-off floor {floor:.1e}).{said}{worst} "
        f"{_uncondensed(run)}{_advice(solver, reached, accuracy, floor)}, or pass check=False to go on regardless.",
        step=n,
        time=state.t,
        reached=reached,
        asked=accuracy,
        floor=floor,
    )


def refuse_unbalanced(program: StepProgram, condensation: Condensation, n: int, now: StepData) -> None:
    """Raise SceneError when no forces of friction and limits balance the load of step `n` on K's kernel."""
    operators, N, kernel = program.operators, program.operators.kernel, condensation.system.kernel
    motion = None if N is None else operators.kernel_balance.unbalanced_motion(program.w, N.T @ program.g)
    if kernel is None or N is None or motion is None:
        return
    field = N @ motion
    parts = np.linalg.lstsq(kernel.modes[condensation.retained], field, rcond=None)[0].astype(float)
    # Unknowns of a joint that read a jump move by less than the bodies themselves.
    field /= np.abs(kernel.modes @ parts).max()
    slip = operators.rows.read(field)
    # The bias of one-way friction is part of g; of the load it is none.
    bias = float(now.bias @ slip)
    push = float(field @ program.g) + bias
    holds = float(program.w @ np.linalg.norm(operators.blocks(slip), axis=1)) + bias
    holds = holds if holds > HOLDS_NOTHING * push else 0.0
    raise SceneError(
        f"step {n} at t = {now.t:.6g}: only friction and one-sided contact hold the body against {kernel.name(parts)}. "
        f"The load pushes it there with a force of {push:.6g} and friction holds {holds:.6g} at most: "
        f"{push - holds:.6g} are lacking, and there is no equilibrium. Change the load, raise the bound, add a "
        "support, or move the body by PrescribedDisplacement instead."
    )


def say_floor(floors: Floats, accuracy: float) -> None:
    """Log it when round-off may account for more than the accuracy asked; `floors` (N + 1,) are relative."""
    n = int(np.argmax(floors))
    if floors[n] > accuracy:
        log.info(
            "step %d: certified as computed, but round-off, that of the data's last digits included, may account for "
            "as much as %.1e of the energy norm, more than the accuracy %.1e asked for",
            n,
            floors[n],
            accuracy,
        )


def _uncondensed(run: PreparedRun) -> str:
    """What helps where condensing has lost digits that refinement would bring back, were it possible."""
    condensation = run.condensation
    lost = condensation.operators.kernel is None and not (condensation.whole or run.refines)
    if not lost or not needs_refinement(condensation, run.solver.accuracy):
        return ""
    return (
        "The factors of the stiffness are too coarse, and where several limits or norm terms read the same unknown "
        "nothing is refined: condense=False loses fewer digits. Else: "
    )


def _advice(solver: Solver, reached: float, accuracy: float, floor: float) -> str:
    if floor > TRUST:
        return (
            f"Round-off in the last digits of the data alone may change the answer by {floor:.1e} of its energy norm: "
            "take data that are farther from singular, such as a Poisson ratio farther from .5 or less contrast"
        )
    if not reached < 0.5:
        return f"Nothing was answered that could be relied on: {solver.advice}"
    if floor > accuracy:
        return f"Round-off alone allows {floor:.1e}: ask for no more than that"
    return f"Ask for accuracy={2 * reached:.0e} or more, {solver.advice}"
