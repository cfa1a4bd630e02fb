r"""A bolt is tightened, locked, pulled until its joint opens, and released: the joint diagram.

A steel bolt of the stiffness k_b clamps a steel sleeve of the stiffness k_c between a base and a rigid cap. A tension
F_V tightens the bolt, which is then locked at its current length. Then a force F pulls at the cap. While cap and sleeve
touch, bolt and sleeve deform by the same displacement, so that the bolt carries only a part of the pull. Once the joint
is open, the bolt carries all of the pull:

$$
\text{bolt}: \qquad F_V + F k_b / (k_b + k_c) \qquad \text{as long as} \qquad F \lt F_V (1 + k_b / k_c),
\qquad \text{then } F.
$$

The compressive force on the sleeve is the tension of the bolt minus F. When the pull has vanished, the tension of the
bolt is F_V again. Stresses are uniaxial (nu = 0), so that the result is exact on every mesh.

    vemcvx run problems/joint_diagram.py --n 2 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, LENGTH, BOLT, SLEEVE, GAP = 210e3, 60.0, 10.0, 15.0, 2.0
TENSION = 3000.0
STIFF, CLAMPED = YOUNG * BOLT / LENGTH, 2 * YOUNG * SLEEVE / LENGTH
"""The stiffnesses k_b and k_c."""
OPENS = TENSION * (1 + STIFF / CLAMPED)
"""The pull at which the joint opens."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 2, "steps": 16}


def tension(x, t):
    """Return the tension that tightens the bolt, for t <= 1."""
    return TENSION * t


def pull(t):
    """Return the pull on the cap: zero for t <= 1, rising to 1.5 `OPENS` at t = 3, and back to zero at t = 4."""
    return OPENS * np.interp(t, [1.0, 3.0, 4.0], [0.0, 1.5, 0.0])


def bolt_force(t):
    """Return the tension of the bolt."""
    clamped = TENSION * np.minimum(t, 1.0) + pull(t) * STIFF / (STIFF + CLAMPED)
    return np.maximum(clamped, pull(t))


def scene():
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=0.0, plane="stress"),
        vx.Clamp(on=["shank.bottom", "left.bottom", "right.bottom"]),
        vx.BilateralContact(on="head|cap"),
        vx.UnilateralContact(on=["left|cap", "right|cap"]),
        vx.Rigid(on="cap", force=lambda x, t: (0.0, pull(t)), motion=(0.0, None, 0.0)),
        vx.Pretension(on="shank|head", force=tension, until=1.0),
    )


def mesh(n, family="squares"):
    """Return bolt, sleeve and cap. The bolt and both halves of the sleeve are n cells wide; the cap is one cell."""
    make, edge = vx.meshes.FAMILIES[family], BOLT / 2 + GAP
    shank, head = (
        make((n, 2 * n), box=((-BOLT / 2, BOLT / 2), ends)) for ends in ((0.0, LENGTH / 2), (LENGTH / 2, LENGTH))
    )
    left, right = (
        make((n, 4 * n), box=(tuple(sorted((side * edge, side * (edge + SLEEVE)))), (0.0, LENGTH))) for side in (-1, 1)
    )
    cap = vx.meshes.squares(1, box=((-edge - SLEEVE, edge + SLEEVE), (LENGTH, LENGTH + 10.0)))
    return vx.meshes.bodies({"shank": shank, "head": head, "left": left, "right": right, "cap": cap})


def times(steps):
    """Return instants with four steps per unit of time; the bolt is tightened in the first unit."""
    return np.arange(steps + 1) / 4


def picture(history):
    """Draw the joint at t = 2, before it opens, and the forces of bolt and sleeve against the pull."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.stressed_body(history, step=8, ax=body, stress="yy", forces="contact", units=UNITS)
    later, line, kilo = history.times >= 1.0, np.linspace(1.0, 3.0, 200), 1e-3
    t = history.times[later]
    bolt = history.force("shank|head")[later, 1]
    sleeve = -sum(history.force(f"{side}|cap")[later, 1] for side in ("left", "right"))
    graph.plot(kilo * pull(line), kilo * bolt_force(line), "k-", label="closed form")
    graph.plot(kilo * pull(t), kilo * bolt, "C0o", label="tension of the bolt")
    graph.plot(kilo * pull(line), kilo * (bolt_force(line) - pull(line)), "k-")
    graph.plot(kilo * pull(t), kilo * sleeve, "C1s", label="force on the sleeve")
    graph.axvline(kilo * OPENS, color="0.6", linestyle=":", label="the joint opens")
    graph.set(xlabel="pull (kN/mm)", ylabel="force (kN/mm)")
    graph.grid()
    graph.legend(loc="upper left")
    return figure
