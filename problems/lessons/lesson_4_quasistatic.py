# %% [markdown]
"""# Lesson 4, the quasistatic problem: why k drops out, hysteresis, and where the energy goes"""

# %% [markdown]
# *You need:* lessons 1 and 2. *You will see:* that the time step $k$ cancels from the program, that the answer depends
# on the whole *path* of the load, and that every step has an exact energy balance. In all steps together,
# backward Euler causes a numerical loss of $O(k)$.
#
# Lessons 1 and 2 took single steps. Now many steps follow each other. Equation numbers refer to the paper of Feng, Han
# and Huang.

# %%
import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx

# %% [markdown]
# ## 1. Why k cancels
#
# Problem 2.1 of the paper asks for a path $u(t)$ with (2.3): for almost every $t$ and all $v$,
#
# $$a(u, v - \dot u) + j(v) - j(\dot u) \ge \langle \ell, v - \dot u \rangle .$$
#
# Here $a(u, v)$ is the elastic bilinear form ($v^T K u$ for vectors), $j$ measures friction ($\sum_i w_i |v_i|$), and
# $\ell$ is the load ($f$ for vectors). Backward Euler, (2.34), replaces $\dot u$ by $(u_n - u_{n-1})/k$. Here $u_n$ is
# the solution after step $n$; in lessons 1 and 2, $u_{n-1}$ was $u_{prev}$. Friction has no time scale, because $j$ is
# a *seminorm*:
#
# $$j(v/k) = j(v)/k .$$
#
# Write the test velocity as $(v - u_{n-1})/k$, where $v$ is any position. The test velocity minus the velocity is then
# $(v - u_n)/k$. Every term has the factor $1/k$, which cancels:
#
# $$a(u_n, v - u_n) + j(v - u_{n-1}) - j(u_n - u_{n-1}) \ge \langle \ell_n, v - u_n \rangle \quad \text{for all } v.$$
#
# The inequality is the optimality condition of the program
#
# $$\min_u \; \tfrac12 a(u, u) - \langle \ell_n, u \rangle + j(u - u_{n-1}).$$
#
# So the path does not depend on the speed of the load (*rate independence*). We check this on the four sliders of
# lesson 2. The unit of time is one second in one run and $2^{-40}$ seconds in the other. The ratio is a power of two.
# So the loads have the same rounding errors, and both answers agree in all bits.

# %%
chain = np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
norms = vx.Norms(np.eye(4), np.full(4, 0.5))
instants = np.linspace(0.0, 5.0, 41)


def course(t):
    """Return the load at t, which is 0, 1, -1 and 1 at t = 0, 1, 3 and 5, and linear in between."""
    return np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def states(second):
    system = vx.System(chain, lambda t: np.array([2.4, 0, 0, 0]) * course(t / second), norms)
    return vx.march(system, instants * second, solver=vx.Newton()).state


slow, fast = states(1.0), states(2.0**-40)
assert np.array_equal(slow, fast)
assert np.ptp(slow[:, 0]) > 1.0
print("the paths in 5 s and in 5e-12 s agree in all bits")

# %% [markdown]
# ## 2. Hysteresis
#
# We return to the slider of lesson 1, with stiffness $K$ and friction bound $w$. A step clips $u_{n-1}$ to the interval
# from $(f_n - w)/K$ to $(f_n + w)/K$. Let the load grow to a peak $f_{\max}$, then fall to $-f_{\max}$, then grow to
# $f_{\max}$ again. After each reversal the slider rests until the load has changed by $2w$. Between two reversals it
# travels $2(f_{\max} - w)/K$, always against the friction $w$. So friction takes the following energy in one closed
# loop:
#
# $$w \cdot 2 \cdot \frac{2(f_{\max} - w)}{K} .$$

# %%
K, w, peak = 2.0, 1.0, 3.0


def walk(loads):
    u = [0.0]
    for f in loads[1:]:
        u.append(float(np.clip(u[-1], (f - w) / K, (f + w) / K)))
    return np.array(u)


def there_and_back(steps):
    """Return the loads: `steps` steps from 0 to the peak, 2 * `steps` to minus the peak, 2 * `steps` to the peak."""
    down = np.linspace(peak, -peak, 2 * steps + 1)
    return np.concatenate([np.linspace(0, peak, steps + 1), down[1:], -down[1:]])


loads = there_and_back(30)
path = walk(loads)
lost = w * np.abs(np.diff(path[30:])).sum()
closed_form = 4 * w * (peak - w) / K
assert abs(lost - closed_form) < 120e-16 * closed_form
assert abs(path[-1] - path[30]) < 1e-15, "the loop closes"
print(f"energy lost in the loop: {lost:.12f}, by the formula {closed_form:.12f}")

# %% [markdown]
# At $f = 0$ the slider is at $w/K$ if the load falls, and at $-w/K$ if the load rises. With friction the position is
# not a function of the load. **Question:** on which parts of the loop does the slider rest, and where do you see the
# number $2w$?
#
# <details><summary>Answer</summary>
#
# The slider rests on the two vertical sides of the loop, at $u = (f_{\max} - w)/K = 1$ while the load falls from
# $f_{\max} = 3$ to $f_{\max} - 2w = 1$, and at $u = -1$ while the load rises from $-3$ to $-1$. Both sides have the
# height $2w = 2$: the force of friction changes from $w$ to $-w$ before the slider moves.
#
# </details>


# %% jupyter={"source_hidden": true}
# Picture: load over position of one slider, a closed parallelogram whose area is the energy lost in the loop
def loop_picture():
    figure, axes = plt.subplots(figsize=(5.6, 3.9), layout="constrained")
    rests = np.append(True, np.diff(path) == 0.0)
    axes.fill(path[30:], loads[30:], facecolor="0.9", edgecolor="0.45", label=f"energy lost in the loop: {lost:g}")
    axes.plot(path, loads, color="0.6", linewidth=1.0)
    for chosen, colour, words in ((rests, "tab:blue", "sticks"), (~rests, "tab:orange", "slips")):
        axes.plot(path[chosen], loads[chosen], "o", color=colour, markersize=4, label=words)
    axes.set(xlabel="position $u$", ylabel="load $f$", title="one slider on a spring")
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.legend(frameon=False)
    plt.close(figure)
    return figure


loop_picture()

# %% [markdown]
# ## 3. The energy balance of a step
#
# The forces balance at the *end* of a step, $K u_n + \lambda_n = f_n$, and $\lambda_n s_n = w|s_n|$ for the slip
# $s_n = u_n - u_{n-1}$. Multiply the balance by $s_n$, and use
# $u_n s_n = \tfrac12 u_n^2 - \tfrac12 u_{n-1}^2 + \tfrac12 s_n^2$:
#
# $$\underbrace{f_n\, s_n}_{\text{work}} = \underbrace{\tfrac12 K u_n^2 - \tfrac12 K u_{n-1}^2}_{\text{stored}}
#   + \underbrace{w |s_n|}_{\text{lost to friction}} + \underbrace{\tfrac12 K s_n^2}_{\text{numerical}} .$$
#
# This balance is exact. The last term is an error of backward Euler: the work uses the load at the end of the step.
# This load differs from the mean load of the step by half of the change. There are $O(1/k)$ steps with slips of $O(k)$,
# so the sum of the numerical terms is $O(k)$. For our slider we compute the sum. If the load changes by $\Delta f$ in
# every step, a moving slider slips by $s_n = \pm\Delta f/K$, and it travels $5(f_{\max} - w)/K$ in all. So
#
# $$\sum_n \tfrac12 K s_n^2 = \tfrac12\, \Delta f \cdot \frac{5 (f_{\max} - w)}{K} .$$


# %%
def balance(steps):
    f = there_and_back(steps)
    u = walk(f)
    s = np.diff(u)
    return np.sum(f[1:] * s), 0.5 * K * u[-1] ** 2, w * np.abs(s).sum(), 0.5 * K * np.sum(s**2)


for _steps in (30, 60, 120):
    _work, _stored, _friction, _numerical = balance(_steps)
    assert abs(_work - _stored - _friction - _numerical) < 600e-15
    assert abs(_friction - 5 * w * (peak - w) / K) < 600e-15, "the loss to friction has no error"
    assert abs(_numerical - 0.5 * (peak / _steps) * 5 * (peak - w) / K) < 600e-15
    print(
        f"{_steps:4d} steps up: work {_work:g} = stored {_stored:g} + friction {_friction:g} + numerical {_numerical:g}"
    )

# %% [markdown]
# ## 4. A body
#
# Now we pull the body of the paper's Section 4 to and fro, with half of the paper's friction bound. The body is
# elastic, and each node of its lower side acts like a slider. The nodes do not start to slip at the same time, so the
# sides of the loop are bent. The energy balance is the same. After $N$ steps from $u_0 = 0$, with
# $s_n = u_n - u_{n-1}$,
#
# $$\sum_n \langle \ell_n, s_n \rangle = \tfrac12 a(u_N, u_N) + \sum_n j(s_n) + \sum_n \tfrac12 a(s_n, s_n),$$
#
# and the package reports the first three terms as `history.work`, `.energy` and `.dissipated`. The last sum is the
# numerical loss of backward Euler. If the time step is halved, this loss is about halved: we assert a ratio between 1.9
# and 2.1. The package warns if the numerical loss exceeds 5 % of the work, as it does here.


# %%
def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * course(t), np.full(len(x), -0.01 * course(t))])


body = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(bound=2.0, on="bottom"),
)
mesh = vx.meshes.squares(8)
histories = {steps: vx.simulate(body, mesh, np.linspace(0, 5, steps + 1)) for steps in (40, 80, 160)}


def numerical(history):
    return history.work - (history.energy - history.energy[0]) - history.dissipated


for _steps, _history in histories.items():
    assert (np.diff(numerical(_history)) > -1e-14 * _history.work.max()).all(), "the numerical loss only grows"
    print(f"{_steps:4d} steps: lost to friction {_history.dissipated[-1]:.6f}, numerical {numerical(_history)[-1]:.6f}")
for _coarse, _fine in ((40, 80), (80, 160)):
    assert 1.9 < numerical(histories[_coarse])[-1] / numerical(histories[_fine])[-1] < 2.1


# %% jupyter={"source_hidden": true}
# Picture: load over displacement of a body, a loop with bent sides; energies over time, which add up to the work
def body_picture(history):
    figure, (loop, energies) = plt.subplots(1, 2, figsize=(8.4, 3.6), layout="constrained")
    left = history.mesh.points[:, 0] == 0
    t = history.times
    loop.plot(1e3 * history.displacement[:, left, 0].mean(axis=1), course(t), color="tab:blue")
    loop.set(xlabel="mean displacement of the left side (1e-3)", ylabel="load", title="the body's loop has bent sides")
    parts = history.energy, history.dissipated, numerical(history)
    names = "stored", "lost to friction", "numerical"
    energies.stackplot(t, *parts, labels=names, colors=("tab:blue", "tab:orange", "tab:green"), alpha=0.7)
    energies.plot(t, history.work, color="black", linewidth=1.2, label="work of the load")
    energies.set(xlabel="time", ylabel="energy", title="the energies add up to the work")
    energies.legend(frameon=False, loc="upper left", fontsize="small")
    for axes in (loop, energies):
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
    plt.close(figure)
    return figure


body_picture(histories[40])

# %% [markdown]
# **Question:** is the loop steeper just after a reversal or just before the next reversal? How does the stiffness of
# the body change in between?
#
# <details><summary>Answer</summary>
#
# The loop is steeper just after a reversal. Then all eight nodes of the lower side stick. Later the nodes start to slip
# one after another. A node that slips carries a constant force and adds no stiffness. Just before the next reversal
# only one node sticks. The slope, load over mean displacement, has fallen from 62.7 to 39.7: the body has lost 37 % of
# its stiffness. Just after the reversal the stiffness is 62.7 again.
#
# </details>
#
# ## 5. The distance of two states never grows
#
# Two equal bodies have different states at some instant. From this instant on they carry the same load. The states of
# the bodies are $u_n$ and $\bar u_n$. Take $v = u_{n-1} + \bar u_n - \bar u_{n-1}$ in the inequality of the first body,
# and exchange the roles for the second. If we add both inequalities, the terms in $j$ cancel, and
#
# $$\begin{gathered} a(u_n - \bar u_n,\; u_n - \bar u_n) \le a(u_n - \bar u_n,\; u_{n-1} - \bar u_{n-1}) \\
#   \Rightarrow\quad |u_n - \bar u_n|_a \le |u_{n-1} - \bar u_{n-1}|_a . \end{gathered}$$
#
# The map of a step is *nonexpansive* in the energy norm; this is (2.38). So a later step does not amplify the error of
# an earlier step. The sum of the certificates of all steps bounds the error at the end.

# %%
later = np.linspace(1.0, 9.0, 161)


def march_from(past):
    """Return the states of the chain from t = 1 on, where the load before t = 1 depends on `past`."""

    def load(t):
        shared = np.interp(t, [1, 2, 4, 6, 9], [0, 0.6, -0.6, 1.0, -1.2])
        return np.interp(t, [0, 0.5, 1], [0, past, 0]) * np.eye(4)[0] + shared * np.array([1, 0, -1.5, 0])

    times = np.concatenate([np.linspace(0.0, 1.0, 11)[:-1], later])
    return vx.march(vx.System(chain, load, norms), times, solver=vx.Newton()).state[10:]


def distance(one, other):
    return np.sqrt(np.einsum("ni,ij,nj->n", one - other, chain, one - other))


apart = distance(march_from(3.0), march_from(-2.0))
assert (np.diff(apart) <= 1e-14).all()
assert apart[-1] < 0.5 * apart[0]


# %% jupyter={"source_hidden": true}
# Picture: the distance of two states with different pasts; under the same load this distance falls in steps
def memory_picture():
    figure, axes = plt.subplots(figsize=(5.6, 3.0), layout="constrained")
    axes.plot(later, apart, color="tab:orange")
    axes.set(xlabel="time", ylabel="distance in energy norm", ylim=(0, None), title="two pasts under one load")
    axes.grid(color="0.9")
    plt.close(figure)
    return figure


memory_picture()

# %% [markdown]
# ## Exercises
#
# 1. The load on the slider of section 2 grows to $f_{\max}$, and falls to 0. Backward Euler uses the loads at the ends
#    of steps only, and misses the peak if no step ends at the peak. How large can the error of the final position be?
# 2. If the load only grows, one step or a hundred steps bring a slider to the same place. Why? Does this also hold for
#    the chain?
# 3. Add a damper: $K u + c\,\dot u + \lambda = f$. How do section 1 and the energy balance change?
# 4. Twenty sliders, each on its own spring of stiffness 1, with the bounds 0.1, 0.2, ..., 2, share a displacement $U$.
#    Draw the total force over $U$ for $U$ up to 2 and back to -2. Show that the curve for falling $U$ is the curve of
#    the first loading, magnified by two (Masing's rule).
# 5. Why does (2.1) of the paper require $a(u_0, v) + j(v) \ge \langle \ell(0), v \rangle$? What does `march` report if
#    a load of 2.4 acts on the chain from the start, at $u_0 = 0$?
#
# Solutions: `lesson_4_solutions.py`.
