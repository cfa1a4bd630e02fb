"""Extremes are taken over the whole history."""

import json

import numpy as np
import pytest
from scenes import small

import vemcvx as vx


def press_and_pull(x, t):
    """Return a traction that grows up to t = 1.25, and falls to half the peak at t = 2."""
    size = t if t <= 1.25 else 1.25 - 0.625 * (t - 1.25) / 0.75
    return np.tile([0.3 * size] + [0.0] * (x.shape[1] - 2) + [-size], (len(x), 1))


def cycle(mesh):
    scene = vx.Scene(
        vx.Elasticity(young=50.0, poisson=0.3),
        vx.Traction(press_and_pull, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.4, on="bottom"),
        vx.Clamp(on="right"),
    )
    return vx.simulate(scene, mesh, np.linspace(0.0, 2.0, 9))


@pytest.fixture(scope="module", params=["plane", "space"])
def history(request):
    return cycle(small("voronoi", 5) if request.param == "plane" else vx.meshes.cubes(2))


def fields(history):
    """Return the values and the places of each field."""
    stored, contact = history.stored.tolist(), history.contact
    principal = np.array([history.principal_stresses(n) for n in stored])
    over = "length" if history.mesh.points.shape[1] == 2 else "area"
    centroids, nodes = history.mesh.centroids, contact.points
    return {
        "largest displacement": (np.linalg.norm(history.displacement, axis=2), history.mesh.points),
        "largest von Mises stress": (np.array([history.von_mises(n) for n in stored]), centroids),
        "largest principal stress": (principal[:, :, 0], centroids),
        "smallest principal stress": (principal[:, :, -1], centroids),
        "largest slip": (np.linalg.norm(contact.slip, axis=2), nodes),
        f"largest friction per {over}": (np.linalg.norm(contact.traction, axis=2), nodes),
        "largest contact pressure": (contact.pressure, nodes),
        "largest recovered contact pressure": (contact.pressure_recovered, nodes),
    }


def test_extremes_are_taken_over_all_stored_steps(history):
    expected = fields(history)
    assert [one.name for one in history.extremes] == list(expected)
    for one in history.extremes:
        values, places = expected[one.name]
        assert one.value == (values.min() if "smallest" in one.name else values.max())
        row = history.stored.tolist().index(one.step)
        assert one.time == history.times[row]
        assert one.value in values[row, (places == one.place).all(axis=1)]


@pytest.mark.long
def test_files_keep_extremes(history, tmp_path):
    history.write(tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())["extremes"]
    assert list(told) == [one.key for one in history.extremes]
    for one in history.extremes:
        found = {"value": one.value, "place": one.place.tolist(), "t": one.time, "step": one.step, "unit": one.unit}
        assert told[one.key] == found | {"unbounded": one.unbounded or None}
    for one, again in zip(history.extremes, vx.read_history(tmp_path).extremes, strict=True):
        assert (one.name, one.value, one.time, one.step) == (again.name, again.value, again.time, again.step)
