# %% [markdown]
"""# Lesson 7, what accuracy costs: errors of the mesh, of the time steps and of the solver; which to reduce first"""

# %% [markdown]
# *You need:* energy norms and orders of convergence; certificates (lesson 6). *You will see:* how to measure each of
# three errors alone, why the error of time steps may be zero or nearly forty per cent, and which error to reduce first.
#
# Let $u$ be the solution of the continuous problem, $u_h$ its discretisation in space, $u_{hk}$ its discretisation in
# space and time, and $\tilde u$ the answer of a solver. Then
#
# $$|u - \tilde u| \;\le\; \underbrace{|u - u_h|}_{\text{mesh}} + \underbrace{|u_h - u_{hk}|}_{\text{time steps}} +
# \underbrace{|u_{hk} - \tilde u|}_{\text{solver}} .$$
#
# Reduce the largest of these errors first. All errors below are relative, in the energy norm. The body is the block of
# Feng, Han and Huang, and $\varphi(t)$ is the factor of its load at the time $t$.

# %%
import matplotlib.pyplot as plt
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
    """Return the distance of two runs at the end, relative to the reference; their meshes may differ."""
    return vx.measures.energy_distance(run, reference).relative


ramp, eight = block(lambda t: t), np.linspace(0.0, 1.0, 9)

# %% [markdown]
# ## 1. The mesh
#
# There is no closed form, so the reference is a solution on a mesh with 96 cells across. By the orders of convergence
# below, the error of the reference is between a third and a half of the error of a mesh with 32 cells across.

# %%
reference = vx.simulate(ramp, vx.meshes.squares(96), eight, store="last")
sizes = (4, 8, 16, 32)
errors, nodes = {}, {}
for _family in ("squares", "triangles", "voronoi"):
    _runs = [vx.simulate(ramp, vx.meshes.FAMILIES[_family](n), eight, store="last") for n in sizes]
    errors[_family] = np.array([relative_error(run, reference) for run in _runs])
    nodes[_family] = np.array([run.mesh.n_nodes for run in _runs])
table = vx.measures.convergence_table(1 / np.array(sizes), errors)
print(table, "\nnodes", {family: count.tolist() for family, count in nodes.items()})

# %% [markdown]
# Linear elements have the order 1 for smooth solutions. If $u$ behaves like $r^\alpha$ at the distance $r$ from a
# singular point, with $\alpha < 1$, the order is lower:
#
# $$|u - u_h| = \begin{cases} O(h) & \text{for smooth } u, \\
#   O(h^\alpha) & \text{where } u \sim r^\alpha . \end{cases}$$
#
# The solution of this block is not smooth: the stress is singular where the clamp meets the free sides. So a tenth of
# the error needs more than a hundred times as many cells.
#
# **Question:** With the same number of *cells* across, all three families of meshes have nearly the same error. Which
# family has the smallest error with the same number of *nodes*?
#
# <details><summary>Answer</summary>
#
# Squares have the smallest error. With 32 cells across they have 1089 nodes and an error of 3.7 %. Triangles also have
# 1089 nodes, and an error of 4.5 %. Voronoi meshes have 2046 nodes, because only three cells meet at a node; their
# error is 4.0 %. The error falls roughly like $1/\sqrt N$ with the number $N$ of nodes, so we compare the products of
# the error and $\sqrt N$: 1.23, 1.48 and 1.81.
#
# </details>

# %%
for _found in table.orders.values():
    assert (_found[1:] > 0.7).all()
    assert (_found[1:] < 1.0).all()

# %% [markdown]
# ## 2. Time steps: no error, or nearly forty per cent
#
# We pull and push the block on one mesh, and compare runs of few steps with a run of 64 steps. The factor of the load
# is
#
# $$\varphi(t) = \sin 2\pi t .$$

# %%
mesh, cycle = vx.meshes.squares(8), block(lambda t: np.sin(2 * np.pi * t))
many = vx.simulate(cycle, mesh, np.linspace(0.0, 1.0, 65))
counts = (4, 6, 8, 10, 14, 16, 22, 30, 32)
deviations = {_n: relative_error(vx.simulate(cycle, mesh, np.linspace(0.0, 1.0, _n + 1)), many) for _n in counts}
for _n, _error in deviations.items():
    print(f"{_n:3d} steps: error {_error:.1e}")

# %% [markdown]
# Four steps are *exact*, and six steps have an error of more than a third. Why? Between two reversals of the load every
# node slips in one direction. Then the integral of the slip rate is the total slip,
#
# $$\int_{t_1}^{t_2} |\dot u|\, dt = |u(t_2) - u(t_1)| .$$
#
# So one large step has the same answer as many small steps. The instants need to include only the *reversals*, at
# $t = 1/4$ and $3/4$. If four divides the number of steps, the instants include both reversals. With six steps the
# nearest instant is half a step, $k/2$, away, and the load reaches only $\cos \pi k$ of its peak. So the error falls
# like
#
# $$1 - \cos \pi k \approx \tfrac12 (\pi k)^2 .$$

# %%
hit = [deviations[n] for n in counts if n % 4 == 0]
late = np.array([n for n in counts if n % 4 == 2])
not_hit = np.array([deviations[n] for n in late])
in_time = vx.measures.convergence_table(1 / late, not_hit, "k")
print(f"steps that do not hit the reversals have order 2:\n{in_time}")
assert max(hit) < 1e-10  # rounding
assert not_hit[0] > 0.3
assert abs(in_time.orders["error"][-1] - 2) < 0.3

# %% [markdown]
# So place instants at the reversals, and then refine the mesh.
#
# ## 3. The solver
#
# We request smaller and smaller errors from an interior-point method, on one mesh. The certificates bound the error of
# the solver,
#
# $$|u_{hk} - \tilde u| \le \sum_n \sqrt{2\,\mathrm{gap}_n} .$$

# %%
coarse = vx.meshes.squares(16)
exact = vx.simulate(ramp, coarse, eight)
requested = (1e-2, 1e-4, 1e-6)
solved = [vx.simulate(ramp, coarse, eight, solver=vx.Clarabel(accuracy=a)) for a in requested]
for _a, _run in zip(requested, solved, strict=True):
    _true = relative_error(_run, exact)
    _certified = _run.certificate.max()
    print(f"requested {_a:.0e}: {_run.iterations.sum()} iterations, certified {_certified:.0e}, true {_true:.0e}")
    assert _certified <= _a
    assert _true <= (_run.certificate_total[-1] + _run.certificate_floor.sum()) * (1 + 1e-6) + 1e-12
work = [run.iterations.sum() for run in solved]
assert work[-1] < 2 * work[0]

# %% [markdown]
# Four additional digits need 25 % more iterations. The error of this mesh is seven per cent, and the true solver errors
# of all three answers are far smaller. The error of the solver is the *cheapest* to reduce, so make this error
# negligible (lesson 6).
#
# ## 4. Estimates instead of references
#
# A reference for every run would cost too much. From the residuals in cells and the jumps of the stress across edges,
# we can estimate the error of the mesh. `vx.error_budget` reports all three errors side by side.

# %%
budgets = [vx.error_budget(vx.simulate(ramp, vx.meshes.squares(n), eight)) for n in (8, 16, 32)]
estimates = np.array([budget.largest["space"] for budget in budgets])
print(budgets[1])
print("estimated error / true error", np.round(estimates / errors["squares"][1:], 2))
# These estimates exceed the errors, but an estimate is not a bound.
assert (estimates > errors["squares"][1:]).all()
assert (estimates < 2.5 * errors["squares"][1:]).all()

# %% [markdown]
# The estimate of each cell also shows *where* to refine. `vx.adapt` refines until the estimate is below a target.

# %%
adapted = vx.adapt(ramp, vx.meshes.squares(8), [0.0, 0.5, 1.0], target=0.05)
reached = relative_error(adapted.history, reference)
print(f"error: estimated {adapted.passes[-1].total:.1%}, true {reached:.1%}; {adapted.history.mesh.n_nodes} nodes")
assert adapted.met
assert reached < 0.05
assert reached < errors["squares"][-1]
assert adapted.history.mesh.n_nodes < nodes["squares"][-1]

# %% jupyter={"source_hidden": true}
# Picture: error over nodes for three families and an adaptive mesh; error over steps that do or do not hit reversals
_figure, (_left, _right) = plt.subplots(1, 2, figsize=(9.4, 3.9), layout="constrained")
_styles = {"squares": ("tab:blue", "o"), "triangles": ("tab:green", "^"), "voronoi": ("tab:orange", "s")}
for _family, (_colour, _mark) in _styles.items():
    _left.loglog(nodes[_family], errors[_family], _mark, linestyle="-", color=_colour, markersize=5, label=_family)
_left.loglog(adapted.history.mesh.n_nodes, reached, "*", color="black", markersize=11, label="adaptive")
_slope = errors["squares"][0] * np.sqrt(nodes["squares"][0] / nodes["squares"])
_left.loglog(nodes["squares"], _slope, ":", color="black", label="order 1 in h")
_left.set(xlabel="nodes", ylabel="relative error (energy norm)", title="mesh")
_right.loglog(late, not_hit, "o", color="tab:orange", label="reversals not hit")
_right.loglog(late, not_hit[-1] * (late[-1] / late) ** 2, ":", color="black", label="order 2 in k")
_right.loglog([n for n in counts if n % 4 == 0], np.maximum(hit, 1e-16), "s", color="tab:blue", label="reversals hit")
_right.set(xlabel="steps", ylabel="relative error (energy norm)", title="time steps, pulled to and fro")
_left.set_yticks([0.04, 0.1, 0.2], ["4 %", "10 %", "20 %"])
_right.set_xticks([4, 8, 16, 32], ["4", "8", "16", "32"])
for _axes in (_left, _right):
    _axes.minorticks_off()
    _axes.grid(color="0.9")
    _axes.legend(frameon=False, fontsize=8)
plt.close(_figure)
_figure

# %% [markdown]
# **Question:** You have one minute, and a run with $n = 64$ and 64 steps takes ten seconds. What do you do with the
# remaining time? Which of the three errors do you measure first?
#
# <details><summary>Answer</summary>
#
# The error of the solver is measured already: the certificate is part of the run and costs nothing. Next, measure the
# error of the time steps, because it may be anything between zero and forty per cent. A run with 32 steps takes five
# seconds, and its distance to the first run shows the error. Then call `vx.error_budget` for the error of the mesh.
#
# Spend the remaining time on the largest error. If the instants hit the reversals, eight steps are as accurate as 64.
# Use eight steps and a finer mesh, or a mesh of `vx.adapt`. If the instants do not hit the reversals, first place
# instants at the reversals.
#
# </details>
#
# `vemcvx cost FILE` measures errors, seconds and memory for a problem file, and gives advice.
#
# ## Exercises
#
# 1. Fit $C h^\alpha$, with constants $C$ and $\alpha$, to the errors of squares of the size $h$. How many cells across
#    do you need for one per cent? How many nodes does an adaptive mesh need, if the error with $N$ nodes falls like
#    $1/\sqrt N$?
# 2. Replace the sine by a zigzag of straight lines. Derive the power of $k$ with which the error falls if the instants
#    do not hit the reversals. Then test the result.
# 3. Take a smooth solution without friction, with a closed form. Which order do you get now?
# 4. In a model, the errors of mesh and steps are $e_h = C_h h$ and $e_k = C_k k$, and the cost is $h^{-2} k^{-1}$.
#    Which $e_h$ and $e_k$ have the smallest cost for a given sum? Should both errors be equal?
#
# Solutions: `lesson_7_solutions.py`.
