"""Elastoplastic bars: loading, unloading, reverse yielding, residual stress, dissipation."""

from __future__ import annotations

import numpy as np
import pytest

import elastoplastic_truss as lesson
import vemcvx as vx


@pytest.mark.long
def test_three_bars_follow_their_closed_form():
    force = lesson.course(lesson.TURNS, 0.25)
    system = lesson.pose_truss(lesson.three_bars(), lesson.load_down(force))
    trajectory = lesson.march(system, force, vx.Newton(1e-12))
    state, sigma, multipliers = lesson.three_bars_exactly(force)
    assert np.abs(trajectory.state - state).max() < 1e-10 * np.abs(state).max()
    assert np.abs(trajectory.multipliers[:, :, 0] - multipliers).max() < 1e-10 * np.abs(multipliers).max()
    reached = lesson.stresses(lesson.three_bars(), trajectory.state)
    assert np.abs(reached - sigma).max() < 1e-10 * np.abs(sigma).max()
    volume = lesson.three_bars().lengths
    loss = np.append(0.0, np.cumsum(lesson.YIELD * np.abs(np.diff(state[:, 2:], axis=0)) @ volume))
    energy = 0.5 * (sigma**2 / lesson.YOUNG + lesson.HARDENING * state[:, 2:] ** 2) @ volume
    assert trajectory.dissipated == pytest.approx(loss, rel=1e-10)
    assert trajectory.energy == pytest.approx(energy, rel=1e-10)


def test_bars_yield_at_the_closed_forms_and_keep_residual_stress():
    first, second = lesson.yield_forces()
    for force, flowing in (
        (0.999 * first, [False, False]),
        (1.001 * first, [True, False]),
        (1.001 * second, [True, True]),
    ):
        F = np.array([0.0, force, 0.0])
        trajectory = lesson.march(lesson.pose_truss(lesson.three_bars(), lesson.load_down(F)), F)
        assert (~trajectory.sticking[1, :2]).tolist() == flowing
    left = lesson.stresses(lesson.three_bars(), trajectory.state)[-1]
    assert left[0] < -1e-3
    assert left[0] + 2 * lesson.COSINE * left[1] == pytest.approx(0.0, abs=1e-13)


def test_one_bar_shows_the_bauschinger_effect():
    """After the stress s > sigma_y, reverse yielding begins at s - 2 sigma_y, not at -sigma_y."""
    bar = lesson.Truss(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0, 1]]), held=np.array([0, 1, 3]))
    peak, reverse = 1.5, 1.5 - 2 * lesson.YIELD
    F = np.array([0.0, peak, 0.0, reverse + 0.01, reverse - 0.01])
    trajectory = lesson.march(lesson.pose_truss(bar, F[:, None] * np.eye(4)[2]), F, vx.Newton(1e-12))
    p = lesson.play(lesson.YIELD, F)[:, 0] / lesson.HARDENING
    assert trajectory.state[:, 1] == pytest.approx(p, rel=1e-10)
    assert trajectory.sticking[:, 0].tolist() == [True, False, True, True, False]
    tangent = lesson.YOUNG * lesson.HARDENING / (lesson.YOUNG + lesson.HARDENING)
    exact = lesson.YIELD / lesson.YOUNG + (peak - lesson.YIELD) / tangent
    assert trajectory.state[1, 0] == pytest.approx(exact, rel=1e-10)
