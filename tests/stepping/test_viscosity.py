"""Kelvin-Voigt solids: creep and friction compared with exact recurrences of backward Euler."""

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON, H, LENGTH = 10.0, 0.25, 0.5, 2.0
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
TAU = 0.7
UNEVEN = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.55, 1.0, 1.7, 3.0])


def solid(tau=TAU):
    """Return an elastic and a viscous effect; viscous moduli are elastic moduli times tau."""
    return vx.Elasticity(YOUNG, POISSON), vx.Viscosity(shear=tau * MU, volume=tau * LAM)


def mesh_of(family, n=4):
    return small(family, n, box=((0, LENGTH), (0, H)))


@few_families
@mostly_long("solver", [vx.Newton(), vx.Clarabel(), None], 0, 2, ids=str)
def test_creep_follows_its_recurrence(family, solver):
    """u_n = (u_inf + tau/k u_{n-1}) / (1 + tau/k) in steps of length k, with the elastic displacement u_inf."""
    scene = vx.Scene(
        *solid(),
        vx.PrescribedDisplacement(0.0, on="left", direction="normal"),
        vx.BilateralContact(on="bottom"),
        vx.Traction((0.3, 0.0), on="right"),
        *([] if solver is None else [vx.TrescaFriction(0.0, on="bottom")]),
    )
    mesh = mesh_of(family)
    history = vx.simulate(scene, mesh, UNEVEN, solver=solver)
    share = np.zeros(len(UNEVEN))
    for n, k in enumerate(np.diff(UNEVEN), start=1):
        share[n] = (1 + TAU / k * share[n - 1]) / (1 + TAU / k)
    final = mesh.points * 0.3 * np.array([(1 - POISSON**2), -POISSON * (1 + POISSON)]) / YOUNG
    loose = 1e-10 if solver is None or solver.name == "Newton" else 1e-5
    assert np.abs(history.displacement - share[:, None, None] * final).max() < loose * np.abs(final).max()
    full = 0.5 * 0.3 * final[:, 0].max() * H
    assert history.energy == pytest.approx(share**2 * full, abs=loose * full)
    steps = np.diff(share)
    assert np.diff(history.dissipated) == pytest.approx(2 * TAU * steps**2 / np.diff(UNEVEN) * full, abs=loose * full)
    assert np.diff(history.work) == pytest.approx(2 * steps * full, abs=loose * full)
    rest = history.work - history.energy - history.dissipated
    assert np.diff(rest) == pytest.approx(steps**2 * full, abs=loose * full)


G, V = 0.8, 0.04
PRESSURE, ACROSS = (LAM + 2 * MU) * V / H, -LAM * V / H
FLOORS = {
    "Tresca": (vx.BilateralContact(on="bottom"), vx.TrescaFriction(G, on="bottom")),
    "Coulomb": (vx.UnilateralContact(on="bottom"), vx.CoulombFriction(G / PRESSURE, on="bottom")),
    "capped": (vx.UnilateralContact(on="bottom"), vx.CoulombFriction(1.5 * G / PRESSURE, on="bottom", cap=G)),
}


@pytest.mark.long
@few_families
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
@pytest.mark.parametrize(("floor", "tau"), [("Tresca", 0.05), ("Coulomb", 0.0), ("Coulomb", 0.05), ("capped", 0.0)])
def test_a_viscous_block_sheared_over_a_rough_floor_follows_its_recurrence(family, solver, floor, tau):
    """A block of height H is pressed and sheared.

    Let mu be the shear modulus, g the friction bound, k the step length, and r = tau / k. The top moves by U_n, and the
    base by a_n. The shear is gamma = (U_n - a_n) / H. While the block sticks, a_n is constant. While the block slips,
    mu (gamma + r (gamma - gamma_prev)) = +-g.
    """
    times = np.linspace(0, 5, 21)
    U = 2.5 * G * H / MU * np.interp(times, [0, 1, 3, 5], [0, 1, -1, 1])
    gamma, a, loss, pull = np.zeros(21), np.zeros(21), np.zeros(21), np.zeros(21)
    for n, k in enumerate(np.diff(times), start=1):
        r, stuck = tau / k, (U[n] - a[n - 1]) / H
        pull[n] = np.clip(MU * (stuck + r * (stuck - gamma[n - 1])), -G, G)
        gamma[n] = (pull[n] / MU + r * gamma[n - 1]) / (1 + r)
        a[n] = U[n] - gamma[n] * H
        lost = tau * MU * (gamma[n] - gamma[n - 1]) ** 2 / k * LENGTH * H
        loss[n] = loss[n - 1] + lost + G * LENGTH * abs(a[n] - a[n - 1])
    pressed = 0.0 if floor == "Tresca" else 1.0

    def side(sign):
        return lambda x, t: [sign * pressed * ACROSS, sign * pull[np.argmin(np.abs(times - t))]]

    scene = vx.Scene(
        *solid(tau),
        vx.PrescribedDisplacement(lambda x, t: [np.interp(t, times, U), -pressed * V], on="top"),
        vx.Traction(side(1.0), on="right"),
        vx.Traction(side(-1.0), on="left"),
        *FLOORS[floor],
    )
    mesh = mesh_of(family)
    history = vx.simulate(scene, mesh, times, solver=solver, initial="settled")
    given, follows = {"Newton": (1e-9, 1e-6), "Clarabel": (1e-4, 1e-3)}[solver.name]
    loose = given if floor == "Tresca" else follows
    contact, exact = history.contact, a[:, None] + gamma[:, None] * mesh.points[:, 1]
    assert np.abs(history.displacement[:, :, 0] - exact).max() < loose * np.abs(U).max()
    assert np.abs(contact.traction[:, :, 0] + pull[:, None]).max() < 10 * loose * G
    assert np.abs(contact.bound - G).max() < loose * G
    assert history.dissipated == pytest.approx(loss, abs=10 * loose * loss[-1])
    if floor == "Tresca":
        assert history.energy == pytest.approx(0.5 * MU * gamma**2 * LENGTH * H, abs=10 * loose)
    else:
        assert np.abs(contact.pressure - PRESSURE).max() < loose * PRESSURE
    rest = history.work - (history.energy - history.energy[0]) - history.dissipated
    assert (np.diff(rest) >= -1e-9 * np.abs(history.work).max()).all()
    assert 0 < contact.sticking[1:].mean() < 1


@few_families
@mostly_long("store", ["all", 3], 1)
def test_reactions_include_the_forces_of_dashpots(family, store):
    scene = vx.Scene(
        *solid(),
        vx.PrescribedDisplacement(0.0, on="left", direction="normal"),
        vx.BilateralContact(on="bottom"),
        vx.Traction((0.3, 0.0), on="right"),
        vx.Traction((0.0, -0.2), on="top"),
    )
    history = vx.simulate(scene, mesh_of(family), UNEVEN, store=store)
    later = slice(1, None)
    assert history.reaction("left")[later, 0] == pytest.approx(-0.3 * H, rel=1e-10)
    assert history.contact.pressure[later] == pytest.approx(0.2, rel=1e-9)
    assert np.abs(history.forces.sum(axis=1)[later] - [-0.3 * H, 0.2 * LENGTH]).max() < 1e-10
