"""Every lesson runs cell by cell, as in a notebook, and has the parts that every lesson must have.

The cells of a lesson check the numbers in the text. These tests do not repeat the checks.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from scenes import small

import vemcvx as vx

FOLDER = Path(__file__).parents[2] / "problems" / "lessons"
FILES = sorted(path.name for path in FOLDER.glob("*.py"))
LESSONS = [name for name in FILES if "solutions" not in name]
figures = pytest.importorskip("matplotlib.figure")


def cells(name):
    """Return (kind, text) of every cell; `kind` is "markdown" or "code"."""
    first, *rest = re.split(r"^# %%(.*)\n", (FOLDER / name).read_text(), flags=re.MULTILINE)
    marked = zip(rest[::2], rest[1::2], strict=True)
    return [("code", first), *(("markdown" if "[markdown]" in mark else "code", text) for mark, text in marked)]


@cache
def run_cells(name):
    """Return the namespace after all cells, and the values that a notebook shows below its cells."""
    space, shown = {"__name__": "__main__"}, []
    for kind, text in cells(name):
        if kind == "code":
            body = ast.parse(text).body
            last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
            exec(compile(ast.Module(body, []), name, "exec"), space)
            if last is not None:
                shown.append(eval(compile(ast.Expression(last.value), name, "eval"), space))
    return space, shown


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_a_lesson_runs_and_its_output_fits_a_screen(name, capsys):
    assert all(len(repr(value)) < 2000 for value in run_cells(name)[1])
    assert len(capsys.readouterr().out) < 4000


@pytest.mark.long
@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_has_formulas_a_picture_exercises_and_a_file_of_solutions(name):
    prose = "".join(text for kind, text in cells(name) if kind == "markdown")
    assert prose.count("$$") >= 4
    assert any(isinstance(value, figures.Figure) for value in run_cells(name)[1])
    number = re.match(r"lesson_(\d+)_", name).group(1)
    solutions = f"lesson_{number}_solutions.py"
    assert f"`{solutions}`" in prose
    asked = re.findall(r"^# (\d+)\. ", prose[prose.index("# ## Exercises") :], re.MULTILINE)
    solved = re.findall(r"^# \*\*(\d+)\.\*\*", (FOLDER / solutions).read_text(), re.MULTILINE)
    assert asked == solved == [str(i) for i in range(1, len(asked) + 1)]


@pytest.mark.parametrize("name", LESSONS)
def test_every_question_has_an_answer_that_unfolds(name):
    prose = "".join(text for kind, text in cells(name) if kind == "markdown")
    asked = prose.split("**Question:**")[1:]
    assert asked
    for question in asked:
        answer = re.search(
            r"\n#\n# <details><summary>Answer</summary>\n#\n(.+?)\n#\n# </details>\n", question, re.DOTALL
        )
        assert answer, question[:300]
        # No heading stands between question and answer.
        assert "# ## " not in question[: answer.start()]
        assert len(answer.group(1).split()) > 25
        assert "details>" not in answer.group(1)
    assert prose.count("<details>") == len(asked)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")  # triangles lock
def test_the_package_agrees_with_the_cantilevers_that_lesson_3_assembles_by_hand():
    space, _ = run_cells("lesson_3_virtual_elements.py")
    for family, n in (("squares", 4), ("hexagons", 4), ("triangles", 4)):
        steel = vx.Elasticity(young=1.0, poisson=space["poissons"][2])
        scene = vx.Scene(steel, vx.Clamp(on="left"), vx.Traction((0.0, -1.0), on="right"))
        history = vx.simulate(scene, small(family, n, box=((0, 4), (0, 1))), [0.0, 1.0], initial="equilibrium")
        # The energy is half the work of the load. Condition numbers below 1e6 cause errors below 1e-9.
        assert 2 * history.energy[-1] == pytest.approx(space["cantilever"][family, n][2], rel=1e-9)
