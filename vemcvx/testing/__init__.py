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

from collections.abc import Callable, Mapping
from functools import partial

import pytest

pytest.register_assert_rewrite("vemcvx.testing.solvers", "vemcvx.testing.linear", "vemcvx.testing.effects")

from vemcvx.linear import LinearSolver  # noqa: E402 - pytest first, so that it tells why sentences fail
from vemcvx.solvers import Solver, Solves, as_solver  # noqa: E402
from vemcvx.testing import solvers as of_solvers  # noqa: E402
from vemcvx.testing.effects import SENTENCES, EffectSample, Other  # noqa: E402
from vemcvx.testing.linear import sentences  # noqa: E402
from vemcvx.testing.solvers import INSTANCES, Instance  # noqa: E402

__all__ = ["INSTANCES", "EffectSample", "Instance", "Other", "effect_suite", "linear_suite", "solver_suite"]


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
    cases: Cases = {}
    for name, solver in ((name, as_solver(one)) for name, one in named.items()):
        cases |= {f"{name}: {of_any.__name__}": partial(of_any, solver) for of_any in of_solvers.OF_ANY_SOLVER}
        for instance in INSTANCES.values():
            case = of_solvers.Case(solver, instance, must_answer)
            able = instance.is_for(solver)
            for sentence in of_solvers.OF_EACH_INSTANCE if able else (of_solvers.refuses_what_it_does_not_accept,):
                cases[f"{name}: {instance.name}: {sentence.__name__}"] = partial(sentence, case)
    twice = of_solvers.gives_the_same_answer_twice.__name__
    return _test({words: case for words, case in cases.items() if repeatable or not words.endswith(twice)})


Cases = dict[str, Callable[[], None]]


def _test(cases: Cases) -> Callable[..., None]:
    @pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
    @pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")
    @pytest.mark.parametrize("case", [pytest.param(case, id=words) for words, case in cases.items()])
    def test(case: Callable[[], None]) -> None:
        case()

    return test


def effect_suite(samples: EffectSample | Mapping[str, EffectSample]) -> Callable[..., None]:
    """A test, to be given a name that begins with test_: one case for each sample and sentence.

    Parameters
    ----------
    samples : EffectSample, or mapping of names to samples
        Several where settings of an effect exclude each other.
    """
    named = samples if isinstance(samples, Mapping) else {samples.name: samples}
    each = [(name, sample, sentence) for name, sample in named.items() for sentence in SENTENCES]
    return _test({f"{name}: {sentence.__name__}": partial(sentence, sample) for name, sample, sentence in each})


def linear_suite(solvers: LinearSolver | Mapping[str, LinearSolver]) -> Callable[..., None]:
    """A test, to be given a name that begins with test_: one case for each linear solver and sentence.

    Parameters
    ----------
    solvers : LinearSolver, or mapping of names to linear solvers
    """
    named = solvers if isinstance(solvers, Mapping) else {type(solvers).__name__: solvers}
    each = [(name, linear, *said) for name, linear in named.items() for said in sentences(linear)]
    return _test({f"{name}: {words}": partial(sentence, linear) for name, linear, words, sentence in each})
