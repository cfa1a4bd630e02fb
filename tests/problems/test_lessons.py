"""Every lesson runs cell by cell, as in a notebook, and has the parts that every lesson must have.

The cells of a lesson assert the numbers that their text claims; these tests do not repeat them.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
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
    """Return (kind, text) of every cell, kind "markdown" or "code"; text before the first mark is code."""
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
def test_a_lesson_opens_with_its_prerequisites_and_imports_public_modules(name):
    opening = cells(name)[2][1]
    assert re.match(r"# \*You need:\* .+?\*You will see:\* ", opening, re.DOTALL)
    first = next(text for kind, text in cells(name)[1:] if kind == "code")
    imports = [line.split()[1] for line in first.splitlines() if line.startswith(("import ", "from "))]
    assert {"matplotlib.pyplot", "numpy"} <= set(imports)
    assert not any(re.match(r"vemcvx\.(base|plots)", module) for module in imports)


@pytest.mark.parametrize("name", FILES)
def test_folded_cells_describe_their_picture(name):
    """The first comment of a folded cell is the alternative text of its picture on the site."""
    text = (FOLDER / name).read_text()
    assert text.count('# %% jupyter={"source_hidden": true}\n') == text.count("\n# Picture: ")
    assert text.count('# %% jupyter={"source_hidden": true}\n# Picture: ') == text.count("\n# Picture: ")


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
        # The answer follows its question, without a heading in between, and contains no other answer.
        assert "# ## " not in question[: answer.start()]
        assert len(answer.group(1).split()) > 25
        assert "details>" not in answer.group(1)
    assert prose.count("<details>") == len(asked)


@pytest.mark.parametrize("name", FILES)
def test_the_title_is_shown_once(name):
    """The docstring of the file is its first cell and its title, the only heading at this level."""
    first, *others = cells(name)[1:]
    number = re.match(r"lesson_(\d+)_", name).group(1)
    title = ast.literal_eval(first[1].strip())
    assert cells(name)[0] == ("code", "")
    assert first[0] == "markdown"
    assert title == ast.get_docstring(ast.parse((FOLDER / name).read_text()))
    assert re.match(rf"# (Lesson {number}, |Solutions to the exercises of lesson {number})", title)
    assert not any(re.search(r"^# # ", text, re.MULTILINE) for kind, text in others if kind == "markdown")


@pytest.mark.parametrize("name", FILES)
def test_cells_of_markdown_contain_comments_only(name):
    """The title is exempt, because it is the docstring."""
    lines = [line for kind, text in cells(name)[2:] if kind == "markdown" for line in text.splitlines()]
    assert [line for line in lines if line and not line.startswith("#")] == []


@pytest.mark.parametrize("name", FILES)
def test_no_two_cells_assign_the_same_name(name):
    """Marimo refuses two cells that define the same name; names that begin with _ are local to a cell."""
    defined = Counter()
    for kind, text in cells(name):
        defined.update(list_assigned_names(ast.parse(text)) if kind == "code" else ())
    assert [one for one, times in defined.items() if times > 1] == []


def list_assigned_names(tree):
    """Return the names that a cell defines outside functions, without names that begin with an underscore."""
    names, waiting = set(), list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).split(".")[0] for alias in node.names}
        elif not isinstance(node, ast.Lambda | ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.add(node.id)
            waiting += ast.iter_child_nodes(node)
    return {name for name in names if not name.startswith("_")}


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")  # triangles lock
def test_the_package_agrees_with_the_cantilevers_that_lesson_3_assembles_by_hand():
    space, _ = run_cells("lesson_3_virtual_elements.py")
    for family, n in (("squares", 4), ("hexagons", 4), ("triangles", 4)):
        steel = vx.Elasticity(young=1.0, poisson=space["poissons"][2])
        scene = vx.Scene(steel, vx.Clamp(on="left"), vx.Traction((0.0, -1.0), on="right"))
        history = vx.simulate(scene, small(family, n, box=((0, 4), (0, 1))), [0.0, 1.0], initial="equilibrium")
        # The energy is half the work of the load; condition numbers below 1e6 cause errors below 1e-9.
        assert 2 * history.energy[-1] == pytest.approx(space["cantilever"][family, n][2], rel=1e-9)
