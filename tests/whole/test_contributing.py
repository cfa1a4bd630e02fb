"""Follow the recipes of CONTRIBUTING.md and its pages word for word: an effect, a family of meshes, a solver."""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import numpy as np
import pytest
from scenes import paper_scene
from test_structure import PACKAGES
from texts import CONTRIBUTING, blocks, file, page
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.scene import pose_scene
from vemcvx.testing import linear_suite

ROOT = Path(__file__).parents[2]
TEXT, EFFECT_PAGE, SOLVER_PAGE = CONTRIBUTING.read_text(), page("howto/own_effect"), page("howto/own_solver")
BLOCKS = blocks(EFFECT_PAGE, "python") + blocks(page("howto/own_mesh_family"), "python")
NAMES = {i: found[1] for i, text in enumerate(BLOCKS) if (found := re.match(r"# (\S+)\n", text))}
FILES = {name: BLOCKS[i] for i, name in NAMES.items()} | {"mine.py": file(SOLVER_PAGE, "mine.py")}
LINES = {name: BLOCKS[i + 1] for i, name in NAMES.items()} | {"mine.py": file(SOLVER_PAGE, "test_mine.py")}
ROBIN_SAMPLE, ROBIN_GIVEN = (block for block in blocks(TEXT, "text") if "vx.Robin" in block or '"support"' in block)
"""Each recipe has its own page, with a file, whose first line is its path, and a line of code. A new effect also needs
two entries in tests, which CONTRIBUTING.md shows."""


def test_the_page_names_every_package_in_its_order_and_its_links_lead_somewhere():
    assert re.findall(r"^\| `vemcvx/(\w+)(?:\.py)?` \|", TEXT, re.MULTILINE) == list(PACKAGES)[:-1]
    for target in re.findall(r"\]\(([^)#]+)\)", re.sub(r"```.*?```", "", TEXT, flags=re.DOTALL)):
        assert (ROOT / target).exists(), target


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A function that adds the file of a recipe to the package for one test, and returns the names its line defines."""

    def make(path):
        name = path.removesuffix(".py").replace("/", ".")
        file = tmp_path / Path(path).name
        file.write_text(FILES[path])
        spec = importlib.util.spec_from_file_location(name, file)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
        known = dict(vars(module))
        if LINES[path].startswith("from"):
            exec(LINES[path], known)
            return known
        return eval(f"{{{LINES[path]}}}", known)

    return make


def test_an_effect_in_one_file_and_a_line(made):
    """A bar on rollers between a fixed end and springs whose support moves by U t: u = k U t / (M + k) (1 - x)."""
    Robin = made("vemcvx/effects/robin.py")["Robin"]
    k, young, poisson, U = 3.0, 10.0, 0.3, 0.01
    M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    scene = vx.Scene(
        vx.Elasticity(young, poisson),
        vx.Symmetry(on=["right", "bottom", "top"]),
        Robin(k, lambda x, t: np.tile([U * t, 0.0], (len(x), 1)), on="left"),
    )
    history = vx.simulate(scene, vx.meshes.voronoi(6), [0.0, 0.5, 1.0])
    exact = np.outer(history.times, k * U / (M + k) * (1 - history.mesh.points[:, 0]))
    assert np.abs(history.displacement[..., 0] - exact).max() < 1e-12 * U
    assert np.abs(history.displacement[..., 1]).max() < 1e-12 * U
    assert vx.error_budget(history).largest["total"] < 1e-12
    assert any(words.startswith("Robin: stiffness 3.0") for words in history.effects)


SAMPLE, BED = file(EFFECT_PAGE, "test_slip_weakening.py"), file(EFFECT_PAGE, "contribute of a bed of springs")
LAW = file(page("howto/own_law"), "contribute of slip weakening")


def test_the_law_on_the_page_is_in_its_problem_file():
    assert LAW in (ROOT / "problems" / "slip_weakening.py").read_text()


def test_a_bed_of_springs_is_normal_compliance():
    known = dict(vars(importlib.import_module("vemcvx.effects.contact")))
    exec(dedent(BED), known)

    @dataclass(frozen=True)
    class Bed(vx.Effect):
        stiffness: float
        gap: float
        on: str
        contribute = known["contribute"]

        def describe(self):
            return "a bed of springs"

    def pressed(contact):
        scene = vx.Scene(vx.Elasticity(10.0, 0.3), vx.Clamp(on="top"), vx.CoulombFriction(0.3, on="bottom"), contact)
        pull = vx.Traction(lambda x, t: np.tile([t, -3.0 * t], (len(x), 1)), on="left")
        return vx.simulate(vx.Scene(*scene, pull), vx.meshes.squares(4), [0.0, 1.0], initial="settled")

    own, ours = pressed(Bed(5.0, -0.01, "bottom")), pressed(vx.NormalCompliance(5.0, "bottom", -0.01))
    assert ours.contact.pressure[-1].max() > 0
    assert np.array_equal(own.displacement, ours.displacement)


def effect_cases():
    """Return the cases of the suite that the page runs for a user's effect."""
    known = {"np": np, "vx": vx}
    exec(SAMPLE, known)
    (mark,) = (mark for mark in known["test_slip_weakening"].pytestmark if mark.name == "parametrize")
    return {case.id: case.values[0] for case in mark.args[1]}


EFFECT = effect_cases()
DEAR = "changes_the_answer_by_each_of_its_settings", "does_not_depend_on_its_place_in_the_scene"


@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.long if case.endswith(DEAR) else ()) for case in EFFECT]
)
def test_an_effect_of_forty_lines_passes_the_suite_first_time(case):
    EFFECT[case]()


def test_a_family_of_meshes_in_one_file_and_a_line(made, monkeypatch):
    for name, family in made("vemcvx/meshes/families/bricks.py").items():
        monkeypatch.setitem(vx.meshes.FAMILIES, name, family)
    mesh = vx.meshes.FAMILIES["bricks"](4, box=((0.0, 1.5), (-1.0, 0.0)))
    # The constructor checks what the family does not check.
    assert vx.PolygonMesh(mesh.points, mesh.cells).n_cells == mesh.n_cells == 26
    assert set(mesh.boundaries) == {"left", "right", "bottom", "top", "boundary"}
    assert mesh.areas.sum() == pytest.approx(1.5, rel=1e-14)
    G = np.array([[0.01, -0.02], [0.03, 0.015]])
    scene = vx.Scene(vx.Elasticity(7.0, 0.3), vx.PrescribedDisplacement(lambda x, t: t * x @ G.T, on="boundary"))
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] - mesh.points @ G.T).max() < 1e-13


@pytest.fixture(scope="module")
def contributed(tmp_path_factory):
    """A copy of the package and its tests to which the effect and the family were added as the page says."""
    root = tmp_path_factory.mktemp("contributed")
    for name in ("vemcvx", "tests", "problems", "docs", ".ci"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    for path in [*ROOT.glob("*.md"), ROOT / "pyproject.toml"]:
        shutil.copy(path, root)

    def insert(path, where, text):
        before, found, after = (root / path).read_text().partition(where)
        assert found, (path, where)
        (root / path).write_text(f"{before}{found}{text}{after}")

    for path in ("vemcvx/effects/robin.py", "vemcvx/meshes/families/bricks.py"):
        (root / path).write_text(FILES[path])
    insert("vemcvx/effects/__init__.py", '"""\n\n', LINES["vemcvx/effects/robin.py"])
    insert("vemcvx/effects/__init__.py", "__all__ = [", '"Robin", ')
    insert("vemcvx/__init__.pyi", '"""\n\n', "from .effects import Robin as Robin\n")
    insert("tests/effects/test_conformance_effects.py", "SAMPLES = {\n", ROBIN_SAMPLE)
    in_space = ROBIN_SAMPLE.replace("(0.0, 0.0)", "(0.0, 0.0, 0.0)").replace('"support": 2', '"support": 3')
    insert("tests/effects/test_conformance_in_space.py", "SAMPLES = {\n", in_space)
    insert("tests/whole/test_wrong_kinds.py", "GIVEN = {\n", ROBIN_GIVEN)
    insert("vemcvx/meshes/__init__.py", '"""\n\n', "from vemcvx.meshes.families.bricks import bricks\n")
    insert("vemcvx/meshes/__init__.py", "\nFAMILIES = {", LINES["vemcvx/meshes/families/bricks.py"])
    insert("vemcvx/meshes/__init__.py", "__all__ = [", '"bricks", ')
    return root


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    [
        ["-k", "Robin or missing or permutation or valid", "tests/effects", "tests/whole/test_wrong_kinds.py"],
        ["-m", "slow", "-k", "Robin", "tests/whole/test_wrong_kinds.py"],
        ["-k", "bricks or missing", "tests", "--ignore", "tests/whole"],
        ["-m", "slow", "-k", "bricks", "tests/estimate", "tests/problems", "tests/meshes"],
    ],
    ids=["effect", "wrong kinds", "family", "orders of the family"],
)
def test_the_contribution_passes_the_existing_tests(contributed, asked):
    command = [sys.executable, "-m", "pytest", "-q", "-x", *asked]
    run = subprocess.run(
        command, cwd=contributed, env={**os.environ, "PYTHONPATH": "."}, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-1000:]


def test_the_table_of_effects_has_a_row_for_each():
    rows = set(re.findall(r"^\| `(\w+)` \| .* \| \[`\w+`\]\(gallery/\w+\.md\) \|$", page("effects"), re.MULTILINE))
    exported = {name for name in vx.effects.__all__ if isinstance(getattr(vx.effects, name), type)}
    concrete = {name for name in exported if not inspect.isabstract(getattr(vx.effects, name))}
    assert rows == {name for name in concrete if issubclass(getattr(vx.effects, name), vx.Effect)}


@pytest.fixture
def mine(tmp_path):
    """The file of the recipe's solver."""
    (tmp_path / "mine.py").write_text(FILES["mine.py"])
    return tmp_path / "mine.py"


@pytest.fixture
def fista(mine):
    """The class of the recipe, unchanged."""
    known = {}
    exec(compile(FILES["mine.py"], str(mine), "exec"), known)
    return known["Fista"]


def test_a_solver_is_a_class_of_25_lines(fista):
    source = FILES["mine.py"]
    assert source[source.index("class ") :].count("\n") <= 25
    assert fista.__mro__ == (fista, object)


def suite(name):
    """Return the cases of the test in the recipe, with the recipe's file as the module `mine`."""
    known = {}
    sys.modules["mine"] = module = ModuleType("mine")
    exec(FILES["mine.py"], vars(module))
    exec(LINES["mine.py"], known)
    del sys.modules["mine"]
    (test,) = (thing for key, thing in known.items() if key.startswith("test_"))
    return {case.id: case.values[0] for case in test.pytestmark[0].args[1]}


SUITE = suite("fista")


ENDLESS = "answers_if_the_gap_is_below_rounding"
"""The property for which the recipe's solver needs all of its iterations."""


def takes(key):
    """Return a case of the suite, marked by its run time."""
    if key.endswith(ENDLESS):
        return pytest.param(key, marks=pytest.mark.slow)
    is_quick = ": plain matrices: " in key or key.count(":") == 1
    is_long = not is_quick or key.endswith(("within_both_certificates", "gives_the_same_answer_twice"))
    return pytest.param(key, marks=pytest.mark.long) if is_long else key


@pytest.mark.parametrize("case", [takes(key) for key in SUITE])
def test_it_passes_the_suite_first_time(case):
    SUITE[case]()


def dense():
    """Return the recipe's linear solver."""
    known = {"__name__": "dense"}
    exec(file(SOLVER_PAGE, "dense.py"), known)
    return known["Dense"]()


test_a_linear_solver_of_25_lines_passes_its_suite = pytest.mark.long(linear_suite(dense()))


@pytest.mark.long
def test_it_is_compared_first_time(mine):
    problem = str(ROOT / "problems" / "feng_han_huang.py")
    command = ["compare", problem, "--n", "6", "--steps", "4", "--solvers", f"newton,{mine}:Fista"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    (line,) = (line.split() for line in done.output.splitlines() if line.startswith("Fista"))
    assert (line[1], line[4], line[7]) == ("own", "yes", "yes")
    first, second = done.stderr.splitlines()
    assert re.fullmatch(r"1 of 2: Newton: certified to \S+ in \S+ s", first)
    assert second.startswith("2 of 2: Fista: certified to")


@pytest.mark.long
def test_answers_to_the_same_steps_are_as_near_as_certified(fista):
    """The distance of both answers is at most the sum of their certified errors over all steps."""
    scene, mesh, times = paper_scene(lambda t: np.sin(6 * t)), vx.meshes.voronoi(4), np.linspace(0.0, 1.0, 7)
    own, newton = (vx.simulate(scene, mesh, times, solver=solver) for solver in (fista(), vx.Newton()))
    assert own.certificate.max() <= 1e-6
    assert not own.contact.sticking[-1].all()
    A = pose_scene(scene, mesh).A
    apart = (own.displacement - newton.displacement).reshape(len(times), -1)
    distance = np.sqrt(np.einsum("ni,ni->n", apart, (A @ apart.T).T) / (2 * newton.energy.max()))
    allowed = sum(h.certificate_total[-1] + h.certificate_floor.sum() for h in (own, newton))
    assert distance.max() <= allowed < 1e-5
