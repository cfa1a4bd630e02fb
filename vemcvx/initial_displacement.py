"""The displacement that a run begins from: given at nodes, or as a function of place that is projected, (3.26)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import SAME, Floats, brief, shaped
from vemcvx.effects import data
from vemcvx.errors import SceneError
from vemcvx.scene.pose import PosedScene
from vemcvx.stepping.beginning import ROUNDED_LOAD, Balanced, Beginning
from vemcvx.vem import mean_strains, stress_load, stresses


@dataclass(frozen=True)
class Projected:
    """P^h u_0: see :func:`vemcvx.projected`, which makes it."""

    displacement: data.Datum


def projected(displacement: data.Datum) -> Projected:
    """The energy projection P^h u_0 of an initial displacement, ``simulate(..., initial=vx.projected(u_0))``.

    a^h(P^h u_0, v) = a(u_0, v) for all v of V^h, (2.11) and (3.26), up to O(h): on every mesh the discrete displacement
    with the stresses of u_0. Of C eps(u_0) cells know the mean alone, for v is virtual, and what that leaves out of
    a(u_0, v) is of the order of (3.18); it is nothing where u_0 is linear. u_0 is read on edges, in space on faces,
    where its strains are not asked for (:mod:`vemcvx.vem.loads`).

    **The run begins one step further.** Condition (2.1), a(u_0, v) + j(v) >= <l(0), v>, says that the loads at times[0]
    and friction within its bounds balance the stresses of u_0. A u_0 that obeys it gives a P^h u_0 that obeys it on the
    mesh up to O(h), for loads and friction are integrated by other rules. State 0 is the end of one step at times[0]
    from P^h u_0, which obeys it by construction, (2.13), and is as near to u_0 by order, O(h). With Viscosity, where
    nothing like (2.1) is asked, it is P^h u_0 itself. How far that step goes is logged, and where it is more than the
    mesh accounts for a warning says that u_0 violates (2.1).

    Parameters
    ----------
    displacement : callable f(x, t) -> (m, dim)
        u_0 at points x (m, dim), with the supports' values there; t is times[0].

    Returns
    -------
    Projected
        It knows no mesh: `adapt`, studies and problem files (``initial = vx.projected(u_0)``) take it alike.

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
    return Projected(displacement)


def free_unknowns(initial: ArrayLike | str | Projected | None, posed: PosedScene, times: Floats) -> Beginning:
    """The free unknowns of an initial displacement, at the first of the times; words pass."""
    if isinstance(initial, str):
        return initial
    if isinstance(initial, Projected):
        return _projected(initial, posed, times)
    points = posed.space.mesh.points
    kinds = "one row a node, or None, 'equilibrium', 'settled' or vx.projected(f)"
    wanted = f"displacements of shape {points.shape}, {kinds}"
    if callable(initial):
        raise SceneError(
            f"initial: found the function {brief(initial)}; wanted {wanted}. A displacement as a function f(x, t) of "
            "place goes in as vx.projected(f), which takes it to the mesh."
        )
    u = np.zeros(points.shape) if initial is None else shaped(initial, "initial", wanted, points.shape)
    if (bad := ~np.isfinite(u).all(axis=1)).any():
        raise SceneError(f"initial: found NaN or infinity at node {int(np.argmax(bad))}; wanted finite {wanted}.")
    return _within_supports(u, posed, times)


def _within_supports(u: Floats, posed: PosedScene, times: Floats) -> Floats:
    """The free unknowns of nodal displacements (n_nodes, dim), or SceneError where supports hold others."""
    t, points = float(times[0]), posed.space.mesh.points
    P, held = posed.supports.P, posed.supports.motion(t)
    y: Floats = P.T @ (u.ravel() - held)
    off = np.abs(P @ y + held - u.ravel())
    known = off.max() <= SAME * max(np.abs(u).max(), np.abs(held).max())
    # Of supports that move later, rounding may be all that there is now.
    if not known and off.max() > ROUNDED_LOAD * max(np.abs(posed.supports.motion(t)).max() for t in times.tolist()):
        node = int(np.argmax(off)) // points.shape[1]
        raise SceneError(
            f"initial: the displacement {u[node]} of node {node} at {points[node]} contradicts its supports at "
            f"t = {t:.6g}, by {off.max():.6g}. Give an initial displacement that obeys them, or initial='settled'."
        )
    return y


def _projected(initial: Projected, posed: PosedScene, times: Floats) -> Balanced:
    """The forces a(u_0, v) over the free unknowns, with the nodal values of u_0."""
    t, space = float(times[0]), posed.space

    def u_0(x: Floats) -> Floats:
        return data.vector(initial.displacement, x, t, "initial: projected")

    nodal = u_0(space.mesh.points)
    near = _within_supports(nodal, posed, times)
    stress = stresses(posed.material.moduli, mean_strains(space, u_0))
    force: Floats = stress_load(space) @ stress.ravel()
    if posed.springs is not None:
        force = force + posed.springs @ nodal.ravel()
    return Balanced(posed.supports.gather(force - posed.A @ posed.supports.motion(t)), near)
