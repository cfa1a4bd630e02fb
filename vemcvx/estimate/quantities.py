"""Friction work, work and wear as one quotes them, and how far steps and mesh leave them off.

Values are those of second order in the steps (:mod:`vemcvx.stepping.state`), Q_k on a mesh of the size h. Their errors
are estimated by three further runs of the same scene:

    steps   3/2 (|Q_k - Q_{k/2}| + |Q_{k/2} - Q_{k/4}|)     on the same mesh, in halves and quarters of the steps, and
                                                            where data bend (:mod:`.finer_steps`),
    mesh    2 |Q_h - Q_{h/2}|       at the same instants, on the mesh whose cells are all refined once; of wear the
                                    largest over all contact nodes that both have.

The finest steps have an error, too: a quarter of the one looked for where friction turns in space or a reversal is
missed, which is of first order and asks for 4/3, and a sixteenth where all is smooth. Where values rise, or fall, from
k to k/2 and k/4 the sum is |Q_k - Q_{k/4}|. Where they do not, the error changes its sign on the way, and that
difference would say nothing: of the largest wear of a dovetail in 48 steps it found .47 of the error, of a rubbed pad's
.55; the sum found 1.13 and 2.97 (truth: 768 steps).

The error of the refined mesh is half of the one looked for where the order is one, as with singular corners, and a
quarter where the solution is smooth. All are estimates and no bounds. The largest wear may stand still by chance while
wear elsewhere does not: of a block on a compliant floor, 4 squares a side, |Q_h - Q_{h/2}| was .11 of its error, the
largest over nodes 2.6. Where pressure is singular, as at most corners of contact, the largest wear grows without limit
as the mesh is refined, which is told as of extremes (:mod:`vemcvx.results.corners`), and the error that the mesh makes
in it is that of the next refinement only.

Values are of second order in the steps where the states at their ends are. In space friction turns with the slip, and
the states of backward Euler are of first order there, and so are the values; the estimate tells.

:func:`vemcvx.adapt` splits the steps in which runs in k and k/4 gain most differently, and refines the cells with the
largest energy errors until the quantity that it aims at is as exact as asked for.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import MeshError
from vemcvx.estimate.finer_steps import finer_instants
from vemcvx.history import History, scene_of
from vemcvx.meshes import AnyMesh
from vemcvx.meshes.polygons import nearest
from vemcvx.results.corners import Corners
from vemcvx.results.quoted import Quantity
from vemcvx.results.results import SPREAD, displacement, record
from vemcvx.scene.pose import pose_scene, unwarned
from vemcvx.simulation import free_unknowns
from vemcvx.stepping import Memory, march
from vemcvx.stepping.course import course


def quantities(history: History) -> dict[str, Quantity]:
    """Friction work, work and the largest wear of a run, of second order in its steps, with estimated errors.

    The scene is simulated three times more: in steps of a half and a quarter, and on a mesh whose cells are all
    refined; unless the history has them already, as those of adaptive runs that aim at one have.

    Parameters
    ----------
    history : History

    Returns
    -------
    dict
        "dissipated" and "work", both since the initial instant, and "wear", the largest friction work per length of a
        contact node (per area in space); zero where nothing rubs.

    Raises
    ------
    HistoryError
        The history was read from files, so that its scene is not known, or does not say where it began.
    SceneError
        The scene has moduli cell by cell that do not go with a refined mesh; name cell data instead.
    """
    if isinstance(history, History) and history.quantities:
        return history.quantities
    scene_of(history, "quantities")
    return with_quantities(history)[0].quantities or {}


def value_of(history: History, of: str) -> float:
    """A quantity at the last instant."""
    return float(_courses(history)[of][-1])


def with_quantities(history: History) -> tuple[History, StepErrors]:
    """The history with its quantities and the errors of energies at all instants, and what steps contribute."""
    own, found = _courses(history), errors_of_steps(history)
    steps = found.errors
    mesh = dict.fromkeys(own, np.array([np.nan]))
    # Cells that are not star-shaped about their centroids are not split in space.
    with contextlib.suppress(MeshError):
        finer_mesh = history.mesh.refine()
        begin = "settled" if _start(history).any() else None
        finer = _beside(history, finer_mesh, history.trajectory.times, begin)
        refined = _courses(finer)
        mesh = {name: 2.0 * np.abs(own[name] - refined[name]) for name in own}
        mesh["wear"] = np.maximum(mesh["wear"], 2.0 * _wear_apart(history, finer))
    over = SPREAD[history.mesh.points.shape[1]][0]
    units = {"dissipated": "energy", "work": "energy", "wear": f"energy/{over}"}
    told = replace(
        history,
        quantities={
            name: Quantity(
                float(own[name][-1]),
                float(steps[name][-1]),
                float(mesh[name][-1]),
                units[name],
                _of_wear_without_limit(history) if name == "wear" else "",
            )
            for name in own
        },
        dissipated_error=steps["dissipated"] + np.nan_to_num(mesh["dissipated"]),
        work_error=steps["work"] + np.nan_to_num(mesh["work"]),
    )
    return told, found


@dataclass(frozen=True)
class StepErrors:
    """The errors that steps make, and where: at all instants (N + 1,), of "wear" at the last one alone."""

    errors: dict[str, Floats]
    added: dict[str, Floats]
    """(N,) what each step adds; to wear by its part of the friction work"""
    bends: Floats
    """instants at which data bend or jump"""


def errors_of_steps(history: History) -> StepErrors:
    """Compare a run with those in halves and quarters of its steps."""
    times = history.trajectory.times
    with unwarned():
        posed = pose_scene(scene_of(history, "quantities"), history.mesh, between=times.tolist())
        known = course(posed.system, times)
    own, begin = _courses(history), _start(history)

    def in_parts(parts: int) -> dict[str, Floats]:
        finer = finer_instants(times, known, parts)
        courses, at = _courses(_beside(history, history.mesh, finer, begin)), np.searchsorted(finer, times)
        return {name: values[at if len(values) > 1 else -1] for name, values in courses.items()}

    halves, quarters = in_parts(2), in_parts(4)
    errors = {name: 1.5 * (np.abs(own[name] - halves[name]) + np.abs(halves[name] - quarters[name])) for name in own}
    added = {name: 1.5 * np.abs(np.diff(own[name] - quarters[name])) for name in ("dissipated", "work")}
    return StepErrors(errors=errors, added=added | {"wear": added["dissipated"]}, bends=known.bends)


def _courses(history: History) -> dict[str, Floats]:
    """Friction work and work at all instants, and the largest wear at the last one."""
    run, contact = history.trajectory, history.contact
    wear = contact.wear_second_order[-1:].max(axis=1, initial=0.0)
    return {"dissipated": run.dissipated_second_order, "work": run.work_second_order, "wear": wear}


def _wear_apart(history: History, finer: History) -> float:
    """The largest difference of wear at the end on contact nodes that both runs have."""
    own, other = history.contact, finer.contact
    if not (len(own.nodes) and len(other.nodes)):
        return 0.0
    away, node = nearest(other.points, own.points)
    shared = away <= SAME * history.mesh.h
    apart = own.wear_second_order[-1] - other.wear_second_order[-1][node]
    return float(np.abs(apart[shared]).max(initial=0.0))


def _of_wear_without_limit(history: History) -> str:
    """The sentence on a largest wear that sits at a corner at which friction has no limit at some instant."""
    contact, wear = history.contact, history.contact.wear_second_order[-1:].max(axis=0, initial=0.0)
    if not wear.any():
        return ""
    corners = Corners(history.mesh, contact, history.moduli, history.sides)
    near = dict.fromkeys(corners.beside(int(contact.nodes[np.argmax(wear)])), 1.0)
    told = (corners.sentence(near, row, "friction") for row in range(len(history.stored)))
    return next(filter(None, told), "")


def _start(history: History) -> Floats:
    """The nodal displacements (n_nodes, 2) at the initial instant."""
    times, initial = history.trajectory.times, history.trajectory.initial
    assert initial is not None
    with unwarned():
        posed = pose_scene(scene_of(history, "quantities"), history.mesh, times.tolist())
    return displacement(posed, initial, float(times[0])).reshape(history.mesh.points.shape)


def _beside(history: History, mesh: AnyMesh, times: Floats, begin: Floats | str | None) -> History:
    """Another run of the scene. It gives no warnings: the run that it stands beside has."""
    with unwarned():
        posed = pose_scene(scene_of(history, "quantities"), mesh, times.tolist())
        initial = free_unknowns(begin, posed, times)
        run = march(posed.system, times, initial=initial, store="last", check=False)
        return History.of(record(posed, run, 0.0, Memory()))
