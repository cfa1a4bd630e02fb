r"""A brake pad on a disc: friction that grows or falls with the speed of slip.

The pressure P presses the pad (0, L) x (0, H) on the disc below. The disc moves along x by V t. Friction per length
depends on the speed v of slip,

$$ g(v) = \max(\mu_0 P + c v, \mu_1 P), \qquad \mu_1 < \mu_0 . $$

The top of the pad is held along x, and the sides move along y as in uniform compression. Therefore the pad is sheared
uniformly. With the shear modulus G, it acts like a spring of the stiffness G / H per length. The pad sticks until its
friction q = G V t / H is mu_0 P, at the instant t_0. Then the speed of slip is V - q' H / G. If friction grows (c > 0),
q = g(V - q' H / G) has the solution

$$ q(t) = g(V) - c V e^{-(t - t_0) / \tau}, \qquad \tau = c H / G . $$

Every step is a convex program with a certified error bound. In the steady state, friction is g(V) on every mesh.

Now let friction fall (c < 0). Under uniform shear, a step of the length k has one solution if the ratio of softening to
stiffness, -c H / (G k), is less than 1. For larger ratios friction jumps from mu_0 P to mu_1 P when the pad begins to
slip. On slow discs, V < (mu_0 - mu_1) P / |c|, the pad then sticks again: q is a sawtooth with the period (mu_0 - mu_1)
P H / (G V). On faster discs there is a second solution besides this sawtooth: the pad slips forever at q = mu_1 P. Try
`--set growth=-.15` for c = -.15: a warning names the ratio.

    vemcvx run problems/brake_pad.py --n 4 --steps 80 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG = 40.0, 10.0, 200.0
PRESSURE, AT_REST, SLIDING, GROWTH, SPEED = 2.0, 0.4, 0.3, 0.4, 1.0
G = YOUNG / 2
"""The shear modulus for nu = 0."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 80}


def bound(speed, growth=GROWTH):
    """Return g(v), the friction per length, at the speeds v of slip."""
    return np.maximum(AT_REST * PRESSURE + growth * speed, SLIDING * PRESSURE)


def friction(t, growth=GROWTH):
    """Return q at the instants t, for friction that grows with speed."""
    start = AT_REST * PRESSURE * HEIGHT / (G * SPEED)
    creep = bound(SPEED, growth) - growth * SPEED * np.exp(-np.maximum(t - start, 0.0) * G / (growth * HEIGHT))
    return np.where(t < start, G * SPEED * t / HEIGHT, creep)


def evaluate_saw():
    """Return the least friction, the largest friction and the period of the sawtooth."""
    low, high = SLIDING * PRESSURE, AT_REST * PRESSURE
    return low, high, (high - low) * HEIGHT / (G * SPEED)


def scene(growth=GROWTH):
    return vx.Scene(
        vx.Elasticity(YOUNG, 0.0),
        vx.Pressure(PRESSURE, on="top"),
        vx.PrescribedDisplacement(0.0, on="top", direction=(1.0, 0.0)),
        vx.PrescribedDisplacement(lambda x, t: -PRESSURE / YOUNG * x[:, 1], on=["left", "right"], direction=(0.0, 1.0)),
        vx.BilateralContact(on="bottom"),
        vx.SpeedFriction(
            lambda speed: bound(speed, growth),
            on="bottom",
            softening=max(-growth, 0.0),
            ground=lambda x, t: (SPEED * t, 0.0),
        ),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 0.4, steps + 1)


initial = "settled"


def measure_friction(history):
    """Return the mean friction per length at every step."""
    return history.force("bottom")[:, 0] / LENGTH


def picture(history):
    """Draw the sheared pad, and friction against time for c > 0 and c < 0."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.6), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="shear", forces="friction", units=UNITS)
    dense = np.linspace(0.0, history.times[-1], 500)
    graph.plot(dense, friction(dense), "k-", label="closed form")
    graph.plot(history.times, measure_friction(history), "C0o", label="grows with speed")
    saw = vx.simulate(scene(-0.15), history.mesh, history.times, initial="settled")
    graph.plot(saw.times, measure_friction(saw), "C1s-", label="falls with speed")
    for value in evaluate_saw()[:2]:
        graph.axhline(value, color="0.5", linestyle="--", linewidth=1.0)
    graph.set(xlabel="t (s)", ylabel="friction (MPa)")
    graph.grid()
    graph.legend(loc="lower right")
    return figure
