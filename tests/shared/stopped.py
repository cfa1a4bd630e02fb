"""Stop a run after a given step."""

from __future__ import annotations


class Stopped(Exception):
    """The error that `stop_at` raises."""


def stop_at(step):
    """Return a function for `progress=` that stops the run after this step."""

    def progress(n, steps):
        if n == step:
            raise Stopped

    return progress
