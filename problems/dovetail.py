r"""The dovetail root of a blade in its slot, pulled more at one end than at the other.

The root is a trapezoid in a slot along z. The flanks of the root are inclined by the angle b to the pull. We compute
the half x > 0 of the root. The pull P(t) acts on the top of the whole blade, distributed like 1 + c z / l over
-l < z < l. Let N be the normal force on a flank, and T its friction force, which is directed towards the floor of the
slot while the root slides out. Forces balance exactly:

$$ N \sin b + T \cos b = P / 2, \qquad M_x = c l P / 6, $$

where M_x is the moment of the forces on the flank of the root about the x-axis.

Friction is at most mu N, with the coefficient of friction mu, so that N stays between two limits,

$$ P / (2 (\sin b + \mu \cos b)) \le N \le P / (2 (\sin b - \mu \cos b)). $$

If all nodes slip straight along the flank, N equals the lower limit while the root slides out, and the upper limit
while the root slides in. Between the limits the root sticks, and N hardly falls when the pull falls.

    vemcvx run problems/dovetail.py --n 3 --steps 16 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, FRICTION = 1000.0, 0.3, 0.15
LEAN = np.radians(30.0)
NECK, ROOT, BLADE, OUTER, HALF = 0.6, 1.0, 0.6, 2.4, 1.0
"""Half the width of the neck; heights of root and blade; half the width of the disc; half the length of the slot."""
PULL, SLANT = 4.0, 0.5
"""Largest P, and c."""
OUT, IN = (0.5 / (np.sin(LEAN) + sign * FRICTION * np.cos(LEAN)) for sign in (1.0, -1.0))
JOINT = "blade|disc"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 3, "steps": 16, "accuracy": 1e-6}


def load(t):
    """Return P(t), which rises, falls to a quarter, and rises again."""
    return PULL * np.interp(t, [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.25, 1.0])


def scene(friction=FRICTION, slant=SLANT):
    def pull(x, t):
        stress = 0.5 * load(t) / (2 * HALF * NECK) * (1 + slant * x[:, 2] / HALF)
        return np.column_stack([0 * stress, stress, 0 * stress])

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Symmetry(on="blade.left"),
        vx.Clamp(on=["disc.front", "disc.right"]),
        vx.Traction(pull, on="blade.back"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def flank(y):
    """Return half the width of root and neck at the height y."""
    return NECK + np.tan(LEAN) * np.maximum(-y, 0.0)


def solid(x, y, layers, is_inside):
    """Return hexahedra over the grid of lines x, y, on the left of the flank if `is_inside`, else on the right."""
    lattice = vx.meshes.squares((len(x) - 1, len(y) - 1), box=((0, len(x) - 1), (0, len(y) - 1)))
    i, j = lattice.points.round().astype(int).T
    side = flank(y[j])
    plane = np.column_stack([x[i] * side if is_inside else side + x[i] * (OUTER - side), y[j]])
    return vx.PolygonMesh(plane, lattice.cells, boundaries=lattice.boundaries).extruded(
        np.linspace(-HALF, HALF, layers + 1)
    )


def mesh(n, family="hexahedra"):
    """Return meshes of blade and disc that do not match; half the neck has n cells."""
    across, root = np.linspace(0.0, 1.0, n + 1), np.linspace(-ROOT, 0.0, 2 * n + 1)
    blade = solid(across, np.append(root, np.linspace(0.0, BLADE, n + 1)[1:]), 2 * n, True)
    disc = solid(np.linspace(0.0, 1.0, 2 * n + 1), np.linspace(-ROOT, 0.0, 2 * n + 2), 2 * n + 1, False)
    return vx.meshes.bodies({"blade": blade, "disc": disc})


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def nodal_forces(history):
    """Return the forces of the joint on the nodes of the blade at the stored instants, (S, m, 3)."""
    contact = history.contact
    friction = contact.traction * contact.friction_lengths[:, None]
    return friction - contact.pressure[:, :, None] * (contact.lengths[:, None] * contact.normals)


def normal_force(history):
    """Return N at the stored instants, (S,)."""
    return history.contact.pressure @ history.contact.lengths


def picture(history):
    """Draw the pulled root in its slot, and the normal force of the flank between its limits."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.deformed_body(history, ax=body, view=(-0.8, 0.9, 1.6), units=UNITS)
    pull, at = np.array([0.0, PULL]), 0.4 * PULL
    graph.plot(pull, np.outer(pull, (OUT, IN)), "--", color="0.5")
    graph.text(at, OUT * at, " slides out", fontsize="small", color="0.3", va="top", ha="left")
    graph.text(at, IN * at, "slides in ", fontsize="small", color="0.3", va="bottom", ha="right")
    graph.plot(load(history.times), normal_force(history), "C0o-", label="computed")
    graph.set(xlabel="pull $P$ (N)", ylabel="normal force $N$ (N)", xlim=(0, None), ylim=(0, 1.6 * OUT * PULL))
    graph.grid()
    graph.legend(loc="lower right")
    return figure
