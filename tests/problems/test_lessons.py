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

import vemcvx as vx
from vemcvx.base.errors import SceneWarning
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram

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


@pytest.mark.parametrize("name", LESSONS)
def test_cells_that_only_draw_are_folded(name):
    """Jupyter and marimo show a folded cell's picture without its code; nothing that is asserted is hidden."""
    marks = re.findall(r"^# %%(.*)\n", (FOLDER / name).read_text(), re.MULTILINE)
    folded = [text for mark, (_, text) in zip(marks, cells(name)[1:], strict=True) if "source_hidden" in mark]
    draws = [text for kind, text in cells(name) if kind == "code" and "new_figure(" in text]
    assert folded == draws
    assert not any(isinstance(node, ast.Assert) for text in folded for node in ast.walk(ast.parse(text)))
    assert all(mark.strip() in ("", "[markdown]", 'jupyter={"source_hidden": true}') for mark in marks)


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


@pytest.mark.long
@pytest.mark.parametrize("name", LESSONS)
def test_swatches_of_legends_are_seen(name):
    """Whether the legend stands on white or on the area itself: a face or an edge differs from both."""
    for figure in (value for value in ran(name)[1] if isinstance(value, figures.Figure)):
        for legend in [one for ax in figure.axes if (one := ax.get_legend())]:
            for patch in legend.get_patches():
                edge = luminance(patch.get_edgecolor()) if patch.get_linewidth() else 1.0
                face = luminance(patch.get_facecolor())
                darkest = min(edge, face)
                assert 1.05 / (darkest + 0.05) > 2.0, f"{name}: a swatch on white is not seen"
                assert face > 0.5 > darkest or face <= 0.5, f"{name}: a swatch on its own area is not seen"


def luminance(colour):
    """That of WCAG, of a colour on white."""
    *rgb, alpha = colour
    mixed = alpha * np.array(rgb) + 1.0 - alpha
    linear = np.where(mixed <= 0.04045, mixed / 12.92, ((mixed + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


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
        mesh = vx.meshes.FAMILIES[family](n, box=((0, 4), (0, 1)))
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


def answers(name):
    """The answers of a lesson, as one line each."""
    text = (FOLDER / name).read_text()
    found = re.findall(r"<summary>Answer</summary>(.*?)# </details>", text, re.DOTALL)
    return [" ".join(one.replace("\n#", " ").split()) for one in found]


def test_answers_of_lessons_1_and_2():
    space, _ = ran("lesson_1_one_slider.py")
    K, g, f = space["K"], space["g"], 1.8
    h = 1e-6
    rise = (space["dual"](g, 0.0, f) - space["dual"](g - h, 0.0, f)) / h
    assert "= .4$, is the slip" in answers("lesson_1_one_slider.py")[1]
    assert rise == pytest.approx(0.4, abs=h)  # the second derivative is -1/K
    assert space["step_by_hand"](0.0, f) == pytest.approx(0.4, rel=1e-15)
    slope = (space["primal"](h, 0.0, f) - space["primal"](0.0, 0.0, f)) / h
    assert slope == pytest.approx(g - f, abs=K * h)

    space, _ = ran("lesson_2_four_nodes.py")
    slip, force = space["second"] - space["first"], space["force_2"]
    # Positions are known to 4e-4, slips are .1 and more: angles to less than half a degree.
    for way in (slip, force):
        assert np.degrees(np.arctan2(way[:3, 1], way[:3, 0])).round().tolist() == [77.0, 60.0, 47.0]
    spring = space["second"][0] - space["second"][1]
    assert spring.round(2).tolist() == [0.69, 0.9]
    assert round(float(np.degrees(np.arctan2(*spring[::-1])))) == 52
    assert space["turned"][0].round(2).tolist() == [0.8, 1.39]
    assert (space["turned"][0] - spring).round(2).tolist() == [0.11, 0.49]
    assert (space["f"] - space["K"] @ space["by_hand"])[3] == 0.0


@pytest.mark.long
def test_answers_of_lessons_3_and_4():
    space, _ = ran("lesson_3_virtual_elements.py")
    lam, mu = space["moduli"]
    for tau in (0.5 * mu, mu, 3.0 * mu):
        values = np.linalg.eigvalsh(space["cell_stiffness"](space["square"], lam, mu, tau=tau))
        assert values == pytest.approx(sorted([0, 0, 0, tau, tau, 2 * mu, 2 * mu, 2 * (lam + mu)]), abs=1e-14)
    ends = [space["cantilever"]["triangles", n][-1] for n in (4, 8)]
    assert [f"{end:.2f}" for end in ends] == re.findall(r"14\.\d\d", answers("lesson_3_virtual_elements.py")[1])

    space, _ = ran("lesson_4_quasistatic.py")
    history = space["histories"][160]
    left, load = history.mesh.points[:, 0] == 0, space["course"](history.times)
    slope = np.diff(load) / np.diff(history.displacement[:, left, 0].mean(axis=1))
    sticks = history.contact.sticking.sum(axis=1)
    for turn in (32, 96):  # at t = 1 and 3; the next is at 96 and 160
        assert round(slope[turn], 1) == 62.7
        assert round(slope[turn + 63], 1) == 39.7
        assert (sticks[turn + 1], sticks[turn + 64]) == (8, 1)
    assert 1 - slope[95] / slope[32] == pytest.approx(0.37, abs=0.005)
    assert "from 62.7 to 39.7" in answers("lesson_4_quasistatic.py")[1]
    # Free of what backward Euler loses, which 160 steps halve and halve again.
    worked = [run.work_second_order[-1] for run in space["histories"].values()]
    assert np.ptp(worked) < 1e-10 * worked[0]


@pytest.mark.long
def test_answers_of_lessons_5_and_6():
    space, _ = ran("lesson_5_active_sets.py")
    assert not space["sides"][0].any()

    space, _ = ran("lesson_6_certificates.py")
    exact, forces, gap, K = space["exact"], space["forces"], space["gap"], space["K"]
    slips = exact != 0
    for size in (1e-1, 1e-3):
        rest = exact * (1 + size * np.cos(np.arange(len(exact))))
        creep = rest + 1e-2 * size * exact.max() * ~slips
        half = [0.5 * (d - exact) @ K @ (d - exact) for d in (rest, creep)]
        assert gap(rest, forces) == pytest.approx(half[0], rel=1e-6)
        short = space["w"] - np.abs(forces)
        assert gap(creep, forces) - half[1] == pytest.approx(short @ np.abs(creep - rest), rel=1e-6)
    assert gap(creep, forces) > 10 * half[1]
    # The hinge of the proof, and that it fails where multipliers exceed their bounds.
    rng = np.random.default_rng(0)
    for v in rng.normal(size=(50, len(exact))):
        lam = space["w"] * rng.uniform(-1, 1, len(exact))
        assert (space["w"] * np.abs(v) >= lam * v).all()
    assert not (space["w"] * np.abs(exact) >= 2 * forces * exact).all()


@pytest.mark.long
def test_answers_of_lesson_7():
    space, _ = ran("lesson_7_what_accuracy_costs.py")
    told = answers("lesson_7_what_accuracy_costs.py")[0]
    scaled = {name: space["errors"][name][-1] * np.sqrt(space["nodes"][name][-1]) for name in space["errors"]}
    assert min(scaled, key=scaled.get) == "squares"
    assert ", ".join(f"{scaled[name]:.2f}" for name in ("squares", "triangles")) in told.replace(" and 1.81", "")
    assert told.endswith(f"and {scaled['voronoi']:.2f}.")
    for name in scaled:
        assert f"{space['errors'][name][-1]:.1%}".replace("%", " %") in told
        assert f"{space['nodes'][name][-1]}" in told


@pytest.mark.long
def test_answers_of_lessons_8_and_9():
    space, _ = ran("lesson_8_your_own_effect.py")
    for steps in (4, 16, 64):
        times = np.linspace(0.0, 1.5, steps + 1)
        assert (space["recursion"](times)[1:] < space["closed_form"](times)[1:]).all()

    space, _ = ran("lesson_9_forces.py")
    K, g, w = space["K"], space["g"], space["w"]

    def best(bounds):
        return vx.march(vx.System(K, lambda t: t * g, vx.Norms(np.eye(len(g)), bounds)), [0.0, 1.0])

    found = [best(bounds) for bounds in (w, 0.5 * w)]
    values = [space["below"](run.multipliers[-1, :, 0]) for run in found]
    assert values[1] < values[0] - 10 * space["blur"]


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
