"""One active-set step after a conic answer: degenerate terms stick, and the certificate goes down to rounding."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.solvers.conic import polished

pytestmark = pytest.mark.arithmetic

SLIPS, STICKS, DEGENERATE = 0, 1, 2


@pytest.mark.parametrize("seed", range(8))
def test_degenerate_terms_stick_to_rounding(seed):
    """By hand: d and lam are chosen, the load follows; interior points leave terms of both kinds at 1e-6."""
    rng = np.random.default_rng(seed)
    n, kind = 12, np.arange(12) % 3
    A = rng.normal(size=(n, n))
    # Shifts are .1 / (B K^-1 B')_ii = .1 to .2 here, and (w - |lam|) / |s| is .1 at least where a term is degenerate.
    K = np.eye(n) + A @ A.T / np.linalg.norm(A @ A.T)
    w, sign = rng.uniform(1.0, 2.0, n), rng.choice([-1.0, 1.0], n)
    d = np.where(kind == SLIPS, sign * rng.uniform(0.1, 1.0, n), 0.0)
    lam = sign * w * np.where(kind == STICKS, 0.5, 1.0)
    program = StepProgram(Operators(K, sp.csr_matrix(np.eye(n))), K @ d + lam, w, np.zeros(n))
    off = np.where(kind == DEGENERATE, 1e-6 * rng.uniform(0.3, 1.0, n), 0.0)
    near = Answer(d + sign * off + 1e-12 * rng.normal(size=n), (lam - sign * off)[:, None], 1)
    assert program.certify(near.d, near.lam).gap > 1e-13
    answer = polished(program, near)
    certificate = program.certify(answer.d, answer.lam)
    assert np.abs(answer.d[kind != SLIPS]).max() < 1e-15
    assert certificate.gap <= certificate.floor < 64e-28
