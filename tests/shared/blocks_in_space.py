"""A block on a rough floor in space, as a System of matrices that scikit-fem assembles on hexahedra or tetrahedra.

The block (0, 1)^3 stands on its face z = 0, in bilateral or one-sided contact with Tresca's or Coulomb's friction. A
traction whose direction may change pulls its top; the face x = 1 may be clamped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import ddot, dot, sym_grad, trace

import vemcvx as vx


@skfem.BilinearForm
def elastic(u, v, w):
    return w.lam * trace(sym_grad(u)) * trace(sym_grad(v)) + 2 * w.mu * ddot(sym_grad(u), sym_grad(v))


@skfem.LinearForm
def pulled(v, w):
    return dot(w.force, v)


@skfem.LinearForm
def share(v, w):
    return v


@dataclass(frozen=True)
class Block:
    """The stiffness matrix of all (n_nodes, 3) displacements, unit loads on the top, and int phi_i over the floor."""

    points: np.ndarray
    K: sp.csr_matrix
    top: np.ndarray
    """(3, 3 n_nodes) loads of unit tractions on z = 1, along each axis"""
    floor: np.ndarray
    """nodes on z = 0"""
    shares: np.ndarray
    """(n_nodes,) int phi_i over z = 0"""


@cache
def block(n, cells="hexahedra", lam=1.0, mu=1.0):
    """Return the block with n cells along each edge."""
    line = np.linspace(0.0, 1.0, n + 1)
    kind, linear = {
        "hexahedra": (skfem.MeshHex, skfem.ElementHex1()),
        "tetrahedra": (skfem.MeshTet, skfem.ElementTetP1()),
    }[cells]
    mesh = kind.init_tensor(line, line, line)
    element = skfem.ElementVector(linear)
    K = sp.csr_matrix(elastic.assemble(skfem.Basis(mesh, element), lam=lam, mu=mu))
    top = skfem.FacetBasis(mesh, element, facets=mesh.facets_satisfying(lambda x: np.isclose(x[2], 1.0)))
    under = skfem.FacetBasis(mesh, linear, facets=mesh.facets_satisfying(lambda x: np.isclose(x[2], 0.0)))
    unit = np.eye(3)
    loads = np.array([pulled.assemble(top, force=np.einsum("i,kq->ikq", e, np.ones(top.dx.shape))) for e in unit])
    points = mesh.p.T.copy()
    return Block(points, K, loads, np.flatnonzero(points[:, 2] == 0.0), share.assemble(under))


def on_floor(
    body, traction, *, bound=1.0, contact="bilateral", coefficient=None, held=True, gap=0.0, frames=None, ground=None
):
    """Return the System of the block on its floor.

    Parameters
    ----------
    traction : callable t -> (3,)
        Force per area on the top.
    bound : float
        Tresca's friction bound, a force per area.
    contact : "bilateral" or "unilateral"
    coefficient : float, optional
        Coulomb's coefficient, in place of the bound.
    held : bool
        True if the face x = 1 is clamped.
    frames : (m,) angles, optional
        Angles by which the tangential frames are rotated.
    """
    n = len(body.points)
    fixed = np.zeros((n, 3), dtype=bool)
    if held:
        fixed[body.points[:, 0] == 1.0] = True
    if contact == "bilateral":
        fixed[body.floor, 2] = True
    free = np.flatnonzero(~fixed.ravel())
    number = np.full(3 * n, -1)
    number[free] = np.arange(len(free))
    nodes = body.floor[~fixed[body.floor, 0]]
    angle = np.zeros(len(nodes)) if frames is None else frames
    m = len(nodes)
    rows = np.repeat(np.arange(2 * m), 2)
    columns = np.repeat(np.column_stack([number[3 * nodes], number[3 * nodes + 1]])[:, None], 2, axis=1).ravel()
    turn = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], axis=1).ravel()
    keep = turn != 0
    B = sp.csr_matrix((turn[keep], (rows[keep], columns[keep])), shape=(2 * m, len(free)))
    K = sp.csr_matrix(body.K[free][:, free])
    loads = body.top[:, free]
    weights = body.shares[nodes]
    limits = None
    norms = vx.Norms(B, bound * weights, block=2, ground=ground)
    if contact == "unilateral":
        D = sp.csr_matrix((-np.ones(m), (np.arange(m), number[3 * nodes + 2])), shape=(m, len(free)))
        limits = vx.Limits(D, np.full(m, gap))
        if coefficient is not None:
            norms = vx.Norms(
                B,
                np.zeros(m),
                block=2,
                law=vx.Law(
                    lambda t, p, past, slip: coefficient * p,
                    slope=lambda t, p, past: sp.csr_matrix(coefficient * sp.eye_array(m)),
                    slips=False,
                ),
            )
    x = body.points - 0.5
    rigid = np.zeros((n, 3, 6))
    rigid[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for k, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))):
        rigid[:, i, 3 + k], rigid[:, j, 3 + k] = -x[:, j], x[:, i]
    return vx.System(
        K, lambda t: np.asarray(traction(t)) @ loads, norms, limits=limits, near_kernel=rigid.reshape(3 * n, 6)[free]
    )


def assert_within_both_certificates(system, direct, iterative):
    """Check that steps of both linear solvers agree within their certificates, and that the same terms stick."""
    assert iterative.certificate.max() <= 1e-8
    apart = iterative.state - direct.state
    distance = np.sqrt(np.maximum(np.einsum("si,si->s", apart, (system.K @ apart.T).T), 0.0))
    claimed = iterative.certificate_total + direct.certificate_total
    claimed = claimed + iterative.certificate_floor + direct.certificate_floor
    assert (distance <= claimed * direct.unit).all()
    assert np.array_equal(iterative.sticking, direct.sticking)
