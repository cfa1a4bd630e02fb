"""The contact boundary over time, from what a march leaves.

Slips are tangential parts of nodal displacements, (I - n n') u; tractions are minus the multipliers over
int phi_i; the pressure is what the obstacle exerts along the normal, A u - f + B'lam, over int phi_i; wear is friction
work, the sum over all steps of w_i |s_i|, over int phi_i: the depth worn off is in proportion to it (Archard 1953).

A one-sided contact is closed where p_j + c_j z_j >= 0, z_j the excess over the gap and c_j = n'An at the node: the rule
by which active sets are chosen, which tells a small pressure from a small distance whatever the units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vemcvx.program.certificate import EPS
from vemcvx.scene.pose import Posed
from vemcvx.stepping.trajectory import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Contact:
    """The contact boundary over time: m nodes that are not held otherwise, S stored instants.

    Attributes
    ----------
    nodes : (m,) int, points : (m, dim), normals : (m, dim)
        Node numbers, places and outward normals.
    slip : (S, m, dim)
        Tangential displacement.
    traction : (S, m, dim)
        Friction force per length on the body: minus the multiplier over int phi_i.
    bound, backward : (S, m)
        Friction bounds per length against slip forward (along the boundary with the body on the left) and backward:
        w_i over int phi_i, equal unless a scene says otherwise; 0 without friction.
    pressure : (S, m)
        Normal force per length, compression positive; of either sign where contact is bilateral.
    sticking : (S, m) bool
        Whether the increment of the step is zero to round-off; true in row 0.
    wear : (S, m)
        Friction work per length since the initial instant, of all steps, stored or not: over int phi_i of the edges
        with friction, so that ``wear @ friction_lengths`` is what friction has dissipated; 0 without friction.
    closed : (S, m) bool
        Whether the node touches its obstacle, in one of its normals at least; true where contact is bilateral.
    lengths, friction_lengths : (m,)
        int phi_i over the edges of contact, and over those with friction: at a corner, both sides count.
    """

    nodes: Ints
    points: Floats
    normals: Floats
    slip: Floats
    traction: Floats
    bound: Floats
    backward: Floats
    pressure: Floats
    sticking: Bools
    wear: Floats
    closed: Bools
    lengths: Floats
    friction_lengths: Floats

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


def contact_history(posed: Posed, trajectory: Trajectory, u: Floats, forces: Floats) -> Contact:
    """The contact boundary at the stored instants.

    Parameters
    ----------
    posed : Posed
    trajectory : Trajectory
    u, forces : (S, n_nodes, dim) arrays
        Displacements, and nodal forces A u - f.
    """
    nodes, normals, lengths = posed.contact
    points = posed.space.mesh.points
    place = np.full(len(points), -1)
    place[nodes] = np.arange(len(nodes))
    at = place[posed.terms.nodes]
    traction, friction = _friction(posed, trajectory, at, len(nodes))
    bounds = _bounds(posed, trajectory, at, len(nodes))
    pressure = -np.einsum("smd,md->sm", forces[:, nodes] + friction, normals) / lengths
    along = np.einsum("smd,md->sm", u[:, nodes], normals)
    slip = u[:, nodes] - along[:, :, None] * normals
    sticking = _sticking(trajectory, slip, at)
    wear, rubbed = _wear(posed, trajectory, at, len(nodes))
    closed = _closed(posed, trajectory, u, place, len(nodes))
    fields = slip, traction, *bounds, pressure, sticking, wear, closed
    return Contact(nodes, points[nodes], normals, *fields, lengths, rubbed)


def _friction(posed: Posed, trajectory: Trajectory, at: Ints, m: int) -> tuple[Floats, Floats]:
    """Friction traction (S, m, dim), and the forces B'lam (S, m, dim) of the terms."""
    terms, lam = posed.terms, trajectory.multipliers
    rows, dim = len(lam), posed.space.mesh.points.shape[1]
    traction, force = np.zeros((rows, m, dim)), np.zeros((rows, m, dim))
    if len(terms.nodes) == 0:
        return traction, force
    tangents = terms.rows.data.reshape(len(terms.nodes), -1, dim)
    pulled = np.einsum("smb,mbd->smd", lam, tangents)
    for row in range(rows):
        np.add.at(traction[row], at, -pulled[row] / terms.lengths[:, None])
        np.add.at(force[row], at, pulled[row])
    return traction, force


def _bounds(posed: Posed, trajectory: Trajectory, at: Ints, m: int) -> tuple[Floats, Floats]:
    """Bounds per length (S, m) of slip forward and backward."""
    terms, weights = posed.terms, trajectory.weights
    tilt = np.zeros_like(weights)
    if terms.bias is not None:
        tilt = np.array([terms.bias(float(t)) for t in trajectory.times[trajectory.stored]])
    bounds = np.zeros((2, len(weights), m))
    for one, values in zip(bounds, (weights + tilt, weights - tilt), strict=True):
        for row in range(len(weights)):
            np.add.at(one[row], at, values[row] / terms.lengths)
    return bounds[0], bounds[1]


def _sticking(trajectory: Trajectory, slip: Floats, at: Ints) -> Bools:
    """Whether each node kept its place in the step that led to a row, (S, m).

    With friction, as the certificate tells; without, where both ends of the step are stored, by comparing them;
    else a node without friction counts as sliding, unless the step had nothing to solve.
    """
    sticking = np.ones(slip.shape[:2], dtype=bool)
    smooth = np.setdiff1d(np.arange(slip.shape[1]), at)
    for row, n in enumerate(trajectory.stored):
        np.logical_and.at(sticking[row], at, trajectory.sticking[row])
        if n == 0 or len(smooth) == 0:
            continue
        if row > 0 and trajectory.stored[row - 1] == n - 1:
            moved = np.abs(slip[row] - slip[row - 1]).max(axis=1)
            sticking[row, smooth] = (moved <= 8 * EPS * np.abs(slip[row]).max())[smooth]
        else:
            sticking[row, smooth] = trajectory.iterations[n] == 0
    return sticking


def _wear(posed: Posed, trajectory: Trajectory, at: Ints, m: int) -> tuple[Floats, Floats]:
    """Friction work per length (S, m), and the lengths with friction (m,)."""
    work, length = np.zeros((m, len(trajectory.worn))), np.zeros(m)
    np.add.at(work, at, trajectory.worn.T)
    np.add.at(length, at, posed.terms.lengths)
    wear = np.divide(work, length[:, None], out=np.zeros_like(work), where=length[:, None] > 0)
    return np.ascontiguousarray(wear.T), length


def _closed(posed: Posed, trajectory: Trajectory, u: Floats, place: Ints, m: int) -> Bools:
    """Whether each node touches its obstacle, (S, m); true where nothing can open."""
    closed, obstacles = np.ones((len(u), m), dtype=bool), posed.obstacles
    if obstacles is None:
        return closed
    at = place[obstacles.nodes]
    rows, at = np.flatnonzero(at >= 0), at[at >= 0]
    stiffness = np.asarray((obstacles.rows @ posed.A).multiply(obstacles.rows).sum(axis=1)).ravel()
    closed[:, at] = False
    for row, n in enumerate(trajectory.stored):
        gap, move = obstacles.gap(float(trajectory.times[n])), obstacles.rows @ u[row].ravel()
        blur = 8 * EPS * (np.abs(gap) + np.abs(move).max(initial=0.0))
        touches = trajectory.pressures[row] + stiffness * (move - gap + blur) >= 0
        np.logical_or.at(closed[row], at, touches[rows])
    return closed
