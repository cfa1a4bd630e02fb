"""Values at any points and along lines: exact where u_h is known, Pi u_h elsewhere, and errors outside."""

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
FIELDS = ("displacement", "stress", "out_of_plane_stress", "von_mises", "principal_stresses")


@cache
def run(family, n=4):
    """A run that many tests ask for values."""
    return vx.simulate(paper_scene(cyclic), small(family, n), TIMES)


def points_in(n, seed=0):
    return np.random.default_rng(seed).uniform(size=(n, 2))


def comb():
    """A body with two slots, one cell a U around both sides of a square that is not there: all but convex."""
    points = [
        [0, 0],
        [5, 0],
        [5, 3],
        [4, 3],
        [4, 1],
        [3, 1],
        [3, 3],
        [2, 3],
        [2, 1],
        [1, 1],
        [1, 3],
        [0, 3],
        [3, 4],
        [2, 4],
    ]
    return vx.PolygonMesh(np.array(points, dtype=float), [list(range(12)), [7, 6, 12, 13]])


def turns(corners, x):
    """How often a polygon winds around x, by the angles at which its sides are seen."""
    to = corners - x
    angle = np.arctan2(to[:, 1], to[:, 0])
    step = np.diff(np.append(angle, angle[0]))
    return round(((step + np.pi) % (2 * np.pi) - np.pi).sum() / (2 * np.pi))


@few_families
def test_cells_that_hold_points(family):
    mesh, x = small(family, 4), points_in(60)
    found = locate(mesh, x)
    held = [(i, c) for i in range(len(x)) for c, cell in enumerate(mesh.cells) if turns(mesh.points[cell], x[i])]
    assert list(zip(found.points.tolist(), found.cells.tolist(), strict=True)) == held
    assert (found.starts == -1).all()


@few_families
def test_nodes_take_their_own_values(family):
    history = run(family)
    assert np.array_equal(history.probe(history.mesh.points), history.displacement)


@few_families
def test_linear_fields_are_met_everywhere(family):
    mesh = small(family, 4)
    gradient, shift = np.array([[0.3, -1.2], [0.7, 0.4]]), np.array([5.0, -2.0])
    linear = (mesh.points @ gradient.T + shift)[None]
    history = dataclasses.replace(run(family), displacement=linear)
    x = np.concatenate([points_in(200), mesh.centroids[mesh.areas > 1e-3], [[0.0, 0.1 + 0.2], [1.0, 0.77]]])
    x = x[np.bincount(locate(mesh, x).points, minlength=len(x)) > 0]  # a centroid may lie outside of its own cell
    assert len(x) > 200
    assert np.abs(history.probe(x)[0] - (x @ gradient.T + shift)).max() < 1e-13


@few_families
def test_inside_of_cells_it_is_the_projection(family):
    history = run(family)
    mesh, x = history.mesh, points_in(20, 5)
    found = locate(mesh, x)
    for i, cell, value in zip(found.points, found.cells, history.probe(x).transpose(1, 0, 2), strict=True):
        corners = mesh.points[mesh.cells[cell]]
        # Pi u is linear, and known at the vertices.
        cell_alone = CellGroup(np.arange(1), np.arange(len(corners))[None], corners)
        at_vertices = cell_alone.vertex_values()[0] @ history.displacement[-1, mesh.cells[cell]]
        base = np.column_stack([np.ones(len(corners)), corners])
        wanted = np.append(1.0, x[i]) @ np.linalg.lstsq(base, at_vertices, rcond=None)[0]
        assert value[-1] == pytest.approx(wanted, abs=1e-11 * np.abs(history.displacement).max())


@few_families
def test_on_edges_it_is_the_trace(family):
    history = run(family)
    mesh = history.mesh
    ends = np.concatenate([np.column_stack([cell, np.roll(cell, -1)]) for cell in mesh.cells])
    a, b = history.displacement[:, ends[:, 0]], history.displacement[:, ends[:, 1]]
    for t in (0.5, 0.2):
        x = (1 - t) * mesh.points[ends[:, 0]] + t * mesh.points[ends[:, 1]]
        # Points between nodes 1e-3 apart are known to 1e-13 of that.
        assert np.abs(history.probe(x) - ((1 - t) * a + t * b)).max() < 1e-11 * np.abs(a).max()


def test_cells_that_are_all_but_convex():
    mesh = comb()
    x = np.array([[0.5, 2.9], [2.5, 2.0], [4.5, 2.5], [2.5, 3.5], [2.5, 0.5]])
    found = locate(mesh, x)
    assert found.points.tolist() == [0, 1, 2, 3, 4]
    assert found.cells.tolist() == [0, 0, 0, 1, 0]
    shared = locate(mesh, np.array([[2.5, 3.0], [2.0, 3.0], [1.0, 2.0]]))
    assert shared.points.tolist() == [0, 0, 1, 1, 2]
    assert shared.cells.tolist() == [0, 1, 0, 1, 0]
    assert shared.along[0] == 0.5
    for slot in ([1.5, 2.0], [3.5, 3.0], [2.5, 4.1], [-1e-9, 1.0], [1e300, 0.0]):
        assert len(locate(mesh, np.array([slot])).points) == 0


def test_far_away_and_in_any_unit():
    """Coordinates near 1e6 are rounded to 1e-10: a point on the boundary may be that far outside."""
    mesh = small("voronoi", 4)
    moved = vx.PolygonMesh(mesh.points / 3 + 1e6, mesh.cells)
    x = np.column_stack([np.linspace(0, 1, 40), np.zeros(40)])
    assert np.array_equal(np.unique(locate(moved, x / 3 + 1e6).points), np.arange(40))
    tiny = vx.PolygonMesh(mesh.points * 1e-9, mesh.cells)
    x = points_in(200)
    assert np.array_equal(locate(tiny, x * 1e-9).cells, locate(mesh, x).cells)


def test_edges_of_rounding_errors_keep_their_ends_apart():
    mesh = vx.PolygonMesh([[0, 0], [1, 0], [1, 1], [0, 1], [1e-12, 0]], [[4, 1, 2, 3, 0]])
    u = np.arange(10.0).reshape(1, 5, 2) ** 2
    assert np.array_equal(places(mesh, mesh.points, "probe").at_nodes(u), u)


@pytest.mark.parametrize("field", FIELDS)
def test_lines(field):
    history = run("squares")
    arc, values = history.along((0.0, 0.6), (1.0, 0.6), count=5, field=field)
    assert arc.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    if field == "displacement":
        x = np.column_stack([arc, np.full(5, 0.6)])
        assert np.array_equal(values, history.probe(x))
        return
    row = np.flatnonzero(np.abs(history.mesh.centroids[:, 1] - 0.625) < 1e-9)
    row = row[np.argsort(history.mesh.centroids[row, 0])]
    for at, step in enumerate(history.stored):
        cells = getattr(history, field)(step)[row]
        # On the lines between cells, the mean of both.
        wanted = np.concatenate([cells[:1], 0.5 * (cells[1:] + cells[:-1]), cells[-1:]])
        assert values[at] == pytest.approx(wanted, abs=1e-14 * np.abs(cells).max())


def test_points_outside_are_named():
    history = run("squares")
    with pytest.raises(
        vx.SceneError, match=r"probe: point 1 at \[1.5 0.5\] lies outside the body; the nearest node .* at "
    ):
        history.probe([[0.5, 0.5], [1.5, 0.5]])
    with pytest.raises(vx.SceneError, match=r"\(and so do 2 others\)"):
        history.probe([[3, 0], [2, 0], [0, 9]])
    with pytest.raises(vx.SceneError, match="along: point 51 .* lies outside the body"):
        history.along((0, 0), (2, 0))
    slotted = dataclasses.replace(history, mesh=comb(), displacement=np.zeros((1, 14, 2)))
    with pytest.raises(vx.SceneError, match="point 3 at .* lies outside"):
        slotted.along((0, 2), (5, 2), count=11)


def test_other_mistakes():
    history = run("squares", 2)
    assert history.probe(np.zeros((0, 2))).shape == (len(TIMES), 0, 2)
    for points in ([0.5, 0.5], [[0.5, 0.5, 0.5]], "here", [[0.1], [0.2, 0.3]]):
        with pytest.raises(vx.SceneError, match=r"probe: .*wanted points \(p, 2\), one per row"):
            history.probe(points)
    with pytest.raises(vx.SceneError, match="probe: found NaN or infinite values"):
        history.probe([[0.5, 0.5], [np.nan, 0.5]])
    with pytest.raises(vx.SceneError, match="no field 'strain'; there are 'displacement', 'stress'"):
        history.along((0, 0), (1, 0), field="strain")
    for count in (1, 2.5, True):
        with pytest.raises(vx.SceneError, match="count = .*2 or more"):
            history.along((0, 0), (1, 0), count=count)
    with pytest.raises(vx.SceneError, match=r"along: end: found an array of .*; wanted a point of 2"):
        history.along((0, 0), (1, 0, 0))
    with pytest.raises(vx.SceneError, match="begins and ends at"):
        history.along((0, 0), (0, 0))
