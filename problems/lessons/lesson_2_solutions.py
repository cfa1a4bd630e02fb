# %% [markdown]
"""# Solutions to the exercises of lesson 2, four nodes"""

# %% [markdown]
# We repeat the chain of the lesson. `march` with `Newton` is exact up to rounding. All numbers are of size 1, so we
# allow errors of 1e-13.

# %%
import cvxpy as cp
import numpy as np

import vemcvx as vx

K = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
w = np.full(4, 0.5)
f = np.array([1.2, 0.0, 0.0, 0.0])


def path(load, times, weights=w):
    """Return the positions after every step."""
    return vx.march(vx.System(K, load, vx.Norms(np.eye(4), weights)), times, solver=vx.Newton()).state


def near(found, expected):
    return bool(np.abs(np.asarray(found) - expected).max() < 1e-13)


# %% [markdown]
# **1.** The blocks are at (0.9, 0.2, 0, 0) when we let go. The spring between blocks 1 and 2 pulls block 1 back by 0.7.
# This is more than 0.5, so block 1 moves. Block 2 is pulled forward by 0.7 and backward by 0.2, in all by 0.5. Friction
# just holds this force, and the force decreases as block 1 comes back. Block 1 stops when its spring carries 0.5, at
# $u_1 = 0.2 + 0.5 = 0.7$. No other block moves.

# %%
back = path(lambda time: f * (2 - time if time > 1 else time), [0.0, 1.0, 2.0])
assert near(back[1], [0.9, 0.2, 0.0, 0.0])
assert near(back[2], [0.7, 0.2, 0.0, 0.0])
print("after the pull", back[1], "and after letting go", back[2])

# %% [markdown]
# **2.** With $w = 0$ only the smooth part of the energy remains. The answer solves the linear system $Ku = f$. The only
# admissible $\lambda$ is zero, and the value of the dual is the least energy. All blocks move.

# %%
assert near(path(lambda time: time * f, [0.0, 1.0], np.zeros(4))[1], np.linalg.solve(K, f))

# %% [markdown]
# **3.** All four blocks must have reached their bounds of 0.5, so the pull must exceed 2.


# %%
def last_block(pull):
    return path(lambda time: time * pull * f / 1.2, [0.0, 1.0])[1, 3]


assert near(last_block(2.0 - 1e-6), 0.0)
assert last_block(2.0 + 1e-6) > 1e-8

# %% [markdown]
# **4.** At 45 degrees each component of the pull is $1.2/\sqrt 2 = 0.85$. With the square, the force of friction has
# the components 0.5 and 0.5, and the length 0.707: $\sqrt 2$ times the force with the disc. So with the square,
# friction depends on the directions of the axes. $|s_x| + |s_y|$ consists of two absolute values, and each can be
# written with a variable and two linear inequalities. A solver of quadratic programs such as OSQP accepts linear
# inequalities. The disc needs a second-order cone.


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
# The gap of 1e-8 allows errors of 4e-4 in positions and of 16e-4 in forces (section 1 of the lesson).
assert abs(disc - 0.5) < 2e-3
assert abs(box - 0.5 * np.sqrt(2)) < 2e-3
print(f"friction on block 1: {disc:.4f} with the disc, {box:.4f} with the square")

# %% [markdown]
# **5.** Multipliers are derivatives of the optimal value. The derivative with respect to $w_3$ is $|s_3| = 0$: the
# block sticks, and a larger bound changes nothing. The derivative with respect to $u_{prev,3}$ is
# $-\lambda_3 = \zeta_3 = -0.2$, because $u_{prev}$ occurs in the dual as $-\lambda^T u_{prev}$. So a start at 0.01
# lowers the least energy by 0.002, up to a term in $0.01^2$.


# %%
def least_energy(bound=0.5, start=0.0):
    """Return the energy if blocks 1 and 2 slide, block 3 stays at its start, and block 4 at zero."""
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
print(f"the derivative of the least energy with respect to the start of block 3 is {slope:.3f}")
