"""Orders of the midpoint rule and of backward Euler on a slider in the plane."""

from __future__ import annotations

import numpy as np
import pytest

import midpoint_rule as rules
import vemcvx as vx


@pytest.fixture(scope="module")
def found():
    return rules.table((16, 32, 64, 128))


def orders(values):
    return np.log2(values[:-1] / values[1:])


@pytest.mark.long
def test_under_straight_pulls_backward_euler_is_exact_and_the_midpoint_rule_has_order_one(found):
    exact, first = found["straight"]
    assert exact.max() < 1e-14
    np.testing.assert_allclose(orders(first), 1.0, atol=1e-9)
    np.testing.assert_allclose(orders(found["straight, in the middles"][1]), 1.0, atol=1e-9)


def test_the_midpoint_rule_has_order_two_while_slips_turn(found):
    first, second = found["turning"]
    assert 0.9 < orders(first).min() < orders(first).max() < 1.0
    np.testing.assert_allclose(orders(second), 2.0, atol=0.03)


def test_both_rules_have_order_one_if_slip_begins_during_the_run(found):
    first, second = found["from rest"]
    assert orders(first).min() > 0.85
    np.testing.assert_allclose(orders(second), 1.0, atol=0.02)


@pytest.mark.long
def test_the_package_takes_the_steps_of_both_rules():
    """A step of the midpoint rule is a half step of backward Euler, followed by a reflection."""
    times = np.linspace(0, 2, 25)
    slider = vx.System(np.eye(2), rules.from_rest, vx.Norms(np.eye(2), [1.0], block=2))
    run = vx.march(slider, times, initial=rules.BEHIND)
    np.testing.assert_allclose(run.state, rules.backward_euler(rules.from_rest, times, rules.BEHIND), atol=1e-9)
    ends, middles = rules.midpoint(rules.from_rest, times, rules.BEHIND)
    k = int(np.flatnonzero(np.abs(middles[:, 0] - rules.BEHIND[0]) > 1e-12)[0])  # the first step that slips
    half = vx.march(slider, [times[k], 0.5 * (times[k] + times[k + 1])], initial=ends[k])
    np.testing.assert_allclose(half.state[-1], middles[k], atol=1e-9)
