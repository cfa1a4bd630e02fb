"""The command line shows each log message once, and logs nothing about its own checks."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from called import call
from scenes import mostly_long, paper_scene

import vemcvx as vx
from vemcvx.cli.terminal import limit_log
from vemcvx.simulation import warn_of_turns


@pytest.fixture
def messages(caplog):
    """Return the messages that have been logged so far."""
    caplog.set_level(logging.INFO, logger="vemcvx")
    return lambda: [record.getMessage() for record in caplog.records]


@pytest.mark.long
def test_a_comparison_warns_once_that_mechanical_work_has_errors_of_first_order_in_the_step(messages):
    call("compare", "feng_han_huang", "--n", "4", "--steps", "2", "--solvers", "newton,clarabel,osqp")
    assert [words.split(":")[0] for words in messages()] == ["time steps"]


def test_each_kind_of_message_is_limited_separately(messages):
    log = logging.getLogger("vemcvx")
    with limit_log(1):
        for words in ("a: 1", "b: 1", "a: 2"):
            log.info("%s", words)
    log.info("a: 3")
    assert messages() == ["a: 1", "b: 1", "a: 3"]


@mostly_long("steps, warned", [(4, True), (64, False), (None, False)], 0, 1)
def test_turns_of_loads_inside_steps_are_named(messages, steps, warned):
    """The load rises to t = .3 and falls. A run in 64 steps misses .01 of the peak; `vx.instants` includes the peak."""
    scene, mesh = paper_scene(lambda t: np.interp(t, [0.0, 0.3, 1.0], [0.0, 1.0, 0.0])), vx.meshes.squares(2)
    times = vx.instants(scene, mesh, [0.0, 1.0]) if steps is None else np.linspace(0.0, 1.0, steps + 1)
    warn_of_turns(scene, mesh, times)
    assert len(messages()) == warned
    assert all("inside steps, at t = 0.3. " in words and "vemcvx.instants(" in words for words in messages())


@pytest.mark.long
def test_runs_warn_of_turns_inside_their_steps(messages):
    call("run", "frictional_hysteresis", "--n", "2", "--steps", "8")
    assert any(words.startswith("instants: ") for words in messages())
