"""How long a sweep still takes: what finished points took, scaled by their work."""

from __future__ import annotations

from collections.abc import Sequence


def seconds_left(finished: Sequence[tuple[float, float]], waiting: Sequence[float], workers: int) -> float | None:
    """Seconds until all are done; None while nothing is known.

    Parameters
    ----------
    finished : sequence of (work, seconds)
        Every point takes about as long as the quickest one, to be started and measured, and more by its work.
    waiting : sequence of float
        Work of the points that are not finished.
    workers : int
    """
    if not finished or not waiting:
        return 0.0 if not waiting else None
    start = min(seconds for _, seconds in finished)
    work = sum(work for work, _ in finished)
    rate = sum(seconds - start for _, seconds in finished) / work if work > 0 else 0.0
    left = [start + rate * work for work in waiting]
    return max(sum(left) / workers, max(left))
