# %% [markdown]
"""# Lesson 8, your own effect: how one file adds dashpots to a boundary, and how to test them against closed forms"""

# %% [markdown]
# *You need:* weak forms, lesson 4 (the quasistatic problem). *You will see:* that each effect adds arrays to a scene,
# that an effect needs twenty lines, and that a closed form in space *and* time is a test that finds mistakes.
#
# A scene is a list of *effects*: elasticity, supports, loads, friction. No effect depends on the others. On a given
# mesh each effect contributes arrays to one or more terms of
#
# $$a(u, v - \dot u) + b(\dot u, v - \dot u) + j(v) - j(\dot u) \ge \langle \ell(t), v - \dot u \rangle :$$
#
# stiffness to $a$, viscosity to $b$, friction bounds to $j$, loads to $\ell$; supports and obstacles restrict the
# admissible $v$. The scene adds all contributions.
#
# Our example is *dashpots*: shock absorbers along a part $\Gamma$ of the boundary. The traction $\sigma n$ of the
# dashpots resists the velocity, where $\sigma$ is the stress and $n$ the outward normal. The damping $c$ is a force per
# area and velocity:
#
# $$\sigma n = -c\, \dot u \quad \text{on } \Gamma, \qquad c \ge 0 .$$
#
# In the weak form the traction multiplies $v$. We move this term to the left side of the inequality:
#
# $$b(\dot u, v) = \int_\Gamma c\, \dot u \cdot v\, ds .$$
#
# Springs with the stiffness $\beta$ per area have the term $\int_\Gamma \beta\, u \cdot v\, ds$. For $\beta = c$ the
# matrix of the springs is the matrix of $b$. The package has springs, so our effect is short. Three helpers are useful:
# `Contribution` collects arrays, `data` evaluates constants and functions, and `amount` and `where` describe data and
# boundaries in words.

# %%
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

import vemcvx as vx
from vemcvx.effects import Contribution, data
from vemcvx.effects.effect import amount, where
from vemcvx.vem import Space


@dataclass(frozen=True)
class Dashpots(vx.Effect):
    """Dashpots between a part of the boundary and the ground: sigma n = -damping * velocity.

    Parameters
    ----------
    damping : number, or callable f(x) -> (m,)
        Force per area and velocity, >= 0.
    on : str or sequence of str
        Boundary names.
    """

    damping: data.Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        """Return the matrix of b, which is the matrix of springs."""
        space.part(self.on, "Dashpots")  # refuses an unknown name
        springs = vx.ElasticFoundation(self.evaluate, self.evaluate, on=self.on)
        return Contribution(viscosity=springs.contribute(space).stiffness)

    def evaluate(self, x):
        """Return the damping (m,) at points (m, 2); raise SceneError if it is negative."""
        c = data.coefficient(self.damping, x, "Dashpots: damping")
        if (c < 0).any():
            raise vx.SceneError(f"Dashpots: found damping = {c.min():.6g}; it must be >= 0, or energy would be gained.")
        return c

    def describe(self):
        """Return one line for `vemcvx show`."""
        return f"Dashpots: damping {amount(self.damping, 'x')} on {where(self.on)}"


# %% [markdown]
# An effect obeys three rules. It is *frozen*: it remembers no mesh, so we can use one scene on all meshes. It *refuses*
# wrong data: the error names the effect, the value found and the values allowed. It *describes* itself in one line.
#
# **Question:** Why may $c$ not be negative? Give one reason from thermodynamics and one from convexity.
#
# <details><summary>Answer</summary>
#
# *Dissipation:* dashpots take the power $c\,|\dot u|^2$ per area from the body; with $c < 0$ they would supply power
# from nothing. *Convexity:* in the program of a step of the length $k$ the dashpots add
# $\tfrac{c}{2k} |u - u_{prev}|^2$. With $c < 0$ this term is concave, and its curvature grows as $k$ gets smaller. If
# this curvature exceeds the stiffness, the program has no minimum.
#
# </details>
#
# ## A closed form as a test
#
# Take a bar between rollers. The right end is held. A constant traction $p$ pushes the left end from $t = 0$ on, and
# the dashpots act at this end. The bar has the length 1 and a uniform strain. Let $E$ be Young's modulus and $\nu$
# Poisson's ratio. The modulus of a body that cannot expand sideways is $M = E(1 - \nu) / ((1 + \nu)(1 - 2\nu))$. So the
# displacement $U$ of the left end satisfies
#
# $$c\, \dot U + M U = p, \qquad U(t) = \frac{p}{M}\bigl(1 - e^{-tM/c}\bigr) .$$
#
# Backward Euler replaces the differential equation by a recursion,
#
# $$(c/k + M)\, U_n = p + (c/k)\, U_{n-1} .$$
#
# We make two tests. Displacements are linear in $x$, and virtual elements represent them *exactly* on every mesh. So
# the computed displacements must agree with the recursion **up to rounding**, on any mesh and for any step. This tests
# the matrix. The recursion must approach the exponential **with the error** $O(k)$. This tests the factor $1/k$ and the
# equation itself.

# %%
young, poisson, p, c = 10.0, 0.3, 0.5, 6.0
M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
bar = vx.Scene(
    vx.Elasticity(young, poisson),
    vx.Symmetry(on=["right", "bottom", "top"]),
    vx.Traction((p, 0.0), on="left"),
    Dashpots(c, on="left"),
)
mesh = vx.meshes.voronoi(4)


def exact_motion(t):
    return p / M * (1 - np.exp(-t * M / c))


def recursion(times):
    U = [0.0]
    for k in np.diff(times):
        U.append((p + c / k * U[-1]) / (c / k + M))
    return np.array(U)


runs, errors = {}, []
for _steps in (4, 8, 16, 32, 64):
    _times = np.linspace(0.0, 1.5, _steps + 1)
    _run = vx.simulate(bar, mesh, _times)
    _exact = np.outer(recursion(_times), 1 - mesh.points[:, 0])
    assert np.abs(_run.displacement[..., 0] - _exact).max() <= 1e-11 * p / M
    assert np.abs(_run.displacement[..., 1]).max() <= 1e-11 * p / M
    runs[_steps] = _run
    errors.append(np.abs(recursion(_times) - exact_motion(_times)).max())
ratios = np.array(errors[:-1]) / errors[1:]
print("errors as the time step is halved:", np.array2string(np.array(errors), precision=4))
print("ratios", np.round(ratios, 2), "-> 2")
# An error C1 k + C2 k^2 + ... has ratios 2 + O(k), which approach 2 with every halving.
assert (np.diff(np.abs(ratios - 2)) < 0).all()
assert abs(ratios[-1] - 2) < 0.1

# %% jupyter={"source_hidden": true}
# Picture: displacement of the pushed end over time; the dots, for three step sizes, lie below the closed form
left = np.flatnonzero(mesh.points[:, 0] == 0)[0]
_figure, _axes = plt.subplots(figsize=(5.8, 3.8), layout="constrained")
_line = np.linspace(0, 1.5, 200)
_axes.plot(_line, exact_motion(_line), "-", color="black", label="closed form")
for _steps, _colour in ((4, "tab:orange"), (16, "tab:green"), (64, "tab:blue")):
    _run = runs[_steps]
    _axes.plot(_run.times, _run.displacement[:, left, 0], "o", color=_colour, markersize=4, label=f"{_steps} steps")
_axes.set(xlabel="time", ylabel="displacement of the pushed end", title="a bar creeps to its final length")
_axes.grid(color="0.9")
_axes.legend(frameon=False)
plt.close(_figure)
_figure

# %% [markdown]
# **Question:** Why do the dots lie below the line? (Which velocity does backward Euler use in a step?)
#
# <details><summary>Answer</summary>
#
# Backward Euler uses the velocity at the *end* of a step, $(p - MU_n)/c$. The motion of the bar slows down, so this
# velocity is less than the mean velocity of the step. A step of backward Euler divides the remainder $p/M - U$ by
# $1 + kM/c$. In the exact solution the remainder is divided by $e^{kM/c}$, which is larger. So after every step the
# remainder of backward Euler is too large, and $U_n$ is too small.
#
# </details>
#
# ## The energy balance
#
# A third test needs no closed form. The dashpots take the energy $\int c\, \dot U^2 dt$. For backward Euler this energy
# is $\sum_n c\, s_n^2 / k$ with $s_n = U_n - U_{n-1}$. The package reports three of the four terms of
#
# $$\text{work} = \text{stored} + \text{dissipated} + \sum_n \tfrac12 a(s_n, s_n),$$
#
# where the last sum is the numerical loss of backward Euler (lesson 4). This balance must also hold for an effect that
# is not part of the package.

# %%
run = runs[64]
moves = np.diff(run.displacement[:, left, 0])
taken = np.sum(c * moves**2 / np.diff(run.times))
lost_by_euler = np.sum(0.5 * M * moves**2)
print(f"energy taken by the dashpots {taken:.6f}; reported by the package {run.dissipated[-1]:.6f}")
assert abs(taken - run.dissipated[-1]) <= 1e-10 * run.work[-1]
assert abs(run.work[-1] - run.energy[-1] - taken - lost_by_euler) <= 1e-10 * run.work[-1]

# %% [markdown]
# ## Together with friction
#
# We put the dashpots on the pulled side of the block of Feng, Han and Huang, and pull at several speeds. Without
# dashpots the *speed does not matter* (lesson 4): the same load leads to the same displacement. Here the displacements
# agree in all bits, because the speeds below are powers of two. With dashpots the speed matters. Each step is certified
# as before.


# %%
def block(speed, *more):
    """Run the block with the effects `more`; the final load is the same for every speed."""

    def pull(x, t):
        return speed * t * np.column_stack([8 * (1.25 - x[:, 1]), np.full(len(x), -0.01)])

    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
        *more,
    )
    return vx.simulate(scene, vx.meshes.squares(8), np.linspace(0.0, 1.0 / speed, 33))


dampers = Dashpots(60.0, on="left")
print(dampers.describe())
slow, fast = block(1.0), block(4.0)
damped = {speed: block(speed, dampers) for speed in (0.25, 1.0, 4.0)}
assert np.array_equal(slow.displacement, fast.displacement)
corner = np.flatnonzero((slow.mesh.points == 0.0).all(axis=1))[0]
ends = [slow.displacement[-1, corner, 0], *(damped[speed].displacement[-1, corner, 0] for speed in damped)]
print(f"slip of the corner without dashpots {ends[0]:.5f}; with dashpots at speeds .25, 1, 4:", np.round(ends[1:], 5))
assert (np.diff(ends) < 0).all()
assert max(one.certificate.max() for one in damped.values()) <= 1e-8

# %% jupyter={"source_hidden": true}
# Picture: slip of the corner over the load for four cases; with dashpots a faster pull leads to less slip
_figure, _axes = plt.subplots(figsize=(5.8, 3.8), layout="constrained")
_load = np.linspace(0, 1, 33)
_axes.plot(_load, 1e3 * slow.displacement[:, corner, 0], "-", color="black", label="no dashpots, any speed")
for (_speed, _one), _colour in zip(damped.items(), ("tab:blue", "tab:green", "tab:orange"), strict=True):
    _slip = 1e3 * _one.displacement[:, corner, 0]
    _axes.plot(_load, _slip, "o", color=_colour, markersize=3, label=f"speed {_speed:g}")
_axes.set(xlabel="load / full load", ylabel="slip of the corner (1e-3)", title="with dashpots the speed matters")
_axes.grid(color="0.9")
_axes.legend(frameon=False)
plt.close(_figure)
_figure

# %% [markdown]
# ## Tests for every effect
#
# `vemcvx.testing.effect_suite` tests what *every* effect must do. For example, an effect returns equal arrays when
# called twice, remembers no mesh, and refuses unknown names. CONTRIBUTING.md has a recipe for adding an effect to the
# library.

# %%
for _wrong in (-1.0, np.nan, lambda x: np.where(x[:, 1] > 0.5, 1.0, -1.0)):
    try:
        vx.simulate(bar.with_(Dashpots(_wrong, on="left")), mesh, [0.0, 1.0])
        raise AssertionError("accepted")
    except vx.SceneError as _error:
        print(_error)

# %% [markdown]
# ## Exercises
#
# 1. Give the dashpots a direction: damping $c_n$ for the normal and $c_t$ for the tangential velocity. Which closed
#    form tests $c_t$? (Shear the bar instead of compressing it.)
# 2. A *Robin* condition stands for springs of stiffness $\beta$ to a support that moves by $u_0(t)$, so
#    $\sigma n = \beta(u_0 - u)$. Write the effect, and find the closed form of the bar for a $u_0$ that is linear in
#    time.
# 3. Replace backward Euler in the recursion by the midpoint rule. With which power of $k$ does the error fall now?
#    Which difficulty would this cause with friction?
# 4. How would you write dashpots that resist motion along the outward normal *only*? Which term would they add to the
#    program of a step, and why is this program still convex?
#
# Solutions: `lesson_8_solutions.py`.
