"""The conformance suite of vemcvx.testing, for all exported solvers and all solvers that cvxpy finds."""

import dataclasses
import inspect

import cvxpy
import numpy as np
import pytest
from scenes import long_cases, paper_scene, small

import vemcvx as vx
from vemcvx.program import ABSOLUTE_VALUES, BOUNDS, QUADRATIC, SECOND_ORDER_CONES
from vemcvx.program.operators import FEATURES
from vemcvx.testing import solver_suite
from vemcvx.testing.solvers import INSTANCES
from vemcvx.testing.solvers import TIMES as TESTED

pytestmark = pytest.mark.arithmetic

OWN = {
    "Newton": vx.Newton(),
    "Clarabel": vx.Clarabel(),
    "Clarabel, polished": vx.Clarabel(accuracy=1e-8, polish=True),
    "OSQP": vx.OSQP(),
    "Direct": vx.Direct(),
    "ThroughCvxpy": vx.ThroughCvxpy("CLARABEL", accuracy=1e-3),
}
"""Solvers that must answer every program they accept."""
OTHERS = {*cvxpy.installed_solvers()} - {"CLARABEL", "OSQP", "PROXQP"}  # the last digits of PROXQP vary
FOUND = {name: vx.ThroughCvxpy(name, accuracy=1e-3) for name in sorted(OTHERS)}
FOUND = {name: solver for name, solver in FOUND.items() if QUADRATIC in solver.accepts}
"""Solvers that may refuse a program. Solvers for linear programs are left out."""

TIMES = np.linspace(0.0, 1.0, 7)


def make_scene():
    """Return the scene of Feng, Han and Huang under a load that reverses."""
    return paper_scene(lambda t: np.sin(6 * t))


FAST = "Newton", "Direct"
test_fast_solvers = long_cases(
    solver_suite({name: OWN[name] for name in FAST}),
    lambda case: case.endswith("agrees_with_newton_within_both_certificates") and ": contact and friction:" not in case,
)
test_conic_solvers = pytest.mark.long(solver_suite({name: OWN[name] for name in OWN if name not in FAST}))
test_found_solvers = pytest.mark.long(solver_suite(FOUND, must_answer=False))


@pytest.mark.parametrize("solver", OWN.values(), ids=OWN)
def test_settings_are_frozen_and_wrong_accuracies_refused(solver):
    with pytest.raises(dataclasses.FrozenInstanceError):
        solver.accuracy = None
    for wrong in (0, 1, -1e-6, np.nan, "x", None):
        with pytest.raises(vx.SceneError, match=rf"^{solver.name}: found accuracy = .*{wrong}.* between 0 and 1"):
            dataclasses.replace(solver, accuracy=wrong)


@pytest.mark.long
def test_instances_of_the_suite_have_every_feature_and_stick_and_slip():
    features = [instance.features for instance in INSTANCES.values()]
    assert frozenset().union(*features) == FEATURES
    for instance in INSTANCES.values():
        history = vx.march(instance.system, TESTED)
        if {ABSOLUTE_VALUES, SECOND_ORDER_CONES} & instance.features:
            assert history.sticking[1:].any()
            assert not history.sticking[1:].all()
        if BOUNDS in instance.features:
            # The limits become active and inactive.
            assert history.pressures.any()
            assert not history.pressures.all()


def test_the_suite_tests_every_exported_solver():
    things = [getattr(space, name) for space in (vx, vx.solvers) for name in space.__all__]
    kinds = [thing for thing in things if isinstance(thing, type) and issubclass(thing, vx.Solver)]
    exported = {kind for kind in kinds if not inspect.isabstract(kind)}
    assert exported == {type(solver) for solver in OWN.values()}
    assert {kind.__name__ for kind in exported} <= set(vx.__all__)


def test_unknown_options_of_a_solver_are_refused_by_name():
    with pytest.raises(vx.NotAccepted, match="^solver Clarabel: refused the options {'speed': 9}"):
        vx.simulate(make_scene(), small("squares", 2), TIMES, solver=vx.Clarabel(options={"speed": 9}))


class Spoilt:
    """A solver that returns `spoil(answer, program)` in place of Newton's answer."""

    def __init__(self, spoil=lambda answer, program: answer):
        self._spoil = spoil

    def solve(self, program, target, lam, p):
        return self._spoil(vx.Newton().prepare(program.operators).solve(program, target, lam, p), program)


MISTAKES = {
    "d one per cent too large": lambda a: {"d": 1.01 * a.d},
    "multipliers reversed": lambda a: {"lam": -a.lam},
    "not a number": lambda a: {"d": a.d * np.nan},
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_wrong_answers_are_not_certified(mistake):
    solver = Spoilt(lambda a, program: dataclasses.replace(a, status="converged", **MISTAKES[mistake](a)))
    message = r"^step 1 at t = .*Spoilt reached .*but 1\.0e-06 was requested(?!.*Round-off)"
    with pytest.raises(vx.NotCertified, match=message) as caught:
        vx.simulate(make_scene(), small("squares", 4), TIMES, solver=solver)
    assert ("The largest part of the gap is at node" in str(caught.value)) == ("multipliers" in mistake)
    assert (caught.value.step, caught.value.time, caught.value.asked) == (1, TIMES[1], 1e-6)
    assert caught.value.reached > 1e-6


def test_the_most_specialised_solver_that_accepts_the_program_is_chosen_and_named(caplog):
    caplog.set_level("INFO", logger="vemcvx")
    frictionless = vx.simulate(make_scene().without(vx.TrescaFriction), small("squares", 2), TIMES)
    assert frictionless.solver == repr(vx.Direct())
    assert "solver: Direct" in caplog.text
    assert vx.simulate(make_scene(), small("squares", 2), TIMES).solver == repr(vx.Newton())
    assert "solver: Newton, the default for absolute values, quadratic" in caplog.text


CHANCE = np.random.default_rng(0)
VIOLATIONS = {
    "leaves_its_input_unchanged": Spoilt(lambda a, program: np.multiply(program.g, 2.0, out=program.g)),
    "gives_the_same_answer_twice": Spoilt(lambda a, program: (a.d * (1 + 1e-12 * CHANCE.random()), a.lam, a.p)),
    "answers_within_its_accuracy": Spoilt(lambda a, program: (1.001 * a.d, a.lam, a.p)),
    "gives_nearly_admissible_multipliers": Spoilt(lambda a, program: (a.d, 1.5 * a.lam, a.p)),
}
"""Solvers that violate a property of the suite, by the name of the property."""


def find_violations(solver):
    """Return the names of the properties that a solver violates on one instance."""
    (mark,) = (mark for mark in solver_suite(solver).pytestmark if mark.name == "parametrize")
    found = set()
    for case in (case for case in mark.args[1] if "friction of one component" in case.id):
        try:
            case.values[0]()
        except (AssertionError, ValueError, vx.NotCertified, vx.SolverFailed, pytest.fail.Exception):
            found.add(case.id.rpartition(": ")[2])
    return found


@pytest.mark.long
def test_the_suite_finds_each_violation_and_none_in_a_right_solver():
    for name, solver in VIOLATIONS.items():
        assert name in find_violations(solver)
    assert find_violations(Spoilt()) == set()
