r"""Derivatives of a run with respect to parameters: the answer of each step is differentiated on its active sets.

Let K be the stiffness, C the damping, f the loads, and A = [B; D] the rows of friction and limits, with the forces
x = (lam, p). Let w be the friction bounds, e the gaps, c the compliances of limits, and k the duration of step n.
Motions of ground and supports add -b_n to the slips. The states y_n obey

    K y_n + C (y_n - y_{n-1}) / k + A'x_n = f_n,    off_n = (B (y_n - y_{n-1}) - b_n,  D y_n - e_n - c p_n).

Sticking terms and acting limits have off_n = 0. Terms with the slip s have lam = w(p) s/|s|. Open limits have p = 0.
All data may depend on a parameter, and d marks derivatives by the parameter. Derivatives of data are central
differences at fixed states. Let K_k = K + C / k and y_prev = y_{n-1}. The columns of H are the directions of slip.
Newton's method (:mod:`vemcvx.solvers.newton`) defines matrices P and Q, unknowns z and a diagonal matrix `compliance`
for the active sets of the answer. Then dy and dx = (dlam, dp) obey

    K_k dy + A'dx = push,    dx = H dw + Q z,    P (A dy - (0; c dp) + off) = compliance z,
    push = -d(K y + C (y - y_prev) / k + A'x - f) + C dy_prev / k,    off = d off_n - (B; 0) dy_prev.

The *forward* sweep solves these equations for each parameter, step by step. The *adjoint* sweep solves the transposed
equations, with P and Q exchanged, backwards in time. One adjoint sweep differentiates a weighted sum of quantities by
all parameters (Giles and Pierce, Flow, Turbulence and Combustion 65 (2000)).

Without dashpots, a step needs only the m unknowns of contact (:mod:`vemcvx.program.condensation`). Column j of the
matrix E is the state in which contact unknown j is 1 and the others are 0. Loads f are condensed to E'f.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, as_real_array, as_shaped_array, brief, call_function, finite, lengths
from vemcvx.base.errors import SceneError
from vemcvx.effects import CoulombFriction, TrescaFriction
from vemcvx.history import History
from vemcvx.meshes import Mesh
from vemcvx.program.forces import Delassus, Point
from vemcvx.results import record
from vemcvx.scene import Scene, pose_scene, pose_unchecked, suppress_scene_warnings
from vemcvx.scene.pose import PosedScene
from vemcvx.sensitivity.observed import FORMS, Gradients, Observed, Quantities, condense, find_quantities
from vemcvx.simulation import begins, check_kinds, free_unknowns
from vemcvx.solvers import Newton, Solver
from vemcvx.solvers.law import Weights
from vemcvx.solvers.newton import REGULARISATION, ActiveSets, build_columns, build_matrix
from vemcvx.stepping import Memory, check_times, prepare
from vemcvx.stepping.backward_euler import march_prepared
from vemcvx.stepping.state import Frame, PreparedRun

log = logging.getLogger("vemcvx")

RELATIVE_STEP = 3e-5
"""Step of central differences, divided by the parameter. At a parameter 0, the step is RELATIVE_STEP."""

Change = tuple[Any, Any, Any]
"""The derivatives of push, off and w in one step, with one column per parameter."""


@dataclass(frozen=True, eq=False)
class LinearStep:
    """One step, linearised on its active sets."""

    delassus: Delassus
    P: sp.csr_matrix
    Qt: sp.csr_matrix
    compliance: Floats
    H: sp.csr_matrix  # (rows, m) directions of slipping terms
    memory: Any  # C / k; 0 without dashpots
    recalls: Floats  # (rows, 1) 1 for rows of y - y_prev, 0 for rows of y

    def forward(self, change: Change, before: Floats) -> tuple[Floats, Floats]:
        """Return dy and dx of this step, given dy of the previous step."""
        push, off, w = (x if isinstance(x, np.ndarray) else x.toarray() for x in change)
        A, given = self.delassus.operators.A, self.H @ w
        push, off = push + self.memory @ before - A.T @ given, off - self.recalls * (A @ before)
        y, x = self._solve(push, off, self.P, self.Qt)
        return y, x + given

    def backward(self, by_y: Floats, by_x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the derivatives of a function J by push, off, w and y_prev, given dJ/dy and dJ/dx."""
        A = self.delassus.operators.A
        y, x = self._solve(by_y, -by_x, self.Qt, self.P)
        return y, -x, self.H.T @ (by_x - A @ y), self.memory.T @ y + A.T @ (self.recalls * x)

    def _solve(self, push: Floats, off: Floats, P: sp.csr_matrix, Qt: sp.csr_matrix) -> tuple[Floats, Floats]:
        """Return y and x = Q z with K_k y + A'x = push, P (A y - (0; c p) + off) = compliance z."""
        delassus, A, solve = self.delassus, self.delassus.operators.A, self.delassus.operators.factor.solve
        M = build_matrix(np.asarray(delassus.W), delassus.R, P, Qt, self.compliance)
        u, count = delassus.u[:, None], P.shape[0]
        z = np.linalg.solve(M, np.vstack([P @ (u * (A @ solve(push) + off)), delassus.N.T @ push]))
        x = u * (Qt.T @ z[:count])
        return solve(push - A.T @ x) + delassus.N @ z[count:], x


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
        True for steps in which, within the certified error, a multiplier may reach its bound, a slip may end or an open
        gap may close. From such a step on, derivatives are one-sided.

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
    _steps: dict[int, LinearStep] = field(repr=False)
    _rows: Gradients = field(repr=False)
    _changes: Sequence[Change] = field(repr=False)
    _explicit: Floats = field(repr=False)  # (Q, N + 1, P) derivatives at fixed unknowns

    @cached_property
    def jacobian(self) -> Floats:
        """The derivatives (Q, N + 1, P), by one forward sweep for each parameter."""
        (y, earlier, x), found = self._rows, np.zeros_like(self._explicit)
        dy = np.zeros((y.shape[2], found.shape[2]))
        for n, step in self._steps.items():
            before, (dy, dx) = dy, step.forward(self._changes[n], dy)
            found[:, n] = y[:, n] @ dy + earlier[:, n] @ before + x[:, n] @ dx
        found[self._lost] = np.cumsum(found[self._lost], axis=1)
        return found + self._explicit

    @property
    def _lost(self) -> Bools:
        return np.array(self.of) == "dissipated"

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
        shape = self.values.shape
        given = as_shaped_array(weights, "gradient: weights", f"an array {shape}", shape)
        found, by_y = np.einsum("qt,qtp->p", given, self._explicit), np.zeros((self._rows[0].shape[2], 1))
        each = np.where(self._lost[:, None], np.cumsum(given[:, ::-1], axis=1)[:, ::-1], given)
        for n, step in reversed(self._steps.items()):
            y, before, x = ((each[:, n] @ of[:, n])[:, None] for of in self._rows)
            *by_data, by_y = step.backward(by_y + y, x)
            by_y = by_y + before
            found = found + sum((d.T @ by)[:, 0] for d, by in zip(self._changes[n], by_data, strict=True))
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

    Derivatives of data are central differences. The answers of steps are differentiated exactly, on their active sets.

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
        (1, 0.5) y", "slip at (0.5, 0) x" (at a contact node), "energy", and "dissipated" (the friction work, with an
        error O(k) for steps of the duration k).
    initial : None, array or "settled"
        As for :func:`vemcvx.simulate`. A given state does not depend on the parameters.
    shapes : callable x (k, dim) -> (k, P), optional
        Shape functions: shapes(x) @ theta is the bound of TrescaFriction or the coefficient of CoulombFriction at
        points x, and nothing else depends on theta. Derivatives are then analytic, also for thousands of parameters.

    Returns
    -------
    Sensitivities
        Use `jacobian` (forward sweeps) for few parameters, and `gradient` (adjoint sweep) for many parameters and one
        sum of quantities. Both are computed when they are used.

    Raises
    ------
    SceneError
        `scene_of` does not return a scene, or a quantity does not fit the scene. Friction depends on slips, nothing
        holds the body, or a small change of `theta` changes the number of unknowns.
    NotCertified
        As for :func:`vemcvx.simulate`.

    Notes
    -----
    Central differences have the step h = 3e-5 times the parameter. If data are singular at a distance d from
    the parameter, as moduli are at Poisson's ratio 0.5, derivatives have a relative error of about (h / d)^2.

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
    if not isinstance(initial, (type(None), list, tuple, np.ndarray)) and repr(initial) != "'settled'":
        raise SceneError(f"sensitivities: found initial = {brief(initial)}; there are None, an array and 'settled'.")
    times = check_times(times)

    def pose(values: Floats, posed: Callable[..., PosedScene] = pose_unchecked) -> PosedScene:
        scene = call_function(scene_of, (values,), f"scene_of({brief(values)}) failed", "return a vemcvx.Scene")
        if not isinstance(scene, Scene):
            raise SceneError(f"scene_of: found {brief(scene)} as its result; it must return a vemcvx.Scene.")
        check_kinds(scene, mesh)
        return posed(scene, mesh, times.tolist())

    posed = pose(parameters, pose_scene)
    _refuse(posed)
    quantities, solver = find_quantities(of, posed), Newton(accuracy=1e-10) if solver is None else solver
    run = prepare(posed.system, solver, True, True, shortest=float(np.diff(times).min(initial=np.inf)))
    found = march_prepared(run, times, free_unknowns(initial, posed, times), np.arange(len(times)), storage=Memory())
    history = History.from_results(record(posed, found, 0.0, Memory()), begins(initial))
    at = quantities.observe(posed, history)
    rows, inner = quantities.differentiate(posed, at, run)
    steps, one_sided = _linearise(run, history, at)
    if one_sided.any():
        when = ", ".join(f"{t:.6g}" for t in times[one_sided][:6])
        log.warning("sensitivities: contact or friction is about to change at t = %s: derivatives are one-sided.", when)
    if shapes is None:
        changes, explicit = _differences(pose, parameters, history, posed, quantities, run=run, inner=inner)
    else:
        changes = _field_changes(posed, found.pressures, shapes, len(parameters), len(run.condensation.retained))
        explicit = np.zeros((len(of), len(times), len(parameters)))
    kept = at.values, history, one_sided
    return Sensitivities(tuple(of), *kept, _steps=steps, _rows=rows, _changes=changes, _explicit=explicit)


def read_parameters(raw: ArrayLike, subject: str) -> Floats:
    """Return parameters (P,). Raise SceneError for anything else."""
    found = finite(as_real_array(raw, subject, "numbers (P,)"), subject)
    return as_shaped_array(found, subject, "numbers (P,)", (found.size,))


def _refuse(posed: PosedScene) -> None:
    terms, law = posed.terms, posed.terms.law_of(slice(None))
    drags = terms.dragged is not None and bool(terms.dragged[terms.acting :].any())
    reasons = {
        "nothing holds the body": bool(posed.pins),
        "its friction depends on slips, or its law has no slope": law is not None and (law.slips or law.slope is None),
        "its friction depends on pressure at nodes dragged by supports": law is not None and drags,
    }
    if any(reasons.values()):
        words = ", ".join(words for words, found in reasons.items() if found)
        raise SceneError(f"sensitivities: this scene has no derivatives, because {words}.")


def _differences(
    pose: Callable[[Floats], PosedScene],
    theta: Floats,
    history: History,
    own: PosedScene,
    quantities: Quantities,
    *,
    run: PreparedRun,
    inner: Floats,
) -> tuple[list[Change], Floats]:
    """Return the `Change` of each step by central differences, and `Sensitivities._explicit`."""
    P, m, E = own.supports.P, len(run.condensation.retained), None
    if m < len(theta) * len(history.trajectory.times):  # m solves cost less than a solve per parameter and step.
        E = run.condensation.complete(np.zeros((run.system.n, m)), np.eye(m))
    columns, shapes = [], [M.shape for M in (own.supports.P, own.terms.rows, own.obstacles.rows)]
    for j, step in enumerate(RELATIVE_STEP * np.where(theta != 0, np.abs(theta), 1.0)):
        pair = []
        for way in (step, -step):
            with suppress_scene_warnings():
                posed = pose(theta + way * np.eye(len(theta))[j])
            if [M.shape for M in (posed.supports.P, posed.terms.rows, posed.obstacles.rows)] != shapes:
                raise SceneError(f"sensitivities: theta[{j}] changes the unknowns or the contact nodes of the scene.")
            at = quantities.observe(posed, history)
            if (at.lam.any(axis=2) & ~history.trajectory.multipliers.any(axis=2)).any():
                raise SceneError(f"sensitivities: theta[{j}] moves, against friction, a support at rest in the run.")
            pair.append((at.forces, at.off, np.where(at.w < np.inf, at.w, 0.0), at.values))
        forces, off, w, values = ((more - less) / (2.0 * step) for more, less in zip(*pair, strict=True))
        push = condense(run, P, forces)[0] if E is None else (P.T @ forces).T @ E
        columns.append((-push, off, w, values - np.einsum("qit,it->qt", inner, forces)))
    *data, explicit = (np.stack(each, axis=-1) for each in zip(*columns, strict=True))
    return list(zip(*data, strict=True)), explicit


def _field_changes(
    posed: PosedScene, p: Floats, shapes: Callable[[Floats], ArrayLike], count: int, unknowns: int
) -> list[Change]:
    """Return the `Change` of each step if `theta` changes friction bounds only."""
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
    rows, gather = terms.acting * terms.block + p.shape[1], terms.gather[: terms.acting]
    none = sp.csr_matrix((unknowns, count)), sp.csr_matrix((rows, count))
    forces = (size if terms.press is None else size + (size == 0) * (terms.press @ force) for force in p)
    return [(*none, sp.csr_matrix(gather @ sp.diags_array(force) @ S)) for force in forces]


def _linearise(run: PreparedRun, history: History, at: Observed) -> tuple[dict[int, LinearStep], Bools]:
    """Return step number -> linearised step, and the mask `Sensitivities.one_sided`."""
    system, found, m = run.system, history.trajectory, run.operators.count
    count, block, unknowns = system.B.shape[0], system.block, len(run.condensation.retained)
    norms, none = system.norms if system.follows_answer else None, sp.csr_matrix((unknowns, unknowns))
    recalls = np.append(np.ones(count), np.zeros(0) if system.limits is None else system.limits.rates)[:, None]

    @cache
    def measure(frame: Frame) -> tuple[Delassus, Floats]:
        delassus = frame.prepared.newton.delassus
        if not isinstance(W := delassus.W, np.ndarray):
            raise SceneError("sensitivities: the contact has too many nodes for a dense matrix; take a coarser mesh.")
        # An error r in the energy norm changes force j by at most r (W^{-1})_jj^{1/2}.
        return delassus, np.sqrt(np.abs(np.diag(np.linalg.inv(W + REGULARISATION * np.eye(len(W))))))

    steps, one_sided = dict[int, LinearStep](), np.zeros(len(found.times), dtype=bool)
    errors = np.sqrt(2.0 * found.gap) + np.sqrt(2.0 * found.floor)
    for n in range(0 if history.begins == "settled" else 1, len(errors)):
        delassus, force = measure(run.frame(float(at.k[n])))
        u, x = delassus.u, np.append(found.multipliers[n, :m], found.pressures[n]) / delassus.u
        law = Weights(at.w[n], norms, float(found.times[n]), term_units=u[:count:block], limit_units=u[count:])
        point = Point(x, u * at.off[n], np.zeros(0), np.zeros(0))
        sets, (lam, p) = ActiveSets.at(delassus, point, law), delassus.split(x)
        slipping = np.where(sets.stick[:, None], 0.0, sets.direction).ravel()
        H = sp.csr_matrix((slipping, (np.arange(count), np.arange(count) // block)), shape=(len(x), len(lam)))
        memory = system.damping.C / at.k[n] if system.damping is not None and n > 0 else none
        steps[n] = LinearStep(delassus, *build_columns(sets, p, law), H=H, memory=memory, recalls=recalls)
        margin = np.where(sets.w > 0, np.where(sets.stick, sets.w - lengths(lam), sets.along), np.inf).repeat(block)
        margin = np.append(margin, np.where(sets.act, p, -point.off[count:]))
        one_sided[n] = (margin <= errors[n] * np.where(sets.held, force, 1.0)).any()
    return steps, one_sided
