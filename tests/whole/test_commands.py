"""Every command in README, CONTRIBUTING, the pages of the site and the lessons is run, from fresh environments.

Commands are indented lines, and what stands between backquotes, that begin with a program; the tests of the site run
blocks of the console. `HOW` has each command, word for word, so that a new one fails the first test until somebody says
here how it is run, or why not.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import pytest
import texts

ROOT = Path(__file__).parents[2]
TEXTS = [*texts.TEXTS, *sorted((ROOT / "problems" / "lessons").glob("*.py"))]
PROGRAM = r"(?:python3?|pip|vemcvx|meshio|ruff) \S|\. \.venv|mypy$|\.ci/\w+$"
SECONDS = 900


def commands():
    """Each command once, in the order of the texts."""
    found = []
    for path in TEXTS:
        text = re.sub(r"^# ?", "", path.read_text(), flags=re.MULTILINE) if path.suffix == ".py" else path.read_text()
        outside = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        found += re.findall(r"^ {4}(\S.*)$|`([^`\n]+)`", outside, re.MULTILINE)
    words = [line or span for line, span in found]
    return list(dict.fromkeys(word for word in words if re.match(PROGRAM, word)))


@dataclass(frozen=True)
class Not:
    """A command that is not run here, and why."""

    why: str


@dataclass(frozen=True)
class As:
    """A command with its placeholders filled in and the options that make it small, in an environment by its name."""

    words: str = ""
    env: str = "main"
    addopts: str = ""
    """Options of pytest that come from its own environment variable, PYTEST_ADDOPTS."""


PAPER = "problems/feng_han_huang.py"
FEW, LONG, ONE_SLOW = (
    "tests/vem/test_patch.py",
    "tests/meshes/test_mesh_refine.py",
    "tests/cost/test_cost.py -k two_materials",
)
HOW = {
    # README and the pages
    'python3 -m venv .venv && .venv/bin/pip install -q ".[plot]" && .venv/bin/vemcvx run problems/feng_han_huang.py '
    "--mesh voronoi --n 24 --steps 64 --solver clarabel --out results/feng_han_huang --plot": As(),
    'python3 -m venv .venv && .venv/bin/pip install -q -e ".[plot,test]" && .venv/bin/python -m pytest -n 2': As(
        addopts=FEW
    ),
    ". .venv/bin/activate": As(". .venv/bin/activate && vemcvx --version"),
    "vemcvx run FILE": As(f"vemcvx run {PAPER}"),
    "vemcvx show FILE": As(f"vemcvx show {PAPER}"),
    "vemcvx compare FILE": As(f"vemcvx compare {PAPER}"),
    "vemcvx export FILE --steps 3,17": As(f"vemcvx export {PAPER} --steps 3,17"),
    "vemcvx collection --out DIR": As("vemcvx collection --out results/collection"),
    "vemcvx collection --out collection --core": As(),
    "vemcvx benchmark DIR --solvers A,B": As(
        "vemcvx collection --out results/collection; "
        "vemcvx benchmark results/collection --solvers newton,clarabel --only easy --tolerances 1e-2,1e-6"
    ),
    "vemcvx benchmark collection --solvers newton,clarabel,scs,mine.py:Mine --only core --time-limit 10": As(
        "vemcvx collection --out collection; vemcvx benchmark collection --solvers newton,clarabel,mine.py:Mine "
        "--only easy --time-limit 10 --tolerances 1e-2,1e-6"
    ),
    "vemcvx cost FILE": As(f"vemcvx cost {PAPER} --n 8,16 --steps 8 --mesh squares"),
    "vemcvx problems": As(),
    "vemcvx run feng_han_huang": As(),
    "vemcvx lesson [N]": As("vemcvx lesson"),
    "vemcvx app [FILE]": Not("it is `vemcvx app`"),
    "vemcvx app": Not("it serves a page until somebody ends it; tests/unit/test_cli_app.py opens it in a browser"),
    "vemcvx doctor": As(),
    "vemcvx show": Not("it names the command, which is run with a file"),
    "vemcvx cost": Not("it names the command, which is run with a file"),
    "vemcvx run --bound": As(f"vemcvx run {PAPER} --n 16 --steps 4 --bound"),
    "vemcvx compare": Not("it names the command, which is run with a file"),
    "vemcvx run ... --resume DIR": Not(
        "it needs a run that was interrupted; tests/cli/test_cli_ends.py interrupts some"
    ),
    'pip install ".[app]"': As(env="app"),
    "vemcvx app --check": As(env="app"),
    "vemcvx app FILE": Not("it is `vemcvx app`"),
    "vemcvx app FILE --html PAGE": As(f"vemcvx app {PAPER} --html results/page.html", env="app"),
    "meshio convert a.xyz a.vtu": As(
        "meshio convert a.mesh a.vtu && python -c 'import vemcvx as vx; vx.meshes.read(\"a.vtu\")'"
    ),
    "meshio convert a.vtk a.vtu": Not("it is `meshio convert a.xyz a.vtu`"),
    "vemcvx run FILE --mesh two.msh": Not("it is tested with files of two bodies in tests/cli"),
    "vemcvx compare problems/feng_han_huang.py --solvers all": As(),
    "vemcvx export FILE --steps 3,17 --format npz|mtx|cbf|mps|qps|hdf5": As(
        f"for form in npz mtx cbf mps qps; do vemcvx export {PAPER} --steps 3,17 --format $form; done; "
        "vemcvx export pad.py --n 8 --steps 3,17 --format hdf5"
    ),
    "vemcvx compare FILE --solvers newton,clarabel,mine.py:Mine": As(
        f"vemcvx compare {PAPER} --n 8 --steps 4 --solvers newton,clarabel,mine.py:Mine"
    ),
    "python problems/gallery.py": As(env="all"),
    "python problems/hard_cases.py": As(),
    "python problems/paper_figures.py --deviations": As(),
    "python -m pytest -m slow": As(addopts=ONE_SLOW),
    'pip install ".[all]"': As(env="all"),
    'pip install ".[view]"': As(env="all"),
    "python tests/benchmarks/run.py --page": As("python tests/benchmarks/run.py --page --quick", env="all"),
    'pip install ".[mkl]"': As(),
    'pip install ".[multigrid]"': As(),
    'pip install ".[pandas,xarray]"': As(),
    "vemcvx run FILE --target 0.02": As(f"vemcvx run {PAPER} --target 0.1 --steps 2"),
    "vemcvx lesson": As(),
    "pip install pytest": As(),
    "vemcvx lesson 1 --no-solutions": As("cd results && vemcvx lesson 1 --no-solutions"),
    "vemcvx lesson 6 --notebook": As("cd results && vemcvx lesson 6 --notebook"),
    "vemcvx lesson 6": As("cd results && vemcvx lesson 6 && python lesson_6_certificates.py"),
    # CONTRIBUTING
    'pip install ".[docs]" && python docs/build.py site': As(env="docs"),
    'pip install -e ".[plot,test]"': As(),
    "python tests/whole/test_messages.py": As(),
    "python -m pytest -n 2 -m quick": As(addopts=FEW),
    "python -m pytest -n 2": As(addopts=FEW),
    "python -m pytest -n 2 -m long": As(addopts=LONG),
    "python -m pytest tests/vem/test_patch.py": As(),
    "python -m pytest -m slow -n 2": As(addopts=ONE_SLOW),
    # Without the files that the reader writes, and what commands before this one wrote.
    "ruff check .": As("ruff check . --extend-exclude pad.py,mine.py,results"),
    "python .ci/words.py": As(),
    "mypy": As(),
    "python -m pytest -m slow tests/whole/test_types.py": As(env="all"),
    "pip install basedpyright": As(),
    ".ci/run": Not("it runs all default tests, and is what continuous integration runs"),
    ".ci/kernels": Not("it takes two hours"),
    "python3 -m venv --system-site-packages": Not(
        "it needs the system's PETSc; tests/linear/test_petsc.py runs with it"
    ),
    'pip install ".[petsc]"': Not(
        "it builds PETSc, which takes an hour; tests/linear/test_petsc.py runs with the system's"
    ),
    "pip install pre-commit && pre-commit install": As(
        "git init -q . && pip install pre-commit && pre-commit install && rm -rf .git"
    ),
    "python problems/gallery.py NAME": Not(
        "NAME is that of a new problem; test_problem_pictures.py draws all there are"
    ),
    "python -m pytest -k bricks": Not("test_contributing.py adds the family of meshes, and runs the tests of it"),
}


def test_every_command_of_the_texts_is_listed():
    assert commands() == [word for word in commands() if word in HOW], "say in HOW how these are run, or why not"
    assert set(HOW) == set(commands()), "HOW has commands that no text has any more"


def test_few_are_not_run():
    assert sum(isinstance(how, Not) for how in HOW.values()) == 15


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of what is checked in, with the files that the texts tell the reader to write."""
    if sys.platform == "win32":
        pytest.skip("the texts' shell is that of Unix")
    folder = tmp_path_factory.mktemp("commands") / "vemcvx"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    (folder / "pad.py").write_text(texts.file(texts.page("howto/problem_file"), "pad.py"))
    mine = texts.file(texts.page("howto/own_solver"), "mine.py")
    (folder / "mine.py").write_text(f"{mine}\n\nMine = Fista\n")
    square = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    meshio.Mesh(square, [("triangle", np.array([(0, 1, 2), (0, 2, 3)]))]).write(folder / "a.mesh")
    (folder / "results").mkdir()
    return folder


def done(command, folder, env, addopts=""):
    """Run a command by the shell as the texts say, in an activated environment."""
    inherited = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHON", "VIRTUAL"))
    }
    active = f". {env}/bin/activate && " if (folder / env).is_dir() else ""
    return subprocess.run(
        ["bash", "-c", f"set -e; {active}{command}"],
        cwd=folder,
        env={**inherited, "PYTEST_ADDOPTS": addopts},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize("env", ["main", "docs", "app", "all"])
def test_they_run(checkout, env):
    # Beside the checkout, where no tool looks for files of ours.
    folder = ".venv" if env == "main" else f"../venv-{env}"
    if env != "main":
        made = done(f"python3 -m venv {folder}", checkout, "none")
        assert made.returncode == 0, made.stderr
    # An extra is installed before what needs it, wherever the text says so.
    asked = [(command, how) for command in commands() if isinstance(how := HOW[command], As) and how.env == env]
    asked.sort(key=lambda one: not one[0].startswith(("pip", "python3 -m venv")) if env != "main" else 0)
    failed = []
    for command, how in asked:
        ran = done(how.words or command, checkout, folder, how.addopts)
        if ran.returncode or "Traceback" in ran.stdout + ran.stderr:
            failed.append(f"{command}\nended with {ran.returncode}:\n{ran.stdout[-3000:]}\n{ran.stderr[-3000:]}")
    assert not failed, "\n\n".join(failed)
