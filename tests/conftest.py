"""Settings of all tests: one BLAS thread, default signal handlers, tiers of tests, the fixture of mesh families."""

from __future__ import annotations

import gc
import os
import signal
import sys
from pathlib import Path

# On two cores, two test processes with two BLAS threads each would slow each other down.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Background jobs of a shell ignore SIGINT and SIGHUP, and so would processes that tests start.
if sys.platform != "win32":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

import pytest
from scenes import FAMILIES

# While pytest collects thousands of tests, the garbage collector would traverse all of them again and again.
gc.disable()

LONGER = {
    "bound": "error_bound",
    "cli": "cli cli_compare cli_report cli_said cli_space cli_supplied",
    "cost": "cost",
    "effects": "absence closed_forms conformance_effects",
    "estimate": (
        "adapt budget_of_bodies error_budget measures_distance measures_orders stretched_cells time_estimate "
        "unseen_data"
    ),
    "exchange": "damaged_programs",
    "linear": "linear",
    "meshes": (
        "bodies mesh_families mesh_foreign_files mesh_objects mesh_refine polyhedral_refine polyhedral_validity"
    ),
    "plots": "animation plots plots_in_space",
    "problems": (
        "hard_cases hysteresis_patch lessons membrane_with_friction paper_figures problem_gallery "
        "problem_pictures problems_in_space reference_problems solver_accuracy spring_slider_chain two_body_problems"
    ),
    "program": "limits scales seminorm step_program",
    "results": "files foreign_files marks_and_moves outputs_wear",
    "scene": (
        "curved_and_rounded_sides dragged_contact interfaces meeting_parts parts_of_bodies space_contact supports"
    ),
    "solvers": "conformance_solvers discs",
    "stepping": (
        "coulomb_certificate ledger moving_ground programs resume slip_laws soft_limits threads_and_processes viscosity"
    ),
    "unit": "cli_app",
    "vem": "stabilisation_spectrum",
    "whole": "any_scene contributing independent_bodies independent_programs properties site structure wrong_kinds",
}
"""Test files, by folder, that take longer than a few seconds; all other files form the quick tier."""


def longer(path: Path) -> bool:
    """Return True if a file of tests is in `LONGER`."""
    return path.stem.removeprefix("test_") in LONGER.get(path.parent.name, "").split()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip the files in `LONGER` if only quick tests run, because collecting these files takes time."""
    return True if config.getoption("markexpr") == "quick" and longer(collection_path) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Add the marks `slow` and `quick`, and remove the mark `long` from cases marked `slow`.

    All other tests marked `long` become `slow`. Tests outside `LONGER` without the mark `slow` become `quick`.
    """
    for item in items:
        if item.get_closest_marker("slow"):
            item.own_markers = [mark for mark in item.own_markers if mark.name != "long"]
        elif item.get_closest_marker("long"):
            item.add_marker("slow")
        if item.get_closest_marker("slow") is None and not longer(item.path):
            item.add_marker("quick")


def pytest_collection_finish() -> None:
    """Enable the garbage collector again."""
    gc.enable()


@pytest.fixture(params=FAMILIES)
def family(request: pytest.FixtureRequest) -> str:
    """Return the name of a mesh family; a test with this fixture runs once per family."""
    return request.param
