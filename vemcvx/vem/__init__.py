"""The lowest-order virtual element method of Section 3: spaces, local matrices, loads, strains."""

from vemcvx.vem.boundary import BoundaryPart, BoundaryRows
from vemcvx.vem.loads import cell_load, edge_load
from vemcvx.vem.quadrature import cell_quadrature
from vemcvx.vem.space import CellGroup, Space
from vemcvx.vem.stiffness import stiffness
from vemcvx.vem.strain import rigid_modes, strains

__all__ = [
    "BoundaryPart",
    "BoundaryRows",
    "CellGroup",
    "Space",
    "cell_load",
    "cell_quadrature",
    "edge_load",
    "rigid_modes",
    "stiffness",
    "strains",
]
