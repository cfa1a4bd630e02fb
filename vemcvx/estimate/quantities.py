"""Friction work, work and wear, with estimates of their errors due to steps and mesh.

The values Q of these quantities are of second order in the step size k (:mod:`vemcvx.stepping.state`). Two more runs of
the same scene estimate the errors of Q due to k and to the mesh size h:

    steps   3 |Q_k - Q_{k/2}|   on the same mesh, in half steps, with instants where data bend (:mod:`.finer_steps`),
    mesh    2 |Q_h - Q_{h/2}|   at the same instants, on the mesh with all cells refined once.

For wear, the difference is the largest over the contact nodes that both runs have. The factors are for errors of first
order, with an extra factor 1.5 for steps. An error that changes sign between k and k/2 is underestimated. Where the
pressure is singular, the largest wear has no limit, which is reported (:mod:`vemcvx.results.corners`).
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace

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

    The scene is simulated twice more: in half steps, and on a mesh with all cells refined. A history from an adaptive
    run with one of these targets already has the estimates, and is not simulated again.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict
        Values with errors: "dissipated" and "work" since the initial instant, and "wear", the largest friction work per
        length (in space per area) of a contact node; zero without friction.

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
    if isinstance(history, History) and history.quantities:
        return history.quantities
    scene_of(history, "quantities")
    return with_quantities(history)[0].quantities or {}


def value_of(history: History, of: str) -> float:
    """Return a quantity at the last instant."""
    return float(_courses(history)[of][-1])


@dataclass(frozen=True)
class StepErrors:
    """Errors due to steps: for "work" and "dissipated" at all instants (N + 1,), for "wear" at the last one (1,)."""

    errors: dict[str, Floats]
    added: dict[str, Floats]
    """(N,) error added by each step; for "wear" the error of the friction work"""
    bends: Floats
    """instants at which data bend or jump"""


def errors_of_steps(history: History) -> StepErrors:
    """Compare a run with a run in half steps."""
    times = history.trajectory.times
    with suppress_scene_warnings():
        posed = pose_scene(scene_of(history, "quantities"), history.mesh, between=times.tolist())
        known = sample_course(posed.system, times)
    finer = _run_again(history, history.mesh, finer_instants(times, known, 2), _start(history))
    apart = {name: 1.5 * difference for name, difference in _extrapolate_errors(history, finer).items()}
    added = {name: np.abs(np.diff(apart[name])) for name in ("dissipated", "work")}
    errors = {name: np.abs(difference) for name, difference in apart.items()}
    return StepErrors(errors=errors, added=added | {"wear": added["dissipated"]}, bends=known.bends)


def with_quantities(history: History) -> tuple[History, StepErrors]:
    """Return a history with its quantities and errors of energies at all instants, and return the errors of steps."""
    own, steps = _courses(history), errors_of_steps(history)
    mesh = dict.fromkeys(own, np.array([np.nan]))
    # In space, cells that are not star-shaped about their centroids cannot be refined.
    with contextlib.suppress(MeshError):
        begin = "settled" if _start(history).any() else None
        finer = _run_again(history, history.mesh.refine(), history.trajectory.times, begin)
        mesh = {name: np.abs(difference) for name, difference in _extrapolate_errors(history, finer).items()}
    over = history.spread[0]
    units = {"dissipated": "energy", "work": "energy", "wear": f"energy/{over}"}
    estimated = {
        name: Quantity(
            value=float(own[name][-1]),
            steps=float(steps.errors[name][-1]),
            mesh=float(mesh[name][-1]),
            unit=unit,
            unbounded=_wear_without_limit(history) if name == "wear" else "",
        )
        for name, unit in units.items()
    }
    energies = {f"{name}_error": steps.errors[name] + np.nan_to_num(mesh[name]) for name in ("dissipated", "work")}
    return replace(history, quantities=estimated, **energies), steps


def _courses(history: History) -> dict[str, Floats]:
    """Return friction work and work at all instants, and the largest wear at the last one."""
    run, contact = history.trajectory, history.contact
    wear = contact.wear_second_order[-1:].max(axis=1, initial=0.0)
    return {"dissipated": run.dissipated_second_order, "work": run.work_second_order, "wear": wear}


def _extrapolate_errors(history: History, finer: History) -> dict[str, Floats]:
    """Return twice the differences of a run and a finer run; for wear, the largest over their common nodes."""
    at, other = np.searchsorted(finer.trajectory.times, history.trajectory.times), _courses(finer)
    apart = {name: 2.0 * (own - other[name][at]) for name, own in _courses(history).items() if name != "wear"}
    coarse, fine = history.contact, finer.contact
    if not (len(coarse.nodes) and len(fine.nodes)):
        return apart | {"wear": np.zeros(1)}
    away, node = nearest(fine.points, coarse.points)
    worn = (coarse.wear_second_order[-1] - fine.wear_second_order[-1][node])[away <= SAME * history.mesh.h]
    return apart | {"wear": 2.0 * np.abs(worn).max(initial=0.0, keepdims=True)}


def _wear_without_limit(history: History) -> str:
    """Return a sentence if the largest wear is at a corner where friction may grow without limit, or ""."""
    contact, sides = history.contact, history.sides
    wear = contact.wear_second_order[-1:].max(axis=0, initial=0.0)
    if not wear.any() or sides is None or not history.trajectory.given_friction.any():
        return ""
    corners, near = Corners(history.mesh, contact, sides), sides.beside(int(contact.nodes[np.argmax(wear)]))
    return next(filter(None, (corners.sentence(near, row) for row in range(len(history.stored)))), "")


def _start(history: History) -> Floats:
    """Return the nodal displacements (n_nodes, dim) at the initial instant."""
    if history.begins == "continued":
        raise HistoryError(
            "quantities: the run continues another run and includes its friction work and work, but the two further "
            "runs would not. Simulate all stages as one scene for estimates."
        )
    times, initial = history.trajectory.times, history.trajectory.initial
    assert initial is not None
    with suppress_scene_warnings():
        posed = pose_scene(scene_of(history, "quantities"), history.mesh, times.tolist())
    return displacement(posed, initial, float(times[0])).reshape(history.mesh.points.shape)


def _run_again(history: History, mesh: Mesh, times: Floats, begin: Floats | str | None) -> History:
    """Simulate the scene again, without warnings: the first run has issued them."""
    with suppress_scene_warnings():
        posed = pose_scene(scene_of(history, "quantities"), mesh, times.tolist())
        initial = free_unknowns(begin, posed, times)
        run = march(posed.system, times, initial=initial, store="last", check=False)
        return History.from_results(record(posed, run, 0.0, Memory()))
