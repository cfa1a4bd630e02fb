"""The package copies arguments. An array that is changed after a call changes no result."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scenes import small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 3)
MESH = small("squares", 3)
CELLS = np.ones(MESH.n_cells)
SCENE = {
    "material": (vx.Elasticity, {"young": 200 * CELLS, "poisson": 0.3 * CELLS}),
    "support": (vx.PrescribedDisplacement, {"value": np.array([0.1, 0.0]), "on": ["right"]}),
    "load": (vx.Traction, {"force": np.array([8.0, -1.0]), "on": ["left"]}),
    "weight": (vx.BodyForce, {"force": np.array([1.0, -1.0])}),
    "pressure": (vx.Pressure, {"value": np.array(2.0), "on": ["left"]}),
    "heat": (vx.ThermalStrain, {"expansion": 1e-3 * CELLS, "temperature": np.array(3.0)}),
    "contact": (vx.BilateralContact, {"on": ["bottom"]}),
    "friction": (vx.TrescaFriction, {"bound": np.array(2.0), "on": ["bottom"]}),
}


def spoil(value):
    """Change an array or a list in place."""
    if isinstance(value, np.ndarray):
        value *= 0.5
    elif isinstance(value, list):
        value[:] = [each * 0.5 if isinstance(each, float) else "top" for each in value]


def test_effects_copy_their_arguments():
    given = {
        part: {key: value.copy() if hasattr(value, "copy") else value for key, value in arguments.items()}
        for part, (_, arguments) in SCENE.items()
    }
    effects = [kind(**given[part]) for part, (kind, _) in SCENE.items()]
    history = vx.simulate(vx.Scene(*effects), MESH, TIMES, initial="settled")
    program = history.program(2)
    K, g = program.operators.K.copy(), program.g.copy()
    for arguments in given.values():
        for value in arguments.values():
            spoil(value)
    again = history.program(2)
    assert np.array_equal(again.operators.K, K)
    assert np.array_equal(again.g, g)
    again = vx.simulate(vx.Scene(*effects), MESH, TIMES, initial="settled")
    assert np.array_equal(again.displacement, history.displacement)
    stored = [value for effect in effects for value in vars(effect).values() if isinstance(value, np.ndarray)]
    assert len(stored) >= 5
    assert not any(value.flags.writeable for value in stored)


def test_systems_copy_their_arguments():
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
