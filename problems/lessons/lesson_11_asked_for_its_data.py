# %% [markdown]
"""# Lesson 11, data from answers: derivatives, fits, and the limit load"""

# %% [markdown]
# *You need:* active sets (lesson 5), the dual of a step (lesson 9), least squares. *You will see:* forward and adjoint
# derivatives of an answer with respect to the data; a fit to a noisy loop; and the largest load, from a cone program.
#
# So far we knew the data, such as stiffness, loads and friction bounds, and computed the answer. Now we know the
# answer, or a part of it, and look for the data: which friction explains a measured loop? How large may the load
# become?

# %%
import cvxpy as cp
import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx

# %% [markdown]
# ## 1. One slider: an answer with a kink
#
# The slider of lesson 1 rests at $u = 0$ and is pulled by $f > 0$. The slider stops at
#
# $$u(K, f, w) = \max\Bigl(0, \frac{f - w}{K}\Bigr) .$$
#
# The answer is a function of the data. Its derivative is
#
# $$\frac{\partial u}{\partial (K, f, w)} = \begin{cases} (0, 0, 0) & \text{sticks: } f < w, \\
#   \bigl(-(f - w)/K^2,\; 1/K,\; -1/K\bigr) & \text{slips: } f > w. \end{cases}$$
#
# Below we compare this formula with difference quotients, and with `vx.sensitivities`. The package needs a body: a unit
# square of rubber with Poisson's ratio zero, whose top moves by $f/K$. The square is the spring, and its bottom side is
# the slider.


# %%
def answer(K, f, w):
    return max(0.0, (f - w) / K)


def derivative(K, f, w):
    return np.array([-(f - w) / K**2, 1 / K, -1 / K]) if f > w else np.zeros(3)


def quotient(data, steps):
    """Return difference quotients of the answer; each changes one datum."""
    moved = np.asarray(data) + np.diag(steps)
    return np.array([(answer(*one) - answer(*data)) / step for one, step in zip(moved, steps, strict=True)])


def shear_square(data):
    """Return the scene of the square of rubber, whose bottom side moves like the slider."""
    K, f, w = data
    return vx.Scene(
        vx.Elasticity(young=2 * K, poisson=0.0),
        vx.PrescribedDisplacement(lambda x, t: [f / K * t, 0.0], on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0)),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(w, on="bottom"),
    )


def differentiate_slider(data):
    return vx.sensitivities(shear_square, data, vx.meshes.squares(1), [0.0, 1.0], ["displacement at (0, 0) x"])


slips, sticks = [2.0, 3.0, 1.0], [2.0, 0.5, 1.0]
for _data in (slips, sticks):
    _found = differentiate_slider(_data)
    print(f"K, f, w = {_data}: derivatives {derivative(*_data)}")
    assert abs(_found.values[0, -1] - answer(*_data)) <= 1e-9
    assert np.abs(_found.jacobian[0, -1] - derivative(*_data)).max() <= 1e-9
    assert np.abs(quotient(_data, [1e-6] * 3) - derivative(*_data)).max() <= 1e-5
    assert not _found.one_sided.any()

# %% [markdown]
# **At the kink**, $f = w$, the answer has only one-sided derivatives. A larger pull moves the slider, a smaller pull
# does not. If the force of friction differs from its bound by no more than the certificate, the package returns one of
# the two one-sided derivatives, logs a warning, and sets the entry of the step in the array `one_sided` to True.

# %%
kink = [2.0, 1.0, 1.0]
more, less = quotient(kink, [1e-6] * 3), quotient(kink, [-1e-6] * 3)
at_kink = differentiate_slider(kink)
print(f"derivatives by f and w: to the right {more[1:].round(6)}, to the left {less[1:].round(6)}")
assert np.abs(more - [0.0, 0.5, 0.0]).max() <= 1e-9
assert np.abs(less - [0.0, 0.0, -0.5]).max() <= 1e-9
assert at_kink.one_sided.tolist() == [False, True]
_sides = [derivative(2.0, 1.0 + side, 1.0) for side in (-1e-9, 1e-9)]
assert min(np.abs(at_kink.jacobian[0, -1] - side).max() for side in _sides) <= 1e-8

# %% [markdown]
# **Question:** A program computes the derivative with respect to $w$ by a *central* difference quotient, over an
# interval that contains the kink. Which values can the quotient have, and how would you notice the error?
#
# <details><summary>Answer</summary>
#
# The quotient can have every value between the two derivatives, here between $-1/K$ and 0. Smaller intervals need not
# help: if the kink is the centre, the quotient is $-1/(2K)$ for every interval. Compare the quotients of both halves of
# the interval instead. Without a kink in the interval, the difference of both quotients tends to zero with the length
# of the interval. With the kink in the centre, this difference is $1/K$ for every interval.
#
# </details>
#
# ## 2. Eight nodes: forward and adjoint
#
# We take the step of lesson 9 again, from rest, with eight contact nodes. If we know which nodes stick and in which
# direction the others slip, the answer $y = (u, \lambda)$ obeys *linear* equations. The first equation is the balance
# of forces. The second equation holds at nodes that stick, the third at nodes that slip:
#
# $$K u + \lambda = f, \qquad u_i = 0 \;\text{ or }\; \lambda_i = w_i\, \mathrm{sign}(u_i) .$$
#
# The parameters $\theta$ are the eight bounds $w_i$ and a factor of the load. Only the right-hand sides of these
# equations depend on $\theta$. So the derivatives obey
#
# $$M\, dy = R\, d\theta, \qquad M = \begin{pmatrix} K & I \\ \text{stick} & \text{slip} \end{pmatrix},$$
#
# where "stick" is the diagonal matrix with ones at the nodes that stick, "slip" is the diagonal matrix with ones at the
# nodes that slip, and $R$ contains the derivatives of the right-hand sides. $M$ is the matrix of the last iteration of
# Newton's method.


# %%
def pull(x, t):
    """Return the load of lesson 9, multiplied by sin(pi t / 2)."""
    return np.sin(np.pi * t / 2) * np.column_stack([8 * (1.25 - x[:, 1]), np.full(len(x), -0.01)])


def block(young, bound):
    return vx.Scene(
        vx.Elasticity(young, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


mesh = vx.meshes.squares(8)
step = next(vx.programs(block(200.0, 4.0), mesh, [0.0, 1.0]))
K, f, w, m = step.operators.K, step.g, step.w, len(step.g)


def build_matrices(sign):
    """Return M, and R for the bounds. The entries of `sign` are directions of slip, or 0 at nodes that stick."""
    stick, none = np.diag(1.0 * (sign == 0)), np.zeros((m, m))
    return np.block([[K, np.eye(m)], [stick, np.eye(m) - stick]]), np.vstack([none, np.diag(sign)])


M, by_bounds = build_matrices(np.sign(step.answer.d))
R = np.column_stack([by_bounds, np.append(f, np.zeros(m))])
print(f"{np.count_nonzero(step.answer.d)} of {m} nodes slip; {R.shape[1]} parameters")

# %% [markdown]
# We are interested in two quantities $Q = b^T y$: the displacement of the left end, and the sum of all friction forces.
# The derivatives $b^T M^{-1} R$ can be computed in two orders:
#
# $$\text{forward: } b^T (M^{-1} R), \qquad \text{adjoint: } (M^{-T} b)^T R = z^T R, \quad M^T z = b .$$
#
# The forward order needs one solve for each *parameter*, the adjoint order needs one solve for each *quantity*.

# %%
b = np.zeros((2 * m, 2))
b[0, 0] = b[m:, 1] = 1.0
forward = b.T @ np.linalg.solve(M, R)
adjoint = np.linalg.solve(M.T, b).T @ R
print(f"forward {R.shape[1]} solves, adjoint {b.shape[1]}; difference {np.abs(forward - adjoint).max():.0e}")
assert np.abs(forward - adjoint).max() <= 1e-13 * np.abs(forward).max()


def quantities(theta):
    """Return both quantities for other bounds and another factor of the load, from a new solution of the step."""
    system = vx.System(K, lambda t: t * theta[m] * f, vx.Norms(np.eye(m), theta[:m]))
    run = vx.march(system, [0.0, 1.0], solver=vx.Newton(accuracy=1e-12))
    return b.T @ np.append(run.state[-1], run.multipliers[-1])


theta = np.append(w, 1.0)
differences = [(quantities(theta + one) - quantities(theta - one)) / 2e-4 for one in 1e-4 * np.eye(m + 1)]
# While the active sets stay the same, the answer is linear in theta, so difference quotients are exact up to rounding.
assert np.abs(np.transpose(differences) - forward).max() <= 1e-8 * np.abs(forward).max()

# %% [markdown]
# **Many steps.** A node that sticks in step $n$ stays at its old place, $u_n = u_{n-1}$. So $dy_n$ depends on
# $dy_{n-1}$. The forward sweep runs through the steps forwards in time, the adjoint sweep backwards:
#
# $$M_n\, dy_n = R_n\, d\theta + T_n\, dy_{n-1}, \qquad M_n^T z_n = b_n + T_{n+1}^T z_{n+1}, \qquad
#   \frac{dQ}{d\theta} = \sum_n R_n^T z_n ,$$
#
# where $b_n$ is the derivative of $Q$ with respect to $y_n$. For the nodes that stick, the matrix $T_n$ copies the
# displacements of step $n - 1$. The load of the block grows, falls to the opposite value and returns to zero, in 32
# steps. The quantity is the displacement of the left end after the last step; the parameters are the eight bounds.

# %%
times = np.linspace(0.0, 4.0, 33)
wave = vx.System(K, lambda t: np.sin(np.pi * t / 2) * f, vx.Norms(np.eye(m), w))
run = vx.march(wave, times, solver=vx.Newton(accuracy=1e-12))
signs = np.sign(np.where(run.sticking, 0.0, np.diff(run.state, axis=0, prepend=0.0)))[1:]
solved = {"forward": 0, "adjoint": 0}


def recall(sign):
    """Return T, which copies the displacements of sticking nodes from the step before."""
    T = np.zeros((2 * m, 2 * m))
    T[m:, :m] = np.diag(1.0 * (sign == 0))
    return T


dy = np.zeros((2 * m, m))
for _sign in signs:
    _M, _R = build_matrices(_sign)
    dy = np.linalg.solve(_M, _R + recall(_sign) @ dy)
    solved["forward"] += m
gradient, carried = np.zeros(m), b[:, 0]
for _sign in signs[::-1]:
    _M, _R = build_matrices(_sign)
    _z = np.linalg.solve(_M.T, carried)
    gradient, carried = gradient + _R.T @ _z, recall(_sign).T @ _z
    solved["adjoint"] += 1
print(f"solves: {solved}; gradient {1e3 * gradient.round(6)} (1e-3)")
assert solved == {"forward": 32 * m, "adjoint": 32}
assert np.abs(gradient - dy[0]).max() <= 1e-13 * np.abs(gradient).max()

# %% [markdown]
# `vx.sensitivities` computes both sweeps for a scene: `jacobian` is forward, `gradient` is adjoint. Here the bound has
# a value at each node, and `shapes` contains the hat functions of the nodes. A nodal bound $w_i$ is the value at the
# node times a length.


# %%
def shapes(x):
    """Return the hat functions of the eight nodes at points x."""
    return np.stack([np.interp(x[:, 0], np.linspace(0, 1, m + 1), hat) for hat in np.eye(m + 1)[:m]], axis=1)


def varying(bounds):
    return block(200.0, lambda x, t: shapes(x) @ bounds)


left = "displacement at (0, 0) x"
found = vx.sensitivities(varying, np.full(m, 4.0), mesh, times, [left], shapes=shapes)
last = np.zeros(found.values.shape)
last[0, -1] = 1.0
length = found.history.contact.friction_lengths
assert np.abs(found.gradient(last) - length * gradient).max() <= 1e-9 * np.abs(length * gradient).max()
assert np.abs(found.jacobian[0, -1] - found.gradient(last)).max() <= 1e-12 * np.abs(found.jacobian).max()

# %% [markdown]
# **Question:** You fit three parameters to a force that was measured at 64 instants. A colleague fits the bounds of
# 1,000 contact nodes, and minimises one sum of squares. Who needs which sweep?
#
# <details><summary>Answer</summary>
#
# You need the forward sweep: three right-hand sides in each step yield the derivatives at all 64 instants. The
# Gauss-Newton method needs all these derivatives, and the adjoint would need 64 backward sweeps. Your colleague needs
# the adjoint: the sum of squares is one quantity, so one backward sweep yields all 1,000 derivatives. The forward sweep
# would carry 1,000 columns.
#
# </details>
#
# ## 3. A fit to a noisy loop
#
# We measure the displacement of the left end during the 32 steps, with noise of one per cent. We look for Young's
# modulus and the friction bound that minimise the sum of squared residuals
#
# $$\sum_n r_n(\theta)^2, \qquad r_n = Q_n(\theta) - \text{measured}_n .$$
#
# The standard errors follow from the Jacobian $J = dr/d\theta$. If the noise has the standard deviation $\sigma$, the
# covariance of the fitted parameters is, to first order,
#
# $$\sigma^2 (J^T J)^{-1} .$$

# %%
true, names = np.array([200.0, 4.0]), ("young", "bound")
exact = vx.sensitivities(lambda theta: block(*theta), true, mesh, times, [left]).values[0]
sigma = 0.01 * np.abs(exact).max()
measured = exact + sigma * np.random.default_rng(11).standard_normal(len(times))


def fit_from(start):
    data, limits = {left: measured}, (0.0, np.inf)
    return vx.fit(lambda theta: block(*theta), start, mesh, times, data, bounds=limits, names=names)


fit = fit_from([150.0, 2.0])
print(fit)
assert (np.abs(fit.theta - true) <= 3 * fit.errors).all()
_J = vx.sensitivities(lambda theta: block(*theta), fit.theta, mesh, times, [left]).jacobian[0]
_noise = np.sqrt(np.sum((fit.values[left] - measured) ** 2) / (len(times) - 2))
assert np.abs(fit.errors / (_noise * np.sqrt(np.diag(np.linalg.inv(_J.T @ _J)))) - 1).max() <= 1e-4

# %% [markdown]
# **A step is a convex program, but a fit is not.** With these data, a search that starts at the bound 8 ends at another
# answer. The standard errors of this answer are small, too, because they describe only a neighbourhood of the answer.
# But the residuals are much larger than the noise of the measurement. So start the search from several parameters, and
# compare the residuals with the noise.

# %%
elsewhere = fit_from([150.0, 8.0])
print(f"young and bound {elsewhere.theta.round(2)} with errors {elsewhere.errors.round(2)}")
print(f"residuals over noise: {elsewhere.noise[left] / sigma:.1f} here, {fit.noise[left] / sigma:.1f} before")
assert (np.abs(elsewhere.theta - true) > 3 * elsewhere.errors).all()
assert 0.7 < fit.noise[left] / sigma < 1.3
assert elsewhere.noise[left] > 3 * fit.noise[left]

# %% jupyter={"source_hidden": true}
# Picture: the measured loop of displacement over load, the fitted loop through its points, and a wrong fit
_figure, _axes = plt.subplots(figsize=(6.0, 3.8), layout="constrained")
_load = np.sin(np.pi * times / 2)
_axes.plot(_load, elsewhere.values[left], "--", color="0.5", label="search from the bound 8")
_axes.plot(_load, fit.values[left], "-", color="tab:orange", label="search from the bound 2")
_axes.plot(_load, measured, "o", color="tab:blue", markersize=4, label="measured")
_axes.set(xlabel="factor of the load", ylabel="displacement of the left end", title="a loop and two fits")
_axes.grid(color="0.9")
_axes.legend(frameon=False)
plt.close(_figure)
_figure

# %% [markdown]
# **What a measurement does not determine.** Now let the bound of each node be a parameter. A node that never slips has
# $|\lambda_i| < w_i$ in all steps. So the column of $J$ for its bound is zero, wherever we measure. $J^T J$ is
# singular, and least squares alone cannot determine this bound.
#
# To determine the bounds of all nodes, we need an assumption. For example, assume that each bound is known beforehand,
# with the standard deviation 2. Then the covariance is
#
# $$\Bigl(\frac{J^T J}{\sigma^2} + \frac{I}{2^2}\Bigr)^{-1} .$$

# %%
surface = [f"displacement at ({x}, 0) x" for x in np.arange(m) / m]
by_nodes = vx.sensitivities(varying, np.full(m, 4.0), mesh, times, surface, shapes=shapes)
never = by_nodes.history.contact.sticking.all(axis=0)
noise, assumed = 0.01 * np.abs(by_nodes.values).max(), 2.0
J = by_nodes.jacobian.reshape(-1, m)
after = np.sqrt(np.diag(np.linalg.inv(J.T @ J / noise**2 + np.eye(m) / assumed**2)))
print("standard errors of the bounds", after.round(2))
assert 0 < np.count_nonzero(never) < m
assert not J[:, never].any()
assert np.abs(after[never] - assumed).max() <= 1e-12
assert (after[~never] < 0.5 * assumed).all()

# %% [markdown]
# If a node never slips, its bound is at least the largest friction force at this node. All larger bounds explain the
# measurements equally well; a smaller bound changes the answer.

# %%
borne = np.abs(by_nodes.history.contact.traction[:, :, 0]).max(axis=0)
print(f"largest friction where the contact never slips {borne[never].round(2)}; the bound is 4")
assert (borne[never] < 4.0).all()
for _factor, _same in ((0.99, False), (1.01, True), (10.0, True)):
    _other = vx.simulate(varying(np.where(never, _factor * borne, 4.0)), mesh, times).displacement
    _away = np.abs(_other - by_nodes.history.displacement).max() / np.abs(_other).max()
    assert (_away <= 1e-7) == _same

# %% [markdown]
# ## 4. The limit load: a program without stiffness
#
# A plate lies on a rough plane, and friction alone holds it. A force $\alpha$ pushes one end in the plane, at right
# angles to the axis of the plate. How large may $\alpha$ become? The plate has three rigid motions: two translations
# and a rotation.
#
# Friction forces $\lambda_i$ must balance the push. The columns of $N_i$ are the rigid motions of node $i$, and $f$
# contains the work of a unit push in the rigid motions. The bound per area is 1, so $w_i$ equals the area of node $i$:
#
# $$\max \alpha \quad \text{subject to} \quad \sum_i N_i^T \lambda_i = \alpha f, \qquad |\lambda_i| \le w_i .$$

# %%
grid = np.stack(np.meshgrid(np.linspace(-2, 2, 9), np.linspace(-0.5, 0.5, 5), indexing="ij"), axis=-1).reshape(-1, 2)
area = 0.5 * 0.25 * np.where(np.abs(grid[:, 0]) == 2, 0.5, 1.0) * np.where(np.abs(grid[:, 1]) == 0.5, 0.5, 1.0)
N = np.array([[[1.0, 0.0, -y], [0.0, 1.0, x]] for x, y in grid])
push = np.array([0.0, 1.0, 2.0])  # work of a unit force along y at x = 2 in the three motions

lam, alpha = cp.Variable(grid.shape), cp.Variable()
balance = N.reshape(-1, 3).T @ cp.vec(lam, order="C") == alpha * push
cp.Problem(cp.Maximize(alpha), [balance, cp.norm(lam, axis=1) <= area]).solve(solver="CLARABEL")
motion = balance.dual_value
print(f"largest force {alpha.value:.8f}; motion {motion.round(4)}")

# %% [markdown]
# The multipliers of the balance are the rigid motion $\xi$ in which the plate fails: a rotation about a point of its
# axis.
#
# We exchange maximum and minimum as in lesson 9. The dual program minimises the work of friction over all
# motions in which the push does the work 1:
#
# $$\alpha^* = \min_\xi \sum_i w_i\, |N_i \xi| \quad \text{subject to} \quad f^T \xi = 1 .$$
#
# If $\lambda$ and $\alpha$ satisfy the constraints, $\alpha$ is a lower bound of $\alpha^*$. Every motion with
# $f^T \xi = 1$ gives an upper bound. `vx.limit_load` returns both bounds, for the elastic plate in space.

# %%
xi = motion / (push @ motion)
centre = -xi[1] / xi[2]
upper = area @ np.linalg.norm(N @ xi, axis=1)
assert abs(upper - alpha.value) <= 1e-6 * upper
assert abs(xi[0]) <= 1e-6
for _other in np.random.default_rng(4).normal(size=(20, 3)):
    assert area @ np.linalg.norm(N @ _other, axis=1) >= (1 - 1e-6) * alpha.value * abs(push @ _other)

scene = vx.Scene(vx.Elasticity(2e5, 0.3), vx.BilateralContact(on="bottom"), vx.TrescaFriction(1.0, on="bottom"))
load = vx.Traction(lambda x, t: np.tile([0.0, 2.0, 0.0], (len(x), 1)), on="right")  # a unit force on 1 x 0.5
limit = vx.limit_load(scene, vx.meshes.cubes((8, 4, 1), box=((-2, 2), (-0.5, 0.5), (0, 0.5))), load)
print(f"vx.limit_load: {limit.factor:.8f} to {limit.upper:.8f}; {limit.mechanism}")
assert limit.factor - 1e-6 <= alpha.value <= limit.upper + 1e-6
assert upper < area.sum()  # a push through the middle would not rotate the plate, and has the limit load area.sum()

# %% jupyter={"source_hidden": true}
# Picture: the plate from above; friction forces at the limit run around the centre of rotation on the axis of the plate
_figure, _axes = plt.subplots(figsize=(7.4, 3.2), layout="constrained")
_axes.fill([-2, 2, 2, -2], [-0.5, -0.5, 0.5, 0.5], facecolor="0.94", edgecolor="0.4")
_axes.quiver(*grid.T, *-lam.value.T, color="tab:orange", width=0.004, label="friction on the plate")
_axes.plot(centre, 0.0, "o", color="black", label="centre of rotation")
_axes.annotate("", (2.15, 0.5), (2.15, -0.5), arrowprops={"arrowstyle": "-|>", "color": "tab:blue", "linewidth": 2})
_axes.text(2.25, 0.0, "push", va="center")
_axes.set(aspect="equal", xlabel="$x$", ylabel="$y$", xlim=(-2.3, 2.8), ylim=(-0.8, 0.8), title="limit load")
_figure.legend(frameon=False, loc="outside lower center", ncols=2)
plt.close(_figure)
_figure

# %% [markdown]
# ## Exercises
#
# 1. The friction work $\sum_n w^T |u_n - u_{n-1}|$ contains the bounds explicitly. Extend the adjoint sweep of
#    section 2 to this quantity, and check the gradient by difference quotients.
# 2. A footing of the width $W$ and the weight $G$ stands on its two edges. A horizontal force acts at the height $h$.
#    At edge $i$ the pressure is $p_i \ge 0$, and the friction force obeys Coulomb's law, $|\lambda_i| \le \mu p_i$.
#    Write the limit load as a linear program, and compare it with $\min(\mu G,\, GW/2h)$. What is the motion if $\mu G$
#    is smaller, and if $GW/2h$ is smaller?
# 3. *Shakedown.* Two sliders in the plane are coupled by springs. A cycle of loads $\alpha f(t)$ is repeated again and
#    again. By Melan's theorem slip stops if constant forces $\bar\lambda_i$ exist with
#    $|\bar\lambda_i + \alpha \lambda^e_i(t)| < w_i$, where $\lambda^e_i$ are the friction forces for $\alpha = 1$ if
#    nothing slips. Let $r_i$ be the radius of the smallest disc that contains all points $\lambda^e_i(t)$. Show that
#    the largest $\alpha$ is $\min_i w_i/r_i$. Run 100 cycles with 0.98 and with 1.02 times this $\alpha$.
#
# Solutions: `lesson_11_solutions.py`.
