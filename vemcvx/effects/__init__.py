"""Effects: the pieces of physics in a scene, for bodies in the plane and in space."""

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
from vemcvx.effects.effect import ContactSurface as ContactSurface
from vemcvx.effects.effect import Contribution, Effect, Friction, Load, Obstacle, Support
from vemcvx.effects.effect import Eigenstrain as Eigenstrain
from vemcvx.effects.effect import InitialStress as InitialStress
from vemcvx.effects.effect import Material as Material
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
    "Contribution",
    "CoulombFriction",
    "Effect",
    "ElasticFoundation",
    "Elasticity",
    "Friction",
    "Law",
    "Load",
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
