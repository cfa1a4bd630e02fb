"""The lowest-order virtual element method of Section 3: spaces, local matrices, loads, strains."""

from vemcvx.vem.boundary import BoundaryRows, EdgeEnds, MirrorPlanes, Part, SideRule, edge_part
from vemcvx.vem.elasticity import (
    anisotropic_stiffness,
    component_names,
    elastic_matrix,
    equivalent,
    isotropic_stress,
    mean_shear,
    principal,
    rigid_modes,
    softest_shear,
    split_motion,
    stabilisation_factor,
    stiffness,
    strains,
    stresses,
    tractions,
    upper_triangle,
)
from vemcvx.vem.loads import cell_load, cell_quadrature, edge_load, stress_load
from vemcvx.vem.points_in_solids import solid_places
from vemcvx.vem.projection import CellGroup, tangents_of
from vemcvx.vem.space import Space

__all__ = [
    "BoundaryRows",
    "CellGroup",
    "EdgeEnds",
    "MirrorPlanes",
    "Part",
    "SideRule",
    "Space",
    "anisotropic_stiffness",
    "cell_load",
    "cell_quadrature",
    "component_names",
    "edge_load",
    "edge_part",
    "elastic_matrix",
    "equivalent",
    "isotropic_stress",
    "mean_shear",
    "principal",
    "rigid_modes",
    "softest_shear",
    "solid_places",
    "split_motion",
    "stabilisation_factor",
    "stiffness",
    "strains",
    "stress_load",
    "stresses",
    "tangents_of",
    "tractions",
    "upper_triangle",
]
