# %% [markdown]
"""# Solutions to the exercises of lesson 1, one slider"""

# %% [markdown]
# The slider of the lesson once more: stiffness $K$, bound $g$, and the step as a clip.

# %%
import numpy as np

K, g = 2.0, 1.0


def step(u_prev, f, bound=g):
    return float(np.clip(u_prev, (f - bound) / K, (f + bound) / K))


# %% [markdown]
# **1.** It stays while $(f - g)/K \le 0.7 \le (f + g)/K$, that is for $|f - 0.7 K| \le g$: for pulls from 0.4 to 2.4.
# At the ends themselves it stays too; a thousandth beyond, it moves.

# %%
inside, beyond = (0.4 + 1e-3, 1.0, 2.4 - 1e-3), (0.4 - 1e-3, 2.4 + 1e-3)
assert all(step(0.7, f) == 0.7 for f in inside)
assert all(step(0.7, f) != 0.7 for f in beyond)

# %% [markdown]
# **2.** With $g = 0$ the terms in $|\cdot|$ go. The inequality $Ku(v - u) \ge f(v - u)$ for all $v$ holds for $v - u$
# of either sign, so it is the equation $Ku = f$. $P$ is a parabola, the only admissible $\lambda$ is 0, and
# $D(0) = -f^2/2K$ is the energy at $u = f/K$.

# %%
assert all(step(u_prev, 1.9, bound=0.0) == 1.9 / K for u_prev in (-1.0, 0.0, 3.0))

# %% [markdown]
# **3.** With $r = f - \lambda - Ku$, the force that is out of balance, and $s = u - u_{prev}$:
#
# $$P(u) - D(\lambda) = \tfrac12 Ku^2 - fu + g|s| + \frac{(f - \lambda)^2}{2K} + \lambda u_{prev}
#   = \frac{r^2}{2K} + (g|s| - \lambda s).$$
#
# (Expand $r^2 = (f - \lambda)^2 - 2(f - \lambda)Ku + K^2u^2$, and add and subtract $\lambda u$.) The second bracket is
# $\ge 0$ because $|\lambda| \le g$; it vanishes if $\lambda = g\,\mathrm{sign}(s)$ or $s = 0$.

# %%
rng = np.random.default_rng(1)
u, lam, f, u_prev = rng.uniform(-1.0, 1.0, size=(4, 200))
gap = 0.5 * K * u**2 - f * u + g * abs(u - u_prev) + (f - lam) ** 2 / (2 * K) + lam * u_prev
terms = (f - lam - K * u) ** 2 / (2 * K), g * abs(u - u_prev) - lam * (u - u_prev)
assert min(term.min() for term in terms) >= 0
# Sums of numbers below 5, each rounded to 1e-16 of its size.
assert abs(gap - sum(terms)).max() < 1e-14

# %% [markdown]
# **4.** What friction feels is the slip against the table, $s = u - u_{prev} - d$. So write $u_{prev} + d$ wherever
# $u_{prev}$ stood: the block is carried along while $(f - g)/K \le u_{prev} + d \le (f + g)/K$. On a belt that runs on
# and on ($d = 0.1$ a step) the block comes to rest at $(f + g)/K$, held by the spring against all friction can do.


# %%
def ride(steps, pull=0.0, belt=0.1):
    at = 0.0
    for _ in range(steps):
        at = step(at + belt, pull)
    return at


assert ride(3) == 0.1 + 0.1 + 0.1
assert ride(50) == g / K

# %% [markdown]
# **5.** A clip to one and the same interval moves no two points apart. In general (lesson 4 needs it for many
# unknowns): put the slip of the second block into the inequality of the first, that is $v = u_{prev,1} + u_2 -
# u_{prev,2}$, and the other way round, and add. The terms in $g$ cancel, and what is left is
# $K(u_1 - u_2)^2 \le K(u_1 - u_2)(u_{prev,1} - u_{prev,2})$. Hence errors of steps add up and are not amplified.

# %%
pairs = rng.uniform(-2.0, 2.0, size=(200, 3))
assert all(abs(step(a, pull) - step(b, pull)) <= abs(a - b) for a, b, pull in pairs)
print("solutions of lesson 1 hold")
