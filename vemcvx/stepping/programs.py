"""Unscaled programs of the steps of a run, with answers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from numpy.typing import ArrayLike

from vemcvx.base.arrays import brief, is_whole
from vemcvx.base.errors import HistoryError
from vemcvx.linear import LinearSolver
from vemcvx.program.step_program import Answer, SolvedProgram
from vemcvx.program.system import System
from vemcvx.solvers import Solver, Solves
from vemcvx.stepping.backward_euler import Beginning, march, pose_step, prepare
from vemcvx.stepping.state import PreparedRun, State
from vemcvx.stepping.trajectory import FIELDS, Trajectory, row_of, state_of_row


def programs_of_march(
    system: System,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: Beginning = None,
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
) -> Iterator[SolvedProgram]:
    """March a System, and return the convex program and the certified answer of each step.

    Parameters
    ----------
    system, times, solver, initial, check, condense, linear
        See :func:`vemcvx.march`.

    Returns
    -------
    Iterator of SolvedProgram

    Raises
    ------
    SceneError, NotAccepted, NotCertified
        See :func:`vemcvx.march`.

    Examples
    --------
    >>> import vemcvx as vx
    >>> system = vx.System(np.eye(2), lambda t: [2.0 * t, 0.0], vx.Norms(np.eye(2), 0.5))
    >>> [float(program.answer.d[0]) for program in vx.programs_of_march(system, [0.0, 0.5, 1.0])]
    [0.5, 1.0]
    """
    trajectory = march(system, times, solver=solver, initial=initial, check=check, condense=condense, linear=linear)
    return programs_of_trajectory(system, trajectory, range(1, len(trajectory.times)), condense, linear)


def programs_of_trajectory(
    system: System,
    trajectory: Trajectory,
    numbers: Sequence[int],
    condense: bool = True,
    linear: LinearSolver | None = None,
) -> Iterator[SolvedProgram]:
    """Yield the programs of steps, or raise HistoryError for unstored states."""
    for n in numbers:
        _check_stored(trajectory, n)
    run = prepare(system, None, True, condense, linear)
    for n in numbers:
        yield _make_solved_program(run, _read_stored(run, trajectory, n - 1), _read_stored(run, trajectory, n), n)


def _make_solved_program(run: PreparedRun, before: State, after: State, n: int) -> SolvedProgram:
    m, norms = run.operators.count, run.system.norms
    posed = pose_step(run, before, after.data, after.weights[:m])
    # The difference of two states may violate a bound by rounding.
    d = posed.program.feasible(after.y - before.y)
    answer = Answer(d, after.lam[:m], after.iterations, after.status, p=after.p)
    slope = None if norms is None else norms.slope_by_forces(after.t, after.p, before.ledger.slipped[:m])
    operators, data = posed.program.operators, posed.program.data
    return SolvedProgram(operators, *data, answer=answer, step=n, t=after.t, slope=slope)


def _check_stored(trajectory: Trajectory, n: int) -> None:
    last = len(trajectory.times) - 1
    if not is_whole(n) or not 1 <= n <= last:
        raise HistoryError(f"program({brief(n)}): there is no such step; steps are numbered 1 to {last}.")
    missing = [str(m) for m in (n - 1, n) if m not in {0, *trajectory.stored.tolist()}]
    if missing:
        raise HistoryError(
            f"program({n}): the state after step {' and '.join(missing)} is not stored, but the program of a step "
            f"needs the states before and after it; simulate with store=[{n - 1}, {n}], or store='all'."
        )


def _read_stored(run: PreparedRun, trajectory: Trajectory, n: int) -> State:
    arrays = {name: array for name in FIELDS if (array := getattr(trajectory, name)) is not None}
    return state_of_row(run, float(trajectory.times[n]), row_of(arrays, trajectory.stored, n))
