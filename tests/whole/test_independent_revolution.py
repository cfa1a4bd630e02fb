"""Bodies of revolution agree with an independent program of linear triangles and, at large radii, with plane strain."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import skfem
from independent_p1 import Body, March, scalar, vector
from skfem.helpers import ddot, div, sym_grad

import vemcvx as vx

YOUNG, POISSON, TIMES = 100.0, 0.3, np.array([0.0, 0.5, 1.0, 1.5])
TURN = 2 * np.pi
LOOSE = pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")


@skfem.BilinearForm
def integrand(u, v, w):
    """Return the integrand of the stiffness in (r, z), with the hoop strain u_r / r."""
    r = w.x[0]
    volumes, hoops = (div(u) + u[0] / r) * (div(v) + v[0] / r), u[0] * v[0] / r**2
    return TURN * r * (w.lam * volumes + 2 * w.mu * (ddot(sym_grad(u), sym_grad(v)) + hoops))


class Ring(Body):
    """A body of revolution, with integrals over the full turn."""

    def elastic(self):
        lam = YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON)
        self.K = self._matrix(integrand, lam=lam, mu=YOUNG / 2 / (1 + POISSON))

    def rows(self, side, tangents=False):
        found = super().rows(side, tangents)
        found.lengths = self.integral(side, lambda x: TURN * x[0])
        return found

    def traction(self, side, force):
        return super().traction(side, lambda x, y, t: tuple(TURN * x * f for f in force(x, y, t)))


def load(x, y, t, inner=0.0, lift=1.5):
    """Return a traction that pulls radially to and fro, and presses down, but lifts near the rim."""
    r, pull = x - inner, {0.0: 0.0, 0.5: 2.0, 1.0: -1.5, 1.5: 0.5}[t]
    return pull * r, -(1 + t) * np.minimum(2 * t, 1) * (1.2 - lift * r)


def bound(x, y, t, inner=0.0):
    return 0.3 + 0.1 * (x - inner)


def press(mesh, inner, lift, *more, plane="axisymmetric"):
    """Simulate a body whose rim lifts from a rough floor."""
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON, plane=plane),
        vx.Traction(vector(partial(load, inner=inner, lift=lift)), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(partial(bound, inner=inner)), on="bottom"),
        *more,
    )
    return vx.simulate(scene, mesh, TIMES)


def differences(inner, n):
    """Return relative differences between both programs: displacement, pressures, energy, dissipation, floor force."""
    mesh = vx.meshes.triangles(n, box=((inner, inner + 1.0), (0.0, 0.5)))
    ours, other = press(mesh, inner, 1.5), Ring(mesh.points, np.array(list(mesh.cells)))
    other.elastic()
    if inner == 0.0:
        other.guide("left", (1.0, 0.0), lambda x, y, t: 0.0)
    other.traction("top", partial(load, inner=inner)).wall("bottom").rub("bottom", partial(bound, inner=inner))
    judge = March(other).run(TIMES)
    pairs = [
        (ours.displacement, judge.displacement),
        (ours.contact.pressure * ours.contact.lengths, judge.pressures),
        (ours.energy, judge.energy),
        (ours.dissipated, judge.dissipated),
        (ours.force("bottom"), judge.forces[:, other.nodes("bottom")].sum(axis=1)),
    ]
    return np.array([np.abs(one - two).max() / np.abs(two).max() for one, two in pairs])


@LOOSE
@pytest.mark.long
@pytest.mark.parametrize("inner", [1.0, 0.0])
def test_steps_agree_with_linear_triangles_to_second_order(inner):
    coarse, fine = differences(inner, 8), differences(inner, 16)
    assert (fine < 2e-3).all()
    assert (coarse > 3.0 * fine).all()


@LOOSE
@pytest.mark.parametrize("family", ["squares", pytest.param("voronoi", marks=pytest.mark.long)])
def test_a_ring_of_large_radius_is_in_plane_strain(family):
    """Results per unit of circumference differ from plane strain by O(1 / r)."""
    make, guide = vx.meshes.FAMILIES[family], vx.PrescribedDisplacement(0.0, on="left", direction=(1.0, 0.0))
    plane, off = press(make(6, box=((0.0, 1.0), (0.0, 0.5))), 0.0, 0.8, guide, plane="strain"), []
    for r in (1e3, 1e4):
        ring, turn = press(make(6, box=((r, r + 1.0), (0.0, 0.5))), r, 0.8, guide), TURN * r
        pairs = [
            (ring.displacement, plane.displacement),
            (ring.contact.pressure, plane.contact.pressure),
            (ring.contact.traction, plane.contact.traction),
            (ring.energy / turn, plane.energy),
            (ring.dissipated / turn, plane.dissipated),
            (ring.force("bottom") / turn, plane.force("bottom")),
            (ring.out_of_plane_stress(3), plane.out_of_plane_stress(3)),
        ]
        off.append([np.abs(one - two).max() / np.abs(two).max() for one, two in pairs])
    assert np.max(off[1]) < 2e-4
    assert np.divide(*off) == pytest.approx(10.0, rel=0.05)
