"""Simulation of a scene on a mesh."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats, as_shaped_array, brief, finite, flag
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import coordinates
from vemcvx.effects import Pretension, data
from vemcvx.history import History
from vemcvx.linear import LinearSolver
from vemcvx.meshes import Mesh, PolygonMesh, PolyhedralMesh
from vemcvx.program import SolvedProgram
from vemcvx.results.results import Results, record, warn_of_large_strains, with_origin
from vemcvx.scene import Scene
from vemcvx.scene.contact import find_missing_contact
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
from vemcvx.vem import stress_load
from vemcvx.vem.loads import mean_strains
from vemcvx.vem.tensors import stresses

log = logging.getLogger("vemcvx")


def simulate(
    scene: Scene,
    mesh: Mesh,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | Projected | History | None = None,
    store: str | int | Sequence[int] = "all",
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
    progress: Literal[False] | Callable[[int, int], None] = False,
    stream: str | Path | Folder | None = None,
    resume: bool = False,
    bound: bool = False,
) -> History:
    """Simulate a scene on a mesh by backward Euler, with a certificate of every step.

    Certificates bound the algebraic error of each step; :func:`vemcvx.error_budget` estimates the other errors.

    Parameters
    ----------
    scene : Scene
    mesh : PolygonMesh or PolyhedralMesh
    times : increasing sequence of instants
        times[0] is the initial instant; a step ends at each later instant.
    solver : Solver, or object with solve(program, target), optional
        By default Direct for programs with neither friction nor one-sided contact, else Newton.
    initial : None, (n_nodes, dim) array, "equilibrium", "settled", vx.projected(u_0) or History
        The displacement at times[0]; None for zero. "equilibrium" solves a(u_0, .) = l(times[0]), without friction.
        "settled" is the result of one step from zero. :func:`vemcvx.projected` gives the projection P^h u_0. A history
        is continued on the same mesh. Slip, wear, work and dissipation add up.
    store : "all", "last", int n or sequence of int
        The steps to store: all, only the last, every n-th, or the given steps. The last step is always stored. Stored
        steps are certified on all unknowns, other steps on the unknowns of contact and friction.
    check : bool
        Raise NotCertified if the certificate of a step exceeds the solver's accuracy.
    condense : bool
        Eliminate unknowns that have neither friction nor contact. Runs with Viscosity or dashpots keep all unknowns.
    linear : LinearSolver, optional
        SuperLU(), Pardiso(), Iterative() or PETSc(). The default depends on problem size and installed packages.
    progress : callable (step, steps), or False
        Called after each step.
    stream : path, optional
        A folder for the stored steps: for histories larger than memory, and runs that may be interrupted.
    resume : bool
        True: continue the run in the folder `stream`. False: replace the run.
    bound : bool
        Compute bounds on the mesh error of every step (:func:`vemcvx.error_bound`). `store` must be "all".

    Returns
    -------
    History

    Raises
    ------
    SceneError
        The scene or an argument is wrong, no error bound exists, or `initial` violates (2.1) of Feng, Han and Huang.
    NotAccepted
        The solver does not accept the scene's program.
    NotCertified
        The certificate of a step exceeds the solver's accuracy.
    HistoryError
        `stream` cannot be written to, is in use by another run, or contains a run of another problem.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Traction((3.0, 0.0), on="right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    >>> history.energy.shape, bool(history.certified.max() < 1e-8)
    ((2,), True)
    """
    check_kinds(scene, mesh)
    given = check_times(times)
    start = time.perf_counter()
    posed = _pose(scene, mesh, given)
    add_bounds = _prepare_bounds(posed, store) if flag(bound, "bound") else None
    assembled = time.perf_counter() - start
    with _open_storage(stream, flag(resume, "resume")) as storage:
        trajectory = march(
            posed.system,
            given,
            solver=solver,
            initial=free_unknowns(initial, posed, given),
            store=store,
            check=check,
            condense=condense,
            linear=linear,
            progress=progress or None,
            storage=storage,
        )
        results = record(posed, trajectory, assembled, storage)
        warn_of_large_strains(posed, results)
        history = History.from_results(results, begins(initial))
        return history if add_bounds is None or history.steps == 0 else add_bounds(history)


def _prepare_bounds(posed: PosedScene, store: str | int | Sequence[int]) -> Callable[[History], History]:
    if not (isinstance(store, str) and store == "all"):
        raise SceneError("bound: the bound of each step needs the step before; set store='all'.")
    from vemcvx.bound.error_bound import bounds_of_runs

    return bounds_of_runs(posed)


def _open_storage(stream: str | Path | Folder | None, resume: bool) -> AbstractContextManager[Memory | Folder]:
    if stream is None:
        if resume:
            raise SceneError("resume: give stream=, the folder of the run to resume.")
        return nullcontext(Memory())
    return nullcontext(stream) if isinstance(stream, Folder) else Folder(stream, resume)


def _pose(scene: Scene, mesh: Mesh, times: Floats) -> PosedScene:
    posed = pose_scene(scene, mesh, times.tolist())
    for effect in scene.canonical:
        if isinstance(effect, Pretension):
            effect.check_instants(times)
    for words in posed.inactive:
        log.info("left out: %s", words)
    for words in find_missing_contact(mesh.interfaces, (*posed.supports.given, *posed.terms.frictions, *posed.stops)):
        log.warning("%s", words)
    return posed


def instants(scene: Scene, mesh: Mesh, times: ArrayLike) -> Floats:
    """Return `times`, and all instants between them at which data have a kink, an extremum or a jump.

    Backward Euler misses the extreme value of a load that reverses inside a step. Data are sampled at least 256 times
    per run, and in the middle of each step.

    Parameters
    ----------
    scene, mesh, times
        As for :func:`simulate`.

    Returns
    -------
    (N + 1,) array
        Increasing instants. A jump lies between two instants, at most a billionth of the run apart.

    Raises
    ------
    SceneError
        The scene or an argument is not valid.

    Examples
    --------
    >>> press = vx.Pressure(lambda x, t: abs(t - 0.3) + 0 * x[:, 0], on="top")
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), press)
    >>> vx.instants(scene, vx.meshes.squares(2), [0.0, 0.5, 1.0]).round(6).tolist()
    [0.0, 0.3, 0.5, 1.0]
    """
    check_kinds(scene, mesh)
    given = check_times(times)
    if len(given) < 2:
        return given
    with suppress_scene_warnings():
        course = sample_course(pose_scene(scene, mesh, between=given.tolist()).system, given)
    return np.union1d(given, inside_steps(given, course.bends))


def programs(
    scene: Scene,
    mesh: Mesh,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | Projected | History | None = None,
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
) -> Iterator[SolvedProgram]:
    """Simulate a scene, and yield the convex program and the certified solution of every step, in order.

    Parameters
    ----------
    scene, mesh, times, solver, initial, check, condense, linear
        As for :func:`simulate`.

    Returns
    -------
    iterator of SolvedProgram

    Raises
    ------
    SceneError, NotAccepted, NotCertified
        As for :func:`simulate`.

    Examples
    --------
    >>> base = vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement((0.01, -0.01), on="top")
    >>> scene = vx.Scene(*base, vx.BilateralContact(on="bottom"), vx.TrescaFriction(1.0, on="bottom"))
    >>> for program in vx.programs(scene, vx.meshes.squares(2), [0.0, 1.0], initial="settled"):
    ...     posed = program.to_cvxpy()
    ...     gap = posed.problem.solve(solver="CLARABEL")
    ...     print(program.step, program.certify(program.feasible(posed.d.value), posed.lam, posed.p).error < 1e-3)
    1 True
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
    return with_origin(found, posed, effects)


def check_kinds(scene: object, mesh: object) -> None:
    """Raise SceneError unless the arguments are a scene and a mesh."""
    if not isinstance(scene, Scene) or not isinstance(mesh, (PolygonMesh, PolyhedralMesh)):
        raise SceneError(f"simulate: found {brief(scene)} and {brief(mesh)}; wanted a Scene, then a mesh.")


@dataclass(frozen=True)
class Projected:
    """P^h u_0, the result of :func:`vemcvx.projected`."""

    displacement: data.Datum
    settle: bool = True


def projected(displacement: data.Datum, settle: bool = True) -> Projected:
    """Return the energy projection P^h u_0 of an initial displacement: a^h(P^h u_0, v) = a(u_0, v) for all v of V^h.

    Feng, Han and Huang define P^h in (2.11), (3.26). A step at times[0] leads from P^h u_0 to the initial state, which
    obeys (2.1) on the mesh. If displacements change much, a warning says that u_0 violates (2.1) or the mesh is coarse.

    Parameters
    ----------
    displacement : callable f(x, t) -> (m, dim)
        The vectors u_0 at points x (m, dim) for t = times[0]. They must agree with all supports.
    settle : bool
        False: begin at P^h u_0 without a step, as Theorem 3.10 allows. The certificate of the initial state is then
        the relative energy norm of the omitted step. Scenes with Viscosity always begin at P^h u_0.

    Returns
    -------
    Projected
        An initial state on any mesh, for simulate, adapt, studies and problem files.

    Raises
    ------
    SceneError
        `displacement` is not a function.

    Examples
    --------
    >>> move = vx.PrescribedDisplacement(lambda x, t: 1e-3 * x[:, [1, 0]], on=["left", "right"])
    >>> scene, start = vx.Scene(vx.Elasticity(200.0, 0.3), move), vx.projected(lambda x, t: 1e-3 * x[:, [1, 0]])
    >>> history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial=start, check=False)
    >>> history.begins
    'projected'
    """
    if not callable(displacement):
        raise SceneError(
            f"projected: found {brief(displacement)}; wanted a function f(x, t) that returns the displacements of "
            "points x (m, dim). Give displacements at nodes directly as initial=."
        )
    return Projected(displacement, flag(settle, "settle"))


def begins(initial: object) -> str:
    """Return the value of `vemcvx.History.begins` for an initial state."""
    if isinstance(initial, Results):
        return "continued"
    word = initial if isinstance(initial, str) and initial in ("equilibrium", "settled") else "given"
    return "projected" if isinstance(initial, Projected) else word


def free_unknowns(initial: ArrayLike | str | Projected | Results | None, posed: PosedScene, times: Floats) -> Beginning:
    """Convert an initial state into the argument `initial` of `march`."""
    if isinstance(initial, Results):
        return _continue(initial, posed, times)
    if isinstance(initial, str):
        return initial
    if isinstance(initial, Projected):
        return _project_start(initial, posed, times)
    points = posed.space.mesh.points
    kinds = "one row per node, or None, 'equilibrium', 'settled' or, for a function f(x, t), vx.projected(f)"
    wanted = f"displacements of shape {points.shape}, {kinds}"
    u = as_shaped_array(np.zeros(points.shape) if initial is None else initial, "initial", wanted, points.shape)
    return _within_supports(finite(u, "initial"), posed, times)


def _continue(history: Results, posed: PosedScene, times: Floats) -> Continued:
    """Return the last state of a history as the first state of another scene on the same mesh."""
    mesh, contact, run, terms = posed.space.mesh, history.contact, history.trajectory, posed.terms
    if not all(np.array_equal(getattr(history.mesh, name), getattr(mesh, name)) for name in ("points", "centroids")):
        raise SceneError("initial: the history is on another mesh; a stage continues a run on the same mesh.")
    at = contact.rows_of(terms)
    several = np.bincount(at[at >= 0], minlength=len(contact.nodes))
    if several.max(initial=0) > 1 and posed.system.norms is not None and posed.system.norms.rule.slips:
        place = coordinates(contact.points[int(several.argmax())])
        raise SceneError(
            f"initial: several friction terms act at {place}, and their law depends on the slip of each, but the "
            "history has one slip per node. Simulate both stages in one run instead."
        )

    # The friction terms at a node share the wear of the node equally.
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
    t, points, resting = float(times[0]), posed.space.mesh.points, posed.at_rest(u.ravel())
    P, held = posed.supports.P, posed.supports.motion(t)
    y: Floats = P.T @ (resting - held)
    off = np.abs(P @ y + held - resting)
    # Compare with the largest motion, because motions at times[0] may vanish.
    size = max(np.abs(u).max(), *(np.abs(posed.supports.motion(t)).max() for t in times.tolist()))
    if off.max() > SAME * size:
        node = int(np.argmax(off)) // points.shape[1]
        raise SceneError(
            f"initial: the displacement {u[node]} of node {node} at {points[node]} contradicts its supports at "
            f"t = {t:.6g}, by {off.max():.6g}. Give an initial displacement that obeys them, or initial='settled'."
        )
    return y


def _project_start(initial: Projected, posed: PosedScene, times: Floats) -> Balanced:
    """Return the forces a(u_0, v) on the free unknowns, and the nodal values of u_0."""
    t, space = float(times[0]), posed.space
    space.refuse_revolution("initial: projected")

    def u_0(x: Floats) -> Floats:
        return data.vector(initial.displacement, x, t, "initial: projected")

    nodal = u_0(space.mesh.points)
    near = _within_supports(nodal, posed, times)
    stress = stresses(posed.material.moduli, mean_strains(space, u_0))
    force: Floats = stress_load(space) @ stress.ravel()
    if posed.springs is not None:
        force = force + posed.springs @ nodal.ravel()
    return Balanced(posed.supports.gather(force - posed.A @ posed.supports.motion(t)), near, initial.settle)
