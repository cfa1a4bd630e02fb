"""The base class of effects, and the contributions of effects to the assembled problem.

A displacement is a vector u of n_nodes * dim numbers: u[i * dim + j] is component j at node i. Users may define effects
with contributions of the kinds in this module.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief, call_function, drop_tails, read_only
from vemcvx.base.errors import SceneError
from vemcvx.base.weight_law import Law
from vemcvx.effects import data
from vemcvx.vem import BoundaryRows, Space, Stabilisation
from vemcvx.vem.boundary import EdgeEnds
from vemcvx.vem.elasticity import softest_shear, stiffness_of
from vemcvx.vem.projection import tangents_of
from vemcvx.vem.stabilisation import VertexWeights, remainder_energies
from vemcvx.vem.tensors import elastic_matrix


@dataclass(frozen=True)
class Load:
    """A force that depends linearly on a datum: the nodal force at t is matrix @ value(points, t).

    Attributes
    ----------
    subject : str
        The name of the effect in messages.
    points : (q, dim) array
        Quadrature points of the datum.
    matrix : (n_u, q * dim) sparse matrix
        Quadrature weights times test functions; (n_u, q) for a scalar datum.
    value : constant, or callable f(x, t)
        The datum.

    Examples
    --------
    >>> space = vx.vem.Space(vx.meshes.squares(1))
    >>> (load,) = vx.Traction([2.0, 0.0], on="right").contribute(space).loads
    >>> print(load.vector(t=0.0).reshape(-1, 2).sum(axis=0).round(9))
    [2. 0.]
    """

    subject: str
    points: Floats
    matrix: sp.csr_matrix
    value: data.Datum
    cells: Ints | None = None  # (q,) the cells of the points, if the load acts inside the body
    edges: Ints | None = None  # (q, 2) the edges of the points, if the load acts on the boundary
    times: tuple[float, ...] = ()  # the instants of the run; empty if unknown
    between: bool = False  # True if two bodies exert the load on each other

    @property
    def is_scalar(self) -> bool:
        """True if the datum is a number, and not a vector."""
        return self.matrix.shape[1] == len(self.points)

    def at(self, x: Floats, t: float) -> Floats:
        """Return the datum, (k,) or (k, dim), at points x (k, dim) and time t."""
        return data.At(x, t).read(self.value, self.subject, "number" if self.is_scalar else "vector")

    def in_cells(self, x: Floats, owner: Ints, t: float) -> Floats:
        """Return the datum, (k,) or (k, dim), at points x of the cells `owner` (k,); zero in cells without the load."""
        loaded = np.isin(owner, () if self.cells is None else self.cells)
        return (self.at(x, t).T * loaded).T

    def vector(self, t: float) -> Floats:
        """Return the nodal force (n_u,) at time t."""
        return self.matrix @ self.values(t)

    @cached_property
    def values(self) -> Callable[[float], Floats]:
        """The function t -> values (q * dim,), or (q,), of the datum at all points."""
        return drop_tails(lambda t: self.at(self.points, t).ravel(), self.times)

    @cached_property
    def borne(self) -> Floats:
        """The force (q, dim) that each point adds to the load if all components of the datum are 1."""
        dim, nodes = self.points.shape[1], np.ones(self.matrix.shape[0] // self.points.shape[1])
        # Basis functions sum to 1, so nodal forces along an axis add up to the total force along this axis.
        total = np.stack([nodes @ self.matrix[a::dim] for a in range(dim)], axis=1)
        return total if self.is_scalar else total.reshape(-1, dim, dim).sum(axis=1)

    @property
    def measures(self) -> Floats:
        """The quadrature weights (q,) of the points: length, area or volume."""
        return np.linalg.norm(self.borne, axis=1) if self.is_scalar else self.borne[:, 0]

    def forces(self, t: float) -> Floats:
        """Return the forces (q, dim) of the points at time t."""
        return self.borne * self.values(t).reshape(len(self.points), -1)


@dataclass(frozen=True)
class Support:
    """Prescribed components of displacements: directions . u(node) = value(t).

    Attributes
    ----------
    subject : str
        The name of the effect in messages.
    nodes : (m,) array
        Node numbers; a node may have several rows, one per direction.
    directions : (m, dim) array
        Unit vectors.
    points : (m, dim) array
        Positions of the nodes.
    value : callable t -> (m,), optional
        Prescribed components, length; None means zero at all times.

    Examples
    --------
    >>> space = vx.vem.Space(vx.meshes.squares(1))
    >>> (support,) = vx.Clamp(on="left").contribute(space).supports
    >>> print(support.nodes, support.directions[0])
    [0 0 2 2] [1. 0.]
    """

    subject: str
    nodes: Ints
    directions: Floats
    points: Floats
    value: Callable[[float], Floats] | None = None
    contact: bool = False  # True for bilateral contact: other supports in the same direction take precedence
    partners: Ints | None = None  # (m,) opposite nodes, if u(node) - u(partner) is prescribed; else -1
    patterns: Floats | None = None  # (m, k) independent columns: patterns @ c is added to value(t), with unknown c (k,)


@dataclass(frozen=True)
class Ground:
    """The displacement of the counter-surface at points (q, dim); normal components have no effect."""

    subject: str
    points: Floats
    value: data.Datum

    def __post_init__(self) -> None:
        if not callable(self.value):
            self.vector(0.0)
            raise SceneError(
                f"{self.subject}: found {brief(self.value)}; it is the displacement of the ground, and a constant "
                "moves nothing. Give a function of time, such as lambda x, t: (0.5 * t, 0.0), or a Tabulated."
            )

    def vector(self, t: float) -> Floats:
        """Return the displacements (q, dim) at time t."""
        return data.vector(self.value, self.points, t, self.subject)


@dataclass(frozen=True)
class ContactSurface:
    """A surface of contact, one row per node and distinct normal."""

    subject: str  # the name of the effect in messages
    nodes: Ints  # (m,)
    normals: Floats  # (m, dim) outward unit normals
    lengths: Floats  # (m,) integrals of basis functions over the edges, in space faces, with this normal
    ends: EdgeEnds | None = field(default=None, kw_only=True)  # the edges at each row; None if unknown
    partners: Ints | None = field(default=None, kw_only=True)  # (m,) opposite nodes at interfaces, else -1

    @classmethod
    def from_rows(cls, rows: BoundaryRows, subject: str = "", **more: Any) -> Self:
        """Return an instance with the rows of a part of the boundary; `more` has further fields."""
        own = subject, rows.nodes, rows.normals, rows.lengths
        return cls(*own, ends=rows.ends, partners=rows.partners, **more)


@dataclass(frozen=True)
class Friction(ContactSurface):
    """Norm terms w_i(t) |(I - n n')(v - v_prev)(node_i)|, one per row.

    Here v is u minus the displacement of the ground, and v_prev is v at the instant before.

    Attributes
    ----------
    weights : callable t -> (m,)
        The largest friction forces, such as bound * lengths; infinite at nodes that always stick.
    in_the_air : bool
        True if a warning is issued where friction acts although one-sided contact is open.
    ground : Ground, optional
        The displacement of the obstacle, if it moves.
    law : Law, optional
        Additional weights, which depend on contact forces and slip.
    directions : (m, dim) array, optional
        Unit vectors e_i: terms are w_i |e_i . (v - v_prev)| instead.

    Examples
    --------
    >>> space = vx.vem.Space(vx.meshes.squares(1))
    >>> (friction,) = vx.TrescaFriction(4.0, on="bottom").contribute(space).frictions
    >>> print(friction.weights(0.0))
    [2. 2.]
    """

    weights: Callable[[float], Floats] = lambda t: np.zeros(())
    in_the_air: bool = False
    ground: Ground | None = None
    law: Law | None = None
    directions: Floats | None = None
    bond: bool = False  # True for a term that locks the amplitude of a support; it is not reported as contact

    def __post_init__(self) -> None:
        given, shape = self.directions, self.normals.shape
        if given is not None and (np.shape(given) != shape or np.abs(np.linalg.norm(given, axis=1) - 1).max() > SAME):
            raise SceneError(
                f"{self.subject}: found directions of shape {np.shape(given)} for normals of shape {shape}; rows along "
                "directions have one unit vector per row."
            )

    @property
    def in_plane(self) -> bool:
        """True if the normals are those of a body in the plane."""
        return tangents_of(self.normals[:1]).shape[1] == 1

    @property
    def across(self) -> Floats:
        """The normals (m, dim); `directions` replace them, in the plane after a rotation by -90 degrees."""
        if self.directions is None:
            return self.normals
        return self.directions[:, ::-1] * (1.0, -1.0) + 0.0 if self.in_plane else self.directions

    @property
    def tangents(self) -> Floats:
        """The vectors (m, dim - 1, dim) along which slip is measured; with `directions` in space, the second is 0."""
        if self.directions is None or self.in_plane:
            return tangents_of(self.across)
        return np.stack([self.directions, 0.0 * self.directions], axis=1)

    def weights_under(self, t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        """Return the weights for normal forces p, slips `past` before the step, and `slip` in the step; all (m,)."""
        w = data.read_weights(self.weights(t), len(self.nodes), f"{self.subject}: weights at t = {t:.6g}")
        if self.law is None:
            return w
        return w + self._evaluate("law of friction", self.law.weights, t, (p, past, slip))

    def slope_under(self, t: float, p: Floats, past: Floats) -> Floats:
        """Return the derivatives (m,) of the weights with respect to normal forces; zero if the law has no slope."""
        if self.law is None or self.law.slope is None:
            return np.zeros(len(self.nodes))
        return self._evaluate("slope", self.law.slope, t, (p, past))

    def _evaluate(self, name: str, function: Callable[..., object], t: float, arguments: Sequence[Floats]) -> Floats:
        law, none, (p, *slips) = self.law, np.zeros(0), arguments
        assert law is not None
        given = (t, p if law.pressed else none, *(slip if law.slips else none for slip in slips))
        call = f"f(t, p, past{', slip' * (len(slips) > 1)}) with t = {t:.6g}"
        wanted = "take the values of all rows at once and return one number for each"
        rule = "; p is empty without pressed=True, past and slip are empty without slips=True"
        raw = call_function(function, given, f"{self.subject}: its {name} failed when called as {call}", wanted + rule)
        return data.read_finite(raw, len(self.nodes), f"{self.subject}: {name}{rule}")

    @property
    def softening(self) -> Floats:
        """The largest decrease (m,) of weights per slip; zero without a law."""
        fall = 0.0 if self.law is None else self.law.softening
        return data.read_finite(fall, len(self.nodes), f"{self.subject}: softening")


@dataclass(frozen=True)
class Obstacle(ContactSurface):
    """Limits n . u(node_i) <= gap_i(t), one per row; compliant obstacles penalise the excess instead.

    Attributes
    ----------
    gap : callable t -> (m,)
        Distance to the obstacle along the outward normal, length.
    compliance : (m,) array
        Depth per nodal force; 0 where the obstacle is rigid. With `rates`, velocity per nodal force.
    rates : bool
        True for limits on velocities: n . (u - u_prev) <= gap - gap_prev in each step.

    Examples
    --------
    >>> space = vx.vem.Space(vx.meshes.squares(1))
    >>> (obstacle,) = vx.UnilateralContact(on="bottom", gap=0.1).contribute(space).obstacles
    >>> print(obstacle.gap(0.0), obstacle.compliance)
    [0.1 0.1] [0. 0.]
    """

    gap: Callable[[float], Floats]
    compliance: Floats
    rates: bool = field(default=False, kw_only=True)


@dataclass(frozen=True)
class Material:
    """Hooke's law on the cells of a material; zero on all other cells."""

    subject: str  # the name of the effect in messages
    # (2, n_cells) Lame's lam (reduced in plane stress) and mu; or the upper triangle of the elastic matrix, row by row:
    # (6, n_cells), in space (21, n_cells), in bodies of revolution (10, n_cells).
    moduli: Floats
    thermal_stress_moduli: Floats  # (n_cells, components) b, if a blocked isotropic strain s causes the stress -b s
    plane: str  # "strain", "stress" or "axisymmetric", the same for all materials of a body; "strain" in space
    cells: Bools | None = None  # (n_cells,) the cells of the material; None means all
    # (n_cells, 4) a row r for each cell: the stress zz is r . (e_xx, e_yy, 2 e_xy, -s) with the eigenstrain s. Zero in
    # plane stress; None in space, in bodies of revolution, and if the law does not define zz.
    out_of_plane: Floats | None = None
    stabilisation: Stabilisation | None = None  # S_K; None means "shear"
    # (x, cells) -> moduli (the upper triangle) and thermal stress moduli at points x; None if constant in every cell.
    at: Callable[[Floats, Ints], tuple[Floats, Floats]] | None = None

    def elastic(self, dim: int) -> Floats:
        """Return the elastic matrices (n_cells, 3, 3), in space (n_cells, 6, 6)."""
        return elastic_matrix(self.moduli, dim)

    def choose_stabilisation(self, dim: int) -> Stabilisation:
        """Return S_K; if the material has none, the stabilisation "shear" with the softest shear modulus."""
        return self.stabilisation or VertexWeights(softest_shear(self.elastic(dim)))

    def stiffness(self, space: Space) -> sp.csr_matrix:
        """Return the stiffness matrix of these cells."""
        return stiffness_of(space, self.moduli, self.choose_stabilisation(space.dim))

    def stabilisation_energies(self, space: Space, u: Floats) -> Floats:
        """Return S_K(u - Pi u, u - Pi u) of every cell, (n_cells,), for displacements u (n_nodes, dim)."""
        return remainder_energies(space, self.choose_stabilisation(space.dim), self.elastic(space.dim), u)


@dataclass(frozen=True)
class Eigenstrain:
    """An isotropic strain that causes stress only where it is blocked."""

    subject: str
    value: Callable[[float], Floats]  # t -> (n_cells,)
    at: Callable[[Floats, Ints, float], Floats] | None = None  # at points of cells; None if constant in every cell


@dataclass(frozen=True)
class InitialStress:
    """A stress at zero strain, force per area, tension positive; `component_names` gives the order of components."""

    subject: str
    value: Callable[[float], Floats]  # t -> (n_cells, components)
    at: Callable[[Floats, Ints, float], Floats] | None = None  # at points of cells; None if constant in every cell


@dataclass(frozen=True)
class Contribution:
    """The contribution of one effect to the problem; every field is optional.

    Attributes
    ----------
    stiffness : (n_u, n_u) sparse matrix, optional
        Stiffness of springs to the ground, or of a material whose stiffness does not follow from its moduli.
    loads, supports, frictions, obstacles : tuple
        Objects of the class in the singular, such as `Load`.
    surfaces : tuple of ContactSurface
        Surfaces on which contact is reported, besides those of frictions and obstacles.
    viscosity : (n_u, n_u) sparse matrix, optional
        Nodal forces per nodal velocity, for stress proportional to the strain rate.
    curves : tuple of str
        Names of effects with conditions along the normals of a curved boundary.

    Examples
    --------
    >>> contribution = vx.BilateralContact(on="bottom").contribute(vx.vem.Space(vx.meshes.squares(1)))
    >>> len(contribution.supports), len(contribution.surfaces), contribution.loads
    (1, 1, ())
    """

    stiffness: sp.csr_matrix | None = None
    material: Material | None = None
    loads: tuple[Load, ...] = ()
    supports: tuple[Support, ...] = ()
    frictions: tuple[Friction, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    surfaces: tuple[ContactSurface, ...] = ()
    eigenstrains: tuple[Eigenstrain, ...] = ()
    initial_stresses: tuple[InitialStress, ...] = ()
    viscosity: sp.csr_matrix | None = None
    curves: tuple[str, ...] = ()


class Effect(ABC):
    """One piece of physics of a scene, independent of the mesh.

    An effect is a frozen dataclass of names of boundaries, constants and functions; arrays are copied. Effects do not
    depend on each other, on solvers or on time stepping, and their order in a scene changes nothing.

    Examples
    --------
    >>> isinstance(vx.Clamp(on="left"), vx.effects.Effect)
    True
    >>> print(vx.Clamp(on="left").describe())
    Clamp: u = 0 on left
    """

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value.copy()))
            elif type(value) is list:
                object.__setattr__(self, name, [x.copy() if isinstance(x, np.ndarray) else x for x in value])

    @abstractmethod
    def contribute(self, space: Space) -> Contribution:
        """Return the contribution of this effect on the mesh of `space`.

        Equal calls must give equal arrays. Data f(x, t) stay functions, which are evaluated at the instants of a run.
        """

    @property
    def _subject(self) -> str:
        return type(self).__name__ + (f" on {where(on)}" if (on := getattr(self, "on", None)) is not None else "")

    def _read(self, name: str, at: data.At | data.InCells, value: Any = None, label: str | None = None) -> Floats:
        """Return the values of a field at points or cells, checked by the rule of the field (`data.holds`)."""
        declared = {one.name: one.metadata for one in fields(self)}[name]  # type: ignore[arg-type]
        found = at.read(getattr(self, name) if value is None else value, f"{self._subject}: {name}")
        sign = declared["sign"]
        if isinstance(at, data.InCells) and at.inside is not None:
            found = np.where(at.inside, found, 1.0 if sign else 0.0)
        lawful = {"> 0": found > 0, ">= 0": found >= 0}.get(sign, np.full(len(found), True))
        data.require(lawful, found, at, f"{self._subject}: found {label or name}", declared["rule"])
        return found

    @abstractmethod
    def describe(self) -> str:
        """Return a description in one line, for `vemcvx show`."""

    def describe_body(self, in_plane: bool) -> str:
        """Return the line of `describe` with the defaults for a body in the plane, or for a body in space."""
        return self.describe()


def where(on: str | Sequence[str]) -> str:
    """Return the boundary names of `on` in words; unknown names are refused later, on the mesh."""
    return ", ".join(map(str, on)) if isinstance(on, Sequence) and not isinstance(on, str) else str(on)


def amount(value: object, arguments: str = "x, t") -> str:
    """Return a description of a datum in one line: its number, or the name of its function."""
    if callable(value):
        return f"{getattr(value, '__name__', 'function')}({arguments})"
    if isinstance(value, np.ndarray) and value.size > 3:
        return f"array of shape {value.shape}"
    return str(value) if isinstance(value, (float, int, np.ndarray)) else brief(value)
