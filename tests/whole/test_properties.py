"""Properties that every problem has. The tests draw a few random problems, or more than a thousand with -m slow.

A property is a function in tests/properties. Its attribute `strategies` draws the arguments. A test fails if the
property completes too few examples.
"""

from __future__ import annotations

import functools

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.configuration import set_hypothesis_home_dir

pytest.register_assert_rewrite("properties")

from properties import bodies, histories, program  # noqa: E402

PROPERTIES = (
    bodies.stiffness_has_the_rigid_motions_as_kernel,
    bodies.answers_move_with_the_body,
    program.objective_is_strongly_convex,
    program.answers_obey_the_law_of_friction,
    program.no_competitor_is_better,
    program.certificates_bound_the_true_error,
    histories.steps_are_stable,
    histories.forces_scale_the_answer,
    histories.solvers_agree,
    histories.ledger_closes,
)
SLOW = 1200
"""Number of examples of all properties in a slow run."""
FEW = 5
MANY = -(-SLOW // len(PROPERTIES))


@pytest.fixture(autouse=True, scope="module")
def _move_home(tmp_path_factory):
    """Let hypothesis store its files outside of the repository."""
    set_hypothesis_home_dir(tmp_path_factory.mktemp("hypothesis"))


def explore(claim, examples):
    """Test a claim on random examples, and return the number of completed examples."""
    held = 0

    @functools.wraps(claim)
    def counted(**drawn):
        nonlocal held
        claim(**drawn)
        held += 1

    # Hypothesis would complain about slow examples that draw much data.
    calm = [HealthCheck.too_slow, HealthCheck.data_too_large]
    profile = settings(
        max_examples=examples, derandomize=True, deadline=None, database=None, suppress_health_check=calm
    )
    profile(given(**claim.strategies)(counted))()
    return held


@pytest.mark.parametrize(
    "examples", [pytest.param(FEW, id="few"), pytest.param(MANY, id="many", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("claim", PROPERTIES, ids=lambda claim: claim.__name__)
def test_a_property_holds(claim, examples):
    held = explore(claim, examples)
    print(f"{held} examples")  # shown by pytest -rP
    assert held >= examples
