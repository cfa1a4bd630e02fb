r"""A viscous strip under a steady pull: it creeps towards the elastic displacement.

The strip (0, 4) x (0, 1), E = 10, nu = 1/4, in plane strain, is a Kelvin-Voigt body with the retardation time tau: its
viscous form b is tau times its elastic form a. A steady pull p acts at its right end from t = 0 on. Without friction
every displacement is the elastic displacement times a factor. In continuous time, and after n steps of backward Euler
with the step k, this factor is

$$ 1 - \exp(-t / \tau) \qquad \text{and} \qquad s_n = (1 + (\tau / k) s_{n-1}) / (1 + \tau / k), \qquad s_0 = 0. $$

The computed factor is s_n on every mesh, because the displacement is linear in space. Friction with the bound g on the
bottom opposes the pull, so that the pulled end creeps less far.

    vemcvx run problems/kelvin_voigt_creep.py --n 8 --steps 40 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, TAU, PULL = 10.0, 0.25, 0.7, 0.3
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 5, "steps": 40}


def creep_fraction(instants):
    """Return the factors s_n at the instants of a run."""
    s = np.zeros(len(instants))
    for n, k in enumerate(np.diff(instants), start=1):
        s[n] = (1 + TAU / k * s[n - 1]) / (1 + TAU / k)
    return s


def course(t):
    """Return the pull at the instant t, divided by the largest pull: always 1."""
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
    """Draw the strip at the last instant, and the creep of its end with and without friction beside the closed form."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.stressed_body(history, ax=body, stress="xx", forces="friction", stretch=2.0, units=UNITS)
    end, elastic = history.mesh.points[:, 0] == 4.0, PULL * (1 - POISSON**2) / YOUNG * 4.0
    free = vx.simulate(scene(bound=0.0), history.mesh, history.times)
    t = np.linspace(0, history.times[-1], 300)
    graph.plot(history.times, creep_fraction(history.times), "k-", label="closed form, step by step")
    graph.plot(t, 1 - np.exp(-t / TAU), "--", color="0.5", label="in continuous time")
    for run, style, words in ((free, "C0o", "without friction"), (history, "C1s-", "friction below")):
        graph.plot(run.times, run.displacement[:, end, 0].mean(axis=1) / elastic, style, linewidth=1.0, label=words)
    graph.set(xlabel="t (s)", ylabel="displacement / elastic displacement")
    graph.grid()
    graph.legend()
    return figure
