"""Newton where plain active sets fail: on programs made to be nasty, and mesh-independent on those that are not."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import cyclic, paper_scene

import vemcvx as vx
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.newton import Shifts, answer_on, sets_at
from vemcvx.solvers.solver import Iterate

pytestmark = pytest.mark.arithmetic


def nasty(seed, block):
    """Eigenvalues over eight orders, weights over six, slips that all want another direction."""
    rng = np.random.default_rng(seed)
    m = 24
    n = m * block
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = Q @ np.diag(10.0 ** rng.uniform(-6, 2, n)) @ Q.T
    K = 0.5 * (K + K.T)
    operators = Operators(K, sp.csr_matrix(np.eye(n)), block)
    g = K @ rng.normal(size=n) + rng.normal(size=n)
    w = 10.0 ** rng.uniform(-4, 2, m)
    return StepProgram(operators, g, w, rng.normal(size=n) * (rng.random(n) < 0.3))


def plain_active_sets(program, rounds=200):
    """Whether undamped active sets, shifts 10 / (B K^-1 B'), reach a point at which the gap vanishes."""
    point = Iterate(np.zeros(len(program.g)), np.zeros((program.operators.count, program.operators.block)), np.zeros(0))
    shift = Shifts.of(program.operators) * 100.0
    for _ in range(rounds):
        point = answer_on(program, sets_at(program, point, shift))
        certificate = program.certify(point.d, point.lam)
        if certificate.gap <= 10 * certificate.floor:
            return True
    return False


@pytest.mark.long
@pytest.mark.parametrize("block", [1, 2])
def test_the_safeguard_ends_what_plain_active_sets_do_not(block, monkeypatch):
    """Every program is answered to its rounding floor or 1e-8; some need the safeguard, on some plain sets cycle."""
    # Newton's method by itself: after sweeps over discs none of these needs it.
    monkeypatch.setattr(Operators, "sweepable", False)
    solver = vx.Newton(max_iterations=2000)
    cycled, saved = False, 0
    for seed in range(60):
        program = nasty(seed, block)
        size = program.g @ program.operators.factor.solve(program.g)
        target = 0.5e-16 * size
        answer = solver.prepare(program.operators).solve(program, target, np.zeros((24, block)))
        certificate = program.certify(answer.d, answer.lam)
        assert certificate.gap <= max(target, certificate.floor), f"seed {seed}: {answer.iterations} iterations"
        assert answer.status == "converged"
        assert answer.safeguards <= answer.iterations
        # Two hundred rounds of cycling, once, are enough.
        cycled = cycled or not plain_active_sets(program)
        saved += answer.safeguards > 0
    assert saved > 0
    assert cycled


def test_safeguards_are_in_the_history():
    """None are needed in the paper's scene; where the iteration limit strikes none is hidden either."""
    history = vx.simulate(paper_scene(cyclic), vx.meshes.squares(8), np.linspace(0, 1, 17))
    assert history.safeguards.dtype == history.iterations.dtype
    assert not history.safeguards.any()
    assert "0 of them safeguards" in history.summary()


@pytest.mark.slow
@pytest.mark.parametrize("n", [16, 32, 64, 128])
def test_iterations_do_not_grow_with_the_mesh(family, n):
    """At most 12 a step at the median, whatever the family and the mesh; cyclic load."""
    history = vx.simulate(paper_scene(cyclic), vx.meshes.FAMILIES[family](n), np.linspace(0, 1, 33), store="last")
    iterations = history.trajectory.iterations[1:]
    assert np.median(iterations) <= 12
    assert iterations.max() <= 24
    assert history.trajectory.certificate.max() <= 1e-8
