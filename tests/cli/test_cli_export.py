"""`vemcvx export`: what it writes is the program of the run, and nothing of others is overwritten."""

from __future__ import annotations

import json
import re

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


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--steps", "0"], "--steps: found '0'; wanted numbers from 1 to 64 separated by commas, or ranges"),
        (["--steps", "4-2"], "--steps: found '4-2'"),
        (["--steps", "1-2-3"], "--steps: found '1-2-3'"),
        (["--steps", "65"], "--steps: found '65'"),
        (["--steps", "one"], "--steps: found 'one'"),
        (["--steps", "1", "--format", "sif"], "--format: found format 'sif'; there are 'npz', 'mtx'"),
    ],
)
def test_what_cannot_be_exported_exits_with_two(tmp_path, options, says):
    done = invoke("export", PROBLEM, "--n", 2, "--out", tmp_path / "new", *options)
    assert done.exit_code == 2
    assert re.search(re.escape(says), done.output)
    assert not (tmp_path / "new").exists()


@pytest.mark.long
def test_files_of_others_stay(tmp_path):
    mine = tmp_path / "feng_han_huang_1.json"
    mine.write_text("mine")
    done = invoke("export", PROBLEM, "--steps", "1", "--n", 2, "--of", 2, "--out", tmp_path)
    assert done.exit_code == 2
    assert "so it is not touched" in done.output
    assert mine.read_text() == "mine"
