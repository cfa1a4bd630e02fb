"""Plane meshes: faults that are refused or corrected, and valid meshes of unusual shape."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import PolygonMesh

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
TWO = [*SQUARE, (2.0, 0.0), (2.0, 1.0)]  # cells [0, 1, 2, 3] and [1, 4, 5, 2]
BOTH = [[0, 1, 2, 3], [1, 4, 5, 2]]


def assert_refused(points, cells, message):
    with pytest.raises(vx.MeshError, match=message):
        PolygonMesh(points, cells)


def make_spiral_stair():
    """Return cells that turn around a node twice. Neighbours fit together, but cells overlap."""
    angle = np.linspace(0.0, 4.0 * np.pi, 13)[:-1]
    ring = (1.0 + 0.05 * np.arange(12))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([[0.0, 0.0], ring]), [[0, k + 1, (k + 1) % 12 + 1] for k in range(12)]


NOTCHED = [[0, 1, 6, 2, 3], [1, 4, 5, 2, 7]]
GEOMETRY = [
    ([*SQUARE[:3], (1, 0)], [[0, 1, 2, 3]], "nodes 1 and 3 are in the same place"),
    ([*SQUARE[:3], (0, 1), (0, 1 + 2e-16)], [[0, 1, 2, 3], [0, 3, 4]], "nodes 3 and 4 are in the same place"),
    (SQUARE, [[0, 2, 1, 3]], "cell 0 has no area"),
    ([(0, 0), (1, 0), (2, 0), (3, 0)], [[0, 1, 2, 3]], "cell 0 has no area"),
    ([*SQUARE, (2, 0)], [[0, 4, 1, 2, 3]], r"cell 0 \(0, 4, 1, 2, 3\) crosses or touches itself"),
    ([*SQUARE, (0.5, 0.0), (0.6, 0.5)], [[0, 1, 2, 5, 4, 3]], "cell 0 .* crosses or touches itself"),
    ([*SQUARE, (0.5, 0.4)], [[0, 1, 4], [1, 0, 2], [0, 1, 3]], r"cells \d and \d overlap near"),
    ([*SQUARE, (0.5, 0.5), (2, 0.4), (2, 0.6)], [[0, 1, 2, 3], [4, 5, 6]], "cells 0 and 1 overlap near"),
    ([*SQUARE, (0.4, 0.4), (0.6, 0.4), (0.5, 0.6)], [[0, 1, 2, 3], [4, 5, 6]], "cells 0 and 1 overlap near"),
    (TWO, [*BOTH, BOTH[0]], "cells 0 and 2 overlap near"),
    (*make_spiral_stair(), "overlap"),
    ([(0, 0), (1, 0), (0, 1), (0.14, 0.14), (-0.14, 0.14)], [[0, 1, 2], [0, 3, 4]], "overlap"),
    # Only the left square has node 6 on the common side. The right square has no node there, or a node 1e-9 away.
    ([*TWO, (1, 0.5)], [NOTCHED[0], BOTH[1]], "cells 0 and 1 .* do not fit together there[.].* hanging nodes included"),
    ([*TWO, (1, 0.5), (1 + 1e-9, 0.5)], NOTCHED, "cells 0 and 1 .* do not fit together there[.].* a gap narrower than"),
    ([*TWO, (1, 0.5), (1 - 1e-9, 0.5)], NOTCHED, "overlap"),
    # Two squares are 1e-9 apart.
    ([*SQUARE, (1 + 1e-9, 0), (2, 0), (2, 1), (1 + 1e-9, 1)], [[0, 1, 2, 3], [4, 5, 6, 7]], "a gap narrower than"),
]


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_invalid_cells_and_tilings_are_refused(scale):
    for points, cells, subject in GEOMETRY:
        assert_refused(scale * np.array(points, dtype=float), cells, subject)


def test_clockwise_cells_are_reversed_with_a_warning():
    with pytest.warns(vx.MeshWarning, match=r"1 of 2 cells were listed clockwise \(the first is cell 1\)") as caught:
        mesh = PolygonMesh(TWO, [[0, 1, 2, 3], [1, 2, 5, 4]])
    assert caught[0].filename == __file__
    assert [cell.tolist() for cell in mesh.cells] == [[0, 1, 2, 3], [1, 4, 5, 2]]
    assert (mesh.areas == 1.0).all()


def test_unused_nodes_are_dropped_with_a_warning():
    points = [(9, 9), *SQUARE[:2], (5, 5), *SQUARE[2:], (7, 7)]
    with pytest.warns(vx.MeshWarning, match=r"3 of 7 nodes belong to no cell \(the first is node 0\)"):
        mesh = PolygonMesh(points, [[1, 2, 4, 5]], boundaries={"base": [(1, 2)]})
    np.testing.assert_array_equal(mesh.points, SQUARE)
    assert mesh.cells[0].tolist() == [0, 1, 2, 3]
    assert mesh.node_map.tolist() == [-1, 0, 1, -1, 2, 3, -1]
    assert mesh.boundaries["base"].tolist() == [[0, 1]]


def assert_valid(points, cells, area):
    """Check the area of a mesh, and return the mesh."""
    mesh = PolygonMesh(points, cells)
    assert mesh.areas.sum() == pytest.approx(area, rel=1e-14)
    return mesh


def test_a_hanging_node_may_be_beside_its_edge_by_rounding():
    """Put a node at a third of an edge. Rounding moves the node to either side of the edge."""
    for a, b in (((0.1, 0.3), (0.7, 1.1)), ((-0.3, 0.9), (1e3, 7.7))):
        a, b = np.array(a), np.array(b)
        node = a + (b - a) / 3.0
        aside = np.array([-(b - a)[1], (b - a)[0]])
        points = np.array([a, b, node, a + aside, a - aside])
        mesh = PolygonMesh(points, [[0, 2, 1, 3], [0, 4, 1, 2]])
        assert len(mesh.neighbours) == 2
        assert_refused(points, [[0, 2, 1, 3], [0, 4, 1]], "do not fit together|overlap")


@pytest.mark.parametrize("offset", [0.0, 3.0, -40.0])
def test_tiny_edges_are_valid(offset):
    """Two cells share a long edge and a tiny edge."""
    tiny = 1e-12 if not offset else 1e-12 * 64  # rounding near 40 is 64 times the rounding below 1
    points = np.array([(0, 0), (1, 0), (1, 1 - tiny), (1 - tiny, 1), (0, 1), (2, 0), (2, 1)]) + offset
    mesh = PolygonMesh(points, [[0, 1, 2, 3, 4], [1, 5, 6, 3, 2]])
    assert mesh.areas.sum() == pytest.approx(2.0, rel=1e-11)


def test_unusual_meshes_are_valid():
    """Check a slender cell, a hole, separate parts, cells that meet in a point, and cells of very different widths."""
    assert_valid([*TWO, (1, 0.5)], [[0, 1, 6, 2, 3], [1, 4, 5, 2, 6]], 2.0)
    assert_valid([(0, 0), (1, 0), (1, 1e-9), (0.5, 1e-9), (0, 1e-9)], [range(5)], 1e-9)
    mesh = vx.meshes.squares(3)
    ring = assert_valid(mesh.points, [cell for c, cell in enumerate(mesh.cells) if c != 4], 8 / 9)
    assert len(ring.boundaries["boundary"]) == 16
    apart = np.vstack([mesh.points, mesh.points + np.array([2.0, 0.5])])
    assert_valid(apart, [*mesh.cells, *(cell + 16 for cell in mesh.cells)], 2.0)
    inside = np.vstack([ring.points, 0.4 + 0.2 * np.array(SQUARE)])
    assert_valid(inside, [*ring.cells, [16, 17, 18, 19]], 8 / 9 + 0.04)
    checkers = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 1), (2, 2), (1, 2)]
    assert len(assert_valid(checkers, [[0, 1, 2, 3], [2, 4, 5, 6]], 2.0).boundaries["boundary"]) == 8
    line = np.concatenate([[0.0], 2.0 ** -np.arange(30.0)[::-1]])
    count = len(line)
    x, y = np.meshgrid(line, line)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    assert_valid(np.column_stack([x.ravel(), y.ravel()]), first[:, None] + [0, 1, count + 1, count], 1.0)
