"""Histories in space as files: a series that PyVista opens, tables with three components, everything to the bit."""

from __future__ import annotations

import numpy as np
import pytest

import block_in_space as block
import vemcvx as vx
from vemcvx.meshes.io.vtu import TYPES
from vemcvx.vem import equivalent

FIELDS = {"displacement", "slip", "traction", "bound", "pressure", "sticking", "closed", "wear"}
ON_CELLS = {"stress", "principal_stresses", "von_mises", "strain_energy"}


@pytest.fixture(scope="module")
def history():
    return vx.simulate(block.scene(), vx.meshes.voronoi3(2), block.times(4), store=2)


@pytest.fixture(scope="module")
def folder(history, tmp_path_factory):
    return history.write(tmp_path_factory.mktemp("run") / "history")


def test_pyvista_opens_the_series(folder, history):
    """Every number to the bit, polyhedra of their volumes."""
    pyvista = pytest.importorskip("pyvista")
    reader = pyvista.get_reader(folder / "history.pvd")
    assert reader.time_values == history.times.tolist()
    reader.set_active_time_point(2)
    grid = reader.read()[0]
    assert set(grid.point_data) >= FIELDS
    assert set(grid.cell_data) == ON_CELLS
    contact, elsewhere = history.contact, np.setdiff1d(np.arange(history.mesh.n_nodes), history.contact.nodes)
    assert np.array_equal(grid.point_data["displacement"], history.displacement[-1])
    assert np.array_equal(grid.point_data["traction"][contact.nodes], contact.traction[-1])
    assert np.array_equal(grid.point_data["wear"][contact.nodes], contact.wear[-1])
    assert not grid.point_data["traction"][elsewhere].any()
    assert np.isnan(grid.point_data["sticking"][elsewhere]).all()
    assert np.array_equal(grid.cell_data["stress"], history.stress(-1))
    assert np.array_equal(grid.cell_data["von_mises"], equivalent(history.stress(-1)))
    energy = grid.cell_data["strain_energy"] @ history.mesh.volumes
    # The part of Pi u; what the stabilisation stores is not on cells.
    assert 0.5 * history.energy[-1] < energy < history.energy[-1]
    assert set(grid.celltypes) == {TYPES["polyhedron"]}
    assert grid.compute_cell_sizes()["Volume"] == pytest.approx(history.mesh.volumes, rel=1e-6)


def test_what_a_step_is_written_on_reads_as_the_mesh(folder, history):
    with pytest.warns(vx.MeshWarning):
        mesh = vx.meshes.read(folder / "step_0004.vtu")
    assert np.array_equal(mesh.points, history.mesh.points)
    assert np.array_equal(mesh.face_vertices, history.mesh.face_vertices)
