# %% [markdown]
"""# Solutions to the exercises of lesson 1, one slider"""

# %% [markdown]
# We repeat the slider of the lesson: stiffness $K$, friction bound $w$, and the step under the pull $f$ as a clip.
# The step has the energy $P$ and the dual energy $D$.

# %%
import numpy as np

K, w = 2.0, 1.0


def step(u_prev, f, bound=w):
    return float(np.clip(u_prev, (f - bound) / K, (f + bound) / K))


# %% [markdown]
# **1.** The block stays at $u_{prev} = 0.7$ while $(f - w)/K \le 0.7 \le (f + w)/K$, that is for $|f - 0.7 K| \le w$.
# These are the pulls from 0.4 to 2.4, both included. Pulls of 0.399 and of 2.401 move the block.

# %%
inside, beyond = (0.4 + 1e-3, 1.0, 2.4 - 1e-3), (0.4 - 1e-3, 2.4 + 1e-3)
assert all(step(0.7, f) == 0.7 for f in inside)
assert all(step(0.7, f) != 0.7 for f in beyond)

# %% [markdown]
# **2.** With $w = 0$ the terms with absolute values vanish. The inequality $Ku(v - u) \ge f(v - u)$ holds for $v - u$
# of either sign, so $Ku = f$. $P$ is a parabola. The only admissible $\lambda$ is 0, and $D(0) = -f^2/2K$ is the value
# of $P$ at $u = f/K$.

# %%
assert all(step(u_prev, 1.9, bound=0.0) == 1.9 / K for u_prev in (-1.0, 0.0, 3.0))

# %% [markdown]
# **3.** Let $r = f - \lambda - Ku$ be the residual of the balance of forces, and $s = u - u_{prev}$ the slip:
#
# $$P(u) - D(\lambda) = \tfrac12 Ku^2 - fu + w|s| + \frac{(f - \lambda)^2}{2K} + \lambda u_{prev}
#   = \frac{r^2}{2K} + (w|s| - \lambda s).$$
#
# To see this, expand $r^2 = (f - \lambda)^2 - 2(f - \lambda)Ku + K^2u^2$, and add and subtract $\lambda u$. The term
# $w|s| - \lambda s$ is $\ge 0$ because $|\lambda| \le w$. This term vanishes if $s = 0$ or
# $\lambda = w\,\mathrm{sign}(s)$.

# %%
rng = np.random.default_rng(1)
u, lam, f, u_prev = rng.uniform(-1.0, 1.0, size=(4, 200))
gap = 0.5 * K * u**2 - f * u + w * abs(u - u_prev) + (f - lam) ** 2 / (2 * K) + lam * u_prev
terms = (f - lam - K * u) ** 2 / (2 * K), w * abs(u - u_prev) - lam * (u - u_prev)
assert min(term.min() for term in terms) >= 0
assert abs(gap - sum(terms)).max() < 1e-14

# %% [markdown]
# **4.** The belt moves by $\Delta$. Friction depends on the slip relative to the belt, $s = u - u_{prev} - \Delta$. So
# $u_{prev} + \Delta$ replaces $u_{prev}$ in $P$, in the clip and in $D$. The belt carries the block along while
# $(f - w)/K \le u_{prev} + \Delta \le (f + w)/K$. On a belt that never stops, with $\Delta = 0.1$ in every step, the
# block comes to rest at $(f + w)/K$. At this position the force of the spring equals the sum of the pull and the
# friction bound.


# %%
def ride(steps, pull=0.0, belt=0.1):
    at = 0.0
    for _ in range(steps):
        at = step(at + belt, pull)
    return at


assert ride(3) == 0.1 + 0.1 + 0.1
assert ride(50) == w / K

# %% [markdown]
# **5.** Clipping two points to the same interval does not increase their distance. A second proof carries over to many
# unknowns (lesson 4). Take $v = u_{prev,1} + u_2 - u_{prev,2}$ in the inequality of the first block: with this $v$ the
# first block has the slip of the second block. Exchange the roles of the blocks, and add both inequalities. The terms
# in $w$ cancel, and $K(u_1 - u_2)^2 \le K(u_1 - u_2)(u_{prev,1} - u_{prev,2})$ remains. So later steps do not amplify
# the error of a step.

# %%
pairs = rng.uniform(-2.0, 2.0, size=(200, 3))
assert all(abs(step(a, pull) - step(b, pull)) <= abs(a - b) for a, b, pull in pairs)
print("solutions of lesson 1 hold")
