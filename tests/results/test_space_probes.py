"""Any point of a body in space: whose cell it lies in, and what is known there."""

from __future__ import annotations

import numpy as np
import pytest

import circular_hysteresis as circles
import vemcvx as vx
from vemcvx.results.probe import places

FAMILIES = [*vx.meshes.SPACE_FAMILIES]
STEPS = 6


def block(family):
    """A block whose displacement is linear."""
    mesh, times = circles.mesh(2, family), circles.times(STEPS)
    return vx.simulate(circles.scene(STEPS), mesh, times)


@pytest.fixture(scope="module")
def history():
    return block("cubes")


def points_of(mesh, seed=0):
    """Points inside, at nodes, on edges and on faces."""
    rng = np.random.default_rng(seed)
    inside = mesh.points.min(axis=0) + rng.random((40, 3)) * np.ptp(mesh.points, axis=0)
    first, second = (mesh.face_vertices[mesh.face_offsets[:-1] + k] for k in (0, 1))
    middles = 0.5 * (mesh.points[first] + mesh.points[second])
    return np.concatenate([inside, mesh.points, middles, mesh.face_centroids, mesh.centroids])


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_linear_fields_are_exact_at_every_point(family):
    """On faces, edges and at nodes too, whatever cells meet there."""
    mesh = circles.mesh(2, family)
    x = points_of(mesh)
    at = places(mesh, x, "test")
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    linear = mesh.points @ gradient + [1.0, 2.0, 3.0]
    assert at.at_nodes(linear[None])[0] == pytest.approx(x @ gradient + [1.0, 2.0, 3.0], abs=1e-12)
    assert at.cells.sum(axis=1) == pytest.approx(1.0, abs=1e-12)


def test_nodes_and_edges_have_their_own_values(history):
    mesh = history.mesh
    x = 0.25 * mesh.points[mesh.face_vertices[0]] + 0.75 * mesh.points[mesh.face_vertices[1]]
    u = history.displacement
    assert np.array_equal(history.probe(mesh.points), u)
    between = 0.25 * u[:, mesh.face_vertices[0]] + 0.75 * u[:, mesh.face_vertices[1]]
    assert history.probe(x[None])[:, 0] == pytest.approx(between, abs=1e-15)


def test_lines_and_tables(history):
    arc, values = history.along([0.1, 0.1, 0.0], [0.1, 0.1, 0.5], count=5)
    assert arc == pytest.approx(np.linspace(0.0, 0.5, 5))
    gamma, a = circles.closed_form(history.times)
    # Errors relative to the largest state, whose displacements are of size one tenth.
    near = history.certificate.max()
    assert values[:, :, :2] == pytest.approx(a[:, None] + gamma[:, None] * arc[:, None], abs=near)
    stress = history.along([0.1, 0.1, 0.1], [1.9, 0.9, 0.4], count=7, field="stress").values
    assert stress[..., 5] == pytest.approx(np.tile(circles.MU * gamma[:, :1], 7), abs=1e-9)
    assert stress[..., 4] == pytest.approx(np.tile(circles.MU * gamma[:, 1:], 7), abs=1e-9)
    table = history.table("probes", [[0.3, 0.2, 0.1]])
    assert list(table)[3:] == ["x", "y", "z", "displacement_x", "displacement_y", "displacement_z"]


def test_probes_are_written(history, tmp_path):
    folder = history.write(tmp_path / "run", probes=[[0.3, 0.2, 0.1], [1.0, 1.0, 0.5]])
    header, *rows = (folder / "probes.csv").read_text().splitlines()
    assert header.endswith("x,y,z,displacement_x,displacement_y,displacement_z")
    assert len(rows) == 2 * (STEPS + 1)
