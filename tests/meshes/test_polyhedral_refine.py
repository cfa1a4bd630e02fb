"""Refinement in space: tilings, shapes over many levels, grading, prolongation, names, interfaces, refusals."""

from __future__ import annotations

import re

import numpy as np
import pytest
from counted import calls
from hypothesis import HealthCheck, given, settings, strategies
from refined_cubes import refined_cubes

import vemcvx as vx
from vemcvx.meshes import SPACE_FAMILIES, bodies, refinement
from vemcvx.meshes.cell_sides import corners_in_pieces, sides_of, skin_of
from vemcvx.meshes.polygons import next_corner, previous_corner
from vemcvx.vem import Space, stiffness

# Bounds on volume / diameter^3 after any number of passes, as measured: cubes have .192, the tetrahedra of cubes .032.
# The cells of kelvin(2) that fall into pyramids have .0117 at least, and tetrahedra in these .0012.
FLATTEST = {"cubes": 0.19, "tetrahedra": 0.03, "prisms": 0.03, "voronoi3": 1e-5, "kelvin": 1e-3}
ONE_SHAPE = ("cubes", "tetrahedra")
UP = ((0, 1), (0, 1), (1, 2))


def family_of(name):
    """A mesh of few cells; two prisms a side would be cubes."""
    return SPACE_FAMILIES[name](3 if name == "prisms" else 2, seed=1)


def checked(mesh):
    """The mesh, taken by the checks of the package."""
    named = {k: v for k, v in mesh.boundaries.items() if k not in (*mesh.interfaces, "boundary")}
    return vx.PolyhedralMesh(mesh.points, mesh.cells, boundaries=named, interfaces=dict(mesh.interfaces))


def fatness(mesh):
    return (mesh.volumes / mesh.diameters**3).min()


def smallest_angle(mesh):
    """Of all corners of faces, hanging nodes included, in degrees."""
    x, offsets = mesh.points[mesh.face_vertices], mesh.face_offsets
    one, other = x[next_corner(offsets)] - x, x[previous_corner(offsets)] - x
    cosine = (one * other).sum(axis=1) / (np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1))
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min()


def clearance(mesh):
    """How far centroids are behind the planes of the faces of their cells at least, in diameters."""
    cell = np.repeat(np.arange(mesh.n_cells), np.diff(mesh.cell_offsets))
    arm = mesh.face_centroids[mesh.cell_faces] - mesh.centroids[cell]
    height = (arm * mesh.face_normals[mesh.cell_faces]).sum(axis=1) * mesh.face_signs
    return (height / mesh.diameters[cell]).min()


def condition(mesh):
    """Of the stiffness scaled by its diagonal, on what is left when the boundary is held at three nodes."""
    K = stiffness(Space(mesh), np.ones(mesh.n_cells), np.ones(mesh.n_cells)).toarray()
    scale = 1.0 / np.sqrt(K.diagonal())
    values = np.linalg.eigvalsh(scale[:, None] * K * scale)
    return values[-1] / values[6]


def area(mesh, name):
    return mesh.face_areas[mesh.boundaries[name]].sum()


def refined_at_random(mesh, passes, seed=0, part=0.2, most=20):
    random = np.random.default_rng(seed)
    for _ in range(passes):
        mesh = mesh.refine(random.random(mesh.n_cells) < min(part, most / mesh.n_cells))
    return mesh


def graded(mesh):
    """Most nodes inside a line between two sides of a cell, and how many sides are in pieces of another kind."""
    skin = skin_of(mesh)
    sides = sides_of(skin)
    parted = corners_in_pieces(skin, sides)[1]
    return np.bincount(sides.chain).max() - 1, np.count_nonzero((sides.pieces > 1) & ~parted)


@pytest.fixture(params=SPACE_FAMILIES)
def name(request):
    return request.param


def followed(mesh, random, passes, balance=True):
    """Passes with random marks, each checked for all that must stay."""
    for _ in range(passes):
        before = mesh
        found = refinement(mesh, random.random(mesh.n_cells) < min(0.3, 12 / mesh.n_cells), balance=balance)
        mesh = found.mesh
        checked(mesh)
        assert mesh.volumes.sum() == pytest.approx(before.volumes.sum(), rel=1e-15 * mesh.n_cells)
        np.testing.assert_allclose(np.bincount(found.parents, weights=mesh.volumes), before.volumes, rtol=1e-12)
        assert set(mesh.boundaries) == set(before.boundaries)
        for side in mesh.boundaries:
            assert area(mesh, side) == pytest.approx(area(before, side), rel=1e-14 * mesh.n_faces)
        np.testing.assert_allclose(found.prolongation @ before.points, mesh.points, atol=1e-13)
    return mesh


@pytest.mark.long
@pytest.mark.parametrize("balance", [True, False])
def test_random_passes_keep_a_tiling(name, balance):
    mesh = followed(family_of(name), np.random.default_rng(2), 2, balance)
    assert fatness(mesh) > FLATTEST[name]


@pytest.mark.slow
@given(seed=strategies.integers(0, 10_000), which=strategies.sampled_from([*SPACE_FAMILIES, "nonconvex", "joint"]))
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_any_marks_keep_a_tiling(seed, which):
    random = np.random.default_rng(seed)
    if which == "joint":
        one, other = random.choice([*SPACE_FAMILIES], 2)
        mesh = bodies({"a": SPACE_FAMILIES[one](2, seed=seed), "b": SPACE_FAMILIES[other](2, UP, seed=seed)})
    elif which == "nonconvex":
        mesh = vx.meshes.nonconvex(3, seed=seed).extruded([0.0, 0.2, 0.5])
    else:
        mesh = SPACE_FAMILIES[which](2, seed=seed)
    followed(mesh, random, 3, balance=bool(random.integers(2)))


def test_cubes_become_cubes_of_half_the_size():
    mesh, fine = vx.meshes.cubes(3).refine(), vx.meshes.cubes(6)
    assert mesh.n_cells == fine.n_cells
    assert np.ptp(mesh.volumes) < 1e-16
    for places in ("points", "centroids", "face_centroids"):
        one, other = (getattr(m, places)[np.lexsort(getattr(m, places).round(9).T)] for m in (mesh, fine))
        np.testing.assert_allclose(one, other, atol=1e-15)
    for side in fine.boundaries:
        assert len(mesh.boundaries[side]) == len(fine.boundaries[side])


def test_a_tetrahedron_becomes_four_and_an_octahedron_and_that_six_and_eight():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    mesh = vx.PolyhedralMesh(corners, [[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]]).refine()
    assert sorted(np.diff(mesh.cell_offsets)) == [4, 4, 4, 4, 8]
    mesh = mesh.refine([np.argmax(np.diff(mesh.cell_offsets))])
    assert sorted(np.diff(mesh.cell_offsets)) == [4] * 8 + [7] * 4 + [8] * 6


def test_a_pyramid_becomes_six_and_four_tetrahedra():
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1.0]])
    mesh = vx.PolyhedralMesh(corners, [[[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]]).refine()
    assert sorted(np.diff(mesh.cell_offsets)) == [4] * 4 + [5] * 6
    np.testing.assert_allclose(np.sort(mesh.volumes), [1 / 48] * 4 + [1 / 24] * 6, rtol=1e-14)


def test_prisms_become_prisms_over_the_children_of_their_polygons():
    plane = vx.meshes.voronoi(3, seed=2)
    mesh, fine = plane.extruded([0.0, 0.3]).refine(), plane.extruded([0.0, 0.15, 0.3])
    assert mesh.n_cells == 2 * np.sum(np.diff(plane.offsets))
    assert mesh.volumes.sum() == pytest.approx(fine.volumes.sum(), rel=1e-13)
    heights = np.unique(mesh.points[:, 2].round(12))
    np.testing.assert_allclose(heights, [0.0, 0.15, 0.3], atol=1e-12)
    wedges = vx.meshes.triangles(2).extruded([0.0, 0.5]).refine()
    assert wedges.n_cells == 8 * vx.meshes.triangles(2).n_cells
    assert np.ptp(wedges.volumes) < 1e-16


def test_neighbours_stay_and_take_coplanar_faces():
    mesh = vx.meshes.cubes(2).refine([0])
    np.testing.assert_array_equal(np.bincount(np.diff(mesh.cell_offsets), minlength=10)[[6, 9]], [12, 3])
    assert mesh.n_cells == 7 + 8
    assert graded(mesh) == (1, 0)
    # A cell beside those that were split before takes their faces, the nodes in these, and what it makes itself.
    again = mesh.refine([8])
    assert again.n_cells == 15 + 7
    assert graded(again) == (1, 0)
    assert fatness(again) == pytest.approx(fatness(mesh))


def test_what_others_have_cut_is_taken_as_it_is():
    """Cubes of two sizes that the package did not make."""
    mesh = refined_cubes(2, (0, 3))
    large = np.flatnonzero(mesh.volumes > 4)
    mesh = mesh.refine(large)
    assert mesh.n_cells == 64
    assert fatness(mesh) == pytest.approx(3**-1.5)


@pytest.mark.long
def test_lines_and_sides_keep_one_level_of_difference():
    for make in ("cubes", "tetrahedra"):
        mesh = family_of(make)
        for _ in range(4):
            mesh = mesh.refine([np.argmin(np.linalg.norm(mesh.centroids - [0.31, 0.42, 0.57], axis=1))])
            assert graded(mesh) == (1, 0)
    mesh = vx.meshes.cubes(2)
    for _ in range(3):
        mesh = mesh.refine([np.argmin(np.linalg.norm(mesh.centroids - 0.499, axis=1))], balance=False)
    assert graded(mesh)[0] > 1


def at(mesh, where):
    """Cells at a point inside; at a line or a plane through it, as far as two diameters from the point."""
    away = np.abs(mesh.centroids - [0.31, 0.42, 0.57])
    on = {"point": away, "edge": away[:, :2], "face": away[:, :1]}[where].max(axis=1)
    near = (on < 0.4 * mesh.diameters) & (away.max(axis=1) < 1.2 * mesh.diameters)
    return near if near.any() else np.arange(mesh.n_cells) == np.argmin(away.max(axis=1) / mesh.diameters)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["point", "edge", "face"])
def test_twelve_levels_keep_the_shapes_that_the_first_have_made(name, where):
    mesh = family_of(name)
    shapes, most = [], 0
    for level in range(12):
        mesh = mesh.refine(at(mesh, where))
        if mesh.n_cells < 6000:
            checked(mesh)
        assert mesh.volumes.sum() == pytest.approx(1.0, abs=1e-15 * mesh.n_cells)
        for side in ("left", "bottom", "back"):
            assert area(mesh, side) == pytest.approx(1.0, abs=1e-14 * mesh.n_faces)
        shapes.append([fatness(mesh), smallest_angle(mesh), clearance(mesh)])
        most = max(most, np.diff(mesh.cell_offsets).max())
        if level in (0, 2, 4) and mesh.n_nodes < 1300:
            shapes[-1].append(condition(mesh))
            print(name, where, level, f"{mesh.n_cells} cells, condition {shapes[-1][3]:.3g}")
    shapes = np.array([row[:3] for row in shapes])
    print(name, where, f"{mesh.n_cells} cells, {most} faces", *(f"{low:.3g}" for low in shapes.min(axis=0)))
    assert mesh.diameters.min() < 2.0**-10
    assert fatness(mesh) > FLATTEST[name]
    # Nothing new after half of the levels, but by chance in Voronoi cells.
    assert (shapes[-1] > 0.5 * shapes[5]).all()
    if name in ONE_SHAPE:
        np.testing.assert_allclose(shapes[-1], shapes[0], rtol=1e-9)


@pytest.mark.long
def test_patch_test_on_refined_meshes(name):
    """A linear displacement prescribed all around is the answer, whatever hangs where."""
    mesh = refined_at_random(family_of(name), 2)
    gradient = np.array([[0.01, -0.02, 0.03], [0.03, 0.015, -0.01], [0.02, 0.0, 0.01]])

    def field(x, t):
        return t * (x @ gradient.T + [0.1, -0.2, 0.05])

    scene = vx.Scene(vx.Elasticity(7.0, 0.3), vx.PrescribedDisplacement(field, on="boundary"))
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] - field(mesh.points, 1.0)).max() < 1e-12


def test_names_and_data_are_handed_down(name):
    mesh = family_of(name).with_boundary("half", lambda x: x[:, 0] < 0.5)
    mesh = mesh.with_cell_data("number", np.arange(mesh.n_cells)).with_cell_data("pair", np.ones((mesh.n_cells, 2)))
    found = refinement(mesh, np.arange(0, mesh.n_cells, 2))
    np.testing.assert_array_equal(found.mesh.cell_data["number"], found.parents)
    assert (np.diff(found.parents) >= 0).all()
    assert found.mesh.cell_data["pair"].shape == (found.mesh.n_cells, 2)
    assert area(found.mesh, "half") == pytest.approx(area(mesh, "half"), rel=1e-13)
    np.testing.assert_array_equal(checked(found.mesh).boundaries["half"], found.mesh.boundaries["half"])
    np.testing.assert_array_equal(found.mesh.points[: mesh.n_nodes], mesh.points)


def test_prolongation_keeps_old_values_and_takes_means_over_edges():
    found = refinement(vx.meshes.cubes(1))
    values = np.random.default_rng(0).random(8)
    new = found.prolongation @ values
    np.testing.assert_array_equal(new[:8], values)
    where = {tuple(x): v for x, v in zip(found.mesh.points.tolist(), new, strict=True)}
    assert where[0.5, 0.0, 0.0] == 0.5 * (values[0] + values[1])
    assert where[0.5, 0.5, 0.0] == pytest.approx(values[:4].mean(), rel=1e-14)
    assert where[0.5, 0.5, 0.5] == pytest.approx(values.mean(), rel=1e-14)
    np.testing.assert_allclose(found.prolongation.sum(axis=1), 1.0, atol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("others", [("cubes", 2), ("cubes", 3), ("tetrahedra", 1), ("kelvin", 1)], ids=str)
def test_interfaces_stay_matched(others):
    make, n = others
    mesh = bodies({"a": vx.meshes.cubes(2), "b": SPACE_FAMILIES[make](n, UP)})
    random = np.random.default_rng(4)
    for _ in range(2):
        before = mesh
        mesh = mesh.refine(random.random(mesh.n_cells) < min(0.3, 10 / mesh.n_cells))
        joint = checked(mesh).interfaces["a|b"]
        np.testing.assert_array_equal(joint.edges, mesh.interfaces["a|b"].edges)
        there = joint.edges >= 0
        np.testing.assert_array_equal(mesh.points[joint.edges[there]], mesh.points[joint.partners[there]])
        assert list(mesh.boundaries) == list(before.boundaries)
        for side in before.boundaries:
            assert area(mesh, side) == pytest.approx(area(before, side), rel=1e-12)
    assert len(joint.edges) > len(
        bodies({"a": vx.meshes.cubes(2), "b": SPACE_FAMILIES[make](n, UP)}).interfaces["a|b"].edges
    )


@pytest.mark.long
@pytest.mark.parametrize("offset", [1e-8, 3e-6, 0.01])
def test_slivers_of_a_joint_go_with_their_neighbours(offset):
    mesh = bodies({"a": vx.meshes.cubes(2), "b": vx.meshes.cubes(2, ((offset, 1 + offset), (0, 1), (1, 2)))})
    for _ in range(2):
        mesh = mesh.refine(np.linalg.norm(mesh.centroids - [0.6, 0.4, 1.0], axis=1) < mesh.diameters)
        checked(mesh)
    assert fatness(mesh) > 0.004


@pytest.mark.long
@pytest.mark.parametrize("others", [("tetrahedra", 3), ("voronoi3", 2), ("prisms", 3)], ids=str)
def test_askew_joints_are_refined_again_and_again(others):
    make, n = others
    lower, upper = vx.meshes.cubes(3), SPACE_FAMILIES[make](n, UP, seed=3)
    turn, middle = np.array([[0.96, -0.28, 0], [0.28, 0.96, 0], [0, 0, 1]]), [0.5, 0.5, 0.0]
    upper = vx.PolyhedralMesh((upper.points - middle) @ turn.T + middle, upper.cells)
    mesh = bodies({"a": lower, "b": upper})
    for level in range(3):
        mesh = mesh.refine(np.linalg.norm(mesh.centroids - [0.45, 0.55, 1.0], axis=1) < 0.3 * 0.6**level)
        checked(mesh)
    assert fatness(mesh) > 1e-6


def test_the_other_body_takes_the_finer_faces_and_stays():
    mesh = bodies({"a": vx.meshes.cubes(2), "b": vx.meshes.cubes(2, UP)})
    top = np.flatnonzero((mesh.centroids[:, 2] > 0.5) & (mesh.centroids[:, 2] < 1.0))[:1]
    finer = mesh.refine(top)
    assert finer.n_cells == mesh.n_cells + 7
    assert len(finer.interfaces["a|b"].edges) == 3 + 4
    apart = finer.interfaces["a|b"].pairs
    assert np.abs(finer.points[apart[:, 0]] - finer.points[apart[:, 1]]).max() == 0.0


def test_a_crack_is_refined_on_both_sides_and_closes_at_its_tip():
    plane = vx.meshes.squares(4)
    x, y = plane.centroids.T
    sides = {"above": np.flatnonzero((y > 0.5) & (x < 0.5)), "below": np.flatnonzero((y < 0.5) & (x < 0.5))}
    mesh = plane.cut("crack", sides).extruded([0.0, 0.25, 0.5])
    for _ in range(2):
        mesh = mesh.refine(np.linalg.norm(mesh.centroids[:, :2] - 0.5, axis=1) < 0.6 * mesh.diameters)
        checked(mesh)
    assert area(mesh, "crack") == pytest.approx(0.25, rel=1e-13)
    pairs = mesh.interfaces["crack"].pairs
    single = pairs[:, 0] == pairs[:, 1]
    assert single.any()
    np.testing.assert_array_equal(mesh.points[pairs[single, 0], 0], 0.5)
    assert mesh.points[pairs[~single, 0], 0].max() < 0.5


@pytest.mark.parametrize("nothing", [[], np.zeros(8, dtype=bool), np.empty(0, dtype=np.int64)], ids=str)
def test_nothing_to_refine(nothing):
    mesh = vx.meshes.cubes(2)
    found = refinement(mesh, nothing)
    for array in mesh.ARRAYS:
        np.testing.assert_array_equal(getattr(found.mesh, array), getattr(mesh, array))
    np.testing.assert_array_equal(found.parents, np.arange(8))
    assert not found.mesh.points.flags.writeable


def test_wrong_marks():
    mesh = vx.meshes.cubes(2)
    wanted = r"cells to refine must be numbers of cells \(0 to 7\), or one bool for each of the 8"
    for cells in ([0, 8], [-1], [0.5], np.ones(3, dtype=bool), "all", [[0], [1, 2]]):
        with pytest.raises(vx.MeshError, match=wanted):
            mesh.refine(cells)
    with pytest.raises(vx.MeshError, match="refinement: found .* where a PolygonMesh or PolyhedralMesh is wanted"):
        refinement("cubes")


def test_cells_that_their_centroids_do_not_see_are_refused():
    plane = vx.PolygonMesh(
        [[0, 0], [4, 0], [4, 4], [3, 4], [3, 1], [1, 1], [1, 4], [0, 4], [5, 0], [5, 4]],
        [[0, 1, 2, 3, 4, 5, 6, 7], [1, 8, 9, 2]],
    )
    mesh = plane.extruded([0.0, 1.0])
    with pytest.raises(
        vx.MeshError, match=r"^cell 0 is not star-shaped about its centroid, .* cut it into convex cells"
    ):
        mesh.refine()
    assert mesh.refine([1]).n_cells == 1 + 8
    with pytest.raises(vx.MeshError, match="cell 0 is not star-shaped"):
        mesh.refine([1]).refine([1])  # beside it, so that it would have faces of faces


def test_a_cell_in_the_shape_of_an_l_is_seen_from_the_corner():
    plane = vx.PolygonMesh([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], [[0, 1, 2, 3, 4, 5]])
    mesh = plane.extruded([0.0, 1.0]).refine()
    checked(mesh)
    assert mesh.n_cells == 12
    assert clearance(mesh) > 0.01


@pytest.mark.long
@pytest.mark.parametrize(
    "box", [((1e6, 1e6 + 1), (0, 1), (0, 1)), ((0, 1e-8), (0, 1e-8), (0, 1e-8)), ((0, 9), (0, 1), (0, 0.05))]
)
def test_boxes_that_are_far_away_small_or_thin(box):
    for make in ("cubes", "kelvin"):
        mesh = SPACE_FAMILIES[make]((2, 2, 2), box)
        fine = refined_at_random(mesh, 2)
        checked(fine)
        assert fine.volumes.sum() == pytest.approx(mesh.volumes.sum(), rel=1e-9)
        for side in mesh.boundaries:
            assert area(fine, side) == pytest.approx(area(mesh, side), rel=1e-9)


@pytest.mark.long
def test_refinement_ends_where_rounding_begins():
    mesh, said = vx.meshes.cubes(1), ""
    for _ in range(60):
        try:
            mesh = mesh.refine([np.argmax(mesh.centroids.sum(axis=1))])
        except vx.MeshError as error:
            said = str(error)
            break
    assert re.match(r"the edge \(\d+, \d+\) at \(1, 1, 1\) is only .* long", said)
    assert mesh.diameters.min() < 2.0**-44
    assert fatness(mesh) == pytest.approx(3**-1.5, rel=0.1)


@pytest.mark.long
def test_solids_of_files_are_refined_and_written(tmp_path):
    mesh = refined_at_random(vx.meshes.kelvin(1), 1)
    mesh.write(tmp_path / "refined.vtu")
    again = vx.meshes.read(tmp_path / "refined.vtu")
    np.testing.assert_array_equal(again.face_vertices, mesh.face_vertices)
    assert refined_at_random(again, 1).n_cells == refined_at_random(mesh, 1).n_cells


@pytest.mark.long
@pytest.mark.parametrize("share", [0.1, 1.0])
def test_more_cells_take_the_same_calls(share):
    count = []
    for n in (3, 9):
        mesh = vx.meshes.kelvin(n)
        some = np.random.default_rng(0).random(mesh.n_cells) < share
        count.append(calls(lambda mesh=mesh, some=some: mesh.refine(some)))
    assert count[1] < 1.2 * count[0]
