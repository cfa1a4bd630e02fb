"""Kelvin-Voigt: creep, relaxation and friction of a dashpot's solid against the recurrences that they obey exactly."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import few_families

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON, H, LENGTH = 10.0, 0.25, 0.5, 2.0
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
TAU = 0.7
UNEVEN = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.55, 1.0, 1.7, 3.0])


def solid(tau=TAU):
    """A dashpot of relaxation time tau in every direction: b = tau a."""
    return vx.Elasticity(YOUNG, POISSON), vx.Viscosity(shear=tau * MU, volume=tau * LAM)


def mesh_of(family, n=4):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, H)))


@few_families
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), None], ids=str)
def test_creep_under_a_steady_pull(family, solver):
    """u_n = (u_inf + tau/k u_{n-1}) / (1 + tau/k), steps of any length; energy, loss and work follow."""
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


@pytest.mark.long
def test_creep_converges_to_the_exponential():
    """First order in the step, to 1 - exp(-t / tau)."""
    errors = []
    scene = vx.Scene(
        *solid(),
        vx.PrescribedDisplacement(0.0, on="left", direction="normal"),
        vx.PrescribedDisplacement(0.0, on="bottom", direction="normal"),
        vx.Traction((0.3, 0.0), on="right"),
    )
    for steps in (20, 40, 80):
        history = vx.simulate(scene, mesh_of("squares", 2), np.linspace(0, 2, steps + 1), store="last")
        share = np.sqrt(history.energy[-1] / (0.5 * 0.3**2 * (1 - POISSON**2) / YOUNG * LENGTH * H))
        errors.append(abs(share - (1 - np.exp(-2 / TAU))))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
@few_families
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_shear_over_a_rough_floor(family, solver):
    """mu gamma + eta gamma' <= g: while it slips the dashpot gives way too. Moving supports, stick and slip.

    With r = tau / k and the top at U_n:  u = (a + gamma y, 0); stick gamma = (U_n - a) / H while
    |mu (gamma + r (gamma - gamma_prev))| <= g, else mu (gamma + r (gamma - gamma_prev)) = +-g.
    """
    tau, g, times = 0.05, 0.8, np.linspace(0, 5, 26)
    U = 2.5 * g * H / MU * np.interp(times, [0, 1, 3, 5], [0, 1, -1, 1])
    gamma, a, loss = np.zeros(26), np.zeros(26), np.zeros(26)
    for n, k in enumerate(np.diff(times), start=1):
        r = tau / k
        stuck = (U[n] - a[n - 1]) / H
        pull = np.clip(MU * (stuck + r * (stuck - gamma[n - 1])), -g, g)
        gamma[n] = (pull / MU + r * gamma[n - 1]) / (1 + r)
        a[n] = U[n] - gamma[n] * H
        lost = tau * MU * (gamma[n] - gamma[n - 1]) ** 2 / k * LENGTH * H
        loss[n] = loss[n - 1] + lost + g * LENGTH * abs(a[n] - a[n - 1])

    def shear(sign):
        def force(x, t):
            n = int(np.argmin(np.abs(times - t)))
            rate = 0.0 if n == 0 else tau * (gamma[n] - gamma[n - 1]) / (times[n] - times[n - 1])
            return np.tile([0.0, sign * MU * (gamma[n] + rate)], (len(x), 1))

        return force

    def top(x, t):
        return np.tile([np.interp(t, times, U), 0.0], (len(x), 1))

    scene = vx.Scene(
        *solid(tau),
        vx.PrescribedDisplacement(top, on="top"),
        vx.Traction(shear(1.0), on="right"),
        vx.Traction(shear(-1.0), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(g, on="bottom"),
    )
    mesh = mesh_of(family)
    history = vx.simulate(scene, mesh, times, solver=solver)
    loose = 1e-9 if solver.name == "Newton" else 1e-4
    exact = a[:, None] + gamma[:, None] * mesh.points[:, 1]
    assert np.abs(history.displacement[:, :, 0] - exact).max() < loose * np.abs(U).max()
    assert history.dissipated == pytest.approx(loss, abs=10 * loose * loss[-1])
    assert history.energy == pytest.approx(0.5 * MU * gamma**2 * LENGTH * H, abs=10 * loose)
    rest = history.work - history.energy - history.dissipated
    assert (np.diff(rest) >= -1e-9 * history.work[-1]).all()
    assert 0 < history.contact.sticking[1:].mean() < 1


def test_without_dashpots_nothing_changes():
    """Viscosity 0 gives the elastic answer, whatever the lengths of steps."""
    beside = vx.Clamp(on="left"), vx.BilateralContact("bottom"), vx.TrescaFriction(0.05, "bottom")
    load = vx.Traction(lambda x, t: np.tile([0.3 * np.sin(3 * t), 0.0], (len(x), 1)), on="right")
    mesh = mesh_of("hexagons", 4)
    elastic = vx.simulate(vx.Scene(vx.Elasticity(YOUNG, POISSON), *beside, load), mesh, UNEVEN)
    viscous = vx.simulate(vx.Scene(*solid(0.0), *beside, load), mesh, UNEVEN)
    size = np.abs(elastic.displacement).max()
    assert np.abs(elastic.displacement - viscous.displacement).max() < 1e-10 * size
    assert viscous.dissipated == pytest.approx(elastic.dissipated, rel=1e-9)


GRIPS = {
    "nothing": (),
    "bound": (vx.BilateralContact("bottom"), vx.TrescaFriction(0.05, "bottom")),
    "floor": (vx.UnilateralContact("bottom"), vx.TrescaFriction(0.05, "bottom")),
    "give": (vx.NormalCompliance(40.0, "bottom"), vx.TrescaFriction(0.05, "bottom")),
}


@pytest.mark.long
@pytest.mark.parametrize("whole", [{"condense": False}, {"linear": vx.Iterative()}], ids=["all unknowns", "iterative"])
@pytest.mark.parametrize("grip", GRIPS.values(), ids=GRIPS)
def test_programs_of_all_unknowns(grip, whole):
    """Each answer is certified within 1e-8 a step: the eight steps of two runs lie within 2e-7."""
    if "linear" in whole:
        pytest.importorskip("pyamg")

    def load(x, t):
        return np.tile([0.3 * np.sin(3 * t), -0.1 * t], (len(x), 1))

    scene = vx.Scene(*solid(), vx.Clamp(on="left"), vx.Traction(load, on="right"), *grip)
    condensed = vx.simulate(scene, mesh_of("hexagons", 4), UNEVEN)
    history = vx.simulate(scene, mesh_of("hexagons", 4), UNEVEN, **whole)
    apart = vx.measures.energy_distance(condensed, history, kind="nodal").absolute
    assert apart < 2e-7 * np.sqrt(2 * condensed.energy.max())
    assert history.work == pytest.approx(condensed.work, abs=1e-6 * condensed.work.max())


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (lambda: vx.Viscosity(-1.0), r"^Viscosity: found shear = -1 in cell 0; it must be >= 0\.$"),
        (lambda: vx.Viscosity(1.0, "zeta"), r"^Viscosity: volume: the mesh has no cell datum named 'zeta'"),
    ],
)
def test_mistakes(mistake, message):
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp("left"), mistake())
    with pytest.raises(vx.SceneError, match=message):
        vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0])


@few_families
@pytest.mark.parametrize("store", ["all", 3])
def test_dashpots_push_on_supports_and_floors(family, store):
    """Whatever share of a steady pull dashpots still bear, supports bear all of it; and so does a floor of pressure."""
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


@pytest.mark.long
@pytest.mark.parametrize(
    "contact", [vx.UnilateralContact(on="bottom", gap=0.03), vx.NormalCompliance(50.0, "bottom", 0.03)]
)
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=["Newton", "Clarabel"])
def test_a_viscous_body_may_be_carried_until_it_touches(contact, solver):
    """Its increment has energy in the layer at the supports, its state none: errors relative to that said nothing."""

    def carried(x, t):
        return np.tile([0.05 * t, -0.1 * t], (len(x), 1))

    effects = vx.Elasticity(10.0, 0.3), vx.Viscosity(2.0), vx.PrescribedDisplacement(carried, on="top")
    scene = vx.Scene(*effects, contact, vx.CoulombFriction(0.3, on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(3), np.linspace(0, 1, 9), solver=solver)
    assert history.energy[2] < 1e-12 * history.energy[-1]
    assert history.contact.closed_count[-1] > 0
    assert history.certificate.max() <= solver.accuracy
