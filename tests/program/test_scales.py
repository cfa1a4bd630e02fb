"""What errors are relative to: states without energy, units without end, and numbers that are none."""

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx
from vemcvx.scene import pose_scene

GAP, DEEP = 0.1, 0.14
MOTIONS = {
    "straight": lambda t: (0.0, -DEEP * t),
    "aslant": lambda t: (0.1 * t, -DEEP * t),
    "down and back": lambda t: (0.05 * np.sin(np.pi * t), -DEEP * np.sin(np.pi * t)),
    "near, and back": lambda t: (0.05 * np.sin(np.pi * t), -0.9 * GAP * np.sin(np.pi * t)),
}
FRICTION = {
    "none": (),
    "Tresca's": (vx.TrescaFriction(5.0, on="bottom"),),
    "Coulomb's": (vx.CoulombFriction(0.3, on="bottom"),),
}


def lowered(motion, friction, family, solver, condense, n=3, steps=5):
    """A block moved rigidly towards an obstacle below it."""
    scene = vx.Scene(
        vx.Elasticity(1000.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.tile(MOTIONS[motion](t), (len(x), 1)), on="top"),
        vx.UnilateralContact("bottom", GAP),
        *FRICTION[friction],
    )
    mesh = small(family, n)
    return mesh, vx.simulate(scene, mesh, np.linspace(0, 1, steps + 1), solver=solver, condense=condense)


def judge(mesh, history, motion, friction):
    """Certified as asked; rigid, and without pressure, until it touches, as far as certificates allow."""
    accuracy = 1e-8 if "Newton" in history.solver else 1e-6
    assert history.certificate.max() <= accuracy
    way = np.array([MOTIONS[motion](t) for t in history.times])
    apart = np.append(-way[:, 1] < GAP, False)[:-1]
    assert apart[:2].all()
    if friction == "Tresca's":  # rubs where it does not touch, too
        return
    for n in np.flatnonzero(np.logical_and.accumulate(apart)):
        off = np.abs(history.displacement[n] - way[n]).max()
        # One node moved by x costs at least x^2 / (K^{-1})_ii; the softest, mu, is 385 and bodies here are of size one.
        assert off <= 10 * accuracy * np.abs(way).max()
        assert history.trajectory.norm[n] <= 10 * accuracy * 20 * np.abs(way).max()
    assert np.isfinite(history.certificate_total).all()


@mostly_long("motion", MOTIONS, "down and back")
@mostly_long("condense", [True, False])
@pytest.mark.parametrize(
    ("family", "friction"), [("squares", "none"), ("triangles", "Tresca's"), ("voronoi", "Coulomb's")]
)
def test_approach(family, motion, condense, friction):
    judge(*lowered(motion, friction, family, vx.Newton(), condense), motion, friction)


@pytest.mark.long
@pytest.mark.parametrize("friction", ["none", "Coulomb's"])
@pytest.mark.parametrize("solver", [vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
def test_approach_by_conic_solvers(solver, friction):
    judge(*lowered("down and back", friction, "voronoi", solver, True), "down and back", friction)


@few_families
@mostly_long("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_loads_that_vanish_leave_what_friction_keeps_or_nothing(family, solver):
    """Back to rest after a press that lifts off again: the scale is that of the largest state, and stays."""
    scene = vx.Scene(
        vx.Elasticity(1000.0, 0.3),
        vx.Clamp(on="top"),
        vx.UnilateralContact("bottom", 0.001),
        vx.Traction(lambda x, t: [0.0, -40.0 * max(np.sin(2 * np.pi * t), 0.0)], on="right"),
    )
    history = vx.simulate(scene, small(family, 3), np.linspace(0, 1, 9), solver=solver)
    assert history.certificate.max() <= solver.accuracy
    assert history.trajectory.norm[-1] <= 2 * history.certificate_total[-1] * history.trajectory.norm.max()
    assert (history.contact.pressure > 0).any()


def pulled(force=1.0, stiffness=1.0, kind="Tresca"):
    """A block whose loads, bounds and gaps are in proportion to `force`, in units of which its stiffness is another."""
    kinds = {
        "Tresca": (vx.BilateralContact("bottom"), vx.TrescaFriction(0.3 * force, "bottom")),
        "contact": (vx.UnilateralContact("bottom", 0.1 * force / stiffness),),
        "Coulomb": (vx.UnilateralContact("bottom", 0.1 * force / stiffness), vx.CoulombFriction(0.3, "bottom")),
        "viscous": (
            vx.BilateralContact("bottom"),
            vx.TrescaFriction(0.3 * force, "bottom"),
            vx.Viscosity(0.1 * stiffness),
        ),
    }
    return vx.Scene(
        vx.Elasticity(stiffness, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: [force * t, -0.2 * force * t], on="left"),
        *kinds[kind],
    )


POWERS = [(-390, 0), (390, 0), (0, 300), (0, -300), (-200, 150), (37, -91)]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["Tresca", "contact", "Coulomb", "viscous"])
def test_units_change_nothing_but_rounding(kind):
    """Loads times 2^a, stiffness times 2^b: displacements times 2^(a - b), energies times 2^(2a - b)."""
    mesh, times = small("voronoi", 3), [0.0, 0.4, 1.0]
    plain = vx.simulate(pulled(kind=kind), mesh, times)
    for a, b in POWERS:
        history = vx.simulate(pulled(2.0**a, 2.0**b, kind), mesh, times)
        size = np.abs(plain.displacement).max()
        assert np.abs(np.ldexp(history.displacement, b - a) - plain.displacement).max() <= 1e-12 * size
        assert np.ldexp(history.energy, b - 2 * a) == pytest.approx(plain.energy, rel=1e-12)
        assert np.ldexp(history.dissipated, b - 2 * a) == pytest.approx(plain.dissipated, rel=1e-10)
        assert history.certificate.max() <= 1e-11


@mostly_long("force", [1e-300, 1e-145, 1e-130, 1e130, 1e155, 1e200, 1e300], 0, 4)
@pytest.mark.parametrize("kind", ["Tresca", "contact", "Coulomb", "viscous"])
def test_loads_whose_energy_is_no_number_are_refused(force, kind):
    with pytest.raises(
        vx.SceneError, match=r"^data: loads and motions in the step to t = 0\.5 have an energy norm of .*; it must be"
    ):
        vx.simulate(pulled(force, kind=kind), vx.meshes.squares(3), [0.0, 0.5, 1.0])


def test_loads_that_fade_are_no_mistake():
    """Beside what has been, a load of 1e-200 is none."""
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: [10.0 ** (-200 * (t - 0.5)) * (t > 0), 0.0], on="left"),
        vx.UnilateralContact("bottom", 0.1),
    )
    history = vx.simulate(scene, vx.meshes.squares(3), [0.0, 0.5, 1.0, 1.5, 1.6])
    assert history.certificate.max() <= 1e-8
    assert history.trajectory.norm[-1] <= 1e-14 * history.trajectory.norm[1]


@pytest.mark.long
@few_families
@pytest.mark.parametrize("off", [1e-6, 1e-9, 0.0])
def test_what_is_out_of_balance_at_the_start_is_certified(family, off):
    """u_0 off by so much of the energy norm: the exact run begins where one step at times[0] leads from there."""
    mesh, times = small(family, 3), np.linspace(0, 1, 4)

    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.Clamp(on="right"),
        vx.BilateralContact("bottom"),
        vx.TrescaFriction(0.05, "bottom"),
        vx.Traction(lambda x, t: [0.1 + 0.1 * t if t >= 0 else 0.1 * (1 + 1e-14), 0.0], on="left"),
    )
    settled = vx.simulate(scene, mesh, times[:1], initial="settled")
    A, size = pose_scene(scene, mesh).A, settled.trajectory.norm[0]
    push = np.zeros(mesh.points.shape)
    push[:, 0] = (1 - mesh.points[:, 0]) ** 2
    push *= 0.9 * off * size / np.sqrt(push.ravel() @ A @ push.ravel())
    start = settled.displacement[0] + push
    history = vx.simulate(scene, mesh, times, initial=start)
    exact = vx.simulate(scene, mesh, [-1.0, *times], initial=start)
    apart = (history.displacement - exact.displacement[1:]).reshape(len(times), -1)
    distance = np.sqrt(np.einsum("ni,ni->n", apart, (A @ apart.T).T))
    run, other = history.trajectory, exact.trajectory
    allowed = history.certificate_total * run.norm + np.sqrt(2 * other.gap[1:]).cumsum()
    rounding = np.sqrt(2 * run.floor).cumsum() + np.sqrt(2 * other.floor).cumsum()[1:] + 4e-16 * size
    assert (distance <= allowed * (1 + 1e-9) + rounding).all()
    if off:
        # Friction keeps a part of the push; the rest springs back.
        assert distance[0] == pytest.approx(history.certificate[0] * size, rel=1e-3)
        assert 0.1 * off <= history.certificate[0] <= off
    else:
        assert history.certificate_total.max() <= 1e-10


@pytest.mark.long
def test_a_start_out_of_balance_is_left_at_the_first_step():
    """Nothing changes, but the given state is farther off than a step may be: it is solved, not held."""
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.Clamp("left"),
        vx.Traction((0.0, -0.01), "right"),
        vx.BilateralContact("bottom"),
        vx.TrescaFriction(1e-3, "bottom"),
    )
    mesh = vx.meshes.squares(4)
    start = vx.simulate(scene, mesh, [0.0], initial="settled").displacement[0]
    history = vx.simulate(scene, mesh, [0.0, 1.0, 2.0], initial=start * (1 + 4e-7))
    assert 1e-7 < history.certificate[0] <= 1e-6
    assert (history.certificate[1:] <= 1e-8).all()
    assert (history.certificate_total >= history.certificate[0]).all()
