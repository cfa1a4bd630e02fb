# %% [markdown]
"""# Lesson 1, one slider: a variational inequality by hand, its convex program, and the dual program"""

# %% [markdown]
# *You need:* convex functions of one variable, and their derivatives. *You will see:* an inequality where you expect an
# equation, a convex program with the same solution, and its dual, whose unknown is the force of friction.
#
# A block on a rough table is attached to a spring and pulled by a force.
#
# Equation numbers refer to Feng, Han and Huang, *A virtual element method for a quasistatic frictional contact
# problem*. Run the cells in order; their assertions check the text.

# %%
import matplotlib.pyplot as plt
import numpy as np

# %% [markdown]
# ## 1. The inequality
#
# The block is at the position $u$. The spring has the stiffness $K$ and is relaxed at $u = 0$. A force $f(t)$ pulls the
# block. Friction takes the part $\lambda$ of this force, and $|\lambda|$ is at most the *friction bound* $w$.
# **Question:** the block rests at $u = 0$, and the pull grows slowly from zero. What is $\lambda$ before the block
# moves?
#
# <details><summary>Answer</summary>
#
# The block rests at $u = 0$ and the spring carries no force, so friction takes the whole pull: $\lambda = f$. Friction
# can take the whole pull while $|f| \le w$. At rest, the balance of forces determines the force of friction.
#
# </details>


# %% jupyter={"source_hidden": true}
# Picture: a block on a rough table; a spring ties it to a wall, the force f pulls it, friction takes the force lambda
def block_and_spring():
    figure, axes = plt.subplots(figsize=(7.0, 2.3), layout="constrained")
    axes.plot([0, 0], [0, 1.5], color="black", linewidth=3)
    for height in np.linspace(0.1, 1.4, 8):
        axes.plot([-0.15, 0], [height - 0.15, height], color="black", linewidth=0.8)
    axes.plot([0, 7.6], [0, 0], color="black", linewidth=2)
    for place in np.linspace(0.2, 7.6, 38):
        axes.plot([place - 0.15, place], [-0.15, 0], color="black", linewidth=0.8)
    coil = np.concatenate([[0, 0.4], np.linspace(0.5, 2.5, 15), [2.6, 3]])
    height = np.concatenate([[0, 0], 0.16 * np.resize([1, -1], 15), [0, 0]])
    axes.plot(coil, 0.5 + height, color="0.3", linewidth=1.5)
    axes.fill([3, 4.6, 4.6, 3], [0.02, 0.02, 1, 1], facecolor="tab:blue", edgecolor="black", alpha=0.5)
    axes.annotate("", (6.2, 0.6), (4.6, 0.6), arrowprops={"arrowstyle": "-|>", "linewidth": 2, "color": "black"})
    axes.annotate("", (2.5, 0.1), (3.8, 0.1), arrowprops={"arrowstyle": "-|>", "linewidth": 2, "color": "tab:orange"})
    axes.annotate("", (4.5, 1.25), (3.8, 1.25), arrowprops={"arrowstyle": "->", "color": "0.3"})
    axes.plot([3.8, 3.8], [1.05, 1.4], color="0.3", linewidth=1)
    words = [(1.5, 0.85, "spring $K$"), (6.3, 0.6, "pull $f$"), (4.6, 1.25, "position $u$")]
    for x, y, text in [*words, (0.62, 0.17, r"friction $\lambda$, at most $w$")]:
        axes.text(x, y, text, va="center", ha="center" if text.startswith("spring") else "left")
    axes.set(xlim=(-0.3, 7.7), ylim=(-0.25, 1.6), aspect="equal")
    axes.set_axis_off()
    plt.close(figure)
    return figure


block_and_spring()

# %% [markdown]
# The motion is slow, so we neglect inertia: the forces balance at every instant. While the block moves, $\lambda$ has
# the magnitude $w$ and the sign of the velocity:
#
# $$K u(t) + \lambda(t) = f(t), \qquad |\lambda| \le w,
#   \qquad \lambda = w\,\mathrm{sign}(\dot u) \text{ while } \dot u \ne 0.$$
#
# At rest $\lambda$ can have any value between $-w$ and $w$, so $\lambda$ is not a function of $u$ or $\dot u$.
#
# The two conditions on $\lambda$ are equivalent to one condition: $\lambda$ is a *subgradient* at $\dot u$ of the
# function $j(v) = w|v|$. This means that a line of slope $\lambda$ touches the graph of $j$ at $\dot u$ from below:
#
# $$j(v) \ge j(\dot u) + \lambda\,(v - \dot u) \qquad \text{for all velocities } v.$$
#
# The substitution $\lambda = f - Ku$ eliminates the force of friction. The paper writes $a(u, v)$ for $Kuv$. The result
# is the variational inequality (2.3):
#
# $$K u\,(v - \dot u) + j(v) - j(\dot u) \;\ge\; f\,(v - \dot u) \qquad \text{for all } v.$$

# %% [markdown]
# ## 2. One step in time, and the program
#
# Backward Euler replaces $\dot u$ by $(u - u_{prev})/k$, with the position $u_{prev}$ one time step $k$ earlier. We
# write the test velocity as $(v - u_{prev})/k$ with a position $v$. Then $k$ cancels (lesson 4), and the inequality
# (2.34) of one step is
#
# $$K u\,(v - u) + w|v - u_{prev}| - w|u - u_{prev}| \;\ge\; f\,(v - u) \qquad \text{for all } v.$$
#
# The inequality of a step holds if and only if $u$ minimises the energy
#
# $$P(u) = \tfrac12 K u^2 - f u + w\,|u - u_{prev}|,$$
#
# a parabola plus a term with a kink at the old position. *Proof.* $P$ is convex, so $u$ is its minimiser if and only if
# zero is a subgradient of $P$ at $u$. Equivalently, $f - Ku$ is a subgradient of $w|\cdot - u_{prev}|$ at $u$. This is
# the inequality. $\square$
#
# If the minimum of $P$ lies at the kink, the block sticks. If not, the derivative of $P$ vanishes at the minimum: at
# $u = (f - w)/K$ to the right of the kink, or at $u = (f + w)/K$ to the left. In all three cases $u$ is the old
# position, clipped:
#
# $$u = \mathrm{clip}\Bigl(u_{prev},\; \frac{f - w}{K},\; \frac{f + w}{K}\Bigr).$$

# %%
K, w = 2.0, 1.0


def primal(u, u_prev, f):
    return 0.5 * K * u**2 - f * u + w * np.abs(u - u_prev)


def step_by_hand(u_prev, f):
    """Return the minimiser: the old position, clipped."""
    return float(np.clip(u_prev, (f - w) / K, (f + w) / K))


# %% [markdown]
# Does the clipped position minimise $P$, and does it solve the inequality? We compare this position with 8001 other
# positions $v$. Differences below 1e-13 are rounding errors.

# %%
others = np.linspace(-4.0, 4.0, 8001)


def is_minimum(u, u_prev, f):
    return primal(u, u_prev, f) <= primal(others, u_prev, f).min() + 1e-13


def solves_the_inequality(u, u_prev, f):
    friction = w * np.abs(others - u_prev) - w * abs(u - u_prev)
    return bool((K * u * (others - u) + friction >= f * (others - u) - 1e-13).all())


cases = [(u_prev, f) for u_prev in (-1.0, 0.0, 0.7) for f in (-3.0, -0.4, 0.0, 1.9)]
assert all(is_minimum(step_by_hand(*case), *case) for case in cases)
assert all(solves_the_inequality(step_by_hand(*case), *case) for case in cases)
# A position that is wrong by 0.01 fails both tests.
assert not any(is_minimum(step_by_hand(*case) + 0.01, *case) for case in cases)
assert not any(solves_the_inequality(step_by_hand(*case) + 0.01, *case) for case in cases)
print(f"{len(cases)} steps by hand minimise the energy and solve the inequality")

# %% [markdown]
# The picture shows $P$ for three pulls, with $u_{prev} = 0$. While $|f| \le w$ the minimum stays at the kink.
# **Question:** which of the two one-sided slopes of $P$ at the kink decides when the block starts to move to the right,
# and what is its value?
#
# <details><summary>Answer</summary>
#
# The slope on the right, $P'(0^+) = w - f$. The block moves to the right as soon as this slope is negative, that is for
# $f > w$. The slope on the left, $-f - w$, is negative for all $f > -w$. This only shows that the block does not move
# to the left.
#
# </details>


# %% jupyter={"source_hidden": true}
# Picture: the energy P for three pulls, a parabola plus a kink; two minima lie at the kink, one lies to its right
def energies(pulls):
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    u = np.linspace(-0.8, 1.6, 400)
    for f, colour in zip(pulls, ("0.6", "tab:blue", "tab:orange"), strict=True):
        best = step_by_hand(0.0, f)
        axes.plot(u, primal(u, 0.0, f), color=colour, label=f"pull $f = {f:g}$: {'slips' if best else 'sticks'}")
        axes.plot(best, primal(best, 0.0, f), "o", color=colour)
    axes.set(xlabel="position $u$", ylabel="$P(u)$", ylim=(-1.1, 3.0), title="parabola plus kink; dots: minima")
    axes.grid(color="0.9")
    axes.legend(frameon=False)
    plt.close(figure)
    return figure


energies((0.0, 0.8, 2.6))

# %% [markdown]
# ## 3. The dual
#
# The term with the kink is a maximum of linear functions: with the slip $s = u - u_{prev}$ of the step,
#
# $$w|s| = \max_{|\lambda| \le w} \lambda s .$$
#
# The program of a step is a minimum over $u$ of a maximum over $\lambda$. We may exchange minimum and maximum, because
# the function is convex in $u$ and linear in $\lambda$, and the admissible $\lambda$ form a closed bounded interval:
#
# $$\begin{aligned} & \min_u \max_{|\lambda| \le w} \; \tfrac12 K u^2 - fu + \lambda (u - u_{prev}) \\
#   =\; & \max_{|\lambda| \le w} \min_u \; \tfrac12 K u^2 - (f - \lambda) u - \lambda u_{prev}. \end{aligned}$$
#
# The inner function of $u$ is now smooth, and its minimum lies where $K u = f - \lambda$. **The multiplier is the force
# that friction takes**, the $\lambda$ of section 1. At this $u$ the inner minimum is a function of $\lambda$, the *dual
# energy*
#
# $$D(\lambda) = -\frac{(f - \lambda)^2}{2K} - \lambda u_{prev} \quad\text{to be maximised over}\quad |\lambda| \le w.$$
#
# The parabola $D$ has its vertex at $f - K u_{prev}$, the force that holds the block where it is. If friction can take
# this force, the block sticks. If not, friction is at its bound. So the maximiser is again a clipped value:
#
# $$\lambda = \mathrm{clip}(f - K u_{prev},\; -w,\; w).$$


# %%
def dual(lam, u_prev, f):
    return -((f - lam) ** 2) / (2 * K) - lam * u_prev


def friction_by_hand(u_prev, f):
    return float(np.clip(f - K * u_prev, -w, w))


for _u_prev, _f in cases:
    _u, _lam = step_by_hand(_u_prev, _f), friction_by_hand(_u_prev, _f)
    _s = _u - _u_prev
    assert abs(K * _u - (_f - _lam)) < 1e-14, "the forces balance"
    assert abs(w * abs(_s) - _lam * _s) < 1e-14, "friction is w in the direction of the slip, or there is no slip"
    assert abs(primal(_u, _u_prev, _f) - dual(_lam, _u_prev, _f)) < 1e-13, "both programs have the same value"
print("in all cases: balance of forces, complementarity, and equal values of both programs")

# %% [markdown]
# ## 4. Any guess of the force bounds the energy from below
#
# For *every* $u$ and every $\lambda$ with $|\lambda| \le w$ we have $D(\lambda) \le P(u)$: a minimum of maxima is at
# least the maximum of minima. The difference $P(u) - D(\lambda)$ is the **gap**. The gap is zero if $u$ and $\lambda$
# solve their programs, and it bounds the distance to the solution $u^*$:
#
# $$\tfrac12 K (u - u^*)^2 \;\le\; P(u) - P(u^*) \;\le\; P(u) - D(\lambda).$$
#
# The first inequality holds because $P$ is $\tfrac12 Ku^2$ plus a convex function. So $P$ grows at least like this
# parabola away from its minimum. The right side does not contain $u^*$. This is the main idea of the package: every
# answer comes with a $\lambda$, and the gap certifies the answer.

# %%
rng = np.random.default_rng(0)
guesses = [(*cases[i % len(cases)], *rng.uniform((-2, -w), (2, w))) for i in range(300)]
for _u_prev, _f, _u, _lam in guesses:
    _gap = primal(_u, _u_prev, _f) - dual(_lam, _u_prev, _f)
    assert 0.5 * K * (_u - step_by_hand(_u_prev, _f)) ** 2 <= _gap + 1e-13
print(f"{len(guesses)} guesses of position and force: the gap bounds the error of each")

# %% [markdown]
# The picture shows both programs on one energy scale: $P$ over positions on the left, $D$ over forces on the right. The
# minimum of $P$ equals the maximum of $D$. **Question:** the block sticks in the upper row and slips in the lower row.
# How does the graph of $D$ show this?
#
# <details><summary>Answer</summary>
#
# In the lower graph the maximum is at the right end, $\lambda = w$. Friction is at its bound, and the block slips. The
# slope of $D$ at this end, $(f - \lambda)/K - u_{prev} = (1.8 - 1)/2 = 0.4$, is the slip. In the upper graph the
# maximum is in the interior, where the slope is zero: there is no slip.
#
# </details>


# %% jupyter={"source_hidden": true}
# Picture: the energy P over positions and the dual energy D over forces; the minimum of P is the maximum of D
def two_programs(pulls):
    figure, panels = plt.subplots(2, 2, sharey="row", sharex="col", figsize=(7.6, 5.2), layout="constrained")
    u, lam = np.linspace(-0.6, 1.2, 300), np.linspace(-w, w, 300)
    for (left, right), f in zip(panels, pulls, strict=True):
        best, force = step_by_hand(0.0, f), friction_by_hand(0.0, f)
        left.plot(u, primal(u, 0.0, f), color="tab:blue")
        right.plot(lam, dual(lam, 0.0, f), color="tab:orange")
        left.plot(best, primal(best, 0.0, f), "o", color="tab:blue", label=f"minimum at $u = {best:g}$")
        right.plot(force, dual(force, 0.0, f), "o", color="tab:orange", label=rf"maximum at $\lambda = {force:g}$")
        left.set(ylabel=f"pull $f = {f:g}$")
        for axes in (left, right):
            axes.axhline(primal(best, 0.0, f), color="0.5", linewidth=0.8)
            axes.grid(color="0.9")
            axes.legend(frameon=False)
    panels[0, 0].set_title("$P(u)$, energy of positions")
    panels[0, 1].set_title(r"$D(\lambda)$, dual energy of forces, $|\lambda| \leq w$")
    panels[1, 0].set_xlabel("position $u$")
    panels[1, 1].set_xlabel(r"force $\lambda$")
    plt.close(figure)
    return figure


two_programs((0.6, 1.8))

# %% [markdown]
# ## Exercises
#
# 1. For which pulls does a block at $u_{prev} = 0.7$ stay where it is? Check with `step_by_hand`.
# 2. Let $w = 0$. What remains of the inequality, of $P$, and of $D$?
# 3. Write the gap as a sum of two terms $\ge 0$. The first term vanishes if the forces balance, the second term if the
#    force of friction obeys its law.
# 4. The table is a belt that moves by $\Delta$ during the step. How do $P$, the clip and $D$ change?
# 5. Two blocks differ in their old positions only. Show that a step with the same pull does not increase their
#    distance.
#
# Solutions: `lesson_1_solutions.py`.
