r"""A block pressed on a rough floor, then sheared back and forth: two stages, in closed form, exact on every mesh.

The block (0, L) x (0, H) has L = 2, H = 1/2, E = 1000, nu = 0, and lies on a floor with Coulomb friction of coefficient
f. In the first stage, 0 <= t <= 1, a pressure on the top grows to P. Then u_y = -t P y / E. As nu = 0, the friction
force is zero. In the second stage the pressure stays, and the top is moved along the floor by U(t) = U0 (0, 1, -1, 1)
at the instants 1, 2, 4, 6. Let gamma be the shear, and mu = E / 2. The tractions +-mu gamma act on the sides of the
block. Therefore the shear is uniform, and the slip a is the same on the whole floor. After step n

$$ \gamma_n = \operatorname{clip}((U_n - a_{n-1}) / H, \pm f P / \mu), \qquad a_n = U_n - \gamma_n H. $$

A closed loop of the amplitude U0 > f P H / mu dissipates 4 f P L (U0 - f P H / mu). The energy P^2 L H / 2E of the
first stage stays stored. `vx.joined` joins both stages to one history.

    vemcvx run problems/pressed_then_sheared.py --n 4 --out results/pressed --plot --report
"""

import numpy as np

import vemcvx as vx

YOUNG, LENGTH, HEIGHT, PRESSURE, COEFFICIENT = 1000.0, 2.0, 0.5, 4.0, 0.2
MU = YOUNG / 2
AMPLITUDE = 2.5 * COEFFICIENT * PRESSURE * HEIGHT / MU
TIMES = np.linspace(0.0, 1.0, 3), np.linspace(1.0, 6.0, 41)
"""The instants of both stages."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4}


def top(t):
    """Return U(t)."""
    return AMPLITUDE * np.interp(t, [1, 2, 4, 6], [0, 1, -1, 1])


def exact_solution(coefficient=COEFFICIENT):
    """Return the shear gamma and the slip a at every instant of the second stage."""
    gamma, a = np.zeros(len(TIMES[1])), np.zeros(len(TIMES[1]))
    most = coefficient * PRESSURE / MU
    for n, U in enumerate(top(TIMES[1][1:]), start=1):
        gamma[n] = np.clip((U - a[n - 1]) / HEIGHT, -most, most)
        a[n] = U - gamma[n] * HEIGHT
    return gamma, a


def stages(coefficient=COEFFICIENT):
    """Return both stages, each as a pair (scene, times)."""

    def press(x, t):
        return np.full(len(x), PRESSURE * min(t, 1.0))

    def shear(sign):
        gamma, _ = exact_solution(coefficient)
        return lambda x, t: np.tile([0.0, sign * MU * np.interp(t, TIMES[1], gamma)], (len(x), 1))

    def move_top(x, t):
        return np.full(len(x), top(t))

    common = (
        vx.Elasticity(young=YOUNG, poisson=0.0),
        vx.Pressure(press, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom"),
    )
    hold_top = vx.PrescribedDisplacement(0.0, on="top", direction=(1.0, 0.0))
    shear_loads = (
        vx.PrescribedDisplacement(move_top, on="top", direction=(1.0, 0.0)),
        vx.Traction(shear(1.0), on="right"),
        vx.Traction(shear(-1.0), on="left"),
    )
    return [(vx.Scene(*common, hold_top), TIMES[0]), (vx.Scene(*common, *shear_loads), TIMES[1])]


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def picture(history):
    """Draw the block at the last instant, and the reaction of the top against its displacement in the second stage."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="shear", forces="contact", units=UNITS)
    second = history.times >= 1.0
    graph.plot(top(TIMES[1]), MU * exact_solution()[0] * LENGTH, "k-", label="closed form")
    graph.plot(top(history.times[second]), history.reaction("top")[second, 0], "C0o", label="computed")
    graph.set(xlabel="displacement of the top (mm)", ylabel="reaction of the top (N)")
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend()
    return figure
