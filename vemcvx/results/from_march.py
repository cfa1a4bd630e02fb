"""From a march in free unknowns to what users ask for at stored instants, and the programs of its steps."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vemcvx.arrays import Floats, summed_columns
from vemcvx.errors import HistoryError, SceneWarning
from vemcvx.meshes import AnyMesh
from vemcvx.program import SolvedProgram
from vemcvx.results.contact import contact_history
from vemcvx.results.results import Results
from vemcvx.scene.jumps import Jumps
from vemcvx.scene.pose import PosedScene, pose_scene
from vemcvx.stepping.programs import programs_of_trajectory
from vemcvx.stepping.trajectory import Storage, Trajectory

# From a march in free unknowns to what users ask for at stored instants: displacements, forces, contact, stresses.


CLOSED = 1e-6
"""Part of the largest pressure that counts as touch, and of friction's work that counts: answers are a solver's."""


def record(posed: PosedScene, trajectory: Trajectory, assembled: float, storage: Storage) -> Results:
    """The results of a posed scene."""
    _warn_of_friction_where_open(posed, trajectory)
    shape = (len(trajectory.stored), *posed.space.mesh.points.shape)
    u, forces = storage.array("displacement", shape), storage.array("forces", shape)
    for row, n in enumerate(trajectory.stored):
        t = float(trajectory.times[n])
        u[row] = displacement(posed, trajectory.state[row], t).reshape(shape[1:])
        stressed = posed.A @ u[row].ravel() + _damped(posed, trajectory, row)
        forces[row] = (stressed - posed.force(t)).reshape(shape[1:])
    return Results(
        mesh=posed.space.mesh,
        scene=posed.scene,
        effects=tuple(effect.describe() for effect in posed.scene.canonical),
        displacement=u,
        forces=forces,
        contact=contact_history(posed, trajectory, u, forces),
        moduli=posed.material.moduli,
        trajectory=trajectory,
        seconds={"assemble": assembled, **trajectory.seconds},
        prestress=_prestress(posed, trajectory, storage),
        out_of_plane=None
        if posed.material.out_of_plane is None
        else np.ascontiguousarray(posed.material.out_of_plane[:, :3]),
        out_of_plane_prestress=_out_of_plane_prestress(posed, trajectory, storage),
        inactive=posed.inactive + _untouched(posed, trajectory),
        **_friction_of_dragged(posed, trajectory),
    )


def displacement(posed: PosedScene, y: Floats, t: float) -> Floats:
    """u (n_u,) from the free unknowns y (n,) at the instant `t`."""
    u: Floats = posed.supports.P @ y
    return u if posed.supports.still else u + posed.supports.motion(t)


def _warn_of_friction_where_open(posed: PosedScene, trajectory: Trajectory) -> None:
    """Say how much of friction's work is done where contact is open, if nobody has said that it is meant to be."""
    terms, obstacles = posed.terms, posed.obstacles
    asked = [friction for friction in terms.frictions if friction.in_the_air]
    if not asked or obstacles is None or len(obstacles.nodes) == 0:
        return
    first, place = obstacles.jumps.distinct
    at = obstacles.jumps[first].find(terms.jumps)
    # The last column is of terms without an obstacle.
    pressed = summed_columns(trajectory.pressures, place, len(first) + 1)[:, at]
    rubbed = np.diff(trajectory.worn, axis=0)
    # Open after the step and before it: the step in which a place closes or opens may rub on either side of that.
    closed = pressed > CLOSED * pressed.max(initial=0.0)
    gone = ~(closed[1:] | closed[:-1]) & (at >= 0)
    asked_for = Jumps.of(asked)
    gone &= asked_for[asked_for.distinct[0]].find(terms.jumps) >= 0
    lost, total = rubbed[gone].sum(), rubbed.sum()
    if lost > CLOSED * total:
        warnings.warn(
            f"{asked[0].subject}: its bound is given, and {lost / total:.0%} of all friction work is done in the air, "
            "where contact is open. Say while_closed=True to rub where there is touch, or while_closed=False if this "
            "is meant.",
            SceneWarning,
            stacklevel=4,
        )


def _friction_of_dragged(posed: PosedScene, trajectory: Trajectory) -> dict[str, Any]:
    """Friction on nodes that supports drag, edge by edge; nothing if there is none."""
    terms = posed.terms
    if terms.dragged is None or terms.ends is None or terms.names is None or not terms.dragged.any():
        return {}
    mine = np.flatnonzero(terms.dragged)
    ends = terms.ends[mine].tocoo()
    force = -np.einsum("sqb,qbd->sqd", trajectory.multipliers[:, mine], terms.tangents[mine])
    share = ends.data / terms.lengths[mine][ends.row]
    return {"dragged_ends": terms.names[ends.col], "dragged_friction": force[:, ends.row] * share[:, None]}


def _damped(posed: PosedScene, trajectory: Trajectory, row: int) -> Floats | float:
    """What dashpots exert on the nodes (n_u,), at the rates of the step that led to a row; 0 where there are none."""
    n = int(trajectory.stored[row])
    if posed.viscosity is None or trajectory.velocity is None or n == 0:
        return 0.0
    v = posed.supports.P @ trajectory.velocity[row]
    if not posed.supports.still:
        s, t = (float(instant) for instant in trajectory.times[n - 1 : n + 1])
        v = v + (posed.supports.motion(t) - posed.supports.motion(s)) / (t - s)
    force: Floats = posed.viscosity @ v
    return force


def _untouched(posed: PosedScene, trajectory: Trajectory) -> tuple[str, ...]:
    """A sentence if there are obstacles, and none was ever felt at a stored instant."""
    if posed.obstacles is None or trajectory.pressures.shape[1] == 0 or trajectory.pressures.any():
        return ()
    subjects = ", ".join(posed.obstacles.subjects)
    return (f"{subjects}: nothing pressed on it at the stored instants",)


def _prestress(posed: PosedScene, trajectory: Trajectory, storage: Storage) -> Floats | None:
    """Stresses at zero strain at the stored instants, (S, n_cells, 3), if there are any."""
    if posed.prestress is None:
        return None
    shape = posed.material.thermal_stress_moduli.shape
    stress = storage.array("prestress", (len(trajectory.stored), *shape))
    for row, t in enumerate(trajectory.times[trajectory.stored]):
        stress[row] = posed.prestress.stress(float(t))
    return stress


def _out_of_plane_prestress(posed: PosedScene, trajectory: Trajectory, storage: Storage) -> Floats | None:
    """What eigenstrains add to the stress across the plane at the stored instants, (S, n_cells), if they do."""
    out_of_plane = posed.material.out_of_plane
    if posed.prestress is None or not posed.prestress.eigenstrains or out_of_plane is None or not out_of_plane.any():
        return None
    stress = storage.array("out_of_plane_prestress", (len(trajectory.stored), posed.space.mesh.n_cells))
    for row, t in enumerate(trajectory.times[trajectory.stored]):
        stress[row] = posed.prestress.out_of_plane(float(t))
    return stress


# The convex programs of a history's steps.


def with_origin(
    programs: Iterator[SolvedProgram], effects: Sequence[str], mesh: AnyMesh, **more: str
) -> Iterator[SolvedProgram]:
    """The programs, which now say what scene and mesh they are of."""
    size = {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}
    for program in programs:
        yield replace(program, origin={"scene": list(effects), "mesh": size, **more})


def programs_of_steps(history: Results, numbers: Sequence[int], condense: bool = True) -> Iterator[SolvedProgram]:
    """The programs of these steps, with one factorisation.

    Raises
    ------
    HistoryError
        The history has no scene, no such step, or has not stored the states before and after one.
    """
    if history.scene is None:
        raise HistoryError(
            "program: the history was read from files, which do not keep the functions of a scene; simulate again, or "
            "take vemcvx.programs(scene, mesh, times)."
        )
    with warnings.catch_warnings():
        # The run has given them.
        warnings.simplefilter("ignore", SceneWarning)
        system = pose_scene(history.scene, history.mesh, history.trajectory.times.tolist()).system
    found = programs_of_trajectory(system, history.trajectory, numbers, condense)
    return with_origin(found, history.effects, history.mesh, solver=history.solver)
