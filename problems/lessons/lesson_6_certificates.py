# %% [markdown]
"""# Lesson 6, certificates: what a gap proves, and a solver that lies"""

# %% [markdown]
# *You need:* linear algebra, the dual of lesson 1. *You will see:* what a duality gap proves, why we need not trust a
# solver, and what a gap cannot tell.
#
# Every answer of this package comes with a *certificate*, a bound on its error. This lesson computes the bound in six
# lines. Then a solver stops too early and reports "optimal".
#
# One step of friction is the convex program
#
# $$\min_s\; P(s) = \tfrac12 s^T K s - f^T s + \sum_i w_i\,|s_i|$$
#
# where $s = u - u_{prev}$ are the slips of the step at the contact nodes, $K$ is the stiffness of the body at these
# nodes, and $w_i$ are the friction bounds. The stresses at the start of the step balance a part of the load; $f$ is the
# other part. (Insert $u = u_{prev} + s$ into the program of lesson 2 to see this.) In the package, $s$ is called `d`
# and $f$ is called `g`. We take the last of eight steps of the block of Feng, Han and Huang, with eight contact nodes.

# %%
import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx


def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


scene = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(bound=4.0, on="bottom"),
)
mesh, times = vx.meshes.squares(8), np.linspace(0.0, 1.0, 9)
steps = list(vx.programs(scene, mesh, times))
step = steps[-1]
K, f, w = step.operators.K, step.g, step.w
print(f"{len(f)} contact nodes, of which {np.count_nonzero(step.answer.d)} slip")

# %% [markdown]
# ## The gap in six lines
#
# Lesson 1 derived the dual: its unknowns are *admissible* forces $\lambda$, with $|\lambda_i| \le w_i$, and
# $Ks = f - \lambda$ at the solution. For any $s$ and any admissible $\lambda$, with the residual
# $r = f - \lambda - Ks$,
#
# $$\mathrm{gap}(s, \lambda) = \tfrac12\, r^T K^{-1} r + \sum_i \bigl( w_i |s_i| - \lambda_i s_i \bigr) .$$
#
# The first part measures how far the forces are from balance. The second part measures how far friction is from its
# law. The term of node $i$ in this part vanishes if the node sticks, $s_i = 0$, or if the node slips with
# $\lambda_i = w_i\, \mathrm{sign}\, s_i$.


# %%
def gap(s, lam):
    """Return the primal minus the dual value, as a sum of terms that are all >= 0."""
    lam = np.clip(lam, -w, w)
    r = f - lam - K @ s
    return 0.5 * r @ np.linalg.solve(K, r) + np.sum(w * np.abs(s) - lam * s)


def energy_norm(s):
    return np.sqrt(s @ K @ s)


exact, forces = step.answer.d, step.answer.lam[:, 0]
# The floor of a certificate bounds the rounding error of its gap.
assert abs(gap(exact, forces) - step.certificate.gap) <= step.certificate.floor
print(f"gap of the package's answer {gap(exact, forces):.1e}; the certificate has {step.certificate.gap:.1e}")

# %% [markdown]
# **Theorem.** Let $s^*$ be the solution, and $|s|_K^2 = s^T K s$. For every $s$ and every $\lambda$ with
# $|\lambda_i| \le w_i$,
#
# $$\tfrac12 |s - s^*|_K^2 \le \mathrm{gap}(s, \lambda) .$$
#
# *Proof.* First, $P(s)$ is $\tfrac12 s^TKs$ plus a convex function, and $s^*$ is its minimiser, so
#
# $$P(s) \ge P(s^*) + \tfrac12 |s - s^*|_K^2 .$$
#
# Second, $|\lambda_i| \le w_i$ implies $w_i |v_i| \ge \lambda_i v_i$ for every $i$ and every $v$. If $\lambda_i v_i$
# replaces $w_i |v_i|$, no term of $P$ grows, and the new function has its minimum at $Kv = f - \lambda$. So
#
# $$\begin{aligned} P(v) &\ge \tfrac12 v^TKv - (f - \lambda)^Tv \\
#   &\ge -\tfrac12 (f - \lambda)^T K^{-1} (f - \lambda) = D(\lambda) \quad \text{for all } v. \end{aligned}$$
#
# Take $v = s^*$: $D(\lambda) \le P(s^*)$. Together, $\tfrac12 |s - s^*|_K^2 \le P(s) - P(s^*) \le P(s) - D(\lambda)$.
# Finally, insert $f = r + \lambda + Ks$ into $P(s)$ and $f - \lambda = r + Ks$ into $D(\lambda)$:
#
# $$\begin{aligned} P(s) - D(\lambda) = & \Bigl(-\tfrac12 s^TKs - r^Ts - \lambda^Ts + \sum_i w_i |s_i|\Bigr) \\
#   & + \Bigl(\tfrac12 r^TK^{-1}r + r^Ts + \tfrac12 s^TKs\Bigr) = \mathrm{gap}(s, \lambda). \qquad \square
#   \end{aligned}$$
#
# The proof depends on $w_i |v_i| \ge \lambda_i v_i$. Without $|\lambda_i| \le w_i$ this inequality is wrong for some
# $v$, and the gap proves nothing (see "How to cheat a careless check" below).
#
# We now disturb the solution at random and compare both sides of the inequality. We do not know $s^*$, but the
# package's answer has a certified relative error below $10^{-13}$, so we use this answer as $s^*$.

# %%
rng = np.random.default_rng(6)
disturbed = []
for _size in np.repeat(10.0 ** np.arange(-6, 1), 8):
    _s = exact + _size * energy_norm(exact) * rng.normal(size=8) / np.sqrt(np.diag(K))
    _lam = forces + _size * w * rng.normal(size=8)
    disturbed.append((energy_norm(_s - exact), np.sqrt(2 * gap(_s, _lam))))
disturbed = np.array(disturbed)
known = step.certificate.error + step.certificate.error_floor
assert (disturbed[:, 0] <= disturbed[:, 1] + known).all()
ratio = disturbed[:, 1] / disturbed[:, 0]
print(f"certified / true error: {ratio[:8].mean():.0f} for small errors, {ratio[-8:].mean():.1f} for large errors")

# %% [markdown]
# The bound always holds, but it is far from sharp for small errors. Suppose that a node sticks in the solution, but
# slips by $s_i$ in the answer. If $\lambda$ is the force of the solution, the gap is at least
#
# $$(w_i - |\lambda_i|)\,|s_i|$$
#
# This bound is linear in the slip, but the squared error is quadratic. So for an error $\varepsilon$ the certificate is
# of size $\sqrt\varepsilon$.
#
# **Question:** Two answers are equally far from $s^*$. Some nodes stick in the solution. In the first answer these
# nodes stick, in the second answer they slip a little. Which answer has the smaller certificate? And why do active-set
# methods (lesson 5) reach certificates that are as small as rounding errors?
#
# <details><summary>Answer</summary>
#
# The first answer has the smaller certificate. Take the forces of the solution, $\lambda = \lambda^*$, and let the
# slipping nodes slip in the right direction. Then $w_i |s_i| = \lambda_i s_i$ at every node, and the gap is
# $\tfrac12 r^TK^{-1}r$ with $r = K(s^* - s)$. This gap is *equal* to $\tfrac12 |s - s^*|_K^2$. In the second answer, a
# node that sticks in the solution adds $(w_i - |\lambda_i|)\,|s_i|$. This term is much larger than $s_i^2$ if $s_i$ is
# small.
#
# The answers of active-set methods have exactly $s_i = 0$ at nodes that stick, and $\lambda_i = \pm w_i$ at nodes that
# slip. The gap of these answers is $\tfrac12 r^TK^{-1}r$, where $r$ is the rounding error of one linear system.
#
# </details>

# %%
still = np.flatnonzero(exact == 0)
assert len(still) > 0
for _node in still:
    for _slip in (1e-6, -1e-3):
        _s = exact.copy()
        _s[_node] = _slip * np.abs(exact).max()
        assert gap(_s, forces) >= (w - np.abs(forces))[_node] * abs(_s[_node]) - step.certificate.floor

# %% jupyter={"source_hidden": true}
# Picture: certified errors of disturbed answers over their true errors; all points lie above the diagonal
_figure, _axes = plt.subplots(figsize=(5.6, 3.9), layout="constrained")
_axes.loglog(*disturbed.T, "o", color="tab:blue", markersize=4, label="disturbed answers")
_line = np.sort(disturbed[:, 0])
_slope = disturbed[0, 1] * np.sqrt(_line / disturbed[0, 0])
_axes.loglog(_line, _line, "-", color="black", linewidth=1.2, label="certified = true error")
_axes.loglog(_line, _slope, "--", color="tab:orange", linewidth=1.2, label="slope 1/2")
_axes.set(xlabel="true error (energy norm)", ylabel="certified error", title="no certificate is below the error")
_axes.grid(color="0.9")
_axes.legend(frameon=False)
plt.close(_figure)
_figure

# %% [markdown]
# ## A solver that lies
#
# Any object with the method `solve(program, target, lam)` is a solver for this package. The following solver is the
# projected gradient method on the dual (lesson 9). This solver stops after three iterations, and reports "optimal".


# %%
class Hasty:
    """Projected gradients on the dual, stopped too early, with the status "optimal"."""

    def __init__(self, iterations):
        self.iterations = iterations

    def solve(self, program, target, lam):
        K, B = program.operators.K, program.operators.B.toarray()  # B, the rows of the norm terms, is the identity here
        rho = 1 / np.linalg.eigvalsh(B @ np.linalg.solve(K, B.T))[-1]
        for _ in range(self.iterations):
            d = np.linalg.solve(K, program.g - B.T @ lam[:, 0])
            lam = program.project(lam + rho * program.slip(d))
        return vx.Answer(d, lam, self.iterations, "optimal")


try:
    vx.simulate(scene, mesh, times, solver=Hasty(3))
except vx.NotCertified as error:
    refused = str(error)
print(refused)

# %% [markdown]
# The package ignored the status and computed the gap, which was too large. With `check=False` the package returns the
# answer with its certificate, so we can compare the true error with the certified error.
#
# Later steps do not *amplify* the error of a step: the map from $u_{prev}$ to $u$ is nonexpansive in $|\cdot|_K$
# (exercise 3). So
#
# $$|u_n - u_n^*|_K \le \sum_{m \le n} \sqrt{2\,\mathrm{gap}_m} .$$
#
# We check this inequality for 32 steps under a load that varies like $\sin 3t$.

# %%
system = vx.System(K, lambda t: np.sin(3 * t) * steps[0].g / times[1], vx.Norms(np.eye(8), w))
instants = np.linspace(0.0, 2.0, 33)
honest = vx.march(system, instants)
table = []
for _count in (10, 100, 1000):
    _run = vx.march(system, instants, solver=Hasty(_count), check=False)
    _difference = _run.state - honest.state
    _error = np.sqrt(np.einsum("ni,ij,nj->n", _difference, K, _difference))
    _allowed = sum(np.cumsum(np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor)) for run in (_run, honest))
    assert (_error <= _allowed).all()
    table.append((_count, _error, _allowed))
    print(f"{_count:5d} iterations per step: error {_error[-1]:.1e}, certificates allow {_allowed[-1]:.1e}")

# %% [markdown]
# The picture shows the true errors over time. Each error stays below the sum of the certificates of its run.

# %% jupyter={"source_hidden": true}
# Picture: true errors over time for three numbers of iterations, each below the sum of its certificates
_figure, _axes = plt.subplots(figsize=(8.0, 3.9), layout="constrained")
for (_count, _error, _allowed), _colour in zip(table, ("tab:orange", "tab:blue", "black"), strict=True):
    _axes.semilogy(instants[1:], _error[1:], "-", color=_colour, label=f"{_count} iterations: error")
    _axes.semilogy(instants[1:], _allowed[1:], "--", color=_colour, label="sum of its certificates")
_axes.set(xlabel="time", ylabel="energy norm", title="a solver that stops too early, step by step")
_axes.grid(color="0.9")
_axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.close(_figure)
_figure

# %% [markdown]
# ## How to cheat a careless check
#
# The theorem needs $|\lambda_i| \le w_i$. Suppose that a check accepts every $\lambda$. Let friction carry the whole
# load, $\lambda = f$. Then $D(\lambda) = 0$, and the primal value minus the dual value is
#
# $$P(s) - D(f) = P(s) .$$
#
# We call this value the careless gap. For every $s$ with $P(s) \le 0$ it is zero or negative, and the check certifies
# $s$ as exact. For $s = 2.1\,s^*$ the careless gap is positive, but smaller than half the squared error. The package
# first moves each multiplier to the nearest admissible value, as `clip` does in the six lines above.


# %%
def careless(s):
    """Return the primal minus the dual value for lam = f, which is not admissible."""
    return 0.5 * s @ K @ s - f @ s + w @ np.abs(s)


assert careless(exact) < 0 == careless(0 * exact)
assert 0 < careless(2.1 * exact) < 0.5 * energy_norm(2.1 * exact - exact) ** 2
for _s in (exact, 0 * exact, 2.1 * exact):
    assert 0.5 * energy_norm(_s - exact) ** 2 <= gap(_s, f) + step.certificate.floor
print(f"careless gap of the solution {careless(exact):.1e} < 0; gap with clipped forces {gap(exact, f):.1e} >= 0")

# %% [markdown]
# ## Where is the error?
#
# Each term in the second part of the gap belongs to one node. If we move a node that sticks, the terms show which node
# has moved:
#
# $$\mathrm{gap} = \tfrac12\, r^T K^{-1} r + \sum_i \mathrm{gap}_i, \qquad
#   \mathrm{gap}_i = w_i |s_i| - \lambda_i s_i .$$

# %%
moved = exact.copy()
node = int(still[1])
moved[node] += 0.01 * np.abs(exact).max()
found = step.certify(moved, forces)
print(f"node {node} has moved; fractions of the gap by node: {np.round(found.friction / found.gap, 2)}")
assert int(np.argmax(found.friction)) == node
assert abs(found.gap - gap(moved, forces)) <= found.floor + 1e-12 * found.gap

# %% [markdown]
# ## What a certificate cannot tell
#
# A certificate bounds the distance to the solution *of this program*. The certificate does not contain the error of the
# mesh. Below, the energies of certified answers on two meshes differ by some per cent. Lesson 7 measures the error of
# the mesh.

# %%
coarse, fine = (vx.simulate(scene, vx.meshes.squares(n), times) for n in (4, 16))
deviation = abs(coarse.energy[-1] - fine.energy[-1]) / fine.energy[-1]
largest = max(coarse.certificate.max(), fine.certificate.max())
print(f"both answers are certified to {largest:.0e}, but their energies differ by {deviation:.0%}")
assert deviation > 1e6 * largest

# %% [markdown]
# ## Exercises
#
# 1. Without friction ($w = 0$), show that the gap is *equal* to $\tfrac12 |s - s^*|_K^2$. (What is $\lambda$?)
# 2. Replace the multipliers of the disturbed answers by $\lambda = \mathrm{clip}(f - Ks, -w, w)$, which depends on $s$
#    alone. Are the certificates smaller or larger?
# 3. Take two random states, do the same step from both, and check that their distance in $|\cdot|_K$ has not grown. To
#    prove this, add the two variational inequalities.
# 4. Write a solver that returns the exact $s$ with $\lambda = 0$. Is its answer refused? Should it be refused?
# 5. The error of the *last* of $n$ steps should be at most $\varepsilon$. Which gap do you request for each step? Which
#    gap would suffice if the errors were random and independent, and why does this gap not suffice for the theorem?
#
# Solutions: `lesson_6_solutions.py`.
