"""Families of meshes in the plane and in space: requirements of all families, and properties of single families."""

from __future__ import annotations

import inspect
import itertools

import numpy as np
import pytest
from counted import calls
from scenes import mostly_long

from vemcvx import meshes
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, PolygonMesh, l_shape

EVERY = {**FAMILIES, **SPACE_FAMILIES}
RANDOM = ("voronoi", "distorted", "hanging", "prisms", "voronoi3")
AXES = {2: {"left": 0, "right": 0, "bottom": 1, "top": 1}}
AXES[3] = {"left": 0, "right": 0, "front": 1, "back": 1, "bottom": 2, "top": 2}
UNIT = ((0.0, 1.0), (0.0, 1.0), (0.0, 1.0))
ODD = ((-1.0 / 3.0, np.pi), (0.1, 0.7), (-5.0, -4.0))
FAR = ((1e5, 1e5 + 2.0), (-3e5, -3e5 + 0.5), (0.0, 0.5))
CASES = {"one": (1, UNIT), "few": ((5, 3, 3), ODD), "row": ((4, 1, 1), ODD), "box": ((2, 3, 1), ODD), "far": (2, FAR)}


def find_dimension(family):
    return 2 if family in FAMILIES else 3


def make(family, n, box, seed=0):
    dim = find_dimension(family)
    return EVERY[family](n[:dim] if isinstance(n, tuple) else n, box[:dim], seed)


def describe_part(mesh, name):
    """Return the nodes, the outward normals, and the lengths or areas of a part of the boundary."""
    if isinstance(mesh, PolygonMesh):
        ends = mesh.points[mesh.boundaries[name]]
        along = ends[:, 1] - ends[:, 0]
        size = np.linalg.norm(along, axis=1)
        return mesh.boundaries[name].ravel(), np.column_stack([along[:, 1], -along[:, 0]]) / size[:, None], size
    faces = mesh.boundaries[name]
    nodes = [mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]] for face in faces]
    return np.concatenate(nodes), mesh.face_normals[faces], mesh.face_areas[faces]


def test_every_function_that_meshes_a_box_is_a_family():
    functions = {name: getattr(meshes, name) for name in meshes.__all__ if inspect.isfunction(getattr(meshes, name))}
    families = {name for name, function in functions.items() if "box" in inspect.signature(function).parameters}
    assert families - {"l_shape"} == set(EVERY)  # an L does not fill its box
    assert all(found.__name__ == name for name, found in EVERY.items())


@mostly_long("case", CASES, "one", "row", "far")
@pytest.mark.parametrize("family", EVERY)
def test_cells_fill_the_box_up_to_its_named_sides(family, case):
    (n, box), dim = CASES[case], find_dimension(family)
    mesh, box = make(family, n, box, seed=3), np.array(box[:dim])
    lengths = box[:, 1] - box[:, 0]
    rounding = 1e-14 * mesh.n_cells + 2.0**-46 * np.abs(box).max() / lengths.min()
    again = type(mesh)(mesh.points, mesh.cells)  # tests turn warnings into errors
    for name in (*mesh.ARRAYS, "measures", "centroids", "diameters"):
        np.testing.assert_array_equal(getattr(again, name), getattr(mesh, name))
        assert not getattr(mesh, name).flags.writeable
    for name in mesh.boundaries:
        np.testing.assert_array_equal(again.boundaries[name], mesh.boundaries[name])
    assert (mesh.measures > 0.0).all()
    assert mesh.measures.sum() == pytest.approx(np.prod(lengths), rel=rounding)
    middle = mesh.measures @ (mesh.centroids - box.mean(axis=1)) / mesh.measures.sum()
    np.testing.assert_allclose(middle, 0.0, atol=rounding * lengths.max())
    assert list(mesh.boundaries) == [*AXES[dim], "boundary"]
    for name, axis in AXES[dim].items():
        end = int(name in ("right", "back", "top"))
        nodes, normals, sizes = describe_part(mesh, name)
        assert (mesh.points[nodes, axis] == box[axis, end]).all()
        np.testing.assert_array_equal(normals, np.tile(np.eye(dim)[axis] * (2 * end - 1), (len(normals), 1)))
        assert sizes.sum() == pytest.approx(np.prod(np.delete(lengths, axis)), rel=rounding)
    assert sum(len(mesh.boundaries[name]) for name in AXES[dim]) == len(mesh.boundaries["boundary"])
    assert set(itertools.product(*box.tolist())) <= set(map(tuple, mesh.points.tolist()))


@mostly_long("family", EVERY, "voronoi", "hanging", "hexagons", "tetrahedra", "prisms")
def test_the_same_seed_gives_the_same_mesh(family):
    one, same, other = (make(family, 3, UNIT, seed) for seed in (5, 5, 6))
    for name in one.ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
    differs = one.points.shape != other.points.shape or not np.array_equal(one.points, other.points)
    assert differs == (family in RANDOM)


def count_cells_per_square(family):
    """Return the number of cells divided by n^2: 2 for triangles, 1.9 for `hanging`."""
    return round(FAMILIES[family]((40, 40)).n_cells / 1600, 1)


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_n_is_the_number_of_cells_across_the_shortest_side(family):
    coarse, fine, per_square = make(family, 10, UNIT), make(family, 20, UNIT), count_cells_per_square(family)
    assert coarse.n_cells / per_square == pytest.approx(100, rel=0.1)
    assert fine.n_cells / coarse.n_cells == pytest.approx(4.0, rel=0.1)
    for box, cells in ((((0, 2), (0, 0.5)), 400), (((0, 0.04), (0, 0.01)), 400), (((0, 30), (0, 40)), 130)):
        assert make(family, 10, box).n_cells / per_square == pytest.approx(cells, rel=0.15)
    assert fine.h < 0.6 * coarse.h
    assert make(family, (6, 2), ((0.0, 3.0), (0.0, 1.0))).n_cells == pytest.approx(12 * per_square, rel=0.1)


@mostly_long("family", SPACE_FAMILIES, "voronoi3", "tetrahedra")
def test_n_is_the_number_of_cells_across_the_shortest_side_in_space(family):
    for box, nx, ny, nz in ((((0, 1), (0, 1), (0, 1)), 2, 2, 2), (((0, 2), (0, 0.5), (0, 1)), 8, 2, 4)):
        per_cube = {"tetrahedra": 6 * nx * ny * nz, "kelvin": 2 * nx * ny * nz}
        assert make(family, 2, box).n_cells == per_cube.get(family, nx * ny * nz)


@mostly_long("family", EVERY, "voronoi", "hanging", "tetrahedra", "voronoi3")
def test_meshes_given_by_size_and_by_number_are_equal_in_any_unit(family):
    for unit in (1.0, 1e-3) if family in FAMILIES else (1.0,):
        box = [(0.0, 40.0 * unit), (-10.0 * unit, 0.0), (0.0, 20.0 * unit)][: find_dimension(family)]
        sized, counted = EVERY[family](size=5.0 * unit, box=box), EVERY[family](2, box)
        for name in counted.ARRAYS:
            np.testing.assert_array_equal(getattr(sized, name), getattr(counted, name))
    h = make(family, 2, UNIT).h
    for length in (1e-12, 1e12):
        assert make(family, 2, ((0.0, length),) * 3).h == pytest.approx(length * h, rel=1e-12, abs=0.0)


# Properties of single families.


@pytest.mark.parametrize("n", [1, 3])
def test_squares_are_numbered_row_by_row_and_triangles_halve_them(n):
    mesh, lines = meshes.squares(n), np.linspace(0.0, 1.0, n + 1)
    assert mesh.h == pytest.approx(np.sqrt(2.0) / n, rel=1e-14)
    np.testing.assert_array_equal(mesh.points, [(x, y) for y in lines for x in lines])
    middles = (lines[1:] + lines[:-1]) / 2
    np.testing.assert_allclose(mesh.centroids, [(x, y) for y in middles for x in middles], rtol=1e-14)
    np.testing.assert_allclose(meshes.triangles(n).areas, 0.5 / n**2, rtol=1e-13)
    np.testing.assert_array_equal(meshes.triangles(n).points, mesh.points)


def test_hexagons_are_regular_where_they_fit():
    columns, rows = 6, 4
    mesh = meshes.hexagons((columns, rows), ((0.0, 6.0), (0.0, 4.0 * np.sqrt(0.75))))
    whole = [cell for cell in mesh.cells if len(cell) == 6]
    assert len(whole) == 2 * columns - 1  # inner rows have six or five hexagons
    for cell in whole:
        sides = np.hypot(*(mesh.points[cell] - mesh.points[np.roll(cell, -1)]).T)
        np.testing.assert_allclose(sides, 1.0 / np.sqrt(3.0), rtol=1e-13)
    assert {len(cell) for cell in mesh.cells} == {4, 5, 6}


def test_distortion_moves_inner_nodes_only():
    mesh, straight = meshes.distorted(6, seed=1), meshes.squares(6)
    assert (np.abs(mesh.points - straight.points).max(axis=1) > 0.0).sum() == 25
    assert np.abs(mesh.points - straight.points).max() <= 0.25 / 6


def cross_edges(mesh, cell):
    """Return the cross products of consecutive edges."""
    edge = np.roll(mesh.points[cell], -1, axis=0) - mesh.points[cell]
    before = np.roll(edge, 1, axis=0)
    return before[:, 0] * edge[:, 1] - before[:, 1] * edge[:, 0]


def test_nonconvex_cells_are_not_convex():
    mesh = meshes.nonconvex(3)
    assert all(cross_edges(mesh, cell).min() < -1e-3 * mesh.areas[0] for cell in mesh.cells)
    np.testing.assert_allclose(mesh.areas, 1.0 / 9.0, rtol=1e-13)


def test_hanging_nodes_are_vertices_of_larger_cells_too():
    mesh = meshes.hanging(4, seed=2)
    assert mesh.n_cells == 16 + 3 * 5
    assert any((cross_edges(mesh, cell) == 0.0).any() for cell in mesh.cells)
    assert set(mesh.areas.tolist()) == {1 / 16, 1 / 64}


def measure_edges(mesh):
    ends = np.concatenate([np.roll(cell, -1) for cell in mesh.cells])
    return np.hypot(*(mesh.points[ends] - mesh.points[mesh.vertices]).T)


@mostly_long("cells", [1, 2, 3, 50], 0, 2)
def test_voronoi_makes_the_requested_number_of_cells(cells):
    """Meshes of narrow boxes keep the corners and the short edges across the box."""
    for width, options in ((5.0, {}), (1e-3, {"shortest": 0.1}), (1e3, {"shortest": 0.1})):
        mesh = meshes.voronoi(cells=cells, box=((0.0, width), (0.0, 1.0)), seed=4, **options)
        PolygonMesh(mesh.points, mesh.cells)
        assert mesh.n_cells == cells
        assert mesh.areas.sum() == pytest.approx(width, rel=1e-12)


@mostly_long("seed", [0, 1, 2])
def test_voronoi_collapses_short_edges_by_default_and_evens_out_cells(seed):
    mesh = meshes.voronoi(cells=400, seed=seed)
    PolygonMesh(mesh.points, mesh.cells)
    # `shortest` is 0.02 by default. Shorter edges remain in triangles, and between two sides of the box.
    assert np.quantile(measure_edges(mesh) * 20, 0.01) > 0.02
    assert measure_edges(mesh).min() * 20 > 1e-3
    raw = meshes.voronoi(cells=400, seed=seed, shortest=0.0)
    PolygonMesh(raw.points, raw.cells)
    assert measure_edges(raw).min() * 20 < 0.02
    assert mesh.areas.std() * 400 < 0.15  # 0.53 without Lloyd's iteration


def test_cubes_tetrahedra_and_truncated_octahedra_have_their_closed_forms():
    assert meshes.cubes(4).h == pytest.approx(np.sqrt(3.0) / 4.0, rel=1e-15)
    np.testing.assert_allclose(meshes.tetrahedra(2).volumes, 1.0 / 48.0, rtol=1e-14)
    mesh = meshes.kelvin(4, ((0, 4), (0, 4), (0, 4)))
    inner = np.flatnonzero(np.abs(mesh.centroids - 2.0).max(axis=1) < 1.0)
    np.testing.assert_allclose(mesh.volumes[inner], 0.5, rtol=1e-12)
    np.testing.assert_allclose(mesh.diameters[inner], np.sqrt(5.0) / 2.0, rtol=1e-12)
    for cell in inner:
        sides = np.diff(mesh.face_offsets)[mesh.cell_faces[mesh.cell_offsets[cell] : mesh.cell_offsets[cell + 1]]]
        assert sorted(sides) == [4] * 6 + [6] * 8


def test_an_l_is_a_box_without_its_upper_right_quarter():
    (left, right), (bottom, top) = ODD[:2]
    for n in (1, (3, 6)):
        mesh = l_shape(n, ODD[:2])
        PolygonMesh(mesh.points, mesh.cells)
        x, y = np.mean(ODD[:2], axis=1)
        assert mesh.areas.sum() == pytest.approx(0.75 * (right - left) * (top - bottom), rel=1e-14)
        assert not ((mesh.centroids[:, 0] > x) & (mesh.centroids[:, 1] > y)).any()
    x, y = mesh.points[np.argmin(np.hypot(*(mesh.points - (x, y)).T))]
    for name, axis, place, length in (("inner_right", 0, x, top - y), ("inner_top", 1, y, right - x)):
        nodes, normals, sizes = describe_part(mesh, name)
        assert (mesh.points[nodes, axis] == place).all()
        assert (normals[:, axis] > 0.0).all()
        assert sizes.sum() == pytest.approx(length, rel=1e-14)
    assert set(mesh.boundaries) == {"left", "right", "bottom", "top", "inner_right", "inner_top", "boundary"}
    assert l_shape(2, ((0, 1), (0, 2))).n_cells == l_shape(size=0.5, box=((0, 1), (0, 2))).n_cells == 6


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_sixteen_times_the_cells_take_hardly_more_calls(name):
    coarse, fine = (calls(lambda n=n: FAMILIES[name](n).boundaries["left"]) for n in (10, 40))
    assert fine < 1.25 * coarse
