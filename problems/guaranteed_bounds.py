"""Guaranteed error bounds: intervals that contain the exact values, on every mesh.

The displacement of a block is the closed form of `manufactured_full_slip.py`, with t^2 / 1000 in place of t. The left
side of the block is on rollers and bears the shear traction of the closed form. The tractions of the closed form act on
the top and the right side, and its body force acts inside. Friction is at its bound along the whole floor. All data are
proportional to t^2.

From an admissible displacement and an admissible stress, `vx.error_bound` computes intervals that contain the elastic
energy and the mean displacement of the top. These intervals hold on every mesh and need no unknown constant (W. Prager
and J. L. Synge, *Approximations in elasticity based on the concept of function space*, Quart. Appl. Math. 5, 1947).
Only the quadrature error of the data is estimated. The intervals shrink with h.

The bound for a whole history covers the errors of mesh and time steps together. If all loads are proportional to one
increasing function of time, time steps make no error. The third panel of the picture therefore shows the block of
`missed_reversal.py`, whose load reverses between two instants of the run. The bound for this block includes an estimate
of the error from the missed reversal. With more steps the bound decreases towards the bound of the mesh error.

    vemcvx run problems/guaranteed_bounds.py --n 16 --steps 8 --bound --plot
"""

import numpy as np

import vemcvx as vx

POISSON = 0.3
LAMBDA = 2.0 * POISSON / (1.0 - 2.0 * POISSON)
"""Lame's constant lambda; the shear modulus mu is 1."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 4}
TOP = vx.Traction((1.0, 0.0), on="top")
"""The bounded quantity: the mean of u_1 on the top, which is one unit long."""


def course(t):
    """Return the factor of all data at the instant t."""
    return 1e-3 * t * t


def displacement(x, t):
    """Return the exact displacement (m, 2) at points x (m, 2)."""
    c, e = 1.0 / (1.0 + LAMBDA), course(t) * np.exp(x[:, 0] * x[:, 1]) / 6.0
    return np.column_stack([e * x[:, 0] * (1.0 + c), e * x[:, 1] * (c - 1.0)])


def strain(x, t):
    """Return the exact strains e_xx, e_yy, 2 e_xy at points, (3, m)."""
    c, e, xy = 1.0 / (1.0 + LAMBDA), course(t) * np.exp(x[:, 0] * x[:, 1]) / 6.0, x[:, 0] * x[:, 1]
    shear = e * (x[:, 0] ** 2 * (1.0 + c) + x[:, 1] ** 2 * (c - 1.0))
    return np.stack([e * (1.0 + xy) * (1.0 + c), e * (1.0 + xy) * (c - 1.0), shear])


def stress(x, t):
    """Return the exact stresses xx, yy, xy at points, (3, m)."""
    xx, yy, xy = strain(x, t)
    return np.stack([(LAMBDA + 2.0) * xx + LAMBDA * yy, LAMBDA * xx + (LAMBDA + 2.0) * yy, xy])


def body_force(x, t):
    """Return -div stress, (m, 2)."""
    x, y = x.T
    q = LAMBDA * y**2 / 2.0 - x**2 * (LAMBDA / 2.0 + 1.0)
    first = 2.0 * (LAMBDA + 1.0) * y * (x * y + 2.0) - LAMBDA * y - x * q
    second = x * (LAMBDA + 2.0) - y * q
    return (-course(t) * np.exp(x * y) / (3.0 * (1.0 + LAMBDA)) * np.stack([first, second])).T


def scene():
    def pull_top(x, t):
        return stress(x, t)[[2, 1]].T

    def pull_right(x, t):
        return stress(x, t)[[0, 2]].T

    def shear_left(x, t):
        shear = stress(x, t)[2]
        return np.column_stack([0.0 * shear, -shear])

    def bound(x, t):
        return course(t) * x[:, 0] ** 2 * (LAMBDA + 2.0) / (6.0 * (LAMBDA + 1.0))

    return vx.Scene(
        vx.Elasticity(young=2.0 * (1.0 + POISSON), poisson=POISSON),
        vx.BodyForce(body_force),
        vx.Symmetry(on="left"),
        vx.Traction(shear_left, on="left"),
        vx.Traction(pull_top, on="top"),
        vx.Traction(pull_right, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def turning_scene():
    """Return the scene of `missed_reversal.py`, whose load reverses at t = 1/2."""

    def pull(x, t):
        return np.column_stack([16.0 * (1.25 - x[:, 1]), np.full(len(x), -0.01)]) * (1.0 - abs(2.0 * t - 1.0))

    return vx.Scene(
        vx.Elasticity(young=2000.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def exact():
    """Return the elastic energy, and the mean of u_1 on the top, at t = 1."""
    s, w = np.polynomial.legendre.leggauss(24)
    s, w = 0.5 + 0.5 * s, 0.5 * w
    points = np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2)
    density = (stress(points, 1.0) * strain(points, 1.0)).sum(axis=0)
    top = np.column_stack([s, np.ones_like(s)])
    return 0.5 * float(np.outer(w, w).ravel() @ density), float(w @ displacement(top, 1.0)[:, 0])


def intervals_over_meshes(history, counts):
    """Return the intervals of the energy and of the mean displacement, on meshes with `counts` cells across."""
    energies, means = [], []
    for n in counts:
        run = vx.simulate(scene(), mesh(n), history.trajectory.times)
        energies.append(vx.error_bound(run, step=-1).energy)
        mean = vx.error_bound(run, step=-1, of=TOP)
        means.append((mean.low, mean.high))
    return np.array(energies), np.array(means)


def bounds_over_steps(n, counts):
    """Return the bounds at the end of runs of `turning_scene` with `counts` steps, on n x n squares."""
    runs = [vx.simulate(turning_scene(), mesh(n), times(count)) for count in counts]
    return np.array([vx.error_bound(run).upper[-1] for run in runs])


def picture(history):
    """Draw intervals of energy and mean displacement on several meshes, and error bounds against steps."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.6, 3.7), layout="constrained")
    panels = figure.subplots(1, 3)
    counts, steps = (2, 3, 4, 6, 8), (3, 5, 9, 17, 33)
    names = "elastic energy / closed form", "mean displacement of the top / closed form"
    for ax, value, intervals, name in zip(panels, exact(), intervals_over_meshes(history, counts), names, strict=False):
        low, high = intervals.T / value
        ax.axhline(1.0, color="black", label="closed form")
        ax.errorbar(
            counts, 0.5 * (low + high), 0.5 * (high - low), fmt="none", capsize=4.0, label="guaranteed interval"
        )
        ax.set(xscale="log", xlabel="cells across", ylabel=name)
        ax.set_xticks(counts, map(str, counts))
    ax = panels[2]
    unit = 0.01 * vx.simulate(turning_scene(), mesh(8), times(8)).trajectory.norm.max()
    for n, style in ((8, "C0o-"), (16, "C2s-")):
        ax.plot(steps, bounds_over_steps(n, steps) / unit, style, label=f"{n} x {n} squares")
    ax.set(
        xscale="log",
        xlabel="steps (odd numbers miss the reversal)",
        ylabel="bound of the error, % in the energy norm",
        ylim=(0.0, None),
    )
    ax.set_xticks(steps, map(str, steps))
    for ax in panels:
        ax.minorticks_off()
        ax.grid()
        ax.legend()
    return figure
