"""The contact boundary over time, from what a march leaves.

Slips are tangential parts of nodal displacements, (I - n n') u; tractions are minus the multipliers over
int phi_i; the pressure is what the obstacle exerts along the normal, A u - f + B'lam, over int phi_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vemcvx.certificate import EPS
from vemcvx.pose import Posed
from vemcvx.trajectory import Trajectory

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
    bound : (S, m)
        Friction bound per length: w_i over int phi_i; 0 without friction.
    pressure : (S, m)
        Normal force per length, compression positive; of either sign where contact is bilateral.
    sticking : (S, m) bool
        Whether the increment of the step is zero to round-off; true in row 0.
    """

    nodes: Ints
    points: Floats
    normals: Floats
    slip: Floats
    traction: Floats
    bound: Floats
    pressure: Floats
    sticking: Bools


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
    traction, bound, friction = _friction(posed, trajectory, at, len(nodes))
    pressure = -np.einsum("smd,md->sm", forces[:, nodes] + friction, normals) / lengths
    along = np.einsum("smd,md->sm", u[:, nodes], normals)
    slip = u[:, nodes] - along[:, :, None] * normals
    sticking = _sticking(trajectory, slip, at)
    return Contact(nodes, points[nodes], normals, slip, traction, bound, pressure, sticking)


def _friction(posed: Posed, trajectory: Trajectory, at: Ints, m: int) -> tuple[Floats, Floats, Floats]:
    """Friction traction (S, m, dim), its bound (S, m), and the forces B'lam (S, m, dim) of the terms."""
    terms, lam = posed.terms, trajectory.multipliers
    rows, dim = len(lam), posed.space.mesh.points.shape[1]
    traction, bound, force = np.zeros((rows, m, dim)), np.zeros((rows, m)), np.zeros((rows, m, dim))
    if len(terms.nodes) == 0:
        return traction, bound, force
    tangents = terms.rows.data.reshape(len(terms.nodes), -1, dim)
    pulled = np.einsum("smb,mbd->smd", lam, tangents)
    for row in range(rows):
        np.add.at(traction[row], at, -pulled[row] / terms.lengths[:, None])
        np.add.at(bound[row], at, trajectory.weights[row] / terms.lengths)
        np.add.at(force[row], at, pulled[row])
    return traction, bound, force


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
