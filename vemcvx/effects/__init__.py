"""Effects: the pieces of physics in a scene.

All effects act in the plane and in space. In space, slip is a vector, and laws of friction depend on the length of the
slip path. For bodies in space, `plane=` of materials and the direction "tangent" are errors. For plane bodies,
`direction=` and `across=` of friction are errors.
"""

from vemcvx.base.weight_law import Law
from vemcvx.effects.contact import (
    BilateralContact,
    CoulombFriction,
    NormalCompliance,
    PrescribedSlip,
    SpeedFriction,
    TrescaFriction,
    UnilateralContact,
    VelocityContact,
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
from vemcvx.effects.effect import where as where
from vemcvx.effects.loads_and_supports import (
    BodyForce,
    Clamp,
    ElasticFoundation,
    PointLoad,
    PrescribedDisplacement,
    Pressure,
    Pretension,
    Rigid,
    Symmetry,
    Traction,
)
from vemcvx.effects.materials import Elasticity, MaterialLaw, Orthotropic, Prestress, ThermalStrain, Viscosity
from vemcvx.effects.materials import cells_of as cells_of
from vemcvx.effects.materials import nodes_of as nodes_of

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
    "PrescribedSlip",
    "Pressure",
    "Prestress",
    "Pretension",
    "Rigid",
    "SpeedFriction",
    "Support",
    "Symmetry",
    "Tabulated",
    "ThermalStrain",
    "Traction",
    "TrescaFriction",
    "UnilateralContact",
    "VelocityContact",
    "Viscosity",
]
