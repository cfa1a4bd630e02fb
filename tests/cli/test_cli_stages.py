"""Problem files with stages: run one after the other, each in its folder, and joined; what means nothing is refused."""

from __future__ import annotations

import csv

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
    (tmp_path / "pad.py").write_text(FILE.strip())
    return tmp_path


def test_stages_have_folders_of_their_own_and_one_table(pad):
    code, said = call("run", "pad.py", "--n", "4", "--out", "out", "--probe", "1,1", "--report")
    assert code == 0
    assert (
        "stage 1     t = 0 ... 1, 2 steps, in out/stage_1\nstage 2     t = 1 ... 2, 8 steps, in out/stage_2\n" in said
    )
    both, stages = vx.read_history("out"), [vx.read_history(f"out/stage_{k}") for k in (1, 2)]
    assert both.steps == sum(stage.steps for stage in stages) == 10
    assert np.array_equal(both.displacement, np.concatenate([stages[0].displacement, stages[1].displacement[1:]]))
    assert np.array_equal(both.dissipated[2:], stages[1].dissipated)
    with open("out/probes.csv", newline="") as file:
        assert [float(row["time"]) for row in csv.DictReader(file)] == both.times.tolist()


@pytest.mark.long
def test_a_report_is_of_all_stages(pad):
    pytest.importorskip("matplotlib")
    code, said = call("run", "pad.py", "--n", "2", "--out", "out", "--plot", "--report")
    page = (pad / "out/report.html").read_text()
    assert code == 0
    assert "energy_ledger.png" in said
    assert "stage 2" in page
    assert "t = 1 ... 2, 8 steps" in page
    assert "no errors of friction work, work and wear" in page


def test_show_has_every_stage_and_a_study_its_parameters(pad):
    shown = call("show", "pad.py", "--n", "4")[1]
    first, second = shown.split("stage 2 ")
    assert ("stage 1" in first, "Traction" in first.split("not simulated")[0], "Traction" in second) == (
        True,
        False,
        True,
    )
    assert "no parameter 'nu'" in call("run", "pad.py", "--set", "nu=0.3")[1]


@pytest.mark.parametrize("options", [["--steps", "4"], ["--target", ".1"], ["--bound"], ["--store", "last"]])
def test_options_without_a_meaning_for_stages_are_refused(pad, options):
    code, said = call("run", "pad.py", *options)
    assert code == 2
    assert f"{' '.join(options) if '--store' in options else options[0]}: pad has stages" in said


def test_files_that_define_no_stages_are_refused(pad):
    for command in (["compare"], ["export", "--steps", "1"], ["app"]):
        assert "it has stages and no scene(**parameters); only `vemcvx run`" in call(*command, "pad.py")[1], command
    (pad / "odd.py").write_text(FILE.replace("return [first, (", "return [first, 3, ("))
    code, said = call("run", "odd.py", "--n", "2")
    assert (code, "wanted a list of (scene, times), one for each stage" in said) == (2, True)
    (pad / "bare.py").write_text(FILE.replace("def mesh", "def grid"))
    assert "does not define mesh" in call("run", "bare.py")[1]
