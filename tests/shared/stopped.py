"""Runs that are ended on the way."""

from __future__ import annotations


class Stopped(Exception):
    """What ends a run in the tests."""


def stop_at(step):
    """For `progress=`: the run ends after this step."""

    def progress(n, steps):
        if n == step:
            raise Stopped

    return progress
