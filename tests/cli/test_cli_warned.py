"""What the package logs reaches those whom it concerns, once: no test of its own, and not every solver's run."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from called import call
from scenes import mostly_long, paper_scene

import vemcvx as vx
from vemcvx.cli import live_page
from vemcvx.cli.terminal import limit_log
from vemcvx.simulation import warn_of_turns


@pytest.mark.long
def test_a_comparison_warns_once_of_lost_work(caplog):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        call("compare", "feng_han_huang", "--n", "4", "--steps", "2", "--solvers", "newton,clarabel,osqp")
    assert [record.getMessage().split(":")[0] for record in caplog.records] == ["time steps"]


@pytest.mark.long
def test_a_check_of_the_live_page_warns_of_nothing(caplog):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        live_page.check()
    assert not caplog.records


def test_kinds_are_counted_apart(caplog):
    log = logging.getLogger("vemcvx")
    with caplog.at_level(logging.INFO, logger="vemcvx"):
        with limit_log(1):
            for words in ("a: 1", "b: 1", "a: 2"):
                log.info("%s", words)
        log.info("a: 3")
    assert [record.getMessage() for record in caplog.records] == ["a: 1", "b: 1", "a: 3"]


@mostly_long("steps, warned", [(4, True), (64, False), (None, False)], 0, 1)
def test_turns_that_steps_miss_are_named(caplog, steps, warned):
    """The load rises to 1 at t = .3 and falls. With 64 steps its turn is missed by .01, with vx.instants not at all."""
    scene, mesh = paper_scene(lambda t: np.interp(t, [0.0, 0.3, 1.0], [0.0, 1.0, 0.0])), vx.meshes.squares(2)
    times = vx.instants(scene, mesh, [0.0, 1.0]) if steps is None else np.linspace(0.0, 1.0, steps + 1)
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        warn_of_turns(scene, mesh, times)
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == warned
    assert all("inside steps, at t = 0.3. The" in words and "vemcvx.instants(" in words for words in said)


@pytest.mark.long
def test_runs_warn_of_turns_that_they_miss(caplog):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        call("run", "frictional_hysteresis", "--n", "2", "--steps", "8")
    assert any(record.getMessage().startswith("instants: ") for record in caplog.records)
