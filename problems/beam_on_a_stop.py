r"""A force bends a cantilever until the end of the beam meets a stop.

The beam (0, L) x (0, H) is in plane stress and clamped at x = 0, with Young's modulus E and nu = 0. The force P t acts
on its top at x = L/2, and a stop lies below its end at the distance `gap`. In Timoshenko's beam theory I = H^3 / 12,
G = E / 2, and the shear factor is 5/6. A force P in the middle, or a force R at the end, deflects the end by

$$
\text{under } P: \qquad P (5 L^3 / (48 E I) + L / (2 k)), \qquad k = \tfrac56 G H, \\
\text{under } R \text{ upwards}: \qquad R (L^3 / (3 E I) + L / k).
$$

The beam meets the stop when P t deflects its end by the gap. From then on the force R of the stop keeps the end at the
stop. Without shear deformation, R is 5/16 of the load that is added after first contact. Beam theory does not hold
within about H of the point force.

    vemcvx run problems/beam_on_a_stop.py --n 8 --steps 12 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, FORCE, GAP = 10.0, 1.0, 1000.0, 1.0, 0.4
BENDING, SHEARING = YOUNG * HEIGHT**3 / 12, 5 / 6 * YOUNG / 2 * HEIGHT
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 16, "steps": 12}


def deflection_by_force():
    """Return the deflection of the end under P = 1 in the middle."""
    return 5 * LENGTH**3 / (48 * BENDING) + LENGTH / (2 * SHEARING)


def deflection_by_stop():
    """Return the deflection of the end under R = 1 at the end."""
    return LENGTH**3 / (3 * BENDING) + LENGTH / SHEARING


def stop_force(force, gap=GAP):
    """Return R, the force of the stop."""
    return np.maximum(force * deflection_by_force() - gap, 0.0) / deflection_by_stop()


def end_deflection(force, gap=GAP):
    """Return the downward deflection of the end."""
    return force * deflection_by_force() - stop_force(force, gap) * deflection_by_stop()


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
    """Return a mesh; its boundary `stop` is the rightmost edge of the bottom."""
    made = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))
    last = made.points[made.boundaries["bottom"]].mean(axis=1)[:, 0].max()
    return made.with_boundary("stop", lambda p: (p[:, 1] < 1e-9) & (p[:, 0] > last - 1e-9))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the beam on its stop, and plot the force of the stop and the deflection of the end against the load."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    axes = figure.subplot_mosaic([["body", "body"], ["force", "deflection"]])
    vx.plots.stressed_body(history, ax=axes["body"], stress="xx", units=UNITS)
    load, line = FORCE * history.times, np.linspace(0, FORCE, 200)
    end = (history.mesh.points == [LENGTH, 0.0]).all(axis=1)
    axes["force"].plot(line, stop_force(line), "k-", label="Timoshenko's beam")
    axes["force"].plot(load, history.force("stop")[:, 1], "C0o", label="computed")
    axes["force"].set(ylabel="stop force (N/mm)")
    axes["deflection"].plot(line, end_deflection(line), "k-", label="Timoshenko's beam")
    axes["deflection"].plot(load, -history.displacement[:, end, 1].mean(axis=1), "C0o", label="computed")
    axes["deflection"].axhline(GAP, color="C1", linestyle="--", label="gap above the stop")
    axes["deflection"].set(ylabel="end deflection (mm)")
    for graph in (axes["force"], axes["deflection"]):
        graph.set(xlabel="load in the middle (N/mm)")
        graph.grid()
        graph.legend()
    return figure
