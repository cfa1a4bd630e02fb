# %% [markdown]
"""# Lesson 9, forces instead of displacements: the dual program of a step, as a projection, by cvxpy and by Uzawa"""

# %% [markdown]
# *You need:* the dual of one slider (lesson 1) and the gap (lesson 6). *You will see:* that friction is a projection,
# that one can compute forces first and displacements afterwards, and that both ways reach the same optimum from two
# sides.
#
# A step of friction asks for increments $d$ of slip,
#
# $$\min_d\; P(d) = \tfrac12 d^T K d - g^T d + \sum_i w_i |d_i| .$$
#
# An engineer may ask instead: which forces $\lambda_i$ does friction carry? Each is at most $w_i$; what is left of
# $g$ moves the body. We take the eight contact nodes of the paper's block again, in the first step in which some slip
# and some stick.

# %%
import cvxpy as cp
import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, EXACT, SECOND, SLIP, STICK, THIRD


def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


scene = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(bound=4.0, on="bottom"),
)
mesh = vx.meshes.squares(8)
step = next(vx.programs(scene, mesh, [0.0, 1.0]))
K, g, w = step.operators.K, step.g, step.w
EPS = np.finfo(float).eps
print(f"{np.count_nonzero(step.answer.d)} of {len(g)} nodes slip")
assert 0 < np.count_nonzero(step.answer.d) < len(g)

# %% [markdown]
# ## 1. The dual is a projection
#
# Write $w_i|d_i| = \max_{|\lambda_i| \le w_i} \lambda_i d_i$, exchange min and max, and minimise over $d$: $Kd = g -
# \lambda$. What remains is a program in the forces alone,
#
# $$\max_{|\lambda_i| \le w_i}\; D(\lambda) = -\tfrac12 (g - \lambda)^T K^{-1} (g - \lambda) .$$
#
# Read it again: $\lambda$ is **the point of a box that is nearest to $g$**, with distances measured by the flexibility
# $K^{-1}$. If $g$ lies in the box, friction carries everything and nothing moves. If not, the part outside the box
# moves the body, in the directions in which that costs the least.
#
# There are no kinks left, and no displacements. In cvxpy these are three lines.

# %%
forces = cp.Variable(len(g))
dual = cp.Problem(cp.Maximize(-0.5 * cp.quad_form(g - forces, cp.psd_wrap(np.linalg.inv(K)))), [cp.abs(forces) <= w])
dual.solve(solver="CLARABEL")
lam = np.clip(forces.value, -w, w)
d = np.linalg.solve(K, g - lam)
judged = step.certify(d, lam)
distance = np.sqrt((d - step.answer.d) @ K @ (d - step.answer.d))
print(f"displacements from forces: certified to {judged.error / step.norm:.0e}, true error {distance / step.norm:.0e}")
assert distance <= judged.error + judged.error_floor + step.certificate.error + step.certificate.error_floor

# %% [markdown]
# **The two optima are equal.** $D(\lambda) \le D(\lambda^*) = P(d^*) \le P(d)$ for all admissible $\lambda$ and all
# $d$: forces approach the optimum from below, displacements from above, and the gap is what lies between.


# %%
def above(d):
    return 0.5 * d @ K @ d - g @ d + w @ np.abs(d)


def below(lam):
    return -0.5 * (g - lam) @ np.linalg.solve(K, g - lam)


blur = 10 * len(g) * EPS * np.linalg.cond(K) * (g @ np.linalg.solve(K, g))  # of the sums below, with a margin of 10
best = above(step.answer.d)
print(f"best displacements {best:.12f}\nbest forces        {below(lam):.12f}")
assert judged.gap <= above(d) - below(lam) + blur  # Where slips are rounding the certificate knows better.
assert below(lam) <= best + blur
assert best <= above(d) + blur

# %% [markdown]
# **Question:** Halve all bounds. In which direction does the dual optimum move, and why can you tell without solving
# anything?
#
# <details><summary>Answer</summary>
#
# Down. $D$ stays the same function, and half of the box is a part of the box: a maximum over fewer $\lambda$ is not
# larger. (It is smaller here, because the old optimum lies outside the new box.) So the least energy falls too, since
# both optima are equal: with less friction the body gives way more.
#
# </details>
#
# ## 2. Moreau
#
# Every projection splits what is projected: $g = \lambda + Kd$, with $\lambda$ in the box and $d$ pointing out of it.
# For a single node ($K = \kappa$, a number) the splitting is known by two names,
#
# $$\lambda = \mathrm{clip}(g, -w, w), \qquad \kappa\, d = g - \lambda = \mathrm{sign}(g)\,(|g| - w)_+ ,$$
#
# the projection onto an interval, and the *soft threshold* of statistics. That $d$ minimises $\tfrac12\kappa d^2 - gd +
# w|d|$, and that $\lambda$ is nearest to $g$, is one statement: Moreau's decomposition. With many nodes $K$ couples the
# thresholds, and the splitting is orthogonal between two bodies of the same kind: forces that friction can hold, and
# motions that friction resists, $\lambda^T d = \sum_i w_i |d_i|$.

# %%
kappa, one = 3.0, np.linspace(-2, 2, 41)
soft = np.sign(one) * np.maximum(np.abs(one) - 0.8, 0.0)
assert np.abs(one - np.clip(one, -0.8, 0.8) - soft).max() <= 2 * EPS
moved = vx.march(vx.System(kappa * np.eye(41), lambda t: t * one, vx.Norms(np.eye(41), np.full(41, 0.8))), [0.0, 1.0])
assert np.abs(kappa * moved.state[-1] - soft).max() <= 1e-8 * np.abs(one).max()
assert abs(step.answer.lam[:, 0] @ step.answer.d - w @ np.abs(step.answer.d)) <= step.certificate.gap + blur

# %% [markdown]
# ## 3. Uzawa: guess the forces, see where it slips
#
# The gradient of $D$ is $K^{-1}(g - \lambda) = d$: the slip that the guess would allow. So: guess the friction forces;
# solve a *linear* elastic problem under them; wherever a node slips, let friction push harder against it, up to its
# bound; repeat,
#
# $$\lambda \leftarrow \mathrm{clip}\bigl(\lambda + \rho\, d(\lambda), -w, w\bigr), \qquad \rho = \kappa_1 ,$$
#
# where $\kappa_1 \le \dots \le \kappa_m$ are the eigenvalues of $K$. This is projected gradients, and in mechanics
# Uzawa's method.
#
# *Why this step?* Subtract the solution, for which $\lambda^* = \mathrm{clip}(\lambda^* + \rho\, d(\lambda^*), -w, w)$.
# Clipping never increases distances, and $d(\lambda) - d(\lambda^*) = -K^{-1} (\lambda - \lambda^*)$, so the error
# after the iteration is at most as long as
#
# $$(I - \rho K^{-1}) (\lambda - \lambda^*) .$$
#
# Along the $i$-th eigenvector of $K$ the factor is $1 - \rho/\kappa_i$. The softest direction has the smallest:
# $1 - \rho/\kappa_1$, which is negative for $\rho > \kappa_1$ and less than $-1$ for $\rho > 2 \kappa_1$, where the
# iteration need not converge. With $\rho = \kappa_1$ all factors are between 0 and $q = 1 - \kappa_1/\kappa_m$: no
# direction is overshot, and the error of the forces shrinks to $q$ times itself or less in *every* iteration. (In words
# of optimisation: $\rho$ is one over the Lipschitz constant of the gradient, $|K^{-1}| = 1/\kappa_1$, as in lesson 5.)
#
# Nesterov's acceleration is one more line: far from the optimum it gains little, and on fine meshes more (exercise 3).

# %%
least, *_, largest = np.linalg.eigvalsh(K)
q = 1 - least / largest
exact = step.answer.lam[:, 0]


def uzawa(iterations, accelerated):
    """Forces after every iteration."""
    now, looked_at, seen = np.zeros_like(g), np.zeros_like(g), []
    for k in range(iterations):
        then = np.clip(looked_at + least * np.linalg.solve(K, g - looked_at), -w, w)
        looked_at = then + (k / (k + 3) * (then - now) if accelerated else 0.0)
        now = then
        seen.append(now)
    return np.array(seen)


plain, fast = uzawa(60, False), uzawa(60, True)
errors = np.linalg.norm(plain - exact, axis=1)
print(f"q = {q:.3f}; the slowest of the first iterations shrinks the error by {(errors[1:20] / errors[:19]).max():.3f}")
assert (errors[1:] <= q * errors[:-1] + 1e-13 * np.linalg.norm(g)).all()


def bracket(seen):
    """Values below and above the optimum after every iteration."""
    slips = np.linalg.solve(K, (g - seen).T).T
    return np.array([below(one) for one in seen]), np.array([above(one) for one in slips])


for _seen in (plain, fast):
    _low, _high = bracket(_seen)
    assert (_low <= best + blur).all()
    assert (best <= _high + blur).all()

# %% jupyter={"source_hidden": true}
_figure = new_figure(9.4, 3.8)
_left, _right = _figure.subplots(1, 2)
for _seen, _colour, _words in ((plain, COMPUTED, "Uzawa"), (fast, SECOND, "accelerated")):
    _low, _high = bracket(_seen)
    _left.plot(np.arange(1, 16), 1e3 * _high[:15], "-", color=_colour, label=f"{_words}: displacements, above")
    _left.plot(np.arange(1, 16), 1e3 * _low[:15], "--", color=_colour, label=f"{_words}: forces, below")
    _gap = np.maximum(_high - _low, blur)
    _right.semilogy(np.arange(1, 61), _gap, "-", color=_colour, label=f"{_words}: gap")
_left.axhline(1e3 * best, color=EXACT, linewidth=0.8)
_left.set(xlabel="iteration", ylabel="value of a program (1e-3 energy)", title="one optimum, from two sides")
_right.set(xlabel="iteration", ylabel="gap (energy)", title="how fast")
for _ax in (_left, _right):
    light_grid(_ax)
    _ax.legend(frameon=False, fontsize=8)
_figure

# %% [markdown]
# ## 4. Only the flexibility counts
#
# The dual never asks for $K$, only for $K^{-1}$ between contact nodes: the *flexibility* $C = B K^{-1} B^T$, column
# $i$ of which says how all contact nodes move under a unit force at node $i$. Take the program on all unknowns of the
# mesh, compute $C$, and compare with the stiffness that the package condensed.

# %%
full = next(vx.programs(scene, mesh, [0.0, 1.0], condense=False))
B = full.operators.B.toarray()
flexibility = B @ np.linalg.solve(full.operators.K.toarray(), B.T)
off = np.abs(flexibility @ K - np.eye(len(g))).max()
print(f"{full.operators.K.shape[0]} unknowns, {len(g)} at the contact; C K = 1 up to {off:.0e}")
assert off <= 100 * EPS * np.linalg.cond(full.operators.K.toarray())

# %% [markdown]
# So an engineer who *measures* flexibilities in the laboratory can solve frictional contact without any mesh. And
# forces are what one reads off first: where $|\lambda_i| = w_i$ the contact slips.

# %%
history = vx.simulate(scene, mesh, [0.0, 1.0])
order = np.argsort(history.contact.points[:, 0])
traction = history.contact.traction[-1, order, 0]
bounds = history.contact.bound[-1, order]
sticks = history.contact.sticking[-1, order]
print("friction over its bound", np.round(traction / bounds, 2))

# %% jupyter={"source_hidden": true}
_figure = new_figure(6.0, 3.6)
_ax = _figure.subplots()
_x = history.contact.points[order, 0]
_ax.fill_between(_x, -bounds, bounds, facecolor="0.9", edgecolor="0.45", label="the box: what friction can carry")
_ax.plot(_x, traction, "-", color=THIRD, linewidth=1.2)
for _chosen, _colour, _words in ((~sticks, SLIP, "slips: on the boundary"), (sticks, STICK, "sticks: inside")):
    _ax.plot(_x[_chosen], traction[_chosen], "o", color=_colour, label=_words)
_ax.set(xlabel="$x_1$ (length)", ylabel="friction on the body (force per length)", title="the nearest point of the box")
light_grid(_ax)
_ax.legend(fontsize=8, framealpha=1.0)
_figure

# %% [markdown]
# **Question:** Uzawa's method solves a linear problem in each of many iterations, Newton's method (lesson 5) in each
# of a few. When would you still take Uzawa? (Think of a $K$ that you cannot factorise but can apply.)
#
# <details><summary>Answer</summary>
#
# Newton's method solves with the block of $K$ of those nodes that slip, another block in every iteration, and wants its
# entries. Uzawa's method solves with one and the same $K$, and sees nothing of it but $K^{-1}$ times a vector. So take
# it where $K$ is too large to be factorised and systems with it are solved iteratively (conjugate gradients,
# multigrid), each beginning at the solution before; where an existing elastic code is a black box that answers loads
# with displacements; or where flexibilities were measured and there is no $K$ at all.
#
# </details>
#
# ## Exercises
#
# 1. How far can you scale $g$ until the first node slips? Derive the factor from the dual, and check it with `march`.
# 2. A one-sided wall, $d_i \le e_i$, has the multiplier $p_i \ge 0$. Derive the dual of $\min \tfrac12 d^TKd - g^Td$
#    subject to $d \le e$, solve it by projected gradients on $p$, and compare with `vx.Limits`.
# 3. Refine the mesh: how do $q$ and the number of iterations for a gap of $10^{-6}$ grow with $n$, with and without
#    acceleration?
# 4. Show that $D$ is strictly concave, so that forces are unique. Two friction terms act on one node ($B$ has two equal
#    rows): what is left of that?
#
# Solutions: `lesson_9_solutions.py`.
