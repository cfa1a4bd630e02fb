"""Kelvin-Voigt viscosity, sigma = C eps + 2 eta eps' + zeta tr(eps') I."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution
from vemcvx.effects.effect import Effect, amount
from vemcvx.errors import SceneError
from vemcvx.vem import Space, stiffness


@dataclass(frozen=True)
class Viscosity(Effect):
    """Kelvin-Voigt viscosity: a stress proportional to the strain rate, added to the elastic one.

    The form b^h(u', v) is that of elasticity with `shear` for mu and `volume` for lambda, stabilised likewise. Results
    of a step then depend on its length, which without viscosity they do not. Han and Sofonea, *Quasistatic Contact
    Problems in Viscoelasticity and Viscoplasticity* (2002), chapter 6.

    `history.energy` remains 1/2 a^h(u, u), `dissipated` includes the viscous loss, forces (`forces`, `reaction`,
    `contact.pressure`) include viscous ones at the rate of the step that led there, and `stress` is the elastic part.
    The initial state need not satisfy condition (2.1), because viscous forces balance it.

    Parameters
    ----------
    shear : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        eta >= 0, force per area times time.
    volume : likewise
        zeta >= 0.
    """

    shear: data.Constant
    volume: data.Constant = 0.0

    def contribute(self, space: Space) -> Contribution:
        eta, zeta = self._checked(self.shear, space, "shear"), self._checked(self.volume, space, "volume")
        return Contribution(viscosity=stiffness(space, zeta, eta, stabilisation="shear"))

    def describe(self) -> str:
        return f"Viscosity: shear {amount(self.shear, 'x')}, volume {amount(self.volume, 'x')}"

    def _checked(self, value: data.Constant, space: Space, name: str) -> Floats:
        found = data.modulus(value, space.mesh, f"Viscosity: {name}")
        if (found < 0).any():
            cell = int(np.argmin(found))
            raise SceneError(f"Viscosity: found {name} = {found[cell]:.6g} in cell {cell}; it must be >= 0.")
        return found
