"""Tests for solvers, linear solvers and effects of one's own: what every one of them must satisfy.

In a file of tests::

    from vemcvx.testing import EffectSample, effect_suite, linear_suite, solver_suite
    test_my_solver = solver_suite(MySolver())
    test_my_linear_solver = linear_suite(MyLinearSolver())
    test_my_effect = effect_suite(EffectSample(MyEffect(...), beside=(...), others={...}))

A solver is tested on the problems whose features it accepts, and that it refuses the others; a linear solver that
eliminates is tested for that, too; an effect in the scene of its sample. This needs pytest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import pytest

pytest.register_assert_rewrite("vemcvx.testing.solvers", "vemcvx.testing.linear", "vemcvx.testing.effects")

from vemcvx.linear import LinearSolver  # noqa: E402 - pytest first, so that it tells why sentences fail
from vemcvx.solvers import Solver, Solves, as_solver  # noqa: E402
from vemcvx.testing.effects import (  # noqa: E402
    SENTENCES,
    EffectSample,
    Other,
)
from vemcvx.testing.linear import sentences  # noqa: E402
from vemcvx.testing.solvers import (  # noqa: E402
    INSTANCES,
    OF_ANY_SOLVER,
    OF_EACH_INSTANCE,
    Case,
    Instance,
    refuses_what_it_does_not_accept,
)

__all__ = ["INSTANCES", "EffectSample", "Instance", "Other", "effect_suite", "linear_suite", "solver_suite"]

ON_DIGITS = ("gives_the_same_answer_twice", "knows_no_units")
"""Sentences about every digit."""


def solver_suite(
    solvers: Solver | Solves | Mapping[str, Solver | Solves], *, must_answer: bool = True, repeatable: bool = True
) -> Callable[..., None]:
    """A test, to be given a name that begins with test_: one case for each solver, sentence and instance.

    Parameters
    ----------
    solvers : solver, or mapping of names to solvers
        Solvers, or objects with `solve(program, target)`.
    must_answer : bool
        Otherwise a solver may also miss its accuracy, as long as that is said by its name.
    repeatable : bool
        Otherwise the last digits of its answers may differ from time to time.
    """
    named = solvers if isinstance(solvers, Mapping) else {as_solver(solvers).name: solvers}
    cases = [case for name, solver in named.items() for case in _cases(name, as_solver(solver), must_answer)]
    return _test([case for case in cases if repeatable or not case.id.endswith(ON_DIGITS)])


def _test(cases: list[Any]) -> Callable[..., None]:
    @pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
    @pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")
    @pytest.mark.parametrize("case", cases)
    def test(case: Callable[[], None]) -> None:
        case()

    return test


def _cases(name: str, solver: Solver, must_answer: bool) -> Iterator[Any]:
    """The cases of one solver, as parameters of a test."""
    for of_any in OF_ANY_SOLVER:
        yield pytest.param(partial(of_any, solver), id=f"{name}: {of_any.__name__}")
    for instance in INSTANCES.values():
        able = instance.features <= solver.accepts
        case = Case(solver, instance, must_answer)
        for sentence in OF_EACH_INSTANCE if able else (refuses_what_it_does_not_accept,):
            yield pytest.param(partial(sentence, case), id=f"{name}: {instance.name}: {sentence.__name__}")


def effect_suite(samples: EffectSample | Mapping[str, EffectSample]) -> Callable[..., None]:
    """A test, to be given a name that begins with test_: one case for each sample and sentence.

    Parameters
    ----------
    samples : EffectSample, or mapping of names to samples
        Several where settings of an effect exclude each other.
    """
    named = samples if isinstance(samples, Mapping) else {samples.name: samples}
    return _test(
        [
            pytest.param(partial(sentence, sample), id=f"{name}: {sentence.__name__}")
            for name, sample in named.items()
            for sentence in SENTENCES
        ]
    )


def linear_suite(solvers: LinearSolver | Mapping[str, LinearSolver]) -> Callable[..., None]:
    """A test, to be given a name that begins with test_: one case for each linear solver and sentence.

    Parameters
    ----------
    solvers : LinearSolver, or mapping of names to linear solvers
    """
    named = solvers if isinstance(solvers, Mapping) else {type(solvers).__name__: solvers}
    return _test(
        [
            pytest.param(partial(sentence, linear), id=f"{name}: {words}")
            for name, linear in named.items()
            for words, sentence in sentences(linear)
        ]
    )
