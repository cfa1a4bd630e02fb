"""Follow the recipes of CONTRIBUTING.md and of linked pages: an effect, a family of meshes, a solver."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import numpy as np
import pytest
from scenes import long_cases
from test_structure import PACKAGES
from texts import CONTRIBUTING, blocks, files, page

import vemcvx as vx
from vemcvx.testing import linear_suite

ROOT = Path(__file__).parents[2]
TEXT, EFFECT_PAGE, SOLVER_PAGE = CONTRIBUTING.read_text(), page("howto/own_effect"), page("howto/own_solver")
BLOCKS = blocks(EFFECT_PAGE, "python") + blocks(page("howto/own_mesh_family"), "python")
NAMES = {i: found[1] for i, text in enumerate(BLOCKS) if (found := re.match(r"# (\S+)\n", text))}
FILES = {name: BLOCKS[i] for i, name in NAMES.items()} | {"mine.py": files(SOLVER_PAGE)["mine.py"]}
LINES = {name: BLOCKS[i + 1] for i, name in NAMES.items()} | {"mine.py": files(SOLVER_PAGE)["test_mine.py"]}
"""A recipe shows a file in a block that begins with the path. The next block adds the file to the package."""


def test_contributing_lists_packages_in_order():
    assert re.findall(r"^\| `vemcvx/(\w+)(?:\.py)?` \|", TEXT, re.MULTILINE) == list(PACKAGES)[:-1]


def test_the_walks_name_functions_and_classes_of_the_package():
    walks = re.search(r"### Walks\n.*?```text\n(.*?)```", TEXT, re.DOTALL)[1]
    for file, name in re.findall(r"^  (\S+)\.py +(\S+)", walks, re.MULTILINE):
        module = importlib.import_module(f"vemcvx.{file.replace('/', '.')}")
        assert hasattr(module, name.split(".")[0]), f"{file}.py has no {name}"


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Return a function that adds the file of a recipe to the package."""

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


def test_an_effect_in_one_file_and_one_line_has_the_solution_in_closed_form(made):
    """A bar of modulus M is fixed at x = 1. At x = 0, springs of stiffness k join it to a support that moves by U t."""
    Robin = made("vemcvx/effects/robin.py")["Robin"]
    k, young, poisson, U = 3.0, 10.0, 0.3, 0.01
    M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))  # modulus without lateral strain
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


SAMPLE, BED = files(EFFECT_PAGE)["test_slip_weakening.py"], files(EFFECT_PAGE)["contribute of a bed of springs"]
LAW = files(page("howto/own_law"))["contribute of slip weakening"]


def test_the_law_on_the_page_is_in_its_problem_file():
    assert LAW in (ROOT / "problems" / "slip_weakening.py").read_text()


def test_a_bed_of_springs_is_normal_compliance():
    """The method `contribute` on the page replaces the method of `NormalCompliance`."""
    known = dict(vars(importlib.import_module("vemcvx.effects.contact")))
    exec(dedent(BED), known)
    beds = vx.NormalCompliance, type("Bed", (vx.NormalCompliance,), {"contribute": known["contribute"]})
    steel, pull = vx.Elasticity(10.0, 0.3), vx.Traction(lambda x, t: np.tile([t, -3.0 * t], (len(x), 1)), on="left")
    parts, times = (steel, pull, vx.Clamp(on="top"), vx.CoulombFriction(0.3, on="bottom")), [0.0, 1.0]
    scenes = (vx.Scene(*parts, bed(5.0, "bottom", -0.01)) for bed in beds)
    ours, own = (vx.simulate(scene, vx.meshes.squares(4), times, initial="settled") for scene in scenes)
    assert ours.contact.pressure[-1].max() > 0
    assert np.array_equal(own.displacement, ours.displacement)


def make_suite(code, is_long, **modules):
    """Return the suite of a test file, with marks on its long cases."""
    known = {"np": np, "vx": vx}
    with pytest.MonkeyPatch.context() as patch:
        for name, source in modules.items():
            patch.setitem(sys.modules, name, ModuleType(name))
            exec(source, vars(sys.modules[name]))
        exec(code, known)
    (suite,) = (thing for key, thing in known.items() if key.startswith("test_"))
    return long_cases(suite, is_long)


EXPENSIVE = "changes_the_answer_by_each_of_its_settings", "does_not_depend_on_its_place_in_the_scene"
test_an_effect_of_forty_lines_passes_the_suite_first_time = pytest.mark.filterwarnings(
    "ignore:.*nothing holds the body in the normal direction"
)(make_suite(SAMPLE, lambda name: name.endswith(EXPENSIVE)))


def test_a_family_of_meshes_in_one_file_and_one_line_passes_the_patch_test(made, monkeypatch):
    for name, family in made("vemcvx/meshes/families/bricks.py").items():
        monkeypatch.setitem(vx.meshes.FAMILIES, name, family)
    mesh = vx.meshes.FAMILIES["bricks"](4, box=((0.0, 1.5), (-1.0, 0.0)))
    # The constructor of PolygonMesh checks the cells.
    assert vx.PolygonMesh(mesh.points, mesh.cells).n_cells == mesh.n_cells == 26
    assert set(mesh.boundaries) == {"left", "right", "bottom", "top", "boundary"}
    assert mesh.areas.sum() == pytest.approx(1.5, rel=1e-14)
    G = np.array([[0.01, -0.02], [0.03, 0.015]])
    scene = vx.Scene(vx.Elasticity(7.0, 0.3), vx.PrescribedDisplacement(lambda x, t: t * x @ G.T, on="boundary"))
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] - mesh.points @ G.T).max() < 1e-13


def test_the_solver_of_the_recipe_has_25_lines_and_no_base_class():
    definition = FILES["mine.py"][FILES["mine.py"].index("class ") :]
    assert definition.count("\n") <= 25
    assert definition.startswith("class Fista:")


def is_long_for_a_solver(name):
    is_quick = ": plain matrices: " in name or name.count(":") == 1
    slow = "within_both_certificates", "gives_the_same_answer_twice", "answers_if_the_gap_is_below_rounding"
    return not is_quick or name.endswith(slow)


test_a_solver_of_25_lines_passes_the_suite_first_time = make_suite(
    LINES["mine.py"], is_long_for_a_solver, mine=FILES["mine.py"]
)
DENSE = {"__name__": "dense"}
exec(files(SOLVER_PAGE)["dense.py"], DENSE)
test_a_linear_solver_of_25_lines_passes_its_suite = pytest.mark.long(linear_suite(DENSE["Dense"]()))
