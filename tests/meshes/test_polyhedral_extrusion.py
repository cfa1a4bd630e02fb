"""Extrusion of polygons: prisms, names, data and interfaces."""

from __future__ import annotations

import numpy as np
import pytest
from same_mesh import assert_matched

import vemcvx as vx

BOX = ((0.0, 2.0), (-1.0, 0.0))
LEVELS = [-0.5, 0.0, 2.0]


@pytest.mark.parametrize("family", vx.meshes.FAMILIES)
def test_layers_are_prisms_in_the_order_of_the_plane_cells(family):
    """Compare volumes with areas times heights, and sides with the sides of a box."""
    plane = vx.meshes.FAMILIES[family](3, BOX, 1)
    mesh = plane.extruded(LEVELS)
    np.testing.assert_allclose(mesh.volumes, np.concatenate([0.5 * plane.areas, 2.0 * plane.areas]), rtol=1e-14)
    middles = np.column_stack([np.tile(plane.centroids, (2, 1)), np.repeat([-0.25, 1.0], plane.n_cells)])
    np.testing.assert_allclose(mesh.centroids, middles, atol=1e-14)
    assert mesh.n_nodes == 3 * plane.n_nodes
    edges = (len(plane.vertices) + len(plane.boundaries["boundary"])) // 2
    assert mesh.n_faces == 3 * plane.n_cells + 2 * edges
    np.testing.assert_array_equal(mesh.points[: plane.n_nodes, :2], plane.points)
    np.testing.assert_array_equal(mesh.points[plane.n_nodes : 2 * plane.n_nodes, 2], 0.0)
    for cell, face in enumerate(mesh.boundaries["bottom"]):
        around = mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]]
        assert sorted(around) == sorted(plane.cells[cell])
        assert mesh.face_cells[face].tolist() == [cell, -1]
    assert list(mesh.boundaries) == ["left", "right", "front", "back", "bottom", "top", "boundary"]
    areas = dict(zip(mesh.boundaries, (2.5, 2.5, 5.0, 5.0, 2.0, 2.0), strict=False))
    for name, area in areas.items():
        assert mesh.face_areas[mesh.boundaries[name]].sum() == pytest.approx(area, rel=1e-14)


def test_extrusion_keeps_names_and_data():
    plane = vx.meshes.squares(2, BOX).with_boundary("hole", lambda x: x[:, 0] < 0.6)
    plane = plane.with_cell_data("young", np.arange(8.0)).with_cell_data("axis", np.arange(16).reshape(8, 2))
    mesh = plane.extruded(LEVELS)
    assert mesh.boundaries["hole"].size == 2 * plane.boundaries["hole"].shape[0]
    assert (mesh.face_centroids[mesh.boundaries["hole"], 0] < 0.6).all()
    np.testing.assert_array_equal(mesh.cell_data["young"], np.tile(np.arange(8.0), 2))
    np.testing.assert_array_equal(mesh.cell_data["axis"][8:], plane.cell_data["axis"])


def test_extrusion_keeps_interfaces():
    pair = vx.meshes.bodies({"a": vx.meshes.squares(2), "b": vx.meshes.voronoi(2, ((0, 1), (1, 2)))})
    solid = pair.extruded([0, 1, 3])
    made = solid.interfaces["a|b"]
    edges = pair.interfaces["a|b"].edges
    assert made.bodies == ("a", "b")
    assert solid.face_areas[solid.boundaries["a|b"]].sum() == pytest.approx(3.0)
    assert len(made.pairs) == 3 * len(np.unique(edges))
    assert_matched(solid)


def test_extrusion_gives_no_name_to_sides_without_names():
    square = vx.meshes.squares(1)
    unnamed = vx.PolygonMesh(square.points, square.cells, boundaries={})
    assert list(unnamed.extruded([0, 1]).boundaries) == ["bottom", "top", "boundary"]
