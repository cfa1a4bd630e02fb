r"""A friction bound that varies along a joint, found from noisy displacements of the surface.

A strip (0, L) x (0, H) is held at its left end and pulled at its right end. Friction at the joint below has the bound
g(x), a force per length. Slip begins at the right end; at the largest pull it has not reached the left end. The
displacements of the top are measured at some points and instants, with noise.

The unknown bound is linear between knots. `vx.fit` finds its values at the knots from the measurements. Far from the
pulled end nothing slips: there the measurements only show that g is not below the friction. Therefore we assume that
the second differences of g at the knots are normally distributed, with the standard deviation `BEND`. The fit adds the
regularising terms (second difference / BEND)^2 to the sum of squares.

The band in the picture is the fitted bound, plus and minus twice its standard error. Where the joint slips, the
measurements determine g, and the narrow band contains the true bound. Where the joint sticks, only the assumption
determines g, and the band is wide.

    vemcvx run problems/friction_along_a_joint.py --n 4 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, PULL = 40.0, 2.0, 200.0, 17.0
KNOTS = np.linspace(0.0, LENGTH, 21)
TRUE = 0.6 + 0.25 * np.sin(2.5 * np.pi * KNOTS / LENGTH)
BEND, NOISE = 0.08, 0.01
"""The assumed standard deviation of second differences of g, and the noise relative to the largest displacement."""
POINTS = np.linspace(2.0, LENGTH, 20)
UNITS = {"length": "mm", "force": "N"}
SMALL = {"n": 4, "steps": 8}


def hats(x):
    """Return the values of the hat functions of all knots, one row per point."""
    return np.stack([np.interp(x[:, 0], KNOTS, one) for one in np.eye(len(KNOTS))], axis=1)


def scene_of(bounds):
    """Return the scene with the bounds g at the knots."""
    return vx.Scene(
        vx.Elasticity(YOUNG, 0.0),
        vx.Symmetry(on="left"),
        vx.Traction(lambda x, t: [PULL / HEIGHT * t, 0.0], on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(lambda x, t: hats(x) @ bounds, on="bottom"),
    )


def scene():
    return scene_of(TRUE)


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def measure(history, seed=0):
    """Return the noisy displacements of each point at all instants, and the standard deviation of the noise."""
    exact = history.probe(np.column_stack([POINTS, np.full(len(POINTS), HEIGHT)]))[:, :, 0]
    noise = NOISE * float(np.abs(exact).max())
    rows = (exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)).T
    names = [f"displacement at ({x}, {HEIGHT}) x" for x in POINTS.tolist()]
    return dict(zip(names, rows, strict=True)), noise


def find_bounds(history, seed=0):
    """Fit the bounds at the knots to the noisy displacements of a history."""
    measured, noise = measure(history, seed)
    penalty = np.diff(np.eye(len(KNOTS)), n=2, axis=0) / BEND
    start, limits = np.full(len(KNOTS), 0.5), (0.0, np.inf)
    return vx.fit(
        scene_of, start, history.mesh, history.times, measured, noise=noise, bounds=limits, shapes=hats, penalty=penalty
    )


def picture(history):
    """Draw the pulled strip, and the fitted bound with its errors beside the true bound."""
    from matplotlib.figure import Figure

    found = find_bounds(history)
    figure = Figure(figsize=(9.4, 5.2), layout="constrained")
    body, graph = figure.subplots(2, 1, height_ratios=(1.0, 1.6))
    vx.plots.stressed_body(history, ax=body, forces="friction", units=UNITS)
    contact = history.contact
    slipped = contact.points[contact.accumulated_slip[-1] > 0.0, 0].min()
    graph.axvspan(slipped, LENGTH, color="0.93", zorder=0, label="slipped part of the joint")
    low, high = found.theta - 2 * found.errors, found.theta + 2 * found.errors
    graph.fill_between(KNOTS, low, high, color="C0", alpha=0.3, label="fit with twice its standard error")
    graph.plot(KNOTS, found.theta, "C0o-", label="fitted bound")
    graph.plot(KNOTS, TRUE, "k--", label="true bound")
    graph.set(xlabel="x (mm)", ylabel="friction bound g (N/mm)", xlim=(0.0, LENGTH), ylim=(0.0, 1.6))
    graph.legend(loc="upper right", frameon=True, ncols=2)
    return figure
