r"""A bolt is tightened, locked, pulled until its joint opens, and released: the joint diagram.

A bolt of the stiffness k_b clamps a sleeve of the stiffness k_c between a base and a cap, all of steel. A tension F_V
tightens the bolt, which is then locked at the length that it has; then a force F pulls at the cap. While cap and sleeve
touch, both give way by the same, so that the bolt bears a part of the pull only, and beyond that all of it:

$$
\text{bolt}: \qquad F_V + F k_b / (k_b + k_c) \qquad \text{as long as} \qquad F \lt F_V (1 + k_b / k_c),
\qquad \text{then } F,
$$

and the sleeve is pressed by the rest. When the pull is gone the bolt has F_V again. Stresses are uniaxial (nu = 0), so
that the answer is exact on every mesh. The cap is rigid. The bolt is cut across its cells, by `vx.meshes.cut`.

    vemcvx run problems/joint_diagram.py --n 2 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

YOUNG, LENGTH, BOLT, SLEEVE, GAP = 210e3, 60.0, 10.0, 15.0, 2.0
TENSION = 3000.0
STIFF, CLAMPED = YOUNG * BOLT / LENGTH, 2 * YOUNG * SLEEVE / LENGTH
OPENS = TENSION * (1 + STIFF / CLAMPED)
UNITS = MM
SMALL = {"n": 2, "steps": 16}


def tension(x, t):
    return TENSION * t


def pull(t):
    """Force on the cap: nothing while the bolt is tightened, then beyond what opens the joint, and back."""
    return OPENS * np.interp(t, [1.0, 3.0, 4.0], [0.0, 1.5, 0.0])


def bolt_force(t):
    """The tension of the bolt."""
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
    """Bolt and sleeve, which is on both sides of it, in n cells across; the cap is one cell."""
    make, edge = vx.meshes.FAMILIES[family], BOLT / 2 + GAP
    bolt = make((n, 4 * n), box=((-BOLT / 2, BOLT / 2), (0.0, LENGTH)))
    shank, head = vx.meshes.cut(bolt, point=(0.0, 0.45 * LENGTH), normal=(0.0, 1.0))
    left, right = (
        make((n, 4 * n), box=(tuple(sorted((side * edge, side * (edge + SLEEVE)))), (0.0, LENGTH))) for side in (-1, 1)
    )
    cap = vx.meshes.squares(1, box=((-edge - SLEEVE, edge + SLEEVE), (LENGTH, LENGTH + 10.0)))
    return vx.meshes.bodies({"shank": shank, "head": head, "left": left, "right": right, "cap": cap})


def times(steps):
    """Four steps for the bolt to be tightened, and for what comes after in proportion."""
    return np.arange(steps + 1) / 4


def picture(history):
    """The joint at its largest pull, and what the bolt and the sleeve bear of the pull."""
    figure, graph = body_and_graph(history, step=8, stress="yy", forces="contact")
    t, dense = history.times, np.linspace(1.0, 3.0, 200)
    bolt, sleeve = (
        history.force("shank|head")[:, 1],
        -sum(history.force(f"{side}|cap")[:, 1] for side in ("left", "right")),
    )
    kilo = 1e-3
    for found, exact, colour, name in (
        (bolt, bolt_force(dense), "C0", "bolt"),
        (sleeve, bolt_force(dense) - pull(dense), "C1", "sleeve"),
    ):
        marks, line = (kilo * pull(t[4:]), kilo * found[4:]), (kilo * pull(dense), kilo * exact)
        beside_closed_form(graph, marks, line, colour=colour, label=name, exact_label=None)
    graph.axvline(kilo * OPENS, color="0.6", linestyle=":", linewidth=1.2)
    graph.legend(frameon=False, fontsize="small", loc="upper left")
    graph.set(xlabel="pull (kN/mm)", ylabel="tension of the bolt, pressure on the sleeve (kN/mm)")
    return figure
