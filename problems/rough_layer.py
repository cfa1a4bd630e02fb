r"""A block on a rough layer: asperities carry it like springs, and soften what a punch does to it.

A column of height H, plane stress, is pressed down by D on a rough layer `gap` below it whose pressure is c times its
depth (Martins and Oden 1987). Uniaxial stress is exact on every mesh: nothing happens up to the gap, then column and
layer yield in series,

$$ p = (D - \text{gap}) / (H / E + 1 / c), \qquad \text{the layer by } p / c; $$

c large is the rigid floor. With `radius=R` and the mesh `punch_mesh` it is the block of :mod:`hertz_contact` on a
rough cylinder: the layer spreads Hertz' pressure, lowers its peak and has no edge where the pressure rises steeply
(Johnson, *Contact Mechanics*, 13.5).

While the column moves freely it stores nothing, and 1e-8 of nothing is below round-off: ask for 1e-6.

    vemcvx run problems/rough_layer.py --n 6 --steps 10 --accuracy 1e-6 --plot
"""

import numpy as np

import hertz_contact as hertz
import vemcvx as vx
from problem_pictures import MM, beside_closed_form
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, SECOND, THIRD

WIDTH, HEIGHT, YOUNG, POISSON, LAYER, GAP, DEPTH = 1.0, 2.0, 100.0, 0.3, 50.0, 0.01, 0.05
UNITS = MM
SMALL = {"n": 6, "steps": 10, "accuracy": 1e-6}


def pressure(depth, layer=LAYER, gap=GAP):
    return np.maximum(depth - gap, 0.0) / (HEIGHT / YOUNG + 1 / layer)


def scene(layer=LAYER, radius=None):
    if radius is not None:
        return on_cylinder(layer, radius)

    def down(x, t):
        return np.full(len(x), -DEPTH * t)

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON, plane="stress"),
        vx.Symmetry(on="left"),
        vx.PrescribedDisplacement(down, on="top", direction="normal"),
        vx.NormalCompliance(layer, on="bottom", gap=GAP),
    )


def on_cylinder(layer, radius):
    """Hertz' problem with a layer for the rigid cylinder."""
    kept = [effect for effect in hertz.scene(radius) if not isinstance(effect, vx.UnilateralContact)]
    return vx.Scene(*kept, vx.NormalCompliance(layer, on="bottom", gap=lambda x, t: x[:, 0] ** 2 / (2 * radius)))


def mesh(n, family="hexagons"):
    return vx.meshes.FAMILIES[family](n, box=((0, WIDTH), (0, HEIGHT)))


punch_mesh = hertz.mesh


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The pressure under the column, beside layers of other stiffness; and a cylinder on a layer."""
    figure = new_figure(9.4, 3.9)
    left, right = figure.subplots(1, 2)
    depth, line = DEPTH * history.times, np.linspace(0, DEPTH, 200)
    found = history.contact.pressure.mean(axis=1)
    beside_closed_form(left, (depth, found), (line, pressure(line)), label=f"layer {LAYER:g}", exact_label="in series")
    for layer, style, words in ((LAYER / 5, ":", f"layer {LAYER / 5:g}"), (1e12, "--", "rigid floor")):
        left.plot(line, pressure(line, layer), style, color="0.4", linewidth=1.2, label=words)
    left.legend(frameon=False, fontsize="small")
    left.set(xlabel="top pressed down by (mm)", ylabel="pressure (MPa)")
    left.set_title("a column pressed down on a layer", fontsize="small")
    mesh = punch_mesh(10)
    kinds = (1e6, COMPUTED, "o", "$10^6$"), (5e4, SECOND, "s", "$5·10^4$"), (1e4, THIRD, "D", "$10^4$")
    for layer, colour, mark, words in kinds:
        under = vx.simulate(scene(layer, hertz.RADIUS), mesh, times(2))
        x, p = under.contact.points[:, 0], under.contact.pressure[-1]
        right.plot(x, p, f"{mark}-", markersize=3, linewidth=1, color=colour, label=f"layer {words}")
    P = 2 * vx.simulate(hertz.scene(), mesh, times(2)).force("bottom")[-1, 1]
    a = np.sqrt(4 * P * hertz.RADIUS * (1 - hertz.POISSON**2) / (np.pi * hertz.YOUNG))
    x = np.linspace(0, a, 400)
    right.plot(
        x, 2 * P / (np.pi * a) * np.sqrt(1 - (x / a) ** 2), color="black", linewidth=1.3, label="Hertz: no layer"
    )
    right.set(xlabel="distance from the middle (mm)", xlim=(0, 0.045), ylim=(0, None), xticks=np.arange(0, 0.05, 0.01))
    right.set_title("a block pressed as far on a rough cylinder", fontsize="small")
    right.legend(frameon=False, fontsize="small")
    light_grid(right)
    return figure
