"""Seconds, ratios and peak memory, measured side by side in one run."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A measured time and a reference time, in wall seconds and in CPU seconds."""

    name: str
    seconds: float
    reference: str
    reference_seconds: float
    wanted: str
    cpu: float | None = None
    reference_cpu: float | None = None

    @property
    def ratio(self) -> float:
        return self.seconds / self.reference_seconds

    @property
    def cpu_ratio(self) -> float | None:
        return None if self.cpu is None or self.reference_cpu is None else self.cpu / self.reference_cpu


def alternate(*actions: Callable[[], object], repeats: int = 3) -> list[float]:
    """Execute actions in turn, and return the median seconds of each.

    If repeats > 1, the first round is not counted.
    """
    seconds: list[list[float]] = [[] for _ in actions]
    for action in actions if repeats > 1 else ():
        action()
    for _ in range(repeats):
        for taken, action in zip(seconds, actions, strict=True):
            start = time.perf_counter()
            action()
            taken.append(time.perf_counter() - start)
    return [statistics.median(taken) for taken in seconds]


def in_turn(codes: dict[str, str], repeats: int = 3) -> dict[str, dict[str, float]]:
    """Run programs in turn in new processes, and return the medians of the numbers that they print."""
    found: dict[str, list[dict]] = {name: [] for name in codes}
    for _ in range(repeats):
        for name, code in codes.items():
            found[name].append(in_a_process(code))
    return {name: {key: statistics.median(one[key] for one in runs) for key in runs[0]} for name, runs in found.items()}


def in_a_process(code: str) -> dict:
    """Run code in a new process. Return its dictionary `out`, with the peak memory in GB under "peak_gb"."""
    # Unlike VmHWM, ru_maxrss may be the peak of the parent process.
    peak = (
        "\nimport json\n"
        "status = dict(line.split(':', 1) for line in open('/proc/self/status'))\n"
        "print(json.dumps(dict(out, peak_gb=int(status['VmHWM'].split()[0]) / 2**20)))"
    )
    run = subprocess.run([sys.executable, "-c", code + peak], capture_output=True, text=True, check=True)
    return json.loads(run.stdout.splitlines()[-1])
