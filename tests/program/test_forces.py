"""Forces as combinations of those that were solved for."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.program.condensation import MOST_FIELDS, SAME_FIELD, SolvedForce, SolvedForces, combined

N = 400


def counting():
    """Forces on a body whose flexibility is one, and how many were solved for."""
    solved = []

    def solve(phi, number):
        solved.append(phi)
        return SolvedForce(phi, phi, *np.zeros((2, 0)), number, lambda: phi, np.dot)

    return SolvedForces(N, solve, np.ones(N)), solved


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


def test_loads_that_differ_by_rounding_where_the_body_is_soft_are_two():
    """A stiff chain and one softer by 1e16, whose load is 1e-15 of the stiff one's and grows otherwise."""
    chain = 2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    K, B = np.zeros((8, 8)), np.zeros((1, 8))
    K[:4, :4], K[4:, 4:], B[0, 7] = 1e16 * chain, chain, 1.0
    hard, soft = np.array([1.0, 0.5, 0.2, 0.1, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1e-15, 0, 0])
    system = vx.System(K, lambda t: t * hard + t**2 * soft, norms=vx.Norms(B, np.array([1e-16])))
    condensed, whole = (vx.march(system, np.linspace(0.0, 1.0, 5), condense=one) for one in (True, False))
    assert max(condensed.certificate.max(), whole.certificate.max()) < 1e-12
    apart = condensed.state - whole.state
    assert np.sqrt(np.einsum("ti,ij,tj->t", apart, K, apart)).max() <= 1e-12 * condensed.norm.max()
