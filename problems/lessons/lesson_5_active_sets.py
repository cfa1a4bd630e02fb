# %% [markdown]
"""# Lesson 5, active sets and semismooth Newton: how they converge, how they cycle, and a safeguard"""

# %% [markdown]
# If somebody told us which nodes stick and which slip, and which way, a step would be one linear system. The method of
# this lesson guesses, solves, looks at what it got, and guesses again. That is Newton's method for an equation with
# kinks; on a body it takes five or six guesses, and the last of them is exact up to rounding. But on two blocks and a
# spring it may run in circles for ever, and the lesson ends with a remedy.
#
# The paper solves its steps by a method of this family ([24] there). Lessons 1 and 2 derive the program and its dual.

# %%
import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import distinct, light_grid, new_figure
from vemcvx.plots.style import BACKWARD, COMPUTED, FORWARD, SECOND, STICK_AREA

# %% [markdown]
# ## 1. An equation with kinks
#
# A step in the unknowns that touch the ground, $\min \tfrac12 y^TKy - f^Ty + \sum_i w_i|y_i - b_i|$, is solved by a $y$
# with forces $\lambda$ such that, with the slip $s = y - b$,
#
# $$K y + \lambda = f, \quad |\lambda_i| \le w_i, \quad \lambda_i = w_i\,\mathrm{sign}(s_i) \text{ where } s_i \ne 0.$$
#
# The two conditions on $\lambda$ are one equation: for any *shift* $c_i > 0$, with $P$ the clip to $[-w_i, w_i]$,
#
# $$\lambda_i = P(\lambda_i + c_i s_i).$$
#
# (If $|\lambda_i + c_i s_i| \le w_i$ it says $s_i = 0$; beyond, $\lambda_i = \pm w_i$ and $s_i$ has that sign.) $P$ is
# linear but for two kinks, so Newton's method on the whole system is: see on which piece $q = \lambda + cs$ lies, take
# this piece for the function, solve. In words, an *active set* iteration:
#
# - $|q_i| \le w_i$: node $i$ sticks, $y_i = b_i$;
# - else it slips the way of $q_i$, and friction is $\lambda_i = w_i\,\mathrm{sign}(q_i)$.


# %%
def newton_step(program, y, lam, c):
    """Guess the sets at (y, lam), and solve on them."""
    K, f, w, b = program
    q = lam + c * (y - b)
    side = np.where(np.abs(q) <= w, 0.0, np.sign(q))
    slip = side != 0
    y = np.where(slip, 0.0, b)
    y[slip] = np.linalg.solve(K[np.ix_(slip, slip)], (f - w * side - K @ y)[slip])
    return y, np.where(slip, w * side, f - K @ y), side


def active_sets(program, c, rounds=40):
    """All guesses, from rest, until one repeats the one before: then it has solved the problem."""
    y, lam, sides = program[3], np.zeros(len(program[3])), []
    while len(sides) < rounds:
        y, lam, side = newton_step(program, y, lam, c)
        if sides and (side == sides[-1]).all():
            break
        sides.append(side)
    return y, lam, np.array(sides)


# %% [markdown]
# Why is a repeated guess a solution? Its $y$ and $\lambda$ came out of the linear system of the guess, so all equations
# hold; and reading the sets off them gave the same guess, so all inequalities do.
#
# **A body.** The paper's Section 4 on squares, 32 nodes on the ground. The package keeps the program of every step;
# all unknowns inside have been eliminated from it, and the 32 nodes on the ground are left, with a full matrix.


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
    """In units of one over the flexibility of the nodes, so that `size` is a number without a unit."""
    return size / np.diag(np.linalg.inv(K))


y, lam, sides = active_sets(body, shift(body[0], 0.1))
assert len(sides) <= 8
# The judge is the certificate of the package, which knows nothing of how y and lam were found.
certificate = step.certify(y, lam[:, None])
assert certificate.gap <= 10 * certificate.floor
print(f"{len(sides)} guesses; nodes that slip: {np.count_nonzero(sides, axis=1)}; gap {certificate.gap:.0e}")

# %% [markdown]
# The picture: one row a guess, first at the top. The end of the slipping zone runs to its place, in ever shorter
# strides, and stops. There are finitely many sets, and Newton's method on a piecewise linear function is *exact* once
# the piece is right: no digits are left to gain. **Question:** why is the first row all blue?
#
# <details><summary>Answer</summary>
#
# The iteration starts from rest, $y = b$ and $\lambda = 0$. Then $s = 0$ and $q = \lambda + cs = 0$ at every node,
# whatever the shift, and $|q_i| \le w_i$: the first guess is that everything sticks.
#
# </details>


# %% jupyter={"source_hidden": true}
def sets_picture():
    figure = new_figure(6.6, 2.6)
    axes = figure.add_subplot()
    axes.pcolormesh(
        sides, cmap=distinct((BACKWARD, STICK_AREA, FORWARD)), vmin=-1, vmax=1, edgecolor="white", linewidth=0.6
    )
    axes.invert_yaxis()
    axes.set(xlabel="node on the ground, from the pulled side to the clamp", ylabel="guess", xticks=[])
    axes.set(yticks=np.arange(len(sides)) + 0.5, yticklabels=range(1, len(sides) + 1))
    axes.set_title("blue: guessed to stick, orange: guessed to slip")
    return figure


sets_picture()

# %% [markdown]
# ## 2. In the plane: superlinear ends
#
# Where a node slips in two directions (a body on a table), $P$ projects on a disc: outside of it $P(q) = wq/|q|$ is no
# longer linear, and Newton's method must differentiate,
#
# $$P'(q) = \frac{w}{|q|}\left(I - \frac{q q^T}{|q|^2}\right).$$
#
# Put into $\lambda = P(\lambda + cs)$ and solved for $\lambda$, a slipping node gets the force $w q/|q|$ and, across
# its way, a spring of stiffness $h = cw/(|q| - w)$, for turning aside costs friction. The rest is as before. $P$ has a
# kink on the rim, but it is *semismooth*: near a solution the linearisation at $q$ is good in the direction of the
# solution, and that is all that Newton needs to converge superlinearly (Qi and Sun 1993).


# %%
def plane_step(K, f, w, b, iterate, c):
    """K couples blocks alike in x and y; f, b, y, lam are (m, 2)."""
    y, lam = iterate
    q = lam + c[:, None] * (y - b)
    size = np.linalg.norm(q, axis=1)
    slip = np.flatnonzero(size > w)
    A, load, held = np.kron(K, np.eye(2)), f.copy(), np.ones(len(w), dtype=bool)
    held[slip] = False
    for i in slip:
        way, h = q[i] / size[i], c[i] * w[i] / (size[i] - w[i])
        across = h * (np.eye(2) - np.outer(way, way))
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += across
        load[i] += across @ b[i] - w[i] * way
    y = np.where(held[:, None], b, 0.0)
    free = np.repeat(~held, 2)
    y.ravel()[free] = np.linalg.solve(A[np.ix_(free, free)], (load.ravel() - A @ y.ravel())[free])
    return y, f - K @ y


# %% [markdown]
# Twenty blocks in a row, tied at one end; a first pull along, then one that turns. We measure the distance to the end
# of the iteration in the energy norm: far away it falls by a quarter a round, while the front runs from block to block
# (neighbours only are coupled), and then it collapses: *superlinear* means that the factor itself tends to zero.

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
errors = np.array([np.sqrt(np.sum((y - iterates[-1][0]) * (row @ (y - iterates[-1][0])))) for y, _ in iterates])
# Numbers of size 10, a condition number below 200: rounding leaves 1e-13.
ends = errors[(errors < 0.5) & (errors > 1e-12)]
factors = ends[1:] / ends[:-1]
assert len(factors) >= 3
assert (np.diff(factors) < 0).all()
assert factors[-1] < 1e-3
assert errors[-2] < 1e-12
print("errors at the end", " ".join(f"{e:.0e}" for e in ends), "| factors", " ".join(f"{r:.0e}" for r in factors))


# %% jupyter={"source_hidden": true}
def errors_picture():
    figure = new_figure(5.6, 3.2)
    axes = figure.add_subplot()
    seen = errors[errors > 1e-13]
    axes.semilogy(np.arange(1, len(seen) + 1), seen, "o-", color=COMPUTED)
    axes.set(xlabel="round", ylabel="error (energy norm)", title="a slow approach, and a superlinear end")
    light_grid(axes)
    return figure


errors_picture()

# %% [markdown]
# ## 3. Running in circles
#
# Two blocks; the first hangs on the second by a spring, the second on the wall by another. The first is pulled back by
# 3, the second forward by 2, and friction is 1 at both.
#
# $$K = \begin{pmatrix} 1 & -1 \\ -1 & 2 \end{pmatrix}, \quad f = (-3, 2), \quad w = (1, 1).$$
#
# The answer: the first slides back to $u_1 = -2$; there the spring carries 2, just what pulls the second, which sticks.
# But let the shift be large, so that any slip at all, however small, decides the guess:
#
# | guess | the system gives | so the next guess is |
# |---|---|---|
# | (back, forward) | $u = (-3, -1)$: the second goes back | (back, back) |
# | (back, back) | $u = (-1, 1)$: the second goes forward | (back, forward) |
#
# For ever the guesses jump over the solution between them, in which the second block sticks. And what the iteration
# returns looks like an answer.

# %%
blocks = (np.array([[1.0, -1.0], [-1.0, 2.0]]), np.array([-3.0, 2.0]), np.ones(2), np.zeros(2))
_, _, circle = active_sets(blocks, shift(blocks[0], 100.0))
assert len(circle) == 40
assert circle[1:5].tolist() == [[-1, 1], [-1, -1], [-1, 1], [-1, -1]]
found, held_by, _ = active_sets(blocks, shift(blocks[0], 0.1))
assert found.tolist() == [-2.0, 0.0]
assert held_by.tolist() == [-1.0, 0.0]
print("large shift:", circle[:5].astype(int).tolist(), "...; small shift:", found)

# %% [markdown]
# A *small* shift asks a block that turns round to stick first: from (back, forward) $q_2 = 1 + c_2 \cdot (-1)$, which
# is not beyond $\pm 1$ while $c_2 \le 2$. So choose $c$ small? It helps: the package takes a tenth of one over the
# flexibility. It is no proof. Let us try 60 random programs.


# %%
def random_program(seed, n=8):
    """Eigenvalues over three orders, bounds over two."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = Q @ np.diag(10.0 ** rng.uniform(-1.5, 1.5, n)) @ Q.T
    b = rng.normal(size=n) * (rng.random(n) < 0.3)
    return 0.5 * (K + K.T), K @ rng.normal(size=n) + rng.normal(size=n), 10.0 ** rng.uniform(-1, 1, n), b


programs = [random_program(seed) for seed in range(60)]
unfinished = {
    size: sum(len(active_sets(program, shift(program[0], size))[2]) == 40 for program in programs)
    for size in (0.1, 1.0, 10.0)
}
assert unfinished[10.0] > 10
print("of 60, still running after 40 rounds:", unfinished)

# %% [markdown]
# ## 4. A safeguard
#
# We need a judge who tells progress from motion and, for when there is no progress, a method that is slow but sure.
#
# *The judge* is the gap of lesson 1, $\tfrac12 r^TK^{-1}r + \sum(w_i|s_i| - \lambda_i s_i)$ with $r = f - \lambda - Ky$
# and $\lambda$ clipped to its bounds: zero at the solution and nowhere else.
#
# *The sure method* goes uphill in the dual, $D(\lambda) = -\tfrac12 (f - \lambda)^TK^{-1}(f - \lambda) - \lambda^Tb$
# over the box $|\lambda_i| \le w_i$. Its gradient is the slip $s = K^{-1}(f - \lambda) - b$ (more friction where it
# slips); $\lambda \leftarrow P(\lambda + \rho s)$ converges for $\rho = 1/|K^{-1}|$ (projected gradient: $D$ is
# concave, its gradient has the Lipschitz constant $1/\rho$).
#
# *Together:* Newton, as long as in five rounds the gap is halved once. Else one sure step, from where the last sure
# step ended, and Newton again from there. **Theorem:** the best gap tends to zero. *Proof.* If it is halved
# again and again, it does. If not, from some round on sure steps are taken for ever; they are those of the projected
# gradient, which converges, and the gap of its points tends to zero: it is halved after all. $\square$


# %%
def gap(program, y, lam):
    K, f, w, b = program
    r = f - lam - K @ y
    return 0.5 * r @ np.linalg.solve(K, r) + np.sum(w * np.abs(y - b) - lam * (y - b))


def safeguarded(program, c, patience=5, rounds=1000):
    """The answer, the gap after every round, and which rounds (from 0) were sure steps."""
    K, f, w, b = program
    flexible = np.linalg.inv(K)
    rate = 1.0 / np.linalg.eigvalsh(flexible).max()
    y, lam, sure, waited, gaps, sure_steps = b, np.zeros(len(f)), np.zeros(len(f)), 0, [], []
    while len(gaps) < rounds:
        is_sure = waited >= patience
        if is_sure:
            sure = np.clip(sure + rate * (flexible @ (f - sure) - b), -w, w)
            y, lam = flexible @ (f - sure), sure
            sure_steps.append(len(gaps))
        else:
            y, lam, _ = newton_step(program, y, lam, c)
        now = gap(program, y, np.clip(lam, -w, w))
        halved = not gaps or now <= 0.5 * min(gaps)
        gaps.append(now)
        if now <= 1e-12 * 0.5 * f @ flexible @ f:
            break
        waited = 0 if halved else patience - 1 if is_sure else waited + 1
    return y, np.array(gaps), sure_steps


# %% [markdown]
# We keep the bad shift, ten, to make it hard. Every program now ends: the gap is below 1e-12 of the energy, the error
# below 1e-6 of its norm. Most would have run in circles, and a few sure steps are enough until Newton sees the right
# sets.

# %%
runs = [safeguarded(program, shift(program[0], 10.0)) for program in programs]
for _program, (_, _gaps, _) in zip(programs, runs, strict=True):
    assert _gaps[-1] <= 1e-12 * 0.5 * _program[1] @ np.linalg.solve(_program[0], _program[1])
needed = [len(sure_steps) for _, _, sure_steps in runs]
assert sum(needed) > 0
assert safeguarded(blocks, shift(blocks[0], 100.0))[0].tolist() == [-2.0, 0.0]
few = np.median([count for count in needed if count])
print(f"all 60 end; {np.count_nonzero(needed)} needed sure steps, {few:.0f} at the median")


# %% jupyter={"source_hidden": true}
def safeguard_picture():
    worst = int(np.argmax(needed))
    c = shift(programs[worst][0], 10.0)
    y, lam, plain = programs[worst][3], np.zeros(8), []
    _, gaps, sure_steps = runs[worst]
    for _ in gaps:
        y, lam, _ = newton_step(programs[worst], y, lam, c)
        plain.append(gap(programs[worst], y, np.clip(lam, -programs[worst][2], programs[worst][2])))
    figure = new_figure(6.4, 3.4)
    axes = figure.add_subplot()
    rounds = np.arange(1, len(gaps) + 1)
    axes.semilogy(rounds, plain, color=SECOND, linewidth=0.8, label="plain active sets: a circle")
    shown = np.maximum(gaps, 1e-13 * gaps.max())
    axes.semilogy(rounds, shown, color=COMPUTED, label="safeguarded")
    axes.semilogy(np.array(sure_steps) + 1, shown[np.array(sure_steps)], ".", color=COMPUTED, label="a sure step")
    axes.set(xlabel="round", ylabel="gap", title="the hardest of the 60")
    light_grid(axes)
    axes.legend(frameon=False)
    return figure


safeguard_picture()

# %% [markdown]
# The package's `vx.Newton` is built like this, with the small shift, a faster sure method (accelerated projected
# gradients on the forces of contact) and cones, bounds and springs beside absolute values. **Question:** the last round
# of the blue curve falls by many orders at once. Which section of this lesson says why?
#
# <details><summary>Answer</summary>
#
# Section 1. The equation is piecewise linear, and on the right piece one linear solve gives its exact solution: the gap
# falls to rounding in one round, however large it was before. (Superlinear convergence, section 2, takes several
# rounds, each faster than the last; it is what remains where $P$ projects on a disc and is not piecewise linear.)
#
# </details>
#
# ## Exercises
#
# 1. For the two blocks, at which shift does the circle begin? Predict it from the table, then try.
# 2. Show that with one unknown and a start from rest nothing cycles, whatever the shift. And from another start?
# 3. Try `active_sets` on a rod of 100 elements, pulled at its end. How many guesses, and why so many more than for the
#    body? Does it help to start from the answer to 9/10 of the pull?
# 4. Use sure steps alone on the 60 programs. How many does the hardest take to a gap of 1e-6 of the energy? Which
#    number of $K$ decides?
# 5. Cycles have length two in section 3. Find out how long those of the random programs are.
#
# Solutions: `lesson_5_solutions.py`.
