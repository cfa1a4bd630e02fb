"""A load that turns back between two steps: what the time step costs, and when it costs nothing.

The block of the paper's Section 4, ten times as stiff, twice as strongly pulled, and by a load that grows until
t = 1/2 and then goes back to nothing. While it grows slip spreads along the contact; when it turns everything sticks at
once, and slip in the other direction spreads, over less of the contact. In the end the body is unloaded and not at
rest: friction locks stresses in.

Backward Euler knows the load at the ends of its steps alone. An odd number of equal steps misses the turn by k/2 on
either side, hence the largest load by its share k; what slipped less on the way up is not made up for on the way down,
and from the turn to the end the answer is off by O(k), as (3.28) of the paper allows. With an even number of steps the
turn is met; while the load only grows, as in the paper (`feng_han_huang.py`), the response is piecewise affine, nothing
that slips sticks again, and as few steps as one cares for give the same answer.

    vemcvx run problems/missed_reversal.py --n 16 --steps 27 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED

PUSH = 16.0
UNITS = MM
SMALL = {"n": 16, "steps": 9}


def course(t):
    """The load in time, between 0 and 1."""
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


def farthest(history, reference):
    """max over n of |u_n - u_ref(t_n)|_{a^h} / |u_ref|, on one mesh: the steps of the one are among the other's."""
    apart = [vx.measures.energy_distance(history, reference, kind="nodal", time=t) for t in history.times]
    return max(one.absolute for one in apart) / max(one.reference for one in apart)


def picture(history):
    """What is left in the unloaded block, and the way the pulled corner took there, beside that of a met turn."""
    how = {"stress": "xx", "forces": "friction", "shares": (1.0, 1.1), "limits": (-6.5, 0.0)}
    figure, graph = body_and_graph(history, step=-1, **how)
    met = vx.simulate(scene(), history.mesh, times(200))
    corner = np.argmin(history.contact.points[:, 0])
    ways = [(course(run.times), run.contact.slip[:, corner, 0]) for run in (history, met)]
    label = f"{history.steps} steps, the turn missed"
    beside_closed_form(graph, *ways, label=label, exact_label="200 steps, the turn met")
    graph.plot(*ways[0], color=COMPUTED, linewidth=0.8)
    graph.set(xlabel="load, as part of the largest", ylabel="slip of the pulled corner (mm)")
    off = farthest(history, vx.simulate(scene(), history.mesh, times(2 * history.steps)))
    graph.set_title(f"farthest from it: {100 * off:.2g} % in energy", fontsize="small")
    return figure
