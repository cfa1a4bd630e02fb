"""The Pareto front: what nothing else beats in both respects."""

from __future__ import annotations

from collections.abc import Sequence

SAME = 0.01
"""Errors that differ by less than this part are the same: solvers differ in the last digits of one mesh's error."""


def front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Which pairs of cost and error are better than all that cost no more, by growing cost; of equal ones the first."""
    best, kept = float("inf"), []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if errors[k] < (1.0 - SAME) * best:
            best = errors[k]
            kept.append(k)
    return kept
