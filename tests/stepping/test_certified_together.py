"""Steps certified in full eight at a time: the same certificates, errors and resumed runs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from identical import same
from installed import threaded
from interrupted import KINDS, TIMES
from scenes import cyclic, paper_scene, small
from stopped import Stopped, stop_at

import vemcvx as vx
from vemcvx.linear import residual
from vemcvx.program.condensation import out_of_balance
from vemcvx.scene import pose_scene
from vemcvx.stepping import posed_step, trajectory
from vemcvx.stepping.backward_euler import first_state, states_of, steps_of
from vemcvx.stepping.posed_step import TOGETHER, certified_in_full, certified_together
from vemcvx.stepping.state import prepare

LINEAR = [vx.SuperLU(), pytest.param(vx.Pardiso(threads=2), id="PARDISO", marks=threaded)]
ON_ALL = {"state", "velocity", "initial", "gap", "floor", "sticking", "stuck", "seconds"}
"""Of a trajectory, what is of all unknowns, or of certificates that are."""


def fields(history):
    """The arrays of a trajectory; rows of a folder are maps into files."""
    record = history.trajectory
    found = {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}
    return {name: np.array(value) if isinstance(value, np.ndarray) else value for name, value in found.items()}


def run_of(linear, n=6, effects=None):
    """A prepared run and its condensed states."""
    scene = paper_scene(cyclic) if effects is None else vx.Scene(*effects)
    run = prepare(pose_scene(scene, small("squares", n)).system, None, True, True, linear)
    first = first_state(run, TIMES, None)
    return run, [state for _, state in states_of(run, steps_of(run, TIMES), TIMES, 0, first)]


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("name", KINDS)
def test_runs_of_every_kind_are_those_of_steps_one_by_one(name, monkeypatch):
    together = KINDS[name].simulate(linear=vx.SuperLU())
    monkeypatch.setattr(trajectory, "together", lambda run: 1)
    alone = KINDS[name].simulate(linear=vx.SuperLU())
    one, two = fields(alone), fields(together)
    assert not [key for key in one if key not in ON_ALL and not same(one[key], two[key])]
    # The answer to a step is as far from both as they certify; accumulated, lest those of the steps before count.
    scene = vx.Scene(*KINDS[name].effects)
    A = pose_scene(scene, alone.mesh).A
    apart = (together.displacement - alone.displacement).reshape(len(TIMES), -1)
    energy = np.sqrt(np.maximum(np.einsum("ni,ni->n", apart, (A @ apart.T).T), 0.0))
    bound = sum(history.trajectory.certified * history.trajectory.scale for history in (alone, together))
    assert (energy <= np.cumsum(bound)).all()


@pytest.mark.parametrize("linear", LINEAR)
def test_digits_do_not_depend_on_how_many_there_are(linear):
    run, states = run_of(linear)
    states = states[:TOGETHER]
    whole = certified_together(run, states)
    for some in (states[:1], states[2:5], states[5:]):
        at = states.index(some[0])
        for one, two in zip(certified_together(run, some), whole[at:], strict=False):
            assert same(np.array(one.full), np.array(two.full))
            assert same(one.certificate, two.certificate)
    singly = [certified_in_full(run, state) for state in states]
    for one, two in zip(singly, whole, strict=True):
        off = one.full - two.full
        error = sum(state.certificate.error + state.certificate.error_floor for state in (one, two))
        assert np.sqrt(off @ (run.system.K @ off)) <= error


def test_states_that_are_known_in_full_stay_as_they_are():
    run, states = run_of(vx.SuperLU())
    known = certified_in_full(run, states[1])
    mixed = certified_together(run, [states[0], known, states[2]])
    assert mixed[1] is known
    assert [state.t for state in mixed] == [state.t for state in states[:3]]
    assert certified_together(run, [known]) == [known]


def test_residuals_and_sizes_of_columns_are_those_of_each_to_the_bit():
    system = pose_scene(paper_scene(), small("squares", 70)).system  # of more rows than are taken at a time
    force, y, held = np.random.default_rng(0).normal(size=(3, system.n, 3))
    for order in "CF":
        given = [np.array(one, order=order) for one in (force, y, held)]
        together = residual(given[0], system.K, *given[1:]), *out_of_balance(system, *given)
        for k in range(3):
            one = [column[:, k].copy() for column in (force, y, held)]
            alone = residual(one[0], system.K, *one[1:]), *out_of_balance(system, *one)
            assert all(same(a[:, k].copy(), b) for a, b in zip(together, alone, strict=True))


@pytest.mark.long
@pytest.mark.parametrize("linear", LINEAR)
@pytest.mark.parametrize("between", [0.0, 1e3], ids=["singly", "as many as wait"])
@pytest.mark.parametrize("step", [5, 8, 11])
def test_a_resumed_run_is_the_uninterrupted_one_to_the_bit(tmp_path, monkeypatch, linear, between, step):
    monkeypatch.setattr(trajectory, "BETWEEN", between)
    scene, mesh, steps = paper_scene(cyclic), small("squares", 24), []
    whole = fields(vx.simulate(scene, mesh, TIMES, linear=linear))
    with pytest.raises(Stopped):
        vx.simulate(scene, mesh, TIMES, linear=linear, stream=tmp_path, progress=stop_at(step))
    options = {"stream": tmp_path, "resume": True, "progress": lambda n, _: steps.append(n)}
    resumed = fields(vx.simulate(scene, mesh, TIMES, linear=linear, **options))
    assert steps[0] == step + 1
    assert not [name for name in whole if name != "seconds" and not same(whole[name], resumed[name])]


def spoil(monkeypatch, step):
    """Let the full certificate of a step miss the accuracy."""

    def spoiled(run, states):
        found = certified_together(run, states)
        missed = [dataclasses.replace(state.certificate, equilibrium=1.0) for state in found]
        pairs = zip(found, missed, strict=True)
        return [dataclasses.replace(a, certificate=b) if a.t == TIMES[step] else a for a, b in pairs]

    monkeypatch.setattr(trajectory, "certified_together", spoiled)


@pytest.mark.parametrize("stop", [5, 100], ids=["before the others fill up", "when they have"])
def test_an_answer_that_does_not_hold_names_its_own_step(tmp_path, monkeypatch, stop):
    """Also where the march has failed meanwhile, and with the steps before it entered."""
    spoil(monkeypatch, 3)
    scene, mesh, steps = paper_scene(cyclic), small("squares", 4), []
    with pytest.raises(vx.NotCertified, match=r"^step 3 at t = 0\.25: ") as caught:
        vx.simulate(scene, mesh, TIMES, stream=tmp_path, progress=stop_at(stop))
    assert caught.value.step == 3
    assert np.load(tmp_path / "checkpoint.npz")["numbers"][0] == 2
    monkeypatch.undo()
    given = {"stream": tmp_path, "resume": True, "progress": lambda n, _: steps.append(n)}
    resumed = vx.simulate(scene, mesh, TIMES, **given)
    assert steps[0] == 3
    assert np.array_equal(resumed.displacement, vx.simulate(scene, mesh, TIMES).displacement)


def test_large_systems_take_no_more_memory_than_they_must(monkeypatch):
    run, states = run_of(vx.SuperLU())
    assert posed_step.together(run) == TOGETHER
    monkeypatch.setattr(posed_step, "AT_ONCE", 12 * run.system.n * 3)
    assert posed_step.together(run) == 3
    one, two = (certified_together(run, states[:k])[0] for k in (3, 1))
    assert same(np.array(one.full), np.array(two.full))
    monkeypatch.setattr(posed_step, "AT_ONCE", 1)
    assert posed_step.together(run) == 1


@pytest.mark.parametrize(
    ("linear", "store", "wanted"),
    [(vx.SuperLU(), "all", [1, 8, 4]), (vx.SuperLU(), 3, []), (vx.Multigrid(), "all", [])],
    ids=["all steps", "every third", "no factor"],
)
def test_steps_wait_for_each_other_where_all_are_kept_and_K_is_factorised(monkeypatch, linear, store, wanted):
    counts = []

    def counted(run, states):
        counts.append(len(states))
        return certified_together(run, states)

    monkeypatch.setattr(trajectory, "certified_together", counted)
    vx.simulate(paper_scene(cyclic), small("squares", 4), TIMES, linear=linear, store=store)
    assert counts == wanted


def test_a_lasting_run_enters_what_has_waited_long(tmp_path, monkeypatch):
    monkeypatch.setattr(trajectory, "BETWEEN", 0.0)
    numbers = []

    def kept(n, _):
        numbers.append((n, int(np.load(tmp_path / "checkpoint.npz")["numbers"][0])))

    options = {"stream": tmp_path, "progress": kept}
    vx.simulate(paper_scene(cyclic), small("squares", 4), TIMES, **options)
    assert numbers == [(n, n) for n in range(1, len(TIMES))]
