"""Time and load: no load, constant load, tiny steps, one giant step, cycles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import shear_lag
from hard.case import ACCURACY, REFUSAL, Case, Setting
from hard.ground import TIMES, cyclic, on, voronoi

MESH = voronoi(12)


def nothing(setting, history):
    return "" if not history.displacement.any() and not history.certificate.any() else "something moves"


def pulse(t):
    return np.interp(t, [0, 0.5, 0.75, 1], [0, 1, 0, 0])


def stays(setting, history):
    """Return a fault if, after the load is gone, nodes still move or no residual stress remains."""
    late = np.flatnonzero(TIMES >= 0.75)
    moved = np.abs(history.displacement[late] - history.displacement[late[0]]).max()
    still = moved <= ACCURACY * np.abs(history.displacement).max()
    return "" if still and history.energy[-1] > 0 else "without load nothing may change"


def tiny_steps(t):
    return 0.0 if t == 0 else 0.5 + 1e-10 * t


def increments_have_digits(setting, history):
    """Return a fault unless the increments of tiny steps are multiples of the first increment."""
    if "Newton" not in history.solver:
        return ""
    steps = np.diff(history.displacement[1:], axis=0)
    linear = steps[0] / np.abs(steps[0]).max()
    worst = max(np.abs(step / np.abs(step).max() - linear).max() for step in steps)
    # Displacements have 16 digits, so increments of 3e-11 times the displacement have five correct digits.
    return "" if worst < 1e-4 else f"increments differ by {worst:.1e}"


def reverses(setting, history):
    """Return a fault unless the end moves as in the rod model of shear_lag, with errors up to H / (slip length)."""
    end = history.mesh.points[:, 0] == 0
    found = history.displacement[[8, 16, 24]][:, end, 0].mean(axis=1)
    expected = np.array(shear_lag.end_displacement())
    apart = np.abs(found - expected).max() / expected.max()
    allowed = shear_lag.HEIGHT * shear_lag.BOUND / shear_lag.FORCE
    return "" if apart <= allowed else f"the end moves by {found}, the rod's end by {expected}"


def strip(times):
    return Setting(shear_lag.scene(), shear_lag.mesh(4), times)


def one_push(setting, history):
    found = history.displacement[-1][history.mesh.points[:, 0] == 0, 0].mean()
    rod = shear_lag.end_displacement()[0]
    return "" if abs(found - rod) <= 0.05 * rod else f"the end moves by {found:.3g}, the rod's end by {rod:.3g}"


def start_settled():
    return replace(on(MESH, lambda t: 5.0 + t), options={"initial": "settled"})


def scale_load(factor):
    return Case(f"load {factor:.0e} times the paper's", lambda: on(MESH, lambda t: factor * t), holds=sensible(factor))


def sensible(factor):
    def holds(setting, history):
        still = history.contact.sticking[-1]
        wanted = still.all() if factor < 1 else not still.any()
        return "" if wanted else f"{still.sum()} of {len(still)} nodes stick"

    return holds


CASES = (
    Case("no load", lambda: on(MESH, lambda t: 0.0), holds=nothing),
    Case("no load after slip", lambda: on(MESH, pulse), holds=stays),
    Case("steps of 1e-10", lambda: on(MESH, tiny_steps), holds=increments_have_digits),
    Case("instants 1e-10 apart", lambda: on(MESH, lambda t: cyclic(t * 1e10), times=TIMES * 1e-10)),
    Case("one giant step", lambda: strip([0.0, 1.0]), holds=one_push),
    scale_load(1e-12),
    scale_load(1e12),
    Case("ten cycles", lambda: on(MESH, lambda t: cyclic(10 * t), times=np.linspace(0, 1, 81))),
    Case("thin strip, L/H = 50: pushed, released, pushed", lambda: strip(shear_lag.times(24)), holds=reverses),
    Case("thin strip in three steps", lambda: strip(shear_lag.times(3))),
    Case("a load that is there from the start", lambda: on(MESH, lambda t: 5.0), REFUSAL, "not held by friction"),
    Case("a load from the start, settled first", start_settled),
)
