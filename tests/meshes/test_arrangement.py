"""Polygons between segments that meet at their ends, found by walking round them, and by Shapely where that fails."""

from __future__ import annotations

import numpy as np
import pytest

from vemcvx.meshes import common_tiling
from vemcvx.meshes.common_tiling import polygons_between
from vemcvx.meshes.polygons import areas_and_centroids

POINTS = np.array(
    [(0, 0), (4, 0), (4, 4), (0, 4), (2, 0), (2, 4), (0, 2), (4, 2), (2, 2), (1, 1), (3, 1), (3, 3), (1, 3)],
    dtype=float,
)
OUTLINE = [(0, 4), (4, 1), (1, 7), (7, 2), (2, 5), (5, 3), (3, 6), (6, 0)]
CROSS = [(4, 8), (8, 5), (6, 8), (8, 7)]
HOLE = [(9, 10), (10, 11), (11, 12), (12, 9)]
GRAPHS = {
    "one polygon": (OUTLINE, [16.0]),
    "four": (OUTLINE + CROSS, [4.0] * 4),
    "halves": (OUTLINE + CROSS[:2], [8.0, 8.0]),
    "a line that ends inside": ([*OUTLINE, (0, 8)], [16.0]),
    "a hole": (OUTLINE + HOLE, [4.0, 12.0]),
    "a hole on a bridge": (OUTLINE + HOLE + [(0, 9)], [4.0, 12.0]),
    "a ring that touches itself": ([(0, 4), (4, 1), (1, 2), (2, 3), (3, 0), (4, 9), (9, 10), (10, 4)], [15.0, 1.0]),
}


def found(names):
    """The areas of the polygons of several graphs, sorted, owner by owner."""
    owner = np.concatenate([np.full(len(GRAPHS[name][0]), k) for k, name in enumerate(names)])
    ends = np.concatenate([np.array(GRAPHS[name][0]) for name in names])
    mixed = np.random.default_rng(0).permutation(len(owner))
    owner, ends = owner[mixed], ends[mixed]
    of, offsets, corners = polygons_between(owner, ends, POINTS[ends])
    assert (np.diff(of) >= 0).all()
    areas = np.abs(areas_and_centroids(POINTS, offsets, ends.ravel()[corners])[0])
    return [np.sort(areas[of == k]) for k in range(len(names))]


@pytest.mark.parametrize("name", GRAPHS)
def test_polygons_have_their_areas(name):
    (areas,) = found([name])
    if "hole" in name or "touches" in name:
        # What has a hole is cut in triangles.
        assert areas.sum() == pytest.approx(16.0, rel=1e-14)
        assert len(areas) > 2
        assert np.isclose(areas, GRAPHS[name][1][-1 if "touches" in name else 0], rtol=1e-14).any()
    else:
        assert areas == pytest.approx(np.sort(GRAPHS[name][1]), rel=1e-14)


def test_graphs_are_told_apart():
    names = [*GRAPHS, *GRAPHS]
    for name, areas in zip(names, found(names), strict=True):
        assert areas.sum() == pytest.approx(16.0, rel=1e-14), name


def test_what_can_be_walked_round_is_not_left_to_shapely(monkeypatch):
    def refuse(*given):
        raise AssertionError("asked")

    monkeypatch.setattr(common_tiling, "_by_shapely", refuse)
    found(["one polygon", "four", "halves"])
    with pytest.raises(AssertionError, match="asked"):
        found(["a hole"])
