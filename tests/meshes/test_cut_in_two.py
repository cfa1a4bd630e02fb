"""A cut along a line or a plane divides a mesh into two parts."""

import numpy as np
import pytest
from same_mesh import measure_part

import vemcvx as vx


def test_both_parts_have_the_area_the_names_and_the_data_of_the_whole():
    mesh = vx.meshes.triangles(5).with_boundary("low left", lambda x: (x[:, 0] < 1e-9) & (x[:, 1] < 0.5))
    mesh = mesh.with_cell_data("number", np.arange(mesh.n_cells))
    parts = vx.meshes.cut(mesh, (0.0, 0.4), (0.0, 2.0))
    for name in ("left", "bottom", "top", "low left"):
        cut = sum(measure_part(part, name) for part in parts if name in part.boundaries)
        assert cut == pytest.approx(measure_part(mesh, name), abs=1e-14)
    for ahead, part in enumerate(parts):
        np.testing.assert_array_equal(part.centroids[:, 1] > 0.4, ahead)
        np.testing.assert_allclose(part.centroids, mesh.centroids[part.cell_data["number"]], atol=1e-15)
    assert sum(part.n_cells for part in parts) == mesh.n_cells
    joined = vx.meshes.bodies({"behind": parts[0], "ahead": parts[1]})
    assert measure_part(joined, "behind|ahead") == pytest.approx(1.0, abs=1e-12)


def test_a_cut_must_run_along_faces():
    cubes = vx.meshes.cubes(4)
    behind, ahead = vx.meshes.cut(cubes, (0.0, 0.0, 0.5), (0.0, 0.0, 3.0))
    assert (behind.n_cells, ahead.n_cells) == (32, 32)
    assert list(behind.boundaries) == ["left", "right", "front", "back", "bottom", "boundary"]
    assert len(vx.meshes.bodies({"a": behind, "b": ahead}).boundaries["a|b"]) == 16
    with pytest.raises(vx.MeshError, match=r"crosses 16 cells, the first at .*; it must run along faces"):
        vx.meshes.cut(cubes, (0.0, 0.0, 0.4), (0.0, 0.0, 1.0))
