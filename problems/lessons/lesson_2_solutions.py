# %% [markdown]
"""# Solutions to the exercises of lesson 2, four nodes"""

# %% [markdown]
# The chain of the lesson, and its step by `march`, which is exact to rounding: numbers below are of size one, and
# 1e-13 is granted.

# %%
import cvxpy as cp
import numpy as np

import vemcvx as vx

K = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
w = np.full(4, 0.5)
f = np.array([1.2, 0.0, 0.0, 0.0])


def path(load, times, weights=w):
    """Positions after every step."""
    return vx.march(vx.System(K, load, vx.Norms(np.eye(4), weights)), times, solver=vx.Newton()).state


def near(found, expected):
    return bool(np.abs(np.asarray(found) - expected).max() < 1e-13)


# %% [markdown]
# **1.** Let go at (.9, .2, 0, 0). The spring between 1 and 2 pulls block 1 back by .7 > .5: it moves. On block 2 pull
# .7 forwards and .2 backwards, .5 in all, which friction just holds; as block 1 comes back there is less. Block 1 stops
# when the spring carries .5: at $u_1 = .2 + .5 = .7$. Then nothing else moves.

# %%
back = path(lambda time: f * (2 - time if time > 1 else time), [0.0, 1.0, 2.0])
assert near(back[1], [0.9, 0.2, 0.0, 0.0])
assert near(back[2], [0.7, 0.2, 0.0, 0.0])
print("after the pull", back[1], "and after letting go", back[2])

# %% [markdown]
# **2.** The smooth part of the energy: one linear system $Ku = f$. The only admissible $\lambda$ is zero, and the dual
# value is the energy. All blocks move, block 4 as well.

# %%
assert near(path(lambda time: time * f, [0.0, 1.0], np.zeros(4))[1], np.linalg.solve(K, f))

# %% [markdown]
# **3.** Every block before it must take its .5, and block 4 itself: the pull must exceed 2, however stiff the springs
# are. At 2 exactly it is about to.


# %%
def last_block(pull):
    return path(lambda time: time * pull * f / 1.2, [0.0, 1.0])[1, 3]


assert near(last_block(2.0 - 1e-6), 0.0)
assert last_block(2.0 + 1e-6) > 1e-8

# %% [markdown]
# **4.** At 45 degrees each component is pulled by $1.2/\sqrt 2 = .85$, and the square holds $.5$ of each: .707 in all,
# $\sqrt 2$ times the disc. The friction of a sliding block then depends on how you lay the axes. $|s_x| + |s_y|$ is two
# absolute values, each a pair of linear inequalities, and that a solver of quadratic programs (OSQP) can have; a disc
# has no corners, and needs a second-order cone.


# %%
def first_block(separate):
    u = cp.Variable((4, 2))
    pull = np.zeros((4, 2))
    pull[0] = 1.2 / np.sqrt(2)
    friction = cp.sum(cp.abs(u), axis=1) if separate else cp.norm(u, 2, axis=1)
    energy = 0.5 * sum(cp.quad_form(u[:, a], K) for a in range(2)) - cp.sum(cp.multiply(pull, u)) + w @ friction
    cp.Problem(cp.Minimize(energy)).solve(solver="CLARABEL")
    return np.linalg.norm(pull[0] - (K @ u.value)[0])


disc, box = first_block(separate=False), first_block(separate=True)
# The gap of 1e-8 allows errors of 4e-4 in positions and 4 times that in forces (section 1 of the lesson).
assert abs(disc - 0.5) < 2e-3
assert abs(box - 0.5 * np.sqrt(2)) < 2e-3
print(f"friction on block 1: {disc:.4f} with the disc, {box:.4f} with the square")

# %% [markdown]
# **5.** Multipliers are derivatives of the optimal value. $\tau_3 = w_3$ goes with $t_3 = |s_3| = 0$: the block sticks,
# more bound does not change anything, and the derivative with respect to $w_3$ is $|s_3| = 0$. And with respect to
# $u_{prev,3}$ it is $-\lambda_3 = -.2$ (put $s = u - u_{prev}$ into the dual): by .01 more, .002 less energy, up to a
# term in $.01^2$. That is what a multiplier is worth.


# %%
def least_energy(bound=0.5, start=0.0):
    """On the sets that the lesson found: 1 and 2 slide, 3 stays at its start, 4 at zero."""
    friction = np.array([0.5, 0.5])
    free = np.linalg.solve(K[:2, :2], f[:2] - friction - K[:2, 2] * start)
    u = np.array([*free, start, 0.0])
    force = f - K @ u
    assert abs(force[2]) <= bound
    assert abs(force[3]) <= 0.5
    return 0.5 * u @ K @ u - f @ u + friction @ free


step = 0.01
assert least_energy(bound=0.51) == least_energy()
slope = (least_energy(start=step) - least_energy(start=-step)) / (2 * step)
assert near(slope, -0.2)  # a central difference of a quadratic is exact
print(f"the least energy changes by {slope:.3f} a unit of the third block's start")
