# %% [markdown]
"""# Lesson 1, one slider: a variational inequality by hand, as a convex program, and the dual of that"""

# %% [markdown]
# A block on a rough table hangs on a spring and is pulled by a force. This problem has one unknown and everything that
# makes frictional contact special: an inequality where you expect an equation, a convex program that says the same, and
# a second program, its dual, whose unknown is the force of friction.
#
# Equation numbers are those of Feng, Han and Huang, *A virtual element method for a quasistatic frictional contact
# problem*. Run the cells in turn; every cell asserts what it claims.

# %%
import numpy as np

from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, SLIP, STICK

# %% [markdown]
# ## 1. The inequality
#
# The block is at $u$, the spring has the stiffness $K$, the pull is $f(t)$, and friction holds or resists with a
# force $r$ of at most $g$. Motion is slow: there is no inertia, and forces balance at every instant,
#
# $$K u(t) + r(t) = f(t), \qquad |r| \le g, \qquad r = g\,\mathrm{sign}(\dot u) \text{ wherever } \dot u \ne 0.$$
#
# What is $r$ while the block rests? Anything between $-g$ and $g$: whatever the balance of forces asks for. So $r$ is
# no function of $u$ or $\dot u$, and the equation alone is of no use. But the two conditions on $r$ say one thing
# together: $r$ is a *subgradient* at $\dot u$ of the function $j(v) = g|v|$, the slope of a line that touches its
# graph at $\dot u$ from below,
#
# $$j(v) \ge j(\dot u) + r\,(v - \dot u) \qquad \text{for all } v.$$
#
# Put $r = f - Ku$, and friction is gone from the unknowns. What remains is (2.3), with $a(u, v) = Kuv$:
#
# $$K u\,(v - \dot u) + j(v) - j(\dot u) \;\ge\; f\,(v - \dot u) \qquad \text{for all } v.$$

# %% [markdown]
# ## 2. One step in time, and the program
#
# Backward Euler replaces $\dot u$ by $(u - u_{prev})/k$, where $u_{prev}$ is the position a time $k$ ago. With
# $u_{prev} + kv$ renamed to $v$ (lesson 4 says why $k$ then drops out), (2.34) reads
#
# $$K u\,(v - u) + g|v - u_{prev}| - g|u - u_{prev}| \;\ge\; f\,(v - u) \qquad \text{for all } v,$$
#
# and this is what holds at the minimum, and only there, of
#
# $$P(u) = \tfrac12 K u^2 - f u + g\,|u - u_{prev}|,$$
#
# a parabola plus a kink at the old position. *Why:* $P$ is convex, so $u$ is its minimum if and only if zero is a
# subgradient there, that is, if $f - Ku$ is a subgradient of $g|\cdot - u_{prev}|$ at $u$: the inequality.
#
# Where is the minimum? At the kink (the block sticks), or where the derivative vanishes on one side of it:
# $u = (f - g)/K$ to the right, $u = (f + g)/K$ to the left. In all three cases $u$ is the old position, clipped to the
# interval between these two.

# %%
K, g = 2.0, 1.0


def primal(u, u_prev, f):
    return 0.5 * K * u**2 - f * u + g * np.abs(u - u_prev)


def step_by_hand(u_prev, f):
    """Stay while (f - g)/K <= u_prev <= (f + g)/K, else move to the nearer end."""
    return float(np.clip(u_prev, (f - g) / K, (f + g) / K))


# %% [markdown]
# Is it the minimum? And does it solve the inequality? We try 8001 other positions $v$. Both sides of either comparison
# are sums of a few numbers below 100, each rounded to 1e-16 of its size, so differences below 1e-13 are rounding.

# %%
others = np.linspace(-4.0, 4.0, 8001)


def is_minimum(u, u_prev, f):
    return primal(u, u_prev, f) <= primal(others, u_prev, f).min() + 1e-13


def solves_the_inequality(u, u_prev, f):
    friction = g * np.abs(others - u_prev) - g * abs(u - u_prev)
    return bool((K * u * (others - u) + friction >= f * (others - u) - 1e-13).all())


cases = [(u_prev, f) for u_prev in (-1.0, 0.0, 0.7) for f in (-3.0, -0.4, 0.0, 1.9)]
assert all(is_minimum(step_by_hand(*case), *case) for case in cases)
assert all(solves_the_inequality(step_by_hand(*case), *case) for case in cases)
# The tests can fail: a step that is a hundredth off passes neither.
assert not any(is_minimum(step_by_hand(*case) + 0.01, *case) for case in cases)
assert not any(solves_the_inequality(step_by_hand(*case) + 0.01, *case) for case in cases)
print(f"{len(cases)} steps by hand are minima, and solve the inequality")

# %% [markdown]
# The picture: $P$ for three pulls from $u_{prev} = 0$. While $|f| \le g$ the kink holds the minimum fast. **Question:**
# which of the two one-sided slopes of $P$ at the kink decides when the block starts to move to the right, and what is
# its value?
#
# <details><summary>Answer</summary>
#
# The slope on the right, $P'(0^+) = g - f$. The block moves to the right as soon as it is negative, for $f > g$. (From
# any $u_{prev}$ it is $K u_{prev} - f + g$.) The slope on the left, $-f - g$, is negative for all $f > -g$ and says
# only that the block does not move to the left.
#
# </details>


# %% jupyter={"source_hidden": true}
def energies(pulls):
    figure = new_figure(6.4, 3.6)
    axes = figure.add_subplot()
    u = np.linspace(-0.8, 1.6, 400)
    for f, colour in zip(pulls, ("0.6", STICK, SLIP), strict=True):
        best = step_by_hand(0.0, f)
        axes.plot(u, primal(u, 0.0, f), color=colour, label=f"pull $f = {f:g}$: {'slips' if best else 'sticks'}")
        axes.plot(best, primal(best, 0.0, f), "o", color=colour)
    axes.set(xlabel="position $u$", ylabel="$P(u)$", ylim=(-1.1, 3.0), title="parabola and kink: the minimum is marked")
    light_grid(axes)
    axes.legend(frameon=False)
    return figure


energies((0.0, 0.8, 2.6))

# %% [markdown]
# ## 3. The dual
#
# The kink is a maximum of lines, $g|s| = \max_{|\lambda| \le g} \lambda s$. So the program asks for the minimum over
# $u$ of a maximum over $\lambda$; exchange the two (allowed: what stands inside is convex in $u$, linear in
# $\lambda$, and the set of the $\lambda$ is bounded):
#
# $$\min_u \max_{|\lambda| \le g} \; \tfrac12 K u^2 - fu + \lambda (u - u_{prev})
#   \;=\; \max_{|\lambda| \le g} \min_u \; \tfrac12 K u^2 - (f - \lambda) u - \lambda u_{prev}.$$
#
# The inner minimum is now smooth: $K u = f - \lambda$. **The multiplier is the force that friction takes**, the $r$
# of section 1. With this $u$ the inner minimum is a function of $\lambda$ alone,
#
# $$D(\lambda) = -\frac{(f - \lambda)^2}{2K} - \lambda u_{prev} \quad\text{to be maximised over}\quad |\lambda| \le g.$$
#
# Another clip: the top of the parabola $D$ is at $f - K u_{prev}$, the force that would hold the block where it is.
# If friction can give as much, it does, and the block sticks; if not, it gives what it can.


# %%
def dual(lam, u_prev, f):
    return -((f - lam) ** 2) / (2 * K) - lam * u_prev


def friction_by_hand(u_prev, f):
    return float(np.clip(f - K * u_prev, -g, g))


for _u_prev, _f in cases:
    _u, _lam = step_by_hand(_u_prev, _f), friction_by_hand(_u_prev, _f)
    assert abs(K * _u - (_f - _lam)) < 1e-14, "forces balance"
    assert abs(g * abs(_u - _u_prev) - _lam * (_u - _u_prev)) < 1e-14, "friction is g against the slip, or no slip"
    assert abs(primal(_u, _u_prev, _f) - dual(_lam, _u_prev, _f)) < 1e-13, "no gap"
print("in all cases: balance, complementarity, and the same value of both programs")

# %% [markdown]
# ## 4. Any guess of the force bounds the energy from below
#
# For *every* $u$ and every $|\lambda| \le g$ we have $D(\lambda) \le P(u)$, by the very order of the minimum and the
# maximum. The difference, the **gap**, is zero at the solution, and it bounds how far we are from it:
#
# $$\tfrac12 K (u - u^*)^2 \;\le\; P(u) - P(u^*) \;\le\; P(u) - D(\lambda).$$
#
# (First step: $P$ is $\tfrac12 Ku^2$ plus something convex, so it grows at least like a parabola away from its
# minimum $u^*$.) Nobody has to know $u^*$ to compute the right side. That is the idea of this package in one line:
# every answer comes with a $\lambda$, whoever computed it, and the gap certifies it. Lesson 6 makes more of it.

# %%
rng = np.random.default_rng(0)
tried = [(*cases[i % len(cases)], *rng.uniform((-2, -g), (2, g))) for i in range(300)]
for _u_prev, _f, _u, _lam in tried:
    _gap = primal(_u, _u_prev, _f) - dual(_lam, _u_prev, _f)
    assert 0.5 * K * (_u - step_by_hand(_u_prev, _f)) ** 2 <= _gap + 1e-13
print(f"{len(tried)} guesses of position and force: the gap bounds the error of each")

# %% [markdown]
# The picture shows both programs on one scale of energy, $P$ over positions on the left and $D$ over forces on the
# right. The lowest point of $P$ is as high as the highest point of $D$. **Question:** the block sticks in the upper row
# and slips in the lower; at which end of which graph do you see it?
#
# <details><summary>Answer</summary>
#
# At the right end of the lower graph of $D$. There the maximum is at $\lambda = g$, and $D$ still rises: friction would
# give more if it could, and the block slips. The slope of $D$ at that end, $(f - \lambda)/K - u_{prev} = (1.8 - 1)/2 =
# .4$, is the slip. In the upper graph the maximum is inside, where the slope is zero: no slip.
#
# </details>


# %% jupyter={"source_hidden": true}
def two_programs(pulls):
    figure = new_figure(7.6, 5.2)
    panels = figure.subplots(2, 2, sharey="row", sharex="col")
    u, lam = np.linspace(-0.6, 1.2, 300), np.linspace(-g, g, 300)
    for (left, right), f in zip(panels, pulls, strict=True):
        best, force = step_by_hand(0.0, f), friction_by_hand(0.0, f)
        left.plot(u, primal(u, 0.0, f), color=COMPUTED)
        right.plot(lam, dual(lam, 0.0, f), color=SLIP)
        left.plot(best, primal(best, 0.0, f), "o", color=COMPUTED, label=f"minimum at $u = {best:g}$")
        right.plot(force, dual(force, 0.0, f), "o", color=SLIP, label=rf"maximum at $\lambda = {force:g}$")
        left.set(ylabel=f"pull $f = {f:g}$")
        for axes in (left, right):
            axes.axhline(primal(best, 0.0, f), color="0.5", linewidth=0.8)
            light_grid(axes)
            axes.legend(frameon=False)
    panels[0, 0].set_title("$P(u)$: the energy of positions")
    panels[0, 1].set_title(r"$D(\lambda)$: forces of friction, $|\lambda| \leq g$")
    panels[1, 0].set_xlabel("position $u$")
    panels[1, 1].set_xlabel(r"force $\lambda$")
    return figure


two_programs((0.6, 1.8))

# %% [markdown]
# ## Exercises
#
# 1. For which pulls does a block at $u_{prev} = 0.7$ stay where it is? Check with `step_by_hand`.
# 2. Let $g = 0$. What is left of the inequality, of $P$, of $D$?
# 3. Write the gap as a sum of two terms that are each $\ge 0$: one that vanishes when forces balance, and one that
#    vanishes when friction fits the slip.
# 4. The table moves by $d$ during the step (a belt). What becomes of $P$, of the clip, of $D$?
# 5. Two blocks differ in their old positions only. Show that they never get farther from each other in a step with the
#    same pull.
#
# Solutions: `lesson_1_solutions.py`.
