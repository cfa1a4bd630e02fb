"""`vemcvx export` writes the programs of a run."""

from __future__ import annotations

import json

import numpy as np
import pytest
from test_cli import PROBLEM, invoke

import vemcvx as vx


@pytest.mark.long
def test_export_writes_the_programs_of_the_run(tmp_path):
    options = ["--n", 4, "--of", 8, "--set", "bound=2.0", "--out", tmp_path]
    done = invoke("export", PROBLEM, "--steps", "6-7, 3,7", *options)
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.glob("f*")) == [
        f"feng_han_huang_{n}.{suffix}" for n in (3, 6, 7) for suffix in ("json", "npz")
    ]
    program = vx.read_program(tmp_path / "feng_han_huang_7.npz")
    words = json.loads((tmp_path / "feng_han_huang_7.json").read_text())
    assert (program.step, words["step"], words["origin"]["problem"]) == (7, 7, "feng_han_huang")
    assert words["origin"]["settings"] == ["bound=2.0"]
    assert "TrescaFriction: |friction| <= 2.0 on bottom" in words["origin"]["scene"]
    assert f"the optimum is between {program.bounds[0]:.17g}" in done.output
    full = invoke("export", PROBLEM, "--steps", "7", "--no-condense", "--format", "mps", *options)
    assert full.exit_code == 0, full.output
    whole = vx.read_program(tmp_path / "feng_han_huang_7.mps")
    assert len(whole.g) > len(program.g)
    assert np.array_equal(whole.w, program.w)
