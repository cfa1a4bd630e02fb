"""Pictures of meshes in space: which faces are drawn, where and in which colours."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx

pytest.importorskip("matplotlib")


@pytest.fixture
def mesh():
    return vx.meshes.kelvin(1, ((0.0, 2.0), (0.0, 1.0), (-1.0, 0.0)))


def polygons(ax):
    """Corners of what is drawn, before it is seen from anywhere."""
    return [np.asarray(face) for face in ax.collections[0]._faces]


@pytest.mark.parametrize("on", ["boundary", "top"])
def test_draws_the_faces_of_a_boundary(mesh, on):
    drawn = polygons(mesh.plot(on=on))
    assert len(drawn) == len(mesh.boundaries[on])
    for polygon, face in zip(drawn, mesh.boundaries[on], strict=True):
        corners = mesh.points[mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]]]
        np.testing.assert_array_equal(polygon[: len(corners)], corners)


def test_draws_displaced(mesh):
    moved = polygons(mesh.plot(displacement=np.full((mesh.n_nodes, 3), 0.5)))
    corners = np.diff(mesh.face_offsets)[mesh.boundaries["boundary"]][0]
    np.testing.assert_array_equal(moved[0][:corners], polygons(mesh.plot())[0][:corners] + 0.5)


@pytest.mark.parametrize("by_name", [False, True])
def test_colours_by_values_of_cells(mesh, by_name):
    mesh = mesh.with_cell_data("size", mesh.volumes)
    ax = mesh.plot("size" if by_name else mesh.volumes, cmap="plasma", ec="black", lw=2.0)
    outer = mesh.face_cells[mesh.boundaries["boundary"], 0]
    np.testing.assert_array_equal(ax.collections[0].get_array(), mesh.volumes[outer])
    assert ax.collections[0].get_cmap().name == "plasma"
    assert ax.collections[0].get_linewidth() == [2.0]


@pytest.mark.long
def test_in_view_true_to_scale_and_saved(mesh, tmp_path):
    ax = mesh.plot(mesh.volumes)
    assert mesh.plot(ax=ax) is ax
    assert len(ax.collections) == 2
    for (low, high), (a, b) in zip(
        [(0, 2), (0, 1), (-1, 0)], [ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], strict=True
    ):
        assert a <= low < high <= b
    x, y, z = ax._box_aspect
    assert x / y == pytest.approx(2.0)
    assert y == pytest.approx(z)
    ax.figure.savefig(tmp_path / "mesh.png", dpi=20)
    assert (tmp_path / "mesh.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"on": "lid"}, "there is no boundary 'lid'; this mesh has left, right, front, back, bottom, top, boundary"),
        ({"values": "young"}, "there is no cell datum 'young'"),
        ({"values": [1.0]}, "for each of the 14 cells|for each of the 23 cells"),
        ({"displacement": np.zeros((3, 3))}, r"displacement must be numbers of the shape \(\d+, 3\)"),
        ({"ax": 3}, "ax must be axes in space, .*; got 3"),
    ],
    ids=str,
)
def test_what_does_not_fit(mesh, given, message):
    with pytest.raises(vx.MeshError, match=message):
        mesh.plot(**given)


def test_plane_axes_are_refused(mesh):
    with pytest.raises(vx.MeshError, match="ax must be axes in space"):
        mesh.plot(ax=vx.meshes.squares(1).plot())
