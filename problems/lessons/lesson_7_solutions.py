# %% [markdown]
"""# Solutions to the exercises of lesson 7"""

# %%
import numpy as np

import vemcvx as vx


def block(phi):
    def pull(x, t):
        return phi(t) * np.column_stack([8 * (1.25 - x[:, 1]), np.full(len(x), -0.01)])

    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    )


def apart(run, reference):
    return vx.measures.energy_distance(run, reference).relative


# %% [markdown]
# **1.** From two meshes, $\alpha = \log_2 (e_1 / e_2)$ and $n = n_2 (e_2 / \varepsilon)^{1/\alpha}$. Orders still
# grow a little with $n$, so the prediction errs on the safe side. We test it where it can be afforded, at ten per
# cent, and then believe it at one. Adaptive meshes: $N = N_0 (e_0 / \varepsilon)^2$ from 862 nodes at 3.3 per cent.

# %%
ramp, steps = block(lambda t: t), np.linspace(0.0, 1.0, 5)
reference = vx.simulate(ramp, vx.meshes.squares(64), steps, store="last")
errors = {n: apart(vx.simulate(ramp, vx.meshes.squares(n), steps, store="last"), reference) for n in (4, 8)}
alpha = np.log2(errors[4] / errors[8])


def cells_across(wanted):
    return int(np.ceil(8 * (errors[8] / wanted) ** (1 / alpha)))


tried = apart(vx.simulate(ramp, vx.meshes.squares(cells_across(0.1)), steps, store="last"), reference)
print(f"order {alpha:.2f}; 10 % needs n = {cells_across(0.1)}, which has {tried:.1%}")
print(f"1 % needs n = {cells_across(0.01)}, {cells_across(0.01) ** 2} nodes; adaptive {round(862 * (3.3 / 1.0) ** 2)}")
assert 0.08 < tried <= 0.1
assert cells_across(0.01) ** 2 > 862 * 3.3**2

# %% [markdown]
# **2.** A zigzag reaches its peak with a slope. The nearest instant is $k/2$ away, so the load lacks $4 \cdot k/2$ of
# its peak: order 1.


# %%
def zigzag(t):
    return np.interp(t, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])


bent, mesh = block(zigzag), vx.meshes.squares(8)
many = vx.simulate(bent, mesh, np.linspace(0.0, 1.0, 9))
late = np.array([14, 22, 30, 62])
off = np.array([apart(vx.simulate(bent, mesh, np.linspace(0.0, 1.0, n + 1)), many) for n in late])
in_time = vx.measures.convergence_table(1 / late, off, "k")
print(in_time)
assert abs(in_time.orders["error"][-1] - 1) < 0.15

# %% [markdown]
# **3.** $u = (x^2, 0)$ has the strain $(2x, 0, 0)$ and the stress $((\lambda + 2\mu)\, 2x, 2\lambda x, 0)$, so the body
# force is $-2 (\lambda + 2\mu)$ along $x$. No singularity, order 1.

# %%
young, poisson = 10.0, 0.3
M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
smooth = vx.Scene(
    vx.Elasticity(young, poisson),
    vx.BodyForce(lambda x, t: t * np.tile([-2 * M, 0.0], (len(x), 1))),
    vx.PrescribedDisplacement(lambda x, t: t * np.column_stack([x[:, 0] ** 2, 0 * x[:, 0]]), on="boundary"),
)


def strain(x, t):
    return t * np.column_stack([2 * x[:, 0], np.zeros((len(x), 2))])


runs = [vx.simulate(smooth, vx.meshes.voronoi(n), [0.0, 1.0]) for n in (8, 16, 32)]
found = [vx.measures.energy_error(run, strain).relative for run in runs]
in_space = vx.measures.convergence_table(1 / np.array([8, 16, 32]), found)
print(f"smooth solution:\n{in_space}")
assert np.abs(in_space.orders["error"][1:] - 1).max() < 0.1

# %% [markdown]
# **4.** Minimise $h^{-2}k^{-1}$ under $ah + bk = \varepsilon$: the gradient of the logarithm, $(-2/h, -1/k)$, is
# parallel to $(a, b)$, so $ah = 2bk$. The mesh may have *two thirds* of the error, because accuracy in space is the
# dearer one.

# %%
a, b, wanted = 3.0, 0.7, 0.05
h = np.linspace(1e-4, wanted / a - 1e-4, 20001)
cost = 1 / (h**2 * (wanted - a * h) / b)
best = a * h[np.argmin(cost)] / wanted
print(f"share of the mesh at the cheapest point: {best:.4f}")
assert abs(best - 2 / 3) <= a * (h[1] - h[0]) / wanted  # the grid
print("all solutions hold")
