"""Effects: the physics a scene can name."""

from vemcvx.effects.contact import (
    BilateralContact,
    CoulombFriction,
    NormalCompliance,
    TrescaFriction,
    UnilateralContact,
)
from vemcvx.effects.data import Tabulated
from vemcvx.effects.effect import (
    ContactSurface,
    Contribution,
    Effect,
    Eigenstrain,
    Friction,
    InitialStress,
    Load,
    Material,
    Obstacle,
    Support,
)
from vemcvx.effects.loads_and_supports import (
    BodyForce,
    Clamp,
    ElasticFoundation,
    PointLoad,
    PrescribedDisplacement,
    Pressure,
    Symmetry,
    Traction,
)
from vemcvx.effects.materials import Elasticity, MaterialLaw, Orthotropic, Prestress, ThermalStrain, Viscosity
from vemcvx.weight_law import Law

__all__ = [
    "BilateralContact",
    "BodyForce",
    "Clamp",
    "ContactSurface",
    "Contribution",
    "CoulombFriction",
    "Effect",
    "Eigenstrain",
    "ElasticFoundation",
    "Elasticity",
    "Friction",
    "InitialStress",
    "Law",
    "Load",
    "Material",
    "MaterialLaw",
    "NormalCompliance",
    "Obstacle",
    "Orthotropic",
    "PointLoad",
    "PrescribedDisplacement",
    "Pressure",
    "Prestress",
    "Support",
    "Symmetry",
    "Tabulated",
    "ThermalStrain",
    "Traction",
    "TrescaFriction",
    "UnilateralContact",
    "Viscosity",
]
