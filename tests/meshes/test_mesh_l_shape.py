"""The L-shaped body."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import PolygonMesh, l_shape

ODD_BOX = ((-1.0 / 3.0, np.pi), (0.1, 0.7))


@pytest.mark.parametrize("box", [((0, 1), (0, 1)), ODD_BOX], ids=["unit", "odd"])
@pytest.mark.parametrize("n", [1, 2, 7, (2, 4), (6, 2)], ids=str)
def test_it_is_a_box_less_its_upper_right_quarter(n, box):
    mesh = l_shape(n, box)
    PolygonMesh(mesh.points, mesh.cells)
    (width, height), middle = np.diff(box)[:, 0], np.mean(box, axis=1)
    assert mesh.areas.sum() == pytest.approx(0.75 * width * height, rel=1e-14)
    assert not ((mesh.centroids[:, 0] > middle[0]) & (mesh.centroids[:, 1] > middle[1])).any()


def test_sides_are_named_and_face_where_they_say():
    (left, right), (bottom, top) = ODD_BOX
    mesh = l_shape((4, 6), ODD_BOX)
    x, y = mesh.points[np.argmin(np.hypot(*(mesh.points - np.mean(ODD_BOX, axis=1)).T))]
    expected = {
        "left": (0, left, top - bottom, -1),
        "right": (0, right, y - bottom, 1),
        "bottom": (1, bottom, right - left, -1),
        "top": (1, top, x - left, 1),
        "inner_right": (0, x, top - y, 1),
        "inner_top": (1, y, right - x, 1),
    }
    assert set(mesh.boundaries) == {*expected, "boundary"}
    for name, (axis, place, length, outward) in expected.items():
        ends = mesh.points[mesh.boundaries[name]]
        assert (ends[..., axis] == place).all()
        along = ends[:, 1] - ends[:, 0]
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        assert (outward * normal[:, axis] > 0.0).all()
        assert np.abs(along).sum() == pytest.approx(length, rel=1e-14)
    assert sum(len(mesh.boundaries[name]) for name in expected) == len(mesh.boundaries["boundary"])


def test_n_is_cells_across_the_shortest_side():
    mesh = l_shape(8)
    assert mesh.n_cells == 48
    assert mesh.h == pytest.approx(np.sqrt(2) / 8, rel=1e-14)
    assert l_shape(4, ((0, 2), (0, 2))).n_cells == l_shape(4, ((0, 1e-3), (0, 1e-3))).n_cells == 12
    assert l_shape(2, ((0, 1), (0, 2))).n_cells == l_shape(size=0.5, box=((0, 1), (0, 2))).n_cells == 6


def test_names_stay_through_refinement():
    mesh = l_shape(2).refine().refine([0, 5])
    assert len(mesh.boundaries["inner_right"]) == 2
    assert mesh.areas.sum() == 0.75


@pytest.mark.parametrize("bad", [0, 2.5, "8", (3, 4), (4, 1), (2, 2, 2)], ids=str)
def test_bad_counts(bad):
    with pytest.raises(vx.MeshError, match=r"^n[xy]? must be"):
        l_shape(bad)


def test_bad_box():
    with pytest.raises(vx.MeshError, match="x0 < x1"):
        l_shape(2, ((1, 0), (0, 1)))
