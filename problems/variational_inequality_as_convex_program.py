"""A variational inequality as a convex program: the first lesson.

One slider by hand, four nodes in ten lines of cvxpy, the dual and what a cone's multiplier means, the same answer from
two solvers of this package, and the gap that certifies all of them. Equation numbers are those of Feng, Han and Huang.
Run it as a script, or cell by cell; each cell prints what it claims beside what it should be.
"""

# %% [markdown]
# # 1. One slider, by hand
#
# A block on a rough table hangs on a spring of stiffness $K$ and is pulled by a force $f(t)$. Its position is
# $u$, and friction can hold or resist it with a force of at most $g$. Slow motion means that forces balance at
# every instant:
#
# $$K u(t) + r(t) = f(t), \qquad |r| \le g, \qquad r = g\,\mathrm{sign}(u') \text{ wherever } u' \ne 0.$$
#
# The three conditions on $r$ say that $r$ is a *subgradient* of $v \mapsto g|v|$ at $u'$: $g|v| \ge g|u'| + r
# (v - u')$ for all $v$. Replace $r$ by $f - Ku$, and friction has left the equation and become an inequality,
#
# $$K u\,(v - u') + g|v| - g|u'| \;\ge\; f\,(v - u') \qquad \text{for all } v,$$
#
# which is (2.3) of the paper with $a(u, v) = Kuv$ and $j(v) = g|v|$.
#
# **One step of backward Euler.** Put $u' \approx (u - u_{prev})/k$. Because $j$ is a seminorm the step length
# $k$ cancels: with $v$ for $u_{prev} + k v$, (2.34) becomes $K u (v - u) + g|v - u_{prev}| - g|u - u_{prev}|
# \ge f (v - u)$. That is the optimality condition of
#
# $$\min_u \; \tfrac12 K u^2 - f u + g\,|u - u_{prev}|.$$
#
# The sum of a parabola and a kink. Either the minimum is at the kink (the slider sticks), or the derivative
# vanishes on one side of it: $u = (f - g)/K$ to the right, $u = (f + g)/K$ to the left. Together: clip the old
# position.

# %%
import cvxpy as cp
import numpy as np

import vemcvx as vx

K, g = 2.0, 1.0


def step_by_hand(u_prev, f):
    """Stay while (f - g)/K <= u_prev <= (f + g)/K, else move to the nearer end."""
    return float(np.clip(u_prev, (f - g) / K, (f + g) / K))


def walk(loads):
    u = [0.0]
    for f in loads[1:]:
        u.append(step_by_hand(u[-1], f))
    return np.array(u)


# %% [markdown]
# Pull to $F$, then to $-F$, then to $F$ again. The path is a *hysteresis loop*: after each reversal the slider
# waits until the load has changed by $2g$. Between the reversals it travels $2(F - g)/K$, always against
# friction $g$, so a closed loop loses $g \cdot 2 \cdot 2(F - g)/K$.

# %%
F = 3.0
loads = np.concatenate([np.linspace(0, F, 31), np.linspace(F, -F, 61)[1:], np.linspace(-F, F, 61)[1:]])
path = walk(loads)
lost = g * np.abs(np.diff(path[30:])).sum()
closed_form = 4 * g * (F - g) / K
print(f"energy lost in the loop: {lost:.12f}, by the formula {closed_form:.12f}")

# %% [markdown]
# # 2. Four nodes, ten lines
#
# Now four blocks in a row, joined by springs; the last is tied to a wall, the first is pulled. Each block $i$
# has its own friction bound $w_i$. The step is
#
# $$\min_u \; \tfrac12 u^T K u - f^T u + \sum_i w_i\, |u_i - u_{prev,i}|.$$
#
# In a conic program each absolute value becomes a variable $t_i$ and one cone, $|u_i - u_{prev,i}| \le t_i$. On
# the line the cone is an angle; on a plane, where $u_i$ has two components, it is the ice-cream cone, and
# nothing else changes.

# %%
chain = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
w = np.array([0.5, 0.5, 0.5, 0.5])
f = np.array([1.2, 0.0, 0.0, 0.0])
u_prev = np.zeros(4)

u, t = cp.Variable(4), cp.Variable(4)
cones = [cp.SOC(t[i], cp.reshape(u[i] - u_prev[i], (1,), order="F")) for i in range(4)]
energy = 0.5 * cp.quad_form(u, chain) - f @ u + w @ t
problem = cp.Problem(cp.Minimize(energy), cones)
problem.solve(solver="CLARABEL")
print("positions", np.round(u.value, 6) + 0.0, "(two blocks move, two stick)")

# %% [markdown]
# Check by hand: blocks 1 and 2 slide forward, so friction takes .5 from each. Forces on the first block: $1.2 -
# .5$ must be what the first spring carries, .7; on the second: $.7 - .5 = .2$ is left for the second spring.
# The third block holds .2 with its own friction and does not move. So $u_3 = u_4 = 0$, $u_2 = .2$, $u_1 = .2 +
# .7 = .9$.

# %%
by_hand = np.array([0.9, 0.2, 0.0, 0.0])
print("by hand  ", by_hand)

# %% [markdown]
# # 3. The dual, and what a multiplier means
#
# Write $w_i|s_i| = \max_{|\lambda_i| \le w_i} \lambda_i s_i$ with $s = u - u_{prev}$ and exchange min and max:
#
# $$\max_{|\lambda_i| \le w_i} \min_u \; \tfrac12 u^TKu - f^Tu + \lambda^T(u - u_{prev})
#   \;=\; \max_{|\lambda_i| \le w_i} -\tfrac12 (f - \lambda)^T K^{-1} (f - \lambda) - \lambda^T u_{prev}.$$
#
# The inner minimum is at $K u = f - \lambda$: **the multiplier is the force that friction takes**. It is
# admissible, $|\lambda_i| \le w_i$; where it stays below the bound the block sticks; where the block slides,
# $\lambda_i = w_i\,\mathrm{sign}(s_i)$. The force *on* the block is $-\lambda_i$, against the slip.
#
# A solver returns the dual of the cone $|s_i| \le t_i$ as a pair $(\tau_i, z_i)$ in the same cone. Its
# Lagrangian *subtracts* $\tau_i t_i + z_i s_i$, so stationarity in $t$ gives $\tau_i = w_i$, and in $u$ gives
# $z_i = -\lambda_i$: mind the minus.

# %%
lam = np.array([-cone.dual_value[1].item() for cone in cones])
print("friction takes    ", np.round(lam, 6) + 0.0, "bounds", w)
print("f - K u           ", np.round(f - chain @ u.value, 6) + 0.0, "(the same: forces balance)")

# %% [markdown]
# # 4. The same from the package
#
# `vx.march` takes any such problem: a matrix, a load as a function of time, and the norm terms. Newton is a
# hand-written semismooth Newton method, Clarabel an interior-point method behind cvxpy: about as different as
# two solvers can be.

# %%
system = vx.System(chain, lambda t: t * f, vx.Norms(np.eye(4), w))
newton = vx.march(system, [0.0, 1.0], solver=vx.Newton())
clarabel = vx.march(system, [0.0, 1.0], solver=vx.Clarabel())
difference = newton.state[-1] - clarabel.state[-1]
apart = np.sqrt(difference @ chain @ difference)
claimed = np.sqrt(2 * newton.gap[-1]) + np.sqrt(2 * clarabel.gap[-1])
print("Newton            ", newton.state[-1])
print(f"distance of the two answers {apart:.1e}, their certificates allow {claimed:.1e}")

# %% [markdown]
# # 5. The gap
#
# How good is an answer $u$, with multipliers $\lambda$, whoever made it? Primal minus dual objective is
#
# $$\mathrm{gap} = \tfrac12 r^T K^{-1} r + \sum_i ( w_i |s_i| - \lambda_i s_i ), \qquad r = f - \lambda - K u,$$
#
# a sum of terms that are all $\ge 0$: forces that do not balance, and friction that does not fit the slip. And
#
# $$\tfrac12 |u - u^*|_K^2 \le \mathrm{gap}.$$
#
# *Proof.* The primal objective $P$ is a quadratic $\tfrac12 u^TKu$ plus something convex, so it grows at least
# like $\tfrac12 |u - u^*|_K^2$ away from its minimiser $u^*$. Hence $\tfrac12 |u - u^*|_K^2 \le P(u) - P(u^*)$;
# and no dual value exceeds $P(u^*)$, so the right side is at most $P(u) - D(\lambda)$, the gap. $\square$
#
# Nothing about the solver entered. Let us spoil the answer more and more, and look at both sides.

# %%


def gap(u, lam):
    s, r = u - u_prev, f - lam - chain @ u
    return 0.5 * r @ np.linalg.solve(chain, r) + float(np.sum(w * np.abs(s) - lam * s))


rng = np.random.default_rng(0)
exact_lam = f - chain @ by_hand
table = []
print("spoilt by   true error  certified")
for size in 10.0 ** -np.arange(0, 7, 2):
    spoilt = by_hand + size * rng.normal(size=4)
    guess = np.clip(exact_lam + size * rng.normal(size=4), -w, w)
    error = np.sqrt((spoilt - by_hand) @ chain @ (spoilt - by_hand))
    table.append((error, np.sqrt(2 * gap(spoilt, guess))))
    print(f"{size:9.0e}   {error:.2e}    {table[-1][1]:.2e}")

# %% [markdown]
# The certificate is never below the error. When the spoiling shrinks by 100 the error does too, but the
# certificate only by 10: a block that should stick and moves by $\varepsilon$ costs $w\varepsilon$, linear, not
# quadratic. That is why interior-point answers certify to about $10^{-6}$, and why an active-set method, which
# sets $s_i = 0$ outright, gets to rounding.
#
# # Exercises
#
# 1. Pull the chain by `f = (1.2, 0, 0, 0)`, then let go. Which blocks move back, and how far? (`march` with
#    times `[0, 1, 2]`; by hand first: nothing moves back unless a spring pulls a block by more than .5.)
# 2. Set `w = 0`. What is left of the program, of the dual, and of the gap? (One linear system.)
# 3. Give every block two components and pull sideways halfway through: `Norms(np.eye(8), w, block=2)`. Why can
#    OSQP no longer take part? (A disc is not a polygon.)
# 4. Show that the step map $u_{prev} \mapsto u$ never expands distances in $|\cdot|_K$. (Add the two
#    variational inequalities; this is why certificates of steps may be added up over time.)
# 5. Two loads differ by $\delta$. Bound the distance of the two answers. (Theorem 2.5: stability.)

# %% [markdown]
# # A picture
#
# The loop of section 1 and the certificates of section 5; `--picture FILE` draws them.

# %%


def main(file):
    from vemcvx.canvas import light_grid, new_figure
    from vemcvx.plots.palette import COMPUTED, SLIP, STICK

    figure = new_figure(9.4, 3.9)
    left, right = figure.subplots(1, 2)
    sticks = np.append(True, np.diff(path) == 0.0)
    left.fill(path[30:], loads[30:], color="0.93", label=f"lost in the loop: {lost:g}")
    left.plot(path, loads, color="0.6", linewidth=1.0)
    for chosen, colour, words in ((sticks, STICK, "sticks"), (~sticks, SLIP, "slips")):
        left.plot(path[chosen], loads[chosen], "o", color=colour, markersize=4, label=words)
    left.set(xlabel="position $u$ (length)", ylabel="load $f$ (force)", title="one slider on a spring")
    errors, certified = np.transpose(table)
    right.loglog(errors, certified, "o", color=COMPUTED, markersize=6, label="spoilt answers, certified")
    right.loglog(errors, errors, "-", color="black", linewidth=1.3, label="the true error")
    right.set(xlabel="true error (energy norm)", ylabel="certified error", title="no certificate below the error")
    for axes in (left, right):
        light_grid(axes)
        axes.legend(frameon=False, fontsize="small")
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    import argparse

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", metavar="FILE")
    if asked := parser.parse_known_args()[0].picture:
        main(asked)
