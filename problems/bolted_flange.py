r"""A bolted flange on a shaking base: friction that slips sideways does not hold a torque, and the joint unscrews.

A ring of steel, radii 30 and 60 mm, 12 mm high, is pressed on a rigid base by four bolts. Their shanks hold it, like
springs spread over the top, against moving sideways and turning; a torque M of three quarters of what friction could
bear acts on it from the start. At rest friction bears it: the ring does not turn. Then the base shakes along x_1, a
cycle in each unit of time, far enough that all of the sole slips. A slipping sole gives its friction to the shaking;
what is left against the torque is less, and in every cycle the ring turns on, until the springs alone bear the torque:

$$ \text{angle} = M / (k J), \qquad J = \int r^2 \text{ over the top}, k \text{ the stiffness of the springs} $$

(Junker, SAE 690055, 1969, found that joints unscrew under transverse slip, not under axial loads.) At each instant the
torques of load, springs and friction are in equilibrium, to rounding. SI units.

    vemcvx run problems/bolted_flange.py --n 2 --steps 64 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import face_and_graph
from twisted_pad import rings
from vemcvx.base.canvas import light_grid
from vemcvx.plots.style import COMPUTED

YOUNG, POISSON, FRICTION = 210e9, 0.3, 0.2
INNER, OUTER, HEIGHT, BOLTS = 0.03, 0.06, 0.012, 4
PRESSURE, SPRINGS, SHAKING = 20e6, 4e10, 6e-5
FORCE = PRESSURE / 2 * np.pi * (OUTER**2 - INNER**2)
"""Of all bolts, whose pressure goes up and down around the ring."""
BEARS = 2 / 3 * FRICTION * FORCE * (OUTER**3 - INNER**3) / (OUTER**2 - INNER**2)
"""The torque that friction can bear."""
SECOND_MOMENT = np.pi * (OUTER**4 - INNER**4) / 2
STEPS = 8
"""In a cycle."""
SMALL = {"n": 2, "steps": 3 * STEPS}
UNITS = {"length": "m", "time": "cycles", "force per area": "Pa"}


def bolted(x, t):
    """The pressure under the bolts."""
    return PRESSURE * np.cos(BOLTS / 2 * np.arctan2(x[:, 1], x[:, 0])) ** 2


def scene(friction=FRICTION, share=0.75, shaking=SHAKING):
    def screwed(x, t):
        return share * BEARS / SECOND_MOMENT * np.column_stack([-x[:, 1], x[:, 0], np.zeros(len(x))])

    def base(x, t):
        moved = shaking * np.interp(t % 1.0, [0, 0.25, 0.75, 1], [0, 1, -1, 0])
        return np.tile([moved, 0.0, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Pressure(bolted, on="top"),
        vx.Traction(screwed, on="top"),
        vx.ElasticFoundation(normal=SPRINGS, tangential=SPRINGS, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(friction, on="bottom", ground=base),
    )


initial = "settled"


def mesh(n, family="rings"):
    """n rings, 16n sectors and n layers."""
    return rings(np.linspace(INNER, OUTER, n + 1), 16 * n, hole=True).extruded(np.linspace(0.0, HEIGHT, n + 1))


def times(steps):
    return np.arange(steps + 1) / STEPS


def angle(history):
    """The angle by which the top has turned, at every step."""
    mesh = history.mesh
    x, u = (of[..., mesh.points[:, 2] > 0.99 * HEIGHT, :] for of in (mesh.points, history.displacement))
    return ((x[:, 0] * u[:, :, 1] - x[:, 1] * u[:, :, 0]) / (x[:, :2] ** 2).sum(axis=1)).mean(axis=1)


def picture(history):
    """The sole when it slips, and how the ring unscrews."""
    figure, graph = face_and_graph(history, step=history.steps - 2, units=UNITS)
    final = 0.75 * BEARS / (SPRINGS * SECOND_MOMENT)
    graph.plot(history.times, angle(history) / final, "o-", color=COMPUTED, markersize=4, linewidth=1.0, label="turned")
    graph.axhline(1.0, color="0.5", linestyle="--", linewidth=1.2, label="springs alone bear the torque, $M/(kJ)$")
    graph.set(xlabel="cycles", ylabel="angle over $M/(kJ)$", ylim=(0, 1.1))
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", loc="lower right")
    return figure
