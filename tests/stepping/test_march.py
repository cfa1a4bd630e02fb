"""Backward Euler: stored steps, initial states, and steps under an unchanged load."""

import numpy as np
import pytest
from scenes import cyclic, mostly_long, paper_scene, small

import vemcvx as vx
from vemcvx.base.arrays import EPS

pytestmark = pytest.mark.arithmetic

TIMES = np.linspace(0.0, 1.0, 13)


def equal_but_for_rounding(one, other):
    """Return True if arrays differ by at most a thousand rounding errors."""
    return np.abs(one - other).max() <= 1e3 * EPS * np.abs(other).max()


@pytest.fixture(scope="module")
def every():
    return vx.simulate(paper_scene(cyclic), small("voronoi", 4), TIMES)


@pytest.mark.parametrize(
    ("store", "rows"), [("all", range(13)), ("last", [12]), (5, [0, 5, 10, 12]), (100, [0, 12]), ([7, 5], [5, 7, 12])]
)
def test_store_selects_steps_and_changes_nothing_else(store, rows, every):
    some = vx.simulate(every.scene, every.mesh, TIMES, store=store)
    rows = list(rows)
    assert some.stored.tolist() == rows
    for name in ("times", "energy", "dissipated", "work", "iterations"):
        assert np.array_equal(getattr(some, name), getattr(every, name)[rows]), name
    for name in ("traction", "sticking", "bound"):
        assert np.array_equal(getattr(some.contact, name), getattr(every.contact, name)[rows]), name
    assert equal_but_for_rounding(some.displacement, every.displacement[rows])
    assert equal_but_for_rounding(some.contact.slip, every.contact.slip[rows])
    assert equal_but_for_rounding(some.contact.pressure, every.contact.pressure[rows])
    assert equal_but_for_rounding(some.reaction("right"), every.reaction("right")[rows])
    assert equal_but_for_rounding(some.stress(12), every.stress(-1))
    if 3 not in rows:
        with pytest.raises(vx.SceneError, match=r"step 3 was not stored; stored steps: \[.*12\] of 0 \.\.\. 12"):
            some.stress(3)


def test_steps_whose_load_does_not_change_keep_the_state():
    history = vx.simulate(paper_scene(lambda t: min(t, 0.5)), small("squares"), TIMES)
    held = TIMES > 0.5
    assert (history.iterations[held] <= 1).all()
    moved = np.abs(history.displacement[held] - history.displacement[6]).max()
    assert moved <= 1e-12 * np.abs(history.displacement[6]).max()
    assert np.abs(np.diff(history.work[6:])).max() <= 1e-12 * history.work[6]


@pytest.mark.long
def test_initial_states_are_consistent():
    mesh = small("squares")
    pulled = paper_scene(lambda t: 1.0 + t)
    with pytest.raises(vx.SceneError, match=r"not held by friction.*slips most at node \d+ at .*settled"):
        vx.simulate(pulled, mesh, TIMES)
    settled = vx.simulate(pulled, mesh, TIMES, initial="settled")
    step = vx.simulate(paper_scene(lambda t: 1.0 if t > 0 else 0.0), mesh, [0.0, 1.0])
    assert np.abs(settled.displacement[0] - step.displacement[1]).max() < 1e-14 * np.abs(step.displacement).max()
    again = vx.simulate(pulled, mesh, TIMES, initial=settled.displacement[0])
    assert np.abs(again.displacement - settled.displacement).max() < 1e-12 * np.abs(settled.displacement).max()
    free = vx.simulate(pulled, mesh, TIMES, initial="equilibrium")
    frictionless = vx.simulate(
        vx.Scene(*(e for e in pulled if not isinstance(e, vx.TrescaFriction))), mesh, TIMES, initial="equilibrium"
    )
    assert np.abs(free.displacement[0] - frictionless.displacement[0]).max() < 1e-13 * np.abs(free.displacement).max()
    assert free.dissipated[0] == free.work[0] == 0.0
    assert free.contact.sticking[0].all()


@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
def test_a_run_may_begin_under_a_load_that_friction_balances(solver):
    """If the load is below the friction bound, u_0 = 0 satisfies condition (2.1) of the paper."""
    system = vx.System(np.diag([2.0, 3.0]), lambda t: np.array([0.5, -0.2]) * (1 + 9 * t), vx.Norms(np.eye(2), [1, 1]))
    history = vx.march(system, [0.0, 1.0], solver=solver)
    assert np.array_equal(history.state[0], [0, 0])
    assert history.certificate[0] <= 1e-15
    assert history.multipliers[0, :, 0] == pytest.approx([0.5, -0.2], abs=1e-5)
    assert history.state[1] == pytest.approx([2.0, -1.0 / 3], abs=1e-5)


@mostly_long("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP(), vx.ThroughCvxpy("SCS", accuracy=1e-4)], 0, 1)
def test_the_library_never_prints(solver, capfd):
    vx.simulate(
        paper_scene(bound=lambda x, t: 0.0 if t < 0.5 else 4.0), small("squares", 4), [0, 0.3, 1], solver=solver
    )
    assert capfd.readouterr() == ("", "")
