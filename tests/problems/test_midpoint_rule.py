"""The midpoint rule beside backward Euler: what the lesson says of both, and the package's steps among its own."""

from __future__ import annotations

import numpy as np
import pytest

import midpoint_rule as lesson
import vemcvx as vx


@pytest.fixture(scope="module")
def found():
    return lesson.table((16, 32, 64, 128))


def orders(values):
    return np.log2(values[:-1] / values[1:])


@pytest.mark.long
def test_straight_pulls(found):
    """Backward Euler is exact; the midpoint rule of order one, in the middles, too: it carries its start along."""
    exact, first = found["straight"]
    assert exact.max() < 1e-14
    np.testing.assert_allclose(orders(first), 1.0, atol=1e-9)
    np.testing.assert_allclose(orders(found["its middles"][1]), 1.0, atol=1e-9)


def test_slips_that_turn(found):
    """Of order one and two: the rule is what it is called, where slips are smooth."""
    first, second = found["turning"]
    assert 0.9 < orders(first).min() < orders(first).max() < 1.0
    np.testing.assert_allclose(orders(second), 2.0, atol=0.03)


def test_once_something_began_to_slip(found):
    """Order one, as backward Euler."""
    first, second = found["from rest"]
    assert orders(first).min() > 0.85
    np.testing.assert_allclose(orders(second), 1.0, atol=0.02)


def test_it_never_dies_out():
    """A steady pull: z is a third of a step's pull beyond its bound and below it, in turn, to the last of 300 steps."""
    times = np.linspace(0, 100, 301)
    sole, middles = lesson.midpoint(lambda t: np.array([t, 0.0]), times, (-1 / 9, 0.0))
    beyond = times - sole[:, 0] - 1.0
    np.testing.assert_allclose(np.abs(beyond[10:]), 1 / 9, atol=1e-12)
    assert (beyond[10:-1] * beyond[11:] < 0).all()
    z = 0.5 * (times[1:] + times[:-1]) - middles[:, 0]
    np.testing.assert_allclose(z[10:], 1.0, atol=1e-12)


def test_both_maps_are_nonexpansive():
    """P_C and 2 P_C - 1, on pairs of states under one load; the second keeps distances where nothing projects twice."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        one, other, U = rng.normal(size=(3, 2)) * 2
        ends = [lesson.midpoint(lambda t, U=U: U, (0.0, 1.0), x)[0][1] for x in (one, other)]
        stepped = [lesson.backward_euler(lambda t, U=U: U, (0.0, 1.0), x)[1] for x in (one, other)]
        apart = np.linalg.norm(one - other)
        assert np.linalg.norm(stepped[0] - stepped[1]) <= apart * (1 + 1e-12)
        assert np.linalg.norm(ends[0] - ends[1]) <= apart * (1 + 1e-12)


def slider(top):
    """The same slider as a system of the package: K = 1, a disc of radius one."""
    return vx.System(np.eye(2), top, vx.Norms(np.eye(2), [1.0], block=2))


@pytest.mark.long
def test_the_package_takes_these_steps():
    """And its half step, reflected, is the midpoint rule's: the same convex program."""
    times = np.linspace(0, 2, 25)
    run = vx.march(slider(lesson.from_rest), times, initial=lesson.BEHIND)
    np.testing.assert_allclose(run.state, lesson.backward_euler(lesson.from_rest, times, lesson.BEHIND), atol=1e-9)
    ends, middles = lesson.midpoint(lesson.from_rest, times, lesson.BEHIND)
    k = int(np.flatnonzero(np.abs(middles[:, 0] - lesson.BEHIND[0]) > 1e-12)[0])  # the first step that slips
    half = vx.march(slider(lesson.from_rest), [times[k], 0.5 * (times[k] + times[k + 1])], initial=ends[k])
    np.testing.assert_allclose(half.state[-1], middles[k], atol=1e-9)


def test_its_states_are_none_to_begin_from():
    """Friction beyond its bound: condition (2.1) refuses them."""
    times = np.linspace(0, 2, 33)
    ends, _ = lesson.midpoint(lesson.there_and_back, times, (0.0, 0.0))
    beyond = [k for k in range(1, 16) if np.linalg.norm(lesson.there_and_back(times[k]) - ends[k]) > 1 + 1e-6]
    assert beyond
    with pytest.raises(vx.SceneError, match=r"condition \(2.1\)"):
        vx.march(slider(lesson.there_and_back), times[beyond[0] :], initial=ends[beyond[0]])
