"""Meshes of polygons: read-only arrays, named boundaries, cell data, copies, pictures."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest
from scenes import small

import vemcvx as vx
from vemcvx.meshes import PolygonMesh

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
HALVES = [[0, 1, 2], [0, 2, 3]]


@pytest.fixture
def mesh():
    return small("voronoi", 4, seed=1)


def test_arrays_are_read_only_copies_of_the_given_arrays(mesh):
    mesh = mesh.with_boundary("part", lambda x: x[:, 0] < 0.5).with_cell_data("young", mesh.areas)
    arrays = [mesh.points, mesh.offsets, mesh.vertices, mesh.areas, mesh.centroids, mesh.diameters, mesh.neighbours]
    arrays += [*mesh.cells, *mesh.boundaries.values(), *mesh.cell_data.values()]
    assert not any(array.flags.writeable for array in arrays)
    for mapping in (mesh.boundaries, mesh.cell_data):
        with pytest.raises(TypeError):
            mapping["new"] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.points = np.zeros((3, 2))
    given = np.array(SQUARE), np.array([[0, 1, 2, 3]]), np.array([5.0]), np.array([[0, 1]])
    mesh = PolygonMesh(*given[:2], cell_data={"young": given[2]}, boundaries={"base": given[3]})
    for array in given:
        array[0] = 9
    np.testing.assert_array_equal(mesh.points, SQUARE)
    assert mesh.cells[0].tolist() == [0, 1, 2, 3]
    assert mesh.cell_data["young"].tolist() == [5.0]
    assert mesh.boundaries["base"].tolist() == [[0, 1]]


def test_sides_of_a_box_are_named_by_position_unless_boundaries_are_given():
    mesh = PolygonMesh(SQUARE, HALVES)
    sides = {"left": [[3, 0]], "right": [[1, 2]], "bottom": [[0, 1]], "top": [[2, 3]]}
    assert {name: edges.tolist() for name, edges in mesh.boundaries.items() if name != "boundary"} == sides
    assert set(mesh.refine().boundaries) == {*sides, "boundary"}
    assert list(PolygonMesh(SQUARE, HALVES, boundaries={}).boundaries) == ["boundary"]
    assert mesh.boundaries["boundary"].tolist() == [[0, 1], [1, 2], [2, 3], [3, 0]]
    named = PolygonMesh(SQUARE, HALVES, boundaries={"floor": [(0, 1)]})
    assert list(named.boundaries) == ["floor", "boundary"]
    angle = 2 * np.pi * (np.arange(12) + 0.25) / 12
    assert list(PolygonMesh(np.column_stack([np.cos(angle), np.sin(angle)]), [range(12)]).boundaries) == ["boundary"]


def test_given_boundaries_may_have_any_order_and_direction():
    mesh = PolygonMesh(SQUARE, HALVES, boundaries={"L": [(0, 3), (1, 0), (0, 1)]})
    assert mesh.boundaries["L"].tolist() == [[0, 1], [3, 0]]
    first = vx.meshes.squares(2)
    names = {name: edges[::-1, ::-1] for name, edges in first.boundaries.items()}
    names["boundary"] = np.concatenate([names["boundary"], names["boundary"][:1]])
    second = PolygonMesh(2 * first.points, first.cells, boundaries=names)
    assert set(second.boundaries) == set(first.boundaries)
    assert all(np.array_equal(second.boundaries[name], first.boundaries[name]) for name in names)
    names["boundary"] = names["boundary"][2:-1]
    with pytest.raises(vx.MeshError, match="the name 'boundary' is taken"):
        PolygonMesh(first.points, first.cells, boundaries=names)


def test_a_boundary_is_named_by_a_predicate_of_midpoints(mesh):
    seen = []
    more = mesh.with_boundary("west", lambda x: seen.append(x) or x[:, 0] == 0.0)
    np.testing.assert_array_equal(seen[0], mesh.points[mesh.boundaries["boundary"]].mean(axis=1))
    np.testing.assert_array_equal(more.boundaries["west"], mesh.boundaries["left"])
    assert "west" not in mesh.boundaries
    assert more.points is mesh.points
    again = more.with_boundary("west", lambda x: x[:, 0] == 1.0)
    np.testing.assert_array_equal(again.boundaries["west"], mesh.boundaries["right"])
    assert list(again.boundaries) == ["left", "right", "bottom", "top", "west", "boundary"]


def test_cell_data_are_added_and_replaced(mesh):
    more = mesh.with_cell_data("young", range(16)).with_cell_data("fibre", np.ones((16, 2)))
    assert more.cell_data["young"].tolist() == list(range(16))
    assert more.cell_data["fibre"].shape == (16, 2)
    assert not mesh.cell_data
    assert more.with_cell_data("young", np.zeros(16)).cell_data["young"].sum() == 0.0


# Pictures.


PLANE = vx.meshes.hanging((2, 3), ((0.0, 2.0), (0.0, 3.0)), seed=1)


def test_cells_are_drawn_at_their_places_in_their_colours():
    pytest.importorskip("matplotlib")
    for path, row in zip(PLANE.plot().collections[0].get_paths(), PLANE.cells, strict=True):
        np.testing.assert_array_equal(path.vertices[: len(row)], PLANE.points[row])
    assert [text.get_text() for text in PLANE.plot().texts] == ["left", "right", "bottom", "top"]
    ax = PLANE.plot(PLANE.areas, cmap="plasma", ec="black", lw=2.0)
    np.testing.assert_array_equal(ax.collections[0].get_array(), PLANE.areas)
    assert ax.collections[0].get_cmap().name == "plasma"
    assert ax.collections[0].get_linewidth() == [2.0]
    assert ax.get_aspect() == 1.0
    assert PLANE.plot(ax=ax) is ax
    assert len(ax.collections) == 2


def test_a_picture_names_the_missing_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(vx.VemcvxError, match=r"pip install 'vemcvx\[plot\]'"):
        PLANE.plot()
