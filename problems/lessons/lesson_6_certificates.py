# %% [markdown]
"""# Lesson 6, certificates: what a gap proves, and a solver that lies"""

# %% [markdown]
# Every answer of this package comes with a number that bounds its error, whoever computed it. The lesson writes that
# number in six lines, proves it, attacks it by a solver that stops too early and says "optimal", and shows what it
# does not know.
#
# *You need:* linear algebra, the dual of lesson 1. *You will see:* what a duality gap proves, why nobody has to trust
# a solver, and what no gap can tell.
#
# One step of friction is the convex program
#
# $$\min_d\; P(d) = \tfrac12 d^T K d - g^T d + \sum_i w_i\,|d_i|,$$
#
# where $d$ are the increments of slip at the contact nodes, $K$ the stiffness that they feel, $g$ the forces that are
# out of balance when the step begins, and $w_i$ the friction bounds. We take one from the block of the paper: eight
# contact nodes, the last of eight steps.

# %%
import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, EXACT, SECOND


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
K, g, w = step.operators.K, step.g, step.w
print(step.operators)

# %% [markdown]
# ## The gap in six lines
#
# Lesson 1 derived the dual: forces $\lambda$ with $|\lambda_i| \le w_i$, and $Kd = g - \lambda$ at the solution. For
# *any* $d$ and any such $\lambda$, with $r = g - \lambda - Kd$,
#
# $$\mathrm{gap}(d, \lambda) = \tfrac12\, r^T K^{-1} r + \sum_i \bigl( w_i |d_i| - \lambda_i d_i \bigr) .$$
#
# The first part says how far forces are from balance. The second says where friction does not fit the slip: it
# vanishes where a node sticks ($d_i = 0$) and where it slips with full friction against it ($\lambda_i = w_i\,
# \mathrm{sign}\, d_i$).


# %%
def gap(d, lam):
    """Primal minus dual value, as a sum of terms that are all >= 0."""
    lam = np.clip(lam, -w, w)
    r = g - lam - K @ d
    return 0.5 * r @ np.linalg.solve(K, r) + np.sum(w * np.abs(d) - lam * d)


def energy_norm(d):
    return np.sqrt(d @ K @ d)


exact, forces = step.answer.d, step.answer.lam[:, 0]
assert abs(gap(exact, forces) - step.certificate.gap) <= step.certificate.floor
print(f"gap of the package's answer {gap(exact, forces):.1e}; it certifies {step.certificate.gap:.1e}")

# %% [markdown]
# **Theorem.** $\tfrac12 |d - d^*|_K^2 \le \mathrm{gap}(d, \lambda)$ for every $d$ and every $\lambda$ with $|\lambda_i|
# \le w_i$, where $d^*$ is the solution and $|d|_K^2 = d^T K d$.
#
# *Proof.* First, $P(v) = \tfrac12 v^TKv$ plus a convex function of $v$, and $d^*$ is its minimum, so
#
# $$P(d) \ge P(d^*) + \tfrac12 |d - d^*|_K^2 .$$
#
# Second, $|\lambda_i| \le w_i$ implies $w_i |v_i| \ge \lambda_i v_i$ for every $i$ and every $v$. With $\lambda_i v_i$
# in place of $w_i |v_i|$ no term of $P$ grows, and the result is smooth, with its minimum where $Kv = g - \lambda$:
#
# $$P(v) \ge \tfrac12 v^TKv - (g - \lambda)^Tv \ge -\tfrac12 (g - \lambda)^T K^{-1} (g - \lambda) = D(\lambda)
#   \quad \text{for all } v.$$
#
# Take $v = d^*$: $D(\lambda) \le P(d^*)$. Both together give $\tfrac12 |d - d^*|_K^2 \le P(d) - P(d^*) \le P(d) -
# D(\lambda)$. Last, put $g = r + \lambda + Kd$ into $P(d)$ and $g - \lambda = r + Kd$ into $D(\lambda)$:
#
# $$P(d) - D(\lambda) = \Bigl(-\tfrac12 d^TKd - r^Td - \lambda^Td + \sum_i w_i |d_i|\Bigr)
#   + \Bigl(\tfrac12 r^TK^{-1}r + r^Td + \tfrac12 d^TKd\Bigr) = \mathrm{gap}(d, \lambda). \qquad \square$$
#
# The whole proof hinges on $w_i |v_i| \ge \lambda_i v_i$: without $|\lambda_i| \le w_i$ it is wrong for some $v$, and
# nothing is proved (see "How to cheat a careless judge" below).
#
# The proof does not mention a solver. Let us spoil the solution at random and hold both sides against each other. We do
# not know $d^*$, but the package's answer is certified to a relative $10^{-13}$ or so, and that counts as known.

# %%
rng = np.random.default_rng(6)
spoilt = []
for _size in np.repeat(10.0 ** np.arange(-6, 1), 8):
    _d = exact + _size * energy_norm(exact) * rng.normal(size=8) / np.sqrt(np.diag(K))
    _lam = forces + _size * w * rng.normal(size=8)
    spoilt.append((energy_norm(_d - exact), np.sqrt(2 * gap(_d, _lam))))
spoilt = np.array(spoilt)
known = step.certificate.error + step.certificate.error_floor
assert (spoilt[:, 0] <= spoilt[:, 1] + known).all()
ratio = spoilt[:, 1] / spoilt[:, 0]
print(f"certified over true error: {ratio[:8].mean():.0f} for small errors, {ratio[-8:].mean():.1f} for large ones")

# %% [markdown]
# The bound always holds. It is far from sharp for small errors: a node that should stick but moves by $\varepsilon$
# costs $(w_i - |\lambda_i|)\,\varepsilon$, which is linear, while the error squared is quadratic in $\varepsilon$. So
# an error of $\varepsilon$ is certified as about $\sqrt\varepsilon$.
#
# **Question:** Two answers are equally far from $d^*$; in one all sticking nodes are at rest, in the other they creep.
# Which has the better certificate, and why do active-set methods (lesson 5) certify to rounding?
#
# <details><summary>Answer</summary>
#
# The one at rest. Take the right forces, $\lambda = \lambda^*$, and let the slipping nodes slip the right way. Then
# $w_i |d_i| = \lambda_i d_i$ at every node that slips, and at every node that is at rest, so that only $\tfrac12
# r^TK^{-1}r$ is left, with $r = K(d^* - d)$: the gap is *equal* to $\tfrac12 |d - d^*|_K^2$. A node that creeps by
# $\varepsilon$ adds $(w_i - |\lambda_i|)\,\varepsilon$ or more, which is larger by far when $\varepsilon$ is small.
#
# Active-set methods put $d_i = 0$ where a node sticks and $\lambda_i = \pm w_i$ where it slips, exactly. Their gap is
# $\tfrac12 r^TK^{-1}r$, where $r$ is the rounding of one linear solve.
#
# </details>

# %% jupyter={"source_hidden": true}
_figure = new_figure(5.6, 3.9)
_ax = _figure.subplots()
_ax.loglog(*spoilt.T, "o", color=COMPUTED, markersize=4, label="spoilt answers")
_line = np.sort(spoilt[:, 0])
_ax.loglog(_line, _line, "-", color=EXACT, linewidth=1.2, label="certified = true")
_ax.loglog(_line, spoilt[0, 1] * np.sqrt(_line / spoilt[0, 0]), "--", color=SECOND, linewidth=1.2, label="slope 1/2")
_ax.set(xlabel="true error (energy norm)", ylabel="certified error", title="no certificate below the error")
light_grid(_ax)
_ax.legend(frameon=False)
_figure

# %% [markdown]
# ## A solver that lies
#
# Any object with `solve(program, target)` is a solver for this package. Here is one that runs projected gradients on
# the dual (lesson 9), stops after three iterations, and says "optimal".


# %%
class Hasty:
    """Projected gradients on the dual, cut short; claims to be done."""

    def __init__(self, iterations):
        self.iterations = iterations

    def solve(self, program, target, lam):
        K, B = program.operators.K, program.operators.B.toarray()  # scaled: B need not be the identity
        length = 1 / np.linalg.eigvalsh(B @ np.linalg.solve(K, B.T))[-1]
        for _ in range(self.iterations):
            d = np.linalg.solve(K, program.g - B.T @ lam[:, 0])
            lam = program.project(lam + length * program.slip(d))
        return vx.Answer(d, lam, self.iterations, "optimal")


try:
    vx.simulate(scene, mesh, times, solver=Hasty(3))
except vx.NotCertified as error:
    refused = str(error)
print(refused)

# %% [markdown]
# The package believed neither the word nor the numbers: it computed the gap and refused. `check=False` lets the answer
# pass, with its certificate. So we may ask how far from the truth the lie was, and whether the certificate knew.
#
# Answers of all steps: the error of one step is carried into the next, because a step begins where the last one ended.
# But it is not *amplified*: the map from $u_{prev}$ to $u$ is nonexpansive in $|\cdot|_K$ (exercise 3). So
#
# $$|u_n - u_n^*|_K \le \sum_{m \le n} \sqrt{2\,\mathrm{gap}_m} .$$

# %%
system = vx.System(K, lambda t: np.sin(3 * t) * steps[0].g / times[1], vx.Norms(np.eye(8), w))
instants = np.linspace(0.0, 2.0, 33)
honest = vx.march(system, instants)
table = []
for _count in (10, 100, 1000):
    _lie = vx.march(system, instants, solver=Hasty(_count), check=False)
    _away = _lie.state - honest.state
    _error = np.sqrt(np.einsum("ni,ij,nj->n", _away, K, _away))
    _allowed = sum(np.cumsum(np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor)) for run in (_lie, honest))
    assert (_error <= _allowed).all()
    table.append((_count, _error, _allowed))
    print(f"{_count:5d} iterations a step: error {_error[-1]:.1e}, certificates allow {_allowed[-1]:.1e}")

# %% jupyter={"source_hidden": true}
_figure = new_figure(6.4, 3.9)
_ax = _figure.subplots()
for (_count, _error, _allowed), _colour in zip(table, (SECOND, COMPUTED, EXACT), strict=True):
    _ax.semilogy(instants[1:], _error[1:], "-", color=_colour, label=f"{_count} iterations: error")
    _ax.semilogy(instants[1:], _allowed[1:], "--", color=_colour, label="its certificates, added up")
_ax.set(xlabel="time", ylabel="energy norm", title="a solver that stops too early, step by step")
light_grid(_ax)
_ax.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
_figure

# %% [markdown]
# ## How to cheat a careless judge
#
# The theorem needs $|\lambda_i| \le w_i$. A judge who takes $\lambda$ as it comes can be cheated: let friction carry
# everything, $\lambda = g$. Then $D(\lambda) = 0$, the "gap" is $P(d)$, and that is *negative* for every answer better
# than staying: it would certify any answer. The package moves multipliers to the nearest admissible ones first, as the
# line with `clip` does above.

# %%
careless = 0.5 * exact @ K @ exact - g @ exact + w @ np.abs(exact)
print(f"careless judge: {careless:.1e} < 0; ours: {gap(exact, g):.1e} >= 0")
assert careless < 0 <= gap(exact, g)

# %% [markdown]
# ## Where is the error?
#
# Every summand of the gap belongs to one place. Move one sticking node, and the certificate points at it.

# %%
crept = exact.copy()
node = int(np.flatnonzero(exact == 0)[1])
crept[node] += 0.01 * np.abs(exact).max()
found = step.certify(crept, forces)
print(f"node {node} has crept; shares of the gap by node: {np.round(found.friction / found.gap, 2)}")
assert int(np.argmax(found.friction)) == node
assert abs(found.gap - gap(crept, forces)) <= found.floor + 1e-12 * found.gap

# %% [markdown]
# ## What it does not know
#
# A certificate bounds the distance to the solution *of this program*. That the mesh is coarse is not written in the
# program. Two meshes, both certified to rounding, differ by some per cent in energy; lesson 7 is about that.

# %%
coarse, fine = (vx.simulate(scene, vx.meshes.squares(n), times) for n in (4, 16))
differ = abs(coarse.energy[-1] - fine.energy[-1]) / fine.energy[-1]
print(f"certified to {max(coarse.certificate.max(), fine.certificate.max()):.0e}, energies differ by {differ:.0%}")
assert differ > 1e6 * max(coarse.certificate.max(), fine.certificate.max())

# %% [markdown]
# ## Exercises
#
# 1. Without friction ($w = 0$), show that the gap is *exactly* $\tfrac12 |d - d^*|_K^2$. (What is $\lambda$?)
# 2. Throw the multipliers of the spoilt answers away and let the judge read them off $d$ alone, $\lambda =
#    \mathrm{clip}(g - Kd)$. Are the certificates better or worse?
# 3. Draw two states at random, do the same step from both, and check that their distance $|\cdot|_K$ has not grown.
#    Prove it: add the two variational inequalities.
# 4. Write a solver that returns the exact $d$ but $\lambda = 0$. Is it refused? Should it be?
# 5. Given a target $\varepsilon$ for the error of the *last* of $N$ steps, which gap would you ask of each step? Which
#    if the errors were random and independent, and why does the theorem not allow that?
#
# Solutions: `lesson_6_solutions.py`.
