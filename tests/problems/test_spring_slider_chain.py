"""Springs and sliders against plays and stops: states, multipliers, loops and memory."""

from __future__ import annotations

import runpy

import numpy as np
import pytest
from certified_bounds import admissible, bounds, ledger_bound, ledger_defect

import spring_slider_chain as lesson

FORCE = lesson.course(lesson.TURNS, first=1.0)


@pytest.fixture(scope="module", params=lesson.SOLVERS, ids=lambda solver: solver.name)
def marched(request):
    system = lesson.chain(FORCE)
    return system, lesson.march(system, FORCE, request.param)


def test_plays_compose():
    x = np.cumsum(np.random.default_rng(0).normal(size=200))
    x[0] = 0.0
    assert np.abs(lesson.play(0.7, lesson.play(0.4, x)) - lesson.play(1.1, x)).max() < 1e-13


@pytest.mark.long
def test_the_chain_adds_up_plays(marched):
    system, trajectory = marched
    u, friction = lesson.chain_exactly(FORCE)
    allowed = bounds(system, trajectory)
    assert (np.abs(trajectory.state - u) <= allowed.state).all()
    assert (np.abs(admissible(system, trajectory)[:, :, 0] - friction) <= allowed.multipliers).all()
    assert allowed.state.max() < 1e-3 * np.abs(u).max()
    assert allowed.multipliers.max() < 1e-2
    loss = np.append(0.0, np.cumsum(np.abs(np.diff(u[:, 1:], axis=0)) @ lesson.BOUNDS))
    energy = 0.5 * np.einsum("ni,ni->n", u, (system.K @ u.T).T)
    assert (np.abs(trajectory.dissipated - loss) <= allowed.dissipated).all()
    assert (np.abs(trajectory.energy - energy) <= allowed.energy).all()
    assert (np.abs(ledger_defect(system, trajectory)) <= ledger_bound(system, trajectory)).all()


@pytest.mark.long
def test_the_area_of_closed_loops_is_the_lost_energy(capsys):
    """The trapezoidal rule is exact: the slope of u(F) jumps two thresholds past a turn, always at an instant."""
    trajectory = lesson.march(lesson.chain(FORCE), FORCE)
    u = trajectory.state[:, 0]
    first, last = lesson.turning_instants(FORCE)[[1, 8]]
    area = np.sum(0.5 * (FORCE[first + 1 : last + 1] + FORCE[first:last]) * np.diff(u[first : last + 1]))
    areas = [lesson.loop_area(swing) for swing in (12, 5, 3.5)]
    assert area == pytest.approx(sum(areas), rel=1e-12)
    assert trajectory.dissipated[last] - trajectory.dissipated[first] == pytest.approx(sum(areas), rel=1e-12)
    assert lesson.loop_area(2 * lesson.BOUNDS[0]) == 0.0
    runpy.run_path(lesson.__file__, run_name="not main")["main"]()
    assert "in closed form: {:g} + {:g} + {:g}".format(*areas) in capsys.readouterr().out


@pytest.mark.long
def test_the_chain_remembers_turning_points_until_a_loop_closes(marched):
    """A closed loop ends in the state in which it began, and the run continues as if the loop were absent."""
    system, trajectory = marched
    allowed = 2 * bounds(system, trajectory).state
    at = lesson.turning_instants(FORCE)
    for before, after in ((4, 6), (3, 7), (1, 8), (2, 9)):
        assert FORCE[at[before]] == FORCE[at[after]]
        apart = np.abs(trajectory.state[at[after]] - trajectory.state[at[before]])
        assert (apart <= allowed[at[after]]).all()
    direct = lesson.course((0, 6, -6, 6, -6))
    short = lesson.march(lesson.chain(direct), direct)
    assert (np.abs(short.state[-1] - trajectory.state[-1]) <= allowed[-1]).all()


@pytest.mark.long
@pytest.mark.parametrize("solver", lesson.SOLVERS, ids=lambda solver: solver.name)
def test_elements_in_parallel_are_stops_and_invert_the_chain(solver):
    u, _ = lesson.chain_exactly(FORCE)
    E_0, E, y = lesson.inverse()
    system = lesson.pose_under_strain(u[:, 0], E, y)
    trajectory = lesson.march(system, FORCE, solver)
    allowed = bounds(system, trajectory)
    p = lesson.play(y / E, u[:, 0])
    assert (np.abs(trajectory.state - p) <= allowed.state).all()
    stops = admissible(system, trajectory)[:, :, 0]
    assert (np.abs(stops - E * (u[:, :1] - p)) <= allowed.multipliers).all()
    stress = E_0 * u[:, 0] + stops.sum(axis=1)
    assert (np.abs(stress - FORCE) <= allowed.multipliers.sum(axis=1)).all()
    under_stress = lesson.pose_under_stress(FORCE, E_0, E, y)
    back = lesson.march(under_stress, FORCE, solver)
    limit = bounds(under_stress, back)
    assert (np.abs(back.state - np.column_stack([u[:, 0], p])) <= limit.state).all()
    assert limit.state.max() < 1e-2 * np.abs(u).max()
