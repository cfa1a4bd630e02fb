"""The file of the report is what it says, whatever the installed HiGHS makes of it; and the script runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import highspy
import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "problems" / "highs_optimal_at_zero.py"


def value(highs, x):
    """The objective of the file as HiGHS has read it, at an x that obeys its rows."""
    model = highs.getModel()
    rows = np.zeros(model.lp_.num_row_)
    A = model.lp_.a_matrix_
    for j in range(4):
        for k in range(A.start_[j], A.start_[j + 1]):
            rows[A.index_[k]] += A.value_[k] * x[j]
    assert (rows <= np.array(model.lp_.row_upper_) + 1e-15).all()
    assert list(model.lp_.col_lower_) == [-np.inf] * 4
    H = model.hessian_
    quadratic = 0.0
    for j in range(H.dim_):
        for k in range(H.start_[j], H.start_[j + 1]):
            i = H.index_[k]
            quadratic += (0.5 if i == j else 1.0) * H.value_[k] * x[i] * x[j]
    return float(np.dot(model.lp_.col_cost_, x)) + quadratic


def test_zero_is_feasible_and_not_optimal():
    highs = highspy.Highs()
    highs.setOptionValue("output_flag", False)  # silent() prints a banner
    assert highs.readModel(str(SCRIPT.with_suffix(".mps"))) == highspy.HighsStatus.kOk
    assert value(highs, np.zeros(4)) == 0.0
    d = np.array([7 / 6, 1 / 3])
    assert value(highs, np.concatenate([d, d])) == pytest.approx(-13 / 12, rel=1e-15)
    # K d = g - lam with lam = (1, 1) = w s / |s|.
    assert np.array([[2, -1], [-1, 2]]) @ d + 1 == pytest.approx([3, 0.5], rel=1e-15)


@pytest.mark.long
def test_the_script_says_what_highs_finds():
    run = subprocess.run([sys.executable, SCRIPT], capture_output=True, text=True, check=True, timeout=60)
    found = re.search(r"value (\S+); that of d = t = \(7/6, 1/3\) is -1.0833333333333333", run.stdout)
    # No solver gets below the optimum.
    assert float(found.group(1)) >= -13 / 12 - 1e-6
    assert "vemcvx" not in SCRIPT.read_text()
