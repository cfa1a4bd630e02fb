"""Fans of triangles in polygons: stresses in equilibrium with given forces, and conforming displacements."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from bounds import inside, strains_at_stations
from scenes import mostly_long, mostly_slow, small
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity

from vemcvx.bound.displacement import displacement_form, to_edges
from vemcvx.bound.fan import CORNERS, LINEAR_MASS_INVERSE, PARTS, STATIONS, distinct, fans_of
from vemcvx.bound.stress import VOIGT, reference, stress_form
from vemcvx.vem import Space
from vemcvx.vem.tensors import elastic_matrix

GRADIENT = np.array([[1.0, 2.0], [0.3, -0.5]])
STRAIN = np.array([1.0, -0.5, 2.3])


def fans(family="voronoi", lam=1.5, n=6):
    mesh = small(family, n)
    return fans_of(Space(mesh), elastic_matrix(np.stack([np.full(mesh.n_cells, lam), np.ones(mesh.n_cells)])))


def balanced_forces():
    """Return a vector of balanced forces on the edges (3, 2, 2) and in the interior (3, 2) of a reference triangle."""
    ends = [CORNERS[k] for edge in range(3) for k in (edge, (edge + 1) % 3)]
    x = np.array([*ends, *CORNERS])
    rows = np.zeros((3, 9, 2))
    rows[0, :, 0] = rows[1, :, 1] = 1.0
    rows[2] = np.column_stack([-x[:, 1], x[:, 0]])
    return np.linalg.svd(rows.reshape(3, 18))[2][3:].T @ np.random.default_rng(0).normal(size=15)


def polynomial(points, values):
    """Return the coefficients (6, ...) of a quadratic polynomial from its values (6, ...) at points (6, 2)."""
    x, y = points.T
    return np.linalg.solve(np.column_stack([np.ones(6), x, y, x * x, x * y, y * y]), values)


def slopes(points, c):
    """Return the derivatives by x and y (q, ...) at points (q, 2) of a polynomial with coefficients c (6, ...)."""
    x, y = points.T
    return (
        np.tensordot(np.column_stack([0 * x, 1 + 0 * x, 0 * x, 2 * x, y, 0 * x]), c, 1),
        np.tensordot(np.column_stack([0 * x, 0 * x, 1 + 0 * x, 0 * x, x, 2 * y]), c, 1),
    )


def test_reference_stress_balances_linear_body_forces_at_every_point():
    data = balanced_forces()
    tau, density = (reference() @ data).reshape(3, 6, 3), LINEAR_MASS_INVERSE @ data[12:].reshape(3, 2)
    for points, values in zip(STATIONS, tau, strict=True):
        along_x, along_y = slopes(points, polynomial(points, values))
        divergence = np.column_stack([along_x[:, 0] + along_y[:, 2], along_x[:, 2] + along_y[:, 1]])
        corners = np.column_stack([1 - points.sum(axis=1), points])
        assert np.abs(divergence + corners @ density).max() < 1e-11


def test_reference_stress_has_the_given_tractions_and_balances_across_inner_edges():
    data = balanced_forces()
    tau = np.einsum("abk,pqk->pqab", VOIGT, (reference() @ data).reshape(3, 6, 3))
    forces, centre = data[:12].reshape(3, 2, 2), CORNERS.mean(axis=0)
    for k, (one, other, _) in enumerate(PARTS):
        along = CORNERS[other] - CORNERS[one]
        traction = tau[k][[0, 1, 3]] @ [along[1], -along[0]]
        first, last = 4 * forces[k, 0] - 2 * forces[k, 1], 4 * forces[k, 1] - 2 * forces[k, 0]
        assert np.abs(traction - [first, last, 0.5 * (first + last)]).max() < 1e-12
        inward = centre - CORNERS[one]
        normal = np.array([inward[1], -inward[0]])
        # The edge from corner to centroid has the stations 0, 5, 2 of this part, and 1, 4, 2 of the previous part.
        assert np.abs((tau[k][[0, 5, 2]] - tau[k - 1][[1, 4, 2]]) @ normal).max() < 1e-12


def edge_motion(one, field):
    """Return the values (c, 4 n) of a field at both ends of the outer edges."""
    return np.stack([field(one.corners), field(np.roll(one.corners, -1, axis=1))], axis=2).reshape(len(one.cells), -1)


def outline_of(one, field):
    """Return the values (c, 4 n) of a field at vertices and at middles of edges."""
    return field(one.outline).reshape(len(one.cells), -1)


def linear(x):
    return x @ GRADIENT.T


def test_constant_strains_have_exact_energies_and_tractions(family):
    """The displacement also contains a rigid motion, which causes no stress."""
    shifted = lambda x: linear(x) + np.array([1.0, 2.0])  # noqa: E731
    for one in fans(family):
        n, motion, stress = 4 * one.n, edge_motion(one, shifted), np.einsum("ckl,l->ck", one.C, STRAIN)
        forces = one.apply(stress_form(one)[:, :n, :n], motion)
        tractions = np.einsum("cna,cab->cnb", one.normals, stress[:, [[0, 2], [2, 1]]])
        assert np.allclose(forces.reshape(-1, one.n, 2, 2), 0.5 * tractions[:, :, None], atol=1e-10)
        energy = stress @ STRAIN * one.areas
        assert np.allclose(np.sum(motion * forces, axis=1), energy, rtol=1e-10)
        outline = outline_of(one, shifted)
        work = one.apply(displacement_form(one)[:, :n, :n], outline)
        assert np.allclose(np.sum(outline * work, axis=1), energy, rtol=1e-10)
        assert np.allclose(outline @ to_edges(one.n).T, motion, atol=1e-12)


def least_energy(one, k, u, force, lam):
    """Return the minimum of (energy - work of a body force) in a cell, computed by scikit-fem.

    The displacement is linear on each edge, with the values u at vertices; elements are quadratic.
    """
    corners = one.corners[k]
    points = np.concatenate([[[0.0, 0.0]], corners])
    t = np.array([[0, 1 + i, 1 + (i + 1) % len(corners)] for i in range(len(corners))])
    mesh = skfem.MeshTri(points.T.copy(), t.T.copy()).refined(4)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=4)
    K = linear_elasticity(lam, 1.0).assemble(basis)
    f = skfem.LinearForm(lambda v, w: dot(np.einsum("k...,kd->d...", np.stack([1 + 0 * w.x[0], *w.x]), force), v))
    f, x, v = f.assemble(basis), basis.doflocs, np.zeros(basis.N)
    ahead = np.roll(corners, -1, axis=0)
    for dof in basis.get_dofs().all():
        along = np.einsum("ia,ia->i", x[:, dof] - corners, ahead - corners) / np.sum((ahead - corners) ** 2, axis=1)
        off = np.linalg.norm(corners + along[:, None] * (ahead - corners) - x[:, dof], axis=1)
        i = int(np.argmin(np.where((along > -1e-9) & (along < 1 + 1e-9), off, np.inf)))
        value = (1 - along[i]) * u[i] + along[i] * u[(i + 1) % len(u)]
        v[dof] = value[int(dof in set(basis.get_dofs(elements=True).all(["u^2"])))]
    v = skfem.solve(*skfem.condense(K, f, x=v, D=basis.get_dofs().all()))
    return 0.5 * v @ (K @ v) - f @ v


@mostly_long("lam", [1.5, 1e6])
def test_linear_displacements_have_constant_strains_inside_cells(family, lam):
    """For large lambda, rounding is measured as an energy: lambda times the squared error of strains."""
    for one in fans(family, lam):
        inner = inside(one, outline_of(one, linear), np.zeros((len(one.cells), 6)))
        error = np.abs(strains_at_stations(one, inner) - STRAIN).max()
        assert error < 1e-11 if lam == 1.5 else lam * error**2 < 1e-9


@mostly_slow("lam", [1.5, 100.0])
@pytest.mark.long
def test_forms_enclose_the_least_energy_of_a_cell(lam):
    """Half the form of displacements bounds the least energy from above, half the form of stresses from below."""
    rng = np.random.default_rng(1)
    for one in fans(lam=lam, n=3):
        u, force = rng.normal(size=(one.n, 2)), 5.0 * rng.normal(size=(3, 2))
        outline = np.concatenate([u, 0.5 * (u + np.roll(u, -1, axis=0))]).ravel()
        motion = np.stack([u, np.roll(u, -1, axis=0)], axis=1).ravel()
        above, below = (
            0.5 * np.append(values, force) @ one.expand(form(one))[0] @ np.append(values, force)
            for values, form in ((outline, displacement_form), (motion, stress_form))
        )
        exact = least_energy(one, 0, u, force, lam)
        assert below <= exact <= above + 1e-9 * abs(above)


def test_cells_that_differ_in_the_last_bit_have_separate_matrices():
    """The two kinds of rows differ, but the sums of their entries are equal after rounding."""
    eps = np.finfo(float).eps
    rows = np.array([[0.0, 1.0, 2.0]] * 40 + [[0.0, 1.0 + eps, 2.0 - 2 * eps]] * 40)
    rows = rows[np.random.default_rng(0).permutation(80)]
    some, same = distinct([rows])
    assert len(some) == 2
    assert np.array_equal(rows[some][same], rows)
    assert distinct([np.random.default_rng(0).random((80, 3))])[0] == slice(None)
