"""The shape of the package: imports point backwards, heavy packages stay out, files stay short."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import vemcvx

ROOT = Path(vemcvx.__file__).parent
LAYERS = [
    ["errors", "version"],
    ["real", "canvas"],
    ["kinds"],
    ["owned"],
    ["meshes"],
    ["vem"],
    ["effects"],
    ["linear"],
    ["program/kernel", "program/rows", "program/ordering", "program/extended", "program/checks", "program/limits"],
    ["program/motion"],
    ["program/system", "program/form"],
    ["program/step_program", "program/scaling", "program/certificate", "program/condensation", "program/refinement"],
    ["scene/scene", "scene/supports"],
    ["scene/rigid", "scene/edges", "scene/freedom", "scene/composition"],
    ["scene/terms"],
    ["scene/obstacles", "scene/surface", "scene/void"],
    ["scene/contact_terms"],
    ["scene/pose"],
    ["solvers"],
    ["stepping/storage", "stepping/seminorm", "stepping/ledger", "stepping/acceptance", "stepping/fixed_point"],
    ["stepping/state"],
    ["stepping/backward_euler", "stepping/dragged"],
    ["stepping/viscous"],
    ["stepping/initial", "stepping/trajectory", "stepping/checkpoint"],
    ["stepping/recorder"],
    ["stepping/march"],
    ["results"],
    ["simulation"],
    ["estimate"],
    ["plots"],
    ["cost"],
    ["cli"],
    ["__main__"],
]
"""Packages as wholes, or module by module where a package has layers of its own."""
LAYERED = {"program": "system", "scene": "scene", "stepping": "march"}
"""These, and the last of the modules that each exports."""
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
HEAVY = {
    "cvxpy": "solvers/conic.py",
    "matplotlib": "canvas.py",
    "meshio": "meshes/io/files.py",
    "distributed": "cost/pool.py",
}


def modules():
    return sorted(
        path.relative_to(ROOT) for path in ROOT.rglob("*.py") if path.name != "__init__.py" or path.parent != ROOT
    )


def layer(parts):
    """The name in LAYERS of the module at these steps of a path, or of what a package exports."""
    head = parts[0]
    if head not in LAYERED:
        return head
    module = parts[1] if len(parts) > 1 and parts[1] != "__init__" else LAYERED[head]
    return f"{head}/{module}"


def imports(tree, everywhere):
    """Names imported when the module is (or anywhere in it), type checking aside."""
    guarded = {
        id(node)
        for test in ast.walk(tree)
        if isinstance(test, ast.If) and "TYPE_CHECKING" in ast.unparse(test.test)
        for node in ast.walk(test)
    }
    nodes = ast.walk(tree) if everywhere else tree.body
    for node in nodes:
        if id(node) in guarded:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


@pytest.mark.parametrize("path", modules(), ids=str)
def test_imports_point_backwards(path):
    own = layer(path.with_suffix("").parts)
    level = LEVEL[own]
    for name in imports(ast.parse((ROOT / path).read_text()), everywhere=False):
        assert not name.startswith("."), f"{path}: relative import {name}; write it out"
        parts = name.split(".")
        if parts[0] == "vemcvx" and len(parts) > 1 and (other := layer(parts[1:])) != own:
            assert LEVEL[other] < level or {other, own} <= set(LAYERS[level]), f"{path} imports {name}"


@pytest.mark.parametrize("path", modules(), ids=str)
def test_heavy_packages_have_one_door(path):
    for name in imports(ast.parse((ROOT / path).read_text()), everywhere=True):
        package = name.split(".")[0]
        if package in HEAVY:
            assert str(path) == HEAVY[package], f"{path} imports {package}; only {HEAVY[package]} may"


@pytest.mark.parametrize("path", modules(), ids=str)
def test_files_are_short(path):
    assert (ROOT / path).read_text().count("\n") <= 300


def test_importing_the_package_imports_nothing_heavy():
    heavy = {"cvxpy", "matplotlib", "meshio", "clarabel", "osqp", "scipy.spatial", "scipy.optimize"}
    code = f"import sys, vemcvx; print({heavy} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_everything_exported_exists():
    for name in vemcvx.__all__:
        assert getattr(vemcvx, name).__doc__, name
