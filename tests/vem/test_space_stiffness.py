"""Polyhedral virtual elements: rigid modes, patch test, tetrahedra as P1, invariance, shares of faces, order 1."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from skfem.models.elasticity import linear_elasticity
from solids import SOLIDS, solid

import vemcvx as vx
from vemcvx.vem import Space, cell_load, edge_load, rigid_modes, stiffness, strains, stress_load
from vemcvx.vem.projection import face_groups

EPS = np.finfo(float).eps
SLOPE = np.array([[0.3, -1.2, 0.4], [0.7, 0.4, 0.1], [-0.2, 0.5, 0.6]])
LONG = dict.fromkeys(("kelvin", "prisms"), pytest.mark.long)


@pytest.fixture(params=[pytest.param(name, marks=LONG.get(name, ())) for name in SOLIDS])
def mesh(request):
    return solid(request.param, 2, ((0.0, 1.0), (0.0, 1.2), (-0.3, 0.6)))


def moduli(mesh):
    return np.random.default_rng(0).uniform(0.5, 3.0, (2, mesh.n_cells))


def moved(mesh, points):
    """The same cells on other points."""
    faces = mesh.face_offsets, mesh.face_vertices, mesh.cell_offsets, mesh.cell_faces, mesh.face_cells
    return vx.PolyhedralMesh.unchecked(points, *faces)


def test_symmetric_to_the_bit_with_the_six_rigid_modes(mesh):
    K = stiffness(Space(mesh), *moduli(mesh))
    assert K.has_canonical_format
    assert (K.T.tocsr() != K).nnz == 0
    values = np.linalg.eigvalsh(K.toarray())
    floor = 10 * K.shape[0] * EPS * values[-1]
    assert np.abs(values[:6]).max() < floor
    assert values[6] > 1e-5 * values[-1]
    assert np.abs(K @ rigid_modes(mesh.points)).max() < floor


def test_a_linear_field_with_jumping_moduli_has_the_forces_of_its_stresses(mesh):
    """K p = sum over cells of |K| sigma : eps(Pi v), which the strains and the virtual work of stresses give, too."""
    space, (lam, mu) = Space(mesh), moduli(mesh)
    e = 0.5 * (SLOPE + SLOPE.T)
    strain = [e[0, 0], e[1, 1], e[2, 2], 2 * e[0, 1], 2 * e[1, 2], 2 * e[0, 2]]
    u = mesh.points @ SLOPE.T + [0.2, -0.1, 0.3]
    assert np.abs(strains(space, u) - strain).max() < 1e-13
    trace = lam * np.trace(e)
    normal = 2 * mu * np.array(strain[:3])[:, None] + trace
    stress = np.vstack([normal, mu * np.array(strain[3:])[:, None]]).T
    forces = stress_load(space) @ stress.ravel()
    assert np.abs(stiffness(space, lam, mu) @ u.ravel() - forces).max() < 1e-13


def test_a_uniform_stress_is_in_equilibrium_with_its_tractions(mesh):
    """Faces give their cells and the boundary the same shares."""
    space, part = Space(mesh), Space(mesh).part("boundary", "test")
    sigma = 0.5 * (SLOPE + SLOPE.T)
    _, matrix, sides = edge_load(space, part)
    tractions = part.normals[sides] @ sigma
    forces = matrix @ tractions.ravel()
    components = sigma[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    assert np.abs(stress_load(space) @ np.tile(components, mesh.n_cells) - forces).max() < 1e-14


def test_the_torque_of_weight_is_that_of_the_means_of_vertices(mesh):
    """Exact where these are centroids; else it is off by less than h times the force."""
    points, matrix, _ = cell_load(Space(mesh))
    weight = np.array([0.3, 0.0, -1.0])
    nodal = (matrix @ np.tile(weight, len(points))).reshape(-1, 3)
    means = np.array([mesh.points[np.unique(np.concatenate(cell))].mean(axis=0) for cell in mesh.cells])
    exact = np.cross(mesh.volumes @ mesh.centroids, weight)
    off = np.cross(mesh.points, nodal).sum(axis=0) - exact
    assert off == pytest.approx(np.cross(mesh.volumes @ (means - mesh.centroids), weight), abs=1e-13)
    assert np.linalg.norm(off) < mesh.h * mesh.volumes.sum() * np.linalg.norm(weight)


def test_loads_have_the_forces_and_moments_of_their_data(mesh):
    space = Space(mesh)
    x, matrix, _ = cell_load(space)
    force = np.column_stack([1 + x[:, 0], x[:, 1] - x[:, 2], 2 * x[:, 2]])
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    middle, volume = 0.5 * (low + high), np.prod(high - low)
    total = rigid_modes(mesh.points)[:, :3].T @ (matrix @ force.ravel())
    assert total == pytest.approx(volume * np.array([1 + middle[0], middle[1] - middle[2], 2 * middle[2]]), rel=1e-12)
    part = space.part("left", "test")
    points, matrix, _ = edge_load(space, part)
    y, z = points[:, 1], points[:, 2]
    found = matrix @ np.column_stack([y**4, y**2 * z**2, z**4]).ravel()

    def integral(powers):
        return np.prod([(high[a] ** (p + 1) - low[a] ** (p + 1)) / (p + 1) for a, p in enumerate(powers, start=1)])

    assert rigid_modes(mesh.points)[:, :3].T @ found == pytest.approx(
        [integral((4, 0)), integral((2, 2)), integral((0, 4))], rel=1e-12
    )


def test_tetrahedra_are_linear_finite_elements():
    mesh = vx.meshes.tetrahedra(3)
    lam, mu = moduli(mesh)
    cells = mesh.cell_nodes[1].reshape(-1, 4)
    basis = skfem.Basis(skfem.MeshTet(mesh.points.T.copy(), cells.T.copy()), skfem.ElementVector(skfem.ElementTetP1()))
    shape = (mesh.n_cells, basis.X.shape[-1])
    expected = linear_elasticity(*(np.broadcast_to(m[:, None], shape) for m in (lam, mu))).assemble(basis)
    order = np.empty(3 * mesh.n_nodes, dtype=int)
    order[np.arange(3 * mesh.n_nodes).reshape(-1, 3)] = basis.nodal_dofs.T
    K = stiffness(Space(mesh), lam, mu)
    assert abs(K - expected[order][:, order]).max() < 1e-12 * abs(K).max()


def test_powers_of_two_change_no_bit(mesh):
    lam, mu = moduli(mesh)
    K = stiffness(Space(mesh), lam, mu)
    assert (stiffness(Space(moved(mesh, 1024.0 * mesh.points)), lam, mu) != 1024.0 * K).nnz == 0
    assert (stiffness(Space(mesh), 0.125 * lam, 0.125 * mu) != 0.125 * K).nnz == 0


def test_a_body_far_away_loses_no_more_than_its_points(mesh):
    lam, mu = moduli(mesh)
    shift = np.array([1e6, -2e6, 3e6])
    K, there = stiffness(Space(mesh), lam, mu), stiffness(Space(moved(mesh, mesh.points + shift)), lam, mu)
    # Points are rounded by 4e-10, edges of 0.3 by 1e-9 of their length.
    assert abs(K - there).max() < 1e-7 * abs(K).max()


FACES = {
    "triangle": [(0, 0), (2, 0), (0, 1)],
    "rectangle": [(0, 0), (3, 0), (3, 1), (0, 1)],
    "hanging nodes": [(0, 0), (1, 0), (2, 0), (2, 1), (2, 1.5), (2, 2), (0, 2)],
    "dart": [(0, 0), (2, -1), (0.5, 0), (2, 1)],
    "no star": [(0, 0), (3, 0), (3, 3), (0, 3), (0, 2), (2, 2), (2, 1), (0, 1)],
}


@pytest.mark.parametrize("name", FACES)
def test_shares_of_a_face_are_positive_and_exact(name):
    """Of any face, convex or not, anywhere in space: sum a_i = A, sum a_i x_i = A c, sum b_i = A nu."""
    flat = np.array(FACES[name], dtype=float)
    x, y, after = *flat.T, np.roll(flat, -1, axis=0)
    cross = x * after[:, 1] - after[:, 0] * y
    area = 0.5 * cross.sum()
    centroid = (flat + after).T @ cross / (6 * area)
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    axes[:, 2] *= np.linalg.det(axes)
    origin = np.array([5.0, -3.0, 2.0])
    points, n = flat @ axes[:, :2].T + origin, len(flat)
    (group,) = face_groups(points, np.array([0, n]), np.arange(n), np.array([0]))
    a, b = group.shares[0], group.vector_shares[0]
    assert (a > 0).all()
    assert a.sum() == pytest.approx(area, rel=1e-14)
    assert a @ points / area == pytest.approx(origin + axes[:, :2] @ centroid, rel=1e-14)
    assert b.sum(axis=0) == pytest.approx(area * axes[:, 2], rel=1e-14, abs=1e-14)
    if name in ("triangle", "rectangle"):
        assert a == pytest.approx(area / n, rel=1e-14)
    places, shares = group.quadrature()
    assert shares[0].sum(axis=1) == pytest.approx(a, rel=1e-14)
    # Quadrature sums basis functions that reproduce linear functions.
    reproduced = shares[0].sum(axis=0)[:, None] * (places[0] - origin)
    assert shares[0].T @ (points - origin) == pytest.approx(reproduced, abs=1e-13)


def test_edges_and_corners_of_a_part_have_a_row_for_every_normal():
    space = Space(vx.meshes.cubes(2))
    rows = space.part(["left", "front", "bottom"], "test").node_normals
    at, count = np.unique(rows.nodes, return_counts=True)
    assert sorted(count.tolist()) == [1] * 12 + [2] * 6 + [3]
    assert at[count == 3] == np.flatnonzero(np.abs(space.mesh.points).max(axis=1) == 0.0)
    corner = np.flatnonzero(rows.nodes == at[count == 3])
    assert sorted(map(tuple, rows.normals[corner])) == [(-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)]
    assert rows.lengths[corner] == pytest.approx(1 / 16, rel=1e-15)
    assert rows.lengths.sum() == pytest.approx(3.0, rel=1e-14)
    assert rows.matrix @ np.ones(len(rows.points)) == pytest.approx(rows.lengths, rel=1e-13)


def field(x):
    """Free of divergence, so that it does not depend on lambda; its slope d u_a / d x_b; its Laplacian."""
    (a, b, c), zero, p = x.T, np.zeros(len(x)), np.pi
    u = np.column_stack([np.sin(p * b) * np.cos(p * c), np.sin(p * a + p * c), np.cos(p * a) * np.sin(p * b)])
    slope = np.array(
        [
            [zero, p * np.cos(p * b) * np.cos(p * c), -p * np.sin(p * b) * np.sin(p * c)],
            [p * np.cos(p * (a + c)), zero, p * np.cos(p * (a + c))],
            [-p * np.sin(p * a) * np.sin(p * b), p * np.cos(p * a) * np.cos(p * b), zero],
        ]
    ).transpose(2, 0, 1)
    return u, slope, -2 * p**2 * u


def energy_error(family, n, lam):
    """Relative energy error of eps(Pi u_h), with mu = 1, over tetrahedra between centroids of cells and their faces."""
    mesh = vx.meshes.SPACE_FAMILIES[family](n)
    poisson = lam / (2 * (lam + 1))

    def pull(x, t):
        slope = field(x)[1]
        return t * (slope + slope.transpose(0, 2, 1))[:, :, 2]

    scene = vx.Scene(
        vx.Elasticity(2 * (1 + poisson), poisson),
        vx.PrescribedDisplacement(lambda x, t: t * field(x)[0], on=["left", "right", "front", "back", "bottom"]),
        vx.Traction(pull, on="top"),
        vx.BodyForce(lambda x, t: -t * field(x)[2]),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    found = strains(Space(mesh), history.displacement[1])
    error = norm = 0.0
    for cell in range(mesh.n_cells):
        for f in mesh.cell_faces[mesh.cell_offsets[cell] : mesh.cell_offsets[cell + 1]]:
            corners = mesh.points[mesh.face_vertices[mesh.face_offsets[f] : mesh.face_offsets[f + 1]]]
            middle = np.broadcast_to(mesh.face_centroids[f], corners.shape)
            ring = np.stack([corners, np.roll(corners, -1, axis=0), middle])
            middle = 0.25 * (ring.sum(axis=0) + mesh.centroids[cell])
            volume = np.abs(np.linalg.det((ring - mesh.centroids[cell]).transpose(1, 0, 2))) / 6
            slope = field(middle)[1]
            e = slope + slope.transpose(0, 2, 1)
            exact = np.column_stack([0.5 * e[:, [0, 1, 2], [0, 1, 2]], e[:, [0, 1, 0], [1, 2, 2]]])
            weight = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
            error += volume @ ((exact - found[cell]) ** 2 @ weight)
            norm += volume @ (exact**2 @ weight)
    return np.sqrt(error / norm)


@pytest.mark.slow
@pytest.mark.parametrize("family", vx.meshes.SPACE_FAMILIES)
@pytest.mark.filterwarnings("ignore:Elasticity. poisson")
def test_order_one_in_the_energy_norm_whatever_lambda(family):
    """Halving h halves the error, on polyhedra with lambda / mu up to 1e6; tetrahedra lock, as P1 does."""
    for lam in (1.0,) if family == "tetrahedra" else (1.0, 1e6):
        coarse, fine = (energy_error(family, n, lam) for n in (4, 8))
        assert coarse < 0.5
        assert np.log2(coarse / fine) > 0.8, (lam, coarse, fine)
