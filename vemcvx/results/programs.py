"""The convex programs of a history's steps."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace

from vemcvx.errors import HistoryError, SceneWarning
from vemcvx.meshes import AnyMesh
from vemcvx.program import SolvedProgram
from vemcvx.results.results import Results
from vemcvx.scene.pose import pose_scene
from vemcvx.stepping.programs import programs_of_trajectory


def with_origin(
    programs: Iterator[SolvedProgram], effects: Sequence[str], mesh: AnyMesh, **more: str
) -> Iterator[SolvedProgram]:
    """The programs, which now say what scene and mesh they are of."""
    size = {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}
    for program in programs:
        yield replace(program, origin={"scene": list(effects), "mesh": size, **more})


def programs_of_steps(history: Results, numbers: Sequence[int], condense: bool = True) -> Iterator[SolvedProgram]:
    """The programs of these steps, with one factorisation.

    Raises
    ------
    HistoryError
        The history has no scene, no such step, or has not stored the states before and after one.
    """
    if history.scene is None:
        raise HistoryError(
            "program: the history was read from files, which do not keep the functions of a scene; simulate again, or "
            "take vemcvx.programs(scene, mesh, times)."
        )
    with warnings.catch_warnings():
        # The run has given them.
        warnings.simplefilter("ignore", SceneWarning)
        system = pose_scene(history.scene, history.mesh, history.trajectory.times.tolist()).system
    found = programs_of_trajectory(system, history.trajectory, numbers, condense)
    return with_origin(found, history.effects, history.mesh, solver=history.solver)
