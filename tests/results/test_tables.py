"""Every number in a history's arrays is also in the tables, CSV files, pandas frames and xarray datasets."""

from __future__ import annotations

import csv
import dataclasses
import sys

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 7)
TABLES = "steps", "contact"


@pytest.fixture(scope="module")
def history():
    return vx.simulate(paper_scene(cyclic), small("voronoi"), TIMES, store=4)


def read(path):
    with path.open(newline="") as file:
        heads, *rows = csv.reader(file)
    return dict(zip(heads, np.array(rows, dtype=float).T, strict=True))


def test_the_table_of_steps_has_a_row_for_each_step(history):
    found = history.table("steps")
    assert found["step"].tolist() == list(range(7))
    assert found["time"].tolist() == TIMES.tolist()
    told = "certificate", "certificate_floor", "certificate_total", "certified", "certified_total"
    for name in ("energy", "dissipated", "work", "iterations", *told):
        assert np.array_equal(found[name], getattr(history.trajectory, name))
        assert np.array_equal(found[name][history.stored], getattr(history, name))


def test_the_table_of_contact_has_a_row_for_each_node_at_each_stored_step(history):
    contact, found = history.contact, history.table("contact")
    m, rows = len(contact.nodes), len(history.stored)
    assert history.stored.tolist() == [0, 4, 6]
    assert found["step"].tolist() == np.repeat(history.stored, m).tolist()
    assert found["node"].tolist() == rows * contact.nodes.tolist()
    for k, axis in enumerate("xy"):
        assert found[axis].tolist() == rows * contact.points[:, k].tolist()
        assert np.array_equal(found[f"slip_{axis}"], contact.slip[:, :, k].ravel())
    for name in ("pressure", "bound", "sticking", "closed", "wear"):
        assert np.array_equal(found[name], getattr(contact, name).ravel())
    # The table has a column for every field of contact.
    columns = {name.removesuffix("_x").removesuffix("_y") for name in found}
    assert len(columns - {"step", "time", "piece", "s", "x", "y"}) == len(dataclasses.fields(contact)) - 1


@pytest.mark.filterwarnings("ignore:supports")
def test_arc_lengths_run_with_the_body_on_their_left_and_begin_at_0_on_each_piece():
    """Walls press both sides. The arc length grows downwards on the left side, and upwards on the right side."""
    walls = [vx.UnilateralContact(on=name, gap=lambda x, t: -0.01 * t * (1 + x[:, 1])) for name in ("left", "right")]
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.Symmetry(on="bottom"), *walls)
    history = vx.simulate(scene, small("squares"), TIMES)
    found = {name: values[-len(history.contact.nodes) :] for name, values in history.table("contact").items()}
    for piece, (name, downward) in enumerate((("left", True), ("right", False))):
        order = np.flatnonzero(found["piece"] == found["piece"][found["x"] == piece][0])
        order = order[np.argsort(found["s"][order])]
        assert (found["x"][order] == piece).all()
        np.testing.assert_allclose(found["s"][order], np.linspace(0, 1, len(order)), atol=1e-12)
        assert np.array_equal(found["y"][order], np.sort(found["y"][order])[:: -1 if downward else 1])
        total = np.trapezoid(found["pressure"][order], found["s"][order])
        assert total == pytest.approx(abs(history.force(name)[-1, 0]), rel=1e-9)


@pytest.mark.filterwarnings("ignore:supports")
def test_the_arc_length_of_a_closed_curve_is_one_piece():
    angle = 2 * np.pi * np.arange(24) / 24
    disc = vx.PolygonMesh(np.column_stack([np.cos(angle), np.sin(angle)]), [np.arange(24)])
    squeezed = vx.UnilateralContact(on="boundary", gap=lambda x, t: -0.01 * t)
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), squeezed, vx.TrescaFriction(1.0, on="boundary"))
    found = vx.simulate(scene, disc, [0.0, 1.0]).table("contact")
    np.testing.assert_allclose(found["s"][:24], np.arange(24) * 2 * np.sin(np.pi / 24), atol=1e-12)
    assert found["node"][:24].tolist() == list(range(24))
    assert not found["piece"].any()


def test_csv_files_have_every_digit(history, tmp_path):
    history.write(tmp_path)
    for name in TABLES:
        told, expected = read(tmp_path / f"{name}.csv"), history.table(name)
        assert list(told) == list(expected)
        for column, values in expected.items():
            assert np.array_equal(told[column], values, equal_nan=True), column


@pytest.mark.long
def test_frames_of_pandas_equal_the_tables(history):
    pandas = pytest.importorskip("pandas")
    for name in TABLES:
        pandas.testing.assert_frame_equal(history.to_pandas(name), pandas.DataFrame(history.table(name)))


@pytest.mark.long
def test_a_dataset_of_xarray_has_every_array_of_the_archive(history, tmp_path):
    pytest.importorskip("xarray")
    found, contact = history.to_xarray(), history.contact
    history.write(tmp_path)
    with np.load(tmp_path / "history.npz") as file:
        parts = ("mesh.", "boundary.", "partners.", "cell_data.", "about")
        kept = {name: file[name] for name in file.files if not name.startswith(parts)}
    assert set(found.data_vars) == set(kept)
    for name, values in kept.items():
        assert np.array_equal(found[name].values, values, equal_nan=values.dtype.kind == "f")
    slip = found["contact.slip"]
    assert slip.dims == ("step", "contact", "axis")
    assert slip.attrs["units"] == "length"
    assert np.array_equal(slip.sel(step=4, axis="y"), contact.slip[1, :, 1])
    assert found["displacement"].dims == ("step", "node", "axis")
    assert found["time"].values.tolist() == history.times.tolist()
    assert found["trajectory.energy"].sel(instant=1.0) == history.energy[-1]


@pytest.mark.parametrize("name", ["pandas", "xarray"])
def test_a_missing_extra_is_named(history, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(vx.VemcvxError, match=rf"pip install 'vemcvx\[{name}\]'"):
        getattr(history, f"to_{name}")()
