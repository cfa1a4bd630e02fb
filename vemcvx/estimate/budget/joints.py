"""Boundary edges at which two bodies meet.

What contact exerts on an edge of the first body it exerts on the second one's edge in the same place the other way.
Where normals are held together, no multiplier is at hand; the normal force that balances the stresses on both sides
best, in the weights w = h_e / (2 mu) of the residuals, is as good as any:

    min over T of  w_1 |T - s_1|^2 + w_2 |T - s_2|^2  =  w_1 w_2 / (w_1 + w_2) |s_1 - s_2|^2,

which is what a jump across an edge inside one body counts, h_e / (4 mu), where both sides are alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.topology import positions
from vemcvx.scene.freedom import normal_rows, on_free
from vemcvx.scene.jumps import Jumps
from vemcvx.scene.pose import PosedScene


@dataclass(frozen=True)
class Joints:
    """Pairs of boundary edges in one place."""

    across: Ints
    """(b, 2) the partners of the nodes of each boundary edge; -1 where it is no first body's at an interface"""
    first: Ints
    """(k,) boundary edges of first bodies"""
    second: Ints
    """(k,) those of second ones in the same places"""
    bonded: Bools
    """(k,) whether normals are held together"""

    def reaction(self, force: Floats) -> Floats:
        """What contact that exerts forces (b, 2) on first bodies exerts on second ones."""
        back = np.zeros_like(force)
        back[self.second] = -force[self.first]
        return back

    def normal_forces(self, traction: Floats, weights: Floats, units: Floats) -> Floats:
        """(b, 2) what bilateral contact exerts on both bodies, by the tractions (b, 2) of the stresses on all edges."""
        one, other = self.first[self.bonded], self.second[self.bonded]
        n, w, v = units[one], weights[one], weights[other]
        size = np.einsum("kd,kd->k", (w[:, None] * traction[one] - v[:, None] * traction[other]), n) / (w + v)
        force = np.zeros_like(traction)
        force[one] = size[:, None] * n
        force[other] = -force[one]
        return force


def joints(posed: PosedScene, edges: Ints, units: Floats) -> Joints:
    """The joints among boundary edges (b, 2) with outward normals (b, 2)."""
    mesh, across = posed.space.mesh, np.full(edges.shape, -1)
    none = np.empty((0, 2), dtype=np.int64)
    found = list(mesh.interfaces.values())
    ends, partners = (
        np.concatenate([none, *side]) for side in ([one.edges for one in found], [one.partners for one in found])
    )
    first, second = (positions(side, edges, mesh.n_nodes) for side in (ends, partners))
    across[first] = partners
    normal = normal_rows(Jumps(ends.ravel(), partners.ravel()), np.repeat(units[first], 2, axis=0), mesh.points)
    held = np.diff(on_free(normal, posed.supports).indptr) == 0
    return Joints(across, first, second, held.reshape(-1, 2).all(axis=1))
