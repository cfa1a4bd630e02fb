"""What shells complete, asked as they ask: by an environment variable."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from vemcvx.cli import app, supplied
from vemcvx.meshes import FAMILIES


def completed(monkeypatch, *words):
    """What bash is told for the last of the words."""
    monkeypatch.setenv("COMP_WORDS", " ".join(["vemcvx", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    done = CliRunner().invoke(app, [], prog_name="vemcvx", env={"_VEMCVX_COMPLETE": "complete_bash"})
    assert done.exit_code == 0, done.output
    return done.output.split()


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("command", ["run", "show", "compare", "export", "cost"])
def test_problems_of_the_package_and_files_here(command, monkeypatch, tmp_path):
    (tmp_path / "free.py").touch()
    (tmp_path / "frame.txt").touch()
    asked = [name for name in supplied.problem_files() if name.startswith("fr")]
    assert completed(monkeypatch, command, "fr") == [*asked, "free.py"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("run", "x", "--solver", "cl"), ["clarabel"]),
        (("export", "x", "--solver", "new"), ["newton"]),
        (("compare", "x", "--solvers", "newton,osq"), ["newton,osqp"]),
        (("compare", "x", "--solvers", "newton,sc"), ["newton,scs"]),
        (("run", "x", "--mesh", "h"), ["hexagons", "hanging"]),
        (("cost", "x", "--mesh", "squares,vor"), ["squares,voronoi"]),
        (("show", "x", "--mesh", ""), list(FAMILIES)),
        (("run", "x", "--linear", "p"), ["pardiso", "petsc"]),
        (("lesson", ""), [str(number) for number in supplied.lessons()]),
        (("run", "x", "--mesh", "part.ms"), []),
        (("do",), ["doctor"]),
    ],
)
def test_words_are_completed(words, expected, monkeypatch):
    assert completed(monkeypatch, *words) == expected


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell_names_the_program(shell):
    environment = {**os.environ, "_VEMCVX_COMPLETE": f"source_{shell}"}
    command = [sys.executable, "-m", "vemcvx"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "_VEMCVX_COMPLETE" in done.stdout
