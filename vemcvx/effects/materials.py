"""Materials: isotropic and orthotropic elasticity, viscosity, thermal strain and initial stress."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeGuard

import numpy as np

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief, choice
from vemcvx.base.errors import SceneError, SceneWarning
from vemcvx.effects import data
from vemcvx.effects.data import Constant
from vemcvx.effects.effect import Contribution, Effect, Eigenstrain, InitialStress, Material, Support, amount, where
from vemcvx.vem import Space, Stabilisation, stiffness
from vemcvx.vem.elasticity import softest_shear
from vemcvx.vem.stabilisation import stabilisation_of
from vemcvx.vem.tensors import COMPONENTS, elastic_matrix, isotropic_stress, moduli_of_revolution, upper_triangle

PLANES = ("strain", "stress")
REVOLVED = "axisymmetric"
IN_PLANE = [COMPONENTS[3].index(pair) for pair in COMPONENTS[2]]
"""The positions of xx, yy and xy among the six components in space."""


class MaterialLaw(Effect):
    """The base class of materials.

    Examples
    --------
    >>> isinstance(vx.Elasticity(young=200.0, poisson=0.3), vx.effects.MaterialLaw)
    True
    """


class Moduli(NamedTuple):
    """The constants of k cells, as in :class:`Material`."""

    moduli: Floats  # (number of constants, k)
    thermal_stress_moduli: Floats  # (k, components)
    out_of_plane: Floats  # (k, 4); unused in space
    shear: Floats  # (k,) for the stabilisation "shear"


class _Elastic(MaterialLaw):
    """An elastic material of the cells named by `on`."""

    plane: str | None
    stabilisation: str | Stabilisation
    on: str | Sequence[str] | None
    _default_plane = "strain"
    _planes: ClassVar[Sequence[str]] = PLANES

    @abstractmethod
    def _law(self, at: data.InCells, space: Space) -> Moduli:
        """Return the moduli at points of cells."""

    @property
    def _plane(self) -> str:
        return self._default_plane if self.plane is None else self.plane

    def describe_body(self, in_plane: bool) -> str:
        return replace(self, plane=self._plane).describe() if in_plane else self.describe()  # type: ignore[type-var]

    def contribute(self, space: Space) -> Contribution:
        name, dim = type(self).__name__, space.dim
        if not isinstance(self.stabilisation, Stabilisation):
            choice(self.stabilisation, name, "stabilisation", STABILISATIONS)
        choice(self._plane, name, "plane", self._planes)
        if self.plane is not None:
            words = "leave out plane=, which chooses between plane strain and plane stress"
            space.require_plane(f"{self._subject}: plane=", words)
        cells = cells_of(space, self.on, name)
        law, inside = self._law(data.InCells(space.mesh, inside=cells), space), 1.0 * cells

        def at(x: Floats, within: Ints) -> tuple[Floats, Floats]:
            there = self._law(data.InCells(space.mesh, x, within), space)
            return upper_triangle(elastic_matrix(there.moduli, dim)), there.thermal_stress_moduli

        constants = (one for given in vars(self).values() for one in (given if _is_sequence(given) else [given]))
        material = Material(
            subject=self._subject,
            moduli=law.moduli * inside,
            thermal_stress_moduli=(law.thermal_stress_moduli.T * inside).T,
            plane=self._plane if space.in_plane else "strain",
            cells=None if self.on is None else cells,
            out_of_plane=(law.out_of_plane.T * inside).T if space.components == 3 else None,
            stabilisation=stabilisation_of(self.stabilisation, law.shear * inside),
            at=at if data.varies(*constants) else None,
        )
        return Contribution(material=material, supports=self._axis(space) if space.axisymmetric else ())

    def _axis(self, space: Space) -> tuple[Support, ...]:
        """Return the support u_r = 0 of the nodes on the axis of revolution."""
        nodes = nodes_of(space, self.on, type(self).__name__)
        r, largest = space.mesh.points[nodes, 0], np.abs(space.mesh.points[:, 0]).max()
        if (r < -SAME * largest).any():
            raise SceneError(
                f"{self._subject}: found the radius {r.min():.6g} in a body of revolution; x is the distance from the "
                "axis, so mesh the half section with x >= 0."
            )
        nodes = nodes[r <= SAME * largest]
        axis = Support(f"{self._subject}: axis", nodes, np.tile([1.0, 0.0], (len(nodes), 1)), space.mesh.points[nodes])
        return (axis,) if len(nodes) else ()

    def _describe_stabilisation(self) -> str:
        name = self.stabilisation.describe() if isinstance(self.stabilisation, Stabilisation) else self.stabilisation
        return f"{name} stabilisation" + ("" if self.on is None else f", on {where(self.on)}")


def cells_of(space: Space, on: str | Sequence[str] | None, subject: str) -> Bools:
    """Return a mask of the cells in which a cell datum named by `on` is nonzero."""
    known, cells = space.mesh.cell_data, np.full(space.mesh.n_cells, on is None)
    if on is None:
        return cells
    for name in on if isinstance(on, Sequence) and not isinstance(on, str) else [on]:
        if not isinstance(name, str) or name not in known or known[name].ndim != 1:
            there_are = ", ".join(repr(n) for n in known if known[n].ndim == 1) or "none"
            raise SceneError(
                f"{subject}: found on={name!r}; cell data of this mesh: {there_are}. on= names a cell datum, and "
                "selects the cells where it is nonzero. Add a cell datum with mesh.with_cell_data(name, values)."
            )
        cells |= known[name] != 0
    if not cells.any():
        raise SceneError(f"{subject}: on={on!r} names no cell: the cell datum is zero everywhere on this mesh.")
    return cells


def nodes_of(space: Space, on: str | Sequence[str] | None, subject: str) -> Ints:
    """Return the nodes of the cells that `cells_of` selects."""
    inside, (cells, nodes) = cells_of(space, on, subject), space.incidences
    found: Ints = np.unique(nodes[inside[cells]])
    return found


# Hooke's law is sigma = 2 mu eps + lam tr(eps) I. In plane stress, lam is 2 lam mu / (lam + 2 mu).
# A blocked thermal strain s causes sigma = -b s I, with b = 3 lam + 2 mu, in plane stress b = 2 (lam + mu).
STABILISATIONS = ("shear", "unit")


@dataclass(frozen=True)
class Elasticity(_Elastic):
    """Isotropic linear elasticity of the body, or of a part of it.

    Parameters
    ----------
    young : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        Young's modulus E > 0, force per area.
    poisson : number, (n_cells,) array, callable or name, like `young`
        Poisson's ratio, -1 < nu < 1/2 in plane strain and in space, -1 < nu <= 1/2 in plane stress.
    plane : {"strain", "stress", "axisymmetric"}, optional
        The state of a plane body; "strain" by default. It must be left out for bodies in space. "axisymmetric" is a
        body of revolution about the axis x = 0: the mesh is its half section, x is the radius and y the axial
        coordinate. **All forces, works and energies refer to the full turn** (docs/howto/bodies_of_revolution.md).
    stabilisation : {"shear", "unit"}, or a vx.Stabilisation
        The part of the stiffness that vanishes for linear displacements (:mod:`vemcvx.vem.stabilisation`). "shear" has
        the factor 2 mu and does not lock; "unit" has the factor 1 (Feng, Han and Huang).
    on : None, str or sequence of str
        Names of cell data; the material fills the cells with a nonzero value. None is the whole body.

    Examples
    --------
    >>> steel = vx.Elasticity(young=210e9, poisson=0.3, plane="stress")
    >>> graded = vx.Elasticity(young=lambda x: 200.0 + 50.0 * x[:, 1], poisson=0.3)
    """

    young: data.Constant = field(metadata=data.holds(sign="> 0", rule="Young's modulus must be > 0"))
    poisson: data.Constant = field(metadata=data.holds())
    plane: str | None = None
    stabilisation: str | Stabilisation = "shear"
    on: str | Sequence[str] | None = None
    _planes: ClassVar[Sequence[str]] = (*PLANES, REVOLVED)

    def contribute(self, space: Space) -> Contribution:
        part = super().contribute(space)
        simplices = sum(len(group.cells) for group in space.groups if group.simplices)
        # Linear triangles lock: at nu = .49 their error is twice the error of polygons.
        if self._plane != "stress" and 2 * simplices > space.mesh.n_cells:
            inside = cells_of(space, self.on, "Elasticity")
            largest = self._read("poisson", data.InCells(space.mesh, inside=inside)).max()
            if largest > 0.49:
                found = f"Elasticity: poisson = {largest:.9g} on a mesh of triangles or tetrahedra"
                words = f"{found}, which lock near 1/2; other polygons and polyhedra do not."
                warnings.warn(words, SceneWarning, stacklevel=2)
        return part

    def describe(self) -> str:
        words = self.plane if self.plane == REVOLVED else f"plane {self.plane}"
        plane = "" if self.plane is None else f"{words}, "
        constants = f"E = {amount(self.young, 'x')}, nu = {amount(self.poisson, 'x')}"
        return f"Elasticity: {constants}, {plane}{self._describe_stabilisation()}"

    def _law(self, at: data.InCells, space: Space) -> Moduli:
        (lam, mu), strain = self._lame(at), self._plane != "stress"
        volume = 3 * lam + 2 * mu if strain else 2 * (lam + mu)
        if self._plane == REVOLVED:
            blocked = np.column_stack([volume, volume, np.zeros_like(volume), volume])
            return Moduli(moduli_of_revolution(lam, mu), blocked, np.zeros((len(mu), 4)), mu)
        out_of_plane = np.column_stack([lam, lam, np.zeros_like(lam), volume]) * float(strain)
        return Moduli(np.stack([lam, mu]), isotropic_stress(volume, space.dim), out_of_plane, mu)

    def _lame(self, at: data.InCells) -> tuple[Floats, Floats]:
        E, nu, strain = self._read("young", at), self._read("poisson", at), self._plane != "stress"
        limit = "< 0.5 in plane strain (use 0.4999999, or plane='stress')" if strain else "<= 0.5"
        limit = "< 0.5 (use 0.4999999)" if self._plane == REVOLVED else limit
        lawful = (nu > -1) & ((nu < 0.5) if strain else (nu <= 0.5))
        data.require(lawful, nu, at, f"{self._subject}: found poisson", f"it must be > -1 and {limit}")
        return E * nu / ((1 + nu) * (1 - (2 * nu if strain else nu))), E / (2 * (1 + nu))


# Orthotropic linear elasticity (Lekhnitskii 1963; Jones 1999, chapter 2).
#
# A material has axes 1, 2, 3, Young's moduli E, and shear moduli G. Under tension along i, nu_ij = -e_j / e_i for the
# normal strains e. In these axes e = S sigma, and shear strains are 2 e_ij = sigma_ij / G_ij, with the symmetric matrix
#
#     S = [[1/E1, -nu12/E1, -nu13/E1], [., 1/E2, -nu23/E2], [., ., 1/E3]].
#
# The elastic matrix C_0 in these axes has the blocks S^{-1} and diag(G). Let Q map strains in x, y, z to strains in
# these axes. Then C = Q' C_0 Q. In plane bodies, axis 3 is the normal. In plane stress, nu13 = nu23 = 0 in S.
SYMBOLS = {"young": ("E1", "E2", "E3"), "poisson": ("nu12", "nu13", "nu23"), "shear": ("G12", "G13", "G23")}


@dataclass(frozen=True)
class Orthotropic(_Elastic):
    """Orthotropic linear elasticity: two perpendicular axes of symmetry in the plane, three in space.

    Every modulus is a number, an (n_cells,) array, a callable f(x) at centroids, or the name of a cell datum.

    Parameters
    ----------
    young : (E1, E2) in plane stress, (E1, E2, E3) in plane strain and in space
        Young's moduli along the axes, force per area, > 0.
    poisson : nu12 in plane stress, (nu12, nu13, nu23) in plane strain and in space
        nu_ij = -e_j / e_i for strains e under tension along i, so nu21 = nu12 E2 / E1. The energy must be positive.
    shear : G12 in the plane, (G12, G13, G23) in space
        Shear moduli, force per area, > 0.
    angle : number, (n_cells,) array, callable or name
        The angle from x to axis 1, counter-clockwise, in radians, from -2 pi to 2 pi. In space axis 3 is z.
    plane : {"stress", "strain"}, optional
        Plane stress (the default) or plane strain, for plane bodies. It must be left out for bodies in space.
    on : None, str or sequence of str
        The cells of this material, as for Elasticity.
    stabilisation : {"shear", "unit"}, or a vx.Stabilisation
        As for Elasticity, with the softest shear modulus in place of mu (:mod:`vemcvx.vem.elasticity`).

    Examples
    --------
    >>> wood = vx.Orthotropic(young=(11e9, 0.6e9), poisson=0.4, shear=0.7e9, angle=np.pi / 6)
    >>> print(wood.describe_body(in_plane=True).split(",")[0])
    Orthotropic: E = (11000000000.0
    """

    young: Sequence[Constant] = field(metadata=data.holds(sign="> 0"))
    poisson: Constant | Sequence[Constant] = field(metadata=data.holds())
    shear: Constant | Sequence[Constant] = field(metadata=data.holds(sign="> 0"))
    angle: Constant = field(default=0.0, metadata=data.holds())
    plane: str | None = None
    on: str | Sequence[str] | None = None
    stabilisation: str | Stabilisation = "shear"
    _default_plane = "stress"

    def _law(self, at: data.InCells, space: Space) -> Moduli:
        plane = self._plane if space.in_plane else None
        S = self._compliance(at, plane)
        C = np.zeros((len(S), 6, 6))
        C[:, :3, :3] = np.linalg.inv(S)
        # `shear` has the order xy, xz, yz; components have the order xy, yz, xz.
        for component, G in zip((3, 5, 4), self._read_constants(at, "shear", plane), strict=False):
            C[:, component, component] = G
        Q = _rotate_strains(self._frame(at))
        C = Q.transpose(0, 2, 1) @ C @ Q
        C = 0.5 * (C + C.transpose(0, 2, 1))
        blocked = C[:, :, :3].sum(axis=2)
        out_of_plane = np.column_stack([C[:, 2, IN_PLANE], blocked[:, 2]]) * float(plane == "strain")
        if plane is not None:
            C, blocked = C[:, IN_PLANE][:, :, IN_PLANE], blocked[:, IN_PLANE]
        return Moduli(upper_triangle(C), blocked, out_of_plane, 0.5 * softest_shear(C))

    def describe(self) -> str:
        E, nu, G = (_words(values) for values in (self.young, self.poisson, self.shear))
        plane = "" if self.plane is None else f", plane {self.plane}"
        turned = f"angle {amount(self.angle, 'x')}{plane}, {self._describe_stabilisation()}"
        return f"Orthotropic: E = {E}, nu = {nu}, G = {G}, {turned}"

    def _compliance(self, at: data.InCells, plane: str | None) -> Floats:
        """Return the compliances S (k, 3, 3) of normal strains."""
        E, nu = self._read_constants(at, "young", plane), self._read_constants(at, "poisson", plane)
        S = np.zeros((E.shape[1], 3, 3))
        S[:, 2, 2] = 1.0
        for i, values in enumerate(E):
            S[:, i, i] = 1.0 / values
        for (i, j), values in zip(((0, 1), (0, 2), (1, 2)), nu, strict=False):
            S[:, i, j] = S[:, j, i] = -values / E[i]
        # Scale S to a unit diagonal, so that entries do not overflow.
        scale = 1.0 / np.sqrt(np.einsum("cii->ci", S))
        positive = np.linalg.eigvalsh(scale[:, :, None] * S * scale[:, None, :]).min(axis=1) > 0
        rule = "nu12^2 < E1 / E2" if plane == "stress" else "the matrix S of compliances must be positive definite"
        found = f"{self._subject}: found poisson (nu12)"
        data.require(positive, nu[0], at, found, f"it must leave the energy positive: {rule}")
        return S

    def _frame(self, at: data.InCells) -> Floats:
        """Return matrices (k, 3, 3) with the unit axes as rows."""
        angle = self._read("angle", at)
        rule = "it is in radians, from -2 pi to 2 pi"
        data.require(np.abs(angle) <= 2 * np.pi, angle, at, f"{self._subject}: found angle", rule)
        c, s, zero = np.cos(angle), np.sin(angle), np.zeros(len(angle))
        return np.array([[c, s, zero], [-s, c, zero], [zero, zero, zero + 1.0]]).transpose(2, 0, 1)

    def _read_constants(self, at: data.InCells, name: str, plane: str | None) -> Floats:
        """Return the constants (count, k) of the field `name`."""
        given, few = getattr(self, name), {"young": 2, "poisson": 1} if plane == "stress" else {}
        count = 1 if name == "shear" and plane is not None else few.get(name, 3)
        parts = [given] if count == 1 else given
        if not _is_sequence(parts) or len(parts) != count:
            wanted = SYMBOLS[name][0] if count == 1 else f"({', '.join(SYMBOLS[name][:count])})"
            body = "a body in space" if plane is None else f"plane {plane}"
            raise SceneError(f"Orthotropic: found {name} = {brief(given)}; {body} takes {wanted}.")
        named = zip(parts, SYMBOLS[name], strict=False)
        return np.stack([self._read(name, at, part, f"{name} ({symbol})") for part, symbol in named])


def _is_sequence(given: object) -> TypeGuard[Sequence[Any]]:
    return isinstance(given, (list, tuple)) or (type(given) is np.ndarray and given.ndim > 0)


def _rotate_strains(R: Floats) -> Floats:
    """Return Q (k, 6, 6) for the axes in the rows of R."""
    Q = np.empty((len(R), 6, 6))
    for k, (a, b) in enumerate(COMPONENTS[3]):
        for m, (i, j) in enumerate(COMPONENTS[3]):
            both = 0.5 * (R[:, a, i] * R[:, b, j] + R[:, a, j] * R[:, b, i])
            Q[:, k, m] = both if a == b else 2.0 * both
    return Q


def _words(values: Any) -> str:
    several = isinstance(values, (tuple, list))
    return f"({', '.join(amount(value, 'x') for value in values)})" if several else amount(values, "x")


@dataclass(frozen=True)
class Viscosity(Effect):
    """Kelvin-Voigt viscosity: sigma = C eps + 2 eta eps' + zeta tr(eps') I, with the strain rate eps'.

    `history.dissipated` and all forces include viscous parts. `history.energy` and `history.stress` are elastic.

    Parameters
    ----------
    shear : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        eta >= 0, force per area times time.
    volume : number, (n_cells,) array, callable or name, like `shear`
        zeta >= 0, force per area times time.

    Examples
    --------
    >>> print(vx.Viscosity(shear=0.5).describe())
    Viscosity: shear 0.5, volume 0.0
    """

    shear: data.Constant = field(metadata=data.holds(sign=">= 0"))
    volume: data.Constant = field(default=0.0, metadata=data.holds(sign=">= 0"))

    def contribute(self, space: Space) -> Contribution:
        eta, zeta = (self._read(name, data.InCells(space.mesh)) for name in ("shear", "volume"))
        return Contribution(viscosity=stiffness(space, zeta, eta, stabilisation="shear"))

    def describe(self) -> str:
        return f"Viscosity: shear {amount(self.shear, 'x')}, volume {amount(self.volume, 'x')}"


@dataclass(frozen=True)
class ThermalStrain(Effect):
    """Thermal expansion: the strain alpha theta in all directions, which causes stress where it is blocked.

    Hooke's law becomes sigma = C (eps - alpha theta I) (Boley and Weiner, *Theory of Thermal Stresses*, 1960).
    `history.stress` is sigma, and `history.energy` is the energy of the total strain eps. The stress C alpha theta I is
    a load in `history.work`. If theta is not zero at the first instant, begin with ``initial="settled"``.

    Parameters
    ----------
    expansion : number, (n_cells,) array, callable f(x) at centroids, or name of a cell datum
        alpha, strain per degree.
    temperature : number, or callable f(x, t) -> (m,)
        theta at centroids, degrees above the stress-free state.
    on : str or sequence of str, optional
        Names of cell data, such as names of bodies. Cells with a nonzero value expand; by default, all cells.

    Examples
    --------
    >>> heating = vx.ThermalStrain(expansion=1.2e-5, temperature=lambda x, t: np.full(len(x), 80.0 * t))
    """

    expansion: data.Constant
    temperature: data.Datum
    on: str | Sequence[str] | None = None

    def contribute(self, space: Space) -> Contribution:
        mesh, expansion = space.mesh, "ThermalStrain: expansion"
        inside = cells_of(space, self.on, "ThermalStrain")
        alpha = data.InCells(mesh).read(self.expansion, expansion) * inside

        def heat(x: Floats, t: float) -> Floats:
            return data.scalar(self.temperature, x, t, "ThermalStrain: temperature")

        def at(x: Floats, cells: Ints, t: float) -> Floats:
            return data.InCells(mesh, x, cells).read(self.expansion, expansion) * heat(x, t) * inside[cells]

        within_cells = at if data.varies(self.expansion, self.temperature) else None
        strain = Eigenstrain(self._subject, lambda t: alpha * heat(mesh.centroids, t), within_cells)
        return Contribution(eigenstrains=(strain,))

    def describe(self) -> str:
        words = f"ThermalStrain: {amount(self.expansion, 'x')} times {amount(self.temperature)}"
        return words if self.on is None else f"{words} in {where(self.on)}"


@dataclass(frozen=True)
class Prestress(Effect):
    """Initial stress sigma_0, for example of tendons or growth: sigma = C eps(u) + sigma_0.

    `history.stress` is sigma, and `history.energy` is the energy of eps(u). The stress -sigma_0 is a load in
    `history.work`. If sigma_0 is not zero at the first instant, begin with ``initial="settled"``.

    Parameters
    ----------
    stress : (3,) constant, or callable f(x, t) -> (m, 3)
        Components xx, yy, xy; in space (6,) xx, yy, zz, xy, yz, xz; in a body of revolution rr, zz, rz (no hoop
        stress). Force per area at centroids, tension positive.
    on : str or sequence of str, optional
        Names of cell data. The stress acts in cells with a nonzero value; by default, in all cells.

    Examples
    --------
    >>> tendon = vx.Prestress(lambda x, t: np.outer(np.full(len(x), 5.0 * t), [1.0, 0.0, 0.0]))
    """

    stress: data.Datum
    on: str | Sequence[str] | None = None

    def contribute(self, space: Space) -> Contribution:
        mesh, inside = space.mesh, cells_of(space, self.on, "Prestress")

        def at(x: Floats, cells: Ints, t: float) -> Floats:
            return data.tensor(self.stress, x, t, "Prestress") * inside[cells, None]

        assembled = partial(at, mesh.centroids, np.arange(mesh.n_cells))
        within_cells = at if data.varies(self.stress) else None
        return Contribution(initial_stresses=(InitialStress(self._subject, assembled, within_cells),))

    def describe(self) -> str:
        return f"Prestress: {amount(self.stress)} in {'the body' if self.on is None else where(self.on)}"
