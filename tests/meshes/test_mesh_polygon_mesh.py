"""The mesh object: read-only, named boundaries, data on cells, copies."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import PolygonMesh

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


@pytest.fixture
def mesh():
    return vx.meshes.voronoi(4, seed=1)


def test_arrays_are_read_only(mesh):
    mesh = mesh.with_boundary("part", lambda x: x[:, 0] < 0.5).with_cell_data("young", mesh.areas)
    mesh = mesh.with_boundaries({"more": mesh.boundaries["left"]})
    arrays = [mesh.points, mesh.offsets, mesh.vertices, mesh.areas, mesh.centroids, mesh.diameters, mesh.neighbours]
    arrays += [*mesh.cells, *mesh.boundaries.values(), *mesh.cell_data.values()]
    for array in arrays:
        assert not array.flags.writeable
    for mapping in (mesh.boundaries, mesh.cell_data):
        with pytest.raises(TypeError):
            mapping["new"] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.points = np.zeros((3, 2))


def test_arrays_handed_in_stay_writeable_and_apart():
    points, cells, values = np.array(SQUARE), np.array([[0, 1, 2, 3]]), np.array([5.0])
    edges = np.array([[0, 1]])
    mesh = PolygonMesh(points, cells, boundaries={"base": edges}, cell_data={"young": values})
    for array in (points, cells, values, edges):
        array[0] = 9
    np.testing.assert_array_equal(mesh.points, SQUARE)
    assert mesh.cells[0].tolist() == [0, 1, 2, 3]
    assert mesh.cell_data["young"].tolist() == [5.0]
    assert mesh.boundaries["base"].tolist() == [[0, 1]]


def test_repr_is_one_line(mesh):
    assert repr(mesh).startswith(f"PolygonMesh(16 cells, {mesh.n_nodes} nodes, h = 0.")
    assert repr(mesh).endswith("boundaries: left, right, bottom, top, boundary)")


def test_counts_and_cells(mesh):
    assert mesh.n_cells == len(mesh.cells) == len(mesh.areas) == 16
    assert mesh.n_nodes == len(mesh.points) == mesh.vertices.max() + 1
    np.testing.assert_array_equal(np.concatenate(mesh.cells), mesh.vertices)
    assert mesh.h == mesh.diameters.max()


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda mesh: pickle.loads(pickle.dumps(mesh))])
def test_copies(mesh, copied):
    mesh = mesh.with_boundary("part", lambda x: x[:, 0] < 0.5).with_cell_data("young", mesh.areas)
    again = copied(mesh)
    np.testing.assert_array_equal(again.points, mesh.points)
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    assert list(again.boundaries) == list(mesh.boundaries)
    np.testing.assert_array_equal(again.boundaries["part"], mesh.boundaries["part"])
    np.testing.assert_array_equal(again.cell_data["young"], mesh.cell_data["young"])
    arrays = [again.points, again.vertices, again.offsets, again.boundaries["part"], again.cell_data["young"]]
    assert not any(array.flags.writeable for array in arrays)


def test_every_mesh_names_its_whole_boundary():
    mesh = PolygonMesh(SQUARE, [[0, 1, 2], [0, 2, 3]], boundaries={})
    assert list(mesh.boundaries) == ["boundary"]
    assert mesh.boundaries["boundary"].tolist() == [[0, 1], [1, 2], [2, 3], [3, 0]]


def test_the_sides_of_a_box_are_named_by_place():
    """As files do; where something is named, or nothing is to be, they are not; a circle has none."""
    mesh = PolygonMesh(SQUARE, [[0, 1, 2], [0, 2, 3]])
    sides = {"left": [[3, 0]], "right": [[1, 2]], "bottom": [[0, 1]], "top": [[2, 3]]}
    assert {name: edges.tolist() for name, edges in mesh.boundaries.items() if name != "boundary"} == sides
    assert set(mesh.refine().boundaries) == {*sides, "boundary"}
    named = PolygonMesh(SQUARE, [[0, 1, 2, 3]], boundaries={"floor": [(0, 1)]})
    assert list(named.boundaries) == ["floor", "boundary"]
    with_one_more = mesh.with_boundary("floor", lambda x: x[:, 1] == 0)
    assert set(with_one_more.boundaries) == {*sides, "floor", "boundary"}
    angle = 2 * np.pi * (np.arange(12) + 0.25) / 12
    assert list(PolygonMesh(np.column_stack([np.cos(angle), np.sin(angle)]), [range(12)]).boundaries) == ["boundary"]


@pytest.mark.parametrize("family", vx.meshes.FAMILIES)
def test_names_by_place_are_those_of_families(family):
    mesh = vx.meshes.FAMILIES[family](3)
    again = PolygonMesh(mesh.points, mesh.cells)
    for name, edges in mesh.boundaries.items():
        np.testing.assert_array_equal(again.boundaries[name], edges)
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp("right"), vx.Traction((1.0, 0.0), on="left"))
    np.testing.assert_array_equal(
        vx.simulate(scene, again, [0.0, 1.0], initial="settled").displacement,
        vx.simulate(scene, mesh, [0.0, 1.0], initial="settled").displacement,
    )


@pytest.mark.parametrize("family", vx.meshes.SPACE_FAMILIES)
def test_in_space_likewise(family):
    mesh = vx.meshes.SPACE_FAMILIES[family](2)
    again = vx.PolyhedralMesh(mesh.points, mesh.cells)
    assert list(again.boundaries) == ["left", "right", "front", "back", "bottom", "top", "boundary"]
    for name in again.boundaries:
        assert len(again.boundaries[name]) == len(mesh.boundaries[name])
    assert list(vx.PolyhedralMesh(mesh.points, mesh.cells, boundaries={}).boundaries) == ["boundary"]


def test_given_boundaries_are_turned_and_sorted():
    mesh = PolygonMesh(SQUARE, [[0, 1, 2], [0, 2, 3]], boundaries={"L": [(0, 3), (1, 0), (0, 1)]})
    assert mesh.boundaries["L"].tolist() == [[0, 1], [3, 0]]


@pytest.mark.parametrize(
    ("boundaries", "message"),
    [
        ({"inner": [(0, 2)]}, r"boundary 'inner': \(0, 2\) is not an edge of the boundary \(1 of 1 are not\)"),
        ({"none": [(0, 1), (1, 3)]}, r"\(1, 3\) is not an edge of the boundary \(1 of 2"),
        ({"far": [(0, 7)]}, "boundary 'far': node numbers run from 0 to 3; got 0 to 7"),
        ({"far": [(-1, 0)]}, "node numbers run from 0 to 3; got -1 to 0"),
        ({"empty": []}, r"boundary 'empty': edges must be pairs of node numbers"),
        ({"flat": [0, 1]}, r"got int64 of shape \(2,\)"),
        ({"ragged": [(0, 1), (1,)]}, "edges must be pairs"),
        ({"real": [(0.0, 1.0)]}, "got float64"),
        ({"boundary": [(0, 1)]}, "the name 'boundary' is taken"),
        ({"": [(0, 1)]}, "must be a non-empty string"),
        ({3: [(0, 1)]}, "must be a non-empty string; got 3"),
        ([("a", [(0, 1)])], "boundaries must map names to edges"),
    ],
)
def test_bad_boundaries(boundaries, message):
    with pytest.raises(vx.MeshError, match=message):
        PolygonMesh(SQUARE, [[0, 1, 2], [0, 2, 3]], boundaries=boundaries)


def test_names_of_one_mesh_are_names_of_another():
    """The whole boundary among them, in any order and direction, repeated or not."""
    first = vx.meshes.squares(2)
    names = {name: edges[::-1, ::-1] for name, edges in first.boundaries.items()}
    names["boundary"] = np.concatenate([names["boundary"], names["boundary"][:1]])
    second = PolygonMesh(2 * first.points, first.cells, boundaries=names)
    assert set(second.boundaries) == set(first.boundaries)
    assert all(np.array_equal(second.boundaries[name], first.boundaries[name]) for name in names)
    names["boundary"] = names["boundary"][2:-1]
    with pytest.raises(vx.MeshError, match="here it is given to 6 of its 8 parts. Choose another name, or leave it"):
        PolygonMesh(first.points, first.cells, boundaries=names)


def test_an_edge_to_a_dropped_node_is_no_boundary():
    with pytest.warns(vx.MeshWarning), pytest.raises(vx.MeshError, match=r"\(0, 4\) is not an edge of the boundary"):
        PolygonMesh([*SQUARE, (9, 9)], [[0, 1, 2, 3]], boundaries={"far": [(0, 4)]})


def test_with_boundary(mesh):
    more = mesh.with_boundary("west", lambda x: x[:, 0] == 0.0)
    np.testing.assert_array_equal(more.boundaries["west"], mesh.boundaries["left"])
    assert "west" not in mesh.boundaries
    assert more.points is mesh.points
    again = more.with_boundary("west", lambda x: x[:, 0] == 1.0)
    np.testing.assert_array_equal(again.boundaries["west"], mesh.boundaries["right"])
    assert list(again.boundaries) == ["left", "right", "bottom", "top", "west", "boundary"]


def test_predicate_gets_all_midpoints(mesh):
    seen = []
    mesh.with_boundary("all", lambda x: seen.append(x) or np.ones(len(x), dtype=bool))
    np.testing.assert_array_equal(seen[0], mesh.points[mesh.boundaries["boundary"]].mean(axis=1))


@pytest.mark.parametrize(
    ("predicate", "message"),
    [
        (
            lambda x: x[:, 0] > 5.0,
            r"boundary 'p': the predicate selects none of the \d+ boundary edges; their midpoints",
        ),
        (lambda x: x[:, 0], r"must return booleans of shape .* it returned float64"),
        (lambda x: x < 0.5, r"it returned bool of shape \(\d+, 2\)"),
        (lambda x: True, r"it returned bool of shape \(\)"),
        (lambda x: None, "it returned object"),
        (lambda x: [[True], [False, True]], "it returned object"),
        ([True], r"predicate must be a function of the midpoints \(m, 2\); got \[True\]"),
    ],
)
def test_bad_predicates(mesh, predicate, message):
    with pytest.raises(vx.MeshError, match=message):
        mesh.with_boundary("p", predicate)


@pytest.mark.parametrize("name", ["boundary", "", None, 3])
def test_bad_names(mesh, name):
    with pytest.raises(vx.MeshError, match=r"name"):
        mesh.with_boundary(name, lambda x: x[:, 0] < 1.0)


def test_cell_data(mesh):
    more = mesh.with_cell_data("young", range(16)).with_cell_data("fibre", np.ones((16, 2)))
    assert more.cell_data["young"].tolist() == list(range(16))
    assert more.cell_data["fibre"].shape == (16, 2)
    assert not mesh.cell_data
    assert more.with_cell_data("young", np.zeros(16)).cell_data["young"].sum() == 0.0


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        (
            "young",
            np.ones(15),
            r"cell datum 'young' must hold one number .* each of the 16 cells; got float64 of shape",
        ),
        ("young", 3.0, r"shape \(\)"),
        ("young", [[1], [2, 3]], "cell datum 'young' must hold"),
        ("young", ["a"] * 16, "cell datum 'young' must hold"),
        ("young", [None] * 16, "got object"),
        ("", np.ones(16), "must be a non-empty string"),
        (5, np.ones(16), "must be a non-empty string; got 5"),
    ],
)
def test_bad_cell_data(mesh, name, values, message):
    with pytest.raises(vx.MeshError, match=message):
        mesh.with_cell_data(name, values)


def test_cell_data_must_be_a_mapping():
    with pytest.raises(vx.MeshError, match="cell_data must map names to arrays of 1 rows; got list"):
        PolygonMesh(SQUARE, [[0, 1, 2, 3]], cell_data=[1.0])
