r"""A block sheared back and forth over a rough floor: stick, slip and reversal in closed form, exact on every mesh.

The block (0, L) x (0, H), L = 2, H = 1/2, with E = 1000, nu = 1/4, has the shear modulus mu. The block rests on a floor
in bilateral contact, with Tresca friction of the bound g. The top is moved by U(t) = U0 (0, 1, -1, 1) at
t = 0, 1, 3, 5. Tractions +-mu gamma on the sides keep the shear uniform: u = (a + gamma y, 0). The shear gamma and the
slip a are, step by step,

$$ \gamma_n = \operatorname{clip}((U_n - a_{n-1}) / H, \pm g / \mu), \qquad a_n = U_n - \gamma_n H. $$

While mu |gamma| < g, the block sticks and a is constant. At mu |gamma| = g the block slips as a whole. A closed loop of
the amplitude U0 > g H / mu dissipates 4 g L (U0 - g H / mu). The displacement is linear, so virtual elements reproduce
it on any mesh. Every difference from this closed form is an algebraic error.

    vemcvx run problems/frictional_hysteresis.py --mesh nonconvex --n 4 --steps 40
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, LENGTH, HEIGHT = 1000.0, 0.25, 2.0, 0.5
MU = YOUNG / (2 * (1 + POISSON))
BOUND = 0.8
AMPLITUDE = 2.5 * BOUND * HEIGHT / MU
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 40}


def top(t):
    """Return U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def exact_solution(instants):
    """Return the shear gamma and the slip a at every instant."""
    gamma, a = np.zeros(len(instants)), np.zeros(len(instants))
    for n, U in enumerate(top(instants[1:]), start=1):
        gamma[n] = np.clip((U - a[n - 1]) / HEIGHT, -BOUND / MU, BOUND / MU)
        a[n] = U - gamma[n] * HEIGHT
    return gamma, a


def exact(points, instants, floor=0.0):
    """Return the displacement (N + 1, n_nodes, 2) at points; `floor` is the height of the floor."""
    gamma, a = exact_solution(instants)
    along = a[:, None] + gamma[:, None] * (points[:, 1] - floor)
    return np.stack([along, np.zeros_like(along)], axis=2)


def scene():
    instants = times(25)  # gamma is linear between these instants
    gamma, _ = exact_solution(instants)

    def shear(sign):
        def force(x, t):
            return np.tile([0.0, sign * MU * np.interp(t, instants, gamma)], (len(x), 1))

        return force

    def move_top(x, t):
        return np.tile([top(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(move_top, on="top"),
        vx.Traction(shear(1.0), on="right"),
        vx.Traction(shear(-1.0), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=BOUND, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """Draw the sheared block at the first reversal, and the loop of friction against the displacement of the top."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    how = {"stress": "shear", "forces": "friction", "stretch": 2.0, "units": UNITS}
    vx.plots.stressed_body(history, ax=body, step=history.steps // 5, **how)
    dense = times(1000)
    graph.plot(top(dense), MU * exact_solution(dense)[0], "k-", label="closed form")
    graph.plot(top(history.times), -history.contact.traction[:, :, 0].mean(axis=1), "C0o", label="computed")
    for bound in (BOUND, -BOUND):
        graph.axhline(bound, color="0.5", linestyle="--", linewidth=1.0)
    graph.set(xlabel="displacement $U$ of the top (mm)", ylabel="friction on the floor (MPa)", ylim=(-0.9, 1.25))
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend(loc="upper left")
    return figure
