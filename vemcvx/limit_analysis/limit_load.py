r"""The limit load of bodies that friction and one-sided contact alone hold (docs/theory/limit_load_and_shakedown.md).

Let N be the rigid motions that no support prevents, f_0 the loads of the scene, and f the load to multiply. A motion u
has slips B u and approaches D u. At contact forces p, friction lam has the bound w + J p. We maximise alpha:

    N'(B'lam + D'p) = N'(f_0 + alpha f),     |lam_i| <= w_i + (J p)_i,     p >= 0.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import ROUNDING, Floats, brief, directions, lengths, number, onto_discs
from vemcvx.base.errors import SceneError, SolverFailed
from vemcvx.base.outline import ArrayRecord
from vemcvx.effects import Contribution, CoulombFriction, Effect
from vemcvx.meshes import Mesh
from vemcvx.program.kernel import balance_multipliers
from vemcvx.scene import PosedScene, Scene, pose_scene, suppress_scene_warnings
from vemcvx.simulation import check_kinds

MARGIN = 1e-10  # Fraction by which friction is reduced before forces are corrected.
TOLERANCE = 0.1 * MARGIN  # Largest violation of a condition by corrected forces and motions.


@dataclass(frozen=True, repr=False, eq=False)
class LimitLoad(ArrayRecord):
    """The largest factor of a load that contact forces can balance, between two bounds.

    Attributes
    ----------
    factor, upper : float
        The lower and the upper bound.
    friction, pressure : (n_nodes, dim) arrays
        Forces of friction and of one-sided contact on the nodes, which balance all loads at `factor`.
    motion : (n_nodes, dim) array
        Displacements of the nodes in the mechanism, on which the load does the work 1.
    mechanism : str
        The mechanism in words, up to a factor.

    Examples
    --------
    >>> vx.LimitLoad(1.0, 1.5, np.zeros((1, 2)), np.zeros((1, 2)), np.eye(1, 2), "the translation (1, 0)").upper
    1.5
    """

    factor: float
    upper: float
    friction: Floats
    pressure: Floats
    motion: Floats
    mechanism: str


def limit_load(scene: Scene, mesh: Mesh, load: Effect | Sequence[Effect], t: float = 1.0) -> LimitLoad:
    """Return the largest factor of a load that friction and one-sided contact can balance.

    Above the factor there is no equilibrium. With Tresca's law every step below the factor has an equilibrium. With
    Coulomb's law equilibrium may be lost below the factor, depending on the history.

    Parameters
    ----------
    scene : Scene
        Bodies with rigid motions that only friction and contact prevent. Loads of the scene are not multiplied.
    mesh : PolygonMesh or PolyhedralMesh
    load : Effect or sequence of Effect
        The load that the factor multiplies, such as Traction, Pressure, BodyForce or PointLoad.
    t : float
        The instant at which loads and friction bounds are evaluated.

    Returns
    -------
    LimitLoad

    Raises
    ------
    SceneError
        Supports hold the body; friction is neither Tresca's nor Coulomb's; `load` is no load, or drives no motion;
        contact forces cannot balance the loads of the scene, or can balance every multiple of `load`.
    SolverFailed
        The bounds could not be verified.

    Examples
    --------
    >>> floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Pressure(2.0, on="top"), *floor)
    >>> round(vx.limit_load(scene, vx.meshes.squares(4), vx.Traction((1.0, 0.0), on="bottom")).factor, 6)
    0.6
    """
    check_kinds(scene, mesh)
    t = number(t, "limit_load: found t", "an instant")
    with suppress_scene_warnings():
        posed = pose_scene(scene, mesh, between=[t])
    kernel, shape = posed.system.kernel, mesh.points.shape
    if kernel is None or kernel.moved is None:
        found = "neither supports nor contact hold the body" if posed.pins else "supports hold the body"
        raise SceneError(f"limit_load: {found}; wanted a body that only friction or one-sided contact holds.")
    w, J = _read_law(posed, t)
    dead, push = (sum_work(posed, kernel.modes, force) for force in (posed.force(t), _sum_loads(posed, load, t)))
    if not push.any():
        raise SceneError(f"limit_load: the load does no work in {' or '.join(kernel.names)}, so it has no limit.")
    per_load = float(np.abs(push).max())
    unit = max(float(w.sum()), float(np.abs(dead).max())) or per_load
    B, D = (np.asarray(rows @ kernel.modes) for rows in (posed.system.B, posed.system.D))
    B = B.reshape(len(w), posed.system.block, len(push))
    balance = Balance(B, D, w=w / unit, J=J, dead=dead / unit, push=push / per_load)
    alpha, lam, p, c, _ = balance.solve("limit_load")
    alpha *= 1.0 - MARGIN
    lam, p, off = balance.correct_forces(alpha, lam, p)
    c, over = balance.correct_motion(c, lam, p)
    if not max(off, over) < TOLERANCE:
        raise SolverFailed(f"limit_load: no verified bounds: a condition is violated by {max(off, over):.1e}.")
    upper = float(balance.w @ lengths(balance.B @ c) - balance.dead @ c)
    return LimitLoad(
        factor=min(alpha, upper) * unit / per_load,
        upper=upper * unit / per_load,
        friction=-unit * (posed.terms.acting_rows.T @ lam.ravel()).reshape(shape),
        pressure=-unit * (posed.obstacles.rows.T @ p).reshape(shape),
        motion=kernel.moved @ c / per_load,
        mechanism=kernel.name(c),
    )


def _sum_loads(posed: PosedScene, load: Any, t: float) -> Floats:
    total = np.zeros(posed.A.shape[0])
    for effect in load if isinstance(load, (list, tuple)) and load else [load]:
        part = effect.contribute(posed.space) if isinstance(effect, Effect) else Contribution()
        if not part.loads or part.supports or part.stiffness is not None:
            words = "an effect that loads the body, such as Traction, Pressure, BodyForce or PointLoad, or a list"
            raise SceneError(f"limit_load: found load = {brief(effect)}; wanted {words}.")
        total += np.sum([one.vector(t) for one in part.loads], axis=0)
    return total


def _read_law(posed: PosedScene, t: float) -> tuple[Floats, sp.csr_matrix]:
    system, (m, r) = posed.system, (posed.system.B.shape[0] // posed.system.block, posed.system.D.shape[0])
    for friction, cause in zip(posed.terms.frictions, posed.causes["frictions"], strict=True):
        effect = posed.scene.canonical[cause]
        coulomb = isinstance(effect, CoulombFriction) and effect.cap is None
        if friction.law is not None and not coulomb:
            raise SceneError(f"{friction.subject}: limit_load takes Tresca's law, or Coulomb's law without cap.")
    if system.dashpots.any():
        raise SceneError("limit_load: found dashpots of VelocityContact, which bear no force at rest.")
    if system.norms is None:
        return np.zeros(0), sp.csr_matrix((0, r))
    w, J = system.norms.weights_under(t, np.zeros(r)), system.norms.slope_by_forces(t, np.zeros(r), np.zeros(m))
    if np.isinf(w).any():
        raise SceneError("limit_load: found friction that always sticks; hold these nodes by supports instead.")
    return w, sp.csr_matrix((m, r)) if J is None else J


def sum_work(posed: PosedScene, N: Floats, force: Floats) -> Floats:
    """Return the work N'f of nodal forces f, with zeros for rounding errors."""
    f = posed.supports.gather(force)
    return np.where(np.abs(N.T @ f) > ROUNDING * (np.abs(N).T @ np.abs(f)), N.T @ f, 0.0)


class Balance(NamedTuple):
    """The equations B'lam + D'p = dead + alpha * push for k motions, scaled to numbers of about 1."""

    B: Floats  # (m, block, k) slips in the motions
    D: Floats  # (r, k) approaches in the motions
    w: Floats  # (m,) friction bounds at p = 0
    J: sp.csr_matrix  # (m, r) friction coefficients
    dead: Floats  # (k,) work of the loads of the scene
    push: Floats  # (k,) work of the multiplied load

    @property
    def modes(self) -> Floats:
        """The rows of B, followed by the rows of D."""
        return np.vstack([self.B.reshape(-1, len(self.push)), self.D])

    def solve(self, subject: str, elastic: Any = (0.0,)) -> tuple[float, Floats, Floats, Floats, Floats]:
        """Find the largest alpha with |lam + alpha E| <= w + J p for every array E (m, block) in `elastic`.

        Return alpha, lam, p, the motion c of the mechanism, and the slips for each E.
        """
        import cvxpy as cp

        (m, block, _), rows, alpha = self.B.shape, self.B.shape[0] * self.B.shape[1], cp.Variable()

        def admit(x: Any, factor: Any) -> list[Any]:
            p, signs = (x[rows:], [x[rows:] >= 0]) if len(self.D) else (np.zeros(0), [])
            bound, lam = (1.0 - MARGIN) * (self.w + self.J @ p), cp.reshape(x[:rows], (block, m), order="F") if m else 0
            cones = [cp.SOC(bound, lam + factor * np.transpose(E), axis=0) for E in elastic if m]
            return [self.modes.T @ x == self.dead + factor * self.push, *cones, *signs]

        x: Any = cp.Variable(len(self.modes))
        conditions = admit(x, alpha)
        # A second set of contact forces balances the loads of the scene without the multiplied load.
        alone = admit(cp.Variable(len(self.modes)), 0.0) if self.dead.any() and self.push.any() else []
        problem = cp.Problem(cp.Maximize(alpha), conditions + alone)
        with warnings.catch_warnings(), suppress(cp.error.SolverError):
            warnings.simplefilter("ignore")  # cvxpy warns of inaccurate answers, but the bounds are verified.
            problem.solve(solver="CLARABEL", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        if "unbounded" in str(problem.status):
            why = "statics sets no limit to pressures on a body between two contacts, or a contact and a support"
            raise SceneError(f"{subject}: friction and contact can bear every multiple of the load: {why}.")
        if "infeasible" in str(problem.status):
            raise SceneError(f"{subject}: friction and contact cannot balance the scene's loads, even at factor 0.")
        if alpha.value is None:
            raise SolverFailed(f"{subject}: Clarabel found no answer; its status is {problem.status}.")
        slips = [
            -np.reshape(one.dual_value[1], (block, m), order="F").T for one in conditions[1 : 1 + len(elastic)] if m
        ]
        lam, p = x.value[:rows].reshape(m, block), x.value[rows:]
        return float(alpha.value), lam, p, conditions[0].dual_value, np.array(slips)

    def correct_forces(self, alpha: float, lam: Floats, p: Floats) -> tuple[Floats, Floats, float]:
        """Return admissible forces that balance `dead + alpha * push`, and the largest violation of a condition."""
        p = np.maximum(p, 0.0)
        bound = (1.0 - 0.5 * MARGIN) * (self.w + self.J @ p)
        near, load = (onto_discs(lam, bound), p), self.dead + alpha * self.push
        lam, p = balance_multipliers(near, bound, self.modes, load, (bound, p + MARGIN))
        left = np.abs(load - np.append(lam, p) @ self.modes)
        return lam, p, max(x.max(initial=0.0) for x in (left, -p, lengths(lam) - self.w - self.J @ p))

    def correct_motion(self, c: Floats, lam: Floats, p: Floats) -> tuple[Floats, float]:
        """Return the corrected motion c, and the largest violation of a condition."""
        c = c / (self.push @ c)
        opens = self.D @ c + self.J.T @ lengths(self.B @ c)
        closed, sticks = p > -opens, self.w + self.J @ p - lengths(lam) > lengths(self.B @ c)
        for _ in range(6):
            slip = self.B @ c
            dilates = self.D + self.J.T @ np.einsum("mb,mbk->mk", directions(slip, lengths(slip)), self.B)
            rows = np.vstack([dilates[closed], self.B[sticks].reshape(-1, len(c))])
            c = c - np.linalg.lstsq(rows, rows @ c, rcond=1e-8)[0]
            c = c / (self.push @ c)
        opens = self.D @ c + self.J.T @ lengths(self.B @ c)
        return c, float(opens.max(initial=0.0))
