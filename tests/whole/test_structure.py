"""The structure of the package: order of packages, no circular imports, heavy packages in few files, line budgets."""

from __future__ import annotations

import ast
import gc
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import vemcvx

ROOT = Path(vemcvx.__file__).parent
PACKAGES = (
    *("meshes", "vem", "effects", "linear", "program", "exchange", "scene", "solvers", "stepping", "results", "plots"),
    *(
        "history",
        "bound",
        "simulation",
        "sensitivity",
        "limit_analysis",
        "testing",
        "estimate",
        "cost",
        "cli",
        "__main__",
    ),
)
"""Packages and modules in the order of CONTRIBUTING.md. Each package imports only earlier packages and `base`."""
APART = {"linear", "program", "exchange"}, {"meshes", "vem", "effects"}
"""Two groups of packages. Neither group imports the other group."""
HEAVY = {
    "cvxpy": {"program/cvxpy_step.py", "program/step_program.py", "solvers/conic.py", "limit_analysis/limit_load.py"},
    "matplotlib": {"base/canvas.py"},
    "meshio": {"meshes/io/blocks.py", "meshes/io/gmsh.py", "meshes/io/nastran.py"},
    "skfem": {"meshes/io/objects.py"},
    "pyvista": {"meshes/io/objects.py", "plots/body.py"},
    "shapely": {
        "meshes/polygons.py",
        "meshes/checks/plane.py",
        "meshes/checks/space.py",
        "meshes/several_bodies.py",
        "meshes/overlay.py",
    },
    "pandas": {"results/tables.py"},
    "xarray": {"results/tables.py"},
}
"""Heavy packages, and the only files that may import them."""

LINES = {"program": 1_976, "solvers": 1_225, "stepping": 1_652, "linear": 887, "scene": 1_744, "effects": 2_120}
LINES |= {"exchange": 646, "testing": 905, "cli/collection": 952}
LINES |= {"bound": 2_595, "results": 2_402, "estimate": 1_752, "plots": 1_701}
LINES |= {"limit_analysis": 398}
LINES |= {"sensitivity": 794, "cost": 486, "cli": 2_911}
LINES |= {"meshes": 5_613, "meshes/io": 1_308, "vem": 1_764}
"""Largest number of lines of each folder."""
TOP = 1_702
"""Largest number of lines of top modules and `base`, without base/canvas.py."""
TESTS = 18_045
"""Largest number of lines of tests for the folders in `LINES`."""
ALL_TESTS = 28_000
"""Largest number of lines of all tests."""
PACKAGE = 33_400
"""Largest number of lines of the package."""

LATE = {"vemcvx.meshes.mesh"}
"""Modules whose methods import later modules."""


@cache
def modules():
    """Return name -> path of every module; the path of a package is its __init__.py."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = ("vemcvx", *path.relative_to(ROOT).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def nodes(path, kind):
    """Return the syntax nodes of a kind in a file."""
    return [node for node in parse(path) if isinstance(node, kind)]


@cache
def parse(path):
    """Return all syntax nodes of a file."""
    gc.disable()
    found = list(ast.walk(ast.parse(path.read_text())))
    gc.enable()
    return found


def list_imports(path, checking=True, late=True):
    """Yield the imported modules. `checking` includes imports for types, `late` includes imports in functions."""
    guards = [] if checking else [node for node in nodes(path, ast.If) if "TYPE_CHECKING" in ast.unparse(node.test)]
    guards = guards if late else [*guards, *nodes(path, ast.FunctionDef)]
    apart = {id(node) for guard in guards for node in ast.walk(guard)}
    for node in nodes(path, ast.Import | ast.ImportFrom):
        if id(node) in apart:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            assert not node.level, f"{path}: relative import; write it out"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in modules() else node.module for name in inner)


@cache
def imports():
    """Return module -> imported modules of the package."""
    found = {name: list_imports(path, name not in LATE, name not in LATE) for name, path in modules().items()}
    return {name: set(others) & set(modules()) - {name} for name, others in found.items()}


def package_of(name):
    """Return the package, or top module, of a module."""
    return name.split(".")[1] if "." in name else name


def test_packages_import_earlier_packages_only():
    order = ["base", *PACKAGES]
    for name, others in imports().items():
        own = package_of(name)
        for other in set(map(package_of, others)) - {own} if own != "vemcvx" else ():
            assert other in order, f"{name} imports {other}, which is not in PACKAGES"
            assert order.index(other) < order.index(own), f"{name} imports {other}"
            assert not any({own} <= one and {other} <= two for one in APART for two in APART if one != two), name


def assert_no_circle(graph):
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        raise AssertionError(" <- ".join(circle.args[1])) from None


def test_imports_of_modules_are_not_circular():
    assert_no_circle(imports())


def test_heavy_packages_are_imported_in_few_files():
    for path in modules().values():
        for package in {other.split(".")[0] for other in list_imports(path, checking=False)} & set(HEAVY):
            assert path.relative_to(ROOT).as_posix() in HEAVY[package], f"{path} imports {package}"


def test_only_meshes_and_vem_depend_on_the_dimension():
    for name, path in modules().items():
        if package_of(name) not in ("meshes", "vem"):
            found = re.findall(r"\b(?:dim|shape\[-?1\])\s*[=!<>]=?\s*[236]\b", path.read_text())
            assert not found, f"{name}: {found}"


@pytest.mark.parametrize(("name", "most"), {"README": 150, "CONTRIBUTING": 200, "CHANGELOG": 100}.items())
def test_texts_are_short(name, most):
    assert len((ROOT.parent / f"{name}.md").read_text(encoding="utf-8").splitlines()) <= most


def test_files_are_short():
    assert {name for name, path in modules().items() if path.read_text().count("\n") > 650} == set()


def test_long_calls_name_their_arguments():
    for path in modules().values():
        for node in nodes(path, ast.Call):
            few = len(node.args) <= 5 or ast.unparse(node.func).startswith("log.")
            assert few, f"{path}:{node.lineno}: {len(node.args)} positional arguments"


@pytest.mark.parametrize("folder", [*LINES, "top"])
def test_folders_keep_their_lines(folder):
    top = [path for path in [*ROOT.glob("*.py*"), *(ROOT / "base").glob("*.py")] if path.name != "canvas.py"]
    paths = top if folder == "top" else [*(ROOT / folder).rglob("*.py")]
    paths += [ROOT / "base" / "canvas.py"] if folder == "plots" else []
    lines, most = sum(len(path.read_text().splitlines()) for path in paths), (LINES | {"top": TOP})[folder]
    assert lines <= most, f"{folder} has {lines} lines, {most} are allowed: cut some, or raise the number"


def test_the_package_keeps_its_lines():
    assert sum(len(path.read_text().splitlines()) for path in modules().values()) <= PACKAGE


def test_tests_keep_their_lines():
    paths = [path for folder in LINES for path in (Path(__file__).parents[1] / folder).rglob("*.py")]
    assert sum(len(path.read_text().splitlines()) for path in paths) <= TESTS
    every = Path(__file__).parents[1].rglob("*.py")
    assert sum(len(path.read_text().splitlines()) for path in every) <= ALL_TESTS


PRIVATE = re.compile(r"^from vemcvx\S* import (?:\w+, )*_[a-z]|^    _\w+,$", re.MULTILINE)
"""Pattern of imports of private names."""


def test_tests_outside_tests_unit_import_no_private_names():
    paths = [path for path in Path(__file__).parents[1].rglob("test_*.py") if path.parent.name != "unit"]
    assert [path for path in paths if PRIVATE.search(path.read_text())] == []


@pytest.mark.long
def test_importing_the_package_imports_nothing_heavy():
    heavy = {*HEAVY, "clarabel", "osqp", "typer", "rich", "numpy", "scipy"}
    code = f"import sys, vemcvx; print({heavy} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
