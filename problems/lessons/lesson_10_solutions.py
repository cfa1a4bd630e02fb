# %% [markdown]
"""# Solutions to the exercises of lesson 10"""

# %%
import cvxpy as cp
import numpy as np

rng = np.random.default_rng(2)
count, free = 40, 24
stretch = rng.normal(size=(count, free))  # a random structure
C = rng.uniform(0.5, 2.0, count)
K = stretch.T @ (C[:, None] * stretch)
f = rng.normal(size=free)
u = np.linalg.solve(K, f)


def force(v):
    return C * (stretch @ v)


def norm(tau):
    return np.sqrt(np.sum(tau**2 / C))


sigma = force(u)
unloaded = np.linalg.svd(stretch.T)[2][free:]
v, tau = u + 0.3 * rng.normal(size=free), sigma + 0.3 * rng.normal(size=count - free) @ unloaded
bound = norm(tau - force(v))

# %% [markdown]
# **1.** $\sigma$ lies on the circle whose diameter joins $\mathbb C\,\varepsilon(v)$ and $\tau$. The mean of both
# fields is the centre. So the distance of $\sigma$ from the mean is the radius, and the bound is the diameter.

# %%
mean = 0.5 * (tau + force(v))
print(f"the error of the mean is {norm(sigma - mean):.6f}, half the bound is {0.5 * bound:.6f}")
assert abs(norm(sigma - mean) - 0.5 * bound) < 1e-12 * bound

# %% [markdown]
# **2.** The energy of $v$ minus the complementary energy of $\tau$ is half the squared diameter of the circle:
# $\tfrac12 |v|^2 - f^T v + \tfrac12 |\tau|^2 = \tfrac12 |\delta|^2$ with $\delta = \tau - \mathbb C\,\varepsilon(v)$,
# because $f^T v = \tau^T \varepsilon(v)$. So without friction the duality gap of lesson 6 is $\tfrac12 |\delta|^2$.

# %%
above, below = 0.5 * v @ K @ v - f @ v, -0.5 * norm(tau) ** 2
print(f"complementary energy {below:.4f} < least energy {0.5 * u @ K @ u - f @ u:.4f} < energy of v {above:.4f}")
assert below < 0.5 * u @ K @ u - f @ u < above
assert abs(above - below - 0.5 * bound**2) < 1e-10

# %% [markdown]
# **3.** Add to $\tau$ a combination of states without a load, and choose the factors for which $|\delta|$ is smallest.
# This is a least-squares problem. The random structure has finitely many independent states without a load. If we use
# all these states, the bound equals the error of $v$. A continuum has infinitely many states without a load, so we take
# states of a mesh.

# %%
scaled = unloaded / np.sqrt(C)
coefficients = np.linalg.lstsq(scaled.T, (force(v) - tau) / np.sqrt(C), rcond=None)[0]
better, error = norm(tau + coefficients @ unloaded - force(v)), norm(force(u - v))
print(f"bound {bound:.4f}, improved bound {better:.6f}, error {error:.6f}")
assert abs(better - error) < 1e-10 * error
assert better < bound

# %% [markdown]
# **4.** Keep only the terms of some nodes in the sum of the exercise, and divide by the smallest reserve
# $w_i - |\lambda_i|$ of these nodes. This bounds the sum of the slips of these nodes. It does not prove that a node
# sticks, because the bound is not zero.

# %%
w = np.full(free, 0.8)
slip = cp.Variable(free)
cp.Problem(cp.Minimize(0.5 * cp.quad_form(slip, cp.psd_wrap(K)) - f @ slip + w @ cp.abs(slip))).solve(solver="CLARABEL")
exact = slip.value
disturbed = exact + 0.01 * rng.normal(size=free)
lam = np.clip(f - K @ exact + 0.05 * rng.normal(size=free), -w, w)
delta = force(np.linalg.solve(K, f - lam)) - force(disturbed)
phi = w @ np.abs(disturbed) - lam @ disturbed
reserve = w - np.abs(lam)
print(f"sum of reserve times slip {reserve @ np.abs(exact):.5f}, at most {0.25 * norm(delta) ** 2 + phi:.5f}")
assert reserve @ np.abs(exact) <= 0.25 * norm(delta) ** 2 + phi
assert np.sum(np.abs(exact[reserve > 0.4])) <= (0.25 * norm(delta) ** 2 + phi) / 0.4
print("all solutions hold")
