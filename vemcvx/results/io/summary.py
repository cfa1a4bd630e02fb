"""The summary of a run as JSON, for scripts."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.results.io.archive import FORMAT, NAME
from vemcvx.results.io.csv_tables import FILES
from vemcvx.results.results import Results
from vemcvx.version import __version__


@dataclass(frozen=True)
class Origin:
    """Where a history comes from."""

    problem: str = "unnamed"
    family: str | None = None
    """The family of meshes, if it was one, or the mesh file."""
    n: int | None = None
    """What that family was asked for: cells across the shortest side; None of a file."""


def write_summary(history: Results, origin: Origin, tables: Sequence[str], *, writing: float, path: Path) -> None:
    """Write the summary; `tables` are CSV files beside it, `writing` is how many seconds the other files took."""
    text = json.dumps(summary(history, origin, writing) | {"tables": list(tables)}, indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def is_summary(path: Path) -> bool:
    """Whether that file is the summary of a history."""
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["format"]).startswith(NAME)
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return False


def listed_tables(path: Path) -> set[str]:
    """Names of the CSV files that the summary `path` lists, if it is there and ours."""
    if not is_summary(path):
        return set()
    listed = json.loads(path.read_text(encoding="utf-8")).get("tables")
    names = filter(lambda name: isinstance(name, str), listed if isinstance(listed, list) else [])
    return {name for name in names if name in FILES.values()}


def summary(history: Results, origin: Origin, writing: float) -> dict[str, Any]:
    """The summary as a dictionary; energies and certificates are those at the end, None where infinite."""
    mesh, run = history.mesh, history.trajectory
    seconds = {name: history.seconds[name] for name in ("assemble", "prepare", "solve")} | {"write": writing}
    size = {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}
    return {
        "format": FORMAT,
        "version": __version__,
        "problem": origin.problem,
        "mesh": {"family": origin.family, "n": origin.n, **size},
        "unknowns": run.state.shape[1],
        "steps": history.steps,
        "effects": list(history.effects),
        "left_out": list(history.inactive),
        "solver": history.solver,
        "linear": run.linear or None,
        "accuracy": run.accuracy,
        "certified_energy_error": finite_or_none(run.certificate.max()),
        "certificate_kind": run.certificate_kind,
        "estimated_energy_errors": history.errors,
        "energy": finite_or_none(run.energy[-1]),
        "dissipated": finite_or_none(run.dissipated[-1]),
        "work": finite_or_none(run.work[-1]),
        "contact": _contact(history),
        "seconds": {**seconds, "total": sum(seconds.values())},
        "peak_memory_mb": peak_memory_mb(),
    }


def _contact(history: Results) -> dict[str, int]:
    """How many contact nodes there are, and do what, in the last step."""
    touch = history.contact
    counts = {"stick": touch.stick_count, "slip": touch.slip_count, "open": touch.open_count}
    return {"nodes": len(touch.nodes)} | {name: int(count[-1]) for name, count in counts.items()}


def finite_or_none(value: float | None) -> float | None:
    """A number for JSON, which has no infinity."""
    return float(value) if value is not None and np.isfinite(value) else None


def peak_memory_mb() -> float | None:
    """The most memory that this process has held so far, in MB; None where the system does not tell (Windows).

    VmHWM where there is /proc: the maxrss of a new process may be that of the one that started it.
    """
    with suppress(OSError):
        if found := re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text()):
            return int(found.group(1)) / 1024
    try:
        import resource
    except ImportError:
        return None
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
