"""Results in space: files and probes."""

from __future__ import annotations

import numpy as np
import pytest
from solids import SOLIDS, solid

import block_in_space as block
import vemcvx as vx
from vemcvx.meshes.io.vtu import TYPES
from vemcvx.results import places
from vemcvx.vem.tensors import equivalent


def test_pyvista_reads_the_series_and_the_package_reads_the_mesh(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    history = vx.simulate(block.scene(), vx.meshes.voronoi3(2), block.times(4), store=2)
    folder = history.write(tmp_path / "run")
    reader = pyvista.get_reader(folder / "history.pvd")
    assert reader.time_values == history.times.tolist()
    reader.set_active_time_point(2)
    grid = reader.read()[0]
    assert set(grid.point_data) >= {
        "displacement", "slip", "traction", "bound", "pressure", "sticking", "closed", "wear"
    }  # fmt: skip
    assert set(grid.cell_data) == {"stress", "principal_stresses", "von_mises", "strain_energy"}
    contact, elsewhere = history.contact, np.setdiff1d(np.arange(history.mesh.n_nodes), history.contact.nodes)
    assert np.array_equal(grid.point_data["displacement"], history.displacement[-1])
    assert np.array_equal(grid.point_data["traction"][contact.nodes], contact.traction[-1])
    assert np.array_equal(grid.point_data["wear"][contact.nodes], contact.wear[-1])
    assert not grid.point_data["traction"][elsewhere].any()
    assert np.isnan(grid.point_data["sticking"][elsewhere]).all()
    assert np.array_equal(grid.cell_data["stress"], history.stress(-1))
    assert np.array_equal(grid.cell_data["von_mises"], equivalent(history.stress(-1)))
    # The energies of cells exclude the energy of the stabilisation.
    energy = grid.cell_data["strain_energy"] @ history.mesh.volumes
    assert 0.5 * history.energy[-1] < energy < history.energy[-1]
    assert set(grid.celltypes) == {TYPES["polyhedron"]}
    assert grid.compute_cell_sizes()["Volume"] == pytest.approx(history.mesh.volumes, rel=1e-6)
    with pytest.warns(vx.MeshWarning):
        mesh = vx.meshes.read(folder / "step_0004.vtu")
    assert np.array_equal(mesh.points, history.mesh.points)
    assert np.array_equal(mesh.face_vertices, history.mesh.face_vertices)


USUAL = "voronoi3", "hanging faces"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in USUAL else pytest.mark.slow) for name in SOLIDS]
)
def test_probes_are_exact_for_linear_fields_and_at_nodes(name):
    size = np.array([1.0, 1.2, 0.9])
    mesh = solid(name, 2, tuple((0.0, float(length)) for length in size))
    gradient, shift = np.array([[0.3, -1.2, 0.4], [0.7, 0.4, 0.1], [-0.2, 0.5, 0.6]]), np.array([5.0, -2.0, 1.0])
    u = mesh.points @ gradient.T + shift
    inside = np.random.default_rng(1).uniform(size=(100, 3)) * size
    first, second = mesh.face_vertices[mesh.face_offsets[:-1]], mesh.face_vertices[mesh.face_offsets[:-1] + 1]
    edges = 0.3 * mesh.points[first] + 0.7 * mesh.points[second]
    for x in (inside, mesh.centroids, mesh.face_centroids, edges, size * [[1.0, 0.1 + 0.2, 0.5]]):
        at = places(mesh, x, "test")
        assert np.abs(at.at_nodes(u[None])[0] - (x @ gradient.T + shift)).max() < 1e-14 * 20
    at = places(mesh, mesh.centroids, "test")
    assert np.array_equal(at.cells @ np.arange(mesh.n_cells), np.arange(mesh.n_cells))
    rough = np.random.default_rng(2).normal(size=(1, mesh.n_nodes, 3))
    assert np.array_equal(places(mesh, mesh.points, "test").at_nodes(rough), rough)
    # Virtual functions are linear on edges.
    found = places(mesh, edges, "test").at_nodes(rough)
    assert np.abs(found - (0.3 * rough[:, first] + 0.7 * rough[:, second])).max() < 1e-13
