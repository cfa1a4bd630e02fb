r"""A block on dashpots and springs: it sinks exponentially, or creeps without springs.

The block (0, L) x (0, H) of the weight w per area hangs on springs of the stiffness s per length at its top. The base
rests on dashpots: the pressure on the base is c times the downward velocity of the base. The block can move along y
only. Young's modulus is E, and nu = 0. Let a be the sinking of the base and p the pressure of the dashpots. At the
height y the vertical stress is w y - p, so that the top sinks by a + (p H - w H^2 / 2) / E. Forces balance:

$$
s \Big( a + \frac{p H - w H^2 / 2}{E} \Big) + p = w H, \qquad p = c a', \qquad
a(t) = a_\infty (1 - e^{-t / \tau}), \\
\tau = c \Big( \frac{1}{s} + \frac{H}{E} \Big), \qquad a_\infty = \frac{w H}{s} + \frac{w H^2}{2 E} .
$$

Up to the time t the dashpots dissipate c a_inf^2 (1 - exp(-2 t / tau)) / (2 tau) per length, the integral of c a'^2.
Without springs (`--set spring=0`) the block creeps at the constant speed w H / c.

At t = 4 the weight is taken off. Dashpots cannot pull, so the springs lift the block at once to a = 0. On squares, only
time steps cause errors. With steps of the length k, backward Euler yields the sinking

$$ a_n = (a_{n-1} + k a_\infty / \tau) / (1 + k / \tau) . $$

    vemcvx run problems/damped_support.py --n 4 --steps 50 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, WEIGHT, SPRING, DAMPING = 2.0, 1.0, 4.0, 0.2, 1.0, 1.0
REST = 4.0
"""The instant at which the weight is taken off."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 50}


def relaxation():
    """Return tau and a_inf."""
    return (
        DAMPING * (1 / SPRING + HEIGHT / YOUNG),
        WEIGHT * HEIGHT / SPRING + WEIGHT * HEIGHT**2 / (2 * YOUNG),
    )


def sinking(t, spring=SPRING):
    """Return the sinking a of the base at the instants t; without springs, for t <= `REST` only."""
    if spring == 0.0:
        return WEIGHT * HEIGHT / DAMPING * t
    tau, most = relaxation()
    return np.where(t <= REST, most * -np.expm1(-t / tau), 0.0)


def sinking_of_steps(instants):
    """Return the sinking after each step of backward Euler, up to `REST`."""
    tau, most = relaxation()
    a = np.zeros(len(instants))
    for n, k in enumerate(np.diff(instants), start=1):
        a[n] = (a[n - 1] + k * most / tau) / (1 + k / tau)
    return a


def evaluate_loss(t):
    """Return the energy that the dashpots dissipate up to the time t, for t <= `REST`."""
    tau, most = relaxation()
    return LENGTH * DAMPING * most**2 / (2 * tau) * -np.expm1(-2 * t / tau)


def scene(spring=SPRING, weight=WEIGHT):
    springs = [vx.ElasticFoundation(spring, on="top")] if spring else []
    return vx.Scene(
        vx.Elasticity(YOUNG, 0.0),
        vx.BodyForce(lambda x, t: (0.0, -weight * (t <= REST))),
        vx.Symmetry(on=["left", "right"]),
        vx.VelocityContact(on="bottom", damping=DAMPING),
        *springs,
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family]((2 * n, n), box=((0.0, LENGTH), (0.0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def measure_sinking(history):
    """Return the largest sinking of the base at every step."""
    base = history.mesh.points[:, 1] == 0.0
    return -history.displacement[:, base, 1].min(axis=1)


def picture(history):
    """Draw the sunk block, its sinking beside the closed form, and the balance of energy."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.4, 3.4), layout="constrained")
    body, graph, energies = figure.subplots(1, 3, width_ratios=(1.6, 1.0, 1.0))
    off = int(np.searchsorted(history.times, REST))
    vx.plots.stressed_body(history, off, ax=body, stress="yy", magnify=1.0, units=UNITS)
    dense = np.linspace(0.0, history.times[-1], 1001)
    graph.plot(dense, sinking(dense), "k-", label="closed form")
    graph.plot(history.times, measure_sinking(history), "C0o", label="computed")
    graph.set(xlabel="t (s)", ylabel="sinking of the base (mm)", ylim=(-0.01, 0.27))
    t = history.times[:off]
    energies.plot(t, history.work_second_order[:off], "C0o", label="work of the weight")
    energies.plot(t, history.energy[:off], "C2^", label="stored")
    energies.plot(t, history.dissipated_second_order[:off], "C1s", label="dissipated")
    energies.plot(t, evaluate_loss(t), "k-", label="closed form")
    energies.set(xlabel="t (s)", ylabel="energy (N mm per mm)", ylim=(-0.004, 0.12))
    for each in (graph, energies):
        each.grid()
        each.legend(loc="upper left")
    return figure
