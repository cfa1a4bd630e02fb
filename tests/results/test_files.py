"""Histories in folders: back to the bit, readable by others, honest about what is missing."""

from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree as ET

import meshio
import numpy as np
import pytest
from identical import same
from scenes import cyclic, mostly_long, paper_load, paper_scene, small

import vemcvx as vx
from vemcvx.base.errors import HistoryError
from vemcvx.base.owned_files import Owned
from vemcvx.history import read_history
from vemcvx.results.files import Origin, write_results
from vemcvx.vem import Space, strains

TIMES = np.linspace(0.0, 1.0, 9)


def named_mesh():
    mesh = small("voronoi", 5).with_boundary("heel", lambda x: (x[:, 0] < 0.4) & (x[:, 1] == 0))
    return mesh.with_cell_data("young", 200.0 + mesh.centroids[:, 0]).with_cell_data(
        "zone", np.arange(mesh.n_cells) % 3
    )


@pytest.fixture(scope="module")
def history():
    scene = vx.Scene(
        vx.Elasticity("young", 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.column_stack([0.01 * t * x[:, 1], 0 * t * x[:, 0]]), on="right"),
        vx.Traction(paper_load(cyclic), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=3.0, on="bottom"),
    )
    return vx.simulate(scene, named_mesh(), TIMES, solver=vx.Newton(accuracy=1e-7))


def same_mesh(one, other):
    arrays = all(same(getattr(one, n), getattr(other, n)) for n in ("points", "offsets", "vertices", "cell_data"))
    return arrays and same(dict(one.boundaries), dict(other.boundaries))


def assert_same(one, other):
    assert same_mesh(one.mesh, other.mesh)
    for field in dataclasses.fields(one):
        if field.name not in ("mesh", "scene"):
            assert same(getattr(one, field.name), getattr(other, field.name)), field.name
    assert other.scene is None
    assert same(one.stress(-1), other.stress(-1))
    assert same(one.reaction("bottom"), other.reaction("bottom"))
    assert one.summary() == other.summary()


@pytest.mark.long
@pytest.mark.parametrize("store", ["all", "last", 3])
def test_back_to_the_bit(history, store, tmp_path):
    kept = vx.simulate(history.scene, history.mesh, TIMES, store=store)
    assert kept.write(tmp_path / "deep" / "folder") == tmp_path / "deep" / "folder"
    assert_same(kept, read_history(tmp_path / "deep" / "folder"))


@pytest.mark.long
def test_every_family_comes_back(family, tmp_path):
    history = vx.simulate(paper_scene(), small(family, 3), TIMES[:3])
    history.write(tmp_path)
    assert_same(history, read_history(tmp_path))


@pytest.mark.long
def test_histories_without_contact_or_steps_come_back(tmp_path):
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="right"), vx.Traction(paper_load(cyclic), on="left"))
    for times in (TIMES, [0.0]):
        history = vx.simulate(scene, small("squares", 3), times)
        history.write(tmp_path)
        assert_same(history, read_history(tmp_path))


def test_series_and_steps_read_by_meshio(history, tmp_path):
    history.write(tmp_path)
    listed = list(ET.parse(tmp_path / "history.pvd").iter("DataSet"))
    assert [float(item.get("timestep")) for item in listed] == TIMES.tolist()
    for row, item in enumerate(listed):
        step = meshio.read(tmp_path / item.get("file"))
        assert np.array_equal(step.points[:, :2], history.mesh.points)
        nodal = step.point_data
        assert np.array_equal(nodal["displacement"][:, :2], history.displacement[row])
        assert nodal["displacement"].shape == (history.mesh.n_nodes, 3)
        away = np.setdiff1d(np.arange(history.mesh.n_nodes), history.contact.nodes)
        for name in ("slip", "traction", "pressure", "sticking"):
            wanted = getattr(history.contact, name)[row]
            found = nodal[name] if wanted.ndim == 1 else nodal[name][:, :2]
            assert np.array_equal(found[history.contact.nodes], wanted), name
            assert np.isnan(nodal[name][away]).all() if name == "sticking" else not nodal[name][away].any()


def test_fields_on_cells_are_those_of_the_cells(history, tmp_path):
    history.write(tmp_path)
    step = meshio.read(tmp_path / "step_0008.vtu")
    cells = [cell.tolist() for block in step.cells for cell in block.data]
    order = [cells.index(cell.tolist()) for cell in history.mesh.cells]
    stress, energy = (np.concatenate(step.cell_data[name])[order] for name in ("stress", "strain_energy"))
    assert np.array_equal(stress, history.stress(8))
    e = strains(Space(history.mesh), history.displacement[8])
    lam, mu = history.moduli
    # 1/2 (lam tr(eps)^2 + 2 mu eps : eps), with 2 e_xy in the third column
    density = 0.5 * lam * (e[:, 0] + e[:, 1]) ** 2 + mu * (e[:, 0] ** 2 + e[:, 1] ** 2 + 0.5 * e[:, 2] ** 2)
    assert energy == pytest.approx(density, rel=1e-12, abs=1e-15 * density.max())


@pytest.mark.long
def test_on_triangles_the_density_adds_up_to_the_stored_energy(tmp_path):
    """There Pi u = u, and nothing is left to stabilise."""
    history = vx.simulate(paper_scene(), small("triangles", 5), TIMES)
    history.write(tmp_path)
    step = meshio.read(tmp_path / "step_0008.vtu")
    assert step.cell_data["strain_energy"][0] @ history.mesh.areas == pytest.approx(history.energy[-1], rel=1e-12)


def test_summary_has_the_keys_of_the_contract(history, tmp_path):
    write_results(history, tmp_path, Origin("block", "voronoi", 5))
    told = json.loads((tmp_path / "summary.json").read_text())
    kinds = {
        str: "format version problem solver certificate_kind linear",
        int: "unknowns steps",
        float: "accuracy certified_energy_error peak_memory_mb energy dissipated work "
        "dissipated_second_order work_second_order",
        list: "effects left_out tables",
        dict: "mesh extremes forces peak contact seconds",
        type(None): "estimated_energy_errors quantities bound_upper bound_lower bound_kind bound_force units",
    }
    assert {name: type(value) for name, value in told.items()} == {
        name: kind for kind, names in kinds.items() for name in names.split()
    }
    mesh = history.mesh
    size = {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}
    assert told["mesh"] == {"family": "voronoi", "n": 5, **size}
    assert (told["problem"], told["version"], told["steps"]) == ("block", vx.__version__, 8)
    assert told["unknowns"] == history.trajectory.state.shape[1]
    assert told["effects"] == list(history.effects)
    assert told["accuracy"] == 1e-7
    assert told["certified_energy_error"] == history.certified.max() > history.certificate.max()
    for name in ("energy", "dissipated", "work"):
        assert told[name] == getattr(history, name)[-1]
    seconds = told["seconds"]
    assert list(seconds) == ["assemble", "prepare", "solve", "write", "total"]
    assert seconds["total"] == pytest.approx(sum(seconds[name] for name in list(seconds)[:-1]))
    # The arrays of numpy alone take more than 10 MB.
    assert 10 < told["peak_memory_mb"] < 1e5


def test_a_summary_of_a_miss_is_still_json(history, tmp_path):
    run = dataclasses.replace(history.trajectory, gap=np.full(9, np.inf), solver="SomebodyElses()", accuracy=None)
    dataclasses.replace(history, trajectory=run).write(tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert told["certified_energy_error"] is None
    assert told["accuracy"] is None
    assert told["mesh"]["family"] is None


@pytest.mark.long
def test_a_new_history_replaces_the_old_one_and_nothing_else(history, tmp_path):
    history.write(tmp_path)
    for name in ("step_9999.vtu", "notes.txt", "deformed_mesh.png"):
        (tmp_path / name).write_text("somebody's")
    some = vx.simulate(history.scene, history.mesh, TIMES, store="last")
    some.write(tmp_path)
    ours = {"history.npz", "history.pvd", "summary.json", "steps.csv", "contact.csv", "step_0008.vtu"}
    assert {path.name for path in tmp_path.iterdir()} == ours | {"step_9999.vtu", "notes.txt", "deformed_mesh.png"}
    assert_same(some, read_history(tmp_path))


@pytest.mark.long
def test_a_write_that_fails_leaves_the_old_history(history, tmp_path, monkeypatch):
    history.write(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    some = vx.simulate(history.scene, history.mesh, TIMES[:5])

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(HistoryError, match="cannot write a history there: .*No space left on device"):
        some.write(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_folders_without_a_history_say_what_they_are(history, tmp_path):
    with pytest.raises(HistoryError, match=r"nowhere: there is no such folder; a history is a folder that contains"):
        read_history(tmp_path / "nowhere")
    with pytest.raises(HistoryError, match="found nothing"):
        read_history(tmp_path)
    (tmp_path / "mesh.vtu").write_text("")
    with pytest.raises(HistoryError, match=r"found mesh\.vtu; a history"):
        read_history(str(tmp_path))
    with pytest.raises(HistoryError, match="found a file, not a folder"):
        read_history(tmp_path / "mesh.vtu")
    with pytest.raises(HistoryError, match=r"mesh\.vtu: cannot be used as a folder"):
        history.write(tmp_path / "mesh.vtu")


@pytest.mark.long
def test_damaged_archives_are_refused_or_whole(history, tmp_path):
    history.write(tmp_path)
    archive = tmp_path / "history.npz"
    whole = archive.read_bytes()
    rng = np.random.default_rng(1)
    for length in (0, 3, 100, len(whole) // 2, len(whole) - 30):
        archive.write_bytes(whole[:length])
        with pytest.raises(HistoryError, match=r"history\.npz: cut short or damaged: .*Run the problem again"):
            read_history(tmp_path)
    refused = 0
    for place in rng.integers(0, len(whole), 60):
        flipped = bytearray(whole)
        flipped[place] ^= 0xFF
        archive.write_bytes(flipped)
        try:
            # Dates and the like in the headers of a zip file may change without harm.
            assert_same(history, read_history(tmp_path))
        except HistoryError:
            refused += 1
    assert refused > 30


@pytest.mark.long
def test_foreign_archives_are_refused(history, tmp_path):
    np.savez(tmp_path / "history.npz", u=np.zeros(3), v=np.ones(2))
    with pytest.raises(HistoryError, match="not a history of this version: it holds u, v"):
        read_history(tmp_path)
    with pytest.raises(HistoryError, match=r"history\.npz: it belongs to no history, so it is not replaced"):
        history.write(tmp_path)
    (tmp_path / "history.npz").unlink()
    history.write(tmp_path)
    with np.load(tmp_path / "history.npz") as file:
        arrays = dict(file)
    newer = {**arrays, "about": np.array(str(arrays["about"]).replace("history 7", "history 8"))}
    np.savez(tmp_path / "history.npz", **newer)
    with pytest.raises(HistoryError, match="found the format 'vemcvx history 8', wanted 'vemcvx history 7'"):
        read_history(tmp_path)
    for name in ("displacement", "contact.slip", "trajectory.gap", "mesh.points", "boundary.boundary"):
        np.savez(tmp_path / "history.npz", **{key: value for key, value in arrays.items() if key != name})
        with pytest.raises(HistoryError, match=name.split(".")[-1]):
            read_history(tmp_path)


@mostly_long("name", ["summary.json", "history.pvd", "history.npz", "step_0003.vtu", "contact.csv"], 0, 2)
def test_files_that_are_of_no_history_stay(history, name, tmp_path):
    (tmp_path / name).write_text('{"a": "thesis"}')
    with pytest.raises(HistoryError, match=f"{name}: it belongs to no history, so it is not replaced"):
        history.write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == '{"a": "thesis"}'


def test_what_a_killed_process_left_goes(history, tmp_path):
    # As it is left by a kill in the middle of writing.
    held = Owned(tmp_path / ".vemcvx-writing")
    held.take("step_0000.vtu").write_text("half")
    with pytest.raises(HistoryError, match="another run is writing there"):
        history.write(tmp_path)
    held.close()
    history.write(tmp_path)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    assert_same(history, read_history(tmp_path))
