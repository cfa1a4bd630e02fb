"""Kelvin and Voigt's solid: a dashpot beside the spring, sigma = C eps + 2 eta eps' + zeta tr(eps') I."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, Floats
from vemcvx.effects.effect import Effect, amount
from vemcvx.errors import SceneError
from vemcvx.vem import Space, stiffness


@dataclass(frozen=True)
class Viscosity(Effect):
    """Stress in proportion to the rate of strain, added to the elastic one: the form b^h(u', v).

    The form is that of elasticity with shear in place of mu and volume in place of lambda, stabilised likewise.
    Steps then depend on their length; nothing else does. Han and Sofonea, *Quasistatic Contact Problems in
    Viscoelasticity and Viscoplasticity* (2002), chapter 6.

    The energy of a history stays 1/2 a^h(u, u), its `dissipated` includes what dashpots lose, its forces (`forces`,
    `reaction`, `contact.pressure`) what they exert, at the rate of the step that led there, and its `stress` is the
    elastic part. Without elastic equilibrium to obey at once, a state need not satisfy condition (2.1) at times[0].

    Parameters
    ----------
    shear : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        eta >= 0, force per area times time.
    volume : likewise
        zeta >= 0.
    """

    shear: data.Datum | str
    volume: data.Datum | str = 0.0

    def contribute(self, space: Space) -> Contribution:
        eta, zeta = self._checked(self.shear, space, "shear"), self._checked(self.volume, space, "volume")
        return Contribution(viscosity=stiffness(space, zeta, eta, stabilisation="shear"))

    def describe(self) -> str:
        return f"Viscosity: shear {amount(self.shear, 'x')}, volume {amount(self.volume, 'x')}"

    def _checked(self, value: data.Datum | str, space: Space, name: str) -> Floats:
        found = data.modulus(value, space.mesh.centroids, space.mesh.cell_data, f"Viscosity: {name}")
        if (found < 0).any():
            cell = int(np.argmin(found))
            raise SceneError(f"Viscosity: found {name} = {found[cell]:.6g} in cell {cell}; it must be >= 0.")
        return found
