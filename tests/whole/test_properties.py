"""Properties of every problem, on random ones: a few examples by default, a thousand and more with -m slow.

A property is a function in tests/properties with strategies for its arguments. Every run counts the examples that
went through to the end, and fails if they are fewer than its share.
"""

from __future__ import annotations

import functools

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.configuration import set_hypothesis_home_dir

pytest.register_assert_rewrite("properties")

from properties import bodies, histories, program  # noqa: E402

PROPERTIES = (
    bodies.stiffness_feels_all_but_rigid_motions,
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
"""Examples of a slow run, of all properties together."""
FEW = 5
MANY = -(-SLOW // len(PROPERTIES))


@pytest.fixture(autouse=True, scope="module")
def _elsewhere(tmp_path_factory):
    """Hypothesis keeps what it reads off the sources in a folder of its own, which is not to lie in the repository."""
    set_hypothesis_home_dir(tmp_path_factory.mktemp("hypothesis"))


def explore(claim, examples):
    """Try a claim on random examples, the same in every run; the number of those it held on."""
    held = 0

    @functools.wraps(claim)
    def counted(**drawn):
        nonlocal held
        claim(**drawn)
        held += 1

    # A march takes long for hypothesis, and draws a lot.
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
def test_property(claim, examples):
    held = explore(claim, examples)
    print(f"{held} examples")  # shown by pytest -rP
    assert held >= examples
