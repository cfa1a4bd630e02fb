"""Local refinement: valid tilings, shapes of cells, grading, names and data."""

from __future__ import annotations

import re
from collections import defaultdict

import numpy as np
import pytest
from same_mesh import measure_part
from scenes import mostly_long, small

import vemcvx as vx
from vemcvx.estimate.measures.distance import common_rule
from vemcvx.meshes import PolygonMesh, tetrahedra
from vemcvx.meshes.local_refinement import splitting_of

FATTEST = defaultdict(
    lambda: 6.0,
    {"squares": 2.01, "triangles": 4.01, "hexagons": 5, "distorted": 5, "nonconvex": 25, "hanging": 2.01},
)
"""Family -> bound on diameter^2 / area after refinement.

The ratio is 2 for a square and 4 for a triangle that is half a square. After seven passes with eight seeds, the largest
ratios were 4.4 for hexagons, 5.3 for voronoi, 4.3 for distorted, and 22 for nonconvex.
"""


def measure_slenderness(mesh):
    return (mesh.diameters**2 / mesh.areas).max()


def measure_edges(mesh):
    ends = np.concatenate([np.roll(cell, -1) for cell in mesh.cells])
    return np.hypot(*(mesh.points[ends] - mesh.points[mesh.vertices]).T)


def count_hanging_nodes(mesh):
    """Return the largest number of nodes on a straight part of an outline."""
    bend = splitting_of(mesh).bend
    most = 0
    for start, end in zip(mesh.offsets[:-1], mesh.offsets[1:], strict=True):
        places = np.flatnonzero(bend[start:end])
        most = max(most, np.diff(np.append(places, places[0] + end - start)).max() - 1)
    return most


def refine_at_random(mesh, passes):
    random = np.random.default_rng(0)
    for _ in range(passes):
        mesh = mesh.refine(random.random(mesh.n_cells) < 0.25)
    return mesh


@mostly_long("family", vx.meshes.FAMILIES, "voronoi", "nonconvex", "hanging")
@mostly_long("passes", [4, 6])
def test_random_passes_keep_a_tiling_of_good_cells(family, passes):
    mesh = small(family, 3, seed=1)
    random = np.random.default_rng(2)
    for _ in range(passes):
        before, short = mesh, (measure_edges(mesh) / np.repeat(mesh.diameters, np.diff(mesh.offsets))).min()
        mesh = mesh.with_cell_data("parent", np.arange(mesh.n_cells)).refine(random.random(mesh.n_cells) < 0.2)
        parents = mesh.cell_data["parent"]
        PolygonMesh(mesh.points, mesh.cells)
        assert mesh.areas.sum() == pytest.approx(1.0, abs=1e-15 * mesh.n_cells)
        rule = common_rule(before, mesh)
        there = rule.first == parents[rule.second]
        inside = np.bincount(rule.second[there], rule.weights[there], mesh.n_cells)
        np.testing.assert_allclose(inside, mesh.areas, rtol=1e-12)
        np.testing.assert_allclose(np.bincount(parents, weights=mesh.areas), before.areas, rtol=1e-12)
        assert measure_slenderness(mesh) < max(FATTEST[family], 1.0 + measure_slenderness(before))
        # A refinement halves an edge at most once.
        edge = (measure_edges(mesh) / np.repeat(mesh.diameters, np.diff(mesh.offsets))).min()
        assert edge > min(0.49 * short, 0.08)
    assert measure_slenderness(mesh) < FATTEST[family]


@pytest.mark.parametrize("make", [vx.meshes.squares, vx.meshes.triangles, vx.meshes.cubes, tetrahedra])
def test_uniform_refinement_gives_the_mesh_of_half_the_size(make):
    mesh, fine = make(3).refine(), make(6)
    assert mesh.n_cells == fine.n_cells
    one, other = (m.points[np.lexsort(m.points.round(9).T)] for m in (mesh, fine))
    np.testing.assert_allclose(one, other, atol=1e-15)
    np.testing.assert_allclose(mesh.measures, fine.measures[0], rtol=1e-12)
    np.testing.assert_allclose(mesh.diameters, fine.diameters[0], rtol=1e-12)
    for side in fine.boundaries:
        assert len(mesh.boundaries[side]) == len(fine.boundaries[side])


@pytest.mark.long
def test_at_most_one_node_hangs_on_a_side():
    for make in (vx.meshes.squares, vx.meshes.triangles, vx.meshes.distorted):
        mesh = make(3)
        for _ in range(7):
            mesh = mesh.refine([0])  # the cell in the corner
        assert count_hanging_nodes(mesh) == count_hanging_nodes(refine_at_random(make(3), 5)) == 1


def test_grading_refines_no_more_cells_than_necessary():
    mesh = vx.meshes.squares(4).refine([5])
    assert mesh.n_cells == 16 + 3
    child = np.argmin(np.hypot(*(mesh.centroids - [0.3, 0.3]).T))
    assert mesh.refine([child]).n_cells == 19 + 3 * 3  # two neighbours with a hanging node are split, too


SOLIDS = {"tetrahedra": tetrahedra(2), "cubes": vx.meshes.cubes(2), "prisms": vx.meshes.prisms(2)}
EVERY = [*vx.meshes.FAMILIES, *SOLIDS]


def make_start(family):
    """Return a mesh and the cells to refine, or None for all cells. Plane meshes have hanging nodes."""
    if family in SOLIDS:
        mesh = SOLIDS[family]
        return mesh, np.arange(0, mesh.n_cells, 2) if family == "tetrahedra" else None
    mesh = refine_at_random(small(family, 3, seed=4), 2)
    return mesh, np.arange(0, mesh.n_cells, 3)


@mostly_long("family", EVERY, "hanging", "nonconvex", "cubes", "tetrahedra")
def test_refinement_keeps_nodes_names_and_data(family):
    mesh, cells = make_start(family)
    mesh = mesh.with_boundary("half", lambda x: x[:, 0] < 0.5)
    mesh = mesh.with_cell_data("number", np.arange(mesh.n_cells)).with_cell_data("pair", np.ones((mesh.n_cells, 2)))
    fine = mesh.refine(cells)
    np.testing.assert_array_equal(fine.points[: mesh.n_nodes], mesh.points)
    assert set(fine.boundaries) == set(mesh.boundaries)
    for name in mesh.boundaries:
        assert measure_part(fine, name) == pytest.approx(measure_part(mesh, name), rel=1e-13)
    assert (np.diff(fine.cell_data["number"]) >= 0).all()
    assert fine.cell_data["pair"].shape == (fine.n_cells, 2)
    half = fine.boundaries["half"]
    again = type(mesh)(fine.points, fine.cells, boundaries={"half": half})
    np.testing.assert_array_equal(again.boundaries["half"], half)


def test_cells_to_refine_are_given_by_number_or_by_flag():
    for mesh in (vx.meshes.squares(3), SOLIDS["tetrahedra"]):
        flags = np.isin(np.arange(mesh.n_cells), [2, 7])
        np.testing.assert_array_equal(mesh.refine([7, 2, 2]).points, mesh.refine(flags).points)
        assert mesh.refine().n_cells >= mesh.refine(np.ones(mesh.n_cells, dtype=bool)).n_cells
        for nothing in ([], np.zeros(mesh.n_cells, dtype=bool), np.empty(0, dtype=np.int64)):
            assert mesh.refine(nothing) is mesh


@pytest.mark.long
@pytest.mark.parametrize("make", [vx.meshes.squares, tetrahedra])
def test_refinement_ends_where_rounding_begins(make):
    """Refine towards the corner (1, 1) until an error is raised. All meshes are valid."""
    mesh, message = make(1), ""
    for _ in range(200):
        try:
            mesh = mesh.refine([np.argmax(mesh.centroids.sum(axis=1))])
        except vx.MeshError as error:
            message = str(error)
            break
    assert re.match(r"the edge \(\d+, \d+\) at \(1, 1(, 1)?\) is only .* long", message)
    assert mesh.diameters.min() < 2.0**-40
    assert (mesh.measures / mesh.diameters ** mesh.points.shape[1]).min() > 0.02
    if make is vx.meshes.squares:
        PolygonMesh(mesh.points, mesh.cells)
        assert count_hanging_nodes(mesh) == 1
