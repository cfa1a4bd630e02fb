"""The conformance suite of effects for the dashpots of lesson 8."""

import contextlib
import importlib
from pathlib import Path

import pytest
from test_conformance_effects import HELD, PULLED, RUBBING, STEEL, TOUCHING, stiff

from vemcvx.testing import EffectSample
from vemcvx.testing.effects import PROPERTIES

LESSONS = Path(__file__).parents[2] / "problems" / "lessons"


@pytest.fixture(scope="module")
def dashpots():
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(None):
        patch.syspath_prepend(LESSONS)
        # The lesson is imported as a module, because pickle finds effects by the name of their module.
        Dashpots = importlib.import_module("lesson_8_your_own_effect").Dashpots
    return EffectSample(
        Dashpots(damping=stiff, on="left"),
        (STEEL, HELD, PULLED, TOUCHING, RUBBING),
        data={"damping": 1},
        others={"damping": 20.0, "on": "top"},
    )


@pytest.mark.long
@pytest.mark.parametrize("check", PROPERTIES, ids=lambda f: f.__name__)
def test_the_dashpots_pass_the_suite(check, dashpots):
    check(dashpots)
