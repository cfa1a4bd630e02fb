"""Extremes over a history: those of a cycle of load, which ends unloaded, and not those of its last step."""

import json

import numpy as np
import pytest
from scenes import small

import vemcvx as vx

TIMES = np.linspace(0.0, 2.0, 9)


def press_and_pull(x, t):
    """Pressed and sheared up to t = 1.25, half of it left at t = 2."""
    size = t if t <= 1.25 else 1.25 - 0.625 * (t - 1.25) / 0.75
    return np.tile([0.3 * size] + [0.0] * (x.shape[1] - 2) + [-size], (len(x), 1))


def cycle(mesh, store="all"):
    scene = vx.Scene(
        vx.Elasticity(young=50.0, poisson=0.3),
        vx.Traction(press_and_pull, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.4, on="bottom"),
        vx.Clamp(on="right"),
    )
    return vx.simulate(scene, mesh, TIMES, store=store)


@pytest.fixture(scope="module")
def plane():
    return cycle(small("voronoi", 5))


@pytest.fixture(scope="module")
def space():
    return cycle(vx.meshes.cubes(2))


@pytest.fixture(params=["plane", "space"])
def history(request):
    return request.getfixturevalue(request.param)


def every(history):
    """All values of each field, (S, n), and their places, read one by one as a user would."""
    stored, contact = history.stored.tolist(), history.contact
    principal = np.array([history.principal_stresses(n) for n in stored])
    over = "length" if history.mesh.points.shape[1] == 2 else "area"
    centroids, nodes = history.mesh.centroids, contact.points
    found = {
        "largest displacement": (np.linalg.norm(history.displacement, axis=2), history.mesh.points),
        "largest von Mises stress": (np.array([history.von_mises(n) for n in stored]), centroids),
        "largest principal stress": (principal[:, :, 0], centroids),
        "smallest principal stress": (principal[:, :, -1], centroids),
        "largest slip": (np.linalg.norm(contact.slip, axis=2), nodes),
        f"largest friction per {over}": (np.linalg.norm(contact.traction, axis=2), nodes),
        f"largest contact pressure per {over}": (contact.pressure, nodes),
        f"largest recovered contact pressure per {over}": (contact.pressure_recovered, nodes),
    }
    return found


@pytest.mark.long
def test_extremes_are_those_of_all_stored_steps(history):
    expected = every(history)
    assert [one.name for one in history.extremes] == list(expected)
    for one in history.extremes:
        values, places = expected[one.name]
        assert one.value == (values.min() if "smallest" in one.name else values.max())
        row = history.stored.tolist().index(one.step)
        assert one.time == history.times[row]
        # The value stands at that place, at that instant.
        assert one.value in values[row, (places == one.place).all(axis=1)]


def test_the_peak_of_a_cycle_is_not_its_end(history):
    found = {one.name: one for one in history.extremes}
    for name in ("largest displacement", "largest von Mises stress", "smallest principal stress"):
        assert found[name].time == 1.25
    assert found["smallest principal stress"].value < 0
    assert found["largest von Mises stress"].value > 1.2 * history.von_mises(-1).max()


@pytest.mark.long
def test_files_keep_them(plane, tmp_path):
    plane.write(tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())["extremes"]
    assert list(told) == [one.key for one in plane.extremes]
    assert {"displacement", "slip", "pressure", "pressure_recovered", "friction", "von_mises"} < set(told)
    for one in plane.extremes:
        found = {"value": one.value, "place": one.place.tolist(), "t": one.time, "step": one.step, "unit": one.unit}
        found["unbounded"] = one.unbounded or None
        assert told[one.key] == found
    assert told["von_mises"]["unit"] == "force/length²"
    for one, again in zip(plane.extremes, vx.read_history(tmp_path).extremes, strict=True):
        assert (one.name, one.value, one.time, one.step) == (again.name, again.value, again.time, again.step)


@pytest.mark.long
def test_a_pulled_strip_has_the_stress_of_its_pull():
    """Closed form: free to contract, it is under the traction alone, sqrt(1 - nu + nu^2) of it across and along."""
    scene = vx.Scene(
        vx.Elasticity(10.0, 0.3),
        vx.Symmetry(on="left"),
        vx.Symmetry(on="bottom"),
        vx.Traction(lambda x, t: np.tile([2.0 * np.sin(np.pi * t), 0.0], (len(x), 1)), on="right"),
    )
    found = {one.name: one for one in vx.simulate(scene, small("voronoi", 4), np.linspace(0, 1, 5)).extremes}
    peak = found["largest principal stress"]
    assert peak.value == pytest.approx(2.0, rel=1e-10)
    assert peak.time == 0.5
    assert found["largest von Mises stress"].value == pytest.approx(2.0 * np.sqrt(1 - 0.3 + 0.09), rel=1e-10)
    assert found["largest displacement"].value == pytest.approx(0.2 * np.hypot(0.91, 0.39), rel=1e-10)
