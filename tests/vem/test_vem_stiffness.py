"""The stiffness matrix in the plane and in space: rigid modes, patch test, invariance, closed forms, first order."""

from __future__ import annotations

import full_slip_in_space as full_slip
import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from scenes import FAMILIES, small
from skfem.models.elasticity import linear_elasticity
from solids import SOLIDS, solid

import manufactured_full_slip as full_slip_in_plane
import vemcvx as vx
from stabilisations_of_ones_own import patch_error
from vemcvx.vem import Space, edge_load, stiffness, strains, stress_load
from vemcvx.vem.elasticity import rigid_modes
from vemcvx.vem.projection import face_groups

EPS = np.finfo(float).eps
SLOPE = np.array([[0.3, -1.2, 0.4], [0.7, 0.4, 0.1], [-0.2, 0.5, 0.6]])
COMPONENTS = {2: ([0, 1, 0], [0, 1, 1]), 3: ([0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2])}
"""Rows and columns of the components of a symmetric tensor."""
LONG = dict.fromkeys(("kelvin", "prisms"), pytest.mark.long)


@pytest.fixture(params=[pytest.param(name, marks=LONG.get(name, ())) for name in (*FAMILIES, *SOLIDS)])
def mesh(request):
    """Return a mesh in the plane or in space."""
    name = request.param
    return small(name, 4) if name in FAMILIES else solid(name, 2, ((0.0, 1.0), (0.0, 1.2), (-0.3, 0.6)))


def draw_moduli(mesh):
    """Return lambda and mu, which differ from cell to cell."""
    return np.random.default_rng(0).uniform(0.5, 3.0, (2, mesh.n_cells))


def assemble(mesh, stabilisation="shear"):
    return stiffness(Space(mesh), *draw_moduli(mesh), stabilisation)


def with_points(mesh, points):
    """Return the mesh with other points, without checks."""
    return type(mesh).unchecked(points, *(getattr(mesh, name) for name in mesh.ARRAYS[1:]))


def find_largest(A):
    return np.abs(A.data).max(initial=0.0) if sp.issparse(A) else np.abs(A).max()


def is_identical(A, B):
    """Return True if two sparse matrices are equal to the bit."""
    return (A != B).nnz == 0


def test_matrices_are_symmetric_to_the_bit_and_rigid_modes_are_their_kernel(mesh):
    for stabilisation in ("shear", "unit"):
        K, motions = assemble(mesh, stabilisation), rigid_modes(mesh.points)
        assert K.has_canonical_format
        assert is_identical(K, K.T.tocsr())
        values, count = np.linalg.eigvalsh(K.toarray()), motions.shape[1]
        floor = 10 * K.shape[0] * EPS * values[-1]  # rounding of a backward stable eigenvalue solver
        assert count == (3 if mesh.points.shape[1] == 2 else 6)
        assert np.abs(values[:count]).max() < floor
        assert values[count] > 1e-5 * values[-1]
        assert np.abs(K @ motions).max() < floor


def test_linear_displacements_have_the_forces_of_their_stresses_and_tractions(mesh):
    """For linear u, v'Ku is the sum over cells E of |E| sigma : eps(Pi v). Uniform stresses balance tractions."""
    space, (lam, mu), dim = Space(mesh), draw_moduli(mesh), mesh.points.shape[1]
    (a, b), slope = COMPONENTS[dim], SLOPE[:dim, :dim]
    strain, u = 0.5 * (slope + slope.T), mesh.points @ slope.T + [0.2, -0.1, 0.3][:dim]
    assert np.abs(strains(space, u) - strain[a, b] * (1.0 + np.not_equal(a, b))).max() < 1e-13
    stress = 2 * mu[:, None, None] * strain + lam[:, None, None] * np.trace(strain) * np.eye(dim)
    K = stiffness(space, lam, mu)
    rounding = (abs(K) @ np.abs(u.ravel())).max()
    assert np.abs(K @ u.ravel() - stress_load(space) @ stress[:, a, b].ravel()).max() < 1e-13 * rounding
    part = space.part("boundary", "test")
    _, matrix, sides = edge_load(space, part)
    forces = stress_load(space) @ np.tile(strain[a, b], mesh.n_cells)
    assert np.abs(matrix @ (part.normals[sides] @ strain).ravel() - forces).max() < 1e-13


def split_centre(gap):
    """Return four cells with a middle edge of length `gap`."""
    points = [[0, 0], [0.5, 0], [1, 0], [0, 0.5], [0.5, 0.5], [0.5 + gap, 0.5], [1, 0.5], [0, 1], [0.5, 1], [1, 1]]
    return vx.PolygonMesh(points, [[0, 1, 5, 4, 3], [1, 2, 6, 5], [3, 4, 8, 7], [4, 5, 6, 9, 8]])


@pytest.mark.parametrize("stabilisation", ["shear", "unit"])
def test_cells_with_short_edges_pass_the_patch_test(stabilisation):
    for hard in (split_centre(1e-6), split_centre(1e-12)):
        assert patch_error(stabilisation, hard) < 1e-11
        K = assemble(hard, stabilisation)
        assert is_identical(K, K.T.tocsr())


@pytest.mark.parametrize("dim", [2, 3])
def test_triangles_and_tetrahedra_are_linear_finite_elements(dim):
    mesh = vx.meshes.triangles(5) if dim == 2 else vx.meshes.tetrahedra(3)
    kind, element = (skfem.MeshTri, skfem.ElementTriP1()) if dim == 2 else (skfem.MeshTet, skfem.ElementTetP1())
    cells = mesh.cell_nodes[1].reshape(-1, dim + 1)
    basis = skfem.Basis(kind(mesh.points.T.copy(), cells.T.copy()), skfem.ElementVector(element))
    fields = [np.broadcast_to(m[:, None], (mesh.n_cells, basis.X.shape[-1])) for m in draw_moduli(mesh)]
    expected, order = linear_elasticity(*fields).assemble(basis), basis.nodal_dofs.T.ravel()
    K = assemble(mesh)
    assert find_largest(K - expected[order][:, order]) < 1e-12 * find_largest(K)
    assert is_identical(K, assemble(mesh, "unit"))  # the stabilisation of simplices is zero


def compute_by_formula(mesh, tau):
    """Compute the matrix (3.13) of Feng, Han and Huang. In a cell, Pi of a basis function solves a 6 x 6 system."""
    K = np.zeros((2 * mesh.n_nodes,) * 2)
    for cell, area, la, m, t in zip(mesh.cells, mesh.areas, *draw_moduli(mesh), tau, strict=True):
        x = mesh.points[cell] - mesh.points[cell].mean(axis=0)
        n = len(x)
        chord = np.roll(x, -1, axis=0) - x
        normal, length = np.column_stack([chord[:, 1], -chord[:, 0]]), np.linalg.norm(chord, axis=1)

        def moments(v, normal=normal, length=length):
            """Integrate strain and rotation over a cell, and v over the boundary, for v linear on edges."""
            mean = 0.5 * (v + np.roll(v, -1, axis=0))
            d = np.einsum("ia,ib->ab", mean, normal)
            return np.array([d[0, 0], d[1, 1], d[0, 1] + d[1, 0], d[1, 0] - d[0, 1], *(length @ mean)])

        linear = np.zeros((6, n, 2))
        linear[0, :, 0] = linear[1, :, 1] = 1.0
        linear[2, :, 0], linear[3, :, 0], linear[4, :, 1], linear[5, :, 1] = x[:, 0], x[:, 1], x[:, 0], x[:, 1]
        basis = np.eye(2 * n).reshape(2 * n, n, 2)
        both = (np.array([moments(v) for v in fields]).T for fields in (linear, basis))
        coefficients = np.linalg.solve(*both)
        rest = (basis - np.tensordot(coefficients.T, linear, 1)).reshape(2 * n, -1)
        e = np.array([coefficients[2], coefficients[5], coefficients[3] + coefficients[4]])
        law = np.diag([2 * m, 2 * m, m]) + la * np.outer([1, 1, 0], [1, 1, 0])
        unknowns = (2 * cell[:, None] + [0, 1]).ravel()
        K[np.ix_(unknowns, unknowns)] += area * e.T @ law @ e + t * rest @ rest.T
    return K


@pytest.mark.parametrize("stabilisation", ["shear", "unit"])
def test_matrices_agree_with_the_formula_of_the_paper(family, stabilisation):
    mesh = small(family, 2)
    mu = draw_moduli(mesh)[1]
    expected = compute_by_formula(mesh, 2 * mu if stabilisation == "shear" else np.ones_like(mu))
    K = assemble(mesh, stabilisation)
    # The 6 x 6 systems have condition numbers below 20.
    assert find_largest(K.toarray() - expected) < 1e-12 * find_largest(K)


def test_distance_from_the_origin_changes_no_bit_of_the_matrix(mesh):
    """Points on a grid with the spacing 2^-20 are shifted by 2^20 without rounding."""
    points = np.round(mesh.points * 2**20) / 2**20
    assert is_identical(assemble(with_points(mesh, points)), assemble(with_points(mesh, points + 2.0**20)))


def test_units_that_are_powers_of_two_change_no_bit(mesh):
    (lam, mu), dim, factor = draw_moduli(mesh), mesh.points.shape[1], 2.0**-40
    K = assemble(mesh)
    assert is_identical(assemble(with_points(mesh, factor * mesh.points)), factor ** (dim - 2) * K)
    assert is_identical(stiffness(Space(mesh), factor * lam, factor * mu), factor * K)


FACES = {
    "triangle": [(0, 0), (2, 0), (0, 1)],
    "rectangle": [(0, 0), (3, 0), (3, 1), (0, 1)],
    "hanging nodes": [(0, 0), (1, 0), (2, 0), (2, 1), (2, 1.5), (2, 2), (0, 2)],
    "dart": [(0, 0), (2, -1), (0.5, 0), (2, 1)],
    "not star-shaped": [(0, 0), (3, 0), (3, 3), (0, 3), (0, 2), (2, 2), (2, 1), (0, 1)],
}


@pytest.mark.parametrize("name", FACES)
def test_weights_of_vertices_of_a_face_are_positive_and_exact(name):
    """On a face of area A and centroid c, sum a_i = A and sum a_i x_i = A c for a_i = int phi_i."""
    flat = np.array(FACES[name], dtype=float)
    after = np.roll(flat, -1, axis=0)
    cross = flat[:, 0] * after[:, 1] - after[:, 0] * flat[:, 1]
    area = 0.5 * cross.sum()
    centroid = (flat + after).T @ cross / (6 * area)
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    axes[:, 2] *= np.linalg.det(axes)
    origin = np.array([5.0, -3.0, 2.0])
    points, n = flat @ axes[:, :2].T + origin, len(flat)
    (group,) = face_groups(points, np.array([0, n]), np.arange(n), np.array([0]))
    a = group.shares[0]
    assert (a > 0).all()
    assert a.sum() == pytest.approx(area, rel=1e-14)
    assert a @ points / area == pytest.approx(origin + axes[:, :2] @ centroid, rel=1e-14)
    assert group.vector_shares[0].sum(axis=0) == pytest.approx(area * axes[:, 2], rel=1e-14, abs=1e-14)
    if name in ("triangle", "rectangle"):
        assert a == pytest.approx(area / n, rel=1e-14)
    places, shares = group.quadrature()
    assert shares[0].sum(axis=1) == pytest.approx(a, rel=1e-14)
    # The basis functions at quadrature points reproduce linear functions.
    reproduced = shares[0].sum(axis=0)[:, None] * (places[0] - origin)
    assert shares[0].T @ (points - origin) == pytest.approx(reproduced, abs=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("family", vx.meshes.SPACE_FAMILIES)
@pytest.mark.filterwarnings("ignore:Elasticity. poisson")
def test_errors_in_space_halve_with_h_for_small_and_large_lambda(family):
    """The ratio lambda / mu is 1.5 or 1e6. For tetrahedra, the ratio is 1.5, because linear elements lock at 1e6."""
    for poisson in (0.3,) if family == "tetrahedra" else (0.3, 0.4999995):
        scene, lam = full_slip.scene(poisson, pulled=True), full_slip_in_plane.lame(poisson)
        runs = (vx.simulate(scene, vx.meshes.SPACE_FAMILIES[family](n), [0.0, 1.0], check=False) for n in (4, 8))
        coarse, fine = (full_slip.energy_error(run, lam) for run in runs)
        assert coarse < 0.5
        assert np.log2(coarse / fine) > 0.8, (poisson, coarse, fine)
