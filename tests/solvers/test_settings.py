"""Settings of solvers that cvxpy calls: one table says them all, and when they are for fewer programs."""

import pytest

import vemcvx as vx
from vemcvx.solvers.conic import TUNED, When

REGULARISATION = "static_regularization_constant"


@pytest.mark.parametrize("solver", [vx.Clarabel(), vx.ThroughCvxpy("clarabel")], ids=["class", "name"])
def test_settings_follow_the_program(solver: vx.ThroughCvxpy) -> None:
    def asked(semidefinite: bool, again: bool) -> dict[str, object]:
        return solver.asks_with(1e-12, semidefinite=semidefinite, again=again)

    assert asked(False, False)[REGULARISATION] == 1e-15
    assert asked(True, False) == {**asked(False, False), REGULARISATION: 1e-13}
    assert asked(False, True)["max_step_fraction"] == 0.99


def test_options_of_the_user_go_before_all() -> None:
    solver = vx.Clarabel(options={REGULARISATION: 1e-8})
    assert solver.asks_with(1e-12, semidefinite=True, again=True)[REGULARISATION] == 1e-8


def test_settings_as_the_library_comes_are_none() -> None:
    assert vx.ThroughCvxpy("CLARABEL", tuned=False).asks_with(1e-12, semidefinite=True, again=True) == {}


@pytest.mark.parametrize("solver", sorted(TUNED))
def test_a_setting_for_fewer_programs_follows_the_one_for_all(solver: str) -> None:
    always = {setting.name for setting in TUNED[solver] if setting.when is When.ALWAYS}
    order = [setting.when is When.ALWAYS for setting in TUNED[solver]]
    assert order == sorted(order, reverse=True)
    assert set(vx.ThroughCvxpy(solver).asks_with(1e-12, semidefinite=True, again=True)) == always
