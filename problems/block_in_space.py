r"""A block pushed obliquely over a rough floor: the problem of Feng, Han and Huang (Section 4) in space.

The unit cube with E = 200, nu = .3 is clamped on its right side, x_1 = 1, and rests on a rigid floor, x_3 = 0, in
bilateral contact with Tresca friction of the bound g = 4. The traction on the left side of the cube is

$$ f_2(x, t) = (8 (1.25 - x_3) t, 2 t, -0.01 t), \qquad 0 \le t \le 1. $$

This is the paper's load on each slice x_2 = const, plus a push along x_2. In space the slip velocity of a node has two
components, and friction opposes slip in every direction. Stresses, g and f_2 are in MPa, lengths in mm, time in s.

The loaded edge of the bottom slips first, and slip spreads to the right.

    vemcvx run problems/block_in_space.py --mesh cubes --n 12 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx

UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 8}


def scene(young=200.0, poisson=0.3, bound=4.0, push=8.0, aside=2.0, press=0.01):
    def pull(x, t):
        return t * np.column_stack([push * (1.25 - x[:, 2]), np.full(len(x), aside), np.full(len(x), -press)])

    return vx.Scene(
        vx.Elasticity(young=young, poisson=poisson),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the sticking and slipping nodes of the bottom, and the friction per area."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    vx.plots.contact_face(history, ax=face, units=UNITS)
    vx.plots.contact_face(history, ax=graph, show="friction", units=UNITS)
    return figure
