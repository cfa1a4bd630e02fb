"""The lowest-order virtual element method of Section 3: spaces, local matrices, loads, strains."""

from vemcvx.vem.anisotropic import anisotropic_stiffness, mean_shear, softest_shear
from vemcvx.vem.boundary import BoundaryPart, BoundaryRows, EdgeEnds
from vemcvx.vem.hooke import elastic_matrix, equivalent, principal, stresses, upper_triangle
from vemcvx.vem.isotropic import stabilisation_factor, stiffness
from vemcvx.vem.loads import cell_load, edge_load, stress_load
from vemcvx.vem.quadrature import cell_quadrature
from vemcvx.vem.space import CellGroup, Space
from vemcvx.vem.strain import rigid_modes, strains

__all__ = [
    "BoundaryPart",
    "BoundaryRows",
    "CellGroup",
    "EdgeEnds",
    "Space",
    "anisotropic_stiffness",
    "cell_load",
    "cell_quadrature",
    "edge_load",
    "elastic_matrix",
    "equivalent",
    "mean_shear",
    "principal",
    "rigid_modes",
    "softest_shear",
    "stabilisation_factor",
    "stiffness",
    "strains",
    "stress_load",
    "stresses",
    "upper_triangle",
]
