# %% [markdown]
"""# Solutions to the exercises of lesson 11"""

# %%
import cvxpy as cp
import numpy as np

import vemcvx as vx

m = 6
K = 2.0 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
f, w = np.linspace(2.0, -0.7, m), np.linspace(0.6, 0.3, m)
times = np.linspace(0.0, 2.0, 33)

# %% [markdown]
# **1.** Let $s_n = u_n - u_{n-1}$ be the slips, $w$ the friction bounds, and $Q$ the friction work. The derivative of
# $Q$ has an explicit part and a part from the slips,
#
# $$dQ = \sum_n |s_n|^T dw + \sum_n w^T \mathrm{sign}(s_n)\, (du_n - du_{n-1}) .$$
#
# So $b_n$, the right side of the adjoint sweep in section 2 of the lesson, contains $w\,\mathrm{sign}(s_n)$ from step
# $n$, and $-w\,\mathrm{sign}(s_{n+1})$ from the next step. The explicit part is added at the end.


# %%
def march(bounds):
    system = vx.System(K, lambda t: np.sin(3 * t) * f, vx.Norms(np.eye(m), bounds))
    return vx.march(system, times, solver=vx.Newton(accuracy=1e-12))


def work(bounds):
    return np.sum(np.abs(np.diff(march(bounds).state, axis=0)) @ bounds)


run = march(w)
slips = np.where(run.sticking[1:], 0.0, np.diff(run.state, axis=0))
gradient, carried = np.abs(slips).sum(axis=0), np.zeros(2 * m)
for _sign in np.sign(slips)[::-1]:
    _stick = np.diag(1.0 * (_sign == 0))
    _M = np.block([[K, np.eye(m)], [_stick, np.eye(m) - _stick]])
    _z = np.linalg.solve(_M.T, carried + np.append(w * _sign, np.zeros(m)))
    gradient = gradient + _sign * _z[m:]
    carried = np.append(_stick @ _z[m:] - w * _sign, np.zeros(m))
quotients = np.array([(work(w + one) - work(w - one)) / 2e-6 for one in 1e-6 * np.eye(m)])
print(f"gradient {gradient.round(4)}, difference quotients {quotients.round(4)}")
assert np.abs(gradient - quotients).max() <= 1e-6 * np.abs(gradient).max()
assert (np.abs(slips).sum(axis=0) > 0).any()
assert np.abs(gradient - np.abs(slips).sum(axis=0)).max() > 0.1  # the explicit part alone is wrong

# %% [markdown]
# **2.** The unknowns are the force $\alpha$, two pressures and two friction forces. The balance has three rows:
# horizontal forces, vertical forces, and moments about the left edge. The multipliers of these rows are the motion. The
# footing slides if the force acts near the floor. In the dual solution the sliding footing rises by $\mu$ times its
# slip. If the force acts higher up, the footing tips about its right edge.

# %%
WIDTH, WEIGHT, FRICTION = 2.0, 3.0, 0.4


def footing(height):
    """Return the largest force at this height, and the motion of the left edge: right, up, and the rotation."""
    lam, p, alpha = cp.Variable(2), cp.Variable(2), cp.Variable()
    moment = WIDTH * (p[1] - WEIGHT / 2) - height * alpha
    balance = cp.hstack([alpha - cp.sum(lam), cp.sum(p) - WEIGHT, moment]) == 0
    cp.Problem(cp.Maximize(alpha), [balance, p >= 0, cp.abs(lam) <= FRICTION * p]).solve(solver="CLARABEL")
    return float(alpha.value), balance.dual_value


motions = []
for _height in (0.5, 5.0):
    _limit, _motion = footing(_height)
    motions.append(_motion)
    print(f"height {_height}: limit {_limit:.6f}, motion {_motion.round(4)}")
    assert abs(_limit - min(FRICTION * WEIGHT, WEIGHT * WIDTH / (2 * _height))) <= 1e-6
    assert abs(_motion[0] - _height * _motion[2] - 1) <= 1e-6  # the work of a unit force
slides, tips = motions
assert np.abs(slides - [1.0, FRICTION, 0.0]).max() <= 1e-6
assert abs(tips[1] + WIDTH * tips[2]) <= 1e-6  # the right edge does not move up
assert tips[1] > 0.1

# %% [markdown]
# **3.** The constant forces of the exercise can have any values, because $K$ is invertible. So the conditions on the
# two sliders are separate. Let $\bar\lambda_i$ be the constant forces, and $\lambda^e_i(t)$ the friction forces of a
# cycle without slip. The factor $\alpha$ multiplies the loads and these friction forces. Slider $i$ needs a point
# $-\bar\lambda_i/\alpha$ whose distance from all $\lambda^e_i(t)$ is at most $w_i/\alpha$. This point is the centre of
# a disc of radius $w_i/\alpha$ that contains all points $\lambda^e_i(t)$. Let $r_i$ be the radius of the smallest disc
# that contains these points. The disc of radius $w_i/\alpha$ exists if and only if $w_i/\alpha \ge r_i$. Therefore
#
# $$\alpha^* = \min_i\; w_i / r_i .$$
#
# The loads of slider 1 run around a triangle without obtuse angle, whose smallest disc is the circumscribed circle. The
# loads of slider 2 run to and fro on a line, and $r_2$ is half the length of this line. While nothing slips, a change
# of the load changes the friction force by the same amount.

# %%
corners = np.array([[[0.0, 0.0], [0.0, 0.0]], [[1.2, 0.0], [0.3, 0.4]], [[0.5, 1.0], [0.6, 0.8]]])  # instant, slider
bounds = np.array([0.5, 0.6])


def radius(points):
    """Return the radius of the smallest disc that contains the points."""
    middle, r = cp.Variable(2), cp.Variable()
    cp.Problem(cp.Minimize(r), [cp.norm(one - middle) <= r for one in points]).solve(solver="CLARABEL")
    return float(r.value)


radii = np.array([radius(corners[:, i]) for i in range(2)])
factor = (bounds / radii).min()
_a, _b, _c = (np.linalg.norm(corners[i, 0] - corners[j, 0]) for i, j in ((0, 1), (1, 2), (2, 0)))
assert abs(radii[0] - _a * _b * _c / (4 * 0.6)) <= 1e-6  # product of the sides over 4 times the area 0.6
assert abs(radii[1] - 0.5) <= 1e-6

springs, instants = np.kron([[3.0, -1.0], [-1.0, 2.0]], np.eye(2)), np.arange(301.0)


def work_by_cycles(alpha):
    """Return the work of friction in each of 100 cycles. A cycle has three steps."""
    norms = vx.Norms(np.eye(4), bounds, block=2)
    system = vx.System(springs, lambda t: alpha * corners[int(t) % 3].ravel(), norms)
    slips = np.diff(vx.march(system, instants).state.reshape(-1, 2, 2), axis=0)
    return (np.linalg.norm(slips, axis=2) @ bounds).reshape(100, 3).sum(axis=1)


below, above = work_by_cycles(0.98 * factor), work_by_cycles(1.02 * factor)
print(f"factor {factor:.6f}; work in cycles 1 and 100: {below[[0, -1]]} below, {above[[0, -1]]} above")
assert below[0] > 1e-3
assert below[-1] <= 1e-9
assert above[-1] > 1e-3
print("all solutions hold")
