"""Friction work, work and wear, with estimated errors due to steps and mesh.

The scene is simulated twice more: once with halved steps, and once with all cells refined. With the step size k and the
mesh size h, the estimated errors of a value Q are 3 |Q_k - Q_{k/2}| (steps) and 2 |Q_h - Q_{h/2}| (mesh). For wear, Q
is the wear at the contact node with the largest error (docs/theory/error_estimates.md).
"""

from __future__ import annotations

import contextlib

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import HistoryError, MeshError
from vemcvx.estimate.finer_steps import finer_instants
from vemcvx.history import History, scene_of
from vemcvx.meshes import Mesh
from vemcvx.meshes.polygons import nearest
from vemcvx.results import Corners, Quantity, displacement, record
from vemcvx.scene import pose_scene, suppress_scene_warnings
from vemcvx.simulation import free_unknowns
from vemcvx.stepping import Memory, march
from vemcvx.stepping.course import sample_course


def quantities(history: History) -> dict[str, Quantity]:
    """Estimate the errors of the friction work, the work and the largest wear of a run.

    The scene is simulated twice more: once with halved steps, and once with all cells refined.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict
        The values "dissipated", "work" and "wear" with estimated errors. "wear" is the largest friction work at a
        contact node, per length or area. All values are accumulated from the initial instant.

    Raises
    ------
    HistoryError
        The history was read from files, which do not contain its scene.
    SceneError
        The scene has arrays of moduli per cell, which do not fit a refined mesh; use named cell data instead.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("left"), vx.Traction((1.0, 0.0), "right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial="settled")
    >>> sorted(vx.quantities(history))
    ['dissipated', 'wear', 'work']
    """
    scene = scene_of(history, "quantities")
    own, times = _final_values(history), history.trajectory.times
    with suppress_scene_warnings():
        posed = pose_scene(scene, history.mesh, between=times.tolist())
        known = sample_course(posed.system, times)
    steps = _extrapolate_errors(
        history, _run_again(history, history.mesh, finer_instants(times, known, 2), _start(history))
    )
    mesh = dict.fromkeys(own, np.nan)
    # In space, cells that are not star-shaped about their centroids cannot be refined.
    with contextlib.suppress(MeshError):
        begin = "settled" if _start(history).any() else None
        finer = _run_again(history, history.mesh.refine(), times, begin)
        mesh = _extrapolate_errors(history, finer)
    units = {"dissipated": "energy", "work": "energy", "wear": f"energy/{history.spread[0]}"}
    return {
        name: Quantity(
            value=own[name],
            steps=1.5 * steps[name],
            mesh=mesh[name],
            unit=unit,
            unbounded=_wear_without_limit(history) if name == "wear" else "",
        )
        for name, unit in units.items()
    }


def _final_values(history: History) -> dict[str, float]:
    run, wear = history.trajectory, history.contact.wear_second_order[-1]
    work, dissipated = float(run.work_second_order[-1]), float(run.dissipated_second_order[-1])
    return {"dissipated": dissipated, "work": work, "wear": float(wear.max(initial=0.0))}


def _extrapolate_errors(history: History, finer: History) -> dict[str, float]:
    """Return twice the differences between the final values of two runs."""
    own, other = _final_values(history), _final_values(finer)
    apart = {name: 2.0 * abs(own[name] - other[name]) for name in ("dissipated", "work")} | {"wear": 0.0}
    coarse, fine = history.contact, finer.contact
    if len(coarse.nodes) and len(fine.nodes):
        away, node = nearest(fine.points, coarse.points)
        worn = (coarse.wear_second_order[-1] - fine.wear_second_order[-1][node])[away <= SAME * history.mesh.h]
        apart["wear"] = 2.0 * float(np.abs(worn).max(initial=0.0))
    return apart


def _wear_without_limit(history: History) -> str:
    """Return a sentence if the wear is unbounded, else ""."""
    contact, sides = history.contact, history.sides
    wear = contact.wear_second_order[-1:].max(axis=0, initial=0.0)
    if not wear.any() or sides is None or not history.trajectory.given_friction.any():
        return ""
    corners, near = Corners(history.mesh, contact, sides), sides.beside(int(contact.nodes[np.argmax(wear)]))
    return next(filter(None, (corners.sentence(near, row) for row in range(len(history.stored)))), "")


def _start(history: History) -> Floats:
    if history.begins == "continued":
        raise HistoryError(
            "quantities: the run continues another run, and its work and friction work include both runs. "
            "Estimates repeat only the last run. Simulate all stages as one scene."
        )
    times, initial = history.trajectory.times, history.trajectory.initial
    assert initial is not None
    with suppress_scene_warnings():
        posed = pose_scene(scene_of(history, "quantities"), history.mesh, times.tolist())
    return displacement(posed, initial, float(times[0])).reshape(history.mesh.points.shape)


def _run_again(history: History, mesh: Mesh, times: Floats, begin: Floats | str | None) -> History:
    with suppress_scene_warnings():
        posed = pose_scene(scene_of(history, "quantities"), mesh, times.tolist())
        initial = free_unknowns(begin, posed, times)
        run = march(posed.system, times, initial=initial, store="last", check=False)
        return History.from_results(record(posed, run, 0.0, Memory()))
