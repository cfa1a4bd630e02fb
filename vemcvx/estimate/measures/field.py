"""What measures compare: a displacement on a mesh, with the moduli that weigh its strains; and what they give."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.arguments import number
from vemcvx.arrays import Floats, as_real_array, brief
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolygonMesh, plane_mesh
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
    return Field(plane_mesh(run.mesh, subject), run.displacement[row], run.moduli, float(run.times[row]))


def step_at(history: Results, time: float) -> int:
    """The number of the stored step at an instant, or HistoryError."""
    time, times = number(time, "history: found time", "an instant, a finite number"), history.times
    nearest = int(np.argmin(np.abs(times - time)))
    span = float(history.trajectory.times[-1] - history.trajectory.times[0])
    if abs(times[nearest] - time) > SAME_INSTANT * span:
        raise HistoryError(
            f"history: no step was stored at t = {time:.9g}; the nearest is step {history.stored[nearest]} at "
            f"t = {times[nearest]:.9g}. Give times that have this instant, or store='all'."
        )
    return int(history.stored[nearest])


@dataclass(frozen=True, eq=False)
class Measured:
    """An error or a distance.

    Attributes
    ----------
    absolute : float
        The norm of the difference. Energy norms are (int C eps : eps dx)^(1/2), the root of force times length; the
        paper's ||v||_E is that over sqrt(2), and relative values are the same.
    reference : float
        The norm of what was compared with, taken in the same way.
    cells : (n_cells,) array
        The norm on each cell of the first mesh: absolute^2 = sum of cells^2.
    moduli_apart : float
        Largest relative difference between the elastic moduli of the two meshes at the same place; where they differ
        those of the first mesh were used.
    """

    absolute: float
    reference: float
    cells: Floats
    moduli_apart: float = 0.0

    @property
    def relative(self) -> float:
        """absolute / reference; 0 / 0 = 0, and infinity where only the reference is zero."""
        if self.reference == 0.0:
            return 0.0 if self.absolute == 0.0 else float("inf")
        return self.absolute / self.reference


def measured(squares: Floats, reference: float, moduli_apart: float = 0.0) -> Measured:
    """A measure from the squared norms of the difference on cells, and of the reference as a whole."""
    cells = np.sqrt(np.maximum(squares, 0.0))
    return Measured(float(np.sqrt(np.sum(cells**2))), float(np.sqrt(max(reference, 0.0))), cells, moduli_apart)
