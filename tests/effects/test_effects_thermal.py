"""ThermalStrain and Prestress: bodies free, half blocked and blocked, in plane strain and stress, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import small

import vemcvx as vx

YOUNG, POISSON, ALPHA, THETA = 200.0, 0.3, 1.2e-3, 40.0
LENGTH, HEIGHT = 2.0, 1.0
BOX = ((0.0, LENGTH), (0.0, HEIGHT))
HOT = ALPHA * THETA
ROUND = 1e-11
IN_PLANE = {"strain": (1 + POISSON), "stress": 1.0}
"""Free expansion in the plane per alpha theta: across it plane strain leaves no room."""
ONE_WAY = {"strain": 1 / (1 - POISSON), "stress": 1.0}
"""-sigma_xx / (E alpha theta) where x alone is blocked: plane strain blocks z, too."""
BOTH_WAYS = {"strain": 1 / (1 - 2 * POISSON), "stress": 1 / (1 - POISSON)}


def heated(plane, *sides, mesh, effects=(), initial="settled", times=(0.0, 1.0)):
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON, plane=plane),
        vx.ThermalStrain(ALPHA, lambda x, t: np.full(len(x), THETA * t)),
        vx.Symmetry(on=list(sides)),
        *effects,
    )
    return vx.simulate(scene, mesh, times, initial=initial)


def near(found, exact, scale):
    return np.abs(np.asarray(found) - exact).max() < ROUND * scale


@pytest.mark.parametrize("plane", ["strain", "stress"])
class TestHeated:
    def test_free(self, family, plane):
        history = heated(plane, "left", "bottom", mesh=small(family, 3, box=BOX))
        expansion = IN_PLANE[plane] * HOT
        assert near(history.displacement[-1], expansion * history.mesh.points, LENGTH * expansion)
        assert near(history.stress(-1), 0.0, YOUNG * HOT)
        assert near(history.forces[-1], 0.0, YOUNG * HOT)

    def test_blocked_in_one_direction(self, family, plane):
        """The free direction widens, by Poisson's effect more than it would alone."""
        history = heated(plane, "left", "right", "bottom", mesh=small(family, 3, box=BOX))
        sigma = -ONE_WAY[plane] * YOUNG * HOT
        assert near(history.stress(-1), [sigma, 0.0, 0.0], YOUNG * HOT)
        assert near(history.reaction("right")[-1], [sigma * HEIGHT, 0.0], YOUNG * HOT)
        widening = {"strain": (1 + POISSON) / (1 - POISSON), "stress": 1 + POISSON}[plane] * HOT
        assert near(history.displacement[-1], widening * history.mesh.points * [0.0, 1.0], widening)

    def test_blocked(self, family, plane):
        history = heated(plane, "boundary", mesh=small(family, 3, box=BOX))
        sigma = -BOTH_WAYS[plane] * YOUNG * HOT
        assert near(history.displacement[-1], 0.0, HOT)
        assert near(history.stress(-1), [sigma, sigma, 0.0], YOUNG * HOT)
        assert history.energy[-1] < ROUND * YOUNG * HOT**2
        whole = np.zeros_like(history.forces[-1])
        for name, normal in {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1)}.items():
            part = vx.vem.Space(history.mesh).part(name, "test")
            whole[part.nodes] += sigma * part.node_lengths[:, None] * normal
        assert near(history.forces[-1], whole, YOUNG * HOT)

    def test_work_counts_it_as_a_load(self, plane):
        """1/2 a(u, u) of a free body is that of its total strain; the ledger closes with 1/2 a(du, du) a step."""
        times = np.linspace(0.0, 1.0, 6)
        history = heated(plane, "left", "bottom", mesh=small("voronoi", 4, box=BOX), initial=None, times=times)
        lam, mu = history.moduli[:, 0]
        e = IN_PLANE[plane] * HOT * times
        assert history.energy == pytest.approx(0.5 * LENGTH * HEIGHT * 4 * (lam + mu) * e**2, rel=1e-11)
        steps = 0.5 * LENGTH * HEIGHT * 4 * (lam + mu) * np.diff(e) ** 2
        left = history.work - history.energy - history.dissipated
        assert left[1:] == pytest.approx(np.cumsum(steps), rel=1e-9)


def test_a_cell_takes_its_own_expansion_and_temperature():
    """Blocked, every cell shows its own stress: alpha by cell datum, theta by place."""
    mesh = small("squares", 4)
    mesh = mesh.with_cell_data("alpha", 1e-3 * (1 + np.arange(mesh.n_cells) % 3))
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON, plane="stress"),
        vx.ThermalStrain("alpha", lambda x, t: 10 * x[:, 0] + t),
        vx.PrescribedDisplacement((0.0, 0.0), on="boundary"),
    )
    history = vx.simulate(scene, mesh, [2.0, 3.0], initial="settled")
    e0 = mesh.cell_data["alpha"] * (10 * mesh.centroids[:, 0] + 3.0)
    strain = history.stress(1)[:, :2] + (YOUNG / (1 - POISSON) * e0)[:, None]
    # The rest is the elastic answer to uneven heat, in equilibrium with it at every node inside.
    inside = np.setdiff1d(np.arange(mesh.n_nodes), np.unique(mesh.boundaries["boundary"]))
    assert near(history.forces[1][inside], 0.0, YOUNG * e0.max())
    assert np.abs(strain).max() > 0.1 * YOUNG * e0.min()
    assert history.prestress[1][:, 0] == pytest.approx(-YOUNG / (1 - POISSON) * e0, rel=1e-14)


def test_expansion_of_an_anisotropic_body_turns_with_its_axes():
    """Blocked in plane strain: Q'(b1, b2, 0), with b the sums of rows of the inverse of S over all three directions."""
    E, nu, G, angle = (100.0, 40.0, 30.0), (0.3, 0.2, 0.25), 25.0, 0.5
    scene = vx.Scene(
        vx.Orthotropic(E, nu, G, angle, plane="strain"), vx.ThermalStrain(ALPHA, THETA), vx.Clamp("boundary")
    )
    S = np.diag(1 / np.array(E))
    for (i, j), n in zip([(0, 1), (0, 2), (1, 2)], nu, strict=True):
        S[i, j] = S[j, i] = -n / E[i]
    b = np.linalg.solve(S, np.ones(3))[:2]
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])
    exact = -HOT * R @ np.diag(b) @ R.T
    history = vx.simulate(scene, small("voronoi", 3), [0.0, 1.0], initial="settled")
    assert near(history.stress(-1), [exact[0, 0], exact[1, 1], exact[0, 1]], 100 * HOT)


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_prestress_of_a_held_and_of_a_free_body(family, plane):
    """Held it shows; free it is gone, and the body has shrunk by C^-1 sigma_0."""
    mesh = small(family, 3, box=BOX)
    sigma = np.array([3.0, -1.0, 0.7])
    steel = vx.Elasticity(YOUNG, POISSON, plane=plane)
    held = vx.simulate(vx.Scene(steel, vx.Prestress(sigma), vx.Clamp("boundary")), mesh, [0.0, 1.0])
    assert near(held.stress(-1), sigma, 3.0)
    assert near(held.displacement[-1], 0.0, 3.0 / YOUNG)
    # Tension in the body pulls the supports inwards: on the body they pull outwards, sigma n.
    part = vx.vem.Space(held.mesh).part("right", "test")
    middle = mesh.points[part.nodes, 1] % HEIGHT != 0
    exact = part.node_lengths[middle, None] * sigma[[0, 2]]
    assert near(held.forces[-1][part.nodes[middle]], exact, 3.0)
    sigma = np.array([3.0, -1.0, 0.0])
    rollers = vx.Symmetry(["left", "bottom"])
    free = vx.simulate(vx.Scene(steel, vx.Prestress(sigma), rollers), mesh, [0.0, 1.0], initial="equilibrium")
    lam, mu = free.moduli[:, 0]
    strain = np.linalg.solve([[lam + 2 * mu, lam], [lam, lam + 2 * mu]], -sigma[:2])
    assert near(free.displacement[-1], strain * mesh.points, 3.0 / YOUNG * LENGTH)
    assert near(free.stress(-1), 0.0, 3.0)
