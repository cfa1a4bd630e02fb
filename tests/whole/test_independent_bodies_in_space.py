"""Two bodies of tetrahedra against a program that was written again from scratch: scikit-fem, cvxpy, Clarabel.

On tetrahedra virtual elements are linear elements. Where two tilings are the same triangles, every node of the joint
exists twice; its weight is a third of the areas of its triangles. Contact with a gap that moves and Tresca's friction
between the bodies, the lower one clamped, the upper one moved to and fro.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

import vemcvx as vx

YOUNG, POISSON = (40.0, 100.0), (0.3, 0.2)
BOUND, N = 0.25, 3
TIMES = [0.0, 0.2, 0.5, 0.7, 1.0]


def top(x, t):
    """Down, and around."""
    moved = np.array([0.05 * np.sin(5 * t), 0.04 * t, -0.02 - 0.03 * np.sin(3 * t)]) * min(1.0, 4 * t)
    return np.tile(moved, (len(x), 1)) + 0.02 * t * x[:, [1, 0, 2]] * [1, -1, 0]


def gap(x, t):
    return 0.004 + 0.03 * np.sin(4 * t) ** 2 * x[:, 0]


def solved(points, cells, faces, body):
    """Steps of the program with doubled nodes: nodes (n, 3) and tetrahedra of both bodies, triangles of the joint."""
    n = len(points)
    K = sp.csr_matrix((3 * n, 3 * n))
    for number in range(2):
        mine = np.unique(cells[body == number])
        local = skfem.MeshTet(points[mine].T.copy(), np.searchsorted(mine, cells[body == number]).T.copy())
        basis = skfem.Basis(local, skfem.ElementVector(skfem.ElementTetP1()))
        form = linear_elasticity(*lame_parameters(YOUNG[number], POISSON[number]))
        inner = sp.coo_matrix(form.assemble(basis))
        # scikit-fem numbers the components of one node after the other.
        order = (3 * mine[:, None] + np.arange(3)).ravel()
        K = K + sp.csr_matrix((inner.data, (order[inner.row], order[inner.col])), shape=K.shape)
    first, second = faces
    area = 0.5 * np.linalg.norm(np.cross(*(points[first[:, k]] - points[first[:, 0]] for k in (1, 2))), axis=1)
    weights = np.bincount(first.ravel(), np.repeat(area / 3, 3), n)
    partner = np.full(n, -1)
    partner[first.ravel()] = second.ravel()
    i = np.flatnonzero(partner >= 0)
    jump = np.zeros((len(i), n))
    jump[np.arange(len(i)), i], jump[np.arange(len(i)), partner[i]] = 1.0, -1.0
    x, y, z = (sp.csr_matrix(np.kron(jump, axis)) for axis in np.eye(3)[:, None])
    held = np.isclose(points[:, 2], points[:, 2].min()) | np.isclose(points[:, 2], points[:, 2].max())
    fixed = (3 * np.flatnonzero(held)[:, None] + np.arange(3)).ravel()
    u, steps = np.zeros(3 * n), [np.zeros((n, 3))]
    low = np.isclose(points[held][:, 2], points[:, 2].min())
    for t in TIMES[1:]:
        v = cp.Variable(3 * n)
        values = np.where(low[:, None], 0.0, top(points[held], t)).ravel()
        slip = cp.vstack([x @ (v - u), y @ (v - u)])
        problem = cp.Problem(
            cp.Minimize(0.5 * cp.quad_form(v, cp.psd_wrap(K)) + BOUND * weights[i] @ cp.norm(slip, 2, axis=0)),
            [v[fixed] == values, z @ v <= gap(points[i], t)],
        )
        problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
        u = v.value
        steps.append(u.reshape(n, 3))
    return np.array(steps)


def test_matching_tetrahedra_are_linear_elements_with_doubled_nodes():
    lower = vx.meshes.tetrahedra(N)
    upper = vx.meshes.tetrahedra(N, box=((0, 1), (0, 1), (1, 2)))
    mesh = vx.meshes.bodies({"lower": lower, "upper": upper})
    joint = mesh.interfaces["lower|upper"]
    # The tilings are the same: nothing is cut, and no node is new.
    assert mesh.n_nodes == lower.n_nodes + upper.n_nodes
    assert joint.edges.shape == (2 * N**2, 3)
    scene = vx.Scene(
        *(vx.Elasticity(E, nu, on=name) for E, nu, name in zip(YOUNG, POISSON, joint.bodies, strict=True)),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(top, on="upper.top"),
        vx.UnilateralContact(on="lower|upper", gap=gap),
        vx.TrescaFriction(BOUND, on="lower|upper", while_closed=False),
    )
    history = vx.simulate(scene, mesh, TIMES)
    cells = np.array([np.unique(np.concatenate(cell)) for cell in mesh.cells])
    other = solved(mesh.points, cells, (joint.edges, joint.partners), mesh.cell_data["body"])
    assert np.abs(history.displacement - other).max() < 1e-6 * np.abs(other).max()
    contact = history.contact
    assert ((contact.closed_count > 0) & (contact.closed_count < len(contact.nodes))).any()
    assert ((contact.slip_count > 0) & (contact.stick_count > 0)).any()
