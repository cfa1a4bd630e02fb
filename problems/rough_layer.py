r"""A block on a rough floor or on a rough cylinder: asperities act like springs, and soften the contact.

The top of a column of height H, in plane stress, is pressed down by D. A rough layer lies below the column at the
distance `gap`. The pressure p of the layer is c times its compression (Martins and Oden 1987). The stress is uniaxial,
and exact on every mesh. The pressure is zero until D reaches the gap. Then column and layer act like springs in series,

$$ p = (D - \text{gap}) / (H / E + 1 / c), \qquad \text{compression of the layer } = p / c. $$

A layer with a large c acts like a rigid floor. With `radius=R` and the mesh `punch_mesh`, the block of
`hertz_contact.py` is pressed on a rough cylinder. The layer spreads Hertz' pressure and lowers its peak, and the
pressure rises gradually at the edge of the contact (Johnson, *Contact Mechanics*, 13.5).

    vemcvx run problems/rough_layer.py --n 6 --steps 10 --plot
"""

import numpy as np

import vemcvx as vx

WIDTH, HEIGHT, YOUNG, POISSON, LAYER, GAP, DEPTH = 1.0, 2.0, 100.0, 0.3, 50.0, 0.01, 0.05
RADIUS, HALF_WIDTH, PUNCH_YOUNG, PUNCH_DEPTH = 1.0, 0.02, 1000.0, 9e-4
"""Values for the block on a cylinder. `HALF_WIDTH` is the approximate half-width a of the contact."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 6, "steps": 10, "accuracy": 1e-6}


def pressure(depth, layer=LAYER, gap=GAP):
    return np.maximum(depth - gap, 0.0) / (HEIGHT / YOUNG + 1 / layer)


def scene(layer=LAYER, radius=None):
    def push(x, t):
        return np.full(len(x), -DEPTH * t)

    if radius is not None:
        return cylinder_scene(layer, radius)
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON, plane="stress"),
        vx.Symmetry(on="left"),
        vx.PrescribedDisplacement(push, on="top", direction="normal"),
        vx.NormalCompliance(layer, on="bottom", gap=GAP),
    )


def cylinder_scene(layer=None, radius=RADIUS):
    """Return the scene of a block pressed on a cylinder, with or without a rough layer."""

    def gap(x, t):
        return x[:, 0] ** 2 / (2 * radius)

    def push(x, t):
        return np.tile([0.0, -PUNCH_DEPTH * t], (len(x), 1))

    smooth = vx.UnilateralContact(on="bottom", gap=gap)
    return vx.Scene(
        vx.Elasticity(young=PUNCH_YOUNG, poisson=POISSON),
        vx.Symmetry(on="left"),
        vx.PrescribedDisplacement(push, on="top"),
        smooth if layer is None else vx.NormalCompliance(layer, on="bottom", gap=gap),
    )


def mesh(n, family="hexagons"):
    return vx.meshes.FAMILIES[family](n, box=((0, WIDTH), (0, HEIGHT)))


def punch_mesh(n):
    """Return rectangles over 0 <= x, y <= 20 `HALF_WIDTH`; their sides are HALF_WIDTH / n near 0, then they grow."""
    line, step = list(np.arange(0.0, 1.6 * HALF_WIDTH, HALF_WIDTH / n)), HALF_WIDTH / n
    while line[-1] < 20 * HALF_WIDTH:
        step *= 1.15
        line.append(line[-1] + step)
    line = np.array([*line[:-1], 20 * HALF_WIDTH])
    lattice = vx.meshes.squares(len(line) - 1, box=((0, len(line) - 1), (0, len(line) - 1)))
    return vx.PolygonMesh(line[lattice.points.round().astype(int)], lattice.cells)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the pressure under the column, and on a cylinder, for layers of different stiffness."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    line = np.linspace(0, DEPTH, 200)
    left.plot(line, pressure(line), "k-", label="springs in series")
    left.plot(DEPTH * history.times, history.contact.pressure.mean(axis=1), "C0o", label=f"c = {LAYER:g} MPa/mm")
    left.plot(line, pressure(line, LAYER / 5), ":", color="0.4", label=f"c = {LAYER / 5:g} MPa/mm")
    left.plot(line, pressure(line, 1e12), "--", color="0.4", label="rigid floor")
    left.set(xlabel="displacement of the top (mm)", ylabel="pressure (MPa)")
    left.set_title("a column pressed down on a layer", fontsize="small")
    mesh = punch_mesh(10)
    for layer, style, words in ((1e6, "C0o-", "$10^6$"), (5e4, "C1s-", "$5·10^4$"), (1e4, "C2D-", "$10^4$")):
        contact = vx.simulate(cylinder_scene(layer), mesh, times(2)).contact
        right.plot(contact.points[:, 0], contact.pressure[-1], style, linewidth=1.0, label=f"c = {words} MPa/mm")
    P = 2 * vx.simulate(cylinder_scene(), mesh, times(2)).force("bottom")[-1, 1]
    a = np.sqrt(4 * P * RADIUS * (1 - POISSON**2) / (np.pi * PUNCH_YOUNG))
    x = np.linspace(0, a, 400)
    right.plot(x, 2 * P / (np.pi * a) * np.sqrt(1 - (x / a) ** 2), "k-", label="Hertz: no layer")
    right.set(xlabel="distance from the middle (mm)", xlim=(0, 0.045), ylim=(0, None), xticks=np.arange(0, 0.05, 0.01))
    right.set_title("a block pressed on a rough cylinder, by the same depth", fontsize="small")
    for graph in (left, right):
        graph.grid()
        graph.legend()
    return figure
