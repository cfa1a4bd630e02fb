"""A solver of one's own: any object with solve(program, target), in Python and on the command line."""

import json
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest
from scenes import mostly_long, paper_scene, small
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.cli.solver_names import make_solver
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


def by(solver, program, target):
    still = np.zeros((program.operators.count, program.operators.block))
    return solver.prepare(program.operators).solve(program, target, still)


class Mine:
    """A solver's answers, handed over as `given` makes of them."""

    def __init__(self, given=lambda answer: answer, solver=None, **told):
        self._given, self._solver = given, solver or vx.Newton()
        for name, value in told.items():
            setattr(self, name, value)

    def solve(self, program, target):
        return self._given(by(self._solver, program, target))


def run(solver, scene=None, n=3, times=(0.0, 1.0)):
    return vx.simulate(scene or paper_scene(), small("squares", n), times, solver=solver)


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
    ours, own = (run(solver, scene, 4, TIMES) for solver in (vx.Newton(), Mine(WAYS[way])))
    assert own.certificate.max() <= 1e-6
    apart = np.abs(own.displacement - ours.displacement).max()
    assert apart <= 1e-6 * np.abs(ours.displacement).max()
    assert own.solver == "Mine(accuracy=1e-06)"
    if way == "(d, lam, p, iterations)":
        assert set(own.iterations[1:].tolist()) == {7}


def test_what_it_says_of_itself_is_read():
    careful = Mine(accuracy=1e-4, accepts=(QUADRATIC, ABSOLUTE_VALUES))
    solver = as_solver(careful)
    assert (solver.accuracy, solver.accepts) == (1e-4, {QUADRATIC, ABSOLUTE_VALUES})
    with pytest.raises(vx.NotAccepted, match="^solver Mine: the program has bounds"):
        run(careful, paper_scene().with_(vx.UnilateralContact(on="top")))


def test_it_gets_multipliers_to_begin_with_if_it_asks_for_them_and_parameters_may_have_any_name():
    seen = []

    class Warm:
        def solve(self, p, target, lam):
            seen.append(lam)
            return vx.Newton().prepare(p.operators).solve(p, target, lam)

    class Named:
        def solve(self, p, lam):
            return by(vx.Newton(), p, lam)

    for solver in (Warm(), Named()):
        assert run(solver, n=4, times=TIMES).certificate.max() < 1e-6
    assert not seen[0].any()
    assert seen[-1].any()


class Plain(vx.Solver):
    """A solver as a class of one's own: Newton's answers."""

    accepts = frozenset({QUADRATIC, ABSOLUTE_VALUES})

    def __init__(self, accuracy, **changes):
        self.accuracy, self._changes = accuracy, changes

    def prepare(self, operators):
        return self

    def solve(self, program, target, lam, p=None):
        return replace(vx.Newton().prepare(program.operators).solve(program, target, lam, p), **self._changes)


NONSENSE = {
    "nothing": (Mine(lambda _: None), "Mine: found the answer None"),
    "words": (Mine(lambda _: "solved"), "Mine: d: found 'solved'"),
    "five things": (Mine(lambda _: (1, 2, 3, 4, 5)), r"Mine: found the answer \(1, 2"),
    "too few increments": (Mine(lambda _: np.zeros(2)), r"Mine: d: found .* \(2,\); wanted .* \(3,\)"),
    "too many multipliers": (Mine(lambda a: (a.d, np.zeros(5))), r"Mine: lam: found .* \(5,\); wanted .* \(3, 1\)"),
    "an error": (Mine(lambda a: 1 / 0), "Mine: it failed: ZeroDivisionError"),
    "four multipliers": (Plain(1e-6, lam=np.zeros(4)), r"Plain: lam: found .* \(4,\); wanted .* \(3, 1\)"),
    "no increments": (Plain(1e-6, d=None), "Plain: found the answer Answer"),
    "no iterations": (Plain(1e-6, iterations=None), "Plain: found the answer Answer"),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_is_refused_by_name(case):
    solver, says = NONSENSE[case]
    with pytest.raises(vx.SolverFailed, match=f"^solver {says}"):
        run(solver)


@pytest.mark.parametrize(
    ("solver", "says"),
    [
        (Mine, "solver: found <class .*Mine'>"),
        (3, "solver: found 3; wanted a solver"),
        (Mine(accuracy="fine"), "Mine: found accuracy = 'fine'"),
        (Plain("fine"), "Plain: found accuracy = 'fine'"),
        (Mine(semidefinite="no"), "solver Mine: semidefinite: found 'no'"),
    ],
)
def test_mistakes_in_python(solver, says):
    with pytest.raises(vx.SceneError, match=f"^{says}"):
        run(solver)


@mostly_long(
    "mesh",
    [vx.meshes.squares(6), small("voronoi", 6), vx.meshes.cubes(3)],
    ids=["corner", "cells", "discs"],
)
def test_increments_alone_are_enough_where_rows_share_unknowns(mesh):
    """On two rough sides that meet, forces read off d stay within their bounds; |d - d*| is rounding."""
    push = (-3.0, -5.0, -5.0)[: mesh.points.shape[1]]
    rough = vx.UnilateralContact(["bottom", "left"]), vx.TrescaFriction(0.5, "bottom"), vx.TrescaFriction(0.3, "left")
    top = vx.Traction(lambda x, t: np.multiply(t, push), on="top")
    scene = vx.Scene(vx.Elasticity(1000.0, 0.3), vx.Clamp(on="right"), top, *rough)
    history = vx.simulate(scene, mesh, TIMES, solver=Mine(attrgetter("d")))
    assert history.certificate.max() <= 1e-12


def test_multipliers_are_recovered_in_closed_form():
    """Two unknowns, one slipping and one pressed: what of g is not K d is held by lam and p."""
    operators = Operators(np.diag([2.0, 3.0]), B=np.eye(2)[:1], D=np.eye(2)[1:])
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
    given = ["run", str(vx.__path__[0] + "/../problems/feng_han_huang.py"), "--n", "4", "--steps", "2", "--solver"]
    done, failing = (CliRunner().invoke(app, [*given, f"{mine}:{name}"]) for name in ("Mine", "Failing"))
    assert done.exit_code == 0, done.output
    assert "solver      Mine(accuracy=1e-06)" in done.output
    assert failing.exit_code == 2
    assert "solver Failing: it failed: ZeroDivisionError: no steps left" in failing.output
    assert "Traceback" not in failing.output


def test_of_a_file_it_may_be_an_object_and_a_solver_as_ours(mine):
    assert repr(make_solver(f"{mine}:ready", None)) == "Greedy(accuracy=1e-06, appetite=3)"
    assert make_solver(f"{mine}:Mine", 1e-3).accuracy == 1e-3
    mine.write_text("import vemcvx as vx\nclass Quick(vx.Newton): pass\nbest = vx.OSQP(accuracy=1e-4)\n")
    assert isinstance(make_solver(f"{mine}:Quick", 1e-3), vx.Newton)
    assert make_solver(f"{mine}:best", None) == vx.OSQP(accuracy=1e-4)
    for name in ("scs", "SCS", "Scs"):
        assert make_solver(name, 1e-3) == vx.ThroughCvxpy("SCS", 1e-3) == vx.ThroughCvxpy(name, 1e-3)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("mine.py:Mime", r"--solver: .*mine\.py has no 'Mime'; its solvers are Broken, Failing, Greedy, Lost, Mine"),
        ("mine.py:three", r"--solver: .*mine\.py: three is 3"),
        ("mine.py:np", r"--solver: .*mine\.py: np is <module"),
        ("mine.py:Greedy", r"mine\.py: Greedy\(\) failed: TypeError"),
        ("mine.py:Broken", r"mine\.py, line 18: Broken\(\) failed: RuntimeError: no licence"),
        ("mine.py:Lost", r"solver Lost: found accepts = \{'everything'\}"),
        ("other.py:Mine", r"other\.py: there is no such file"),
        ("wrong.py:Mine", r"wrong\.py, line 2: executing it failed: ZeroDivisionError"),
    ],
)
def test_mistakes_in_a_file(mine, name, says):
    (mine.parent / "wrong.py").write_text("class Mine:\n    solve = 1 / 0\n")
    with pytest.raises(vx.VemcvxError, match=says):
        make_solver(str(mine.parent / name), None)


@pytest.mark.parametrize("array", ["g", "w", "b", "e", "operators.K", "operators.B.data", "operators.D.data"])
def test_a_program_cannot_be_written_to(array):
    """An answer to other weights was certified to 1e-15, with the weights that it had been given."""

    class Meddles:
        def solve(self, program, target):
            attrgetter(array)(program)[:] *= 0.1
            return by(vx.Newton(), program, target)

    contact = vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.5, on="bottom", while_closed=False)
    scene = paper_scene().without(vx.BilateralContact, vx.TrescaFriction).with_(*contact)
    with pytest.raises(vx.SolverFailed, match="Meddles: it failed: ValueError: .* read-only"):
        run(Meddles(), scene)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")
def test_a_body_that_contact_alone_holds_is_for_solvers_that_take_a_singular_matrix():
    push = vx.Traction(lambda x, t: [0.1 * t, -1.0], on="top")
    floor = vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.2, on="bottom")
    asked = vx.Scene(vx.Elasticity(10.0, 0.3), push, *floor), vx.meshes.squares(2), TIMES[:3]
    rough = Mine(solver=vx.Clarabel(), semidefinite=True)
    own, newton = (vx.simulate(*asked, solver=s, initial="settled") for s in (rough, vx.Newton()))
    assert own.certificate.max() <= 1e-6
    apart = np.abs(np.sqrt(own.energy) - np.sqrt(newton.energy)) / np.sqrt(newton.energy.max())
    assert apart.max() < (1 + 1e-9) * (own.certificate_total[-1] + newton.certificate_total[-1])
    with pytest.raises(vx.NotAccepted, match="^solver Mine: only friction and contact hold a body"):
        vx.simulate(*asked, solver=Mine(solver=vx.Clarabel()), initial="settled")


@pytest.mark.long
def test_a_class_of_ones_own_need_not_be_a_dataclass(tmp_path):
    history = run(Plain(3e-7), times=(0.0, 0.5, 1.0))
    history.write(tmp_path / "out")
    assert history.solver == "Plain(accuracy=3e-07)"
    assert history.certificate.max() <= 3e-7
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["accuracy"] == 3e-7
    assert vx.read_history(tmp_path / "out").trajectory.accuracy == 3e-7
    assert (Plain(1e-9).with_accuracy(1e-4).accuracy, type(Plain(1e-9).with_accuracy(1e-4))) == (1e-4, Plain)
