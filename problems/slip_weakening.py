r"""A user-defined effect: friction that weakens with slip, in a block sheared back and forth over a floor.

The block (0, L) x (0, H) has the shear modulus mu. The top moves by U(t) = 0, U0, -U0, U0 at t = 0, 1, 3, 5, with the
amplitude U0. The sides are free along x only, so that the block is sheared uniformly. The friction bound g falls with
the accumulated slip A of each point, from the peak g_p to the residual value g_r:

$$ g(A) = \max(g_p - k A, g_r). $$

Let a be the displacement of the bottom, and q = mu (U - a) / H the friction. The block sticks while |q| < g(A). In a
step from a state with a and A, let the displacement of the top change to U. If the block slips, |q| ends at the new
bound, and the slip is

$$
|da| = (|\mu(U - a) / H| - g(A)) / (\mu/ H - k) \quad \text{if } g_p - k (A + |da|) \ge g_r,
\quad \text{else } |da| = (|\mu(U - a) / H| - g_r) / (\mu/ H).
$$

If k < mu / H, a step has one solution. For larger k the block would jump. The effect passes k to the package, which
warns if k is too large.

Backward Euler agrees with the closed form at every instant, if steps end at the reversals of the top.

    vemcvx run problems/slip_weakening.py --n 4 --steps 40
"""

from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from vemcvx.effects import Contribution, Friction, Law


@dataclass(frozen=True)
class SlipWeakening(vx.Effect):
    """Friction whose bound falls linearly with the accumulated slip.

    Parameters
    ----------
    peak, residual : float
        g_p >= g_r >= 0, force per length.
    distance : float
        The slip over which the bound falls from peak to residual.
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies.
    """

    peak: float
    residual: float
    distance: float
    on: str

    def contribute(self, space):
        rows = space.part(self.on, "SlipWeakening", contact=True).node_normals
        k = (self.peak - self.residual) / self.distance

        def weights(t, p, past, slip):
            return rows.lengths * np.maximum(self.peak - k * (past + slip), self.residual)

        law = Law(weights, softening=k * rows.lengths)
        friction = replace(Friction.from_rows(rows, "SlipWeakening"), law=law)
        return Contribution(frictions=(friction,))

    def describe(self):
        return f"SlipWeakening: bound from {self.peak} to {self.residual} over the slip {self.distance} on {self.on}"


LENGTH, HEIGHT, YOUNG, POISSON = 2.0, 0.5, 26.0, 0.3
MU = YOUNG / (2 * (1 + POISSON))
PEAK, RESIDUAL = 1.0, 0.4
FALL = 0.5 * MU / HEIGHT
AMPLITUDE = 1.4 * PEAK * HEIGHT / MU
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 40}


def top(t):
    """Return the displacement U of the top."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def exact_solution(instants):
    """Return the friction q (positive against slip to the right) and the displacement a of the bottom."""
    q, a, way = np.zeros(len(instants)), np.zeros(len(instants)), 0.0
    for n, U in enumerate(top(instants[1:]), start=1):
        trial = MU * (U - a[n - 1]) / HEIGHT
        bound = max(PEAK - FALL * way, RESIDUAL)
        slip = max(abs(trial) - bound, 0.0) / (MU / HEIGHT - FALL)
        if PEAK - FALL * (way + slip) < RESIDUAL:
            slip = max(abs(trial) - RESIDUAL, 0.0) / (MU / HEIGHT)
        a[n], way = a[n - 1] + np.sign(trial) * slip, way + slip
        q[n] = MU * (U - a[n]) / HEIGHT
    return q, a


def scene(distance=(PEAK - RESIDUAL) / FALL):
    def move_top(x, t):
        return np.tile([top(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(move_top, on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0)),
        vx.BilateralContact(on="bottom"),
        SlipWeakening(PEAK, RESIDUAL, distance, on="bottom"),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """Draw the block at the first reversal, and friction against the displacement of the top."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    vx.plots.stressed_body(history, step=history.steps // 5, ax=body, stress="shear", units=UNITS)
    dense = times(1000)
    graph.plot(top(dense), exact_solution(dense)[0], "k-", label="closed form")
    graph.plot(top(history.times), -history.contact.traction[:, :, 0].mean(axis=1), "C0o", label="computed")
    for bound, style in ((PEAK, ":"), (RESIDUAL, "--")):
        for sign in (1, -1):
            graph.axhline(sign * bound, color="0.5", linestyle=style, linewidth=1.0)
    graph.set(xlabel="displacement $U$ of the top (mm)", ylabel="friction, against slip to the right (MPa)")
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend(loc="lower right")
    return figure
