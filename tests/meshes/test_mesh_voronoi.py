"""Voronoi meshes: numbers of cells, short edges, relaxation, thin boxes."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx import meshes
from vemcvx.meshes import PolygonMesh


def edge_lengths(mesh):
    ends = np.concatenate([np.roll(cell, -1) for cell in mesh.cells])
    return np.hypot(*(mesh.points[ends] - mesh.points[mesh.vertices]).T)


@pytest.mark.parametrize("cells", [1, 2, 3, 5, 50, 333])
def test_voronoi_makes_the_number_of_cells_asked_for(cells):
    mesh = meshes.voronoi(cells=cells, box=((0.0, 5.0), (0.0, 1.0)), seed=4)
    PolygonMesh(mesh.points, mesh.cells)
    assert mesh.n_cells == cells
    assert mesh.areas.sum() == pytest.approx(5.0, rel=1e-13)


def test_voronoi_needs_a_count():
    with pytest.raises(vx.MeshError, match="n must be given"):
        meshes.voronoi()


@pytest.mark.long
@pytest.mark.parametrize("relaxations", [0, 50])
@pytest.mark.parametrize("seed", range(4))
def test_voronoi_has_no_short_edges(seed, relaxations):
    mesh = meshes.voronoi(cells=400, seed=seed, relaxations=relaxations)
    PolygonMesh(mesh.points, mesh.cells)
    # 0.02 is asked for; an edge of a triangle stays, and one between a side and its neighbour.
    assert np.quantile(edge_lengths(mesh) * 20, 0.01) > 0.02
    assert edge_lengths(mesh).min() * 20 > 1e-3


def test_voronoi_keeps_short_edges_on_demand():
    mesh = meshes.voronoi(cells=400, relaxations=0, shortest=0.0)
    PolygonMesh(mesh.points, mesh.cells)
    assert edge_lengths(mesh).min() * 20 < 0.02


@pytest.mark.long
def test_relaxed_voronoi_cells_are_round():
    spread = [meshes.voronoi(cells=200, relaxations=k).areas.std() * 200 for k in (0, 50)]
    assert spread[0] > 0.4  # 0.53 for random seeds in the plane
    assert spread[1] < 0.15


@pytest.mark.long
def test_voronoi_in_a_thin_strip():
    mesh = meshes.voronoi(cells=60, box=((0.0, 1e4), (0.0, 1.0)))
    PolygonMesh(mesh.points, mesh.cells)
    assert mesh.areas.sum() == pytest.approx(1e4, rel=1e-12)


@pytest.mark.parametrize("cells", [1, 2, 3, 4])
@pytest.mark.parametrize("width", [1e-3, 1e3])
@pytest.mark.parametrize("relaxations", [0, 50])
def test_few_cells_in_a_needle(cells, width, relaxations):
    """Short edges from side to side of the box must stay, and so must its corners."""
    mesh = meshes.voronoi(cells=cells, box=((0.0, width), (0.0, 1.0)), relaxations=relaxations, shortest=0.1)
    PolygonMesh(mesh.points, mesh.cells)
    assert mesh.areas.sum() == pytest.approx(width, rel=1e-13)
