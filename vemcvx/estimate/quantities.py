"""Friction work, work and wear as one quotes them, and how far steps and mesh leave them off.

Values are those of second order in the steps (:mod:`vemcvx.stepping.ledger`), Q_k on a mesh of the size h. Their errors
are estimated by two further runs of the same scene:

    steps   3/2 |Q_k - Q_k'|        on the same mesh, in finer steps that go where data bend (:mod:`.finer_steps`),
    mesh    2 |Q_h - Q_{h/2}|       at the same instants, on the mesh whose cells are all refined once.

The finer steps have an error, too: a quarter of the one looked for where friction turns in space or a reversal is
missed, which is of first order and asks for 4/3, and a sixteenth where all is smooth. That of the refined mesh is half
of it where the order is one, as with singular corners, and a quarter where the solution is smooth. Both are estimates
and no bounds. Where pressure is singular, as at most corners of contact, the largest wear grows without limit as the
mesh is refined, and the error that the mesh makes in it is that of the next refinement only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, brief
from vemcvx.errors import HistoryError
from vemcvx.estimate.finer_steps import course, finer_instants
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh
from vemcvx.results.results import SPREAD, displacement
from vemcvx.scene.pose import pose_scene
from vemcvx.simulation import simulate


@dataclass(frozen=True)
class Quantity:
    """A quantity over a whole run with its estimated error.

    Attributes
    ----------
    value : float
        Of second order in the steps.
    steps, mesh : float
        The estimated errors that time steps and mesh make in it; `mesh` is NaN in space, where no mesh is refined.
    unit : str
        In words.
    """

    value: float
    steps: float
    mesh: float
    unit: str

    @property
    def error(self) -> float:
        """The sum of the two; that of the steps alone where nothing is known of the mesh."""
        return self.steps if np.isnan(self.mesh) else self.steps + self.mesh


def quantities(history: History) -> dict[str, Quantity]:
    """Friction work, work and the largest wear of a run, of second order in its steps, with estimated errors.

    The scene is simulated twice more: in finer steps, and, in the plane, on a refined mesh.

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
    if not isinstance(history, History):
        raise HistoryError(f"quantities: found {brief(history)} where a History is wanted.")
    if history.scene is None or history.trajectory.initial is None:
        raise HistoryError(
            "quantities: this history was read from files, and its scene is not among them; simulate the scene."
        )
    scene, mesh, times = history.scene, history.mesh, history.trajectory.times
    posed = pose_scene(scene, mesh)
    start = displacement(pose_scene(scene, mesh, times.tolist()), history.trajectory.initial, float(times[0]))
    finer = finer_instants(times, course(posed.system, times))
    begin = start.reshape(mesh.points.shape)
    own = _values(history)
    in_time = _values(simulate(scene, mesh, finer, initial=begin, store="last", check=False))
    steps = 1.5 * np.abs(own - in_time)
    refined = np.full(len(own), np.nan)
    if isinstance(mesh, PolygonMesh):
        rest = "settled" if start.any() else None
        refined = _values(simulate(scene, mesh.refine(), times, initial=rest, store="last", check=False))
    over = SPREAD[mesh.points.shape[1]][0]
    units = {"dissipated": "energy", "work": "energy", "wear": f"energy/{over}"}
    off = 2.0 * np.abs(own - refined)
    return {
        name: Quantity(float(own[i]), float(steps[i]), float(off[i]), unit)
        for i, (name, unit) in enumerate(units.items())
    }


def _values(history: History) -> Floats:
    """Friction work, work and the largest wear at the end of a run."""
    run = history.trajectory
    wear = history.contact.wear_second_order[-1].max(initial=0.0)
    return np.array([run.dissipated_second_order[-1], run.work_second_order[-1], wear])
