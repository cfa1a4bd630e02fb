"""Pictures and tables show the instant of the largest energy and the instants at which the motion reverses."""

import json

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.plots import deformed_mesh, stressed_body
from vemcvx.plots.contact import along_contact

YOUNG, LENGTH = 200.0, 4.0


def pull_bar(course, *more, times=None):
    """Pull a bar on rollers by stresses that are linear between pairs (t, stress)."""
    times = np.linspace(0.0, course[-1][0], 4 * (len(course) - 1) + 1) if times is None else times
    instants, stresses = np.array(course).T

    def pull(x, t):
        return np.tile([np.interp(t, instants, stresses), 0.0], (len(x), 1))

    bar = vx.meshes.squares((8, 2), box=((0.0, LENGTH), (0.0, 1.0)))
    bar = bar.with_boundary("spot", lambda x: (x[:, 1] == 1.0) & (np.abs(x[:, 0] - 2.25) < 0.3))
    scene = vx.Scene(
        vx.Elasticity(YOUNG, 0.0, plane="stress"),
        vx.Symmetry(on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(1e-9, on="bottom"),
        vx.Traction(pull, on="right"),
        *more,
    )
    return vx.simulate(scene, bar, times)


CYCLE = [(0, 0), (1, 1), (2, 0), (3, -2), (4, 0)]


def test_pictures_of_a_cycle_show_its_peak_and_turns(tmp_path):
    history = pull_bar(CYCLE)
    assert (history.peak, history.turns.tolist()) == (12, [4, 12])
    assert history.telling(4).tolist() == [4, 12, 16]
    assert history.energy[12] == pytest.approx(2.0**2 * LENGTH / (2 * YOUNG), rel=1e-6)
    for draw, step, t in ((deformed_mesh, None, 3), (stressed_body, None, 3), (deformed_mesh, -1, 4)):
        assert draw(history, step).axes[0].get_title().startswith(f"t = {t},")
    shown = along_contact(history, "slip").legends[0].get_texts()
    assert [text.get_text() for text in shown] == ["t = 1", "t = 3", "t = 4"]
    assert "at t = 3" in history.summary()
    history.write(tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())["peak"]
    assert told == {"energy": history.energy[12], "t": 3.0, "step": 12}


@pytest.mark.parametrize(
    ("course", "times", "peak", "turns", "telling"),
    [
        ([*CYCLE, *[(4 + t, stress) for t, stress in CYCLE[1:]]], None, 28, [4, 12, 20, 28], [4, 20, 28, 32]),
        ([(0, 0), (1, 1), (2, 1)], None, 8, [], [2, 4, 6, 8]),
        ([(0, 0), (1, 0)], None, 4, [], None),
        (CYCLE, [0.0, 0.5, 1.0 - 1e-9, 1.0, 1.5, 2.0], None, [3], None),
    ],
    ids=["equal cycles", "a load that grows and stays", "no load", "two close instants"],
)
def test_peak_and_turns_of_other_loads(course, times, peak, turns, telling):
    history = pull_bar(course, times=times)
    assert history.turns.tolist() == turns
    assert peak is None or history.peak == peak
    assert telling is None or history.telling(4).tolist() == telling


def test_a_stressed_body_is_shown_at_its_largest_stress():
    """A load on a short piece of the bar stores less energy than the pull, but causes a larger yy stress."""
    pressed = vx.Pressure(lambda x, t: np.interp(t, [0, 1, 2], [0, 0, 1.6]) + 0 * x[:, 0], on="spot")
    history = pull_bar([(0, 0), (1, 1), (2, 0)], pressed)
    worst = max(history.stored, key=lambda step: np.abs(history.stress(step)[:, 1]).max())
    assert (history.peak, worst) == (4, 8)
    assert deformed_mesh(history).axes[0].get_title().startswith("t = 1,")
    assert stressed_body(history, stress="yy").axes[0].get_title().startswith("t = 2,")
    assert stressed_body(history, stress="xx").axes[0].get_title().startswith("t = 1,")
