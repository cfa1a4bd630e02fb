"""Shakedown: the largest factor of a cycle for which slip stops (docs/theory/limit_load_and_shakedown.md).

Let g be the friction bounds, f_0 the loads at the first instant, N the rigid motions, B the slip matrix, and E(t) the
change of friction forces since the first instant while all contact sticks. By Melan's theorem slip stops under alpha E
if constant forces s exist with N'B's = N'f_0 and |s_i + alpha E_i(t)| <= g_i. Koiter's theorem gives upper bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError, SolverFailed
from vemcvx.base.outline import ArrayRecord
from vemcvx.limit_analysis.limit_load import TOLERANCE, Balance, sum_work
from vemcvx.meshes import Mesh
from vemcvx.scene import PosedScene, Scene, pose_scene, suppress_scene_warnings
from vemcvx.simulation import check_kinds
from vemcvx.stepping import check_times, march


@dataclass(frozen=True, repr=False, eq=False)
class Shakedown(ArrayRecord):
    """Two bounds on the largest factor of a cycle for which slip stops. There are T instants and m friction terms.

    Attributes
    ----------
    factor, upper : float
        Melan's lower bound, from `residual`; Koiter's upper bound, from `slips`.
    points : (m, dim) array
        The contact nodes.
    bounds : (m,) array
        Friction bounds, as forces.
    elastic : (T, m, block) array
        Changes of friction forces since the first instant while all contact sticks. In the plane block = 1, in space 2.
    residual : (m, block) array
        Constant friction forces: ``residual + factor * elastic`` obeys the bounds at all instants.
    slips : (T, m, block) array
        Increments of slip in a cycle, on which `elastic` does the work 1.

    Examples
    --------
    >>> vx.Shakedown(1.0, 1.5, *np.zeros((5, 1))).upper
    1.5
    """

    factor: float
    upper: float
    points: Floats
    bounds: Floats
    elastic: Floats
    residual: Floats
    slips: Floats


def shakedown(scene: Scene, mesh: Mesh, times: ArrayLike) -> Shakedown:
    """Return the largest factor of a load cycle for which slip stops after some repetitions.

    The factor multiplies the changes of loads and prescribed displacements since the first instant. Above the factor,
    slip never stops. If friction of stuck contact is singular at the ends of contact, the factor tends to zero as the
    mesh is refined.

    Parameters
    ----------
    scene : Scene
        Bilateral contact and Tresca's friction with constant bounds, without viscosity.
    mesh : PolygonMesh or PolyhedralMesh
    times : increasing sequence of instants
        One cycle, with all instants at which loads turn. Loads are evaluated at these instants only.

    Returns
    -------
    Shakedown

    Raises
    ------
    SceneError
        The theorems do not hold for the scene, loads do not change friction, or friction does not balance the loads at
        the first instant.
    SolverFailed
        The lower bound could not be verified.

    Examples
    --------
    >>> floor = vx.BilateralContact(on="bottom"), vx.TrescaFriction(1.0, on="bottom")
    >>> move = vx.PrescribedDisplacement(lambda x, t: np.tile([0.2 * t, 0.0], (len(x), 1)), on="top")
    >>> scene = vx.Scene(vx.Elasticity(20.0, 0.0), move, *floor)
    >>> round(vx.shakedown(scene, vx.meshes.squares(2), [0.0, 1.0]).factor, 6)
    1.25
    """
    check_kinds(scene, mesh)
    instants = check_times(times).tolist()
    with suppress_scene_warnings():
        posed = pose_scene(scene, mesh, instants)
    g, system = _read_bounds(posed, instants), posed.system
    # Infinite weights make nodes stick. Nodes whose bound is zero bear no friction.
    norms = None if system.norms is None else replace(system.norms, w=np.where(g > 0, np.inf, 0.0))
    forces = march(replace(system, norms=norms), instants, initial="settled").multipliers[:, : len(g)]
    E = forces - forces[0]
    N = np.zeros((system.n, 1)) if system.kernel is None else system.kernel.modes
    dead, B = sum_work(posed, N, posed.force(instants[0])), (system.B @ N).reshape(*E.shape[1:], N.shape[1])
    unit, largest = float(g.max()) or 1.0, float(np.abs(E).max())
    if largest <= SAME * max(np.abs(system.force(t)).max() for t in instants):
        raise SceneError("shakedown: the loads do not change the friction forces. Slip stops for every factor.")
    none = sp.csr_matrix((len(g), 0))
    balance = Balance(B, np.zeros((0, len(dead))), w=g / unit, J=none, dead=dead / unit, push=0.0 * dead)
    alpha, s, p, _, v = balance.solve("shakedown", E / largest)
    s, _, off = balance.correct_forces(alpha, s, p)
    if not off < TOLERANCE:
        raise SolverFailed(f"shakedown: no verified lower bound: a condition is violated by {off:.1e}.")
    net = v.sum(axis=0)
    c = np.linalg.lstsq(B.reshape(-1, len(dead)), net.ravel())[0]
    # Correct the slips v: their sum over a cycle must be B c for a motion c.
    size = np.linalg.norm(v, axis=2, keepdims=True) + np.finfo(float).tiny
    v = v - (net - B @ c) * size / size.sum(axis=0)
    work = float((E * v).sum())
    return Shakedown(
        factor=_find_largest_factor(unit * s, E, g),
        upper=float((g * np.linalg.norm(v, axis=2)).sum() - dead @ c) / work,
        points=mesh.points[posed.terms.nodes[: len(g)]],
        bounds=g,
        elastic=E,
        residual=unit * s,
        slips=v / work,
    )


def _read_bounds(posed: PosedScene, instants: list[float]) -> Floats:
    system, norms, drawn = posed.system, posed.system.norms, posed.terms.dragged
    if norms is None:
        raise SceneError("shakedown: found no friction; wanted TrescaFriction where the body can slip.")
    g, B = norms.weights(instants[0]), system.B.tocoo()
    unknowns = np.unique(np.column_stack([B.coords[1], B.coords[0] // system.block]), axis=0)[:, 0]
    beyond = {
        "one-sided contact": system.limits is not None,
        "viscosity": system.damping is not None,
        "friction that depends on pressure, slip or speed": norms.law is not None,
        "friction bounds that change": any((norms.weights(t) != g).any() for t in instants),
        "friction that always sticks": np.isinf(g).any(),
        "nodes that supports drag against friction": drawn is not None and drawn.any(),
        "several friction terms on one unknown": (np.bincount(unknowns) > 1).any(),
    }
    for words, found in beyond.items():
        if found:
            wanted = "bilateral contact and Tresca's friction with constant bounds, for which Melan's theorem holds"
            raise SceneError(f"shakedown: found {words}; wanted {wanted}.")
    return g


def _find_largest_factor(s: Floats, E: Floats, g: Floats) -> float:
    """Return the largest alpha with |s_i + alpha E_i(t)| <= g_i for all i and t."""
    a, b, c = (E**2).sum(axis=2), (E * s).sum(axis=2), np.maximum(g**2 - (s**2).sum(axis=1), 0.0)
    root = np.sqrt(b**2 + a * c)
    # The positive root x of a x^2 + 2 b x = c, without cancellation.
    falls = np.divide(root - b, a, out=np.full_like(root, np.inf), where=a > 0)
    return float(np.divide(c, root + b, out=falls, where=b > 0).min())
