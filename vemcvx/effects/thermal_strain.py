"""Thermal expansion: a strain eps_0 = alpha theta I, the same in all three directions of space, free of stress.

Hooke's law becomes sigma = C (eps - eps_0). In the plane, with sigma_p = (xx, yy, xy) and C_p the law in the plane:

- plane strain: eps_zz = 0, so that eps_zz - alpha theta = -alpha theta adds -lam alpha theta to the stresses in the
  plane: sigma_p = C_p eps_p - (2 lam + 2 mu + lam) alpha theta (1, 1, 0), and 3 lam + 2 mu = E / (1 - 2 nu). A body
  that is free in the plane strains by (1 + nu) alpha theta there, and bears sigma_zz = -E alpha theta;
- plane stress: sigma_zz = 0 leaves eps_zz free: sigma_p = C_p (eps_p - alpha theta (1, 1, 0)), and C_p (1, 1, 0) is
  E / (1 - nu) (1, 1, 0).

Each material says its own factor. (Boley and Weiner, Theory of Thermal Stresses, 1960.)
"""

from __future__ import annotations

from dataclasses import dataclass

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, Eigenstrain, GivenDatum
from vemcvx.effects.effect import Effect, amount
from vemcvx.vem import Space


@dataclass(frozen=True)
class ThermalStrain(Effect):
    """Thermal expansion: the strain alpha theta in all directions, which causes stress where it is prevented.

    Thermal stresses act as a load, sum_K |K| sigma_0 : eps(Pi v), and are part of `history.stress`: a body that expands
    freely has none. `history.energy` remains 1/2 a^h(u, u), the energy of the total strain, which is not the elastic
    energy 1/2 (eps - eps_0) : C (eps - eps_0). `history.work` includes the work of thermal stresses, as of loads, so
    that the energy balance holds. Temperatures are relative to the stress-free state: if theta(x, times[0]) != 0, begin
    with ``initial="settled"`` or "equilibrium".

    Parameters
    ----------
    expansion : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        alpha, strain per degree.
    temperature : number, or callable f(x, t) -> (m,)
        theta, degrees above the stress-free state, at centroids and t_n; positive expands (with alpha > 0).
    """

    expansion: data.Constant
    temperature: data.Datum

    def contribute(self, space: Space) -> Contribution:
        alpha = data.modulus(self.expansion, space.mesh, "ThermalStrain: expansion")

        def strain(t: float) -> Floats:
            return alpha * data.scalar(self.temperature, space.mesh.centroids, t, "ThermalStrain: temperature")

        def at(x: Floats, cells: Ints, t: float) -> Floats:
            there = data.InCells(space.mesh, x, cells).read(self.expansion, "ThermalStrain: expansion")
            return there * data.scalar(self.temperature, x, t, "ThermalStrain: temperature")

        given = (
            (GivenDatum("ThermalStrain", "eigenstrain", at),) if data.varies(self.expansion, self.temperature) else ()
        )
        return Contribution(eigenstrains=(Eigenstrain("ThermalStrain", strain),), given=given)

    def describe(self) -> str:
        return f"ThermalStrain: {amount(self.expansion, 'x')} times {amount(self.temperature)}"
