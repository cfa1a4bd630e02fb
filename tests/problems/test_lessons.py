"""Every lesson is run cell by cell, as a notebook runs it; what it asserts holds, and it shows what it promises.

The numbers that a lesson rests on are asserted in the lesson, where a student reads why; here stands what a lesson
as such must be, and what would pass unnoticed if an assertion were lost from it.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import small

import vemcvx as vx
from vemcvx.base.errors import SceneWarning
from vemcvx.program import Operators, StepProgram

FOLDER = Path(__file__).parents[2] / "problems" / "lessons"
FILES = sorted(path.name for path in FOLDER.glob("*.py"))
LESSONS = [name for name in FILES if "solutions" not in name]
figures = pytest.importorskip("matplotlib.figure")


def cells(name):
    """Kind ("markdown" or "code") and text of every cell; what precedes the first mark is code."""
    first, *rest = re.split(r"^# %%(.*)\n", (FOLDER / name).read_text(), flags=re.MULTILINE)
    marked = zip(rest[::2], rest[1::2], strict=True)
    return [("code", first), *(("markdown" if "[markdown]" in mark else "code", text) for mark, text in marked)]


@cache
def ran(name):
    """The namespace after all cells, and the values of the cells' last lines, which a notebook shows."""
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
def test_it_runs(name, capsys):
    """Nothing it shows in passing fills more than a screen."""
    assert all(len(repr(value)) < 2000 for value in ran(name)[1])
    assert len(capsys.readouterr().out) < 4000


@pytest.mark.parametrize("name", FILES)
def test_it_asserts(name):
    """A lesson without assertions would pass whatever it computed."""
    tree = ast.parse((FOLDER / name).read_text())
    assert sum(isinstance(node, ast.Assert) for node in ast.walk(tree)) >= 4


@pytest.mark.long
@pytest.mark.parametrize("name", LESSONS)
def test_it_is_a_lesson(name):
    """Formula, picture, question, exercises, and their solutions in a file of their own."""
    prose = "".join(text for kind, text in cells(name) if kind == "markdown")
    assert prose.count("$$") >= 4
    assert any(isinstance(value, figures.Figure) for value in ran(name)[1])
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
        # It stands below its question, with no heading between the two, and no other within.
        assert "# ## " not in question[: answer.start()]
        assert len(answer.group(1).split()) > 25
        assert "details>" not in answer.group(1)
    assert prose.count("<details>") == len(asked)


@pytest.mark.parametrize("name", FILES)
def test_the_title_is_shown_once(name):
    """It is the docstring of the file and its first cell, the only heading of its level."""
    first, *others = cells(name)[1:]
    number = re.match(r"lesson_(\d+)_", name).group(1)
    title = ast.literal_eval(first[1].strip())
    assert cells(name)[0] == ("code", "")
    assert first[0] == "markdown"
    assert title == ast.get_docstring(ast.parse((FOLDER / name).read_text()))
    assert re.match(rf"# (Lesson {number}, |Solutions to the exercises of lesson {number})", title)
    assert not any(re.search(r"^# # ", text, re.MULTILINE) for kind, text in others if kind == "markdown")


@pytest.mark.parametrize("name", FILES)
def test_cells_of_markdown_are_comments_alone(name):
    """Except for the title, which is the docstring, too."""
    lines = [line for kind, text in cells(name)[2:] if kind == "markdown" for line in text.splitlines()]
    assert [line for line in lines if line and not line.startswith("#")] == []


@pytest.mark.parametrize("name", FILES)
def test_no_two_cells_give_a_value_to_one_name(name):
    """Marimo orders cells by who defines what, and refuses two that define the same; names with _ stay in a cell."""
    defined = Counter()
    for kind, text in cells(name):
        defined.update(outermost_names(ast.parse(text)) if kind == "code" else ())
    assert [one for one, times in defined.items() if times > 1] == []


def outermost_names(tree):
    """Names that a cell gives a value to outside functions, except those that begin with an underscore."""
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


def test_lesson_1_a_step_by_hand_minimises_its_energy():
    space, _ = ran("lesson_1_one_slider.py")
    K, g, anywhere = space["K"], space["g"], np.linspace(-4, 4, 8001)
    for u_prev in (-1.0, 0.0, 0.7):
        for f in (-3.0, -0.4, 0.0, 1.9):
            u = space["step_by_hand"](u_prev, f)

            def energy(v, u_prev=u_prev, f=f):
                return 0.5 * K * v**2 - f * v + g * np.abs(v - u_prev)

            assert energy(u) <= energy(anywhere).min() + 1e-14
            lam = space["friction_by_hand"](u_prev, f)
            assert energy(u) == pytest.approx(-((f - lam) ** 2) / (2 * K) - lam * u_prev, abs=1e-14)


@pytest.mark.long
def test_lesson_2_four_nodes_agree_with_the_hand():
    """Clarabel's own tolerance, 1e-8 in the gap, is 1e-4 in the slip at worst and was seen to give 1e-8."""
    space, _ = ran("lesson_2_four_nodes.py")
    assert space["u"].value == pytest.approx(space["by_hand"], abs=1e-5)
    balance = space["f"] - space["K"] @ space["by_hand"]
    assert balance == pytest.approx([0.5, 0.5, 0.2, 0.0], abs=1e-15)
    assert (np.abs(balance) <= space["w"] + 1e-15).all()
    assert space["lam"] == pytest.approx(balance, abs=1e-4)
    assert space["newton"].multipliers[-1, :, 0] == pytest.approx(balance, abs=1e-14)
    assert space["newton"].state[-1] == pytest.approx(space["by_hand"], abs=1e-15)
    assert space["apart"] <= space["claimed"] < 1e-5


@pytest.mark.long
def test_lesson_3_is_the_package_by_other_means():
    """One pentagon to 1e-13; cantilevers, which the lesson assembles cell by cell, by `simulate`."""
    space, _ = ran("lesson_3_virtual_elements.py")
    assert space["apart"] < 1e-13
    for family, n in (("squares", 4), ("hexagons", 4), ("triangles", 4)):
        scene = vx.Scene(
            vx.Elasticity(young=1.0, poisson=space["poissons"][2]),
            vx.Clamp(on="left"),
            vx.Traction(lambda x, t: np.tile([0.0, -1.0], (len(x), 1)), on="right"),
        )
        mesh = small(family, n, box=((0, 4), (0, 1)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # that triangles lock
            history = vx.simulate(scene, mesh, [0.0, 1.0], initial="equilibrium")
        # Energy is half the work of the load; condition numbers below 1e6 leave less than 1e-9.
        assert 2 * history.energy[-1] == pytest.approx(space["cantilever"][family, n][2], rel=1e-9)


@pytest.mark.long
def test_lesson_4_the_loop_loses_what_the_formula_says():
    space, _ = ran("lesson_4_quasistatic.py")
    assert space["lost"] == pytest.approx(space["closed_form"], rel=1e-14)
    assert space["path"][0] == 0.0
    assert space["path"][-1] == pytest.approx(space["path"][30], rel=1e-14)
    # Friction's share has no error in time here: between reversals, which are instants, every node slips one way.
    spent = [history.dissipated[-1] for history in space["histories"].values()]
    assert np.ptp(spent) < 1e-12 * spent[0]


@pytest.mark.long
def test_lesson_5_ends_where_the_package_does():
    """Two answers to a program are no farther apart than both gaps allow."""
    space, _ = ran("lesson_5_active_sets.py")
    assert max(space["needed"]) > 10, "no program that is hard to end"
    for i in np.argsort(space["needed"])[-4:]:
        K, f, w, b = space["programs"][i]
        y, gaps, _ = space["runs"][i]
        ours = vx.Newton(accuracy=1e-8)
        operators = Operators(K, sp.csr_matrix(np.eye(len(f))), 1)
        program = StepProgram(operators, f, w, b)
        answer = ours.prepare(operators).solve(program, 1e-16 * (f @ np.linalg.solve(K, f)), np.zeros((len(f), 1)))
        apart = y - answer.d
        allowed = np.sqrt(2 * gaps[-1]) + np.sqrt(2 * program.certify(answer.d, answer.lam).gap)
        assert np.sqrt(apart @ K @ apart) <= allowed + 1e-13 * np.sqrt(y @ K @ y)


@pytest.mark.long
def test_uzawas_step_is_the_least_eigenvalue():
    """Lesson 9: no direction is overshot, and the slowest shrinks by q; steps beyond twice that overshoot more."""
    space, _ = ran("lesson_9_forces.py")
    eigenvalues, vectors = np.linalg.eigh(space["K"])
    assert space["least"] == pytest.approx(eigenvalues[0], rel=1e-12)
    for longer, softest in ((1.0, 0.0), (1.9, -0.9), (2.5, -1.5)):
        factors = [
            v @ (v - longer * space["least"] * np.linalg.solve(space["K"], v)) for v in vectors.T
        ]  # of errors within the box
        assert factors[0] == pytest.approx(softest, abs=1e-12)
        assert (min(factors) >= -1e-12) == (longer == 1.0)
        assert longer > 1.0 or max(factors) == pytest.approx(space["q"], rel=1e-12)
    assert "\\rho = \\kappa_1 ,$$" in (FOLDER / "lesson_9_forces.py").read_text()
