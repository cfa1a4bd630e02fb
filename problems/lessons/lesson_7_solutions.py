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


def relative_error(run, reference):
    return vx.measures.energy_distance(run, reference).relative


# %% [markdown]
# **1.** Let the meshes with $n_1$ and $n_2 = 2 n_1$ cells across have the errors $e_1$ and $e_2$. The order is
# $\alpha = \log_2 (e_1 / e_2)$, and the error $\varepsilon$ needs $n = n_2 (e_2 / \varepsilon)^{1/\alpha}$. We test the
# prediction for ten per cent, where the test is cheap. The adaptive mesh of the lesson has 862 nodes and an error of
# 3.3 per cent. On adaptive meshes of $N$ nodes the error is $O(N^{-1/2})$, so one per cent needs $862 \cdot 3.3^2$
# nodes.

# %%
ramp, steps = block(lambda t: t), np.linspace(0.0, 1.0, 5)
reference = vx.simulate(ramp, vx.meshes.squares(64), steps, store="last")
errors = {n: relative_error(vx.simulate(ramp, vx.meshes.squares(n), steps, store="last"), reference) for n in (4, 8)}
alpha = np.log2(errors[4] / errors[8])


def cells_across(target):
    return int(np.ceil(8 * (errors[8] / target) ** (1 / alpha)))


measured = relative_error(vx.simulate(ramp, vx.meshes.squares(cells_across(0.1)), steps, store="last"), reference)
print(f"order {alpha:.2f}; 10 % needs n = {cells_across(0.1)}, where {measured:.1%} are measured")
print(f"1 % needs n = {cells_across(0.01)}, {cells_across(0.01) ** 2} cells; adaptive {round(862 * 3.3**2)} nodes")
assert 0.08 < measured <= 0.1
assert cells_across(0.01) ** 2 > 862 * 3.3**2

# %% [markdown]
# **2.** The zigzag has the slope 4 on both sides of its peaks. We choose steps of the length $k$ so that each reversal
# is in the middle of a step. Then the instants next to a peak are $k/2$ away, and the largest load of the run is too
# small by $4 \cdot k/2$. So the order is 1.


# %%
def zigzag(t):
    return np.interp(t, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])


bent, mesh = block(zigzag), vx.meshes.squares(8)
many = vx.simulate(bent, mesh, np.linspace(0.0, 1.0, 9))
late = np.array([14, 22, 30, 62])
deviations = np.array([relative_error(vx.simulate(bent, mesh, np.linspace(0.0, 1.0, n + 1)), many) for n in late])
in_time = vx.measures.convergence_table(1 / late, deviations, "k")
print(in_time)
assert abs(in_time.orders["error"][-1] - 1) < 0.15

# %% [markdown]
# **3.** Take $u = (x^2, 0)$, with Lamé's moduli $\Lambda$ and $\mu$. The strain is $(2x, 0, 0)$ and the stress
# $((\Lambda + 2\mu)\, 2x, 2\Lambda x, 0)$, so the body force is $-2M$ along $x$ with $M = \Lambda + 2\mu$. There is no
# singularity, and the order is 1.

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
smooth_errors = [vx.measures.energy_error(run, strain).relative for run in runs]
in_space = vx.measures.convergence_table(1 / np.array([8, 16, 32]), smooth_errors)
print(f"smooth solution:\n{in_space}")
assert np.abs(in_space.orders["error"][1:] - 1).max() < 0.1

# %% [markdown]
# **4.** Minimise the cost $h^{-2}k^{-1}$ for $C_h h + C_k k = \varepsilon$. At the minimum the gradient of the
# logarithm of the cost, $(-2/h, -1/k)$, is parallel to $(C_h, C_k)$, so $C_h h = 2 C_k k$. The error of the mesh is
# *two thirds* of the total.

# %%
C_h, C_k, target = 3.0, 0.7, 0.05
h = np.linspace(1e-4, target / C_h - 1e-4, 20001)
cost = 1 / (h**2 * (target - C_h * h) / C_k)
best = C_h * h[np.argmin(cost)] / target
print(f"at the least cost the mesh causes this fraction of the error: {best:.4f}")
assert abs(best - 2 / 3) <= C_h * (h[1] - h[0]) / target  # the spacing of the tried values
print("all solutions hold")
