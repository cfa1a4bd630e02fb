"""The certified error, the sum of gap and rounding, is the same number wherever it is printed."""

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


def run(**options):
    return vx.simulate(SCENE, vx.meshes.squares(4), np.linspace(0.0, 0.9, 9), **options)


@pytest.fixture(scope="module")
def history():
    return run()


def find_line(history, **parts):
    """Replace the results `parts` of a run, and return the line about certificates in the summary of this run."""
    changed = dataclasses.replace(history, trajectory=dataclasses.replace(history.trajectory, **parts))
    return next(line for line in changed.summary().splitlines() if line.startswith("certified"))


@pytest.mark.long
def test_run_and_compare_print_the_same_error():
    _, compared = call("compare", "feng_han_huang", "--n", "4", "--steps", "2", "--solvers", "newton")
    _, ran = call("run", "feng_han_huang", "--n", "4", "--steps", "2")
    (said,) = re.findall(r"certified +(\S+) relative", ran)
    assert f"Newton: certified to {said} in" in compared
    assert re.search(rf"Newton +own +1e-08 +{re.escape(said)} ", compared)


def test_a_refusal_names_an_error_above_rounding():
    with pytest.raises(vx.NotCertified) as caught:
        run(solver=vx.Newton(accuracy=1e-20))
    assert caught.value.reached >= caught.value.floor > 0
    reached, allows = re.findall(r"(?:error of|Round-off alone allows) (\S+?)[,:]", str(caught.value))
    assert float(reached) >= float(allows)


def test_the_summary_gives_the_reason_for_an_error_above_the_requested_accuracy(history):
    """The reason is rounding, or a gap that the solver left."""
    unit = history.trajectory.unit
    assert "asked for" not in find_line(history)
    assert "; round-off leaves " in find_line(history, floor=np.full(9, 0.5e-14) * unit**2)
    missed = find_line(history, gap=np.where(np.arange(9) > 6, 0.5e-10, 0.0) * unit**2)
    assert missed.endswith("; asked for 1e-08, missed at 2 of 9 instants")
