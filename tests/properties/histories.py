"""Properties of histories: stability, homogeneity, agreement of solvers, and the balance of energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from strategies import SEEDS, cases, courses, exponents, for_all, settings_of_scenes

import vemcvx as vx
from properties.rounding import EPS, Energy, majorant, marched
from vemcvx.scene import pose_scene

NEWTON = vx.Newton(accuracy=1e-9)


@for_all(case=cases(), data=st.data(), size=exponents(-6, 1), seed=SEEDS)
def steps_are_stable(case, data, size, seed):
    """Steps under two loads f1, f2 and the same friction bounds obey Theorem 2.5 of Feng, Han and Huang.

    Step n has the load f_n, the state y_n and the friction term j. Let |x| = (x'Kx)^{1/2}, p = K^{-1} f,
    d_n = y_n - y_{n-1} and q = p_n - y_{n-1}. The step minimises 1/2 |d - q|^2 + j(d). So d_n = prox_j(q), and
    r_n = p_n - y_n = q - d_n is the projection of q on a closed convex set, the subdifferential of j at zero. The
    subdifferential of j is monotone in the inner product of K, (r1 - r2, d1 - d2) >= 0. Hence

        |r1_n - r2_n|^2 + |d1_n - d2_n|^2 <= |q1 - q2|^2,   q1 - q2 = (r1 - r2)_{n-1} + ((p1 - p2)_n - (p1 - p2)_{n-1}),

    which implies |y1_n - y2_n - K^{-1}(f1_n - f2_n)| <= |y1_{n-1} - y2_{n-1} - K^{-1}(f1_n - f2_n)|. With
    |f|_* = |K^{-1} f| and equal y_0,  |y1_N - y2_N| <= |f1_N - f2_N|_* + sum_n |(f1 - f2)_n - (f1 - f2)_{n-1}|_*.

    An error e of a step changes the pair (r, d) by at most sqrt(2) e, and r alone by at most e. We compute |r| as the
    norm |K r|_* from the forces K r = f - K y, because the rounding errors of these forces have a known bound.
    """
    rng, K = np.random.default_rng(seed), case.K
    change = np.outer(data.draw(courses(len(case.times) - 1)), rng.normal(size=len(K)))
    other = replace(case, loads=case.loads + size * np.abs(case.loads).max() * change)
    one, two = marched(case, NEWTON), marched(other, NEWTON)
    energy, y1, y2 = one.energy, one.trajectory.state, two.trajectory.state
    between = energy.force_norm
    bound = 0.0
    for n in range(1, len(case.times)):
        f = case.loads[n] - other.loads[n]
        after = between(f - K @ (y1[n] - y2[n]))
        before = between(f - K @ (y1[n - 1] - y2[n - 1]))
        moved = energy.norm(one.increment(n) - two.increment(n))
        errors = one.errors[n] + two.errors[n]
        blur = 2 * energy.rounding_of_forces(
            np.abs(case.loads[n]) + np.abs(other.loads[n]), y1[n], y2[n], y1[n - 1], y2[n - 1]
        )
        assert np.hypot(after, moved) <= before + np.sqrt(2) * errors + blur
        bound += between(f - (case.loads[n - 1] - other.loads[n - 1])) + errors + blur
        assert energy.norm(y1[n] - y2[n]) <= between(f) + bound


@for_all(case=cases(), power=st.integers(-40, 40), numerator=st.integers(3, 1000))
def forces_scale_the_answer(case, power, numerator):
    """Loads c f and weights c w with c > 0 give the state c y, exactly if c is a power of two.

    Loads f and weights w have 24 binary digits. If c is no power of two, c has at most 10 binary digits. So c f and c w
    are exact. The scaled state c y_n and the answer y^c_n approximate the same exact solution. Their distance is at
    most the sum of the certified errors of both runs so far, because steps do not enlarge errors.
    """
    plain = marched(case, NEWTON)
    doubled = case.times_forces(2.0**power).march(NEWTON, check=False)
    assert np.array_equal(doubled.state, 2.0**power * plain.trajectory.state)
    assert np.array_equal(doubled.multipliers, 2.0**power * plain.trajectory.multipliers)
    assert np.array_equal(doubled.sticking, plain.trajectory.sticking)
    c = numerator / 64
    scaled = marched(case.times_forces(c), NEWTON)
    claimed = np.cumsum(scaled.errors + c * plain.errors)
    for n, y in enumerate(plain.trajectory.state):
        blur = plain.energy.of_blurred_state(EPS * np.abs(c * y))
        assert plain.energy.norm(scaled.trajectory.state[n] - c * y) <= claimed[n] + blur


@for_all(case=cases(blocks=(1, 1, 2)))
def solvers_agree(case):
    """Newton, Clarabel and OSQP differ by at most the sum of their certified errors so far.

    Steps do not enlarge earlier errors. Newton's gap is at most e^2 / 2 plus the rounding floor, where e is 1e-6 of
    the load's energy norm.
    """
    solvers = [vx.Newton(), vx.Clarabel()] + ([vx.OSQP()] if case.block == 1 else [])
    runs = [marched(case, solver) for solver in solvers]
    for i, one in enumerate(runs):
        for two in runs[:i]:
            claimed = np.cumsum(one.errors + two.errors)
            for n in range(len(case.times)):
                assert one.energy.norm(one.trajectory.state[n] - two.trajectory.state[n]) <= claimed[n]
    newton = runs[0]
    assert (newton.trajectory.gap <= 0.5 * (1e-6 * newton.size) ** 2 + newton.trajectory.floor).all()


@for_all(setting=settings_of_scenes(moving=True), which=st.sampled_from("NNC"))
def ledger_closes(setting, which):
    """Dissipation grows. Up to certified errors, work - dE - loss = sum 1/2 a(du, du).

    Here dE is the change of the energy, and a(du, du) = du'K du. A step has the load f, the increment du of the state
    y, the slips s = B du with bounds w, multipliers lam, and the residual r = f - B'lam - K y. So the work is dE + 1/2
    a(du, du) + lam.s + r.du, and the loss is sum w|s|. The error of the balance in a step is r.du - (w|s| - lam.s), at
    most e |du|_K + gap for the certified error e. The balance contains products x'Ky, where x and y are states,
    increments, or responses K^{-1}f to loads. A step has fewer than twenty products and linear solves. Rounding
    changes each product by at most n eps |x|'M|y|, with M = majorant(A) for the n x n stiffness A of all nodes.
    """
    solver = vx.Newton() if which == "N" else vx.Clarabel(accuracy=1e-4)
    history = vx.simulate(setting.scene, setting.mesh, setting.times, solver=solver, check=False)
    posed, t = pose_scene(setting.scene, setting.mesh), history.trajectory
    A, P = posed.A.toarray(), posed.supports.P
    u = history.displacement.reshape(len(setting.times), -1)
    numerical = np.append(0.0, [0.5 * d @ A @ d for d in np.diff(u, axis=0)])
    energy = Energy(posed.system.K.toarray())
    responses = [P @ np.linalg.solve(energy.K, posed.system.force(s)) for s in setting.times]
    errors = np.sqrt(2 * t.gap) + np.sqrt(2 * t.floor)
    lengths = np.append(0.0, [energy.norm(d) for d in np.diff(t.state, axis=0)])
    allowed = np.cumsum(errors * lengths + t.gap + t.floor)
    largest = np.max(np.abs(u), axis=0) + np.max(np.abs(responses), axis=0)
    rounding = 20 * len(setting.times) * len(A) * EPS * largest @ majorant(A) @ largest
    remainder = history.work - (history.energy - history.energy[0]) - history.dissipated
    assert (np.abs(remainder - np.cumsum(numerical)) <= allowed + rounding).all()
    assert (np.diff(history.dissipated) >= 0).all()
    assert (history.energy >= -rounding).all()
