"""Systems that no scene makes: dependent rows, zero rows, loads that friction balances completely."""

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

pytestmark = pytest.mark.arithmetic


@mostly_long("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
@pytest.mark.parametrize(
    ("K", "B", "f"),
    [
        (np.diag([2.0, 3.0]), [[1.0, 0.3], [0.2, 1.0]], [0.31, 0.17]),
        ([[1.0]], [[1.0], [0.7], [-0.3]], [0.5]),
        (3 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1), np.eye(3), [0.1, 0.3, 0.7]),
    ],
)
def test_nothing_moves_if_friction_balances_the_load(solver, K, B, f):
    """The solution is zero. The relative error 0/0 counts as 0."""
    system = vx.System(K, lambda t: t * np.array(f), vx.Norms(B, 3.0))
    run = vx.march(system, [0.0, 0.5, 1.0], solver=solver, check=False)
    assert np.abs(run.state).max() < 1e-5
    if solver.name == "Newton":
        assert run.certificate.max() <= solver.accuracy
        vx.march(system, [0.0, 0.5, 1.0], solver=solver)
    elif run.certificate.max() > solver.accuracy:
        with pytest.raises(vx.NotCertified, match=r"use vx\.Newton"):
            vx.march(system, [0.0, 0.5, 1.0], solver=solver)


ZERO_ROWS = {
    "norms": {"norms": vx.Norms(np.zeros((1, 2)), [1.0])},
    "norms beside another row": {"norms": vx.Norms([[1.0, 0.0], [0.0, 0.0]], [0.0, 1.0])},
    "norms in space": {"norms": vx.Norms(np.zeros((2, 2)), [1.0], 2)},
    "norms on a ground": {"norms": vx.Norms(np.zeros((1, 2)), [1.0], ground=lambda t: [3.0 * t])},
    "limits": {"limits": vx.Limits(np.zeros((1, 2)), [1.0])},
}


@mostly_long("condense", [True, False])
@pytest.mark.parametrize("terms", ZERO_ROWS.values(), ids=ZERO_ROWS)
def test_zero_rows_change_no_state(terms, condense):
    """A zero row of the weight 1, on a ground that moves by 6, dissipates 6."""
    system = vx.System(np.diag([2.0, 3.0]), lambda t: [2 * t, t], **terms)
    run = vx.march(system, [0.0, 1.0, 2.0], condense=condense)
    assert run.state[1:] == pytest.approx(np.outer([1.0, 2.0], [1.0, 1 / 3]), rel=1e-15)
    assert run.dissipated[-1] == (6.0 if terms is ZERO_ROWS["norms on a ground"] else 0.0)


def test_a_run_responds_to_a_pulse_although_its_data_nearly_vanish_at_the_start():
    """The friction bound is 0.1. The load is 0, then 1e-67, 1e-16 and 5."""
    system = vx.System([[1.0]], lambda t: [5.0 * np.exp(-(((t - 0.437) / 0.01) ** 2))], vx.Norms([[1.0]], 0.1))
    run = vx.march(system, [0.0, 0.15, 0.3125, 0.375, 0.437, 1.0])
    assert run.state.ravel() == pytest.approx([0.0, 0.0, 0.0, 0.0, 4.9, 0.1], abs=1e-12)
    assert run.certificate.max() <= 1e-8
