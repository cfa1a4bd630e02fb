"""What a measure gives: an energy norm or an L2 norm, the same relative to a reference, and its share of every cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats


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
