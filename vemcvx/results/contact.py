"""The contact boundary over time.

Let u be the displacement of a contact node relative to the other body, and n the normal. The slip is (I - n n') u minus
the motion of the ground. Let phi be the hat function of the node. The pressure is the normal force divided by the
integral of phi over contact edges. The traction is the friction force divided by the integral of phi over edges with
friction. The worn depth is proportional to wear (Archard 1953). In one-sided contact, let p be the contact force, z the
normal displacement minus the gap, and c the stiffness of the node. The node is closed if p + c z >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from vemcvx.base.arrays import EPS, Bools, Floats, Ints, array_fields, sum_columns, totals
from vemcvx.base.outline import ArrayRecord
from vemcvx.meshes.polygons import find_in
from vemcvx.results.contact_tiles import ContactTiles, find_unmatched
from vemcvx.scene.contact import Terms
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows, pair_numbers
from vemcvx.stepping import Trajectory


@dataclass(frozen=True, kw_only=True, repr=False)
class Contact(ArrayRecord):
    """The contact boundary over time: m contact nodes, S stored instants.

    Contact nodes lie on boundaries with contact or friction, if no support fixes their normal displacement. The
    friction is 0 at nodes that a support at rest holds along the boundary. In space, lengths are areas.

    Attributes
    ----------
    nodes : (m,) int
        Node numbers.
    partners : (m,) int
        The nodes of the other body at the same places; -1 for contact with an obstacle.
    points, normals : (m, dim)
        Coordinates, and outward unit normals. At corners, normals are averaged with lengths as weights.
    slip : (S, m, dim)
        Tangential displacement relative to the partner or the ground.
    traction : (S, m, dim)
        Friction force on the body of `nodes`, per length of the edges with friction.
    bound : (S, m)
        Friction bound per length; 0 without friction.
    pressure : (S, m)
        Normal contact force per length; compression is positive.
    traction_recovered, pressure_recovered : (S, m, dim), (S, m)
        Traction and pressure to quote and draw. On interfaces of meshes that do not match, both are averaged over 1.5
        cells (:mod:`vemcvx.results.contact_tiles`).
    sticking : (S, m) bool
        True where the slip of the step is zero up to rounding; always True at the initial instant.
    wear : (S, m)
        Friction work since the initial instant, per length. The total work is ``wear @ friction_lengths``.
    accumulated_slip : (S, m)
        Length of the slip path since the initial instant.
    closed : (S, m) bool
        True where the node touches an obstacle, and at nodes without obstacles.
    lengths, friction_lengths : (m,)
        Integrals of the node's hat function over contact edges, and over edges with friction.

    Examples
    --------
    >>> effects = vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement((0.0, -0.1), on="top")
    >>> scene = vx.Scene(*effects, vx.UnilateralContact(on="bottom"))
    >>> history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial="settled")
    >>> history.contact.nodes, history.contact.open_count
    (array([0, 1, 2]), array([0, 0]))
    """

    nodes: Annotated[Ints, "m", ""]
    partners: Annotated[Ints, "m", ""]
    points: Annotated[Floats, "m dim", "length"]
    normals: Annotated[Floats, "m dim", ""]
    slip: Annotated[Floats, "S m dim", "length"]
    traction: Annotated[Floats, "S m dim", "force/length"]
    bound: Annotated[Floats, "S m", "force/length"]
    pressure: Annotated[Floats, "S m", "force/length"]
    traction_recovered: Annotated[Floats, "S m dim", "force/length"]
    pressure_recovered: Annotated[Floats, "S m", "force/length"]
    sticking: Annotated[Bools, "S m", ""]
    wear: Annotated[Floats, "S m", "energy/length"]
    wear_second_order: Annotated[Floats, "S m", "energy/length"]  # wear, accurate to second order in the time step
    accumulated_slip: Annotated[Floats, "S m", "length"]
    closed: Annotated[Bools, "S m", ""]
    lengths: Annotated[Floats, "m", "length"]
    friction_lengths: Annotated[Floats, "m", "length"]

    def take(self, nodes: Ints) -> Contact:
        """Return the contact at some positions in `self.nodes`."""
        sizes = {name: of.sizes for name, of in array_fields(Contact).items()}
        return Contact(**{name: getattr(self, name).take(nodes, axis=sizes[name].index("m")) for name in sizes})

    def rows_of(self, rows: ContactRows) -> Ints:
        """Return the position of each row in `self.nodes`, -1 for missing rows."""
        largest = int(max(self.partners.max(initial=0), self.nodes.max(initial=0), rows.nodes.max(initial=0)))
        each = ((one.nodes, one.partners) for one in (self, rows))
        return find_in(*(pair_numbers(np.maximum(*pair), np.minimum(*pair), largest) for pair in each))

    @property
    def has_friction(self) -> bool:
        """True if friction or the friction bound is nonzero at some stored instant."""
        return bool(self.bound.any() or self.traction.any())

    @property
    def stick_count(self) -> Ints:
        """The number (S,) of nodes that touch and stick."""
        return (self.closed & self.sticking).sum(axis=1)

    @property
    def slip_count(self) -> Ints:
        """The number (S,) of nodes that touch and slip."""
        return (self.closed & ~self.sticking).sum(axis=1)

    @property
    def open_count(self) -> Ints:
        """The number (S,) of nodes that are not closed."""
        return (~self.closed).sum(axis=1)


def contact_history(posed: PosedScene, trajectory: Trajectory, u: Floats, forces: Floats) -> Contact:
    """Return the contact for displacements u and nodal forces A u - f."""
    surface, terms, m = posed.surface, posed.terms, len(posed.surface.nodes)
    normals, at = surface.normals, surface.find(terms)
    length, force, cohesion = _friction_on_nodes(terms, trajectory.multipliers, at, normals)
    jump, joined, slipped = u[:, surface.nodes], np.flatnonzero(surface.partners >= 0), np.zeros((len(u), m))
    jump[:, joined] -= u[:, surface.partners[joined]]
    jump -= _ground(posed, trajectory, at, length)
    np.maximum.at(slipped.T, at, trajectory.slipped.T)
    slip = jump - np.einsum("smd,md->sm", jump, normals)[:, :, None] * normals
    traction = -force / np.where(length > 0, length, 1.0)[:, None]
    pressure = _pressure(posed, trajectory, forces) + cohesion / surface.lengths
    closed = _is_closed(posed, trajectory, u)
    smooth = _recover(posed, traction, pressure, closed, at)
    whole = Contact(
        nodes=surface.nodes,
        partners=surface.partners,
        points=posed.space.mesh.points[surface.nodes],
        normals=normals,
        slip=slip,
        traction=traction,
        bound=_bounds(posed, trajectory, at, length),
        pressure=pressure,
        traction_recovered=smooth[0],
        pressure_recovered=smooth[1],
        sticking=_sticking(trajectory, slip, at),
        wear=_per_length(trajectory.worn, at, length),
        wear_second_order=_per_length(trajectory.worn_second_order, at, length),
        accumulated_slip=slipped,
        closed=closed,
        lengths=surface.lengths,
        friction_lengths=length,
    )
    bonds = [surface.find(ContactRows.from_parts([f], u.shape[2])) for f in terms.frictions if f.bond]
    return whole.take(np.setdiff1d(np.arange(m), np.concatenate(bonds))) if bonds else whole


def _friction_on_nodes(terms: Terms, lam: Floats, at: Ints, normals: Floats) -> tuple[Floats, Floats, Floats | float]:
    m, each = len(normals), np.einsum("smb,mbd->smd", lam, terms.tangents)
    force, given = sum_columns(each, at, m), terms.directed
    if not given.any():
        return totals(at, terms.lengths, m), force, 0.0
    parts = [totals(at[kind], terms.lengths[kind], m) for kind in (given, ~given)]
    cohesion = np.einsum("smd,md->sm", sum_columns(each[:, given], at[given], m), normals)
    return np.maximum(*parts), force - cohesion[:, :, None] * normals, cohesion


def _ground(posed: PosedScene, trajectory: Trajectory, at: Ints, length: Floats) -> Floats | float:
    """Return the tangential motion of the ground at contact nodes."""
    terms = posed.terms
    if terms.reported is None:
        return 0.0
    moved = np.array([terms.reported(float(t)) for t in trajectory.times[trajectory.stored]])
    return sum_columns(moved * (terms.lengths / length[at])[:, None], at, len(length))


def _pressure(posed: PosedScene, trajectory: Trajectory, forces: Floats) -> Floats:
    surface, terms, obstacles, p = posed.surface, posed.terms, posed.obstacles, trajectory.pressures
    S, m = len(forces), len(surface.nodes)
    held = np.unique(surface.normal_reaction.indices)
    rest = forces.reshape(S, -1)[:, held] + trajectory.multipliers.reshape(S, -1) @ terms.rows[:, held]
    normal = sum_columns(p, surface.find(obstacles), m)
    rest += p @ obstacles.rows[:, held]
    return (normal - rest @ surface.normal_reaction[:, held].T) / surface.lengths


def _recover(posed: PosedScene, traction: Floats, pressure: Floats, closed: Bools, at: Ints) -> tuple[Floats, Floats]:
    surface, terms, mesh = posed.surface, posed.terms, posed.space.mesh
    mixed = surface.partners >= 0
    if mixed.any():
        mixed &= find_unmatched(mesh)[surface.nodes]
    if not mixed.any():
        return traction, pressure
    closed = closed & mixed
    whole = ContactTiles.from_rows(surface, np.arange(len(surface)), surface, mesh)
    smooth = whole.average(pressure * surface.lengths, surface.lengths, closed)
    # Friction with prescribed directions is not averaged.
    if len(terms) == 0 or terms.directed.any():
        return traction, smooth
    length = totals(at, terms.lengths, len(surface))
    tiles = ContactTiles.from_rows(terms, at, surface, mesh)
    safe, rubs = np.where(length > 0, length, 1.0), closed & (length > 0)
    along = traction.transpose(2, 0, 1)  # friction along each axis
    friction = tiles.average((along * safe).reshape(-1, len(safe)), safe, np.tile(rubs, (len(along), 1)))
    change = friction.reshape(along.shape).transpose(1, 2, 0) - traction
    change -= np.einsum("smd,md->sm", change, surface.normals)[:, :, None] * surface.normals
    return traction + change, smooth


def _per_length(values: Floats, at: Ints, length: Floats) -> Floats:
    """Return the sums of values per length at contact nodes, or 0 where the length is 0."""
    total = sum_columns(values, at, len(length))
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def _bounds(posed: PosedScene, trajectory: Trajectory, at: Ints, length: Floats) -> Floats:
    terms, weights = posed.terms, trajectory.weights
    # Friction with prescribed directions counts only at nodes without other friction.
    rubs = np.isin(at, at[~terms.directed])
    weights = np.where(terms.directed & rubs, 0.0, weights)
    return _per_length(weights, at, length)


def _sticking(trajectory: Trajectory, slip: Floats, at: Ints) -> Bools:
    """Return a mask (S, m) of nodes that do not slide in a stored step."""
    sticking = np.ones(slip.shape[:2], dtype=bool)
    smooth = np.setdiff1d(np.arange(slip.shape[1]), at)
    for row, n in enumerate(trajectory.stored):
        np.logical_and.at(sticking[row], at, trajectory.sticking[row])
        if n == 0 or len(smooth) == 0:
            continue
        if row > 0 and trajectory.stored[row - 1] == n - 1:
            moved = np.abs(slip[row] - slip[row - 1]).max(axis=1)
            kept = moved <= 8 * EPS * np.abs(slip[row]).max()
        else:  # The state before the step is not stored.
            kept = np.full(slip.shape[1], trajectory.iterations[n] == 0)
        sticking[row, smooth] &= kept[smooth]
    return sticking


def _is_closed(posed: PosedScene, trajectory: Trajectory, u: Floats) -> Bools:
    """Return a mask (S, m) of nodes that touch an obstacle or cannot open."""
    closed, held = np.ones((len(u), len(posed.surface.nodes)), dtype=bool), posed.obstacles.prescribed
    met = [(posed.obstacles, trajectory.pressures)] if len(posed.obstacles) else []
    if held is not None:
        met.append((held, np.zeros((len(u), len(held)))))
    places = [posed.surface.find(obstacles) for obstacles, _ in met]
    for at in places:
        closed[:, at[at >= 0]] = False
    for (obstacles, p), at in zip(met, places, strict=True):
        stiffness = np.asarray((obstacles.rows @ posed.A).multiply(obstacles.rows).sum(axis=1)).ravel()
        for row, n in enumerate(trajectory.stored):
            gap, move = obstacles.gap(float(trajectory.times[n])), obstacles.rows @ u[row].ravel()
            blur = 8 * EPS * (np.abs(gap) + np.abs(move).max(initial=0.0))
            touches = p[row] + stiffness * (move - gap + blur) >= 0
            np.logical_or.at(closed[row], at[at >= 0], touches[at >= 0])
    return closed
