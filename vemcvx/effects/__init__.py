"""Effects: the physics a scene can name."""

from vemcvx.effects.bilateral_contact import BilateralContact
from vemcvx.effects.body_force import BodyForce
from vemcvx.effects.clamp import Clamp
from vemcvx.effects.contribution import (
    ContactSurface,
    Contribution,
    Eigenstrain,
    Friction,
    GivenDatum,
    InitialStress,
    Load,
    Material,
    Obstacle,
    Support,
)
from vemcvx.effects.coulomb_friction import CoulombFriction
from vemcvx.effects.effect import Effect
from vemcvx.effects.elastic_foundation import ElasticFoundation
from vemcvx.effects.elasticity import Elasticity
from vemcvx.effects.material_law import MaterialLaw
from vemcvx.effects.normal_compliance import NormalCompliance
from vemcvx.effects.orthotropic import Orthotropic
from vemcvx.effects.point_load import PointLoad
from vemcvx.effects.prescribed_displacement import PrescribedDisplacement
from vemcvx.effects.pressure import Pressure
from vemcvx.effects.prestress import Prestress
from vemcvx.effects.slip_law import SlipLaw
from vemcvx.effects.symmetry import Symmetry
from vemcvx.effects.tabulated import Tabulated
from vemcvx.effects.thermal_strain import ThermalStrain
from vemcvx.effects.traction import Traction
from vemcvx.effects.tresca_friction import TrescaFriction
from vemcvx.effects.unilateral_contact import UnilateralContact
from vemcvx.effects.viscosity import Viscosity

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
    "GivenDatum",
    "InitialStress",
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
    "SlipLaw",
    "Support",
    "Symmetry",
    "Tabulated",
    "ThermalStrain",
    "Traction",
    "TrescaFriction",
    "UnilateralContact",
    "Viscosity",
]
