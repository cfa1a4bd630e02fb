"""The stiffness matrix: rigid modes, consistency, patch test, invariance, and (3.13) computed literally."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import skfem
from scenes import small
from scipy.sparse.linalg import spsolve
from skfem.models.elasticity import linear_elasticity

import vemcvx as vx
from vemcvx.vem import Space, SumOverCells, rigid_modes, stiffness
from vemcvx.vem.elasticity import distinct, local_blocks

SLOPE = np.array([[0.3, -1.2], [0.7, 0.4]])
EPS = np.finfo(float).eps


def mesh_of(family, n=4):
    return small(family, n)


def moduli(mesh, seed=0):
    """lam and mu that differ from cell to cell."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.5, 3.0, mesh.n_cells), rng.uniform(0.5, 3.0, mesh.n_cells)


def matrix(mesh, stabilisation="shear", lam=None, mu=None):
    if lam is None:
        lam, mu = moduli(mesh)
    return stiffness(Space(mesh), lam, mu, stabilisation)


def moved(mesh, points, order=None):
    """The same cells on other points."""
    cells = list(mesh.cells) if order is None else [mesh.cells[c] for c in order]
    return vx.PolygonMesh(points, cells)


def largest(A):
    return np.abs(A.data).max(initial=0.0) if sp.issparse(A) else np.abs(A).max()


def same(A, B):
    """Equal to the bit, entry by entry."""
    return (A != B).nnz == 0


@pytest.fixture
def mesh(family):
    return mesh_of(family)


@pytest.mark.parametrize("stabilisation", ["shear", "unit"])
class TestEveryFamily:
    def test_symmetric_to_the_bit(self, mesh, stabilisation):
        K = matrix(mesh, stabilisation)
        assert K.has_canonical_format
        assert same(K, K.T.tocsr())

    def test_kernel_is_the_three_rigid_modes(self, family, stabilisation):
        mesh = mesh_of(family, 3)
        K = matrix(mesh, stabilisation).toarray()
        values = np.linalg.eigvalsh(K)
        floor = len(K) * EPS * values[-1]  # of a backward stable eigenvalue solver
        assert np.abs(values[:3]).max() < 10 * floor
        # The softest deformation, about mu h^2, against the stiffest, about lam + 2 mu with h = 1/3: near 1e-2.
        assert values[3] > 1e-4 * values[-1]
        assert largest(K @ rigid_modes(mesh.points)) < 10 * floor

    def test_consistency(self, mesh, stabilisation):
        """a^h(p, v) = sum over cells of int_dK sigma(p) n . v ds for linear p and every v."""
        lam, mu = moduli(mesh)
        strain = 0.5 * (SLOPE + SLOPE.T)
        stress = 2 * mu[:, None, None] * strain + lam[:, None, None] * np.trace(strain) * np.eye(2)
        expected = np.zeros((mesh.n_nodes, 2))
        for cell, sigma in zip(mesh.cells, stress, strict=True):
            x = mesh.points[cell]
            chord = np.roll(x, -1, axis=0) - x
            half = 0.5 * np.column_stack([chord[:, 1], -chord[:, 0]]) @ sigma
            np.add.at(expected, cell, half + np.roll(half, 1, axis=0))
        K = matrix(mesh, stabilisation, lam, mu)
        p = (mesh.points @ SLOPE.T).ravel()
        rounding = (abs(K) @ np.abs(p)).max()
        assert np.abs(K @ p - expected.ravel()).max() < 1e-13 * rounding

    def test_patch(self, mesh, stabilisation):
        assert patch_error(mesh, stabilisation) < 1e-11


def patch_error(mesh, stabilisation):
    """Largest relative error of a linear field from its boundary values, moduli constant."""
    K = matrix(mesh, stabilisation, np.full(mesh.n_cells, 1.5), np.full(mesh.n_cells, 0.8))
    exact = (mesh.points @ SLOPE.T + [0.2, -0.1]).ravel()
    held = np.unique(mesh.boundaries["boundary"])
    free = np.setdiff1d(np.arange(mesh.n_nodes), held)
    inside, outside = (2 * np.array(i)[:, None] + [0, 1] for i in (free, held))
    inside, outside = inside.ravel(), outside.ravel()
    assert len(inside)
    u = spsolve(K[inside][:, inside].tocsc(), -K[inside][:, outside] @ exact[outside])
    return np.abs(u - exact[inside]).max() / np.abs(exact).max()


def split_centre(gap):
    """Four cells whose common corner is torn into an edge of length `gap`."""
    points = [[0, 0], [0.5, 0], [1, 0], [0, 0.5], [0.5, 0.5], [0.5 + gap, 0.5], [1, 0.5], [0, 1], [0.5, 1], [1, 1]]
    return vx.PolygonMesh(points, [[0, 1, 5, 4, 3], [1, 2, 6, 5], [3, 4, 8, 7], [4, 5, 6, 9, 8]])


def comb():
    """A comb-shaped cell that holds five squares between and beside its teeth, with one node inside each gap."""
    points = [[0, 0], [5, 0], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]]
    middle = [[3.5, 2], [1.5, 2]]
    cells = [list(range(12)), [4, 3, 12], [3, 6, 12], [6, 5, 12], [5, 4, 12], [8, 7, 13], [7, 10, 13], [10, 9, 13]]
    return vx.PolygonMesh(points + middle, [*cells, [9, 8, 13]])


@pytest.mark.parametrize("stabilisation", ["shear", "unit"])
@pytest.mark.parametrize(
    "make", [lambda: split_centre(1e-6), lambda: split_centre(1e-12), comb], ids=["-6", "-12", "comb"]
)
def test_patch_on_hard_cells(make, stabilisation):
    """Edges of 1e-12 h, and a cell with two deep notches."""
    hard = make()
    assert patch_error(hard, stabilisation) < 1e-11
    K = matrix(hard, stabilisation)
    assert same(K, K.T.tocsr())


def test_triangles_are_linear_finite_elements():
    mesh = mesh_of("triangles", 5)
    lam, mu = moduli(mesh)
    element = skfem.ElementVector(skfem.ElementTriP1())
    flat = skfem.MeshTri(mesh.points.T.copy(), mesh.vertices.reshape(-1, 3).T.copy())
    basis = skfem.Basis(flat, element)
    points = (mesh.n_cells, basis.X.shape[-1])
    fields = [np.broadcast_to(m[:, None], points) for m in (lam, mu)]
    expected = linear_elasticity(*fields).assemble(basis)
    K = matrix(mesh, "shear", lam, mu)
    assert largest(K - expected) < 1e-12 * largest(K)
    assert same(K, matrix(mesh, "unit", lam, mu))  # nothing to stabilise
    with pytest.raises(vx.SceneError, match="found stabilisation 'trace'; there are 'shear' and 'unit'"):
        matrix(mesh, "trace")


def literal(mesh, lam, mu, tau):
    """(3.13) basis function by basis function: Pi from the three conditions by least squares."""
    K = np.zeros((2 * mesh.n_nodes,) * 2)
    for cell, area, la, m, t in zip(mesh.cells, mesh.areas, lam, mu, tau, strict=True):
        x = mesh.points[cell] - mesh.points[cell].mean(axis=0)
        n = len(x)
        chord = np.roll(x, -1, axis=0) - x
        normal, length = np.column_stack([chord[:, 1], -chord[:, 0]]), np.linalg.norm(chord, axis=1)

        def moments(v, normal=normal, length=length):
            """Integrals over K of the strain and the rotation, over dK of the field, of v linear on edges."""
            mean = 0.5 * (v + np.roll(v, -1, axis=0))
            d = np.einsum("ia,ib->ab", mean, normal)
            return np.array([d[0, 0], d[1, 1], d[0, 1] + d[1, 0], d[1, 0] - d[0, 1], *(length @ mean)])

        linear = np.zeros((6, n, 2))
        linear[0, :, 0] = linear[1, :, 1] = 1.0
        linear[2, :, 0], linear[3, :, 0], linear[4, :, 1], linear[5, :, 1] = x[:, 0], x[:, 1], x[:, 0], x[:, 1]
        of_linear = np.array([moments(q) for q in linear]).T
        basis = np.eye(2 * n).reshape(2 * n, n, 2)
        coefficients = [np.linalg.solve(of_linear, moments(v)) for v in basis]
        strain = [np.array([c[2], c[5], c[3] + c[4]]) for c in coefficients]
        rest = [(v - np.tensordot(c, linear, 1)).ravel() for v, c in zip(basis, coefficients, strict=True)]
        unknowns = (2 * cell[:, None] + [0, 1]).ravel()
        for i, a in enumerate(unknowns):
            for j, b in enumerate(unknowns):
                e, f = strain[i], strain[j]
                K[a, b] += 2 * m * area * (e[0] * f[0] + e[1] * f[1] + 0.5 * e[2] * f[2])
                K[a, b] += la * area * (e[0] + e[1]) * (f[0] + f[1])
                K[a, b] += t * (rest[i] @ rest[j])
    return K


@pytest.mark.parametrize("stabilisation", ["shear", "unit"])
def test_is_the_paper_to_the_letter(family, stabilisation):
    mesh = mesh_of(family, 2)
    lam, mu = moduli(mesh)
    expected = literal(mesh, lam, mu, 2 * mu if stabilisation == "shear" else np.ones_like(mu))
    K = matrix(mesh, stabilisation, lam, mu)
    # The 6 x 6 systems of the reference have condition numbers below 1e3.
    assert largest(K.toarray() - expected) < 1e-12 * largest(K)


def test_turning_the_body_turns_the_matrix(family):
    mesh = mesh_of(family)
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    R = sp.kron(sp.eye_array(mesh.n_nodes), turn, format="csr")
    K = matrix(mesh)
    turned = matrix(moved(mesh, mesh.points @ turn.T))
    assert largest(turned - R @ K @ R.T) < 1e-12 * largest(K)


def test_far_from_the_origin_nothing_is_lost(family):
    """Points on a grid of 2^-20 can be moved by 2^20 without rounding: not a bit of K changes."""
    mesh = mesh_of(family)
    points = np.round(mesh.points * 2**20) / 2**20
    near, far = moved(mesh, points), moved(mesh, points + 2.0**20)
    assert same(matrix(near), matrix(far))


def test_numbering_does_not_matter(family):
    mesh = mesh_of(family)
    rng = np.random.default_rng(2)
    number, order = rng.permutation(mesh.n_nodes), rng.permutation(mesh.n_cells)
    cells = [np.roll(number[mesh.cells[c]], rng.integers(9)) for c in order]
    points = np.empty_like(mesh.points)
    points[number] = mesh.points
    lam, mu = moduli(mesh)
    K = matrix(mesh, "shear", lam, mu)
    other = matrix(vx.PolygonMesh(points, cells), "shear", lam[order], mu[order])
    unknowns = (2 * number[:, None] + [0, 1]).ravel()
    assert largest(other[unknowns][:, unknowns] - K) < 1e-13 * largest(K)


def test_units_change_no_bit(family):
    mesh, factor = mesh_of(family), 2.0**-40
    lam, mu = moduli(mesh)
    K = matrix(mesh, "shear", lam, mu)
    assert same(K, matrix(moved(mesh, mesh.points * factor), "shear", lam, mu))
    assert same(K * factor, matrix(mesh, "shear", lam * factor, mu * factor))


def test_incompressible_limit_leaves_the_stabilisation_alone():
    """lam enters through the mean divergence only: one constraint a cell."""
    mesh = mesh_of("squares", 2)
    lam, mu = moduli(mesh)
    volumetric = matrix(mesh, "shear", lam + 1e6, mu) - matrix(mesh, "shear", lam, mu)
    assert np.linalg.matrix_rank(volumetric.toarray(), tol=1.0) == mesh.n_cells


@pytest.mark.parametrize("stiffer", [0, 1], ids=["one material", "two"])
@pytest.mark.parametrize(
    ("family", "n", "most"), [("squares", 4, 1), ("triangles", 8, 4), ("hexagons", 12, 100), ("tetrahedra", 4, 30)]
)
def test_translates_of_equal_moduli_share_their_local_matrix(family, n, most, stiffer):
    """To the last bit as if each had its own; corners are exact where widths are powers of two, rounded elsewhere."""
    mesh = getattr(vx.meshes, family)(n)
    lam, mu = np.full(mesh.n_cells, 1.7), np.full(mesh.n_cells, 0.6)
    mu[5 : 5 + stiffer] = 0.9
    made = []

    def local(cells, *moduli):
        made.append(len(cells.cells))
        return local_blocks(cells, *moduli)

    shared = SumOverCells(Space(mesh), local, mu > 0, (lam, mu, 2 * mu)).whole()
    given = np.arange(mesh.n_cells)
    own = SumOverCells(
        Space(mesh), lambda cells, at: local_blocks(cells, lam[at], mu[at], 2 * mu[at]), mu > 0, [given]
    ).whole()
    assert np.array_equal(shared.toarray(), own.toarray())
    assert sum(made) <= most + stiffer
    assert sum(made) < mesh.n_cells / 2


def test_cells_that_differ_in_the_last_bit_have_matrices_of_their_own():
    """Sums of their corners are equal, or nearly so; those of their bits are not."""
    rows = np.array([[0.0, 1.0, 2.0]] * 40 + [[0.0, 1.0 + EPS, 2.0 - 2 * EPS]] * 40)[
        np.random.default_rng(0).permutation(80)
    ]
    some, same = distinct([rows])
    assert len(some) == 2
    assert np.array_equal(rows[some][same], rows)
    many = np.random.default_rng(0).random((80, 3))
    assert distinct([many])[0] == slice(None)
