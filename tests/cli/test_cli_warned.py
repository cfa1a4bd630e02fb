"""The command line limits the number of log messages of each kind."""

from __future__ import annotations

import logging

import pytest

from vemcvx.cli.terminal import limit_log


@pytest.fixture
def messages(caplog):
    """Return the messages that have been logged so far."""
    caplog.set_level(logging.INFO, logger="vemcvx")
    return lambda: [record.getMessage() for record in caplog.records]


def test_each_kind_of_message_is_limited_separately(messages):
    log = logging.getLogger("vemcvx")
    with limit_log(1):
        for words in ("a: 1", "b: 1", "a: 2"):
            log.info("%s", words)
    log.info("a: 3")
    assert messages() == ["a: 1", "b: 1", "a: 3"]
