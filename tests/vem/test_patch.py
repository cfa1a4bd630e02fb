"""The patch test of whole scenes: linear displacements under mixed boundary conditions, on every family."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import mostly_long, small

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON, PULL = 7.0, 0.3, 0.2


def compute_strain(plane):
    """Return the strains along x and y of a bar under tension along x."""
    if plane == "stress":
        return PULL / YOUNG, -POISSON * PULL / YOUNG
    return PULL * (1 - POISSON**2) / YOUNG, -PULL * POISSON * (1 + POISSON) / YOUNG


@mostly_long("plane, stabilisation", [("strain", "shear"), ("stress", "unit")])
def test_a_bar_on_rollers_pulled_at_one_end(family, plane, stabilisation):
    """Prescribe u . n on the left, contact and zero friction on the bottom, and a traction on the right."""
    mesh = small(family, 4, box=((0, 1.5), (0, 1)))
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON, plane=plane, stabilisation=stabilisation),
        vx.PrescribedDisplacement(0.0, on="left", direction="normal"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(0.0, on="bottom"),
        vx.Traction(lambda x, t: np.tile([PULL * t, 0.0], (len(x), 1)), on="right"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    exact = mesh.points * compute_strain(plane)
    assert np.abs(history.displacement[-1] - exact).max() < 1e-11 * np.abs(exact).max()
    assert np.abs(history.stress(-1) - [PULL, 0.0, 0.0]).max() < 1e-11 * PULL
    assert history.reaction("left")[-1] == pytest.approx([-PULL, 0.0], abs=1e-11)
    assert history.energy[-1] == pytest.approx(0.5 * PULL * compute_strain(plane)[0] * 1.5, rel=1e-11)


def test_a_sheared_body_between_prescribed_displacements_and_tractions(family):
    """Prescribe u = a + G x on two sides, and the traction sigma n on two other sides."""
    mesh = small(family, 4)
    points = mesh.points + 0.25 * mesh.points[:, 1:] * [1.0, 0.0]
    mesh = vx.PolygonMesh(points, mesh.cells, boundaries={k: v for k, v in mesh.boundaries.items() if k != "boundary"})
    G = np.array([[0.01, -0.02], [0.03, 0.015]])
    mu = YOUNG / (2 * (1 + POISSON))
    lam = 2 * mu * POISSON / (1 - 2 * POISSON)
    sigma = mu * (G + G.T) + lam * np.trace(G) * np.eye(2)
    inclined = np.array([1.0, -0.25]) / np.hypot(1.0, 0.25)  # normal of the right side

    def field(x, t):
        return t * (x @ G.T + [0.1, -0.2])

    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(field, on=["bottom", "left"]),
        vx.Traction(lambda x, t: np.tile(t * sigma @ inclined, (len(x), 1)), on="right"),
        vx.Traction(lambda x, t: np.tile(t * sigma[:, 1], (len(x), 1)), on="top"),
    )
    history = vx.simulate(scene, mesh, [0.0, 0.5, 1.0])
    exact = np.stack([field(points, t) for t in (0.0, 0.5, 1.0)])
    assert np.abs(history.displacement - exact).max() < 1e-11
    assert np.abs(history.stress(-1) - [sigma[0, 0], sigma[1, 1], sigma[0, 1]]).max() < 1e-11 * np.abs(sigma).max() * 10
