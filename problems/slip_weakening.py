r"""Friction that weakens with slip, an effect of one's own: a block sheared to and fro over a floor.

The block (0, L) x (0, H) has the shear modulus mu. Its top moves by U(t) = U0 (0, 1, -1, 1) at t = 0, 1, 3, 5, its
sides are free along x only, so that it shears uniformly. The friction bound falls with the slip A that a place has made
so far, to and fro, from its peak to what is left:

$$ g(A) = \max(g_p - k A, g_r). $$

With the slip a of the block and its friction q = mu (U - a) / H it sticks while |q| < g(A), and slips with |q| = g(A):

$$
da = (|\mu(U - a) / H| - g(A)) / (\mu/ H - k)
\qquad \text{until } g = g_r, \text{ and with } k = 0 \text{ from there}.
$$

This is stable, and a step has one solution, if k < mu / H: else the block would jump. The effect states k as
`softening`, and `vemcvx show` compares it with the stiffness of the block.

Backward Euler meets the closed form at every instant, for steps that end where the top turns.

    vemcvx run problems/slip_weakening.py --n 4 --steps 40
"""

from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.effects import Contribution, Friction, Law


@dataclass(frozen=True)
class SlipWeakening(vx.Effect):
    """Friction whose bound falls linearly with the accumulated slip.

    Parameters
    ----------
    peak, residual : float
        g_p >= g_r >= 0, force per length.
    distance : float
        The slip over which one falls to the other.
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
UNITS = MM
SMALL = {"n": 4, "steps": 40}


def top(t):
    """U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def closed_form(instants):
    """The friction q on the block (positive against slip to the right) and its slip a at every instant."""
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
    def moved(x, t):
        return np.tile([top(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(moved, on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0)),
        vx.BilateralContact(on="bottom"),
        SlipWeakening(PEAK, RESIDUAL, distance, on="bottom"),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """The block at the first turn, and friction over the motion of the top."""
    figure, graph = body_and_graph(history, step=history.steps // 5, stress="shear", shares=(1.2, 1.0))
    traction, dense = -history.contact.traction[:, :, 0].mean(axis=1), times(1000)
    beside_closed_form(graph, (top(history.times), traction), (top(dense), closed_form(dense)[0]))
    for bound, style in ((PEAK, ":"), (RESIDUAL, "--")):
        for sign in (1, -1):
            graph.axhline(sign * bound, color="0.5", linestyle=style, linewidth=1.0)
    graph.legend(frameon=False, fontsize="small", loc="lower right")
    graph.set(xlabel="top moved aside by $U$ (mm)", ylabel="friction, against slip to the right (MPa)")
    return figure
