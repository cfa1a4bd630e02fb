"""The first lesson is a test: what it claims in words holds in numbers."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

LESSON = Path(__file__).parents[2] / "problems" / "variational_inequality_as_convex_program.py"


@pytest.fixture(scope="module")
def lesson():
    return runpy.run_path(str(LESSON))


def test_the_loop_loses_what_the_formula_says(lesson):
    assert lesson["lost"] == pytest.approx(lesson["closed_form"], rel=1e-14)
    assert lesson["path"][0] == 0.0
    assert lesson["path"][-1] == pytest.approx(lesson["path"][30], rel=1e-14)


def test_a_step_by_hand_minimises_its_energy(lesson):
    K, g = lesson["K"], lesson["g"]
    pose_step = np.linspace(-4, 4, 8001)
    for u_prev in (-1.0, 0.0, 0.7):
        for f in (-3.0, -0.4, 0.0, 1.9):
            u = lesson["step_by_hand"](u_prev, f)

            def energy(v, u_prev=u_prev, f=f):
                return 0.5 * K * v**2 - f * v + g * np.abs(v - u_prev)

            assert energy(u) <= energy(pose_step).min() + 1e-14


def test_four_nodes_agree_with_the_hand(lesson):
    # Clarabel's own tolerance, 1e-8 in the gap, is 1e-4 in the slip at worst and was seen to give 1e-8.
    assert lesson["u"].value == pytest.approx(lesson["by_hand"], abs=1e-5)
    chain, f, w = lesson["chain"], lesson["f"], lesson["w"]
    balance = f - chain @ lesson["by_hand"]
    assert balance == pytest.approx([0.5, 0.5, 0.2, 0.0], abs=1e-15)
    assert (np.abs(balance) <= w + 1e-15).all()


def test_the_multiplier_is_the_friction_force(lesson):
    assert lesson["lam"] == pytest.approx([0.5, 0.5, 0.2, 0.0], abs=1e-4)
    assert lesson["newton"].multipliers[-1, :, 0] == pytest.approx([0.5, 0.5, 0.2, 0.0], abs=1e-14)


def test_solvers_agree_within_their_certificates(lesson):
    assert lesson["apart"] <= lesson["claimed"] < 1e-5
    assert lesson["newton"].state[-1] == pytest.approx(lesson["by_hand"], abs=1e-15)


def test_the_gap_bounds_every_spoilt_answer(lesson):
    table = np.array(lesson["table"])
    assert (table[:, 0] <= table[:, 1]).all()
    # Errors shrink by 100 from row to row, certificates by 10: the gap is linear in a spurious slip.
    assert np.diff(np.log10(table[:, 1]))[1:] == pytest.approx([-1, -1], abs=0.4)
    assert np.diff(np.log10(table[:, 0]))[1:] == pytest.approx([-2, -2], abs=0.4)
    assert lesson["gap"](lesson["by_hand"], lesson["exact_lam"]) == pytest.approx(0.0, abs=1e-16)


def test_it_says_what_is_so(lesson, capsys):
    runpy.run_path(str(LESSON), run_name="__main__")
    said = capsys.readouterr().out
    assert "energy lost in the loop: 4.000000000000, by the formula 4.000000000000" in said
    assert "by hand   [0.9 0.2 0.  0. ]" in said
