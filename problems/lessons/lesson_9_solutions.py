# %% [markdown]
"""# Solutions to the exercises of lesson 9"""

# %%
import numpy as np

import vemcvx as vx

n = 6
K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
g, w = np.linspace(2.0, -0.7, n), np.linspace(0.6, 0.3, n)
EPS = np.finfo(float).eps

# %% [markdown]
# **1.** Nothing moves as long as $\alpha g$ lies in the box: then the nearest point is $\alpha g$ itself. So $\alpha =
# \min_i w_i / |g_i|$, and the node where the minimum is attained slips first. (No linear system is needed.)

# %%
factors = w / np.abs(g)
first, alpha = int(np.argmin(factors)), factors.min()
pulled = vx.march(vx.System(K, lambda t: t * g, vx.Norms(np.eye(n), w)), [0.0, alpha * (1 - 1e-6), alpha * (1 + 1e-6)])
print(f"node {first} slips first, at {alpha:g} of the load")
assert not pulled.state[1].any()
assert np.flatnonzero(pulled.state[2]).tolist() == [first]

# %% [markdown]
# **2.** $\max_{p \ge 0} p^T(d - e)$ is 0 within the wall and infinite beyond. Exchange: $Kd = g - p$, and
#
# $$\max_{p \ge 0}\; -\tfrac12 (g - p)^TK^{-1}(g - p) - p^Te,$$
#
# whose gradient is $d(p) - e$: where a node would be in the wall, push it back. Primal minus dual value is $p^T(e - d)$
# for a feasible $d$ in balance. The iteration below stops changing at rounding, and its $d$ is feasible up to that.

# %%
wall = np.full(n, 0.8)
p = np.zeros(n)
for _ in range(2000):
    p = np.maximum(p + np.linalg.eigvalsh(K)[0] * (np.linalg.solve(K, g - p) - wall), 0.0)
pushed = np.linalg.solve(K, g - p)
limited = vx.march(vx.System(K, lambda t: t * g, limits=vx.Limits(np.eye(n), lambda t: wall)), [0.0, 1.0])
off = np.abs(pushed - limited.state[-1]).max()
print(f"{np.count_nonzero(p)} nodes touch the wall; distance of the two answers {off:.0e}")
assert 0 < np.count_nonzero(p) < n
assert (pushed - wall).max() <= 100 * EPS * np.linalg.cond(K)
assert off <= 100 * EPS * np.linalg.cond(K) + 1e-8
assert np.abs(p * (wall - pushed)).max() <= 100 * EPS * np.linalg.cond(K) * np.abs(g).max()

# %% [markdown]
# **3.** The stiffness that the contact nodes feel is a map from displacements to tractions: it takes one derivative,
# so its largest eigenvalue grows like $1/h$ beside the least, and so does the bound on Uzawa's iterations; that on
# accelerated ones grows like the root of that.


# %%
def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


scene = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(bound=4.0, on="bottom"),
)


def iterations_needed(step, accelerated):
    """Until the gap is 1e-6 of the energy of the answer."""
    K, g, w = step.operators.K, step.g, step.w
    length, now, looked_at = np.linalg.eigvalsh(K)[0], np.zeros_like(g), np.zeros_like(g)
    inverse = np.linalg.inv(K)
    for k in range(100_000):
        then = np.clip(looked_at + length * inverse @ (g - looked_at), -w, w)
        looked_at = then + (k / (k + 3) * (then - now) if accelerated else 0.0)
        now = then
        d = inverse @ (g - now)
        if w @ np.abs(d) - now @ d <= 1e-6 * 0.5 * step.norm**2:
            break
    return k + 1


conditions, counts = [], []
for _n in (4, 8, 16, 32):
    _step = next(vx.programs(scene, vx.meshes.squares(_n), [0.0, 1.0]))
    conditions.append(np.linalg.cond(_step.operators.K))
    counts.append([iterations_needed(_step, accelerated) for accelerated in (False, True)])
    print(f"n = {_n:2d}: condition {conditions[-1]:6.1f}, Uzawa {counts[-1][0]:4d}, accelerated {counts[-1][1]:4d}")
growth = np.array(counts[-1]) / counts[-2]
assert 1.6 < conditions[-1] / conditions[-2] < 2.4
assert growth[1] < growth[0]
assert counts[-1][1] < counts[-1][0]

# %% [markdown]
# **4.** The second derivative of $D$ is $-K^{-1}$ on the forces $B^T\lambda$ that nodes feel: negative definite, and
# $\lambda \mapsto B^T\lambda$ is one to one if the rows of $B$ are independent. With two equal rows only the *sum* of
# the two forces is determined: two brakes on one wheel.

# %%
kappa, load = 2.0, 1.5


def value(first, second):
    return -0.5 * (load - first - second) ** 2 / kappa


assert value(0.5, 0.25) == value(0.25, 0.5) == value(0.375, 0.375)
brakes = vx.march(vx.System([[kappa]], lambda t: [t * load], vx.Norms([[1.0], [1.0]], [0.5, 0.5])), [0.0, 1.0])
together = vx.march(vx.System([[kappa]], lambda t: [t * load], vx.Norms([[1.0]], [1.0])), [0.0, 1.0])
assert abs(brakes.state[-1, 0] - together.state[-1, 0]) <= 1e-8
print("all solutions hold")
