r"""Two blocks with friction between them, sheared back and forth: a loop in closed form, exact on every mesh.

Blocks of shear moduli mu_1, mu_2 and heights H_1, H_2 lie on each other, with the same length and meshes that do not
match. The lower block is clamped at its bottom, and the top of the upper block moves by U(t) = U0 (0, 1, -1, 1) at
t = 0, 1, 3, 5. The sides of both blocks are free along x only, so both blocks are sheared uniformly. Bilateral contact
and Tresca friction with the bound g act between the blocks. The friction traction q is the shear stress of both blocks,
so the slip of the upper over the lower block is

$$ a = U - C q, \qquad C = H_1 / \mu_1 + H_2 / \mu_2. $$

The blocks act like springs in series with a slider. In step n, q_n is (U_n - a_{n-1}) / C, clipped to the interval from
-g to g. A closed loop of the amplitude U0 > g C dissipates 4 g (U0 - g C) per length. Displacements are linear in each
block, so virtual elements reproduce the solution on any two meshes.

    vemcvx run problems/two_blocks_in_series.py --mesh nonconvex --n 4 --steps 40
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHTS, YOUNG, POISSON, BOUND = 2.0, (0.6, 0.4), (1000.0, 3000.0), 0.3, 0.8
MU = tuple(young / (2 * (1 + POISSON)) for young in YOUNG)
COMPLIANCE = sum(height / mu for height, mu in zip(HEIGHTS, MU, strict=True))
AMPLITUDE = 2.5 * BOUND * COMPLIANCE
JOINT = "lower|upper"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 40}


def top(t):
    """Return the displacement U of the top."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def exact_solution(instants):
    """Return the friction traction q and the slip a of the upper over the lower block at all instants."""
    q, a = np.zeros(len(instants)), np.zeros(len(instants))
    for n, U in enumerate(top(instants[1:]), start=1):
        q[n] = np.clip((U - a[n - 1]) / COMPLIANCE, -BOUND, BOUND)
        a[n] = U - q[n] * COMPLIANCE
    return q, a


def scene():
    def move_top(x, t):
        return np.tile([top(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, on="lower"),
        vx.Elasticity(YOUNG[1], POISSON, on="upper"),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(move_top, on="upper.top"),
        vx.PrescribedDisplacement(
            0.0, on=["lower.left", "lower.right", "upper.left", "upper.right"], direction=(0.0, 1.0)
        ),
        vx.BilateralContact(on=JOINT),
        vx.TrescaFriction(BOUND, on=JOINT),
    )


def mesh(n, family="hexagons"):
    """Return the blocks: the lower block in cells of `family`, the upper block in squares, n + 3 across its height."""
    lower = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHTS[0])))
    upper = vx.meshes.squares(n + 3, box=((0, LENGTH), (HEIGHTS[0], sum(HEIGHTS))))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """Draw both blocks at the first reversal, and the loop of friction against the displacement of the top."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    how = {"stress": "shear", "forces": "friction", "units": UNITS}
    vx.plots.stressed_body(history, step=history.steps // 5, ax=body, **how)
    dense = times(1000)
    graph.plot(top(dense), exact_solution(dense)[0], "k-", label="closed form")
    graph.plot(top(history.times), history.contact.traction[:, :, 0].mean(axis=1), "C0o", label="computed")
    for sign in (1, -1):
        graph.axhline(sign * BOUND, color="0.5", linestyle="--", linewidth=1.0)
    graph.set(xlabel="displacement $U$ of the top (mm)", ylabel="friction traction $q$ (MPa)", ylim=(-0.9, 1.25))
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend(loc="upper left")
    return figure
