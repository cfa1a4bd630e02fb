# %% [markdown]
"""# Lesson 2, four nodes: ten lines of cvxpy, and what the dual of a cone means"""

# %% [markdown]
# *You need:* lesson 1; vectors and matrices. *You will see:* the program of a step in ten lines of cvxpy, and what a
# conic solver returns in addition to the positions. In the plane, absolute values become lengths.
#
# Lesson 1 had one slider; this lesson has four in a row. Equation numbers refer to the paper of Feng, Han and Huang.

# %%
import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx

# %% [markdown]
# ## 1. Ten lines
#
# Springs of stiffness 1 join four blocks in a row, and tie block 4 to a wall. The load $f$ pulls block 1. Block $i$ has
# the friction bound $w_i$. As in lesson 1, the step (2.34) from the positions $u_{prev}$ to the positions $u$ minimises
# the energy
#
# $$\begin{gathered} P(u) = \tfrac12 u^T K u - f^T u + \sum_i w_i\, |u_i - u_{prev,i}|, \\
#   K = \begin{pmatrix} 1 & -1 \\ -1 & 2 & -1 \\ & -1 & 2 & -1 \\ & & -1 & 2 \end{pmatrix}. \end{gathered}$$
#
# A finite element model of a body on a rough floor leads to the same program with a larger $K$.
#
# A conic program has a linear or quadratic objective, and requires that vectors lie in *cones*. We replace each
# absolute value by a variable $d_i$, a distance, and require
#
# $$|u_i - u_{prev,i}| \le d_i .$$
#
# The pairs $(d_i, u_i - u_{prev,i})$ with this property form a cone. At the minimum $d_i$ equals the absolute value,
# because a larger $d_i$ costs energy.

# %%
K = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
w = np.array([0.5, 0.5, 0.5, 0.5])
f = np.array([1.2, 0.0, 0.0, 0.0])
u_prev = np.zeros(4)

u, d = cp.Variable(4), cp.Variable(4)
cones = [cp.SOC(d[i], cp.reshape(u[i] - u_prev[i], (1,), order="F")) for i in range(4)]
energy = 0.5 * cp.quad_form(u, K) - f @ u + w @ d
problem = cp.Problem(cp.Minimize(energy), cones)
problem.solve(solver="CLARABEL")
print("positions", np.round(u.value, 6) + 0.0)

# %% [markdown]
# **By hand.** Blocks 1 and 2 slide forward, and friction takes 0.5 at each block. The first spring carries the
# remaining $1.2 - 0.5 = 0.7$, and the second spring carries $0.7 - 0.5 = 0.2$. The friction of block 3 takes 0.2, and
# block 3 does not move. So $u_4 = u_3 = 0$, $u_2 = 0.2$ and $u_1 = 0.2 + 0.7 = 0.9$.
#
# How accurate is the solver? Clarabel stops at a gap of about 1e-8. As in lesson 1, the gap bounds the error $e$ of the
# positions in the *energy norm*: $\sqrt{e^T K e} \le \sqrt{2 \cdot 10^{-8}} \approx$ 1.4e-4. The smallest eigenvalue of
# $K$ is 0.12, so $|e|$ is at most 4.1e-4.
#
# For a block $i$ that sticks in the solution, a much smaller bound holds. If the computed slip of this block is $s_i$,
# the gap is at least (lesson 6)
#
# $$(w_i - |\lambda_i|)\,|s_i|$$
#
# where $\lambda_i$ is the force of friction in the solution. Here $\lambda_3 = 0.2$ and $\lambda_4 = 0$. So the
# computed slips of blocks 3 and 4 are at most 1e-8/0.3 and 1e-8/0.5.

# %%
by_hand = np.array([0.9, 0.2, 0.0, 0.0])
allowed = np.sqrt(2e-8 / np.linalg.eigvalsh(K).min())
assert np.linalg.norm(u.value - by_hand) < allowed
assert (np.abs(u.value[2:]) < 1e-8 / np.array([0.5 - 0.2, 0.5 - 0.0])).all()
print(f"by hand   {by_hand}; difference {np.linalg.norm(u.value - by_hand):.0e}, allowed {allowed:.0e}")

# %% [markdown]
# ## 2. Which part of the dual solution is a force
#
# As in lesson 1, write $w_i|s_i| = \max_{|\lambda_i| \le w_i} \lambda_i s_i$ with the slip $s = u - u_{prev}$, and
# exchange minimum and maximum:
#
# $$\begin{aligned} & \max_{|\lambda_i| \le w_i} \min_u \; \tfrac12 u^TKu - f^Tu + \lambda^T(u - u_{prev}) \\
#   =\; & \max_{|\lambda_i| \le w_i} -\tfrac12 (f - \lambda)^T K^{-1} (f - \lambda) - \lambda^T u_{prev}.
#   \end{aligned}$$
#
# The inner minimum is at $K u = f - \lambda$: the multiplier is the force that friction takes. A block with
# $|\lambda_i| < w_i$ sticks. Where a block slides, $\lambda_i = w_i\,\mathrm{sign}(s_i)$. The force of friction *on*
# the block is $-\lambda_i$, opposite to the slip.
#
# **What the solver returns.** For the cone $|s_i| \le d_i$ the solver returns a pair $(\xi_i, \zeta_i)$ in the *dual
# cone*. The dual cone contains all pairs $(\xi, \zeta)$ with $\xi d + \zeta s \ge 0$ for every $(d, s)$ in the cone.
# Here the dual cone equals the cone itself:
#
# $$|\zeta_i| \le \xi_i .$$
#
# The Lagrangian of the solver subtracts $\xi_i d_i + \zeta_i s_i$ from the objective:
#
# - Stationarity in $d_i$ gives $w_i - \xi_i = 0$: **the first component is the friction bound**.
# - Stationarity in $u$ gives $Ku - f - \zeta = 0$, so $\zeta_i = -\lambda_i$: **the second component is the force on
#   the block**.
# - Complementarity, $\xi_i d_i + \zeta_i s_i = 0$, means that a block sticks, or that its friction has the size $w_i$
#   and opposes its slip.

# %%
xi = np.array([cone.dual_value[0].item() for cone in cones])
lam = np.array([-cone.dual_value[1].item() for cone in cones])
# An error e in u causes an error K e in the forces, and no eigenvalue of K exceeds 4 (Gershgorin).
assert np.abs(xi - w).max() < 4 * allowed
assert np.abs(lam - [0.5, 0.5, 0.2, 0.0]).max() < 4 * allowed
assert np.abs(lam - (f - K @ u.value)).max() < 4 * allowed
print("friction takes", np.round(lam, 6) + 0.0, "of the bounds", w)
print("f - K u       ", np.round(f - K @ u.value, 6) + 0.0, "(equal, because the forces balance)")

# %% [markdown]
# The dual is itself a program: a concave quadratic function is maximised over a box, and the unknowns are the forces of
# friction. If we solve the dual, the positions follow from $Ku = f - \lambda$. **Question:** block 1 is pulled, and
# block 4 carries no force at all. Why?
#
# <details><summary>Answer</summary>
#
# Block 3 sticks, $u_3 = 0$, so the spring between blocks 3 and 4 keeps its length and carries no force. Block 4 is in
# balance without friction: $\lambda_4 = f_4 - (Ku)_4 = 0$. A block that sticks acts like a wall.
#
# </details>

# %%
force = cp.Variable(4)
flexibility = np.linalg.inv(K)
dual_energy = -0.5 * cp.quad_form(f - force, flexibility) - u_prev @ force
dual = cp.Problem(cp.Maximize(dual_energy), [cp.abs(force) <= w])
dual.solve(solver="CLARABEL")
# Both objectives are within 1e-8 (absolute and relative) of the common optimum.
assert abs(dual.value - problem.value) < 4e-8
assert np.linalg.norm(flexibility @ (f - force.value) - by_hand) < allowed
print(f"least energy {problem.value:.8f}, best lower bound {dual.value:.8f}")


# %% jupyter={"source_hidden": true}
# Picture: the four blocks after the step (top); the force of friction on each block, within its bound (bottom)
def chain_picture():
    figure, (above, below) = plt.subplots(
        2, 1, sharex=True, figsize=(7.0, 3.4), layout="constrained", gridspec_kw={"height_ratios": [1, 1.5]}
    )
    rest = np.array([4.5, 3.0, 1.5, 0.0])
    now, colours = rest + by_hand, ["tab:orange" if moves else "tab:blue" for moves in by_hand > 0]
    above.plot([-1.0, now[0]], [0, 0], color="0.6", linewidth=1.0)
    above.plot([-1.0, -1.0], [-0.5, 0.5], color="black", linewidth=3)
    above.scatter(rest, np.zeros(4), s=200, facecolor="white", edgecolor="0.4", marker="s", zorder=2)
    above.scatter(now, np.zeros(4), s=200, color=colours, marker="s", zorder=3)
    above.annotate("pull", (6.4, 0), (5.6, 0), arrowprops={"arrowstyle": "->"}, va="center")
    above.set(yticks=[], xlim=(-1.2, 6.6), ylim=(-1, 1), title="the step: orange blocks slide, blue blocks stick")
    below.bar(rest, 2 * w, 0.6, bottom=-w, facecolor="none", edgecolor="0.4", label=r"$|\lambda_i| \leq w_i$")
    below.bar(rest, lam, 0.6, color=colours)
    below.set(ylabel=r"force $\lambda_i$", xticks=rest, xticklabels=[f"block {i}" for i in (1, 2, 3, 4)])
    below.grid(axis="y", color="0.9")
    below.set_axisbelow(True)
    below.legend(frameon=False, loc="lower right")
    plt.close(figure)
    return figure


chain_picture()

# %% [markdown]
# ## 3. From the line to the plane: the absolute value becomes a length
#
# Now the four blocks stand on a table, and each may slide in any direction of the plane: $u_i \in \mathbb{R}^2$. The
# springs act equally in $x$ and $y$. The absolute value becomes a length, and the set of admissible pairs becomes the
# second-order cone:
#
# $$\{(d_i, s_i) : |s_i| \le d_i\}, \qquad s_i \in \mathbb{R}^2 .$$
#
# The force $\lambda_i$ is now a vector in a **disc** of radius $w_i$. In the program, the slip in each cone has two
# components:


# %%
def step_in_the_plane(pull, before):
    position, distance = cp.Variable((4, 2)), cp.Variable(4)
    discs = [cp.SOC(distance[i], position[i] - before[i]) for i in range(4)]
    stored = 0.5 * sum(cp.quad_form(position[:, a], K) for a in range(2))
    least = cp.Problem(cp.Minimize(stored - cp.sum(cp.multiply(pull, position)) + w @ distance), discs)
    least.solve(solver="CLARABEL")
    return position.value, -np.array([np.ravel(disc.dual_value[1]) for disc in discs])


# %% [markdown]
# We pull along $x$ first, as before. In a second step we turn the pull by 60 degrees and increase it to 1.6. Where a
# block slides, the force is on the rim of the disc and has the direction of the slip *of this step*:
#
# $$\lambda_i = w_i\,\frac{s_i}{|s_i|} .$$
#
# Where a block sticks, $\lambda_i$ may be anywhere in the disc.
#
# How accurately does the solver satisfy this equation? Complementarity holds up to the gap:
# $w|s| - \lambda \cdot s \le$ 1e-8. If $\lambda$ has the length $w$ and a small angle $\theta$ to $s$, the left side is
# $w|s|(1 - \cos\theta) \approx w|s|\theta^2/2$. So $\theta$ is at most 2e-4 if $w = 0.5$ and $|s| = 1$.

# %%
along, turned = np.zeros((4, 2)), np.zeros((4, 2))
along[0], turned[0] = (1.2, 0.0), (1.6 * np.cos(np.pi / 3), 1.6 * np.sin(np.pi / 3))
first, force_1 = step_in_the_plane(along, np.zeros((4, 2)))
second, force_2 = step_in_the_plane(turned, first)
assert np.linalg.norm(first - np.column_stack([by_hand, np.zeros(4)])) < allowed
for _slip, _force in ((first, force_1), (second - first, force_2)):
    assert (np.linalg.norm(_force, axis=1) <= w + 4 * allowed).all()
    assert (w * np.linalg.norm(_slip, axis=1) - np.sum(_force * _slip, axis=1) < 4e-8).all()
assert np.linalg.norm((second - first)[0]) > 0.3
print("slips of the second step\n", np.round(second - first, 4) + 0.0)
_directions = np.degrees(np.arctan2(*(second - first)[:3].T[::-1]))
assert np.abs(_directions - [77, 60, 47]).max() < 0.5

# %% [markdown]
# For each block the picture shows the disc, the force $\lambda_i$ in it, and the direction of the slip (dashed).
# **Question:** in the second step block 1 is pulled at 60 degrees, but slips at 77 degrees. Why not at 60 degrees? And
# would the sum of absolute values, $|s_x| + |s_y|$, lead to the same picture?
#
# <details><summary>Answer</summary>
#
# Friction takes the part of the pull that the springs do not carry. The spring to block 2 is still stretched along $x$
# from the first step and carries $(0.69, 0.90)$, at 52 degrees. Friction takes the rest of the pull $(0.80, 1.39)$.
# This rest is $(0.11, 0.49)$, at 77 degrees, and the block slips in this direction. Blocks 2 and 3 slip at 60 and 47
# degrees, each in the direction of the sum of its two spring forces.
#
# The sum of absolute values leads to another picture. Each component of the force then has its own bound, and the disc
# becomes a square. A block that slips forward in $x$ and $y$ has its force in a corner of the square, $(0.5, 0.5)$. The
# force is at 45 degrees whatever the direction of the slip, and $\sqrt 2$ times as long as in the disc.
#
# </details>


# %% jupyter={"source_hidden": true}
# Picture: for each block the disc of admissible forces, the force of friction in it, and the direction of the slip
def discs_picture():
    figure, panels = plt.subplots(2, 4, figsize=(8.4, 4.6), layout="constrained")
    steps = ((first, force_1, "along x"), (second - first, force_2, "turned"))
    for row, (slip, force_now, words) in zip(panels, steps, strict=True):
        for i, axes in enumerate(row):
            slides = np.linalg.norm(slip[i]) > allowed
            axes.add_patch(plt.Circle((0, 0), w[i], facecolor="0.95", edgecolor="0.4"))
            if slides:
                direction = 0.7 * slip[i] / np.linalg.norm(slip[i])
                axes.plot(*np.transpose([(0, 0), direction]), "--", color="0.4", linewidth=1.0)
            colour = "tab:orange" if slides else "tab:blue"
            axes.plot(*np.transpose([(0, 0), force_now[i]]), color=colour, linewidth=2)
            axes.plot(*force_now[i], "o", color=colour)
            axes.set(xlim=(-0.75, 0.75), ylim=(-0.75, 0.75), aspect="equal", xticks=[], yticks=[])
            axes.set_title(f"block {i + 1} {'slides' if slides else 'sticks'}", fontsize="medium")
        row[0].set_ylabel(f"pull {words}")
    figure.suptitle(r"force $\lambda_i$ in its disc; dashed: direction of the slip")
    plt.close(figure)
    return figure


discs_picture()

# %% [markdown]
# ## 4. The same program in the package
#
# `vx.march` solves problems of this form. `march` takes a matrix, a load as a function of time, and the terms
# $w_i |s_i|$ (`vx.Norms`). `vx.Newton` is a semismooth Newton method (lesson 5), and `vx.Clarabel` is the
# interior-point method of section 1. Each answer has a *certificate*, a bound on its error in the energy norm (lesson
# 6). So the distance between the answer $u_N$ of Newton and the answer $u_C$ of Clarabel is at most the sum of both
# certificates:
#
# $$|u_N - u_C|_K \le \sqrt{2\,\mathrm{gap}_N} + \sqrt{2\,\mathrm{gap}_C}, \qquad |u|_K^2 = u^T K u .$$

# %%
system = vx.System(K, lambda time: time * f, vx.Norms(np.eye(4), w))
newton = vx.march(system, [0.0, 1.0], solver=vx.Newton())
clarabel = vx.march(system, [0.0, 1.0], solver=vx.Clarabel())
difference = newton.state[-1] - clarabel.state[-1]
apart = np.sqrt(difference @ K @ difference)
claimed = np.sqrt(2 * newton.gap[-1]) + np.sqrt(2 * clarabel.gap[-1])
assert apart <= claimed < 1e-5
assert np.allclose(newton.state[-1], by_hand, rtol=0, atol=1e-14)
assert np.allclose(newton.multipliers[-1, :, 0], [0.5, 0.5, 0.2, 0.0], rtol=0, atol=1e-14)
print("Newton   ", newton.state[-1])
print(f"the answers are {apart:.0e} apart; the certificates allow {claimed:.0e}")

# %% [markdown]
# ## Exercises
#
# 1. Pull the chain by $f = (1.2, 0, 0, 0)$, then let go. Which blocks move back, and how far? First compute the answer
#    by hand: a block moves back only if its springs pull it by more than 0.5. Then use `march` with the times 0, 1, 2.
# 2. Set $w = 0$. What remains of the program, of the dual, and of the answer?
# 3. Block 1 is pulled in one step from rest. At which pull does block 4 begin to move?
# 4. Replace the disc by the square $|\lambda_x|, |\lambda_y| \le w$, that is $|s|$ by $|s_x| + |s_y|$. Pull by 1.2 at
#    45 degrees. By which factor does the force of friction on block 1 grow? Why can a solver of quadratic programs now
#    solve this step?
# 5. The dual pair of the cone of block 3 is $(\xi_3, \zeta_3) = (0.5, -0.2)$. How does the least energy change if $w_3$
#    grows by 0.01? How does it change if block 3 starts at $u_{prev,3} = 0.01$?
#
# Solutions: `lesson_2_solutions.py`.
