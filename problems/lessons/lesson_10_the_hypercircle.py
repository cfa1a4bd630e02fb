# %% [markdown]
"""# Lesson 10, the hypercircle: two admissible fields, the truth on the circle between them, and error bars"""

# %% [markdown]
# *You need:* energy norms and weak forms; the gap of a step (lesson 6); what an estimate is (lesson 7). *You will
# see:* an error that is known although the truth is not, from any two fields that are admissible, good or bad; what
# friction changes; and bounds for a body, its energy, and a displacement that one would measure.
#
# A certificate (lesson 6) says how far an answer is from the best one *on its mesh*. How far the mesh is from the body
# no residual estimate says for certain: it has a constant that nobody knows. In 1947 Prager and Synge saw that one
# needs none.
#
# ## 1. A net of springs
#
# A net of springs is fixed at its left side; its nodes move out of the plane by $u_i$. A spring from $i$ to $j$ is
# stretched by $u_i - u_j$, all together by $Bu$, and pulls with $s = c\,Bu$. Two sets of fields are admissible:
#
# $$\text{displacements } v \text{ that are zero where the net is held,} \qquad
# \text{forces } \tau \text{ in equilibrium, } B^T \tau = f .$$
#
# The first need no equilibrium, the second no displacement that they belong to. Both are easy to find; the truth,
# $\sigma = c\,Bu$, is what is in both.

# %%
import cvxpy as cp
import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, EXACT, SECOND, THIRD

rng = np.random.default_rng(1)
side = 6
number = np.arange(side * side).reshape(side, side)
springs = np.concatenate([np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
                          np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)])  # fmt: skip
every = np.zeros((len(springs), side * side))
every[np.arange(len(springs)), springs[:, 0]] = 1.0
every[np.arange(len(springs)), springs[:, 1]] = -1.0
B = every[:, side:]  # the first row of nodes is held
c = rng.uniform(0.5, 2.0, len(springs))
K = B.T @ (c[:, None] * B)
f = rng.normal(size=B.shape[1])
u = np.linalg.solve(K, f)
sigma = c * (B @ u)


def size(s):
    """The norm of forces: the root of twice the energy that they store."""
    return np.sqrt(np.sum(s**2 / c))


states = np.linalg.svd(B.T)[2][B.shape[1] :]  # forces that balance without a load, one a row


def admissible(of_displacement, of_forces):
    """A displacement and forces, admissible both, and otherwise as wrong as one likes."""
    v = u + of_displacement * rng.normal(size=len(u))
    return v, sigma + of_forces * rng.normal(size=len(states)) @ states


v, tau = admissible(0.5, 0.5)
print(f"{len(springs)} springs, {len(u)} nodes that move, {len(states)} states of stress without a load")
assert np.allclose(B.T @ tau, f)

# %% [markdown]
# ## 2. The circle
#
# Work of forces that balance without a load is zero on every admissible displacement, so that
# $\sigma - \tau$ and $c\,B(u - v)$ are orthogonal in the norm of the springs. Pythagoras:
#
# $$|u - v|^2 + |\sigma - \tau|^2 = |\tau - c\,Bv|^2 .$$
#
# The right side has no $u$ and no $\sigma$. Thales knew the picture: whoever sees the segment from $c\,Bv$ to $\tau$
# under a right angle stands on the circle over it.

# %%
pairs = [admissible(far, far * ratio) for far in (0.02, 0.1, 0.5, 2.0) for ratio in np.geomspace(0.2, 20.0, 12)]
seen = []
for one_v, one_tau in pairs:
    known = size(one_tau - c * (B @ one_v))
    of_v, of_tau = size(c * (B @ (u - one_v))), size(sigma - one_tau)
    assert abs(of_v**2 + of_tau**2 - known**2) < 1e-12 * known**2
    seen.append((of_v / known, of_tau / known))
seen = np.array(seen)

# %% jupyter={"source_hidden": true}
_figure = new_figure(9.4, 4.4)
_left, _right = _figure.subplots(1, 2)
_angle = np.linspace(0.0, 2.0 * np.pi, 200)
_left.plot(0.5 + 0.5 * np.cos(_angle), 0.5 * np.sin(_angle), color=EXACT, linewidth=1.2)
# From c B v at (0, 0) and tau at (1, 0) the truth is as far as these say; above the line or below, nobody knows.
_x = seen[:, 0] ** 2
_y = seen[:, 0] * seen[:, 1]
_left.plot(_x, _y, "o", color=COMPUTED, markersize=4, label="the truth, of 48 pairs of fields")
_k = int(np.argmin(np.abs(_x - 0.6)))
_left.plot([0.0, _x[_k], 1.0], [0.0, _y[_k], 0.0], color=THIRD, linewidth=1.4, label="a right angle")
_left.plot([0.0, 1.0], [0.0, 0.0], "s-", color=SECOND, markersize=7, label="two admissible fields")
_left.plot([0.5], [0.0], "x", color=SECOND, markersize=8, label="their mean")
_left.annotate("$c\\,Bv$", (0.0, 0.0), (-0.15, -0.09))
_left.annotate("$\\tau$", (1.0, 0.0), (1.04, -0.09))
_left.annotate("$|u - v|$", (0.5 * _x[_k], 0.5 * _y[_k]), (0.5 * _x[_k] + 0.02, 0.5 * _y[_k] - 0.08))
_left.annotate("$|\\sigma - \\tau|$", (0.5 + 0.5 * _x[_k], 0.5 * _y[_k]), (0.26 + 0.5 * _x[_k], 0.5 * _y[_k] + 0.06))
_left.set(
    aspect="equal", xlim=(-0.3, 1.35), ylim=(-0.6, 0.95), title="the hypercircle, diameter 1", xticks=[], yticks=[]
)
_left.legend(frameon=False, fontsize=8, loc="upper left")
_far = [size(_tau - c * (B @ _v)) for _v, _tau in pairs]
_right.loglog(_far, seen[:, 0] * _far, "o", color=COMPUTED, markersize=4, label="error of the displacement")
_right.loglog(_far, _far, "-", color=EXACT, label="bound, $|\\tau - c\\,Bv|$")
_right.set(xlabel="bound", ylabel="error", title="a bound for good fields and bad ones")
light_grid(_right)
_right.legend(frameon=False, fontsize=8)
_figure

# %% [markdown]
# **Question:** The bound holds for *every* $\tau$ in equilibrium. When is it close, and what does a bad $\tau$ cost?
#
# <details><summary>Answer</summary>
#
# The bound exceeds the error by the error of $\tau$: the excess is the other leg of the right angle. A bad $\tau$
# never makes the bound false, it makes it large. If both legs are alike, the bound is $\sqrt 2$ times the error; to
# have 1.1 the stress must be twice as near to the truth as the displacement. So one spends work on $\tau$, and can stop
# at any time.
#
# </details>
#
# ## 3. A number that one would measure
#
# One node is to be known, $q(u) = u_k$. Let $z$ solve the same net under a unit force on that node, with a
# circle of its own. The truth of the first is on its circle, that of the second on the other, and $q(u - v) =
# (c\,B(u - v),\, c\,Bz)$ is a product of both. With $r = \tau - c\,Bv$ and $r_z$ the same of $z$ it differs from what
# the centres of the circles give by the product of the radii at most:
#
# $$\big|\, q(u) - m \,\big| \le \tfrac12\, |r|\,|r_z| , \qquad
# m = q(v) + f\cdot v_z - (c\,Bv, c\,Bv_z) + \tfrac12 (r, r_z) .$$

# %%
watched = 17
unit = np.eye(len(u))[watched]
z = np.linalg.solve(K, unit)


def product(one, other):
    return np.sum(one * other / c)


widths, offs = [], []
for far in (0.4, 0.2, 0.1, 0.05):
    near_v, near_tau = u + far * rng.normal(size=len(u)), sigma + far * rng.normal(size=len(states)) @ states
    v_z, tau_z = z + far * rng.normal(size=len(u)), c * (B @ z) + far * rng.normal(size=len(states)) @ states
    r, r_z = near_tau - c * (B @ near_v), tau_z - c * (B @ v_z)
    middle = near_v[watched] + f @ v_z - product(c * (B @ near_v), c * (B @ v_z)) + 0.5 * product(r, r_z)
    widths.append(0.5 * size(r) * size(r_z))
    offs.append(abs(u[watched] - middle))
    print(f"fields off by {far}: u_k = {u[watched]:.4f} is in {middle:.4f} ± {widths[-1]:.4f}")
    assert offs[-1] <= widths[-1]
# Half the error of the fields, a quarter of the interval.
assert widths[0] / widths[-1] > 40

# %% [markdown]
# ## 4. Friction
#
# Now every node rubs, by $w_i$ at most: $u$ minimises $\tfrac12 v^T K v - f^T v + \sum_i w_i |v_i|$. Forces are
# admissible with friction $|\lambda_i| \le w_i$ and $B^T \tau = f - \lambda$. What the pair lacks of the law,
#
# $$b = \sum_i w_i |v_i| - \lambda_i v_i \;\ge\; 0 , \qquad |u - v|^2 \le (\tau - c\,Bv,\, c\,B(u - v)) + b ,$$
#
# is added, and with $A = |\tau - c\,Bv|$ it follows that $|u - v| \le A/2 + \sqrt{A^2/4 + b}$. The circle has become
# a ball: the truth is on it or inside.

# %%
w = rng.uniform(0.2, 1.0, len(u))
slip = cp.Variable(len(u))
cp.Problem(cp.Minimize(0.5 * cp.quad_form(slip, cp.psd_wrap(K)) - f @ slip + w @ cp.abs(slip))).solve(solver="CLARABEL")
rubbed = slip.value
ratios = []
for off in (0.01, 0.1, 1.0):
    for _ in range(20):
        tried = rubbed + off * rng.normal(size=len(u))
        lam = np.clip(f - K @ rubbed + off * rng.normal(size=len(u)), -w, w)
        tau_l = c * (B @ np.linalg.solve(K, f - lam)) + off * rng.normal(size=len(states)) @ states
        lacking = w @ np.abs(tried) - lam @ tried
        A = size(tau_l - c * (B @ tried))
        ratios.append((A / 2 + np.sqrt(A**2 / 4 + lacking)) / size(c * (B @ (rubbed - tried))))
        assert lacking >= 0.0
print(
    f"{np.sum(np.abs(rubbed) < 1e-6)} of {len(u)} nodes stick; bound over error {min(ratios):.2f} ... {max(ratios):.2f}"
)
# Clarabel's own error is below a millionth.
assert min(ratios) > 1.0 - 1e-4
assert min(ratios) < 1.5  # good pairs have good bounds

# %% [markdown]
# **Question:** Which friction $\lambda$ makes $b = 0$? Why is it not always the best choice?
#
# <details><summary>Answer</summary>
#
# $\lambda_i = w_i \operatorname{sign} v_i$, where $v_i$ is not zero: then every term of $b$ vanishes. But these forces
# are the law's answer to a *wrong* displacement, and the stress that balances them may be far from the truth. The best
# pair makes $A$ and $b$ small together; the multipliers of the answer do so, since they belong to nearly the right
# displacement.
#
# </details>
#
# ## 5. A body
#
# A mesh makes conforming displacements $v$ easily. Stresses in equilibrium take work: on every triangle of every cell,
# with tractions that go on from cell to cell. `vx.error_bound` makes the best that there are (of a kind), and says how
# far the *body's* answer can be, up to the corners where stress is infinite.

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


mean = vx.Traction((1.0, 0.0), on="left")  # its work is the mean displacement of the side, which is one unit long
found = {}
for n in (3, 6, 12):
    history = vx.simulate(block(), vx.meshes.squares(n), [0.0, 1.0])
    found[n] = vx.error_bound(history, step=-1), vx.error_bound(history, step=-1, of=mean)
    error, side_mean = found[n]
    print(f"n = {n:2d}: error {error.lower:.3f} ... {error.upper:.3f}; mean in {side_mean.low:.5f} ... "
          f"{side_mean.high:.5f}")  # fmt: skip
    assert error.lower < error.upper < 1.3 * error.lower
# Intervals that are theorems have the truth in common.
assert max(one.low for _, one in found.values()) < min(one.high for _, one in found.values())
assert found[12][0].upper < 0.6 * found[3][0].upper

# %% [markdown]
# The error is known within a few per cent from both sides, and no finer mesh was computed. The interval of the mean
# supposes nothing of what sticks and what slips: with friction that costs width.
#
# **Question:** A colleague's residual estimate for $n = 12$ says 0.018, the lower bound says 0.022. Who is right?
#
# <details><summary>Answer</summary>
#
# The bound: the error is 0.022 at least, by a theorem, so the estimate is too small, whatever it was calibrated on.
# This is what lower bounds are for: they find estimates that are wrong without a reference. Had the estimate been
# larger than the upper bound, it would merely be wasteful.
#
# </details>
#
# ## Exercises
#
# 1. Show that the mean of both fields, $\tfrac12(\tau + c\,Bv)$, is off by half the bound exactly, and check it.
# 2. The complementary energy $-\tfrac12 |\tau|^2$ is below $J(u) = \tfrac12 |u|^2 - f \cdot u$, the energy of any $v$
#    above. How are the two and the circle related?
# 3. Improve a bad $\tau$: add the state of stress without a load that makes the bound least. What is left?
# 4. How much slips, at most? From $\sum_i (w_i - |\lambda_i|) |u_i| \le A^2/4 + b$ say what is certain about nodes
#    that seem to stick, and what is not.
#
# Solutions: `lesson_10_solutions.py`.
