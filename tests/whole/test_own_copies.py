"""What becomes of an array after it was handed in changes nothing."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scenes import mostly_long, small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 3)
MESH = small("squares", 3)
REST = (
    vx.Elasticity(200.0, 0.3),
    vx.Clamp(on="right"),
    vx.Traction((8.0, -1.0), on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(1.0, on="bottom"),
)
CELLS = np.ones(MESH.n_cells)
GIVEN = {
    "Elasticity": (vx.Elasticity, {"young": 200 * CELLS, "poisson": 0.3 * CELLS}),
    "Orthotropic": (
        vx.Orthotropic,
        {"young": [200.0, 100.0], "poisson": 0.2, "shear": 50 * CELLS, "angle": 0.1 * CELLS},
    ),
    "Traction": (vx.Traction, {"force": np.array([8.0, -1.0]), "on": ["left"]}),
    "BodyForce": (vx.BodyForce, {"force": np.array([1.0, -1.0])}),
    "Pressure": (vx.Pressure, {"value": np.array(2.0), "on": ["left"]}),
    "PrescribedDisplacement": (vx.PrescribedDisplacement, {"value": np.array([0.1, 0.0]), "on": ["right"]}),
    "TrescaFriction": (vx.TrescaFriction, {"bound": np.array(2.0), "on": ["bottom"]}),
    "ThermalStrain": (vx.ThermalStrain, {"expansion": 1e-3 * CELLS, "temperature": np.array(3.0)}),
}


def spoil(value):
    if isinstance(value, np.ndarray):
        value *= 0.5
    elif isinstance(value, list):
        value[:] = [each * 0.5 if isinstance(each, float) else "top" for each in value]


@mostly_long("name", GIVEN, "TrescaFriction")
def test_effects_keep_copies(name):
    kind, given = GIVEN[name]
    given = {key: value.copy() if hasattr(value, "copy") else value for key, value in given.items()}
    effect = kind(**given)
    rest = [other for other in REST if not isinstance(other, kind)]
    if name == "Orthotropic":
        rest = [other for other in rest if not isinstance(other, vx.Elasticity)]
    if name == "PrescribedDisplacement":
        rest = [other for other in rest if not isinstance(other, vx.Clamp)]
    history = vx.simulate(vx.Scene(effect, *rest), MESH, TIMES, initial="settled")
    program = history.program(2)
    K, g = program.operators.K.copy(), program.g.copy()
    for value in given.values():
        spoil(value)
    again = history.program(2)
    assert np.array_equal(again.operators.K, K)
    assert np.array_equal(again.g, g)
    again = vx.simulate(vx.Scene(effect, *rest), MESH, TIMES, initial="settled")
    assert np.array_equal(again.displacement, history.displacement)
    kept = [value for value in vars(effect).values() if isinstance(value, np.ndarray)]
    assert not any(value.flags.writeable for value in kept)


def test_systems_keep_copies():
    A = np.random.default_rng(0).random((4, 4))
    arrays = {
        "K": sp.csr_matrix(A @ A.T + np.eye(4)), "B": np.eye(4)[:2], "w": np.ones(2),
        "D": np.eye(4)[2:], "e": np.ones(2), "compliance": np.full(2, 0.5), "near_kernel": np.ones((4, 1)),
        "order": np.arange(4),
    }  # fmt: skip
    norms = vx.Norms(arrays["B"], arrays["w"])
    limits = vx.Limits(arrays["D"], arrays["e"], compliance=arrays["compliance"])
    system = vx.System(
        arrays["K"], lambda t: t * np.arange(4.0), norms=norms, limits=limits,
        near_kernel=arrays["near_kernel"], order=arrays["order"],
    )  # fmt: skip
    state = vx.march(system, TIMES).state.copy()
    for value in arrays.values():
        (value.data if sp.issparse(value) else value)[...] = 7
    assert np.array_equal(vx.march(system, TIMES).state, state)


def test_meshes_keep_copies():
    points, cells = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), np.array([[0, 1, 2, 3]])
    sides, data = np.array([[3, 0]]), np.ones(1)
    mesh = vx.PolygonMesh(points, cells, boundaries={"left": sides}, cell_data={"a": data})
    for value in (points, cells, sides, data):
        value[...] = 0
    assert mesh.areas.tolist() == [1.0]
    assert mesh.boundaries["left"].tolist() == [[3, 0]]
    assert mesh.cell_data["a"].tolist() == [1.0]


def test_instants_and_beginnings_are_copies():
    times, initial = TIMES.copy(), np.zeros((MESH.n_nodes, 2))
    scene = vx.Scene(*(effect for effect in REST if not isinstance(effect, vx.Traction)))
    history = vx.simulate(scene, MESH, times, initial=initial)
    times[...], initial[...] = 7.0, 7.0
    assert np.array_equal(history.times, TIMES)
    assert not history.displacement.any()
