"""Forces as combinations of those that were solved for."""

from __future__ import annotations

import numpy as np
import pytest

from vemcvx.program.forces import MOST_FIELDS, SAME_FIELD, SolvedForce, SolvedForces, combined

N = 400


def counting():
    """Forces on a body whose flexibility is one, and how many were solved for."""
    solved = []

    def solve(phi, number):
        solved.append(phi)
        return SolvedForce(phi, phi, *np.zeros((3, 0)), number, lambda: phi)

    return SolvedForces(N, solve), solved


def shapes(k, seed=0):
    return np.random.default_rng(seed).normal(size=(k, N))


@pytest.mark.arithmetic
def test_a_load_that_turns_in_space_is_three_shapes():
    """The third is a small part of the first loads, and its rounding comes back with large shares of it."""
    forces, solved = counting()
    x, y, z = shapes(3)
    for t in np.linspace(0, 1, 17):
        phi = 0.5 * min(1.0, 4 * t) * (np.cos(2 * np.pi * t) * x + np.sin(2 * np.pi * t) * y - 0.2 * z)
        parts = forces.parts(phi)
        again = combined([(share, one.phi) for one, share in parts.items()], phi)
        assert np.linalg.norm(again - phi) <= 8 * SAME_FIELD * np.linalg.norm(phi)
    assert len(solved) == 3


@pytest.mark.arithmetic
def test_what_is_no_rounding_is_solved_for():
    """Of two loads that differ by 1e-9, the difference is known to 1e-7 only: alone it is another shape."""
    forces, solved = counting()
    x, y = shapes(2, seed=1)
    for phi in (x, x + 1e-9 * y, y):
        parts = forces.parts(phi)
        again = combined([(share, one.phi) for one, share in parts.items()], phi)
        assert np.linalg.norm(again - phi) <= 8 * SAME_FIELD * np.linalg.norm(phi)
    assert len(solved) == 3


def test_shapes_beyond_those_that_are_remembered_are_solved_for_afresh():
    forces, solved = counting()
    loads = shapes(MOST_FIELDS + 2, seed=2)
    for phi in (*loads, *loads):
        forces.parts(phi)
    assert len(solved) == MOST_FIELDS + 4
