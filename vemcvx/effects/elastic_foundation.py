"""Springs along a part of the boundary (Winkler's foundation): sigma n = -k_n u_n n - k_t u_tau.

They add

    int k_n (u . n)(v . n) + k_t (u_tau . v_tau) ds

to a(u, v). Traces are linear on edges and two Gauss points an edge integrate their products exactly (the P1 mass
matrix of the edge) for constant and affine k; likewise on faces of polyhedra, where traces are piecewise linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, GivenDatum
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.vem import SideRule, Space

GAUSS = 2


@dataclass(frozen=True)
class ElasticFoundation(Effect):
    """Springs between a part of the boundary and the ground, in tension and compression (Winkler foundation).

    The springs are part of a^h: `history.energy` = 1/2 a^h(u, u) includes their energy,
    int k_n u_n^2 / 2 + k_t u_tau^2 / 2, and `history.reaction` does not include their force, which is minus the
    stiffness times the displacement. A motion that stretches the springs needs no other support.

    Parameters
    ----------
    normal, tangential : number, or callable f(x) -> (m,)
        k_n, k_t >= 0, traction per displacement: force per length^2 (and unit thickness). Fixed in time.
    on : str or sequence of str
        Boundary names.
    """

    normal: data.Constant = 0.0
    tangential: data.Constant = 0.0
    on: str | Sequence[str] = field(kw_only=True)

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "ElasticFoundation")
        springs = [_spread(self._of_sides(rule, part.normals[rule.sides]), rule, space) for rule in part.rules(GAUSS)]

        def at(x: Floats) -> Floats:
            return np.stack([self._stiffness("normal", x), self._stiffness("tangential", x)])

        subject = f"ElasticFoundation on {where(self.on)}"
        given = (
            (GivenDatum(subject, "foundation", at, part.sides),) if data.varies(self.normal, self.tangential) else ()
        )
        return Contribution(stiffness=sp.csr_matrix(sum(springs[1:], start=springs[0])), given=given)

    def _of_sides(self, rule: SideRule, n: Floats) -> Floats:
        """The matrices (m, n, dim, n, dim) of sides with these normals (m, dim), symmetric to the bit."""
        (m, count, q), dim = rule.shares.shape, n.shape[1]
        across = n[:, :, None] * n[:, None, :]
        along = np.eye(dim) - across
        ends = rule.shares / rule.shares.sum(axis=1, keepdims=True)
        blocks = np.zeros((m, count, dim, count, dim))
        for name, direction in (("normal", across), ("tangential", along)):
            k = self._stiffness(name, rule.points.reshape(-1, dim)).reshape(m, q)
            mass = np.einsum("eiq,ejq,eq->eij", rule.shares, ends, k)
            # The product above rounds (i, j) and (j, i) differently.
            mass = 0.5 * (mass + mass.transpose(0, 2, 1))
            blocks += mass[:, :, None, :, None] * direction[:, None, :, None, :]
        return blocks

    def describe(self) -> str:
        return (
            f"ElasticFoundation: normal {amount(self.normal, 'x')}, tangential {amount(self.tangential, 'x')} "
            f"on {where(self.on)}"
        )

    def _stiffness(self, name: str, x: Floats) -> Floats:
        return data.stiffness(getattr(self, name), x, f"ElasticFoundation on {where(self.on)}: {name}")


def _spread(blocks: Floats, rule: SideRule, space: Space) -> sp.csr_matrix:
    """Sum of the sides' matrices (m, n, dim, n, dim) over all nodal values, symmetric to the bit."""
    dim, n = blocks.shape[2], space.n_unknowns
    unknowns = rule.nodes[:, :, None] * dim + np.arange(dim)
    rows = np.broadcast_to(unknowns[:, :, :, None, None], blocks.shape)
    columns = np.broadcast_to(unknowns[:, None, None, :, :], blocks.shape)
    return sp.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
