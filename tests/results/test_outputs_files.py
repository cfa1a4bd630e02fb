"""What is written says what the history says, for ParaView, for scripts, and read back."""

from __future__ import annotations

import dataclasses
import json
import zlib

import meshio
import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.meshes.io.vtu import packed_cells, write_cells
from vemcvx.results.files import write_results

TIMES = np.linspace(0.0, 1.0, 6)


@pytest.fixture(scope="module")
def history():
    heat = vx.ThermalStrain(1e-4, lambda x, t: 30.0 * t * x[:, 1])
    return vx.simulate(vx.Scene(*paper_scene(cyclic).effects, heat), small("voronoi", 5), TIMES, store=2)


@pytest.mark.long
def test_steps_hold_stresses_and_contact(history, tmp_path):
    history.write(tmp_path)
    mesh, contact = history.mesh, history.contact
    for row, step in enumerate(history.stored):
        read = meshio.read(tmp_path / f"step_{step:04d}.vtu")
        cells = [cell.tolist() for block in read.cells for cell in block.data]
        order = [cells.index(cell.tolist()) for cell in mesh.cells]
        for name in ("stress", "out_of_plane_stress", "von_mises", "principal_stresses"):
            wanted, found = getattr(history, name)(step), np.concatenate(read.cell_data[name])[order]
            found = found[:, :2] if name == "principal_stresses" else found
            assert np.array_equal(found, wanted), name
        assert read.cell_data["principal_stresses"][0].shape[1] == 3
        away = np.setdiff1d(np.arange(mesh.n_nodes), contact.nodes)
        for name in ("wear", "bound", "closed", "pressure", "sticking"):
            assert np.array_equal(read.point_data[name][contact.nodes], getattr(contact, name)[row]), name
            empty = read.point_data[name][away]
            assert np.isnan(empty).all() if name in ("closed", "sticking") else not empty.any()
    assert contact.wear[-1].any()


def test_pyvista_opens_the_steps_in_time(history, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    told = []
    write_results(history, tmp_path, progress=lambda *now: told.append(now))
    reader = pyvista.get_reader(tmp_path / "history.pvd")
    assert reader.time_values == history.times.tolist()
    for row, step in enumerate(history.stored):
        reader.set_active_time_point(row)
        (grid,) = reader.read()
        assert np.array_equal(grid.point_data["displacement"][:, :2], history.displacement[row])
        assert np.array_equal(grid.cell_data["stress"], history.stress(step))
        assert np.array_equal(grid.points[:, :2], history.mesh.points)
        assert np.array_equal(grid.cell_connectivity, history.mesh.vertices)
    assert told == [(row + 1, len(history.stored)) for row in range(len(history.stored))]


def test_points_and_cells_are_packed_once(history, tmp_path, monkeypatch):
    """Bytes of full fields are written as they are: to compress them takes ten times as long, and saves a fifth."""
    squeezed, compress = [], zlib.compress

    def counting(data, level=-1):
        squeezed.append(len(data) if level else 0)
        return compress(data, level)

    monkeypatch.setattr(zlib, "compress", counting)
    mesh = vx.meshes.squares(32)
    packed = packed_cells(mesh)
    assert sum(squeezed) > mesh.vertices.nbytes
    squeezed.clear()
    random = np.random.default_rng(0)
    stress = random.random((mesh.n_cells, 3))
    write_cells(tmp_path / "step.vtu", packed, {"p": np.zeros(mesh.n_nodes)}, {"stress": stress})
    assert sum(squeezed) < 3 * 4096 + 8 * mesh.n_nodes
    assert np.array_equal(vx.meshes.read(tmp_path / "step.vtu").cell_data["stress"], stress)
    # In base64 the stresses alone take a third more.
    assert (tmp_path / "step.vtu").stat().st_size < stress.nbytes + mesh.vertices.nbytes / 2


def test_the_summary_counts(history, tmp_path):
    history.write(tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())["contact"]
    contact = history.contact
    last = {"stick": contact.stick_count, "slip": contact.slip_count, "open": contact.open_count}
    assert told == {"nodes": len(contact.nodes), **{name: counts[-1] for name, counts in last.items()}}
    assert told["slip"] > 0


def test_read_back_it_says_the_same(history, tmp_path):
    history.write(tmp_path)
    again = vx.read_history(tmp_path)
    for name in ("wear", "closed", "stick_count", "slip_count", "open_count", "lengths", "friction_lengths"):
        assert np.array_equal(getattr(again.contact, name), getattr(history.contact, name)), name
    assert np.array_equal(again.trajectory.stuck, history.trajectory.stuck)
    for name in ("von_mises", "principal_stresses", "out_of_plane_stress"):
        assert np.array_equal(getattr(again, name)(-1), getattr(history, name)(-1)), name
    x = np.random.default_rng(2).uniform(size=(30, 2))
    assert np.array_equal(again.probe(x), history.probe(x))
    for field in ("displacement", "von_mises"):
        one, two = (h.along((0.1, 0.9), (0.9, 0.2), field=field) for h in (history, again))
        assert np.array_equal(one.values, two.values)


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
