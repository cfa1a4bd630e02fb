# %% [markdown]
"""# Solutions to the exercises of lesson 4, the quasistatic problem"""

# %%
import numpy as np

import vemcvx as vx

K, g, F = 2.0, 1.0, 3.0
chain = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
norms = vx.Norms(np.eye(4), np.full(4, 0.5))


def walk(loads, u=0.0, bound=g):
    for f in loads:
        u = float(np.clip(u, (f - bound) / K, (f + bound) / K))
    return u


# %% [markdown]
# **1.** A slider that has been pulled to a largest load $F'$ is at $(F' - g)/K$, and at load 0 it may stay if that is
# below $g/K$. So the end is $\min((F' - g)/K,\, g/K)$ (and 0 for $F' < g$): a peak beyond $2g$ may be missed by a lot
# without a trace, a peak below costs the missed load over $K$. At worst the end is wrong by all of $g/K$, if steps
# see nothing of the peak, and no certificate of a step can know. (`vemcvx` has an indicator for it: see
# `missed_reversal.py` among the problems.)


# %%
def end(peak, seen):
    hit, missed = walk([0.0, peak, 0.0]), walk([0.0, seen, 0.0])
    return hit - missed


assert end(peak=3.0, seen=2.0) == 0.0
assert end(peak=1.8, seen=1.6) == (1.8 - g) / K - (1.6 - g) / K
assert end(peak=3.0, seen=0.5) == g / K

# %% [markdown]
# **2.** For one slider a growing load means $u_n = \max(u_{n-1}, (f_n - g)/K)$, and the last one wins. For the chain it
# holds as well: if one block goes forward it pulls the others forward (off the diagonal, no entry of $K$ is positive),
# so no block ever turns back, and the friction of the last step is that of the whole way. A stiffness matrix of
# elasticity has positive entries too; then a node may turn back while the load only grows, and steps count.


# %%
def pulled(times):
    system = vx.System(chain, lambda t: np.array([2.4, 0, 0, 0]) * t, norms)
    return vx.march(system, times, solver=vx.Newton()).state[-1]


one, hundred = pulled([0.0, 1.0]), pulled(np.linspace(0.0, 1.0, 101))
# A hundred increments, each rounded to 1e-16 of numbers of size one, and a condition number of 30.
assert np.abs(one - hundred).max() < 100 * 30 * 2.2e-16

# %% [markdown]
# **3.** $c\,\dot u$ becomes $c\,(u - u_{n-1})/k$: in the program a term $\tfrac{c}{2k}(u - u_{n-1})^2$. A square does
# not scale like a seminorm, and $k$ stays: slow films differ from fast ones. The account gets $c\,du^2/k$, what the
# damper takes, of order one in sum. One step minimises $\tfrac12 (K + c/k) u^2 - (f + c u_{n-1}/k) u + g|u - u_{n-1}|$:


# %%
def damped(loads, k, c=0.5):
    u, K_k = 0.0, K + c / k
    for f in loads:
        f_k = f + c * u / k
        u = float(np.clip(u, (f_k - g) / K_k, (f_k + g) / K_k))
    return u


ramp = np.linspace(0.0, F, 31)
ends = [damped(ramp, k) for k in (1e-3, 1e-1, 1e3)]
assert ends[0] < ends[1] < ends[2] <= walk(ramp)
# The slowest moves by .05 in 1000 s: the damper takes c * .05 / 1000 / K of the way.
assert walk(ramp) - ends[2] <= 0.5 * 0.05 / 1000 / K + 1e-15
print("the same loads, faster and slower:", np.round(ends, 4), "without a damper", walk(ramp))

# %% [markdown]
# **4.** The force of one of them follows $U$ until it reaches its bound: $p \leftarrow \mathrm{clip}(p + dU, \pm b)$.
# On first loading all start from zero, $P(U) = \sum_i \min(U, b_i)$, concave: the stiffness is the number of those that
# still stick. From the tip at $U = 2$, where all slip, each can change by twice its bound before it slips back:
# $P(2) - \sum_i \min(d, 2 b_i) = P(2) - 2 P(d/2)$ after going back by $d$. The branch is the first loading, magnified
# by two.

# %%
bounds = np.arange(1, 21) / 10


def forces(course):
    p, last, total = np.zeros(len(bounds)), 0.0, []
    for U in course:
        p, last = np.clip(p + U - last, -bounds, bounds), U
        total.append(p.sum())
    return np.array(total)


up, down = np.linspace(0.0, 2.0, 41), np.linspace(2.0, -2.0, 81)
branch = forces(np.concatenate([up, down]))[len(up) :]


def first_loading(U):
    return np.minimum(U[:, None], bounds).sum(axis=1)


# Sums of 20 numbers below 2, after up to 121 roundings each.
assert np.abs(branch - (first_loading(up)[-1] - 2 * first_loading((2.0 - down) / 2))).max() < 20 * 2 * 121 * 2.2e-16

# %% [markdown]
# **5.** It says that the start is in equilibrium, with what friction can give: $\ell(0) - a(u_0, \cdot)$ is a
# subgradient of $j$ at zero. Otherwise the state would have to jump at $t = 0$, and (2.3) knows of no jumps: its
# solutions are Lipschitz in time. `march` takes one step at the first instant, and refuses a start that moves.

# %%
try:
    vx.march(vx.System(chain, lambda t: np.array([2.4, 0, 0, 0]), norms), [0.0, 1.0])
    answer = "it started"
except vx.SceneError as _error:
    answer = str(_error)
assert "(2.1)" in answer
assert "It slips most at norm term 0, by 4.6" in answer
print(answer)
