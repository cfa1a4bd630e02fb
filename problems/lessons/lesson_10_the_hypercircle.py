# %% [markdown]
"""# Lesson 10, the hypercircle: two admissible fields, the solution on the circle between them, and error bars"""

# %% [markdown]
# *You need:* energy norms and weak forms; the gap of a step (lesson 6); error estimates (lesson 7). *You will see:* a
# bound of the error from any two admissible fields, without the solution; the bound with friction; and the function
# `vx.error_bound`, which computes the bound for a body and an interval for a displacement.
#
# A certificate (lesson 6) bounds the distance of an answer to the solution *on the same mesh*. A residual estimate
# measures the error of the mesh, but contains an unknown constant. In 1947 Prager and Synge found a bound without an
# unknown constant.
#
# ## 1. A net of springs
#
# A net of springs is held along one side, and its nodes move out of the plane by $u_i$. A spring from node $i$ to node
# $j$ is stretched by $u_i - u_j$. The vector $\varepsilon(u)$ of all stretches causes the forces $\sigma$, which
# balance the load $f$:
#
# $$\sigma = \mathbb C\, \varepsilon(u), \qquad \varepsilon^T \sigma = f.$$
#
# Here $\mathbb C$ contains the stiffnesses of the springs, and the matrix $\varepsilon^T$ sums up the forces at each
# node. The stiffness matrix of the net is $K = \varepsilon^T \mathbb C\, \varepsilon$.
#
# There are two sets of admissible fields:
#
# $$\begin{gathered} \text{displacements } v \text{ that are zero where the net is held,} \\
# \text{forces } \tau \text{ in equilibrium, } \varepsilon^T \tau = f . \end{gathered}$$
#
# The forces of $v$ need not balance the load, and $\tau$ need not belong to a displacement. Only the solution satisfies
# both conditions: $u$ is an admissible displacement, and $\sigma = \mathbb C\, \varepsilon(u)$ are admissible forces.
# The norm of forces is $|\tau|^2 = \tau^T \mathbb C^{-1} \tau$, the norm of displacements is $|v|^2 = v^T K v$. So
# $|v| = |\mathbb C\, \varepsilon(v)|$.

# %%
import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx

rng = np.random.default_rng(1)
side = 6
number = np.arange(side * side).reshape(side, side)
first = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
second = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
springs = np.arange(len(first))
stretch_all = np.zeros((len(springs), side * side))
stretch_all[springs, first], stretch_all[springs, second] = 1.0, -1.0
stretch = stretch_all[:, side:]  # the matrix of epsilon; the first row of nodes is held
C = rng.uniform(0.5, 2.0, len(springs))
K = stretch.T @ (C[:, None] * stretch)
f = rng.normal(size=stretch.shape[1])
u = np.linalg.solve(K, f)


def force(v):
    """Return C epsilon(v), the forces that displacements cause."""
    return C * (stretch @ v)


sigma = force(u)


def norm(tau):
    """Return the norm of forces: the root of twice the energy that they store."""
    return np.sqrt(np.sum(tau**2 / C))


unloaded = np.linalg.svd(stretch.T)[2][len(u) :]  # states of force without a load, one per row


def admissible(scale_v, scale_tau):
    """Return an admissible displacement and admissible forces, with random errors of the given sizes."""
    v = u + scale_v * rng.normal(size=len(u))
    return v, sigma + scale_tau * rng.normal(size=len(unloaded)) @ unloaded


v, tau = admissible(0.5, 0.5)
print(f"{len(springs)} springs, {len(u)} nodes that move, {len(unloaded)} states of force without a load")
assert np.allclose(stretch.T @ tau, f)

# %% [markdown]
# ## 2. The circle
#
# The difference of two admissible forces, $\sigma - \tau$, is in equilibrium without a load, and does no work on any
# admissible displacement. So $\sigma - \tau$ and $\mathbb C\, \varepsilon(u - v)$ are orthogonal in the norm of forces.
# Pythagoras' theorem says
#
# $$|u - v|^2 + |\sigma - \tau|^2 = |\delta|^2, \qquad \delta = \tau - \mathbb C\, \varepsilon(v) .$$
#
# The difference $\delta$ contains neither $u$ nor $\sigma$. By Thales' theorem, $\sigma$ lies on the circle whose
# diameter is the segment from $\mathbb C\, \varepsilon(v)$ to $\tau$.

# %%
pairs = [admissible(scale, scale * ratio) for scale in (0.02, 0.1, 0.5, 2.0) for ratio in np.geomspace(0.2, 20.0, 12)]
legs = []
for _v, _tau in pairs:
    _diameter = norm(_tau - force(_v))
    _error_v, _error_tau = norm(force(u - _v)), norm(sigma - _tau)
    assert abs(_error_v**2 + _error_tau**2 - _diameter**2) < 1e-12 * _diameter**2
    legs.append((_error_v / _diameter, _error_tau / _diameter))
legs = np.array(legs)

# %% jupyter={"source_hidden": true}
# Picture: for 48 pairs of fields the solution lies on a circle whose diameter joins the pair; errors lie below bounds
_figure, (_left, _right) = plt.subplots(1, 2, figsize=(9.4, 4.4), layout="constrained")
_angle = np.linspace(0.0, 2.0 * np.pi, 200)
_left.plot(0.5 + 0.5 * np.cos(_angle), 0.5 * np.sin(_angle), color="black", linewidth=1.2)
# C epsilon(v) is at (0, 0), tau at (1, 0); the two errors do not determine on which side of the segment sigma lies.
_x = legs[:, 0] ** 2
_y = legs[:, 0] * legs[:, 1]
_left.plot(_x, _y, "o", color="tab:blue", markersize=4, label="solution, for 48 pairs of fields")
_k = int(np.argmin(np.abs(_x - 0.6)))
_left.plot([0.0, _x[_k], 1.0], [0.0, _y[_k], 0.0], color="tab:green", linewidth=1.4, label="a right angle")
_left.plot([0.0, 1.0], [0.0, 0.0], "s-", color="tab:orange", markersize=7, label="two admissible fields")
_left.plot([0.5], [0.0], "x", color="tab:orange", markersize=8, label="their mean")
_left.annotate(r"$\mathbb{C}\,\varepsilon(v)$", (0.0, 0.0), (-0.2, -0.11))
_left.annotate(r"$\tau$", (1.0, 0.0), (1.04, -0.09))
_left.annotate("$|u - v|$", (0.5 * _x[_k], 0.5 * _y[_k]), (0.5 * _x[_k] + 0.02, 0.5 * _y[_k] - 0.08))
_left.annotate(r"$|\sigma - \tau|$", (0.5 + 0.5 * _x[_k], 0.5 * _y[_k]), (0.26 + 0.5 * _x[_k], 0.5 * _y[_k] + 0.06))
_left.set(aspect="equal", xlim=(-0.3, 1.35), ylim=(-0.6, 0.95), xticks=[], yticks=[])
_left.set_title(r"the hypercircle, drawn with $|\delta| = 1$")
_left.legend(frameon=False, fontsize=8, loc="upper left")
_bounds = [norm(_tau - force(_v)) for _v, _tau in pairs]
_right.loglog(_bounds, legs[:, 0] * _bounds, "o", color="tab:blue", markersize=4, label="error $|u - v|$")
_right.loglog(_bounds, _bounds, "-", color="black", label=r"bound $|\delta|$")
_right.set(xlabel="bound", ylabel="error", title="a bound for good fields and bad ones")
_right.grid(color="0.9")
_right.legend(frameon=False, fontsize=8)
plt.close(_figure)
_figure

# %% [markdown]
# **Question:** The bound $|u - v| \le |\delta|$ holds for *every* $\tau$ in equilibrium. When is the bound close to the
# error? How does a large error of $\tau$ change the bound?
#
# <details><summary>Answer</summary>
#
# The bound is the hypotenuse of a right triangle whose legs are the errors of $v$ and $\tau$. So the bound is close if
# the error of $\tau$ is small. If the error of $\tau$ is large, the bound still holds, but it is large. If both legs
# are equal, the bound is $\sqrt 2$ times the error. For a bound of 1.1 times the error, the error of $\tau$ must be
# less than half of the error of $v$.
#
# </details>
#
# ## 3. The displacement of one node
#
# We are interested in one quantity, $Q(u) = u_i$ for one node $i$. Let $z$ be the solution of the same net under a unit
# force at this node. This second problem has admissible fields $v_z$ and $\tau_z$, and a second circle. The product of
# two forces is $(\sigma, \tau) = \sigma^T \mathbb C^{-1} \tau$. Then
# $Q(u - v) = (\mathbb C\,\varepsilon(u - v),\, \mathbb C\,\varepsilon(z))$.
#
# The force $\sigma$ lies on the first circle, and $\mathbb C\,\varepsilon(z)$ lies on the second. Let
# $\delta_z = \tau_z - \mathbb C\,\varepsilon(v_z)$. The centres of both circles determine a value $m$. The radii bound
# the difference between $Q(u)$ and $m$:
#
# $$\begin{gathered} \big|\, Q(u) - m \,\big| \le \tfrac12\, |\delta|\,|\delta_z| , \\
# m = Q(v) + f^T v_z - (\mathbb C\,\varepsilon(v), \mathbb C\,\varepsilon(v_z)) + \tfrac12 (\delta, \delta_z) .
# \end{gathered}$$

# %%
node = 17
unit = np.eye(len(u))[node]
z = np.linalg.solve(K, unit)


def product(one, other):
    return np.sum(one * other / C)


widths = []
for _scale in (0.4, 0.2, 0.1, 0.05):
    _v, _tau = admissible(_scale, _scale)
    _v_z = z + _scale * rng.normal(size=len(u))
    _tau_z = force(z) + _scale * rng.normal(size=len(unloaded)) @ unloaded
    _delta, _delta_z = _tau - force(_v), _tau_z - force(_v_z)
    _m = _v[node] + f @ _v_z - product(force(_v), force(_v_z)) + 0.5 * product(_delta, _delta_z)
    widths.append(0.5 * norm(_delta) * norm(_delta_z))
    print(f"errors of size {_scale}: u_i = {u[node]:.4f} lies in {_m:.4f} ± {widths[-1]:.4f}")
    assert abs(u[node] - _m) <= widths[-1]
# If the errors of the fields are halved, the interval has about a quarter of its length.
assert widths[0] / widths[-1] > 40

# %% [markdown]
# ## 4. Friction
#
# Now friction acts at every node, with the bounds $w_i$: $u$ minimises $\tfrac12 v^T K v - f^T v + \sum_i w_i |v_i|$.
# The admissible forces are now pairs $(\tau, \lambda)$ with $\varepsilon^T \tau = f - \lambda$ and
# $|\lambda_i| \le w_i$. The bound now has an additional term $\Phi$, the second part of the gap of lesson 6:
#
# $$\Phi = \sum_i (w_i |v_i| - \lambda_i v_i) \;\ge\; 0 , \qquad
#   |u - v|^2 \le (\delta,\, \mathbb C\,\varepsilon(u - v)) + \Phi .$$
#
# By the Cauchy-Schwarz inequality and the formula for quadratic equations,
#
# $$|u - v| \le \tfrac12 |\delta| + \sqrt{\tfrac14 |\delta|^2 + \Phi} .$$
#
# The solution $\sigma$ lies in a ball with the centre of the circle. The square root is the radius of this ball.

# %%
w = rng.uniform(0.2, 1.0, len(u))
slip = cp.Variable(len(u))
cp.Problem(cp.Minimize(0.5 * cp.quad_form(slip, cp.psd_wrap(K)) - f @ slip + w @ cp.abs(slip))).solve(solver="CLARABEL")
exact = slip.value
ratios = []
for _scale in np.repeat([0.01, 0.1, 1.0], 20):
    _v = exact + _scale * rng.normal(size=len(u))
    _lam = np.clip(f - K @ exact + _scale * rng.normal(size=len(u)), -w, w)
    _tau = force(np.linalg.solve(K, f - _lam)) + _scale * rng.normal(size=len(unloaded)) @ unloaded
    _phi, _diameter = w @ np.abs(_v) - _lam @ _v, norm(_tau - force(_v))
    assert _phi >= 0.0
    ratios.append((_diameter / 2 + np.sqrt(_diameter**2 / 4 + _phi)) / norm(force(exact - _v)))
n_stick = np.sum(np.abs(exact) < 1e-6)
print(f"{n_stick} of {len(u)} nodes stick; bound over error {min(ratios):.2f} ... {max(ratios):.2f}")
# The error of Clarabel's answer is below a millionth.
assert min(ratios) > 1.0 - 1e-4
assert min(ratios) < 1.5

# %% [markdown]
# **Question:** Which $\lambda$ makes $\Phi = 0$? Why is this $\lambda$ not always the best choice?
#
# <details><summary>Answer</summary>
#
# Every term of $\Phi$ vanishes if $\lambda_i = w_i \operatorname{sign} v_i$ at all nodes with $v_i \ne 0$. But these
# forces obey the friction law for the *wrong* displacement $v$, and the forces $\tau$ that balance them may be far from
# $\sigma$. The multipliers of the computed answer make both $|\delta|$ and $\Phi$ small.
#
# </details>
#
# ## 5. A body
#
# A mesh provides admissible displacements $v$ directly. Stresses in equilibrium need more work. We split every cell
# into triangles. On each triangle the components of the stress $\tau$ are polynomials, and the tractions of two
# triangles agree on the common edge. With the body force $f$ the stress satisfies
#
# $$\mathrm{div}\, \tau + f = 0 .$$
#
# Among the stresses of one polynomial degree, `vx.error_bound` finds the stress with the smallest bound. The bound is
# for the distance to the solution of the *body*, not to the solution on the mesh.

# %%


def block():
    def pull(x, t):
        return t * np.column_stack([8 * (1.25 - x[:, 1]), np.full(len(x), -0.01)])

    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    )


mean = vx.Traction((1.0, 0.0), on="left")  # its work is the mean displacement of the side, which has length 1
bounds = {}
for n in (3, 6, 12):
    history = vx.simulate(block(), vx.meshes.squares(n), [0.0, 1.0])
    bounds[n] = vx.error_bound(history, step=-1), vx.error_bound(history, step=-1, of=mean)
    error, side_mean = bounds[n]
    print(f"n = {n:2d}: error {error.lower:.3f} ... {error.upper:.3f}; mean in {side_mean.low:.5f} ... "
          f"{side_mean.high:.5f}")  # fmt: skip
    assert error.lower < error.upper < 1.3 * error.lower
# All intervals contain the exact mean, so they overlap.
assert max(one.low for _, one in bounds.values()) < min(one.high for _, one in bounds.values())
assert bounds[12][0].upper < 0.6 * bounds[3][0].upper

# %% [markdown]
# So the error in the energy norm has an upper and a lower bound, without a finer mesh. For $n = 12$ the upper bound is
# 14 per cent above the lower bound.
#
# **Question:** A colleague's residual estimate of the error for $n = 12$ is 0.018, and the lower bound is 0.022. Can
# the estimate be right?
#
# <details><summary>Answer</summary>
#
# No: the error is at least 0.022, so the estimate is too small. The lower bound detects the wrong estimate, and no
# reference solution is needed.
#
# </details>
#
# ## Exercises
#
# 1. Show that the error of the mean of both fields, $\tfrac12(\tau + \mathbb C\,\varepsilon(v))$, is exactly half the
#    bound.
# 2. The complementary energy $-\tfrac12 |\tau|^2$ is below the least energy $\tfrac12 |u|^2 - f^T u$, and the energy of
#    any $v$ is above the least energy. How does the energy of $v$ minus the complementary energy depend on the circle?
# 3. Add to $\tau$ the state of force without a load for which the bound is smallest. How large is this bound?
# 4. How much do nodes slip at most? Use $\sum_i (w_i - |\lambda_i|) |u_i| \le \tfrac14 |\delta|^2 + \Phi$. What does
#    this prove about nodes that stick in the answer?
#
# Solutions: `lesson_10_solutions.py`.
