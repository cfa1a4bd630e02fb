"""Two bodies of tetrahedra are compared with an independent program (scikit-fem, cvxpy, Clarabel) and with GetFEM.

On tetrahedra, virtual elements are linear elements. Both bodies have the same triangles at the joint, so every node of
the joint exists twice. The weight of a node is a third of the area of its triangles. The lower body is clamped, the
upper body is moved. The independent program has a moving gap and Tresca's friction. GetFEM has Coulomb's friction
between nodes, and applies Newton's method to an augmented Lagrangian. The Debian package python3-getfem serves the
system's Python only.
"""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

import vemcvx as vx

YOUNG, POISSON = (40.0, 100.0), (0.3, 0.2)
BOUND, N = 0.25, 3
TIMES = [0.0, 0.2, 0.5, 0.7, 1.0]


def top(x, t):
    """Return the displacement of the top, which is pressed down, moved along a curve and rotated."""
    moved = np.array([0.05 * np.sin(5 * t), 0.04 * t, -0.02 - 0.03 * np.sin(3 * t)]) * min(1.0, 4 * t)
    return np.tile(moved, (len(x), 1)) + 0.02 * t * x[:, [1, 0, 2]] * [1, -1, 0]


def gap(x, t):
    return 0.004 + 0.03 * np.sin(4 * t) ** 2 * x[:, 0]


def solve_independently(points, cells, faces, body):
    """Return the displacements at every instant; `faces` are the triangles of both bodies at the joint."""
    n = len(points)
    K = sp.csr_matrix((3 * n, 3 * n))
    for number in range(2):
        mine = np.unique(cells[body == number])
        local = skfem.MeshTet(points[mine].T.copy(), np.searchsorted(mine, cells[body == number]).T.copy())
        basis = skfem.Basis(local, skfem.ElementVector(skfem.ElementTetP1()))
        form = linear_elasticity(*lame_parameters(YOUNG[number], POISSON[number]))
        inner = sp.coo_matrix(form.assemble(basis))
        # scikit-fem numbers the unknowns node by node.
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


def simulate_blocks(n, contact, steps=TIMES, moved=top):
    """Return the history of two blocks, and the four nodes of each tetrahedron."""
    lower = vx.meshes.tetrahedra(n)
    upper = vx.meshes.tetrahedra(n, box=((0, 1), (0, 1), (1, 2)))
    mesh = vx.meshes.bodies({"lower": lower, "upper": upper})
    joint = mesh.interfaces["lower|upper"]
    # No face is cut, and no node is new.
    assert mesh.n_nodes == lower.n_nodes + upper.n_nodes
    assert joint.edges.shape == (2 * n**2, 3)
    scene = vx.Scene(
        *(vx.Elasticity(E, nu, on=name) for E, nu, name in zip(YOUNG, POISSON, joint.bodies, strict=True)),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(moved, on="upper.top"),
        *contact,
    )
    return vx.simulate(scene, mesh, steps), np.array([np.unique(np.concatenate(cell)) for cell in mesh.cells])


@pytest.mark.parametrize("n", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_matching_tetrahedra_are_linear_elements_with_doubled_nodes(n):
    history, cells = simulate_blocks(
        n,
        [
            vx.UnilateralContact(on="lower|upper", gap=gap),
            vx.TrescaFriction(BOUND, on="lower|upper", while_closed=False),
        ],
    )
    mesh, contact = history.mesh, history.contact
    joint = mesh.interfaces["lower|upper"]
    other = solve_independently(mesh.points, cells, (joint.edges, joint.partners), mesh.cell_data["body"])
    assert np.abs(history.displacement - other).max() < 1e-6 * np.abs(other).max()
    assert ((contact.open_count > 0) & (contact.open_count < len(contact.nodes))).any()
    assert ((contact.slip_count > 0) & (contact.stick_count > 0)).any()


PEER, FRICTION = "/usr/bin/python3", 0.3
GETFEM = """
import sys, numpy as np, getfem as gf
d = np.load(sys.argv[1])
points, away = d["points"], 5.0 * np.ones(3)  # GetFEM merges coinciding nodes: the upper body is moved away
mesh, model, cells = gf.Mesh("empty", 3), gf.Model("real"), ([], [])
for body, cell in zip(d["body"], d["cells"]):
    cells[body].append(mesh.add_convex(gf.GeoTrans("GT_PK(3,1)"), (points[cell] + body * away).T))
fem, integral = gf.MeshFem(mesh, 3), gf.MeshIm(mesh, gf.Integ("IM_TETRAHEDRON(2)"))
fem.set_fem(gf.Fem("FEM_PK(3,1)"))
model.add_fem_variable("u", fem)
for body, (young, poisson) in enumerate(zip(d["young"], d["poisson"])):
    every = [np.ravel(cells[body]), np.full(len(cells[body]), -1)]
    mesh.set_region(10 + body, np.array(every))
    model.add_initialized_data(f"lame{body}", [young * poisson / (1 + poisson) / (1 - 2 * poisson)])
    model.add_initialized_data(f"mu{body}", [young / 2 / (1 + poisson)])
    model.add_isotropic_linearized_elasticity_brick(integral, "u", f"lame{body}", f"mu{body}", 10 + body)
x = fem.basic_dof_nodes()[:, ::3].T
upper = x[:, 2] > 4.0
x = x - np.where(upper[:, None], away, 0.0)
there = [(np.abs(points - p).max(axis=1) < 1e-9) & (d["of_node"] == k) for p, k in zip(x, upper)]
node = np.array([np.flatnonzero(one)[0] for one in there])
faces = mesh.outer_faces()
level = [mesh.pts()[2, mesh.pid_in_faces(face[:, None])] for face in faces.T]
mesh.set_region(1, faces[:, [np.abs(z).max() < 1e-9 or np.abs(z - 7.0).max() < 1e-9 for z in level]])
model.add_initialized_fem_data("held", fem, d["held"][node].ravel())
model.add_Dirichlet_condition_with_multipliers(integral, "u", fem, 1, "held")
first = np.flatnonzero(~upper & (np.abs(x[:, 2] - 1.0) < 1e-9))
second = [np.flatnonzero(upper & (np.abs(x - x[i]).max(axis=1) < 1e-9))[0] for i in first]
BN, BT = gf.Spmat("empty", len(first), fem.nbdof()), gf.Spmat("empty", 2 * len(first), fem.nbdof())
for row, pair in enumerate(zip(first, second)):
    for k, sign in zip(pair, (1.0, -1.0)):
        BN.add(row, int(3 * k + 2), sign)
        BT.add(2 * row, int(3 * k), sign)
        BT.add(2 * row + 1, int(3 * k + 1), sign)
for name, value in (("r", d["young"].min()), ("friction", d["friction"]), ("gap", 0.0), ("alpha", 1.0)):
    model.add_initialized_data(name, [float(value)])
model.add_variable("normal", len(first))
model.add_variable("tangent", 2 * len(first))
model.add_basic_contact_brick("u", "normal", "tangent", "r", BN, BT, "friction", "gap", "alpha", 1)
model.solve("max_res", 1e-11, "max_iter", 200)
found = np.empty_like(points)
found[node] = model.variable("u").reshape(-1, 3)
np.save(sys.argv[2], found)
"""


@cache
def has_getfem():
    return not subprocess.run([PEER, "-c", "import getfem"], capture_output=True, check=False).returncode


def push_aside(x, t):
    """Return a motion that presses the upper block down, tilts it and pushes it aside."""
    return t * np.column_stack([0.02 + 0 * x[:, 0], 0.01 * x[:, 0], -0.005 - 0.04 * x[:, 0] + 0.01 * x[:, 1]])


@pytest.mark.skipif(not Path(PEER).exists(), reason="the system has no Python")
@pytest.mark.parametrize("n", [pytest.param(3, marks=pytest.mark.long), pytest.param(8, marks=pytest.mark.slow)])
def test_coulombs_law_between_bodies_agrees_with_getfem(n, tmp_path):
    if not has_getfem():
        pytest.skip("GetFEM is not installed")
    laws = vx.UnilateralContact(on="lower|upper"), vx.CoulombFriction(FRICTION, on="lower|upper")
    history, cells = simulate_blocks(n, laws, [0.0, 1.0], push_aside)
    mesh, contact = history.mesh, history.contact
    held = np.where(mesh.points[:, 2:] > 1.5, push_aside(mesh.points, 1.0), 0.0)
    body = mesh.cell_data["body"]
    of_node = np.isin(np.arange(mesh.n_nodes), cells[body == 1])
    given = {"points": mesh.points, "cells": cells, "body": body, "of_node": of_node, "held": held}
    np.savez(tmp_path / "given.npz", young=YOUNG, poisson=POISSON, friction=FRICTION, **given)
    arguments = [PEER, "-c", GETFEM, str(tmp_path / "given.npz"), str(tmp_path / "found.npy")]
    made = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert not made.returncode, made.stderr
    other = np.load(tmp_path / "found.npy")
    assert np.abs(history.displacement[-1] - other).max() < 1e-10 * np.abs(other).max()
    assert 0 < contact.open_count[-1] < len(contact.nodes)
    assert contact.slip_count[-1] > 0 < contact.stick_count[-1]
