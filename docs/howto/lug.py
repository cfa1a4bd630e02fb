"""A pin pulls at a steel bush that is pressed into the hole of an aluminium lug.

The lug is clamped at its left end. The radius of the bush is 0.01 mm larger than the radius of the hole. A pin in the
bush pulls to the right, up to 8 kN at t = 1. The model is the upper half of the lug, 10 mm thick, in plane stress.
Lengths are in mm, forces in N, stresses in MPa; forces in the results are for this half, per mm of thickness.
"""

import numpy as np

import vemcvx as vx

THICKNESS, BORE = 10.0, 7.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
initial = "settled"  # the bush is in the lug before the pin pulls


def scene(interference=0.01, friction=0.15, pull=8000.0):
    def pin(x, t):  # pressure on the right half of the bore: a cosine of the angle, with the resultant `pull * t`
        largest = pull * t / (THICKNESS * BORE * np.pi / 2)
        return largest * np.maximum(x[:, 0], 0.0) / np.hypot(*x.T)

    return vx.Scene(
        vx.Elasticity(young=210e3, poisson=0.3, plane="stress", on="bush"),
        vx.Elasticity(young=70e3, poisson=0.33, plane="stress", on="lug"),
        vx.Clamp(on="lug.grip"),
        vx.Symmetry(on=["bush.middle", "lug.middle"]),
        vx.UnilateralContact(on="joint", gap=-interference),
        vx.CoulombFriction(friction, on="joint"),
        vx.Pressure(pin, on="bush.bore"),
    )


def mesh(n, family="lug.msh"):
    return vx.meshes.read(family, bodies="physical")


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)
