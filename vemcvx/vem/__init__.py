"""The lowest-order virtual element method, Section 3 of the paper named in :mod:`vemcvx`: spaces, matrices, loads."""

from vemcvx.vem.boundary import BoundaryRows, EdgeEnds, MirrorPlanes, Part, SideRule, edge_part
from vemcvx.vem.elasticity import (
    SumOverCells,
    cell_energies,
    consistent_blocks,
    energy_rows,
    mean_shear,
    rigid_modes,
    softest_shear,
    split_motion,
    stiffness,
    stiffness_of,
    strains,
)
from vemcvx.vem.loads import cell_load, cell_quadrature, edge_load, mean_strains, mean_weights, stress_load
from vemcvx.vem.points_in_solids import solid_places
from vemcvx.vem.projection import CellGroup, tangents_of
from vemcvx.vem.space import Space
from vemcvx.vem.stabilisation import InRegions, Stabilisation, VertexWeights, missed_energies, stabilisation_of
from vemcvx.vem.tensors import (
    component_names,
    elastic_matrix,
    equivalent,
    isotropic_stress,
    moduli_of_revolution,
    principal,
    stresses,
    tractions,
    upper_triangle,
)

__all__ = [
    "BoundaryRows",
    "CellGroup",
    "EdgeEnds",
    "InRegions",
    "MirrorPlanes",
    "Part",
    "SideRule",
    "Space",
    "Stabilisation",
    "SumOverCells",
    "VertexWeights",
    "cell_energies",
    "cell_load",
    "cell_quadrature",
    "component_names",
    "consistent_blocks",
    "edge_load",
    "edge_part",
    "elastic_matrix",
    "energy_rows",
    "equivalent",
    "isotropic_stress",
    "mean_shear",
    "mean_strains",
    "mean_weights",
    "missed_energies",
    "moduli_of_revolution",
    "principal",
    "rigid_modes",
    "softest_shear",
    "solid_places",
    "split_motion",
    "stabilisation_of",
    "stiffness",
    "stiffness_of",
    "strains",
    "stress_load",
    "stresses",
    "tangents_of",
    "tractions",
    "upper_triangle",
]
