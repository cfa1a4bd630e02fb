"""The base of effects, and what one contributes to the assembled problem: arrays, and data to be evaluated at t_n.

Displacements are vectors u of n_nodes * dim nodal values, component a of node i at position i * dim + a. The kinds of
contributions are closed; effects are open (each returns any of these kinds).

Friction by direction on a surface in space is bounded by an ellipse of forces: with the bound g along a unit vector e
of the surface and h across it, along c = n x e, friction q obeys (q_e / g)^2 + (q_c / h)^2 <= 1. What it dissipates in
the slip s is the largest work of such forces, by Cauchy and Schwarz on (q_e / g, q_c / h),

    max -q . s = |(g s_e, h s_c)| = g |(s_e, r s_c)|,   r = h / g,

attained where s is along the normal (q_e / g^2, q_c / h^2) of the ellipse (Michalowski and Mroz, Arch. Mech. 30, 1978).
It is the term of a disc with the weight g that reads slip by the vectors e and r c in place of two orthonormal
tangents: the same second-order cone, certificate and active sets. r must not change in time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.sparse as sp

from vemcvx import vem
from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief, call_function, drop_tails, read_only
from vemcvx.base.errors import SceneError
from vemcvx.base.weight_law import Law
from vemcvx.effects import data
from vemcvx.vem import BoundaryRows, EdgeEnds, Space, Stabilisation


@dataclass(frozen=True)
class Load:
    """A force that enters linearly: its nodal vector at t is matrix @ value(points, t)."""

    subject: str
    points: Floats  #: (q, dim) points where the datum is evaluated.
    matrix: sp.csr_matrix  #: (n_u, q * dim) quadrature times test functions; (n_u, q) where the datum is a scalar.
    value: data.Datum
    cells: Ints | None = None  #: (q,) of a load in the body: the cell of each point
    edges: Ints | None = None  #: (q, 2) of a load on the boundary: the edge of each point
    times: tuple[float, ...] = ()  # of the run, where they are known
    between: bool = False  # True of the force of two bodies on each other, at their interface

    def at(self, x: Floats, t: float) -> Floats:
        """Return the datum, (k,) or (k, dim), at points x (k, dim) and the instant `t`."""
        shape = "number" if self.matrix.shape[1] == len(self.points) else "vector"
        return data.At(x, t).read(self.value, self.subject, shape)

    def in_cells(self, x: Floats, owner: Ints, t: float) -> Floats:
        """Return the datum of a load in the body at points of cells (k,): zero in cells that have none of it."""
        there = np.isin(owner, () if self.cells is None else self.cells)
        return self.at(x, t) * there if self.matrix.shape[1] == len(self.points) else self.at(x, t) * there[:, None]

    def vector(self, t: float) -> Floats:
        """Nodal force (n_u,) at the instant `t`."""
        return self.matrix @ self.values(t)

    @cached_property
    def values(self) -> Callable[[float], Floats]:
        """t -> the datum at all points, by which `matrix` is to be multiplied."""
        return drop_tails(lambda t: self.at(self.points, t).ravel(), self.times)

    @cached_property
    def borne(self) -> Floats:
        """(q, dim) the total that each point gives by a datum of one along each axis, or by a scalar one."""
        dim, nodes = self.points.shape[1], np.ones(self.matrix.shape[0] // self.points.shape[1])
        total = np.stack([nodes @ self.matrix[a::dim] for a in range(dim)], axis=1)
        # Basis functions sum to one: the rows of one component to its total, on which no other acts.
        return total if self.matrix.shape[1] == len(self.points) else total.reshape(-1, dim, dim).sum(axis=1)

    @property
    def measures(self) -> Floats:
        """The part of length, area or volume (q,) that each point stands for."""
        scalar = self.matrix.shape[1] == len(self.points)
        return np.linalg.norm(self.borne, axis=1) if scalar else self.borne[:, 0]

    def forces(self, t: float) -> Floats:
        """Return the force (q, dim) that each point stands for at the instant `t`."""
        return self.borne * self.values(t).reshape(len(self.points), -1)


@dataclass(frozen=True)
class Support:
    """Prescribed components directions . u(node) = value(t) + patterns @ c; contact (value 0) yields to the rest."""

    subject: str
    nodes: Ints  #: (m,) node numbers; a node may appear once a direction.
    directions: Floats  #: (m, dim) unit vectors.
    points: Floats  #: (m, dim) where the nodes are.
    value: Callable[[float], Floats] | None = None  #: t -> (m,) prescribed components; None means zero at all times.
    contact: bool = False  #: Contact, u.n = 0, which at shared nodes yields to supports in the same direction.
    partners: Ints | None = None
    """(m,) nodes of other bodies, or -1: the components of u(node) - u(partner) are prescribed"""
    patterns: Floats | None = None
    """(m, k) independent columns: the components that a unit of each of k unknown amplitudes c adds"""


@dataclass(frozen=True)
class Ground:
    """The displacement of what a body rubs on, (q, dim) at points: what of it is along the boundary counts."""

    subject: str
    points: Floats  # (q, dim)
    value: data.Datum

    def __post_init__(self) -> None:
        """Raise SceneError for a constant."""
        if not callable(self.value):
            self.vector(0.0)
            raise SceneError(
                f"{self.subject}: found {brief(self.value)}; it is the displacement of the ground, and a constant "
                "moves nothing. Give a function of time, such as lambda x, t: (0.5 * t, 0.0), or a Tabulated."
            )

    def vector(self, t: float) -> Floats:
        """Return the displacements (q, dim) at the instant `t`."""
        return data.vector(self.value, self.points, t, self.subject)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipse:
    """The ellipses of friction at m rows of nodes and normals."""

    subject: str
    points: Floats  # (m, 3)
    direction: Floats  # (m, 3) vectors of any length, of which what is along the surface counts
    bounds: Callable[[float], tuple[Floats, Floats]]  # t -> (m,) bounds along the direction and across it, in any unit
    names: tuple[str, str]  # what they are called in messages

    def vectors(self, normals: Floats, times: Sequence[float]) -> Floats:
        """Return the vectors e and r c (m, 2, 3) of each row.

        SceneError where the direction is along the normal; where r is infinite, or changes between any two of `times`.
        """
        first = self.direction - np.einsum("mi,mi->m", self.direction, normals)[:, None] * normals
        length, found = np.linalg.norm(first, axis=1), f"{self.subject}: found direction"
        flat = length > 1e-6 * np.linalg.norm(self.direction, axis=1)
        data.require(flat, self.direction, data.At(self.points), found, "give a vector that is not along the normal")
        first = first / length[:, None]
        return np.stack([first, self._ratio(times)[:, None] * np.cross(normals, first)], axis=1) + 0.0

    def _ratio(self, times: Sequence[float]) -> Floats:
        """Return r (m,), read at the first instant at which there is friction; 1 where there never is."""
        ratio = np.full(len(self.points), np.nan)
        for t in times if len(times) else (0.0,):
            along, across = self.bounds(float(t))
            new = np.isnan(ratio) & (along > 0)
            ratio[new] = across[new] / along[new]
            wanted = np.where(np.isnan(ratio), 0.0, ratio) * along
            apart = np.abs(across - wanted) > 1e-9 * np.maximum(across, wanted)
            if apart.any():
                row, (one, other) = int(np.argmax(apart)), self.names
                raise SceneError(
                    f"{self.subject}: found {one} = {along[row]:.6g} and {other} = {across[row]:.6g} at "
                    f"{self.points[row]} and t = {t:.6g}; {one} must be > 0 where {other} is, and their ratio must not "
                    "change in time."
                )
        return np.where(np.isnan(ratio), 1.0, ratio)


@dataclass(frozen=True)
class ContactSurface:
    """Rows of contact, one a node and distinct normal: a surface on which it is reported, friction, or an obstacle."""

    subject: str
    nodes: Ints
    normals: Floats
    lengths: Floats  #: (m,) integrals of the nodal basis functions over the edges with that normal.
    ends: EdgeEnds | None = field(default=None, kw_only=True)
    """the edges of each row; without, `lengths` are of an edge that no other part has"""
    partners: Ints | None = field(default=None, kw_only=True)
    """(m,) nodes of other bodies, or -1: rows read u(node) - u(partner)"""

    @classmethod
    def of(cls, rows: BoundaryRows, subject: str = "", **more: Any) -> Self:
        """Return what acts on the rows of a part of the boundary, with `more` of its fields."""
        own = subject, rows.nodes, rows.normals, rows.lengths
        return cls(*own, ends=rows.ends, partners=rows.partners, **more)


def _no_weight(t: float) -> Floats:
    return np.zeros(())


@dataclass(frozen=True)
class Friction(ContactSurface):
    """Terms w_i(t) |(I - n n') (v - v_prev)(node_i)|, v = u less the ground's motion: one row a node and normal."""

    weights: Callable[[float], Floats] = _no_weight
    """t -> (m,) integrals of the friction bound against the nodal basis functions (force units); infinite: it sticks"""
    steady: bool = False  #: True if these are the same at all times
    in_the_air: bool = False  #: True if a warning is to say where it rubs while one-sided contact is open
    ground: Ground | None = None  #: the obstacle under it, if that moves
    law: Law | None = None  #: what forces of contact and slip add to the weights
    directions: Floats | None = None
    """(m, dim) unit vectors: terms are w_i |e_i . (v - v_prev)|, instead of those along the tangents"""
    bond: bool = False  #: True of what holds the amplitude of a support, and is no place of contact
    ellipse: Ellipse | None = None
    """of friction by direction in space: terms are w_i |((v - v_prev) . e, r (v - v_prev) . (n x e))|"""

    def __post_init__(self) -> None:
        """Raise SceneError unless `directions` are one unit vector a row."""
        given, shape = self.directions, self.normals.shape
        if given is not None and (np.shape(given) != shape or np.abs(np.linalg.norm(given, axis=1) - 1).max() > SAME):
            raise SceneError(
                f"{self.subject}: found directions of shape {np.shape(given)} for normals of shape {shape}; rows along "
                "directions have one unit vector a row."
            )

    @property
    def in_plane(self) -> bool:
        """True if the normals are those of a body in the plane."""
        return len(vem.tangents_of(self.normals[:1]).swapaxes(0, 1)) == 1

    @property
    def across(self) -> Floats:
        """The unit vectors (m, dim) that tell terms of a node from each other.

        Normals, or `directions` turned by -90 degrees; in space the directions themselves.
        """
        if self.directions is None:
            return self.normals
        return self.directions[:, ::-1] * (1.0, -1.0) + 0.0 if self.in_plane else self.directions

    def read(self, times: Sequence[float]) -> Floats:
        """Return vectors (m, dim - 1, dim) along which terms read slip; the second vanishes of directions in space."""
        if self.ellipse is not None:
            return self.ellipse.vectors(self.normals, times)
        if self.directions is None or self.in_plane:
            return vem.tangents_of(self.across)
        return np.stack([self.directions, 0.0 * self.directions], axis=1)

    def weights_under(self, t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        """Return the weights (m,) under normal forces p (m,), after slips (m,) before the step and in it."""
        law = self.law
        w = data.weight_a_row(self.weights(t), len(self.nodes), f"{self.subject}: weights at t = {t:.6g}")
        if law is None:
            return w
        added = self._asked("law of friction", law.weights, t, (p, past, slip))
        lawful = (added >= 0) & (added < np.inf)
        if not lawful.all():
            i = int(np.argmin(lawful))
            raise SceneError(
                f"{self.subject}: found the weight {added[i]:.6g} at node {self.nodes[i]} and t = {t:.6g}, where slip "
                f"is {past[i]:.6g} before the step and {slip[i]:.6g} in it; laws of friction give finite weights >= 0."
            )
        return w + added

    def slope_under(self, t: float, p: Floats, past: Floats) -> Floats:
        """The derivative (m,) of the weights by the normal forces; zero if it is not known."""
        if self.law is None or self.law.slope is None:
            return np.zeros(len(self.nodes))
        return self._asked("slope", self.law.slope, t, (p, past))

    def _asked(self, name: str, function: Callable[..., object], t: float, under: Sequence[Floats]) -> Floats:
        """Return the values (m,) of a function of the law, which is told what the law says that it reads only."""
        law, none, (p, *slips) = self.law, np.zeros(0), under
        assert law is not None
        told = (t, p if law.pressed else none, *(slip if law.slips else none for slip in slips))
        given = f"f(t, p, past{', slip' * (len(slips) > 1)}) with t = {t:.6g}"
        wanted = "take the values of all rows at once and return one number for each"
        rule = "; p is empty without pressed=True, slips are without slips=True"
        raw = call_function(function, told, f"{self.subject}: its {name} failed when called as {given}", wanted + rule)
        return data.number_a_row(raw, len(self.nodes), f"{self.subject}: {name}{rule}")

    @property
    def softening(self) -> Floats:
        """The largest rate (m,) at which weights fall with slip; zero without a law."""
        law = self.law
        if law is None:
            return np.zeros(len(self.nodes))
        rate = data.number_a_row(law.softening, len(self.nodes), f"{self.subject}: softening")
        if law.pressed or not ((rate >= 0) & (rate < np.inf)).all():
            raise SceneError(
                f"{self.subject}: found softening {rate.max():.6g} and pressed={law.pressed}; it is a finite number "
                ">= 0 of a law that reads no normal forces, or None if it is not known."
            )
        return rate


@dataclass(frozen=True)
class Obstacle(ContactSurface):
    """Limits n . u(node_i) <= gap_i(t), one row a node and distinct normal; squared penalties if compliant."""

    gap: Callable[[float], Floats]  #: t -> (m,) distance to the obstacle along the outward normal.
    compliance: Floats  #: (m,) depth per nodal force; 0 where the obstacle is rigid.


@dataclass(frozen=True)
class Material:
    """Hooke's law on the cells of a material; zero on all others."""

    subject: str
    moduli: Floats
    """(2, n_cells) Lame's lam, already reduced in plane stress, and mu; or (6, n_cells), in space (21, n_cells), the
    upper triangle of the elastic matrix row by row: see :mod:`vemcvx.vem.tensors`"""
    thermal_stress_moduli: Floats
    """(n_cells, components) stress that holds back a unit strain in all directions of space, with a minus sign"""
    plane: str  #: plane "strain", as in space, or "stress"; one for the whole body
    cells: Bools | None = None  #: (n_cells,) which cells; None means all
    out_of_plane: Floats | None = None
    """(n_cells, 4) stress zz across the plane of unit strains e_xx, e_yy, 2 e_xy, and what holds back a unit
    eigenstrain there, with a minus sign; zero in plane stress, None where the law does not say, and in space"""
    stabilisation: Stabilisation | None = None  #: S_K; None means "shear", :func:`vemcvx.vem.softest_shear`
    at: Callable[[Floats, Ints], tuple[Floats, Floats]] | None = None
    """points (k, dim) of cells (k,) -> the upper triangle of the elastic matrix and the thermal stress moduli there;
    None if they are constant in every cell"""

    def elastic(self, dim: int) -> Floats:
        """(n_cells, 3, 3), in space (n_cells, 6, 6), stresses from strains."""
        return vem.elastic_matrix(self.moduli, dim)

    def stabilised(self, dim: int) -> Stabilisation:
        """S_K, of the softest shear where the material does not say."""
        return self.stabilisation or vem.VertexWeights(vem.softest_shear(self.elastic(dim)))

    def stiffness(self, space: Space) -> vem.SumOverCells:
        """The matrix of a^h of these cells: their resistance to strains."""
        return vem.stiffness_of(space, self.moduli, self.stabilised(space.dim))

    def missed(self, space: Space, u: Floats) -> Floats:
        """S_K(u - Pi u, u - Pi u) of each cell, (n_cells,), of nodal displacements (n_nodes, dim)."""
        return vem.missed_energies(space, self.stabilised(space.dim), self.elastic(space.dim), u)


@dataclass(frozen=True)
class Eigenstrain:
    """An isotropic strain that is free of stress; the material of a cell says what blocking it costs."""

    subject: str
    value: Callable[[float], Floats]  #: t -> (n_cells,)
    at: Callable[[Floats, Ints, float], Floats] | None = None
    """points (k, dim) of cells (k,) and t -> (k,), as of a material"""


@dataclass(frozen=True)
class InitialStress:
    """A stress that is there without strain."""

    subject: str
    value: Callable[[float], Floats]  #: t -> (n_cells, components): xx, yy, xy, in space xx, yy, zz, xy, yz, xz
    at: Callable[[Floats, Ints, float], Floats] | None = None
    """points (k, dim) of cells (k,) and t -> (k, components), as of a material"""


@dataclass(frozen=True)
class Contribution:
    """The sum of what an effect adds; every field may be absent."""

    stiffness: sp.csr_matrix | None = None
    """of springs to the ground: motions that these feel are held; or of a material, where its moduli do not say all"""
    material: Material | None = None
    loads: tuple[Load, ...] = ()
    supports: tuple[Support, ...] = ()
    frictions: tuple[Friction, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    surfaces: tuple[ContactSurface, ...] = ()  #: where contact is reported besides frictions and obstacles
    eigenstrains: tuple[Eigenstrain, ...] = ()
    initial_stresses: tuple[InitialStress, ...] = ()
    viscosity: sp.csr_matrix | None = None  #: matrix of b^h, stress in proportion to the rate of strain
    curves: tuple[str, ...] = ()  #: subjects whose conditions on normals hold along curves


class Effect(ABC):
    """One piece of physics of a scene, free of any mesh.

    Effects are frozen: names of boundaries, constants and callables, of which arrays are copied. They know nothing of
    each other, of solvers or of time stepping, and the order in which a scene names them changes nothing.
    """

    def __post_init__(self) -> None:
        """Keep copies of arrays and lists."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value.copy()))
            elif type(value) is list:
                object.__setattr__(self, name, [x.copy() if isinstance(x, np.ndarray) else x for x in value])

    @abstractmethod
    def contribute(self, space: Space) -> Contribution:
        """The contribution of this effect on the mesh of `space`.

        Equal calls give equal arrays; data f(x, t) are carried along and evaluated at t_n. Effects of contact are asked
        again with planes of symmetry that supports make (`space.mirrors`), which turn normals at the ends of curves.

        Raises
        ------
        SceneError
            A boundary's name is unknown, or a datum that does not depend on time has a wrong shape, sign or value.
        """

    @property
    def _subject(self) -> str:
        """The name of the effect in messages, with that of its boundary."""
        return type(self).__name__ + (f" on {where(on)}" if (on := getattr(self, "on", None)) is not None else "")

    def _read(self, name: str, at: data.At | data.InCells, value: object = None, label: str | None = None) -> Floats:
        """Return the values of a field at places, of the shape and the sign that it declares by `data.holds`.

        A part of its value may stand for it, and another label for its name in messages.
        """
        (declared,) = (one.metadata["holds"] for one in fields(self) if one.name == name)  # type: ignore[arg-type]
        given = getattr(self, name) if value is None else value
        found: Floats = declared.values(given, at, self._subject, name, label)
        return found

    def _check_dimension(self, space: Space) -> None:
        """Raise SceneError for fields that bodies of this dimension do not have, as their metadata say."""
        for one in fields(self):  # type: ignore[arg-type]
            value = getattr(self, one.name)
            if value is not None and "in the plane" in one.metadata:
                space.require_plane(f"{self._subject}: {one.name}=", one.metadata["in the plane"])
            elif value is not None and "in space" in one.metadata and space.in_plane:
                found = f"{self._subject}: found {one.name} = {brief(value)}"
                raise SceneError(f"{found}, which belongs to bodies in space; {one.metadata['in space']}.")

    @abstractmethod
    def describe(self) -> str:
        """One line of words for `vemcvx show`."""

    def described(self, in_plane: bool) -> str:
        """Return the line for a body in the plane or in space."""
        return self.describe()


def where(on: str | Sequence[str]) -> str:
    """The boundary names of `on` in words; what is no name is refused later, by name, on the mesh."""
    return ", ".join(map(str, on)) if isinstance(on, Sequence) and not isinstance(on, str) else str(on)


def amount(value: object, arguments: str = "x, t") -> str:
    """A datum in words, in one line: its number, or how it varies."""
    if callable(value):
        return f"{getattr(value, '__name__', 'function')}({arguments})"
    if isinstance(value, np.ndarray) and value.size > 3:
        return f"array of shape {value.shape}"
    return str(value) if isinstance(value, (float, int, np.ndarray)) else brief(value)
