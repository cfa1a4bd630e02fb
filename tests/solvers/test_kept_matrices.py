"""Clarabel is told what a step changes, and answers as if it had been told all."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import paper_scene

import vemcvx as vx
from vemcvx.solvers.conic import KeptMatrices, keep_matrices

pytest.importorskip("clarabel")


class Told:
    """Stands for Clarabel's solver: notes what it is told."""

    def __init__(self):
        self.told = []

    def update(self, **data):
        if "P" in data and data["P"].shape != (2, 2):
            raise ValueError("another pattern")
        self.told.append(sorted(data))

    def solve(self):
        return "solved"


def test_matrices_are_told_when_they_change():
    solvers = {"CLARABEL": Told(), "SCS": "an answer"}
    keep_matrices(solvers)
    kept, P, q = solvers["CLARABEL"], sp.csc_array(np.eye(2)), np.ones(2)
    keep_matrices(solvers)
    assert solvers == {"CLARABEL": kept, "SCS": "an answer"}
    assert kept.solve() == "solved"
    for matrix in (P, P.copy(), 2 * P, sp.csc_array(np.eye(3)), 2 * P, P):
        if matrix.shape == (2, 2):
            kept.update(P=matrix, q=q)
        else:
            with pytest.raises(ValueError, match="another pattern"):
                kept.update(P=matrix, q=q)
    assert kept.told == [["P", "q"], ["q"], ["P", "q"], ["q"], ["P", "q"]]


def test_solvers_without_updates_stay_as_they_are():
    solvers = {"CLARABEL": object()}
    before = dict(solvers)
    keep_matrices(solvers)
    assert solvers == before


@pytest.mark.long
def test_a_history_is_that_of_all_data_to_the_bit(monkeypatch):
    mesh, times, solver = vx.meshes.squares(16), np.linspace(0, 1, 9), vx.Clarabel(accuracy=1e-6)
    told, update = [], KeptMatrices.update

    def noted(self, **data):
        told.append(sorted(data))
        update(self, **data)

    monkeypatch.setattr(KeptMatrices, "update", noted)
    kept = vx.simulate(paper_scene(), mesh, times, solver=solver)
    monkeypatch.setattr("vemcvx.solvers.conic.keep_matrices", lambda solvers: None)
    whole = vx.simulate(paper_scene(), mesh, times, solver=solver)
    assert len(told) == 7
    assert np.array_equal(kept.trajectory.state, whole.trajectory.state)
    assert np.array_equal(kept.trajectory.multipliers, whole.trajectory.multipliers)
