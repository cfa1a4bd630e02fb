"""What every family of meshes must do, and what each promises of its own."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pytest
from counted import calls

import vemcvx as vx
from vemcvx import meshes
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, PolygonMesh

ODD_BOX = ((-1.0 / 3.0, np.pi), (0.1, 0.7))
COUNTS = [1, 2, 7, (1, 4), (5, 1), (3, 4)]
RANDOM = ("voronoi", "distorted", "hanging")


@pytest.fixture(params=FAMILIES)
def make(request):
    return FAMILIES[request.param]


def test_no_family_is_missing_from_the_list():
    made = {
        name
        for name in meshes.__all__
        if inspect.isfunction(getattr(meshes, name)) and "box" in inspect.signature(getattr(meshes, name)).parameters
    }
    assert made - {"l_shape"} == set(FAMILIES) | set(
        SPACE_FAMILIES
    )  # it does not fill its box: see test_mesh_l_shape.py
    assert all(found.__name__ == name for name, found in (FAMILIES | SPACE_FAMILIES).items())


@pytest.mark.parametrize("box", [((0, 1), (0, 1)), ODD_BOX], ids=["unit", "odd"])
@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_passes_the_checks_of_user_meshes(make, n, box):
    mesh = make(n, box, 3)
    again = PolygonMesh(mesh.points, mesh.cells)  # a warning (turned cells, unused nodes) would be an error here
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.points, mesh.points)


@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_cells_fill_the_box_counter_clockwise(make, n):
    mesh = make(n, ODD_BOX, 1)
    width, height = np.diff(ODD_BOX)[:, 0]
    assert (mesh.areas > 0.0).all()
    # Every area is off by a few units in the last place of products of coordinates, at most pi^2.
    assert mesh.areas.sum() == pytest.approx(width * height, abs=1e-15 * 10 * mesh.n_cells)


@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_sides_are_named_and_exact(make, n):
    mesh = make(n, ODD_BOX, 2)
    (left, right), (bottom, top) = ODD_BOX
    assert list(mesh.boundaries) == ["left", "right", "bottom", "top", "boundary"]
    for name, axis, place in (("left", 0, left), ("right", 0, right), ("bottom", 1, bottom), ("top", 1, top)):
        ends = mesh.points[mesh.boundaries[name]]
        assert (ends[..., axis] == place).all()
        along = ends[:, 1, 1 - axis] - ends[:, 0, 1 - axis]
        outward_turn = {"left": -1, "right": 1, "bottom": 1, "top": -1}[name]  # counter-clockwise around the box
        assert (outward_turn * along > 0.0).all()
        assert np.abs(along).sum() == pytest.approx(np.diff(ODD_BOX[1 - axis])[0], rel=1e-14)
    assert sum(len(mesh.boundaries[name]) for name in ("left", "right", "bottom", "top")) == len(
        mesh.boundaries["boundary"]
    )


def test_corners_of_the_box_are_nodes(make):
    points = {tuple(point) for point in make(3, ODD_BOX).points}
    assert {(x, y) for x in ODD_BOX[0] for y in ODD_BOX[1]} <= points


def test_same_seed_same_mesh(make):
    one, same, other = make(6, seed=5), make(6, seed=5), make(6, seed=6)
    np.testing.assert_array_equal(one.points, same.points)
    np.testing.assert_array_equal(one.vertices, same.vertices)
    differs = one.points.shape != other.points.shape or not np.array_equal(one.points, other.points)
    assert differs == (make.__name__ in RANDOM)


def cells_per_square(make):
    """How many cells a family makes of each that was asked for, where there are many: 2 triangles, 1.9 of `hanging`."""
    return round(make((40, 40)).n_cells / 1600, 1)


@pytest.mark.long
def test_n_is_cells_across_the_shortest_side(make):
    coarse, fine = make(10), make(20)
    per_square = cells_per_square(make)
    assert coarse.n_cells / per_square == pytest.approx(100, rel=0.1)
    assert fine.n_cells / coarse.n_cells == pytest.approx(4.0, rel=0.1)
    for box, cells in ((((0, 2), (0, 0.5)), 400), (((0, 0.04), (0, 0.01)), 400), (((0, 30), (0, 40)), 130)):
        assert make(10, box).n_cells / per_square == pytest.approx(cells, rel=0.15)
    assert fine.h < 0.6 * coarse.h


@pytest.mark.parametrize("unit", [1.0, 1e-3, 25.4], ids=str)
def test_cells_of_a_size(make, unit):
    """As many as across the shortest side, in any unit of length."""
    box = ((0.0, 40.0 * unit), (-10.0 * unit, 0.0))
    sized, counted = make(size=2.5 * unit, box=box), make(4, box)
    np.testing.assert_array_equal(sized.points, counted.points)
    np.testing.assert_array_equal(sized.vertices, counted.vertices)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"size": 0.0}, "size must be a length above 1e-60"),
        ({"size": "fine"}, "size must be a length .* got 'fine'"),
        ({"size": np.nan}, "size must be a length"),
        ({"size": 1e-9}, "that would be 1e\\+18 cells"),
        ({"n": 3, "size": 0.1}, "n must be given .*; got n = 3 and size = 0.1"),
        ({"n": (3, 4), "size": 0.1}, "n must be given"),
    ],
    ids=str,
)
def test_bad_sizes(make, given, says):
    with pytest.raises(vx.MeshError, match=says):
        make(**given)


@pytest.mark.long
def test_pair_of_counts(make):
    """A row begins and ends with half a cell in some families, and some numbers of cells are rounded."""
    mesh = make((6, 2), ((0.0, 3.0), (0.0, 1.0)))
    assert mesh.n_cells == pytest.approx(12 * cells_per_square(make), rel=0.1)


@pytest.mark.parametrize(
    ("name", "cells"),
    [("squares", 12), ("triangles", 24), ("hexagons", 13), ("voronoi", 12), ("hanging", 12 + 3 * round(0.3 * 12))],
)
def test_pair_of_counts_of_ours(name, cells):
    assert FAMILIES[name]((6, 2), ((0.0, 3.0), (0.0, 1.0))).n_cells == cells


def test_far_from_the_origin(make):
    mesh = make(4, ((1e6, 1e6 + 1.0), (-1e6, 1.0 - 1e6)))
    PolygonMesh(mesh.points, mesh.cells)
    assert mesh.areas.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("length", [1e-12, 1e12])
def test_any_unit_of_length(make, length):
    mesh, unit = make((4, 4), ((0, length), (0, length))), make((4, 4))
    PolygonMesh(mesh.points, mesh.cells)
    assert mesh.h == pytest.approx(length * unit.h, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    "bad", [0, -3, 2.5, 4.0, float("nan"), None, True, "8", (0, 3), (2, 1.5), (1, 2, 3), ()], ids=str
)
def test_bad_counts(make, bad):
    with pytest.raises(vx.MeshError, match=r"^n[xy]? must be"):
        make(bad)


def test_absurd_counts(make):
    with pytest.raises(vx.MeshError, match="cells; at most"):
        make(10**6)


@pytest.mark.parametrize(
    ("box", "message"),
    [
        (((1, 0), (0, 1)), "x0 < x1; got x0 = 1 and x1 = 0"),
        (((0, 1), (2, 2)), "y0 < y1; got y0 = 2 and y1 = 2"),
        (((0, float("nan")), (0, 1)), "box must be finite"),
        (((0, float("inf")), (0, 1)), "box must be finite"),
        ((0, 1, 0, 1), "four numbers"),
        (((0, 1),), "four numbers"),
        ("unit", "four numbers"),
        (None, "four numbers"),
        (((0, 1e80), (0, 1)), "Choose other units"),
        (((0, 1e-80), (0, 1)), "Choose other units"),
    ],
    ids=str,
)
def test_bad_boxes(make, box, message):
    with pytest.raises(vx.MeshError, match=message):
        make(2, box)


@pytest.mark.parametrize("name", RANDOM)
@pytest.mark.parametrize("seed", [-1, 0.5, None])
def test_bad_seeds(name, seed):
    with pytest.raises(vx.MeshError, match="seed must be"):
        FAMILIES[name](2, seed=seed)


@pytest.mark.parametrize("name", ["squares", "triangles", "distorted", "nonconvex", "hexagons", "hanging"])
def test_cells_narrower_than_rounding(name):
    with pytest.raises(vx.MeshError, match="narrower than the spacing of floating-point numbers"):
        FAMILIES[name]((1000, 1), ((1e15, 1e15 + 1), (0, 1)))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("distorted", {"amount": 1.0}, r"amount must be a number in \[0, 1\)"),
        ("distorted", {"amount": float("nan")}, "amount must be"),
        ("nonconvex", {"zigzag": 0.4}, r"zigzag must be a number in \[0, 0.333333\)"),
        ("hanging", {"fraction": 1.5}, r"fraction must be a number in \[0, 1\]"),
        ("voronoi", {"shortest": 0.5}, r"shortest must be a number in \[0, 0.1\]"),
        ("voronoi", {"relaxations": -1}, "relaxations must be at least 0"),
        ("voronoi", {"cells": 0}, "cells must be at least 1"),
        ("voronoi", {"cells": 2.0}, "cells must be a whole number"),
    ],
)
def test_bad_options(name, options, message):
    with pytest.raises(vx.MeshError, match=message):
        FAMILIES[name](3, **options)


@pytest.mark.parametrize("n", [1, 3, 64])
def test_squares_are_numbered_row_by_row(n):
    mesh = meshes.squares(n)
    assert mesh.n_cells == n**2
    assert mesh.h == pytest.approx(np.sqrt(2.0) / n, rel=1e-14)
    np.testing.assert_allclose(mesh.areas, 1.0 / n**2, rtol=1e-12)
    lines = np.linspace(0.0, 1.0, n + 1)
    np.testing.assert_array_equal(mesh.points, [(x, y) for y in lines for x in lines])
    middles = (lines[1:] + lines[:-1]) / 2
    np.testing.assert_allclose(mesh.centroids, [(x, y) for y in middles for x in middles], rtol=1e-14)


def test_triangles_halve_squares():
    mesh = meshes.triangles(5)
    np.testing.assert_allclose(mesh.areas, 0.5 / 25, rtol=1e-13)
    np.testing.assert_array_equal(mesh.points, meshes.squares(5).points)


def test_hexagons_are_regular_where_they_fit():
    columns, rows = 6, 4
    mesh = meshes.hexagons((columns, rows), ((0.0, 6.0), (0.0, 4.0 * np.sqrt(0.75))))
    whole = [cell for cell in mesh.cells if len(cell) == 6]
    assert len(whole) == 2 * columns - 1  # the inner two of four rows: six cells, and five between halves
    for cell in whole:
        sides = np.hypot(*(mesh.points[cell] - mesh.points[np.roll(cell, -1)]).T)
        np.testing.assert_allclose(sides, 1.0 / np.sqrt(3.0), rtol=1e-13)
    assert {len(cell) for cell in mesh.cells} == {4, 5, 6}


def test_distorted_moves_inner_nodes_only():
    mesh, straight = meshes.distorted(6, seed=1, amount=0.9), meshes.squares(6)
    moved = np.abs(mesh.points - straight.points).max(axis=1) > 0.0
    assert moved.sum() == 25
    assert np.abs(mesh.points - straight.points).max() <= 0.45 / 6
    np.testing.assert_array_equal(meshes.distorted(6, amount=0.0).points, straight.points)


@pytest.mark.parametrize("seed", range(5))
def test_wildly_distorted_is_valid(seed):
    mesh = meshes.distorted(20, seed=seed, amount=0.999)
    PolygonMesh(mesh.points, mesh.cells)


@pytest.mark.parametrize("zigzag", [0.15, 0.33])
def test_nonconvex_cells_are_not_convex(zigzag):
    mesh = meshes.nonconvex(3, zigzag=zigzag)
    PolygonMesh(mesh.points, mesh.cells)
    for cell in mesh.cells:
        edge = np.roll(mesh.points[cell], -1, axis=0) - mesh.points[cell]
        before = np.roll(edge, 1, axis=0)
        assert (before[:, 0] * edge[:, 1] - before[:, 1] * edge[:, 0]).min() < -1e-3 * mesh.areas[0]
    np.testing.assert_allclose(mesh.areas, 1.0 / 9.0, rtol=1e-13)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_hanging_nodes_belong_to_both_cells(fraction):
    mesh = meshes.hanging(4, seed=2, fraction=fraction)
    assert mesh.n_cells == 16 + 3 * round(fraction * 16)
    straight = 0
    for cell in mesh.cells:
        edge = np.roll(mesh.points[cell], -1, axis=0) - mesh.points[cell]
        before = np.roll(edge, 1, axis=0)
        straight += np.count_nonzero(before[:, 0] * edge[:, 1] == before[:, 1] * edge[:, 0])
    assert (straight > 0) == (fraction == 0.3)
    assert set(mesh.areas.tolist()) <= {1 / 16, 1 / 64}


@pytest.mark.long
@pytest.mark.parametrize("name", FAMILIES)
def test_sixteen_times_the_cells_take_hardly_more_calls(name):
    def made(n):
        return calls(lambda: FAMILIES[name](n).boundaries["left"])

    # Hexagons are cut at the box row by row.
    assert made(40) < (1.8 if name == "hexagons" else 1.25) * made(10)


@pytest.mark.parametrize(
    ("name", "cells"), [("squares", "1.01e+08"), ("triangles", "2.02e+08"), ("hanging", "4.04e+08")]
)
def test_too_many_cells_are_counted_as_they_are_made(name, cells):
    with pytest.raises(vx.MeshError, match=re.escape(f"that would be {cells} cells")):
        FAMILIES[name](1, ((0.0, 1e8 + 1e6), (0.0, 1.0)))


def test_needles_have_no_voronoi_cells():
    with pytest.raises(vx.MeshError, match="points have no triangulation: they are all but on one line"):
        meshes.voronoi(size=1e-2, box=((0.0, 1e-59), (0.0, 1.0)))
