"""Values at points and along lines."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from scenes import cyclic, few_families, paper_scene, small

import vemcvx as vx
from vemcvx.results import places
from vemcvx.results.probe import locate
from vemcvx.vem import CellGroup

TIMES = np.linspace(0.0, 1.0, 4)
FIELDS = ("stress", "out_of_plane_stress", "von_mises", "principal_stresses")


@cache
def run(family, n=4):
    return vx.simulate(paper_scene(cyclic), small(family, n), TIMES)


def draw_points(n, seed=0):
    return np.random.default_rng(seed).uniform(size=(n, 2))


def make_comb():
    """Return a mesh of two cells: a comb with two slots, and a square on the middle tooth."""
    outline = [[0, 0], [5, 0], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]]
    return vx.PolygonMesh(np.array([*outline, [3, 4], [2, 4]], dtype=float), [list(range(12)), [7, 6, 12, 13]])


def winding_number(corners, x):
    """Return how often a polygon winds around x."""
    to = corners - x
    angle = np.arctan2(to[:, 1], to[:, 0])
    step = np.diff(np.append(angle, angle[0]))
    return round(((step + np.pi) % (2 * np.pi) - np.pi).sum() / (2 * np.pi))


@few_families
def test_points_are_located_in_their_cells(family):
    mesh, x = small(family, 4), draw_points(60)
    found = locate(mesh, x)
    inside = [(i, c) for i in range(60) for c, cell in enumerate(mesh.cells) if winding_number(mesh.points[cell], x[i])]
    assert list(zip(found.points.tolist(), found.cells.tolist(), strict=True)) == inside
    assert (found.starts == -1).all()


@few_families
def test_nodes_have_their_own_values_and_edges_interpolate_them(family):
    history = run(family)
    mesh = history.mesh
    assert np.array_equal(history.probe(mesh.points), history.displacement)
    ends = np.concatenate([np.column_stack([cell, np.roll(cell, -1)]) for cell in mesh.cells])
    a, b = history.displacement[:, ends[:, 0]], history.displacement[:, ends[:, 1]]
    for t in (0.5, 0.2):
        x = (1 - t) * mesh.points[ends[:, 0]] + t * mesh.points[ends[:, 1]]
        # Edges are longer than 0.04, so the parameter t has an error of at most 1e-14.
        assert np.abs(history.probe(x) - ((1 - t) * a + t * b)).max() < 1e-13 * np.abs(a).max()


@few_families
def test_linear_fields_are_exact_everywhere(family):
    mesh = small(family, 4)
    gradient, shift = np.array([[0.3, -1.2], [0.7, 0.4]]), np.array([5.0, -2.0])
    linear = (mesh.points @ gradient.T + shift)[None]
    history = dataclasses.replace(run(family), displacement=linear)
    x = np.concatenate([draw_points(200), [[0.0, 0.1 + 0.2], [1.0, 0.77]]])
    assert np.abs(history.probe(x)[0] - (x @ gradient.T + shift)).max() < 1e-13


@few_families
def test_values_inside_cells_are_those_of_the_projection(family):
    history = run(family)
    mesh, x = history.mesh, draw_points(20, 5)
    found = locate(mesh, x)
    for i, cell, value in zip(found.points, found.cells, history.probe(x).transpose(1, 0, 2), strict=True):
        corners = mesh.points[mesh.cells[cell]]
        # Values at vertices determine the linear function Pi u.
        cell_alone = CellGroup(np.arange(1), np.arange(len(corners))[None], corners)
        at_vertices = cell_alone.vertex_values()[0] @ history.displacement[-1, mesh.cells[cell]]
        base = np.column_stack([np.ones(len(corners)), corners])
        wanted = np.append(1.0, x[i]) @ np.linalg.lstsq(base, at_vertices, rcond=None)[0]
        assert value[-1] == pytest.approx(wanted, abs=1e-11 * np.abs(history.displacement).max())


def test_points_in_slots_of_a_nonconvex_cell_are_outside():
    mesh = make_comb()
    found = locate(mesh, np.array([[0.5, 2.9], [2.5, 2.0], [4.5, 2.5], [2.5, 3.5], [2.5, 0.5]]))
    assert (found.points.tolist(), found.cells.tolist()) == ([0, 1, 2, 3, 4], [0, 0, 0, 1, 0])
    shared = locate(mesh, np.array([[2.5, 3.0], [2.0, 3.0], [1.0, 2.0]]))
    assert (shared.points.tolist(), shared.cells.tolist()) == ([0, 0, 1, 1, 2], [0, 1, 0, 1, 0])
    assert shared.along[0] == 0.5
    for slot in ([1.5, 2.0], [3.5, 3.0], [2.5, 4.1], [-1e-9, 1.0], [1e300, 0.0]):
        assert len(locate(mesh, np.array([slot])).points) == 0


def test_points_are_located_far_from_the_origin_and_in_any_unit():
    """Coordinates near 1e6 are rounded to 1e-10, so points on the boundary may lie outside by 1e-10."""
    mesh = small("voronoi", 4)
    far = vx.PolygonMesh(mesh.points / 3 + 1e6, mesh.cells)
    x = np.column_stack([np.linspace(0, 1, 40), np.zeros(40)])
    assert np.array_equal(np.unique(locate(far, x / 3 + 1e6).points), np.arange(40))
    tiny, x = vx.PolygonMesh(mesh.points * 1e-9, mesh.cells), draw_points(200)
    assert np.array_equal(locate(tiny, x * 1e-9).cells, locate(mesh, x).cells)


def test_nodes_at_a_distance_of_rounding_keep_their_own_values():
    mesh = vx.PolygonMesh([[0, 0], [1, 0], [1, 1], [0, 1], [1e-12, 0]], [[4, 1, 2, 3, 0]])
    u = np.arange(10.0).reshape(1, 5, 2) ** 2
    assert np.array_equal(places(mesh, mesh.points, "probe").at_nodes(u), u)


@pytest.mark.parametrize("field", FIELDS)
def test_values_along_a_line_are_those_of_its_cells(field):
    history = run("squares")
    values = history.probe(np.linspace((0.0, 0.6), (1.0, 0.6), 5), field)
    row = np.flatnonzero(np.abs(history.mesh.centroids[:, 1] - 0.625) < 1e-9)
    row = row[np.argsort(history.mesh.centroids[row, 0])]
    for at, step in enumerate(history.stored):
        cells = getattr(history, field)(step)[row]
        # On an edge, the value is the mean of both cells.
        wanted = np.concatenate([cells[:1], 0.5 * (cells[1:] + cells[:-1]), cells[-1:]])
        assert values[at] == pytest.approx(wanted, abs=1e-14 * np.abs(cells).max())
