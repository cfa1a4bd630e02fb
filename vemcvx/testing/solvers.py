"""The conformance suite of solvers: small instances, and what every solver must satisfy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import pytest

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import NotAccepted, SceneError
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
from vemcvx.scene.pose import pose_scene, unwarned
from vemcvx.solvers import Newton, Solver
from vemcvx.stepping import Trajectory, march

TIMES: Floats = np.linspace(0.0, 1.0, 6)


@dataclass(frozen=True)
class Instance:
    """A problem: a system in time, made when it is first asked for."""

    name: str
    make: Callable[[], System]

    @cached_property
    def system(self) -> System:
        """The system; its instants are TIMES."""
        with unwarned():  # Friction alone holds some of them.
            return self.make()

    @cached_property
    def features(self) -> frozenset[str]:
        """The features of the instance's programs."""
        return Condensation(self.system).operators.features

    def is_for(self, solver: Solver) -> bool:
        """Return True if the solver accepts the instance's programs."""
        return self.features <= solver.accepts and (self.system.kernel is None or solver.semidefinite)


def block(
    *below: Effect, of: Effect | None = None, held: bool = True, family: str = "squares", n: int = 4
) -> Callable[[], System]:
    """Return the paper's block, held on the right, pulled on the left, on what is below; pulled gently if not held."""

    def pull(x: Floats, t: float) -> Floats:
        course = np.sin(6 * t) if held else 0.02 * np.sin(6 * t)
        return np.column_stack([8 * (1.25 - x[:, 1]) * course, np.full(len(x), -0.5 * course)])

    support = [Clamp(on="right")] if held else []
    scene = Scene(of or Elasticity(200.0, 0.3), *support, Traction(pull, on="left"), *below)
    return lambda: pose_scene(scene, FAMILIES[family](n), TIMES.tolist()).system


def _cube(*below: Effect) -> Callable[[], System]:
    """Return a block in space, held on the right, on what is below, under a pressing load that turns at its top."""

    def pull(x: Floats, t: float) -> Floats:
        size = min(1.0, 4 * t)
        return np.tile(size * np.array([np.cos(6 * t), np.sin(6 * t), -0.6]), (len(x), 1))

    scene = Scene(Elasticity(2.5, 0.25), Clamp(on="right"), Traction(pull, on="top"), *below)
    return lambda: pose_scene(scene, SPACE_FAMILIES["cubes"](2), TIMES.tolist()).system


def sliders(block: int, n: int = 6) -> System:
    """Return unconnected sliders of different stiffness and threshold."""
    rng = np.random.default_rng(0)
    k, w = rng.uniform(1, 3, n), rng.uniform(0.2, 1.5, n)
    push = rng.uniform(-1, 1, (n, block))
    push /= np.linalg.norm(push, axis=1)[:, None]
    return System(
        np.diag(np.repeat(k, block)), lambda t: np.ravel(2 * np.sin(5 * t) * push), Norms(np.eye(n * block), w, block)
    )


def _plain_matrices() -> System:
    """Return a system of three unknowns, in which rows of B and D read several of them."""
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
"""The instances by name; between them they have every feature of programs, and a K with a kernel."""


@dataclass(frozen=True)
class Asked:
    """A step as solvers are asked it, with the gap asked for and multipliers to begin with."""

    program: StepProgram
    target: float
    lam: Floats
    p: Floats

    def arrays(self) -> Iterator[Floats]:
        """Yield the arrays of numbers in it: operators, data, and multipliers to begin from."""
        program, operators = self.program, self.program.operators
        yield from (A if isinstance(A, np.ndarray) else A.toarray() for A in (operators.K, operators.B, operators.D))
        yield from (operators.compliance, *program.data, self.lam, self.p)


@dataclass(frozen=True)
class Case:
    """A solver on an instance."""

    solver: Solver
    instance: Instance
    must_answer: bool

    def marched(self) -> Trajectory:
        """Return the trajectory by the solver, whatever its accuracy."""
        return march(self.instance.system, TIMES, solver=self.solver, check=False)

    def answer(self, asked: Asked) -> Answer:
        """Return the answer of the solver to one step, freshly prepared."""
        prepared = self.solver.prepare(asked.program.operators)
        found = prepared.solve(asked.program, asked.target, asked.lam, asked.p)
        return read_answer(found, asked.program, self.solver.name)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The trajectory by the solver; computed once for all tests."""
        return self.marched()

    @cached_property
    def answers(self) -> tuple[Answer, ...]:
        """The answers of the solver to the steps, each freshly prepared; computed once for all tests."""
        return tuple(map(self.answer, steps_asked(self.instance)))


@cache
def reference(instance: Instance) -> Trajectory:
    """Return Newton's answer, as sharp as it comes."""
    return march(instance.system, TIMES, solver=Newton(accuracy=1e-12), check=False)


@cache
def newtons_step(instance: Instance, n: int, condense: bool) -> Trajectory:
    """Return Newton's step n from the reference, as sharp as it comes."""
    return _step(instance, n, condense, Newton(accuracy=1e-12))


def _step(instance: Instance, n: int, condense: bool, solver: Solver) -> Trajectory:
    start, instants = reference(instance).state[n - 1], TIMES[n - 1 : n + 1]
    return march(instance.system, instants, initial=start, check=False, solver=solver, condense=condense)


@cache
def steps_asked(instance: Instance) -> tuple[Asked, Asked]:
    """Return the first and the last program of a march, as solvers are asked them for a relative error of 1e-6."""
    seen: list[Asked] = []

    class Watch:
        semidefinite = True

        def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats) -> Answer:
            seen.append(Asked(program, target, lam.copy(), p.copy()))
            return Newton().prepare(program.operators).solve(program, target, lam, p)

    # Without terms nothing is left to ask a solver of a condensed program.
    march(instance.system, TIMES, solver=Watch(), condense=len(instance.system.retained) > 0)
    return seen[0], seen[-1]


def refuses_an_accuracy_that_means_nothing(solver: Solver) -> None:
    """An accuracy outside (0, 1) is refused."""
    for wrong in (0, 1, -1e-6, 2, np.nan, np.inf, "x", None):
        with pytest.raises(SceneError, match=f"^{solver.name}: found accuracy"):
            solver.with_accuracy(wrong).check_accuracy()  # type: ignore[arg-type]


def accepts_programs_without_terms(solver: Solver) -> None:
    """A quadratic function is the least that a program is; a solver that cannot minimise one accepts nothing."""
    assert "quadratic" in solver.accepts


def answers_where_rounding_forbids_the_gap(solver: Solver) -> None:
    """Asked for a gap beyond rounding, once and on the smallest instance, it answers as well as it can."""
    smallest = min((one for one in INSTANCES.values() if one.is_for(solver)), key=lambda one: one.system.n)
    asked = steps_asked(smallest)[0]
    answer = Case(solver, smallest, must_answer=False).answer(replace(asked, target=1e-60 * asked.target))
    program = asked.program
    assert np.isfinite(program.certify(program.feasible(answer.d), answer.lam, answer.p).gap)


OF_ANY_SOLVER: list[Callable[[Solver], None]] = [
    refuses_an_accuracy_that_means_nothing,
    accepts_programs_without_terms,
    answers_where_rounding_forbids_the_gap,
]


def refuses_what_it_does_not_accept(case: Case) -> None:
    """The refusal begins with the solver's name and names the features."""
    missing = case.instance.features - case.solver.accepts or {"semidefinite"}
    with pytest.raises(NotAccepted, match=f"^solver {case.solver.name}: ") as refusal:
        march(case.instance.system, TIMES, solver=case.solver)
    for feature in missing:
        assert feature in str(refusal.value)


def answers_within_its_accuracy(case: Case) -> None:
    """The certificate of every step is as small as the accuracy that is asked for."""
    assert not case.must_answer or case.trajectory.certificate.max() <= case.solver.accuracy


def is_as_near_to_newton_as_certified(case: Case) -> None:
    """The first and last step from Newton's states, condensed and on all unknowns: |y - z|_K <= both errors."""
    for n in (1, len(TIMES) - 1):
        for condense in (True, False):
            own, ours = _step(case.instance, n, condense, case.solver), newtons_step(case.instance, n, condense)
            allowed = sum(np.sqrt(2 * run.gap[1]) + np.sqrt(2 * run.floor[1]) for run in (own, ours))
            assert energy_norm(case.instance.system.K, own.state[1] - ours.state[1]) <= allowed


def gives_multipliers_as_admissible_as_it_is_accurate(case: Case) -> None:
    """Making them admissible moves forces, in the norm of K^{-1}, by no more than the error that is asked for."""
    for asked, answer in zip(steps_asked(case.instance), case.answers, strict=True):
        program = asked.program
        lam, p = program.admissible(answer.lam, answer.p, answer.d)
        moved = program.multiplier_force(answer.lam - lam, answer.p - p)
        assert program.operators.factor.energy(moved) <= 2 * asked.target


def agrees_with_itself_warm_and_cold(case: Case) -> None:
    """Begun with no multipliers, or with those of the answer, within both certificates."""
    for asked, first in zip(steps_asked(case.instance), case.answers, strict=True):
        lam, p = asked.program.admissible(first.lam, first.p, first.d)
        for begin in (replace(asked, lam=0 * lam, p=0 * p), replace(asked, lam=lam, p=p)):
            _agree(asked.program, first, case.answer(begin))


def remembers_no_other_step(case: Case) -> None:
    """Prepared once and asked the steps backwards, it answers as when freshly prepared, within both certificates."""
    steps = steps_asked(case.instance)
    prepared = case.solver.prepare(steps[0].program.operators)
    for asked, fresh in zip(reversed(steps), reversed(case.answers), strict=True):
        again = replace(asked.program, operators=steps[0].program.operators)
        _agree(asked.program, prepared.solve(again, asked.target, asked.lam, asked.p), fresh)


def changes_nothing_that_it_is_given(case: Case) -> None:
    """The program and the multipliers to begin with are the same afterwards."""
    asked = steps_asked(case.instance)[1]
    before = [array.copy() for array in asked.arrays()]
    case.answer(asked)
    for array, copy in zip(asked.arrays(), before, strict=True):
        assert np.array_equal(array, copy)


def gives_the_same_answer_twice(case: Case) -> None:
    """The second answer is that of the first to the bit, and the settings are unchanged."""
    settings = repr(case.solver)
    first, again = case.trajectory, case.marched()
    for name in ("state", "multipliers", "pressures", "gap", "iterations"):
        assert np.array_equal(getattr(again, name), getattr(first, name)), name
    assert repr(case.solver) == settings


def does_not_move_without_a_load(case: Case) -> None:
    """Without a load the answer is zero, within both certificates."""
    asked = steps_asked(case.instance)[0]
    program, lam, p = asked.program, 0 * asked.lam, 0 * asked.p
    rest = replace(program, g=0 * program.g, b=0 * program.b, e=np.maximum(program.e, 0.0))
    _agree(rest, case.answer(replace(asked, program=rest)), Answer(0 * program.g, lam, 0, p=p))


def answers_sliders_in_closed_form(case: Case) -> None:
    """k u + w u' / |u'| = f: u_n = u_{n-1} + (1 - w / |q|)_+ q / k, q = f_n - k u_{n-1}, on instances that are this."""
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


OF_EACH_INSTANCE: list[Callable[[Case], None]] = [
    answers_within_its_accuracy,
    is_as_near_to_newton_as_certified,
    gives_multipliers_as_admissible_as_it_is_accurate,
    agrees_with_itself_warm_and_cold,
    remembers_no_other_step,
    changes_nothing_that_it_is_given,
    gives_the_same_answer_twice,
    does_not_move_without_a_load,
    answers_sliders_in_closed_form,
]


def _agree(program: StepProgram, one: Answer, other: Answer) -> None:
    ends = [program.feasible(answer.d) for answer in (one, other)]
    found = [program.certify(d, answer.lam, answer.p) for d, answer in zip(ends, (one, other), strict=True)]
    assert program.operators.energy_norm(ends[0] - ends[1]) <= sum(each.error + each.error_floor for each in found)
