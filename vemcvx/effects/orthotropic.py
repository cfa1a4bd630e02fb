"""Orthotropic linear elasticity: wood, laminates, rolled or layered solids (Lekhnitskii 1963; Jones 1999, chapter 2).

In the axes 1, 2 of the material (3 across the plane) the strains are e = S sigma with

    S = [[1/E1, -nu12/E1, -nu13/E1], [., 1/E2, -nu23/E2], [., ., 1/E3]],   2 e_12 = sigma_12 / G12,

nu_ij = -e_j / e_i under a pull along i. Plane stress (sigma_3 = 0) inverts the block of S for 1, 2; plane strain
(e_3 = 0) takes that block of S^-1, whose third row is what is borne across the plane. With axis 1 at the angle a from
x, strains turn by e' = Q e (c = cos a, s = sin a),

    Q = [[c^2, s^2, c s], [s^2, c^2, -c s], [-2 c s, 2 c s, c^2 - s^2]],   C = Q'C'Q,   stresses sigma = Q'sigma'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arguments import choice
from vemcvx.arrays import Floats, Ints, brief
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, GivenDatum, Material
from vemcvx.effects.data import Constant
from vemcvx.effects.effect import amount, where
from vemcvx.effects.material_law import PLANES, MaterialLaw, region
from vemcvx.errors import SceneError
from vemcvx.vem import Space, anisotropic_stiffness, upper_triangle


@dataclass(frozen=True)
class Orthotropic(MaterialLaw):
    """Orthotropic linear elasticity with two axes of symmetry in the plane.

    The stabilisation is scaled by the softest shear modulus (:mod:`vemcvx.vem.anisotropic`). Every modulus is a number,
    an (n_cells,) array, a callable f(x) at centroids, or the name of a cell datum.

    Parameters
    ----------
    young : (E1, E2) in plane stress, (E1, E2, E3) in plane strain
        Young's moduli along the axes, force per area, > 0.
    poisson : nu12 in plane stress, (nu12, nu13, nu23) in plane strain
        nu_ij = -e_j / e_i under tension along i, so that nu21 = nu12 E2 / E1. The energy must be positive.
    shear : modulus
        G12 > 0, force per area.
    angle : modulus
        From x to axis 1, counter-clockwise, in radians, from -2 pi to 2 pi.
    plane : {"stress", "strain"}
    on : None, str or sequence of str
        The cells of this material, as for Elasticity.
    """

    young: Sequence[Constant]
    poisson: Constant | Sequence[Constant]
    shear: Constant
    angle: Constant = 0.0
    plane: str = "stress"
    on: str | Sequence[str] | None = None

    def contribute(self, space: Space) -> Contribution:
        space.require_plane("Orthotropic", "take Elasticity, or an effect of your own with a stiffness")
        choice(self.plane, "Orthotropic", "plane", PLANES)
        cells = region(space, self.on, "Orthotropic")
        inside = np.ones(space.mesh.n_cells) if cells is None else cells.astype(float)
        C, thermal_stress_moduli, out_of_plane = self._law(data.InCells(space.mesh), inside)
        subject = "Orthotropic" if self.on is None else f"Orthotropic on {where(self.on)}"
        material = Material(
            subject=subject,
            moduli=upper_triangle(C),
            thermal_stress_moduli=thermal_stress_moduli,
            plane=self.plane,
            cells=cells,
            out_of_plane=out_of_plane,
        )

        def at(x: Floats, within: Ints) -> tuple[Floats, Floats]:
            C, thermal_stress_moduli, _ = self._law(data.InCells(space.mesh, x, within), np.ones(len(x)))
            return upper_triangle(C), thermal_stress_moduli

        constants = (*self._constants("young", 2), *self._constants("poisson", 1), self.shear, self.angle)
        given = (GivenDatum(subject, "moduli", at, cells=cells),) if data.varies(*constants) else ()
        return Contribution(stiffness=anisotropic_stiffness(space, C), material=material, given=given)

    def _law(self, at: data.InCells, inside: Floats) -> tuple[Floats, Floats, Floats]:
        """C (k, 3, 3), and Material's thermal_stress_moduli (k, 3) and out_of_plane (k, 4); zero where not `inside`."""
        S = self._compliance(at, inside > 0)
        G, angle = self._read(at, self.shear, "shear"), self._radians(at, inside > 0)
        self._require(np.where(inside > 0, G, 1.0) > 0, G, "shear", "must be > 0")
        C = np.zeros_like(S)
        inverse = np.linalg.inv(S)
        C[:, :2, :2] = np.linalg.inv(S[:, :2, :2]) if self.plane == "stress" else inverse[:, :2, :2]
        C[:, 2, 2] = G
        blocked = np.zeros((len(S), 3))
        blocked[:, :2] = C[:, :2, :2].sum(axis=2) if self.plane == "stress" else inverse[:, :2].sum(axis=2)
        Q = _turn(angle)
        C = Q.transpose(0, 2, 1) @ C @ Q * inside[:, None, None]
        C = 0.5 * (C + C.transpose(0, 2, 1))
        thermal_stress_moduli = np.einsum("cki,ck->ci", Q, blocked) * inside[:, None]
        out_of_plane = np.zeros((len(S), 4))
        if self.plane == "strain":
            out_of_plane[:, :3] = np.einsum("ck,ckl->cl", inverse[:, 2, :2], Q[:, :2])
            out_of_plane[:, 3] = inverse[:, 2].sum(axis=1)
        return C, thermal_stress_moduli, out_of_plane * inside[:, None]

    def describe(self) -> str:
        place = "" if self.on is None else f", on {where(self.on)}"
        E, nu = (_words(values) for values in (self.young, self.poisson))
        return (
            f"Orthotropic: E = {E}, nu = {nu}, G = {amount(self.shear, 'x')}, angle {amount(self.angle, 'x')}, "
            f"plane {self.plane}{place}"
        )

    def _compliance(self, at: data.InCells, inside: np.ndarray) -> Floats:
        """S (n_cells, 3, 3) of the normal directions; without coupling to 3 in plane stress."""
        E, nu = self._several(at, "young", 2), self._several(at, "poisson", 1)
        E, nu = np.where(inside, E, 1.0), np.where(inside, nu, 0.0)
        for i, values in enumerate(E):
            self._require(values > 0, values, f"young ({i + 1})", "must be > 0")
        S = np.zeros((len(inside), 3, 3))
        S[:, 2, 2] = 1.0
        for i, values in enumerate(E):
            S[:, i, i] = 1.0 / values
        for (i, j), values in zip(((0, 1), (0, 2), (1, 2)), nu, strict=False):
            S[:, i, j] = S[:, j, i] = -values / E[i]
        # Scaled to a unit diagonal: entries do not depend on units, nor overflow.
        scale = 1.0 / np.sqrt(np.einsum("cii->ci", S))
        positive = np.linalg.eigvalsh(scale[:, :, None] * S * scale[:, None, :]).min(axis=1) > 0
        rule = "nu12^2 < E1 / E2" if self.plane == "stress" else "such that S (see the module) is positive definite"
        self._require(positive, nu[0], "poisson (nu12)", f"must leave the energy positive: {rule}")
        return S

    def _radians(self, at: data.InCells, inside: np.ndarray) -> Floats:
        angle = self._read(at, self.angle, "angle")
        beyond = inside & (np.abs(angle) > 2 * np.pi)
        first = angle[np.argmax(beyond)]
        rule = f"is in radians, from -2 pi to 2 pi, and {first:.6g} degrees are {np.radians(first):.6g}"
        self._require(~beyond, angle, "angle", rule)
        return angle

    def _several(self, at: data.InCells, name: str, in_stress: int) -> Floats:
        return np.stack([self._read(at, part, name) for part in self._constants(name, in_stress)])

    def _constants(self, name: str, in_stress: int) -> Sequence[Constant]:
        given, count = getattr(self, name), in_stress if self.plane == "stress" else 3
        parts = [given] if count == 1 else given
        several = isinstance(parts, (list, tuple)) or (type(parts) is np.ndarray and parts.ndim > 0)
        if not several or len(parts) != count:
            wanted = {1: "nu12", 2: "(E1, E2)"}.get(count, "(E1, E2, E3)" if name == "young" else "(nu12, nu13, nu23)")
            raise SceneError(f"Orthotropic: found {name} = {brief(given)}; plane {self.plane} takes {wanted}.")
        return list(parts)

    def _read(self, at: data.InCells, value: Constant, name: str) -> Floats:
        return at.read(value, f"Orthotropic: {name}")

    def _require(self, holds: np.ndarray, values: Floats, name: str, rule: str) -> None:
        if not holds.all():
            cell = int(np.argmin(holds))
            raise SceneError(f"Orthotropic: found {name} = {values[cell]:.6g} in cell {cell}; it {rule}.")


def _turn(angle: Floats) -> Floats:
    """Q (n_cells, 3, 3): strains in the axes of the material from strains along x and y."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    return np.array(rows).transpose(2, 0, 1)


def _words(values: object) -> str:
    if isinstance(values, (tuple, list)):
        return f"({', '.join(amount(value, 'x') for value in values)})"
    return amount(values, "x")
