# %% [markdown]
"""# Lesson 2, four nodes: ten lines of cvxpy, and what the dual of a cone means"""

# %% [markdown]
# This lesson goes on from one slider to a chain of four. It writes the same program with vectors, in ten lines of
# cvxpy; it says what a conic solver returns beside the positions, and which part of that is a force; and it goes from
# the line to the plane, where an absolute value becomes a length and the cone shows its shape.
#
# Equation numbers are those of Feng, Han and Huang; lesson 1 derives the program for one slider.

# %%
import cvxpy as cp
import numpy as np
from matplotlib.patches import Circle

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import OUTLINE, SLIP, STICK

# %% [markdown]
# ## 1. Ten lines
#
# Four blocks in a row, joined by springs of stiffness one; the last is tied to a wall, the first is pulled. Block $i$
# has its own friction bound $w_i$. A step (2.34) from $u_{prev}$ is, as in lesson 1,
#
# $$\min_u \; \tfrac12 u^T K u - f^T u + \sum_i w_i\, |u_i - u_{prev,i}|, \qquad
#   K = \begin{pmatrix} 1 & -1 \\ -1 & 2 & -1 \\ & -1 & 2 & -1 \\ & & -1 & 2 \end{pmatrix}.$$
#
# A finite element model of a body on a rough floor is this with a larger $K$; nothing else is different.
#
# A conic program has a linear objective (here: quadratic) and *cones* for constraints. Each absolute value becomes a
# variable $t_i$ and one cone, $|u_i - u_{prev,i}| \le t_i$; the minimum pushes $t_i$ down onto it.

# %%
K = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
w = np.array([0.5, 0.5, 0.5, 0.5])
f = np.array([1.2, 0.0, 0.0, 0.0])
u_prev = np.zeros(4)

u, t = cp.Variable(4), cp.Variable(4)
cones = [cp.SOC(t[i], cp.reshape(u[i] - u_prev[i], (1,), order="F")) for i in range(4)]
energy = 0.5 * cp.quad_form(u, K) - f @ u + w @ t
problem = cp.Problem(cp.Minimize(energy), cones)
problem.solve(solver="CLARABEL")
print("positions", np.round(u.value, 6) + 0.0)

# %% [markdown]
# **By hand.** Blocks 1 and 2 slide forward, so friction takes .5 from each. On the first block 1.2 - .5 is what the
# first spring must carry, .7; on the second .7 - .5 = .2 is left for the second spring. The third block holds .2 with
# its own friction and does not move. So $u_3 = u_4 = 0$, $u_2 = .2$, $u_1 = .2 + .7 = .9$.
#
# How near should the solver come? Clarabel stops when the gap is 1e-8, and the gap is *linear* in a slip that should be
# zero (lesson 6), $w_i |s_i|$: a slip of 2e-8 and, in the energy norm, an error of $\sqrt{2 \cdot 10^{-8}} \approx$
# 1.4e-4. The smallest eigenvalue of $K$ is .12, so 4.1e-4 in the positions at worst.

# %%
by_hand = np.array([0.9, 0.2, 0.0, 0.0])
allowed = np.sqrt(2e-8 / np.linalg.eigvalsh(K).min())
assert np.linalg.norm(u.value - by_hand) < allowed
print(f"by hand   {by_hand}, {np.linalg.norm(u.value - by_hand):.0e} apart, {allowed:.0e} allowed")

# %% [markdown]
# ## 2. The dual, and which part of it is a force
#
# As in lesson 1, write $w_i|s_i| = \max_{|\lambda_i| \le w_i} \lambda_i s_i$ with the slip $s = u - u_{prev}$, and
# exchange minimum and maximum:
#
# $$\max_{|\lambda_i| \le w_i} \min_u \; \tfrac12 u^TKu - f^Tu + \lambda^T(u - u_{prev})
#   \;=\; \max_{|\lambda_i| \le w_i} -\tfrac12 (f - \lambda)^T K^{-1} (f - \lambda) - \lambda^T u_{prev}.$$
#
# The inner minimum is at $K u = f - \lambda$: the multiplier is the force that friction takes. Where it stays below the
# bound the block sticks; where the block slides, $\lambda_i = w_i\,\mathrm{sign}(s_i)$. The force *on* the block is
# $-\lambda_i$, against the slip.
#
# **What the solver returns** for the cone $|s_i| \le t_i$ is a pair $(\tau_i, z_i)$ in the *dual cone*, all pairs with
# $\tau t + z s \ge 0$ for every $(t, s)$ in the cone: again $|z_i| \le \tau_i$. Its Lagrangian subtracts $\tau_i t_i +
# z_i s_i$. Stationarity in $t_i$ gives $w_i - \tau_i = 0$: **the first component is the bound**. Stationarity in $u$
# gives $Ku - f - z = 0$, so $z_i = -\lambda_i$: **the second is the force on the block**; mind the minus. And
# complementarity $\tau_i t_i + z_i s_i = 0$ says: full friction against the slip, or no slip.

# %%
tau = np.array([cone.dual_value[0].item() for cone in cones])
lam = np.array([-cone.dual_value[1].item() for cone in cones])
# An error e in u is K e in the forces, and no eigenvalue of K exceeds 4 (Gershgorin).
assert np.abs(tau - w).max() < 4 * allowed
assert np.abs(lam - [0.5, 0.5, 0.2, 0.0]).max() < 4 * allowed
assert np.abs(lam - (f - K @ u.value)).max() < 4 * allowed
print("friction takes", np.round(lam, 6) + 0.0, "of", w)
print("f - K u       ", np.round(f - K @ u.value, 6) + 0.0, "(the same: forces balance)")

# %% [markdown]
# The dual is a program in its own right: a quadratic in a box, the blocks' forces its unknowns. Solve it as such, and
# positions come out as *its* multipliers. (Lesson 9 starts here.) **Question:** why does block 4 not even notice that
# block 1 is pulled?
#
# <details><summary>Answer</summary>
#
# Block 3 sticks, $u_3 = 0$, so the spring between blocks 3 and 4 keeps its length and carries no force. Block 4 is in
# balance without friction: $\lambda_4 = f_4 - (Ku)_4 = 0$. A block that sticks is a wall to what lies behind it.
#
# </details>

# %%
force = cp.Variable(4)
flexibility = np.linalg.inv(K)
balance = -0.5 * cp.quad_form(f - force, flexibility) - u_prev @ force
dual = cp.Problem(cp.Maximize(balance), [cp.abs(force) <= w])
dual.solve(solver="CLARABEL")
# Both objectives are within 1e-8 (absolute and relative) of the common optimum.
assert abs(dual.value - problem.value) < 4e-8
assert np.linalg.norm(flexibility @ (f - force.value) - by_hand) < allowed
print(f"least energy {problem.value:.8f}, best lower bound {dual.value:.8f}")


# %% jupyter={"source_hidden": true}
def chain_picture():
    figure = new_figure(7.0, 3.4)
    above, below = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [1, 1.5]})
    rest = np.array([4.5, 3.0, 1.5, 0.0])
    now, colours = rest + by_hand, [SLIP if moves else STICK for moves in by_hand > 0]
    above.plot([-1.0, now[0]], [0, 0], color="0.6", linewidth=1.0)
    above.plot([-1.0, -1.0], [-0.5, 0.5], color="black", linewidth=3)
    above.scatter(rest, np.zeros(4), s=200, facecolor="white", edgecolor=OUTLINE, marker="s", zorder=2)
    above.scatter(now, np.zeros(4), s=200, color=colours, marker="s", zorder=3)
    above.annotate("pull", (6.4, 0), (5.6, 0), arrowprops={"arrowstyle": "->"}, va="center")
    above.set(yticks=[], xlim=(-1.2, 6.6), ylim=(-1, 1), title="the step: orange slides, blue sticks")
    below.bar(rest, 2 * w, 0.6, bottom=-w, facecolor="none", edgecolor=OUTLINE, label=r"$|\lambda_i| \leq w_i$")
    below.bar(rest, lam, 0.6, color=colours)
    below.set(ylabel=r"force $\lambda_i$", xticks=rest, xticklabels=[f"block {i}" for i in (1, 2, 3, 4)])
    light_grid(below, axis="y")
    below.legend(frameon=False, loc="lower right")
    return figure


chain_picture()

# %% [markdown]
# ## 3. From the line to the plane: the cone gets its shape
#
# Now the four blocks stand on a table, and each may slide in both directions of the plane: $u_i \in \mathbb{R}^2$, the
# springs alike in $x$ and $y$. $|s_i|$ is a length, $\{|s_i| \le t_i\}$ is the ice-cream cone, and $\lambda_i$ is a
# vector in a **disc** of radius $w_i$. In the program, `(1,)` becomes `(2,)`:


# %%
def step_in_the_plane(pull, before):
    position, length = cp.Variable((4, 2)), cp.Variable(4)
    discs = [cp.SOC(length[i], position[i] - before[i]) for i in range(4)]
    stored = 0.5 * sum(cp.quad_form(position[:, a], K) for a in range(2))
    least = cp.Problem(cp.Minimize(stored - cp.sum(cp.multiply(pull, position)) + w @ length), discs)
    least.solve(solver="CLARABEL")
    return position.value, -np.array([np.ravel(disc.dual_value[1]) for disc in discs])


# %% [markdown]
# Pull first along $x$, as before, then turn the pull by 60 degrees and let it grow a little. Where a block slides,
# $\lambda_i = w_i s_i/|s_i|$: on the rim, in the direction of the slip *of this step*, whatever it was before. Where it
# sticks, $\lambda_i$ is anywhere in the disc.
#
# How exactly? Complementarity holds up to the gap: $w|s| - \lambda \cdot s \le$ 1e-8. With $\lambda$ of length $w$
# at an angle $\phi$ from $s$, the left side is $w|s|(1 - \cos\phi) \approx w|s|\phi^2/2$, and as much is granted.

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

# %% [markdown]
# The picture: the disc of each block, in it the force $\lambda_i$ that friction takes, beside it the direction of the
# slip. **Question:** in the second step block 1 is pulled at 60 degrees, but friction on it acts at 77 degrees. Why not
# at 60? And could an absolute value for each component ($|s_x| + |s_y|$) give the same picture?
#
# <details><summary>Answer</summary>
#
# Friction takes what the springs leave of the pull. The spring to block 2 is still stretched along $x$ from the first
# step and carries (.69, .90), at 52 degrees; of the pull (.80, 1.39) this leaves (.11, .49), at 77 degrees, and the
# block slips that way. Blocks 2 and 3 slip at 60 and 47 degrees, each along what its own two springs leave.
#
# No. With $|s_x| + |s_y|$ every component of the force has a bound of its own, and the disc becomes a square. A block
# that slips in both components has its force in a corner of the square, $(.5, .5)$: at 45 degrees whatever the way of
# the slip, and $\sqrt 2$ times as long.
#
# </details>


# %% jupyter={"source_hidden": true}
def discs_picture():
    figure = new_figure(8.4, 4.6)
    panels = figure.subplots(2, 4)
    steps = ((first, force_1, "along x"), (second - first, force_2, "turned"))
    for row, (slip, force_now, words) in zip(panels, steps, strict=True):
        for i, axes in enumerate(row):
            slides = np.linalg.norm(slip[i]) > allowed
            axes.add_patch(Circle((0, 0), w[i], facecolor="0.95", edgecolor=OUTLINE))
            if slides:
                way = 0.7 * slip[i] / np.linalg.norm(slip[i])
                axes.plot(*np.transpose([(0, 0), way]), "--", color="0.4", linewidth=1.0)
            colour = SLIP if slides else STICK
            axes.plot(*np.transpose([(0, 0), force_now[i]]), color=colour, linewidth=2)
            axes.plot(*force_now[i], "o", color=colour)
            axes.set(xlim=(-0.75, 0.75), ylim=(-0.75, 0.75), aspect="equal", xticks=[], yticks=[])
            axes.set_title(f"block {i + 1} {'slides' if slides else 'sticks'}", fontsize="medium")
        row[0].set_ylabel(f"pull {words}")
    figure.suptitle(r"$\lambda_i$ in its disc; dashed: the way of the slip")
    return figure


discs_picture()

# %% [markdown]
# ## 4. The same from the package
#
# `vx.march` takes any such problem: a matrix, a load as a function of time, and the norm terms. Newton is a semismooth
# Newton method written by hand (lesson 5), Clarabel the interior-point method from above: about as different as two
# solvers can be. Each answer has a *certificate*, a bound on its error in the energy norm (lesson 6), so two answers
# may be apart by no more than both together.

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
print(f"the two are {apart:.0e} apart, and claim to be within {claimed:.0e}")

# %% [markdown]
# ## Exercises
#
# 1. Pull the chain by $f = (1.2, 0, 0, 0)$, then let go. Which blocks move back, and how far? By hand first: nothing
#    moves back unless a spring pulls a block by more than .5. (`march` with times 0, 1, 2.)
# 2. Set $w = 0$. What is left of the program, of the dual, and of the answer?
# 3. By which pull does block 4 begin to move? (From rest, one step.)
# 4. Replace the disc by the square $|\lambda_x|, |\lambda_y| \le w$, that is $|s|$ by $|s_x| + |s_y|$. Pull at 45
#    degrees by 1.2. How much more friction is there than with the disc? Why can a solver of quadratic programs take
#    part now, and not before?
# 5. The dual value of the cone of block 3 is $(.5, -.2)$. By how much does the least energy change if $w_3$ grows by
#    .01? If block 3 had started at $u_{prev,3} = .01$?
#
# Solutions: `lesson_2_solutions.py`.
