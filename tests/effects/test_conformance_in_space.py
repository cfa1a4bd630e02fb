"""What every effect must satisfy, in space: the sentences of vemcvx.testing on a cube, laws of slip among them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vemcvx as vx
from cohesive_interface import Glue
from slip_weakening import SlipWeakening
from vemcvx.testing import EffectSample, Other, effect_suite


def pull(x, t):
    return 8 * t * np.column_stack([1.25 - x[:, 1], 0.2 + 0 * x[:, 0], -0.1 * x[:, 2]])


def weigh(x, t):
    return t * np.column_stack([3 + x[:, 1], -1 - x[:, 0], x[:, 2] - 2])


def lift(x, t):
    # Zero where the clamp begins, so that it may stand beside it.
    return 1e-3 * t * (1 - x[:, 0]) * (1 + x[:, 1])


def slide(x, t):
    return lift(x, t)[:, None] * [1.0, 0.5, -0.3]


def belt(x, t):
    return 0.1 * t * np.column_stack([2 + x[:, 0], x[:, 1], 0 * x[:, 2]])


def uneven(x, t):
    return 3 + x[:, 0] + 0 * t


def less(x, t):
    return 0.5 * uneven(x, t)


def stiff(x):
    return 200 + 50 * x[:, 0]


def springy(x, t):
    return 400 + 100 * x[:, 0] + 0 * t


def apart(x, t):
    return 1e-3 * x[:, 0] * (1 + t)


def grip(x, t):
    return 0.3 + 0.1 * x[:, 0] + 0 * t


def slight(x, t):
    return 0.3 * grip(x, t)


def around(x):
    return np.column_stack([1 + x[:, 0], 0.5 - x[:, 1], 1 + 0 * x[:, 2]])


def press(x, t):
    return t * (3 + x[:, 1])


def stress(x, t):
    return t * np.column_stack([3 + x[:, 0], 1 - x[:, 1], x[:, 2], 0.5 + 0 * x[:, 0], x[:, 1], x[:, 0]])


STEEL = vx.Elasticity(200.0, 0.3)
HELD, TOUCHING = vx.Clamp(on="right"), vx.BilateralContact(on="bottom")
PULLED = vx.Traction(pull, on="left")
SHAKEN = vx.Traction(lambda x, t: np.tile([30 * t * (0.6 - t), 9 * t, 0.0], (len(x), 1)), on="left")
PRESSED = vx.Traction(lambda x, t: t * np.column_stack([4 + x[:, 0], 2 + 0 * x[:, 0], -6 - x[:, 0]]), on="top")
RUBBING = vx.TrescaFriction(bound=2.0, on="bottom")
RUBBED = STEEL, HELD, PULLED, TOUCHING, RUBBING
REST = Other("west", beside=(vx.Elasticity(young=80.0, poisson=0.2, on="east"),))
UNPRESSED = Other(True, beside=(vx.UnilateralContact(on="left"),))

SAMPLES = {
    "Elasticity": EffectSample(
        STEEL,
        RUBBED[1:],
        (vx.Elasticity(100.0, 0.3),),
        {"young": 1, "poisson": 1},
        {"young": 150.0, "poisson": 0.2, "stabilisation": "unit", "on": REST},
    ),
    "Orthotropic": EffectSample(
        vx.Orthotropic(
            (200.0, 60.0, 80.0), (0.3, 0.3, 0.2), (40.0, 30.0, 20.0), axes=((1.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        ),
        RUBBED[1:],
        (STEEL,),
        others={
            "young": (200.0, 80.0, 80.0),
            "poisson": (0.2, 0.3, 0.2),
            "shear": (stiff, 30.0, 20.0),
            "angle": Other(0.3, {"axes": None}),
            "axes": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
            "stabilisation": "unit",
            "on": REST,
        },
    ),
    "Clamp": EffectSample(vx.Clamp(on=["top", "right"]), RUBBED, others={"on": ["right", "bottom"]}),
    "PrescribedDisplacement": EffectSample(
        vx.PrescribedDisplacement(slide, on="left"),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 3},
        others={"value": (0.0, 0.0, 0.0), "on": "bottom", "direction": Other("normal", {"value": lift})},
    ),
    "PrescribedDisplacement, oblique": EffectSample(
        vx.PrescribedDisplacement(lift, on="left", direction=(1.0, 2.0, -1.0)),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 1},
        others={"value": 0.0, "on": "bottom", "direction": (2.0, 1.0, 0.0)},
    ),
    "BodyForce": EffectSample(
        vx.BodyForce(weigh), (STEEL, HELD, TOUCHING, RUBBING), data={"force": 3}, others={"force": pull}
    ),
    "Traction": EffectSample(
        vx.Traction(pull, on=("left", "top")),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"force": 3},
        others={"force": weigh, "on": "left"},
    ),
    "Pressure": EffectSample(
        vx.Pressure(press, on=("left", "top")),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 1},
        others={"value": lambda x, t: -t * (1 + x[:, 0]), "on": "left"},
    ),
    "PointLoad": EffectSample(
        vx.PointLoad(pull, at=(0.0, 1.0, 1.0)),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"force": 3},
        others={"force": weigh, "at": [(0.0, 1.0, 1.0), (0.0, 0.0, 1.0)]},
    ),
    "Symmetry": EffectSample(vx.Symmetry(on=["top"]), RUBBED, others={"on": ["right", "left"]}),
    "ElasticFoundation": EffectSample(
        vx.ElasticFoundation(normal=stiff, tangential=15.0, on="left"),
        RUBBED,
        data={"normal": 1, "tangential": 1},
        others={"normal": 10.0, "tangential": 5.0, "on": "top"},
    ),
    "ThermalStrain": EffectSample(
        vx.ThermalStrain(expansion=1e-3, temperature=press),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"expansion": 1, "temperature": 1},
        others={"expansion": 2e-3, "temperature": lambda x, t: -t * (1 + x[:, 0])},
    ),
    "Prestress": EffectSample(
        vx.Prestress(stress),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"stress": 6},
        others={"stress": lambda x, t: -stress(x, t)},
    ),
    "Viscosity": EffectSample(
        vx.Viscosity(shear=30.0, volume=20.0),
        RUBBED,
        data={"shear": 1, "volume": 1},
        others={"shear": 10.0, "volume": 0.0},
    ),
    "BilateralContact": EffectSample(TOUCHING, (STEEL, HELD, PULLED), others={"on": "left"}),
    "UnilateralContact": EffectSample(
        vx.UnilateralContact(on="bottom", gap=apart),
        (STEEL, HELD, PRESSED, RUBBING),
        data={"gap": 1},
        others={"on": "left", "gap": 0.25},
    ),
    "NormalCompliance": EffectSample(
        vx.NormalCompliance(springy, on="bottom", gap=apart),
        (STEEL, HELD, PRESSED, RUBBING),
        data={"gap": 1},
        others={"stiffness": 7.0, "on": "left", "gap": 0.25},
    ),
    "TrescaFriction on a belt": EffectSample(
        vx.TrescaFriction(uneven, on="bottom", ground=belt),
        (STEEL, HELD, PULLED, TOUCHING),
        (vx.TrescaFriction(uneven, on="bottom"),),
        {"bound": 1, "ground": 3},
        {
            "bound": 0.5,
            "on": "left",
            "quadrature": "integral",
            "while_closed": UNPRESSED,
            "ground": slide,
            "direction": Other((1.0, 0.0, 0.0), {"across": less}),
            "across": Other(less, {"direction": (1.0, 0.0, 0.0)}),
        },
    ),
    "TrescaFriction by direction": EffectSample(
        vx.TrescaFriction(uneven, on="bottom", direction=around, across=less),
        (STEEL, HELD, SHAKEN, TOUCHING),
        (vx.TrescaFriction(uneven, on="bottom"),),
        {"ground": 3},
        {
            "bound": Other(2.0, {"across": 1.0}),
            "on": "left",
            "quadrature": "integral",
            "while_closed": UNPRESSED,
            "ground": belt,
            "direction": (0.2, 1.0, 0.3),
            "across": 0.0,
        },
    ),
    "CoulombFriction by direction, on a belt": EffectSample(
        vx.CoulombFriction(grip, on="bottom", ground=belt, direction=around, across=slight),
        (STEEL, HELD, PRESSED, vx.UnilateralContact(on=["bottom", "left"])),
        (vx.CoulombFriction(grip, on="bottom", ground=belt),),
        {"cap": 1, "ground": 3},
        {
            "coefficient": Other(0.1, {"across": 0.2}),
            "on": "left",
            "cap": 0.1,
            "ground": slide,
            "direction": (0.2, 1.0, 0.3),
            "across": 0.0,
        },
    ),
    "SlipWeakening": EffectSample(
        SlipWeakening(4.0, 1.0, 0.1, on="bottom"),
        (STEEL, HELD, SHAKEN, TOUCHING),
        others={"peak": 3.5, "residual": 3.0, "distance": 0.2, "on": "left"},
    ),
    "Glue": EffectSample(
        Glue(1.0, 0.2, on="bottom"),
        (STEEL, HELD, PULLED, vx.UnilateralContact(on="bottom")),
        others={"strength": 0.5, "way": 0.3, "on": "left"},
    ),
}


def in_space(sample):
    return replace(sample, in_space=True)


test_every_effect_in_space = pytest.mark.long(
    effect_suite({name: in_space(sample) for name, sample in SAMPLES.items()})
)


def test_no_exported_effect_is_missing_from_the_samples_in_space():
    exported = {
        kind for kind in map(vars(vx).get, vx.__all__) if isinstance(kind, type) and issubclass(kind, vx.Effect)
    }
    assert exported - {vx.Effect} == {type(sample.effect) for sample in SAMPLES.values()} - {SlipWeakening, Glue}
