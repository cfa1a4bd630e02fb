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
from vemcvx.bound.fan import distinct, fans_of
from vemcvx.bound.stress import stress_form
from vemcvx.vem import Space
from vemcvx.vem.tensors import elastic_matrix

GRADIENT = np.array([[1.0, 2.0], [0.3, -0.5]])
STRAIN = np.array([1.0, -0.5, 2.3])


def fans(family="voronoi", lam=1.5, n=6):
    mesh = small(family, n)
    return fans_of(Space(mesh), elastic_matrix(np.stack([np.full(mesh.n_cells, lam), np.ones(mesh.n_cells)])))


def edge_motion(one, field):
    """Return the values of a field at both ends of outer edges."""
    return np.stack([field(one.corners), field(np.roll(one.corners, -1, axis=1))], axis=2).reshape(len(one.cells), -1)


def outline_of(one, field):
    """Return the values of a field at vertices and middles of edges."""
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

    The displacement is linear on each edge, with the values u at vertices.
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
    for one in fans(family, lam):
        inner = inside(one, outline_of(one, linear), np.zeros((len(one.cells), 6)))
        error = np.abs(strains_at_stations(one, inner) - STRAIN).max()
        assert error < 1e-11 if lam == 1.5 else lam * error**2 < 1e-9


@mostly_slow("lam", [1.5, 100.0])
@pytest.mark.long
def test_forms_enclose_the_least_energy_of_a_cell(lam):
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
    eps = np.finfo(float).eps
    rows = np.array([[0.0, 1.0, 2.0]] * 40 + [[0.0, 1.0 + eps, 2.0 - 2 * eps]] * 40)
    rows = rows[np.random.default_rng(0).permutation(80)]
    some, same = distinct([rows])
    assert len(some) == 2
    assert np.array_equal(rows[some][same], rows)
    assert distinct([np.random.default_rng(0).random((80, 3))])[0] == slice(None)
