"""Every command in README, CONTRIBUTING, the pages of the site and the lessons is run, in new environments.

A command is an indented line, or a text in backquotes, that begins with the name of a program. (Console blocks are run
by tests/whole/test_site.py.) `HOW` has replacements for some commands; `NOT_RUN` lists the commands that are not run.
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


def list_commands():
    """Return each command once, in the order of the texts."""
    found = []
    for path in TEXTS:
        text = re.sub(r"^# ?", "", path.read_text(), flags=re.MULTILINE) if path.suffix == ".py" else path.read_text()
        outside = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        found += re.findall(r"^ {4}(\S.*)$|`([^`\n]+)`", outside, re.MULTILINE)
    words = [line or span for line, span in found]
    return list(dict.fromkeys(word for word in words if re.match(PROGRAM, word)))


@dataclass(frozen=True)
class As:
    """The command line to run, the name of its environment, and the value of PYTEST_ADDOPTS."""

    words: str = ""
    """The command with its placeholders filled in, and with options that make it small."""
    env: str = "main"
    addopts: str = ""


PAPER = "problems/feng_han_huang.py"
FEW, LONG, ONE_SLOW = (
    "tests/vem/test_patch.py",
    "tests/meshes/test_mesh_refine.py",
    "tests/cost/test_cost.py -k ended_sweep",
)
HOW = {
    'python3 -m venv .venv && .venv/bin/pip install -q -e ".[plot,test]" && .venv/bin/python -m pytest -n 2': As(
        addopts=FEW
    ),
    ". .venv/bin/activate": As(". .venv/bin/activate && vemcvx --version"),
    "vemcvx run FILE": As(f"vemcvx run {PAPER}"),
    "vemcvx show FILE": As(f"vemcvx show {PAPER}"),
    "vemcvx compare FILE": As(f"vemcvx compare {PAPER}"),
    "vemcvx export FILE --steps 3,17": As(f"vemcvx export {PAPER} --steps 3,17"),
    "vemcvx collection --out DIR": As("vemcvx collection --out results/collection"),
    "vemcvx benchmark DIR --solvers A,B": As(
        "vemcvx collection --out results/collection; "
        "vemcvx benchmark results/collection --solvers newton,clarabel --only easy --tolerances 1e-2,1e-6"
    ),
    "vemcvx benchmark collection --solvers newton,clarabel,scs,mine.py:Mine --only core --time-limit 10": As(
        "vemcvx collection --out collection; vemcvx benchmark collection --solvers newton,clarabel,mine.py:Mine "
        "--only easy --time-limit 10 --tolerances 1e-2,1e-6"
    ),
    "vemcvx cost FILE": As(f"vemcvx cost {PAPER} --n 8,16 --steps 8 --mesh squares"),
    "vemcvx lesson [N]": As("vemcvx lesson"),
    "vemcvx run --bound": As(f"vemcvx run {PAPER} --n 16 --steps 4 --bound"),
    'pip install ".[app]"': As(env="app"),
    "vemcvx app --check": As(env="app"),
    "vemcvx app FILE --html PAGE": As(f"vemcvx app {PAPER} --html results/page.html", env="app"),
    "meshio convert a.xyz a.vtu": As(
        "meshio convert a.mesh a.vtu && python -c 'import vemcvx as vx; vx.meshes.read(\"a.vtu\")'"
    ),
    "vemcvx export FILE --steps 3,17 --format npz|mtx|cbf|mps|qps|hdf5": As(
        f"for form in npz mtx cbf mps qps; do vemcvx export {PAPER} --steps 3,17 --format $form; done; "
        "vemcvx export pad.py --n 8 --steps 3,17 --format hdf5"
    ),
    "vemcvx compare FILE --solvers newton,clarabel,mine.py:Mine": As(
        f"vemcvx compare {PAPER} --n 8 --steps 4 --solvers newton,clarabel,mine.py:Mine"
    ),
    "python problems/gallery.py": As(env="all"),
    "python -m pytest -m slow": As(addopts=ONE_SLOW),
    'pip install ".[all]"': As(env="all"),
    'pip install ".[view]"': As(env="all"),
    "python tests/benchmarks/run.py --page": As("python tests/benchmarks/run.py --page --quick", env="all"),
    "vemcvx run FILE --target 0.02": As(f"vemcvx run {PAPER} --target 0.1 --steps 2"),
    "vemcvx lesson 6 --notebook": As("cd results && vemcvx lesson 6 --notebook"),
    "vemcvx lesson 6": As("cd results && vemcvx lesson 6 && python lesson_6_certificates.py"),
    'pip install ".[docs]" && python docs/build.py site': As(env="docs"),
    "python -m pytest -n 2 -m quick": As(addopts=FEW),
    "python -m pytest -n 2": As(addopts=FEW),
    "python -m pytest -n 2 -m long": As(addopts=LONG),
    "python -m pytest -m slow -n 2": As(addopts=ONE_SLOW),
    "ruff check .": As("ruff check . --extend-exclude pad.py,mine.py,results"),
    "python -m pytest -m slow tests/whole/test_types.py": As(env="all"),
    "pip install pre-commit && pre-commit install": As(
        "git init -q . && pip install pre-commit && pre-commit install && rm -rf .git"
    ),
}
NOT_RUN = {
    "vemcvx app [FILE]": "same as `vemcvx app`",
    "vemcvx app": "it serves a page until it is stopped; tests/unit/test_cli_app.py opens it in a browser",
    "vemcvx show": "the name of a command, which is run with a file",
    "vemcvx cost": "the name of a command, which is run with a file",
    "vemcvx compare": "the name of a command, which is run with a file",
    "vemcvx run ... --resume DIR": "it needs an interrupted run; tests/results/test_foreign_files.py has one",
    "vemcvx app FILE": "same as `vemcvx app`",
    "meshio convert a.vtk a.vtu": "same as `meshio convert a.xyz a.vtu`",
    "vemcvx run FILE --mesh two.msh": "it is tested with files of two bodies in tests/cli",
    ".ci/run": "it runs all default tests; continuous integration runs it",
    ".ci/kernels": "it takes two hours",
    "python3 -m venv --system-site-packages": "it needs the system's PETSc; tests/linear/test_petsc.py runs with it",
    'pip install ".[petsc]"': "it builds PETSc for an hour; tests/linear/test_petsc.py runs with the system's PETSc",
    "python problems/gallery.py NAME": "NAME is a new problem; test_problem_pictures.py draws every existing problem",
    "python -m pytest -k bricks": "test_contributing.py adds the family of meshes, and runs its tests",
}
"""Commands that are not run, and the reasons."""


def test_tables_of_commands_name_commands_of_the_texts():
    assert {*HOW, *NOT_RUN} <= set(list_commands())
    assert not set(HOW) & set(NOT_RUN)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Return a copy of the repository, with the files that the texts tell the reader to write."""
    if sys.platform == "win32":
        pytest.skip("commands of the texts need a Unix shell")
    folder = tmp_path_factory.mktemp("commands") / "vemcvx"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    (folder / "pad.py").write_text(texts.files(texts.page("howto/problem_file"))["pad.py"])
    mine = texts.files(texts.page("howto/own_solver"))["mine.py"]
    (folder / "mine.py").write_text(f"{mine}\n\nMine = Fista\n")
    square = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    meshio.Mesh(square, [("triangle", np.array([(0, 1, 2), (0, 2, 3)]))]).write(folder / "a.mesh")
    (folder / "results").mkdir()
    return folder


def run(command, folder, env, addopts=""):
    """Run a command by the shell, in an activated environment."""
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
def test_commands_of_the_texts_run(checkout, env):
    # The other environments are beside the checkout: tools that search the checkout must not find their files.
    folder = ".venv" if env == "main" else f"../venv-{env}"
    if env != "main":
        made = run(f"python3 -m venv {folder}", checkout, "none")
        assert made.returncode == 0, made.stderr
    chosen = [(command, HOW.get(command, As())) for command in list_commands() if command not in NOT_RUN]
    chosen = [(command, how) for command, how in chosen if how.env == env]
    # Extras are installed before the commands that need them.
    chosen.sort(key=lambda one: not one[0].startswith(("pip", "python3 -m venv")) if env != "main" else 0)
    failed = []
    for command, how in chosen:
        ran = run(how.words or command, checkout, folder, how.addopts)
        if ran.returncode or "Traceback" in ran.stdout + ran.stderr:
            failed.append(f"{command}\nended with {ran.returncode}:\n{ran.stdout[-3000:]}\n{ran.stderr[-3000:]}")
    assert not failed, "\n\n".join(failed)
