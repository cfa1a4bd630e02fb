"""The core runs without its wings, and the wings import public names of the core.

The wings are bounds, estimates, costs, exchange of programs, plots and the command line. All else is the core.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest
from test_structure import modules, nodes, parse

ROOT = Path(__file__).parents[2]
WINGS = ("bound", "estimate", "cost", "exchange", "plots", "cli")
OPEN = (
    *("base", "history", "simulation", "meshes.polygons", "results.files", "stepping.course"),
    *("vem.elasticity", "vem.points_in_solids", "vem.projection", "vem.stabilisation", "vem.tensors"),
)
"""Modules in which every name without a leading underscore is public."""
EXCEPTIONS = {
    "effects": "data",
    "effects.effect": "amount where",
    "meshes": "plane_mesh",
    "meshes.bisection": "check_tetrahedra",
    "meshes.interfaces": "faces_of",
    "meshes.polyhedra": "list_faces",
    "program.condensation": "Condensation",
    "program.kernel": "balance_multipliers",
    "program.operators": "SYMMETRY_TOLERANCE energy_norm",
    "results.tables": "FILES",
    "scene.supports": "by_precedence resolve",
    "solvers.default": "BY_SIZE name_features",
    "solvers.solver": "ScaledSolver name_failures",
}
"""Private names that wings import. The list may shrink, but not grow."""


def is_wing(name):
    """Return True if a dotted name is a wing or lies in a wing."""
    return name.split(".")[1:2] != [] and name.split(".")[1] in WINGS


def list_public_names(module):
    """Return the names in `__all__` of a package, from its source."""
    for node in parse(modules()[module]):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)
    return []


def list_private_imports(path):
    """Yield the private names of the core that a file imports, without the prefix `vemcvx.`."""
    for node in nodes(path, ast.ImportFrom):
        if not node.module.startswith("vemcvx.") or is_wing(node.module):
            continue
        module = node.module.removeprefix("vemcvx.")
        for name in (alias.name for alias in node.names):
            is_open = module.startswith("base.") or module in OPEN or f"{module}.{name}" in OPEN
            is_private = name.startswith("_") and not name.startswith("__")
            if is_private or not (is_open or name in list_public_names(node.module)):
                yield f"{module}.{name}"


def test_wings_import_public_names_of_the_core():
    found = {name for wing in modules() if is_wing(wing) for name in list_private_imports(modules()[wing])}
    excepted = {f"{module}.{name}" for module, names in EXCEPTIONS.items() for name in names.split()}
    assert found <= excepted, sorted(found - excepted)


def test_the_core_imports_a_wing_in_one_function_only():
    """Only `simulate(bound=True)` and `python -m vemcvx` import wings."""
    doors = {
        (name, node.module)
        for name, path in modules().items()
        for node in nodes(path, ast.ImportFrom)
        if not is_wing(name) and is_wing(node.module)
    }
    assert doors == {
        ("vemcvx.__main__", "vemcvx.cli"),
        ("vemcvx.simulation", "vemcvx.bound.error_bound"),
    }


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    """Copy the package without its wings; return the folder of the copy."""
    root, package = tmp_path_factory.mktemp("core"), ROOT / "vemcvx"
    shutil.copytree(package, root / "vemcvx", ignore=lambda folder, _: WINGS if folder == str(package) else ())
    return root


def run(core, *command):
    """Run Python in the copy, and return its output."""
    environment = {**os.environ, "PYTHONPATH": str(core)}
    done = subprocess.run([sys.executable, *command], cwd=core, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    return done.stdout


EXAMPLE = """
    import numpy as np, vemcvx as vx
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)]), on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(4.0, on="bottom", while_closed=False),
    )
    mesh, times = vx.meshes.voronoi(8), np.linspace(0.0, 1.0, 5)
    history = vx.simulate(scene, mesh, times)
    print(vx.__file__, history.certified.max(), history.dissipated[-1], abs(history.displacement).max())
    history.write("out")
    assert np.array_equal(vx.read_history("out").displacement, history.displacement)
    try:
        vx.simulate(scene, mesh, times, bound=True)
    except ModuleNotFoundError as error:
        print(error.name)
"""


def test_a_scene_runs_without_the_wings(core):
    file, certified, dissipated, largest, missing = run(core, "-c", dedent(EXAMPLE)).split()
    assert file.startswith(str(core))
    assert float(certified) < 1e-6
    assert min(float(dissipated), float(largest)) > 0
    assert missing == "vemcvx.bound"
