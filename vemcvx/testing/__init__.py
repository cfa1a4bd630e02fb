"""Conformance tests for users' solvers, linear solvers and effects.

In a test file::

    from vemcvx.testing import EffectSample, effect_suite, linear_suite, solver_suite
    test_my_solver = solver_suite(MySolver())
    test_my_linear_solver = linear_suite(MyLinearSolver())
    test_my_effect = effect_suite(EffectSample(MyEffect(...), beside=(...), others={...}))

A solver must solve all test problems whose features are in `accepts`, and refuse all others. An effect is
tested in the scene of an EffectSample. pytest is required.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import pytest

pytest.register_assert_rewrite("vemcvx.testing.solvers", "vemcvx.testing.linear", "vemcvx.testing.effects")

from vemcvx.linear import LinearSolver  # noqa: E402 - after the registration above
from vemcvx.solvers import Solver, Solves, as_solver  # noqa: E402
from vemcvx.testing import solvers as conformance  # noqa: E402
from vemcvx.testing.effects import PROPERTIES, EffectSample  # noqa: E402
from vemcvx.testing.linear import linear_properties  # noqa: E402
from vemcvx.testing.solvers import INSTANCES  # noqa: E402

__all__ = ["EffectSample", "effect_suite", "linear_suite", "solver_suite"]


def solver_suite(
    solvers: Solver | Solves | Mapping[str, Solver | Solves], *, must_answer: bool = True
) -> Callable[..., None]:
    """Return a test with one case per solver, property and test problem. Assign the test to a name test_*.

    Parameters
    ----------
    solvers : solver, or mapping of names to solvers
        Solvers, or objects with `solve(program, target)`.
    must_answer : bool
        True: the test fails if a solver misses the accuracy.

    Returns
    -------
    callable
        A parametrised test for pytest.

    Raises
    ------
    SceneError
        An object has no method `solve`, or its `accepts` has a word that is no feature of programs.

    Examples
    --------
    >>> from vemcvx.testing import solver_suite
    >>> test_newton = solver_suite(vx.Newton())
    """
    named = solvers if isinstance(solvers, Mapping) else {as_solver(solvers).name: solvers}
    cases: Cases = {}
    for name, solver in ((name, as_solver(one)) for name, one in named.items()):
        cases |= {f"{name}: {each.__name__}": partial(each, solver) for each in conformance.SOLVER_PROPERTIES}
        for instance in INSTANCES.values():
            case = conformance.Case(solver, instance, must_answer)
            refusal = [conformance.refuses_unaccepted_features]
            for check in conformance.INSTANCE_PROPERTIES if instance.is_for(solver) else refusal:
                cases[f"{name}: {instance.name}: {check.__name__}"] = partial(check, case)
    return _test(cases)


Cases = dict[str, Callable[[], None]]


def _test(cases: Cases) -> Callable[..., None]:
    @pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
    @pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")
    @pytest.mark.parametrize("case", [pytest.param(case, id=words) for words, case in cases.items()])
    def test(case: Callable[[], None]) -> None:
        case()

    return test


def effect_suite(samples: EffectSample | Mapping[str, EffectSample]) -> Callable[..., None]:
    """Return a test with one case per sample and property. Assign the test to a name test_*.

    Parameters
    ----------
    samples : EffectSample, or mapping of names to samples
        One sample per effect, or several samples for settings that exclude each other.

    Returns
    -------
    callable
        A parametrised test for pytest.

    Examples
    --------
    >>> from vemcvx.testing import EffectSample, effect_suite
    >>> steel, pull = vx.Elasticity(200.0, 0.3), vx.Traction((1.0, 0.0), "right")
    >>> test_clamp = effect_suite(EffectSample(vx.Clamp("left"), beside=(steel, pull)))
    """
    named = samples if isinstance(samples, Mapping) else {samples.name: samples}
    each = [(name, sample, check) for name, sample in named.items() for check in PROPERTIES]
    return _test({f"{name}: {check.__name__}": partial(check, sample) for name, sample, check in each})


def linear_suite(solvers: LinearSolver | Mapping[str, LinearSolver]) -> Callable[..., None]:
    """Return a test with one case per linear solver and property. Assign the test to a name test_*.

    Parameters
    ----------
    solvers : LinearSolver, or mapping of names to linear solvers

    Returns
    -------
    callable
        A parametrised test for pytest.

    Examples
    --------
    >>> from vemcvx.testing import linear_suite
    >>> test_superlu = linear_suite(vx.SuperLU())
    """
    named = solvers if isinstance(solvers, Mapping) else {type(solvers).__name__: solvers}
    each = [(name, linear, *one) for name, linear in named.items() for one in linear_properties(linear)]
    return _test({f"{name}: {words}": partial(check, linear) for name, linear, words, check in each})
