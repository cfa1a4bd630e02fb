"""Refinement in space: bisection of tetrahedra, uniform refinement of other cells, interfaces, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from same_mesh import assert_matched, measure_part
from scenes import mostly_long, small
from scipy.spatial import Delaunay

import vemcvx as vx
from vemcvx.meshes import SPACE_FAMILIES, bodies, tetrahedra
from vemcvx.meshes.polyhedra import FACES

UP = ((0, 1), (0, 1), (1, 2))


def check_mesh(mesh):
    """Return a checked copy of the mesh."""
    named = {k: v for k, v in mesh.boundaries.items() if k not in (*mesh.interfaces, "boundary")}
    return vx.PolyhedralMesh(mesh.points, mesh.cells, boundaries=named, interfaces=dict(mesh.interfaces))


def measure_fatness(mesh):
    return (mesh.volumes / mesh.diameters**3).min()


def triangulate_random_points(seed, count=30):
    """Return tetrahedra between random points, without edges of equal length."""
    points = np.random.default_rng(seed).random((count, 3))
    cells = Delaunay(points).simplices
    x = points[cells]
    volumes = np.linalg.det(x[:, 1:] - x[:, :1])
    cells = np.where((volumes < 0)[:, None], cells[:, [0, 1, 3, 2]], cells)[np.abs(volumes) > 1e-4]
    number = np.unique(cells)
    return vx.PolyhedralMesh(points[number], np.searchsorted(number, cells)[:, np.array(FACES["tetra"])])


def refine_at_random(mesh, random, passes):
    """Return the mesh after random passes, which must keep volumes, boundaries and nodes."""
    for _ in range(passes):
        before, marked = mesh, random.random(mesh.n_cells) < min(0.3, 12 / mesh.n_cells)
        mesh = mesh.with_cell_data("parent", np.arange(mesh.n_cells)).refine(marked)
        check_mesh(mesh)
        parents = mesh.cell_data["parent"]
        np.testing.assert_allclose(np.bincount(parents, weights=mesh.volumes), before.volumes, rtol=1e-12)
        assert (mesh.volumes <= 0.5 * before.volumes[parents] * (1 + 1e-12))[marked[parents]].all()
        assert list(mesh.boundaries) == list(before.boundaries)
        for side in mesh.boundaries:
            assert measure_part(mesh, side) == pytest.approx(measure_part(before, side), rel=1e-14 * mesh.n_faces)
        np.testing.assert_array_equal(mesh.points[: before.n_nodes], before.points)
    return mesh


STARTS = {
    "box": lambda seed: tetrahedra(2, tuple((0.0, x) for x in np.random.default_rng(seed).uniform(0.3, 3.0, 3))),
    "random points": triangulate_random_points,
    "two bodies": lambda seed: bodies({"a": tetrahedra(2), "b": tetrahedra(2, UP)}),
}


@mostly_long("seed", range(8))
@mostly_long("name", STARTS, 1)
def test_random_passes_keep_a_tiling_of_tetrahedra(name, seed):
    mesh = refine_at_random(STARTS[name](seed), np.random.default_rng(seed), 3)
    assert (np.diff(mesh.cell_offsets) == 4).all()
    assert (np.diff(mesh.face_offsets) == 3).all()


@pytest.mark.parametrize("seed", range(2))
def test_bisection_gives_the_cells_of_scikit_fem(seed):
    """Bisect tetrahedra without edges of equal length, so that the result is unique."""
    skfem = pytest.importorskip("skfem")
    mesh = triangulate_random_points(seed)
    marked = np.random.default_rng(seed).random(mesh.n_cells) < 0.2
    fine, other = mesh.refine(marked), skfem.MeshTet(mesh.points.T, mesh.cell_nodes[1].reshape(-1, 4).T)
    other = other.refined(np.flatnonzero(marked))
    places = [fine.points[fine.cell_nodes[1]].reshape(-1, 12), other.p.T[np.sort(other.t, axis=0).T].reshape(-1, 12)]
    cells = [{tuple(sorted(map(tuple, row.reshape(4, 3).round(9)))) for row in rows} for rows in places]
    assert cells[0] == cells[1]
    assert fine.n_nodes == other.p.shape[1]


def test_uniform_refinement_of_prisms_gives_prisms_over_the_parts_of_their_polygons():
    plane = small("voronoi", 3, seed=2)
    mesh, fine = check_mesh(plane.extruded([0.0, 0.3]).refine()), plane.extruded([0.0, 0.15, 0.3])
    assert mesh.n_cells == 2 * np.sum(np.diff(plane.offsets))
    assert mesh.volumes.sum() == pytest.approx(fine.volumes.sum(), rel=1e-13)
    np.testing.assert_allclose(np.unique(mesh.points[:, 2].round(12)), [0.0, 0.15, 0.3], atol=1e-12)
    wedges = vx.meshes.triangles(2).extruded([0.0, 0.5]).refine()
    assert wedges.n_cells == 6 * vx.meshes.triangles(2).n_cells
    assert np.ptp(wedges.volumes) < 1e-16


@pytest.mark.parametrize("make", ["kelvin", "voronoi3"])
def test_cells_whose_parts_would_have_curved_faces_are_refused(make):
    with pytest.raises(vx.MeshError, match=r"^refine: parts of cells .* would not have plane faces \(cell"):
        SPACE_FAMILIES[make](2).refine()


@pytest.mark.long
@pytest.mark.parametrize("axes", [3, 2, 1], ids=["point", "edge", "face"])
def test_thirty_six_bisections_keep_the_shapes_of_the_first_three(axes):
    """Refine towards a point, a line or a plane. Three bisections halve a cell in every direction."""
    mesh, shapes = tetrahedra(2), []
    for _ in range(36):
        away = np.abs(mesh.centroids - [0.31, 0.42, 0.57])
        near = (away[:, :axes].max(axis=1) < 0.4 * mesh.diameters) & (away.max(axis=1) < 1.2 * mesh.diameters)
        near[np.argmin(away.max(axis=1) / mesh.diameters)] = True
        mesh = mesh.refine(near)
        assert mesh.volumes.sum() == pytest.approx(1.0, abs=1e-15 * mesh.n_cells)
        for side in ("left", "bottom", "back"):
            assert measure_part(mesh, side) == pytest.approx(1.0, abs=1e-14 * mesh.n_faces)
        shapes.append(measure_fatness(mesh))
    assert mesh.diameters.min() < 2.0**-10
    assert min(shapes) == pytest.approx(min(shapes[:3]), rel=1e-9)


@mostly_long("make", ["tetrahedra", "cubes"], "tetrahedra")
def test_refinement_keeps_interfaces_matched(make):
    mesh = start = bodies({"a": SPACE_FAMILIES[make](2), "b": SPACE_FAMILIES[make](2, UP)})
    for _ in range(3 if make == "tetrahedra" else 1):
        before, near = mesh, np.linalg.norm(mesh.centroids - [0.45, 0.55, 1.0], axis=1) < 0.4
        mesh = mesh.refine(near if make == "tetrahedra" else None)
        assert_matched(mesh)
        assert list(mesh.boundaries) == list(before.boundaries)
        for side in before.boundaries:
            assert measure_part(mesh, side) == pytest.approx(measure_part(before, side), rel=1e-12)
    assert len(mesh.interfaces["a|b"].edges) > len(start.interfaces["a|b"].edges)
