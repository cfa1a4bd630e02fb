"""A load that reverses between two instants: the error of the time steps.

The block of Feng, Han and Huang, Section 4 (`feng_han_huang.py`), is ten times as stiff here, and pushed twice as
strongly. The load grows until t = 1/2 and then returns to zero. While the load grows, slip spreads along the contact.
When the load reverses, all nodes stick at once; then slip in the other direction spreads over a smaller part of the
contact. At the end the body is unloaded but not stress-free, because friction locks stresses in.

Backward Euler evaluates the load only at the ends of its steps. If the number of equal steps is odd, the reversal is
half a step, k/2, away from the nearest instants. The run misses the last rise of the load, which is the fraction k of
the largest load, and lacks the slip that this rise causes. From the reversal to the end the error of the run is O(k).
With an even number of steps a step ends at the reversal. If the load only grows, any number of steps gives the same
displacement.

    vemcvx run problems/missed_reversal.py --n 16 --steps 27 --plot
"""

import numpy as np

import vemcvx as vx

PUSH = 16.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 16, "steps": 9}


def course(t):
    """Return the load at the instant t, divided by the largest load."""
    return 1.0 - abs(2.0 * t - 1.0)


def scene(push=PUSH, course=course):
    def pull(x, t):
        return np.column_stack([push * (1.25 - x[:, 1]), np.full(len(x), -0.01)]) * course(t)

    return vx.Scene(
        vx.Elasticity(young=2000.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def largest_distance(history, reference):
    """Return the largest energy distance to a reference run, relative to the largest energy norm of this reference.

    The reference has the same mesh, and its instants include all instants of the history.
    """
    distances = [vx.measures.energy_distance(history, reference, kind="nodal", time=t) for t in history.times]
    return max(one.absolute for one in distances) / max(one.reference for one in distances)


def picture(history):
    """Draw the stress left in the unloaded block, and the slip of the left corner against the load."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    how = {"stress": "xx", "forces": "friction", "units": UNITS}
    vx.plots.stressed_body(history, step=-1, ax=body, **how)
    corner, fine = np.argmin(history.contact.points[:, 0]), vx.simulate(scene(), history.mesh, times(200))
    graph.plot(course(fine.times), fine.contact.slip[:, corner, 0], "k-", label="200 steps, the reversal met")
    words = f"{history.steps} steps, the reversal missed"
    graph.plot(course(history.times), history.contact.slip[:, corner, 0], "C0o-", linewidth=0.8, label=words)
    graph.set(xlabel="load / largest load", ylabel="slip of the left corner (mm)")
    error = largest_distance(history, vx.simulate(scene(), history.mesh, times(2 * history.steps)))
    graph.set_title(f"largest error: {100 * error:.2g} % in the energy norm", fontsize="small")
    graph.grid()
    graph.legend()
    return figure
