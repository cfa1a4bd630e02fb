"""A step begins with the multipliers that the two steps before it let expect."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identical import same
from scenes import cyclic, paper_scene, small
from stopped import Stopped, stop_at

import vemcvx as vx
from vemcvx.scene import pose_scene
from vemcvx.stepping.state import Earlier, State

TIMES = np.linspace(0.0, 1.0, 33)


def expected(t, at=3.0, before=2.0, p=(5.0, 1.0)):
    """After multipliers 1 and 2, one instant before, those at `t`; in binary fractions, which are not rounded."""
    earlier = Earlier(before, np.array([[1.0], [-1.0]]), np.array([4.0, 3.0]), np.zeros(3))
    return State.expected(SimpleNamespace(t=at, lam=np.array([[2.0], [-4.0]]), p=np.array(p), earlier=earlier), t)


@pytest.mark.parametrize(("t", "share"), [(3.0, 0.0), (3.25, 0.25), (4.0, 1.0), (4.5, 1.0), (103.0, 1.0)])
def test_they_go_on_but_by_no_more_than_they_changed(t, share):
    lam, p = expected(t)
    assert np.array_equal(lam, [[2.0 + share], [-4.0 - 3 * share]])
    assert np.array_equal(p, [5.0 + share, max(1.0 - 2 * share, 0.0)])


def test_after_a_long_step_a_short_one_expects_its_part():
    lam, p = expected(3.5, before=1.0)
    assert np.array_equal(lam, [[2.25], [-4.75]])
    assert np.array_equal(p, [5.25, 0.5])


def test_limits_do_not_pull():
    assert np.array_equal(expected(4.0, p=(0.0, 2.0))[1], [0.0, 1.0])


def test_two_states_of_one_instant_say_nothing_of_the_next():
    lam, p = expected(4.0, before=3.0)
    assert np.array_equal(lam, [[2.0], [-4.0]])
    assert np.array_equal(p, [5.0, 1.0])


@pytest.fixture
def begun(monkeypatch):
    """What steps were begun with, and the state that said so, by their instants."""
    found, own = {}, State.expected

    def noted(self, t):
        found[t] = (self, *own(self, t))
        return found[t][1:]

    monkeypatch.setattr(State, "expected", noted)
    return found


def test_at_the_first_step_nothing_is_expected(begun):
    vx.simulate(paper_scene(lambda t: 1.0 + t), small("squares", 4), TIMES[:4], initial="settled")
    state, lam, p = begun[TIMES[1]]
    assert np.array_equal(lam, state.lam)
    assert np.array_equal(p, state.p)
    state, lam, _ = begun[TIMES[2]]
    assert not np.array_equal(lam, state.lam)


@pytest.mark.long
def test_a_resumed_run_begins_with_the_same(tmp_path, begun):
    scene, mesh = paper_scene(cyclic).with_(vx.UnilateralContact(on="top")), small("squares", 5)
    vx.simulate(scene, mesh, TIMES)
    whole = dict(begun)
    with pytest.raises(Stopped):
        vx.simulate(scene, mesh, TIMES, stream=tmp_path, progress=stop_at(9))
    begun.clear()
    vx.simulate(scene, mesh, TIMES, stream=tmp_path, resume=True)
    state, lam, _ = begun[TIMES[10]]
    assert not np.array_equal(lam, state.lam)
    for t, found in begun.items():
        assert same(found[1:], whole[t][1:])


@pytest.mark.long
def test_where_sets_move_fewer_systems_are_solved(monkeypatch):
    mesh = small("squares", 16)
    ours = vx.simulate(paper_scene(), mesh, TIMES)
    monkeypatch.setattr(State, "expected", lambda self, t: (self.lam, self.p))
    plain = vx.simulate(paper_scene(), mesh, TIMES)
    assert np.diff(ours.trajectory.stuck).astype(bool).sum() > 0
    assert ours.iterations.sum() < plain.iterations.sum()
    K, apart = pose_scene(paper_scene(), mesh).system.K, ours.trajectory.state - plain.trajectory.state
    distance = np.sqrt(np.einsum("si,si->s", apart, (K @ apart.T).T))
    # A step hands on the error of the step before at most whole.
    steps = [(one.certificate + one.certificate_floor) * one.trajectory.unit for one in (ours, plain)]
    assert (distance <= np.cumsum(sum(steps))).all()
