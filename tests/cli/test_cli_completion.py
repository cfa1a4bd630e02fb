"""Shells complete names of problems, files, solvers, families and lessons."""

from __future__ import annotations

import pytest
from scenes import mostly_long
from typer.testing import CliRunner

from vemcvx.cli import app, supplied
from vemcvx.meshes import FAMILIES


def complete(monkeypatch, *words):
    """Return the completions of the last word, as bash asks for them."""
    monkeypatch.setenv("COMP_WORDS", " ".join(["vemcvx", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    done = CliRunner().invoke(app, [], prog_name="vemcvx", env={"_VEMCVX_COMPLETE": "complete_bash"})
    assert done.exit_code == 0, done.output
    return done.output.split()


@mostly_long("command", ["run", "show", "compare", "export", "cost"])
def test_problems_of_the_package_and_local_files_are_completed(command, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "free.py").touch()
    (tmp_path / "frame.txt").touch()
    problems = [name for name in supplied.problem_files() if name.startswith("fr")]
    assert complete(monkeypatch, command, "fr") == [*problems, "free.py"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("run", "x", "--solver", "cl"), ["clarabel"]),
        (("compare", "x", "--solvers", "newton,osq"), ["newton,osqp"]),
        (("run", "x", "--mesh", "h"), ["hexagons", "hanging"]),
        (("cost", "x", "--mesh", "squares,vor"), ["squares,voronoi"]),
        (("show", "x", "--mesh", ""), list(FAMILIES)),
        (("run", "x", "--linear", "p"), ["pardiso", "petsc"]),
        (("lesson", ""), [str(number) for number in supplied.lessons()]),
        (("run", "x", "--mesh", "part.ms"), []),
        (("do",), ["doctor"]),
    ],
)
def test_words_are_completed(words, expected, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert complete(monkeypatch, *words) == expected
