"""Every problem file runs in seconds and is drawn; every effect has a problem that shows it."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import texts
from pages import assert_drawn_within_the_page

import gallery
from vemcvx import effects
from vemcvx.effects import Effect

ROOT = Path(gallery.__file__).parent.parent
ALONE = ("feng_han_huang", "liner_in_housing")
"""Problems that the default tests run as a single file in an empty folder."""
FORMAL = {"manufactured_full_slip"}
"""Problems whose runs warn about large strains."""
matplotlib = pytest.importorskip("matplotlib")


@pytest.mark.long
@pytest.mark.parametrize("name", gallery.problem_files())
def test_every_problem_runs_in_its_small_setting_and_is_drawn_within_the_page(name, caplog):
    problem = import_module(name)
    history = gallery.small_run(problem)
    assert history.certificate.max() <= getattr(problem, "SMALL", {}).get("accuracy", 1e-8)
    assert history.displacement[0].size < 20_000
    assert history.iterations.sum() < 5_000
    says_so = "a run warns about" in " ".join(problem.__doc__.split())
    assert ("strains are not small" in caplog.text) == (name in FORMAL) == says_so
    drawn = ROOT / "problems" / "pictures" / f"{name}.png"
    assert 5_000 < drawn.stat().st_size < 250_000, "run problems/gallery.py"
    if history.mesh.points.shape[1] == 3:
        pytest.importorskip("pyvista")
    assert_drawn_within_the_page(gallery.picture(problem, history))


def test_every_effect_has_a_problem_that_shows_it():
    lines = re.findall(r"^\| `(\w+)` \|.*\| \[`(\w+)`\]\(gallery/\2\.md\) \|$", texts.page("effects"), re.M)
    kinds = [kind for kind in vars(effects).values() if isinstance(kind, type) and issubclass(kind, Effect)]
    wanted = {kind.__name__ for kind in kinds if kind.__name__ in effects.__all__} - {"Effect", "MaterialLaw"}
    assert sorted(effect for effect, _ in lines) == sorted(wanted)
    for effect, problem in lines:
        scene = import_module(problem).scene()
        assert any(type(part).__name__ == effect for part in scene), (effect, problem)


@pytest.mark.parametrize("name", gallery.problem_files())
def test_a_problem_file_imports_no_other_problem_file(name):
    tree = ast.parse((ROOT / "problems" / f"{name}.py").read_text())
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    modules |= {one.name for node in ast.walk(tree) if isinstance(node, ast.Import) for one in node.names}
    assert {module.partition(".")[0] for module in modules} <= {"numpy", "scipy", "vemcvx", "matplotlib", "dataclasses"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in ALONE else pytest.mark.long) for name in gallery.problem_files()]
)
def test_a_problem_file_runs_alone_in_an_empty_folder(name, tmp_path):
    """Start a new process, without the folder of problems in sys.path."""
    shutil.copy(ROOT / "problems" / f"{name}.py", tmp_path)
    problem = import_module(name)
    steps = ["--steps", "2"] if hasattr(problem, "times") else []
    options = ["run", f"{name}.py", "--n", str(problem.SMALL["n"]), *steps, "--accuracy", "1e-5"]
    run = subprocess.run([sys.executable, "-m", "vemcvx", *options], capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(f"{name}: {gallery.title(name).removesuffix('.')[:40]}")
