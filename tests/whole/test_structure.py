"""The shape of the package: what may know what, no circles of imports, heavy packages behind a door or two."""

from __future__ import annotations

import ast
import gc
import importlib
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import vemcvx

ROOT = Path(vemcvx.__file__).parent
GROUND = ["base"]
PAGE = {
    "meshes": "polygons or polyhedra that tile a domain, families of them, local refinement, mesh files",
    "vem": "the virtual element space, its matrices, loads and strains",
    "effects": "the physics that a scene can name, each turned into arrays",
    "linear": "factorisations behind one seam",
    "program": "a step as a convex program: condensed, scaled, certified; it knows no mesh",
    "exchange": "programs as files",
    "scene": "effects on a mesh, put together into a system",
    "solvers": "answers to a step's program",
    "stepping": "backward Euler: pose, answer, certify, record",
    "results": "what a run leaves, in the words of contact",
    "plots": "pictures and films of results",
    "history": "results and all that can be asked of them",
    "bound": "guaranteed bounds on the error",
    "simulation": "from a scene to results",
    "testing": "what every solver and every effect must satisfy, for those of one's own",
    "estimate": "distances to other runs, estimated errors, adaptivity",
    "cost": "what accuracy costs",
    "cli": "the command line",
    "__main__": "python -m vemcvx",
}
"""From the ground up: each may import what stands above it here, and the ground below all (`GROUND`)."""
APART = {"linear", "program", "exchange"}, {"meshes", "vem", "effects"}
"""Mechanics of programs on the one hand, of meshes on the other: neither knows the other; `scene` joins them."""
HEAVY = {
    "cvxpy": {"program/cvxpy_step.py", "program/kernel.py", "program/step_program.py", "solvers/conic.py"},
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


LINES = {"program": 2_321, "solvers": 1_433, "stepping": 1_800, "linear": 940, "scene": 2_015, "effects": 2_403}
LINES |= {"exchange": 709, "testing": 1_042, "cli/collection": 1_172}
LINES |= {"bound": 3_273, "results": 2_849, "estimate": 2_286, "plots": 2_122}
LINES |= {"cost": 682, "cli": 3_753}
LINES |= {"meshes": 7_563, "meshes/io": 1_548, "vem": 2_585}
"""Most lines of folders: they grow by decision only, which raises a number here."""
TOP = 1_807
"""Most lines of the modules at the top and of what all may use, without the canvas, which counts with the plots."""
TESTS = 27_753
"""Most lines of the tests of `LINES`, in the folders of their names."""

ALL_TESTS = 40_300
"""Most lines of all tests, of which 28,000 are wanted."""

LATE = {"vemcvx.meshes.mesh"}
"""Modules whose classes have methods that lead to modules above: these are imported when the methods are called."""


@cache
def modules():
    """name -> path of every module; a package is called by its own name."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = ("vemcvx", *path.relative_to(ROOT).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def nodes(path, kind):
    """The nodes of a kind in the syntax of a file; a file is parsed once."""
    return [node for node in parsed(path) if isinstance(node, kind)]


@cache
def parsed(path):
    """All nodes in the syntax of a file; among a million of them the collector finds no garbage."""
    gc.disable()
    found = list(ast.walk(ast.parse(path.read_text())))
    gc.enable()
    return found


def imported(path, checking=True, late=True):
    """Names of modules that a file imports, anywhere in it; for type checking and in functions, unless told not to."""
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
    """name -> names of our own modules that it imports; of `LATE` those that it imports when it is imported."""
    found = {name: imported(path, name not in LATE, name not in LATE) for name, path in modules().items()}
    return {name: set(others) & set(modules()) - {name} for name, others in found.items()}


def part(name):
    """The package, or single module, that a module belongs to."""
    return name.split(".")[1] if "." in name else name


def test_a_part_knows_only_what_stands_above_it_on_the_page():
    order = [*GROUND, *PAGE]
    for name, others in imports().items():
        own = part(name)
        for other in set(map(part, others)) - {own} if own != "vemcvx" else ():
            assert other in order, f"{name} imports {other}, which is on no line of the page"
            assert order.index(other) < order.index(own), f"{name} imports {other}"
            assert not any({own} <= one and {other} <= two for one in APART for two in APART if one != two), name


def test_no_module_leads_back_to_itself():
    try:
        TopologicalSorter(imports()).prepare()
    except CycleError as circle:
        raise AssertionError(" <- ".join(circle.args[1])) from None


def test_no_folder_leads_back_to_itself():
    """Folders inside packages, too: `meshes/io`, `meshes/families` ...; a module on its own stands for itself."""

    def folder(name):
        return name if modules()[name].name == "__init__.py" else name.rpartition(".")[0] or name

    below = {}
    for name, others in imports().items():
        for other in others:
            one, two = folder(name), folder(other)
            if one != two and not one.startswith(f"{two}.") and not two.startswith(f"{one}."):
                below.setdefault(one, set()).add(two)
    try:
        TopologicalSorter(below).prepare()
    except CycleError as circle:
        raise AssertionError(" <- ".join(circle.args[1])) from None


def test_heavy_packages_have_their_doors():
    for path in modules().values():
        for package in {other.split(".")[0] for other in imported(path, checking=False)} & set(HEAVY):
            assert path.relative_to(ROOT).as_posix() in HEAVY[package], f"{path} imports {package}"


def test_only_meshes_and_virtual_elements_ask_for_the_dimension():
    for name, path in modules().items():
        if part(name) not in ("meshes", "vem"):
            asked = re.findall(r"\b(?:dim|shape\[-?1\])\s*[=!<>]=?\s*[236]\b", path.read_text())
            assert not asked, f"{name}: {asked}"


@pytest.mark.parametrize(("name", "most"), {"README": 150, "CONTRIBUTING": 200, "CHANGELOG": 100}.items())
def test_texts_are_read_in_one_sitting(name, most):
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
    assert lines <= most, f"{folder} has {lines} lines, {most} are decided: cut some, or raise it by what is new"


def test_tests_of_these_folders_keep_their_lines():
    paths = [path for folder in LINES for path in (Path(__file__).parents[1] / folder).rglob("*.py")]
    assert sum(len(path.read_text().splitlines()) for path in paths) <= TESTS
    every = Path(__file__).parents[1].rglob("*.py")
    assert sum(len(path.read_text().splitlines()) for path in every) <= ALL_TESTS


SUSPECT = re.compile(r"monkeypatch\.setattr|^ *from vemcvx\b.*\b_|^    _\w+,$", re.MULTILINE)


def uses_internals(path):
    """Whether a file of tests imports names with an underscore, or replaces something in a module of ours."""
    if not SUSPECT.search(path.read_text()):
        return False
    found = [node for node in nodes(path, ast.ImportFrom) if (node.module or "").split(".")[0] == "vemcvx"]
    ours = {alias.asname or alias.name for node in found for alias in node.names} | {"vx"}
    for node in nodes(path, ast.Call):
        if ast.unparse(node.func).endswith("monkeypatch.setattr"):
            place = ast.unparse(node.args[0])
            if place.startswith("'vemcvx") or re.split(r"\W", place.removeprefix("type("))[0] in ours:
                return True
    return any(alias.name.startswith("_") for node in found for alias in node.names)


INTERNALS = {
    "cli/test_cli.py",
    "cli/test_cli_collection.py",
    "cli/test_cli_report.py",
    "cli/test_cli_said.py",
    "cli/test_cli_space.py",
    "cli/test_cli_supplied.py",
    "cli/test_cli_typed.py",
    "cost/test_cost.py",
    "effects/test_absence.py",
    "estimate/test_error_budget_in_space.py",
    "plots/test_animation.py",
    "results/test_foreign_files.py",
}
"""Files outside `tests/unit` that use internals yet: none is to be added."""


def test_tests_of_internals_stand_in_their_folder():
    tests = Path(__file__).parents[1]
    found = {path.relative_to(tests).as_posix() for path in tests.rglob("test_*.py") if path.parent.name != "unit"}
    assert {name for name in found if uses_internals(tests / name)} <= INTERNALS


def test_names_of_functions_hide_no_modules():
    for name, path in modules().items():
        # A picture is a file with one function of its name.
        if path.name == "__init__.py" and name != "vemcvx.plots":
            package = __import__(name, fromlist=["_"])
            hidden = [
                m for m in modules() if m.rpartition(".")[0] == name and callable(vars(package).get(m.split(".")[-1]))
            ]
            assert not hidden, f"{hidden[0]} cannot be reached: a function of {name} has its name"


@pytest.mark.long
def test_importing_the_package_imports_nothing_heavy():
    heavy = {*HEAVY, "clarabel", "osqp", "typer", "rich", "numpy", "scipy"}
    code = f"import sys, vemcvx; print({heavy} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_everything_exported_exists():
    for name in vemcvx.__all__:
        assert getattr(vemcvx, name).__doc__ or name == "__version__", name


def exists(name):
    """Whether a dotted name leads to a module, or to something in one, fields of records included."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        if (module := ".".join(parts[:k])) in modules():
            found = importlib.import_module(module)
            for part in parts[k:-1]:
                found = getattr(found, part)
            fields = [key for kind in getattr(found, "__mro__", ()) for key in getattr(kind, "__annotations__", ())]
            return k == len(parts) or hasattr(found, parts[-1]) or parts[-1] in fields
    return False


def test_what_docstrings_refer_to_exists():
    for name, path in modules().items():
        text = path.read_text()
        beside = [f"{name.rpartition('.')[0]}.{to}" for to in re.findall(r":mod:`\.(\w+)`", text)]
        lost = [to for to in beside if to not in modules() and f"{name}.{to.rpartition('.')[2]}" not in modules()]
        named = re.findall(r":\w+:`~?(\w[\w.]*)`", text)
        lost += [to for to in named if not exists(to if to.startswith("vemcvx") else f"{name}.{to}")]
        assert lost == [], path


@cache
def kinds():
    """Names of all classes and aliases of types in the package."""
    words = {"None", "ArrayLike", "Axes", "Figure", "Path"}
    for path in modules().values():
        words |= {node.name for node in nodes(path, ast.ClassDef)}
        words |= set(re.findall(r"^([A-Z]\w+) = ", path.read_text(), flags=re.MULTILINE))
    return words


def test_types_of_documented_parameters_exist():
    for path in modules().values():
        documented = re.findall(r"^    +\w+(?:, \w+)* : ([A-Z][a-z]\w+)", path.read_text(), flags=re.MULTILINE)
        assert set(documented) <= kinds(), path
