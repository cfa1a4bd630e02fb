r"""A block pushed askew over a rough floor: the problem of Feng, Han and Huang (Section 4) in space.

The unit cube, E = 200, nu = .3, is clamped on its right side, x_1 = 1, and rests on a rigid floor, x_3 = 0, in
bilateral contact with Tresca friction, bound g = 4. On its left side acts the traction

$$ f_2(x, t) = (8 (1.25 - x_3) t, 2 t, -0.01 t), \qquad 0 \le t \le 1, $$

the paper's load on each slice, and a push aside. (With `aside` = 0 the problem is the same at x_2 and 1 - x_2.) In
space |v_tau| is the length of a vector of two components, and friction opposes the slip whatever its direction.
Stresses, g and f_2 are in daN/mm^2, lengths in mm, time in s.

What happens: the loaded edge of the floor's face slips first, slip spreads to the right, and the friction of its nodes
turns as it does: it begins against the push, and is turned by what slips around it.

    vemcvx run problems/block_in_space.py --mesh cubes --n 12 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, face_and_graph
from vemcvx.plots import friction_disc

UNITS = MM
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
    """The face on the floor, what sticks and where to the rest slips, and friction in its disc."""
    figure, graph = face_and_graph(history)
    friction_disc(history, ax=graph, units=UNITS)
    return figure
