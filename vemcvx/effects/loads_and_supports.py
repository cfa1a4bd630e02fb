"""Loads and supports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats, Ints, as_real_array, as_shaped_array, brief, one_point
from vemcvx.base.errors import SceneError
from vemcvx.effects import data
from vemcvx.effects.effect import Contribution, Effect, Friction, Load, Support, amount, where
from vemcvx.effects.materials import cells_of, nodes_of
from vemcvx.vem import Space, edge_load
from vemcvx.vem.boundary import EdgeEnds, Part
from vemcvx.vem.elasticity import rigid_modes
from vemcvx.vem.loads import cell_load


@dataclass(frozen=True)
class Traction(Effect):
    """Surface force f per length (in space: per area), with the work int f . v ds on a displacement v.

    Parameters
    ----------
    force : (dim,) constant, or callable f(x, t) -> (m, dim)
        Cartesian components, force per length and unit thickness (in space per area). The load is exact for affine f.
    on : str or sequence of str
        Boundary names.

    Examples
    --------
    >>> constant = vx.Traction([1.0, 0.0], on="right")
    >>> ramp = vx.Traction(lambda x, t: np.column_stack([x[:, 1] * t, 0.0 * x[:, 1]]), on="right")
    """

    force: data.Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "Traction")
        points, matrix, sides = edge_load(space, part)
        return Contribution(loads=(Load(self._subject, points, matrix, self.force, edges=part.sides[sides]),))

    def describe(self) -> str:
        return f"Traction: {amount(self.force)} on {where(self.on)}"


@dataclass(frozen=True)
class Pressure(Effect):
    """Pressure on a part of the boundary: the load -int p n . v ds, exact for affine p.

    The pressure does not follow the body: n is the normal of the undeformed boundary (small displacements).

    Parameters
    ----------
    value : number, or callable f(x, t) -> (m,)
        p, force per length (and unit thickness), in space per area. Compression is positive.
    on : str or sequence of str
        Boundary names. At an interface (a crack or a joint filled with fluid), the pressure pushes both bodies apart,
        whether they touch or not.

    Examples
    --------
    >>> water = vx.Pressure(lambda x, t: 9.81 * (1.0 - x[:, 1]), on="left")
    """

    value: data.Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        loads = []
        for part in space.both_sides(self.on, "Pressure"):
            points, matrix, sides = edge_load(space, part)
            inward = sp.csr_matrix(sp.block_diag(-part.normals[sides][:, :, None]))
            loads.append(Load(self._subject, points, matrix @ inward, self.value, edges=part.sides[sides]))
        return Contribution(loads=tuple(loads))

    def describe(self) -> str:
        return f"Pressure: {amount(self.value)} on {where(self.on)}"


@dataclass(frozen=True)
class BodyForce(Effect):
    """A force f per area (in space: per volume), with the work int f . v_hat on a displacement v.

    In each cell, v_hat is the mean of v at the vertices (Feng, Han and Huang, before (3.14)).

    Parameters
    ----------
    force : (dim,) constant, or callable f(x, t) -> (m, dim)
        Cartesian components, force per area and unit thickness (in space per volume).
    on : str or sequence of str, optional
        Names of cell data, such as bodies. The force acts where one of these data is nonzero; by default everywhere.

    Examples
    --------
    >>> gravity = vx.BodyForce([0.0, -7850 * 9.81])
    """

    force: data.Datum
    on: str | Sequence[str] | None = None

    def contribute(self, space: Space) -> Contribution:
        points, matrix, cells = cell_load(space)
        if self.on is not None:
            some = np.flatnonzero(cells_of(space, self.on, "BodyForce")[cells])
            entries = (some[:, None] * space.dim + np.arange(space.dim)).ravel()
            points, matrix, cells = points[some], sp.csr_matrix(matrix[:, entries]), cells[some]
        return Contribution(loads=(Load(self._subject, points, matrix, self.force, cells),))

    def describe(self) -> str:
        return f"BodyForce: {amount(self.force)} in {'the body' if self.on is None else where(self.on)}"


@dataclass(frozen=True)
class PointLoad(Effect):
    """A force on single nodes, per unit thickness. Under refinement, displacements at these nodes grow without bound.

    Parameters
    ----------
    force : (dim,) constant, (m, dim) array, or callable f(x, t) -> (m, dim)
        Cartesian components of the force on every point of `at`. Forces on the same point add up.
    at : (dim,) or (m, dim)
        Coordinates of nodes of the mesh.

    Examples
    --------
    >>> print(vx.PointLoad([0.0, -1.0], at=[1.0, 1.0]).describe())
    PointLoad: [0.0, -1.0] at [1.0, 1.0]
    """

    force: data.Datum
    at: ArrayLike

    def contribute(self, space: Space) -> Contribution:
        points = space.mesh.points
        nodes = self._nodes(points)
        rows = (nodes[:, None] * points.shape[1] + np.arange(points.shape[1])).ravel()
        matrix = sp.csr_matrix((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(points.size, len(rows)))
        return Contribution(loads=(Load("PointLoad", points[nodes], matrix, self.force),))

    def describe(self) -> str:
        return f"PointLoad: {amount(self.force)} at {brief(np.asarray(self.at).tolist())}"

    def _nodes(self, points: Floats) -> Ints:
        dim = points.shape[1]
        wanted = f"a point of {dim} finite coordinates, or points (m, {dim})"
        at = np.atleast_2d(as_real_array(self.at, "PointLoad: at", wanted))
        if at.ndim != 2 or at.shape[1] != dim or not len(at) or not np.isfinite(at).all():
            raise SceneError(f"PointLoad: found at = {brief(self.at)}; wanted {wanted}.")
        nodes = np.array([np.argmin(np.abs(points - place).max(axis=1)) for place in at])
        apart = np.abs(points[nodes] - at).max(axis=1)
        worst = int(np.argmax(apart))
        # A computed point may differ from its node by rounding.
        if apart[worst] > 1e-9 * np.ptp(points, axis=0).max():
            raise SceneError(
                f"PointLoad: there is no node at {at[worst]}; the nearest is node {nodes[worst]} at "
                f"{points[nodes[worst]]}. Name a node, spread the force by Traction, or mesh with a vertex there."
            )
        return nodes


@dataclass(frozen=True)
class Clamp(Effect):
    """Fixed boundary: u = 0 at all nodes of a part of the boundary, end points included.

    Parameters
    ----------
    on : str or sequence of str
        Boundary names.

    Examples
    --------
    >>> print(vx.Clamp(on=["left", "right"]).describe())
    Clamp: u = 0 on left, right
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        nodes, axes = _all_components(space.part(self.on, "Clamp").nodes, space.dim)
        return Contribution(supports=(Support("Clamp", nodes, axes, space.mesh.points[nodes]),))

    def describe(self) -> str:
        return f"Clamp: u = 0 on {where(self.on)}"


def _all_components(nodes: Ints, dim: int) -> tuple[Ints, Floats]:
    """Return all pairs of a node and an axis."""
    return np.repeat(nodes, dim), np.tile(np.eye(dim), (len(nodes), 1))


@dataclass(frozen=True)
class Symmetry(Effect):
    """Line of symmetry, or rollers: u . n = 0 on a part of the boundary, which is free to slide.

    Unlike BilateralContact, Symmetry is a support: its force is part of `history.reaction`.

    Parameters
    ----------
    on : str or sequence of str
        Boundary names.

    Examples
    --------
    >>> print(vx.Symmetry(on="left").describe())
    Symmetry: u.n = 0, free along left
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "Symmetry").node_normals
        support = Support(self._subject, rows.nodes, rows.normals, space.mesh.points[rows.nodes])
        return Contribution(supports=(support,), curves=(self._subject,) if rows.curved else ())

    def describe(self) -> str:
        return f"Symmetry: u.n = 0, free along {where(self.on)}"


@dataclass(frozen=True)
class PrescribedDisplacement(Effect):
    """Prescribed displacements of a part of the boundary: all components, or one component.

    `history.reaction` is the force that causes these displacements.

    Parameters
    ----------
    value : (dim,) constant, or callable f(x, t) -> (m, dim); with `direction`, number, or callable f(x, t) -> (m,)
        The displacement u, or its component u . direction; length.
    on : str or sequence of str
        Boundary names.
    direction : None, (dim,) vector, "normal" or "tangent"
        "normal" is outward. "tangent" is the normal rotated by +90 degrees (in the plane only). A vector is normalised.
        At a corner of the boundary, the components along both normals, or both tangents, are prescribed.

    Examples
    --------
    >>> print(vx.PrescribedDisplacement(-0.1, on="top", direction="normal").describe())
    PrescribedDisplacement: u = -0.1 along normal on top
    """

    value: data.Datum
    on: str | Sequence[str]
    direction: str | Sequence[float] | None = None

    def contribute(self, space: Space) -> Contribution:
        part, whole = space.part(self.on, "PrescribedDisplacement"), self.direction is None
        nodes, directions, cosines = self._rows(part, space)
        points = space.mesh.points[nodes]

        def value(t: float) -> Floats:
            if whole:
                return data.vector(self.value, points[:: space.dim], t, self._subject).ravel()
            return data.scalar(self.value, points, t, self._subject) / cosines

        moves = data.varies(self.value) or value(0.0).any()
        support = Support(self._subject, nodes, directions, points, value if moves else None)
        curved = isinstance(self.direction, str) and part.node_normals.curved
        return Contribution(supports=(support,), curves=(self._subject,) if curved else ())

    def describe(self) -> str:
        along = "" if self.direction is None else f" along {self.direction}"
        return f"PrescribedDisplacement: u = {amount(self.value)}{along} on {where(self.on)}"

    def _rows(self, part: Part, space: Space) -> tuple[Ints, Floats, Floats]:
        """Return nodes, directions and cosines."""
        rows, dim, found, one = part.node_normals, space.dim, f"{self._subject}: direction", np.ones(1)
        if self.direction is None:
            return *_all_components(part.nodes, dim), one
        if isinstance(self.direction, str) and self.direction == "normal":
            return rows.nodes, rows.normals, rows.cosines
        if isinstance(self.direction, str) and self.direction == "tangent":
            space.require_plane(f"{found} 'tangent'", "give a vector along the boundary")
            return rows.nodes, rows.tangents, one
        wanted = f"a nonzero vector of {dim} finite components, 'normal', 'tangent', or None (all components)"
        direction = as_real_array(self.direction, found, wanted)
        if direction.shape != (dim,) or not np.isfinite(direction).all() or not direction.any():
            raise SceneError(f"{self._subject}: found direction {brief(self.direction)}; wanted {wanted}.")
        # Divide by the largest component first: the square of 1e200 would overflow.
        direction = direction / np.abs(direction).max()
        return part.nodes, np.tile(direction / np.linalg.norm(direction), (len(part.nodes), 1)), one


@dataclass(frozen=True)
class Rigid(Effect):
    """A part of the boundary, or a whole body, that moves rigidly: translations and small rotations.

    The motion is unknown, except for components that `motion` prescribes. Other supports at nodes of the part are
    refused, unless they agree with `motion`. `history.force(Rigid)` is the sum of `force` and of the force that causes
    the prescribed motion.

    Parameters
    ----------
    on : str or sequence of str
        Boundary names, or names of bodies (cell data that are nonzero on the body).
    at : (dim,), optional
        The centre of rotation, at which `force` acts; by default the centre of the bounding box of the nodes.
    force : (dim,) constant, or callable f(x, t) -> (m, dim), optional
        Force at the centre (per unit thickness).
    moment : number, in space (3,), or callable f(x, t), optional
        Moment (per unit thickness); in the plane positive anticlockwise.
    motion : sequence of 3, in space 6, optional
        The translation of the centre (length), then the rotation (radians; in space about x, y, z). Each component
        is a number, or f(x, t) with the point x (1, dim), or None if it is free. By default all are free.

    Examples
    --------
    >>> print(vx.Rigid(on="top", force=[0.0, -10.0], motion=[0.0, None, None]).describe())
    Rigid: motion 0.0, free, free on top, under force [0.0, -10.0]
    """

    on: str | Sequence[str]
    at: ArrayLike | None = None
    force: data.Datum | None = None
    moment: data.Datum | None = None
    motion: Sequence[data.Datum | None] | None = None

    def contribute(self, space: Space) -> Contribution:
        space.refuse_revolution(self._subject)
        nodes, dim = self._nodes(space), space.dim
        x = space.mesh.points[nodes]
        middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
        at = one_point(middle if self.at is None else self.at, dim, f"{self._subject}: at")
        modes, points = rigid_modes(x - at), at[None]
        motion = self._motion(modes.shape[1])
        free = [k for k, given in enumerate(motion) if given is None]
        held = {k: given for k, given in enumerate(motion) if given is not None}

        def value(t: float) -> Floats:
            each = (data.scalar(given, points, t, f"{self._subject}: motion")[0] for given in held.values())
            moved: Floats = modes[:, list(held)] @ np.fromiter(each, float)
            return moved

        rows, axes = _all_components(nodes, dim)
        moves, patterns = data.varies(*held.values()) or value(0.0).any(), modes[:, free] if free else None
        support = Support(
            self._subject, rows, axes, space.mesh.points[rows], value if moves else None, patterns=patterns
        )
        # With T = `modes`, the nodal forces T (T'T)^{-1} (F, M) have the resultant force F and moment M.
        spread = np.zeros((space.mesh.n_nodes, dim, modes.shape[1]))
        spread[nodes] = np.linalg.pinv(modes).T.reshape(len(nodes), dim, -1)
        own = (("force", self.force, slice(dim)), ("moment", self.moment, slice(dim, None)))
        loads = [
            Load(f"{self._subject}: {name}", points, sp.csr_matrix(spread.reshape(-1, modes.shape[1])[:, some]), given)
            for name, given, some in own
            if given is not None
        ]
        return Contribution(supports=(support,), loads=tuple(loads))

    def _nodes(self, space: Space) -> Ints:
        names, mesh = [self.on] if isinstance(self.on, str) else self.on, space.mesh
        bodies = isinstance(names, Sequence) and all(isinstance(name, str) and name in mesh.cell_data for name in names)
        if not bodies or any(name in mesh.boundaries for name in names):
            return space.part(self.on, "Rigid").nodes
        return nodes_of(space, self.on, "Rigid")

    def _motion(self, count: int) -> Sequence[data.Datum | None]:
        if self.motion is None:
            return [None] * count
        if not isinstance(self.motion, Sequence) or isinstance(self.motion, str) or len(self.motion) != count:
            raise SceneError(
                f"{self._subject}: found motion = {brief(self.motion)}; wanted {count} entries, first translations and "
                "then rotations: a number or f(x, t) for a prescribed component, None for a free one."
            )
        return self.motion

    def describe(self) -> str:
        given = {"force": self.force, "moment": self.moment}
        loads = [f"{name} {amount(value)}" for name, value in given.items() if value is not None]
        free = "free" if self.motion is None else ", ".join("free" if c is None else amount(c) for c in self.motion)
        return f"Rigid: motion {free} on {where(self.on)}" + (f", under {' and '.join(loads)}" if loads else "")


@dataclass(frozen=True)
class Pretension(Effect):
    """A bolt that is tightened by a given force, and then locked.

    The interface `on` cuts the bolt. Both sides of the cut are bonded, except for a uniform jump along the mean normal.
    The jump is the shortening of the bolt. Up to t = `until`, the force pulls the sides together. Later, the jump
    is constant. `history.force` of this effect is the force on the first body at the cut: tension and shear.

    Parameters
    ----------
    on : str or sequence of str
        An interface across one bolt, made by :func:`vemcvx.meshes.cut`. Each bolt needs a separate Pretension.
    force : number, or callable f(x, t)
        The tension during tightening (per unit thickness). The point x (1, dim) is the centre of the cut.
    until : float, optional
        The last instant of tightening, one of the instants of the run. By default the bolt is never locked.

    Examples
    --------
    >>> print(vx.Pretension(on="shank|head", force=100.0, until=1.0).describe())
    Pretension: a tension 100.0 on shank|head until t = 1.0, then locked
    """

    on: str | Sequence[str]
    force: data.Datum
    until: float = np.inf

    def contribute(self, space: Space) -> Contribution:
        subject, part, dim = self._subject, space.part(self.on, "Pretension", contact=True), space.dim
        until = float(as_shaped_array(self.until, f"{subject}: until", "an instant", ()))
        rows = part.node_normals
        if (rows.partners < 0).any():
            raise SceneError(
                f"{subject}: found a boundary that is no interface. Cut the mesh of the bolt in two by vx.meshes.cut, "
                "join the parts by vx.meshes.bodies, and name the interface between the parts by on=."
            )
        normal = part.measures @ part.normals
        normal = normal / np.linalg.norm(normal)
        nodes, partners = np.unique(np.column_stack([rows.nodes, rows.partners]), axis=0).T
        held, axes = _all_components(nodes, dim)
        bond = Support(
            subject,
            held,
            axes,
            space.mesh.points[held],
            contact=True,
            partners=np.repeat(partners, dim),
            patterns=np.tile(normal, len(nodes))[:, None],
        )
        unknowns = (np.append(nodes, partners)[:, None] * dim + np.arange(dim)).ravel()
        forces = np.concatenate([np.tile(sign * normal / len(nodes), len(nodes)) for sign in (1.0, -1.0)])
        matrix = sp.csr_matrix((forces, (unknowns, np.zeros_like(unknowns))), shape=(space.n_unknowns, 1))
        middle = space.mesh.points[nodes].mean(axis=0, keepdims=True)

        def tension(x: Floats, t: float) -> Floats:
            return data.scalar(self.force, x, min(t, until), f"{subject}: force")

        first = np.flatnonzero(rows.ends.row == 0)
        # After `until`, this norm term has infinite weight, and keeps the jump constant.
        lock = Friction(
            f"{subject}: lock",
            rows.nodes[:1],
            normal[None],
            rows.lengths[:1],
            ends=EdgeEnds(rows.ends.row[first], rows.ends.beyond[first], rows.ends.lengths[first]),
            partners=rows.partners[:1],
            weights=lambda t: np.array([0.0 if t <= until else np.inf]),
            directions=normal[None],
            bond=True,
        )
        load = Load(subject, middle, matrix, tension, between=True)
        return Contribution(loads=(load,), supports=(bond,), frictions=(lock,) if until < np.inf else ())

    def check_instants(self, times: Floats) -> None:
        """Raise SceneError if `until` is between two instants of a run."""
        if times[0] < self.until < times[-1] and not np.isclose(times, self.until, rtol=SAME, atol=0.0).any():
            raise SceneError(
                f"{self._subject}: found until = {self.until:.6g}, which is no instant of the run: the bolt would "
                f"be locked at t = {times[times < self.until][-1]:.6g}. Add t = {self.until:.6g} to times=."
            )

    def describe(self) -> str:
        locked = "" if self.until == np.inf else f" until t = {amount(self.until)}, then locked"
        return f"Pretension: a tension {amount(self.force)} on {where(self.on)}{locked}"


# Springs have the bilinear form int k_n (u . n)(v . n) + k_t u_t . v_t ds, with tangential parts u_t and v_t.
SPRING_FIELD = data.holds(sign=">= 0", rule="a spring's stiffness must be >= 0")


@dataclass(frozen=True)
class ElasticFoundation(Effect):
    """Springs between a part of the boundary and the ground, in tension and compression (Winkler foundation).

    `history.energy` includes the energy of the springs; `history.reaction` does not include their force.

    Parameters
    ----------
    normal, tangential : number, or callable f(x) -> (m,)
        k_n, k_t >= 0, traction per displacement: force per length^2 (and unit thickness), in space force per length^3.
    on : str or sequence of str
        Boundary names.

    Examples
    --------
    >>> print(vx.ElasticFoundation(normal=50.0, on="bottom").describe())
    ElasticFoundation: normal 50.0, tangential 0.0 on bottom
    """

    normal: data.Constant = field(default=0.0, metadata=SPRING_FIELD)
    tangential: data.Constant = field(default=0.0, metadata=SPRING_FIELD)
    on: str | Sequence[str] = field(kw_only=True)

    def contribute(self, space: Space) -> Contribution:
        part, dim = space.part(self.on, "ElasticFoundation"), space.dim
        springs = sp.csr_matrix((space.n_unknowns, space.n_unknowns))
        for rule in part.rules(2):
            (m, _, q), normals = rule.shares.shape, part.normals[rule.sides]
            weights = rule.shares.sum(axis=1, keepdims=True)
            basis = np.divide(rule.shares, weights, out=np.zeros_like(rule.shares), where=weights > 0.0)
            across = normals[:, :, None] * normals[:, None, :]
            blocks = np.zeros(())
            for name, projection in (("normal", across), ("tangential", np.eye(dim) - across)):
                k = self._read(name, data.At(rule.points.reshape(-1, dim))).reshape(m, q)
                blocks = blocks + np.einsum("eiq,ejq,eq,eab->eiajb", rule.shares, basis, k, projection)
            unknowns = (rule.nodes[:, :, None] * dim + np.arange(dim)).reshape(m, -1)
            rows, columns = np.broadcast_arrays(unknowns[:, :, None], unknowns[:, None, :])
            places = rows.ravel(), columns.ravel()
            springs = springs + sp.coo_matrix((blocks.ravel(), places), shape=springs.shape).tocsr()
        # Rounding makes the products slightly unsymmetric.
        return Contribution(stiffness=sp.csr_matrix(0.5 * (springs + springs.T)))

    def describe(self) -> str:
        springs = f"normal {amount(self.normal, 'x')}, tangential {amount(self.tangential, 'x')}"
        return f"ElasticFoundation: {springs} on {where(self.on)}"
