r"""Limit loads: the largest force that friction can bear before a body slides, tips or turns.

A body has a limit load if only friction and one-sided contact hold it. `vx.limit_load` computes this load without
steps, as a cone program, and gives a lower and an upper bound. Three bodies have closed forms. The coefficient of
friction is mu.

*A footing* of the width W bears the weight N and a horizontal force F at the height h. The footing slides or tips at

$$ F = \min(\mu N, \, N W / 2h) . $$

*A block* of the weight G lies on an incline of the angle a. A horizontal force F pushes the block uphill. The block
slides at

$$ F / G = (\tan a + \mu) / (1 - \mu \tan a) . $$

*A plate* on a rough plane, with the friction bound g, is pushed at one end, across its axis. The plate turns about a
point on this axis, at x = c. At node i the largest friction force is w_i, the integral of g times the basis function of
the node. In a rotation about any c, the work of friction divided by the work of a unit force at the end x = L / 2 is an
upper bound of the limit load. F is the least of these bounds:

$$ F = \min_c \frac{\sum_i w_i \sqrt{(x_i - c)^2 + y_i^2}}{L / 2 - c} . $$

This F is the exact limit load of the plate on its mesh. On fine meshes the sum approaches the integral over the plate,
and F approaches the limit load of the plate.

The run pushes the plate with .95 of this limit load. In the last step only the far end of the plate sticks.

    vemcvx run problems/limit_load.py --n 8 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

STEEL = vx.Elasticity(2e5, 0.3)
WIDTH, WEIGHT, FRICTION = 2.0, 3.0, 0.4
"""The width of the footing and of the block, their weight per unit of thickness, and the coefficient of friction."""
SLOPE = 0.1
"""The tangent of the angle of the incline."""
LENGTH, BREADTH, THICKNESS, BOUND = 4.0, 1.0, 0.5, 1.0
"""The sides of the plate, and its friction bound."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 8}


def footing_limit(height):
    """Return the force F at which the footing slides or tips."""
    return np.minimum(FRICTION * WEIGHT, WEIGHT * WIDTH / (2 * height))


def incline_limit():
    """Return the horizontal force, divided by the weight, at which the block slides uphill."""
    return (SLOPE + FRICTION) / (1 - FRICTION * SLOPE)


def turning(points, weights):
    """Return the limit F and the centre c, for friction forces w_i at points relative to the middle of the plate."""
    # Golden section: each of 70 rounds multiplies the interval by .618.
    low, high, golden = -0.5 * LENGTH, 0.0, 0.5 * (np.sqrt(5.0) - 1.0)

    def bound(c):
        return weights @ np.hypot(points[:, 0] - c, points[:, 1]) / (0.5 * LENGTH - c)

    for _ in range(70):
        left, right = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, right) if bound(left) < bound(right) else (left, high)
    return bound(low), low


def plate_limit(points=400):
    """Return the limit of the plate and the centre c, by the midpoint rule with `points` points along each side."""
    x = (np.arange(points) + 0.5) / points - 0.5
    grid = np.stack(np.meshgrid(LENGTH * x, BREADTH * x), axis=-1).reshape(-1, 2)
    return turning(grid, np.full(len(grid), BOUND * LENGTH * BREADTH / len(grid)))


def footing(n, height, family="voronoi"):
    """Return scene, mesh and load of the footing, with a force of 1 at `height`."""
    scene = vx.Scene(STEEL, vx.Pressure(WEIGHT / WIDTH, on="top"), *floor())
    # A traction that is linear in y, with the force 1 and the moment `height` about the floor.
    load = vx.Traction(lambda x, t: np.outer(4 - 6 * height + (12 * height - 6) * x[:, 1], [1.0, 0.0]), on="left")
    return scene, vx.meshes.FAMILIES[family](n, box=((0.0, WIDTH), (0.0, 1.0))), load


def incline(n, family="voronoi"):
    """Return scene, mesh and load of the block on the incline, pushed by the force 1."""
    c, s = np.array([1.0, SLOPE]) / np.hypot(1.0, SLOPE)
    flat = vx.meshes.FAMILIES[family](n, box=((0.0, WIDTH), (0.0, 1.0)))
    mesh = vx.PolygonMesh(flat.points @ [[c, s], [-s, c]], flat.cells, boundaries=flat.boundaries)
    scene = vx.Scene(STEEL, vx.BodyForce((0.0, -WEIGHT / WIDTH)), *floor())
    return scene, mesh, vx.BodyForce((1.0 / WIDTH, 0.0))


def floor():
    return vx.UnilateralContact(on="bottom"), vx.CoulombFriction(FRICTION, on="bottom")


def push(force=1.0):
    """Return the load of the plate: a transverse force at the right end, which grows with time."""
    return vx.Traction(lambda x, t: np.tile([0.0, force * t / (BREADTH * THICKNESS), 0.0], (len(x), 1)), on="right")


def scene(force=None):
    """Return the scene of the plate under this force; by default .95 of the limit."""
    load = push(0.95 * plate_limit()[0] if force is None else force)
    return vx.Scene(STEEL, vx.BilateralContact(on="bottom"), vx.TrescaFriction(BOUND, on="bottom"), load)


def mesh(n, family="cubes"):
    box = ((-LENGTH / 2, LENGTH / 2), (-BREADTH / 2, BREADTH / 2), (0.0, THICKNESS))
    cells = (2 * n, n, 1) if family == "cubes" else n
    return vx.meshes.SPACE_FAMILIES[family](cells, box=box)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def find_plate_limit(mesh):
    """Return the computed limit of the plate."""
    return vx.limit_load(scene(0.0).without(vx.Traction), mesh, push())


def picture(history):
    """Draw friction on the plate at its limit load, sticking nodes at .95 of this load, and limits of the footing."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.6), layout="constrained")
    plate, graph = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    contact, found = history.contact, find_plate_limit(history.mesh)
    x, sticks = contact.points[:, :2], contact.sticking[-1]
    centre = turning(x, BOUND * contact.friction_lengths)[1]
    arrows = {"angles": "xy", "color": "0.5", "width": 0.003, "label": f"friction at the limit, F = {found.factor:.4f}"}
    plate.quiver(*x.T, *found.friction[contact.nodes, :2].T, **arrows)
    plate.plot(*x[sticks].T, "C0o", label="sticks at .95 of the limit")
    plate.plot(*x[~sticks].T, "C1s", label="slips")
    plate.plot(centre, 0.0, "kx", markersize=9, markeredgewidth=2.0, label="centre of rotation, closed form")
    end = LENGTH / 2 + 0.15
    plate.annotate("$F$", (end, 0.5), (end, -0.5), ha="center", arrowprops={"arrowstyle": "->"})
    plate.set(xlabel="$x_1$ (mm)", ylabel="$x_2$ (mm)", aspect="equal", xlim=(-LENGTH / 2 - 0.2, LENGTH / 2 + 0.3))
    plate.legend(loc="upper center", bbox_to_anchor=(0.5, -0.35), ncols=2)
    heights, dense = np.linspace(0.2, 5.0, 13), np.linspace(0.2, 5.0, 400)
    limits = [vx.limit_load(*footing(3, height)).factor for height in heights]
    graph.plot(dense, footing_limit(dense) / WEIGHT, "k-", label="slides, then tips: closed form")
    graph.plot(heights, np.divide(limits, WEIGHT), "C0o", label="computed")
    graph.set(xlabel="height $h$ of the force (mm)", ylabel="limit of $F / N$", ylim=(0, 0.5))
    graph.grid()
    graph.legend(loc="lower left")
    return figure
