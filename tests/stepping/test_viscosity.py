"""Kelvin-Voigt: creep, relaxation and friction of a dashpot's solid against the recurrences that they obey exactly."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import few_families
from scipy.sparse.linalg import splu
from stopped import Stopped, stop_at

import vemcvx as vx
from vemcvx.scene import pose_scene
from vemcvx.stepping.viscous import shared_lengths

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


def test_one_factorisation_a_length_of_step(monkeypatch):
    from vemcvx.program.condensation import Condensation

    made = []
    plain = Condensation.__init__
    monkeypatch.setattr(
        Condensation, "__init__", lambda self, *args, **more: (made.append(1), plain(self, *args, **more))[1]
    )
    scene = vx.Scene(*solid(), vx.Clamp(on="left"), vx.Traction((0.3, 0.0), on="right"))
    vx.simulate(scene, mesh_of("squares", 2), np.linspace(0, 1, 41))
    assert len(made) == 2, "one for the elastic system, one for the only length of step"
    made.clear()
    vx.simulate(scene, mesh_of("squares", 2), np.cumsum([0.0, *[0.1, 0.2] * 10]))
    assert len(made) == 3


@pytest.mark.long
def test_a_viscous_run_goes_on_where_it_stopped(tmp_path):
    scene = vx.Scene(*solid(), vx.Clamp(on="left"), vx.Traction((0.3, 0.0), on="right"))
    mesh, times = mesh_of("voronoi", 3), np.linspace(0, 1, 9)
    whole = vx.simulate(scene, mesh, times)
    with pytest.raises(Stopped):
        vx.simulate(scene, mesh, times, stream=tmp_path / "run", progress=stop_at(5))
    again = vx.simulate(scene, mesh, times, stream=tmp_path / "run", resume=True)
    assert np.abs(again.displacement - whole.displacement).max() < 1e-12 * np.abs(whole.displacement).max()
    assert again.dissipated == pytest.approx(whole.dissipated, rel=1e-12)


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
@pytest.mark.parametrize("whole", [{"condense": False}, {"linear": vx.Multigrid()}], ids=["all unknowns", "multigrid"])
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
@few_families
def test_everything_balances_while_supports_move_and_friction_rubs(family):
    """Forces and moments, at every instant and however few are stored."""
    scene = vx.Scene(
        *solid(0.2),
        vx.PrescribedDisplacement(lambda x, t: 0.1 * np.sin(t) * x + [0.05 * t, -0.1 * t], on="top"),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.02 * (2 + np.cos(5 * t)) + 0 * x[:, 0]),
        vx.TrescaFriction(0.05, on="bottom"),
        vx.BodyForce((0.3, -1.0)),
    )
    mesh = mesh_of(family)
    for store in ("all", 3):
        history = vx.simulate(scene, mesh, UNEVEN, store=store, solver=vx.Newton())
        load = np.array([pose_scene(scene, mesh).force(t) for t in history.times[1:]]).reshape(-1, *mesh.points.shape)
        forces = history.forces[1:]
        scale = np.abs(forces).sum()
        assert np.abs((forces + load).sum(axis=1)).max() < 1e-12 * scale
        assert np.abs(np.einsum("ia,sia->s", mesh.points @ [[0, 1], [-1, 0]], forces + load)).max() < 1e-12 * scale
        # Where nothing holds a node, nothing is exerted on it.
        free = np.setdiff1d(np.arange(mesh.n_nodes), np.union1d(mesh.boundaries["top"], mesh.boundaries["bottom"]))
        assert np.abs(forces[:, free]).max(initial=0.0) < 1e-10 * np.abs(forces).max()


def test_lengths_of_steps_are_shared_when_rounding_explains_that_they_differ():
    def count(instants):
        lengths = shared_lengths(instants)
        assert np.abs(lengths / np.diff(instants) - 1).max() <= 1e-11
        return len(np.unique(lengths))

    for steps in (41, 1000, 20_000):
        assert count(np.linspace(0, 1, steps)) == 1
    assert count(5 + np.linspace(0, 1, 1000)) == 1
    assert count(np.cumsum([0.0, *[0.1, 0.2] * 10])) == 2
    assert count(np.array([0.0, 1.0, 2.0 + 1e-14, 3.0])) == 3
    assert count(100 + np.linspace(0, 1e-3, 8)) > 1


def exactly(A, f):
    """A^{-1} f of rational numbers, by elimination."""
    rows = [[*row, value] for row, value in zip(A, f, strict=True)]
    n = len(rows)
    for i in range(n):
        for j in range(i + 1, n):
            share = rows[j][i] / rows[i][i]
            rows[j] = [other - share * own for other, own in zip(rows[j], rows[i], strict=True)]
    x = [Fraction(0)] * n
    for i in reversed(range(n)):
        x[i] = (rows[i][n] - sum(rows[i][j] * x[j] for j in range(i + 1, n))) / rows[i][i]
    return x


def rational(values):
    return [Fraction(float(value)) for value in values]


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(
    ("tau", "times"),
    [
        (100.0, np.linspace(0, 1, 8)),
        (1e4, np.linspace(0, 1, 8)),
        (1.0, np.array([0.0, 1e3, 1e3 + 1e-3, 1e3 + 2e-3])),
        (1.0, 100 + np.linspace(0, 1e-3, 5)),
    ],
)
def test_certificate_and_floor_hold_against_rational_numbers(tau, times, moving):
    """(K + C/k) d = f_n - (m_n - m_{n-1}) / k - K y_{n-1} without rounding, from the y_{n-1} that is stored."""

    def top(x, t):
        return np.tile([0.1 * np.sin(3 * (t - times[0])), -0.05 * (t - times[0])], (len(x), 1))

    def pull(x, t):
        return np.tile([0.3 + 0.1 * t, -0.2 * t], (len(x), 1))

    support = vx.PrescribedDisplacement(top, on="left") if moving else vx.Clamp("left")
    scene = vx.Scene(*solid(tau), support, vx.Traction(pull, on="right"))
    mesh = vx.meshes.voronoi(2)
    run, system = vx.simulate(scene, mesh, times, check=False).trajectory, pose_scene(scene, mesh, times).system
    K, C = ([rational(row) for row in (0.5 * (A + A.T)).toarray()] for A in (system.K, system.damping.C))
    dirichlet_force = system.damping.motion.dirichlet_force if moving else lambda t: np.zeros(system.n)

    def times_K(y):
        return [sum(a * b for a, b in zip(row, y, strict=True)) for row in K]

    for n in range(1, len(times)):
        s, t = map(Fraction, times[n - 1 : n + 1].tolist())
        before, here = rational(run.state[n - 1]), rational(run.state[n])
        pulled = zip(
            *map(rational, (system.force(times[n]), dirichlet_force(times[n]), dirichlet_force(times[n - 1]))),
            strict=True,
        )
        force = [f - (m - old) / (t - s) - own for (f, m, old), own in zip(pulled, times_K(before), strict=True)]
        sum_of = [[a + b / (t - s) for a, b in zip(*rows, strict=True)] for rows in zip(K, C, strict=True)]
        d = exactly(sum_of, force)
        off = [y - b - e for y, b, e in zip(here, before, d, strict=True)]
        error = np.sqrt(float(sum(a * b for a, b in zip(off, times_K(off), strict=True))))
        assert error <= np.sqrt(2 * run.gap[n]) + np.sqrt(2 * run.floor[n])


def refined_in_extended_precision(system, y, s, t):
    """d of (K + C/k) d = f - K y."""
    K, C, k = (x.astype(np.longdouble) for x in (system.K, system.damping.C, np.float64(t) - np.float64(s)))
    factors = splu(sp.csc_matrix(system.K + system.damping.C / (t - s)))
    d = np.zeros(system.n, dtype=np.longdouble)
    for _ in range(6):
        d = d + factors.solve((system.force(t) - K @ (y + d) - C @ d / k).astype(float))
    return d


@pytest.mark.skipif(np.finfo(np.longdouble).eps == np.finfo(float).eps, reason="no extended precision here")
def test_rounding_of_equal_cells_is_certified():
    """Cells that are equal round K + C/k equally, which adds up: four times what random signs would make of it."""
    scene = vx.Scene(
        vx.Elasticity(1.7, 0.3),
        vx.Viscosity(0.013, 0.0091),
        vx.Clamp(on="left"),
        vx.Traction(lambda x, t: np.tile([0.3 * t, -0.2 * t], (len(x), 1)), on="right"),
    )
    mesh, times = vx.meshes.squares(32), np.array([0.0, 0.1, 0.2])
    run, system = vx.simulate(scene, mesh, times).trajectory, pose_scene(scene, mesh, times).system
    for n, (s, t) in enumerate(pairwise(times), start=1):
        before = run.state[n - 1]
        off = (run.state[n] - before - refined_in_extended_precision(system, before, s, t)).astype(float)
        K = system.K + system.damping.C / (t - s)
        cut = np.finfo(float).eps / 2 * np.abs(run.state[n])
        # The certificate is evaluated with cond(K) eps, 1e-11; what the sum y + d has lost is in the floor.
        assert np.sqrt(off @ (K @ off)) <= (1 + 1e-9) * np.sqrt(2 * run.gap[n]) + np.sqrt(cut @ (abs(K) @ cut))


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Clarabel(accuracy=1e-4), vx.OSQP(accuracy=1e-5)], ids=lambda s: s.name)
def test_the_accuracy_asked_is_that_of_the_state(solver):
    """Increments have a norm with the dashpots in it, tau / k times as large in its square: not that is meant."""
    scene = vx.Scene(
        *solid(10.0),
        vx.Clamp(on="right"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
        vx.Pressure(lambda x, t: np.full(len(x), 0.1 * t), on="top"),
        vx.Traction(lambda x, t: np.tile([0.1 * np.sin(5 * t), 0.0], (len(x), 1)), on="left"),
    )
    history = vx.simulate(scene, mesh_of("voronoi", 2), [0.0, 0.25, 0.5], solver=solver)
    assert history.certificate.max() <= solver.accuracy


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
