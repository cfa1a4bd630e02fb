"""Relative errors for states without energy, extreme units and extreme loads."""

import numpy as np
import pytest
from scenes import mostly_long, small

import vemcvx as vx
from vemcvx.scene import pose_scene

GAP = 0.1


@pytest.mark.parametrize(
    ("family", "friction"),
    [("squares", ()), ("triangles", (vx.CoulombFriction(0.3, on="bottom"),))],
    ids=["no friction", "Coulomb"],
)
@mostly_long("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
def test_a_rigid_approach_to_an_obstacle_is_certified(family, friction, solver):
    """The block has no energy until contact closes, and after contact has opened."""
    scene = vx.Scene(
        vx.Elasticity(1000.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.05, -0.14], (len(x), 1)) * np.sin(np.pi * t), on="top"),
        vx.UnilateralContact("bottom", GAP),
        *friction,
    )
    history = vx.simulate(scene, small(family, 3), np.linspace(0, 1, 6), solver=solver)
    accuracy = 1e-8 if solver.name == "Newton" else 1e-6
    assert history.certificate.max() <= accuracy
    assert np.isfinite(history.certificate_total).all()
    motion = np.outer(np.sin(np.pi * history.times), [0.05, -0.14])
    for n in range(2):
        assert -motion[n, 1] < GAP
        assert np.abs(history.displacement[n] - motion[n]).max() <= 10 * accuracy * np.abs(motion).max()
        # A displacement x has an energy norm of about 20 x.
        assert history.trajectory.norm[n] <= 10 * accuracy * 20 * np.abs(motion).max()


KINDS = "Tresca", "contact", "Coulomb", "viscous"


def make_pulled_block(kind, force=1.0, stiffness=1.0):
    """Return a block. Loads and friction bounds grow with `force`, and the gap grows with `force / stiffness`."""
    gap = 0.1 * force / stiffness
    rough = vx.BilateralContact("bottom"), vx.TrescaFriction(0.3 * force, "bottom")
    contact = {
        "Tresca": rough,
        "contact": (vx.UnilateralContact("bottom", gap),),
        "Coulomb": (vx.UnilateralContact("bottom", gap), vx.CoulombFriction(0.3, "bottom")),
        "viscous": (*rough, vx.Viscosity(0.1 * stiffness)),
    }
    return vx.Scene(
        vx.Elasticity(stiffness, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: [force * t, -0.2 * force * t], on="left"),
        *contact[kind],
    )


@mostly_long("a, b", [(37, -91), (-390, 0), (390, 0), (0, 300), (0, -300), (-200, 150)])
@pytest.mark.parametrize("kind", KINDS)
def test_units_change_answers_by_rounding_only(kind, a, b):
    """Loads grow by the factor 2^a, stiffnesses by 2^b, displacements by 2^(a - b), and energies by 2^(2a - b)."""
    mesh, times = small("voronoi", 3), [0.0, 0.4, 1.0]
    plain = vx.simulate(make_pulled_block(kind), mesh, times)
    history = vx.simulate(make_pulled_block(kind, 2.0**a, 2.0**b), mesh, times)
    size = np.abs(plain.displacement).max()
    assert np.abs(np.ldexp(history.displacement, b - a) - plain.displacement).max() <= 1e-12 * size
    assert np.ldexp(history.energy, b - 2 * a) == pytest.approx(plain.energy, rel=1e-12)
    assert np.ldexp(history.dissipated, b - 2 * a) == pytest.approx(plain.dissipated, rel=1e-10)
    assert history.certificate.max() <= 1e-11


@pytest.mark.parametrize("force", [1e-300, 1e155])
@pytest.mark.parametrize("kind", KINDS)
def test_loads_whose_energy_overflows_or_underflows_are_refused(force, kind):
    with pytest.raises(vx.SceneError, match=r"^data: loads and motions in the step to t = 0\.5 have an energy norm of"):
        vx.simulate(make_pulled_block(kind, force), vx.meshes.squares(3), [0.0, 0.5, 1.0])


def make_held_block(force):
    """Return a block on a rough floor, pulled by the traction `force(t)`."""
    return vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.Clamp(on="right"),
        vx.BilateralContact("bottom"),
        vx.TrescaFriction(0.05, "bottom"),
        vx.Traction(lambda x, t: [force(t), 0.0], on="left"),
    )


@pytest.mark.long
@pytest.mark.parametrize("off", [1e-6, 1e-9, 0.0])
def test_a_start_out_of_balance_is_certified(off):
    """The distance from the start to equilibrium is 0.9 * `off`, in the relative energy norm."""
    mesh, times = small("voronoi", 3), np.linspace(0, 1, 4)
    scene = make_held_block(lambda t: 0.1 + 0.1 * t if t >= 0 else 0.1 * (1 + 1e-14))
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
        assert distance[0] == pytest.approx(history.certificate[0] * size, rel=1e-3)
        assert 0.1 * off <= history.certificate[0] <= off
    else:
        assert history.certificate_total.max() <= 1e-10
