"""An L-shaped bracket, clamped at its top and pulled along a rough floor: stress is infinite in its re-entrant corner.

At the distance r from the corner of 270 degrees strains grow like r^(a-1) = r^-0.455, where a = 0.5445 is the root of
sin(1.5 pi a) = -a sin(1.5 pi) between 0 and 1 (Williams, *Stress singularities resulting from various boundary
conditions in angular corners of plates in extension*, J. Appl. Mech. 19, 1952). On equal squares the error in the
energy norm is therefore only O(h^0.5445), or O(N^-0.27) for N unknowns. Adaptive meshes (`adaptive_meshes.py`) recover
O(N^-0.5). Slip on the floor spreads from the pulled right side.

    vemcvx run problems/l_shaped_bracket.py --n 32 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx

UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 16, "steps": 8}
EXPONENT = 0.5444837 - 1.0
"""The exponent a - 1 of the stress, from Williams' equation."""


def course(t):
    """Return the pull at the instant t, divided by the pull at t = 1."""
    return t


def scene(pull=2.0, bound=1.2, course=course):
    def force(x, t):
        return np.tile([pull * course(t), -0.25 * pull * course(t)], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="top"),
        vx.Traction(force, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def mesh(n, family="l_shape"):
    return vx.meshes.l_shape(n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def stress_near_corner(history):
    """Return distances to the corner (up to about 0.2) and von Mises' stresses of the cells on the bisector."""
    arm = history.mesh.centroids - np.array([0.5, 0.5])
    near = (np.abs(arm[:, 0] - arm[:, 1]) < 1e-9) & (arm[:, 0] > -0.15)
    distance = np.linalg.norm(arm[near], axis=1)
    order = np.argsort(distance)
    return distance[order], history.von_mises(-1)[near][order]


def picture(history):
    """Draw the stress in the bracket, and its growth towards the corner beside the power r^(a-1)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    vx.plots.stressed_body(history, ax=body, stress="shear", forces="friction", units=UNITS)
    fine = vx.adapt(scene(), vx.meshes.l_shape(4), [0.0, 1.0], 0.04)
    r, stress = stress_near_corner(fine.history)
    inside = np.array([r[0], 0.05])
    graph.plot(inside, stress[2] * (inside / r[2]) ** EXPONENT, "k-", label=r"$r^{-0.455}$")
    graph.plot(r, stress, "C0o", label="adaptive mesh, error 4 %")
    graph.set(xscale="log", yscale="log", xlabel="distance to the corner (mm)", ylabel="von Mises' stress (MPa)")
    graph.set_yticks([1, 2, 5], ["1", "2", "5"])
    graph.minorticks_off()
    graph.grid()
    graph.legend()
    return figure
