"""Conic solvers: the active-set step after an answer, and the settings passed to cvxpy."""

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.program import Answer, Operators, StepProgram
from vemcvx.solvers.conic import polish_answer

pytestmark = pytest.mark.arithmetic

SLIPS, STICKS, DEGENERATE = 0, 1, 2
REGULARISATION = "static_regularization_constant"


@pytest.mark.parametrize("seed", range(4))
def test_polishing_corrects_degenerate_terms_to_rounding(seed):
    """Degenerate terms have d = 0 and |lam| = w. Interior-point methods leave errors of 1e-6 in these terms."""
    rng = np.random.default_rng(seed)
    n, kind = 12, np.arange(12) % 3
    A = rng.normal(size=(n, n))
    # In degenerate terms, the answer `near` has |lam| + |d| = w. Newton predicts sticking, because
    # |lam| + |d| / (10 (K^-1)_ii) < w.
    K = np.eye(n) + A @ A.T / np.linalg.norm(A @ A.T)
    w, sign = rng.uniform(1.0, 2.0, n), rng.choice([-1.0, 1.0], n)
    d = np.where(kind == SLIPS, sign * rng.uniform(0.1, 1.0, n), 0.0)
    lam = sign * w * np.where(kind == STICKS, 0.5, 1.0)
    program = StepProgram(Operators(K, np.eye(n)), K @ d + lam, w, np.zeros(n))
    off = np.where(kind == DEGENERATE, 1e-6 * rng.uniform(0.3, 1.0, n), 0.0)
    near = Answer(d + sign * off + 1e-12 * rng.normal(size=n), (lam - sign * off)[:, None], 1)
    assert program.certify(near.d, near.lam).gap > 1e-13
    answer = polish_answer(vx.Newton(max_iterations=1).prepare(program.operators), program, near)
    certificate = program.certify(answer.d, answer.lam)
    assert np.abs(answer.d[kind != SLIPS]).max() < 1e-15
    assert certificate.gap <= certificate.floor < 64e-28


@pytest.mark.parametrize("solver", [vx.Clarabel(), vx.ThroughCvxpy("clarabel")], ids=["class", "name"])
def test_settings_depend_on_the_program_and_on_retries(solver):
    first = solver.choose_options(1e-12, semidefinite=False)
    assert first[REGULARISATION] == 1e-15
    assert solver.choose_options(1e-12, semidefinite=True) == {**first, REGULARISATION: 1e-13}
    assert solver.for_second_attempt().choose_options(1e-12, semidefinite=False)["max_step_fraction"] == 0.99


def test_options_of_the_user_replace_settings_and_tuned_false_omits_them():
    options = vx.Clarabel(options={REGULARISATION: 1e-8}).for_second_attempt().choose_options(1e-12, semidefinite=True)
    assert options[REGULARISATION] == 1e-8
    assert vx.ThroughCvxpy("CLARABEL", tuned=False).for_second_attempt().choose_options(1e-12, semidefinite=True) == {}
