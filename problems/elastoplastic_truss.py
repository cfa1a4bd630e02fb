r"""A truss that yields: elastoplasticity with linear kinematic hardening.

Bars have Young's modulus E, the hardening modulus H and the yield stress sigma_y. Let u be the displacements, e = G u
the strains (elongation divided by length) and p the plastic strains. The stored energy per volume and the stress are

$$ E / 2 (e - p)^2 + H / 2 p^2, \qquad \sigma = E (e - p). $$

Bars flow while |sigma - H p| = sigma_y, in the direction of sigma - H p, and dissipate sigma_y |p'| per volume. Let A
be the areas, L the lengths and V = A L the volumes of the bars, y = (u, p) and D = diag(V E). The truss obeys the
primal variational inequality of Han and Reddy, Plasticity (2nd ed., 2013), chapter 7, with

$$
K = [[G'DG, -G'D], [-DG, D + \operatorname{diag}(V H)]], \qquad j(v, q) = \sum_b V_b \sigma_{y,b} |q_b|,
\qquad \text{load } = (\text{forces}, 0).
$$

The multiplier of bar b is lam_b = V_b (sigma_b - H p_b). H > 0 makes K definite.

**One bar.** Let play_r(e) stay within r of e, and change only if it must. With r = sigma_y / E the plastic strain is
p = E/(E+H) play_r(e). With stop_r(e) = e - play_r(e) and the tangent E_t = E H/(E+H), the stress is
sigma = E_t e + (E - E_t) stop_r(e). After loading to sigma_1 > sigma_y the bar yields backwards at sigma_1 - 2 sigma_y.
This stress is above -sigma_y: the Bauschinger effect.

**Three bars** hold one node, pulled by F(t): one bar of length L along the force, two of length L / c at the angle
theta to the force, c = cos theta. If the node moves by v, the strains are v / L and c^2 v / L. So F(v) is a sum of two
functions of the kind sigma(e). The slope of F(v) is k_0 up to F_1, where the middle bar yields, then k_1 up to F_2,
where all bars yield, then k_2. For L = A = 1 the inverse v(F) is

$$
k_0 = E (1 + 2 c^3), \qquad k_1 = E_t + 2 c^3 E, \qquad k_2 = E_t (1 + 2 c^3), \\
F_1 = k_0 r, \qquad F_2 = F_1 + k_1 (r / c^2 - r), \\
v = F / k_0 + (1 / k_1 - 1 / k_0) \operatorname{play}_{F_1}(F) + (1 / k_2 - 1 / k_1) \operatorname{play}_{F_2}(F).
$$

Between F_1 and F_2 only the bar in the middle flows. After unloading, the inclined bars keep this bar compressed.
Backward Euler makes no error as long as F is monotone between instants.

    python problems/elastoplastic_truss.py --picture elastoplastic_truss.png
"""

import argparse
import time
from typing import NamedTuple

import numpy as np

import vemcvx as vx
from spring_slider_chain import course, march, play, sample

YOUNG, HARDENING, YIELD = 200.0, 20.0, 1.0
COSINE = 0.6
TURNS = (0, 3, -3, 3, 0)
"""Turning points of the force on three bars; all bars yield at the force 3."""


class Truss(NamedTuple):
    """Bars between nodes; each material constant is an array (m,), or one number for all m bars."""

    points: np.ndarray
    bars: np.ndarray
    held: np.ndarray
    """Indices 2 i + a of fixed components a at nodes i."""
    young: float | np.ndarray = YOUNG
    hardening: float | np.ndarray = HARDENING
    yield_stress: float | np.ndarray = YIELD
    area: float | np.ndarray = 1.0

    @property
    def lengths(self):
        return np.linalg.norm(self.points[self.bars[:, 1]] - self.points[self.bars[:, 0]], axis=1)

    @property
    def free(self):
        return np.setdiff1d(np.arange(2 * len(self.points)), self.held)


def strain_matrix(truss):
    """Return G (m, free displacements): the strains of the bars."""
    start, end = truss.bars.T
    direction = (truss.points[end] - truss.points[start]) / truss.lengths[:, None] ** 2
    G, bar = np.zeros((len(truss.bars), 2 * len(truss.points))), np.arange(len(truss.bars))
    for a in (0, 1):
        G[bar, 2 * start + a], G[bar, 2 * end + a] = -direction[:, a], direction[:, a]
    return G[:, truss.free]


def pose_truss(truss, force):
    """Return the system for (u, p); row t of `force` (N + 1, 2 n) has the forces on all n nodes at t = 0, ..., N."""
    G, V = strain_matrix(truss), truss.area * truss.lengths
    D, H = np.diag(V * truss.young), np.diag(V * truss.hardening)
    K = np.block([[G.T @ D @ G, -G.T @ D], [-D @ G, D + H]])
    m = len(truss.bars)
    B = np.hstack([np.zeros((m, G.shape[1])), np.eye(m)])
    load = np.hstack([force[:, truss.free], np.zeros((len(force), m))])
    return vx.System(K, sample(load), vx.Norms(B, V * truss.yield_stress))


def stresses(truss, state):
    """Return the stresses E (e - p), (N + 1, m)."""
    m = len(truss.bars)
    return truss.young * (state[:, :-m] @ strain_matrix(truss).T - state[:, -m:])


def three_bars():
    """Return three bars from the origin to supports at height 1; bar 0 is in the middle."""
    reach = np.sqrt(1 - COSINE**2) / COSINE
    points = np.array([[0.0, 0.0], [0.0, 1.0], [-reach, 1.0], [reach, 1.0]])
    return Truss(points, np.array([[0, 1], [0, 2], [0, 3]]), held=np.arange(2, 8))


def load_down(F):
    """Return the forces on the nodes of three bars: F pulls the free node down."""
    return F[:, None] * -np.eye(8)[1]


def three_bars_exactly(F):
    """Return state (N + 1, 5), stresses (N + 1, 3) and multipliers (N + 1, 3)."""
    c, r, tangent = COSINE, YIELD / YOUNG, YOUNG * HARDENING / (YOUNG + HARDENING)
    k = np.array([YOUNG * (1 + 2 * c**3), tangent + 2 * c**3 * YOUNG, tangent * (1 + 2 * c**3)])
    first = k[0] * r
    yielding = np.array([0.0, first, first + k[1] * (r / c**2 - r)])
    v = play(yielding, F) @ np.diff(1 / k, prepend=0.0)
    e = v[:, None] * np.array([1.0, c**2, c**2])
    p = YOUNG / (YOUNG + HARDENING) * play(np.full(3, r), e)
    sigma = YOUNG * (e - p)
    volume = np.array([1.0, 1 / c, 1 / c])
    return np.column_stack([0 * v, -v, p]), sigma, volume * (sigma - HARDENING * p)


def yield_forces():
    """Return F_1 and F_2."""
    tangent, c2, c3 = YOUNG * HARDENING / (YOUNG + HARDENING), COSINE**2, COSINE**3
    first = YIELD * (1 + 2 * c3)
    return first, first + (tangent + 2 * c3 * YOUNG) * YIELD / YOUNG * (1 / c2 - 1)


def girder(bays=10):
    """Return a girder, held at the left end; each of its square bays has two thin diagonals."""
    x = np.repeat(np.arange(bays + 1.0), 2)
    points = np.column_stack([x, np.tile([0.0, 1.0], bays + 1)])
    one = np.array([[0, 2], [1, 3], [0, 3], [1, 2], [2, 3]])
    bars = np.concatenate([one + 2 * bay for bay in range(bays)])
    return Truss(points, bars, held=np.arange(4), area=np.tile([2.0, 2.0, 0.2, 0.2, 1.0], bays))


def load_end(truss, F):
    """Return nodal forces: F down at the free end of a girder, and F / 3 down halfway."""
    force = np.zeros((len(F), 2 * len(truss.points)))
    force[:, -1] = -F
    force[:, 2 * (len(truss.points) // 2) + 1] = -F / 3
    return force


def picture(path, truss, F, trajectory):
    """Draw force against displacement, and the stresses of the bars against their strains."""
    from vemcvx.base.canvas import new_figure
    from vemcvx.plots.style import SERIES

    figure = new_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    exact, sigma, _ = three_bars_exactly(F)
    left.plot(-exact[:, 1], F, color=SERIES[0], linewidth=1, label="closed form")
    left.plot(-trajectory.state[:, 1], F, ".", color=SERIES[0], markersize=4, label="march")
    for level in yield_forces():
        left.axhline(level, color="0.7", linewidth=0.7, linestyle="--")
    e = trajectory.state[:, :2] @ strain_matrix(truss).T
    for bar, mark, name in ((0, "s", "middle"), (1, "^", "inclined")):
        right.plot(e[:, bar], sigma[:, bar], color=SERIES[bar + 1], linewidth=1)
        found = stresses(truss, trajectory.state)[:, bar]
        right.plot(e[:, bar], found, mark, color=SERIES[bar + 1], markersize=4, label=name)
    left.set(xlabel="displacement", ylabel="force", title="dashed: forces at which bars begin to yield")
    right.set(xlabel="strain", ylabel="stress", title="each bar: linear kinematic hardening")
    left.locator_params(axis="x", nbins=6), right.locator_params(axis="x", nbins=6)
    left.legend(), right.legend()
    figure.savefig(path, dpi=120)


def main(path=None):
    F, truss = course(TURNS, 0.25), three_bars()
    exact, sigma, multipliers = three_bars_exactly(F)
    lost = YIELD * np.abs(np.diff(exact[:, 2:], axis=0)).sum(axis=0) @ truss.lengths
    print("three bars: yield at F = {:.4f} and {:.4f}".format(*yield_forces()))
    print("solver      error of y   certified   error of lam   dissipated     seconds")
    for solver in (vx.Newton(), vx.Clarabel(), vx.OSQP()):
        start = time.perf_counter()
        trajectory = march(pose_truss(truss, load_down(F)), F, solver)
        seconds = time.perf_counter() - start
        print(
            f"{solver.name:9s}{np.abs(trajectory.state - exact).max():12.1e}{trajectory.certificate_total[-1]:12.1e}"
            f"{np.abs(trajectory.multipliers[:, :, 0] - multipliers).max():15.1e}"
            f"{trajectory.dissipated[-1]:15.10f}{seconds:10.2f}"
        )
        if path and isinstance(solver, vx.Newton):
            picture(path, truss, F, trajectory)
    print(f"in closed form: dissipated {lost:.10f}; stresses after unloading {np.round(sigma[-1], 4)}")
    F, truss = course((0, 0.25, -0.25, 0.25), 0.05), girder()
    print(f"girder of 10 bays, {len(truss.bars)} bars")
    for solver in (vx.Newton(), vx.Clarabel(), vx.OSQP()):
        trajectory = march(pose_truss(truss, load_end(truss, F)), F, solver)
        yielded = int((~trajectory.sticking).any(axis=0).sum())
        print(
            f"{solver.name:9s} certified {trajectory.certificate_total[-1]:.1e}, dissipated "
            f"{trajectory.dissipated[-1]:.8f}, {yielded} bars yielded"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", metavar="FILE")
    main(parser.parse_args().picture)
