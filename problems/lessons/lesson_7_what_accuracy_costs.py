# %% [markdown]
"""# Lesson 7, what accuracy costs: errors of the mesh, of the time steps and of the solver, and how to spend wisely"""

# %% [markdown]
# *You need:* energy norms and convergence orders; certificates (lesson 6). *You will see:* three errors, how to
# measure each without the others, that one of them may be zero or forty per cent, and where a second of computing is
# well spent.
#
# Let $u$ be the solution of the continuous problem, $u_h$ its discretisation in space, $u_{hk}$ with time steps, and
# $\tilde u$ what a solver returns. Then
#
# $$|u - \tilde u| \;\le\; \underbrace{|u - u_h|}_{\text{mesh}} + \underbrace{|u_h - u_{hk}|}_{\text{time steps}} +
# \underbrace{|u_{hk} - \tilde u|}_{\text{solver}} ,$$
#
# and work spent on one term is wasted while another is larger. All errors below are relative, in the energy norm. The
# body is the paper's block; $\varphi(t)$ says how hard it is pulled.

# %%
import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, EXACT, SECOND, THIRD


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
    """Distance of two runs at the end, on whatever meshes, as a part of the reference."""
    return vx.measures.energy_distance(run, reference).relative


ramp, eight = block(lambda t: t), np.linspace(0.0, 1.0, 9)

# %% [markdown]
# ## 1. The mesh
#
# There is no closed form, so the truth is a much finer mesh. Its own error is between a half and a third of that of
# $n = 32$.

# %%
reference = vx.simulate(ramp, vx.meshes.squares(96), eight, store="last")
sizes = (4, 8, 16, 32)
errors, nodes = {}, {}
for _family in ("squares", "triangles", "voronoi"):
    _runs = [vx.simulate(ramp, vx.meshes.FAMILIES[_family](n), eight, store="last") for n in sizes]
    errors[_family] = np.array([apart(run, reference) for run in _runs])
    nodes[_family] = np.array([run.mesh.n_nodes for run in _runs])
table = vx.measures.convergence_table(1 / np.array(sizes), errors)
print(table, "\nnodes", nodes)

# %% [markdown]
# Linear elements have the order 1 at best,
#
# $$|u - u_h| \le C h\, |u|_{H^2} \quad \text{for smooth } u, \qquad |u - u_h| \sim h^\alpha \quad \text{where } u \sim
# r^\alpha,\; \alpha < 1 .$$
#
# This body is not smooth: where the clamp meets the free sides stresses are singular. So ten times the accuracy needs
# more than a hundred times the cells.
#
# **Question:** With equally many *cells* across, all families have nearly the same error. Which has the smallest error
# with equally many *unknowns*?
#
# <details><summary>Answer</summary>
#
# Squares. With 32 cells across they have 1089 nodes and an error of 3.7 %, triangles as many nodes and 4.5 %; Voronoi
# cells, of which three meet at a node, have 2046 nodes and 4.0 %. The error falls like the root of the number of nodes
# $N$, so compare error times $\sqrt N$: 1.23, 1.48 and 1.81.
#
# </details>

# %%
for _found in table.orders.values():
    assert (_found[1:] > 0.7).all()
    assert (_found[1:] < 1.0).all()

# %% [markdown]
# ## 2. Time steps: nothing, or forty per cent
#
# Pull and push, $\varphi = \sin 2\pi t$, on one mesh, and compare steps with many steps.

# %%
mesh, cycle = vx.meshes.squares(8), block(lambda t: np.sin(2 * np.pi * t))
many = vx.simulate(cycle, mesh, np.linspace(0.0, 1.0, 65))
counts = (4, 6, 8, 10, 14, 16, 22, 30, 32)
missed = {_n: apart(vx.simulate(cycle, mesh, np.linspace(0.0, 1.0, _n + 1)), many) for _n in counts}
for _n, _error in missed.items():
    print(f"{_n:3d} steps: error {_error:.1e}")

# %% [markdown]
# Four steps are *exact*, six are off by a third. Why? Between reversals a load that only grows makes slip that only
# grows, and then its rate can be summed up,
#
# $$\int_s^t |\dot u_\tau|\, dt = |u_\tau(t) - u_\tau(s)| :$$
#
# one large step solves the same program as many small ones. What counts is whether the instants hit the *reversals* of
# the load, at $t = 1/4$ and $3/4$. Four divides 4, 8, 16, 32. With six steps the load never reaches its peak: it gets
# to $\cos(\pi k)$ of it, for the nearest instant is half a step $k$ away. So the error falls like $1 - \cos \pi k
# \approx (\pi k)^2 / 2$.

# %%
hit = [missed[n] for n in counts if n % 4 == 0]
late = np.array([n for n in counts if n % 4 == 2])
off = np.array([missed[n] for n in late])
in_time = vx.measures.convergence_table(1 / late, off, "k")
print(f"where reversals are missed, of order 2:\n{in_time}")
assert max(hit) < 1e-10  # rounding, and nothing else
assert off[0] > 0.3
assert abs(in_time.orders["error"][-1] - 2) < 0.3

# %% [markdown]
# Place instants at the reversals, and then spend on the mesh. (Loads that turn in direction, or pressures that
# change, make an error of order $k$ in addition. `vx.adapt` looks for kinks and reversals by itself.)
#
# ## 3. The solver
#
# Ask an interior-point method for less and less error, on one mesh.

# %%
coarse = vx.meshes.squares(16)
exact = vx.simulate(ramp, coarse, eight)
asked = (1e-2, 1e-4, 1e-6)
solved = [vx.simulate(ramp, coarse, eight, solver=vx.Clarabel(accuracy=a)) for a in asked]
for _a, _run in zip(asked, solved, strict=True):
    _true = apart(_run, exact)
    print(f"asked {_a:.0e}: {_run.iterations.sum()} iterations, got {_run.certificate.max():.0e}, true {_true:.0e}")
    assert _run.certificate.max() <= _a
    assert _true <= (_run.certificate_total[-1] + _run.certificate_floor.sum()) * (1 + 1e-6) + 1e-12
work = [run.iterations.sum() for run in solved]
assert work[-1] < 2 * work[0]

# %% [markdown]
# Four more digits cost a quarter more iterations: Newton's method converges fast or not at all. Beside a mesh error of
# seven per cent every one of these answers is exact. The error of the solver is the *cheapest* of the three to
# reduce, so make it negligible and forget it; but certify that it is (lesson 6).
#
# ## 4. Estimates instead of references
#
# Nobody can afford a reference each time. Residuals in cells and jumps of stress across edges estimate the error of the
# mesh; `vx.error_budget` puts all three side by side.

# %%
budgets = [vx.error_budget(vx.simulate(ramp, vx.meshes.squares(n), eight)) for n in (8, 16, 32)]
estimates = np.array([budget.largest["space"] for budget in budgets])
print(budgets[1])
print("estimated over true", np.round(estimates / errors["squares"][1:], 2))
# An estimate is no bound: its constant is chosen so that it errs on the safe side. The page "Choose accuracy" says by
# how much.
assert (estimates > errors["squares"][1:]).all()
assert (estimates < 2.5 * errors["squares"][1:]).all()

# %% [markdown]
# An estimate cell by cell also says *where* to refine. `vx.adapt` does so until a target is met.

# %%
adapted = vx.adapt(ramp, vx.meshes.squares(8), [0.0, 0.5, 1.0], target=0.05)
reached = apart(adapted.history, reference)
print(f"estimated {adapted.passes[-1].total:.1%}, true {reached:.1%}, {adapted.history.mesh.n_nodes} nodes")
assert adapted.met
assert reached < 0.05
assert reached < errors["squares"][-1]
assert adapted.history.mesh.n_nodes < nodes["squares"][-1]

# %% jupyter={"source_hidden": true}
_figure = new_figure(9.4, 3.9)
_left, _right = _figure.subplots(1, 2)
for _family, _colour, _mark in (("squares", COMPUTED, "o"), ("triangles", THIRD, "^"), ("voronoi", SECOND, "s")):
    _left.loglog(nodes[_family], errors[_family], _mark, linestyle="-", color=_colour, markersize=5, label=_family)
_left.loglog(adapted.history.mesh.n_nodes, reached, "*", color=EXACT, markersize=11, label="refined where needed")
_slope = errors["squares"][0] * np.sqrt(nodes["squares"][0] / nodes["squares"])
_left.loglog(nodes["squares"], _slope, ":", color=EXACT, label="order 1 in h")
_left.set(xlabel="nodes", ylabel="relative error (energy norm)", title="mesh")
_right.loglog(late, off, "o", color=SECOND, label="reversals missed")
_right.loglog(late, off[-1] * (late[-1] / late) ** 2, ":", color=EXACT, label="order 2 in k")
_right.loglog([n for n in counts if n % 4 == 0], np.maximum(hit, 1e-16), "s", color=COMPUTED, label="reversals hit")
_right.set(xlabel="steps", ylabel="relative error (energy norm)", title="time steps, pulled back and forth")
_left.set_yticks([0.04, 0.1, 0.2], ["4 %", "10 %", "20 %"])
_right.set_xticks([4, 8, 16, 32], ["4", "8", "16", "32"])
for _ax in (_left, _right):
    _ax.minorticks_off()
    light_grid(_ax)
    _ax.legend(frameon=False, fontsize=8)
_figure

# %% [markdown]
# **Question:** You have one minute, and a run with $n = 64$ and 64 steps takes ten seconds. What do you do with the
# rest? Which of the three errors do you measure first?
#
# <details><summary>Answer</summary>
#
# The solver's is measured already: the certificate is in the run and costs nothing. Measure that of the time steps
# next, because it may be anything between nothing and forty per cent: a run with 32 steps takes five seconds, and its
# distance to the first tells. Then ask `vx.error_budget` for that of the mesh.
#
# Spend the rest on the largest. If instants hit the reversals, the steps cost nothing in accuracy, and eight of them do
# as well as 64: take these, and a finer mesh for the time that you save, better still one that `vx.adapt` refines where
# the estimate is large. If reversals are missed, place instants there first; no mesh makes up for that.
#
# </details>
#
# `vemcvx cost FILE` does all this for a problem file: true errors against seconds and memory, for families of meshes,
# steps, solvers, uniform and adaptive, with advice.
#
# ## Exercises
#
# 1. Fit $C h^\alpha$ to the errors of squares. Which $n$ do you need for one per cent? How many for adaptive meshes, if
#    their error falls like the root of the number of unknowns?
# 2. Replace the sine by a zigzag of straight lines. With which power of $k$ does the error fall where reversals are
#    missed? Derive it first.
# 3. Take a smooth solution, without friction, with a closed form. Which order do you get now?
# 4. A model: the error is $a h + b k$, the cost $h^{-2} k^{-1}$. For a given error, where does the cost have its
#    minimum? Should both errors be equal?
#
# Solutions: `lesson_7_solutions.py`.
