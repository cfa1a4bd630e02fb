"""Cuts along a line or a plane: the two parts of a mesh."""

import numpy as np
import pytest
from same_mesh import measure_part

import vemcvx as vx


@pytest.mark.parametrize("family", ["squares", "voronoi", "hanging"])
@pytest.mark.parametrize("normal", [(0.0, 2.0), (1.0, 2.0)])
def test_both_parts_have_the_area_the_names_and_the_data_of_the_whole(family, normal):
    mesh = vx.meshes.FAMILIES[family](5).with_boundary("low left", lambda x: (x[:, 0] < 1e-9) & (x[:, 1] < 0.5))
    mesh = mesh.with_cell_data("number", np.arange(mesh.n_cells))
    point = np.array([0.5, 0.43])
    parts = vx.meshes.cut(mesh, point, normal)
    assert sum(part.areas.sum() for part in parts) == pytest.approx(1.0, abs=1e-14)
    for name in ("left", "bottom", "top", "low left"):
        whole = measure_part(mesh, name)
        assert sum(measure_part(part, name) for part in parts if name in part.boundaries) == pytest.approx(
            whole, abs=1e-14
        )
    for sign, part in zip((-1, 1), parts, strict=True):
        assert (sign * ((part.points - point) @ normal) > -1e-12).all()
        # Each new cell lies in the old cell from which it was cut.
        old = mesh.centroids[part.cell_data["number"]]
        assert np.linalg.norm(part.centroids - old, axis=1).max() < mesh.h
    joined = vx.meshes.bodies({"behind": parts[0], "ahead": parts[1]})
    across = np.linalg.norm(np.array([-normal[1], normal[0]])) / np.abs(normal[1])
    assert measure_part(joined, "behind|ahead") == pytest.approx(across, abs=1e-12)


def test_in_space_the_plane_must_run_along_faces():
    cubes = vx.meshes.cubes(4)
    behind, ahead = vx.meshes.cut(cubes, (0.0, 0.0, 0.5), (0.0, 0.0, 3.0))
    assert (behind.n_cells, ahead.n_cells) == (32, 32)
    assert list(behind.boundaries) == ["left", "right", "front", "back", "bottom", "boundary"]
    assert len(vx.meshes.bodies({"a": behind, "b": ahead}).boundaries["a|b"]) == 16
    with pytest.raises(vx.MeshError, match=r"crosses 16 cells, the first at .*; in space it must run along faces"):
        vx.meshes.cut(cubes, (0.0, 0.0, 0.4), (0.0, 0.0, 1.0))
