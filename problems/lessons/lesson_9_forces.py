# %% [markdown]
"""# Lesson 9, forces instead of displacements: the dual program of a step as a projection, by cvxpy and by Uzawa"""

# %% [markdown]
# *You need:* the dual of one slider (lesson 1) and the gap (lesson 6). *You will see:* that friction is a projection,
# that we may compute forces first and displacements afterwards, and that forces and displacements approach the same
# optimum from two sides.
#
# A step of friction has the stiffness $K$, the load $f$ and the friction bounds $w_i$. As in lesson 6, it minimises
# over the slips $s$
#
# $$P(s) = \tfrac12 s^T K s - f^T s + \sum_i w_i |s_i| .$$
#
# This lesson computes the forces $\lambda_i$ of friction first. Each $|\lambda_i|$ is at most $w_i$, and the rest of
# the load $f$ moves the body. We take the eight contact nodes of the block of lesson 6 again, in a step in which some
# nodes slip and some stick.

# %%
import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx


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
K, f, w = step.operators.K, step.g, step.w
EPS = np.finfo(float).eps
print(f"{np.count_nonzero(step.answer.d)} of {len(f)} nodes slip")
assert 0 < np.count_nonzero(step.answer.d) < len(f)

# %% [markdown]
# ## 1. The dual is a projection
#
# Write $w_i|s_i| = \max_{|\lambda_i| \le w_i} \lambda_i s_i$, exchange minimum and maximum, and minimise over $s$,
# which gives $Ks = f - \lambda$. A program in the forces alone remains,
#
# $$\max_{|\lambda_i| \le w_i}\; D(\lambda) = -\tfrac12 (f - \lambda)^T K^{-1} (f - \lambda) .$$
#
# So $\lambda$ is **the point of the box $|\lambda_i| \le w_i$ that is nearest to $f$** in the norm of the flexibility
# $K^{-1}$. If $f$ lies in the box, friction carries the whole load, and nothing moves. Otherwise the rest $f - \lambda$
# moves the body.
#
# The dual has no kinks and no displacements. In cvxpy the dual takes three lines.

# %%
forces = cp.Variable(len(f))
dual = cp.Problem(cp.Maximize(-0.5 * cp.quad_form(f - forces, cp.psd_wrap(np.linalg.inv(K)))), [cp.abs(forces) <= w])
dual.solve(solver="CLARABEL")
lam = np.clip(forces.value, -w, w)
s = np.linalg.solve(K, f - lam)
certificate = step.certify(s, lam)
distance = np.sqrt((s - step.answer.d) @ K @ (s - step.answer.d))
print(f"relative errors of s: certified {certificate.error / step.norm:.0e}, true {distance / step.norm:.0e}")
known = step.certificate.error + step.certificate.error_floor
assert distance <= certificate.error + certificate.error_floor + known

# %% [markdown]
# **The two optima are equal.** For all admissible $\lambda$ and all $s$,
#
# $$D(\lambda) \le D(\lambda^*) = P(s^*) \le P(s) .$$
#
# $D$ approaches the optimum from below, and $P$ from above. The difference $P(s) - D(\lambda)$ is the gap.


# %%
def above(s):
    """Return P(s)."""
    return 0.5 * s @ K @ s - f @ s + w @ np.abs(s)


def below(lam):
    """Return D(lam)."""
    return -0.5 * (f - lam) @ np.linalg.solve(K, f - lam)


rounding = 10 * len(f) * EPS * np.linalg.cond(K) * (f @ np.linalg.solve(K, f))  # 10 times the rounding of P and D
best = above(step.answer.d)
print(f"P of the best slips  {best:.12f}\nD of the best forces {below(lam):.12f}")
# The certificate replaces slips by zero if they are as small as rounding, so its gap may be smaller than P - D.
assert certificate.gap <= above(s) - below(lam) + rounding
assert below(lam) <= best + rounding
assert best <= above(s) + rounding

# %% [markdown]
# **Question:** Halve all friction bounds. Does the optimal value of the dual rise or fall, and why is this clear
# without any computation?
#
# <details><summary>Answer</summary>
#
# The optimal value falls. The function $D$ does not change, and the new box is a part of the old box: a maximum over
# fewer $\lambda$ is not larger. Here the maximum is smaller, because the old optimum lies outside the new box. The
# least energy $P(s^*)$ is equal to the maximum of $D$, so the least energy falls as well.
#
# </details>
#
# ## 2. Moreau's decomposition
#
# The projection splits $f = \lambda + Ks$, with $\lambda$ in the box and $s$ normal to the box at $\lambda$. For a
# single node $K$ is a number, and
#
# $$\lambda = \mathrm{clip}(f, -w, w), \qquad K s = f - \lambda = \mathrm{sign}(f)\,(|f| - w)_+ .$$
#
# The two functions of $f$ are the projection onto an interval and the *soft threshold* of statistics. With many nodes
# the matrix $K$ couples the nodes. The work of friction is
#
# $$\lambda^T s = \sum_i w_i |s_i| .$$

# %%
stiffness, loads = 3.0, np.linspace(-2, 2, 41)
soft = np.sign(loads) * np.maximum(np.abs(loads) - 0.8, 0.0)
assert np.abs(loads - np.clip(loads, -0.8, 0.8) - soft).max() <= 2 * EPS
nodes = vx.System(stiffness * np.eye(41), lambda t: t * loads, vx.Norms(np.eye(41), np.full(41, 0.8)))
moved = vx.march(nodes, [0.0, 1.0])
assert np.abs(stiffness * moved.state[-1] - soft).max() <= 1e-8 * np.abs(loads).max()
friction = step.answer.lam[:, 0] @ step.answer.d
assert abs(friction - w @ np.abs(step.answer.d)) <= step.certificate.gap + rounding

# %% [markdown]
# ## 3. Uzawa's method: guess the forces, find the slips
#
# The gradient of $D$ is $K^{-1}(f - \lambda) = s(\lambda)$, the slips under the forces $\lambda$.
#
# Guess the forces of friction, and solve a *linear* elastic problem with these forces. Wherever a node slips, increase
# the force of friction against the slip, up to its bound. Repeat:
#
# $$\lambda \leftarrow \mathrm{clip}\bigl(\lambda + \rho\, s(\lambda), -w, w\bigr), \qquad \rho = \kappa_1 ,$$
#
# where $\kappa_1 \le \dots \le \kappa_m$ are the eigenvalues of $K$. This is the projected gradient method. In
# mechanics it is called Uzawa's method.
#
# *Why this* $\rho$*?* The solution satisfies $\lambda^* = \mathrm{clip}(\lambda^* + \rho\, s(\lambda^*), -w, w)$.
# Subtract the equation for $\lambda^*$ from the equation of the iteration. Clipping does not increase distances, and
# $s(\lambda) - s(\lambda^*) = -K^{-1} (\lambda - \lambda^*)$. So after the iteration the error of the forces is at most
# as long as the vector
#
# $$(I - \rho K^{-1}) (\lambda - \lambda^*) .$$
#
# Along the $i$-th eigenvector of $K$ the error is multiplied by $1 - \rho/\kappa_i$. The smallest factor,
# $1 - \rho/\kappa_1$, belongs to the softest direction. This factor is negative for $\rho > \kappa_1$. For
# $\rho > 2 \kappa_1$ it is less than $-1$, and the iteration need not converge. With $\rho = \kappa_1$ all factors lie
# between 0 and
#
# $$q = 1 - \kappa_1/\kappa_m ,$$
#
# and *every* iteration multiplies the error of the forces by $q$ or less.
#
# Nesterov's acceleration needs one more line of code. The acceleration saves few iterations on coarse meshes, and many
# on fine meshes (exercise 3).

# %%
least, *_, largest = np.linalg.eigvalsh(K)
q = 1 - least / largest
exact = step.answer.lam[:, 0]


def uzawa(iterations, accelerated):
    """Return the forces after every iteration."""
    now, extrapolated, found = np.zeros_like(f), np.zeros_like(f), []
    for count in range(iterations):
        following = np.clip(extrapolated + least * np.linalg.solve(K, f - extrapolated), -w, w)
        extrapolated = following + (count / (count + 3) * (following - now) if accelerated else 0.0)
        now = following
        found.append(now)
    return np.array(found)


plain, fast = uzawa(60, False), uzawa(60, True)
errors = np.linalg.norm(plain - exact, axis=1)
print(f"q = {q:.3f}; largest factor in 20 iterations {(errors[1:20] / errors[:19]).max():.3f}")
assert (errors[1:] <= q * errors[:-1] + 1e-13 * np.linalg.norm(f)).all()


def bracket(found):
    """Return the values below and above the optimum after every iteration."""
    slips = np.linalg.solve(K, (f - found).T).T
    return np.array([below(lam) for lam in found]), np.array([above(s) for s in slips])


for _found in (plain, fast):
    _low, _high = bracket(_found)
    assert (_low <= best + rounding).all()
    assert (best <= _high + rounding).all()

# %% jupyter={"source_hidden": true}
# Picture: the values of both programs, which close in on the optimum, and the gap between the values, over iterations
_figure, (_left, _right) = plt.subplots(1, 2, figsize=(9.4, 3.8), layout="constrained")
for _found, _colour, _words in ((plain, "tab:blue", "Uzawa"), (fast, "tab:orange", "accelerated")):
    _low, _high = bracket(_found)
    _left.plot(np.arange(1, 16), 1e3 * _high[:15], "-", color=_colour, label=f"{_words}: slips, above")
    _left.plot(np.arange(1, 16), 1e3 * _low[:15], "--", color=_colour, label=f"{_words}: forces, below")
    _gap = np.maximum(_high - _low, rounding)
    _right.semilogy(np.arange(1, 61), _gap, "-", color=_colour, label=f"{_words}: gap")
_left.axhline(1e3 * best, color="black", linewidth=0.8)
_left.set(xlabel="iteration", ylabel="value of the program (1e-3)", title="one optimum, from two sides")
_right.set(xlabel="iteration", ylabel="gap (energy)", title="speed of convergence")
for _axes in (_left, _right):
    _axes.grid(color="0.9")
    _axes.legend(frameon=False, fontsize=8)
plt.close(_figure)
_figure

# %% [markdown]
# ## 4. Only the flexibility matters
#
# The dual contains only $K^{-1}$, the flexibility of the contact nodes. Let $K_{all}$ be the stiffness of all unknowns
# of the mesh, and let the matrix $B$ select the contact unknowns. The flexibility is
#
# $$G = B K_{all}^{-1} B^T = K^{-1} .$$
#
# Column $i$ of $G$ contains the displacements of all contact nodes under a unit force at node $i$. We compute $G$ from
# the program on all unknowns, and check that $G$ is the inverse of the condensed stiffness $K$.

# %%
full = next(vx.programs(scene, mesh, [0.0, 1.0], condense=False))
B = full.operators.B.toarray()
flexibility = B @ np.linalg.solve(full.operators.K.toarray(), B.T)
deviation = np.abs(flexibility @ K - np.eye(len(f))).max()
print(f"{full.operators.K.shape[0]} unknowns, {len(f)} at the contact; G K = I up to {deviation:.0e}")
assert deviation <= 100 * EPS * np.linalg.cond(full.operators.K.toarray())

# %% [markdown]
# So measured flexibilities suffice to solve frictional contact. The contact may slip only where $|\lambda_i| = w_i$.

# %%
history = vx.simulate(scene, mesh, [0.0, 1.0])
order = np.argsort(history.contact.points[:, 0])
traction = history.contact.traction[-1, order, 0]
bounds = history.contact.bound[-1, order]
sticks = history.contact.sticking[-1, order]
print("friction / bound", np.round(traction / bounds, 2))

# %% jupyter={"source_hidden": true}
# Picture: friction along the contact within its bounds; it is at the bound where the contact slips
_figure, _axes = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
_x = history.contact.points[order, 0]
_axes.fill_between(_x, -bounds, bounds, facecolor="0.9", edgecolor="0.45", label="the box: admissible friction")
_axes.plot(_x, traction, "-", color="tab:green", linewidth=1.2)
_kinds = ((~sticks, "tab:orange", "slips: on the boundary"), (sticks, "tab:blue", "sticks: inside"))
for _chosen, _colour, _words in _kinds:
    _axes.plot(_x[_chosen], traction[_chosen], "o", color=_colour, label=_words)
_axes.set(xlabel="$x$ (length)", ylabel="friction (force per length)", title="the nearest point of the box")
_axes.grid(color="0.9")
_axes.legend(fontsize=8, framealpha=1.0)
plt.close(_figure)
_figure

# %% [markdown]
# **Question:** Uzawa's method solves many linear problems, Newton's method (lesson 5) only a few. When is Uzawa's
# method still the better choice? (Think of a matrix $K$ that is too large for a factorisation.)
#
# <details><summary>Answer</summary>
#
# Newton's method needs the entries of $K$: it solves a system with the block of $K$ for the slipping nodes, and this
# block changes in every iteration. Uzawa's method only needs $K^{-1}$ times a vector, with the same $K$ in every
# iteration. So Uzawa's method is the better choice where $K$ is too large to be factorised. Uzawa's method also works
# with an elastic code that returns displacements for loads, and with measured flexibilities.
#
# </details>
#
# ## Exercises
#
# 1. By which factor can you scale $f$ until the first node slips? Derive the factor from the dual, and check the factor
#    with `march`.
# 2. A one-sided wall, $s_i \le e_i$, has the multiplier $p_i \ge 0$. Derive the dual of $\min \tfrac12 s^TKs - f^Ts$
#    subject to $s \le e$. Solve the dual by projected gradients for $p$, and compare the answer with the answer for
#    `vx.Limits`.
# 3. Refine the mesh: how do $q$ and the number of iterations for a gap of $10^{-6}$ grow with the number $n$ of cells
#    across, with and without acceleration?
# 4. Show that $D$ is strictly concave, so the forces are unique. If two friction terms act on one node, $B$ has two
#    equal rows. What remains unique?
#
# Solutions: `lesson_9_solutions.py`.
