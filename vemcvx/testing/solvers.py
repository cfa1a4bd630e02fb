"""Test problems and properties for the conformance suite of solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import pytest

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import NotAccepted
from vemcvx.effects import (
    BilateralContact,
    Clamp,
    Effect,
    Elasticity,
    NormalCompliance,
    Traction,
    TrescaFriction,
    UnilateralContact,
)
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES
from vemcvx.program import Limits, Norms, System
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import energy_norm
from vemcvx.program.step_program import Answer, StepProgram, read_answer
from vemcvx.scene import Scene
from vemcvx.scene.pose import pose_scene, suppress_scene_warnings
from vemcvx.solvers import Newton, Solver
from vemcvx.stepping import Trajectory, march

TIMES: Floats = np.linspace(0.0, 1.0, 6)


@dataclass(frozen=True)
class Instance:
    """A test problem."""

    name: str
    make: Callable[[], System]

    @cached_property
    def system(self) -> System:
        """The system, posed for the instants TIMES."""
        with suppress_scene_warnings():  # Posing warns if only friction holds a body.
            return self.make()

    @cached_property
    def features(self) -> frozenset[str]:
        """The features of the programs."""
        return Condensation(self.system).operators.features

    def is_for(self, solver: Solver) -> bool:
        """Return True if the solver accepts the programs."""
        return self.features <= solver.accepts and (self.system.kernel is None or solver.semidefinite)


def block(
    *below: Effect, of: Effect | None = None, held: bool = True, family: str = "squares", n: int = 4
) -> Callable[[], System]:
    """Return a function that poses a block, clamped if `held`."""

    def pull(x: Floats, t: float) -> Floats:
        course = np.sin(6 * t) if held else 0.02 * np.sin(6 * t)
        return np.column_stack([8 * (1.25 - x[:, 1]) * course, np.full(len(x), -0.5 * course)])

    support = [Clamp(on="right")] if held else []
    scene = Scene(of or Elasticity(200.0, 0.3), *support, Traction(pull, on="left"), *below)
    return lambda: pose_scene(scene, FAMILIES[family](n), TIMES.tolist()).system


def _cube(*below: Effect) -> Callable[[], System]:

    def pull(x: Floats, t: float) -> Floats:
        size = min(1.0, 4 * t)
        return np.tile(size * np.array([np.cos(6 * t), np.sin(6 * t), -0.6]), (len(x), 1))

    scene = Scene(Elasticity(2.5, 0.25), Clamp(on="right"), Traction(pull, on="top"), *below)
    return lambda: pose_scene(scene, SPACE_FAMILIES["cubes"](2), TIMES.tolist()).system


def sliders(block: int) -> System:
    """Return six uncoupled sliders with `block` components."""
    n, rng = 6, np.random.default_rng(0)
    k, w = rng.uniform(1, 3, n), rng.uniform(0.2, 1.5, n)
    push = rng.uniform(-1, 1, (n, block))
    push /= np.linalg.norm(push, axis=1)[:, None]
    return System(
        np.diag(np.repeat(k, block)), lambda t: np.ravel(2 * np.sin(5 * t) * push), Norms(np.eye(n * block), w, block)
    )


def _plain_matrices() -> System:
    K = [[4.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 5.0]]
    norms = Norms([[1.0, -1.0, 0.0], [0.0, 0.6, 0.8]], [0.3, 0.5])
    return System(K, lambda t: [3 * t, -t, 2 * t * (1 - t)], norms, limits=Limits([[1.0, 1.0, 0.0]], [0.4]))


FRICTION = BilateralContact(on="bottom"), TrescaFriction(4.0, on="bottom")
INSTANCES = {
    name: Instance(name, make)
    for name, make in {
        "no terms": block(),
        "friction": block(*FRICTION),
        "contact": block(UnilateralContact(on="bottom", gap=1e-4)),
        "contact and friction": block(UnilateralContact(on="bottom"), TrescaFriction(1.0, on="bottom")),
        "compliant contact": block(NormalCompliance(1e3, on="bottom"), TrescaFriction(1.0, on="bottom")),
        "a kernel": block(BilateralContact(on="bottom"), TrescaFriction(0.16, on="bottom"), held=False),
        "friction of one component": lambda: sliders(1),
        "friction of two components": lambda: sliders(2),
        "friction in space": _cube(BilateralContact(on="bottom"), TrescaFriction(0.6, on="bottom")),
        "contact and friction in space": _cube(UnilateralContact(on="bottom"), TrescaFriction(0.5, on="bottom")),
        "plain matrices": _plain_matrices,
    }.items()
}
"""The test problems by name. They cover all features of programs."""


@dataclass(frozen=True)
class Request:
    """The input of a solver: the program of a step, the requested gap, and initial multipliers."""

    program: StepProgram
    target: float
    lam: Floats
    p: Floats

    def arrays(self) -> Iterator[Floats]:
        """Yield the arrays of operators, data and initial multipliers."""
        program, operators = self.program, self.program.operators
        yield from (A if isinstance(A, np.ndarray) else A.toarray() for A in (operators.K, operators.B, operators.D))
        yield from (operators.compliance, *program.data, self.lam, self.p)


@dataclass(frozen=True)
class Case:
    """A solver and a test problem."""

    solver: Solver
    instance: Instance
    must_answer: bool

    def march(self) -> Trajectory:
        """Return a new trajectory of the solver."""
        return march(self.instance.system, TIMES, solver=self.solver, check=False)

    def answer(self, request: Request) -> Answer:
        """Prepare the solver anew, and return the answer to a request."""
        prepared = self.solver.prepare(request.program.operators)
        found = prepared.solve(request.program, request.target, request.lam, request.p)
        return read_answer(found, request.program, self.solver.name)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The trajectory of the solver."""
        return self.march()

    @cached_property
    def answers(self) -> tuple[Answer, ...]:
        """The answers to `record_requests`."""
        return tuple(map(self.answer, record_requests(self.instance)))


@cache
def reference(instance: Instance) -> Trajectory:
    return march(instance.system, TIMES, solver=Newton(accuracy=1e-12), check=False)


@cache
def newtons_step(instance: Instance, n: int, condense: bool) -> Trajectory:
    return _step(instance, n, condense, Newton(accuracy=1e-12))


def _step(instance: Instance, n: int, condense: bool, solver: Solver) -> Trajectory:
    start, instants = reference(instance).state[n - 1], TIMES[n - 1 : n + 1]
    return march(instance.system, instants, initial=start, check=False, solver=solver, condense=condense)


@cache
def record_requests(instance: Instance) -> tuple[Request, Request]:
    """Return the first and the last request that a solver receives in a march."""
    seen: list[Request] = []

    class Watch:
        semidefinite = True

        def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats) -> Answer:
            seen.append(Request(program, target, lam.copy(), p.copy()))
            return Newton().prepare(program.operators).solve(program, target, lam, p)

    # A condensed program without terms would have no unknowns.
    march(instance.system, TIMES, solver=Watch(), condense=len(instance.system.retained) > 0)
    return seen[0], seen[-1]


def accepts_programs_without_terms(solver: Solver) -> None:
    assert "quadratic" in solver.accepts


def answers_if_the_gap_is_below_rounding(solver: Solver) -> None:
    smallest = min((one for one in INSTANCES.values() if one.is_for(solver)), key=lambda one: one.system.n)
    request = record_requests(smallest)[0]
    answer = Case(solver, smallest, must_answer=False).answer(replace(request, target=1e-60 * request.target))
    program = request.program
    assert np.isfinite(program.certify(program.feasible(answer.d), answer.lam, answer.p).gap)


SOLVER_PROPERTIES: list[Callable[[Solver], None]] = [
    accepts_programs_without_terms,
    answers_if_the_gap_is_below_rounding,
]


def refuses_unaccepted_features(case: Case) -> None:
    missing = case.instance.features - case.solver.accepts or {"semidefinite"}
    with pytest.raises(NotAccepted, match=f"^solver {case.solver.name}: ") as refusal:
        march(case.instance.system, TIMES, solver=case.solver)
    for feature in missing:
        assert feature in str(refusal.value)


def answers_within_its_accuracy(case: Case) -> None:
    assert not case.must_answer or case.trajectory.certificate.max() <= case.solver.accuracy


def agrees_with_newton_within_both_certificates(case: Case) -> None:
    for n in (1, len(TIMES) - 1):
        for condense in (True, False):
            own, ours = _step(case.instance, n, condense, case.solver), newtons_step(case.instance, n, condense)
            allowed = sum(np.sqrt(2 * run.gap[1]) + np.sqrt(2 * run.floor[1]) for run in (own, ours))
            assert energy_norm(case.instance.system.K, own.state[1] - ours.state[1]) <= allowed


def gives_nearly_admissible_multipliers(case: Case) -> None:
    for request, answer in zip(record_requests(case.instance), case.answers, strict=True):
        program = request.program
        lam, p = program.admissible(answer.lam, answer.p, answer.d)
        moved = program.operators.multiplier_force(answer.lam - lam, answer.p - p)
        assert program.operators.factor.energy(moved) <= 2 * request.target


def agrees_with_itself_warm_and_cold(case: Case) -> None:
    for request, first in zip(record_requests(case.instance), case.answers, strict=True):
        lam, p = request.program.admissible(first.lam, first.p, first.d)
        for begin in (replace(request, lam=0 * lam, p=0 * p), replace(request, lam=lam, p=p)):
            _agree(request.program, first, case.answer(begin))


def remembers_no_other_step(case: Case) -> None:
    steps = record_requests(case.instance)
    prepared = case.solver.prepare(steps[0].program.operators)
    for request, fresh in zip(reversed(steps), reversed(case.answers), strict=True):
        again = replace(request.program, operators=steps[0].program.operators)
        _agree(request.program, prepared.solve(again, request.target, request.lam, request.p), fresh)


def leaves_its_input_unchanged(case: Case) -> None:
    request = record_requests(case.instance)[1]
    before = [array.copy() for array in request.arrays()]
    case.answer(request)
    for array, copy in zip(request.arrays(), before, strict=True):
        assert np.array_equal(array, copy)


def gives_the_same_answer_twice(case: Case) -> None:
    settings = repr(case.solver)
    first, again = case.trajectory, case.march()
    for name in ("state", "multipliers", "pressures", "gap", "iterations"):
        assert np.array_equal(getattr(again, name), getattr(first, name)), name
    assert repr(case.solver) == settings


def does_not_move_without_a_load(case: Case) -> None:
    request = record_requests(case.instance)[0]
    program, lam, p = request.program, 0 * request.lam, 0 * request.p
    rest = replace(program, g=0 * program.g, b=0 * program.b, e=np.maximum(program.e, 0.0))
    _agree(rest, case.answer(replace(request, program=rest)), Answer(0 * program.g, lam, 0, p=p))


def answers_sliders_in_closed_form(case: Case) -> None:
    """Check that sliders move by (1 - w / |q|)_+ q / k with q = load_n - k u_{n-1}, stiffness k, friction bound w."""
    components = {"friction of one component": 1, "friction of two components": 2}.get(case.instance.name)
    if components is None:
        return
    system, found = sliders(components), case.trajectory
    k, norms = system.K.diagonal(), system.norms
    assert norms is not None
    u, held = np.zeros((len(TIMES), len(k))), np.repeat(norms.weights(0.0), components)
    for n, t in enumerate(TIMES[1:], start=1):
        q = system.force(float(t)) - k * u[n - 1]
        size = np.repeat(np.linalg.norm(q.reshape(-1, components), axis=1), components)
        u[n] = u[n - 1] + (size > held) * (1 - held / np.where(size > 0, size, 1.0)) * q / k
    allowed = np.cumsum(np.sqrt(2 * found.gap) + np.sqrt(2 * found.floor))
    assert (np.sqrt((found.state - u) ** 2 @ k) <= allowed).all()


INSTANCE_PROPERTIES: list[Callable[[Case], None]] = [
    answers_within_its_accuracy,
    agrees_with_newton_within_both_certificates,
    gives_nearly_admissible_multipliers,
    agrees_with_itself_warm_and_cold,
    remembers_no_other_step,
    leaves_its_input_unchanged,
    gives_the_same_answer_twice,
    does_not_move_without_a_load,
    answers_sliders_in_closed_form,
]


def _agree(program: StepProgram, one: Answer, other: Answer) -> None:
    ends = [program.feasible(answer.d) for answer in (one, other)]
    found = [program.certify(d, answer.lam, answer.p) for d, answer in zip(ends, (one, other), strict=True)]
    assert program.operators.energy_norm(ends[0] - ends[1]) <= sum(each.error + each.error_floor for each in found)
