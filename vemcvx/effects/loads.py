"""Loads: tractions, pressures, forces in the volume and on single nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, Ints, as_real_array, brief
from vemcvx.effects.data import Datum
from vemcvx.effects.effect import Contribution, Effect, Load, amount, where
from vemcvx.errors import SceneError
from vemcvx.vem import Space, cell_load, edge_load

# Surface forces sigma n = f_2 on a part of the boundary, (3.4).


@dataclass(frozen=True)
class Traction(Effect):
    """Surface force per length (and unit thickness), in space per area: the load int f_2 . v ds, exact for affine f_2.

    Parameters
    ----------
    force : (dim,) constant, or callable f(x, t) -> (m, dim)
        Cartesian components, force per length (area), evaluated at t_n.
    on : str or sequence of str
        Boundary names.
    """

    force: Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "Traction")
        points, matrix, sides = edge_load(space, part)
        load = Load(f"Traction on {where(self.on)}", points, matrix, self.force, edges=part.sides[sides])
        return Contribution(loads=(load,))

    def describe(self) -> str:
        return f"Traction: {amount(self.force)} on {where(self.on)}"


# A pressure p on a part of the boundary: sigma n = -p n, the traction f_2 = -p n of (3.4).
#
# n is the outward normal of the undeformed edge or face: the pressure does not follow the body (small displacements).


@dataclass(frozen=True)
class Pressure(Effect):
    """Pressure on a part of the boundary: the load -int p n . v ds, exact for affine p, as of Traction.

    Parameters
    ----------
    value : number, or callable f(x, t) -> (m,)
        p, force per length (and unit thickness), in space per area, evaluated at t_n; compression positive, suction
        negative.
    on : str or sequence of str
        Boundary names; at a corner the pressure acts on each side along its own normal.
    """

    value: Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "Pressure")
        points, matrix, sides = edge_load(space, part)
        (q, dim), normals = points.shape, part.normals[sides]
        inward = sp.csr_matrix((-normals.ravel(), (np.arange(q * dim), np.repeat(np.arange(q), dim))))
        subject = f"Pressure on {where(self.on)}"
        load = Load(subject, points, matrix @ inward, self.value, edges=part.sides[sides])
        return Contribution(loads=(load,))

    def describe(self) -> str:
        return f"Pressure: {amount(self.value)} on {where(self.on)}"


# Volume forces -div sigma = f_1, (3.2), by the paper's rule: (Pi_0^0 f_1, average of the vertex values).


@dataclass(frozen=True)
class BodyForce(Effect):
    """A force per unit area (and unit thickness), in space per volume: <l^h, v> = sum_K int_K Pi_0^0 f_1 . v_hat.

    v_hat is the average of the vertex values of v on K, as in Section 3 of the paper (before (3.14)). The sum of these
    forces is exact for constant ones; their torque is so on cells whose centroid is the mean of their vertices, such as
    boxes and simplices, and else within h times the force.

    Parameters
    ----------
    force : (dim,) constant, or callable f(x, t) -> (m, dim)
        Cartesian components, force per area, evaluated at t_n.
    """

    force: Datum

    def contribute(self, space: Space) -> Contribution:
        points, matrix, cells = cell_load(space)
        load = Load("BodyForce", points, matrix, self.force, cells)
        return Contribution(loads=(load,))

    def describe(self) -> str:
        return f"BodyForce: {amount(self.force)} in the body"


# Forces on single nodes: <l^h, v> += sum_i F_i . v(x_i).
#
# On a continuum this is a model that no refinement improves: under a point force the displacement grows like log(1/h)
# and the energy with it, without bound (Kelvin's and Flamant's solutions). On a given mesh the answer is that of the
# force spread over about one cell; away from it the answer converges.


@dataclass(frozen=True)
class PointLoad(Effect):
    """A force on single nodes (per unit thickness).

    In the limit h -> 0 the energy of a point force is infinite: displacement and energy near it depend on the mesh.

    Parameters
    ----------
    force : (dim,) constant, (m, dim) array, or callable f(x, t) -> (m, dim)
        Cartesian components of the force on every point of `at`, evaluated at t_n. Forces on the same point add up.
    at : (dim,) or (m, dim)
        The points; each must be a node of the mesh, to 1e-9 of the body's size.
    """

    force: Datum
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
        with np.errstate(over="ignore"):  # of a point at 1e200
            nodes = np.array([np.argmin(np.linalg.norm(points - place, axis=1)) for place in at])
            apart = np.linalg.norm(points[nodes] - at, axis=1)
        worst = int(np.argmax(apart))
        # A point that a user computes may miss its node by rounding, never by a noticeable part of the body's size.
        if apart[worst] > 1e-9 * np.ptp(points, axis=0).max():
            node = nodes[worst]
            raise SceneError(
                f"PointLoad: there is no node at {at[worst]}; the nearest is node {node} at {points[node]}, "
                f"{apart[worst]:.6g} away. Name a node, spread the force by Traction, or mesh with a vertex there."
            )
        return nodes
