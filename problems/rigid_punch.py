r"""A rigid punch that tilts under an eccentric force: its pressure has a closed form.

A flat rigid punch of half width a is pressed without friction on an elastic half-plane in plane strain. The force P
acts at the distance e to the right of the punch's middle. The punch sinks and rotates until the pressure balances the
force (Sadowsky 1928):

$$
p(x) = P (1 + 2 e x / a^2) / (\pi \sqrt{a^2-x^2}), \qquad e \le a / 2,
\qquad \text{rotation } = 4 (1 - \nu^2) P e / (\pi E a^2) \text{ clockwise}.
$$

If e > a / 2, the punch lifts off on one side. Here the force acts in the middle until t = 1/4, and then moves to
e = a / 2. In place of the half-plane we compute a block of width 16a and depth 8a, clamped below. The block is stiffer
than the half-plane by a fraction O(a / depth). The pressure is infinite at the edges, so errors of nodal forces are
O(h / a).

    vemcvx run problems/rigid_punch.py --n 6 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

HALF, FORCE, YOUNG, POISSON = 1.0, 100.0, 20e3, 0.3
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 6, "steps": 8}


def offset(t):
    """Return the distance e of the force from the middle at the instant t."""
    return HALF / 2 * np.interp(t, [0.25, 1.0], [0.0, 1.0])


def pressure(x, t):
    return FORCE * (1 + 2 * offset(t) * x / HALF**2) / (np.pi * np.sqrt(HALF**2 - x**2))


def turn(t):
    """Return the anticlockwise rotation of the punch at the instant t."""
    return -4 * (1 - POISSON**2) * FORCE * offset(t) / (np.pi * YOUNG * HALF**2)


def scene():
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Clamp(on="ground.bottom"),
        vx.UnilateralContact(on="ground|punch"),
        vx.Rigid(
            on="punch",
            at=(0.0, 0.0),
            force=(0.0, -FORCE),
            moment=lambda x, t: -FORCE * offset(t),
            motion=(0.0, None, None),
        ),
    )


initial = "settled"


def mesh(n, family="squares"):
    """Return the ground with n cells per half width of the punch, and the punch with 2n cells."""
    make = vx.meshes.FAMILIES[family]
    ground = make((16 * n, 8 * n), box=((-8 * HALF, 8 * HALF), (-8 * HALF, 0.0)))
    return vx.meshes.bodies({"ground": ground, "punch": vx.meshes.squares((2 * n, 1), box=((-HALF, HALF), (0, HALF)))})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def tilt(history):
    """Return the computed rotation of the punch, (S,)."""
    top = np.unique(history.mesh.boundaries["punch.top"])
    x = history.mesh.points[top, 0]
    return np.polyfit(x, history.displacement[:, top, 1].T, 1)[0]


def picture(history):
    """Draw the tilted punch, and the pressure below it at the start and at the end."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    window = ((-3 * HALF, 3 * HALF), (-3 * HALF, HALF))
    vx.plots.stressed_body(history, ax=body, window=window, stress="yy", forces="contact", units=UNITS)
    x, contact = HALF * np.sin(np.linspace(-1.45, 1.45, 200)), history.contact
    for step, style, marks in ((0, "C1--", "C1s"), (-1, "C0-", "C0o")):
        t = history.times[step]
        graph.plot(x, pressure(x, t), style, label=f"closed form, e = {offset(t):g} mm")
        graph.plot(contact.points[:, 0], contact.pressure[step], marks, label="computed")
    graph.set(xlabel="x (mm)", ylabel="pressure (MPa)", ylim=(0.0, 4.4 * FORCE / (np.pi * HALF)))
    graph.grid()
    graph.legend()
    return figure
