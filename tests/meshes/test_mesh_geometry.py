"""Areas, centroids, diameters and neighbours of polygons against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from vemcvx.meshes import FAMILIES, PolygonMesh

SHAPES = {
    # vertices, area, centroid, diameter
    "square": ([(0, 0), (1, 0), (1, 1), (0, 1)], 1.0, (0.5, 0.5), np.sqrt(2)),
    "triangle": ([(0, 0), (3, 0), (0, 6)], 9.0, (1.0, 2.0), np.sqrt(45)),
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3.0, (5 / 6, 5 / 6), np.sqrt(8)),
    "straight angle": ([(0, 0), (1, 0), (2, 0), (2, 1), (0, 1)], 2.0, (1.0, 0.5), np.sqrt(5)),
    "arrow": ([(0, 0), (2, -1), (1, 0), (2, 1)], 1.0, (1.0, 0.0), np.sqrt(5)),
}


@pytest.mark.parametrize("offset", [0.0, 1e6, -3e8])
def test_polygons_have_the_areas_centroids_and_diameters_of_closed_forms(offset):
    for corners, area, centroid, diameter in SHAPES.values():
        shift = np.array([offset, 2 * offset])
        points = np.array(corners, dtype=float) + shift
        mesh = PolygonMesh(points, [range(len(points))])
        assert mesh.areas[0] == pytest.approx(area, rel=1e-15)
        np.testing.assert_allclose(mesh.centroids[0], np.array(centroid) + shift, rtol=4e-16, atol=4e-16)
        assert mesh.diameters[0] == mesh.h == pytest.approx(diameter, rel=1e-15)
    for sides in (5, 6, 9, 40):
        angle = 2 * np.pi * np.arange(sides) / sides
        mesh = PolygonMesh(np.column_stack([np.cos(angle), np.sin(angle)]), [range(sides)])
        assert mesh.areas[0] == pytest.approx(sides / 2 * np.sin(2 * np.pi / sides), rel=1e-14)
        np.testing.assert_allclose(mesh.centroids[0], 0.0, atol=1e-15)
        assert mesh.h == pytest.approx(2 * np.cos(np.pi / (2 * sides)) if sides % 2 else 2.0, rel=1e-15)


def test_neighbours_share_an_edge():
    mesh = FAMILIES["voronoi"](5, seed=1)
    for one, other in mesh.neighbours:
        assert one < other
        assert len(set(mesh.cells[one].tolist()) & set(mesh.cells[other].tolist())) >= 2
    assert mesh.n_nodes - len(mesh.neighbours) - len(mesh.boundaries["boundary"]) + mesh.n_cells == 1  # Euler
