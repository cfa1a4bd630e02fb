"""A run responds to a pulse although data are nearly zero at the start."""

import numpy as np
import pytest
from scenes import small

import vemcvx as vx

STEEL, TOUCHING = vx.Elasticity(200.0, 0.3), vx.BilateralContact(on="bottom")
RUBBING, HELD = vx.TrescaFriction(0.1, on="bottom"), vx.Clamp(on="right")


def pulse(t):
    return 5.0 * np.exp(-(((t - 0.437) / 0.01) ** 2))


def pull(x, t):
    return np.column_stack([np.full(len(x), pulse(t)), np.zeros(len(x))])


def scalar(size):
    return lambda x, t: np.full(len(x), size * pulse(t))


SCENES = {
    "traction": (STEEL, TOUCHING, RUBBING, HELD, vx.Traction(pull, on="left")),
    "support": (
        STEEL, TOUCHING, RUBBING, HELD, vx.PrescribedDisplacement(scalar(0.01), on="left", direction=(1.0, 0.0))
    ),
    "Coulomb": (
        STEEL, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"), HELD,
        vx.Pressure(scalar(1.0), on="top"), vx.Traction(pull, on="left"),
    ),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_a_run_responds_to_a_pulse(name):
    history = vx.simulate(vx.Scene(*SCENES[name]), small("squares", 4), np.linspace(0.0, 1.0, 17))
    assert history.certificate.max() <= 1e-8
    assert not history.displacement[1].any()
    last = np.flatnonzero(history.times < 0.437)[-1]
    assert history.energy[last : last + 2].max() > 0.01 * history.energy.max() > 0.0
