"""User-defined solvers: any object with solve(program, target), in Python and on the command line."""

from operator import attrgetter

import numpy as np
import pytest
from called import call
from scenes import mostly_long, paper_scene, small

import vemcvx as vx
from vemcvx.cli.solver_names import make_solver
from vemcvx.program import ABSOLUTE_VALUES, QUADRATIC
from vemcvx.solvers import as_solver

TIMES = np.linspace(0.0, 1.0, 5)
FILE = '''
"""Solvers of a user."""
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

class Quick(vx.Newton):
    pass

ready, three = Greedy(3), 3
'''


def solve(solver, program, target):
    still = np.zeros((program.operators.count, program.operators.block))
    return solver.prepare(program.operators).solve(program, target, still)


class Mine:
    """A solver that returns `convert(answer)` for the answer of another solver."""

    def __init__(self, convert=lambda answer: answer, solver=None, **attributes):
        self._convert, self._solver = convert, solver or vx.Newton()
        for name, value in attributes.items():
            setattr(self, name, value)

    def solve(self, program, target):
        return self._convert(solve(self._solver, program, target))


def run(solver, scene=None, n=3, times=(0.0, 1.0)):
    return vx.simulate(scene or paper_scene(), small("squares", n), times, solver=solver)


FORMS = {
    "an Answer without p": lambda a: vx.Answer(a.d, a.lam, a.iterations, a.status),
    "(d, lam, p, iterations)": lambda a: (a.d, a.lam, a.p, 7),
    "(d, lam)": lambda a: (a.d, a.lam),
    "(d, None, p)": lambda a: (a.d, None, a.p),
    "d": lambda a: a.d,
    "lists": lambda a: (a.d.tolist(), a.lam.ravel().tolist()),
}


@mostly_long("form", FORMS, "d", "(d, lam, p, iterations)")
@pytest.mark.parametrize("limits", [False, True], ids=["friction", "friction and limits"])
def test_answers_of_every_form_are_certified(form, limits):
    scene = paper_scene().with_(vx.UnilateralContact(on="top", gap=1e-4)) if limits else paper_scene()
    ours, own = (run(solver, scene, 4, TIMES) for solver in (vx.Newton(), Mine(FORMS[form])))
    assert own.certificate.max() <= 1e-6
    assert np.abs(own.displacement - ours.displacement).max() <= 1e-6 * np.abs(ours.displacement).max()
    assert own.solver == "Mine(accuracy=1e-06)"
    if form == "(d, lam, p, iterations)":
        assert set(own.iterations[1:].tolist()) == {7}


def test_accuracy_and_accepted_features_are_attributes():
    careful = Mine(accuracy=1e-4, accepts=(QUADRATIC, ABSOLUTE_VALUES))
    solver = as_solver(careful)
    assert (solver.accuracy, solver.accepts) == (1e-4, {QUADRATIC, ABSOLUTE_VALUES})
    with pytest.raises(vx.NotAccepted, match="^solver Mine: the program has bounds"):
        run(careful, paper_scene().with_(vx.UnilateralContact(on="top")))


def test_a_third_parameter_receives_the_last_multipliers_and_parameters_may_have_any_name():
    received = []

    class Warm:
        def solve(self, p, accuracy, lam):
            received.append(lam)
            return vx.Newton().prepare(p.operators).solve(p, accuracy, lam)

    assert run(Warm(), n=4, times=TIMES).certificate.max() < 1e-6
    assert not received[0].any()
    assert received[-1].any()


@mostly_long("mesh", [vx.meshes.squares(6), small("voronoi", 6), vx.meshes.cubes(3)], ids=["corner", "cells", "discs"])
def test_increments_suffice_where_rows_share_unknowns(mesh):
    """Two rough sides meet in a corner, and the solver returns no multipliers."""
    push = (-3.0, -5.0, -5.0)[: mesh.points.shape[1]]
    rough = vx.UnilateralContact(["bottom", "left"]), vx.TrescaFriction(0.5, "bottom"), vx.TrescaFriction(0.3, "left")
    top = vx.Traction(lambda x, t: np.multiply(t, push), on="top")
    scene = vx.Scene(vx.Elasticity(1000.0, 0.3), vx.Clamp(on="right"), top, *rough)
    history = vx.simulate(scene, mesh, TIMES, solver=Mine(attrgetter("d")))
    assert history.certificate.max() <= 1e-12


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    return tmp_path / "mine.py"


@pytest.mark.long
def test_the_command_line_runs_a_solver_from_a_file(mine):
    code, output = call("run", "feng_han_huang", "--n", "4", "--steps", "2", "--solver", f"{mine}:Mine")
    assert code == 0, output
    assert "solver      Mine(accuracy=1e-06)" in output
    code, output = call("run", "feng_han_huang", "--n", "4", "--steps", "2", "--solver", f"{mine}:ready")
    assert code == 2
    assert "solver Greedy: it failed: ZeroDivisionError: no steps left" in output
    assert "Traceback" not in output


def test_solvers_are_objects_or_classes_of_a_file_or_names_of_cvxpy(mine):
    assert repr(make_solver(f"{mine}:ready", None)) == "Greedy(accuracy=1e-06, appetite=3)"
    assert make_solver(f"{mine}:Mine", 1e-3).accuracy == 1e-3
    assert isinstance(make_solver(f"{mine}:Quick", 1e-3), vx.Newton)
    for name in ("scs", "SCS"):
        assert make_solver(name, 1e-3) == vx.ThroughCvxpy("SCS", 1e-3) == vx.ThroughCvxpy(name, 1e-3)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mine.py:Mime", r"--solver: .*mine\.py has no 'Mime'; its solvers are Broken, Greedy, Mine"),
        ("mine.py:three", r"--solver: .*mine\.py: three is 3"),
        ("mine.py:Broken", r"mine\.py, line \d+: Broken\(\) failed: RuntimeError: no licence"),
        ("other.py:Mine", r"other\.py: there is no such file"),
        ("wrong.py:Mine", r"wrong\.py, line 2: executing it failed: ZeroDivisionError"),
    ],
)
def test_mistakes_in_a_file_are_named(mine, name, message):
    (mine.parent / "wrong.py").write_text("class Mine:\n    solve = 1 / 0\n")
    with pytest.raises(vx.VemcvxError, match=message):
        make_solver(str(mine.parent / name), None)


@pytest.mark.parametrize("array", ["g", "w", "b", "e", "operators.K", "operators.B.data", "operators.D.data"])
def test_arrays_of_a_program_are_read_only(array):
    class Meddles:
        def solve(self, program, target):
            attrgetter(array)(program)[:] *= 0.1
            return solve(vx.Newton(), program, target)

    contact = vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.5, on="bottom", while_closed=False)
    scene = paper_scene().without(vx.BilateralContact, vx.TrescaFriction).with_(*contact)
    with pytest.raises(vx.SolverFailed, match="Meddles: it failed: ValueError: .* read-only"):
        run(Meddles(), scene)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")
def test_only_solvers_that_declare_semidefinite_receive_a_singular_matrix():
    push = vx.Traction(lambda x, t: [0.1 * t, -1.0], on="top")
    floor = vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.2, on="bottom")
    problem = vx.Scene(vx.Elasticity(10.0, 0.3), push, *floor), vx.meshes.squares(2), TIMES[:3]
    solver = Mine(solver=vx.Clarabel(), semidefinite=True)
    assert vx.simulate(*problem, solver=solver, initial="settled").certificate.max() <= 1e-6
    with pytest.raises(vx.NotAccepted, match="^solver Mine: only friction and contact hold a body"):
        vx.simulate(*problem, solver=Mine(solver=vx.Clarabel()), initial="settled")
