"""Bounds of the least value of a program, and what nobody can change in a certificate."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, SolvedProgram, StepProgram


def beside(w, b=1.0):
    """Minimise |d|^2 / 2 + w |d_1 + d_2 - b|: 1/4 at d = (1/2, 1/2) for b = 1 and any w >= 1/2."""
    return StepProgram(Operators(np.eye(2), sp.csr_matrix([[1.0, 1.0]])), np.zeros(2), np.array([w]), np.array([b]))


@pytest.mark.parametrize("w", [1.0, 1e6, 1e10])
def test_bounds_hold_where_what_sticks_was_put_in_place(w):
    """A slip of 2e-14 costs w times that; the certificate is of the place after it, and no difference of objectives."""
    answer = Answer(np.array([0.5 + 2e-14, 0.5]), np.array([[-0.5]]), 0)
    low, high = SolvedProgram.of(beside(w), answer, 1, 1.0).bounds
    assert low <= 0.25 <= high


@pytest.mark.parametrize(("w", "b"), [([1.0, 1.0], [1.0]), ([1.0], [1.0, 0.0]), ([[1.0]], [1.0])])
def test_a_program_has_the_shapes_of_its_operators(w, b):
    operators = Operators(np.eye(2), sp.csr_matrix([[1.0, 1.0]]))
    with pytest.raises(vx.SceneError, match=r"StepProgram: [wb]: found .*; wanted \(1,\)"):
        StepProgram(operators, np.zeros(2), np.array(w), np.array(b))


@pytest.mark.parametrize("w", [-1.0, np.nan])
def test_a_weight_that_pays_for_slip_is_not_certified(w):
    with pytest.raises(vx.SceneError, match=f"certify: found the weight {w:g} of term 0; weights are >= 0"):
        beside(w).certify(np.array([0.5, 0.5]))
