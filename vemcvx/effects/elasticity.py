"""Isotropic linear elasticity, sigma = 2 mu eps + lam tr(eps) I, (3.1), in plane strain, plane stress or space.

lam = E nu / ((1 + nu)(1 - 2 nu)),   mu = E / (2 (1 + nu)),   plane stress: lam -> 2 lam mu / (lam + 2 mu)

A strain s in all three directions of space that is held back in the plane costs the stress -b s in the plane, with
b = 3 lam + 2 mu = E / (1 - 2 nu) in plane strain (held back across the plane, too) and in space, and b = 2 (lam + mu),
with the reduced lam, = E / (1 - nu) in plane stress. Across the plane, plane strain bears
sigma_zz = lam (e_xx + e_yy) - b s.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arguments import choice
from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, GivenDatum, Material
from vemcvx.effects.effect import amount, where
from vemcvx.effects.material_law import PLANES, MaterialLaw, region
from vemcvx.errors import SceneError, SceneWarning
from vemcvx.vem import Space, elastic_matrix, isotropic_stress, stabilisation_factor, stiffness, upper_triangle

STABILISATIONS = ("shear", "unit")
# Linear triangles cannot follow a volume-preserving motion: at nu = .49 the error of P1 already exceeds
# twice that of polygons of the same size, and grows without bound towards 1/2.
LOCKING_POISSON = 0.49


@dataclass(frozen=True)
class Elasticity(MaterialLaw):
    """Isotropic linear elasticity of the body, or of a part of it.

    Parameters
    ----------
    young : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        Young's modulus E > 0, force per area.
    poisson : likewise
        Poisson's ratio, -1 < nu < 1/2 in plane strain and in space, -1 < nu <= 1/2 in plane stress.
    plane : {"strain", "stress"}, optional
        What a plane body is in; "strain" by default. Of bodies in space it says nothing, and is refused.
    stabilisation : {"shear", "unit"}
        The part of a_K^h that vanishes for linear displacements: "shear" is 2 mu times the dofi-dofi product, which
        does not depend on units and does not lock; "unit" is S_K of (3.13) to the letter, without a factor.
    on : None, str or sequence of str
        The cells of this material: those where the cell datum of that name is nonzero; None is the whole body. Moduli
        must be finite on all cells, but only their values on these count.
    """

    young: data.Constant
    poisson: data.Constant
    plane: str | None = None
    stabilisation: str = "shear"
    on: str | Sequence[str] | None = None

    def contribute(self, space: Space) -> Contribution:
        choice(self.stabilisation, "Elasticity", "stabilisation", STABILISATIONS)
        cells = region(space, self.on, "Elasticity")
        if self.plane is not None:
            space.require_plane("Elasticity: plane=", "leave it out, a body in space is in neither plane")
        lam, mu = self._lame(data.InCells(space.mesh), cells)
        if self._plane == "strain":
            self._warn_of_locking(lam, mu, space)
        if cells is not None:
            lam, mu = lam * cells, mu * cells
        A = stiffness(space, lam, mu, stabilisation=self.stabilisation)
        volume, thermal = self._blocked(lam, mu, space.dim)
        out_of_plane = np.column_stack([lam, lam, np.zeros_like(lam), volume]) * float(self._plane == "strain")
        subject = "Elasticity" if self.on is None else f"Elasticity on {where(self.on)}"
        material = Material(
            subject=subject,
            moduli=np.stack([lam, mu]),
            thermal_stress_moduli=thermal,
            plane=self._plane,
            cells=cells,
            out_of_plane=out_of_plane if space.in_plane else None,
            stabilisation=stabilisation_factor(mu, self.stabilisation),
        )

        def at(x: Floats, inside: Ints) -> tuple[Floats, Floats]:
            lam, mu = self._lame(data.InCells(space.mesh, x, inside), None)
            return upper_triangle(elastic_matrix(np.stack([lam, mu]))), self._blocked(lam, mu, space.dim)[1]

        given = (GivenDatum(subject, "moduli", at, cells=cells),) if data.varies(self.young, self.poisson) else ()
        return Contribution(stiffness=A, material=material, given=given)

    def describe(self) -> str:
        place = "" if self.on is None else f", on {where(self.on)}"
        return (
            f"Elasticity: E = {amount(self.young, 'x')}, nu = {amount(self.poisson, 'x')}, "
            f"{'plane strain in two dimensions' if self.plane is None else f'plane {self.plane}'}, "
            f"{self.stabilisation} stabilisation{place}"
        )

    @property
    def _plane(self) -> str:
        return "strain" if self.plane is None else self.plane

    def _warn_of_locking(self, lam: Floats, mu: Floats, space: Space) -> None:
        largest = float((0.5 * lam / (lam + mu)).max())
        (simplices, others), part = space.simplices
        if largest > LOCKING_POISSON and part > 0.5:
            warnings.warn(
                f"Elasticity: poisson = {largest:.9g} on a mesh of {simplices}, which lock near 1/2; {others} do not.",
                SceneWarning,
                stacklevel=3,
            )

    def _blocked(self, lam: Floats, mu: Floats, dim: int) -> tuple[Floats, Floats]:
        """What a blocked unit eigenstrain costs, and the stresses (k, components) of it."""
        volume = 3 * lam + 2 * mu if self._plane == "strain" else 2 * (lam + mu)
        return volume, isotropic_stress(volume, dim)

    def _lame(self, at: data.InCells, cells: Bools | None) -> tuple[Floats, Floats]:
        E, nu = at.read(self.young, "Elasticity: young"), at.read(self.poisson, "Elasticity: poisson")
        if cells is not None:
            E, nu = np.where(cells, E, 1.0), np.where(cells, nu, 0.0)
        choice(self._plane, "Elasticity", "plane", PLANES)
        if (E <= 0).any():
            cell = int(np.argmin(E))
            raise SceneError(f"Elasticity: found young = {E[cell]:.6g} in cell {cell}; Young's modulus must be > 0.")
        wrong = (nu <= -1) | ((nu >= 0.5) if self._plane == "strain" else (nu > 0.5))
        if wrong.any():
            cell = int(np.argmax(wrong))
            limit = "< 0.5 in plane strain (use 0.4999999, or plane='stress')" if self._plane == "strain" else "<= 0.5"
            raise SceneError(f"Elasticity: found poisson = {nu[cell]:.9g} in cell {cell}; it must be > -1 and {limit}.")
        mu = E / (2 * (1 + nu))
        if self._plane == "stress":
            return E * nu / ((1 + nu) * (1 - nu)), mu
        return E * nu / ((1 + nu) * (1 - 2 * nu)), mu
