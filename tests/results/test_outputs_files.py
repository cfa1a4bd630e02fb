"""What is written says what the history says, for ParaView, for scripts, and read back."""

from __future__ import annotations

import dataclasses
import zlib

import meshio
import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.meshes.io.vtu import pack_cells, write_cells

TIMES = np.linspace(0.0, 1.0, 6)


@pytest.fixture(scope="module")
def history():
    heat = vx.ThermalStrain(1e-4, lambda x, t: 30.0 * t * x[:, 1])
    return vx.simulate(vx.Scene(*paper_scene(cyclic).effects, heat), small("voronoi", 5), TIMES, store=2)


def test_points_and_cells_are_packed_once(history, tmp_path, monkeypatch):
    """Bytes of full fields are written as they are: to compress them takes ten times as long, and saves a fifth."""
    squeezed, compress = [], zlib.compress

    def counting(data, level=-1):
        squeezed.append(len(data) if level else 0)
        return compress(data, level)

    monkeypatch.setattr(zlib, "compress", counting)
    mesh = vx.meshes.squares(32)
    packed = pack_cells(mesh)
    assert sum(squeezed) > mesh.vertices.nbytes
    squeezed.clear()
    random = np.random.default_rng(0)
    stress = random.random((mesh.n_cells, 3))
    write_cells(tmp_path / "step.vtu", packed, {"p": np.zeros(mesh.n_nodes)}, {"stress": stress})
    assert sum(squeezed) < 3 * 4096 + 8 * mesh.n_nodes
    assert np.array_equal(vx.meshes.read(tmp_path / "step.vtu").cell_data["stress"], stress)
    # In base64 the stresses alone take a third more.
    assert (tmp_path / "step.vtu").stat().st_size < stress.nbytes + mesh.vertices.nbytes / 2


def test_what_no_material_says_is_left_out(history, tmp_path):
    dataclasses.replace(history, out_of_plane=None, out_of_plane_prestress=None).write(tmp_path)
    names = set(meshio.read(tmp_path / "step_0005.vtu").cell_data)
    assert "principal_stresses" in names
    assert not {"von_mises", "out_of_plane_stress"} & names
    assert vx.read_history(tmp_path).out_of_plane is None


def test_streamed_histories_hold_the_same(history, tmp_path):
    streamed = vx.simulate(history.scene, history.mesh, TIMES, store=2, stream=tmp_path)
    assert np.array_equal(streamed.contact.wear, history.contact.wear)
    assert np.array_equal(streamed.von_mises(-1), history.von_mises(-1))
