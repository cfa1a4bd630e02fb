"""The conformance suite of vemcvx.testing for every effect that the package exports."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from scenes import long_cases

import vemcvx as vx
from cohesive_interface import Glue
from slip_weakening import SlipWeakening
from vemcvx.testing import EffectSample, effect_suite

OTHER_FIELDS = {
    *("bound", "softening", "on", "direction", "plane", "stabilisation"),
    *("quadrature", "stiffness", "young", "at", "while_closed", "motion"),
}
"""Fields whose values are not data f(x, t)."""


def vectors(x, first, last):
    """Return vectors with these first and last components at points x."""
    first, last = first + 0 * x[:, 0], last + 0 * x[:, 0]
    return np.column_stack([first, *(0.3 * first for _ in x.T[2:]), last])


def pull(x, t):
    return vectors(x, 8 * (1.25 - x[:, 1]) * t, -0.01 * t)


def lift(x, t):
    # The displacement vanishes at x = 1, so it is compatible with the clamp.
    return 1e-3 * t * (1 - x[:, 0]) * (1 + x[:, 1])


def slide(x, t):
    return vectors(x, lift(x, t), 0.5 * lift(x, t))


def viscous(speed):
    return 0.5 + 0.1 * speed


def more_viscous(speed):
    return 0.6 + 0.1 * speed


def weigh(x, t):
    return vectors(x, t * (3 + x[:, 1]), t * (-1 - x[:, 0]))


def uneven(x, t):
    return 3 + x[:, 0] + 0 * t


def stiff(x):
    return 200 + 50 * x[:, 0]


def apart(x, t):
    return 1e-3 * x[:, 0] * (1 + t)


def springy(x, t):
    return 400 + 100 * x[:, 0] + 0 * t


def grip(x, t):
    return 0.3 + 0.1 * x[:, 0] + 0 * t


def creep(x, t):
    return 0.01 * t * (1 - x[:, 0])


def press(x, t):
    return t * (3 + x[:, 1])


def suck(x, t):
    return -t * (1 + x[:, 0])


def stress(x, t):
    zero = 0 * x[:, 0]
    more = [0.5 + zero, x[:, 1], x[:, 0]] if x.shape[1] == 3 else []
    return t * np.column_stack([3 + x[:, 0], 1 - x[:, 1], x[:, 0] * x[:, 1] + zero, *more])


def belt(x, t):
    return vectors(x, 0.1 * t * (2 + x[:, 0]), 0.0)


def squeeze(x, t):
    return -stress(x, t) - t * np.eye(6)[0, : stress(x, t).shape[1]]


STEEL = vx.Elasticity(young=200.0, poisson=0.3)
HELD = vx.Clamp(on="right")
PULLED = vx.Traction(pull, on="left")
SHAKEN = vx.Traction(lambda x, t: vectors(x, 30 * t * (0.6 - t), 0.0), on="left")
PRESSED = vx.Traction(lambda x, t: vectors(x, t * (4 + x[:, 0]), -t * (6 + x[:, 0])), on="top")
SPRUNG = vx.ElasticFoundation(5.0, 5.0, on="top")
TOUCHING = vx.BilateralContact(on="bottom")
RUBBING = vx.TrescaFriction(bound=4.0, on="bottom")


SPLIT = vx.Scene(replace(STEEL, on="west"), vx.Elasticity(young=80.0, poisson=0.2, on="east"))
PLY = vx.Orthotropic(young=(200.0, 60.0), poisson=0.3, shear=40.0, angle=0.4)
RUBBED = vx.TrescaFriction(uneven, on="bottom")
# `while_closed` needs the pressure of one-sided contact.
UNPRESSED = vx.Scene(replace(RUBBED, while_closed=True), vx.UnilateralContact(on="left"))
ON_FLOOR = STEEL, HELD, TOUCHING, RUBBING
LOADED = STEEL, HELD, PULLED, TOUCHING, RUBBING
SAMPLES = {
    "Elasticity": EffectSample(
        STEEL,
        LOADED[1:],
        (vx.Elasticity(young=100.0, poisson=0.3),),
        {"young": 1, "poisson": 1},
        {"young": 150.0, "poisson": 0.2, "plane": "stress", "stabilisation": "unit", "on": SPLIT},
    ),
    "Orthotropic": EffectSample(
        PLY,
        LOADED[1:],
        (STEEL,),
        {"poisson": 1, "shear": 1, "angle": 1},
        {
            "young": (200.0, 80.0),
            "poisson": 0.2,
            "shear": stiff,
            "angle": 0.1,
            "plane": vx.Scene(vx.Orthotropic((200.0, 60.0, 50.0), (0.3, 0.3, 0.2), 40.0, 0.4, "strain")),
            "on": vx.Scene(replace(PLY, on="west"), vx.Elasticity(80.0, 0.2, "stress", on="east")),
            "stabilisation": "unit",
        },
    ),
    "Clamp": EffectSample(vx.Clamp(on=["top", "right"]), LOADED, others={"on": ["right", "bottom"]}),
    "PrescribedDisplacement": EffectSample(
        vx.PrescribedDisplacement(slide, on="left"),
        ON_FLOOR,
        data={"value": 2},
        others={
            "value": (0.0, 0.0),
            "on": "bottom",
            "direction": vx.Scene(vx.PrescribedDisplacement(lift, "left", "normal")),
        },
    ),
    "BodyForce": EffectSample(vx.BodyForce(weigh), ON_FLOOR, data={"force": 2}, others={"force": pull, "on": "west"}),
    "Traction": EffectSample(
        vx.Traction(pull, on=("left", "top")), ON_FLOOR, data={"force": 2}, others={"force": weigh, "on": "left"}
    ),
    "Pressure": EffectSample(
        vx.Pressure(press, on=("left", "top")), ON_FLOOR, data={"value": 1}, others={"value": suck, "on": "left"}
    ),
    "PointLoad": EffectSample(
        vx.PointLoad(pull, at=(0.0, 1.0)),
        ON_FLOOR,
        data={"force": 2},
        others={"force": weigh, "at": [(0.0, 1.0), (0.0, 0.0)]},
    ),
    "Rigid": EffectSample(
        vx.Rigid(on="left", force=pull, moment=press),
        (STEEL, HELD),
        data={"force": 2, "moment": 1},
        others={"on": "west", "at": (0.0, 1.0), "force": weigh, "moment": suck, "motion": (0.0, lift, None)},
    ),
    "Symmetry": EffectSample(vx.Symmetry(on=["top"]), LOADED, others={"on": ["right", "left"]}),
    "ElasticFoundation": EffectSample(
        vx.ElasticFoundation(normal=stiff, tangential=15.0, on="left"),
        LOADED,
        data={"normal": 1, "tangential": 1},
        others={"normal": 10.0, "tangential": 5.0, "on": "top"},
    ),
    "ThermalStrain": EffectSample(
        vx.ThermalStrain(expansion=1e-3, temperature=press),
        ON_FLOOR,
        data={"expansion": 1, "temperature": 1},
        others={"expansion": 2e-3, "temperature": suck, "on": "west"},
    ),
    "Prestress": EffectSample(
        vx.Prestress(stress), ON_FLOOR, data={"stress": 3}, others={"stress": squeeze, "on": "west"}
    ),
    "BilateralContact": EffectSample(TOUCHING, (STEEL, HELD, PULLED), others={"on": "left"}),
    "PrescribedSlip": EffectSample(
        vx.PrescribedSlip(creep, on="bottom"),
        (STEEL, SPRUNG, PULLED),
        data={"value": 1},
        others={"value": 0.0, "on": "left"},
    ),
    "TrescaFriction": EffectSample(
        RUBBED,
        (STEEL, HELD, SHAKEN, TOUCHING),
        data={"bound": 1, "ground": 2},
        others={"bound": 2.0, "on": "left", "quadrature": "integral", "while_closed": UNPRESSED, "ground": belt},
    ),
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
    "Viscosity": EffectSample(
        vx.Viscosity(shear=30.0, volume=20.0),
        LOADED,
        data={"shear": 1, "volume": 1},
        others={"shear": 10.0, "volume": 0.0},
    ),
    "CoulombFriction": EffectSample(
        vx.CoulombFriction(grip, on="bottom", cap=uneven),
        (STEEL, HELD, PRESSED, PULLED, vx.UnilateralContact(on=["bottom", "left"])),
        data={"coefficient": 1, "cap": 1, "ground": 2},
        others={"coefficient": 0.1, "on": "left", "cap": 0.1, "ground": belt},
    ),
    "SpeedFriction": EffectSample(
        vx.SpeedFriction(viscous, on="bottom"),
        (STEEL, HELD, PULLED, TOUCHING),
        data={"ground": 2},
        others={"bound": more_viscous, "on": "left", "softening": None, "ground": belt},
    ),
    "VelocityContact": EffectSample(
        vx.VelocityContact(on="bottom"),
        (STEEL, HELD, PRESSED, PULLED),
        data={"damping": 1},
        others={"on": "left", "damping": 10.0},
    ),
}
OF_PROBLEMS = {
    "SlipWeakening": EffectSample(
        SlipWeakening(4.0, 1.0, 0.1, on="bottom"),
        (STEEL, HELD, SHAKEN, TOUCHING),
        others={"peak": 3.5, "residual": 3.0, "distance": 0.2, "on": "left"},
    ),
    "Glue": EffectSample(
        Glue(2.0, 0.2, on="bottom"),
        (STEEL, HELD, PULLED, vx.UnilateralContact(on="bottom")),
        others={"strength": 1.0, "way": 0.3, "on": "left"},
    ),
}


ONE_OF_EACH_KIND = "Elasticity", "Traction", "UnilateralContact", "CoulombFriction"
"""The effects that are tested by default."""
SLOW = "each_of_its_settings", "its_place_in_the_scene", "refuses_nan_and_infinity"
"""Ends of the names of slow tests. By default, each slow test runs for one effect."""
test_effects = long_cases(
    effect_suite({name: SAMPLES[name] for name in ONE_OF_EACH_KIND}),
    lambda case: case.endswith(SLOW) and not case.startswith("Traction" if "infinity" in case else "CoulombFriction"),
)
test_other_effects = pytest.mark.long(
    effect_suite({name: sample for name, sample in (SAMPLES | OF_PROBLEMS).items() if name not in ONE_OF_EACH_KIND})
)


@pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)
def test_samples_cover_all_data_of_every_effect(sample):
    assert set(sample.fields) <= set(sample.data) | OTHER_FIELDS


def test_no_exported_effect_is_missing_from_the_samples():
    exported = {
        thing
        for space in (vx, vx.effects)
        for thing in vars(space).values()
        if isinstance(thing, type) and issubclass(thing, vx.Effect) and not inspect.isabstract(thing)
    }
    # test_pretension.py tests Pretension, which needs an interface.
    assert exported - {vx.Pretension} == {type(sample.effect) for sample in SAMPLES.values()}
    assert {kind.__name__ for kind in exported} <= set(vx.__all__)


def test_functions_are_summed_in_the_order_in_which_they_are_written():
    """With an order by memory addresses, two runs of one script would differ in the last bit."""
    makers = [
        lambda: vx.BodyForce(lambda x, t: np.full((len(x), 2), t / 3)),
        lambda: vx.BodyForce(lambda x, t: np.full((len(x), 2), 0.7 * t)),
        lambda: vx.BodyForce(lambda x, t: np.full((len(x), 2), 0.1 * t)),
    ]
    rng = np.random.default_rng(2)
    kept = [[makers[i]() for i in rng.permutation(3)] for _ in range(20)]
    orders = {
        tuple(effect.force.__code__.co_firstlineno for effect in vx.Scene(STEEL, *loads).canonical[:3])
        for loads in kept
    }
    (order,) = orders
    assert list(order) == sorted(order)
