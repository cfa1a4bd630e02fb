"""Problem files with stages. Stages run in order, have separate folders, and are joined into one history."""

from __future__ import annotations

import numpy as np
import pytest
from called import call

import vemcvx as vx

FILE = '''
"""A pad, pressed and then pulled."""
import numpy as np, vemcvx as vx
def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n)
def stages(pull=2.0):
    common = vx.Elasticity(1000.0, 0.3), vx.Clamp(on="left"), vx.UnilateralContact(on="bottom")
    press = vx.Pressure(lambda x, t: 5.0 * min(t, 1.0), on="top")
    drag = vx.Traction(lambda x, t: [pull * np.sin(2 * np.pi * (t - 1)), 0.0], on="right")
    rub = vx.CoulombFriction(0.3, on="bottom")
    first = vx.Scene(*common, press, rub), np.linspace(0, 1, 3)
    return [first, (vx.Scene(*common, press, drag, rub), np.linspace(1, 2, 9))]
'''


@pytest.fixture
def pad(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VEMCVX_APP", "")  # monkeypatch restores the variable after the test
    (tmp_path / "pad.py").write_text(FILE.strip())
    return tmp_path


def test_stages_have_folders_and_one_joined_history(pad):
    code, printed = call("run", "pad.py", "--n", "4", "--out", "out")
    assert code == 0, printed
    assert "stage 1     t = 0 ... 1, 2 steps, in out/stage_1\n" in printed
    assert "stage 2     t = 1 ... 2, 8 steps, in out/stage_2\n" in printed
    joined, stages = vx.read_history("out"), [vx.read_history(f"out/stage_{k}") for k in (1, 2)]
    assert joined.steps == sum(stage.steps for stage in stages) == 10
    assert np.array_equal(joined.displacement, np.concatenate([stages[0].displacement, stages[1].displacement[1:]]))
    assert np.array_equal(joined.dissipated[2:], stages[1].dissipated)


def test_show_describes_every_stage(pad):
    first, second = call("show", "pad.py", "--n", "4")[1].split("stage 2 ")
    assert "stage 1" in first
    assert "Traction" not in first
    assert "Traction" in second


def test_commands_that_take_no_stages_and_files_with_invalid_stages_are_refused(pad):
    for command in (["compare"], ["export", "--steps", "1"], ["app"]):
        assert "it has stages and no scene(**parameters); only `vemcvx run`" in call(*command, "pad.py")[1], command
    (pad / "odd.py").write_text(FILE.replace("return [first, (", "return [first, 3, ("))
    code, printed = call("run", "odd.py", "--n", "2")
    assert (code, "wanted a list of (scene, times), one for each stage" in printed) == (2, True)
