"""Simulation of a scene on a mesh."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats, as_shaped_array, brief, finite, flag
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import coordinates
from vemcvx.effects import Pretension, data
from vemcvx.history import History, read_history
from vemcvx.linear import LinearSolver
from vemcvx.meshes import Mesh, PolygonMesh, PolyhedralMesh
from vemcvx.program import SolvedProgram
from vemcvx.results.results import Results, record, warn_of_large_strains, warn_of_lost_work, with_origin
from vemcvx.scene import Scene
from vemcvx.scene.contact import through_obstacles, without_contact
from vemcvx.scene.pose import PosedScene, pose_scene, suppress_scene_warnings
from vemcvx.solvers import Solver, Solves
from vemcvx.stepping import (
    Balanced,
    Beginning,
    Continued,
    Folder,
    Ledger,
    Memory,
    check_times,
    march,
    programs_of_march,
)
from vemcvx.stepping.course import inside_steps, sample_course
from vemcvx.vem import mean_strains, stress_load, stresses

log = logging.getLogger("vemcvx")


def simulate(
    scene: Scene,
    mesh: Mesh,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | Path | Projected | History | None = None,
    store: str | int | Sequence[int] = "all",
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
    progress: bool | Callable[[int, int], None] = False,
    stream: str | Path | Folder | None = None,
    resume: bool = False,
    bound: bool = False,
) -> History:
    """Simulate a scene on a mesh by backward Euler, every step certified.

    Parameters
    ----------
    scene : Scene
    mesh : PolygonMesh or PolyhedralMesh
    times : increasing sequence of instants
        times[0] is the initial instant; data are evaluated at each of the others.
    solver : Solver, or object with solve(program, target), optional
        By default Direct for programs without friction and one-sided contact, else Newton.
    initial : None, (n_nodes, dim) array, "equilibrium", "settled", vx.projected(u_0), History or path
        The displacement at times[0]: zero; the array; the equilibrium a(u_0, .) = l(0) without friction; the result of
        one step from zero; P^h u_0 of a function, see :func:`vemcvx.projected`; or where another run on the same mesh
        ended, a history or its folder: slips, wear, work and losses go on from there.
    store : "all", "last", int n or sequence of int
        Steps to store, and to certify on all unknowns: all; the last; every n-th, or those given, and the last. Other
        steps are certified on the unknowns of contact and friction.
    check : bool
        Raise NotCertified if the certificate of a step exceeds the solver's accuracy.
    condense : bool
        Eliminate the unknowns that friction and contact do not touch (default, not with Viscosity), or solve for all.
    linear : LinearSolver, optional
        SuperLU(), Pardiso(), Iterative() or PETSc(); by default by the number of unknowns and what is installed.
    progress : bool, or callable (step, steps)
        True logs every tenth of the run to the logger "vemcvx".
    stream : path, optional
        A folder for the stored steps, as memory-mapped files: for histories larger than memory, and runs that may be
        interrupted. One run at a time writes there; files of other origin are left alone.
    resume : bool
        Continue the run in the folder `stream`, if there is one, from its last stored step; otherwise it is replaced.
    bound : bool
        Bound the error of the mesh in every step from both sides (:func:`vemcvx.error_bound`): `history.bound` has the
        largest. All steps must be stored.

    Returns
    -------
    History

    Raises
    ------
    SceneError
        Scene, mesh and times make no well-posed problem, or there is no bound; `initial` violates (3.10) on this mesh.
    NotAccepted
        The solver cannot take the scene's program.
    NotCertified
        A step misses the accuracy.
    HistoryError
        `stream` cannot be written to, another run writes there, or it holds a run of something else.

    Notes
    -----
    Backward Euler for Problem 3.9 of the paper, of first order in the step and the mesh size, Theorem 3.10. The
    certificate bounds the algebraic error of each step; :func:`vemcvx.error_budget` estimates those of mesh and steps.
    """
    check_kinds(scene, mesh)
    given = check_times(times)
    start = time.perf_counter()
    posed = pose_scene(scene, mesh, given.tolist())
    for effect in scene.canonical:
        if isinstance(effect, Pretension):
            effect.check_instants(given)
    for words in posed.inactive:
        log.info("left out: %s", words)
    for words in without_contact(mesh.interfaces, (*posed.supports.given, *posed.terms.frictions, *posed.stops)):
        log.warning("%s", words)
    bounded = None
    if flag(bound, "bound"):
        if not (isinstance(store, str) and store == "all"):
            raise SceneError("bound: every step is bounded given the one before, and needs store='all'.")
        from vemcvx.bound.error_bound import bounds_of_runs

        bounded = bounds_of_runs(posed)
    assembled = time.perf_counter() - start
    if flag(resume, "resume") and stream is None:
        raise SceneError("resume: there is nothing to resume without stream=, the folder of the earlier run.")
    rows: AbstractContextManager[Memory | Folder] = (
        nullcontext(stream or Memory()) if stream is None or isinstance(stream, Folder) else Folder(stream, resume)
    )
    with rows as storage:
        trajectory = march(
            posed.system,
            given,
            solver=solver,
            initial=free_unknowns(initial, posed, given),
            store=store,
            check=check,
            condense=condense,
            linear=linear,
            progress=_log if progress is True else progress or None,
            storage=storage,
        )
        warn_of_lost_work(trajectory)
        results = record(posed, trajectory, assembled, storage)
        warn_of_large_strains(posed, results)
        for words in through_obstacles(posed.obstacles, posed.supports, given[trajectory.stored].tolist()):
            log.warning("%s", words)
        history = History.of(results, begins(initial))
        return history if bounded is None or history.steps == 0 else bounded(history)


def instants(scene: Scene, mesh: Mesh, times: ArrayLike) -> Floats:
    """Return the instants of a run, with those inside steps at which its data bend, turn or jump.

    Backward Euler reads data at the ends of steps: it misses part of a load that turns back between them, and with
    friction the answer is off from then on. Data are sampled at 256 instants, or at the middles of steps: changes that
    begin and end between two samples are not seen. Parameters and errors are those of :func:`simulate`.

    Returns
    -------
    (N + 1,) array
        With both sides of a jump, a billionth of the run apart at most.

    Examples
    --------
    >>> history = vx.simulate(scene, mesh, vx.instants(scene, mesh, times))  # doctest: +SKIP
    """
    check_kinds(scene, mesh)
    given = check_times(times)
    if len(given) < 2:
        return given
    with suppress_scene_warnings():
        bends = sample_course(pose_scene(scene, mesh, between=given.tolist()).system, given).bends
    return np.union1d(given, inside_steps(given, bends))


def warn_of_turns(scene: Scene, mesh: Mesh, times: Floats) -> None:
    """Log a warning of instants inside steps at which data bend, turn or jump: it takes a twentieth of a run."""
    if len(times) < 2:
        return
    with suppress_scene_warnings():
        posed = pose_scene(scene, mesh, between=times.tolist())
        missed = sample_course(posed.system, times).find_missed(times)
    if not len(missed):
        return
    apart = missed[np.diff(missed, prepend=-np.inf) > 1e-6 * float(times[-1] - times[0])]
    named = ", ".join(f"{t:.6g}" for t in apart[:6]) + f" and {len(apart) - 6} more" * (len(apart) > 6)
    log.warning(
        f"instants: loads or other data turn, bend or jump inside steps, at t = {named}, which steps miss. Return "
        "vemcvx.instants(scene, mesh, times), which puts them into the run, from times(steps); or take --target."
    )


def programs(
    scene: Scene,
    mesh: Mesh,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | Path | Projected | History | None = None,
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
) -> Iterator[SolvedProgram]:
    """Simulate a scene, and yield the convex program of every step with its certified answer, step after step.

    One factorisation serves all programs. Parameters and errors are those of :func:`simulate`.

    Examples
    --------
    ::

        for program in vx.programs(scene, mesh, times):
            posed = program.to_cvxpy()
            posed.problem.solve(solver="SCS")
            print(program.step, program.certify(program.feasible(posed.d.value), posed.lam, posed.p).error)
    """
    check_kinds(scene, mesh)
    given = check_times(times)
    posed = pose_scene(scene, mesh, given.tolist())
    found = programs_of_march(
        posed.system,
        given,
        solver=solver,
        initial=free_unknowns(initial, posed, given),
        check=check,
        condense=condense,
        linear=linear,
    )
    effects = [effect.describe_body(posed.space.in_plane) for effect in scene.canonical]
    return with_origin(found, posed, effects, condense)


def check_kinds(scene: object, mesh: object) -> None:
    """Raise SceneError unless these are a scene and a mesh, in this order."""
    if not isinstance(scene, Scene):
        raise SceneError(f"simulate: found {brief(scene)} where the scene goes; give a Scene(...), then a mesh.")
    if not isinstance(mesh, (PolygonMesh, PolyhedralMesh)):
        raise SceneError(
            f"simulate: found {brief(mesh)} where the mesh goes; give a PolygonMesh, such as vemcvx.meshes.squares(16)."
        )


def _log(step: int, steps: int) -> None:
    if step * 10 // steps > (step - 1) * 10 // steps:
        log.info("step %d of %d", step, steps)


@dataclass(frozen=True)
class Projected:
    """P^h u_0: see :func:`vemcvx.projected`, which makes it."""

    displacement: data.Datum
    settle: bool = True


def projected(displacement: data.Datum, settle: bool = True) -> Projected:
    """Return the energy projection P^h u_0 of an initial displacement, ``simulate(..., initial=vx.projected(u_0))``.

    a^h(P^h u_0, v) = a(u_0, v) for all v of V^h, (2.11) and (3.26), up to O(h), and exactly if u_0 is linear.

    If u_0 obeys condition (2.1), a(u_0, v) + j(v) >= <l(0), v>, then P^h u_0 obeys it on the mesh up to O(h). State 0
    is the end of one step at times[0] from P^h u_0, and obeys (2.1) exactly. If this step is longer than the projection
    explains, a warning says that u_0 violates (2.1) or that the mesh is too coarse.

    Parameters
    ----------
    displacement : callable f(x, t) -> (m, dim)
        u_0, a vector for each of the points x (m, dim), equal to the values of supports there; t is times[0].
    settle : bool
        False: state 0 is P^h u_0 itself, (3.26) to the letter, which Theorem 3.10 allows. Its certificate is then the
        length of the step that was left out. Scenes with Viscosity always begin at P^h u_0.

    Returns
    -------
    Projected
        For simulate, adapt, studies and problem files: it knows no mesh.

    Raises
    ------
    SceneError
        It is no function.

    Examples
    --------
    >>> def bent(x, t):
    ...     return 1e-3 * np.column_stack([x[:, 0] * x[:, 1], -0.5 * x[:, 0] ** 2])
    >>> history = vx.simulate(scene, mesh, times, initial=vx.projected(bent))  # doctest: +SKIP
    """
    if not callable(displacement):
        raise SceneError(
            f"projected: found {brief(displacement)}; wanted a function f(x, t) of points (m, dim) that gives their "
            "displacements. Values at the nodes of one mesh go to initial= as they are."
        )
    return Projected(displacement, flag(settle, "settle"))


def begins(initial: object) -> str:
    """Return what a run begins from, in a word of :class:`vemcvx.History`."""
    if isinstance(initial, (Path, Results)) or (isinstance(initial, str) and Path(initial).is_dir()):
        return "continued"
    word = initial if isinstance(initial, str) and initial in ("equilibrium", "settled") else "given"
    return "projected" if isinstance(initial, Projected) else word


def free_unknowns(
    initial: ArrayLike | str | Path | Projected | Results | None, posed: PosedScene, times: Floats
) -> Beginning:
    """Return what a march begins from at the first of the times: the free unknowns of a displacement; words pass."""
    if isinstance(initial, Path) or (isinstance(initial, str) and Path(initial).is_dir()):
        initial = read_history(initial)
    if isinstance(initial, Results):
        return _continued(initial, posed, times)
    if isinstance(initial, str):
        return initial
    if isinstance(initial, Projected):
        return _projected(initial, posed, times)
    points = posed.space.mesh.points
    kinds = "one row a node, or None, 'equilibrium', 'settled' or, of a function f(x, t), vx.projected(f)"
    wanted = f"displacements of shape {points.shape}, {kinds}"
    u = as_shaped_array(np.zeros(points.shape) if initial is None else initial, "initial", wanted, points.shape)
    return _within_supports(finite(u, "initial"), posed, times)


def _continued(history: Results, posed: PosedScene, times: Floats) -> Continued:
    """Where a history on the same mesh ended, as the terms of another scene know it.

    What was worn at a place is shared by the terms there; ways, which laws may read, are those of the place.
    """
    mesh, contact, run, terms = posed.space.mesh, history.contact, history.trajectory, posed.terms
    if not all(np.array_equal(getattr(history.mesh, name), getattr(mesh, name)) for name in ("points", "centroids")):
        raise SceneError("initial: the history is of another mesh; a stage goes on from a run on the same one.")
    at = contact.rows_of(terms)
    several = np.bincount(at[at >= 0], minlength=len(contact.nodes))
    if several.max(initial=0) > 1 and posed.system.norms is not None and posed.system.norms.remembers:
        place = coordinates(contact.points[int(several.argmax())])
        raise SceneError(
            f"initial: several terms of friction act at {place}, and the law reads slips, of which the history has one "
            "a place. Let one run go through both stages instead."
        )

    share = contact.friction_lengths / np.maximum(several, 1)
    of_places = contact.wear[-1] * share, contact.wear_second_order[-1] * share, contact.accumulated_slip[-1]
    worn, worn_second_order, slipped = (np.append(values, 0.0)[at] for values in of_places)
    past = Ledger(
        dissipated=float(run.dissipated[-1]),
        work=float(run.work[-1]),
        worn=worn,
        slipped=slipped,
        dissipated_second_order=float(run.dissipated_second_order[-1]),
        worn_second_order=worn_second_order,
    )
    return Continued(_within_supports(history.displacement[-1], posed, times), past, float(run.work_second_order[-1]))


def _within_supports(u: Floats, posed: PosedScene, times: Floats) -> Floats:
    """Return the free unknowns of nodal displacements (n_nodes, dim); SceneError where supports hold others."""
    t, points, resting = float(times[0]), posed.space.mesh.points, posed.at_rest(u.ravel())
    P, held = posed.supports.P, posed.supports.motion(t)
    y: Floats = P.T @ (resting - held)
    off = np.abs(P @ y + held - resting)
    # Where supports move later, their motion at t may be rounding.
    size = max(np.abs(u).max(), *(np.abs(posed.supports.motion(t)).max() for t in times.tolist()))
    if off.max() > SAME * size:
        node = int(np.argmax(off)) // points.shape[1]
        raise SceneError(
            f"initial: the displacement {u[node]} of node {node} at {points[node]} contradicts its supports at "
            f"t = {t:.6g}, by {off.max():.6g}. Give an initial displacement that obeys them, or initial='settled'."
        )
    return y


def _projected(initial: Projected, posed: PosedScene, times: Floats) -> Balanced:
    """Return the forces a(u_0, v) over the free unknowns, with the nodal values of u_0."""
    t, space = float(times[0]), posed.space

    def u_0(x: Floats) -> Floats:
        return data.vector(initial.displacement, x, t, "initial: projected")

    nodal = u_0(space.mesh.points)
    near = _within_supports(nodal, posed, times)
    stress = stresses(posed.material.moduli, mean_strains(space, u_0))
    force: Floats = stress_load(space) @ stress.ravel()
    if posed.springs is not None:
        force = force + posed.springs @ nodal.ravel()
    return Balanced(posed.supports.gather(force - posed.A @ posed.supports.motion(t)), near, initial.settle)
