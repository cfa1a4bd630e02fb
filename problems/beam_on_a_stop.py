r"""A cantilever bent by a force until its end meets a stop: from then on it is a propped beam.

The beam (0, L) x (0, H), plane stress, nu = 0, is clamped at x = 0, bears the force P t on its top at x = L/2, and
has a stop below its end at the distance `gap`. As Timoshenko's beam, I = H^3 / 12, G = E / 2, with 5/6 for the shear
of a rectangle,

$$
\text{end by } P: \qquad P (5 L^3 / (48 E I) + L / (2 k)), \qquad k = \tfrac56 G H, \\
\text{end by } R \text{ upwards}: \qquad R (L^3 / (3 E I) + L / k),
$$

so the stop is met when the first is the gap, and then R is what brings their difference back to it: 5/16 of what P
exceeds that load by, if shear is left out. A point force bears on a node: within about H of it, no beam.

    vemcvx run problems/beam_on_a_stop.py --n 8 --steps 12 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import SECOND

LENGTH, HEIGHT, YOUNG, FORCE, GAP = 10.0, 1.0, 1000.0, 1.0, 0.4
BENDING, SHEARING = YOUNG * HEIGHT**3 / 12, 5 / 6 * YOUNG / 2 * HEIGHT
UNITS = MM
SMALL = {"n": 16, "steps": 12}


def by_force():
    """Deflection of the end by P = 1 in the middle."""
    return 5 * LENGTH**3 / (48 * BENDING) + LENGTH / (2 * SHEARING)


def by_stop():
    """Deflection of the end by R = 1 at it."""
    return LENGTH**3 / (3 * BENDING) + LENGTH / SHEARING


def stop_force(force, gap=GAP):
    """R."""
    return np.maximum(force * by_force() - gap, 0.0) / by_stop()


def end_deflection(force, gap=GAP):
    """Downwards."""
    return force * by_force() - stop_force(force, gap) * by_stop()


def scene(gap=GAP):
    def press(x, t):
        return np.tile([0.0, -FORCE * t], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=0.0, plane="stress"),
        vx.Clamp(on="left"),
        vx.PointLoad(press, at=(LENGTH / 2, HEIGHT)),
        vx.UnilateralContact(on="stop", gap=gap),
    )


def mesh(n, family="squares"):
    """The stop is under the last tenth of a height."""
    made = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))
    last = made.points[made.boundaries["bottom"]].mean(axis=1)[:, 0].max()
    return made.with_boundary("stop", lambda p: (p[:, 1] < 1e-9) & (p[:, 0] > last - 1e-9))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The beam on its stop, and the force of the stop, and the deflection of the end, as the load grows."""
    figure, graph = body_and_graph(history, stress="xx")
    left, right = graph.get_subplotspec().subgridspec(1, 2).subplots()
    graph.remove()
    force, line = FORCE * history.times, np.linspace(0, FORCE, 200)
    end = (history.mesh.points == [LENGTH, 0.0]).all(axis=1)
    deflection = -history.displacement[:, end, 1].mean(axis=1)
    for ax, found, exact, what in (
        (left, history.force("stop")[:, 1], stop_force(line), "stop bears (N/mm)"),
        (right, deflection, end_deflection(line), "end sinks by (mm)"),
    ):
        beside_closed_form(ax, (force, found), (line, exact), exact_label="Timoshenko's beam")
        ax.set(xlabel="load in the middle (N/mm)", ylabel=what)
    right.axhline(GAP, color=SECOND, linewidth=1.0, linestyle="--", label="gap above the stop")
    right.legend(frameon=False, fontsize="small")
    return figure
