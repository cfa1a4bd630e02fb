"""What the package logs reaches those whom it concerns, once: no test of its own, and not every solver's run."""

from __future__ import annotations

import logging

import pytest
from test_cli_supplied import call

from vemcvx.cli import doctor, live_page
from vemcvx.cli.terminal import logged_at_most


@pytest.mark.long
def test_a_comparison_warns_once_of_lost_work(caplog):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        call("compare", "feng_han_huang", "--n", "4", "--steps", "2", "--solvers", "newton,clarabel,osqp")
    assert [record.getMessage().split(":")[0] for record in caplog.records] == ["time steps"]


@pytest.mark.long
@pytest.mark.parametrize("test", [doctor._patch, live_page.check])
def test_tests_of_its_own_warn_of_nothing(caplog, test):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        test()
    assert not caplog.records


def test_kinds_are_counted_apart(caplog):
    log = logging.getLogger("vemcvx")
    with caplog.at_level(logging.INFO, logger="vemcvx"):
        with logged_at_most(1):
            for words in ("a: 1", "b: 1", "a: 2"):
                log.info("%s", words)
        log.info("a: 3")
    assert [record.getMessage() for record in caplog.records] == ["a: 1", "b: 1", "a: 3"]
