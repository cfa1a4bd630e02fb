"""What every solver must satisfy: the suite of vemcvx.testing, run over every solver that the package exports.

Solvers that cvxpy finds on a machine besides are asked the same in tests/solvers/test_conformance_found_solvers.py.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable

import cvxpy
import numpy as np
import pytest
from scenes import paper_scene, small

import vemcvx as vx
from vemcvx.program.operators import ABSOLUTE_VALUES, BOUNDS, FEATURES, QUADRATIC, SECOND_ORDER_CONES
from vemcvx.testing import INSTANCES, solver_suite
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
"""Solvers that must answer."""
FOUND = {
    name: vx.ThroughCvxpy(name, accuracy=1e-3) for name in cvxpy.installed_solvers() if name not in ("CLARABEL", "OSQP")
}
FOUND = {name: solver for name, solver in FOUND.items() if QUADRATIC in solver.accepts}
"""Solvers that answer or refuse; those of linear programs accept no step at all (tests/cli/test_cli_compare.py)."""

TIMES = np.linspace(0.0, 1.0, 7)


def scene():
    """The paper's scene under a load that reverses."""
    return paper_scene(lambda t: np.sin(6 * t))


test_every_solver = solver_suite(OWN)


@pytest.mark.parametrize("solver", OWN.values(), ids=OWN)
def test_settings_are_frozen(solver):
    for setting in dataclasses.fields(solver):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(solver, setting.name, None)


@pytest.mark.parametrize("solver", (OWN | FOUND).values(), ids=OWN | FOUND)
def test_an_accuracy_that_means_nothing_makes_no_solver(solver):
    for wrong in (0, 1, 0.0, -1e-6, 2, np.nan, np.inf, "x", None):
        with pytest.raises(
            vx.SceneError, match=rf"^{solver.name}: found accuracy = .*{wrong}.* between 0 and 1, such as 1e-6\.$"
        ):
            dataclasses.replace(solver, accuracy=wrong)


def test_the_instances_have_every_feature_and_stick_and_slip():
    features = [instance.features for instance in INSTANCES.values()]
    assert frozenset().union(*features) == FEATURES
    for instance in INSTANCES.values():
        history = vx.march(instance.system, TESTED)
        if {ABSOLUTE_VALUES, SECOND_ORDER_CONES} & instance.features:
            assert history.sticking[1:].any()
            assert not history.sticking[1:].all()
        if BOUNDS in instance.features:
            # Some limit presses, and some does not, at some instant.
            assert history.pressures.any()
            assert not history.pressures.all()


def test_no_exported_solver_is_missing_from_the_samples():
    exported = {
        thing
        for space in (vx, vx.solvers)
        for thing in vars(space).values()
        if isinstance(thing, type) and issubclass(thing, vx.Solver) and not inspect.isabstract(thing)
    }
    assert exported == {type(solver) for solver in OWN.values()}
    assert {kind.__name__ for kind in exported} <= set(vx.__all__)


@dataclasses.dataclass(frozen=True)
class Liar(vx.Solver):
    """A solver of one's own that spoils Newton's answers, and says they converged."""

    spoil: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    accuracy: float = 1e-6
    accepts = vx.Newton.accepts

    def prepare(self, operators):
        honest, spoil = vx.Newton().prepare(operators), self.spoil

        class Prepared:
            def solve(self, program, target, lam, p=None):
                answer = honest.solve(program, target, lam)
                d, lam = spoil(answer.d, answer.lam)
                return dataclasses.replace(answer, d=d, lam=lam, status="converged")

        return Prepared()


def spoils():
    return {
        "honest": lambda d, lam: (d, lam),
        "nothing moves": lambda d, lam: (0 * d, lam),
        "a hundredth more": lambda d, lam: (1.01 * d, lam),
        "no multipliers": lambda d, lam: (d, 0 * lam),
        "multipliers turned": lambda d, lam: (d, -lam),
        "not a number": lambda d, lam: (d * np.nan, lam),
    }


@pytest.mark.parametrize(("lie", "spoil"), spoils().items(), ids=spoils())
def test_a_solver_is_believed_in_nothing(lie, spoil):
    solver, mesh = Liar(spoil), small("squares", 4)
    if lie == "honest":
        assert vx.simulate(scene(), mesh, TIMES, solver=solver).certificate.max() <= 1e-6
        return
    with pytest.raises(vx.NotCertified, match=r"^step 1 at t = .*Liar reached .*asked was 1\.0e-06"):
        vx.simulate(scene(), mesh, TIMES, solver=solver)


def test_the_smallest_solver_that_accepts_is_chosen_and_named(caplog):
    caplog.set_level("INFO", logger="vemcvx")
    frictionless = vx.simulate(scene().without(vx.TrescaFriction), small("squares", 2), TIMES)
    assert frictionless.solver == repr(vx.Direct())
    assert "solver: Direct" in caplog.text
    assert vx.simulate(scene(), small("squares", 2), TIMES).solver == repr(vx.Newton())
    assert "solver: Newton, the smallest that accepts absolute values, quadratic" in caplog.text


class Honest:
    """Newton's answers: what the spoilt ones below are made of."""

    def solve(self, program, target, lam, p):
        return vx.Newton().prepare(program.operators).solve(program, target, lam, p)


class Careless(Honest):
    """Scales its data in place, which programs do not let it."""

    def solve(self, program, target, lam, p):
        answer = super().solve(program, target, lam, p)
        np.multiply(program.g, 2.0, out=program.g)
        return answer


class Moody(Honest):
    """Adds digits of chance, far below its accuracy."""

    def __init__(self):
        self._rng = np.random.default_rng(0)

    def solve(self, program, target, lam, p):
        answer = super().solve(program, target, lam, p)
        return answer.d * (1 + 1e-12 * self._rng.random()), answer.lam, answer.p


class Counting(Honest):
    """Keeps what it did among its settings."""

    asked = 0

    def solve(self, program, target, lam, p):
        self.asked += 1
        return super().solve(program, target, lam, p)


class Rough(Honest):
    """A thousandth off."""

    def solve(self, program, target, lam, p):
        answer = super().solve(program, target, lam, p)
        return 1.001 * answer.d, answer.lam, answer.p


class Greedy(Honest):
    """Multipliers far beyond their bounds where these bind."""

    def solve(self, program, target, lam, p):
        answer = super().solve(program, target, lam, p)
        return answer.d, 1.5 * answer.lam, answer.p


BROKEN = {
    Careless: "changes_nothing_that_it_is_given",
    Moody: "gives_the_same_answer_twice",
    Counting: "gives_the_same_answer_twice",
    Rough: "answers_within_its_accuracy",
    Greedy: "gives_multipliers_as_admissible_as_it_is_accurate",
}


def failures(solver):
    """Names of the sentences that a solver does not satisfy on one instance."""
    (mark,) = (mark for mark in solver_suite(solver).pytestmark if mark.name == "parametrize")
    found = set()
    for case in (case for case in mark.args[1] if "friction of one component" in case.id):
        try:
            case.values[0]()
        except (AssertionError, ValueError, vx.NotCertified, vx.SolverFailed, pytest.fail.Exception):
            found.add(case.id.rpartition(": ")[2])
    return found


@pytest.mark.long
@pytest.mark.parametrize("kind", BROKEN)
def test_the_suite_finds_what_is_wrong(kind):
    assert BROKEN[kind] in failures(kind())


@pytest.mark.long
def test_the_suite_finds_nothing_wrong_with_a_solver_that_is_not():
    assert failures(Honest()) == set()
