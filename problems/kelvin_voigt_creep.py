r"""A viscous strip under a steady pull: creep towards the elastic answer, and friction that holds part of it back.

The strip (0, 4) x (0, 1), E = 10, nu = 1/4, has dashpots of relaxation time tau beside its springs, b = tau a. A pull
p acts at its right end from t = 0 on, steadily. Without friction every displacement is the elastic one times

$$ 1 - \exp(-t / \tau), \qquad \text{step by step} \qquad s_n = (1 + \tau / k s_{n-1}) / (1 + \tau / k) $$

(backward Euler; exact on every mesh, because the field is linear). With friction below, bound g, the far end stays
where the near one slips: the end creeps less far, and what friction and dashpots lose is in the ledger.

    vemcvx run problems/kelvin_voigt_creep.py --n 8 --steps 40 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import SECOND

YOUNG, POISSON, TAU, PULL = 10.0, 0.25, 0.7, 0.3
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
UNITS = MM
SMALL = {"n": 5, "steps": 40}


def share(instants):
    """How much of the elastic answer is there, step by step."""
    s = np.zeros(len(instants))
    for n, k in enumerate(np.diff(instants), start=1):
        s[n] = (1 + TAU / k * s[n - 1]) / (1 + TAU / k)
    return s


def course(t):
    """The pull in time, as part of the largest: it is there from the start."""
    return np.ones_like(t)


def scene(bound=0.05, course=course):
    def pull(x, t):
        return np.tile([PULL * course(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Viscosity(shear=TAU * MU, volume=TAU * LAM),
        vx.Symmetry(on="left"),
        vx.Traction(pull, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def mesh(n, family="hexagons"):
    return vx.meshes.FAMILIES[family](n, box=((0, 4), (0, 1)))


def times(steps):
    return np.linspace(0.0, 4.0, steps + 1)


def picture(history):
    """The strip in the end, and the creep of its end with friction, and without beside its closed form."""
    figure, graph = body_and_graph(history, stress="xx", forces="friction", stretch=2.0)
    end = history.mesh.points[:, 0] == 4.0
    elastic = PULL * (1 - POISSON**2) / YOUNG * 4.0
    free = vx.simulate(scene(bound=0.0), history.mesh, history.times).displacement[:, end, 0].mean(axis=1)
    marks, line = (history.times, free / elastic), (history.times, share(history.times))
    beside_closed_form(graph, marks, line, label="without friction", exact_label="closed form, step by step")
    t = np.linspace(0, history.times[-1], 300)
    graph.plot(t, 1 - np.exp(-t / TAU), "--", color="0.5", linewidth=1.2, label="as steps vanish")
    held = history.displacement[:, end, 0].mean(axis=1) / elastic
    graph.plot(history.times, held, "s-", color=SECOND, markersize=4, linewidth=1, label="friction below")
    graph.legend(frameon=False, fontsize="small")
    graph.set(xlabel="t (s)", ylabel="end moved / elastic answer")
    return figure
