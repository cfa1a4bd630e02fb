r"""Why backward Euler: the midpoint rule beside it, on slips that are known in closed form.

Quasistatic friction is a play operator in the energy norm: with C = {z : a(z, v) <= j(v) for all v}, the displacements
whose forces friction can hold, u_l(t) the answer of the body without friction, and z = u_l - u,

$$ u' \in N_C(z), \qquad \text{backward Euler } (2.34): \qquad z_n = P_C(z_{n-1} + u_{l,n} - u_{l,n-1}), $$

P_C the projection on C in |.|_a, a convex program a step. The midpoint rule asks for the inequality at the mean m =
(u_{n-1} + u_n) / 2 of a step, with the load of its middle. With e = m - u_{n-1} = d / 2 and j(d) = 2 j(e),

$$
\min_d \; a(d, d) / 4 + a(u_{n-1}, d) - l(d) + j(d) \\
\qquad = 2 \min_e \; a(e, e) / 2 + a(u_{n-1}, e) - l(e) + j(e):
$$

it is a convex program a step, too, the same one as backward Euler's to the middle, and then a reflection,

$$ m = \text{ backward Euler from } u_{n-1} \text{ to } t_{n-1/2}, \qquad u_n = 2 m - u_{n-1}. $$

In z its map is 2 P_C - 1, which is nonexpansive as P_C is: errors of the algebra do not grow either. But

1. it ends outside. z_n is in C at the middles of steps alone; at the ends friction exceeds its bound, and (2.1) fails:
   what one step hands to the next is no state that friction can hold.
2. nothing dies out. P_C is firmly nonexpansive, |P x - P y|^2 <= |x - y|^2 - |(x - P x) - (y - P y)|^2; a reflection
   only keeps distances. Where a place begins to slip inside a step, z ends that step eta beyond its bound, at most k
   |u_l'| / 2, the next one eta below, and so on for ever: from then on the order is one.
3. of order two it is where slips are smooth: where they turn without beginning or ending.

Backward Euler is of order one where slips turn. In the plane they do not turn; there, and in space where they keep
their direction, it is *exact* at the instants, as long as they include those at which loads turn back
(:func:`vemcvx.instants`): the play of a monotone input does not depend on its steps. What is summed over steps, work
and dissipation, is of second order in either case (`dissipated_second_order`).

    python problems/midpoint_rule.py [--picture FILE]

The slider is the block of :mod:`circular_hysteresis`: u is the place of its sole, u_l that of its top, C the disc about
zero whose radius is the unit of length. The experiments: a straight pull there and back; a slip that turns, from the
exact state; and a pull from rest that turns afterwards. Slips begin inside of steps.
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
BEHIND = (-1 / 3, 0.0)
"""Where the sole rests at first, so that it begins to slip at t = 1/3, which is no instant, as in the straight pull."""


def held(z):
    """P_C z, C the unit disc."""
    return z / max(1.0, np.linalg.norm(z))


def backward_euler(top, times, start):
    """The sole (N + 1, 2) at the instants."""
    sole = [np.asarray(start, dtype=float)]
    for t in times[1:]:
        sole.append(top(t) - held(top(t) - sole[-1]))
    return np.array(sole)


def midpoint(top, times, start):
    """The sole (N + 1, 2) at the instants, and (N, 2) in the middles of steps."""
    sole, middles = [np.asarray(start, dtype=float)], []
    for s, t in pairwise(times):
        U = top(0.5 * (s + t))
        middles.append(U - held(U - sole[-1]))
        sole.append(2.0 * middles[-1] - sole[-1])
    return np.array(sole), np.array(middles)


def there_and_back(t):
    """A straight pull to 3 and back to -3, turning at t = 1."""
    return np.array([3.0 * t if t <= 1 else 9.0 - 6.0 * t, 0.0])


def straight(t):
    """The sole under that: from rest, a play of half width one."""
    x = there_and_back(t)[0]
    return np.array([max(x - 1.0, 0.0) if t <= 1 else min(2.0, x + 1.0), 0.0])


def around(t):
    """The top on a circle of radius R, one turn in the unit of time."""
    return R * np.array([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)])


def turning(t):
    """The sole that follows it on a circle of radius rho, a right angle behind: z = U - a is tangent to its way."""
    rho = np.sqrt(R**2 - 1.0)
    angle = 2 * np.pi * t - np.arccos(rho / R)
    return rho * np.array([np.cos(angle), np.sin(angle)])


def from_rest(t):
    """Straight to the circle while t < 1, then round it."""
    return np.array([R * t, 0.0]) if t < 1 else around(t - 1)


def far(found, exact):
    """The largest distance over all instants."""
    return float(np.linalg.norm(found - exact, axis=1).max())


@cache
def extrapolated():
    """The sole from rest at FINE + 1 instants, by two runs of backward Euler that are twice and four times as fine."""
    one, two = (backward_euler(from_rest, np.linspace(0, 2, m * FINE + 1), BEHIND)[::m] for m in (2, 4))
    return 2 * two - one


def errors(steps):
    """Largest errors of both rules, by experiment; of the midpoint rule also in the middles of the straight pull."""
    # The turn at t = 1 is an instant. The last experiment has no closed form: backward Euler, extrapolated.
    pull, turn, rest = np.linspace(0, 2, steps + 1), np.linspace(0, 1, steps + 1), np.linspace(0, 2, 2 * steps + 1)
    middles = 0.5 * (pull[1:] + pull[:-1])
    exact = [
        np.array([straight(t) for t in pull]),
        np.array([turning(t) for t in turn]),
        extrapolated()[:: FINE // (2 * steps)],
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
        found[name] = far(backward_euler(top, times, truth[0]), truth), far(ends, truth)
        if name == "straight":
            found["its middles"] = np.nan, far(inside, np.array([straight(t) for t in middles]))
    return found


def table(steps=STEPS):
    """By experiment the errors of both rules, (2, len(steps)), and what there is to see of them."""
    every = [errors(n) for n in steps]
    return {name: np.array([one[name] for one in every]).T for name in every[0]}


TITLES = {
    "straight": "a straight pull there and back",
    "turning": "a slip that turns",
    "from rest": "a pull from rest that turns",
}


def picture(found, steps=STEPS):
    """Errors over steps, with lines of the orders one and two."""
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
    parser.add_argument("--picture", type=Path, help="draw the errors there")
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
