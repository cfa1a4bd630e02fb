# %% [markdown]
"""# Solutions to the exercises of lesson 6, on a chain of eight blocks"""

# %%
import numpy as np

import vemcvx as vx

size = 8
K = 2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)
f, w = np.linspace(2.0, -0.5, size), np.full(size, 0.4)
EPS = np.finfo(float).eps
FLOOR = 100 * size * EPS * np.linalg.cond(K) * (f @ np.linalg.solve(K, f))  # 100 times the rounding of sums of 8 terms


def gap(s, lam, w=w):
    lam = np.clip(lam, -w, w)
    r = f - lam - K @ s
    return 0.5 * r @ np.linalg.solve(K, r) + np.sum(w * np.abs(s) - lam * s)


def step_from(u_prev, load):
    """Return the position after a step from `u_prev` under `load`."""
    system = vx.System(K, lambda t: t * (load - K @ u_prev), vx.Norms(np.eye(size), w))
    return u_prev + vx.march(system, [0.0, 1.0]).state[-1]


rng = np.random.default_rng(0)

# %% [markdown]
# **1.** With $w = 0$ the only admissible $\lambda$ is 0. So $r = f - Ks = K(s^* - s)$, and
# $\tfrac12 r^TK^{-1}r = \tfrac12 (s^* - s)^T K (s^* - s)$.

# %%
best = np.linalg.solve(K, f)
for _s in rng.normal(size=(20, size)):
    assert abs(gap(_s, np.zeros(size), w=0.0) - 0.5 * (_s - best) @ K @ (_s - best)) <= FLOOR

# %% [markdown]
# **2.** The multipliers computed from $s$ are $f - Ks$, clipped to the friction bounds. If $s$ has an error
# $\varepsilon$, these multipliers have errors of the order $\varepsilon$. Then the terms $w_i |s_i| - \lambda_i s_i$ of
# the gap at slipping nodes are of this order. A disturbed $\lambda$ adds terms of the same order. Neither choice always
# has the smaller gap. Both gaps are certificates, so a check can take the smaller gap.

# %%
exact = step_from(np.zeros(size), f)
forces = np.clip(f - K @ exact, -w, w)
wins = 0
for _scale in np.repeat(10.0 ** -np.arange(1, 6), 20):
    _s = exact + _scale * rng.normal(size=size)
    _disturbed, _computed = gap(_s, forces + _scale * rng.normal(size=size)), gap(_s, f - K @ _s)
    assert 0.5 * (_s - exact) @ K @ (_s - exact) <= min(_disturbed, _computed) + FLOOR
    wins += _computed < _disturbed
print(f"multipliers computed from s give the smaller gap in {wins} of 100")
assert 0 < wins < 100

# %% [markdown]
# **3.** Two steps lead from $u_{prev}$ to $u$ and from $\bar u_{prev}$ to $\bar u$ under the same load, with the slips
# $s$ and $\bar s$. In each variational inequality, take the slip of the other step as the test function. With
# $j(s) = \sum_i w_i |s_i|$, this is $(Ku - f)^T (\bar s - s) + j(\bar s) - j(s) \ge 0$, and the same with exchanged
# roles. The sum of both is $(u - \bar u)^T K (s - \bar s) \le 0$, that is
# $|u - \bar u|_K^2 \le (u - \bar u)^TK(u_{prev} - \bar u_{prev})$. The Cauchy-Schwarz inequality completes the proof.


# %%
def energy_norm(u):
    return np.sqrt(u @ K @ u)


for _a, _b in rng.normal(size=(10, 2, size)):
    assert energy_norm(step_from(_a, f) - step_from(_b, f)) <= energy_norm(_a - _b) + np.sqrt(FLOOR)

# %% [markdown]
# **4.** With $\lambda = 0$ the gap is $\tfrac12 |\lambda^*|_{K^{-1}}^2 + \sum w_i|s_i| > 0$. The answer is refused,
# although $s$ is exact. If a solver returns `d` alone, the package computes the multipliers from `d`.


# %%
class Right:
    """A solver with the right slips, and with zero multipliers or none."""

    accuracy = 1e-6

    def __init__(self, with_zeros):
        self.with_zeros = with_zeros

    def solve(self, program, target):
        inner = vx.Newton().prepare(program.operators)
        d = inner.solve(program, target, np.zeros((program.operators.count, 1))).d
        return (d, np.zeros((program.operators.count, 1))) if self.with_zeros else d


system = vx.System(K, lambda t: t * f, vx.Norms(np.eye(size), w))
try:
    vx.march(system, [0.0, 1.0], solver=Right(with_zeros=True))
    refused = False
except vx.NotCertified:
    refused = True
assert refused
assert vx.march(system, [0.0, 1.0], solver=Right(with_zeros=False)).certificate.max() <= 1e-6

# %% [markdown]
# **5.** For $n$ steps, $\sum_m \sqrt{2\,\mathrm{gap}_m} \le \varepsilon$ holds if each gap is at most
# $\tfrac12 (\varepsilon / n)^2$. If the errors were independent with mean zero, their squares would add up, and
# $\tfrac12 \varepsilon^2 / n$ would suffice. But the errors of a solver may be biased, for example if all slips are too
# small. The theorem covers the worst case.

# %%
n, target = 50, 1e-3
assert np.isclose(n * np.sqrt(2 * 0.5 * (target / n) ** 2), target, rtol=4 * EPS)
assert np.isclose(n * np.sqrt(2 * 0.5 * target**2 / n), np.sqrt(n) * target, rtol=4 * EPS)
print("all solutions hold")
