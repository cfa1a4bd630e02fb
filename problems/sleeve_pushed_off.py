r"""A sleeve is shrunk on a tube and pushed off: Poisson's effect relieves the pressure.

Tube (a < r < b) and sleeve (b < r < c) are bodies of revolution of the length L: x_1 is the radius r, x_2 the axial
coordinate z, and all forces are integrals over the full turn. Until t = 1 the hot sleeve cools on the tube, without
friction, and the interference grows to delta: the gap is -delta t. Both bodies are then in plane stress. With Young's
moduli E_1 and E_2 and Poisson's ratios nu_1 and nu_2 of tube and sleeve, the pressure on the joint is (Lame, 1852;
Timoshenko and Goodier, *Theory of Elasticity*, article 28)

$$
p_0 = \frac{\delta}{b C}, \qquad C = \frac{1}{E_1} \Big( \frac{b^2 + a^2}{b^2 - a^2} - \nu_1 \Big)
+ \frac{1}{E_2} \Big( \frac{c^2 + b^2}{c^2 - b^2} + \nu_2 \Big).
$$

From t = 1 on the joint has the friction coefficient mu. The bottom of the tube is held, and the bottom of the sleeve is
pushed upwards until all of the joint slips. Above the height z, friction transfers the force F(z) from the sleeve to
the tube. At z this force compresses the sleeve and stretches the tube: the sleeve widens, and the tube becomes
narrower. With the cross-section areas A_1 and A_2 of tube and sleeve,

$$
p = p_0 - \kappa F, \qquad \kappa = \Big( \frac{\nu_1}{E_1 A_1} + \frac{\nu_2}{E_2 A_2} \Big) / C, \qquad
\frac{dF}{dz} = -2 \pi b \mu p, \quad F(L) = 0, \\
p(z) = p_0 e^{-(L - z) / l}, \qquad F(0) = \frac{p_0}{\kappa} (1 - e^{-L / l}), \qquad l = \frac{1}{2 \pi b \mu \kappa}.
$$

F(0) is the force that pushes the sleeve off. If the pressure stayed p_0 (kappa = 0), this force would be mu p_0 times
the area of the joint; here it is 11 % smaller. The formulas assume that axial stresses are uniform over each section.
With n = 4 the mean computed pressure at t = 1 is within .2 % of p_0, and the computed push-out force within .1 % of
F(0).

    vemcvx run problems/sleeve_pushed_off.py --n 4 --steps 13 --plot
"""

import numpy as np

import vemcvx as vx

RADII, LENGTH, YOUNG, POISSON = (10.0, 16.0, 24.0), 80.0, (200e3, 70e3), (0.3, 0.33)
INTERFERENCE, FRICTION, TRAVEL = 0.02, 0.2, 0.05
JOINT = "tube|sleeve"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 13}


def evaluate_closed_form(poisson=POISSON):
    """Return the pressure p_0, the push-out force F(0), and the length l (infinite without Poisson's effect)."""
    a, b, c = RADII
    inner = ((b**2 + a**2) / (b**2 - a**2) - poisson[0]) / YOUNG[0]
    outer = ((c**2 + b**2) / (c**2 - b**2) + poisson[1]) / YOUNG[1]
    areas = np.pi * (b**2 - a**2), np.pi * (c**2 - b**2)
    relief = sum(nu / (E * A) for nu, E, A in zip(poisson, YOUNG, areas, strict=True)) / (inner + outer)
    pressure, rate = INTERFERENCE / (b * (inner + outer)), 2 * np.pi * b * FRICTION * relief
    if rate == 0.0:
        return pressure, FRICTION * pressure * 2 * np.pi * b * LENGTH, np.inf
    return pressure, pressure / relief * (1 - np.exp(-LENGTH * rate)), 1 / rate


def scene(poisson=POISSON, travel=TRAVEL):
    def push(x, t):
        return np.full(len(x), travel * max(t - 1.0, 0.0))

    return vx.Scene(
        vx.Elasticity(YOUNG[0], poisson[0], plane="axisymmetric", on="tube"),
        vx.Elasticity(YOUNG[1], poisson[1], plane="axisymmetric", on="sleeve"),
        vx.PrescribedDisplacement(0.0, on="tube.bottom", direction=(0.0, 1.0)),
        vx.PrescribedDisplacement(push, on="sleeve.bottom", direction=(0.0, 1.0)),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: np.full(len(x), -INTERFERENCE * min(t, 1.0))),
        vx.CoulombFriction(lambda x, t: np.full(len(x), FRICTION if t > 1.0 else 0.0), on=JOINT),
    )


def mesh(n, family="squares"):
    """Return the mesh of tube and sleeve, with n cells across each wall and 6 n cells along the axis."""
    a, b, c = RADII
    make = vx.meshes.FAMILIES[family]
    walls = {"tube": (a, b), "sleeve": (b, c)}
    return vx.meshes.bodies({name: make((n, 6 * n), box=(wall, (0.0, LENGTH))) for name, wall in walls.items()})


def times(steps):
    """Return the instants of one step of cooling and of `steps` - 1 steps of pushing."""
    return np.append(0.0, np.linspace(1.0, 2.0, steps))


def push_force(history):
    """Return the force on the bottom of the sleeve at every step."""
    return history.reaction("sleeve.bottom")[:, 1]


def picture(history):
    """Draw the bodies, the push force, and the pressure before and after the push, beside closed forms."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 4.2), layout="constrained")
    body, push, graph = figure.subplots(1, 3, width_ratios=(1.1, 1, 1))
    vx.plots.stressed_body(history, history.steps, ax=body, stress="yy", mirrors=[(-1, 1)], magnify=50, units=UNITS)
    pressure, force, length = evaluate_closed_form()
    push.plot(1e3 * TRAVEL * np.maximum(history.times - 1, 0), push_force(history) / 1e3, "C0o-", label="computed")
    push.axhline(force / 1e3, color="C1", label="$F(0)$")
    push.axhline(evaluate_closed_form((0.0, 0.0))[1] / 1e3, color="0.5", ls="--", label=r"$\nu = 0$")
    push.set(xlabel=r"travel of the sleeve ($\mu$m)", ylabel="force per full turn (kN)")
    z, found = history.contact.points[:, 1], history.contact.pressure_recovered
    line = np.linspace(0.0, LENGTH, 101)
    graph.plot(np.full(101, pressure), line, "C0-", pressure * np.exp((line - LENGTH) / length), line, "C1-")
    graph.plot(found[1], z, "C0o", label="shrunk on")
    graph.plot(found[-1], z, "C1s", label="pushed off")
    graph.set(xlabel="pressure (MPa)", ylabel="$z$ (mm)")
    for each in (push, graph):
        each.grid()
        each.legend()
    return figure
