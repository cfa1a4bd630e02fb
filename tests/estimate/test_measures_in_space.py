"""Errors and distances in space: closed forms, nested meshes, and refusals."""

from __future__ import annotations

import full_slip_in_space as full_slip
import numpy as np
import pytest
from scenes import mostly_long
from solids import SOLIDS, solid

import manufactured_full_slip as plane
import vemcvx as vx
from vemcvx.estimate.measures.distance import common_rule

LAM, MU = 1.5, 0.8
BOX = ((0, 1), (0, 1), (0, 1))
GRADIENT = np.array([[0.3, 0.2, 0.1], [-0.1, 0.4, 0.2], [0.2, 0.0, -0.3]])


def field(mesh, displacement):
    """Return the nodal interpolant of a displacement, a function of points x (n, 3)."""
    moduli = np.array([np.full(mesh.n_cells, LAM), np.full(mesh.n_cells, MU)])
    return vx.measures.Field(mesh, displacement(mesh.points), moduli)


def affine(x):
    return x @ GRADIENT.T


def wavy(x):
    return np.column_stack([np.sin(3 * x[:, 0] + x[:, 2]), x[:, 0] ** 2 * x[:, 1], np.cos(x[:, 1])])


@mostly_long("name", SOLIDS, "tetrahedra", "hanging faces")
def test_affine_fields_have_no_distance_and_no_error(name):
    a, b = field(solid(name, 3, BOX), affine), field(solid("cubes", 2, BOX), affine)
    apart = vx.measures.energy_distance(a, b)
    assert apart.absolute < 1e-12
    strain = 0.5 * (GRADIENT + GRADIENT.T)
    density = LAM * np.trace(strain) ** 2 + 2 * MU * np.sum(strain**2)
    assert apart.reference == pytest.approx(np.sqrt(density * a.mesh.volumes.sum()), rel=1e-12)
    exact = [strain[0, 0], strain[1, 1], strain[2, 2], 2 * strain[0, 1], 2 * strain[1, 2], 2 * strain[0, 2]]
    found = vx.measures.energy_error(a, lambda x, t: np.tile(exact, (len(x), 1)))
    assert found.absolute < 1e-12
    assert found.reference == pytest.approx(apart.reference, rel=1e-12)
    assert vx.measures.l2_error(a, lambda x, t: affine(x)).relative < 1e-12


def test_distances_of_nested_meshes_are_exact():
    """Strains are constant on cubes."""
    coarse, fine = field(vx.meshes.cubes(2), wavy), field(vx.meshes.cubes(4), wavy)
    number = (fine.mesh.centroids // 0.5).astype(int)
    own = np.argmin(np.linalg.norm(coarse.mesh.centroids - 0.5 * number[:, None] - 0.25, axis=2), axis=1)
    apart = coarse.strain[own] - fine.strain
    energy = LAM * apart[:, :3].sum(axis=1) ** 2 + MU * (2 * (apart[:, :3] ** 2).sum(1) + (apart[:, 3:] ** 2).sum(1))
    found = vx.measures.energy_distance(coarse, fine)
    assert found.absolute == pytest.approx(np.sqrt(energy @ fine.mesh.volumes), rel=1e-12)
    assert np.sum(found.cells**2) == pytest.approx(found.absolute**2, rel=1e-12)
    rule = common_rule(coarse.mesh, fine.mesh)
    np.testing.assert_allclose(np.bincount(rule.first, rule.weights), coarse.mesh.volumes, rtol=1e-12)
    assert vx.measures.energy_distance(coarse, coarse).absolute == 0.0
    nodal = vx.measures.energy_distance(coarse, fine, kind="nodal")
    assert nodal.absolute < 1e-15
    assert nodal.reference > 0.0


def test_exact_distances_need_tetrahedra():
    tetrahedra, cubes = field(vx.meshes.tetrahedra(2), wavy), field(vx.meshes.cubes(2), wavy)
    assert vx.measures.energy_distance(tetrahedra, cubes, kind="projected").absolute > 0.0
    assert vx.measures.energy_distance(tetrahedra, tetrahedra, kind="exact").absolute == 0.0
    with pytest.raises(
        vx.MeshError, match=r"^energy_distance \(first mesh\): cell 0, of 8 vertices, is no tetrahedron\. "
    ):
        vx.measures.energy_distance(cubes, tetrahedra, kind="exact")


def test_meshes_of_different_bodies_are_refused():
    one, other = field(vx.meshes.cubes(2), affine), field(vx.meshes.cubes(2, ((0, 1), (0, 1), (0, 2))), affine)
    sentence = r"^energy_distance: the first mesh has the volume 1, the second 2, and they share 1; both must cover"
    with pytest.raises(vx.MeshError, match=sentence):
        vx.measures.energy_distance(one, other)
    assert vx.measures.energy_distance(one, other, common=True).absolute < 1e-13
    flat = vx.measures.Field(vx.meshes.squares(2), np.zeros((9, 2)), np.ones((2, 4)))
    with pytest.raises(vx.MeshError, match=r"^energy_distance: one mesh has polygons, the other polyhedra; give two"):
        vx.measures.energy_distance(one, flat)


@pytest.mark.long
@pytest.mark.parametrize("family", ["cubes", "tetrahedra", "voronoi3"])
def test_energy_errors_are_of_first_order_and_l2_errors_of_second_order(family):
    """The energy error agrees with an independent sum over tetrahedra."""
    lam, energy, l2 = plane.lame(0.3), [], []
    for n in (3, 6):
        mesh = vx.meshes.SPACE_FAMILIES[family](n)
        history = vx.simulate(full_slip.scene(), mesh, [0.0, 1.0])
        energy.append(vx.measures.energy_error(history, lambda x, t: full_slip.strain(x, t, lam)).relative)
        l2.append(vx.measures.l2_error(history, lambda x, t: full_slip.displacement(x, t, lam)).relative)
        assert energy[-1] == pytest.approx(full_slip.energy_error(history, lam), rel=1e-10)
    assert np.log2(energy[0] / energy[1]) > 0.85
    assert np.log2(l2[0] / l2[1]) > 1.6
