"""A displacement on a mesh, with the moduli that weigh its strains: what measures compare."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.arguments import number
from vemcvx.arrays import Floats, as_real_array, brief
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolygonMesh
from vemcvx.program.checks import finite
from vemcvx.results.results import Results
from vemcvx.vem import Space, strains

# Two runs share an instant if theirs differ by no more than this part of the time they span: linspace rounds.
SAME_INSTANT = 1e-9


@dataclass(frozen=True, eq=False)
class Field:
    """A displacement field.

    Parameters
    ----------
    mesh : PolygonMesh
    displacement : (n_nodes, 2) array
        At the nodes, length.
    moduli : (2, n_cells) or (6, n_cells) array
        As in `History.moduli`, force per area.
    time : float
        The instant, which closed forms are asked for.

    Raises
    ------
    HistoryError
        The arrays do not fit the mesh.
    """

    mesh: PolygonMesh
    displacement: Floats
    moduli: Floats
    time: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.mesh, PolygonMesh):
            raise HistoryError(f"Field: found mesh = {brief(self.mesh)}; wanted a PolygonMesh.")
        number(self.time, "Field: found time", "the instant, a finite number")
        for name in ("displacement", "moduli"):
            values = as_real_array(getattr(self, name), f"Field: {name}", "numbers, as many as fit the mesh")
            finite(values, f"Field: {name}")
            object.__setattr__(self, name, values)
        nodes, cells = (self.mesh.n_nodes, 2), self.mesh.n_cells
        if np.shape(self.displacement) != nodes:
            raise HistoryError(f"Field: found displacements {np.shape(self.displacement)}; this mesh takes {nodes}.")
        if np.shape(self.moduli) not in ((2, cells), (6, cells)):
            raise HistoryError(
                f"Field: found moduli {np.shape(self.moduli)}; wanted (2, {cells}), lambda and mu of every cell, or "
                f"(6, {cells}), the upper triangle of its elastic matrix."
            )

    @cached_property
    def space(self) -> Space:
        """V^h on the mesh."""
        return Space(self.mesh)

    @cached_property
    def strain(self) -> Floats:
        """(n_cells, 3) strains of Pi u: e_xx, e_yy, 2 e_xy."""
        return strains(self.space, self.displacement)


def field_of(run: Results | Field, step: int, subject: str) -> Field:
    """The field of a history at a stored step, or the field that was given."""
    if isinstance(run, Field):
        return run
    if not isinstance(run, Results):
        raise HistoryError(f"{subject}: found {brief(run)} where a History (or a vx.measures.Field) goes.")
    row = run.row(step)
    return Field(run.mesh, run.displacement[row], run.moduli, float(run.times[row]))


def step_at(history: Results, time: float) -> int:
    """The number of the stored step at an instant.

    Raises
    ------
    HistoryError
        No stored step is at that instant.
    """
    time, times = number(time, "history: found time", "an instant, a finite number"), history.times
    nearest = int(np.argmin(np.abs(times - time)))
    span = float(history.trajectory.times[-1] - history.trajectory.times[0])
    if abs(times[nearest] - time) > SAME_INSTANT * span:
        raise HistoryError(
            f"history: no step was stored at t = {time:.9g}; the nearest is step {history.stored[nearest]} at "
            f"t = {times[nearest]:.9g}. Give times that have this instant, or store='all'."
        )
    return int(history.stored[nearest])
