# %% [markdown]
"""# Lesson 5, active sets and semismooth Newton: how they converge, how they cycle, and a safeguard"""

# %% [markdown]
# *You need:* lessons 1 and 2; Newton's method. *You will see:* how to solve a step by guessing which nodes stick;
# superlinear convergence in the plane; two blocks for which the guesses cycle for ever, and a safeguard against cycles.
#
# If we knew which nodes stick, and in which direction the others slip, a step would be one linear system. The method of
# this lesson guesses these sets of nodes, solves the system, checks the guess, and guesses again. This is Newton's
# method for an equation with kinks.

# %%
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

import vemcvx as vx

# %% [markdown]
# ## 1. An equation with kinks
#
# The unknowns $u$ are the positions of the nodes on the ground, as in lesson 2, and $s = u - u_{prev}$ is the slip. For
# the minimiser of $\tfrac12 u^TKu - f^Tu + \sum_i w_i|s_i|$ there are forces $\lambda$ such that
#
# $$K u + \lambda = f, \quad |\lambda_i| \le w_i, \quad \lambda_i = w_i\,\mathrm{sign}(s_i) \text{ where } s_i \ne 0.$$
#
# For any *shift* $\gamma_i > 0$, the two conditions on $\lambda$ are equivalent to one equation:
#
# $$\lambda_i = \mathrm{clip}(\hat\lambda_i, -w_i, w_i), \qquad \hat\lambda_i = \lambda_i + \gamma_i s_i .$$
#
# We call $\hat\lambda$ the *trial force*. If $|\hat\lambda_i| \le w_i$, the equation gives $s_i = 0$. If
# $|\hat\lambda_i| > w_i$, then $\lambda_i = \pm w_i$, and $s_i$ has the same sign. The clip is linear except for two
# kinks. So Newton's method finds the linear piece on which $\hat\lambda$ lies, replaces the clip by this piece, and
# solves the linear system. This is an *active set* iteration:
#
# - If $|\hat\lambda_i| \le w_i$, node $i$ sticks: $u_i = u_{prev,i}$.
# - Otherwise node $i$ slips in the direction of $\hat\lambda_i$, with the force
#   $\lambda_i = w_i\,\mathrm{sign}(\hat\lambda_i)$.


# %%
def newton_step(program, u, lam, gamma):
    """Return positions, forces and sides (0: sticks, 1 or -1: slips) for the sets that follow from (u, lam)."""
    K, f, w, u_prev = program
    trial = lam + gamma * (u - u_prev)
    side = np.where(np.abs(trial) <= w, 0.0, np.sign(trial))
    slips = side != 0
    u = np.where(slips, 0.0, u_prev)
    u[slips] = np.linalg.solve(K[np.ix_(slips, slips)], (f - w * side - K @ u)[slips])
    return u, np.where(slips, w * side, f - K @ u), side


def active_sets(program, gamma, rounds=40):
    """Return the answer and all guesses; start from rest, and end when two successive guesses are equal."""
    u, lam, sides = program[3], np.zeros(len(program[3])), []
    while len(sides) < rounds:
        u, lam, side = newton_step(program, u, lam, gamma)
        if sides and (side == sides[-1]).all():
            break
        sides.append(side)
    return u, lam, np.array(sides)


# %% [markdown]
# Why does the iteration end with the solution? The last $u$ and $\lambda$ solve the linear system of the guess, so all
# equations hold. The sets that follow from $u$ and $\lambda$ equal the guess, so all inequalities hold.
#
# **A body.** We take the block of Feng, Han and Huang (Section 4) on squares, with 32 nodes on the ground. The package
# keeps the program of every step. All nodes off the ground are eliminated from this program, so $K$ is a full matrix
# for 32 nodes. The unknowns are the slips of these nodes in the step. In the package `b` takes the place of $u_{prev}$
# and `g` the place of $f$. Here `b` is zero.


# %%
def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


scene = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(bound=4.0, on="bottom"),
)
step = vx.simulate(scene, vx.meshes.squares(32), [0.0, 1.0]).program(1)
body = (step.operators.K, step.g, step.w, step.b)
assert np.array_equal(step.operators.B.toarray(), np.eye(32))


def shift(K, size):
    """Return `size` divided by the flexibility of each node; `size` has no unit."""
    return size / np.diag(np.linalg.inv(K))


u, lam, sides = active_sets(body, shift(body[0], 0.1))
assert len(sides) <= 8
# The certificate of the package does not depend on the method that found u and lam. `floor` bounds its rounding error.
certificate = step.certify(u, lam[:, None])
assert certificate.gap <= 10 * certificate.floor
print(f"{len(sides)} guesses; nodes that slip: {np.count_nonzero(sides, axis=1)}; gap {certificate.gap:.0e}")

# %% [markdown]
# The picture has one row per guess, with the first guess at the top. The end of the slipping zone moves to its final
# place in ever shorter steps. Newton's method on a piecewise linear function is *exact* as soon as the piece is right.
# **Question:** why is the first row all blue?
#
# <details><summary>Answer</summary>
#
# The iteration starts from rest, with $u = u_{prev}$ and $\lambda = 0$. So $s = 0$, and the trial force
# $\hat\lambda = \lambda + \gamma s$ is zero at every node, whatever the shift. Then $|\hat\lambda_i| \le w_i$: the
# first guess is that all nodes stick.
#
# </details>


# %% jupyter={"source_hidden": true}
# Picture: one row per guess, one column per node on the ground; the slipping zone grows from the pulled side
def sets_picture():
    figure, axes = plt.subplots(figsize=(6.6, 2.6), layout="constrained")
    colours = ListedColormap(["tab:purple", "lightblue", "tab:orange"])
    axes.pcolormesh(sides, cmap=colours, vmin=-1, vmax=1, edgecolor="white", linewidth=0.6)
    axes.invert_yaxis()
    axes.set(xlabel="node on the ground, from the pulled side to the clamp", ylabel="guess", xticks=[])
    axes.set(yticks=np.arange(len(sides)) + 0.5, yticklabels=range(1, len(sides) + 1))
    axes.set_title("blue: guessed to stick, orange: guessed to slip")
    plt.close(figure)
    return figure


sets_picture()

# %% [markdown]
# ## 2. In the plane: superlinear convergence
#
# A node of a body on a table can slip in two directions. Then the projection of $\hat\lambda$ on the disc of the radius
# $w$ takes the place of the clip. Outside the disc, the projection $w\hat\lambda/|\hat\lambda|$ is not linear. Newton's
# method needs its derivative,
#
# $$\frac{w}{|\hat\lambda|}\left(I - \frac{\hat\lambda \hat\lambda^T}{|\hat\lambda|^2}\right).$$
#
# We linearise the equation. Then a slipping node carries the force $w \hat\lambda/|\hat\lambda|$. Friction also resists
# a change of this direction, like a spring at right angles to the direction. The stiffness of this spring is
#
# $$\frac{\gamma w}{|\hat\lambda| - w} .$$
#
# The projection has a kink on the rim of the disc, but it is *semismooth*: near a solution, the error of the
# linearisation at $\hat\lambda$ is small compared with the distance to the solution. This is sufficient for superlinear
# convergence (Qi and Sun 1993).


# %%
def plane_step(K, f, w, u_prev, iterate, gamma):
    """Return the next iterate. K (m, m) is the same for x and for y; f, u_prev, u and lam are (m, 2)."""
    u, lam = iterate
    trial = lam + gamma[:, None] * (u - u_prev)
    length = np.linalg.norm(trial, axis=1)
    A, load, sticks = np.kron(K, np.eye(2)), f.copy(), length <= w
    for i in np.flatnonzero(~sticks):
        direction, stiffness = trial[i] / length[i], gamma[i] * w[i] / (length[i] - w[i])
        across = stiffness * (np.eye(2) - np.outer(direction, direction))
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += across
        load[i] += across @ u_prev[i] - w[i] * direction
    u = np.where(sticks[:, None], u_prev, 0.0)
    free = np.repeat(~sticks, 2)
    u.ravel()[free] = np.linalg.solve(A[np.ix_(free, free)], (load.ravel() - A @ u.ravel())[free])
    return u, f - K @ u


# %% [markdown]
# Twenty blocks stand in a row that is tied at one end and pulled at the other. The first pull is along the row, the
# second pull has another direction. The error of an iterate is its distance to the last iterate, in the energy norm. At
# first the error falls by about a fifth per round: only neighbours are coupled, so slip spreads from block to block.
# Then the error collapses. *Superlinear* means that the ratio of successive errors tends to zero:
#
# $$\frac{|u^{(n+1)} - u^*|_K}{|u^{(n)} - u^*|_K} \to 0 \quad \text{for the iterates } u^{(n)} .$$

# %%
m = 20
row = 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
row[-1, -1] = 1.0
bounds = np.full(m, 0.25)


def in_the_plane(force, before, rounds):
    f, points = np.zeros((m, 2)), [(before, np.zeros((m, 2)))]
    f[-1] = force
    for _ in range(rounds):
        points.append(plane_step(row, f, bounds, before, points[-1], shift(row, 1.0)))
    return points[1:]


along = in_the_plane((3.0, 0.0), np.zeros((m, 2)), 20)[-1][0]
iterates = in_the_plane((1.5, 2.5), along, 24)
distances = [u - iterates[-1][0] for u, _ in iterates]
errors = np.array([np.sqrt(np.sum(distance * (row @ distance))) for distance in distances])
# The numbers are of size 10 and the condition number is below 700, so rounding errors are below 1e-12.
ends = errors[(errors < 0.5) & (errors > 1e-12)]
factors = ends[1:] / ends[:-1]
assert len(factors) >= 3
assert (np.diff(factors) < 0).all()
assert factors[-1] < 1e-3
assert errors[-2] < 1e-12
print("errors at the end", " ".join(f"{e:.0e}" for e in ends), "| factors", " ".join(f"{r:.0e}" for r in factors))


# %% jupyter={"source_hidden": true}
# Picture: error over rounds, on a logarithmic scale; the error falls slowly at first and then collapses
def errors_picture():
    figure, axes = plt.subplots(figsize=(5.6, 3.2), layout="constrained")
    seen = errors[errors > 1e-13]
    axes.semilogy(np.arange(1, len(seen) + 1), seen, "o-", color="tab:blue")
    axes.set(xlabel="round", ylabel="error (energy norm)", title="slow at first, superlinear at the end")
    axes.grid(color="0.9")
    plt.close(figure)
    return figure


errors_picture()

# %% [markdown]
# ## 3. Cycles
#
# One spring joins two blocks, and another spring joins the second block to a wall. The first block is pulled back by
# the force 3, the second forward by the force 2, and both friction bounds are 1:
#
# $$K = \begin{pmatrix} 1 & -1 \\ -1 & 2 \end{pmatrix}, \quad f = (-3, 2), \quad w = (1, 1).$$
#
# In the solution the first block slides back to $u_1 = -2$. The spring between the blocks pulls the second block back
# with the force 2. This balances the pull on the second block, which sticks. But if the shift is large, the signs of
# the slips determine the next guess:
#
# | guess | solution of the system | next guess |
# |---|---|---|
# | (back, forward) | $u = (-3, -1)$: the second block moves back | (back, back) |
# | (back, back) | $u = (-1, 1)$: the second block moves forward | (back, forward) |
#
# The two guesses alternate, and the iteration never reaches the solution.

# %%
blocks = (np.array([[1.0, -1.0], [-1.0, 2.0]]), np.array([-3.0, 2.0]), np.ones(2), np.zeros(2))
_, _, cycle = active_sets(blocks, shift(blocks[0], 100.0))
assert len(cycle) == 40
assert cycle[1:5].tolist() == [[-1, 1], [-1, -1], [-1, 1], [-1, -1]]
positions, forces, _ = active_sets(blocks, shift(blocks[0], 0.1))
assert positions.tolist() == [-2.0, 0.0]
assert forces.tolist() == [-1.0, 0.0]
print("large shift:", cycle[:5].astype(int).tolist(), "...; small shift:", positions)

# %% [markdown]
# With a *small* shift, the next guess is that the second block sticks. The solution for the guess (back, forward) has
# $\lambda_2 = 1$ and $s_2 = -1$. So the trial force is $\hat\lambda_2 = 1 - \gamma_2$, which lies within $\pm 1$ while
# $\gamma_2 \le 2$. In the package the shift is 0.1 divided by the flexibility. But a small shift does not guarantee
# convergence. We try 60 random programs.


# %%
def random_program(seed, n=8):
    """Return a program whose eigenvalues span three orders of magnitude, and whose friction bounds span two."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = Q @ np.diag(10.0 ** rng.uniform(-1.5, 1.5, n)) @ Q.T
    u_prev = rng.normal(size=n) * (rng.random(n) < 0.3)
    return 0.5 * (K + K.T), K @ rng.normal(size=n) + rng.normal(size=n), 10.0 ** rng.uniform(-1, 1, n), u_prev


programs = [random_program(seed) for seed in range(60)]
unfinished = {
    size: sum(len(active_sets(program, shift(program[0], size))[2]) == 40 for program in programs)
    for size in (0.1, 1.0, 10.0)
}
assert unfinished[10.0] > 10
print("programs out of 60 that are unsolved after 40 rounds, by shift:", unfinished)

# %% [markdown]
# ## 4. A safeguard
#
# We need a measure of the error, and a slow method that always converges.
#
# *The measure* is the gap of lesson 1 (exercise 3), here for vectors, with $r = f - \lambda - Ku$ and $\lambda$ clipped
# to its bounds. The gap is zero at the solution and nowhere else:
#
# $$\mathrm{gap}(u, \lambda) = \tfrac12 r^TK^{-1}r + \sum_i(w_i|s_i| - \lambda_i s_i) .$$
#
# *The slow method* is the projected gradient for the dual. This method maximises
# $D(\lambda) = -\tfrac12 (f - \lambda)^TK^{-1}(f - \lambda) - \lambda^Tu_{prev}$ over the box $|\lambda_i| \le w_i$.
# The gradient of $D$ is the slip $s = K^{-1}(f - \lambda) - u_{prev}$, so one iteration is
#
# $$\lambda \leftarrow \mathrm{clip}(\lambda + \rho s, -w, w), \qquad \rho = 1/|K^{-1}| .$$
#
# The iteration converges, because $D$ is concave and its gradient has the Lipschitz constant $1/\rho$. We call an
# iteration of this method a *sure step*.
#
# *The combination* keeps the smallest gap of all rounds so far. Newton's method runs until five rounds in a row have
# not halved the smallest gap. Then sure steps and rounds of Newton's method alternate until the smallest gap is halved.
# A sure step begins at the result of the last sure step. The round of Newton's method after a sure step begins at the
# result of this step.
#
# **Theorem.** The smallest gap tends to zero. *Proof.* If the smallest gap is halved infinitely often, the claim holds.
# Otherwise it is never halved after some round, and there are infinitely many sure steps. Sure steps are the iterates
# of the projected gradient, so their gap tends to zero. Hence the smallest gap is halved: a contradiction. $\square$


# %%
def gap(program, u, lam):
    K, f, w, u_prev = program
    r, s = f - lam - K @ u, u - u_prev
    return 0.5 * r @ np.linalg.solve(K, r) + np.sum(w * np.abs(s) - lam * s)


def solve_safely(program, gamma, patience=5, rounds=1000):
    """Return the answer, the gap after every round, and the indices of the sure steps."""
    K, f, w, u_prev = program
    flexibility = np.linalg.inv(K)
    rho = 1.0 / np.linalg.eigvalsh(flexibility).max()
    u, lam, sure, waited, gaps, sure_steps = u_prev, np.zeros(len(f)), np.zeros(len(f)), 0, [], []
    while len(gaps) < rounds:
        is_sure = waited >= patience
        if is_sure:
            sure = np.clip(sure + rho * (flexibility @ (f - sure) - u_prev), -w, w)
            u, lam = flexibility @ (f - sure), sure
            sure_steps.append(len(gaps))
        else:
            u, lam, _ = newton_step(program, u, lam, gamma)
        now = gap(program, u, np.clip(lam, -w, w))
        is_halved = not gaps or now <= 0.5 * min(gaps)
        gaps.append(now)
        if now <= 1e-12 * 0.5 * f @ flexibility @ f:
            break
        waited = 0 if is_halved else patience - 1 if is_sure else waited + 1
    return u, np.array(gaps), sure_steps


# %% [markdown]
# We set `size` to 10 again. Now every program is solved: the gap is below $10^{-12} \cdot \tfrac12 f^T K^{-1} f$, so
# the error in the energy norm is below 1e-6 of the norm of the answer without friction. Sure steps end the cycles of
# Newton's method.

# %%
runs = [solve_safely(program, shift(program[0], 10.0)) for program in programs]
for _program, (_, _gaps, _) in zip(programs, runs, strict=True):
    assert _gaps[-1] <= 1e-12 * 0.5 * _program[1] @ np.linalg.solve(_program[0], _program[1])
needed = [len(sure_steps) for _, _, sure_steps in runs]
assert sum(needed) > 0
assert solve_safely(blocks, shift(blocks[0], 100.0))[0].tolist() == [-2.0, 0.0]
few = np.median([count for count in needed if count])
print(f"all 60 are solved; {np.count_nonzero(needed)} needed sure steps, {few:.0f} at the median")


# %% jupyter={"source_hidden": true}
# Picture: gap over rounds; plain active sets go on for ever, the safeguarded iteration falls to rounding
def safeguard_picture():
    worst = int(np.argmax(needed))
    gamma = shift(programs[worst][0], 10.0)
    u, lam, plain = programs[worst][3], np.zeros(8), []
    _, gaps, sure_steps = runs[worst]
    for _ in gaps:
        u, lam, _ = newton_step(programs[worst], u, lam, gamma)
        plain.append(gap(programs[worst], u, np.clip(lam, -programs[worst][2], programs[worst][2])))
    figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
    rounds = np.arange(1, len(gaps) + 1)
    axes.semilogy(rounds, plain, color="tab:orange", linewidth=0.8, label="plain active sets: a cycle")
    shown = np.maximum(gaps, 1e-13 * gaps.max())
    axes.semilogy(rounds, shown, color="tab:blue", label="safeguarded")
    axes.semilogy(np.array(sure_steps) + 1, shown[np.array(sure_steps)], ".", color="tab:blue", label="a sure step")
    axes.set(xlabel="round", ylabel="gap", title="the program that needs the most sure steps")
    axes.grid(color="0.9")
    axes.legend(frameon=False)
    plt.close(figure)
    return figure


safeguard_picture()

# %% [markdown]
# The package's `vx.Newton` works in this way, with the small shift and faster sure steps (accelerated projected
# gradients). **Question:** in the last round the blue curve falls by many orders of magnitude. Which section of this
# lesson explains this?
#
# <details><summary>Answer</summary>
#
# Section 1 explains this. The equation is piecewise linear, and on the right piece one linear system determines the
# exact solution. So the gap falls to rounding in one round. Section 2 does not explain this, because superlinear
# convergence takes several rounds.
#
# </details>
#
# ## Exercises
#
# 1. Beyond which shift do the guesses for the two blocks cycle? Predict this shift from the table, and test the
#    prediction.
# 2. Show that for one unknown and a start from rest the guesses never cycle, whatever the shift. Can the guesses cycle
#    from another start?
# 3. Try `active_sets` on a rod of 100 elements that is pulled at its end. Why does the rod need more guesses than the
#    body? Does it help to start from the answer to 9/10 of the pull?
# 4. Solve the 60 programs by sure steps alone. How many steps does the hardest program need for a gap of 1e-6 of the
#    energy? Which property of $K$ explains this number?
# 5. The cycle of section 3 has length two. How long are the cycles of the random programs?
#
# Solutions: `lesson_5_solutions.py`.
