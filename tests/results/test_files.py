"""Histories are read back from files without loss. Damaged files are refused."""

from __future__ import annotations

import copy
import dataclasses
import json
import pickle

import meshio
import numpy as np
import pytest
from identical import same
from scenes import cyclic, mostly_long, paper_load, small

import vemcvx as vx
from vemcvx.base.errors import HistoryError
from vemcvx.history import read_history
from vemcvx.results.files import Origin, write_results
from vemcvx.vem import Space, strains

TIMES = np.linspace(0.0, 1.0, 9)
SWELLS = vx.ThermalStrain(1e-4, lambda x, t: 30.0 * t * x[:, 1])


@pytest.fixture(scope="module")
def history():
    mesh = small("voronoi", 5).with_boundary("heel", lambda x: (x[:, 0] < 0.4) & (x[:, 1] == 0))
    mesh = mesh.with_cell_data("young", 200.0 + mesh.centroids[:, 0])
    scene = vx.Scene(
        vx.Elasticity("young", 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.column_stack([0.01 * t * x[:, 1], 0 * t * x[:, 0]]), on="right"),
        vx.Traction(paper_load(cyclic), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=3.0, on="bottom"),
    )
    mesh = mesh.with_cell_data("zone", np.arange(mesh.n_cells) % 3)
    return vx.simulate(scene, mesh, TIMES, solver=vx.Newton(accuracy=1e-7))


def assert_same(one, other):
    assert all(same(getattr(one.mesh, n), getattr(other.mesh, n)) for n in (*one.mesh.ARRAYS, "cell_data"))
    assert same(dict(one.mesh.boundaries), dict(other.mesh.boundaries))
    for field in dataclasses.fields(one):
        if field.name not in ("mesh", "scene"):
            assert same(getattr(one, field.name), getattr(other, field.name)), field.name
    assert other.scene is None
    assert same(one.stress(-1), other.stress(-1))
    assert same(one.reaction("bottom"), other.reaction("bottom"))
    assert one.summary() == other.summary()


@pytest.mark.long
@pytest.mark.parametrize("store", ["all", "last", 3])
def test_a_history_is_read_back_to_the_bit(history, store, tmp_path):
    kept = vx.simulate(vx.Scene(*history.scene, SWELLS), history.mesh, TIMES, store=store)
    assert kept.write(tmp_path / "deep" / "folder") == tmp_path / "deep" / "folder"
    assert_same(kept, read_history(tmp_path / "deep" / "folder"))


@pytest.mark.long
def test_histories_without_contact_or_steps_and_in_space_are_read_back(tmp_path):
    plane, solid = small("squares", 3), vx.meshes.prisms(2)
    solid = solid.with_cell_data("zone", np.arange(solid.n_cells))
    heated = vx.Elasticity(200.0, 0.3), vx.Clamp(on="top"), vx.ThermalStrain(1e-4, lambda x, t: t * x[:, -1])
    contact = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.01, on="bottom")
    for times, mesh, more in ((TIMES, plane, ()), ([0.0], plane, ()), (TIMES, solid, contact)):
        history = vx.simulate(vx.Scene(*heated, *more), mesh, times)
        history.write(tmp_path)
        assert_same(history, read_history(tmp_path))


def test_a_history_with_constant_data_is_pickled_and_copied_with_its_scene():
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.Clamp(on="left"), vx.Traction((0.0, 1.0), on="right"))
    history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial="settled")
    again = pickle.loads(pickle.dumps(history))
    assert np.array_equal(again.displacement, history.displacement)
    assert [effect.describe() for effect in again.scene] == [effect.describe() for effect in history.scene]
    assert copy.copy(history).scene is history.scene
    assert not np.shares_memory(copy.deepcopy(history).displacement, history.displacement)


def test_cell_fields_are_in_the_order_of_the_cells(history, tmp_path):
    history.write(tmp_path)
    step = meshio.read(tmp_path / "step_0008.vtu")
    cells = [cell.tolist() for block in step.cells for cell in block.data]
    order = [cells.index(cell.tolist()) for cell in history.mesh.cells]
    stress, energy = (np.concatenate(step.cell_data[name])[order] for name in ("stress", "strain_energy"))
    assert np.array_equal(stress, history.stress(8))
    e = strains(Space(history.mesh), history.displacement[8])
    lam, mu = history.moduli
    # The columns of e are e_xx, e_yy and 2 e_xy.
    density = 0.5 * lam * (e[:, 0] + e[:, 1]) ** 2 + mu * (e[:, 0] ** 2 + e[:, 1] ** 2 + 0.5 * e[:, 2] ** 2)
    assert energy == pytest.approx(density, rel=1e-12, abs=1e-15 * density.max())


def test_the_summary_has_the_public_keys(history, tmp_path):
    write_results(history, tmp_path, Origin("block", "voronoi", 5))
    told = json.loads((tmp_path / "summary.json").read_text())
    kinds = {
        str: "format version problem solver certificate_kind linear",
        int: "unknowns steps",
        float: "accuracy certified_energy_error peak_memory_mb energy dissipated work "
        "dissipated_second_order work_second_order",
        list: "effects left_out",
        dict: "mesh extremes forces peak contact seconds",
        type(None): "estimated_energy_errors bound_upper bound_lower bound_kind bound_force units",
    }
    assert {name: type(value) for name, value in told.items()} == {
        name: kind for kind, names in kinds.items() for name in names.split()
    }
    mesh = history.mesh
    size = {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}
    assert told["mesh"] == {"family": "voronoi", "n": 5, **size}
    assert (told["problem"], told["version"], told["steps"]) == ("block", vx.__version__, 8)
    assert (told["unknowns"], told["accuracy"]) == (history.trajectory.state.shape[1], 1e-7)
    assert told["effects"] == list(history.effects)
    assert told["certified_energy_error"] == history.certified.max() > history.certificate.max()
    for name in ("energy", "dissipated", "work"):
        assert told[name] == getattr(history, name)[-1]
    seconds = told["seconds"]
    assert list(seconds) == ["assemble", "prepare", "solve", "write", "total"]
    assert seconds["total"] == pytest.approx(sum(seconds[name] for name in list(seconds)[:-1]))
    assert 10 < told["peak_memory_mb"] < 1e5


def test_the_summary_writes_an_infinite_error_as_null(history, tmp_path):
    run = dataclasses.replace(history.trajectory, gap=np.full(9, np.inf), solver="SomebodyElses()", accuracy=None)
    dataclasses.replace(history, trajectory=run).write(tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert told["certified_energy_error"] is told["accuracy"] is told["mesh"]["family"] is None


def test_folders_without_a_history_are_refused(history, tmp_path):
    (tmp_path / "mesh.vtu").write_text("")
    for folder in ("nowhere", "", "mesh.vtu"):
        with pytest.raises(HistoryError, match=r"found no history\.npz there"):
            read_history(tmp_path / folder)
    with pytest.raises(HistoryError, match=r"mesh\.vtu: cannot be used as a folder"):
        history.write(tmp_path / "mesh.vtu")


@pytest.mark.long
def test_foreign_archives_are_refused(history, tmp_path):
    np.savez(tmp_path / "history.npz", u=np.zeros(3), v=np.ones(2))
    with pytest.raises(HistoryError, match="not a history of this version"):
        read_history(tmp_path)
    (tmp_path / "history.npz").unlink()
    history.write(tmp_path)
    with np.load(tmp_path / "history.npz") as file:
        arrays = dict(file)
    newer = {**arrays, "about": np.array(str(arrays["about"]).replace("history 7", "history 8"))}
    np.savez(tmp_path / "history.npz", **newer)
    with pytest.raises(HistoryError, match="vemcvx history 8"):
        read_history(tmp_path)
    for name in ("displacement", "contact.slip", "trajectory.gap", "mesh.points", "boundary.boundary"):
        np.savez(tmp_path / "history.npz", **{key: value for key, value in arrays.items() if key != name})
        with pytest.raises(HistoryError, match=name.split(".")[-1]):
            read_history(tmp_path)


@mostly_long("name", ["summary.json", "history.pvd", "history.npz", "step_0003.vtu", "contact.csv"], 0, 2)
def test_foreign_files_of_the_same_names_are_not_replaced(history, name, tmp_path):
    (tmp_path / name).write_text('{"a": "thesis"}')
    with pytest.raises(HistoryError, match=f"{name}: .* not replaced"):
        history.write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == '{"a": "thesis"}'
