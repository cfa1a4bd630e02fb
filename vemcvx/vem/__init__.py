"""Spaces, matrices and loads of the lowest-order virtual element method (Section 3 of the paper in :mod:`vemcvx`)."""

from vemcvx.vem.boundary import BoundaryRows
from vemcvx.vem.elasticity import consistent_blocks, stiffness, strains
from vemcvx.vem.loads import edge_load, stress_load
from vemcvx.vem.projection import CellGroup
from vemcvx.vem.space import Space
from vemcvx.vem.stabilisation import Stabilisation

__all__ = [
    "BoundaryRows",
    "CellGroup",
    "Space",
    "Stabilisation",
    "consistent_blocks",
    "edge_load",
    "stiffness",
    "strains",
    "stress_load",
]
