r"""Derivatives of a run with respect to parameters: the answer of each step is differentiated on its active sets.

The states y_n of a run obey, with the multipliers x = (lam, p) and the rows A = [B; D] of friction and limits,

    K y_n + C (y_n - y_{n-1}) / k + A'x_n = f_n,    off_n = (B (y_n - y_{n-1}) - b_n,  D y_n - e_n - compliance p_n),

off = 0 on sticking terms and acting limits, lam = w(p) s/|s| on terms that slip by s, and p = 0 on open limits. Data
depend on the parameters. We difference them at fixed states, which needs no factorisation; d denotes a difference.
With h = dw s/|s| on slipping terms, dx = h + Q z and

    dy = K_k^{-1} (push - A'dx) + N a,       push = -d(K y + C (y - y_prev) / k + A'x - f) + C dy_prev / k,
    M (z, a) = (P (off_0 - W h),  N'push - R'h),     off_0 = A K_k^{-1} push + d off - (B; 0) dy_prev,

where K_k = K + C / k, and M, P, Q, W, N and R are those of Newton's method (:mod:`vemcvx.solvers.newton`), made again
from the stored sets. Any solver may have solved the run. The *forward* sweep solves this for each parameter, step by
step. The *adjoint* sweep goes backwards with M', once for a weighted sum of quantities, whatever the number of
parameters (for adjoints in time see Giles and Pierce, Flow, Turbulence and Combustion 65 (2000)).

Without dashpots, a step needs only the unknowns of contact: forces f are condensed to E'f, where the columns of E are
the states (n, m) of unit displacements of these unknowns (:mod:`vemcvx.program.condensation`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.linalg import lu_factor, lu_solve

from vemcvx.base.arrays import (
    SAME,
    Bools,
    Floats,
    as_real_array,
    as_shaped_array,
    brief,
    call_function,
    directions,
    finite,
    lengths,
)
from vemcvx.base.errors import SceneError
from vemcvx.effects import CoulombFriction, TrescaFriction
from vemcvx.history import History
from vemcvx.meshes import Mesh
from vemcvx.program.forces import Delassus
from vemcvx.program.system import System
from vemcvx.results import record
from vemcvx.scene import Scene, pose_scene, suppress_scene_warnings
from vemcvx.scene.pose import PosedScene
from vemcvx.sensitivity.observed import FORMS, Course, Gradient, Observed, Quantities, find_quantities
from vemcvx.simulation import check_kinds, free_unknowns
from vemcvx.solvers import Newton, Solver
from vemcvx.solvers.law import Weights
from vemcvx.solvers.newton import REGULARISATION, SHIFT, ActiveSets, build_columns, build_matrix
from vemcvx.stepping import Memory, check_times, march
from vemcvx.stepping.backward_euler import prepare
from vemcvx.stepping.state import PreparedRun

log = logging.getLogger("vemcvx")

RELATIVE_STEP = 3e-5
"""Step of central differences of data, relative to the parameter; absolute for parameters that are zero."""

Change = tuple[Any, Any, Any]
"""The derivatives of push, off and w of one step by P parameters: matrices with P columns, dense or sparse."""


@dataclass(frozen=True, eq=False)
class LinearStep:
    """One step, linearised on its active sets; forces are divided by `delassus.u`, slips and gaps multiplied by it."""

    delassus: Delassus
    sets: ActiveSets
    law: Weights
    p: Floats
    memory: Any  # C / k; 0 without dashpots
    recalls: Floats  # (rows, 1) one for rows of increments (friction, dashpots), else zero

    def factorise(self) -> tuple[sp.csr_matrix, sp.csr_matrix, Callable[..., Floats]]:
        """Return P, Q' and a function that solves with M, or with M' if trans=1."""
        P, Qt, compliance = build_columns(self.delassus, self.sets, self.p, self.law)
        M = build_matrix(np.asarray(self.delassus.W), self.delassus.R, P, Qt, compliance)
        lu = lu_factor(M, overwrite_a=True, check_finite=False) if len(M) else None
        return P, Qt, lambda b, trans=0: b if lu is None else lu_solve(lu, b, trans=trans, check_finite=False)

    def forward(self, change: Change, before: Floats) -> tuple[Floats, Floats]:
        """Return dy (unknowns, P) and dx (rows, P) of this step; `before` is dy of the previous step."""
        delassus, A, solve = self.delassus, self.delassus.operators.A, self.delassus.operators.factor.solve
        push, off, w = (x if isinstance(x, np.ndarray) else x.toarray() for x in change)
        P, Qt, system = self.factorise()
        u, push = delassus.u[:, None], push + self.memory @ before
        off = u * (A @ solve(push) + off - self.recalls * (A @ before))
        h, slips = np.zeros_like(off), self._slipping[:, :, None] * w[:, None, :]
        h[: slips.shape[0] * slips.shape[1]] = slips.reshape(-1, w.shape[1])
        h /= u
        z = system(np.vstack([P @ (off - delassus.W @ h), delassus.N.T @ push - delassus.R.T @ h]))
        x = u * (h + Qt.T @ z[: P.shape[0]])
        return solve(push - A.T @ x) + delassus.N @ z[P.shape[0] :], x

    def backward(self, by_y: Floats, by_x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the derivatives of a sum of quantities by push, off, w and the previous y, from those by y and x."""
        delassus, A, solve = self.delassus, self.delassus.operators.A, self.delassus.operators.factor.solve
        P, Qt, system = self.factorise()
        u, by_push = delassus.u[:, None], solve(by_y)
        by_x = u * (by_x - A @ by_push)
        z = system(np.vstack([Qt @ by_x, delassus.N.T @ by_y]), trans=1)
        held, rest = P.T @ z[: P.shape[0]], z[P.shape[0] :]
        by_h, by_off = (by_x - delassus.W @ held - delassus.R @ rest) / u, u * held
        by_push = by_push + solve(A.T @ by_off) + delassus.N @ rest
        m, block = self._slipping.shape
        by_w = np.einsum("mb,mbr->mr", self._slipping, by_h[: m * block].reshape(m, block, by_h.shape[1]))
        return by_push, by_off, by_w, self.memory @ by_push - A.T @ (self.recalls * by_off)

    @property
    def _slipping(self) -> Floats:
        """The directions (m, block) of the slipping terms; zero on sticking terms."""
        return np.where(self.sets.stick[:, None], 0.0, self.sets.direction)

    def is_about_to_change(self, lam: Floats, gap: Floats, force: Floats, error: float) -> bool:
        """Return True if a multiplier may reach its bound, or an open gap may close.

        The state has this `error` in the energy norm, and its scaled forces have the errors `force` (rows,). Scaled
        gaps have errors of at most `error` times the roots of the diagonal of W.
        """
        W, (m, block) = np.asarray(self.delassus.W), self.sets.direction.shape
        room, gap = self.sets.w - lengths(lam.reshape(m, block)), gap - error * np.sqrt(np.diag(W)[m * block :])
        weak = self.sets.stick & (room <= force[: m * block].reshape(m, block).max(axis=1))
        return bool(weak.any() or np.where(self.sets.act, self.p <= force[m * block :], gap <= 0).any())


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Quantities of a run, and their derivatives with respect to P parameters.

    Attributes
    ----------
    of : tuple of str
        The names of the Q quantities.
    values : (Q, N + 1)
        The quantities at all instants.
    history : History
    one_sided : (N + 1,) array of bool
        True for steps whose active sets are about to change: within the certificate, a multiplier may reach its bound
        or an open gap may close. From there on, derivatives hold on one side only.

    Examples
    --------
    >>> def scene_of(theta):
    ...     pull = vx.Traction((theta[1], 0.0), on="right")
    ...     return vx.Scene(vx.Elasticity(theta[0], 0.0), vx.Clamp(on="left"), pull)
    >>> of, mesh = ["displacement at (1, 0) x"], vx.meshes.squares(2)
    >>> found = vx.sensitivities(scene_of, [200.0, 3.0], mesh, [0.0, 1.0], of, initial="settled")
    >>> found.jacobian[0, -1].round(9).tolist()  # u = F / E: -F / E^2 and 1 / E
    [-7.5e-05, 0.005]
    """

    of: tuple[str, ...]
    values: Floats
    history: History
    one_sided: Bools
    _steps: list[LinearStep | None] = field(repr=False)
    _difference: Callable[[], tuple[list[Change], Floats]] = field(repr=False)
    _rows: tuple[list[Floats], list[Floats], list[Floats]] = field(repr=False)
    """The derivatives of each quantity (N + 1, .), by the unknowns of a step, by those one step before, and by x."""

    @cached_property
    def _data(self) -> tuple[list[Change], Floats]:
        """The differences of the data of each step, and of values (Q, N + 1, P) at fixed unknowns of the steps."""
        return self._difference()

    @property
    def _losses(self) -> Bools:
        """A mask (Q,) of the losses: their values are sums over steps, and `_rows` are derivatives of the summands."""
        return np.array([name == "dissipated" for name in self.of])

    @cached_property
    def jacobian(self) -> Floats:
        """The derivatives (Q, N + 1, P), by one forward sweep for each parameter."""
        changes, explicit = self._data
        found, losses = np.zeros_like(explicit), self._losses
        dy = np.zeros((self._rows[0][0].shape[1], found.shape[2]))
        for n, step in enumerate(self._steps):
            if step is not None:
                before, (dy, dx) = dy, step.forward(changes[n], dy)
                of_rows = zip(*self._rows, strict=True)
                found[:, n] = [y[n] @ dy + past[n] @ before + x[n] @ dx for y, past, x in of_rows]
        found[losses] = np.cumsum(found[losses], axis=1)
        return found + explicit

    def gradient(self, weights: ArrayLike) -> Floats:
        """Return the derivatives (P,) of the sum of weights times values, by one adjoint sweep.

        Parameters
        ----------
        weights : (Q, N + 1) array
            For example the derivatives of a misfit with respect to the values.

        Raises
        ------
        SceneError
            `weights` has another shape.
        """
        shape, (changes, explicit) = self.values.shape, self._data
        given = as_shaped_array(weights, "gradient: weights", f"an array {shape}", shape)
        found, by_y, each = np.einsum("qt,qtp->p", given, explicit), np.zeros((1, 1)), given.copy()
        losses = self._losses
        each[losses] = np.cumsum(given[losses, ::-1], axis=1)[:, ::-1]
        for n, step in reversed(list(enumerate(self._steps))):
            if step is not None:
                y, before, x = (sum(w * rows[n] for w, rows in zip(each[:, n], of, strict=True)) for of in self._rows)
                *by_data, by_y = step.backward(by_y + y[:, None], x[:, None])
                by_y = by_y + before[:, None]
                found = found + sum((d.T @ by)[:, 0] for d, by in zip(changes[n], by_data, strict=True))
        return found


def sensitivities(
    scene_of: Callable[[Floats], Scene],
    theta: ArrayLike,
    mesh: Mesh,
    times: ArrayLike,
    of: Sequence[str],
    *,
    initial: ArrayLike | str | None = None,
    solver: Solver | None = None,
    shapes: Callable[[Floats], ArrayLike] | None = None,
) -> Sensitivities:
    """Simulate a scene, and differentiate quantities of the run with respect to parameters of the scene.

    The run is simulated once. The data of the scene are differenced by central differences, at the states of the run;
    the answers of the steps are differentiated exactly, on their active sets.

    Parameters
    ----------
    scene_of : callable theta (P,) -> Scene
        The scene for some parameters. The mesh, and the directions of supports, must not depend on them.
    theta : (P,) array
        The parameters.
    mesh, times, solver
        As for :func:`vemcvx.simulate`. The default solver is vx.Newton(accuracy=1e-10).
    of : sequence of str
        Names of quantities: "reaction of left x" (the force of supports on a boundary of the body), "displacement at
        (1, 0.5) y", "slip at (0.5, 0) x" (at a contact node), "energy", and "dissipated" (the losses by friction, of
        first order in the step).
    initial : None, array or "settled"
        As for :func:`vemcvx.simulate`. A given state does not depend on the parameters.
    shapes : callable x (k, dim) -> (k, P), optional
        Parameters of a field: the scene has friction bounds (or coefficients, with CoulombFriction) shapes(x) @ theta
        at points x, and nothing else depends on theta. Derivatives are then analytic, also for thousands of parameters.

    Returns
    -------
    Sensitivities
        `jacobian` (forward: for a few parameters) and `gradient` (adjoint: for many parameters and one sum of
        quantities) are computed when they are asked for.

    Raises
    ------
    SceneError
        A quantity does not fit the scene, its friction depends on slips, nothing holds the body, the scene has other
        unknowns for neighbouring parameters, or `scene_of` does not return a scene.
    NotCertified
        As for :func:`vemcvx.simulate`.

    Notes
    -----
    If a step of central differences (3e-5 of the parameter) is not small for the data, as for Poisson's ratio near 0.5,
    derivatives have a relative error of about the square of step over distance to the singularity.

    Examples
    --------
    >>> def scene_of(theta):
    ...     pull = vx.Traction((theta[1], 0.0), on="right")
    ...     return vx.Scene(vx.Elasticity(theta[0], 0.0), vx.Clamp(on="left"), pull)
    >>> of, mesh = ["displacement at (1, 0) x"], vx.meshes.squares(2)
    >>> found = vx.sensitivities(scene_of, [200.0, 3.0], mesh, [0.0, 1.0], of, initial="settled")
    >>> found.gradient([[0.0, 1.0]]).round(9).tolist()  # the same by the adjoint sweep
    [-7.5e-05, 0.005]
    """
    parameters = read_parameters(theta, "sensitivities: theta")
    if not isinstance(of, (list, tuple)) or not of or not all(isinstance(name, str) for name in of):
        raise SceneError(f"sensitivities: found of = {brief(of)}; wanted a list of names: {FORMS}.")
    if not (
        isinstance(initial, (type(None), list, tuple, np.ndarray))
        or (isinstance(initial, str) and initial == "settled")
    ):
        raise SceneError(f"sensitivities: found initial = {brief(initial)}; there are None, an array and 'settled'.")
    times = check_times(times)

    def pose(values: Floats) -> PosedScene:
        return pose_scene(_call_scene(scene_of, values, mesh), mesh, times.tolist())

    posed = pose(parameters)
    _refuse(posed)
    chosen = Newton(accuracy=1e-10) if solver is None else solver
    found = march(posed.system, times, solver=chosen, initial=free_unknowns(initial, posed, times))
    history, run = History.from_results(record(posed, found, 0.0, Memory())), prepare(posed.system, None, True, True)
    course = Course(times, found.state, found.multipliers, found.pressures, isinstance(initial, str))
    quantities, at = find_quantities(of, posed), Observed.evaluate(posed, course)
    gradients, E = quantities.gradients(posed, at, course), _unit_states(run)

    of_field = None if shapes is None else _field_changes(posed, course, shapes, len(parameters), E.shape[1])

    def difference() -> tuple[list[Change], Floats]:
        if of_field is not None:
            return of_field, np.zeros((len(of), len(times), len(parameters)))
        return _differences(pose, parameters, run, E, course=course, quantities=quantities, gradients=gradients)

    steps, one_sided = _linearise(run, history, course, at)
    if one_sided.any():
        when = ", ".join(f"{t:.6g}" for t in times[one_sided][:6])
        log.warning("sensitivities: contact or friction is about to change at t = %s: derivatives are one-sided.", when)
    rows = [one.y @ E for one in gradients], [one.before @ E for one in gradients], [one.x for one in gradients]
    return Sensitivities(
        of=quantities.names,
        values=quantities.values(posed, at, course.p),
        history=history,
        one_sided=one_sided,
        _steps=steps,
        _difference=difference,
        _rows=rows,
    )


def read_parameters(raw: ArrayLike, subject: str) -> Floats:
    """Return parameters (P,); raise SceneError for anything else."""
    found = finite(as_real_array(raw, subject, "numbers (P,)"), subject)
    return as_shaped_array(found, subject, "numbers (P,)", (found.size,))


def _call_scene(scene_of: Callable[[Floats], Scene], theta: Floats, mesh: Mesh) -> Scene:
    """Return the scene for some parameters; raise SceneError if it is no scene, or the mesh no mesh."""
    scene = call_function(scene_of, (theta,), f"scene_of({brief(theta)}) failed", "return a vemcvx.Scene")
    if not isinstance(scene, Scene):
        raise SceneError(f"scene_of: found {brief(scene)} as its result; it must return a vemcvx.Scene.")
    check_kinds(scene, mesh)
    return scene


def _refuse(posed: PosedScene) -> None:
    """Raise SceneError for scenes whose steps are not differentiated."""
    norms, terms = posed.system.norms, posed.terms
    drags = terms.dragged is not None and bool(terms.dragged[terms.acting :].any())
    law = None if norms is None else norms.law
    reasons = {
        "nothing holds the body": bool(posed.pins),
        "its friction depends on slips, or its law has no slope": law is not None and (law.slips or law.slope is None),
        "its friction depends on the direction of slip": bool(terms.elliptic.any()),
        "its friction depends on pressure at nodes that supports drag": law is not None and drags,
    }
    for words in (words for words, found in reasons.items() if found):
        raise SceneError(f"sensitivities: found a scene without derivatives: {words}.")


def _unit_states(run: PreparedRun) -> Any:
    """Return the states E (n, m) of unit displacements of the unknowns of steps; the identity without condensation."""
    condensation, n, m = run.condensation, run.system.n, len(run.condensation.retained)
    if condensation.whole:
        return sp.csr_matrix(sp.eye_array(n))
    return condensation.complete(np.zeros((n, m)), np.eye(m))


def _differences(
    pose: Callable[[Floats], PosedScene],
    theta: Floats,
    run: PreparedRun,
    E: Any,
    *,
    course: Course,
    quantities: Quantities,
    gradients: Sequence[Gradient],
) -> tuple[list[Change], Floats]:
    """Return the differences of the data of each step, and of quantities at fixed unknowns of the steps.

    At fixed contact unknowns, forces still move the interior: `inner` are derivatives of quantities by these forces.
    """
    whole, solve = run.condensation.whole, run.condensation.solve_interior
    # Rows of linear quantities are the same at all instants.
    rows = [one.y[:1] if (one.y == one.y[0]).all() else one.y for one in gradients]
    inner = [0.0 * each if whole else solve(np.ascontiguousarray(each.T)).T for each in rows]
    columns, own = [], run.system
    for j, step in enumerate(RELATIVE_STEP * np.where(theta != 0, np.abs(theta), 1.0)):
        pair = []
        for way in (step, -step):
            with suppress_scene_warnings():
                posed = pose(theta + way * np.eye(len(theta))[j])
            system = posed.system
            if [M.shape for M in (system.K, system.B, system.D)] != [M.shape for M in (own.K, own.B, own.D)]:
                raise SceneError(f"sensitivities: theta[{j}] changes the unknowns or the contact nodes of the scene.")
            at = Observed.evaluate(posed, course)
            lam = np.stack([course.lam, at.lam.reshape(course.lam.shape)])[:, :, posed.terms.acting :]
            rubbed, rubs = (lam != 0).any(axis=3)
            if (rubs & ~rubbed).any():
                raise SceneError(f"sensitivities: theta[{j}] moves a support that stands still against friction.")
            off = np.hstack([at.slips[:, : own.B.shape[0]], at.excess])
            values = quantities.values(posed, at, course.p)
            pair.append((posed.supports.gather(at.forces.T).T, off, np.where(at.w < np.inf, at.w, 0.0), values))
        balance, off, w, values = ((more - less) / (2.0 * step) for more, less in zip(*pair, strict=True))
        values -= [(x * balance).sum(axis=1) for x in inner]
        columns.append((-balance @ E, off, w, values))
    *data, explicit = (np.stack(each, axis=-1) for each in zip(*columns, strict=True))
    return list(zip(*data, strict=True)), explicit


def _field_changes(
    posed: PosedScene, course: Course, shapes: Callable[[Floats], ArrayLike], count: int, unknowns: int
) -> list[Change]:
    """Return the derivatives of data by field coefficients: w sums field times length, or field times normal force."""
    terms, points = posed.terms, posed.space.mesh.points
    for effect in (posed.scene.canonical[i] for i in posed.causes["frictions"]):
        given = isinstance(effect, TrescaFriction) and effect.quadrature == "nodes" and not effect.while_closed
        if not (given or (isinstance(effect, CoulombFriction) and effect.cap is None)):
            raise SceneError(f"sensitivities: shapes: found {effect.describe()}; its bound is not a field of nodes.")
    x = points[np.concatenate([np.zeros(0, dtype=np.int64), *(f.nodes for f in terms.frictions)])]
    read = call_function(shapes, (x,), "sensitivities: shapes failed", "return an array (k, P)")
    wanted = (len(x), count)
    S = sp.csr_matrix(as_shaped_array(read, "sensitivities: shapes", f"an array {wanted}", wanted))
    size = np.concatenate([np.zeros(0), *(f.lengths * (f.law is None) for f in terms.frictions)])
    rows, gather = terms.acting * terms.block + course.p.shape[1], terms.gather[: terms.acting]
    none = sp.csr_matrix((unknowns, count)), sp.csr_matrix((rows, count))
    forces = (size if terms.press is None else size + (size == 0) * (terms.press @ p) for p in course.p)
    return [(*none, sp.csr_matrix(gather @ sp.diags_array(force) @ S)) for force in forces]


def _linearise(
    run: PreparedRun, history: History, course: Course, at: Observed
) -> tuple[list[LinearStep | None], Bools]:
    """Return the linearised steps, and a mask of the steps whose active sets are about to change."""
    system, found, known = run.system, history.trajectory, dict[str, tuple[Delassus, Floats]]()
    steps, one_sided = list[LinearStep | None](), np.zeros(len(course.times), dtype=bool)
    errors = np.sqrt(2.0 * found.gap) + np.sqrt(2.0 * found.floor)
    for n, k in enumerate(course.durations.tolist()):
        if n == 0 and not course.settles:
            steps.append(None)
            continue
        if (key := f"{k:.11e}") not in known:
            delassus = Delassus(run.frame(k).condensation.operators)
            known[key] = delassus, _forces_per_error(delassus)
        delassus, force = known[key]
        u, rows = delassus.u, system.B.shape[0]
        slip = lengths(run.operators.blocks(at.slips[n, :rows]))
        # A history stores no slips of the step from zero to a settled state: find its sticking terms from `at.slips`.
        sticks = found.sticking[n, : len(slip)] if n > 0 else slip <= SAME * np.abs(at.u[n]).max()
        steps.append(step := _linear_step(system, delassus, course, at, sticks, n=n))
        lam, gap = at.lam[n, :rows] / u[:rows], -u[rows:] * at.excess[n]
        one_sided[n] = step.is_about_to_change(lam, gap, errors[n] * force, errors[n])
    return steps, one_sided


def _forces_per_error(delassus: Delassus) -> Floats:
    """Return the largest errors (rows,) of scaled forces in states with the error one in the energy norm.

    They are the roots of the diagonal of W^{-1}.
    """
    W = delassus.W
    if not isinstance(W, np.ndarray):
        raise SceneError("sensitivities: the contact has too many nodes for a dense matrix; take a coarser mesh.")
    return np.sqrt(np.abs(np.diag(np.linalg.inv(W + REGULARISATION * np.eye(len(W))))))


def _linear_step(
    system: System, delassus: Delassus, course: Course, at: Observed, sticks: Bools, *, n: int
) -> LinearStep:
    """Return step n, linearised on the active sets of its answer."""
    operators, u, p = delassus.operators, delassus.u, course.p[n]
    rows, block, unknowns = operators.B.shape[0], operators.block, operators.K.shape[0]
    slip, w = operators.blocks(u[:rows] * at.slips[n, :rows]), at.w[n] / u[:rows:block]
    stick, size = sticks & (w > 0), lengths(slip)
    along = np.where(stick, 0.0, size)
    law = Weights(at.w[n], system.norms if system.follows_answer else None, t=float(course.times[n]))
    rates = np.zeros(0) if system.limits is None else system.limits.rates
    return LinearStep(
        delassus=delassus,
        sets=ActiveSets(
            stick=stick, act=p > 0, direction=directions(slip, size), along=along, w=w, size=w + SHIFT * along
        ),
        law=law.in_units(u[:rows:block], u[rows:]),
        p=p / u[rows:],
        memory=sp.csr_matrix(course.rates[n] * system.damping.C if system.damping else (unknowns, unknowns)),
        recalls=np.append(np.ones(rows), rates)[:, None],
    )
