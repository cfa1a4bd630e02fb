"""The conformance suite of vemcvx.testing for every effect, on a cube."""

from dataclasses import replace

import pytest
import test_conformance_effects as flat

import vemcvx as vx
from cohesive_interface import Glue
from vemcvx.testing import EffectSample, effect_suite


def turning(x, t):
    return flat.creep(x, t)[:, None] * (1.0, 2.0, 0.0)


RUBBING = vx.TrescaFriction(bound=2.0, on="bottom")
RUBBED = flat.STEEL, flat.HELD, flat.PULLED, flat.TOUCHING, RUBBING
PLY = vx.Orthotropic((200.0, 60.0, 80.0), (0.3, 0.3, 0.2), (40.0, 30.0, 20.0), angle=0.8)
UNLIKE = vx.Elasticity, vx.Orthotropic, vx.TrescaFriction, vx.CoulombFriction, vx.PointLoad, vx.Rigid, vx.PrescribedSlip


def in_space(sample):
    data = {name: {2: 3, 3: 6}.get(count, count) for name, count in sample.data.items()}
    others = {name: (0.0, 0.0, 0.0) if other == (0.0, 0.0) else other for name, other in sample.others.items()}
    beside = tuple(RUBBING if isinstance(effect, vx.TrescaFriction) else effect for effect in sample.beside)
    return replace(sample, beside=beside, data=data, others=others)


SAMPLES = {
    **{
        name: in_space(one)
        for name, one in flat.SAMPLES.items()
        if "," not in name and not isinstance(one.effect, UNLIKE)
    },
    "Elasticity": EffectSample(
        flat.STEEL,
        RUBBED[1:],
        (vx.Elasticity(100.0, 0.3),),
        {"young": 1, "poisson": 1},
        {"young": 150.0, "poisson": 0.2, "stabilisation": "unit", "on": flat.SPLIT},
    ),
    "Orthotropic": EffectSample(
        PLY,
        RUBBED[1:],
        (flat.STEEL,),
        others={
            "young": (200.0, 80.0, 80.0),
            "poisson": (0.2, 0.3, 0.2),
            "shear": (flat.stiff, 30.0, 20.0),
            "angle": 0.3,
            "stabilisation": "unit",
            "on": vx.Scene(replace(PLY, on="west"), vx.Elasticity(80.0, 0.2, on="east")),
        },
    ),
    "Rigid": EffectSample(
        vx.Rigid(on="left", force=flat.pull, moment=flat.weigh),
        (flat.STEEL, vx.ElasticFoundation(normal=20.0, tangential=10.0, on="right")),
        data={"force": 3, "moment": 3},
        others={
            "on": "west",
            "at": (0.0, 1.0, 0.5),
            "force": flat.weigh,
            "moment": flat.pull,
            "motion": (0.0, flat.lift, None, None, 0.0, None),
        },
    ),
    "PrescribedSlip": EffectSample(
        vx.PrescribedSlip(turning, on="bottom"),
        (flat.STEEL, flat.SPRUNG, flat.PULLED),
        data={"value": 3},
        others={"value": (0.0, 0.0, 0.0), "on": "left"},
    ),
    "PointLoad": EffectSample(
        vx.PointLoad(flat.pull, at=(0.0, 1.0, 1.0)),
        (flat.STEEL, flat.HELD, flat.TOUCHING, RUBBING),
        data={"force": 3},
        others={"force": flat.weigh, "at": [(0.0, 1.0, 1.0), (0.0, 0.0, 1.0)]},
    ),
    "TrescaFriction": EffectSample(
        flat.RUBBED,
        (flat.STEEL, flat.HELD, flat.SHAKEN, flat.TOUCHING),
        data={"bound": 1, "ground": 3},
        others={
            "bound": 2.0,
            "on": "left",
            "quadrature": "integral",
            "while_closed": flat.UNPRESSED,
            "ground": flat.belt,
        },
    ),
    "CoulombFriction on a belt": EffectSample(
        vx.CoulombFriction(flat.grip, on="bottom", ground=flat.belt),
        (flat.STEEL, flat.HELD, flat.PRESSED, vx.UnilateralContact(on=["bottom", "left"])),
        data={"coefficient": 1, "cap": 1, "ground": 3},
        others={"coefficient": 0.1, "on": "left", "cap": 0.1, "ground": flat.slide},
    ),
    "SlipWeakening": flat.OF_PROBLEMS["SlipWeakening"],
    "Glue": replace(
        flat.OF_PROBLEMS["Glue"], effect=Glue(1.0, 0.2, on="bottom"), others={"strength": 0.5, "way": 0.3, "on": "left"}
    ),
}


test_every_effect_in_space = pytest.mark.long(
    effect_suite({name: replace(sample, in_space=True) for name, sample in SAMPLES.items()})
)


def test_no_effect_is_missing_from_the_samples_in_space():
    plane, space = ({type(sample.effect) for sample in samples.values()} for samples in (flat.SAMPLES, SAMPLES))
    assert plane <= space
