"""The contact boundary over time, from what a march leaves.

Slips are tangential parts of nodal displacements, (I - n n') u, less that of the ground. All forces are over int phi_i
of their own edges, those of contact or those with friction, and at corners both sides count, forces and edges:
tractions are minus the multipliers; pressures are the forces p_j of one-sided contact, and where contact holds a node
in both ways, its part of R = A u - f + B'lam + D'p, what then is left to supports and contact
(:mod:`vemcvx.scene.rows`); wear is friction work, the sum over all steps of w_i |s_i|: the depth worn off is in
proportion to it (Archard 1953).

A one-sided contact is closed where p_j + c_j z_j >= 0, z_j the excess over the gap and c_j = n'An at the node: the rule
by which active sets are chosen, which tells a small pressure from a small distance whatever the units.

Recovered pressure and friction, in the plane (in space: :mod:`.contact_faces`). Forces on nodes are right in the mean
over a few sides, R(v) = int p v for smooth v, better than each of them is. A force over int phi_i, as
`Contact.pressure` has it, is p not at node i but where phi_i has its centre, (h_2 - h_1) / 3 away from it between sides
of lengths h_1, h_2; and where nodes of two bodies alternate, forces do, too, because a hanging node bends a cell in
which strains are constant. Both are of order h, and show as a ripple. The recovered pressure is linear along sides, p =
sum_i p_i phi_i, has these forces in the mean, and is smooth: it is least in

    1/2 int p^2 - sum_i R_i p_i + 1/2 c sum_i h_i^4 / l_i [p']_i^2,    hence    (M + c J' diag(h^4 / l) J) p = R,

with the jumps [p']_i = (J p)_i of its slope at nodes between two sides, l_i half their length, M = int phi_i phi_j.
The last term is c h^4 int p''^2 of a smoothing spline (Reinsch, Numer. Math. 10 (1967)); without it p is the
L2-projection of the forces, as consistent fluxes are (Carey, Chow and Seager, Comput. Methods Appl. Mech. Engrg. 50
(1985)), and ripples by twice as much. Tested by 1 and x, for which J vanishes: the resultant of every stretch and its
moment are kept, and constant and linear fields are found exactly. A wave of length L keeps the part
1 / (1 + c (2 pi h / L)^4), so that smooth fields are changed by the order of h^4.

A stretch is what is closed in one piece, without corners: p ends with it, and half a side beyond its last node, where
no phi_i goes on, counts as p_i phi_i. Where all forces press, so does p: what is negative is 0, and the rest is scaled
to the resultant. At corners, and at nodes alone, p is R_i / int phi_i.

With the moments J p for unknowns of their own, sides of a millionth of others cost six digits and not eighteen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vemcvx.base.arrays import EPS, Bools, Floats, Ints, summed_columns, totals
from vemcvx.base.outline import ArrayRecord
from vemcvx.meshes import PolygonMesh, PolyhedralMesh, plane_mesh
from vemcvx.meshes.polygons import found_in, smallest_linked
from vemcvx.results.contact_faces import ContactFaces
from vemcvx.scene.contact import Surface, Terms
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows, pair_numbers
from vemcvx.stepping import Trajectory
from vemcvx.vem import tangents_of
from vemcvx.vem.boundary import SMOOTH


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
        Friction and pressure without the ripple of order h where nodes of two bodies alternate or sides are unequal:
        the smooth field, linear along sides, that has the same resultants and moments, exact where they are constant
        or linear. Quote and draw these; laws and bounds of friction hold for `traction` and `pressure` at every node.
        Edges of contact are as sharp as there, infinite values at corners of a body lower. In space, too, where nodes
        without much area of their own have pressures that mean nothing; edges of contact are rounded over a cell. See
        :mod:`vemcvx.results.contact` and :mod:`vemcvx.results.contact_faces`.
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
    return Contact(
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


def _friction_on_nodes(terms: Terms, lam: Floats, at: Ints, normals: Floats) -> tuple[Floats, Floats, Floats | float]:
    """Lengths (m,) of edges with friction, its multipliers on the nodes (S, m, dim), and (S, m) what holds normals.

    The last is of terms along given directions, and not in the one before.
    """
    m, each = len(normals), np.einsum("smb,mbd->smd", lam, terms.tangents)
    force, given = summed_columns(each, at, m), terms.directed
    if not given.any():
        return totals(at, terms.lengths, m), force, 0.0
    parts = [totals(at[kind], terms.lengths[kind], m) for kind in (given, ~given)]
    cohesion = np.einsum("smd,md->sm", summed_columns(each[:, given], at[given], m), normals)
    return np.maximum(*parts), force - cohesion[:, :, None] * normals, cohesion


def _ground(posed: PosedScene, trajectory: Trajectory, at: Ints, length: Floats) -> Floats | float:
    """The motion of the ground along the boundary (S, m, dim), the mean by length where parts meet."""
    terms = posed.terms
    if terms.reported is None:
        return 0.0
    moved = np.array([terms.reported(float(t)) for t in trajectory.times[trajectory.stored]])
    return summed_columns(moved * (terms.lengths / length[at])[:, None], at, len(length))


def _pressure(posed: PosedScene, trajectory: Trajectory, forces: Floats) -> Floats:
    """Normal forces of contact per length (S, m), from nodal forces A u - f (S, n_nodes, dim)."""
    surface, terms, obstacles, p = posed.surface, posed.terms, posed.obstacles, trajectory.pressures
    S, m = len(forces), len(surface.nodes)
    held = np.unique(surface.normal_reaction.indices)
    rest = forces.reshape(S, -1)[:, held] + trajectory.multipliers.reshape(S, -1) @ terms.rows[:, held]
    normal = summed_columns(p, surface.find(obstacles), m)
    rest += p @ obstacles.rows[:, held]
    return (normal - rest @ surface.normal_reaction[:, held].T) / surface.lengths


def _recovered(posed: PosedScene, traction: Floats, pressure: Floats, closed: Bools, at: Ints) -> tuple[Floats, Floats]:
    """Tractions and pressures recovered at the instants; friction has its terms `at` contact nodes."""
    surface, terms, mesh = posed.surface, posed.terms, posed.space.mesh
    if len(surface) == 0:
        return traction, pressure

    def sides(rows: ContactRows, at: Ints) -> ContactSides | ContactFaces:
        if isinstance(mesh, PolyhedralMesh):
            return ContactFaces.of(rows, at, surface, mesh)
        return ContactSides.of(rows, at, surface, plane_mesh(mesh, "pressures along sides"))

    whole, pressed, rows = sides(surface, np.arange(len(surface))), pressure * surface.lengths, len(pressure)
    # Forces along given directions are over lengths of their own.
    if len(terms) == 0 or terms.directed.any():
        return traction, recovered(pressed, surface.lengths, whole, closed, pressing=rows)
    length = totals(at, terms.lengths, len(surface))
    # The component of friction along the sides; in space, where tangents at a node are any two, that along each axis.
    flat = isinstance(mesh, PolygonMesh)
    axes = tangents_of(surface.normals) if flat else np.tile(np.eye(3), (len(surface), 1, 1))
    along = np.einsum("smd,mad->asm", traction, axes)
    if np.array_equal(length, surface.lengths):
        forces, each = np.vstack([pressed, *(along * length)]), np.tile(closed, (1 + len(along), 1))
        smooth, friction = np.split(recovered(forces, length, whole, each, pressing=rows), [rows])
    else:
        smooth = recovered(pressed, surface.lengths, whole, closed, pressing=rows)
        safe, rubs = np.where(length > 0, length, 1.0), np.tile(closed & (length > 0), (len(along), 1))
        friction = recovered((along * safe).reshape(rubs.shape), safe, sides(terms, at), rubs)
    change = np.einsum("asm,mad->smd", friction.reshape(along.shape) - along, axes)
    if not flat:
        change -= np.einsum("smd,md->sm", change, surface.normals)[:, :, None] * surface.normals
    return traction + change, smooth


def _per_length(values: Floats, at: Ints, length: Floats) -> Floats:
    """Values (S, terms) summed at contact nodes over their lengths with friction (m,); 0 where there is none."""
    total = summed_columns(values, at, len(length))
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


@dataclass(frozen=True, eq=False)
class ContactSides:
    """The sides of contact in the plane between two of its m nodes, without those at corners."""

    ends: Ints  # (k, 2) the nodes, of m
    lengths: Floats  # (k,)
    reach: Floats  # (k,) h, the length of the side of the finer of the two bodies that each is part of

    @classmethod
    def of(cls, rows: ContactRows, at: Ints, surface: Surface, mesh: PolygonMesh) -> ContactSides:
        """The sides of these rows, whose places among the nodes of contact are `at`."""
        owner, (node, beyond) = rows.owners(at), rows.names.T
        one, back = (pair_numbers(*pair, mesh.n_nodes) for pair in ((node, beyond), (beyond, node)))
        other = np.minimum(np.searchsorted(one, back), len(one) - 1)
        whole = np.flatnonzero((one[other] == back) & (node < beyond) & (owner >= 0) & (owner[other] >= 0))
        ends, m = np.column_stack([owner[whole], owner[other[whole]]]), len(surface)
        along = mesh.points[beyond[whole]] - mesh.points[node[whole]]
        lengths = np.linalg.norm(along, axis=1)
        turns = np.zeros((m, 2))
        np.add.at(turns, ends, np.stack([-along, along], axis=1) / lengths[:, None, None])
        degree = np.bincount(ends.ravel(), minlength=m)
        corner = (degree > 2) | ((degree == 2) & (np.linalg.norm(turns, axis=1) > SMOOTH))
        kept = ~corner[ends].any(axis=1)
        ends, lengths, reach = ends[kept], lengths[kept], np.full(int(kept.sum()), np.inf)
        cells = np.bincount(mesh.vertices, minlength=mesh.n_nodes)
        for body in (surface.nodes, surface.partners):
            reach = np.minimum(reach, _runs(ends, lengths, (body >= 0) & (cells[body] == 1)))
        return cls(ends, lengths, reach)

    def within(self, pattern: Bools) -> ContactSides:
        """The sides both of whose nodes are in the pattern (m,)."""
        kept = pattern[self.ends].all(axis=1)
        return ContactSides(self.ends[kept], self.lengths[kept], self.reach[kept])

    @property
    def links(self) -> Ints:
        """(k, 2) the nodes at the ends of sides."""
        return self.ends

    def smoothed(self, forces: Floats, lengths: Floats) -> Floats:
        """The field (S, m) without regard to signs, R_i / int phi_i where no side is."""
        m, ends, h = len(lengths), self.ends, self.lengths
        nodes, degree, reach = np.arange(m), np.bincount(ends.ravel(), minlength=m), np.zeros(m)
        np.maximum.at(reach, ends, self.reach[:, None])
        # Nodes between two sides, these sides, and the nodes at their other ends: (q,), (q, 2), (q, 2).
        inner = np.flatnonzero(degree == 2)
        at = np.argsort(ends.ravel(), kind="stable")[(np.cumsum(degree) - degree)[inner][:, None] + [0, 1]]
        side, other = at // 2, ends.ravel()[at ^ 1]
        # Rows of J times l_1 l_2 / (l_1 + l_2), and h, so that none is large.
        scale = reach[inner] / np.sum(1.0 / h[side], axis=1)
        J = np.column_stack([reach[inner], -scale[:, None] / h[side]]).ravel()
        # c = 1/2: of ripples of two sides 2 % are left, of four 25 %.
        soft = h[side].sum(axis=1) * (scale / reach[inner] ** 2) ** 2
        jumps = np.arange(m, m + len(inner))
        row, column = np.repeat(jumps, 3), np.column_stack([inner, other]).ravel()
        # M, J, J' and -soft, by their entries.
        values = [lengths - totals(ends.ravel(), np.repeat(h / 6.0, 2), m), *[h / 6.0] * 2, J, J, -soft]
        rows, columns = ([nodes, *ends.T, row, column, jumps], [nodes, *ends.T[::-1], column, row, jumps])
        size = m + len(inner)
        where = np.concatenate(rows), np.concatenate(columns)
        system = sp.csc_matrix((np.concatenate(values), where), shape=(size, size))
        loads = np.concatenate([forces.T, np.zeros((len(inner), len(forces)))])
        return splu(system).solve(loads)[:m].T


def _runs(ends: Ints, lengths: Floats, hangs: Bools) -> Floats:
    """The lengths (k,) of what sides were before the nodes that hang, of m, were put into them."""
    order = np.argsort(ends.ravel(), kind="stable")
    node = ends.ravel()[order]
    same = np.flatnonzero((np.diff(node) == 0) & hangs[node[:-1]])
    if len(same) == 0:
        return lengths
    run = smallest_linked(np.column_stack([order[same], order[same + 1]]) // 2, len(ends))
    return np.bincount(run, lengths, minlength=len(ends)).astype(float)[run]


def recovered(
    forces: Floats, lengths: Floats, sides: ContactSides | ContactFaces, closed: Bools, *, pressing: int = 0
) -> Floats:
    """Forces (k, m) on nodes, with int phi_i as lengths (m,), as recovered forces per length.

    In each row stretches go to the nodes that are `closed`, (k, m). The first rows are `pressing`: of these a stretch
    without negative forces has no negative values.
    """
    found, rows_of = forces / lengths, dict[bytes, list[int]]()
    for row, pattern in enumerate(closed):
        rows_of.setdefault(pattern.tobytes(), []).append(row)
    for rows in rows_of.values():
        stretch = sides.within(closed[rows[0]])
        if len(stretch.links):
            smooth, press = stretch.smoothed(forces[rows], lengths), np.array(rows) < pressing
            smooth[press] = _pressing(smooth[press], forces[rows][press], lengths, stretch.links)
            found[rows] = smooth
    return found


def _pressing(smooth: Floats, forces: Floats, lengths: Floats, links: Ints) -> Floats:
    """The field without negative values in stretches that are pressed all over, with the same resultants."""
    if not (smooth < 0).any():
        return smooth
    m = len(lengths)
    stretch = smallest_linked(links, m)
    pulled, turned = (summed_columns((each < 0).astype(float), stretch, m)[:, stretch] > 0 for each in (forces, smooth))
    positive = np.maximum(smooth, 0.0)
    total, wanted = (summed_columns(each, stretch, m)[:, stretch] for each in (positive * lengths, forces))
    scaled = positive * np.divide(wanted, total, out=np.ones_like(total), where=total > 0)
    return np.where(turned & ~pulled, scaled, smooth)
