# %% [markdown]
"""# Solutions to the exercises of lesson 10"""

# %%
import cvxpy as cp
import numpy as np

rng = np.random.default_rng(2)
count, free = 40, 24
B = rng.normal(size=(count, free))  # any structure will do
c = rng.uniform(0.5, 2.0, count)
K = B.T @ (c[:, None] * B)
f = rng.normal(size=free)
u = np.linalg.solve(K, f)
sigma = c * (B @ u)
states = np.linalg.svd(B.T)[2][free:]
v, tau = u + 0.3 * rng.normal(size=free), sigma + 0.3 * rng.normal(size=count - free) @ states


def size(s):
    return np.sqrt(np.sum(s**2 / c))


bound = size(tau - c * (B @ v))

# %% [markdown]
# **1.** $\sigma$ is on the circle over the diameter from $c\,Bv$ to $\tau$, and its centre is the mean: the distance is
# the radius, half the bound. No measurement, no assumption; and of all that one can say of $\sigma$ from this pair, it
# is the best.

# %%
mean = 0.5 * (tau + c * (B @ v))
print(f"the mean is off by {size(sigma - mean):.6f}, half the bound is {0.5 * bound:.6f}")
assert abs(size(sigma - mean) - 0.5 * bound) < 1e-12 * bound

# %% [markdown]
# **2.** Their difference is half the square of the diameter:
# $\tfrac12 |v|^2 - f\cdot v + \tfrac12 |\tau|^2 = \tfrac12 |\tau - c\,Bv|^2$, since $f \cdot v = \tau \cdot Bv$. The
# duality gap of lesson 6 is the hypercircle.

# %%
above, below = 0.5 * v @ K @ v - f @ v, -0.5 * size(tau) ** 2
print(f"{below:.4f} < {0.5 * u @ K @ u - f @ u:.4f} < {above:.4f}")
assert below < 0.5 * u @ K @ u - f @ u < above
assert abs(above - below - 0.5 * bound**2) < 1e-10

# %% [markdown]
# **3.** Minimise $|\tau + Z^T a - c\,Bv|$ over $a$: least squares. In a net one can take all states, and what is left
# is the error itself. On a continuum there are infinitely many, and one takes those of a mesh.

# %%
scaled = states / np.sqrt(c)
a = np.linalg.lstsq(scaled.T, (c * (B @ v) - tau) / np.sqrt(c), rcond=None)[0]
better, error = size(tau + a @ states - c * (B @ v)), size(c * (B @ (u - v)))
print(f"bound {bound:.4f}, improved {better:.6f}, error {error:.6f}")
assert abs(better - error) < 1e-10 * error
assert better < bound

# %% [markdown]
# **4.** Divide by the least reserve, $\delta = \min (w_i - |\lambda_i|)$ over some nodes: their slips add up to
# $(A^2/4 + b)/\delta$ at most. So it is certain how *much* they slip, and nothing that one of them sticks: a slip as
# small as one likes is admitted. In a net, whose forces are finitely many, one could still bound $|\lambda_i|$ node by
# node; on a continuum errors in energy bound no traction at a point.

# %%
w = np.full(free, 0.8)
slip = cp.Variable(free)
cp.Problem(cp.Minimize(0.5 * cp.quad_form(slip, cp.psd_wrap(K)) - f @ slip + w @ cp.abs(slip))).solve(solver="CLARABEL")
exact = slip.value
tried = exact + 0.01 * rng.normal(size=free)
lam = np.clip(f - K @ exact + 0.05 * rng.normal(size=free), -w, w)
balanced = c * (B @ np.linalg.solve(K, f - lam))
allowed = 0.25 * size(balanced - c * (B @ tried)) ** 2 + w @ np.abs(tried) - lam @ tried
reserve = w - np.abs(lam)
print(f"slips weighed by reserves {reserve @ np.abs(exact):.5f}, at most {allowed:.5f}")
assert reserve @ np.abs(exact) <= allowed
assert np.sum(np.abs(exact[reserve > 0.4])) <= allowed / 0.4
print("all solutions hold")
