"""The contact boundary over time, from what a march leaves.

Slips are tangential parts of nodal displacements, (I - n n') u, less that of the ground. All forces are over int phi_i
of their own edges, those of contact or those with friction, and at corners both sides count, forces and edges:
tractions are minus the multipliers; pressures are the forces p_j of one-sided contact, and where contact holds a node
in both ways, its part of R = A u - f + B'lam + D'p, what then is left to supports and contact
(:mod:`vemcvx.scene.rows`); wear is friction work, the sum over all steps of w_i |s_i|: the depth worn off is in
proportion to it (Archard 1953).

A one-sided contact is closed where p_j + c_j z_j >= 0, z_j the excess over the gap and c_j = n'An at the node: the rule
by which active sets are chosen, which tells a small pressure from a small distance whatever the units.

Pressures and tractions are recovered from these by :mod:`vemcvx.results.contact_tiles`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, Bools, Floats, Ints, array_fields, sum_columns, totals
from vemcvx.base.outline import ArrayRecord
from vemcvx.meshes.polygons import found_in
from vemcvx.results.contact_tiles import ContactTiles, unmatched
from vemcvx.scene.contact import Terms
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows, pair_numbers
from vemcvx.stepping import Trajectory


@dataclass(frozen=True, kw_only=True, repr=False)
class Contact(ArrayRecord):
    """The contact boundary over time: m contact nodes, S stored instants.

    Nodes of the boundary are contact nodes unless another support fixes their normal component. Among them are nodes
    whose tangent a support fixes (on the axis of a half model). Nodes that a prescribed displacement moves along the
    boundary against friction always are. The forces of such supports are neither traction nor pressure. Friction
    against them is traction; it is taken to be 0 in a step in which the support stands still, when any value up to the
    bound would be admissible.

    In space lengths are areas. Where a node has one normal, slip and traction are vectors in the tangent plane of the
    surface, and minus traction times the slip of a step is the wear of it. At edges and corners of contact friction
    acts in the tangent plane of every normal: traction is the sum, slip lacks what is along the mean of the normals,
    and the wear of a step is minus traction times its whole displacement, normal parts included.

    Attributes
    ----------
    nodes : (m,) int
        Node numbers.
    partners : (m,) int
        The nodes of the other body at the same places, against which slip, traction and pressure are those of `nodes`;
        -1 where contact is with an obstacle.
    points : (m, dim)
        Places.
    normals : (m, dim)
        Outward unit normals, averaged by length at corners.
    slip : (S, m, dim)
        Tangential displacement, relative to the partner; where the ground moves, relative to it since the initial
        instant (where parts meet, to the mean of their grounds).
    traction : (S, m, dim)
        Friction force on the body of `nodes`, minus the multiplier, per length of the edges with friction.
    bound : (S, m)
        Friction bound per length: w_i over int phi_i; 0 without friction. Where parts meet, their mean. For friction by
        direction it is the bound in the direction in which friction acts, along `direction` where there is none.
    pressure : (S, m)
        Normal force of contact per length, compression positive; of either sign where contact is bilateral, or
        cohesive along the normal. A support that moves a node along the normal of its contact is an obstacle that
        moves: its force is pressure.
    traction_recovered, pressure_recovered : (S, m, dim), (S, m)
        Friction and pressure without the ripple of order h on interfaces where the meshes of two bodies do not match:
        there means over a cell and a half that have the same resultants, exact where they are constant; elsewhere
        `traction` and `pressure`. Quote and draw these; laws and bounds of friction hold for `traction` and `pressure`
        at every node. Means round edges of contact over a cell. See :mod:`vemcvx.results.contact_tiles`.
    sticking : (S, m) bool
        True where the increment of the step is zero, up to rounding, and in row 0.
    wear : (S, m)
        Friction work per length since the initial instant, of all steps, stored or not: over int phi_i of the edges
        with friction, so that ``wear @ friction_lengths`` is what friction has dissipated; 0 without friction.
    wear_second_order : (S, m)
        `wear` with the friction bounds of both ends of every step: of second order in their length.
    accumulated_slip : (S, m)
        Length of the way that the node has slipped since the initial instant, to and fro, in all steps, stored or not,
        which laws of friction may follow (where parts meet, the largest). For friction by direction slip across
        `direction` counts across / bound times, so that ways cost alike.
    closed : (S, m) bool
        True where the node touches its obstacle, in one of its normals at least, and where contact is bilateral.
    lengths : (m,)
        int phi_i over the edges of contact: at a corner, both sides count.
    friction_lengths : (m,)
        int phi_i over the edges with friction.
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
    wear_second_order: Annotated[Floats, "S m", "energy/length"]
    accumulated_slip: Annotated[Floats, "S m", "length"]
    closed: Annotated[Bools, "S m", ""]
    lengths: Annotated[Floats, "m", "length"]
    friction_lengths: Annotated[Floats, "m", "length"]

    def rows_of(self, rows: ContactRows) -> Ints:
        """The row (k,) of the contact node of each of `rows`, whichever of two bodies is named first; -1 for none."""
        largest = int(max(self.partners.max(initial=0), self.nodes.max(initial=0), rows.nodes.max(initial=0)))
        pairs = pair_numbers(self.nodes, self.partners, largest)
        at, turned = (found_in(pairs, pair_numbers(*two, largest)) for two in _both_ways(rows))
        return np.where(at >= 0, at, turned)

    @property
    def stick_count(self) -> Ints:
        """(S,) nodes that touch and stick; with `slip_count` and `open_count` all m."""
        return (self.closed & self.sticking).sum(axis=1)

    @property
    def slip_count(self) -> Ints:
        """(S,) nodes that touch and slip."""
        return (self.closed & ~self.sticking).sum(axis=1)

    @property
    def closed_count(self) -> Ints:
        """(S,) nodes that touch their obstacle."""
        return self.closed.sum(axis=1)

    @property
    def open_count(self) -> Ints:
        """(S,) nodes that do not."""
        return (~self.closed).sum(axis=1)


def _both_ways(rows: ContactRows) -> tuple[tuple[Ints, Ints], tuple[Ints, Ints]]:
    """Nodes and partners, and these the other way round where there are partners."""
    joined = rows.partners >= 0
    turned = np.where(joined, rows.partners, rows.nodes), np.where(joined, rows.nodes, rows.partners)
    return (rows.nodes, rows.partners), turned


def contact_history(posed: PosedScene, trajectory: Trajectory, u: Floats, forces: Floats) -> Contact:
    """The contact boundary at the stored instants, from displacements and forces A u - f (S, n_nodes, dim) of nodes."""
    surface, terms, m = posed.surface, posed.terms, len(posed.surface.nodes)
    normals, at = surface.normals, surface.find(terms)
    length, force, cohesion = _friction_on_nodes(terms, trajectory.multipliers, at, normals)
    jump, joined, slipped = u[:, surface.nodes], np.flatnonzero(surface.partners >= 0), np.zeros((len(u), m))
    jump[:, joined] -= u[:, surface.partners[joined]]
    jump -= _ground(posed, trajectory, at, length)
    np.maximum.at(slipped.T, at, trajectory.slipped.T)
    slip = jump - np.einsum("smd,md->sm", jump, normals)[:, :, None] * normals
    traction = -force / np.where(length > 0, length, 1.0)[:, None]
    pressure, closed = _pressure(posed, trajectory, forces) + cohesion / surface.lengths, _closed(posed, trajectory, u)
    smooth = _recovered(posed, traction, pressure, closed, at)
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
        sticking=_sticking(trajectory, slip, terms, at),
        wear=_per_length(trajectory.worn, at, length),
        wear_second_order=_per_length(trajectory.worn_second_order, at, length),
        accumulated_slip=slipped,
        closed=closed,
        lengths=surface.lengths,
        friction_lengths=length,
    )
    bonds = [surface.find(ContactRows.from_parts([f], u.shape[2])) for f in terms.frictions if f.bond]
    if not bonds:
        return whole
    kept, each = np.setdiff1d(np.arange(m), np.concatenate(bonds)), array_fields(Contact)
    return replace(whole, **{k: x[:, kept] if each[k].sizes[0] == "S" else x[kept] for k, x in vars(whole).items()})


def _friction_on_nodes(terms: Terms, lam: Floats, at: Ints, normals: Floats) -> tuple[Floats, Floats, Floats | float]:
    """Lengths (m,) of edges with friction, its multipliers on the nodes (S, m, dim), and (S, m) what holds normals.

    The last is of terms along given directions, and not in the one before.
    """
    m, each = len(normals), np.einsum("smb,mbd->smd", lam, terms.tangents)
    force, given = sum_columns(each, at, m), terms.directed
    if not given.any():
        return totals(at, terms.lengths, m), force, 0.0
    parts = [totals(at[kind], terms.lengths[kind], m) for kind in (given, ~given)]
    cohesion = np.einsum("smd,md->sm", sum_columns(each[:, given], at[given], m), normals)
    return np.maximum(*parts), force - cohesion[:, :, None] * normals, cohesion


def _ground(posed: PosedScene, trajectory: Trajectory, at: Ints, length: Floats) -> Floats | float:
    """The motion of the ground along the boundary (S, m, dim), the mean by length where parts meet."""
    terms = posed.terms
    if terms.reported is None:
        return 0.0
    moved = np.array([terms.reported(float(t)) for t in trajectory.times[trajectory.stored]])
    return sum_columns(moved * (terms.lengths / length[at])[:, None], at, len(length))


def _pressure(posed: PosedScene, trajectory: Trajectory, forces: Floats) -> Floats:
    """Normal forces of contact per length (S, m), from nodal forces A u - f (S, n_nodes, dim)."""
    surface, terms, obstacles, p = posed.surface, posed.terms, posed.obstacles, trajectory.pressures
    S, m = len(forces), len(surface.nodes)
    held = np.unique(surface.normal_reaction.indices)
    rest = forces.reshape(S, -1)[:, held] + trajectory.multipliers.reshape(S, -1) @ terms.rows[:, held]
    normal = sum_columns(p, surface.find(obstacles), m)
    rest += p @ obstacles.rows[:, held]
    return (normal - rest @ surface.normal_reaction[:, held].T) / surface.lengths


def _recovered(posed: PosedScene, traction: Floats, pressure: Floats, closed: Bools, at: Ints) -> tuple[Floats, Floats]:
    """Tractions and pressures recovered at the instants; friction has its terms `at` contact nodes."""
    surface, terms, mesh = posed.surface, posed.terms, posed.space.mesh
    mixed = surface.partners >= 0
    if mixed.any():
        mixed &= unmatched(mesh)[surface.nodes]
    if not mixed.any():
        return traction, pressure
    closed = closed & mixed
    whole = ContactTiles.of(surface, np.arange(len(surface)), surface, mesh)
    smooth = whole.recovered(pressure * surface.lengths, surface.lengths, closed)
    # Forces along given directions are over lengths of their own.
    if len(terms) == 0 or terms.directed.any():
        return traction, smooth
    length = totals(at, terms.lengths, len(surface))
    tiles = whole if np.array_equal(length, surface.lengths) else ContactTiles.of(terms, at, surface, mesh)
    safe, rubs = np.where(length > 0, length, 1.0), closed & (length > 0)
    along = traction.transpose(2, 0, 1)  # friction along each axis
    friction = tiles.recovered((along * safe).reshape(-1, len(safe)), safe, np.tile(rubs, (len(along), 1)))
    change = friction.reshape(along.shape).transpose(1, 2, 0) - traction
    change -= np.einsum("smd,md->sm", change, surface.normals)[:, :, None] * surface.normals
    return traction + change, smooth


def _per_length(values: Floats, at: Ints, length: Floats) -> Floats:
    """Values (S, terms) summed at contact nodes over their lengths with friction (m,); 0 where there is none."""
    total = sum_columns(values, at, len(length))
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def _bounds(posed: PosedScene, trajectory: Trajectory, at: Ints, length: Floats) -> Floats:
    """Return the bounds of friction per length (S, m)."""
    terms, weights = posed.terms, trajectory.weights
    # What holds along given directions is no bound of friction where there is some.
    rubs = np.isin(at, at[~terms.directed])
    weights = np.where(terms.directed & rubs, 0.0, weights)
    if terms.elliptic.any():
        # What friction by direction has at its bound, in the direction in which it acts, over the weight.
        lam = trajectory.multipliers
        force, size = (np.linalg.norm(x, axis=2) for x in (np.einsum("smb,mbd->smd", lam, terms.tangents), lam))
        weights = weights * np.divide(force, size, out=np.ones_like(size), where=terms.elliptic & (size > 0))
    return _per_length(weights, at, length)


def _sticking(trajectory: Trajectory, slip: Floats, terms: Terms, at: Ints) -> Bools:
    """Return True if each node kept its place in the step that led to a row, (S, m).

    With friction, as the certificate tells; without, where both ends of the step are stored, by comparing them;
    else a node without friction counts as sliding, unless the step had nothing to solve. Friction along a line alone is
    both: what it does not read slides as without.
    """
    sticking = np.ones(slip.shape[:2], dtype=bool)
    along, rails = terms.tangents[:, 0], terms.elliptic & ~terms.tangents[:, -1].any(axis=1)
    smooth = np.union1d(np.setdiff1d(np.arange(slip.shape[1]), at), at[rails])
    free = np.zeros((slip.shape[1], slip.shape[2]))
    free[at[rails]] = along[rails]
    for row, n in enumerate(trajectory.stored):
        np.logical_and.at(sticking[row], at, trajectory.sticking[row])
        if n == 0 or len(smooth) == 0:
            continue
        if row > 0 and trajectory.stored[row - 1] == n - 1:
            step = slip[row] - slip[row - 1]
            moved = np.abs(step - np.sum(step * free, axis=1)[:, None] * free).max(axis=1)
            kept = moved <= 8 * EPS * np.abs(slip[row]).max()
        else:
            kept = np.full(slip.shape[1], trajectory.iterations[n] == 0)
        sticking[row, smooth] &= kept[smooth]
    return sticking


def _closed(posed: PosedScene, trajectory: Trajectory, u: Floats) -> Bools:
    """Return True if each node touches its obstacle, (S, m); true where nothing can open."""
    closed, held = np.ones((len(u), len(posed.surface.nodes)), dtype=bool), posed.obstacles.prescribed
    met = [(posed.obstacles, trajectory.pressures)] if len(posed.obstacles) else []
    if held is not None:
        met.append((held, np.zeros((len(u), len(held)))))
    places = [posed.surface.find(obstacles) for obstacles, _ in met]
    for at in places:
        closed[:, at[at >= 0]] = False
    for (obstacles, p), at in zip(met, places, strict=True):
        stiffness = _stiffness_along(obstacles.rows, posed.A)
        for row, n in enumerate(trajectory.stored):
            gap, move = obstacles.gap(float(trajectory.times[n])), obstacles.rows @ u[row].ravel()
            blur = 8 * EPS * (np.abs(gap) + np.abs(move).max(initial=0.0))
            touches = p[row] + stiffness * (move - gap + blur) >= 0
            np.logical_or.at(closed[row], at[at >= 0], touches[at >= 0])
    return closed


def _stiffness_along(rows: sp.csr_matrix, A: sp.csr_matrix) -> Floats:
    """(r,) r'A r of every row r."""
    return np.asarray((rows @ A).multiply(rows).sum(axis=1)).ravel()
