# %% [markdown]
"""# Solutions to the exercises of lesson 4, the quasistatic problem"""

# %%
import numpy as np

import vemcvx as vx

K, w, peak = 2.0, 1.0, 3.0
chain = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
norms = vx.Norms(np.eye(4), np.full(4, 0.5))


def walk(loads, u=0.0, bound=w):
    for f in loads:
        u = float(np.clip(u, (f - bound) / K, (f + bound) / K))
    return u


# %% [markdown]
# **1.** Let $K$ be the stiffness, $w$ the friction bound, and $f \ge w$ the peak of the load. At the peak the slider is
# at $(f - w)/K$. At load 0 the slider is still at this position if $(f - w)/K \le w/K$. So the end position is
# $\min((f - w)/K,\, w/K)$, and 0 for $f < w$. A computation uses only the loads at the ends of steps; let $\tilde f$ be
# the largest of these loads. The error is the difference of the end positions for $f$ and for $\tilde f$. It is
# $(f - \tilde f)/K$ if both loads lie between $w$ and $2w$. The largest error is $w/K$, for $f \ge 2w$ and
# $\tilde f \le w$. No certificate of a step can detect this error.


# %%
def error(peak, seen):
    return walk([0.0, peak, 0.0]) - walk([0.0, seen, 0.0])


assert error(peak=3.0, seen=2.0) == 0.0
assert error(peak=1.8, seen=1.6) == (1.8 - w) / K - (1.6 - w) / K
assert error(peak=3.0, seen=0.5) == w / K

# %% [markdown]
# **2.** For one slider a growing load means $u_n = \max(u_{n-1}, (f_n - w)/K)$, and the last load determines the end
# position. The same holds for the chain. If one block moves forward, it pulls the others forward, because no entry of
# $K$ off the diagonal is positive. So no block ever turns back. Every block that has moved ends with the friction
# $w_i$, whether there is one step or a hundred. A stiffness matrix of elasticity also has positive entries off the
# diagonal. So a node may turn back while the load grows, and the number of steps matters.


# %%
def pull_chain(times):
    system = vx.System(chain, lambda t: np.array([2.4, 0, 0, 0]) * t, norms)
    return vx.march(system, times, solver=vx.Newton()).state[-1]


one, hundred = pull_chain([0.0, 1.0]), pull_chain(np.linspace(0.0, 1.0, 101))
# Each of a hundred steps rounds positions of order 1 by about 2.2e-16, and the condition number of K is 30.
assert np.abs(one - hundred).max() < 100 * 30 * 2.2e-16

# %% [markdown]
# **3.** Let $c$ be the constant of the damper, and $k$ the time step. The force $c\,\dot u$ becomes $c\,s/k$ with
# $s = u - u_{n-1}$, and the program gets the term $\tfrac{c}{2k} s^2$. A square does not scale like a seminorm, so $k$
# stays in the program, and the speed of the load matters. The energy balance gets the term $c\,s^2/k$, the energy lost
# in the damper. The sum of this term over all steps does not tend to zero as $k$ tends to zero. One step minimises
# $\tfrac12 (K + c/k) u^2 - (f + c u_{n-1}/k) u + w|u - u_{n-1}|$:


# %%
def move_damped(loads, k, c=0.5):
    u, K_k = 0.0, K + c / k
    for f in loads:
        f_k = f + c * u / k
        u = float(np.clip(u, (f_k - w) / K_k, (f_k + w) / K_k))
    return u


ramp = np.linspace(0.0, peak, 31)
ends = [move_damped(ramp, k) for k in (1e-3, 1e-1, 1e3)]
assert ends[0] < ends[1] < ends[2] <= walk(ramp)
# In a step of the slowest load, the slider moves by 0.05 in 1000 s. The damper holds it back by c * 0.05 / 1000 / K.
assert walk(ramp) - ends[2] <= 0.5 * 0.05 / 1000 / K + 1e-15
print(f"end positions for fast, slower and slow loads: {np.round(ends, 4)}; without a damper: {walk(ramp)}")

# %% [markdown]
# **4.** The force $\lambda_i$ of a slider follows the displacement $U$ until the force reaches its bound:
# $\lambda_i \leftarrow \mathrm{clip}(\lambda_i + dU, \pm w_i)$. During the first loading all forces start from zero, so
# the total force is $R(U) = \sum_i \min(U, w_i)$. This function is concave, and its slope is the number of sliders that
# stick. At $U = 2$ all forces are at their bounds. While $U$ falls, each force can change by twice its bound before its
# slider slips again. When $U$ has fallen by $x$, the total force is $R(2) - \sum_i \min(x, 2 w_i) = R(2) - 2 R(x/2)$.
# This is the curve of the first loading, magnified by two.

# %%
bounds = np.arange(1, 21) / 10


def forces(course):
    lam, last, total = np.zeros(len(bounds)), 0.0, []
    for U in course:
        lam, last = np.clip(lam + U - last, -bounds, bounds), U
        total.append(lam.sum())
    return np.array(total)


up, down = np.linspace(0.0, 2.0, 41), np.linspace(2.0, -2.0, 81)
branch = forces(np.concatenate([up, down]))[len(up) :]


def first_loading(U):
    return np.minimum(U[:, None], bounds).sum(axis=1)


# The sums have 20 terms below 2, each rounded at most 121 times.
assert np.abs(branch - (first_loading(up)[-1] - 2 * first_loading((2.0 - down) / 2))).max() < 20 * 2 * 121 * 2.2e-16

# %% [markdown]
# **5.** Condition (2.1) of the paper says that the start is in equilibrium, with forces that friction can carry:
# $\ell(0) - a(u_0, \cdot)$ is a subgradient of $j$ at zero. Otherwise the state would jump at $t = 0$, but solutions of
# (2.3) are Lipschitz continuous in time. `march` takes one step at the first instant, and refuses a start that moves.

# %%
try:
    vx.march(vx.System(chain, lambda t: np.array([2.4, 0, 0, 0]), norms), [0.0, 1.0])
    answer = "it started"
except vx.SceneError as _error:
    answer = str(_error)
assert "(2.1)" in answer
assert "It slips most at norm term 0, by 4.6" in answer
print(answer)
