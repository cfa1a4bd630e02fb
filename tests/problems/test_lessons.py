"""Every lesson is run cell by cell, as a notebook runs it; its assertions hold, and it shows its pictures.

The numbers of a lesson are asserted in the lesson, next to the explanation for students. These tests state what every
lesson must have, and repeat the main numbers in case an assertion is lost from a lesson.
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
    """Return the kind ("markdown" or "code") and the text of every cell; text before the first mark is code."""
    first, *rest = re.split(r"^# %%(.*)\n", (FOLDER / name).read_text(), flags=re.MULTILINE)
    marked = zip(rest[::2], rest[1::2], strict=True)
    return [("code", first), *(("markdown" if "[markdown]" in mark else "code", text) for mark, text in marked)]


@cache
def ran(name):
    """Return the namespace after all cells, and the values of the cells' last lines, which a notebook shows."""
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
    """No output fills more than a screen."""
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
    """It has a formula, a picture, exercises, and their solutions in a separate file."""
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
def test_it_begins_with_what_you_need_and_will_see_and_plain_imports(name):
    """The first cell of code imports numpy, matplotlib, scipy, cvxpy and public parts of the package only."""
    opening = cells(name)[2][1]
    assert re.match(r"# \*You need:\* .+?\*You will see:\* ", opening, re.DOTALL)
    first = next(text for kind, text in cells(name)[1:] if kind == "code")
    imports = [line.split()[1] for line in first.splitlines() if line.startswith(("import ", "from "))]
    assert {"matplotlib.pyplot", "numpy"} <= set(imports)
    assert not any(re.match(r"vemcvx\.(base|plots)", module) for module in imports)


@pytest.mark.parametrize("name", FILES)
def test_pictures_are_described_in_words(name):
    """A folded cell begins with a comment that describes its picture; the site uses it as alternative text."""
    text = (FOLDER / name).read_text()
    assert text.count('# %% jupyter={"source_hidden": true}\n') == text.count("\n# Picture: ")
    assert text.count('# %% jupyter={"source_hidden": true}\n# Picture: ') == text.count("\n# Picture: ")


def test_one_symbol_has_one_meaning():
    """No lesson uses the symbols that once had two: g, tau outside lesson 10, and K for a cell."""
    for name in FILES:
        prose = "".join(text for kind, text in cells(name) if kind == "markdown")
        formulas = " ".join(re.findall(r"\$\$?([^$]+)\$\$?", prose))
        assert not re.search(r"(?<![\\a-zA-Z])g(?![a-zA-Z])", formulas), name
        assert "_10_" in name or r"\tau" not in formulas, name
        assert "_3_" not in name or r"\int_K" not in formulas


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
    """The title is the docstring of the file and its first cell, and the only heading of its level."""
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
    """The title is exempt, because it is the docstring."""
    lines = [line for kind, text in cells(name)[2:] if kind == "markdown" for line in text.splitlines()]
    assert [line for line in lines if line and not line.startswith("#")] == []


@pytest.mark.parametrize("name", FILES)
def test_no_two_cells_give_a_value_to_one_name(name):
    """Marimo refuses two cells that define the same name; names that begin with _ are local to a cell."""
    defined = Counter()
    for kind, text in cells(name):
        defined.update(outermost_names(ast.parse(text)) if kind == "code" else ())
    assert [one for one, times in defined.items() if times > 1] == []


def outermost_names(tree):
    """Return the names that a cell defines outside functions, except names that begin with an underscore."""
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
    K, w, anywhere = space["K"], space["w"], np.linspace(-4, 4, 8001)
    for u_prev in (-1.0, 0.0, 0.7):
        for f in (-3.0, -0.4, 0.0, 1.9):
            u = space["step_by_hand"](u_prev, f)

            def energy(v, u_prev=u_prev, f=f):
                return 0.5 * K * v**2 - f * v + w * np.abs(v - u_prev)

            assert energy(u) <= energy(anywhere).min() + 1e-14
            lam = space["friction_by_hand"](u_prev, f)
            assert energy(u) == pytest.approx(-((f - lam) ** 2) / (2 * K) - lam * u_prev, abs=1e-14)


@pytest.mark.long
def test_lesson_2_four_nodes_agree_with_the_hand():
    """Clarabel's tolerance of 1e-8 in the gap allows 1e-4 in the slip; 1e-8 was measured."""
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
    """One pentagon agrees to 1e-13, and `simulate` agrees with the cantilevers that the lesson assembles by hand."""
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
            warnings.simplefilter("ignore", SceneWarning)  # triangles lock
            history = vx.simulate(scene, mesh, [0.0, 1.0], initial="equilibrium")
        # Energy is half the work of the load; condition numbers below 1e6 leave less than 1e-9.
        assert 2 * history.energy[-1] == pytest.approx(space["cantilever"][family, n][2], rel=1e-9)


@pytest.mark.long
def test_lesson_4_the_loop_loses_what_the_formula_says():
    space, _ = ran("lesson_4_quasistatic.py")
    assert space["lost"] == pytest.approx(space["closed_form"], rel=1e-14)
    assert space["path"][0] == 0.0
    assert space["path"][-1] == pytest.approx(space["path"][30], rel=1e-14)
    # The loss to friction has no time error: each node slips in one direction between reversals, which are instants.
    spent = [history.dissipated[-1] for history in space["histories"].values()]
    assert np.ptp(spent) < 1e-12 * spent[0]


@pytest.mark.long
def test_lesson_5_ends_where_the_package_does():
    """The distance of two answers to a program is at most the sum of both certificates."""
    space, _ = ran("lesson_5_active_sets.py")
    assert max(space["needed"]) > 10, "no program is hard"
    for i in np.argsort(space["needed"])[-4:]:
        K, f, w, u_prev = space["programs"][i]
        u, gaps, _ = space["runs"][i]
        ours = vx.Newton(accuracy=1e-8)
        operators = Operators(K, sp.csr_matrix(np.eye(len(f))), 1)
        program = StepProgram(operators, f, w, u_prev)
        answer = ours.prepare(operators).solve(program, 1e-16 * (f @ np.linalg.solve(K, f)), np.zeros((len(f), 1)))
        apart = u - answer.d
        allowed = np.sqrt(2 * gaps[-1]) + np.sqrt(2 * program.certify(answer.d, answer.lam).gap)
        assert np.sqrt(apart @ K @ apart) <= allowed + 1e-13 * np.sqrt(u @ K @ u)


@pytest.mark.long
def test_uzawas_step_is_the_least_eigenvalue():
    """In lesson 9 no direction is overshot, and the slowest factor is q; steps beyond twice the eigenvalue diverge."""
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
