"""Key figures of runs as rows of tables and CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vemcvx.base.table import Table
from vemcvx.plots.style import Units, in_units
from vemcvx.results import Results
from vemcvx.results.files import ENERGIES, finite_or_none, peak_memory_mb

Row = dict[str, Any]  # Values of a run by name.
COUNTS = "sticking", "slipping", "open"
FORCES = "reaction", "force"
PLAIN = "certified", "certified_total", "estimated_error", "steps", "cells", "unknowns", "seconds", "peak_mb"
NAMES = (
    *(*ENERGIES, "displacement", "von_mises", "largest_principal_stress", "smallest_principal_stress"),
    *("slip", "friction", "pressure", "pressure_recovered", *FORCES, *COUNTS, *PLAIN),
)
"""Names of key figures. Energies belong to the end of a run, and `COUNTS` to the step with the largest energy."""


def figures(history: Results) -> Row:
    """Return the key figures of a run by name."""
    run, touch = history.trajectory, history.contact
    counts = dict(zip(COUNTS, (touch.stick_count, touch.slip_count, touch.open_count), strict=True))
    largest_forces = Row()
    for name, forces in history.resultants.items():
        kind = name.partition(" ")[0]
        largest_forces[kind] = max(largest_forces.get(kind, 0.0), float(np.linalg.norm(forces, axis=1).max()))
    return {
        **{name: finite_or_none(getattr(run, name)[-1]) for name in ENERGIES},
        **{one.key: finite_or_none(one.value) for one in history.extremes},
        **({name: int(count[history.row(None)]) for name, count in counts.items()} if len(touch.nodes) else {}),
        **largest_forces,
        "certified": finite_or_none(run.certified.max()),
        "certified_total": finite_or_none(run.certified_total.max()),
        **({"estimated_error": history.errors["total"]} if history.errors else {}),
        "steps": history.steps,
        "cells": history.mesh.n_cells,
        "unknowns": run.state.shape[1],
        "seconds": sum(history.seconds.values()),
        "peak_mb": peak_memory_mb(),
    }


def units_of(history: Results, units: Units) -> dict[str, str]:
    """Return the units of key figures by name."""
    return {
        **dict.fromkeys(ENERGIES, in_units("energy", units)),
        **{one.key: in_units(one.unit, units) for one in history.extremes},
        **dict.fromkeys(FORCES, in_units("force", units)),
    }


def csv(rows: Sequence[Row]) -> str:
    """Return rows as CSV, with all names as columns."""
    heads = list(dict.fromkeys(name for row in rows for name in row))
    return Table(heads, [list(map(row.get, heads)) for row in rows]).csv()
