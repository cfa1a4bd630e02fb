r"""Backward Euler compared with the midpoint rule, on the slip of one block.

Let a be the elastic form, |.|_a its energy norm, and j the friction functional. Friction can balance the elastic forces
of a displacement z if z is in the set C = {z : a(z, v) <= j(v) for all v}. Let N_C be the normal cone of C, and P_C the
projection on C, both in the energy norm. Let u be the displacement of the body, u_l(t) its displacement under the load
l without friction, and z = u_l - u. The problem and its steps of backward Euler, equation (2.34) of Feng, Han and
Huang, are

$$ u' \in N_C(z) \qquad \text{and} \qquad z_n = P_C(z_{n-1} + u_{l,n} - u_{l,n-1}). $$

Each step of backward Euler is one convex program. The midpoint rule requires the variational inequality at the mean
$m = (u_{n-1} + u_n) / 2$ of a step, with the load at the middle of the step. Let d = u_n - u_{n-1} and
e = m - u_{n-1} = d / 2, so that j(d) = 2 j(e). The midpoint rule then is

$$
\min_d \; a(d, d) / 4 + a(u_{n-1}, d) - l(d) + j(d) \\
\qquad = 2 \min_e \; a(e, e) / 2 + a(u_{n-1}, e) - l(e) + j(e).
$$

So a step of the midpoint rule is one convex program, too: backward Euler to the middle, and then a reflection,

$$ m = \text{ backward Euler from } u_{n-1} \text{ to } t_{n-1/2}, \qquad u_n = 2 m - u_{n-1}. $$

The midpoint rule maps z by 2 P_C - 1. This map is nonexpansive, like P_C, so errors of the solver do not grow. The
midpoint rule has three defects:

1. In the middle of a step z is in C, but at the end z may be outside of C. Then friction exceeds its bound at the
   beginning of the next step.
2. Oscillations do not decay. P_C is firmly nonexpansive, but a reflection may keep all distances. Suppose that a place
   begins to slip inside a step of length k. At the end of this step z is beyond its bound by some eta <= k |u_l'| / 2,
   at the end of the next step z is below its bound by eta, and so on forever. From then on the order is 1.
3. The midpoint rule has the order 2 only where slip is smooth: where slip changes its direction, but neither begins nor
   ends.

Backward Euler has the order 1 where slip turns gradually. Suppose that slip keeps its direction, and neither stops nor
reverses inside a step. Then backward Euler is *exact* at the ends of steps, because the slip of the whole step obeys
the law of friction at the end of the step. The slip of a plane body does not turn: it only stops or reverses. The loads
should therefore reverse at instants of the run (:func:`vemcvx.instants`). The dissipation `dissipated_second_order`
then has an error of second order in the step.

    python problems/midpoint_rule.py [--picture FILE]

The experiments use the block of `circular_hysteresis.py`: u is the place of its sole, and u_l the place of its top. The
radius of the disc C is the unit of length. In the first experiment, the top is pulled straight there and back. In the
second, the slip turns, and the sole starts at its exact place. In the third, the top is pulled from rest and turns
afterwards. In the first and in the third, slip begins inside a step.
"""

from __future__ import annotations

import argparse
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, SECOND

R = 2.0
STEPS = (16, 32, 64, 128, 256)
FINE = 4096
"""Number of intervals of the extrapolated reference in the pull from rest."""
BEHIND = (-1 / 3, 0.0)
"""Initial place of the sole in the pull from rest: slip begins at t = 1/3, which is no instant of the run."""


def project(z):
    """Return P_C z, where C is the unit disc."""
    return z / max(1.0, np.linalg.norm(z))


def backward_euler(top, times, start):
    """Return the places of the sole (N + 1, 2) at the instants."""
    sole = [np.asarray(start, dtype=float)]
    for t in times[1:]:
        sole.append(top(t) - project(top(t) - sole[-1]))
    return np.array(sole)


def midpoint(top, times, start):
    """Return the places of the sole (N + 1, 2) at the instants, and (N, 2) in the middles of steps."""
    sole, middles = [np.asarray(start, dtype=float)], []
    for s, t in pairwise(times):
        U = top(0.5 * (s + t))
        middles.append(U - project(U - sole[-1]))
        sole.append(2.0 * middles[-1] - sole[-1])
    return np.array(sole), np.array(middles)


def there_and_back(t):
    """Return the place of the top in a straight pull to 3 and back to -3, which reverses at t = 1."""
    return np.array([3.0 * t if t <= 1 else 9.0 - 6.0 * t, 0.0])


def straight(t):
    """Return the place of the sole under `there_and_back`, from rest: the play operator of half width 1."""
    x = there_and_back(t)[0]
    return np.array([max(x - 1.0, 0.0) if t <= 1 else min(2.0, x + 1.0), 0.0])


def around(t):
    """Return the place of the top on a circle of radius R, one turn per unit of time."""
    return R * np.array([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)])


def turning(t):
    """Return the place of the sole under `around`: a point of a circle to which z = u_l - u is tangent."""
    rho = np.sqrt(R**2 - 1.0)
    angle = 2 * np.pi * t - np.arccos(rho / R)
    return rho * np.array([np.cos(angle), np.sin(angle)])


def from_rest(t):
    """Return the place of the top: straight to the circle for t < 1, then around the circle."""
    return np.array([R * t, 0.0]) if t < 1 else around(t - 1)


def largest_distance(found, exact):
    """Return the largest distance over all instants."""
    return float(np.linalg.norm(found - exact, axis=1).max())


@cache
def extrapolate():
    """Return the places of the sole under `from_rest` at FINE + 1 instants, extrapolated from two runs."""
    one, two = (backward_euler(from_rest, np.linspace(0, 2, m * FINE + 1), BEHIND)[::m] for m in (2, 4))
    return 2 * two - one


def errors(steps):
    """Return the largest errors of both rules in each experiment; in the straight pull also in the middles of steps."""
    # The reversal at t = 1 is an instant. The last experiment has no closed form: we extrapolate backward Euler.
    pull, turn, rest = np.linspace(0, 2, steps + 1), np.linspace(0, 1, steps + 1), np.linspace(0, 2, 2 * steps + 1)
    middles = 0.5 * (pull[1:] + pull[:-1])
    exact = [
        np.array([straight(t) for t in pull]),
        np.array([turning(t) for t in turn]),
        extrapolate()[:: FINE // (2 * steps)],
    ]
    found = {}
    for name, top, times, truth in zip(
        ("straight", "turning", "from rest"),
        (there_and_back, around, from_rest),
        (pull, turn, rest),
        exact,
        strict=True,
    ):
        ends, inside = midpoint(top, times, truth[0])
        found[name] = largest_distance(backward_euler(top, times, truth[0]), truth), largest_distance(ends, truth)
        if name == "straight":
            found["straight, in the middles"] = (
                np.nan,
                largest_distance(inside, np.array([straight(t) for t in middles])),
            )
    return found


def table(steps=STEPS):
    """Return the errors of both rules in each experiment, (2, len(steps))."""
    every = [errors(n) for n in steps]
    return {name: np.array([one[name] for one in every]).T for name in every[0]}


TITLES = {
    "straight": "a straight pull there and back",
    "turning": "a slip that turns",
    "from rest": "a pull from rest that turns",
}


def picture(found, steps=STEPS):
    """Draw errors against numbers of steps, with lines of the orders one and two."""
    figure = new_figure(10.5, 3.8)
    axes = figure.subplots(1, len(TITLES), sharey=True)
    k = 1 / np.array(steps)
    for ax, (name, title) in zip(axes, TITLES.items(), strict=True):
        for label, colour, mark, values in zip(
            ("backward Euler", "midpoint rule"), (COMPUTED, SECOND), "os", found[name], strict=True
        ):
            exact = bool((values < 1e-13).all())
            if exact:
                ax.text(0.97, 0.05, f"{label}: exact", color=colour, ha="right", transform=ax.transAxes)
            else:
                ax.plot(k, values, mark, color=colour, label=label)
        ax.plot(k, 2 * k, color="0.6", linewidth=0.8, label="order 1")
        ax.plot(k, 2 * k**2, color="0.6", linewidth=0.8, linestyle="--", label="order 2")
        ax.set(xscale="log", yscale="log", title=title, xlabel="1 / steps")
        ax.set_xticks(k, [f"1/{n}" for n in steps])
        ax.minorticks_off()
        light_grid(ax)
    axes[0].set_ylabel("largest error / radius of the disc")
    axes[1].legend(frameon=False, fontsize="small")
    return figure


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="where to draw the errors (PNG)")
    given, found = parser.parse_args(arguments), table()
    for name, both in found.items():
        rules = dict(zip(("backward Euler", "midpoint rule"), both, strict=True))
        exact = [rule for rule, values in rules.items() if (values < 1e-13).all()]
        shown = {rule: values for rule, values in rules.items() if (values > 1e-13).all()}
        print(f"{name}{''.join(f'; {rule} is exact' for rule in exact)}\n")
        print(f"{vx.measures.convergence_table(1 / np.array(STEPS), shown, 'k')}\n")
    if given.picture is not None:
        picture(found).savefig(given.picture, dpi=110)


if __name__ == "__main__":
    main()
