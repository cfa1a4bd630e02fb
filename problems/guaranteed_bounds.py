"""Error bars that are theorems: they close over meshes and steps, and the exact solution is between them.

The block of `manufactured_full_slip.py`, whose displacement is known in closed form, on rollers at its left and loaded
by the tractions of that solution on the other sides, by its body force, and by friction at its bound all along the
floor. All data grow with t^2: a step that knows them at its ends alone takes them for linear in between.

From a displacement and a stress that are admissible, `vx.error_bound` says what interval the elastic energy and the
mean displacement of the top are in, without a constant that anybody had to estimate, on every mesh (W. Prager and J. L.
Synge, *Approximations in elasticity based on the concept of function space*, Quart. Appl. Math. 5, 1947). The bars
shrink with h.

Over whole histories bounds are of mesh and steps at once. In proportion to one function of time steps lose nothing, and
the bound of this block is the same in one step as in sixteen. So the third picture is of another one, the block of
`missed_reversal.py`, whose load turns back between two steps: what the steps miss is in the bound, and with more steps
it comes down to what the mesh makes of it.

    vemcvx run problems/guaranteed_bounds.py --n 16 --steps 8 --bound --plot
"""

import numpy as np

import manufactured_full_slip as full_slip
import missed_reversal as turning
import vemcvx as vx
from problem_pictures import MM
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, EXACT, THIRD

POISSON = 0.3
LAMBDA = full_slip.lame(POISSON)
UNITS = MM
SMALL = {"n": 8, "steps": 4}
TOP = vx.Traction((1.0, 0.0), on="top")
"""The quantity: the mean of u_1 on the top, which is one unit long."""


def course(t):
    """The part of the data of that file that acts: a thousandth, so that strains are small."""
    return 1e-3 * t * t


def scene(course=course):
    def of(field):
        return lambda x, t: field(x[:, 0], x[:, 1], course(t), LAMBDA)

    def on_the_right(x, t):
        xx, yy, xy = np.moveaxis(full_slip.strain(x[:, 0], x[:, 1], course(t), LAMBDA), -1, 0)
        return np.column_stack([(LAMBDA + 2.0) * xx + LAMBDA * yy, xy])

    def on_the_left(x, t):
        shear = full_slip.strain(x[:, 0], x[:, 1], course(t), LAMBDA)[:, 2]
        return np.column_stack([0.0 * shear, -shear])

    def bound(x, t):
        return course(t) * x[:, 0] ** 2 * (LAMBDA + 2.0) / (6.0 * (LAMBDA + 1.0))

    return vx.Scene(
        vx.Elasticity(young=2.0 * (1.0 + POISSON), poisson=POISSON),
        vx.BodyForce(of(full_slip.body_force)),
        vx.Symmetry(on="left"),
        vx.Traction(on_the_left, on="left"),
        vx.Traction(of(full_slip.traction_on_top), on="top"),
        vx.Traction(on_the_right, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def exact():
    """Elastic energy, and the mean of u_1 on the top, at t = 1."""
    s, w = np.polynomial.legendre.leggauss(24)
    s, w = 0.5 + 0.5 * s, 0.5 * w
    x, y = (one.ravel() for one in np.meshgrid(s, s))
    xx, yy, xy = np.moveaxis(full_slip.strain(x, y, course(1.0), LAMBDA), -1, 0)
    density = 2.0 * (xx**2 + yy**2 + 0.5 * xy**2) + LAMBDA * (xx + yy) ** 2
    mean = w @ full_slip.displacement(s, 1.0 + 0.0 * s, course(1.0), LAMBDA)[:, 0]
    return 0.5 * float(np.outer(w, w).ravel() @ density), float(mean)


def closing(history, counts):
    """Of meshes with these cells across: intervals (k, 2) of the energy and of the mean."""
    energies, means = [], []
    for n in counts:
        run = vx.simulate(scene(), mesh(n), history.trajectory.times)
        energies.append(vx.error_bound(run, step=-1).energy)
        found = vx.error_bound(run, step=-1, of=TOP)
        means.append((found.low, found.high))
    return np.array(energies), np.array(means)


def over_steps(n, counts):
    """Bounds of whole histories whose load turns inside a step, at the end, in as many steps on n x n squares."""
    runs = [vx.simulate(turning.scene(), turning.mesh(n), turning.times(count)) for count in counts]
    return np.array([vx.error_bound(run).upper[-1] for run in runs])


def picture(history):
    """Bars of energy and of a mean displacement over meshes, and bounds of whole histories over steps."""
    counts, steps = (2, 3, 4, 6, 8), (3, 5, 9, 17, 33)
    energies, means = closing(history, counts)
    energy, mean = exact()
    figure = new_figure(10.6, 3.7)
    panels = figure.subplots(1, 3)
    for ax, value, intervals, y in (
        (panels[0], energy, energies, "elastic energy over its closed form"),
        (panels[1], mean, means, "mean displacement of the top, likewise"),
    ):
        ax.axhline(1.0, color=EXACT, linewidth=1.2, label="closed form")
        low, high = intervals.T / value
        style = {"fmt": "none", "ecolor": COMPUTED, "elinewidth": 1.8, "capsize": 4.0, "label": "a theorem"}
        ax.errorbar(counts, 0.5 * (low + high), yerr=0.5 * (high - low), **style)
        ax.set(xscale="log", xlabel="cells across", ylabel=y)
        ax.set_xticks(counts, map(str, counts))
    ax = panels[2]
    # In parts of the largest energy norm of a run that meets the turn.
    unit = 0.01 * vx.simulate(turning.scene(), turning.mesh(8), turning.times(8)).trajectory.norm.max()
    for n, colour, mark in ((8, COMPUTED, "o"), (16, THIRD, "s")):
        ax.plot(steps, over_steps(n, steps) / unit, f"{mark}-", color=colour, markersize=4, label=f"{n} x {n} squares")
    ax.set(xscale="log", xlabel="steps, a turn missed", ylabel="bound of mesh and steps, % in energy", ylim=(0.0, None))
    ax.set_xticks(steps, map(str, steps))
    for ax in panels:
        ax.minorticks_off()
        light_grid(ax)
        ax.legend(frameon=False, fontsize="small")
    return figure
