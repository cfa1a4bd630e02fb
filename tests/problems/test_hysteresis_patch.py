"""The frictional hysteresis patch test: a closed form with stick, slip and reversal, exact on every mesh.

The block (0, L) x (0, H) of the shear modulus mu is in bilateral contact at its bottom, with Tresca friction of the
bound g. Its top moves by (U(t), 0), and its sides bear the tractions +-(0, mu gamma(t)). At step n the shear strain is
gamma_n = clip((U_n - a_{n-1}) / H, +-g / mu), and the slip is a_n = U_n - gamma_n H. The field u = (a_n + gamma_n y, 0)
is linear, so virtual elements reproduce it. A loop of the amplitude U0 > g H / mu dissipates 4 g L (U0 - g H / mu).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scenes import any_family, small

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON, L, H = 10.0, 0.25, 2.0, 0.5
MU = YOUNG / (2 * (1 + POISSON))
G = 0.8
U0 = 2.5 * G * H / MU
TIMES = np.linspace(0.0, 5.0, 21)
U = U0 * np.interp(TIMES, [0, 1, 3, 5], [0, 1, -1, 1])


def closed_form():
    """Return shear strain, slip of the bottom, and friction work at every instant."""
    gamma, a, loss = np.zeros(len(U)), np.zeros(len(U)), np.zeros(len(U))
    for n in range(1, len(U)):
        gamma[n] = np.clip((U[n] - a[n - 1]) / H, -G / MU, G / MU)
        a[n] = U[n] - gamma[n] * H
        loss[n] = loss[n - 1] + G * L * abs(a[n] - a[n - 1])
    return gamma, a, loss


def scene():
    gamma, _, _ = closed_form()

    def shear(sign):
        return lambda x, t: np.tile([0.0, sign * MU * np.interp(t, TIMES, gamma)], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: np.tile([np.interp(t, TIMES, U), 0.0], (len(x), 1)), on="top"),
        vx.Traction(shear(1.0), on="right"),
        vx.Traction(shear(-1.0), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=G, on="bottom"),
    )


@cache
def run(family):
    mesh = small(family, 4, box=((0, L), (0, H)))
    return vx.simulate(scene(), mesh, TIMES, solver=vx.Newton())


@any_family
def test_displacements_and_dissipation_are_exact(family):
    history, (gamma, a, loss) = run(family), closed_form()
    exact = np.zeros_like(history.displacement)
    exact[:, :, 0] = a[:, None] + gamma[:, None] * history.mesh.points[:, 1]
    assert np.abs(history.displacement - exact).max() < 1e-10 * U0
    assert np.abs(history.dissipated - loss).max() < 1e-10 * loss[-1]
    # The loop from the first turning point (t = 1) back to it (t = 5) is closed.
    closed = history.dissipated[20] - history.dissipated[4]
    assert closed == pytest.approx(4 * G * L * (U0 - G * H / MU), rel=1e-10)


@any_family
def test_stick_slip_and_tractions_are_exact(family):
    history, (gamma, a, _) = run(family), closed_form()
    slips = np.append(False, np.abs(np.diff(a)) > 1e-12 * U0)
    assert slips.any()
    assert not slips[1:].all()
    assert (history.contact.sticking == ~slips[:, None]).all()
    # The outward normal of the bottom is (0, -1): friction on the body is minus the shear stress.
    shear = np.where(slips, np.sign(np.append(0.0, np.diff(a))) * G, MU * gamma)
    assert np.abs(history.contact.traction[:, :, 0] + shear[:, None]).max() < 1e-10 * G
    assert np.abs(history.contact.pressure).max() < 1e-10 * G
