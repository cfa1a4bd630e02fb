"""Compare runs of random scenes with exact steps: errors are at most certificate plus rounding floor."""

from __future__ import annotations

import contextlib
import tempfile
import warnings
from dataclasses import dataclass, field

import numpy as np
from exact_steps import Steps, Stuck
from stopped import Stopped, stop_at

import vemcvx as vx
from vemcvx.results import displacement
from vemcvx.scene import pose_scene

EPS = float(np.finfo(float).eps)
ROUNDED = 64 * EPS
ANCHORED = 256
"""If the scaled stiffness matrix is singular, :mod:`vemcvx.program.kernel` adds stiffness. We assume that the sum of
both has eigenvalues >= 1 / ANCHORED."""
CONSISTENT = 1e-11
"""Allowed deviation of weights from the friction law, relative to the largest force."""
EXACT = 2.0**-160
"""Relative error of the distances that :mod:`exact_steps` returns."""
UPPER = 1 + 1e-9
"""Factor that allows for rounding of bounds and errors."""


@dataclass
class Verdict:
    """The outcome of a random scene."""

    refused: str = ""
    """the error message, if the scene was refused"""
    faults: list = field(default_factory=list)
    steps: int = 0
    """number of steps compared with exact steps"""
    unknown: int = 0
    """number of steps without an exact solution"""
    ratio: float = 0.0
    """largest ratio of error to certificate + floor"""


def run(drawn):
    """Simulate a random scene from its initial state."""
    options = {"solver": drawn.solver, "linear": drawn.linear, "condense": drawn.condense}
    scene, mesh, times = drawn.scene, drawn.mesh, drawn.times
    half = (len(times) + 1) // 2
    if drawn.start == "given" and half < len(times) - 1:
        first = vx.simulate(scene, mesh, times[: half + 1], **options)
        return vx.simulate(scene, mesh, times[half:], initial=first.displacement[-1], **options)
    if drawn.start == "resumed" and half < len(times) - 1:
        return _run_resumed(scene, mesh, times, half, options)
    initial = drawn.start if drawn.start in ("settled", "equilibrium") else None
    return vx.simulate(scene, mesh, times, initial=initial, **options)


def _run_resumed(scene, mesh, times, half, options):
    with tempfile.TemporaryDirectory() as folder:
        with contextlib.suppress(Stopped):
            vx.simulate(scene, mesh, times, stream=folder, progress=stop_at(half), **options)
        return vx.simulate(scene, mesh, times, stream=folder, resume=True, **options)


def run_and_judge(drawn):
    """Run a random scene and compare it with exact steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", vx.SceneWarning)
        try:
            history = run(drawn)
        except vx.VemcvxError as error:
            return Verdict(refused=f"{type(error).__name__}: {error}")
        return judge(drawn, history)


def judge(drawn, history):
    """Compare a history of a random scene with exact steps, and check its energy balance and forces."""
    verdict = Verdict()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vx.SceneWarning)
        posed = pose_scene(history.scene, history.mesh, history.trajectory.times)
        if drawn.start == "resumed":
            _check_resumed(drawn, history, verdict)
    _check_numbers(history, verdict)
    _check_steps(drawn, posed.system, history.trajectory, verdict)
    errors = _solve_error(drawn, posed.system), _iterative_error(drawn, posed.system)
    _check_ledger(drawn, posed, history.trajectory, *errors, verdict)
    _check_balance(posed, history, verdict)
    _check_total(drawn, posed.system, history.trajectory, verdict)
    return verdict


def _check_numbers(history, verdict):
    """Check that all numbers are finite."""
    t, c = history.trajectory, history.contact
    for name in ("state", "multipliers", "pressures", "weights", "energy", "dissipated", "work", "gap", "floor"):
        if not np.isfinite(getattr(t, name)).all():
            verdict.faults.append(f"number: {name} is not finite")
    for name in ("slip", "traction", "bound", "pressure", "wear"):
        if not np.isfinite(getattr(c, name)).all():
            verdict.faults.append(f"number: contact.{name} is not finite")


def _check_steps(drawn, system, t, verdict):
    exact = Steps(system)
    scale = t.unit
    raw = np.sqrt(2 * t.gap) + np.sqrt(2 * t.floor)
    # If nothing moves, the relative certificate is 0 or infinite.
    bound = np.where(scale > 0, (t.certificate + t.certificate_floor) * np.where(scale > 0, scale, 1.0), raw)
    for n in range(0 if drawn.start == "settled" else 1, len(t.times)):
        before = np.zeros(system.n) if n == 0 else t.state[n - 1]
        now = float(t.times[n])
        # The program does not contain the multipliers of nodes that a support drags.
        guess = t.state[n] - before, t.multipliers[n].ravel()[: system.B.shape[0]], t.pressures[n]
        try:
            step = exact.step(before, float(t.times[n - 1]), now, guess, settled=n == 0)
        except Stuck:
            verdict.unknown += 1
            continue
        error = step.distance(exact.scaled(before, t.state[n], step.unit))
        if system.norms is not None and system.norms.law is not None:
            error = min(error, _measure_distance_for_weights(exact, t, n, before, guess))
        verdict.steps += 1
        allowed = bound[n] + EXACT * scale[n]
        verdict.ratio = max(verdict.ratio, error / allowed if allowed > 0 else (np.inf if error > 0 else 0.0))
        if error > allowed * UPPER:
            verdict.faults.append(
                f"certificate: step {n}: |u - u*| = {error:.3e}, certificate and floor {allowed:.3e}, "
                f"|u| up to {scale[n]:.3e}, |d*| = {step.size(step.d):.3e}"
            )


def _check_total(drawn, system, t, verdict):
    """Check that the errors of nonexpansive steps add up to at most `certificate_total`."""
    given = system.norms is None or system.norms.law is None
    if system.limits is not None or system.damping is not None or drawn.start == "equilibrium" or not given:
        return
    exact, now, blur = Steps(system), t.state[0], 0.0
    if drawn.start == "settled":
        now, blur = _solve_exactly(exact, np.zeros(system.n), t, 0), 0.0
    allowed = t.certificate_total * t.unit + np.cumsum(np.sqrt(2 * t.floor))
    for n in range(1, len(t.times)):
        now = _solve_exactly(exact, now, t, n)
        if now is None:
            return
        # Exact states are rounded once per step.
        blur += EPS * np.sqrt(np.abs(now) @ (abs(system.K) @ np.abs(now)))
        off = t.state[n] - now
        error = np.sqrt(max(float(off @ (system.K @ off)), 0.0))
        if np.isfinite(allowed[n]) and error > (allowed[n] + blur) * UPPER:
            verdict.faults.append(f"total: step {n}: |u - u*| = {error:.3e}, total certificate {allowed[n]:.3e}")


def _solve_exactly(exact, before, t, n):
    """Return the exact state after step n from the state `before`, or None if it was not found."""
    guess = t.state[n] - before, t.multipliers[n].ravel()[: exact.system.B.shape[0]], t.pressures[n]
    try:
        step = exact.step(before, float(t.times[n - 1]), float(t.times[n]), guess, settled=n == 0)
    except Stuck:
        return None
    return before + exact.unscaled(step.d, step.unit)


def _check_resumed(drawn, history, verdict):
    """Check that a resumed run begins like the uninterrupted run."""
    options = {"solver": drawn.solver, "linear": drawn.linear, "condense": drawn.condense}
    whole, half = vx.simulate(drawn.scene, drawn.mesh, drawn.times, **options), (len(drawn.times) + 1) // 2
    for name in ("displacement", "forces", "energy", "work", "dissipated", "certificate", "certificate_floor"):
        one, other = getattr(whole, name)[:half], getattr(history, name)[:half]
        # Certificates of a resumed run have other rounding errors, up to the floor.
        rounded = ROUNDED if name.startswith("certificate") else 0.0
        hidden = whole.certificate_floor[:half] if name == "certificate" else 0.0
        if not np.allclose(one, other, rtol=rounded, atol=hidden, equal_nan=True):
            verdict.faults.append(f"resumed: {name} is different in the uninterrupted run")


def _requested_accuracy(drawn):
    """Return the requested accuracy, by default 1e-8."""
    return 1e-8 if drawn.solver is None else drawn.solver.accuracy


def _solve_error(drawn, system):
    """Return the relative error of energy and work due to linear solves: min(ROUNDED cond(K), accuracy)."""
    D = 1.0 / np.sqrt(system.K.diagonal())
    size = np.linalg.eigvalsh(D[:, None] * system.K.toarray() * D)
    condition = ANCHORED * size[-1] if system.kernel is not None else size[-1] / max(size[0], EPS)
    return min(_requested_accuracy(drawn), ROUNDED * condition)


def _iterative_error(drawn, system):
    """Return the energy error of an iterative solver as a function of t.

    With K x = b, a residual of r |b| causes an error of r cond(K)^(1/2) |x|_K.
    """
    if not isinstance(drawn.linear, vx.Iterative) or system.kernel is not None:
        return lambda t: 0.0
    K, moved = system.K.toarray(), system.motion
    part = drawn.linear.tolerance * np.sqrt(np.linalg.cond(K))

    def left(t):
        loads = [system.force(t), *([] if moved is None else [moved.dirichlet_force(t)])]
        return part * sum(np.sqrt(max(float(b @ np.linalg.solve(K, b)), 0.0)) for b in loads)

    return left


def _measure_distance_for_weights(exact, t, n, before, guess):
    """Return the distance of state n from the exact solution for the weights w of the run.

    With large friction coefficients, a step may have several solutions. The distance is infinite if w violates the law
    of friction, or if no exact solution is found.
    """
    norms, now = exact.system.norms, float(t.times[n])
    w, lawful = t.weights[n][: norms.count], norms.weights_under(now, t.pressures[n])
    if np.abs(w - lawful).max() > CONSISTENT * max(w.max(initial=0.0), t.pressures[n].max(initial=0.0)):
        return np.inf
    try:
        step = exact.step(before, float(t.times[n - 1]), now, guess, settled=n == 0, weights=w)
    except Stuck:
        return np.inf
    return step.distance(exact.scaled(before, t.state[n], step.unit))


def _check_ledger(drawn, posed, t, inexact, unsolved, verdict):
    """Check the balance of energy in every step, up to residuals and rounding.

    The displacement u has the elastic energy a(u, u) / 2, and E is the stored energy. Contact has the pressure p and
    the compliance c. The normal displacement minus the gap is z. With the letter d for increments, the balance is

        work - dE - loss = a(du, du) / 2 + p . dz - c d(p^2) / 2.

    A residual r and a duality gap change the balance by r . du + gap. In runs with viscosity, z determines the
    pressures of a prescribed initial state.
    """
    system, A, size = posed.system, posed.A, abs(posed.A)
    soft = np.zeros(0) if system.limits is None else system.limits.compliance
    u = [displacement(posed, y, float(s)) for y, s in zip(t.state, t.times, strict=True)]
    z = [_compute_excess(posed, v, float(s)) for v, s in zip(u, t.times, strict=True)]
    p, totals = t.pressures.copy(), np.abs(t.work) + np.abs(t.energy) + t.dissipated
    if system.damping is not None and drawn.start in ("given", "equilibrium"):
        p[0] = np.divide(np.maximum(z[0], 0.0), soft, out=p[0], where=soft > 0)
    for n in range(1, len(u)):
        du, d = u[n] - u[n - 1], t.state[n] - t.state[n - 1]
        half = 0.5 * float(du @ (A @ du))
        press = float(p[n] @ (z[n] - z[n - 1])) - 0.5 * float(soft @ (p[n] ** 2 - p[n - 1] ** 2))
        done = (t.work[n] - t.work[n - 1]) - (t.energy[n] - t.energy[n - 1])
        # Negative losses are rounding errors, and count as zero.
        slip = system.B @ d + system.slip_of_supports(float(t.times[n]))
        slip = slip - system.slip_of_supports(float(t.times[n - 1]))
        lam = t.multipliers[n][: 0 if system.norms is None else system.norms.count]
        against = np.minimum((lam * slip.reshape(lam.shape)).sum(axis=1), 0.0).sum()
        defect = abs(done - (t.dissipated[n] - t.dissipated[n - 1]) - half - press - against)
        K = system.K if system.damping is None else system.K + system.damping.C / (t.times[n] - t.times[n - 1])
        error = np.sqrt(2 * t.gap[n]) + np.sqrt(2 * t.floor[n])
        left = error * np.sqrt(max(float(d @ (K @ d)), 0.0)) + t.gap[n] + t.floor[n]
        # Rounding errors of a state change its energy and its work.
        size_of_states = t.norm[n] + t.norm[n - 1]
        left += (np.sqrt(2 * max(t.floor[n], t.floor[n - 1])) + inexact * size_of_states) * size_of_states
        # Energy and work of a step contain the errors of four linear solves.
        left += 2 * (unsolved(float(t.times[n])) + unsolved(float(t.times[n - 1]))) * size_of_states
        force = size @ np.maximum(np.abs(u[n]), np.abs(u[n - 1])) + np.abs(posed.force(float(t.times[n])))
        blur = float(force @ (np.abs(du) + np.abs(u[n]) + np.abs(u[n - 1]))) + totals[: n + 1].max()
        blur += float(np.abs(p[n]) @ (np.abs(z[n]) + np.abs(z[n - 1]))) + float(soft @ p[n] ** 2)
        if defect > left + ROUNDED * blur:
            verdict.faults.append(
                f"ledger: step {n}: work - dE - loss misses 1/2 a(du, du) + ... by {defect:.3e}; residual and rounding "
                f"allow {left:.3e} + {ROUNDED * blur:.3e}; work {t.work[n]:.3e}, E {t.energy[n]:.3e}, "
                f"loss {t.dissipated[n]:.3e}"
            )


def _compute_excess(posed, u, t):
    if posed.obstacles is None or len(posed.obstacles.nodes) == 0:
        return np.zeros(0)
    return posed.obstacles.rows @ u - posed.obstacles.gap(t)


def _check_balance(posed, history, verdict):
    """Check the balance of forces and moments: nodal forces, loads, and springs to the ground."""
    points = history.mesh.points
    middle = points.mean(axis=0)
    x, y = (points - middle).T / np.ptp(points, axis=0).max()
    motions = np.stack([np.stack([1 + 0 * x, 0 * x], 1), np.stack([0 * x, 1 + 0 * x], 1), np.stack([-y, x], 1)])
    times = history.trajectory.times
    for n in range(1, len(times)):
        u, f = history.displacement[n].ravel(), posed.force(float(times[n]))
        sprung = np.zeros_like(f) if posed.springs is None else posed.springs @ u
        total = history.forces[n].ravel() + f - sprung
        # Viscous forces have rounding errors.
        blur = abs(posed.A) @ np.abs(u) + np.abs(f) + np.abs(history.forces[n].ravel())
        if posed.system.damping is not None:
            before = np.abs(history.displacement[n - 1].ravel())
            blur += abs(posed.viscosity) @ (np.abs(u) + before) / (times[n] - times[n - 1])
        for name, m in zip(("x", "y", "moment"), motions, strict=True):
            left, size = abs(float(m.ravel() @ total)), float(np.abs(m.ravel()) @ blur)
            if left > ROUNDED * size:
                verdict.faults.append(f"balance: step {n}: {name} of forces and loads is {left:.3e}, scale {size:.3e}")
