"""Bounds on the error of whole histories, if the friction bound is given.

At each instant, u is the exact displacement, and sigma the exact stress. The displacement v and the stress tau are
admissible, and r is the defect of v and tau (:mod:`vemcvx.bound`). Let X = tau - sigma, and let C be the elastic
tensor. Then X = r + C eps(v - u). Let g be the friction bound, q the friction of tau, and s' the slip rate of v. A
prime is a derivative in time, and |v|_a is the energy norm. Green's formula and Tresca's law give

    d/dt |X|^2 / 2  =  <r', X> + (X, eps(v' - u'))  <=  |r'| |X| + D',      D' = int (g |s'| - q s'),

where <., .> is the inner product of the norm |.|. By Brezis' lemma, y <= a + int m follows from y^2 / 2 <= a^2 / 2 +
int m y. In step n all fields are linear in time. Let D_n be the integral of D' over step n. Then

    |X| <= y_n = (y_{n-1}^2 + 2 D_n)^{1/2} + |r_n - r_{n-1}|,      |u - v_n|_a^2 <= y_n^2 + 2 y_n |r_n| + |r_n|^2,

because C eps(u - v_n) = r_n - X. The displacement w of :mod:`.hypercircle` vanishes on supports and contact edges, so X
is orthogonal to C eps(w). Therefore v + w may replace v, except in the last term |r_n|^2.

**The start.** If u(0) = v_0, then y_0 = |r_0|. A run with initial="equilibrium" or "settled" begins with a step from
zero, and so does the exact history. For this step, Theorem 1 with b of :mod:`vemcvx.bound` gives y_0^2 = |r_0|^2 + 2 b.

**Data in time.** If data are not linear within steps, we repeat the run on the same mesh in finer steps. To the bound
at an instant, we add SAFETY times the largest energy distance between both runs up to the instant.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import SceneError
from vemcvx.bound.hypercircle import Hypercircle
from vemcvx.bound.skeleton import instant
from vemcvx.history import History
from vemcvx.program import System
from vemcvx.program.operators import energy_norm
from vemcvx.scene import PosedScene, pose_scene, suppress_scene_warnings
from vemcvx.stepping import march
from vemcvx.stepping.course import JUMP_WIDTH, inputs, inside_steps, sample_course, subdivide

log = logging.getLogger("vemcvx")
SAMPLES = 512  # Smallest number of sampled instants in a run.
SAMPLES_PER_STEP = 8  # Smallest number of sampled instants in each step.
SAFETY = 1.5  # Safety factor of the estimated error between instants.


def check_history(posed: PosedScene, history: History) -> None:
    """Raise SceneError if the whole history has no bound."""
    count = history.steps + 1
    laws = [friction.subject for friction in posed.terms.frictions if friction.law is not None]
    if len(posed.obstacles) or laws:
        raise SceneError(
            f"error_bound: {', '.join((*posed.obstacles.subjects, *laws))}: a bound over a whole history exists only "
            "for TrescaFriction on BilateralContact. error_bound(history, step=-1) bounds the error of one step, "
            "if the state before the step is exact."
        )
    if len(history.stored) < count:
        raise SceneError(
            f"error_bound: {len(history.stored)} of {count} instants were stored, and the bound over a whole history "
            "needs all of them (store='all'). error_bound(history, step=-1) gives the bound of a step."
        )
    if history.begins == "projected":
        raise SceneError(
            "error_bound: the run begins at vx.projected(u_0) and the exact history at u_0. The distance between the "
            "two is unknown. Begin with an array of nodal displacements, or with initial='settled'. "
            "error_bound(history, step=-1) bounds the error of one step, if the state before the step is exact."
        )


def collect_terms(circle: Hypercircle, history: History) -> tuple[Floats, Floats, Floats]:
    """Return terms of the bounds, squared cell errors, and instants of nonlinear data."""
    first = instant(history, 0)
    rests = history.begins in ("equilibrium", "settled")
    pair = circle.pair(first, replace(first, u=0.0 * first.u) if rests else first)
    y, dissipated, missed = float(np.sqrt(pair.A2 + 2.0 * pair.law_defect)), 0.0, 0.0
    found, squares = list[tuple[float, ...]](), list[Floats]()
    for n in range(history.steps + 1):
        if n > 0:
            before, pair = pair, circle.pair(instant(history, n), instant(history, n - 1))
            lost = circle.boundary.law_defect(before.surface, pair.surface)
            change = float(np.sqrt(circle.squares(pair.richer - before.richer).sum()))
            y, dissipated = float(np.sqrt(y**2 + 2.0 * lost)) + change, dissipated + lost
            missed += float(np.linalg.norm(pair.read.omitted - before.read.omitted))
        richer = float(np.sqrt(circle.squares(pair.richer).sum()))
        # The columns are y, the sum of D_n, |v_n|_a, |r_n| for v, |r_n| for v + w, and estimated errors.
        found.append((y, dissipated, pair.norm, float(np.sqrt(pair.A2)), richer, missed + pair.read.eta))
        squares.append(pair.cells)
    between, bends = _between(circle.posed, history)
    sizes = np.column_stack([found, between])
    return sizes, squares[int(np.argmax(sizes[:, 0]))], bends


def _between(posed: PosedScene, history: History) -> tuple[Floats, Floats]:
    """Return estimated errors (N + 1,), and instants at which data are not linear."""
    times = history.trajectory.times
    if len(times) < 2:
        return np.zeros(1), times[:0]
    with suppress_scene_warnings():
        # Without instants, pose_scene omits no effects.
        whole = pose_scene(posed.scene, posed.space.mesh)
    bends = inside_steps(times, sample_course(whole.system, times).bends)
    off = np.union1d(bends, _off_lines(whole.system, times))
    if not len(off):
        return np.zeros(len(times)), off
    found = bends if len(bends) else off
    log.warning(
        f"error_bound: data have kinks or jumps inside steps, or are not linear in time there, at t = "
        f"{', '.join(f'{t:.6g}' for t in found[:5])}{' ...' if len(found) > 5 else ''}. The run ignores data "
        "between its instants, and the bound contains an estimate of the error that results. Simulate at "
        "vemcvx.instants(scene, mesh, times), which includes the kinks, or in finer steps."
    )
    system, supports, instants = whole.system, whole.supports, np.union1d(times, off)
    own = [
        supports.P.T @ (whole.at_rest(u.ravel()) - supports.motion(t))
        for u, t in zip(history.displacement, times.tolist(), strict=True)
    ]
    at = np.searchsorted(instants, times).tolist()
    finer = march(system, instants, initial=own[0], check=False, store=at).state
    apart = np.array([energy_norm(system.K, d) for d in finer - own])
    return SAFETY * np.maximum.accumulate(apart), found


def _off_lines(system: System, times: Floats) -> Floats:
    """Return random instants at which data differ from linear interpolation in time."""
    parts = subdivide(times, SAMPLES_PER_STEP, SAMPLES)
    width, draw = np.diff(parts), np.random.default_rng(0)
    inside = parts[:-1] + draw.uniform(1.0, 2.0, len(width)) / 3.0 * width
    inside = inside[width > 2.0 * JUMP_WIDTH * (times[-1] - times[0])]
    weights = [draw.uniform(0.5, 1.5, len(datum)) for _, datum in inputs(system, float(times[0]))]
    known, values = (
        np.array([[w @ x for w, (_, x) in zip(weights, inputs(system, t), strict=True)] for t in instants.tolist()])
        for instants in (times, inside)
    )
    lines = np.column_stack([np.interp(inside, times, datum) for datum in known.T])
    return np.asarray(inside[(np.abs(values - lines) > SAME * np.abs(known).max(axis=0, initial=0.0)).any(axis=1)])
