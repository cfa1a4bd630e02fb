"""Springs and sliders are compared with play and stop operators: states, multipliers, loops and memory."""

from __future__ import annotations

import numpy as np
import pytest

import spring_slider_chain as lesson
import vemcvx as vx

FORCE = lesson.course(lesson.TURNS, first=1.0)


NEWTON = vx.Newton(1e-12)


@pytest.fixture(scope="module")
def marched():
    system = lesson.chain(FORCE)
    return system, lesson.march(system, FORCE, NEWTON)


def test_plays_compose():
    x = np.cumsum(np.random.default_rng(0).normal(size=200))
    x[0] = 0.0
    assert np.abs(lesson.play(0.7, lesson.play(0.4, x)) - lesson.play(1.1, x)).max() < 1e-13


@pytest.mark.long
def test_the_chain_adds_up_plays(marched):
    system, trajectory = marched
    u, friction = lesson.chain_exactly(FORCE)
    assert np.abs(trajectory.state - u).max() < 1e-10 * np.abs(u).max()
    assert np.abs(trajectory.multipliers[:, :, 0] - friction).max() < 1e-10 * np.abs(friction).max()
    loss = np.append(0.0, np.cumsum(np.abs(np.diff(u[:, 1:], axis=0)) @ lesson.BOUNDS))
    energy = 0.5 * np.einsum("ni,ni->n", u, (system.K @ u.T).T)
    assert trajectory.dissipated == pytest.approx(loss, rel=1e-10)
    assert trajectory.energy == pytest.approx(energy, rel=1e-10)


@pytest.mark.long
def test_the_area_of_closed_loops_is_the_lost_energy():
    """The trapezoidal rule is exact, because all kinks of u(F) are at instants."""
    trajectory = lesson.march(lesson.chain(FORCE), FORCE)
    u = trajectory.state[:, 0]
    first, last = lesson.turning_instants(FORCE)[[1, 8]]
    area = np.sum(0.5 * (FORCE[first + 1 : last + 1] + FORCE[first:last]) * np.diff(u[first : last + 1]))
    areas = [lesson.loop_area(swing) for swing in (12, 5, 3.5)]
    assert area == pytest.approx(sum(areas), rel=1e-12)
    assert trajectory.dissipated[last] - trajectory.dissipated[first] == pytest.approx(sum(areas), rel=1e-12)
    assert lesson.loop_area(2 * lesson.BOUNDS[0]) == 0.0


@pytest.mark.long
def test_the_chain_remembers_turning_points_until_a_loop_closes(marched):
    """A closed loop ends in the state in which it began, and the run continues as if the loop were absent."""
    _, trajectory = marched
    at, near = lesson.turning_instants(FORCE), 1e-10 * np.abs(trajectory.state).max()
    for before, after in ((4, 6), (3, 7), (1, 8), (2, 9)):
        assert FORCE[at[before]] == FORCE[at[after]]
        assert trajectory.state[at[after]] == pytest.approx(trajectory.state[at[before]], abs=near)
    direct = lesson.course((0, 6, -6, 6, -6))
    short = lesson.march(lesson.chain(direct), direct, NEWTON)
    assert short.state[-1] == pytest.approx(trajectory.state[-1], abs=near)


@pytest.mark.long
def test_elements_in_parallel_are_stops_and_invert_the_chain():
    u, _ = lesson.chain_exactly(FORCE)
    E_0, E, y = lesson.inverse()
    trajectory = lesson.march(lesson.pose_under_strain(u[:, 0], E, y), FORCE, NEWTON)
    p, stops = lesson.play(y / E, u[:, 0]), trajectory.multipliers[:, :, 0]
    assert trajectory.state == pytest.approx(p, abs=1e-10 * np.abs(p).max())
    assert stops == pytest.approx(E * (u[:, :1] - p), abs=1e-10 * y.max())
    assert E_0 * u[:, 0] + stops.sum(axis=1) == pytest.approx(FORCE, abs=1e-10 * np.abs(FORCE).max())
    back = lesson.march(lesson.pose_under_stress(FORCE, E_0, E, y), FORCE, NEWTON)
    assert back.state == pytest.approx(np.column_stack([u[:, 0], p]), abs=1e-10 * np.abs(u).max())
