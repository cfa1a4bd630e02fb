"""Backward Euler for a quasistatic variational inequality: one certified convex program a step, (2.34).

The loop below is Problem 2.4 in a dozen lines; what one step is stands in :mod:`vemcvx.stepping.backward_euler`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arguments import check_takes, flag
from vemcvx.arrays import Floats, as_real_array, brief
from vemcvx.errors import SceneError
from vemcvx.linear import LinearSolver
from vemcvx.linear.one_thread import one_thread
from vemcvx.program.system import System
from vemcvx.solvers import Solver, Solves, as_solver
from vemcvx.stepping.backward_euler import QuasistaticSteps, Steps
from vemcvx.stepping.dragged import nothing_dragged, with_dragged_friction
from vemcvx.stepping.initial import initial_state
from vemcvx.stepping.recorder import Recorder, certified_in_full, stored_steps
from vemcvx.stepping.state import PreparedRun, prepare
from vemcvx.stepping.storage import Memory, Storage
from vemcvx.stepping.trajectory import Trajectory
from vemcvx.stepping.viscous import ViscousSteps


def march(
    system: System,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | None = None,
    store: str | int | Sequence[int] = "all",
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
    progress: Callable[[int, int], None] | None = None,
    storage: Storage | None = None,
) -> Trajectory:
    """March a System through time by backward Euler.

    Parameters
    ----------
    system : System
    times : increasing sequence of N + 1 instants
        times[0] is the initial one.
    solver : Solver, or object with solve(program, target), optional
        By default the smallest that accepts the program.
    initial : None, (n,) array, "equilibrium" or "settled"
        Zero; a given state; K y = load(t_0), without friction; or one step from zero at t_0.
    store : "all", "last", int or sequence of int
        Which states to keep: every one, the last, every so many and the last, or those of these steps and the last.
    check, condense, linear : as of :func:`vemcvx.simulate`
    progress : callable (step, steps), optional
    storage : Storage, optional
        Where rows are kept; a Folder that holds an interrupted run of the same system is gone on with.

    Raises
    ------
    SceneError
        The times do not increase, or the initial state violates (2.1).
    NotAccepted
        The solver cannot take the program.
    NotCertified
        A step misses the accuracy asked for.
    """
    check_kinds(system, solver, linear, progress)
    check, condense = flag(check, "check"), flag(condense, "condense")
    if storage is not None and not isinstance(storage, Storage):
        raise SceneError(f"march: found storage = {brief(storage)}; wanted Memory(), Folder(path), or None.")
    instants = checked_times(times)
    system = system.faded(instants.tolist())
    steps = len(instants) - 1
    kept = stored_steps(store, steps)
    start = time.perf_counter()
    linear = system.linear(linear)
    with threads_of_steps(system, condense, linear):
        run = prepare(system, solver, check, condense, linear, begin=begins(system, instants))
        prepared = time.perf_counter()
        recorder = Recorder(run, instants, kept, storage or Memory(), initial)
        _march(run, recorder, instants, initial, progress)
        seconds = {"prepare": prepared - start, "solve": time.perf_counter() - prepared}
        return recorder.finish(seconds)


def _march(
    run: PreparedRun,
    recorder: Recorder,
    instants: Floats,
    initial: ArrayLike | str | None,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Step from where the recorder is, or from the beginning, to the end; all rows are entered."""
    system, steps = run.system, len(instants) - 1
    earlier = recorder.begin()
    if earlier is None:
        first = initial_state(run, instants[0], initial)
        earlier = 0, replace(first, dragged=nothing_dragged(system, first.t, first.p))
        recorder.add(*earlier)
    begin, state = earlier
    if system.damping is not None:
        state = certified_in_full(run, state)
    advance = steps_of(run, instants)
    for n in range(begin + 1, steps + 1):
        state = with_dragged_friction(system, state, advance.step(state, n, instants[n]))
        recorder.add(n, state)
        if progress is not None:
            progress(n, steps)


def begins(system: System, instants: Floats) -> list[float]:
    """The first instants, whose loads the run asks for as they are: none where rates cost and the past drives, too."""
    return instants[:2].tolist() if system.damping is None else []


def threads_of_steps(system: System, condense: bool, linear: LinearSolver) -> AbstractContextManager[None]:
    """One thread for BLAS within, unless the steps' own matrices are large and dense."""
    unknowns = len(system.retained) if condense else system.n
    return one_thread(unknowns if linear.eliminates else 0)


def steps_of(run: PreparedRun, instants: Floats) -> Steps:
    """The steps of a run, viscous or not."""
    damping = run.system.damping
    return QuasistaticSteps(run) if damping is None else ViscousSteps(run, damping, instants)


def check_kinds(
    system: System, solver: Solver | Solves | None, linear: LinearSolver | None, progress: object = None
) -> None:
    """Raise SceneError for what is no system, no solver, no linear solver or no function."""
    if not isinstance(system, System):
        raise SceneError(f"march: found {brief(system)} where the System goes; simulate() takes a scene and a mesh.")
    if solver is not None:
        as_solver(solver).check_accuracy()
    if linear is not None and not isinstance(linear, LinearSolver):
        raise SceneError(f"linear: found {brief(linear)}; wanted SuperLU(), Pardiso(), Multigrid(), or None (chosen).")
    if progress is not None and not callable(progress):
        raise SceneError(f"progress: found {brief(progress)}; wanted a function of (step, steps).")
    check_takes(progress, 2, "progress", "(step, steps)")


def checked_times(times: ArrayLike) -> Floats:
    """The instants as an increasing array of at least one."""
    wanted = "an increasing sequence of finite instants, such as np.linspace(0, 1, 65)"
    t = as_real_array(times, "times", wanted)
    if t.ndim != 1 or len(t) == 0 or not np.isfinite(t).all():
        raise SceneError(f"times: found {brief(times)}; wanted {wanted}.")
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        n = int(back[0])
        raise SceneError(
            f"times: instant {n + 1} is {t[n + 1]:.17g}, which does not come after instant {n}, {t[n]:.17g}; "
            "times must increase strictly."
        )
    return t
