# %% [markdown]
"""# Lesson 8, your own effect: dashpots along a boundary in one file, and how to test them against closed forms"""

# %% [markdown]
# *You need:* weak forms, lesson 4 (the quasistatic problem). *You will see:* that physics enters a scene as arrays,
# that twenty lines are an effect, and that a closed form in space *and* in time is the test that finds mistakes.
#
# A scene is a list of *effects*: elasticity, supports, loads, friction. Each one knows nothing of the others; asked for
# its contribution on a mesh, it returns arrays for one of the places in
#
# $$a(u, v - \dot u) + b(\dot u, v - \dot u) + j(v) - j(\dot u) \ge \langle l(t), v - \dot u \rangle :$$
#
# stiffness for $a$, viscosity for $b$, friction bounds for $j$, loads for $l$, supports and obstacles for the set of
# admissible $v$. The scene adds them up. What is missing from the library, you write yourself. Here: **dashpots**,
# shock absorbers along a part $\Gamma$ of the boundary, which resist velocity with a traction
#
# $$\sigma n = -c\, \dot u \quad \text{on } \Gamma, \qquad c \ge 0, \text{ force per area and velocity.}$$
#
# In the weak form the traction of the boundary does work on $v$. Bring it to the left side: $b(\dot u, v) = \int_\Gamma
# c\, \dot u \cdot v\, ds$. Springs along the boundary have $\int_\Gamma k\, u \cdot v\, ds$: the same matrix. The
# library has those, so the effect is short.

# %%
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.effects import Contribution, data
from vemcvx.effects.effect import amount, where
from vemcvx.plots.style import COMPUTED, EXACT, SECOND, THIRD
from vemcvx.vem import Space


@dataclass(frozen=True)
class Dashpots(vx.Effect):
    """Dashpots between a part of the boundary and the ground: sigma n = -damping u'.

    Parameters
    ----------
    damping : number, or callable f(x) -> (m,)
        c >= 0, force per area and velocity.
    on : str or sequence of str
        Boundary names.
    """

    damping: data.Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        """The matrix of b, which is that of springs."""
        space.part(self.on, "Dashpots")  # an unknown name is refused in our name
        springs = vx.ElasticFoundation(self.checked, self.checked, on=self.on)
        return Contribution(viscosity=springs.contribute(space).stiffness)

    def checked(self, x):
        """(m,) the damping at points (m, 2)."""
        c = data.coefficient(self.damping, x, "Dashpots: damping")
        if (c < 0).any():
            raise vx.SceneError(f"Dashpots: found damping = {c.min():.6g}; it must be >= 0, or energy would be gained.")
        return c

    def describe(self):
        """One line for `vemcvx show`."""
        return f"Dashpots: damping {amount(self.damping, 'x')} on {where(self.on)}"


# %% [markdown]
# Three habits make an effect a good neighbour. It is *frozen*: no mesh is remembered, so one scene serves all of
# them. It *refuses* data that mean nothing, in a sentence that names the effect, what was found and what is allowed.
# And it *describes* itself in one line.
#
# **Question:** Why may $c$ not be negative, in one word of thermodynamics and in one word of convexity?
#
# <details><summary>Answer</summary>
#
# *Dissipation*: dashpots take the power $c\,|\dot u|^2$ from the body, and with $c < 0$ they would supply power from
# nothing. *Concave*: in the program of a step they are the term $\tfrac{c}{2k} |u - u_{prev}|^2$, and with $c < 0$ it
# bends downwards, the more so the smaller $k$ is. Where it outweighs the stiffness there is no minimum.
#
# </details>
#
# ## A closed form to test it
#
# Take a bar between rollers, held on the right, pushed on the left by a constant traction $q$ from $t = 0$ on, with
# dashpots at the same end. Nothing varies across the bar, strains are uniform, and with the modulus $M = E(1 - \nu) /
# ((1 + \nu)(1 - 2\nu))$ of a body that cannot expand sideways and the length 1, the left end obeys
#
# $$c\, \dot U + M U = q, \qquad U(t) = \frac{q}{M}\bigl(1 - e^{-tM/c}\bigr) .$$
#
# Two tests, because two things may be wrong. Backward Euler turns the equation into $(c/k + M)\, U_n = q + (c/k)\,
# U_{n-1}$. Displacements are linear in $x$, so every mesh of virtual elements represents them *exactly*: the numbers
# must agree with this recursion **up to rounding**, on any mesh, for any step. That tests the matrix. And the recursion
# must approach the exponential **with the first power of $k$**. That tests the factor $1/k$ and the idea.

# %%
young, poisson, q, c = 10.0, 0.3, 0.5, 6.0
M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
bar = vx.Scene(
    vx.Elasticity(young, poisson),
    vx.Symmetry(on=["right", "bottom", "top"]),
    vx.Traction((q, 0.0), on="left"),
    Dashpots(c, on="left"),
)
mesh = vx.meshes.voronoi(4)


def closed_form(t):
    return q / M * (1 - np.exp(-t * M / c))


def recursion(times):
    U = [0.0]
    for k in np.diff(times):
        U.append((q + c / k * U[-1]) / (c / k + M))
    return np.array(U)


runs, errors = {}, []
for _steps in (4, 8, 16, 32, 64):
    _times = np.linspace(0.0, 1.5, _steps + 1)
    _run = vx.simulate(bar, mesh, _times)
    _exact = np.outer(recursion(_times), 1 - mesh.points[:, 0])
    assert np.abs(_run.displacement[..., 0] - _exact).max() <= 1e-11 * q / M
    assert np.abs(_run.displacement[..., 1]).max() <= 1e-11 * q / M
    runs[_steps] = _run
    errors.append(np.abs(recursion(_times) - closed_form(_times)).max())
ratios = np.array(errors[:-1]) / errors[1:]
print("error of the time step, each half as long as before:", np.array2string(np.array(errors), precision=4))
print("ratios", np.round(ratios, 2), "-> 2")
# An error e k + f k^2 + ... has ratios 2 + O(k): they come nearer to 2 with every halving.
assert (np.diff(np.abs(ratios - 2)) < 0).all()
assert abs(ratios[-1] - 2) < 0.1

# %% jupyter={"source_hidden": true}
left = np.flatnonzero(mesh.points[:, 0] == 0)[0]
_figure = new_figure(5.8, 3.8)
_ax = _figure.subplots()
_line = np.linspace(0, 1.5, 200)
_ax.plot(_line, closed_form(_line), "-", color=EXACT, label="closed form")
for _steps, _colour in ((4, SECOND), (16, THIRD), (64, COMPUTED)):
    _run = runs[_steps]
    _ax.plot(_run.times, _run.displacement[:, left, 0], "o", color=_colour, markersize=4, label=f"{_steps} steps")
_ax.set(xlabel="time", ylabel="displacement of the pushed end", title="a bar creeps to its elastic length")
light_grid(_ax)
_ax.legend(frameon=False)
_figure

# %% [markdown]
# **Question:** The dots lie below the line. Must they? (Which slope does backward Euler use in a step?)
#
# <details><summary>Answer</summary>
#
# They must. Backward Euler moves by the slope at the *end* of a step, $(q - MU_n)/c$. The end moves more and more
# slowly, so this slope is less than the mean one. In formulas, what is missing of $q/M$ shrinks in a step by $1/(1 +
# x)$ with $x = kM/c$, in truth by $e^{-x}$, and $e^x > 1 + x$: $1 - (1 + x)^{-n} < 1 - e^{-nx}$ after every number of
# steps.
#
# </details>
#
# ## The ledger
#
# A third test costs nothing: energy. The dashpots take $\int c\, \dot U^2 dt$, in steps $\sum c\, (\Delta U)^2 / k$.
# The package adds up what it knows, $\text{work} = \text{stored} + \text{dissipated} + \sum \tfrac12 |\Delta u|_a^2$,
# where the last sum is what backward Euler loses. The balance has to hold for an effect that the package has never
# seen.

# %%
run = runs[64]
moves = np.diff(run.displacement[:, left, 0])
taken = np.sum(c * moves**2 / np.diff(run.times))
lost_by_euler = np.sum(0.5 * M * moves**2)
print(f"dashpots took {taken:.6f}, the package says {run.dissipated[-1]:.6f}")
assert abs(taken - run.dissipated[-1]) <= 1e-10 * run.work[-1]
assert abs(run.work[-1] - run.energy[-1] - taken - lost_by_euler) <= 1e-10 * run.work[-1]

# %% [markdown]
# ## Beside friction
#
# Effects combine without knowing each other. Put the dashpots on the pulled side of the paper's block, and pull at
# two speeds. Without dashpots the *speed does not matter*: friction and elasticity know no time (lesson 4), and the
# same load makes the same displacement (to the bit, for the speeds below are powers of two). With dashpots it does.
# Each step is certified as before.


# %%
def block(speed, *more):
    """Pull the paper's block up to the same load, at some speed."""

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
print("the corner at full load: without", f"{ends[0]:.5f};", "at speeds .25, 1, 4:", np.round(ends[1:], 5))
assert (np.diff(ends) < 0).all()
assert max(one.certificate.max() for one in damped.values()) <= 1e-8

# %% jupyter={"source_hidden": true}
_figure = new_figure(5.8, 3.8)
_ax = _figure.subplots()
_load = np.linspace(0, 1, 33)
_ax.plot(_load, 1e3 * slow.displacement[:, corner, 0], "-", color=EXACT, label="no dashpots, any speed")
for (_speed, _one), _colour in zip(damped.items(), (COMPUTED, THIRD, SECOND), strict=True):
    _ax.plot(_load, 1e3 * _one.displacement[:, corner, 0], "o", color=_colour, markersize=3, label=f"speed {_speed:g}")
_ax.set(xlabel="load (of the full one)", ylabel="slip of the corner (1e-3)", title="dashpots bring back time")
light_grid(_ax)
_ax.legend(frameon=False)
_figure

# %% [markdown]
# ## Who checks the rest?
#
# `tests/effects/test_conformance_effects.py` says in fifteen sentences what *every* effect must do: equal arrays when
# asked twice, no memory of a mesh, finite numbers, unknown names refused, a copy to another process, no dependence on
# the order of the scene, every setting matters ... The dashpots of this lesson are held to all of them by
# `tests/effects/test_lesson_8.py`. CONTRIBUTING.md has a recipe for an effect that is to stay in the library.

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
# 1. Give the dashpots a direction: $c_n$ against normal and $c_t$ against tangential velocity. Which closed form tests
#    $c_t$? (Shear the bar instead of compressing it.)
# 2. A *Robin* condition: springs to a support that moves by $u_0(t)$, $\sigma n = k(u_0 - u)$. Write the effect, and
#    the closed form of the bar for $u_0 = Ut$.
# 3. Replace backward Euler in the recursion by the midpoint rule. With which power of $k$ does the error fall now? What
#    would break in a problem with friction?
# 4. How would you write dashpots that resist *only* compression? Which of the kinds above would they need, and why is
#    the step still convex?
#
# Solutions: `lesson_8_solutions.py`.
