"""Forces on single nodes: <l^h, v> += sum_i F_i . v(x_i).

On a continuum this is a model that no refinement improves: under a point force the displacement grows like log(1/h)
and the energy with it, without bound (Kelvin's and Flamant's solutions). On a given mesh the answer is that of the
force spread over about one cell; away from it the answer converges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, Ints, as_real_array, brief
from vemcvx.effects.contribution import Contribution, Load
from vemcvx.effects.data import Datum
from vemcvx.effects.effect import Effect, amount
from vemcvx.errors import SceneError
from vemcvx.vem import Space

# A point that a user computes may miss its node by rounding, never by a noticeable part of the body's size.
SAME_POINT = 1e-9


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
        if apart[worst] > SAME_POINT * np.ptp(points, axis=0).max():
            node = nodes[worst]
            raise SceneError(
                f"PointLoad: there is no node at {at[worst]}; the nearest is node {node} at {points[node]}, "
                f"{apart[worst]:.6g} away. Name a node, spread the force by Traction, or mesh with a vertex there."
            )
        return nodes
