# %% [markdown]
"""# Solutions to the exercises of lesson 8, your own effect"""

# %%
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from vemcvx.effects import Contribution, data
from vemcvx.effects.effect import amount, where

young, poisson = 10.0, 0.3
M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
mu = young / (2 * (1 + poisson))
mesh = vx.meshes.voronoi(4)

# %% [markdown]
# **1.** The dashpots have the damping $c_n$ for the normal and $c_t$ for the tangential velocity. Springs with these
# numbers as stiffnesses have the same matrix. To test $c_t$ alone, shear the bar. Hold the right side, forbid motion
# along $x$ on top and bottom, and pull the left side along $y$ by $p$. Then $u = (0, U (1 - x))$, and the only stress
# is $\sigma_{xy} = -\mu U$, so $c_t \dot U + \mu U = p$. The answer must not depend on $c_n$.


# %%
@dataclass(frozen=True)
class DirectedDashpots(vx.Effect):
    """Dashpots with different damping for the normal and the tangential velocity."""

    normal: float
    tangential: float
    on: str | Sequence[str]

    def contribute(self, space):
        """Return the matrix of springs, as viscosity."""
        springs = vx.ElasticFoundation(self.normal, self.tangential, on=self.on)
        return Contribution(viscosity=springs.contribute(space).stiffness)

    def describe(self):
        """Return one line for `vemcvx show`."""
        return f"DirectedDashpots: normal {self.normal}, tangential {self.tangential} on {where(self.on)}"


def recursion(stiffness, force, c, times):
    U = [0.0]
    for k in np.diff(times):
        U.append((force + c / k * U[-1]) / (c / k + stiffness))
    return np.array(U)


p, c, times = 0.5, 6.0, np.linspace(0.0, 3.0, 9)
for _normal in (0.0, 100.0):
    _scene = vx.Scene(
        vx.Elasticity(young, poisson),
        vx.Clamp(on="right"),
        vx.PrescribedDisplacement(0.0, on=["bottom", "top"], direction=(1.0, 0.0)),
        vx.Traction((0.0, p), on="left"),
        DirectedDashpots(_normal, c, on="left"),
    )
    _run = vx.simulate(_scene, mesh, times)
    _exact = np.outer(recursion(mu, p, c, times), 1 - mesh.points[:, 0])
    assert np.abs(_run.displacement[..., 1] - _exact).max() <= 1e-11 * p / mu
    assert np.abs(_run.displacement[..., 0]).max() <= 1e-11 * p / mu

# %% [markdown]
# **2.** The springs have the stiffness $\beta$, and the support moves by $u_0$. The work
# $\int_\Gamma \beta (u_0 - u) \cdot v\, ds$ consists of a spring term and a load term, and the package has an effect
# for each term. The bar has the modulus $M$ of uniaxial strain. Let $U$ be the displacement of its left end.
# Then $M U = \beta (u_0 - U)$, so $U = \beta u_0 / (M + \beta)$. The displacement is linear in $x$, and the equation of
# $U$ contains no rate, so the answer is exact on every mesh and for every step.


# %%
@dataclass(frozen=True)
class Robin(vx.Effect):
    """Springs to a support that moves: sigma n = stiffness (support - u)."""

    stiffness: float
    support: data.Datum
    on: str | Sequence[str]

    def contribute(self, space):
        """Return springs, and the load from the moving support."""

        def pull(x, t):
            return self.stiffness * data.vector(self.support, x, t, "Robin: support")

        springs = vx.ElasticFoundation(self.stiffness, self.stiffness, on=self.on).contribute(space)
        return replace(springs, loads=vx.Traction(pull, on=self.on).contribute(space).loads)

    def describe(self):
        """Return one line for `vemcvx show`."""
        return f"Robin: stiffness {self.stiffness}, support {amount(self.support)} on {where(self.on)}"


beta, speed = 3.0, 0.01
bar = vx.Scene(
    vx.Elasticity(young, poisson),
    vx.Symmetry(on=["right", "bottom", "top"]),
    Robin(beta, lambda x, t: np.tile([speed * t, 0.0], (len(x), 1)), on="left"),
)
history = vx.simulate(bar, mesh, [0.0, 0.5, 1.0])
exact = np.outer(history.times, beta * speed / (M + beta) * (1 - mesh.points[:, 0]))
assert np.abs(history.displacement[..., 0] - exact).max() <= 1e-11 * speed
assert np.abs(history.displacement[..., 1]).max() <= 1e-11 * speed

# %% [markdown]
# **3.** The midpoint rule, $c\,(U_n - U_{n-1}) / k + M (U_n + U_{n-1}) / 2 = p$, is of second order. With friction,
# this rule balances the forces and respects the friction bound in the *middle* of the step. The force at the end of the
# step is extrapolated from the middle, so it may exceed the bound and oscillate from step to step. Backward Euler
# respects the bound at the end of every step.

# %%
errors = []
for _steps in (8, 16, 32, 64):
    _k = 1.5 / _steps
    _U = [0.0]
    for _ in range(_steps):
        _U.append((p + (c / _k - M / 2) * _U[-1]) / (c / _k + M / 2))
    errors.append(abs(_U[-1] - p / M * (1 - np.exp(-1.5 * M / c))))
ratios = np.array(errors[:-1]) / errors[1:]
print("midpoint rule, ratios", np.round(ratios, 3), "-> 4")
# At a fixed instant the error is C1 k^2 + C2 k^4 + ..., so the ratios approach 4.
assert (np.diff(np.abs(ratios - 4)) < 0).all()
assert abs(ratios[-1] - 4) < 0.05

# %% [markdown]
# **4.** A step would minimise
# $\tfrac12 a(u, u) - \langle \ell, u \rangle + \tfrac{c}{2k} \int_\Gamma (n \cdot (u - u_{prev}))_+^2\, ds$. The
# squared positive part is convex, so there is one minimiser, and a duality gap certifies an answer. The package has
# this term, `vx.Limits(compliance=1/c, rates=True)`, and the effect `vx.VelocityContact` contributes this term. We
# compute one degree of freedom by hand:


# %%
def one_way(u_prev, f, damping=2.0, stiffness=3.0, step=0.1):
    """Return the minimiser of stiffness u^2 / 2 - f u + damping (u - u_prev)_+^2 / (2 step)."""
    free = f / stiffness
    return free if free <= u_prev else (f + damping / step * u_prev) / (stiffness + damping / step)


anywhere = np.linspace(-3, 3, 6001)
for _f in (-2.0, 0.5, 4.0):
    for _before in (-1.0, 0.0, 1.0):
        _energy = 1.5 * anywhere**2 - _f * anywhere + 10.0 * np.maximum(anywhere - _before, 0) ** 2
        # The energy is convex, so the best point of the grid is within one spacing of the minimiser.
        assert abs(anywhere[np.argmin(_energy)] - one_way(_before, _f)) <= 1e-3
print("all solutions hold")
