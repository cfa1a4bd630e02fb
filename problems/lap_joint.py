r"""A lap joint: two strips, glued by a soft layer, are pulled apart.

Two strips of height t and length l, with Young's moduli E_1 (lower) and E_2 (upper), nu = 0 and G_i = E_i / 2, are
joined by glue of thickness t_g and shear modulus G_g. Strips and glue are three bodies whose meshes do not match. The
bodies are bonded by bilateral contact and by friction with so high a bound that nothing slips. The lower strip is held
at its left end, and the force F pulls the upper strip at its right end. The outer faces of the strips are on rollers,
because the theory neglects bending. Let q(x) be the shear stress of the glue, and C the shear compliance of the joint.
Volkersen (1938) took the strips as rigid in shear. Here the shear stress of a strip falls linearly from q at the glue
to zero at its outer face, so that each strip adds t / (3 G_i) to C (Tsai, Oplinger and Morton 1998):

$$
q'' = k^2 q, \qquad k^2 = (1 / (E_1 t) + 1 / (E_2 t)) / C, \qquad C = t_g / G_g + t / (3 G_1) + t / (3 G_2), \\
q(x) = F / (C k \sinh k l) (\cosh(k x) / (E_2 t) + \cosh(k (l - x)) / (E_1 t)), \qquad \text{integral of } q = F.
$$

In shear the glue is a hundred times more flexible than both strips together. The glue therefore acts as a shear spring,
except within about t of its free ends.

    vemcvx run problems/lap_joint.py --n 4 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, GLUE, THICKNESS, FORCE = 40.0, 1.0, (20000.0, 10000.0), 10.0, 0.1, 1.0
JOINTS = ["lower|glue", "glue|upper"]
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 1}


def shear(x):
    """Return q(x), the friction traction between strips and glue."""
    flexibilities = [1 / (young * HEIGHT) for young in YOUNG]
    compliance = THICKNESS / GLUE + sum(2 * HEIGHT / (3 * young) for young in YOUNG)
    k = np.sqrt(sum(flexibilities) / compliance)
    ends = np.cosh(k * x) * flexibilities[1] + np.cosh(k * (LENGTH - x)) * flexibilities[0]
    return FORCE * ends / (compliance * k * np.sinh(k * LENGTH))


def scene():
    return vx.Scene(
        vx.Elasticity(YOUNG[0], 0.0, on="lower"),
        vx.Elasticity(2 * GLUE, 0.0, on="glue"),
        vx.Elasticity(YOUNG[1], 0.0, on="upper"),
        vx.PrescribedDisplacement(0.0, on="lower.left", direction=(1.0, 0.0)),
        vx.Symmetry(on=["lower.bottom", "upper.top"]),
        vx.Traction(lambda x, t: np.tile([FORCE * t / HEIGHT, 0.0], (len(x), 1)), on="upper.right"),
        vx.BilateralContact(on=JOINTS),
        vx.TrescaFriction(100 * FORCE, on=JOINTS),
    )


def mesh(n, family="squares"):
    """Return strips, n and n + 1 cells high, and one layer of glue with 3n/2 cells per unit length."""
    make, top = vx.meshes.FAMILIES[family], HEIGHT + THICKNESS
    lower = make(n, box=((0, LENGTH), (0, HEIGHT)))
    glue = vx.meshes.squares((round(1.5 * n * LENGTH), 1), box=((0, LENGTH), (HEIGHT, top)))
    upper = make(n + 1, box=((0, LENGTH), (top, top + HEIGHT)))
    return vx.meshes.bodies({"lower": lower, "glue": glue, "upper": upper})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def bond(history):
    """Return places x and tractions of the last step along the lower face of the glue, from left to right."""
    contact = history.contact
    below = np.abs(contact.points[:, 1] - HEIGHT) < 1e-9
    x, traction = contact.points[below, 0], contact.traction[-1][below, 0]
    order = np.argsort(x)
    return x[order], traction[order]


def picture(history):
    """Draw the joint near its pulled end, and the shear stress along the glue."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    window = ((LENGTH - 8, LENGTH + 0.5), (-0.3, 2.4))
    vx.plots.stressed_body(history, ax=body, stress="xx", forces="none", window=window, units=UNITS)
    line, (x, traction) = np.linspace(0, LENGTH, 200), bond(history)
    graph.plot(line, shear(line), "k-", label="Tsai, Oplinger, Morton 1998")
    graph.plot(x[::8], traction[::8], "C0o", label="computed")
    graph.set(xlabel="$x_1$ (mm)", ylabel="shear stress of the glue (MPa)", ylim=(0, None))
    graph.grid()
    graph.legend()
    return figure
