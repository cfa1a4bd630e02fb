r"""Shakedown: the largest amplitude of a cycle at which slip stops after some cycles.

A block (0, L) x (0, H) with the shear modulus G lies on a rough floor, from which it cannot lift. The friction bound
grows along the floor from g_0 to g_1. While the block sticks, it is sheared uniformly. `vx.shakedown` computes, without
steps, the largest factor of the amplitude for which slip stops. For three kinds of cycle this factor has a closed form.

*The top moves* between 0 and U. Friction per length then runs through a range of the width G U / H. Earlier slip may
add constant friction forces, which shift this range. The range must fit between -g_0 and g_0, the bounds of the weakest
point. The factor is

$$ 2 g_0 H / (G U) . $$

*The top moves in space* along a circle of the radius R, and the bound is g. Friction runs through a circle of the
radius G R / H, which must fit into the disc of the radius g. The factor is g H / (G R).

*The top is free*, under a shear traction between 0 and T. Friction alone holds the block, so the sum of the added
forces is zero. The factor is the smaller of 2 g_0 / T and the limit load factor (g_0 + g_1) / (2 T).

By Melan's theorem, the added forces give a lower bound of the factor. By Koiter's theorem, a cycle of slips gives an
upper bound. The run goes through 100 cycles with 1.02 times the factor: the work of friction in a cycle approaches a
positive limit. With .98 times the factor slip stops after some cycles.

    vemcvx run problems/shakedown.py --n 4 --steps 200 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG = 2.0, 1.0, 2000.0
G = YOUNG / 2
"""The shear modulus for nu = 0."""
WEAK, STRONG = 1.0, 3.0
"""The friction bounds g_0 and g_1 at both ends of the floor."""
MOVE, RADIUS, SHEAR = 0.004, 0.003, 1.6
"""The motion U of the top, the radius R of its circle, and the shear traction T on a free top."""
CYCLE = [0.0, 0.5, 1.0]
"""Instants of a cycle; the motion is largest at .5."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 200}


def there_and_back(t):
    """Return the fraction of the motion: 0 at t = 0, 1, 2, and 1 at t = .5, 1.5."""
    return 1.0 - abs(2.0 * (t % 1.0) - 1.0)


def bound(x, t):
    """Return the friction bound at points x."""
    return WEAK + (STRONG - WEAK) * x[:, 0] / LENGTH


def shear_factor():
    """Return the factor for the top that moves between 0 and U."""
    return 2 * WEAK * HEIGHT / (G * MOVE)


def circle_factor():
    """Return the factor for the top that moves along a circle in space, for the uniform bound g_0."""
    return WEAK * HEIGHT / (G * RADIUS)


def free_factor():
    """Return the factor for the free top under the shear traction."""
    return min(2 * WEAK, (WEAK + STRONG) / 2) / SHEAR


def floor(friction=bound):
    return vx.BilateralContact(on="bottom"), vx.TrescaFriction(friction, on="bottom")


def sides():
    return vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0))


def scene(factor=None):
    """Return the scene in which the top moves by U times a factor; by default 1.02 times the closed form."""
    amplitude = (1.02 * shear_factor() if factor is None else factor) * MOVE

    def move(x, t):
        return np.tile([amplitude * there_and_back(t), 0.0], (len(x), 1))

    return vx.Scene(vx.Elasticity(YOUNG, 0.0), vx.PrescribedDisplacement(move, on="top"), sides(), *floor())


def free_scene(factor=1.0):
    """Return the scene of the free top under the shear traction times a factor."""
    shear = vx.Traction(lambda x, t: np.tile([factor * SHEAR * there_and_back(t), 0.0], (len(x), 1)), on="top")
    return vx.Scene(vx.Elasticity(YOUNG, 0.0), shear, sides(), *floor())


def circle_scene(factor=1.0):
    """Return the scene in space whose top moves once around a circle in the time 1."""

    def move(x, t):
        turned = 2 * np.pi * t
        return np.tile([factor * RADIUS * (np.cos(turned) - 1), factor * RADIUS * np.sin(turned), 0.0], (len(x), 1))

    upright = vx.PrescribedDisplacement(0.0, on=["left", "right", "front", "back"], direction=(0.0, 0.0, 1.0))
    return vx.Scene(vx.Elasticity(YOUNG, 0.0), vx.PrescribedDisplacement(move, on="top"), upright, *floor(WEAK))


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def space_mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n, box=((0.0, LENGTH), (0.0, LENGTH), (0.0, HEIGHT)))


def times(steps):
    """Return the instants; a cycle has two steps."""
    return 0.5 * np.arange(steps + 1)


def measure_friction_work(history):
    """Return the work of friction in each cycle."""
    return np.diff(history.trajectory.dissipated[::2])


def picture(history):
    """Draw the range of friction in a cycle, within the bounds, and the work of friction in each cycle."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    ranges, graph = figure.subplots(1, 2)
    found = vx.shakedown(scene(1.0), history.mesh, CYCLE)
    x, lengths = found.points[:, 0], found.bounds / bound(found.points, 0.0)
    friction = (found.residual + found.factor * found.elastic)[:, :, 0] / lengths
    ends, slips = np.array([0.0, LENGTH]), np.abs(found.slips).sum(axis=(0, 2))
    limit = bound(np.column_stack([ends, ends]), 0.0)
    ranges.plot(ends, limit, "k-", ends, -limit, "k-")
    ranges.vlines(x, friction.min(axis=0), friction.max(axis=0), "C0", label="range in the cycle (Melan)")
    worst = slips > 1e-3 * slips.max()
    ranges.plot(x[worst], 0 * x[worst], "C1o", label="slips in the cycle of Koiter")
    ranges.set(xlabel="$x_1$ (mm)", ylabel="friction (MPa)", title=f"factor {found.factor:.6f}", ylim=(-3.2, 4.6))
    for factor, style in ((0.98, "C0o"), (1.02, "C1s")):
        run = vx.simulate(scene(factor * shear_factor()), history.mesh, history.times, store="last")
        work = np.maximum(measure_friction_work(run), 1e-16)
        graph.semilogy(1 + np.arange(len(work)), work, style, label=f"{factor} of the factor")
    graph.set(xlabel="cycle", ylabel="work of friction in the cycle (N)", ylim=(1e-17, 1e-2))
    graph.set_title("below 1e-14: rounding", fontsize="small")
    for ax in (ranges, graph):
        ax.grid()
        ax.legend(loc="upper left")
    return figure
