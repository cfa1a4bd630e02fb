"""What is certified is one number, gap and rounding together, wherever it is said."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from called import call

import vemcvx as vx


def push(x, t):
    return np.column_stack([8 * np.sin(6 * t) + 0 * x[:, 0], -2 * np.sin(3 * t) + 0 * x[:, 0]])


SCENE = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(push, on="left"),
    vx.UnilateralContact(on="bottom", gap=1e-4),
    vx.TrescaFriction(bound=2.0, on="bottom"),
)
TIMES = np.linspace(0.0, 0.9, 9)


@pytest.fixture(scope="module")
def history():
    return vx.simulate(SCENE, vx.meshes.squares(4), TIMES)


def line_of(history):
    return next(line for line in history.summary().splitlines() if line.startswith("certified"))


@pytest.mark.long
def test_run_and_compare_say_the_same():
    _, compared = call("compare", "feng_han_huang", "--n", "4", "--steps", "2", "--solvers", "newton")
    _, ran = call("run", "feng_han_huang", "--n", "4", "--steps", "2")
    (said,) = re.findall(r"certified +(\S+) relative", ran)
    assert f"Newton: certified to {said} in" in compared
    assert re.search(rf"Newton +own +1e-08 +{re.escape(said)} ", compared)


def test_a_refusal_says_no_less_than_round_off_allows():
    with pytest.raises(vx.NotCertified, match=r"Python, check=False") as caught:
        vx.simulate(SCENE, vx.meshes.squares(4), TIMES, solver=vx.Newton(accuracy=1e-20))
    assert caught.value.reached >= caught.value.floor > 0
    reached, allows = re.findall(r"(?:error of|Round-off alone allows) (\S+?)[,:]", str(caught.value))
    assert float(reached) >= float(allows)


def test_more_than_was_asked_is_said_with_its_reason(history):
    """By round-off, which nothing can be done about, and by a gap, which a solver left."""
    run = history.trajectory
    assert ";".join(line_of(history).split(";")[2:]) == ""
    coarse = dataclasses.replace(run, floor=np.full(9, 0.5e-14) * run.unit**2)
    line = line_of(dataclasses.replace(history, trajectory=coarse))
    assert line.endswith(f"; asked for 1e-08; round-off leaves {coarse.certified.max():.1e}")
    missed = dataclasses.replace(run, gap=np.where(np.arange(9) > 6, 0.5e-10, 0.0) * run.unit**2)
    assert line_of(dataclasses.replace(history, trajectory=missed)).endswith(
        "; asked for 1e-08, missed at 2 of 9 instants"
    )


def test_a_sum_is_never_below_its_parts(history):
    """Relative to the norm so far, the first step may be certified worst, and all together at the end less."""
    run = history.trajectory
    early = dataclasses.replace(run, gap=np.where(np.arange(9) == 1, 1e-6, 0.0), unit=1.0 + np.arange(9.0))
    step, total = re.findall(r"(\S+) (?:relative|accumulated)", line_of(dataclasses.replace(history, trajectory=early)))
    assert float(total) >= float(step)
