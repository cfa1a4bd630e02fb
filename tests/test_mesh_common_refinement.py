"""The finer of the cells of two refinements of one mesh, everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from counted import calls

import vemcvx as vx
from vemcvx.meshes import PolygonMesh, common_refinement
from vemcvx.meshes.location import cells_around, inner_points


def refined(mesh, seed, passes=3, **options):
    random = np.random.default_rng(seed)
    for _ in range(passes):
        mesh = mesh.refine(random.random(mesh.n_cells) < 0.25, **options)
    return mesh


def length(mesh, name):
    ends = mesh.points[mesh.boundaries[name]]
    return np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum()


@pytest.mark.parametrize("balance", [True, False])
def test_it_has_the_finer_cell_everywhere(family, balance):
    root = vx.meshes.FAMILIES[family](3, seed=2).with_boundary("corner", lambda x: x.sum(axis=1) < 0.7)
    a, b = (refined(root, seed, balance=balance) for seed in (1, 2))
    a = a.with_cell_data("number", np.arange(a.n_cells))
    mesh = common_refinement(a, b)
    PolygonMesh(mesh.points, mesh.cells)
    in_a, in_b = (cells_around(coarse, inner_points(mesh)) for coarse in (a, b))
    np.testing.assert_array_equal(mesh.cell_data["number"], in_a)
    assert (np.diff(in_a) >= 0).all()
    np.testing.assert_allclose(mesh.areas, np.minimum(a.areas[in_a], b.areas[in_b]), rtol=1e-12)
    np.testing.assert_allclose(np.bincount(in_a, weights=mesh.areas), a.areas, rtol=1e-12)
    np.testing.assert_allclose(np.bincount(in_b, weights=mesh.areas), b.areas, rtol=1e-12)
    np.testing.assert_array_equal(mesh.points[: a.n_nodes], a.points)
    other = common_refinement(b, a)
    assert (other.n_cells, other.n_nodes) == (mesh.n_cells, mesh.n_nodes)
    for name in root.boundaries:
        assert length(mesh, name) == pytest.approx(length(root, name), rel=1e-14)


def test_of_a_mesh_and_its_own_refinement():
    coarse = refined(vx.meshes.voronoi(4), 3)
    fine = refined(coarse, 4, passes=2)
    for one, other in ((coarse, fine), (fine, coarse), (fine, fine)):
        mesh = common_refinement(one, other)
        assert (mesh.n_cells, mesh.n_nodes) == (fine.n_cells, fine.n_nodes)
    same = common_refinement(fine, coarse)
    np.testing.assert_array_equal(same.points, fine.points)
    np.testing.assert_array_equal(same.vertices, fine.vertices)


def test_of_an_l_shape():
    a, b = (refined(vx.meshes.l_shape(4), seed) for seed in (1, 2))
    mesh = common_refinement(a, b)
    PolygonMesh(mesh.points, mesh.cells)
    assert mesh.areas.sum() == 0.75
    assert length(mesh, "inner_top") == length(mesh, "inner_right") == 0.5


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (vx.meshes.squares(3), vx.meshes.squares(4), r"cell \d+ of mesh a overlaps cells of the other mesh in part"),
        (vx.meshes.squares(3), vx.meshes.voronoi(3), "in part .* made of the same one by refine"),
        (vx.meshes.squares(4), vx.meshes.l_shape(4), "of mesh a lies outside the other mesh"),
        (vx.meshes.l_shape(4), vx.meshes.squares(4), "of mesh b lies outside the other mesh"),
    ],
    ids=["3 and 4", "squares and voronoi", "square and L", "L and square"],
)
def test_of_strangers(a, b, message):
    with pytest.raises(vx.MeshError, match=message):
        common_refinement(a, b)


def test_nineteen_times_the_cells_take_hardly_more_calls():
    count = []
    for n in (6, 24):
        a, b = (refined(vx.meshes.squares(n), seed, passes=2) for seed in (1, 2))
        count.append((a.n_cells, calls(lambda a=a, b=b: common_refinement(a, b))))
    assert count[1][0] > 16 * count[0][0]
    assert count[1][1] < 1.5 * count[0][1]
