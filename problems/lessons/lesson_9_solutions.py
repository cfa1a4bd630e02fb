# %% [markdown]
"""# Solutions to the exercises of lesson 9"""

# %%
import numpy as np

import vemcvx as vx

size = 6
K = 2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)
f, w = np.linspace(2.0, -0.7, size), np.linspace(0.6, 0.3, size)
EPS = np.finfo(float).eps

# %% [markdown]
# **1.** Scale the load to $\alpha f$. Nothing moves while $\alpha f$ lies in the box $|\lambda_i| \le w_i$, because
# then the point of the box that is nearest to $\alpha f$ is $\alpha f$ itself. So slip begins at
# $\alpha = \min_i w_i / |f_i|$, and the node with the smallest quotient slips first.

# %%
factors = w / np.abs(f)
first, alpha = int(np.argmin(factors)), factors.min()
system = vx.System(K, lambda t: t * f, vx.Norms(np.eye(size), w))
pulled = vx.march(system, [0.0, alpha * (1 - 1e-6), alpha * (1 + 1e-6)])
print(f"node {first} slips first, at {alpha:g} of the load")
assert not pulled.state[1].any()
assert np.flatnonzero(pulled.state[2]).tolist() == [first]

# %% [markdown]
# **2.** The wall requires $s \le e$. The maximum $\max_{p \ge 0} p^T(s - e)$ is 0 if $s \le e$, and infinite otherwise.
# After the exchange of minimum and maximum, the minimum over $s$ lies where $Ks = f - p$, and the dual is
#
# $$\max_{p \ge 0}\; -\tfrac12 (f - p)^TK^{-1}(f - p) - p^Te .$$
#
# The gradient of the dual is $s(p) - e$, so the force grows where a node is beyond the wall. For a feasible $s$ with
# $Ks = f - p$ the gap is $p^T(e - s)$. The iteration below converges up to rounding, and its $s$ is feasible up to
# rounding.

# %%
wall = np.full(size, 0.8)
p = np.zeros(size)
for _ in range(2000):
    p = np.maximum(p + np.linalg.eigvalsh(K)[0] * (np.linalg.solve(K, f - p) - wall), 0.0)
pushed = np.linalg.solve(K, f - p)
limited = vx.march(vx.System(K, lambda t: t * f, limits=vx.Limits(np.eye(size), lambda t: wall)), [0.0, 1.0])
deviation = np.abs(pushed - limited.state[-1]).max()
print(f"{np.count_nonzero(p)} nodes touch the wall; the two answers differ by {deviation:.0e}")
assert 0 < np.count_nonzero(p) < size
assert (pushed - wall).max() <= 100 * EPS * np.linalg.cond(K)
assert deviation <= 100 * EPS * np.linalg.cond(K) + 1e-8
assert np.abs(p * (wall - pushed)).max() <= 100 * EPS * np.linalg.cond(K) * np.abs(f).max()

# %% [markdown]
# **3.** The stiffness at the contact nodes maps displacements to tractions. This map behaves like a derivative, so the
# condition number of $K$ grows like $1/h$. The bound on Uzawa's iterations grows in the same way, and the bound on
# accelerated iterations grows like the square root of $1/h$.


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
    """Return the number of iterations until the gap is 1e-6 of the energy of the answer."""
    K, f, w = step.operators.K, step.g, step.w
    rho, now, extrapolated = np.linalg.eigvalsh(K)[0], np.zeros_like(f), np.zeros_like(f)
    flexibility = np.linalg.inv(K)
    for count in range(100_000):
        following = np.clip(extrapolated + rho * flexibility @ (f - extrapolated), -w, w)
        extrapolated = following + (count / (count + 3) * (following - now) if accelerated else 0.0)
        now = following
        s = flexibility @ (f - now)
        if w @ np.abs(s) - now @ s <= 1e-6 * 0.5 * step.norm**2:
            break
    return count + 1


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
# **4.** As a function of the nodal forces $B^T\lambda$, the dual objective $D$ has the second derivative $-K^{-1}$,
# which is negative definite. So the nodal forces are unique. The map from $\lambda$ to $B^T\lambda$ is one-to-one if
# the rows of $B$ are independent. With two equal rows only the *sum* of the two forces is unique.

# %%
stiffness, load = 2.0, 1.5


def value(first, second):
    return -0.5 * (load - first - second) ** 2 / stiffness


assert value(0.5, 0.25) == value(0.25, 0.5) == value(0.375, 0.375)
brakes = vx.march(vx.System([[stiffness]], lambda t: [t * load], vx.Norms([[1.0], [1.0]], [0.5, 0.5])), [0.0, 1.0])
together = vx.march(vx.System([[stiffness]], lambda t: [t * load], vx.Norms([[1.0]], [1.0])), [0.0, 1.0])
assert abs(brakes.state[-1, 0] - together.state[-1, 0]) <= 1e-8
print("all solutions hold")
