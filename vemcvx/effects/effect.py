"""The base class of effects, and the contributions of effects to the assembled problem.

A displacement is a vector u of n_u = n_nodes * dim numbers. Component j at node i is u[i * dim + j].
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
    """A force that depends linearly on a datum: the nodal force at time t is matrix @ value(points, t).

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
    cells: Ints | None = None  # (q,) cells of the points, for loads inside the body
    edges: Ints | None = None  # (q, 2) edges of the points, for loads on the boundary
    times: tuple[float, ...] = ()  # the instants of the run; empty if unknown
    between: bool = False  # True if two bodies exert the load on each other

    @property
    def is_scalar(self) -> bool:
        """True if the datum is a number, False if it is a vector."""
        return self.matrix.shape[1] == len(self.points)

    def at(self, x: Floats, t: float) -> Floats:
        """Return the datum at points x (k, dim) and time t."""
        return data.At(x, t).read(self.value, self.subject, "number" if self.is_scalar else "vector")

    def in_cells(self, x: Floats, owner: Ints, t: float) -> Floats:
        """Return the datum at points x, or zero in cells without load."""
        loaded = np.isin(owner, () if self.cells is None else self.cells)
        return (self.at(x, t).T * loaded).T

    def vector(self, t: float) -> Floats:
        """Return the nodal force (n_u,) at time t."""
        return self.matrix @ self.values(t)

    @cached_property
    def values(self) -> Callable[[float], Floats]:
        """The datum at all points, as a function of time."""
        return drop_tails(lambda t: self.at(self.points, t).ravel(), self.times)

    @cached_property
    def borne(self) -> Floats:
        """The forces (q, dim) at the points if all components of the datum are 1."""
        dim, nodes = self.points.shape[1], np.ones(self.matrix.shape[0] // self.points.shape[1])
        # Basis functions sum to 1, so nodal forces along an axis add up to the total force.
        total = np.stack([nodes @ self.matrix[a::dim] for a in range(dim)], axis=1)
        return total if self.is_scalar else total.reshape(-1, dim, dim).sum(axis=1)

    @property
    def measures(self) -> Floats:
        """The quadrature weights (q,): lengths, areas or volumes."""
        return np.linalg.norm(self.borne, axis=1) if self.is_scalar else self.borne[:, 0]

    def forces(self, t: float) -> Floats:
        """Return the forces (q, dim) at the points at time t."""
        return self.borne * self.values(t).reshape(len(self.points), -1)


@dataclass(frozen=True)
class Support:
    """Prescribed components of displacements: directions . u(node) = value(t).

    Attributes
    ----------
    subject : str
        The name of the effect in messages.
    nodes : (m,) array
        Node numbers. A node with several directions occurs several times.
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
    contact: bool = False  # True for bilateral contact
    partners: Ints | None = None  # (m,) opposite nodes at interfaces, else -1
    patterns: Floats | None = None  # (m, k) independent columns, added to value(t) with unknown factors


@dataclass(frozen=True)
class Ground:
    """The displacement of the counter-surface at points (q, dim). Normal components have no effect."""

    subject: str
    points: Floats
    value: data.Datum

    def __post_init__(self) -> None:
        if not callable(self.value):
            self.vector(0.0)
            raise SceneError(
                f"{self.subject}: found {brief(self.value)}; it is the displacement of the ground, and a constant "
                "causes no motion. Give a function of time, such as lambda x, t: (0.5 * t, 0.0), or a Tabulated."
            )

    def vector(self, t: float) -> Floats:
        """Return the displacements (q, dim) at time t."""
        return data.vector(self.value, self.points, t, self.subject)


@dataclass(frozen=True)
class ContactSurface:
    """A contact surface with one row per node and normal."""

    subject: str  # the name of the effect in messages
    nodes: Ints  # (m,)
    normals: Floats  # (m, dim) outward unit normals
    lengths: Floats  # (m,) integrals of basis functions over edges or faces with this normal
    ends: EdgeEnds | None = field(default=None, kw_only=True)  # the edges at each row; None if unknown
    partners: Ints | None = field(default=None, kw_only=True)  # (m,) opposite nodes at interfaces, else -1

    @classmethod
    def from_rows(cls, rows: BoundaryRows, subject: str = "", **more: Any) -> Self:
        """Return the surface of boundary rows, with further fields from `more`."""
        own = subject, rows.nodes, rows.normals, rows.lengths
        return cls(*own, ends=rows.ends, partners=rows.partners, **more)


@dataclass(frozen=True)
class Friction(ContactSurface):
    """Friction terms w_i(t) |(I - n n')(v - v_prev)(node_i)| at nodes with normals n.

    Here v is u minus the displacement of the ground, and v_prev is v at the previous instant.

    Attributes
    ----------
    weights : callable t -> (m,)
        The weights w_i are the largest friction forces, such as bound * lengths. They are infinite at nodes that
        always stick.
    in_the_air : bool
        True to warn where friction acts although one-sided contact is open.
    ground : Ground, optional
        The displacement of the obstacle, if it moves.
    law : Law, optional
        Additional weights, which depend on contact forces and slip.
    directions : (m, dim) array, optional
        Unit vectors e_i. With `directions`, the terms are w_i |e_i . (v - v_prev)(node_i)|.

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
    bond: bool = False  # True for terms that are not reported as contact

    def __post_init__(self) -> None:
        given, shape = self.directions, self.normals.shape
        if given is not None and (np.shape(given) != shape or np.abs(np.linalg.norm(given, axis=1) - 1).max() > SAME):
            raise SceneError(
                f"{self.subject}: found directions of shape {np.shape(given)} for normals of shape {shape}; wanted "
                "one unit vector per row."
            )

    @property
    def in_plane(self) -> bool:
        """True for a body in the plane."""
        return tangents_of(self.normals[:1]).shape[1] == 1

    @property
    def across(self) -> Floats:
        """The vectors (m, dim) that determine tangents."""
        if self.directions is None:
            return self.normals
        return self.directions[:, ::-1] * (1.0, -1.0) + 0.0 if self.in_plane else self.directions

    @property
    def tangents(self) -> Floats:
        """The vectors (m, dim - 1, dim) along which slip is measured."""
        if self.directions is None or self.in_plane:
            return tangents_of(self.across)
        return np.stack([self.directions, 0.0 * self.directions], axis=1)

    def weights_under(self, t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        """Return the weights for normal forces p, past slips, and the slip of the step."""
        w = data.read_weights(self.weights(t), len(self.nodes), f"{self.subject}: weights at t = {t:.6g}")
        if self.law is None:
            return w
        return w + self._evaluate("law of friction", self.law.weights, t, (p, past, slip))

    def slope_under(self, t: float, p: Floats, past: Floats) -> Floats:
        """Return the derivatives (m,) of the weights with respect to the normal forces p."""
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
        """The largest decrease (m,) of the weights per unit of slip."""
        fall = 0.0 if self.law is None else self.law.softening
        return data.read_finite(fall, len(self.nodes), f"{self.subject}: softening")


@dataclass(frozen=True)
class Obstacle(ContactSurface):
    """Limits n . u(node_i) <= gap_i(t) at nodes with normals n. Compliant obstacles penalise the excess.

    Attributes
    ----------
    gap : callable t -> (m,)
        Distance to the obstacle along the outward normal, length.
    compliance : (m,) array
        Penetration per nodal force; 0 where the obstacle is rigid. With `rates`, velocity per nodal force.
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
    """Hooke's law in the cells of a material. Moduli are zero in other cells."""

    subject: str  # the name of the effect in messages
    # (2, n_cells) Lame's lam (reduced in plane stress) and mu, or upper triangles of elastic matrices: (6, n_cells), in
    # space (21, n_cells), in bodies of revolution (10, n_cells)
    moduli: Floats
    thermal_stress_moduli: Floats  # (n_cells, components) b: a blocked isotropic strain s causes the stress -b s
    plane: str  # "strain", "stress" or "axisymmetric", the same for all materials of a body; "strain" in space
    cells: Bools | None = None  # (n_cells,) the cells of the material; None means all
    # (n_cells, 4) rows r: the stress zz is r . (e_xx, e_yy, 2 e_xy, -s) with the strain e and the eigenstrain s. Zero
    # in plane stress; None in space, in bodies of revolution, and for laws without zz.
    out_of_plane: Floats | None = None
    stabilisation: Stabilisation | None = None  # None means "shear"
    # moduli (upper triangles) and thermal stress moduli at points of cells; None if constant in every cell
    at: Callable[[Floats, Ints], tuple[Floats, Floats]] | None = None

    def elastic(self, dim: int) -> Floats:
        """Return the elastic matrices (n_cells, 3, 3), in space (n_cells, 6, 6)."""
        return elastic_matrix(self.moduli, dim)

    def choose_stabilisation(self, dim: int) -> Stabilisation:
        """Return the stabilisation, by default "shear" with the softest shear modulus."""
        return self.stabilisation or VertexWeights(softest_shear(self.elastic(dim)))

    def stiffness(self, space: Space) -> sp.csr_matrix:
        """Return the stiffness matrix of the cells of the material."""
        return stiffness_of(space, self.moduli, self.choose_stabilisation(space.dim))

    def stabilisation_energies(self, space: Space, u: Floats) -> Floats:
        """Return the stabilisation energies (n_cells,) of displacements u (n_nodes, dim)."""
        return remainder_energies(space, self.choose_stabilisation(space.dim), self.elastic(space.dim), u)


@dataclass(frozen=True)
class Eigenstrain:
    """An isotropic strain that causes stress only where it is blocked."""

    subject: str
    value: Callable[[float], Floats]  # t -> (n_cells,)
    at: Callable[[Floats, Ints, float], Floats] | None = None  # at points of cells; None if constant in every cell


@dataclass(frozen=True)
class InitialStress:
    """A stress at zero strain, force per area, positive in tension. `component_names` gives the order of components."""

    subject: str
    value: Callable[[float], Floats]  # t -> (n_cells, components)
    at: Callable[[Floats, Ints, float], Floats] | None = None  # at points of cells; None if constant in every cell


@dataclass(frozen=True)
class Contribution:
    """The contribution of one effect to the problem. Every field is optional.

    Attributes
    ----------
    stiffness : (n_u, n_u) sparse matrix, optional
        Stiffness of springs to the ground, or of a material whose stiffness does not follow from moduli.
    loads, supports, frictions, obstacles : tuple
        Objects of the classes `Load`, `Support`, `Friction` and `Obstacle`.
    surfaces : tuple of ContactSurface
        Further surfaces on which contact is reported.
    viscosity : (n_u, n_u) sparse matrix, optional
        Viscous nodal forces per nodal velocity.
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

    An effect is a frozen dataclass of names, constants and functions. Arrays are copied. The order of effects in a
    scene does not change results.

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
        """Return the contribution of this effect on the mesh of `space`. Repeated calls return equal arrays."""

    @property
    def _subject(self) -> str:
        return type(self).__name__ + (f" on {where(on)}" if (on := getattr(self, "on", None)) is not None else "")

    def _read(self, name: str, at: data.At | data.InCells, value: Any = None, label: str | None = None) -> Floats:
        """Return the checked values of a field at points or in cells."""
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
        """Return `describe()` for a body in the plane or in space."""
        return self.describe()


def where(on: str | Sequence[str]) -> str:
    """Return names, separated by commas."""
    return ", ".join(map(str, on)) if isinstance(on, Sequence) and not isinstance(on, str) else str(on)


def amount(value: object, arguments: str = "x, t") -> str:
    """Return a description of a datum in one line."""
    if callable(value):
        return f"{getattr(value, '__name__', 'function')}({arguments})"
    if isinstance(value, np.ndarray) and value.size > 3:
        return f"array of shape {value.shape}"
    return str(value) if isinstance(value, (float, int, np.ndarray)) else brief(value)
