"""A solver of one's own: any object with solve(program, target), in Python and on the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest
from scenes import paper_scene, small
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.base.errors import ProblemError
from vemcvx.cli import app
from vemcvx.cli.solver_names import named_solver
from vemcvx.program import ABSOLUTE_VALUES, QUADRATIC, Operators, StepProgram
from vemcvx.solvers import as_solver

TIMES = np.linspace(0.0, 1.0, 5)
MINE = '''
"""Newton's answers, handed over in one's own way."""
import numpy as np, vemcvx as vx

class Mine:
    def solve(self, program, target):
        answer = vx.Newton().prepare(program.operators).solve(program, target, np.zeros((program.operators.count, 1)))
        return answer.d, answer.lam, answer.p

class Greedy:
    def __init__(self, appetite):
        self.appetite = appetite
    def solve(self, program, target):
        raise ZeroDivisionError("no steps left")

class Broken(Mine):
    def __init__(self):
        raise RuntimeError("no licence")

class Failing(Mine):
    def solve(self, program, target):
        raise ZeroDivisionError("no steps left")

class Lost(Mine):
    accepts = {"everything"}

ready, three = Greedy(3), 3
'''


class Mine:
    """Newton's answers, handed over as `given` makes of them."""

    def __init__(self, given):
        self._given = given

    def solve(self, program, target):
        start = np.zeros((program.operators.count, program.operators.block))
        return self._given(vx.Newton().prepare(program.operators).solve(program, target, start))


WAYS = {
    "an Answer": lambda a: a,
    "an Answer without p": lambda a: vx.Answer(a.d, a.lam, a.iterations, a.status),
    "(d, lam, p)": lambda a: (a.d, a.lam, a.p),
    "(d, lam, p, iterations)": lambda a: (a.d, a.lam, a.p, 7),
    "(d, lam)": lambda a: (a.d, a.lam),
    "(d, None, p)": lambda a: (a.d, None, a.p),
    "d": lambda a: a.d,
    "lists": lambda a: (a.d.tolist(), a.lam.ravel().tolist()),
}


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("limits", [False, True], ids=["friction", "limits, too"])
def test_however_it_answers_it_is_certified(way, limits):
    """The certificate is Newton's but for the rounding of multipliers that are read off the forces."""
    scene = paper_scene().with_(vx.UnilateralContact(on="top", gap=1e-4)) if limits else paper_scene()
    ours, own = (vx.simulate(scene, small("squares", 4), TIMES, solver=s) for s in (vx.Newton(), Mine(WAYS[way])))
    assert own.certificate.max() <= 1e-6
    apart = np.abs(own.displacement - ours.displacement).max()
    assert apart <= 1e-6 * np.abs(ours.displacement).max()
    assert own.solver == "Mine(accuracy=1e-06)"
    if way == "(d, lam, p, iterations)":
        assert set(own.iterations[1:].tolist()) == {7}


def test_what_it_says_of_itself_is_read():
    class Careful(Mine):
        accuracy = 1e-4
        accepts = (QUADRATIC, ABSOLUTE_VALUES)

    solver = as_solver(Careful(lambda a: a))
    assert (solver.accuracy, solver.accepts) == (1e-4, {QUADRATIC, ABSOLUTE_VALUES})
    scene = paper_scene().with_(vx.UnilateralContact(on="top"))
    with pytest.raises(vx.NotAccepted, match="^solver Careful: the program has bounds, which it does not accept"):
        vx.simulate(scene, small("squares", 3), TIMES, solver=Careful(lambda a: a))


def test_it_gets_multipliers_to_begin_with_if_it_asks_for_them():
    seen = []

    class Warm:
        def solve(self, program, target, lam):
            seen.append(lam)
            return vx.Newton().prepare(program.operators).solve(program, target, lam)

    vx.simulate(paper_scene(), small("squares", 4), TIMES, solver=Warm())
    assert not seen[0].any()
    assert seen[-1].any()


NONSENSE = {
    "nothing": (None, r"found the answer None; it must return vx\.Answer"),
    "words": ("solved", r"d: found 'solved'.*; wanted numbers of shape \(3,\)\."),
    "five things": ((1, 2, 3, 4, 5), r"found the answer \(1, 2, 3, 4, 5\); it must return"),
    "too few increments": (np.zeros(2), r"d: found an array of shape \(2,\); wanted numbers of shape \(3,\)\."),
    "too many multipliers": (
        (np.zeros(3), np.zeros(5)),
        r"lam: found an array of shape \(5,\); wanted numbers of shape \(3, 1\)\.",
    ),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_is_refused_in_one_sentence(case):
    made, words = NONSENSE[case]
    with pytest.raises(vx.SolverFailed, match=f"^solver Mine: {words}"):
        vx.simulate(paper_scene(), small("squares", 3), [0.0, 1.0], solver=Mine(lambda _: made))


@pytest.mark.long
def test_mistakes_in_python():
    def simulate(solver):
        vx.simulate(paper_scene(), small("squares", 3), [0.0, 1.0], solver=solver)

    with pytest.raises(vx.SceneError, match="^solver: found <class .*Mine'>; wanted a solver with its settings"):
        simulate(Mine)
    with pytest.raises(vx.SceneError, match=r"^solver: found 3; wanted a solver .* any object with solve\(program"):
        simulate(3)
    with pytest.raises(vx.SolverFailed, match="^solver Mine: it failed: ZeroDivisionError: division by zero"):
        simulate(Mine(lambda a: 1 / 0))
    vague = Mine(lambda a: a)
    vague.accuracy = "fine"
    with pytest.raises(vx.SceneError, match="^Mine: found accuracy = 'fine'"):
        simulate(vague)


@pytest.mark.parametrize(
    "mesh", [vx.meshes.squares(6), vx.meshes.voronoi(6), vx.meshes.cubes(3)], ids=["corner", "cells", "discs"]
)
def test_increments_alone_are_enough_where_rows_share_unknowns(mesh):
    """On two rough sides that meet, forces read off d stay within their bounds; |d - d*| is rounding."""
    push = (-3.0, -5.0, -5.0)[: mesh.points.shape[1]]
    rough = (
        cls
        for on, bound in (("bottom", 0.5), ("left", 0.3))
        for cls in (vx.UnilateralContact(on), vx.TrescaFriction(bound, on))
    )
    top = vx.Traction(lambda x, t: np.tile(np.multiply(t, push), (len(x), 1)), on="top")
    scene = vx.Scene(vx.Elasticity(1000.0, 0.3), vx.Clamp(on="right"), top, *rough)
    history = vx.simulate(scene, mesh, TIMES, solver=Mine(attrgetter("d")))
    assert history.certificate.max() <= 1e-12


def test_multipliers_are_recovered_in_closed_form():
    """Two unknowns, one slipping and one pressed: what of g is not K d is held by lam and p."""
    operators = Operators(np.diag([2.0, 3.0]), B=vx.Norms(np.eye(2)[:1], 1.0).B, D=vx.Norms(np.eye(2)[1:], 1.0).B)
    program = StepProgram(operators, g=np.array([3.0, 5.0]), w=np.ones(1), b=np.zeros(1), e=np.array([0.5]))
    answer = as_solver(Mine(lambda a: a.d)).prepare(operators).solve(program, 1e-12, np.zeros((1, 1)))
    assert np.allclose(answer.d, [1.0, 0.5], rtol=1e-14, atol=0)
    assert np.allclose(answer.lam, [[1.0]], rtol=1e-14, atol=0)
    assert np.allclose(answer.p, [3.5], rtol=1e-14, atol=0)


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    return tmp_path / "mine.py"


@pytest.mark.long
def test_the_command_line_takes_it_from_a_file(mine):
    problem = str(vx.__path__[0] + "/../problems/feng_han_huang.py")
    done = CliRunner().invoke(app, ["run", problem, "--n", "4", "--steps", "2", "--solver", f"{mine}:Mine"])
    assert done.exit_code == 0, done.output
    assert "solver      Mine(accuracy=1e-06)" in done.output
    failing = CliRunner().invoke(app, ["run", problem, "--n", "4", "--steps", "2", "--solver", f"{mine}:Failing"])
    assert failing.exit_code == 2
    assert "solver Failing: it failed: ZeroDivisionError: no steps left" in failing.output
    assert "Traceback" not in failing.output


def test_of_a_file_it_may_be_an_object_and_a_solver_as_ours(mine):
    assert repr(named_solver(f"{mine}:ready", None)) == "Greedy(accuracy=1e-06, appetite=3)"
    assert named_solver(f"{mine}:Mine", 1e-3).accuracy == 1e-3
    mine.write_text("import vemcvx as vx\nclass Quick(vx.Newton): pass\nbest = vx.OSQP(accuracy=1e-4)\n")
    assert isinstance(named_solver(f"{mine}:Quick", 1e-3), vx.Newton)
    assert named_solver(f"{mine}:best", None) == vx.OSQP(accuracy=1e-4)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Mime", r"--solver: .*mine\.py has no 'Mime'; its solvers are Broken, Failing, Greedy, Lost, Mine\."),
        ("three", r"--solver: .*mine\.py: three is 3; wanted a class with solve\(program, target\)"),
        ("np", r"--solver: .*mine\.py: np is <module .*; wanted a class"),
        ("Greedy", r"mine\.py: Greedy\(\) failed: TypeError: .*appetite"),
        ("Broken", r"mine\.py, line 18: Broken\(\) failed: RuntimeError: no licence"),
        ("Lost", r"solver Lost: found accepts = \{'everything'\}; wanted a set of some of 'absolute values', 'bounds'"),
    ],
)
def test_mistakes_in_a_file(mine, name, words):
    with pytest.raises(vx.VemcvxError, match=words):
        named_solver(f"{mine}:{name}", None)


def test_files_that_are_none(mine, tmp_path):
    with pytest.raises(ProblemError, match=r"other\.py: there is no such file of a solver"):
        named_solver(f"{tmp_path / 'other.py'}:Mine", None)
    mine.write_text("class Mine:\n    solve = 1 / 0\n")
    with pytest.raises(ProblemError, match=r"mine\.py, line 2: executing it failed: ZeroDivisionError"):
        named_solver(f"{mine}:Mine", None)


@pytest.mark.parametrize("name", ["scs", "SCS", "Scs"])
def test_names_of_cvxpy_in_any_case(name):
    assert named_solver(name, 1e-3) == vx.ThroughCvxpy("SCS", 1e-3) == vx.ThroughCvxpy(name, 1e-3)


class Meddles:
    """Answers with Newton, and writes into what it is given."""

    def __init__(self, name):
        self.array = name

    def solve(self, program, target):
        attrgetter(self.array)(program)[:] *= 0.1
        return by_newton(program, target)


def by_newton(program, target):
    still = np.zeros((program.operators.count, program.operators.block))
    return vx.Newton().prepare(program.operators).solve(program, target, still)


@pytest.mark.parametrize("array", ["g", "w", "b", "e", "operators.K", "operators.B.data", "operators.D.data"])
def test_a_program_cannot_be_written_to(array):
    """An answer to other weights was certified to 1e-15, with the weights that it had been given."""
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.tile([3 * t, -t], (len(x), 1)), on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(0.5, on="bottom", while_closed=False),
    )
    with pytest.raises(vx.SolverFailed, match="Meddles: it failed: ValueError: .* read-only"):
        vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0], solver=Meddles(array))


def test_parameters_may_have_any_name():
    class Named:
        def solve(self, p, lam):
            return by_newton(p, lam)

    history = vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=Named())
    assert history.certificate.max() < 1e-6


class Rough:
    """Clarabel's answers, which are about as good as asked for."""

    def __init__(self, semidefinite):
        self.semidefinite = semidefinite

    def solve(self, program, target):
        start = np.zeros((program.operators.count, program.operators.block))
        return vx.Clarabel().prepare(program.operators).solve(program, target, start)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")
def test_a_body_that_contact_alone_holds_is_for_solvers_that_take_a_singular_matrix():
    push = vx.Traction(lambda x, t: np.tile([0.1 * t, -1.0], (len(x), 1)), on="top")
    floor = vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.2, on="bottom")
    asked = vx.Scene(vx.Elasticity(10.0, 0.3), push, *floor), vx.meshes.squares(2), TIMES[:3]
    own, newton = (vx.simulate(*asked, solver=s, initial="settled") for s in (Rough(True), vx.Newton()))
    assert own.certificate.max() <= 1e-6
    apart = np.abs(np.sqrt(own.energy) - np.sqrt(newton.energy)) / np.sqrt(newton.energy.max())
    assert apart.max() < (1 + 1e-9) * (own.certificate_total[-1] + newton.certificate_total[-1])
    with pytest.raises(vx.NotAccepted, match="^solver Rough: only friction and contact hold a body"):
        vx.simulate(*asked, solver=Rough(False), initial="settled")
    with pytest.raises(vx.SceneError, match=r"^solver Rough: semidefinite: found 'no'; wanted True or False\.$"):
        as_solver(Rough("no"))


class Plain(vx.Solver):
    """A solver as a class of one's own: Newton's answers."""

    accepts, made = frozenset({QUADRATIC, ABSOLUTE_VALUES}), staticmethod(lambda answer: answer)

    def __init__(self, accuracy):
        self.accuracy = accuracy

    def prepare(self, operators):
        return self

    def solve(self, program, target, lam, p=None):
        return self.made(vx.Newton().prepare(program.operators).solve(program, target, lam, p))


@pytest.mark.long
def test_a_class_of_ones_own_need_not_be_a_dataclass(tmp_path):
    history = vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 0.5, 1.0], solver=Plain(3e-7))
    history.write(tmp_path / "out")
    assert history.solver == "Plain(accuracy=3e-07)"
    assert history.certificate.max() <= 3e-7
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["accuracy"] == 3e-7
    assert vx.read_history(tmp_path / "out").trajectory.accuracy == 3e-7
    assert (Plain(1e-9).asked(1e-4).accuracy, type(Plain(1e-9).asked(1e-4))) == (1e-4, Plain)
    with pytest.raises(vx.SceneError, match="^Plain: found accuracy = 'fine'"):
        vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=Plain("fine"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lam": np.zeros(4)}, r"lam: found an array of shape \(4,\); wanted numbers of shape \(3, 1\)"),
        ({"d": None}, r"found the answer Answer.*; it must return vx.Answer\(d, lam, iterations\)"),
        ({"iterations": None}, r"found the answer Answer.*; it must return vx.Answer\(d, lam, iterations\)"),
    ],
)
def test_an_answer_that_fits_no_program_is_refused_in_one_sentence(monkeypatch, change, words):
    monkeypatch.setattr(Plain, "made", staticmethod(lambda answer: replace(answer, **change)))
    with pytest.raises(vx.SolverFailed, match=f"^solver Plain: {words}"):
        vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=Plain(1e-6))
