"""Effects: the physics a scene can name."""

from vemcvx.effects.bilateral_contact import BilateralContact
from vemcvx.effects.body_force import BodyForce
from vemcvx.effects.clamp import Clamp
from vemcvx.effects.contribution import (
    ContactSurface,
    Contribution,
    Friction,
    Load,
    Material,
    Obstacle,
    Support,
)
from vemcvx.effects.coulomb_friction import CoulombFriction
from vemcvx.effects.effect import Effect
from vemcvx.effects.elasticity import Elasticity
from vemcvx.effects.normal_compliance import NormalCompliance
from vemcvx.effects.prescribed_displacement import PrescribedDisplacement
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
    "Elasticity",
    "Friction",
    "Load",
    "Material",
    "NormalCompliance",
    "Obstacle",
    "PrescribedDisplacement",
    "Support",
    "Traction",
    "TrescaFriction",
    "UnilateralContact",
    "Viscosity",
]
