r"""A pad that brakes a disc: pressed while the disc turns, relieved while it turns back; a cycle wears it by so much.

The disc is a ring a < r < b on a rigid hub, which turns by the small angle phi(t). A pad lies on its rim, |x| < b sin
alpha; its sides are guided along y, its flat top is pressed by P(t), and nothing but Coulomb's friction and one-sided
contact joins the two. A cycle: the hub turns forward by PHI under the full pressure, the pad is relieved to P0 / 10,
the hub turns back, the pad is pressed again. Both bodies are elastic, and at first the pad sticks and is sheared.

Once all of it slips, friction is mu p at every node, all at the radius b: the torque is mu b N, N = integral of p. The
pad's balance along y, 2 b sin(alpha) P = integral of p (cos theta - mu sin theta) ds with theta forward from its
middle, leaves N to p(theta); if that is p_0 cos theta, as of a lining that has been worn to fit (Shigley and Mischke,
*Mechanical Engineering Design*, brakes with symmetrical shoes),

$$ N = 2 b \sin(\alpha) P (4 \sin \alpha) / (2 \alpha + \sin 2 \alpha), $$

which is within 0.2 % of N for a uniform p, and an elastic pad is near. Friction dissipates in every step, and from
the second cycle on alike in each.

    vemcvx run problems/brake_pad_on_disc.py --n 8 --steps 96 --plot
"""

import numpy as np

import vemcvx as vx
from plate_with_hole import polar
from problem_pictures import MM
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots import stressed_body, wear
from vemcvx.plots.style import COMPUTED, EXACT

HUB, RIM, TOP, ALPHA = 0.4, 1.0, 1.3, np.pi / 6
YOUNG, POISSON, FRICTION, PRESSURE = (1000.0, 400.0), 0.3, 0.4, 1.0
ANGLE = 4e-3
JOINT = "disc|pad"
CYCLE = 24
"""Steps of a cycle: 10 forward, 2 to relieve the pad, 10 back, 2 to press it."""
UNITS = MM
SMALL = {"n": 6, "steps": 3 * CYCLE}
initial = "settled"


def turned(t):
    """phi(t), counted clockwise: the rim moves along x under the pad."""
    return ANGLE * np.interp(t % 1.0, np.array([0, 10, 12, 22, 24]) / CYCLE, [0, 1, 1, 0, 0])


def pressed(t):
    """P(t)."""
    return PRESSURE * np.interp(t % 1.0, np.array([0, 10, 12, 22, 24]) / CYCLE, [1, 1, 0.1, 0.1, 1])


def torque_of_slip(P):
    """mu b N of a pad that slips as a whole, with p like the cosine."""
    force = 2 * RIM * np.sin(ALPHA) * P
    return FRICTION * RIM * force * 4 * np.sin(ALPHA) / (2 * ALPHA + np.sin(2 * ALPHA))


def scene(friction=FRICTION):
    def hub(x, t):
        return turned(t) * np.column_stack([x[:, 1], -x[:, 0]])

    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, plane="stress", on="disc"),
        vx.Elasticity(YOUNG[1], POISSON, plane="stress", on="pad"),
        vx.PrescribedDisplacement(hub, on="disc.inner"),
        vx.PrescribedDisplacement(0.0, on="pad.sides", direction=(1.0, 0.0)),
        vx.Pressure(lambda x, t: np.full(len(x), pressed(t)), on="pad.top"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def mesh(n, family="polar"):
    """2n cells along the pad, and 24n around the disc: every second node of the rim meets one of the pad."""
    rings = max(2, round(24 * n / (2 * np.pi) * np.log(RIM / HUB)))
    disc = polar(np.geomspace(HUB, RIM, rings + 1), np.linspace(0, 2 * np.pi, 24 * n + 1))
    pad = vx.meshes.squares((2 * n, n), box=((-1, 1), (0, 1)))
    s, angle = pad.points[:, 1], np.pi / 2 - ALPHA * pad.points[:, 0]
    x, y = RIM * np.cos(angle), RIM * np.sin(angle)
    edge = RIM * np.sin(ALPHA) * (1 - 1e-9)
    shaped = vx.PolygonMesh(np.column_stack([x, y + s * (TOP - y)]), pad.cells)
    shaped = shaped.with_boundary("sides", lambda p: np.abs(p[:, 0]) > edge)
    shaped = shaped.with_boundary("top", lambda p: p[:, 1] > TOP * (1 - 1e-9))
    return vx.meshes.bodies({"disc": disc, "pad": shaped}, tolerance=RIM * (ALPHA / n) ** 2 / 7)


def times(steps):
    return np.arange(steps + 1) / CYCLE


def torque(history):
    """Of the hub, against friction."""
    hub = np.unique(history.mesh.boundaries["disc.inner"])
    (x, y), (fx, fy) = history.mesh.points[hub].T, np.moveaxis(history.forces[:, hub], 2, 0)
    return (fx * y - fy * x).sum(axis=1)


def picture(history):
    """Pad and rim while they slip, the torque over the angle, and wear along the rim after every cycle."""
    figure = new_figure(9.4, 5.6)
    axes = figure.subplot_mosaic([["body", "torque"], ["body", "wear"]])
    stressed_body(history, 10, ax=axes["body"], stress="shear", window=((-1.05, 1.05), (-1.05, 1.4)), units=UNITS)
    angle, graph = 1e3 * turned(history.times), axes["torque"]
    graph.plot(angle, torque(history), "o-", color=COMPUTED, markersize=4, linewidth=0.8, label="computed")
    for P, label in ((PRESSURE, "pad slips"), (-0.1 * PRESSURE, None)):
        graph.axhline(torque_of_slip(P), color=EXACT, linestyle="--", linewidth=1.2, label=label)
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", loc="center")
    graph.set(xlabel="angle of the hub (1/1000)", ylabel="torque on the hub (N)")
    wear(history, steps=range(CYCLE, history.steps + 1, CYCLE), ax=axes["wear"], units=UNITS)
    axes["wear"].set_title("")
    return figure
