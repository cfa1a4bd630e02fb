"""The factor on the free unknowns is remembered while these are the same, and is no other than a fresh one."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.linear import DenseCholesky
from vemcvx.linear.superlu import SuperLUFactor
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import Operators, restricted
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.arithmetic
CONDENSED = pytest.mark.parametrize("condense", [True, False], ids=["condensed", "all unknowns"])


@pytest.fixture
def factorised(monkeypatch):
    """The sets of unknowns on which a factor was made, in turn."""
    found = []
    for kind in (DenseCholesky, SuperLUFactor):

        def within(self, K_FF, F, own=kind.within):
            found.append(F.copy())
            return own(self, K_FF, F)

        monkeypatch.setattr(kind, "within", within)
    return found


@CONDENSED
def test_it_is_made_again_when_the_set_changes(condense, factorised):
    system = pose_scene(paper_scene(), small("squares", 6)).system
    operators = Condensation(system, condense, vx.SuperLU()).operators
    n = operators.K.shape[0]
    F, other, b = np.arange(1, n), np.arange(n - 1), np.random.default_rng(0).normal(size=n - 1)
    fresh = {0: operators.factor.within(restricted(operators.K, other), other).solve(b)}
    fresh[1] = operators.factor.within(restricted(operators.K, F), F).solve(b)
    assert not np.allclose(fresh[0], fresh[1])
    factorised.clear()
    for which in (F, F.copy(), other, F, F):
        assert np.array_equal(operators.principal(which).solve(b), fresh[int(which[0])])
    assert [int(one[0]) for one in factorised] == [1, 0, 1]


@CONDENSED
def test_a_run_factorises_where_its_sets_change(condense, factorised, monkeypatch):
    asked, principal = [], Operators.principal

    def noted(self, F):
        asked.append(F.copy())
        return principal(self, F)

    monkeypatch.setattr(Operators, "principal", noted)
    times = np.linspace(0, 1, 33)
    vx.simulate(paper_scene(cyclic), small("squares", 8), times, condense=condense, linear=vx.SuperLU())
    changed = [F for n, F in enumerate(asked) if n == 0 or not np.array_equal(F, asked[n - 1])]
    assert 1 < len(changed) < 0.75 * len(asked)
    assert len(factorised) == len(changed)
    assert all(map(np.array_equal, factorised, changed))
