"""Frictional steps in space on Iterative: matrix-free, inexact, certified, and as good as on direct factors."""

from __future__ import annotations

import numpy as np
import pytest
from blocks_in_space import assert_within_both_certificates, block, on_floor

import vemcvx as vx
from vemcvx.stepping import march, prepare

pytest.importorskip("pyamg")

TIMES = np.linspace(0.0, 1.0, 7)


def turning(t):
    angle, pull = 2 * np.pi * t, 0.5 * min(1.0, 4 * t)
    return np.array([pull * np.cos(angle), pull * np.sin(angle), -0.2 * pull])


def systems():
    body = block(6)
    return {
        "bilateral": on_floor(body, turning, bound=0.2),
        "one-sided": on_floor(body, lambda t: turning(t) - [0, 0, min(1.0, 4 * t)], contact="unilateral", bound=0.1),
    }


@pytest.mark.long
@pytest.mark.parametrize("name", ["bilateral", "one-sided"])
def test_steps_on_iterative_are_those_of_direct_factors(name):
    """Within both certificates, sticking the same terms; most of them stick and slip at some instant."""
    system = systems()[name]
    direct, iterative = (march(system, TIMES, linear=linear) for linear in (vx.SuperLU(), vx.Iterative()))
    assert_within_both_certificates(system, direct, iterative)
    assert 0.2 < direct.sticking[1:].mean() < 0.8


@pytest.mark.long
def test_flexibilities_are_estimated_by_a_few():
    """Of iterative factors: from above where looked at, hence nowhere far below."""
    system = systems()["bilateral"]
    exact, estimate = (
        prepare(system, vx.Newton(), True, True, linear).operators.norm_flexibility
        for linear in (vx.SuperLU(), vx.Iterative())
    )
    assert (estimate > 0.5 * exact).all()
    assert (estimate < 4.0 * exact).all()
