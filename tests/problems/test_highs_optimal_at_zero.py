"""The script of a bug report shows a program for which HiGHS 1.15.1 returns 0, a point that is not optimal."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "problems" / "highs_optimal_at_zero.py"


@pytest.mark.long
def test_the_script_prints_a_value_that_is_not_below_the_optimum():
    run = subprocess.run([sys.executable, SCRIPT], capture_output=True, text=True, check=True, timeout=60)
    found = re.search(r"value (\S+); the value at d = t = \(7/6, 1/3\) is -1.0833333333333333", run.stdout)
    assert float(found.group(1)) >= -13 / 12 - 1e-6
    assert "vemcvx" not in SCRIPT.read_text()
