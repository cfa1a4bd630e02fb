"""The history of several stages. A stage is a run that continues the run before.

The initial instants of later stages are left out. Each stage has its own effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from vemcvx.base.arrays import SAME, array_fields
from vemcvx.base.errors import HistoryError
from vemcvx.results.results import Results

COUNTED = "slip", "wear", "wear_second_order", "accumulated_slip"  # contact arrays that begin at 0 in each stage
PER_EFFECT = "acting", "loads"  # names of array dimensions with one entry per effect


def join(stages: Sequence[Results]) -> Results:
    """Return one history of all stages, or raise HistoryError."""
    for k, (before, after) in enumerate(pairwise(stages), start=2):
        if why := _difference(before, after):
            raise HistoryError(
                f"joined: stage {k} does not continue stage {k - 1}: {why}. Simulate it on the same mesh, with "
                f"the history of stage {k - 1} as initial=, at times that begin where stage {k - 1} ended, and store "
                "all steps."
            )
    first, runs = stages[0], [stage.trajectory for stage in stages]
    shifts = accumulate((len(stage.effects) for stage in stages[:-1]), initial=0)
    acting = [
        replace(own, causes=own.causes + shift * (own.causes >= 0), load_causes=own.load_causes + shift)
        for own, shift in zip((stage.acting for stage in stages), shifts, strict=True)
    ]
    steps = accumulate((len(run.times) - 1 for run in runs[:-1]), initial=0)
    numbered = [replace(run, stored=run.stored + shift) for run, shift in zip(runs, steps, strict=True)]
    contact = _in_time([stage.contact for stage in stages])
    each = np.array([stage.contact.friction_lengths for stage in stages])
    contact["friction_lengths"] = rubbing = each.max(axis=0)
    if ((each > 0) & (each != rubbing)).any():
        raise HistoryError("joined: in some stages, friction does not act on the same edges as in others.")
    solver, linear = (" / ".join(dict.fromkeys(getattr(run, name) for run in runs)) for name in ("solver", "linear"))
    seconds = {name: sum(stage.seconds[name] for stage in stages) for name in first.seconds}
    held = [stage.sides and stage.sides.held.tolist() for stage in stages]
    return Results(
        mesh=first.mesh,
        scene=None,
        effects=tuple(words for stage in stages for words in stage.effects),
        contact=replace(first.contact, **contact),
        acting=replace(acting[0], **_in_time(acting)),
        trajectory=replace(runs[0], **_in_time(numbered), solver=solver, linear=linear, seconds=seconds),
        moduli=first.moduli,
        out_of_plane=first.out_of_plane,
        seconds=seconds,
        inactive=tuple(f"stage {k}: {words}" for k, stage in enumerate(stages, 1) for words in stage.inactive),
        # Stages with different supports have no common `sides`.
        sides=first.sides if held.count(held[0]) == len(held) else None,
        stabilisation=first.stabilisation,
        units=first.units,
        **_in_time(stages, ("displacement", "forces", "prestress", "out_of_plane_prestress")),
    )


def _difference(before: Results, after: Results) -> str:
    """Return why `after` does not continue `before`, or ""."""
    alike = {"mesh": ("points", "centroids"), "contact": ("nodes", "partners", "normals", "lengths")}
    for name, arrays in alike.items():
        one, other = getattr(before, name), getattr(after, name)
        if not all(np.array_equal(getattr(one, array), getattr(other, array)) for array in arrays):
            return "it is on another mesh" if name == "mesh" else "its contact nodes are different"
    if not np.array_equal(before.moduli, after.moduli):
        return "its material is different"
    if after.stored[0] > 0:
        return "its initial instant was not stored"
    begun, ended = float(after.times[0]), float(before.times[-1])
    if abs(begun - ended) > SAME * float(after.times[-1] - before.times[0]):
        return f"it begins at t = {begun:.6g}, but the stage before it ended at t = {ended:.6g}"
    off = float(np.abs(after.displacement[0] - before.displacement[-1]).max())
    if off > SAME * float(np.abs(before.displacement).max()):
        return f"its displacement at t = {begun:.6g} is off by {off:.3g}"
    for name in ("dissipated", "work"):
        here, there = float(getattr(after, name)[0]), float(getattr(before, name)[-1])
        if here != there:
            return f"`{name}` begins at {here:.6g}, but the stage before it ended with {there:.6g}"
    return ""


def _in_time(records: Sequence[Any], names: Sequence[str] = ()) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, (sizes, *_) in array_fields(type(records[0])).items():
        arrays = [getattr(record, name) for record in records]
        if sizes[0] in PER_EFFECT:
            found[name] = np.concatenate(arrays)
        if sizes[0] not in ("S", "N") or (names and name not in names) or all(array is None for array in arrays):
            continue
        shape = np.max([array.shape[1:] for array in arrays if array is not None], axis=0).astype(int)
        apart, rows = any(size in PER_EFFECT for size in sizes), list[Any]()
        first, count = 0, sum(array.shape[1] for array in arrays) if apart else 0
        for record, array in zip(records, arrays, strict=True):
            own = np.zeros((len(record.stored), *shape)) if array is None else array
            ends = [(0, most - size) for most, size in zip(shape.tolist(), own.shape[1:], strict=True)]
            if apart:
                ends[0] = first, count - first - own.shape[1]
                first += own.shape[1]
            filling = np.nan if own.dtype.kind == "f" and not apart else 0
            row = np.pad(own, [(0, 0), *ends], constant_values=filling)
            rows.append(row + (rows[-1][-1] - row[0]) if rows and name in COUNTED else row)
        found[name] = np.concatenate([rows[0], *(row[1:] for row in rows[1:])])
    return found
