"""Materials: isotropic and orthotropic elasticity, viscosity, and strains and stresses that a material brings along."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from vemcvx import vem
from vemcvx.arrays import Bools, Floats, Ints, brief, choice, directions
from vemcvx.effects import data
from vemcvx.effects.data import Constant
from vemcvx.effects.effect import Contribution, Effect, Eigenstrain, InitialStress, Material, amount, where
from vemcvx.errors import SceneError, SceneWarning
from vemcvx.vem import Space, Stabilisation
from vemcvx.vem.elasticity import COMPONENTS

PLANES = ("strain", "stress")
IN_PLANE = [COMPONENTS[3].index(pair) for pair in COMPONENTS[2]]
"""Where xx, yy and xy are among the components in space."""


class MaterialLaw(Effect):
    """An effect that says what cells are made of; a scene has at least one, and every cell exactly one."""


def region(space: Space, on: str | Sequence[str] | None, subject: str) -> Bools | None:
    """The cells (n_cells,) where one of the cell data named by `on` is nonzero; None for the whole body."""
    if on is None:
        return None
    known = space.mesh.cell_data
    names = [on] if isinstance(on, str) else list(on) if isinstance(on, Sequence) else [on]
    cells = np.zeros(space.mesh.n_cells, dtype=bool)
    for name in names:
        if not isinstance(name, str) or name not in known or known[name].ndim != 1:
            there_are = ", ".join(repr(n) for n in known if known[n].ndim == 1) or "none"
            raise SceneError(
                f"{subject}: on= names cells by a cell datum that is nonzero there; found {name!r}, but this mesh has "
                f"{there_are}. Add one with mesh.with_cell_data(name, values)."
            )
        cells |= known[name] != 0
    if not cells.any():
        raise SceneError(f"{subject}: on={on!r} names no cell: the cell datum is zero everywhere on this mesh.")
    return cells


# Isotropic linear elasticity, sigma = 2 mu eps + lam tr(eps) I, (3.1), in plane strain, plane stress or space.
#
# lam = E nu / ((1 + nu)(1 - 2 nu)),   mu = E / (2 (1 + nu)),   plane stress: lam -> 2 lam mu / (lam + 2 mu)
#
# A strain s in all three directions of space that is held back in the plane costs the stress -b s in the plane, with
# b = 3 lam + 2 mu = E / (1 - 2 nu) in plane strain (held back across the plane, too) and in space, and b = 2 (lam +
# mu), with the reduced lam, = E / (1 - nu) in plane stress. Across the plane, plane strain bears sigma_zz = lam (e_xx
# + e_yy) - b s.


STABILISATIONS = ("shear", "unit")


def check_stabilisation(given: object, subject: str) -> None:
    """Raise SceneError unless this is a stabilisation, or the name of one."""
    if not isinstance(given, Stabilisation):
        choice(given, subject, "stabilisation", STABILISATIONS)


def named(stabilisation: str | Stabilisation) -> str:
    """The name of a stabilisation."""
    return stabilisation.describe() if isinstance(stabilisation, Stabilisation) else stabilisation


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
    stabilisation : {"shear", "unit"}, or a vx.Stabilisation
        The part of a_K^h that vanishes for linear displacements: "shear" is 2 mu times the dofi-dofi product, which
        does not depend on units and does not lock; "unit" is S_K of (3.13) to the letter, without a factor; or one's
        own, :class:`vemcvx.Stabilisation`.
    on : None, str or sequence of str
        The cells of this material: those where the cell datum of that name is nonzero; None is the whole body. Moduli
        must be finite on all cells, but only their values on these count.
    """

    young: data.Constant
    poisson: data.Constant
    plane: str | None = field(default=None, metadata={"in the plane": True})
    stabilisation: str | Stabilisation = "shear"
    on: str | Sequence[str] | None = None

    def contribute(self, space: Space) -> Contribution:
        check_stabilisation(self.stabilisation, "Elasticity")
        cells = region(space, self.on, "Elasticity")
        if self.plane is not None:
            space.require_plane("Elasticity: plane=", "leave it out, a body in space is in neither plane")
        lam, mu = self._lame(data.InCells(space.mesh), cells)
        if self._plane == "strain":
            self._warn_of_locking(lam, mu, space)
        if cells is not None:
            lam, mu = lam * cells, mu * cells
        volume, thermal = self._blocked(lam, mu, space.dim)
        out_of_plane = np.column_stack([lam, lam, np.zeros_like(lam), volume]) * float(self._plane == "strain")

        def at(x: Floats, inside: Ints) -> tuple[Floats, Floats]:
            lam, mu = self._lame(data.InCells(space.mesh, x, inside), None)
            C = vem.elastic_matrix(np.stack([lam, mu]), space.dim)
            return vem.upper_triangle(C), self._blocked(lam, mu, space.dim)[1]

        material = Material(
            subject="Elasticity" if self.on is None else f"Elasticity on {where(self.on)}",
            moduli=np.stack([lam, mu]),
            thermal_stress_moduli=thermal,
            plane=self._plane,
            cells=cells,
            out_of_plane=out_of_plane if space.in_plane else None,
            stabilisation=vem.stabilisation_of(self.stabilisation, mu),
            at=at if data.varies(self.young, self.poisson) else None,
        )
        return Contribution(material=material)

    def describe(self) -> str:
        plane = "" if self.plane is None else f"plane {self.plane}, "
        place = "" if self.on is None else f", on {where(self.on)}"
        constants = f"E = {amount(self.young, 'x')}, nu = {amount(self.poisson, 'x')}"
        return f"Elasticity: {constants}, {plane}{named(self.stabilisation)} stabilisation{place}"

    def described(self, in_plane: bool) -> str:
        return replace(self, plane=self._plane).describe() if in_plane else self.describe()

    @property
    def _plane(self) -> str:
        return "strain" if self.plane is None else self.plane

    def _warn_of_locking(self, lam: Floats, mu: Floats, space: Space) -> None:
        largest = float((0.5 * lam / (lam + mu)).max())
        (simplices, others), part = space.simplices
        # Linear triangles cannot follow a volume-preserving motion: at nu = .49 the error of P1 already exceeds twice
        # that of polygons of the same size, and grows without bound towards 1/2.
        if largest > 0.49 and part > 0.5:
            warnings.warn(
                f"Elasticity: poisson = {largest:.9g} on a mesh of {simplices}, which lock near 1/2; {others} do not.",
                SceneWarning,
                stacklevel=3,
            )

    def _blocked(self, lam: Floats, mu: Floats, dim: int) -> tuple[Floats, Floats]:
        """The energy of a blocked unit eigenstrain, and its stresses (k, components)."""
        volume = 3 * lam + 2 * mu if self._plane == "strain" else 2 * (lam + mu)
        return volume, vem.isotropic_stress(volume, dim)

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


# Orthotropic linear elasticity: wood, laminates, rolled or layered solids (Lekhnitskii 1963; Jones 1999, chapter 2).
#
# In the axes 1, 2 of the material (3 across the plane) the strains are e = S sigma with
#
#     S = [[1/E1, -nu12/E1, -nu13/E1], [., 1/E2, -nu23/E2], [., ., 1/E3]],   2 e_12 = sigma_12 / G12,
#
# nu_ij = -e_j / e_i under a pull along i, and in space 2 e_13 = sigma_13 / G13 and 2 e_23 = sigma_23 / G23, too. With
# the axes a_1, a_2, a_3 = a_1 x a_2 as the rows of R tensors turn by e' = R e R', strains by e' = Q e: the row of e'_ab
# has (2 - delta_ab) (R_ai R_bj + R_aj R_bi) / 2 for e_ij; so C = Q'C'Q.
#
# The plane is space with axis 3 across it. Plane strain (e_3 = 0) takes of C what is in the plane, and its row of zz is
# what is borne across; in plane stress (sigma_3 = 0) S has no coupling to 3, so that C has none.
@dataclass(frozen=True)
class Orthotropic(MaterialLaw):
    """Orthotropic linear elasticity: in the plane with two axes of symmetry there, in space with three.

    Every modulus is a number, an (n_cells,) array, a callable f(x) at centroids, or the name of a cell datum.

    Parameters
    ----------
    young : (E1, E2) in plane stress, (E1, E2, E3) in plane strain and in space
        Young's moduli along the axes, force per area, > 0.
    poisson : nu12 in plane stress, (nu12, nu13, nu23) in plane strain and in space
        nu_ij = -e_j / e_i under tension along i, so that nu21 = nu12 E2 / E1. The energy must be positive.
    shear : G12 in the plane, (G12, G13, G23) in space
        Moduli of shear, force per area, > 0.
    angle : modulus
        From x to axis 1, counter-clockwise, in radians, from -2 pi to 2 pi; in space about z, which is axis 3 then.
    plane : {"stress", "strain"}, optional
        Plane stress (the default) or plane strain, of bodies in the plane. Bodies in space refuse it.
    axes : (axis 1, axis 2), optional
        In space the two vectors (3,), or callables f(x) -> (m, 3) at centroids; of any length. Of axis 2 only
        the part across axis 1 counts. Instead of `angle`.
    on : None, str or sequence of str
        The cells of this material, as for Elasticity.
    stabilisation : {"shear", "unit"}, or a vx.Stabilisation
        As for Elasticity, with the softest modulus of shear for 2 mu (:mod:`vemcvx.vem.elasticity`).
    """

    young: Sequence[Constant]
    poisson: Constant | Sequence[Constant]
    shear: Constant | Sequence[Constant]
    angle: Constant = 0.0
    plane: str | None = field(default=None, metadata={"in the plane": True})
    axes: Sequence[Any] | None = field(default=None, metadata={"in space": True})
    on: str | Sequence[str] | None = None
    stabilisation: str | Stabilisation = "shear"

    def contribute(self, space: Space) -> Contribution:
        check_stabilisation(self.stabilisation, "Orthotropic")
        choice(self._plane, "Orthotropic", "plane", PLANES)
        if self.plane is not None:
            space.require_plane("Orthotropic: plane=", "leave it out, a body in space is in neither plane")
        turned = not (isinstance(self.angle, (int, float)) and self.angle == 0.0)
        if self.axes is not None and (space.in_plane or turned):
            but = "belong to bodies in space; give angle=" if space.in_plane else "take the place of angle=; give one"
            raise SceneError(f"Orthotropic: found axes = {brief(self.axes)}, which {but}.")
        cells = region(space, self.on, "Orthotropic")
        inside = np.ones(space.mesh.n_cells) if cells is None else cells.astype(float)
        C, thermal_stress_moduli, out_of_plane = self._law(data.InCells(space.mesh), inside, space.in_plane)

        def at(x: Floats, within: Ints) -> tuple[Floats, Floats]:
            C, thermal_stress_moduli, _ = self._law(
                data.InCells(space.mesh, x, within), np.ones(len(x)), space.in_plane
            )
            return vem.upper_triangle(C), thermal_stress_moduli

        names = "young", "poisson", "shear"
        constants = [one for name in names for one in self._constants(name, space.in_plane)]
        material = Material(
            subject="Orthotropic" if self.on is None else f"Orthotropic on {where(self.on)}",
            moduli=vem.upper_triangle(C),
            thermal_stress_moduli=thermal_stress_moduli,
            plane=self._plane if space.in_plane else "strain",
            cells=cells,
            out_of_plane=out_of_plane,
            stabilisation=vem.stabilisation_of(self.stabilisation, 0.5 * vem.softest_shear(C)),
            at=at if data.varies(*constants, self.angle, *(() if self.axes is None else self.axes)) else None,
        )
        return Contribution(material=material)

    @property
    def _plane(self) -> str:
        return "stress" if self.plane is None else self.plane

    def _law(self, at: data.InCells, inside: Floats, in_plane: bool) -> tuple[Floats, Floats, Floats | None]:
        """C (k, 6, 6), and Material's thermal_stress_moduli (k, 6); zero where not `inside`.

        In the plane (k, 3, 3) and (k, 3), and Material's out_of_plane (k, 4).
        """
        C = np.zeros((len(inside), 6, 6))
        C[:, :3, :3] = np.linalg.inv(self._compliance(at, inside > 0, in_plane))
        # G12, G13, G23; components are in the order xy, yz, xz.
        for component, G in zip((3, 5, 4), self._shears(at, inside > 0, in_plane), strict=False):
            C[:, component, component] = G
        Q = _turn(self._frame(at, inside > 0))
        C = Q.transpose(0, 2, 1) @ C @ Q * inside[:, None, None]
        C = 0.5 * (C + C.transpose(0, 2, 1))
        blocked = C[:, :, :3].sum(axis=2)
        if not in_plane:
            return C, blocked, None
        borne = np.column_stack([C[:, 2, IN_PLANE], blocked[:, 2]]) * float(self._plane == "strain")
        return C[:, IN_PLANE][:, :, IN_PLANE], blocked[:, IN_PLANE], borne

    def describe(self) -> str:
        place = "" if self.on is None else f", on {where(self.on)}"
        E, nu, G = (_words(values) for values in (self.young, self.poisson, self.shear))
        turned = f"angle {amount(self.angle, 'x')}" if self.axes is None else f"axes {_words(tuple(self.axes))}"
        plane = "" if self.plane is None else f", plane {self.plane}"
        name = named(self.stabilisation)
        stable = "" if name == "shear" else f", {name} stabilisation"
        return f"Orthotropic: E = {E}, nu = {nu}, G = {G}, {turned}{plane}{stable}{place}"

    def described(self, in_plane: bool) -> str:
        return replace(self, plane=self._plane).describe() if in_plane else self.describe()

    def _compliance(self, at: data.InCells, inside: Bools, in_plane: bool) -> Floats:
        """S (n_cells, 3, 3) of the normal directions; without coupling to 3 in plane stress."""
        E, nu = self._several(at, "young", in_plane), self._several(at, "poisson", in_plane)
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
        stress = in_plane and self._plane == "stress"
        rule = "nu12^2 < E1 / E2" if stress else "such that S (see the module) is positive definite"
        self._require(positive, nu[0], "poisson (nu12)", f"must leave the energy positive: {rule}")
        return S

    def _shears(self, at: data.InCells, inside: Bools, in_plane: bool) -> Floats:
        shears, names = self._several(at, "shear", in_plane), ("shear (G12)", "shear (G13)", "shear (G23)")
        for name, G in zip(("shear",) if in_plane else names, shears, strict=True):
            self._require(np.where(inside, G, 1.0) > 0, G, name, "must be > 0")
        return shears

    def _radians(self, at: data.InCells, inside: Bools) -> Floats:
        angle = self._read(at, self.angle, "angle")
        beyond = inside & (np.abs(angle) > 2 * np.pi)
        first = angle[np.argmax(beyond)]
        rule = f"is in radians, from -2 pi to 2 pi, and {first:.6g} degrees are {np.radians(first):.6g}"
        self._require(~beyond, angle, "angle", rule)
        return angle

    def _frame(self, at: data.InCells, inside: Bools) -> Floats:
        """R (k, 3, 3): the unit axes, row by row."""
        if self.axes is None:
            angle = self._radians(at, inside)
            c, s, zero = np.cos(angle), np.sin(angle), np.zeros(len(angle))
            return np.array([[c, s, zero], [-s, c, zero], [zero, zero, zero + 1.0]]).transpose(2, 0, 1)
        if not isinstance(self.axes, (list, tuple, np.ndarray)) or len(self.axes) != 2:
            raise SceneError(
                f"Orthotropic: found axes = {brief(self.axes)}; give two vectors, of axis 1 and of axis 2."
            )
        x = at.mesh.centroids if at.x is None else at.x
        first, second = (data.vector(axis, x, None, "Orthotropic: axes") for axis in self.axes)
        third = np.cross(first, second)
        sizes = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
        area = np.linalg.norm(third, axis=1)
        flat = inside & (area <= 1e-6 * sizes)
        if flat.any():
            cell = int(np.argmax(flat))
            raise SceneError(
                f"Orthotropic: axes 1 and 2 are {first[cell]} and {second[cell]} in cell {cell}; they must not be zero "
                "nor parallel."
            )
        first, third = (directions(rows, np.linalg.norm(rows, axis=1)) for rows in (first, third))
        return np.stack([first, np.cross(third, first), third], axis=1)

    def _several(self, at: data.InCells, name: str, in_plane: bool) -> Floats:
        return np.stack([self._read(at, part, name) for part in self._constants(name, in_plane)])

    def _constants(self, name: str, in_plane: bool) -> Sequence[Constant]:
        given, stress = getattr(self, name), in_plane and self._plane == "stress"
        count = {"young": 2 if stress else 3, "poisson": 1 if stress else 3, "shear": 1 if in_plane else 3}[name]
        parts = [given] if count == 1 else given
        several = isinstance(parts, (list, tuple)) or (type(parts) is np.ndarray and parts.ndim > 0)
        if not several or len(parts) != count:
            names = {"young": "(E1, E2, E3)", "poisson": "(nu12, nu13, nu23)", "shear": "(G12, G13, G23)"}
            wanted = {"young": "(E1, E2)", "poisson": "nu12", "shear": "G12"}[name] if count < 3 else names[name]
            body = f"plane {self._plane}" if in_plane else "a body in space"
            raise SceneError(f"Orthotropic: found {name} = {brief(given)}; {body} takes {wanted}.")
        return list(parts)

    def _read(self, at: data.InCells, value: Constant, name: str) -> Floats:
        return at.read(value, f"Orthotropic: {name}")

    def _require(self, holds: Bools, values: Floats, name: str, rule: str) -> None:
        if not holds.all():
            cell = int(np.argmin(holds))
            raise SceneError(f"Orthotropic: found {name} = {values[cell]:.6g} in cell {cell}; it {rule}.")


def _turn(R: Floats) -> Floats:
    """Q (n_cells, 6, 6): strains in axes, the rows of R (n_cells, 3, 3), from those along x, y and z."""
    Q = np.empty((len(R), 6, 6))
    for k, (a, b) in enumerate(COMPONENTS[3]):
        for m, (i, j) in enumerate(COMPONENTS[3]):
            both = 0.5 * (R[:, a, i] * R[:, b, j] + R[:, a, j] * R[:, b, i])
            Q[:, k, m] = both if a == b else 2.0 * both
    return Q


def _words(values: object) -> str:
    if isinstance(values, (tuple, list)):
        return f"({', '.join(amount(value, 'x') for value in values)})"
    return amount(values, "x")


@dataclass(frozen=True)
class Viscosity(Effect):
    """Kelvin-Voigt viscosity: sigma = C eps + 2 eta eps' + zeta tr(eps') I, with the strain rate eps'.

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
        eta, zeta = (self._checked(getattr(self, name), space, name) for name in ("shear", "volume"))
        return Contribution(viscosity=vem.stiffness(space, zeta, eta, stabilisation="shear"))

    def describe(self) -> str:
        return f"Viscosity: shear {amount(self.shear, 'x')}, volume {amount(self.volume, 'x')}"

    def _checked(self, value: data.Constant, space: Space, name: str) -> Floats:
        found = data.InCells(space.mesh).read(value, f"Viscosity: {name}")
        if (found < 0).any():
            cell = int(np.argmin(found))
            raise SceneError(f"Viscosity: found {name} = {found[cell]:.6g} in cell {cell}; it must be >= 0.")
        return found


# Thermal expansion: a strain eps_0 = alpha theta I, the same in all three directions of space, free of stress.
#
# Hooke's law becomes sigma = C (eps - eps_0). In the plane, with sigma_p = (xx, yy, xy) and C_p the law in the plane:
#
# - plane strain: eps_zz = 0, so that eps_zz - alpha theta = -alpha theta adds -lam alpha theta to the stresses in the
#   plane: sigma_p = C_p eps_p - (2 lam + 2 mu + lam) alpha theta (1, 1, 0), and 3 lam + 2 mu = E / (1 - 2 nu). A body
#   that is free in the plane strains by (1 + nu) alpha theta there, and bears sigma_zz = -E alpha theta;
# - plane stress: sigma_zz = 0 leaves eps_zz free: sigma_p = C_p (eps_p - alpha theta (1, 1, 0)), and C_p (1, 1, 0) is
#   E / (1 - nu) (1, 1, 0).
#
# Each material says its own factor. (Boley and Weiner, Theory of Thermal Stresses, 1960.)
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
        alpha = data.InCells(space.mesh).read(self.expansion, "ThermalStrain: expansion")

        def strain(t: float) -> Floats:
            return alpha * data.scalar(self.temperature, space.mesh.centroids, t, "ThermalStrain: temperature")

        def at(x: Floats, cells: Ints, t: float) -> Floats:
            there = data.InCells(space.mesh, x, cells).read(self.expansion, "ThermalStrain: expansion")
            return there * data.scalar(self.temperature, x, t, "ThermalStrain: temperature")

        of_place = at if data.varies(self.expansion, self.temperature) else None
        return Contribution(eigenstrains=(Eigenstrain("ThermalStrain", strain, of_place),))

    def describe(self) -> str:
        return f"ThermalStrain: {amount(self.expansion, 'x')} times {amount(self.temperature)}"


# Initial stress: sigma = C eps(u) + sigma_0.
#
# It enters the principle of virtual work as the load -int sigma_0 : eps(v), on cells -sum_K |K| sigma_0 : eps(Pi v).
@dataclass(frozen=True)
class Prestress(Effect):
    """Initial stress: a stress at zero strain, such as that of tendons or growth.

    `history.stress` includes it. A body that is fixed everywhere keeps it; a free body relaxes from a uniform one
    completely. `history.energy` remains 1/2 a^h(u, u), and `history.work` includes the work of the initial stress, as
    of a load. If the stress is nonzero at times[0], u = 0 is in equilibrium only if supports bear it: begin with
    ``initial="settled"`` or "equilibrium".

    Parameters
    ----------
    stress : (3,) constant, or callable f(x, t) -> (m, 3)
        xx, yy, xy, in space (6,): xx, yy, zz, xy, yz, xz; force per area, tension positive, at centroids and t_n.
    """

    stress: data.Datum

    def contribute(self, space: Space) -> Contribution:
        mesh = space.mesh

        def at(x: Floats, cells: Ints, t: float) -> Floats:
            return data.tensor(self.stress, x, t, "Prestress")

        assembled = partial(at, mesh.centroids, np.arange(mesh.n_cells))
        of_place = at if data.varies(self.stress) else None
        return Contribution(initial_stresses=(InitialStress("Prestress", assembled, of_place),))

    def describe(self) -> str:
        return f"Prestress: {amount(self.stress)} in the body"
