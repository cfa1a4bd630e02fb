"""Solvers as classes derived from Solver, with settings and work that steps share."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenes import paper_scene

import vemcvx as vx
from vemcvx.program import ABSOLUTE_VALUES, QUADRATIC


@dataclass(frozen=True)
class Own(vx.Solver):
    """Newton's answers by another name, for friction only."""

    accuracy: float = 1e-6
    max_iterations: int = 20_000
    accepts = frozenset({QUADRATIC, ABSOLUTE_VALUES})

    def prepare(self, operators):
        return Prepared(vx.Newton().prepare(operators))


class Prepared:
    def __init__(self, newton):
        self._newton = newton

    def solve(self, program, target, lam, p=None):
        return self._newton.solve(program, target, lam, p)


@pytest.mark.long
def test_the_accuracy_is_in_the_files_whatever_the_solver_prints(tmp_path):
    class Quiet(Own):
        __repr__ = object.__repr__

    history = vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=Quiet(accuracy=1e-5))
    history.write(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["accuracy"] == 1e-5
    assert vx.read_history(tmp_path / "out").trajectory.accuracy == 1e-5


def test_the_solver_is_asked_for_no_more_than_it_accepts():
    scene = paper_scene().with_(vx.UnilateralContact(on="top"))
    with pytest.raises(vx.NotAccepted, match="solver Own: the program has bounds, which it does not accept"):
        vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0], solver=Own())


def test_the_solver_refuses_an_accuracy_that_means_nothing():
    with pytest.raises(vx.SceneError, match="^Own: found accuracy = 2"):
        Own(accuracy=2)


@pytest.mark.long
def test_a_solver_need_not_be_a_dataclass(tmp_path):
    class Plain(vx.Solver):
        accepts, max_iterations, prepare = Own.accepts, 20_000, Own.prepare

        def __init__(self, accuracy):
            self.accuracy = accuracy

    asked = paper_scene(), vx.meshes.squares(3), [0.0, 0.5, 1.0]
    history = vx.simulate(*asked, solver=Plain(3e-7), stream=tmp_path)
    assert history.solver == "Plain(accuracy=3e-07)"
    assert history.trajectory.accuracy == 3e-7
    assert history.certificate.max() <= 3e-7
    again = vx.simulate(*asked, solver=Plain(3e-7), stream=tmp_path, resume=True)
    assert np.array_equal(again.displacement, history.displacement)
    assert isinstance(Plain(1e-9).asked(1e-4), Plain)
    assert Plain(1e-9).asked(1e-4).accuracy == 1e-4
    with pytest.raises(vx.SceneError, match="^Plain: found accuracy = 'fine'"):
        vx.simulate(*asked, solver=Plain("fine"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lam": np.zeros(3)}, r"found lam = array.*; wanted an array of floats \(3, 1\)"),
        ({"d": np.zeros((3, 1))}, r"found d = array.*; wanted an array of floats \(3,\)"),
        ({"d": [0.0, 0.0, 0.0]}, r"found d = \[.*; wanted an array of floats \(3,\)"),
        ({"p": None}, r"found p = None; wanted an array of floats \(0,\)"),
        ({"iterations": None}, r"found the answer Answer.*; wanted Answer\(d, lam, iterations\)"),
    ],
)
def test_an_answer_that_fits_no_program_is_refused_in_one_sentence(monkeypatch, change, words):
    own = Prepared.solve
    monkeypatch.setattr(Prepared, "solve", lambda *asked: replace(own(*asked), **change))
    with pytest.raises(vx.SceneError, match=f"^solver Own: {words}"):
        vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=Own())
