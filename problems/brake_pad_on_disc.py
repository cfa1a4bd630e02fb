r"""A brake pad, pressed while its disc turns forward, and relieved while the disc turns back.

The disc is a ring a < r < b on a rigid hub, which rotates by the small angle phi(t). A pad lies on the rim of the disc,
|x| < b sin alpha. The sides of the pad are guided along y, and the pressure P(t) acts on its top. In a cycle the hub
rotates forward by `ANGLE` under the full pressure, the pressure falls to a tenth, the hub rotates back, and the pad is
pressed again. At first the pad sticks and is sheared.

Let p be the pressure between pad and disc, and N its integral over the arc. Once all of the pad slips, friction is mu p
at every node of the rim, which has the radius b. So the torque is mu b N. Let the angle theta be measured forward from
the middle of the pad. The equilibrium of the pad along y is 2 b sin(alpha) P = integral of p (cos theta - mu sin theta)
ds. For p = p_0 cos theta, as in a worn lining (Shigley and Mischke, *Mechanical Engineering Design*, brakes with
symmetrical shoes),

$$ N = 2 b \sin(\alpha) P (4 \sin \alpha) / (2 \alpha + \sin 2 \alpha), $$

which is within 0.2 % of N for a uniform p. From the second cycle on, friction dissipates the same energy in each cycle.

    vemcvx run problems/brake_pad_on_disc.py --n 8 --steps 96 --plot
"""

import numpy as np

import vemcvx as vx

HUB, RIM, TOP, ALPHA = 0.4, 1.0, 1.3, np.pi / 6
YOUNG, POISSON, FRICTION, PRESSURE = (1000.0, 400.0), 0.3, 0.4, 1.0
ANGLE = 4e-3
JOINT = "disc|pad"
CYCLE = 24
"""Number of steps of a cycle: 10 forward, 2 to relieve the pad, 10 back, 2 to press the pad."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 6, "steps": 3 * CYCLE}
initial = "settled"


def hub_angle(t):
    """Return phi(t), clockwise: the rim moves along x under the pad."""
    return ANGLE * np.interp(t % 1.0, np.array([0, 10, 12, 22, 24]) / CYCLE, [0, 1, 1, 0, 0])


def pad_pressure(t):
    """Return P(t)."""
    return PRESSURE * np.interp(t % 1.0, np.array([0, 10, 12, 22, 24]) / CYCLE, [1, 1, 0.1, 0.1, 1])


def slip_torque(P):
    """Return the torque mu b N of a pad that slips as a whole, for p = p_0 cos theta."""
    force = 2 * RIM * np.sin(ALPHA) * P
    return FRICTION * RIM * force * 4 * np.sin(ALPHA) / (2 * ALPHA + np.sin(2 * ALPHA))


def scene(friction=FRICTION):
    def rotate_hub(x, t):
        return hub_angle(t) * np.column_stack([x[:, 1], -x[:, 0]])

    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, plane="stress", on="disc"),
        vx.Elasticity(YOUNG[1], POISSON, plane="stress", on="pad"),
        vx.PrescribedDisplacement(rotate_hub, on="disc.inner"),
        vx.PrescribedDisplacement(0.0, on="pad.sides", direction=(1.0, 0.0)),
        vx.Pressure(lambda x, t: np.full(len(x), pad_pressure(t)), on="pad.top"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def mesh(n, family="polar"):
    """Return a mesh with 2n cells along the pad and 24n cells around the disc."""
    rings = max(2, round(24 * n / (2 * np.pi) * np.log(RIM / HUB)))
    disc = vx.meshes.ring(np.geomspace(HUB, RIM, rings + 1), 24 * n)
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
    """Return the torque of the hub on the disc, which balances friction."""
    hub = np.unique(history.mesh.boundaries["disc.inner"])
    (x, y), (fx, fy) = history.mesh.points[hub].T, np.moveaxis(history.forces[:, hub], 2, 0)
    return (fx * y - fy * x).sum(axis=1)


def picture(history):
    """Draw pad and rim while they slip, the torque against the angle, and the wear along the rim after every cycle."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 5.6), layout="constrained")
    axes = figure.subplot_mosaic([["body", "torque"], ["body", "wear"]])
    window = ((-1.05, 1.05), (-1.05, 1.4))
    vx.plots.stressed_body(history, 10, ax=axes["body"], stress="shear", window=window, units=UNITS)
    graph = axes["torque"]
    graph.plot(1e3 * hub_angle(history.times), torque(history), "C0o-", linewidth=0.8, label="computed")
    for P, label in ((PRESSURE, "pad slips as a whole"), (-0.1 * PRESSURE, None)):
        graph.axhline(slip_torque(P), color="black", linestyle="--", label=label)
    graph.set(xlabel="angle of the hub (1/1000)", ylabel="torque on the hub (N)")
    graph.grid()
    graph.legend(loc="center")
    vx.plots.along_contact(history, "wear", range(CYCLE, history.steps + 1, CYCLE), ax=axes["wear"], units=UNITS)
    axes["wear"].set_title("")
    return figure
