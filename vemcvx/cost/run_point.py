"""Run one point, in the process it is called in: seconds, memory, certificate, estimate, and the answer itself.

A run of less than a third of a second is made three times, and the median one counts. Before that a small run of the
same kind has imported what is imported late. Memory is the high-water mark of the resident set when the last run ends.
"""

from __future__ import annotations

import contextlib
import time
import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.cost.settings import Ingredients, Point, Recipe
from vemcvx.errors import SceneError, SceneWarning, VemcvxError
from vemcvx.estimate.adapt import adapt
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.measures.field import step_at
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.results.io.summary import finite_or_none, peak_memory_mb
from vemcvx.simulation import simulate

SHORT, REPEATS = 0.3, 3


@dataclass(frozen=True, eq=False)
class Ran:
    """A run."""

    mesh: PolygonMesh
    displacement: Floats
    """(T, n_nodes, 2) at the instants asked for"""
    moduli: Floats
    """(2, n_cells) or (6, n_cells)"""
    found: dict[str, Any]
    """what the table says of it, column by column"""


def run_point(recipe: Recipe, point: Point, instants: Floats) -> Ran:
    """Make the ingredients of a point and simulate.

    Raises
    ------
    VemcvxError
        There is no such answer.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        _warm_up(recipe, point)
        caught.clear()
        start = time.perf_counter()
        made = recipe(point)
        meshing = time.perf_counter() - start
        history, seconds, repeats, estimated = _repeated(made, point, instants)
        peak = peak_memory_mb()
        if point.target is None:
            # Scenes with viscosity have no estimate.
            with contextlib.suppress(SceneError):
                estimated = error_budget(history).largest["total"]
    said = [str(warning.message) for warning in caught if issubclass(warning.category, SceneWarning)]
    if point.target is not None and estimated is not None and estimated > point.target:
        said.append(f"the target was not met: {estimated:.2%} estimated")
    rows = [history.row(step_at(history, float(t))) for t in instants]
    run = history.trajectory
    found = {
        "steps": history.steps,
        "cells": history.mesh.n_cells,
        "unknowns": run.state.shape[1],
        "estimated": finite_or_none(estimated),
        "certificate": finite_or_none(run.certificate_total[-1]),
        "seconds": sum(seconds.values()),
        **seconds,
        "mesh": meshing,
        "repeats": repeats,
        "peak_mb": peak,
        "message": "; ".join(dict.fromkeys(said)),
    }
    return Ran(plane_mesh(history.mesh, "cost"), history.displacement[rows], history.moduli, found)


def _warm_up(recipe: Recipe, point: Point) -> None:
    """Import what the point needs; whatever is wrong will show again."""
    with contextlib.suppress(VemcvxError):
        made = recipe(replace(point, n=min(point.n, 4), steps=2, target=None))
        simulate(made.scene, made.mesh, made.times, solver=made.solver, initial=made.initial, check=False)


def _repeated(made: Ingredients, point: Point, instants: Floats) -> tuple[History, dict[str, float], int, float | None]:
    """The history and seconds of the median run, how many there were, and what an adaptive one estimates."""
    runs = [_timed(made, point, instants)]
    if sum(runs[0][1].values()) < SHORT:
        runs += [_timed(made, point, instants) for _ in range(REPEATS - 1)]
    history, seconds, estimated = sorted(runs, key=lambda run: sum(run[1].values()))[len(runs) // 2]
    return history, seconds, len(runs), estimated


def _timed(made: Ingredients, point: Point, instants: Floats) -> tuple[History, dict[str, float], float | None]:
    if point.target is None:
        steps = np.searchsorted(made.times, instants - 0.5 * np.diff(made.times).min())
        history = simulate(
            made.scene, made.mesh, made.times, solver=made.solver, initial=made.initial, store=steps.tolist()
        )
        return history, {**history.seconds, "adapt": 0.0}, None
    wanted, start = np.append(made.times[0], instants), time.perf_counter()
    adapted = adapt(made.scene, made.mesh, wanted, point.target, solver=made.solver, initial=made.initial)
    wall, last = time.perf_counter() - start, adapted.history.seconds
    return adapted.history, {**last, "adapt": wall - sum(last.values())}, adapted.passes[-1].total
